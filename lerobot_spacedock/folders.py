"""Folders that a command is about to write: by one process at a time, and found out before hours of work."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from lerobot_spacedock.errors import InputError, SpaceDockError


@contextlib.contextmanager
def only_process(folder: Path, flag: str) -> Iterator[None]:
    """Keeps a second process from writing ``folder``; released by the system if this one dies.

    Args:
        folder: need not exist; the lock is a file beside it.
        flag: by which the user named the folder.

    Raises:
        InputError: another process holds it, or it is the root.
    """
    place = folder.resolve()  # "." has no name
    if not place.name:
        raise InputError(flag, str(folder), "a folder below the root of the file system")
    place.parent.mkdir(parents=True, exist_ok=True)
    path = place.with_name(f".{place.name}.lock")
    with path.open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held = os.path.samestat(os.fstat(stream.fileno()), path.stat())  # not of a file that its holder removed
        except (BlockingIOError, FileNotFoundError):
            held = False
        if not held:
            raise InputError(flag, str(folder), "a folder that no other process is writing", "Wait for it to end.")
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def check_writable(folder: Path, flag: str) -> None:
    """Tries to write where ``folder`` is, or is to be made.

    Args:
        folder: need not exist, and is not made.
        flag: by which the user named it.

    Raises:
        InputError: the system refuses; with its reason.
    """
    nearest = folder.absolute()
    try:
        while not nearest.exists():
            nearest = nearest.parent
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise InputError(flag, str(folder), "a folder that can be written", f"{nearest}: {error.strerror}.") from error


def check_output(file: Path, flag: str) -> None:
    """Before long work: that ``file`` can be written at its end.

    Raises:
        InputError: it is a folder, or its folder cannot be written; as ``check_writable``.
    """
    if file.is_dir():
        raise InputError(flag, str(file), "the name of a file", "This is a folder.")
    check_writable(file.parent, flag)


@contextlib.contextmanager
def disk_errors(folder: Path, remedy: str) -> Iterator[None]:
    """Turns a write that the system refuses (a full disk, no permission) into one sentence.

    Args:
        folder: where is written.
        remedy: what is kept, and what to do.

    Raises:
        SpaceDockError: what the system said, how much room is left, and the remedy.
    """
    try:
        yield
    except OSError as error:
        raise SpaceDockError(f"{folder}: the system refused ({error}). {free_space(folder)} {remedy}") from error


def free_space(path: Path) -> str:
    """A sentence for error messages: how much room is left where ``path`` is to be written."""
    while not os.path.exists(path):  # False, where Path.exists raises: a name too long, a folder that may not be read
        path = path.parent
    usage = shutil.disk_usage(path)
    return f"{usage.free / 1e6:.0f} MB of {usage.total / 1e6:.0f} MB are free there."
