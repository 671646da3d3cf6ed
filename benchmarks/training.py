"""How fast training goes: the expert's recurrent PPO beside sb3-contrib's, and a step of stock ACT by its parts.

    python benchmarks/training.py [--quick]

Both PPOs fly the same environment (`SpaceDockMeta-v0`'s dynamics, state only) with an LSTM of 64 on one thread; counted
are environment steps a second, collection and update together. The ACT step is that of `configs/act_cpu.yaml`'s network
and batch on synthetic demonstrations: reading and decoding a batch, beside forward, backward and the optimiser.
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from table import Row, show

import lerobot_spacedock
from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset.record import Storage
from lerobot_spacedock.expert.ppo import collect, make_ppo
from lerobot_spacedock.expert.train_config import TrainExpertConfig
from lerobot_spacedock.expert.training_tasks import TrainingTasks


def expert_rate(iterations: int) -> float:
    """Environment steps a second of ``spacedock train-expert``, 256 chasers at once."""
    config = TrainExpertConfig(num_envs=256)
    tasks = TrainingTasks(config)
    algorithm = make_ppo(config, tasks.reset(0))
    collect(algorithm, tasks, 0, config.episode_steps)
    algorithm.update()
    start = time.perf_counter()
    for iteration in range(1, iterations + 1):
        collect(algorithm, tasks, iteration, config.episode_steps)
        algorithm.update()
    return iterations * config.num_envs * config.episode_steps / (time.perf_counter() - start)


def sb3_rate(steps: int) -> float:
    """The same of sb3-contrib's RecurrentPPO, 16 environments in one process."""
    from sb3_contrib import RecurrentPPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    def make() -> gym.Env:
        env = gym.make("SpaceDockMeta-v0", obs_type="agent_pos", disable_env_checker=True)
        return gym.wrappers.RescaleAction(gym.wrappers.FlattenObservation(env), np.float32(-1), np.float32(1))

    agent = RecurrentPPO(
        "MlpLstmPolicy", DummyVecEnv([make] * 16), n_steps=80, batch_size=320, n_epochs=5, device="cpu",
        policy_kwargs={"lstm_hidden_size": 64, "net_arch": [64]},
    )  # fmt: skip
    start = time.perf_counter()
    agent.learn(steps)
    return agent.num_timesteps / (time.perf_counter() - start)


def act_step(batches: int) -> tuple[float, float]:
    """Seconds a training step of stock ACT spends on reading its batch and on computing."""
    from lerobot.configs.types import FeatureType
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors
    from lerobot.utils.feature_utils import dataset_to_policy_features

    from lerobot_spacedock.dataset.demos import DemosConfig, demos

    scratch = Path(tempfile.mkdtemp())
    try:
        config = DemosConfig(
            repo_id="spacedock/bench", root=str(scratch / "set"), num_episodes=4, num_candidates=4, expert="W",
            camera=CameraConfig(height=96, width=128), storage=Storage(kind="image"),
        )  # fmt: skip
        with contextlib.redirect_stdout(sys.stderr):  # stdout is the table's
            demos(config)
        chunk = 5
        dataset = LeRobotDataset(
            config.repo_id, config.root, delta_timestamps={"action": [i / 1 for i in range(chunk)]}
        )
        features = dataset_to_policy_features(dataset.meta.features)
        outputs = {name: f for name, f in features.items() if f.type is FeatureType.ACTION}
        policy_config = ACTConfig(
            input_features={name: f for name, f in features.items() if name not in outputs}, output_features=outputs,
            chunk_size=chunk, n_action_steps=1, temporal_ensemble_coeff=0.01, dim_model=128, n_heads=4,
            dim_feedforward=512, n_encoder_layers=2, use_vae=False, dropout=0.0, device="cpu",
            pretrained_backbone_weights=None,
        )  # fmt: skip
        policy = ACTPolicy(policy_config).train()
        preprocess, _ = make_pre_post_processors(policy_config, dataset_stats=dataset.meta.stats)
        optimizer = torch.optim.AdamW(policy.parameters(), 3e-4)
        loader = torch.utils.data.DataLoader(dataset, batch_size=16, shuffle=True)
        reading = computing = 0.0
        batch_iterator, done = iter(loader), 0
        while done <= batches:
            start = time.perf_counter()
            batch = next(batch_iterator, None)
            if batch is None:
                batch_iterator = iter(loader)
                continue
            middle = time.perf_counter()
            loss, _ = policy(preprocess(batch))
            loss.backward()
            optimizer.step()
            optimizer.zero_grad()
            if done:  # the first warms up
                reading += middle - start
                computing += time.perf_counter() - middle
            done += 1
        return reading / batches, computing / batches
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def rows(quick: bool = False) -> Iterator[Row]:
    """Both comparisons."""
    torch.set_num_threads(1)
    ours = expert_rate(1 if quick else 3)
    try:
        peer = sb3_rate(1280 if quick else 3840)
        yield Row(
            "expert training (recurrent PPO, simulator and updates)", ours, "steps/s", "sb3-contrib RecurrentPPO", peer
        )
    except ImportError:
        yield Row("expert training (recurrent PPO)", ours, "steps/s", "sb3-contrib is not installed")
    reading, computing = act_step(3 if quick else 12)
    yield Row("ACT step, 96 × 128, batch 16: reading the batch", reading, "s", "computing", computing)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    print(f"lerobot_spacedock {lerobot_spacedock.__version__}")
    show(rows(parser.parse_args().quick))
