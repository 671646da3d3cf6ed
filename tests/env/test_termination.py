"""How episodes end: each outcome by a flight with a known end, and the crossing where the closed form puts it."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.optimize import brentq

import lerobot_spacedock  # noqa: F401
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.relative_motion import hcw_transition_matrix

Q = [np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]


def flight(
    position, velocity, *, env_id="SpaceDockContact-v0", action=(0,) * 6, steps=None, q=None, rates=(0, 0, 0), **options
):
    """Flies a held command from a given state to the end; returns what the last step gave but the observation."""
    env = gym.make(env_id, obs_type="agent_pos", disable_env_checker=True, **options)
    start = [*position, *velocity, 1000.0, *(q or Q), *rates]
    env.reset(seed=0, options={"state": start} | ({} if steps is None else {"time_steps": steps}))
    while True:
        _, *last = env.step(np.array(action, dtype=np.float32))
        if last[1] or last[2]:
            return last


def test_contact_is_where_the_closed_form_crosses_the_plane():
    start = np.array([0.02, -0.5, 0.01, 0.002, 0.07, -0.001])
    _, terminated, truncated, info = flight(start[:3], start[3:], time_step="fixed", hill_coupling=False)
    crossing = brentq(lambda t: (hcw_transition_matrix(t, MEAN_MOTION_rad_s) @ start)[1], 0.0, 20.0, xtol=1e-13)
    at_plane = hcw_transition_matrix(crossing, MEAN_MOTION_rad_s) @ start
    assert (terminated, truncated) == (True, False)
    assert info["time_s"] == pytest.approx(crossing, abs=1e-9)
    assert abs(info["state"][1]) < 1e-10
    assert np.allclose(info["state"][:6], at_plane, atol=1e-10)
    assert info["outcome"] == "docked"
    assert info["is_success"]
    assert info["contact_closing_speed_m_s"] == pytest.approx(at_plane[4], abs=1e-10)


def test_who_starts_on_the_plane_meets_it_at_once_going_in_and_not_going_out():
    _, terminated, _, info = flight((0.01, 0.0, 0.0), (0.0, 0.07, 0.0))
    assert (terminated, info["outcome"]) == (True, "docked")
    assert info["time_s"] < 1e-9
    _, terminated, truncated, info = flight((0.01, 0.0, 0.0), (0.0, -0.05, 0.0), steps=[0.9, 0.9])
    assert (terminated, truncated, info["outcome"]) == (False, True, "timeout")


def test_a_touch_between_two_samples_is_found():
    """In through the plane and out again within one step of 4 s, by a brake that is on all along."""
    speed, brake, start = 0.1, 0.05, -0.09  # deepest point: -0.09 + 0.1²/(2*0.05) = +0.01
    _, terminated, _, info = flight(
        (0, start, 0), (0, speed, 0), action=(0, 0, -1000 * brake, 0, 0, 0), steps=[4.0, 4.0], hill_coupling=False
    )
    first = (speed - np.sqrt(speed**2 + 2 * brake * start)) / brake  # first root of start + v t - a t²/2
    assert terminated
    assert info["time_s"] == pytest.approx(first, abs=2e-3)  # mass flow and HCW move it by less
    assert abs(info["state"][1]) < 1e-10
    # without reaching it, no contact
    _, terminated, truncated, info = flight(
        (0, -0.11, 0), (0, speed, 0), action=(0, 0, -1000 * brake, 0, 0, 0), steps=[4.0], hill_coupling=False
    )
    assert (terminated, truncated, info["outcome"]) == (False, True, "timeout")


@pytest.mark.parametrize(
    ("case", "outcome"),
    [
        ({"position": (0.3, -0.2, 0), "velocity": (0, 0.07, 0)}, "contact"),  # 30 cm off: touches, outside the box
        ({"position": (0, -0.2, 0), "velocity": (0, 0.5, 0)}, "contact"),  # too fast
        ({"position": (0.9, -0.2, 0), "velocity": (0, 0.3, 0)}, "collision"),  # beside the port, into the module
        ({"position": (5.9, -25, 0), "velocity": (0.3, 0, 0)}, "corridor"),
        ({"position": (0, -58, 0), "velocity": (0, -1.0, 0)}, "volume"),
        ({"position": (0, -25, 0), "velocity": (0, 0, 0), "max_steps": 4}, "timeout"),
        ({"position": (0, -25, 0), "velocity": (0, 0, 0), "env_id": "SpaceDock-v0", "max_steps": 4}, "horizon"),
        ({"position": (0, -0.2, 0), "velocity": (0, 0.07, 0)}, "docked"),
    ],
)
def test_each_outcome(case, outcome):
    _, terminated, truncated, info = flight(**case)
    assert info["outcome"] == outcome
    assert truncated == (outcome in ("timeout", "horizon"))
    assert terminated == (not truncated)
    assert info["is_success"] == (outcome == "docked")


@pytest.mark.parametrize("limit", [{"steps": [4.0]}, {"max_steps": 1, "time_step": "fixed", "time_step_mean_s": 4.0}])
def test_contact_in_the_last_step_is_contact_and_no_timeout(limit):
    _, terminated, truncated, info = flight((0, -0.2, 0), (0, 0.07, 0), **limit)
    assert (terminated, truncated, info["outcome"]) == (True, False, "docked")
    assert info["time_s"] == pytest.approx(0.2 / 0.07, abs=0.01)


TAN_10_deg = 0.17632698
OPEN = {"corridor": {"enabled": False}}
IN = {"velocity": (0, 0.07, 0)}  # through the plane in the first step


@pytest.mark.parametrize(
    ("inside", "outside", "ends", "options"),
    [
        # the corridor: 1.5 m at its mouth, 10° to either side, along x, along z and between
        ((1.49 + 0.1 * TAN_10_deg, -0.1, 0), (1.51 + 0.1 * TAN_10_deg, -0.1, 0), "corridor", {}),
        ((0, -25, 1.49 + 25 * TAN_10_deg), (0, -25, 1.51 + 25 * TAN_10_deg), "corridor", {}),
        ((1.80, -6, 1.80), (1.82, -6, 1.82), "corridor", {}),  # (1.5 + 6 tan 10°) / √2 = 1.809
        # 60 m from the port, on the axis and beside it: √(60² - 10²) = 59.161
        ((0, -59.99, 0), (0, -60.01, 0), "volume", {}),
        ((10, -59.15, 0), (10, -59.17, 0), "volume", {}),
        # behind the port's plane: 3.1 m of Zvezda and 3.2 m of Harmony, at rest in there and on the way in
        ((0, 2, 3.11), (0, 2, 3.09), "collision", OPEN),
        ((0, -2, 3.21), (0, -2, 3.19), "collision", OPEN | {"port": "harmony_forward"}),
        ((3.11, -0.02, 0), (3.09, -0.02, 0), "collision", OPEN | IN),
    ],
)
def test_each_limit_stands_where_it_is_said_to(inside, outside, ends, options):
    """Two steps, at rest where nothing else is said, from just this side of a limit and from just that."""
    for place, outcome in ((inside, "timeout"), (outside, ends)):
        *_, info = flight(place, **{"velocity": (0, 0, 0), "max_steps": 2} | options)
        assert info["outcome"] == outcome


@pytest.mark.parametrize(("beside_m", "outcome"), [(0.59, "contact"), (0.61, "collision")])
def test_the_port_is_met_within_its_capture_radius(beside_m, outcome):
    """0.6 m; beside it is the module."""
    *_, info = flight((0.6 * beside_m, -0.02, 0.8 * beside_m), **IN)
    assert info["outcome"] == outcome


def test_harmony_is_approached_from_the_other_side():
    q = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    _, _, _, info = flight((0, 0.2, 0), (0, -0.07, 0), q=q, port="harmony_forward")
    assert info["outcome"] == "docked"


def test_corridor_can_be_left_open():
    _, _, _, info = flight((5.9, -25, 0), (0.3, 0, 0), corridor={"enabled": False}, max_steps=5)
    assert info["outcome"] == "timeout"


def test_the_papers_task_flies_through_the_plane():
    _, _, truncated, info = flight((0, -1.0, 0), (0, 0.1, 0), env_id="SpaceDock-v0", max_steps=30)
    assert truncated
    assert info["state"][1] > 1.0
    assert not info["is_success"]


@pytest.mark.parametrize(("distance", "success"), [(0.05, True), (0.2, False)])
def test_the_papers_task_succeeds_by_the_box_at_its_last_state(distance, success):
    *_, info = flight((0, -distance - 0.07, 0), (0, 0.07, 0), env_id="SpaceDock-v0", steps=[1.0])
    assert info["is_success"] is success


@pytest.mark.parametrize("case", [{"max_steps": 4}, {"steps": [0.9, 0.9]}])
def test_running_out_of_time_on_the_axis_is_not_in_the_box(case):
    """Aligned, at docking speed, on the axis: all but at the port."""
    *_, info = flight((0, -5.0, 0), (0, 0.07, 0), hill_coupling=False, **case)
    assert info["outcome"] == "timeout"
    assert info["contact_axial_m"] > 4.0
    assert info["contact_lateral_m"] < 0.01
    assert info["contact_idss_closing_speed"]
    for name in ("idss_lateral", "idss", "atv_lateral", "atv"):
        assert not info[f"contact_{name}"], name
