"""What no reader may do, watched while it reads: unpickle, write elsewhere, start a program, hang, take the memory."""

from __future__ import annotations

import os
import resource
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# what changes a path beside opening it: the arguments that name one, and where its folder's descriptor is
CHANGES = {
    "os.mkdir": ((0, 2),), "os.remove": ((0, 1),), "os.rmdir": ((0, 1),), "os.truncate": ((0, None),),
    "os.rename": ((0, 2), (1, 3)), "os.link": ((1, 3),), "os.symlink": ((1, 2),), "os.chmod": ((0, 2),),
    "os.chown": ((0, 3),), "os.utime": ((0, 3),),
}  # fmt: skip
FORBIDDEN = ("pickle.find_class", "os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "socket.connect")
TIME_LIMIT_S = 2.0
MEMORY_BYTES = 1 << 30  # beyond what the readers' libraries have taken already


class TooLongError(BaseException):
    """Not an ``Exception``: no reader may take it for a damaged file."""


class Guard:
    """Notes every forbidden act of this process while armed; audit hooks stay for the life of a process."""

    def __init__(self, allowed: Path, *, loopback: bool = False) -> None:
        self._allowed, self._loopback = str(allowed.resolve()) + os.sep, loopback
        self._armed = False
        self.seen: list[str] = []
        sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple) -> None:
        if not self._armed:
            return
        if event == "socket.connect" and self._loopback and arguments[1][0] == "127.0.0.1":
            return
        if event in FORBIDDEN:
            self._note(f"{event}{arguments!r:.80}")
        elif event == "open" and isinstance(arguments[0], str | bytes | os.PathLike):
            path, flags = os.fsdecode(arguments[0]), arguments[2]
            writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            if writes and path != os.devnull and not os.path.realpath(path).startswith(self._allowed):
                self._note(f"writes {path}")
        elif event in CHANGES:
            for at, folder in CHANGES[event]:
                self._check_change(event, arguments[at], -1 if folder is None else arguments[folder])

    def _check_change(self, event: str, path: object, folder: int) -> None:
        if not isinstance(path, str | bytes | os.PathLike):  # an open file, whose opening was judged
            return
        place = os.fsdecode(path)
        if folder not in (-1, None) and not os.path.isabs(place):
            place = os.path.join(os.readlink(f"/proc/self/fd/{folder}"), place)
        # the folder is resolved, not its last step: a link is changed, never what it leads to
        changed = os.path.join(os.path.realpath(os.path.dirname(place)), os.path.basename(place))
        if not f"{changed}{os.sep}".startswith(self._allowed):
            self._note(f"{event} {place}")

    def _note(self, what: str) -> None:
        self.seen.append(what)
        raise PermissionError(what)

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Arms the hooks and a timer that no ``except Exception`` stops."""
        self.seen.clear()
        previous = signal.signal(signal.SIGALRM, _too_long)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, _too_long)
        signal.setitimer(signal.ITIMER_PROF, TIME_LIMIT_S)  # CPU time: a busy machine is no hang
        signal.setitimer(signal.ITIMER_REAL, 30 * TIME_LIMIT_S)
        self._armed = True
        try:
            yield
        finally:
            self._armed = False
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, previous)


def forget_peak_mb() -> float:
    """Have the system forget this process's largest memory so far → what it takes now, MB.

    The mutations of an input are made in the same process, and may take more than its reader.
    """
    Path("/proc/self/clear_refs").write_text("5")
    return peak_mb()


def peak_mb() -> float:
    """The most memory since ``forget_peak_mb``, MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024


def limit_memory() -> None:
    """Lets this process take ``MEMORY_BYTES`` more than it has; an allocation beyond fails instead of swapping."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY_BYTES,) * 2)


def _too_long(signum: int, frame: object) -> None:
    raise TooLongError
