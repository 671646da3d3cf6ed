"""What ``spacedock <verb> --help`` says: draccus's parser in a reader's words."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import re

_LONGEST_DEFAULT = 60  # characters
_NESTED = re.compile(r"\w+ \['([\w.]+)'\]")  # draccus's title of a nested config: its class, and its flags' prefix
_CONFIG_PATH = "a YAML or JSON file of these options, nested as their dots say; flags override it"


def print_help(parser: argparse.ArgumentParser, config_class: type, prog: str) -> None:
    """Prints the help of a verb.

    Args:
        parser: argparse's, as draccus has filled it; it is changed, and good for nothing else afterwards.
        config_class: the verb's config.
        prog: ``spacedock <verb>``.
    """
    required = {f.name for f in dataclasses.fields(config_class) if _is_required(f)}
    needed = "".join(f" --{f.name}=…" for f in dataclasses.fields(config_class) if f.name in required)
    parser.usage = f"{prog}{needed} [--flag=value ...]"
    # groups still hold actions that others of the same flag have replaced
    for action in {*parser._actions, *(action for group in parser._action_groups for action in group._group_actions)}:
        _tidy(action, required)
    for group in parser._action_groups:
        nested = _NESTED.fullmatch(group.title or "")
        if nested:
            group.title = f"--{nested[1]}.…"
        elif group.title == config_class.__name__:
            parser.description, group.title, group.description = group.description, "options", None
        elif group.title == "options":  # argparse's own: --help and --config_path
            group.title = "general"
        group.description = (group.description or "").replace("``", "") or None
    parser._action_groups.sort(key=lambda group: group.title == "general")
    parser.formatter_class = functools.partial(parser.formatter_class, max_help_position=30)
    parser.print_help()


def _tidy(action: argparse.Action, required: set[str]) -> None:
    """One option; argparse formats its text: "99 %" would be taken for a format."""
    from draccus.wrappers.field_metavar import get_metavar

    text = re.sub(r"\.?\s*\(default: .*?\)$|\.$", "", (action.help or "").replace("``", ""))
    default = action.default
    action.default = argparse.SUPPRESS  # else the formatter adds it in its own words, None too
    if (action.help or "").startswith("Config file for "):  # said twice of each group, which can have its own file
        action.help = argparse.SUPPRESS
        return
    if "--config_path" in action.option_strings:
        text = _CONFIG_PATH
    elif action.dest in required:
        text = f"{text} (required)"
    elif default not in (None, "", argparse.SUPPRESS) and default != [] and len(str(default)) < _LONGEST_DEFAULT:
        text = f"{text} (default: {default})"
    action.help = text.replace("%", "%%")
    kind = get_metavar(action.type) or ""
    if kind.startswith("["):  # of what may be None: reads as if the value could be left out
        action.metavar = kind[1:-1]


def _is_required(option: dataclasses.Field) -> bool:
    return option.default is dataclasses.MISSING and option.default_factory is dataclasses.MISSING
