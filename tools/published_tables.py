"""Writes the tables of a document anew from the results in git: python tools/published_tables.py docs/results.md

A table stands between <!-- table: COMMAND --> and <!-- end -->, COMMAND being what follows
"python -m lerobot_spacedock.study." on the command line. With --check nothing is written; it exits 1 where a table
differs.
"""

import argparse
import contextlib
import io
import re
import shlex
import sys
from pathlib import Path

from lerobot_spacedock.study import summarize, table

BLOCK = re.compile(r"(<!-- table: ([^\n]+?) -->\n\n)(?:(?!<!--).)*?(\n\n<!-- end -->)", flags=re.S)
COMMANDS = {"summarize": summarize.main, "table": table.main}


def printed(command: str) -> str:
    """What the command of a table prints."""
    name, *arguments = shlex.split(command)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        if COMMANDS[name](arguments) != 0:
            raise SystemExit(f"failed: {command}")
    return out.getvalue().strip()


def refreshed(text: str) -> str:
    """The document with every table as its command prints it."""
    blocks = BLOCK.findall(text)
    if not len(blocks) == text.count("<!-- table:") == text.count("<!-- end -->"):
        raise SystemExit("a table's marker lacks its end, or the empty line beside it")
    return BLOCK.sub(lambda block: block[1] + printed(block[2]) + block[3], text)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("documents", nargs="+", type=Path)
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    stale = 0
    for path in arguments.documents:
        if not path.is_file():
            parser.error(f"{path}: no such file")
        text = path.read_text(encoding="utf-8")
        new = refreshed(text)
        if new == text:
            continue
        stale += 1
        print(f"{path}: {'tables differ from results/' if arguments.check else 'written anew'}", file=sys.stderr)
        if not arguments.check:
            path.write_text(new, encoding="utf-8")
    return 1 if arguments.check and stale else 0


if __name__ == "__main__":
    raise SystemExit(main())
