"""Stock ACT trained from states alone, fast enough to map the space of settings on one core.

Policy, processors, sampler, optimiser, schedule and the update itself are LeRobot's own. Only the data loader is not:
``lerobot-train`` reads and collates frame by frame, which takes five times as long as the update of so small a network;
here the frames lie in memory, normalised once. The weights are those of ``lerobot-train`` (a test compares them).

ACT refuses a state without a picture or an ``observation.environment_state``, so the observed values (13, or 6 where
the pose is withheld) go in under both names.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from lerobot.configs import FeatureType, NormalizationMode, PolicyFeature
from lerobot.datasets.sampler import EpisodeAwareSampler
from lerobot.optim import AdamWConfig
from lerobot.optim.schedulers import CosineAnnealingWithWarmupSchedulerConfig
from lerobot.policies import make_pre_post_processors
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_STATE
from lerobot.utils.random_utils import set_seed

from lerobot_spacedock.physics.frames import ACTION_DIM, OBSERVATION_NAMES
from lerobot_spacedock.study.demonstrations import Frames


@dataclass(frozen=True)
class StudentConfig:
    """Options of ACT and of its training; names and meaning are LeRobot's."""

    chunk_size: int = 5
    dim_model: int = 96
    n_heads: int = 4
    dim_feedforward: int = 256
    n_encoder_layers: int = 1
    use_vae: bool = False
    kl_weight: float = 10.0
    dropout: float = 0.0
    steps: int = 2000
    batch_size: int = 64
    lr: float = 5e-4
    weight_decay: float = 1e-4
    grad_clip_norm: float = 10.0
    num_warmup_steps: int = 100
    seed: int = 0

    def policy(self, size: int = len(OBSERVATION_NAMES)) -> ACTConfig:
        """ACT's own configuration, for a state of ``size`` values given as the environment's."""
        return ACTConfig(
            input_features={
                OBS_STATE: PolicyFeature(FeatureType.STATE, (size,)),
                OBS_ENV_STATE: PolicyFeature(FeatureType.ENV, (size,)),
            },
            output_features={ACTION: PolicyFeature(FeatureType.ACTION, (ACTION_DIM,))},
            normalization_mapping=dict.fromkeys(("STATE", "ENV", "ACTION"), NormalizationMode.MEAN_STD),
            device="cpu",
            push_to_hub=False,
            pretrained_backbone_weights=None,
            n_action_steps=1,
            **{
                name: getattr(self, name)
                for name in (
                    "chunk_size",
                    "dim_model",
                    "n_heads",
                    "dim_feedforward",
                    "n_encoder_layers",
                    "use_vae",
                    "kl_weight",
                    "dropout",
                )
            },
        )


@dataclass(frozen=True)
class Student:
    """A trained policy with its processors."""

    policy: ACTPolicy
    preprocessor: Any
    postprocessor: Any
    final_loss: float


def train(config: StudentConfig, frames: Frames) -> Student:
    """Trains stock ACT on the frames; the same seed gives the weights that ``lerobot-train`` gives."""
    set_seed(config.seed)
    policy = ACTPolicy(config.policy(frames.state.shape[1]))
    preprocessor, postprocessor = make_pre_post_processors(policy.config, dataset_stats=frames.stats)
    optimizer = AdamWConfig(lr=config.lr, weight_decay=config.weight_decay).build(policy.parameters())
    schedule = CosineAnnealingWithWarmupSchedulerConfig(num_warmup_steps=config.num_warmup_steps)
    scheduler = schedule.build(optimizer, config.steps)
    batch = preprocessor(frames.chunks(config.chunk_size))
    data = {key: batch[key] for key in (OBS_STATE, OBS_ENV_STATE, ACTION, f"{ACTION}_is_pad")}
    sampler = EpisodeAwareSampler(frames.starts, frames.ends, shuffle=True, seed=config.seed)
    policy.train()
    losses = []
    for _, index in zip(range(config.steps), _batches(sampler, config.batch_size), strict=False):
        loss, _ = policy.forward({key: values[index] for key, values in data.items()})
        loss.backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), config.grad_clip_norm)
        optimizer.step()
        optimizer.zero_grad()
        scheduler.step()
        losses.append(loss.detach())
    return Student(policy, preprocessor, postprocessor, float(torch.stack(losses[-100:]).mean()))


def _batches(sampler: EpisodeAwareSampler, size: int) -> Iterator[torch.Tensor]:
    """Indices of one batch after another, epoch after epoch, as LeRobot's loader draws them."""
    while True:
        epoch = torch.tensor(list(sampler))
        yield from epoch.split(size)
