"""``spacedock demos``: flies an expert, keeps the best episodes, draws them, writes a LeRobotDataset.

Every flight is an episode log the moment it ends, every shard a whole dataset the moment it is written, and the
dataset appears under its name only when it is complete: a job that was killed goes on from there by the same command.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset.assemble import assemble
from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig, disturbs
from lerobot_spacedock.dataset.encoder import check_encoder
from lerobot_spacedock.dataset.flight import fly
from lerobot_spacedock.dataset.frames import check_drawing, drawing_options
from lerobot_spacedock.dataset.job import Job, Plan, shard_count
from lerobot_spacedock.dataset.next_commands import TRAINING_HINT, train_command
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.record import DatasetLayout, Storage
from lerobot_spacedock.dataset.roots import check_repo_id, dataset_root
from lerobot_spacedock.dataset.scale import ExecutorConfig, run_executor
from lerobot_spacedock.dataset.segments import Segment, pieces
from lerobot_spacedock.dataset.selection import RULES, best, check_rule, score
from lerobot_spacedock.dataset.sources import EpisodeRef
from lerobot_spacedock.dataset.workers import check_workers
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS, withholds_pose
from lerobot_spacedock.env.scenario_config import get_initial_conditions
from lerobot_spacedock.episode_log import EpisodeLog, log_path, read_episode_log, write_episode_log
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.expert.controllers import check_expert, make_expert
from lerobot_spacedock.files import aside, write_json
from lerobot_spacedock.folders import check_writable
from lerobot_spacedock.invocation import available_cores, command_line

FIRST_EVALUATION_SEED, LAST_EVALUATION_SEED = 1000, 1999
FLIGHT_BLOCK = 256


@dataclass
class DemosConfig:
    """Fly an expert, keep the best episodes, draw them, write a LeRobotDataset."""

    # user/name of the dataset
    repo_id: str
    # folder of the dataset; by default LeRobot's own place for this repo_id. Must not exist
    root: str | None = None
    # how many demonstrations to keep
    num_episodes: int = 100
    # how many to fly; by default half as many again as are kept
    num_candidates: int | None = None
    # meta_rl | meta_rl_sampled | meta_rl_forgetful | mpc (arrives when it costs least) | mpc_fixed (at a deadline) |
    # zem | W | V | Q (hand-designed time-invariant laws) | mpc_adaptive | W_adaptive (with an estimate of the thrust)
    # | MODULE:FACTORY of your own (examples/own_controller.py)
    expert: str = "meta_rl"
    # a meta-RL checkpoint, file or folder, or gentle, which ships for docking without a deadline, or hold, which ships
    # for stopping at the port within the 65 steps of SpaceDock-v0; by default the one that ships for passing it then
    checkpoint: str | None = None
    # first | distance | propellant | smoothness | return: what the best are best at
    select: str = "distance"
    # successful dockings rank before all others
    successes_first: bool = True
    # SpaceDock-v0 | SpaceDockContact-v0 | SpaceDockMeta-v0 | SpaceDockVision-v0 (the expert sees the state, the dataset
    # shows velocity, rates and the picture). lerobot-eval flies SpaceDock-v0 unless --env.task names this one
    env_id: str = "SpaceDockContact-v0"
    # same | random | same_dispersed | wide, or several with commas, taken in turn
    initial_conditions: str = "same"
    # zvezda_aft | harmony_forward
    port: str = "zvezda_aft"
    # most steps in an episode; by default the environment's
    max_steps: int | None = None
    # seed of the first episode; the others follow. Evaluations begin at 1000: keep away from there
    seed: int = 100_000
    # disturbances added to the executed command, the label staying clean: sparse kicks
    kicks: KickConfig = field(default_factory=KickConfig)
    # the same: coloured noise on every step
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    # all | last:10m | last:20s | last:30: which part of each episode
    segment: str = "all"
    # write each whole episode once and its segment so many times more
    repeat_terminal: int = 0
    # the observed state carries the mass (14 values)
    with_mass: bool = False
    # False writes states and actions alone
    image: bool = True
    camera: CameraConfig = field(default_factory=CameraConfig)
    # software | pyrender
    renderer: str = "software"
    # fixed | random | orbit | eclipse
    sun: str = "fixed"
    storage: Storage = field(default_factory=Storage)
    # what the dataset says the task is
    task: str = "dock with the International Space Station"
    # folder into which the logs of the kept episodes are copied (what spacedock report reads)
    log_dir: str | None = None
    # processes (or tasks at a time) that draw and encode; 0 takes one a core
    num_workers: int = 0
    # where episodes are drawn and encoded: this machine's processes, or tasks of a pipeline
    executor: ExecutorConfig = field(default_factory=ExecutorConfig)

    def env_config(self, initial_conditions: str) -> SpaceDockConfig:
        """The environment that is flown, as gymnasium would make it."""
        options = dict(ENV_IDS[self.env_id])
        if self.max_steps is not None:
            options["max_steps"] = self.max_steps
        return SpaceDockConfig(
            **options,
            env_id=self.env_id,
            initial_conditions=initial_conditions,
            port=self.port,
            with_mass=self.with_mass,
            camera=self.camera,
            renderer=self.renderer,
            sun=self.sun,
            label=self.expert,
        )

    @property
    def starts(self) -> tuple[str, ...]:
        return tuple(name.strip() for name in self.initial_conditions.split(","))

    @property
    def candidates(self) -> int:
        return -(-3 * self.num_episodes // 2) if self.num_candidates is None else self.num_candidates

    def settings(self) -> dict[str, Any]:
        """What decides the data: a job can only go on with the same."""
        values = asdict(self)
        for name in ("root", "log_dir", "num_workers", "executor"):
            values.pop(name)
        return values


def demos(config: DemosConfig) -> int:
    """Runs the verb; see the module."""
    _check(config)
    root = dataset_root(config.repo_id, config.root)
    if config.log_dir is not None:
        check_writable(Path(config.log_dir), "--log_dir")  # it is used last, after hours
    job = Job(root)
    with job.disk_errors(), job.lock():
        resumed = job.begin(config.settings())
        if resumed:
            print(f"Going on with the unfinished job in {job.folder}")
        _fly_candidates(config, job)
        kept, facts = _select(config, job)
        if not job.plan_path.exists():
            job.write_plan(_plan(config, len(kept), facts), kept)
        run_executor(job, config.executor, num_workers=config.num_workers, total_frames=facts["frames"])
        if config.log_dir is not None:
            _copy_logs(kept, Path(config.log_dir))
        total = assemble(job)
    chosen = facts["selection"]
    print(f"Wrote {total.episodes} episodes, {total.frames} frames to {root}")
    print(
        f"  kept {chosen['kept']} of {chosen['flown']} flown ({chosen['rule_text']}); {chosen['docked']} of them docked"
    )
    if disturbs(config.kicks, config.noise):
        print("  (They were pushed off course on purpose; the labels are what the expert commanded to come back.)")
    reader = DatasetReader(root)
    print(f"Next: spacedock check --repo_id={config.repo_id} --root={root}")
    print(f"      {' '.join(train_command(reader, config.repo_id, root))}")
    if reader.cameras:
        print(f"      {TRAINING_HINT}")
    return 0


def _check(config: DemosConfig) -> None:
    check_repo_id(config.repo_id)
    check_expert(config.expert)
    if config.checkpoint is not None and not config.expert.startswith("meta_rl"):
        raise InputError("--checkpoint", config.checkpoint, "nothing, unless --expert=meta_rl")
    if config.checkpoint is not None:
        from lerobot_spacedock.expert.checkpoint import NAMED, find_checkpoint

        if not find_checkpoint(config.checkpoint).is_file():
            allowed = f"{' | '.join(NAMED)}, or a file or folder that spacedock train-expert wrote"
            raise InputError("--checkpoint", config.checkpoint, allowed, "Left out, it is the one that ships.")
    check_rule(config.select)
    if config.env_id not in ENV_IDS:
        raise InputError("--env_id", config.env_id, " | ".join(ENV_IDS))
    if config.task in ENV_IDS:
        raise InputError("--task", config.task, "the task in words", f"The environment is --env_id={config.task}.")
    for name in config.starts:
        get_initial_conditions(name)
    if config.num_episodes < 1:
        raise InputError("--num_episodes", config.num_episodes, "at least 1")
    if config.candidates < config.num_episodes:
        raise InputError("--num_candidates", config.num_candidates, f"at least --num_episodes={config.num_episodes}")
    check_workers(config.num_workers)
    if config.seed < 0:
        raise InputError("--seed", config.seed, "0 or more")
    if config.seed <= LAST_EVALUATION_SEED and config.seed + config.candidates > FIRST_EVALUATION_SEED:
        seeds = f"{FIRST_EVALUATION_SEED:,} to {LAST_EVALUATION_SEED:,}"
        print(f"warning: --seed={config.seed}: LeRobot evaluates on seeds from 1000; {seeds} are better left to it")
    if config.repeat_terminal < 0 or (config.repeat_terminal and Segment.parse(config.segment).whole):
        raise InputError("--repeat_terminal", config.repeat_terminal, "0, or more with a --segment such as last:10m")
    Segment.parse(config.segment)
    disturbs(config.kicks, config.noise)
    for name in config.starts:
        config.env_config(name)
    _layout(config).columns()
    check_encoder(_layout(config))
    if config.image and config.executor.here:
        check_drawing(drawing_options(config.env_config(config.starts[0])))


def _layout(config: DemosConfig) -> DatasetLayout:
    return DatasetLayout(
        repo_id=config.repo_id,
        height=config.camera.height,
        width=config.camera.width,
        with_mass=config.with_mass,
        withhold_pose=withholds_pose(config.env_id),
        image=config.image,
        task=config.task,
        storage=config.storage,
    )


def flight_blocks(config: DemosConfig) -> Iterator[tuple[SpaceDockConfig, np.ndarray]]:
    """The environment and the seeds of each block of candidates that is flown at once."""
    seeds = config.seed + np.arange(config.candidates)
    sets = np.arange(config.candidates) % len(config.starts)
    for index, name in enumerate(config.starts):
        own = seeds[sets == index]
        for at in range(0, len(own), FLIGHT_BLOCK):
            yield config.env_config(name), own[at : at + FLIGHT_BLOCK]


def fly_block(config: DemosConfig, env: SpaceDockConfig, block: np.ndarray) -> Iterator[EpisodeLog]:
    """The flights of one block; an expert that samples its actions draws other noise in every block."""
    policy = make_expert(config.expert, env, checkpoint=config.checkpoint, seed=int(block[0]))
    disturbance = Disturbance.draw(block, env.max_steps, config.kicks, config.noise)
    return fly(policy, env, block, disturbance)


def _fly_candidates(config: DemosConfig, job: Job) -> None:
    """Flies what has not been flown; each episode is a file of its own the moment its block has ended."""
    with tqdm(total=config.candidates, unit="flight", desc="Flying") as bar:
        for env, block in flight_blocks(config):
            if not all(log_path(job.flights, seed).exists() for seed in block):
                for log in fly_block(config, env, block):
                    write_episode_log(log_path(job.flights, log.metadata["seed"]), log)
            bar.update(len(block))


def _select(config: DemosConfig, job: Job) -> tuple[list[EpisodeRef], dict[str, Any]]:
    """The kept flights, and what the dataset says of how it was made; decided once, then read again."""
    path = job.folder / "selection.json"
    if not path.exists():
        seeds = [config.seed + i for i in range(config.candidates)]
        scores, successes, lengths = [], [], []
        segment = Segment.parse(config.segment)
        for seed in seeds:
            log = read_episode_log(log_path(job.flights, seed))
            scores.append(score(log, config.select))
            successes.append(bool(log.metadata["success"]))
            lengths.append(
                sum(part.num_steps for _, part in pieces(log, segment, repeat_terminal=config.repeat_terminal))
            )
        kept = best(scores, successes, config.num_episodes, successes_first=config.successes_first)
        text = RULES[config.select][1]
        chosen = {
            "kept": len(kept),
            "flown": len(seeds),
            "rule": config.select,
            "rule_text": f"successes first, then {text}" if config.successes_first else text,
            "docked": sum(successes[i] for i in kept),
            "docked_of_flown": sum(successes),
            "seeds": [seeds[i] for i in kept],
        }
        write_json(path, {"frames": sum(lengths[i] for i in kept), "selection": chosen, "command": command_line()})
    facts = json.loads(path.read_text())
    flights = job.flights.resolve()
    return [EpisodeRef("logs", str(log_path(flights, seed))) for seed in facts["selection"]["seeds"]], facts


def _plan(config: DemosConfig, kept: int, facts: dict[str, Any]) -> Plan:
    from lerobot_spacedock.expert.checkpoint import training_counts

    env = config.env_config(config.starts[0])
    return Plan(
        layout=_layout(config),
        num_shards=shard_count(kept, config.num_workers or available_cores()),
        drawing=drawing_options(env) if config.image else None,
        segment=config.segment,
        repeat_terminal=config.repeat_terminal,
        facts={
            "made_by": "spacedock demos",
            "command": facts["command"],
            "expert": {
                "name": config.expert,
                "checkpoint": config.checkpoint,
                "training": training_counts(config.expert, config.checkpoint),
            },
            "env": asdict(env),
            "initial_conditions": list(config.starts),
            "first_seed": config.seed,
            "disturbance": {"kicks": asdict(config.kicks), "noise": asdict(config.noise)}
            if disturbs(config.kicks, config.noise)
            else None,
            "selection": facts["selection"],
            "segment": config.segment,
            "repeat_terminal": config.repeat_terminal,
            "storage": asdict(config.storage),
            "drawing": drawing_options(env) if config.image else None,
        },
    )


def _copy_logs(kept: list[EpisodeRef], folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for ref in kept:
            with aside(folder / Path(ref.path).name) as own:
                shutil.copyfile(ref.path, own)
    except OSError as error:
        raise SpaceDockError(f"--log_dir={folder}: writing failed ({error}).") from error
