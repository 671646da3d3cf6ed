"""Every long command in its smallest form, and what of its result has to be the same after any number of kills."""

from __future__ import annotations

import functools
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from killed import Command, files_of

sys.path.insert(0, str(Path(__file__).parents[1] / "dataset"))  # its hub and its sample flights

CLI = "lerobot_spacedock.cli:main"
SMALL = ("--camera.height=48", "--camera.width=64")
REPO = "test/killed"
# whatever a command imports on its way, so that no moment falls into it
LIBRARIES = (
    "lerobot_spacedock.dataset.demos",
    "lerobot_spacedock.dataset.convert",
    "lerobot_spacedock.dataset.push",
    "lerobot_spacedock.dataset.record",
    "lerobot_spacedock.expert.train",
    "lerobot_spacedock.expert.controllers",
    "lerobot_spacedock.study.sweep",
    "lerobot_spacedock.camera.software",
    "lerobot.datasets.lerobot_dataset",
    "lerobot.datasets.aggregate",
    "lerobot.scripts.lerobot_eval",
    "huggingface_hub.hf_api",
)


# ---- datasets


def demos_arguments(*options: str) -> Sequence[str]:
    return (
        *("demos", f"--repo_id={REPO}", "--root=data", "--expert=V", "--num_episodes=6", "--num_candidates=8"),
        *("--kicks.probability=0.1", "--kicks.quiet_m=3.0", "--log_dir=logs", *options),
    )


def dataset_result(folder: Path) -> object:
    return {"data": files_of(folder / "data"), "logs": files_of(folder / "logs"), "left": leftovers(folder)}


LEFT = (".part", ".tmp", ".lock", ".trash")


