"""From log files to columns: one pass, episode by episode, memory flat but for some numbers an episode."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from itertools import batched
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from lerobot_spacedock.episode_log import SURPLUS_FOLDER, EpisodeLog, read_episode_log
from lerobot_spacedock.errors import FileFormatError, InputError, SpaceDockError, reading
from lerobot_spacedock.invocation import available_cores
from lerobot_spacedock.metrics.catalog import NAMES
from lerobot_spacedock.metrics.crossing import range_rate
from lerobot_spacedock.metrics.episode import ATV_CONDITIONS, IDSS_CONDITIONS, episode_metrics
from lerobot_spacedock.metrics.task import Task, plain_name, task_of
from lerobot_spacedock.metrics.visitation import CellCounts, count_cells, merge
from lerobot_spacedock.physics.frames import OBSERVATION_INDICES, POSITION, VELOCITY

COLUMN_NAMES = (*NAMES, *IDSS_CONDITIONS, *ATV_CONDITIONS)
RANGE_GRID_M = np.concatenate([[0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4], np.linspace(0.5, 30.0, 60)])
PLACES_IN_A_STEP = 16  # looked at for the closing rate: it turns quickly where the port is passed at the side
TRACES_KEPT = 100  # of each set, for the figures that draw episodes one by one
SURPLUS = "surplus episode of the last vector batch, beyond the number that was asked for"
BATCH = 64
POOL_FROM = 600  # files; below, starting workers costs more than they save


@dataclass(frozen=True)
class Trace:
    """One episode as drawn: file name, times (K+1,), states (K+1, 14) in dataset units, commands (K, 6)."""

    name: str
    time: np.ndarray
    state: np.ndarray
    action: np.ndarray


@dataclass
class EpisodeSet:
    """All episodes of one run from one set of initial conditions.

    Attributes:
        task: what the run was flown to do.
        columns: per metric, (N,) float64; NaN marks "not defined" and is read through ``values`` only.
        starts: first states without mass, (N, 13), dataset units.
        folder: which of the run's folders (training seeds) each episode came from, (N,).
        names: file names, (N,).
        closing: closing rate in m/s when the range first fell to each of ``RANGE_GRID_M``, (N, 67); NaN: never.
        traces: the first ``TRACES_KEPT`` episodes.
        visits: cells of (y, x) and of (y, z) over every state.
    """

    task: Task
    columns: dict[str, np.ndarray]
    starts: np.ndarray
    folder: np.ndarray
    names: list[str]
    closing: np.ndarray
    traces: list[Trace] = field(default_factory=list)
    visits: dict[str, CellCounts] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def training_seeds(self) -> int:
        """How many folders the episodes came from."""
        return len(np.unique(self.folder))

    def values(self, name: str) -> np.ndarray:
        """The defined values of a metric, (M,), M ≤ N."""
        column = self.columns[name]
        return column[~np.isnan(column)]

    def count(self, name: str) -> tuple[int, int]:
        """A flag's (true, defined)."""
        values = self.values(name)
        return int(values.sum()), len(values)


@dataclass(frozen=True)
class Exclusion:
    """A file that does not enter any number, and why."""

    path: str
    reason: str


@dataclass
class _Part:
    """What a worker hands back, per set of initial conditions; lists are joined in file order."""

    rows: dict[str, list[tuple]] = field(default_factory=dict)
    traces: dict[str, list[Trace]] = field(default_factory=dict)
    visits: dict[str, dict[str, CellCounts]] = field(default_factory=dict)
    exclusions: list[Exclusion] = field(default_factory=list)
    tasks: dict[Task, str] = field(default_factory=dict)  # → a file that was flown for it


def collect(
    folders: Sequence[Sequence[Path]], *, workers: int | None = None, progress: Iterable | None = None
) -> tuple[dict[str, EpisodeSet], list[Exclusion]]:
    """Reads the episode logs of one run.

    Args:
        folders: per training seed, its files in order.
        workers: processes; ``None``: as many as there are cores where the files are many, else none.
        progress: an object with ``update(n)``, such as a tqdm bar.

    Returns:
        Episodes by set of initial conditions (``unspecified`` where a log does not say), and what was left out.

    Raises:
        InputError: episodes of several tasks or ports, or one twice in a folder: what flew them cannot be one run.
    """
    jobs = [(i, batch) for i, files in enumerate(folders) for batch in batched(files, BATCH)]
    total = sum(len(files) for files in folders)
    if workers is None:
        workers = available_cores() if total >= POOL_FROM else 1
    joined = _Part()
    if workers > 1:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            try:
                for part in pool.map(_read_batch, jobs):
                    _join(joined, part, progress)
            except BrokenProcessPool as error:
                message = "A process that read logs was ended from outside (killed, or out of memory): run it again."
                raise SpaceDockError(message) from error
    else:
        for job in jobs:
            _join(joined, _read_batch(job), progress)
    task = _one_task(joined.tasks) if joined.tasks else None
    for name, rows in joined.rows.items():
        twice = [key for key, count in Counter(row[:2] for row in rows).items() if count > 1]
        if twice:
            _, file = twice[0]
            mend = "The folder holds several evaluations: name the folder of each."
            raise InputError("a run's episodes", f"{file} from {name!r} twice in one folder", "each once", mend)
    return {name: _assemble(joined, name, task) for name in joined.rows}, joined.exclusions


