"""Kills a command with SIGKILL at random moments, goes on with it, and compares what comes out.

The processes are forked from a server that has imported the libraries already, so that the moments fall into the work
and not into the ten seconds of imports before it, where there is nothing to lose.
"""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

MOST_KILLS_IN_A_ROW = 5
SLOWEST_s = 600.0


@dataclass(frozen=True)
class Command:
    """A long command and what is expected of it.

    Attributes:
        name: as the user writes it.
        program: ``module:function`` that takes over from ``sys.argv``.
        arguments: of the first start, given the folder that it works in.
        result: everything that must be the same however often it was killed. Bytes, or arrays and numbers made from
            files whose bytes hold times.
        outputs: names in the folder that it makes; removed between the rounds.
        again: arguments of every later start; None: the same.
        prepare: makes the inputs, once.
        after_kill: raises where something half-finished can be mistaken for something whole.
        finished: whether nothing is left to do, and the same command is refused.
        clean: undoes what is not a file of the folder.
    """

    name: str
    program: str
    arguments: Callable[[Path], Sequence[str]]
    result: Callable[[Path], object]
    outputs: tuple[str, ...]
    again: Callable[[Path], Sequence[str]] | None = None
    prepare: Callable[[Path], None] = lambda folder: None
    after_kill: Callable[[Path], None] = lambda folder: None
    finished: Callable[[Path], bool] = lambda folder: False
    clean: Callable[[Path], None] = lambda folder: None


@dataclass
class Outcome:
    """What came of it.

    Attributes:
        kills: how many moments.
        rounds: how many times it was brought to its end and compared.
        late: kills that came after it had ended (not counted among ``kills``).
        whole_s: how long it takes undisturbed, without imports.
        differences: what was wrong, by round.
    """

    kills: int = 0
    rounds: int = 0
    late: int = 0
    whole_s: float = 0.0
    differences: list[str] = field(default_factory=list)


def run_killed(
    command: Command, folder: Path, *, moments: int, seed: int = 0, libraries: Sequence[str] = ()
) -> Outcome:
    """Kills ``command`` at ``moments`` random moments, in rounds that each end with a comparison.

    Args:
        command: what runs.
        folder: empty; the command works in it.
        moments: how many kills.
        seed: of the moments.
        libraries: modules that are imported before the clock starts; of the first call in a process only.

    Raises:
        RuntimeError: it fails undisturbed, or on being started again.
    """
    folder.mkdir(parents=True, exist_ok=True)
    command.prepare(folder)
    context = server(libraries)
    rng, outcome = np.random.default_rng(seed), Outcome()
    finish(context, command, folder, command.arguments(folder))  # fills the caches; the first fork waits for imports
    wanted = command.result(folder)
    clear(command, folder)
    outcome.whole_s = finish(context, command, folder, command.arguments(folder))
    if not same(wanted, command.result(folder)):
        raise RuntimeError(f"{command.name}: two undisturbed runs differ: {difference(wanted, command.result(folder))}")
    while outcome.kills < moments:
        clear(command, folder)
        _round(context, command, folder, rng, outcome, min(MOST_KILLS_IN_A_ROW, moments - outcome.kills), wanted)
    return outcome


