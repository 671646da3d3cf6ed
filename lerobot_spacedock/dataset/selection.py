"""Which of the flown episodes become demonstrations: the best N of M by a stated rule."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lerobot_spacedock.dataset.episode import label_of
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.constants import THRUST_LIMIT_N, TORQUE_LIMIT_Nm
from lerobot_spacedock.physics.frames import ACTION_DIM, MASS, POSITION

_LIMITS = np.repeat([THRUST_LIMIT_N, TORQUE_LIMIT_Nm], ACTION_DIM // 2)


def final_distance_m(log: EpisodeLog) -> float:
    """Distance of the reference point from the port at the end."""
    return float(np.linalg.norm(log.state[-1, POSITION]))


def propellant_kg(log: EpisodeLog) -> float:
    return float(log.state[0, MASS] - log.state[-1, MASS])


def roughness(log: EpisodeLog) -> float:
    """Mean change of the label from step to step, in shares of the limits."""
    return float(np.linalg.norm(np.diff(label_of(log), axis=0) / _LIMITS, axis=1).mean()) if log.num_steps > 1 else 0.0


def episode_return(log: EpisodeLog) -> float:
    return float(log.reward.sum())


RULES: dict[str, tuple[Callable[[EpisodeLog], float], str]] = {
    "first": (lambda log: 0.0, "the first N, in the order flown"),
    "distance": (final_distance_m, "least distance from the port at the end"),
    "propellant": (propellant_kg, "least propellant"),
    "smoothness": (roughness, "least mean change of the label from step to step"),
    "return": (lambda log: -episode_return(log), "highest sum of rewards"),
}


def check_rule(rule: str) -> None:
    if rule not in RULES:
        raise InputError("--select", rule, " | ".join(f"{name} ({text})" for name, (_, text) in RULES.items()))


def score(log: EpisodeLog, rule: str) -> float:
    """What the rule sorts by: the lower the better."""
    check_rule(rule)
    return RULES[rule][0](log)


def best(scores: list[float], successes: list[bool], keep: int, *, successes_first: bool) -> list[int]:
    """Indices of the ``keep`` best, in ascending order; ties go to the earlier.

    Args:
        scores: one an episode, lower is better.
        successes: one an episode.
        keep: how many.
        successes_first: every success ranks before every failure.
    """
    order = sorted(range(len(scores)), key=lambda i: (successes_first and not successes[i], scores[i], i))
    return sorted(order[:keep])
