"""Warm start: the actor first imitates demonstrations, whole sequences at a time; then PPO goes on from there."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from lerobot_spacedock.expert.demonstrations import find_dataset, load_demonstrations, port_of_dataset, teacher_counts
from lerobot_spacedock.expert.features import actor_features
from lerobot_spacedock.expert.policy import action_signs, observation_signs
from lerobot_spacedock.expert.rsl import PPO
from lerobot_spacedock.expert.train_config import TrainExpertConfig
from lerobot_spacedock.physics.contact import ZVEZDA_AFT

_SEQUENCES_PER_BATCH = 16


def imitate(config: TrainExpertConfig, algorithm: PPO) -> dict[str, Any]:
    """Fits the actor's mean to the commands of ``config.init_from``; returns what it cost, for the account.

    The command of the step before is a feature, as in flight; the loss is the squared error in units of output.
    """
    start = time.perf_counter()
    teacher = teacher_counts(find_dataset(config.init_from))
    actor, device = algorithm.actor, algorithm.device
    features, targets, mask = _sequences(config, device)
    actor.obs_normalizer.update(features[mask])
    optimizer = torch.optim.Adam(actor.parameters(), lr=1e-3)
    count = features.shape[1]
    batches = max(1, count // _SEQUENCES_PER_BATCH)
    steps = config.init_epochs * batches
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=3e-3, total_steps=steps)
    bar = tqdm(total=steps, desc="imitate", unit="update", dynamic_ncols=True)
    loss = torch.zeros(())
    with bar:
        for _ in range(config.init_epochs):
            for rows in torch.randperm(count, device=device).chunk(batches):
                output = _run(actor, features[:, rows])
                wrong = ((output - targets[:, rows]) ** 2).sum(dim=-1)
                loss = wrong[mask[:, rows]].mean()
                optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
                optimizer.step()
                schedule.step()
                bar.update()
            bar.set_postfix_str(f"loss {loss.item():.2e}")
    with torch.no_grad():
        actor.distribution.log_std_param.fill_(torch.log(torch.tensor(config.init_std)).item())
    actor.reset()
    return {
        "imitation_s": time.perf_counter() - start,
        "demonstration_frames": int(mask.sum()),
        "earlier_episodes": teacher["episodes"] + count,
        "earlier_interactions": teacher["interactions"] + int(mask.sum()),
    }


def _run(actor: torch.nn.Module, features: Tensor) -> Tensor:
    """The actor's mean over whole sequences from an empty memory. (T, N, F) → (T, N, 6)."""
    x = actor.obs_normalizer(features)
    if actor.is_recurrent:
        x, _ = actor.rnn.rnn(x)
    return actor.mlp(x)


def _sequences(config: TrainExpertConfig, device: str) -> tuple[Tensor, Tensor, Tensor]:
    """Features (T, N, F), targets (T, N, 6) in units of output, and which of them are frames (T, N).

    Demonstrations at another port are seen as at Zvezda's, where the network flies (``policy.py``).
    """
    folder = find_dataset(config.init_from)
    port = port_of_dataset(folder)
    turned, turned_back = observation_signs(port).astype(np.float32), action_signs(port).astype(np.float32)
    scale = torch.tensor([config.actor.thrust_scale_N] * 3 + [config.actor.torque_scale_Nm] * 3)
    nominal = torch.tensor(ZVEZDA_AFT.q_nominal, dtype=torch.float32)
    features, targets = [], []
    for observation, command in load_demonstrations(folder):
        target = torch.from_numpy(command * turned_back) / scale
        last = torch.cat([torch.zeros(1, target.shape[1]), target[:-1]])
        features.append(actor_features(torch.from_numpy(observation * turned), last, nominal))
        targets.append(target)
    lengths = torch.tensor([len(target) for target in targets])
    pad = torch.nn.utils.rnn.pad_sequence
    mask = torch.arange(int(lengths.max()))[:, None] < lengths
    return pad(features).to(device), pad(targets).to(device), mask.to(device)


def freeze_actor(algorithm: PPO, frozen: bool) -> None:
    """While frozen, updates teach the critic alone: one that knows nothing would pull a good actor apart.

    The scaling of the actor's inputs stays that of the demonstrations, later too: the weights were fitted behind it,
    and moved it would make another policy of them in one update (100 % docked became 0 %).
    """
    algorithm.actor.obs_normalizer.until = 0
    for parameter in algorithm.actor.parameters():
        parameter.requires_grad_(not frozen)
