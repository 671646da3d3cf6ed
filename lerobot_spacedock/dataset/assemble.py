"""Puts the finished shards of a job together into the dataset, and says how it was made."""

from __future__ import annotations

import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from lerobot_spacedock.dataset.card import write_card
from lerobot_spacedock.dataset.job import Job, Plan
from lerobot_spacedock.dataset.merge import merge_by_parts
from lerobot_spacedock.dataset.provenance import write_dataset_facts, write_episode_rows
from lerobot_spacedock.dataset.shards import read_summary
from lerobot_spacedock.dataset.statistics import repair_statistics
from lerobot_spacedock.errors import FileFormatError, SpaceDockError
from lerobot_spacedock.folders import free_space


@dataclass(frozen=True)
class Total:
    """What a dataset holds.

    Attributes:
        episodes, frames: sizes.
        left_out: (episode, reason) of each that could not be read.
        notes: further sentences for whoever ran the command.
        starts: the sets of starts that its episodes state.
    """

    episodes: int
    frames: int
    left_out: list[tuple[str, str]]
    notes: list[str]
    starts: list[str]


def assemble(job: Job) -> Total:
    """Makes the dataset at ``job.root`` out of the shards, all of which have to be finished.

    Returns:
        What it holds and what was left out.

    Raises:
        FileFormatError: no episode at all could be read.
        SpaceDockError: writing failed; the shards stay, and the same command goes on from them.
    """
    plan = Plan.read(job.plan_path)
    total, shards = _count(job, plan)
    if not total.episodes:
        listed = "; ".join(f"{name}: {reason}" for name, reason in total.left_out[:3])
        raise FileFormatError(f"None of {len(total.left_out)} episodes could be read. {listed}")
    complete = job.folder / "complete"
    shutil.rmtree(complete, ignore_errors=True)
    try:
        merge_by_parts(shards, plan.layout.repo_id, job.folder / "merged", complete)
        repair_statistics(complete)
        write_episode_rows(complete, (read_summary(job, index).rows for index in range(plan.num_shards)))
        facts = plan.facts | {"left_out": total.left_out} if total.left_out else plan.facts
        facts = facts | {"notes": total.notes} if total.notes else facts
        facts = {"initial_conditions": total.starts} | facts if total.starts else facts
        write_dataset_facts(complete, facts, plan.layout.columns())
        write_card(complete, plan.layout.repo_id)
    except (OSError, RuntimeError) as error:
        raise SpaceDockError(
            f"{complete}: putting the shards together failed ({error}). {free_space(job.folder)} "
            "The shards are kept: run the same command again."
        ) from error
    job.finish(complete)
    return total


def _count(job: Job, plan: Plan) -> tuple[Total, list[Path]]:
    """The sizes of all shards together, and the folders of those that hold something."""
    episodes, frames, shards = 0, 0, []
    left_out = [tuple(pair) for pair in plan.facts.get("left_out", [])]  # found unreadable when episodes were chosen
    sizes: Counter[str] = Counter()
    assumed: Counter[str] = Counter()
    starts: dict[str, None] = {}
    for index in range(plan.num_shards):
        summary = read_summary(job, index)
        episodes, frames = episodes + len(summary.rows), frames + summary.frames
        left_out += summary.left_out
        sizes.update(summary.resized)
        assumed.update(summary.assumed)
        starts.update(dict.fromkeys(name for row in summary.rows if (name := row["initial_conditions"])))
        if summary.rows:
            shards.append(job.shard(index))
    notes = [f"pictures of {count} episodes were scaled: {size}" for size, count in sorted(sizes.items())]
    notes += [f"{what} ({count} episodes)" for what, count in sorted(assumed.items())]
    return Total(episodes, frames, left_out, notes, list(starts)), shards
