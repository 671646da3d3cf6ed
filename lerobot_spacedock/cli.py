"""The ``spacedock`` command: ``spacedock <verb> --flag=value``, flags parsed as LeRobot parses its own (draccus).

Each verb is a config dataclass and a function of it, living in the room that does the work and imported only when
the verb is called. ``--config_path=file.yaml`` reads a config first; flags override it.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import difflib
import importlib
import io
import json
import os
import re
import sys
import typing
from collections.abc import Iterator, Sequence
from typing import Any

from lerobot_spacedock import __version__
from lerobot_spacedock.cli_help import print_help
from lerobot_spacedock.errors import InputError, SpaceDockError

USAGE_ERROR = 2  # the exit status of argparse and of every shell tool for a command that cannot be understood


MOST_LISTED = 20  # options in an error message

# the options that a file, or a folder, is read by: the first that a verb has
OF_FILES = ("--log", "--source", "--results")
OF_FOLDERS = ("--dataset", "--source", "--runs", "--root")


@dataclasses.dataclass(frozen=True)
class Verb:
    """Where a verb lives: ``module:config`` is its dataclass, ``module:function`` does the work."""

    module: str
    config: str
    function: str
    summary: str

    def load(self) -> tuple[type, Any]:
        module = importlib.import_module(f"lerobot_spacedock.{self.module}")
        return getattr(module, self.config), getattr(module, self.function)


VERBS = {
    "train-expert": Verb("expert.train", "TrainExpertConfig", "train_expert", "train the meta-RL expert"),
    "demos": Verb("dataset.demos", "DemosConfig", "demos", "fly an expert, render, write a LeRobotDataset"),
    "convert": Verb("dataset.convert", "ConvertConfig", "convert", "turn other people's rollouts into a dataset"),
    "check": Verb("dataset.check", "CheckConfig", "check", "check a dataset's integrity and physics"),
    "push": Verb("dataset.push", "PushConfig", "push", "publish a dataset with its card"),
    "report": Verb("report.build", "ReportConfig", "report", "tables and figures from episode logs"),
    "sweep": Verb("study.sweep", "SweepConfig", "sweep", "vary demonstrations and the settings of ACT, resumable"),
    "sweep-figure": Verb("study.figure", "FigureConfig", "sweep_figure", "accuracy against smoothness of a sweep"),
    "view": Verb("report.view", "ViewConfig", "view", "look at an episode: in Rerun, as a film, as a picture"),
    "completion": Verb("completion", "CompletionConfig", "completion", "print a script for tab completion"),
}


# what Ctrl-C leaves behind, of the verbs that take it up again
RESUMED = dict.fromkeys(("demos", "convert", "push", "sweep"), "; the same command goes on from what is finished")
RESUMED["train-expert"] = "; the same command with --resume=true goes on from the last checkpoint"


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one verb; a mistake in the input is one message on stderr and exit status 2."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["help"] and len(arguments) > 1:
        arguments = [arguments[1], "--help"]
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(_overview())
        return 0 if arguments else USAGE_ERROR
    if arguments[0] in ("-V", "--version"):
        print(f"spacedock {__version__}")
        return 0
    try:
        return run(arguments[0], arguments[1:])
    except (SpaceDockError, OSError) as error:  # the latter: a full disk, a folder that may not be written, ...
        print(f"spacedock: error: {error}", file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print(f"spacedock: stopped{RESUMED.get(arguments[0], '')}", file=sys.stderr)
        return 130


def run(name: str, arguments: Sequence[str]) -> int:
    """Parses the flags of one verb and calls it.

    Raises:
        InputError: no such verb, an unknown or malformed flag, or a config file that cannot be used.
    """
    if name not in VERBS:
        raise InputError("verb", name, ", ".join(VERBS), _suggestion(name, VERBS))
    config_class, function = VERBS[name].load()
    try:
        config = parse_config(config_class, arguments, prog=f"spacedock {name}")
        return int(function(config) or 0)
    except InputError as error:
        if f"--{error.what}" in dict(_flag_kinds(config_class)):  # a part of the package that knows no flags
            raise InputError(f"--{error.what}", error.given, error.allowed, error.mend) from error
        raise


def parse_config(config_class: type, arguments: Sequence[str], *, prog: str) -> Any:
    """Flags (and the file of ``--config_path``) → an instance of ``config_class``.

    Raises:
        InputError: naming the flag, what was given, and the flags that exist.
    """
    from draccus.argparsing import ArgumentParser
    from draccus.utils import DraccusException

    parser = ArgumentParser(config_class, prog=prog)
    if "-h" in arguments or "--help" in arguments:
        print_help(parser.parser, config_class, prog)
        raise SystemExit(0)
    known = sorted({flag for action in parser.parser._actions for flag in action.option_strings} - {"-h", "--help"})
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            config, unknown = parser.parse_known_args(_joined(arguments, config_class, known))
    except SystemExit as error:  # argparse's own way out: a value missing, or not among the choices
        message = complaint.getvalue().strip().rpartition("error: ")[2]
        raise InputError(prog, " ".join(arguments), _options(known, prog), f"{message}.") from error
    except OSError as error:
        raise InputError("--config_path", error.filename, "an existing YAML or JSON file") from error
    except (DraccusException, argparse.ArgumentError) as error:
        if isinstance(error.__cause__, InputError):  # a config's own check, which names the field and the remedy
            raise error.__cause__ from None
        if str(error).startswith("Failed to load config"):
            said = f"{_config_path(arguments)}: {error.__cause__ or error}"
            raise InputError("--config_path", said, "a YAML or JSON file") from error
        flags = [argument.partition("=")[0] for argument in arguments if argument.startswith("--")]
        if stray := next((flag for flag in flags if flag not in (*known, "--config_path")), None):
            raise InputError(prog, stray, _options(known, prog), _suggestion(stray, known)) from error
        if wrong := re.search(r"^(?:`(.+?)`: )?The fields `(.+?)`", str(error)):
            flag = "--" + ".".join(part for part in (wrong[1], wrong[2].split("`")[0]) if part)
            given = f"{flag[2:]} in {_config_path(arguments)}"
            raise InputError("--config_path", given, _options(known, prog), _suggestion(flag, known)) from error
        if missing := re.search(r"Missing required field\(s\) (.+) for", str(error)):
            needed = " and ".join(f"--{name}" for name in re.findall(r"`(.+?)`", missing[1]))
            raise InputError(prog, f"no {needed}", f"{needed}=…", f"{prog} --help lists all options.") from error
        field = re.match(r"`(.+?)`: ", str(error))
        if field and f"--{field[1]}" in known:
            said = str(error)[field.end() :].partition(" Underlying error")[0]
            value = re.search(r"Couldn't parse '(.*)' into", said)
            given = f"--{field[1]}={value[1]}" if value else f"--{field[1]}"
            given = next((a for a in arguments if a.startswith(f"--{field[1]}=")), given)
            kind = re.search(r"into an? (\w+)", said)
            allowed = f"a value of type {kind[1]}" if kind else "a value of the type that --help names"
            raise InputError(prog, given, allowed, f"{prog} --help lists all options.") from error
        raise InputError(prog, str(error), _options(known, prog)) from error
    except InputError:
        raise
    # draccus trips over a file of another shape
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise InputError("--config_path", _config_path(arguments), "a YAML mapping of options") from error
    if unknown:
        flag = unknown[0].split("=", 1)[0]
        raise InputError(prog, unknown[0], _options(known, prog), _suggestion(flag, known))
    return config


def _config_path(arguments: Sequence[str]) -> str:
    """As given, in either form."""
    at = next((i for i, argument in enumerate(arguments) if argument.partition("=")[0] == "--config_path"), None)
    if at is None:
        return "none"
    _, equals, value = arguments[at].partition("=")
    return value if equals or at + 1 == len(arguments) else arguments[at + 1]


def _joined(arguments: Sequence[str], config_class: type, known: Sequence[str]) -> list[str]:
    """One ``--flag=value`` a flag: a bare switch is true; values of a list, given at once or one by one, are joined.

    Raises:
        InputError: a word that belongs to no flag, or a flag that needs a value and has none.
    """
    kinds = dict(_flag_kinds(config_class))
    given: dict[str, list[str]] = {}
    flag = None
    for argument in arguments:
        if argument.startswith("--"):
            flag, equals, value = argument.partition("=")
            given.setdefault(flag, [])
            if equals:  # a shell knows ~ only where a word begins with it
                given[flag].append(os.path.expanduser(value) if value.startswith("~/") else value)
        elif flag is None:
            raise InputError("option", argument, "options, which begin with --", _meant(argument, known))
        elif given[flag] and not kinds.get(flag, set()) & {list, tuple}:
            allowed = "options, which begin with --, and one value each"
            raise InputError("option", argument, allowed, _meant(argument, known))
        else:
            given[flag].append(argument)
    out = []
    for flag, values in given.items():
        kind = kinds.get(flag, set())
        if not values and flag in known and bool not in kind:
            raise InputError(flag, "nothing", f"a value: {flag}=…")
        if kind & {list, tuple} and not (len(values) == 1 and values[0].startswith("[")):
            out.append(f"{flag}={json.dumps(values)}")
        else:
            out += [f"{flag}={value}" for value in values or ["true"]]
    return out


def _meant(word: str, known: Sequence[str]) -> str:
    """A hint at the option that a bare word was meant for: one without dashes, or the one that takes such a path."""
    if f"--{word}".partition("=")[0] in known:
        return f"Did you mean --{word}?"
    ending = os.path.splitext(word)[1].lower()
    if not (os.path.exists(word) or "/" in word or ending[1:2].isalpha()):
        return ""
    if ending in (".yaml", ".yml"):
        return f"Did you mean --config_path={word}?"
    options = OF_FILES if ending and not os.path.isdir(word) else OF_FOLDERS
    option = next((option for option in options if option in known), None)
    if option == "--runs":
        return f"Did you mean --runs LABEL={word}?"
    return f"Did you mean {option}={word}?" if option else ""


def _flag_kinds(config_class: type, prefix: str = "--") -> Iterator[tuple[str, set[Any]]]:
    """Each flag, nested ones included, with the types that its value may be of."""
    for name, hint in typing.get_type_hints(config_class).items():
        yield prefix + name, {typing.get_origin(part) or part for part in (hint, *typing.get_args(hint))}
        if dataclasses.is_dataclass(hint):
            yield from _flag_kinds(hint, f"{prefix}{name}.")


def _options(known: Sequence[str], prog: str) -> str:
    """All of them where a reader can take them in."""
    return " ".join(known) if len(known) <= MOST_LISTED else f"the options that {prog} --help lists"


def _suggestion(given: str, known: Sequence[str]) -> str:
    if given.startswith("--env."):
        meant = {"--env.task": "--env_id"}.get(given, f"--{given.removeprefix('--env.')}")
        hint = f"Did you mean {meant}? " if meant in known else ""
        return f"{hint}--env.… are options of lerobot-train and lerobot-eval."
    close = difflib.get_close_matches(given, list(known), n=1)
    return f"Did you mean {close[0]}?" if close else ""


def _overview() -> str:
    width = max(map(len, VERBS))
    verbs = "\n".join(f"  {name:<{width}}  {verb.summary}" for name, verb in VERBS.items())
    return (
        "usage: spacedock <verb> [--flag=value ...]   (spacedock help <verb> lists its flags)\n\n"
        f"{verbs}\n\n"
        "Training and evaluation are LeRobot's own: lerobot-train and lerobot-eval with --env.type=spacedock."
    )


if __name__ == "__main__":
    raise SystemExit(main())
