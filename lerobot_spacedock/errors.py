"""One root error. A message says what was given, what is allowed, and how to mend it."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LARGEST_ARRAY_BYTES = 8 << 30  # a file that asks for more at once is no episode, and is refused before it gets it


class SpaceDockError(Exception):
    """Root of every error that this package raises on purpose."""


class InputError(SpaceDockError, ValueError):
    """An argument, option, file or action that cannot be used.

    Args:
        what: the name of the thing, as its user writes it (``--env.camera.height``, ``action``).
        given: what was received.
        allowed: what would have been accepted.
        mend: what to do about it; left out where ``allowed`` already says it.
    """

    def __init__(self, what: str, given: object, allowed: str, mend: str = "") -> None:
        self.what, self.given, self.allowed, self.mend = what, given, allowed, mend
        super().__init__(what, given, allowed, mend)

    def __str__(self) -> str:
        text = f"{self.what}: got {_short(self.given)}; allowed: {self.allowed}."
        return f"{text} {self.mend}" if self.mend else text


class SimulationError(SpaceDockError):
    """The simulation left the domain in which it means anything (a state that is not finite, no mass left)."""


class FileFormatError(SpaceDockError, ValueError):
    """A file that cannot be read as what it claims to be; the message names file and place."""


class MissingDependencyError(SpaceDockError, ImportError):
    """An optional package is needed for what was asked."""


@contextmanager
def reading(path: Path | str, what: str) -> Iterator[None]:
    """Around the parsing of a file that anybody may have made: whatever a parser raises names the file.

    Args:
        path: of the file.
        what: it is read as, with its article ("an HDF5 file").

    Raises:
        FileFormatError: from any error inside, but for a file that is not there and what names this one already.
    """
    try:
        yield
    except InputError as error:
        if Path(path).name in str(error) or error.what.startswith("--"):
            raise
        raise FileFormatError(f"{path}: {error}") from error
    except (SpaceDockError, FileNotFoundError):
        raise
    except Exception as error:  # parsers of damaged files raise what their authors did not think of
        said = _short(f"{type(error).__name__}: {error}")
        raise FileFormatError(f"{path}: not readable as {what} ({said}).") from error


def check_size(path: Path | str, name: str, count_bytes: int) -> None:
    """Raises FileFormatError where a header asks for more than ``LARGEST_ARRAY_BYTES``."""
    if count_bytes > LARGEST_ARRAY_BYTES:
        raise FileFormatError(f"{path}: {name!r} claims {count_bytes / 2**30:,.0f} GiB; 8 are the most.")


def one_of(what: str, given: object, allowed: tuple[str, ...]) -> None:
    """Raises InputError unless ``given`` is one of the names."""
    if given not in allowed:
        raise InputError(what, given, " | ".join(allowed))


def in_range(what: str, given: object, low: float, high: float) -> None:
    """Raises InputError unless ``given`` is a finite number within the bounds."""
    number = isinstance(given, (int, float)) and not isinstance(given, bool)
    if not number or not math.isfinite(given) or not low <= given <= high:
        raise InputError(what, given, f"a number from {low:g} to {high:g}")


def _short(value: object, limit: int = 200) -> str:
    text = value if isinstance(value, str) else repr(value)
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 1] + "…"
