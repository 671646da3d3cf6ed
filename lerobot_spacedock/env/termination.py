"""How an episode ends, and where exactly: the port plane is met inside a step, not after it."""

from __future__ import annotations

from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics.propagate import propagate_row

# the task ended the episode: CONTACT to VOLUME; its limit of steps: TIMEOUT and HORIZON
RUNNING, CONTACT, COLLISION, CORRIDOR, VOLUME, TIMEOUT, HORIZON, BROKEN = range(8)

# a contact inside the IDSS box is "docked"; BROKEN raises and has no name
OUTCOMES = {
    RUNNING: "running",
    CONTACT: "contact",
    COLLISION: "collision",
    CORRIDOR: "corridor",
    VOLUME: "volume",
    TIMEOUT: "timeout",
    HORIZON: "horizon",
}
DOCKED = "docked"

CROSSING_TOLERANCE_s = 1e-11  # 1e-11 s at 1 m/s: far below the integration error
_MAX_BISECTIONS = 60


@jit(forceinline=True)
def may_cross(start_m, end_m, start_m_s, end_m_s, step_s):
    """Whether a step can have met the port plane: axial distance and speed (outward) at both its ends."""
    # the closest that free deceleration can have come within the step
    dips = (start_m_s < 0.0) & (end_m_s > 0.0) & (min(start_m, end_m) <= -start_m_s * step_s)
    outside = (start_m > 0.0) | ((start_m == 0.0) & (start_m_s < 0.0))  # who starts on the plane, inwards, meets it now
    return outside & ((end_m <= 0.0) | dips)


@jit
def time_of_crossing(before, after, action, step_s, parameters, row, mean_motion, coupling, axial_sign):
    """When, inside a step, the reference point first meets the port plane coming from outside.

    Args:
        before, after: 14-tuples, the states at both ends of the step.
        axial_sign: of the outward normal along y; the other arguments as ``propagate_row``'s.

    Returns:
        s after the step's start, at which the axial distance is ≤ 0 for the first time (to ``CROSSING_TOLERANCE_s``),
        or -1.0 where the plane is not met. A dip through the plane and back within the step counts.
    """
    start, end = axial_sign * before[1], axial_sign * after[1]
    if not may_cross(start, end, axial_sign * before[4], axial_sign * after[4], step_s):
        return -1.0
    low, high = 0.0, step_s
    if end > 0.0:
        for _ in range(_MAX_BISECTIONS):  # to the turning point: where the axial speed changes sign
            middle = 0.5 * (low + high)
            state = propagate_row(before, action, middle, parameters, row, mean_motion, coupling, 0)
            if axial_sign * state[4] < 0.0:
                low = middle
            else:
                high = middle
        state = propagate_row(before, action, high, parameters, row, mean_motion, coupling, 0)
        if axial_sign * state[1] > 0.0:
            return -1.0
        low = 0.0
    # bisection, kept on the inner side: at `high` the plane has been reached
    for _ in range(_MAX_BISECTIONS):
        if high - low <= CROSSING_TOLERANCE_s:
            break
        middle = 0.5 * (low + high)
        state = propagate_row(before, action, middle, parameters, row, mean_motion, coupling, 0)
        if axial_sign * state[1] > 0.0:
            low = middle
        else:
            high = middle
    return high


@jit(forceinline=True)
def judge_place(r, axial_sign, crossed, capture_radius, station_radius, corridor, tangent, mouth_radius, volume_radius):
    """The outcome code of a place in a contact task; ``crossed``: it is where the port plane was met."""
    axial, lateral2 = axial_sign * r[1], r[0] * r[0] + r[2] * r[2]
    if crossed and lateral2 <= capture_radius * capture_radius:
        return CONTACT
    if axial <= 0.0 and lateral2 <= station_radius * station_radius:
        return COLLISION
    if corridor:
        width = mouth_radius + tangent * max(axial, 0.0)
        if lateral2 > width * width:
            return CORRIDOR
    if axial * axial + lateral2 > volume_radius * volume_radius:
        return VOLUME
    return RUNNING
