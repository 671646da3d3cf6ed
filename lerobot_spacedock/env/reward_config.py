"""Weights and scales of the reward; the terms themselves are in ``reward.py``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RewardConfig:
    """Every step: ``alive`` minus the weighted costs; at the end: the weighted bonuses."""

    # m/s, closing speed wanted at contact
    closing_speed_m_s: float = 0.075
    # m/s, wanted far away
    cruise_speed_m_s: float = 1.0
    # s, time to go at which braking from the cruise speed begins
    braking_time_s: float = 39.5
    # speed over time to go is this power of it; above 1 it is flat at the port
    braking_power: float = 1.4
    # s, time constant with which a lateral offset is to be closed
    lateral_time_s: float = 10.0
    # s, time constant with which an attitude error is to be closed
    attitude_time_s: float = 8.0
    # a step without any cost
    alive: float = 3.0
    # cost of the closing speed's distance from the wanted one, …
    closing: float = 1.0
    # … and its scale, m/s: quadratic below, logarithmic above
    closing_scale_m_s: float = 0.02
    # cost of the lateral velocity's distance from the wanted one
    drift: float = 0.3
    # its scale at the port, m/s, …
    drift_scale_m_s: float = 0.01
    # … and how it grows with the distance to go, m/s per m: far away there is time to be gentle
    drift_scale_per_m: float = 0.0
    # cost of the lateral offset
    lateral: float = 0.25
    # its scale at the port, m, …
    lateral_scale_m: float = 0.015
    # … and how it grows with the distance to go, m per m
    lateral_scale_per_m: float = 0.0
    # cost of the angle to the nominal attitude
    attitude: float = 0.25
    # its scale, deg
    attitude_scale_deg: float = 0.5
    # cost of the angular rate's distance from the wanted one
    rate: float = 0.3
    # its scale, deg/s
    rate_scale_deg_s: float = 0.05
    # cost of each N (and N·m) by which the command changes from the last step: the norm of the paper's Eq. 4
    smoothness: float = 0.08
    # factor on all terminal bonuses
    terminal: float = 20.0
    # factor on everything, so that returns are of order ten
    scale: float = 0.1
