"""Writes one shard of a job: some episodes as a LeRobotDataset of their own, whole or not there."""

from __future__ import annotations

import json
import os
import platform
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from lerobot_spacedock.dataset.frames import Artist, drawing_options
from lerobot_spacedock.dataset.job import Job, Plan, dotted
from lerobot_spacedock.dataset.provenance import episode_row
from lerobot_spacedock.dataset.record import DatasetRecorder
from lerobot_spacedock.dataset.segments import Segment, pieces
from lerobot_spacedock.dataset.source_env import stated_env
from lerobot_spacedock.dataset.sources import FURTHER, LAST_STATE, EpisodeRef, LoadedEpisode, load
from lerobot_spacedock.dataset.sources.pictures import resized
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.files import write_json
from lerobot_spacedock.metrics.episode import port_of

SUMMARY_FILE = "shard.json"
# keys of a log's metadata, each a sentence where the source has none, or what there is no place for
ASSUMED = ("times", "mass", "rewards", "readings", "chaser", LAST_STATE, FURTHER)


@dataclass(frozen=True)
class ShardSummary:
    """What a finished shard holds.

    Attributes:
        rows: of ``provenance.EPISODES_FILE``, one an episode written.
        left_out: (episode, reason) of each that could not be read.
        resized: how many episodes had stored pictures of another size, by "height × width → height × width".
        assumed: how many episodes came without something, by what stands in its place, or from another environment.
    """

    rows: list[dict]
    left_out: list[tuple[str, str]]
    resized: dict[str, int] = field(default_factory=dict)
    assumed: dict[str, int] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        return sum(row["length"] for row in self.rows)


def finished(job: Job, index: int) -> bool:
    """Whether the shard is complete: it gets its name only then."""
    return (job.shard(index) / SUMMARY_FILE).exists()


def read_summary(job: Job, index: int) -> ShardSummary:
    content = json.loads((job.shard(index) / SUMMARY_FILE).read_text())
    return ShardSummary(**content | {"left_out": [tuple(pair) for pair in content["left_out"]]})


def write_shard(root: Path | str, index: int, *, encoder_threads: int | None = None) -> ShardSummary:
    """Writes shard ``index`` of the job at ``root``; a finished one is left as it is.

    Args:
        root: of the dataset that is being made; the plan is read from its working folder.
        index: of the shard.
        encoder_threads: of the video encoder; None lets it decide.

    Raises:
        FileFormatError, InputError: an episode that cannot be used; with the plan's ``skip_bad`` it is left out.
    """
    job = Job(Path(root))
    if finished(job, index):
        return read_summary(job, index)
    plan = Plan.read(job.plan_path)
    # a name of its own: a worker that was given up may still be writing the same shard
    aside = job.shards / f".shard_{index:06d}.{platform.node()}.{os.getpid()}"
    shutil.rmtree(aside, ignore_errors=True)
    artist = Artist(**(plan.drawing or {}))
    try:
        with (job.progress / str(index)).open("wb", buffering=0) as progress:
            summary = _write(plan, job.shard_refs(index), aside, artist, progress, encoder_threads)
    except BaseException:
        shutil.rmtree(aside, ignore_errors=True)
        raise
    finally:
        artist.close()
    aside.mkdir(exist_ok=True)
    write_json(aside / SUMMARY_FILE, asdict(summary))
    try:
        os.rename(aside, job.shard(index))
    except OSError:
        shutil.rmtree(aside, ignore_errors=True)
        if not finished(job, index):
            raise
        return read_summary(job, index)  # another worker was first
    return summary


def remove_stale(job: Job) -> None:
    """Removes what killed workers left behind; while none is at work."""
    for aside in job.shards.glob(".shard_*"):
        shutil.rmtree(aside, ignore_errors=True)


