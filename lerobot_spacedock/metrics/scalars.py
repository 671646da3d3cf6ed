"""Episode logs of in-training evaluations as TensorBoard scalars: LeRobot itself stays as it is.

A training writes them itself (``adapters/training_scalars.py``). For logs of other trainings, or of one that was told
not to,

    python -m lerobot_spacedock.metrics.scalars outputs/train/act/logs --eval_freq=2000 --follow=30

reads ``evaluation_0001``, ``evaluation_0002``, … below the folder as they appear, and writes one event file beside
them. ``wandb sync --sync-tensorboard`` takes the same file.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.metrics.catalog import CATALOG
from lerobot_spacedock.metrics.collect import EpisodeSet, collect

EVALUATIONS = "evaluation_[0-9][0-9][0-9][0-9]"
LONGEST_PAUSE_s = 86400.0


def terminal_scalars(episodes: EpisodeSet) -> dict[str, float]:
    """Means of numbers and shares of flags, over the episodes for which they are defined; undefined ones left out."""
    scalars = {"episodes": float(len(episodes))}
    for metric in CATALOG:
        values = episodes.values(metric.name)
        if len(values):
            scalars[metric.name] = float(values.mean())
    return scalars


def evaluations(log_dir: Path) -> list[tuple[int, Path]]:
    """(number, folder) of each in-training evaluation; a folder of episodes by itself is number 1."""
    found = [(int(path.name.rpartition("_")[2]), path) for path in sorted(log_dir.glob(EVALUATIONS))]
    return found or ([(1, log_dir)] if next(log_dir.glob("episode_*.parquet"), None) else [])


def write_scalars(log_dir: Path, out: Path, *, eval_freq: int = 1, done: set[int] | None = None) -> list[int]:
    """Writes the scalars of the evaluations that are not in ``done`` yet.

    Args:
        log_dir: as given to ``--env.log_dir`` of the training.
        out: folder of the event file.
        eval_freq: training steps between evaluations; the scalars' step is number × this.
        done: numbers already written; extended in place.

    Returns:
        Numbers written now.
    """
    done = set() if done is None else done
    fresh = [(number, folder) for number, folder in evaluations(log_dir) if number not in done]
    for number, folder in fresh:
        write_event(out, evaluation_scalars(folder), number * eval_freq)
        done.add(number)
    return [number for number, _ in fresh]


def evaluation_scalars(folder: Path) -> dict[str, float]:
    """``spacedock_<set>/<metric>`` → mean over the episode logs in a folder."""
    sets, _ = collect([sorted(folder.glob("episode_*.parquet"))], workers=1)
    return {
        f"spacedock_{conditions}/{name}": value
        for conditions, episodes in sets.items()
        for name, value in terminal_scalars(episodes).items()
    }


def write_event(out: Path, scalars: dict[str, float], step: int) -> None:
    """Adds scalars at one training step to a folder of TensorBoard event files."""
    from tensorboard.summary import Writer

    writer = Writer(str(out))
    for tag, value in scalars.items():
        writer.add_scalar(tag, value, step=step)
    writer.flush()
    writer.close()


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m lerobot_spacedock.metrics.scalars", description=__doc__)
    parser.add_argument("log_dir", type=Path, help="folder given to --env.log_dir of lerobot-train")
    parser.add_argument("--out", type=Path, help="folder of the event file; default: LOG_DIR/tensorboard")
    parser.add_argument("--eval_freq", type=int, default=1, help="training steps between evaluations")
    parser.add_argument("--follow", type=float, help="s between looks for new evaluations; default: look once")
    options = parser.parse_args(arguments)
    out = options.out or options.log_dir / "tensorboard"
    done: set[int] = set()
    try:
        if not options.log_dir.is_dir():
            raise InputError("log_dir", str(options.log_dir), "a folder that exists")
        if options.eval_freq < 1:
            raise InputError("--eval_freq", options.eval_freq, "an integer ≥ 1")
        if options.follow is not None and not 0.0 < options.follow <= LONGEST_PAUSE_s:
            raise InputError("--follow", options.follow, f"s, above 0 and at most {LONGEST_PAUSE_s:g}")
        while True:
            held = set() if options.follow is None else _unfinished(options.log_dir)
            written = write_scalars(options.log_dir, out, eval_freq=options.eval_freq, done=done | held)
            done |= set(written)
            if written:
                print(f"Wrote evaluations {written} to {out}")
            if options.follow is None:
                break
            time.sleep(options.follow)
    except SpaceDockError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    if not done:
        inner = options.log_dir / "episodes"
        hint = f"; there are some in {inner}" if evaluations(inner) else ""
        print(f"error: no evaluation in {options.log_dir}{hint}", file=sys.stderr)
        return 2
    print(f"Next: tensorboard --logdir={out}")
    return 0


def _unfinished(log_dir: Path) -> set[int]:
    """The last evaluation, if a file in it is younger than a minute: it may still be flying."""
    found = evaluations(log_dir)
    if not found:
        return set()
    number, folder = found[-1]
    quiet = time.time() - max((path.stat().st_mtime for path in folder.glob("*")), default=0.0)
    return {number} if quiet < 60.0 else set()


if __name__ == "__main__":
    sys.exit(main())
