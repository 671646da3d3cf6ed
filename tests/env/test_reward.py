"""The reward: bounded, best where it should be, and made of the terms that ``info`` shows."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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


def one_step(position, velocity, q=None, rates=(0, 0, 0), action=(0,) * 6):
    env = gym.make("SpaceDockContact-v0", obs_type="agent_pos", disable_env_checker=True, hill_coupling=False)
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
