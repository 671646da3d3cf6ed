"""The experts of ``lerobot_spacedock/expert`` as LeRobot policies: same evaluation, same seeds, same logs as ACT."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import OBS_STATE
from torch import Tensor

from lerobot_spacedock.adapters.policies.configuration_spacedock import (
    ClassicalConfig,
    DeadlineConfig,
    ExpertConfig,
    SpaceDockFeedbackConfig,
    SpaceDockMetaRlConfig,
    SpaceDockMpcConfig,
    SpaceDockZemConfig,
)
from lerobot_spacedock.adapters.policies.processor_spacedock import make_expert_processors
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.expert.deadline import Deadline
from lerobot_spacedock.expert.policy import Policy
from lerobot_spacedock.physics.contact import get_port
from lerobot_spacedock.physics.frames import MASS, STATE_DIM


class ExpertPolicy(PreTrainedPolicy):
    """An expert behind LeRobot's interface: one command a call, for a whole batch."""

    # LeRobot wants both on every subclass; the concrete types name their own
    config_class = ExpertConfig
    name = "spacedock_expert"

    def __init__(self, config: ExpertConfig, **_: Any) -> None:
        super().__init__(config)
        config.validate_features()
        self._expert: Policy | None = None
        # a checkpoint always holds at least this, also where a controller has no weights
        self.register_buffer("format_version", torch.tensor([1]))

    def make_expert(self, device: torch.device) -> Policy:
        """A fresh expert for tensors on ``device``."""
        raise NotImplementedError

    def reset(self) -> None:
        """Forgets everything; the next ``select_action`` is the first of new episodes."""
        self._expert = None

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor], **_: Any) -> Tensor:
        """(N, 13 or 14) ``observation.state`` → (N, 6) N and N·m, body axes, on the device of the state."""
        if OBS_STATE not in batch:
            raise InputError(OBS_STATE, "none", "the state, 13 or 14 values", "Add --env.obs_type=agent_pos.")
        state = batch[OBS_STATE]
        if state.shape[-1] == STATE_DIM:
            state = torch.cat([state[..., :MASS], state[..., MASS + 1 :]], dim=-1)
        if self._expert is None:
            self._expert = self.make_expert(state.device)
            self._expert.reset(len(state))
        action = self._expert.act(state.detach().cpu().numpy())
        return torch.as_tensor(np.asarray(action), dtype=torch.float32, device=state.device)

    def predict_action_chunk(self, batch: dict[str, Tensor], **_: Any) -> Tensor:
        """A chunk of one command, (N, 1, 6)."""
        return self.select_action(batch).unsqueeze(1)

    def forward(self, batch: dict[str, Tensor]) -> tuple[Tensor, dict | None]:
        raise SpaceDockError(_UNTRAINABLE.format(name=self.name))

    def get_optim_params(self) -> dict:
        raise SpaceDockError(_UNTRAINABLE.format(name=self.name))

    def _save_pretrained(self, save_directory: Path, state_dict: dict[str, Tensor] | None = None) -> None:
        """Config and weights, and the processors with them: there is nothing in those that training would add."""
        super()._save_pretrained(save_directory, state_dict=state_dict)
        for pipeline in make_expert_processors(self.config):
            pipeline.save_pretrained(save_directory)

    @classmethod
    def from_pretrained(cls, pretrained_name_or_path: str | Path, **options: Any) -> ExpertPolicy:
        """As LeRobot's, but a weight that is missing or does not fit is an error."""
        return super().from_pretrained(pretrained_name_or_path, **(options | {"strict": True}))


class SpaceDockMetaRlPolicy(ExpertPolicy):
    """The recurrent meta-RL policy; its memory lasts from one ``reset`` to the next."""

    config_class = SpaceDockMetaRlConfig
    name = "spacedock_meta_rl"

    def __init__(self, config: SpaceDockMetaRlConfig, **options: Any) -> None:
        from lerobot_spacedock.expert.checkpoint import load_actor
        from lerobot_spacedock.expert.network import ActorNetwork, NetworkConfig

        super().__init__(config, **options)
        if config.network_options:
            if config.checkpoint is not None:
                raise InputError(
                    "--policy.checkpoint", config.checkpoint, "nothing together with --policy.path or a network shape"
                )
            self.network = ActorNetwork(NetworkConfig(**config.network_options))
            self._has_weights = False
        else:
            self.network, description = load_actor(config.checkpoint)
            logging.info("meta-RL actor of %s", description.get("spacedock_version"))
            for name, value in self.network.config.to_json().items():
                setattr(config, name, tuple(value) if isinstance(value, list) else value)
            config.checkpoint = None
            self._has_weights = True
        self._batches = 0  # of episodes that were begun: each samples actions of its own

    def make_expert(self, device: torch.device) -> Policy:
        from lerobot_spacedock.expert.meta_rl import MetaRlPolicy

        if not self._has_weights:
            raise InputError(
                "--policy.type=spacedock_meta_rl",
                self.config.network_options,
                "a trained network: --policy.path, --policy.checkpoint, or neither for the one that ships",
            )
        self._batches += 1
        return MetaRlPolicy(
            self.network,
            port=get_port(self.config.port),
            device=device,
            stochastic=self.config.stochastic,
            seed=self._batches - 1,
            forgetful=self.config.forgetful,
        )

    @classmethod
    def _load_as_safetensor(cls, model: SpaceDockMetaRlPolicy, *arguments: Any) -> SpaceDockMetaRlPolicy:
        model = super()._load_as_safetensor(model, *arguments)
        model._has_weights = True
        return model


class ClassicalExpertPolicy(ExpertPolicy):
    """A controller, with an estimate of the thrust that acts in front of it or without."""

    def make_law(self) -> Policy:
        """A fresh controller."""
        raise NotImplementedError

    def make_expert(self, device: torch.device) -> Policy:
        from lerobot_spacedock.expert.adaptive import AdaptiveThrust

        law = self.make_law()
        return AdaptiveThrust(law, step_s=self.config.step_s) if self.config.adaptive else law


class SpaceDockMpcPolicy(ClassicalExpertPolicy):
    """Minimum-energy MPC."""

    config_class = SpaceDockMpcConfig
    name = "spacedock_mpc"

    def make_law(self) -> Policy:
        from lerobot_spacedock.expert.mpc import MpcPolicy

        return MpcPolicy(_deadline(self.config), mode=self.config.mode, **_classical(self.config))


class SpaceDockZemPolicy(ClassicalExpertPolicy):
    """ZEM/ZEV guidance."""

    config_class = SpaceDockZemConfig
    name = "spacedock_zem"

    def make_law(self) -> Policy:
        from lerobot_spacedock.expert.zem import ZemZevPolicy

        return ZemZevPolicy(_deadline(self.config), **_classical(self.config))


class SpaceDockFeedbackPolicy(ClassicalExpertPolicy):
    """The time-invariant feedback law."""

    config_class = SpaceDockFeedbackConfig
    name = "spacedock_feedback"

    def make_law(self) -> Policy:
        from lerobot_spacedock.expert.feedback import FeedbackPolicy

        return FeedbackPolicy(self.config.law, **_classical(self.config))


_UNTRAINABLE = (
    "--policy.type={name}: lerobot-train has nothing to train in it. The meta-RL expert is trained with "
    "spacedock train-expert; the controllers need no training."
)


def _deadline(config: DeadlineConfig) -> Deadline:
    return Deadline(config.deadline_steps, config.deadline_step_s, config.closing_speed_m_s)


def _classical(config: ClassicalConfig) -> dict[str, Any]:
    return {"port": get_port(config.port), "hill_coupling": config.hill_coupling}