def server(libraries: Sequence[str]):
    """From what processes are forked: one that has imported ``libraries``, where no other was asked for before."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(libraries))
    return context


def _round(context, command, folder, rng, outcome: Outcome, kills: int, wanted: object) -> None:
    """Up to ``kills`` kills, then to the end."""
    arguments, times, ended = command.arguments(folder), [], False
    for _ in range(int(rng.integers(1, kills + 1))):
        allowed = (0, 2) if command.finished(folder) else (0,)
        moment = float(rng.uniform(0.0, 1.05 * outcome.whole_s))
        process = start(context, command, folder, arguments)
        process.join(moment)
        if process.exitcode is not None:
            outcome.late, ended = outcome.late + 1, True
            _refuse_failure(command, folder, process.exitcode, allowed)
            break
        kill(process)
        outcome.kills += 1
        times.append(moment)
        try:
            command.after_kill(folder)
        except Exception as error:
            outcome.differences.append(f"killed after {_seconds(times)}: {type(error).__name__}: {error}")
        arguments = (command.again or command.arguments)(folder)
    if not ended:
        try:
            finish(context, command, folder, arguments, allowed=(0, 2) if command.finished(folder) else (0,))
        except RuntimeError as error:
            outcome.differences.append(f"killed after {_seconds(times)}: {error}")
            return
    found = command.result(folder)
    outcome.rounds += 1
    if not same(wanted, found):
        outcome.differences.append(f"killed after {_seconds(times)}: {difference(wanted, found)}")


def start(context, command: Command, folder: Path, arguments: Sequence[str]):
    process = context.Process(target=call, args=(command.program, list(arguments), str(folder)))
    process.start()
    return process


def call(program: str, arguments: list[str], folder: str) -> None:
    """What the process does: the command in a session of its own, its words in ``folder.words``."""
    os.setsid()
    os.chdir(folder)
    words = os.open(f"{folder}.words", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(words, 1)
    os.dup2(words, 2)
    module, _, function = program.partition(":")
    sys.argv = [module, *arguments]
    sys.exit(getattr(importlib.import_module(module), function)())


def finish(context, command: Command, folder: Path, arguments: Sequence[str], allowed: tuple = (0,)) -> float:
    """Lets it end, with one of the exit codes allowed; returns how long it took."""
    began = time.monotonic()
    process = start(context, command, folder, arguments)
    process.join(SLOWEST_s)
    if process.exitcode is None:
        kill(process)
        raise RuntimeError(f"{command.name}: not ended after {SLOWEST_s:g} s; {last_words(folder)}")
    _refuse_failure(command, folder, process.exitcode, allowed)
    return time.monotonic() - began


def _refuse_failure(command: Command, folder: Path, exitcode: int, allowed: tuple) -> None:
    if exitcode not in allowed:
        raise RuntimeError(f"{command.name} ended with {exitcode}: {last_words(folder)}")


def words_file(folder: Path) -> Path:
    """Where a command's words are kept: beside its folder, whose disk may be full."""
    return folder.with_name(f"{folder.name}.words")


def last_words(folder: Path) -> str:
    return (
        words_file(folder).read_text(errors="replace")[-1500:] if words_file(folder).exists() else "(it said nothing)"
    )


def kill(process) -> None:
    """The process and all that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    with contextlib.suppress(ProcessLookupError):  # before it had a session of its own
        os.kill(process.pid, signal.SIGKILL)
    process.join()


def clear(command: Command, folder: Path) -> None:
    command.clean(folder)
    words_file(folder).unlink(missing_ok=True)
    for name in command.outputs:
        for path in folder.glob(name):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def _seconds(times: list[float]) -> str:
    return ", ".join(f"{moment:.2f} s" for moment in times)


def files_of(root: Path, *, without: tuple[str, ...] = ()) -> dict[str, bytes]:
    """Every file below ``root`` with its bytes."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and not any(part in path.parts for part in without)
    }


def same(one: object, other: object) -> bool:
    """Equality to the bit, through dicts and lists, of arrays too."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return bool(one == other)


def difference(one: object, other: object, place: str = "") -> str:
    """Where two results differ first, in a few words."""
    if isinstance(one, dict) and isinstance(other, dict):
        if one.keys() != other.keys():
            lacking, more = sorted(one.keys() - other.keys()), sorted(other.keys() - one.keys())
            return f"{place or 'result'}: without {lacking[:5]}, with {more[:5]}"
        for key in one:
            if not same(one[key], other[key]):
                return difference(one[key], other[key], f"{place}/{key}")
    return f"{place}: {repr(one)[:120]} became {repr(other)[:120]}"
