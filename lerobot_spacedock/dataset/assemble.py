"""Puts the finished shards of a job together into the dataset, and says how it was made."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

from lerobot_spacedock.dataset.card import write_card
from lerobot_spacedock.dataset.job import Job, Plan
from lerobot_spacedock.dataset.provenance import write_dataset_facts, write_episode_rows
from lerobot_spacedock.dataset.record import free_space, quiet_encoders
from lerobot_spacedock.dataset.shards import SUMMARY_FILE, ShardSummary, read_summary
from lerobot_spacedock.dataset.statistics import repair_statistics
from lerobot_spacedock.errors import FileFormatError, SpaceDockError


def assemble(job: Job) -> ShardSummary:
    """Makes the dataset at ``job.root`` out of the shards, all of which have to be finished.

    Returns:
        What it holds and what was left out.

    Raises:
        FileFormatError: no episode at all could be read.
        SpaceDockError: writing failed; the shards stay, and the same command goes on from them.
    """
    plan = Plan.read(job.plan_path)
    summaries = [read_summary(job, index) for index in range(plan.num_shards)]
    total = ShardSummary(
        rows=[row for summary in summaries for row in summary.rows],
        left_out=[pair for summary in summaries for pair in summary.left_out],
    )
    if not total.rows:
        listed = "; ".join(f"{name}: {reason}" for name, reason in total.left_out[:3])
        raise FileFormatError(f"None of {len(total.left_out)} episodes could be read. {listed}")
    complete = job.folder / "complete"
    shutil.rmtree(complete, ignore_errors=True)
    shards = [job.shard(index) for index, summary in enumerate(summaries) if summary.rows]
    try:
        _merge(shards, plan, complete)
        repair_statistics(complete)
        write_episode_rows(complete, total.rows)
        facts = plan.facts | {"left_out": total.left_out} if total.left_out else plan.facts
        write_dataset_facts(complete, facts, plan.layout.columns())
        write_card(complete, plan.layout.repo_id)
    except (OSError, RuntimeError) as error:
        raise SpaceDockError(
            f"{complete}: putting the shards together failed ({error}). {free_space(job.folder)} "
            "The shards are kept: run the same command again."
        ) from error
    job.finish(complete)
    return total


def _merge(shards: list[Path], plan: Plan, complete: Path) -> None:
    if len(shards) == 1:
        shutil.copytree(shards[0], complete, ignore=shutil.ignore_patterns(SUMMARY_FILE))
        return
    from datasets.utils import disable_progress_bars
    from lerobot.datasets.aggregate import aggregate_datasets

    quiet_encoders()
    disable_progress_bars()
    repo_id = plan.layout.repo_id
    quiet = logging.getLogger("lerobot.datasets.aggregate")
    before = quiet.level
    quiet.setLevel(logging.WARNING)
    try:
        aggregate_datasets([repo_id] * len(shards), repo_id, roots=shards, aggr_root=complete)
    finally:
        quiet.setLevel(before)
