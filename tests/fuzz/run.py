"""Feeds hostile files to every reader: ``python tests/fuzz/run.py --inputs 10000``.

Half of the inputs are bytes changed anywhere, half keep the format's framing whole (``mutations.py``). A reader may
return, or raise what its row allows with a message that names the file. Anything else is a failure: another exception,
a hang of 2 s, unpickling, a write outside its folder, a program started, a crash, or more than 1 GiB of memory.
Seeded: a failure's number gives the same input again (``--only NAME --first N --inputs 1 --keep DIR``).
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import guard
import mutations
import numpy as np
from readers import READERS, Reader


@dataclass
class Result:
    """What came of the inputs to one reader; ``failures`` maps a kind to (count, first input, text)."""

    inputs: int = 0
    read: int = 0
    refused: int = 0
    seconds: float = 0.0
    peak_mb: float = 0.0
    failures: dict[str, tuple[int, int, str]] = field(default_factory=dict)

    def fail(self, kind: str, number: int, text: str) -> None:
        count, first, said = self.failures.get(kind, (0, number, text))
        self.failures[kind] = (count + 1, first, said)


def fuzz(reader: Reader, inputs: int, *, first: int = 0, keep: Path | None = None) -> Result:
    """All inputs to one reader, in a process of its own; a crash of that process counts and the rest goes on."""
    result, at, context = Result(), first, multiprocessing.get_context("fork")
    while at < first + inputs:
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(reader, at, first + inputs - at, there, keep))
        process.start()
        there.close()
        part, last = None, None
        try:
            while True:
                message = here.recv()
                if isinstance(message, int):
                    last = message
                else:
                    part = message
        except EOFError:
            process.join()
        if part is not None:
            _join(result, part)
            break
        if last is None:
            raise RuntimeError(f"{reader.name}: the good files could not be made or read; see above")
        result.fail(f"crash (exit status {process.exitcode})", last, "the process ended")
        result.inputs += last + 1 - at
        at = last + 1
    return result


def _work(reader: Reader, first: int, inputs: int, connection, keep: Path | None) -> None:
    warnings.simplefilter("ignore")
    result = Result()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seeds = [(file, whole, file.read_bytes()) for file, whole in reader.make(folder)]
        for file, _, _ in seeds:
            reader.read(file)  # a good file is read; whatever is imported late is imported now
        guarded = guard.Guard(folder, loopback=reader.loopback)
        guard.limit_memory()
        start = time.process_time()
        for number in range(first, first + inputs):
            rng = np.random.default_rng([zlib.crc32(reader.name.encode()), number])
            file, whole, data = seeds[int(rng.integers(len(seeds)))]
            framed = whole is not None and (reader.framed or rng.random() < 0.5)
            try:
                changed = whole(rng, data) if framed else mutations.mutate_bytes(rng, data)
            except Exception:  # the mutation made something that its own writer refuses
                changed = mutations.mutate_bytes(rng, data)
            file.write_bytes(changed)
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{number}_{file.name}").write_bytes(changed)
            connection.send(number)
            _one(reader, file, number, guarded, result)
            file.write_bytes(data)
        result.seconds = time.process_time() - start
    connection.send(result)
    connection.close()


def _one(reader: Reader, file: Path, number: int, guarded: guard.Guard, result: Result) -> None:
    result.inputs += 1
    before = guard.forget_peak_mb()
    try:
        with guarded.watching():
            reader.read(file)
        result.read += 1
    except reader.allowed as error:
        result.refused += 1
        # the file, or the dataset (and then the episode in it), or the option that named it
        names = (file.stem, *(folder.name for folder in list(file.parents)[:4]), "--")
        if not any(name in str(error) for name in names):
            result.fail("message without the file", number, str(error))
        if _chain_has(error, MemoryError):
            result.fail("asked for the memory first", number, str(error))
    except guard.TooLongError:
        result.fail("hang", number, f"{guard.TIME_LIMIT_S:g} s")
    except BaseException as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [f for f in frames if "lerobot_spacedock" in f.filename] or frames
        place = f"{Path(own[-1].filename).name}:{own[-1].lineno}"
        result.fail(f"{type(error).__name__} at {place}", number, str(error)[:200])
    took = guard.peak_mb() - before
    result.peak_mb = max(result.peak_mb, took)
    if took > guard.MEMORY_BYTES / 2**20:
        result.fail("memory", number, f"{took:.0f} MB")
    for act in guarded.seen:
        result.fail(f"forbidden: {act}", number, act)


def _chain_has(error: BaseException | None, kind: type[BaseException]) -> bool:
    seen: set[int] = set()  # a chain may run in a circle, where an error's cause is raised again
    while error is not None and id(error) not in seen:
        if isinstance(error, kind):
            return True
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return False


def _join(result: Result, part: Result) -> None:
    for name in ("inputs", "read", "refused", "seconds"):
        setattr(result, name, getattr(result, name) + getattr(part, name))
    result.peak_mb = max(result.peak_mb, part.peak_mb)
    for kind, (count, first, text) in part.failures.items():
        known = result.failures.get(kind)
        result.failures[kind] = (count + known[0], known[1], known[2]) if known else (count, first, text)


def available(reader: Reader) -> bool:
    return all(importlib.util.find_spec(name) for name in reader.needs)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000, help="to each reader")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--only", help="readers whose name holds this")
    parser.add_argument("--keep", type=Path, help="write the inputs here too")
    options = parser.parse_args()
    if options.only and not any(options.only.lower() in reader.name.lower() for reader in READERS):
        parser.error(f"--only {options.only}: none of {', '.join(reader.name for reader in READERS)}")
    print(
        "| reader | inputs | read | refused | CPU s | memory, MB | failures |\n|:--|--:|--:|--:|--:|--:|:--|",
        flush=True,
    )
    failed = Counter()
    for reader in READERS:
        if (options.only and options.only.lower() not in reader.name.lower()) or not available(reader):
            continue
        r = fuzz(reader, options.inputs, first=options.first, keep=options.keep)
        said = "; ".join(f"{kind}: {n}, first {number}" for kind, (n, number, _) in r.failures.items()) or "none"
        numbers = f"{r.inputs:,} | {r.read:,} | {r.refused:,} | {r.seconds:.0f} | {r.peak_mb:.0f}"
        print(f"| {reader.name} | {numbers} | {said} |", flush=True)
        for kind, (_, number, text) in r.failures.items():
            print(f"  {reader.name}, input {number}: {kind}: {text}", file=sys.stderr, flush=True)
        failed[reader.name] = len(r.failures)
    return 1 if failed.total() else 0


if __name__ == "__main__":
    sys.exit(main())