def measured(path: Path) -> tuple[EpisodeLog, dict[str, float | bool | None]]:
    """An episode log and its metrics.

    Raises:
        FileFormatError: not a log, or one whose metadata say what cannot be.
    """
    log = read_episode_log(path)
    try:
        with reading(path, "an episode log"):
            return log, episode_metrics(log)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def initial_conditions(log: EpisodeLog) -> str:
    """The name of the set that an episode's start was drawn from; ``unspecified`` where the log does not say."""
    return plain_name(log.metadata.get("initial_conditions")) or "unspecified"


def closing_profile(log: EpisodeLog) -> np.ndarray:
    """m/s, (67,): closing rate when the range first fell to each of ``RANGE_GRID_M``; NaN where it never did.

    Between states position and velocity are straight.
    """
    distance, rate = range_rate(*(_within_steps(log.state[:, part]) for part in (POSITION, VELOCITY)))
    nearest = np.minimum.accumulate(distance)
    fresh = np.concatenate([[True], nearest[1:] < nearest[:-1]])
    profile = np.interp(RANGE_GRID_M, nearest[fresh][::-1], -rate[fresh][::-1], left=np.nan, right=np.nan)
    return profile.astype(np.float32)


def _within_steps(rows: np.ndarray) -> np.ndarray:
    """States and what lies straight between them: (K+1, D) → (K · ``PLACES_IN_A_STEP`` + 1, D)."""
    steps = np.arange(len(rows))
    places = np.linspace(0, len(rows) - 1, PLACES_IN_A_STEP * (len(rows) - 1) + 1)
    return np.stack([np.interp(places, steps, column) for column in rows.T], axis=1)


def _read_batch(job: tuple[int, Sequence[Path]]) -> _Part:
    folder, files = job
    part = _Part()
    points: dict[str, list[np.ndarray]] = {}
    for path in files:
        if path.parent.name == SURPLUS_FOLDER:
            part.exclusions.append(Exclusion(str(path), SURPLUS))
            continue
        try:
            log, metrics = measured(path)
        except (SpaceDockError, OSError) as error:
            part.exclusions.append(Exclusion(str(path), f"not readable: {error}"))
            continue
        if log.metadata.get("surplus"):
            part.exclusions.append(Exclusion(str(path), SURPLUS))
            continue
        part.tasks.setdefault(task_of(log.metadata), str(path))
        name = initial_conditions(log)
        numbers = [np.nan if metrics[key] is None else float(metrics[key]) for key in COLUMN_NAMES]
        row = (folder, path.name, numbers, log.state[0, OBSERVATION_INDICES], closing_profile(log))
        part.rows.setdefault(name, []).append(row)
        points.setdefault(name, []).append(log.state[:, POSITION])
        kept = part.traces.setdefault(name, [])
        if len(kept) < TRACES_KEPT:
            kept.append(Trace(path.name, log.time, log.state.astype(np.float32), log.action.astype(np.float32)))
    for name, positions in points.items():
        xyz = np.concatenate(positions)
        part.visits[name] = {
            "yx": count_cells(xyz[:, 1], xyz[:, 0]),
            "yz": count_cells(xyz[:, 1], xyz[:, 2]),
        }
    return part


def _one_task(found: dict[Task, str]) -> Task:
    """The task of a run's episodes; by the logs that name it, where others do not."""
    task = max(found, key=lambda task: task.env_id is not None)
    if not all(map(task.agrees, found)):
        given = ", ".join(sorted(f"{task} ({path})" for task, path in found.items()))
        raise InputError("a run's episodes", given, "one task a run, at one port", "Name the folder of each apart.")
    return task


def _join(joined: _Part, part: _Part, progress: object) -> None:
    joined.tasks = part.tasks | joined.tasks
    count = len(part.exclusions)
    for name, rows in part.rows.items():
        count += len(rows)
        joined.rows.setdefault(name, []).extend(rows)
        kept = joined.traces.setdefault(name, [])
        kept.extend(part.traces[name][: TRACES_KEPT - len(kept)])
        visits = joined.visits.setdefault(name, {"yx": CellCounts(), "yz": CellCounts()})
        for plane, cells in part.visits[name].items():
            visits[plane] = merge(visits[plane], cells)
    joined.exclusions.extend(part.exclusions)
    if progress is not None:
        progress.update(count)


def _assemble(joined: _Part, name: str, task: Task) -> EpisodeSet:
    folder, names, numbers, starts, closing = zip(*joined.rows[name], strict=True)
    table = np.array(numbers, dtype=np.float64)
    return EpisodeSet(
        task=task,
        columns={key: table[:, i] for i, key in enumerate(COLUMN_NAMES)},
        starts=np.stack(starts),
        folder=np.array(folder),
        names=list(names),
        closing=np.stack(closing),
        traces=joined.traces[name],
        visits=joined.visits[name],
    )
