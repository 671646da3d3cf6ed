"""A dataset that is being made: a folder beside its root, from which a killed job goes on.

``<root>.part/`` holds ``plan.json`` and ``refs/`` (what is to be written, fixed at the first start; the episodes of
each shard in a file of their own, so that a worker reads no more than its own), ``shards/`` (each a whole
LeRobotDataset, renamed into place when it is finished) and, for demonstrations, ``flights/`` (an episode log each).
The dataset appears under its own name only when it is complete.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from lerobot_spacedock.dataset.record import DatasetLayout
from lerobot_spacedock.dataset.sources import EpisodeRef
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.files import write_json
from lerobot_spacedock.folders import disk_errors, only_process
from lerobot_spacedock.invocation import command_line

MAX_SHARD_EPISODES = 50
FINISHED = "finished"
NEW_FOLDER = "a folder that does not exist"


@dataclass(frozen=True)
class Plan:
    """What the shards of one job hold; written once, read by every worker.

    Attributes:
        layout: schema and storage of the dataset.
        num_shards: into how many the episodes are cut.
        drawing: keyword arguments of ``frames.Artist``; None where no frame has to be drawn.
        redraw: draw even where the source has pictures.
        segment: as ``--segment``.
        repeat_terminal: as ``--repeat_terminal``.
        skip_bad: leave out episodes that cannot be read instead of stopping.
        as_stated: dotted names in ``drawing`` that every flight has to state alike.
        facts: what ``meta/spacedock.json`` says beside the schema.
    """

    layout: DatasetLayout
    num_shards: int
    drawing: dict[str, Any] | None = None
    redraw: bool = False
    segment: str = "all"
    repeat_terminal: int = 0
    skip_bad: bool = False
    as_stated: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        write_json(path, asdict(self))

    @classmethod
    def read(cls, path: Path) -> Plan:
        content = json.loads(path.read_text())
        content["layout"] = DatasetLayout.from_dict(content["layout"])
        return cls(**content)


class Job:
    """The working folder of the dataset at ``root``.

    Raises:
        InputError: a root without a name, beside which no folder can be.
    """

    def __init__(self, root: Path) -> None:
        if not root.name:
            raise InputError("--root", str(root), NEW_FOLDER, "Name one, such as --root=outputs/docking.")
        self.root = root
        self.folder = root.with_name(f"{root.name}.part")
        self.plan_path = self.folder / "plan.json"
        self.shards = self.folder / "shards"
        self.flights = self.folder / "flights"
        self.progress = self.folder / "progress"
        self.refs = self.folder / "refs"

    def shard(self, index: int) -> Path:
        return self.shards / f"shard_{index:06d}"

    def write_plan(self, plan: Plan, refs: list[EpisodeRef]) -> None:
        """Cuts the episodes into the plan's shards; the plan itself comes last: it is there only when all is."""
        for index in range(plan.num_shards):
            first, last = (len(refs) * i // plan.num_shards for i in (index, index + 1))
            write_json(self.refs / f"{index:06d}.json", [ref.to_json() for ref in refs[first:last]])
        plan.save(self.plan_path)

    def shard_refs(self, index: int) -> list[EpisodeRef]:
        """The episodes of one shard, in order."""
        return [EpisodeRef.from_json(ref) for ref in json.loads((self.refs / f"{index:06d}.json").read_text())]

    def begin(self, settings: dict[str, Any]) -> bool:
        """Makes the folder, or takes up the job that is in it.

        Args:
            settings: everything that decides what the data will be. JSON. ``skip_bad`` may be turned on in a job that
                goes on: what is finished had nothing to skip.

        Returns:
            True where an unfinished job goes on.

        Raises:
            InputError: the dataset exists, or the folder holds finished work of a job with other settings.
        """
        shutil.rmtree(self._trash, ignore_errors=True)
        if self.root.exists():
            if (self.folder / FINISHED).exists() and not (self.folder / "complete").exists():
                self._discard()  # killed when the dataset had its name already
            raise InputError("--root", str(self.root), NEW_FOLDER, "Delete it or name another.")
        settings = json.loads(json.dumps(settings))
        path = self.folder / "settings.json"
        if path.exists():
            before = json.loads(path.read_text())
            if before != settings and not self._anything_finished():
                self._discard()  # it failed before it had made anything: nothing to go on from, nothing to lose
                return self.begin(settings)
            if before | {"skip_bad": True} == settings:
                self._skip_bad_from_now_on(settings)
            elif before != settings:
                was, now = dotted(before), dotted(settings)
                keys = [key for key in {**was, **now} if was.get(key) != now.get(key)]
                changes = ", ".join(f"{key} was {was.get(key)!r}, now {now.get(key)!r}" for key in keys)
                raise InputError(
                    "--root",
                    str(self.root),
                    "the settings with which the unfinished job was begun",
                    f"{changes}. Repeat the first command to finish it, or delete {self.folder} to begin anew.",
                )
            return True
        for folder in (self.shards, self.flights, self.progress, self.refs):
            folder.mkdir(parents=True, exist_ok=True)
        write_json(path, settings)
        return False

    def _skip_bad_from_now_on(self, settings: dict[str, Any]) -> None:
        if self.plan_path.exists():
            plan = Plan.read(self.plan_path)
            facts = plan.facts | ({"command": command_line()} if "command" in plan.facts else {})
            replace(plan, skip_bad=True, facts=facts).save(self.plan_path)
        write_json(self.folder / "settings.json", settings)

    def _anything_finished(self) -> bool:
        """Whether the folder holds a flight or a shard, or others may be at work in it: more than a plan to lose."""
        empty = all(not any(part.iterdir()) for part in (self.shards, self.flights) if part.exists())
        return not empty or any((self.folder / name).exists() for name in ("selection.json", "datatrove", "slurm.json"))

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Keeps a second process from working in the same folder; released by the system if this one dies.

        A job that is refused before anything of it is finished leaves no folder behind.
        """
        with only_process(self.root, "--root"):
            try:
                yield
            except SpaceDockError:
                if self.folder.exists() and not self._anything_finished():
                    self._discard()
                raise

    @contextlib.contextmanager
    def disk_errors(self) -> Iterator[None]:
        """Turns a write that the system refuses (a full disk, no permission) into one sentence.

        Raises:
            SpaceDockError: what the system said, how much room is left, and that what is finished is kept.
        """
        remedy = f"What is finished is kept in {self.folder}: mend it and run the same command again."
        with disk_errors(self.root, remedy):
            yield

    def finish(self, complete: Path) -> None:
        """Puts the complete dataset under its own name and removes the working folder."""
        (self.folder / FINISHED).touch()
        os.rename(complete, self.root)
        self._discard()

    @property
    def _trash(self) -> Path:
        return self.root.with_name(f".{self.root.name}.trash")

    def _discard(self) -> None:
        """Removes the working folder; renamed first: no later job may go on from the half that a kill would leave."""
        shutil.rmtree(self._trash, ignore_errors=True)
        os.rename(self.folder, self._trash)
        shutil.rmtree(self._trash, ignore_errors=True)


def shard_count(episodes: int, workers: int) -> int:
    """How many shards: some a worker, so that all cores stay busy to the end and little is lost to a kill."""
    return max(1, min(episodes, max(4 * max(workers, 1), -(-episodes // MAX_SHARD_EPISODES))))


def dotted(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by their dotted names, as their flags are called."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        found |= dotted(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return found
