"""The tables' cells against values by hand, from eight logs of known outcome; and the closing rate over range."""

import math

import numpy as np
import pytest
from synthetic_logs import NOMINAL

from lerobot_spacedock.episode_log import EpisodeLog, log_path, write_episode_log
from lerobot_spacedock.metrics.collect import RANGE_GRID_M, closing_profile
from lerobot_spacedock.report.build import ReportConfig, load_study
from lerobot_spacedock.report.write import make_tables


def hand_made(states, action=None, *, dt=0.5, extra=None, **metadata):
    """A log of states (x, y, vx, vy), m and m/s, at the nominal attitude and 1,000 kg."""
    state = np.zeros((len(states), 14))
    state[:, [0, 1, 3, 4]] = states
    state[:, 6], state[:, 7:11] = 1000.0, NOMINAL
    steps = len(states) - 1
    action = np.zeros((steps, 6)) if action is None else np.array(action, dtype=float)
    time = dt * np.arange(steps + 1)
    return EpisodeLog(time, state, action, np.full(steps, dt), np.zeros(steps), metadata, extra or {})


def approach(seed, x, y, speed, *, thrust, torque=0.0, at_5_m=0.0, **more):
    """Three steps of half a second: ends at (x, y) at ``speed``. Thrust N, 0, N; the torque in the last step."""
    states = [(0.1 * seed, -25, 0, 0), (at_5_m, -5, 0, speed), (x, y - 0.5 * speed, 0, speed), (x, y, 0, speed)]
    action = [(thrust, 0, 0, 0, 0, 0), (0,) * 6, (thrust, 0, 0, 0, 0, torque)]
    task = {"env_id": "SpaceDockContact-v0", "config": {"contact": True}, "initial_conditions": "same"}
    return hand_made(states, action, seed=seed, **task, **more)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    root = tmp_path_factory.mktemp("hand_made")
    slow, quick = [{"inference_s": np.array([9.0, 0.01, end])} for end in (0.05, 0.03)]  # the first is warm-up
    timed = {"inference": {"warm_up_steps": 1, "batch": 2}, "extra": quick}
    runs = {
        "MPC": [
            approach(0, 0.05, 0.0, 0.07, thrust=8, clipped_actions=0, **timed),  # docks
            approach(1, 0.30, 0.0, 0.07, thrust=9, clipped_actions=1, success=True, **timed),  # beside the port
            approach(2, 0.0, -2.0, 0.07, thrust=11, clipped_actions=0, at_5_m=3.0, **timed),  # stays before it
            approach(3, 0.02, 0.0, 0.5, thrust=12, clipped_actions=2, success=True, **timed | {"extra": slow}),  # fast
        ],
        "ACT": [
            approach(0, 0.15, 0.0, 0.07, thrust=19, torque=20),
            approach(1, 0.40, 0.0, 0.07, thrust=22, torque=20),
            approach(2, 0.0, -3.0, 0.07, thrust=21, torque=20),
            approach(3, 0.12, 0.0, 0.5, thrust=18, torque=20),
        ],
    }
    for label, logs in runs.items():
        for log in logs:
            write_episode_log(log_path(root / label, log.metadata["seed"]), log)
    cfg = ReportConfig(runs=[f"{label}={root / label}" for label in runs])
    return {table.key: table for table in make_tables(load_study(cfg), cfg)}


ROOT_10_3 = math.sqrt(10 / 3)  # N, sample standard deviation of 8, 9, 11, 12 as of 19, 22, 21, 18


