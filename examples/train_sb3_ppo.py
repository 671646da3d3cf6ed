"""Stable-baselines3's PPO on the state-only contact task: any RL library will do.

    python examples/train_sb3_ppo.py [--steps=100000] [--seed=0]

Prints the mean return and the final distance over 20 held-out episodes before and after. A feed-forward agent and this
few steps do not dock; the package's own expert (`spacedock train-expert`) does.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

import lerobot_spacedock  # noqa: F401  registers the ids


def make_env() -> gym.Env:
    """The contact task with a flat observation and actions in [-1, 1], which PPO's Gaussian starts from."""
    env = gym.make("SpaceDockContact-v0", obs_type="agent_pos", initial_conditions="same", disable_env_checker=True)
    env = gym.wrappers.FlattenObservation(env)
    # metres, radians and fractions of either on one scale
    low, high = env.observation_space.low, env.observation_space.high
    scale = np.float32([10, 10, 10, 0.5, 0.5, 0.5, 1, 1, 1, 1, 1, 1, 1])
    env = gym.wrappers.TransformObservation(
        env, lambda o: o / scale, gym.spaces.Box(low / scale, high / scale, dtype=np.float32)
    )
    return gym.wrappers.RescaleAction(env, np.float32(-1.0), np.float32(1.0))


def evaluate(agent: PPO, episodes: int = 20) -> tuple[float, float]:
    """(mean return, mean final distance in m) over held-out seeds."""
    env, returns, distances = make_env(), [], []
    for seed in range(10_000, 10_000 + episodes):
        observation, info = env.reset(seed=seed)
        total, done = 0.0, False
        while not done:
            action, _ = agent.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, info = env.step(action)
            total, done = total + reward, terminated or truncated
        returns.append(total)
        distances.append(np.linalg.norm(info["state"][:3]))
    return float(np.mean(returns)), float(np.mean(distances))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000, help="environment steps")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    agent = PPO(
        "MlpPolicy", DummyVecEnv([make_env] * 16), n_steps=128, batch_size=256, seed=args.seed, device="cpu",
        policy_kwargs={"log_std_init": -2.0},
    )  # fmt: skip
    print("before: mean return {:.2f}, mean final distance {:.1f} m".format(*evaluate(agent)))
    agent.learn(args.steps, progress_bar=False)
    print("after:  mean return {:.2f}, mean final distance {:.1f} m".format(*evaluate(agent)))


if __name__ == "__main__":
    main()
