"""The reward: bounded, best where it should be, and made of the terms that ``info`` shows."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import lerobot_spacedock  # noqa: F401
from lerobot_spacedock.env.reward import LOG_WELL_CAP, STEP_TERMS, TERMINAL_FACTORS, log_well, terminal_bonus
from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.physics.contact import contact_report

Q = [np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]


@settings(max_examples=300, deadline=None)
@given(st.floats(-1e12, 1e12), st.floats(1e-6, 1e3))
def test_wells_are_bounded_even_and_zero_at_the_goal(value, scale):
    depth = log_well(value, scale)
    assert 0.0 <= depth <= LOG_WELL_CAP
    assert depth == log_well(-value, scale)
    assert log_well(0.0, scale) == 0.0


def one_step(position, velocity, q=None, rates=(0, 0, 0), action=(0,) * 6, **options):
    options = {"obs_type": "agent_pos", "disable_env_checker": True, "hill_coupling": False} | options
    env = gym.make("SpaceDockContact-v0", **options)
    env.reset(seed=0, options={"state": [*position, *velocity, 1000.0, *(q or Q), *rates]})
    _, reward, *_, info = env.step(np.float32(action))
    return reward, info


def test_reward_is_the_sum_of_the_terms_in_info():
    reward, info = one_step((0.5, -20, -0.3), (0.01, 0.4, 0), action=(1, 2, 3, 0.1, 0, 0))
    assert reward == pytest.approx(sum(info[f"reward_{name}"] for name in (*STEP_TERMS, "terminal")), abs=1e-12)
    assert info["reward_terminal"] == 0.0


@pytest.mark.parametrize(
    ("term", "worse"),
    [
        ("closing", {"velocity": (0, 1.5, 0)}),
        ("drift", {"velocity": (0.5, 0.5, 0)}),
        ("lateral", {"position": (3.0, -20, 0)}),
        ("attitude", {"q": [1.0, 0, 0, 0]}),
        ("rate", {"rates": (0, 0, 5.0)}),
    ],
)
def test_each_term_falls_with_its_own_error(term, worse):
    good = {"position": (0, -20, 0), "velocity": (0, 0.5, 0)}
    _, before = one_step(**good)
    _, after = one_step(**(good | worse))
    assert after[f"reward_{term}"] < before[f"reward_{term}"]


@pytest.mark.parametrize(("port", "side"), [("zvezda_aft", -1.0), ("harmony_forward", 1.0)])
@pytest.mark.parametrize(
    ("distance", "wanted"), [(0.2, RewardConfig.closing_speed_m_s), (38.0, RewardConfig.cruise_speed_m_s)]
)
def test_closing_is_best_at_the_wanted_speed_into_the_port(port, side, distance, wanted):
    term = {
        share: one_step((0, side * distance, 0), (0, -side * share * wanted, 0), port=port)[1]["reward_closing"]
        for share in (-1, 0, 1, 2)
    }
    assert max(term, key=term.get) == 1
    assert term[-1] < term[0]


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("offset", [1.0, -1.0])
def test_drift_is_best_towards_the_axis_in_the_stated_time(axis, offset):
    place, towards = np.array([0, -20.0, 0]), np.zeros(3)
    place[axis], towards[axis] = offset, -offset / RewardConfig.lateral_time_s
    term = {share: one_step(place, share * towards)[1]["reward_drift"] for share in (-1, 0, 1, 2)}
    assert max(term, key=term.get) == 1
    assert term[-1] < term[0]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle_deg", [4.0, -4.0])
def test_rate_is_best_towards_the_nominal_attitude_in_the_stated_time(axis, angle_deg):
    """Tilted about each body axis."""
    turn = np.zeros(3)
    turn[axis] = angle_deg
    nominal = Rotation.from_quat(Q, scalar_first=True)
    q = (nominal * Rotation.from_rotvec(turn, degrees=True)).as_quat(scalar_first=True)
    towards = -turn / RewardConfig.attitude_time_s
    term = {
        share: one_step((0, -20, 0), (0, 0.5, 0), q=list(q), rates=share * towards)[1]["reward_rate"]
        for share in (-1, 0, 1, 2)
    }
    assert max(term, key=term.get) == 1
    assert term[-1] < term[0]


@pytest.mark.parametrize("seed", range(3))
def test_both_quaternions_of_an_attitude_earn_the_same(seed):
    rng = np.random.default_rng(seed)
    q, rates = rng.normal(size=4), rng.uniform(-2, 2, 3)
    q /= np.linalg.norm(q)
    one, other = (one_step((0.5, -20, -0.3), (0.01, 0.4, 0), q=list(s * q), rates=rates) for s in (1, -1))
    assert one[0] == pytest.approx(other[0], abs=1e-12)
    for name in STEP_TERMS:
        assert one[1][f"reward_{name}"] == pytest.approx(other[1][f"reward_{name}"], abs=1e-12), name


def test_docking_earns_the_whole_bonus_and_missing_little_of_it():
    config = RewardConfig()
    best = {
        "axial_m": 0.0, "closing_speed_m_s": config.closing_speed_m_s, "lateral_m": 0.0, "lateral_speed_m_s": 0.0,
        "pitch_yaw_deg": 0.0, "roll_deg": 0.0, "pitch_yaw_rate_deg_s": 0.0, "roll_rate_deg_s": 0.0,
    }  # fmt: skip
    worst = {name: np.full(1, 50.0) for name in best}
    best = {name: np.full(1, value) for name, value in best.items()}
    most = config.scale * config.terminal * sum(TERMINAL_FACTORS.values())
    assert terminal_bonus(contact_report(best), best["lateral_m"], config) == pytest.approx(most)
    assert terminal_bonus(contact_report(worst), worst["lateral_m"], config) == pytest.approx(0.0, abs=1e-6)
