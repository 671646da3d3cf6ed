"""The benchmarks in one table: each measurement beside a named peer or floor of the same run.

    python benchmarks [--quick] [--only simulator,frame]

`--quick` takes fewer repeats than the whole, which takes some seven minutes on two cores; a peer that is not installed
is named as such (`pip install "lerobot_env_spacedock[bench]"` brings them). Each file of this folder also runs alone,
with more detail; `dataset_scale.py`, `dataset_codec.py`, `expert.py` and `report.py`, which take minutes each, run
alone only.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import traceback
from collections.abc import Iterator

from table import Row, show

PARTS = ("imports", "simulator", "frame", "flights", "dataset", "training")


def rows(names: list[str], quick: bool) -> Iterator[Row]:
    """Rows of every part; a part that fails says so in the table and on stderr, and the others go on."""
    for name in names:
        print(f"… {name}", file=sys.stderr, flush=True)
        try:
            yield from importlib.import_module(name).rows(quick)
        except Exception:
            traceback.print_exc()
            yield Row(f"{name}: failed, see above", float("nan"), "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--only", default=",".join(PARTS), help=f"comma-separated, of {', '.join(PARTS)}")
    args = parser.parse_args()
    names = args.only.split(",")
    if unknown := sorted(set(names) - set(PARTS)):
        parser.error(f"--only: {', '.join(unknown)}; allowed: {', '.join(PARTS)}")
    show(rows(names, args.quick))


if __name__ == "__main__":
    main()