def leftovers(folder: Path) -> list[str]:
    """Working folders and half-written files that are still there."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.name.endswith(LEFT))


def finished_logs_are_whole(folder: Path) -> None:
    """Every flight that has its name can be read, and the dataset is there complete or not at all."""
    from lerobot_spacedock.dataset.integrity import check_dataset
    from lerobot_spacedock.episode_log import iterate_episode_logs

    for place in (folder / "data.part" / "flights", folder / "logs"):
        assert all(log.num_steps > 5 for _, log in iterate_episode_logs(place))
    for shard in (folder / "data.part" / "shards").glob("shard_*"):
        assert (shard / "shard.json").exists(), f"{shard.name} has its name and is not whole"
    if (folder / "data").exists():
        assert check_dataset(folder / "data", sample_frames=0, redraw=False).errors == []


def fly_logs(folder: Path) -> None:
    """Six episode logs in ``folder/flown``."""
    from dataset_samples import fly_some

    from lerobot_spacedock.episode_log import log_path, write_episode_log

    for log in fly_some(range(100_000, 100_006)):
        write_episode_log(log_path(folder / "flown", log.metadata["seed"]), log)


def convert_arguments(folder: Path) -> Sequence[str]:
    return ("convert", "--source=flown", f"--repo_id={REPO}", "--root=data", "--images=none", "--num_workers=1")


# ---- the hub


@functools.cache
def hub():
    """The one hub of this process; commands know it from their environment, so it comes before their server."""
    from local_hub import TOKEN, LocalHub

    running = LocalHub()
    running.__enter__()
    os.environ |= {
        "HF_ENDPOINT": running.url, "HF_TOKEN": TOKEN, "HF_HUB_DISABLE_XET": "1", "HF_HUB_DISABLE_TELEMETRY": "1",
        "HF_HUB_OFFLINE": "0"
    }  # fmt: skip
    return running


class Pushed:
    """A dataset on that hub; pushes run in another process."""

    def __init__(self, large: str) -> None:
        self.large, self.hub = large, hub()

    def prepare(self, folder: Path) -> None:
        from dataset_samples import fly_some, short, write_raw_export

        from lerobot_spacedock.camera import CameraConfig
        from lerobot_spacedock.dataset.convert import ConvertConfig, convert

        write_raw_export(folder / "raw", [short(log, 6) for log in fly_some(range(100_000, 100_002))], pictures=True)
        source, root = str(folder / "raw"), str(folder / "sent")
        small = CameraConfig(height=48, width=64)
        convert(ConvertConfig(source, REPO, format="raw", root=root, camera=small, num_workers=1))

    def arguments(self, folder: Path) -> Sequence[str]:
        return ("push", f"--repo_id={REPO}", "--root=sent", f"--large={self.large}", "--revision_tag=v1.0")

    def result(self, folder: Path) -> object:
        repository = self.hub.repositories[("dataset", REPO)]
        own = files_of(folder / "sent", without=(".cache",))
        arrived = {tag: dict(repository.files(tag)) for tag in ("main", "v3.0", "v1.0")}
        for files in arrived.values():
            files.pop(".gitattributes", None)
        return {"own": own, "private": repository.private, **{tag: files == own for tag, files in arrived.items()}}

    def after_kill(self, folder: Path) -> None:
        from lerobot_spacedock.dataset.integrity import check_dataset

        assert check_dataset(folder / "sent", sample_frames=0, redraw=False).errors == []

    def clean(self, folder: Path) -> None:
        with self.hub.lock:
            self.hub.repositories.clear()
            self.hub.blobs.clear()


# ---- training, evaluation, sweep


def train_arguments(folder: Path) -> Sequence[str]:
    return (
        *("train-expert", "--output_dir=expert", f"--interactions={12 * 8 * 20}", "--num_envs=8", "--episode_steps=20"),
        *("--checkpoint_every=1", "--evaluate_every=4", "--evaluation_episodes=4"),
        *("--ppo.epochs=2", "--ppo.mini_batches=2", "--ppo.critic_hidden_sizes=[16]"),
        *("--actor.lstm_size=8", "--actor.hidden_sizes=[8]"),
    )


def train_again(folder: Path) -> Sequence[str]:
    """With ``--resume=true``, which is refused where nothing has begun."""
    begun = any((folder / "expert").glob("config.json*"))
    return (*train_arguments(folder), *(["--resume=true"] if begun else []))


def train_result(folder: Path) -> object:
    from safetensors.numpy import load_file

    record = json.loads((folder / "expert" / "training.json").read_text())
    record = {name: value for name, value in record.items() if not name.endswith("_s")}
    record["config"].pop("resume")
    for point in record["curve"]:
        point.pop("wall_s"), point.pop("cpu_s")
    return {"weights": load_file(folder / "expert" / "policy.safetensors"), "record": record}


def eval_arguments(folder: Path) -> Sequence[str]:
    return (
        *("--policy.type=spacedock_feedback", "--policy.device=cpu", "--env.type=spacedock"),
        *("--env.task=SpaceDockContact-v0", "--env.obs_type=agent_pos", "--env.camera.height=48"),
        *("--env.camera.width=64", "--eval.n_episodes=6", "--eval.batch_size=2", "--eval.use_async_envs=false"),
        *("--eval.recording=false", "--output_dir=eval", "--env.log_dir=logs", "--seed=1000"),
    )


def eval_again(folder: Path) -> Sequence[str]:
    """An evaluation is flown again, into another folder: the finished episodes of the killed one stay."""
    number = sum(1 for _ in folder.glob("logs*"))
    return [a.replace("=logs", f"=logs_{number}").replace("=eval", f"=eval_{number}") for a in eval_arguments(folder)]


def flown(folder: Path) -> dict:
    """What flew, by episode; without the times that the policy took."""
    from lerobot_spacedock.episode_log import iterate_episode_logs

    return {
        path.name: (log.time, log.state, log.action, log.reward, log.metadata["outcome"])
        for path, log in iterate_episode_logs(folder)
    }


def eval_result(folder: Path) -> object:
    """The last evaluation; and all that any killed one had finished is part of it."""
    from killed import same

    logs = max(folder.glob("logs*"), key=lambda path: path.stat().st_mtime_ns)
    whole = flown(logs)
    agree = all(same(log, whole[name]) for other in folder.glob("logs*") for name, log in flown(other).items())
    lines = [json.loads(line) for line in (logs / "eval_metrics.jsonl").read_text().splitlines()]
    return {"flown": whole, "agree": agree, "episodes": [(line["seed"], line["is_success"]) for line in lines]}


def lines_are_whole(folder: Path) -> None:
    for logs in folder.glob("logs*"):
        flown(logs)
        if (logs / "eval_metrics.jsonl").exists():
            names = {f"episode_{json.loads(x)['seed']:06d}.parquet" for x in (logs / "eval_metrics.jsonl").open()}
            assert names <= {path.name for path in logs.glob("episode_*.parquet")}


def sweep_arguments(folder: Path) -> Sequence[str]:
    return (
        *("sweep", "--name=little", "--output_dir=study", "--results=little.json", "--steps=[3]", "--seeds=[0,1]"),
        *("--chunk_sizes=[5,10]", "--num_demonstrations=[2]", "--dim_models=[16]", "--batch_sizes=[4]"),
        *("--tasks=[SpaceDockContact-v0/same]", "--episodes=2"),
    )


def sweep_result(folder: Path) -> object:
    content = json.loads((folder / "little.json").read_text())
    for trial in content["trials"]:
        trial.pop("cpu_s")
    return content


def results_are_whole(folder: Path) -> None:
    if (folder / "little.json").exists():
        sweep_result(folder)


DATASETS = ("data", "data.part", ".data.*", "logs")


def dataset_there(folder: Path) -> bool:
    return (folder / "data").exists()


COMMANDS = {
    "demos": lambda: _demos("states alone", "--image=false", "--num_workers=1"),
    "demos_frames": lambda: _demos("video", *SMALL, "--num_workers=1"),
    "demos_workers": lambda: _demos("two workers", "--image=false", "--num_workers=2"),
    "convert": lambda: Command(
        "spacedock convert", CLI, convert_arguments, dataset_result, DATASETS,
        prepare=fly_logs, after_kill=finished_logs_are_whole, finished=dataset_there,
    ),
    "push": lambda: _push("never"),
    "push_large": lambda: _push("always"),
    "train-expert": lambda: Command(
        "spacedock train-expert", CLI, train_arguments, train_result, ("expert",),
        again=train_again,
    ),
    "eval": lambda: Command(
        "lerobot-eval", "lerobot.scripts.lerobot_eval:main", eval_arguments, eval_result, ("eval*", "logs*"),
        again=eval_again, after_kill=lines_are_whole,
    ),
    "sweep": lambda: Command(
        "spacedock sweep", CLI, sweep_arguments, sweep_result, ("study", "little.json", "little.tmp"),
        after_kill=results_are_whole,
    ),
}  # fmt: skip


def _demos(words: str, *options: str) -> Command:
    return Command(
        f"spacedock demos ({words})", CLI, lambda folder: demos_arguments(*options), dataset_result, DATASETS,
        after_kill=finished_logs_are_whole, finished=dataset_there,
    )  # fmt: skip


def _push(large: str) -> Command:
    to = Pushed(large)
    name = "spacedock push" if large == "never" else f"spacedock push --large={large}"
    return Command(
        name,
        CLI,
        to.arguments,
        to.result,
        ("sent/.cache",),
        prepare=to.prepare,
        after_kill=to.after_kill,
        clean=to.clean,
    )
