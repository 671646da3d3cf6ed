"""``spacedock train-expert``: recurrent PPO from nothing to a policy that docks, with a checkpoint to resume from."""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
import re
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from lerobot_spacedock import __version__
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.errors import InputError, SimulationError
from lerobot_spacedock.expert.checkpoint import save_actor
from lerobot_spacedock.expert.demonstrations import find_dataset
from lerobot_spacedock.expert.evaluate import TASKS, VALIDATION_SEED, fly
from lerobot_spacedock.expert.imitate import freeze_actor, imitate
from lerobot_spacedock.expert.meta_rl import MetaRlPolicy
from lerobot_spacedock.expert.ppo import collect, make_ppo, set_std_ceiling
from lerobot_spacedock.expert.smooth_ppo import LEARNING_RATE_RANGE, SmoothPPO
from lerobot_spacedock.expert.train_config import TrainExpertConfig
from lerobot_spacedock.expert.train_state import (
    TRAINING_FILE,
    account_of,
    checkpoints,
    export_actor,
    load_checkpoint,
    load_networks,
    refuse_other_config,
    save_checkpoint,
)
from lerobot_spacedock.expert.training_tasks import TrainingTasks
from lerobot_spacedock.files import read_object, write_json
from lerobot_spacedock.folders import disk_errors, only_process

__all__ = ["TrainExpertConfig", "train_expert"]

VALIDATION_TASKS = ("fixed same", "contact same", "meta random")


def train_expert(config: TrainExpertConfig) -> int:
    """Trains; writes checkpoints, logs, ``policy.safetensors`` and ``training.json`` under ``config.output_dir``.

    Raises:
        InputError: an option that cannot be used, or an output folder that exists.
        FileFormatError: nothing to resume from, or a checkpoint of another configuration.
    """
    output = Path(config.output_dir).expanduser()
    resolved = json.loads(json.dumps(asdict(config)))
    again = "With room, the same command goes on from the last checkpoint with --resume=true."
    with disk_errors(output, again), only_process(output, "--output_dir"):
        _prepare(config, output, resolved)
        with _fast_arithmetic(config.threads):
            _train(config, output, resolved)
    return 0


@contextlib.contextmanager
def _fast_arithmetic(threads: int) -> Iterator[None]:
    """Flushes subnormal numbers (in decaying LSTM states they cost a factor and mean nothing); undone at the end."""
    np.finfo(np.float32), np.finfo(np.float64)  # numpy looks at subnormals once, and warns if they are gone by then
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
        torch.set_num_threads(before)


def _train(config: TrainExpertConfig, output: Path, resolved: dict[str, Any]) -> None:
    tasks = TrainingTasks(config)
    algorithm = make_ppo(config, tasks.reset(0))
    progress: dict[str, Any] = {
        "iteration": 0, "interactions": 0, "episodes": 0, "wall_s": 0.0, "cpu_s": 0.0, "collect_s": 0.0, "learn_s": 0.0,
        "evaluate_s": 0.0, "imitation_s": 0.0, "demonstration_frames": 0, "smoothness_price": 1.0,
        "earlier_episodes": 0, "earlier_interactions": 0, "curve": [],
    }  # fmt: skip
    after = 0 if config.resume else None
    if config.resume and checkpoints(output / "checkpoints"):
        progress |= load_checkpoint(output / "checkpoints", algorithm, resolved)
        after = progress["interactions"] + 1  # the points of a run that was killed later; the checkpoint's own stays
    elif starts_from_checkpoint(config):
        progress |= load_networks(config, algorithm)
    elif config.init_from is not None:
        progress |= imitate(config, algorithm)

    writer = SummaryWriter(str(output / "tensorboard"), purge_step=after)
    stop_at = config.iterations
    if config.stop_after:
        stop_at = min(stop_at, config.stop_after)
    per_iteration = config.num_envs * config.episode_steps
    clock = _Clock(progress)
    bar = tqdm(
        total=config.iterations * per_iteration, initial=progress["interactions"], unit="step", unit_scale=True,
        desc="train-expert", dynamic_ncols=True,
    )  # fmt: skip
    with writer, bar:
        if progress["iteration"] == 0:
            _evaluate(config, algorithm, progress, writer, bar)
        while progress["iteration"] < stop_at:
            _iterate(config, algorithm, tasks, progress, writer)
            bar.update(per_iteration)
            clock.read()
            # not at --stop_after, which an uninterrupted training would pass by: it changes the price of smoothness
            if progress["iteration"] == config.iterations or progress["iteration"] % config.evaluate_every == 0:
                _evaluate(config, algorithm, progress, writer, bar)
                clock.read()
            if progress["iteration"] == stop_at or progress["iteration"] % config.checkpoint_every == 0:
                save_checkpoint(output / "checkpoints", config, algorithm, progress, resolved)
    _finish(config, algorithm, progress, output, resolved)