def _write(
    plan: Plan,
    refs: list[EpisodeRef],
    aside: Path,
    artist: Artist,
    progress: BinaryIO,
    encoder_threads: int | None,
) -> ShardSummary:
    segment = Segment.parse(plan.segment)
    rows: list[dict] = []
    left_out: list[tuple[str, str]] = []
    changed: Counter[str] = Counter()
    assumed: Counter[str] = Counter()
    recorder: DatasetRecorder | None = None
    for ref in refs:
        try:
            episode = load(ref)
            _check_alike(plan, ref, episode.log)
            parts = pieces(episode.log, segment, repeat_terminal=plan.repeat_terminal)
            for number, (first, part) in enumerate(parts):
                recorder = recorder or DatasetRecorder(aside, plan.layout, encoder_threads=encoder_threads)
                sizes: set[tuple[int, int]] = set()
                frames = _frames(plan, episode, first, part, artist, progress, sizes)
                recorder.add_episode(part, frames, None if episode.tasks is None else episode.tasks[first:])
                size = f"{plan.layout.height} × {plan.layout.width}"
                changed.update(f"{height} × {width} → {size}" for height, width in sizes)
                rows.append(episode_row(part, source=ref.label, repeat=number))
            assumed.update(_remarks(plan, episode.log.metadata))
        except (FileFormatError, InputError) as error:
            if not plan.skip_bad:
                if recorder is not None:
                    recorder.discard_episode()
                    recorder.close()
                if isinstance(error, InputError) and not error.what.startswith("--"):
                    raise FileFormatError(f"{ref.name}: {error}") from error
                raise
            if recorder is not None:
                recorder.discard_episode()
            left_out.append((ref.label, reason_of(error, ref)))
    if recorder is not None:
        recorder.close()
    return ShardSummary(rows, left_out, dict(changed), dict(assumed))


def _remarks(plan: Plan, flown: dict[str, Any]) -> list[str]:
    """What a reader of the dataset should know of an episode: what was assumed, and that its environment is another."""
    remarks = [f"{name} {said}" for name in ASSUMED if (said := flown.get(name))]
    named = (plan.facts.get("env") or {}).get("env_id")
    if named and flown.get("env_id") not in (None, named):
        remarks.append(f"flown in {flown['env_id']}, where the environment named is the first flight's, {named}")
    return remarks


def _check_alike(plan: Plan, ref: EpisodeRef, log: EpisodeLog) -> None:
    """One dataset is of one port, and its pictures are drawn in one way: that of the first episode.

    Raises:
        InputError: this one is of another port, or states that its pictures are drawn otherwise.
    """
    port = port_of(log.metadata).name
    planned = plan.facts.get("port") or (plan.facts.get("env") or {}).get("port", port)
    if port != planned:
        mend = "Convert those of each port into a dataset of their own."
        raise InputError("--source", f"{ref.label} at {port}", f"flights to {planned}, as the first", mend)
    env = stated_env(log, {}) if plan.as_stated else None
    if env is None:
        return
    stated, drawn = (dotted(json.loads(json.dumps(options))) for options in (drawing_options(env), plan.drawing))
    for name in plan.as_stated:
        if stated[name] != drawn[name]:
            given, mend = f"{ref.label} with {name}={stated[name]}", f"Give --{name}, or convert the two apart."
            raise InputError("--source", given, f"{name}={drawn[name]}, as the first", mend)


def reason_of(error: Exception, ref: EpisodeRef) -> str:
    """Why an episode was left out, without the folders above it: it will be published with the dataset."""
    return str(error).replace(f"{Path(ref.path).parent}/", "").removeprefix(f"{ref.label}: ")


def _frames(
    plan: Plan,
    episode: LoadedEpisode,
    first: int,
    part: EpisodeLog,
    artist: Artist,
    progress: BinaryIO,
    sizes: set[tuple[int, int]],
) -> Iterator[np.ndarray] | None:
    if not plan.layout.image:
        progress.write(b"\0" * part.num_steps)
        return None
    if episode.frames is None or plan.redraw:
        return _counted(artist.draw(part), progress)
    return _counted(resized(episode.frames(first), plan.layout.height, plan.layout.width, sizes), progress)


def _counted(frames: Iterator[np.ndarray], progress: BinaryIO) -> Iterator[np.ndarray]:
    """The same frames; each leaves a byte in the progress file, by which whoever waits sees how far it is."""
    for frame in frames:
        progress.write(b"\0")
        yield frame


if __name__ == "__main__":
    write_shard(sys.argv[1], int(sys.argv[2]), encoder_threads=int(sys.argv[3]))
