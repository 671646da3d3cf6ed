"""``spacedock sweep``: trials from a storage that many machines share, and that outlives each of them.

Optuna keeps the list: a journal file on a disk that all of them see, or a database. Every process takes the next trial
that nobody has taken; one that was killed leaves a trial behind that the next start on its machine takes up again.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import warnings
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from lerobot_spacedock.errors import InputError, MissingDependencyError
from lerobot_spacedock.files import remove_abandoned, write_text
from lerobot_spacedock.folders import check_output, disk_errors
from lerobot_spacedock.study.config import SweepConfig
from lerobot_spacedock.study.results import read_trials
from lerobot_spacedock.study.trial import run_trial

try:
    import optuna
    from optuna.storages import BaseStorage, JournalStorage, RDBStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
    from optuna.trial import FrozenTrial, TrialState
    from sqlalchemy.exc import SQLAlchemyError
except ImportError as error:
    message = "spacedock sweep needs Optuna: pip install '.[study]' in SpaceDock's folder."
    raise MissingDependencyError(message) from error

POINT, OWNER, RESULT = "point", "owner", "result"  # what each trial carries
SIGNS_WITHIN = timedelta(minutes=1)
LOCK_GIVEN_UP_AFTER_s = 10  # held for milliseconds; whoever holds it for so long was killed
DIRECTIONS = ("maximize", "minimize")  # share of episodes in the IDSS box, smoothness


def sweep(config: SweepConfig) -> int:
    """Runs the verb; see the module."""
    check_output(results_path(config), "--results")
    with disk_errors(Path(config.output_dir), "With room, the same command goes on."):
        return _sweep(config)


def _sweep(config: SweepConfig) -> int:
    torch.set_num_threads(1)  # trials are small: spread processes over the cores, not threads
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = open_study(config)
    requeue_abandoned(study)
    if config.sampler == "grid":
        for point in config.points():
            _enqueue(study, point)
    _work(study, config)
    path = write_results(study, config)
    finished = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    print(f"Finished {len(finished)} trials; wrote {path}")
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        host, pid, *_ = trial.user_attrs.get(OWNER, ("?", "?"))
        print(
            f"Trial {trial.number} still runs, on {host} in process {pid}; if that is no more, the same command again"
        )
    print(f"Next: {_shown_by(path) if finished else 'the same command again'}")
    return 0


def _shown_by(results: Path) -> str:
    """The command that shows what was found: a figure where one can, else the table."""
    from lerobot_spacedock.study.figure import not_drawn  # matplotlib is not needed before

    if not_drawn(read_trials([results])):
        return f"python -m lerobot_spacedock.study.table {results}"
    return f"spacedock sweep-figure --results={results}"


def open_study(config: SweepConfig) -> optuna.Study:
    """The study of that name in its storage, made if it is not there.

    Raises:
        InputError: the study was made with other axes.
    """
    # without a seed: processes of one storage that all drew the same would try the same; what others are at counts
    tpe = config.sampler == "tpe"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # constant_liar
        sampler = optuna.samplers.TPESampler(constant_liar=True) if tpe else optuna.samplers.RandomSampler()
    study = optuna.create_study(
        study_name=config.name,
        storage=_storage(config),
        sampler=sampler,
        directions=DIRECTIONS,
        load_if_exists=True,
    )
    settings = {name: getattr(config, name) for name in ("tasks", "episodes", "evaluation_seed")}
    settings |= {"axes": config.axes(), "weightings": config.weightings}
    known = study.user_attrs.get("settings")
    if known is None:
        study.set_user_attr("settings", settings)
    elif known != json.loads(json.dumps(settings)):
        raise InputError("--name", config.name, "a new name for other axes, coefficients or tasks", f"It has {known}.")
    return study


def _storage(config: SweepConfig) -> BaseStorage:
    given = config.storage or str(Path(config.output_dir) / f"{config.name}.journal")
    if "://" in given:
        try:
            return RDBStorage(given)
        except (SQLAlchemyError, ImportError) as error:
            said = str(error).splitlines()[0]
            raise InputError("--storage", given, "a database that can be reached, or a journal's file", said) from error
    # whole path: Optuna never gives up the lock of a killed process where the journal's is relative
    path = Path(given).resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = JournalFileSymlinkLock(str(path), grace_period=LOCK_GIVEN_UP_AFTER_s)
    backend = JournalFileBackend(str(path), lock_obj=lock)
    lock.acquire()
    try:
        _cut_half_line(path)
    finally:
        lock.release()
    return JournalStorage(backend)


def _cut_half_line(journal: Path) -> None:
    """Takes away the half of an entry that a full disk left at the end, behind which Optuna could read nothing."""
    content = journal.read_bytes()
    if not content.endswith(b"\n"):
        os.truncate(journal, content.rfind(b"\n") + 1)


def requeue_abandoned(study: optuna.Study) -> int:
    """Puts the trials of processes of this machine that are no more back into the queue; returns how many."""
    abandoned = [trial for trial in study.get_trials(states=(TrialState.RUNNING,)) if not _alive(trial)]
    for trial in abandoned:
        with contextlib.suppress(ValueError):  # another process found it too, and was first
            study.tell(trial.number, state=TrialState.FAIL)
        if POINT in trial.user_attrs:
            _enqueue(study, trial.user_attrs[POINT])
    return len(abandoned)


def _enqueue(study: optuna.Study, point: dict[str, Any]) -> None:
    """Puts a point into the queue, unless it waits there, runs, or is done: what only ever failed comes again."""
    states = (TrialState.WAITING, TrialState.RUNNING, TrialState.COMPLETE)
    trials = study.get_trials(deepcopy=False, states=states)
    if all(trial.user_attrs.get(POINT) != point for trial in trials):
        study.enqueue_trial(point, user_attrs={POINT: point})


def _alive(trial: FrozenTrial) -> bool:
    """Whether a trial's process still runs; on another machine it is taken to."""
    if OWNER not in trial.user_attrs:  # taken a moment ago, or by a process that was killed before it could sign
        return trial.datetime_start is None or datetime.now() - trial.datetime_start < SIGNS_WITHIN
    host, pid, *began = trial.user_attrs[OWNER]
    return host != socket.gethostname() or (_began(pid) is not None and began in ([], [_began(pid)]))


