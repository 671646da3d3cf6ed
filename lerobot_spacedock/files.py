"""Files that are there whole or not at all, and JSON objects, which anybody may have made."""

from __future__ import annotations

import contextlib
import glob
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lerobot_spacedock.errors import FileFormatError

ABANDONED_AFTER_s = 3600.0  # by age, since the process may be another machine's


@contextlib.contextmanager
def aside(path: Path, *, shared: bool = False) -> Iterator[Path]:
    """A hidden name beside ``path`` to write to; renamed to ``path`` when the block ends well, else removed.

    What a kill leaves under that name is overwritten by the next writer, so it is one name a file.

    Args:
        path: the file's own name. Its folder exists. A file of that name is replaced.
        shared: several processes may write this file at once; each gets a name of its own, and what a kill leaves
            stays until ``remove_abandoned``.
    """
    own = path.with_name(f".{path.name}.{os.getpid()}.tmp" if shared else f".{path.name}.tmp")
    try:
        yield own
        os.replace(own, path)
    finally:
        own.unlink(missing_ok=True)


def remove_abandoned(path: Path) -> None:
    """Removes what killed processes left of ``aside(path, shared=True)``: what has not been written to for an hour."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        with contextlib.suppress(OSError):  # another process removes it too
            if time.time() - left.stat().st_mtime > ABANDONED_AFTER_s:
                left.unlink()


def write_text(path: Path, text: str, *, shared: bool = False) -> None:
    """Writes UTF-8, aside and renamed."""
    with aside(path, shared=shared) as own:
        own.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any, *, shared: bool = False, **style: Any) -> None:
    """Writes JSON, aside and renamed; ``style`` goes to ``json.dumps``."""
    write_text(path, json.dumps(value, **style) + "\n", shared=shared)


def read_object(path: Path) -> dict[str, Any]:
    """The object that the file holds.

    Raises:
        FileFormatError: the file is missing or not JSON, or holds something else.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: not JSON ({error}).") from error
    if not isinstance(value, dict):
        raise FileFormatError(f"{path}: {type(value).__name__}, not a JSON object.")
    return value
