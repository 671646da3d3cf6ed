"""Where an evaluation's episode logs go, and ``eval_metrics.jsonl``: one line an episode that was finished.

The environments write their own episode logs; this module decides the folder, keeps the episodes apart that LeRobot
flies only to fill its last batch, and records what the terminal ``info`` carried, which LeRobot drops.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.episode_log import (
    POLICY_FILE,
    SURPLUS_FOLDER,
    log_path,
    read_episode_log,
    write_episode_log,
)
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.files import write_json
from lerobot_spacedock.folders import check_writable

METRICS_FILE = "eval_metrics.jsonl"


@dataclass
class Inference:
    """How long a policy took for each step of one batch of episodes.

    Attributes:
        batch: episodes that it was asked for at once.
        warm_up_steps: steps at the beginning that are no measure of a step (the first of all).
        step_s: s, a step.
    """

    batch: int
    warm_up_steps: int
    step_s: list[float] = field(default_factory=list)

    @property
    def mean_ms(self) -> float | None:
        """ms, over the steps that count; None where there is none."""
        counted = self.step_s[self.warm_up_steps :]
        return 1e3 * math.fsum(counted) / len(counted) if counted else None


def evaluation_folder(log_dir: Path, *, numbered: bool) -> Path:
    """The folder of one evaluation, which nothing has been written to yet.

    Args:
        log_dir: what the user chose.
        numbered: True inside training, where evaluation follows evaluation: ``evaluation_0001``, ``_0002``, ...

    Raises:
        InputError: the folder already holds the episodes of another evaluation, or cannot be written.
    """
    check_writable(log_dir, "--env.log_dir")
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
        policy: what flies and what it learnt from, for ``policy.json``; asked for when the first episode is finished.
        at_end: called with the folder once, when the envs close, if an episode was finished.
    """

    def __init__(
        self,
        folder: Path,
        num_envs: int,
        num_episodes: int | None,
        *,
        policy: Callable[[], dict[str, Any] | None] | None = None,
        at_end: Callable[[Path], None] | None = None,
    ) -> None:
        self.folder = folder
        self._policy, self._at_end = policy, at_end
        self._begun = False
        self._num_envs = num_envs
        self._num_episodes = num_episodes
        self._batch = -1
        self._seeds: list[int | None] = []

    def start_batch(self, seeds: list[int | None]) -> None:
        self._batch += 1
        self._seeds = seeds

    def finish(self, env_index: int, values: Mapping[str, Any], inference: Inference | None = None) -> None:
        """Records one finished episode: the flat numbers, truths and words among ``values``, and the inference time.

        The latter goes into the episode's own log too, as the column ``inference_s``.
        """
        episode = self._batch * self._num_envs + env_index
        surplus = self._num_episodes is not None and episode >= self._num_episodes
        seed = self._seeds[env_index]
        line = {"episode": episode, "seed": seed, "surplus": surplus}
        line |= {key: flat for key, value in values.items() if (flat := _flat(value)) is not None}
        if inference is not None:
            line |= {"inference_ms": inference.mean_ms, "inference_batch": inference.batch}
            if seed is not None:
                _add_inference(log_path(self.folder, seed), inference)
        if surplus and seed is not None:
            self._put_aside(log_path(self.folder, seed))
        self.folder.mkdir(parents=True, exist_ok=True)
        if not self._begun:
            self._begun = True
            self._write_policy()
        with (self.folder / METRICS_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")

    def close(self) -> None:
        """The evaluation is over; may be called twice."""
        if self._begun and self._at_end is not None:
            then, self._at_end = self._at_end, None
            then(self.folder)

    def _write_policy(self) -> None:
        described = None if self._policy is None else self._policy()
        if described is not None:
            write_json(self.folder / POLICY_FILE, described, indent=2)

    def _put_aside(self, path: Path) -> None:
        if path.exists():
            (self.folder / SURPLUS_FOLDER).mkdir(exist_ok=True)
            path.replace(self.folder / SURPLUS_FOLDER / path.name)


def _add_inference(path: Path, inference: Inference) -> None:
    """Adds the inference times to a log that its env has just written."""
    try:
        log = read_episode_log(path)
    except FileNotFoundError:  # the env writes none
        return
    except FileFormatError as error:
        logging.warning("no inference times in a log: %s", error)
        return
    about = {"batch": inference.batch, "warm_up_steps": inference.warm_up_steps}
    times = {"inference_s": np.array(inference.step_s[: log.num_steps])}
    write_episode_log(path, replace(log, metadata=log.metadata | {"inference": about}, extra=log.extra | times))


def _flat(value: Any) -> float | int | bool | str | None:
    """A JSON scalar of a NumPy or Python scalar; None for everything else and for numbers that are not finite."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, (bool, int, float, str)) else None