class _Clock:
    """Keeps wall and processor time of the training in ``progress``, over all its runs."""

    def __init__(self, progress: dict[str, Any]) -> None:
        self._progress = progress
        self._wall = progress["wall_s"] - time.perf_counter()
        self._cpu = progress["cpu_s"] - time.process_time()

    def read(self) -> None:
        self._progress["wall_s"] = self._wall + time.perf_counter()
        self._progress["cpu_s"] = self._cpu + time.process_time()


def _prepare(config: TrainExpertConfig, output: Path, resolved: dict[str, Any]) -> None:
    if output.exists() and not output.is_dir():
        raise InputError("--output_dir", str(output), "a folder, there or not")
    if not config.resume and output.exists() and any(output.iterdir()):
        raise InputError(
            "output_dir",
            str(output),
            "a folder that does not exist yet",
            "Give another --output_dir, or --resume=true to go on from its last checkpoint.",
        )
    begun = any(output.glob("*config.json*"))  # and perhaps killed before its first checkpoint, or in writing this
    if config.resume and not begun:
        raise InputError("resume", str(output), "the output_dir of a training", "Start without --resume=true.")
    known = re.fullmatch(r"cpu|cuda(:\d+)?", config.device)
    gpu = int((known[1] or ":0")[1:]) if known else 0
    if not known or (config.device != "cpu" and gpu >= torch.cuda.device_count()):
        raise InputError("--device", config.device, "cpu, or cuda or cuda:N of a GPU that torch sees")
    if checkpoints(output / "checkpoints"):
        return  # which holds all that was started from
    if (output / "config.json").is_file():
        refuse_other_config(output / "config.json", read_object(output / "config.json"), resolved)
        print(f"{output}: no checkpoint yet; it begins from nothing.")
    if config.init_from is not None and not starts_from_checkpoint(config):
        find_dataset(config.init_from)
    elif config.init_from is not None:  # one of another shape is told of before there is a folder
        load_networks(config, make_ppo(config, TrainingTasks(config).reset(0)))
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / "config.json", resolved, indent=2, sort_keys=True)