def _began(pid: int) -> str | None:
    """When a process of this machine began, told apart over reboots; None if there is none of that number."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        # the 22nd field; the second, the program's name in brackets, may hold spaces
        return f"{boot} {Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[19]}"
    except OSError:
        return None


def _work(study: optuna.Study, config: SweepConfig) -> None:
    axes = config.axes()
    total = len(config.points()) if config.sampler == "grid" else config.num_trials
    with tqdm(total=total, unit="trial", desc=config.name) as bar:
        while True:
            trials = study.get_trials(deepcopy=False)
            bar.update(sum(trial.state.is_finished() and trial.state != TrialState.FAIL for trial in trials) - bar.n)
            waiting = any(trial.state == TrialState.WAITING for trial in trials)
            taken = sum(trial.state != TrialState.FAIL for trial in trials)
            if not waiting and (config.sampler == "grid" or taken >= config.num_trials):
                return
            trial = study.ask()
            trial.set_user_attr(OWNER, (socket.gethostname(), os.getpid(), _began(os.getpid())))
            if config.sampler == "grid" and POINT not in trial.user_attrs:
                study.tell(trial, state=TrialState.FAIL)  # another process took the last one first
                continue
            point = {name: trial.suggest_categorical(name, values) for name, values in axes.items()}
            try:
                result = run_trial(point, config)
            except BaseException:
                study.tell(trial, state=TrialState.FAIL)
                _enqueue(study, point)
                raise
            trial.set_user_attr(RESULT, result)
            study.tell(trial, _values(result, config))
            write_results(study, config)


def _values(result: dict[str, Any], config: SweepConfig) -> tuple[float, float]:
    """Docked share and smoothness over the tasks with contact (over all, where there is none), at the best coefficient.

    The best is the one that docks most often, the smoother of equals.
    """
    rows = [row for row in result["rows"] if "Contact" in row["task"] or "Meta" in row["task"]] or result["rows"]
    scores = []
    for coefficient in config.weightings:
        own = [row for row in rows if row["coefficient"] == coefficient]
        share = sum(row["idss"] for row in own) / sum(row["episodes"] for row in own)
        scores.append((share, sum(row["smoothness"]["mean"] for row in own) / len(own)))
    return max(scores, key=lambda score: (score[0], -score[1]))


def results_path(config: SweepConfig) -> Path:
    """Where the finished trials go."""
    return Path(config.results or f"results/sweep_{config.name}.json")


def write_results(study: optuna.Study, config: SweepConfig) -> Path:
    """Writes every finished trial, in the order of the grid, aside and renamed. Returns the file.

    A point that a search tried again stands there once: as another trial it would pass for another training seed.
    """
    path = results_path(config)
    finished = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    found = [trial.user_attrs[RESULT] for trial in finished]
    results = list({json.dumps(result["point"], sort_keys=True): result for result in found}.values())
    if config.sampler == "grid":
        points = config.points()
        results.sort(key=lambda result: points.index(result["point"]))
    lines = ",\n".join(json.dumps(result) for result in results)
    head = json.dumps({"name": config.name, "episodes": config.episodes, "evaluation_seed": config.evaluation_seed})
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_abandoned(path)
    write_text(path, f'{head[:-1]}, "trials": [\n{lines}\n]}}\n', shared=True)
    return path
