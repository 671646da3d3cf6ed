"""The command that is running: how what it writes says that it was made, and the cores that it may use."""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path


def command_line() -> str:
    """As its user would type it in a shell: the program by its name, not by its path."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def available_cores() -> int:
    """How many of this machine's cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