def _iterate(config, algorithm, tasks, progress, writer) -> None:
    """One batch of episodes, one update."""
    fraction = progress["iteration"] / config.iterations
    if progress["demonstration_frames"]:
        frozen_for = config.init_critic_iterations - progress["iteration"]
        freeze_actor(algorithm, frozen_for > 0)
        if frozen_for == 0:  # the critic learned at a rate of which the actor knows nothing
            algorithm.learning_rate = LEARNING_RATE_RANGE[0]
    price = progress["smoothness_price"]
    tasks.smoothness_weight = price * smoothness_weight(config, fraction)
    algorithm.mean_change_coef = price * mean_change_coef(config, fraction)
    algorithm.desired_kl = desired_kl(config, fraction)
    set_std_ceiling(algorithm, std_ceiling(config, fraction))
    start = time.perf_counter()
    episode_return = collect(algorithm, tasks, progress["iteration"], config.episode_steps)
    middle = time.perf_counter()
    losses = _update(algorithm, f"iteration {progress['iteration']}, seed {config.seed}")
    end = time.perf_counter()
    progress["collect_s"] += middle - start
    progress["learn_s"] += end - middle
    progress["iteration"] += 1
    progress["episodes"] += config.num_envs
    progress["interactions"] += config.num_envs * config.episode_steps
    step = progress["interactions"]
    writer.add_scalar("train/return", episode_return, step)
    writer.add_scalar("train/value_loss", losses["value"], step)
    writer.add_scalar("train/surrogate_loss", losses["surrogate"], step)
    writer.add_scalar("train/mean_change_N", losses["mean_change"], step)
    writer.add_scalar("train/learning_rate", algorithm.learning_rate, step)
    writer.add_scalar("train/smoothness_weight", tasks.smoothness_weight, step)
    std = algorithm.actor.distribution.log_std_param.detach().exp()
    writer.add_scalar("train/std_thrust", std[:3].mean().item(), step)
    writer.add_scalar("train/std_torque", std[3:].mean().item(), step)
    writer.add_scalar("train/steps_per_s", config.num_envs * config.episode_steps / (end - start), step)


def _update(algorithm: SmoothPPO, where: str) -> dict[str, float]:
    """One update.

    Raises:
        SimulationError: the networks are not finite any more.
    """
    cause, losses = None, {}
    try:
        losses = algorithm.update()
    except RuntimeError as error:  # of torch's distribution, which refuses what is no number
        cause = error
    weights = [*algorithm.actor.parameters(), *algorithm.critic.parameters()]
    if not all(weight.isfinite().all() for weight in weights):
        mend = "The last checkpoint is from before; begin anew with a smaller ppo.learning_rate."
        raise SimulationError(
            f"train-expert: {where}: the networks' weights are not finite any more. {mend}"
        ) from cause
    if cause:
        raise cause
    return losses


def smoothness_weight(config: TrainExpertConfig, fraction: float) -> float:
    """Weight of the change of command after ``fraction`` of the training; grows exponentially to its final value."""
    final = config.reward.smoothness
    if final <= config.smoothness_start or config.smoothness_ramp == 0.0:
        return final
    along = min(fraction / config.smoothness_ramp, 1.0)
    return config.smoothness_start * (final / config.smoothness_start) ** along


def guarded_price(price: float, idss_percent: float, guard_percent: float) -> float:
    """The factor on the price of smoothness after an evaluation: a multiplier of "smooth, but docking all the same".

    Halved (to 1/16 at least) where fewer than ``guard_percent`` dock, else a square root of two larger, up to 1.
    """
    if idss_percent < guard_percent:
        return max(0.5 * price, 1.0 / 16.0)
    return min(math.sqrt(2.0) * price, 1.0)


def starts_from_checkpoint(config: TrainExpertConfig) -> bool:
    """``init_from`` is a checkpoint folder of another training, not a dataset."""
    return config.init_from is not None and (Path(config.init_from).expanduser() / TRAINING_FILE).is_file()


def mean_change_coef(config: TrainExpertConfig, fraction: float) -> float:
    """Price of the mean command's change in the loss: none while the policy learns to fly, then rising to its value."""
    start, end = config.ppo.mean_change_from, config.smoothness_ramp
    return config.ppo.mean_change_coef * float(np.clip((fraction - start) / max(end - start, 1e-9), 0.0, 1.0))


def std_ceiling(config: TrainExpertConfig, fraction: float) -> float:
    """Bound on the exploration: down to one value while the smoothness weight grows, then on to the final one."""
    start, middle, end = config.actor.initial_std, config.ppo.std_ceiling, config.ppo.final_std_ceiling
    ramp = config.smoothness_ramp
    if fraction < ramp:
        return start * (middle / start) ** (fraction / ramp)
    return middle * (end / middle) ** ((fraction - ramp) / max(1.0 - ramp, 1e-9))


