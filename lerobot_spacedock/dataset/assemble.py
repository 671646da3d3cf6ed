"""Puts the finished shards of a job together into the dataset, and says how it was made."""

from __future__ import annotations

import logging
import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from lerobot_spacedock.dataset.card import write_card
from lerobot_spacedock.dataset.encoder import quiet_encoders
from lerobot_spacedock.dataset.job import Job, Plan
from lerobot_spacedock.dataset.provenance import write_dataset_facts, write_episode_rows
from lerobot_spacedock.dataset.record import datasets_cache, prepare_libraries
from lerobot_spacedock.dataset.shards import SUMMARY_FILE, read_summary
from lerobot_spacedock.dataset.statistics import repair_statistics
from lerobot_spacedock.errors import FileFormatError, SpaceDockError
from lerobot_spacedock.folders import free_space

# LeRobot holds the metadata of all that it merges, and rewrites the file it appends to once for each of them
MERGE_AT_ONCE = 8


@dataclass(frozen=True)
class Total:
    """What a dataset holds.

    Attributes:
        episodes, frames: sizes.
        left_out: (episode, reason) of each that could not be read.
        notes: further sentences for whoever ran the command.
    """

    episodes: int
    frames: int
    left_out: list[tuple[str, str]]
    notes: list[str]


def assemble(job: Job) -> Total:
    """Makes the dataset at ``job.root`` out of the shards, all of which have to be finished.

    Returns:
        What it holds and what was left out.

    Raises:
        FileFormatError: no episode at all could be read.
        SpaceDockError: writing failed; the shards stay, and the same command goes on from them.
    """
    plan = Plan.read(job.plan_path)
    total, shards = _count(job, plan.num_shards)
    if not total.episodes:
        listed = "; ".join(f"{name}: {reason}" for name, reason in total.left_out[:3])
        raise FileFormatError(f"None of {len(total.left_out)} episodes could be read. {listed}")
    complete = job.folder / "complete"
    shutil.rmtree(complete, ignore_errors=True)
    try:
        _merge_by_parts(shards, plan, job.folder / "merged", complete)
        repair_statistics(complete)
        write_episode_rows(complete, (read_summary(job, index).rows for index in range(plan.num_shards)))
        facts = plan.facts | {"left_out": total.left_out} if total.left_out else plan.facts
        facts = facts | {"notes": total.notes} if total.notes else facts
        write_dataset_facts(complete, facts, plan.layout.columns())
        write_card(complete, plan.layout.repo_id)
    except (OSError, RuntimeError) as error:
        raise SpaceDockError(
            f"{complete}: putting the shards together failed ({error}). {free_space(job.folder)} "
            "The shards are kept: run the same command again."
        ) from error
    job.finish(complete)
    return total


def _count(job: Job, num_shards: int) -> tuple[Total, list[Path]]:
    """The sizes of all shards together, and the folders of those that hold something."""
    episodes, frames, left_out, shards = 0, 0, [], []
    sizes: Counter[str] = Counter()
    assumed: Counter[str] = Counter()
    for index in range(num_shards):
        summary = read_summary(job, index)
        episodes, frames = episodes + len(summary.rows), frames + summary.frames
        left_out += summary.left_out
        sizes.update(summary.resized)
        assumed.update(summary.assumed)
        if summary.rows:
            shards.append(job.shard(index))
    notes = [f"pictures of {count} episodes were scaled: {size}" for size, count in sorted(sizes.items())]
    notes += [f"{what} ({count} episodes)" for what, count in sorted(assumed.items())]
    return Total(episodes, frames, left_out, notes), shards


def _merge_by_parts(shards: list[Path], plan: Plan, scratch: Path, complete: Path) -> None:
    """Merges a few at a time, and what comes of that again, so that neither memory nor time an episode grow.

    From the second round on data files are taken as they are: several, of hundreds of episodes each.
    """
    level = 0
    while len(shards) > MERGE_AT_ONCE:
        parts = [shards[at : at + MERGE_AT_ONCE] for at in range(0, len(shards), MERGE_AT_ONCE)]
        folder = scratch / str(level)
        shutil.rmtree(folder, ignore_errors=True)
        merged = [folder / f"{number:06d}" for number in range(len(parts))]
        for part, target in zip(parts, merged, strict=True):
            _merge(part, plan, target, concatenate=level == 0)
        if level:
            shutil.rmtree(scratch / str(level - 1))
        shards, level = merged, level + 1
    _merge(shards, plan, complete, concatenate=level == 0)


def _merge(shards: list[Path], plan: Plan, complete: Path, *, concatenate: bool) -> None:
    if len(shards) == 1:
        shutil.copytree(shards[0], complete, ignore=shutil.ignore_patterns(SUMMARY_FILE))
        return
    from lerobot.datasets.aggregate import aggregate_datasets

    quiet_encoders()
    prepare_libraries()
    repo_id = plan.layout.repo_id
    quiet = logging.getLogger("lerobot.datasets.aggregate")
    before = quiet.level
    quiet.setLevel(logging.WARNING)
    try:
        with datasets_cache(complete.with_name(f"{complete.name}_cache")):
            aggregate_datasets(
                [repo_id] * len(shards), repo_id, roots=shards, aggr_root=complete, concatenate_data=concatenate
            )
    finally:
        quiet.setLevel(before)
