"""Real full disks: each command runs into a small file system until it is full, then goes on when there is room.

    unshare --user --map-root-user --mount python tests/faults/full_disk.py       # root needs no unshare
    ... --only=demos,convert --tries=4

For each command: how much it takes when it has room; then file systems (tmpfs) of sizes between nothing and that. Each
try must end with one message that says so, leave no dataset that looks whole, and, once the file system has grown, end
with the same result by the same command.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from commands import COMMANDS, LIBRARIES, hub
from killed import Command, clear, difference, finish, last_words, same, server, start, words_file

ROOMY_MB = 500.0


def mount(folder: Path, size_MB: float, *, again: bool = False) -> None:
    """A tmpfs of this size at ``folder``, or the one that is there made larger."""
    options = f"size={max(int(size_MB * 1e6), 4096)}" + (",remount" if again else "")
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", str(folder)], check=True)


class Peak(threading.Thread):
    """The most that was in use of a file system while this ran."""

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        self.folder, self.most_MB, self._end = folder, 0.0, threading.Event()

    def run(self) -> None:
        while not self._end.wait(0.005):
            self.most_MB = max(self.most_MB, used_MB(self.folder))

    def stop(self) -> float:
        self._end.set()
        self.join()
        return self.most_MB


def used_MB(folder: Path) -> float:
    return shutil.disk_usage(folder).used / 1e6


def fill(command: Command, folder: Path, tries: int) -> list[str]:
    """All tries of one command; returns a line each that was wrong."""
    folder.mkdir(parents=True)
    mount(folder, ROOMY_MB)
    context, wrong = server(LIBRARIES), []
    command.prepare(folder)
    before = used_MB(folder)
    finish(context, command, folder, command.arguments(folder))
    clear(command, folder)
    peak = Peak(folder)
    peak.start()
    finish(context, command, folder, command.arguments(folder))
    most = peak.stop()
    wanted = command.result(folder)
    full = 0
    for number in range(tries):
        clear(command, folder)
        size = before + (most - before) * (number + 0.5) / tries
        mount(folder, size, again=True)
        process = start(context, command, folder, command.arguments(folder))
        process.join(300.0)
        said = last_words(folder)
        place = f"{command.name}, {size:.2f} of {most:.2f} MB"
        if process.exitcode is None:
            process.kill()
            wrong.append(f"{place}: it hung: {said}")
        elif process.exitcode != 0:
            full += 1
            if not any(text in said for text in ("No space left", "Errno 28", "disk is full")):
                wrong.append(f"{place}: the reason is missing: {said[-700:]}")
            if command.program.startswith("lerobot_spacedock") and "Traceback" in said:
                wrong.append(f"{place}: a traceback: {said[-1200:]}")
            print(f"    {size:.2f} MB: {[line for line in said.splitlines() if line.strip()][-1][:230]}", flush=True)
        try:
            command.after_kill(folder)
        except Exception as error:
            wrong.append(f"{place}: {type(error).__name__}: {error}")
        mount(folder, ROOMY_MB, again=True)
        words_file(folder).unlink(missing_ok=True)
        if process.exitcode != 0:
            try:
                finish(context, command, folder, (command.again or command.arguments)(folder))
            except RuntimeError as error:
                wrong.append(f"{place}: with room again: {error}")
                continue
        found = command.result(folder)
        if not same(wanted, found):
            wrong.append(f"{place}: with room again: {difference(wanted, found)}")
    print(f"| `{command.name}` | {most - before:.2f} | {tries} | {full} | {len(wrong) or 'none'} |", flush=True)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="demos,demos_frames,convert,push,train-expert,eval,sweep")
    parser.add_argument("--tries", type=int, default=6, help="file systems of different sizes, for each command")
    options = parser.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "HF_HUB_DISABLE_PROGRESS_BARS": "1", "TQDM_DISABLE": "1"}
    hub()
    print("| command | needs, MB | tries | full | wrong |\n|:--|--:|--:|--:|:--|", flush=True)
    failures: list[str] = []
    for name in options.only.split(","):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / name
            try:
                failures += fill(COMMANDS[name](), folder, options.tries)
            finally:
                time.sleep(0.1)
                subprocess.run(["umount", "-l", str(folder)], check=False)
    for text in failures:
        print(f"  {text}", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
