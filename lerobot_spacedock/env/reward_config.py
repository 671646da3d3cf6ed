"""Weights and scales of the reward; the terms themselves are in ``reward.py``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RewardConfig:
    """Every step: ``alive`` minus the weighted costs, each cost in [0, 1]; at the end: the weighted bonuses."""

    # m/s, closing speed wanted at contact
    closing_speed_m_s: float = 0.075
    # m/s², deceleration of the wanted speed profile
    profile_deceleration_m_s2: float = 0.017
    # m/s, cap of the wanted speed
    profile_max_speed_m_s: float = 0.75
    # s, time constant with which a lateral offset is to be closed
    lateral_time_s: float = 8.0
    # s, time constant with which an attitude error is to be closed
    attitude_time_s: float = 5.0
    # a step without any cost
    alive: float = 0.3
    # cost of the velocity's distance from the wanted one
    velocity: float = 1.55
    # cost of the lateral offset
    lateral: float = 0.8
    # cost of the angle to the nominal attitude
    attitude: float = 0.8
    # cost of the angular rate's distance from the wanted one
    rate: float = 0.7
    # cost of the command itself, normalised by its limits
    effort: float = 0.06
    # cost of the command's change from the last step, normalised by its limits
    smoothness: float = 0.6
    # factor on all terminal bonuses
    terminal: float = 2.0
    # factor on everything, so that returns are of order one
    scale: float = 0.1