@pytest.mark.parametrize(
    ("table", "row", "column", "value"),
    [
        ("glance", ["MPC"], "IDSS box", {"successes": 1, "n": 4}),
        ("glance", ["MPC"], "median ‖r_K‖ (m)", 0.175),
        ("glance", ["MPC"], "median miss at contact (m), of", 0.05),
        ("glance", ["MPC"], "‖Δa‖", 10.0),
        ("glance", ["MPC"], "Δv (m/s)", 0.010),
        ("table2", ["MPC"], "x, z (m)", [0.0, 0.3]),
        ("ladder", ["MPC"], "‖r_K‖ ≤ 0.1 m", {"successes": 2, "n": 4}),
        ("ladder", ["MPC"], "‖r_K‖ ≤ 0.8 m", {"successes": 3, "n": 4}),
        ("ladder", ["MPC"], "‖r_K‖ ≤ 2 m", {"successes": 4, "n": 4}),  # one on the limit itself
        ("ladder", ["MPC"], "best (m)", 0.02),
        ("conditions", ["IDSS", "closing speed"], "MPC, same", {"successes": 3, "n": 4}),
        ("conditions", ["IDSS", "lateral"], "MPC, same", {"successes": 2, "n": 4}),
        ("conditions", ["IDSS", "all together"], "MPC, same", {"successes": 1, "n": 4}),
        ("contact", ["MPC"], "crossed the plane", {"successes": 3, "n": 4}),
        ("contact", ["MPC"], "closing rate (m/s)", {"mean": 0.64 / 3, "p95": 0.07 + 0.9 * 0.43, "n": 3}),
        ("safety", ["MPC"], "success", {"successes": 3, "n": 4}),  # as stated, else the box
        ("safety", ["MPC"], "left the corridor", {"successes": 1, "n": 4}),
        ("safety", ["MPC"], "flew through", {"successes": 2, "n": 4}),
        ("safety", ["MPC"], "closest approach (m)", (0.05 + 0.3 + 2.0 + 0.02) / 4),
        # 0.07 three times and 0.5 once: of four draws none is 0.5 in 32 %, more than three in 0.4 % of resamples
        ("intervals", ["MPC", "‖v_K‖ (m/s)"], "mean", {"estimate": 0.1775, "low": 0.07, "high": 0.3925}),
        ("intervals", ["MPC", "‖v_K‖ (m/s)"], "95 %", {"estimate": 0.07 + 0.85 * 0.43, "low": 0.07, "high": 0.5}),
        ("pairs", ["Δv (m/s)"], "Welch t (df)", {"t": -10 / (ROOT_10_3 * math.sqrt(0.5)), "df": 6}),
        ("pairs", ["Δv (m/s)"], "Mann–Whitney U", 0),
        ("pairs", ["Δv (m/s)"], "p", 2 / 70),  # the extreme two of the 70 orders of four and four
        ("pairs", ["Δv (m/s)"], "p, Holm", 4 * 2 / 70),
        ("pairs", ["Δv (m/s)"], "Hedges g [95 %]", {"estimate": 0.8686 * -10 / ROOT_10_3}),  # c(6) of Hedges' table
        ("pairs", ["Δv (m/s)"], "Cliff's δ", -1.0),
        ("pairs", ["‖r_K‖ (m)"], "Cliff's δ", (5 - 11) / 16),
        ("matched", ["Δv (m/s)"], "pairs", 4),
        ("matched", ["Δv (m/s)"], "median difference", -0.0105),
        ("matched", ["Δv (m/s)"], "statistic", 0.0),
        ("matched", ["Δv (m/s)"], "p", 2 / 16),  # the extreme two of the 16 signs of four differences
        ("effort", ["MPC"], "impulse (N·s)", {"mean": 10.0, "std": ROOT_10_3}),
        ("effort", ["ACT"], "Δv / MPC's", 2.0),
        ("effort", ["ACT"], "steps at a limit", 1 / 3),
        ("effort", ["MPC"], "steps clipped", 3 / 12),
        ("smoothness", ["ACT"], "‖ΔT‖ (N)", {"mean": 20.0, "std": ROOT_10_3}),
        ("smoothness", ["ACT"], "‖ΔL‖ (N·m)", {"mean": 10.0, "std": 0.0}),
        ("smoothness", ["ACT"], "‖ΔT‖ per second (N/s)", {"mean": 40.0}),
        ("inference", ["MPC"], "mean (ms)", (3 * 20 + 30) / 4),
        ("inference", ["MPC"], "mean, 95 % of episodes (ms)", 20 + 0.85 * 10),
        ("inference", ["MPC"], "longest step (ms)", 50),
        ("inference", ["MPC"], "share of a control step", 0.1),
    ],
)
def test_cells_are_what_a_hand_finds(tables, table, row, column, value):
    (found,) = [cells for cells in tables[table].rows if set(row) <= {c for c in cells if isinstance(c, str)}]
    cell = found[tables[table].head.index(column)]
    if isinstance(value, dict):
        assert {key: cell.value[key] for key in value} == pytest.approx(value, rel=1e-4)
    else:
        assert cell.value == pytest.approx(value, rel=1e-4)


def test_cells_say_what_they_hold(tables):
    """Beside the numbers, what a reader sees: Clopper and Pearson's interval, the count, mean and percentile."""
    said = {}
    for key in ("glance", "contact", "effort"):
        (row,) = [cells for cells in tables[key].rows if "MPC" in cells]
        said |= {head: getattr(cell, "text", cell) for head, cell in zip(tables[key].head, row, strict=True)}
    assert said["IDSS box"] == "25 % [0.6, 80.6]"
    assert said["median miss at contact (m), of"] == "0.050, 3"
    assert said["closing rate (m/s)"] == "0.213 / 0.457"
    assert said["propellant (kg)"] == "–"


def test_the_closing_profile_is_of_the_first_time_at_each_range():
    """In from 10 m to 6 m, out to 9 m, in again to 1 m, out: what was flown outwards or again does not count."""
    flown = {-10: 1.0, -6: 0.8, -9: -0.5, -8: 0.3, -5: 0.6, -1: 0.2, -3: -0.3}  # m: m/s
    profile = closing_profile(hand_made([(0, y, 0, speed) for y, speed in flown.items()]))
    found = dict(zip(RANGE_GRID_M, profile, strict=True))
    expected = {10.0: 1.0, 8.0: 0.9, 6.0: 0.8, 5.5: 0.55, 5.0: 0.6, 3.0: 0.4, 1.0: 0.2}
    assert {distance: found[distance] for distance in expected} == pytest.approx(expected, abs=1e-6)
    assert np.array_equal(np.isnan(profile), (RANGE_GRID_M < 1.0) | (RANGE_GRID_M > 10.0))


def test_the_closing_profile_of_a_chaser_that_docks_is_its_speed_to_the_end():
    """At 0.08 m/s to 6 mm beside the port, where the range stands still: at range r the rate is v √(1 − (x/r)²)."""
    miss, speed = 0.006, 0.08
    profile = closing_profile(hand_made([(miss, y, 0, speed) for y in (-0.24, -0.16, -0.08, 0.0)], dt=1.0))
    near = RANGE_GRID_M[1:5]
    assert profile[1:5] == pytest.approx(speed * np.sqrt(1.0 - (miss / near) ** 2), abs=5e-4)
