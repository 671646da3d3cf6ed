"""Pieces of an episode: the terminal approach alone, or shown more often."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.frames import POSITION

MIN_STEPS = 2  # LeRobot computes no statistics over a single frame
FORMS = "all | last:10m | last:20s | last:30 (or last:30steps)"
_PATTERN = re.compile(r"last:(\d+(?:\.\d+)?)(m|s|steps)?")


@dataclass(frozen=True)
class Segment:
    """The last part of an episode.

    Attributes:
        amount: how much; infinity is the whole episode.
        unit: ``m`` from the port (to the reference point), ``s`` before the end, or ``steps`` before the end.
    """

    amount: float = np.inf
    unit: str = "steps"

    @classmethod
    def parse(cls, text: str) -> Segment:
        """Reads ``all``, ``last:10m``, ``last:20s`` or ``last:30``; raises InputError otherwise."""
        if text in ("", "all"):
            return cls()
        match = _PATTERN.fullmatch(text)
        if match is None or float(match[1]) <= 0.0:
            raise InputError("--segment", text, FORMS)
        return cls(float(match[1]), match[2] or "steps")

    @property
    def whole(self) -> bool:
        return not np.isfinite(self.amount)

    def first_step(self, log: EpisodeLog) -> int:
        """Index of the first step that belongs to the segment; at least ``MIN_STEPS`` steps are left.

        In metres it is the step after the last time that the chaser was farther away: a chaser that leaves the
        sphere and comes back is taken from its last entry.
        """
        if self.whole:
            return 0
        if self.unit == "steps":
            first = log.num_steps - int(self.amount)
        elif self.unit == "s":
            first = int(np.searchsorted(log.time[:-1], log.time[-1] - self.amount))
        else:
            distance = np.linalg.norm(log.state[:-1, POSITION], axis=1)
            outside = np.flatnonzero(distance > self.amount)
            first = int(outside[-1]) + 1 if outside.size else 0
        return int(np.clip(first, 0, max(log.num_steps - MIN_STEPS, 0)))


def tail(log: EpisodeLog, first: int) -> EpisodeLog:
    """The episode from step ``first`` on; its time starts at 0 again.

    The metadata say where it begins in the whole episode, of which ``log`` may be a tail already.
    """
    if first == 0:
        return log
    begins = {
        "segment_first_step": int(log.metadata.get("segment_first_step", 0)) + first,
        "segment_start_s": float(log.metadata.get("segment_start_s", 0.0)) + float(log.time[first]),
    }
    rows = log.num_steps + 1
    extra = {name: values[first:] for name, values in log.extra.items() if len(values) in (rows, rows - 1)}
    return replace(
        log,
        time=log.time[first:] - log.time[first],
        state=log.state[first:],
        action=log.action[first:],
        dt=log.dt[first:],
        reward=log.reward[first:],
        metadata=log.metadata | begins,
        extra=extra,
    )


def pieces(log: EpisodeLog, segment: Segment, *, repeat_terminal: int = 0) -> list[tuple[int, EpisodeLog]]:
    """What one episode becomes in the dataset.

    Args:
        log: the episode.
        segment: which part. Where ``repeat_terminal`` is 0 the dataset holds this part alone.
        repeat_terminal: k > 0 writes the whole episode once and the segment k times more, as episodes of their own.

    Returns:
        (first step, episode) of each piece, in order.
    """
    first = segment.first_step(log)
    if repeat_terminal == 0:
        return [(first, tail(log, first))]
    if segment.whole:
        raise InputError("--repeat_terminal", repeat_terminal, "0 without a --segment", "Add --segment=last:10m.")
    return [(0, log)] + [(first, tail(log, first))] * repeat_terminal
