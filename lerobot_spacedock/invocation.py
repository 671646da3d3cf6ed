"""The command that is running, as what it writes says how it was made."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path


def command_line() -> str:
    """As its user would type it in a shell: the program by its name, not by its path."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
