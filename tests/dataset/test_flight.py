"""Flights against the gymnasium environment; disturbances against their distribution."""

import gymnasium as gym
import numpy as np
import pytest
from dataset_samples import fly_some

from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig, disturbs
from lerobot_spacedock.dataset.episode import label_of
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.feedback import FeedbackPolicy


@pytest.mark.parametrize("env_id", ["SpaceDock-v0", "SpaceDockContact-v0", "SpaceDockMeta-v0"])
def test_the_environment_flies_the_same_episode(env_id):
    """The executed commands, given to the gymnasium environment from the same seed, lead to the same log."""
    log = fly_some([100_007], env_id=env_id, kicks=KickConfig(probability=0.2))[0]
    env = gym.make(env_id, obs_type="agent_pos")
    observation, info = env.unwrapped.reset(seed=100_007)
    seen = np.stack([log.extra[name] for name in sorted(log.extra) if name.startswith("observed_")] or [[0.0]])
    states, dts, rewards = [info["state"]], [], []
    for k, action in enumerate(log.action):
        if seen.size > 1:
            found = np.stack([log.extra[f"observed_{n}"][k] for n in ("x", "vy", "q1", "w3")])
            np.testing.assert_array_equal(found.astype(np.float32), observation["agent_pos"][[0, 4, 7, 12]])
        observation, reward, terminated, truncated, info = env.unwrapped.step(action)
        states.append(info["state"])
        dts.append(info["dt_s"])
        rewards.append(reward)
    assert terminated or truncated
    np.testing.assert_array_equal(np.array(states), log.state)
    np.testing.assert_array_equal(dts, log.dt)
    np.testing.assert_allclose(rewards, log.reward, rtol=1e-12)
    assert info["outcome"] == log.metadata["outcome"]
    assert info["is_success"] == log.metadata["success"]


def test_an_episode_does_not_depend_on_its_company():
    together = fly_some([5, 6, 7], kicks=KickConfig(probability=0.3))
    alone = fly_some([6], kicks=KickConfig(probability=0.3))[0]
    np.testing.assert_array_equal(together[1].state, alone.state)
    np.testing.assert_array_equal(label_of(together[1]), label_of(alone))


def test_the_label_is_what_the_law_says_of_the_disturbed_state():
    log = fly_some([9], kicks=KickConfig(probability=0.3))[0]
    law = FeedbackPolicy("V", hill_coupling=True)
    law.reset(1)
    for state, label in zip(log.state[:-1], label_of(log), strict=True):
        observation = np.delete(state, 6)[None].astype(np.float32)
        np.testing.assert_allclose(law.act(observation)[0], label, rtol=1e-9, atol=1e-9)
    assert np.abs(log.action - label_of(log)).max() > 10.0


def test_kicks_have_the_stated_rate_and_size():
    seeds = np.arange(400)
    drawn = Disturbance.draw(seeds, 100, KickConfig(probability=0.12, thrust_N=40.0, torque_Nm=3.0), NoiseConfig())
    kicked = (drawn.commands != 0.0).any(axis=2)
    assert kicked.mean() == pytest.approx(0.12, abs=0.005)  # 40,000 draws: one sigma is 0.0016
    assert drawn.commands[kicked][:, :3].std() == pytest.approx(40.0, rel=0.03)
    assert drawn.commands[kicked][:, 3:].std() == pytest.approx(3.0, rel=0.03)


def test_coloured_noise_has_the_stated_spread_and_correlation():
    drawn = Disturbance.draw(np.arange(200), 80, KickConfig(), NoiseConfig(0.7, thrust_N=8.0, torque_Nm=0.5)).commands
    assert drawn[..., :3].std() == pytest.approx(8.0, rel=0.03)
    assert drawn[..., 3:].std() == pytest.approx(0.5, rel=0.03)
    lag = (drawn[:, 1:, :3] * drawn[:, :-1, :3]).mean() / (drawn[..., :3] ** 2).mean()
    assert lag == pytest.approx(0.7, abs=0.03)


def test_no_disturbance_within_the_quiet_radius():
    log = fly_some([100_001], kicks=KickConfig(probability=1.0, quiet_m=5.0))[0]
    near = np.linalg.norm(log.state[:-1, :3], axis=1) < 5.0
    assert near.any()
    np.testing.assert_array_equal(log.action[near], label_of(log)[near])
    assert (log.action[~near] != label_of(log)[~near]).any(axis=1).all()


@pytest.mark.parametrize(
    "build", [lambda: KickConfig(probability=1.2), lambda: KickConfig(thrust_N=-1.0), lambda: NoiseConfig(1.0)]
)
def test_impossible_disturbances_are_refused(build):
    with pytest.raises(InputError, match=r"--(kicks|noise)\."):
        build()


@pytest.mark.parametrize(
    ("build", "missing"),
    [
        (lambda: KickConfig(thrust_N=80.0), "--kicks.probability"),
        (lambda: KickConfig(torque_Nm=6.0, quiet_m=1.0), "--kicks.probability"),
        (lambda: NoiseConfig(correlation=0.9), "--noise.thrust_N"),
        (lambda: disturbs(KickConfig(quiet_m=1.0), NoiseConfig()), "--kicks.probability"),
    ],
)
def test_the_size_of_a_disturbance_that_is_off_is_refused_with_the_flag_that_is_missing(build, missing):
    with pytest.raises(InputError, match=missing):
        build()


def test_what_is_on_may_have_any_size():
    assert disturbs(KickConfig(0.1, thrust_N=80.0, quiet_m=1.0), NoiseConfig())
    assert disturbs(KickConfig(quiet_m=1.0), NoiseConfig(0.9, torque_Nm=0.5)), "noise has a calm zone too"
    assert not disturbs(KickConfig(), NoiseConfig())
