"""``spacedock completion``: a script that teaches a shell the verbs and their flags (written by shtab)."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass

import shtab
from draccus.argparsing import ArgumentParser

from lerobot_spacedock.errors import InputError, MissingDependencyError

# flags whose value is a file or a folder
_PATHS = re.compile(
    r"(^|_)(path|root|out|output|dir|log|logs|source|save|runs|results|demos|checkpoint|mesh|dataset|json|render|video"
    r"|training|init_from)$"
)


@dataclass
class CompletionConfig:
    """Prints a completion script, to be kept in the shell's own folder (it takes seconds to write)."""

    # bash | zsh | fish | tcsh | powershell
    shell: str = "bash"

    def __post_init__(self) -> None:
        if self.shell not in shtab.SUPPORTED_SHELLS:
            raise InputError("--shell", self.shell, " | ".join(shtab.SUPPORTED_SHELLS))


def completion(config: CompletionConfig) -> int:
    """Runs the verb; see the module."""
    print(shtab.complete(command_line(), config.shell))
    return 0


def command_line() -> argparse.ArgumentParser:
    """Every verb with its flags as argparse knows them; verbs whose extra is not installed have none."""
    from lerobot_spacedock.cli import VERBS

    parser = argparse.ArgumentParser(prog="spacedock")
    verbs = parser.add_subparsers()
    for name, verb in VERBS.items():
        own = verbs.add_parser(name, help=verb.summary)
        try:
            config_class, _ = verb.load()
        except MissingDependencyError:
            continue
        for action in ArgumentParser(config_class, prog=name).parser._actions:
            if "--help" in action.option_strings:
                continue
            flag = own.add_argument(*action.option_strings, help=_first_line(action.help), choices=action.choices)
            if _PATHS.search(action.dest.rpartition(".")[2]):
                flag.complete = shtab.FILE
    return parser


def _first_line(text: str | None) -> str:
    """Without what argparse or a shell would take for a format."""
    lines = (text or "").strip().splitlines()
    return re.sub(r"[^\w ,.;:()/°·-]", " ", lines[0]) if lines else ""
