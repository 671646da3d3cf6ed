"""Where an evaluation's episode logs go, and ``eval_metrics.jsonl``: one line an episode that was finished.

The environments write their own episode logs; this module decides the folder, keeps the episodes apart that LeRobot
flies only to fill its last batch, and records what the terminal ``info`` carried, which LeRobot drops.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.episode_log import log_path
from lerobot_spacedock.errors import InputError

METRICS_FILE = "eval_metrics.jsonl"
SURPLUS_FOLDER = "surplus"


def evaluation_folder(log_dir: Path, *, numbered: bool) -> Path:
    """The folder of one evaluation, which nothing has been written to yet.

    Args:
        log_dir: what the user chose.
        numbered: True inside training, where evaluation follows evaluation: ``evaluation_0001``, ``_0002``, ...

    Raises:
        InputError: the folder already holds the episodes of another evaluation.
    """
    if numbered:
        taken = [int(path.name.rpartition("_")[2]) for path in log_dir.glob("evaluation_[0-9][0-9][0-9][0-9]")]
        return log_dir / f"evaluation_{max(taken, default=0) + 1:04d}"
    if (log_dir / METRICS_FILE).exists() or next(log_dir.glob("episode_*.parquet"), None):
        raise InputError(
            "--env.log_dir",
            str(log_dir),
            "a folder without episodes of an earlier evaluation",
            "Give another --env.log_dir (or --output_dir, which it follows), or remove the old episodes.",
        )
    return log_dir


class EvaluationLog:
    """Counts the episodes of one evaluation as LeRobot does, by their place in its batches.

    Args:
        folder: where the environments write their episode logs.
        num_envs: episodes flown side by side.
        num_episodes: how many LeRobot will count, None if that cannot be known.
    """

    def __init__(self, folder: Path, num_envs: int, num_episodes: int | None) -> None:
        self.folder = folder
        self._num_envs = num_envs
        self._num_episodes = num_episodes
        self._batch = -1
        self._seeds: list[int | None] = []

    def start_batch(self, seeds: list[int | None]) -> None:
        self._batch += 1
        self._seeds = seeds

    def finish(self, env_index: int, values: Mapping[str, Any]) -> None:
        """Records one finished episode: the flat numbers, truths and words among ``values``."""
        episode = self._batch * self._num_envs + env_index
        surplus = self._num_episodes is not None and episode >= self._num_episodes
        seed = self._seeds[env_index]
        line = {"episode": episode, "seed": seed, "surplus": surplus}
        line |= {key: flat for key, value in values.items() if (flat := _flat(value)) is not None}
        if surplus and seed is not None:
            self._put_aside(log_path(self.folder, seed))
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / METRICS_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")

    def _put_aside(self, path: Path) -> None:
        if path.exists():
            (self.folder / SURPLUS_FOLDER).mkdir(exist_ok=True)
            path.replace(self.folder / SURPLUS_FOLDER / path.name)


def _flat(value: Any) -> float | int | bool | str | None:
    """A JSON scalar of a NumPy or Python scalar; None for everything else and for numbers that are not finite."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, (bool, int, float, str)) else None