def desired_kl(config: TrainExpertConfig, fraction: float) -> float:
    """Step size of an update: constant while the smoothness weight grows, then down to its final value."""
    ppo = config.ppo
    along = max(fraction - config.smoothness_ramp, 0.0) / max(1.0 - config.smoothness_ramp, 1e-9)
    return ppo.desired_kl * (ppo.final_desired_kl / ppo.desired_kl) ** along


def _evaluate(config, algorithm, progress, writer, bar) -> None:
    """The mean policy on validation episodes; a point of the learning curve."""
    start = time.perf_counter()
    random_state = torch.get_rng_state()
    policy = MetaRlPolicy(export_actor(config, algorithm))
    point: dict[str, Any] = {name: progress[name] for name in ("interactions", "episodes", "wall_s", "cpu_s")}
    for name in VALIDATION_TASKS:
        task: TaskConfig = replace(TASKS[name], meta=config.meta)
        seeds = VALIDATION_SEED + np.arange(config.evaluation_episodes)
        summary = {key: float(value) for key, value in fly(policy, task, seeds).summary().items()}
        point[name] = summary
        for key, value in summary.items():
            writer.add_scalar(f"{name.replace(' ', '_')}/{key}", value, progress["interactions"])
    torch.set_rng_state(random_state)
    progress["curve"].append(point)
    progress["evaluate_s"] += time.perf_counter() - start
    nominal, meta = point["contact same"], point["meta random"]
    worse = min(nominal["idss_percent"], meta["idss_percent"])
    progress["smoothness_price"] = guarded_price(progress["smoothness_price"], worse, config.smoothness_guard_percent)
    writer.add_scalar("train/smoothness_price", progress["smoothness_price"], progress["interactions"])
    bar.set_postfix_str(
        f"IDSS {nominal['idss_percent']:.0f}/{meta['idss_percent']:.0f} % "
        f"miss {100 * nominal['miss_mean_m']:.1f}/{100 * meta['miss_mean_m']:.1f} cm "
        f"smoothness {nominal['smoothness_mean']:.2f}"
    )


def _finish(config, algorithm, progress, output: Path, resolved: dict[str, Any]) -> None:
    """Writes the policy and the account of the training, and says what to do next."""
    account = account_of(progress)
    account["device"] = config.device
    account["processor"] = platform.processor() or platform.machine()
    account["cpu_count"] = os.cpu_count()
    account["torch"] = torch.__version__
    account["spacedock"] = __version__
    save_actor(output / "policy.safetensors", export_actor(config, algorithm), {"config": resolved, **account})
    record = account | {"config": resolved, "curve": progress["curve"]}
    write_json(output / "training.json", record, indent=2, sort_keys=True)
    minutes = {name: progress[f"{name}_s"] / 60.0 for name in ("wall", "cpu", "collect", "learn", "evaluate")}
    print(
        f"{progress['episodes']} episodes, {progress['interactions']} interactions, {minutes['wall']:.1f} min "
        f"(flying {minutes['collect']:.1f}, learning {minutes['learn']:.1f}, evaluating {minutes['evaluate']:.1f}), "
        f"{minutes['cpu']:.1f} min of processor time"
    )
    print(f"wrote {output / 'policy.safetensors'}, {output / 'training.json'}, {output / 'tensorboard'}")
    if progress["iteration"] < config.iterations:
        print(f"go on with: spacedock train-expert --output_dir={output} --resume=true … (not with --stop_after)")
    else:
        print(f"next: python -m lerobot_spacedock.expert.evaluate --checkpoint={output / 'policy.safetensors'}")
        print(f"      spacedock demos --repo_id=USER/NAME --checkpoint={output / 'policy.safetensors'}")
