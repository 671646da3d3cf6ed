"""Kill -9 at random moments in every long command, and the result beside the undisturbed one.

    python tests/faults/run.py --moments=100                   # every command
    python tests/faults/run.py --only=demos,convert --moments=20

One line a command: how many kills, in how many rounds that ended with a comparison, and what was wrong.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from commands import COMMANDS, LIBRARIES, hub
from killed import Outcome, run_killed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moments", type=int, default=100, help="kills of each command")
    parser.add_argument("--only", default=",".join(COMMANDS), help="names, with commas between")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--keep", type=Path, help="work here, and leave what was written")
    options = parser.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "HF_HUB_DISABLE_PROGRESS_BARS": "1", "TQDM_DISABLE": "1"}
    hub()
    print("| command | undisturbed, s | kills | compared | differences | s |\n|:--|--:|--:|--:|:--|--:|", flush=True)
    wrong = 0
    for name in options.only.split(","):
        start = time.monotonic()
        with tempfile.TemporaryDirectory() as scratch:
            command = COMMANDS[name]()
            folder = (options.keep or Path(scratch)) / name
            try:
                outcome = run_killed(command, folder, moments=options.moments, seed=options.seed, libraries=LIBRARIES)
            except RuntimeError as error:
                outcome = Outcome(differences=[str(error)])
        said = "none" if not outcome.differences else str(len(outcome.differences))
        numbers = f"{outcome.whole_s:.1f} | {outcome.kills} | {outcome.rounds} | {said}"
        print(f"| `{command.name}` | {numbers} | {time.monotonic() - start:.0f} |", flush=True)
        for text in outcome.differences:
            print(f"  {command.name}: {text}", file=sys.stderr, flush=True)
        wrong += len(outcome.differences)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
