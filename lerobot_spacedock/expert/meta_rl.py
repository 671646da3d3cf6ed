"""The recurrent expert in flight: features from the observation, memory across steps, wrench out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from lerobot_spacedock.expert.checkpoint import load_actor
from lerobot_spacedock.expert.features import actor_features
from lerobot_spacedock.expert.network import ActorNetwork, Memory
from lerobot_spacedock.expert.policy import action_signs, check_observation, observation_signs
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, Port
from lerobot_spacedock.physics.frames import ACTION_DIM


class MetaRlPolicy:
    """A trained actor as a batched policy.

    Args:
        network: the actor; ``MetaRlPolicy.load()`` takes the shipped one.
        port: where to dock; trained at Zvezda, flown at Harmony by the exact symmetry of ``policy.py``.
        device: of the network.
        stochastic: sample actions with the spread that the checkpoint holds, instead of flying the mean; the ceiling
            that training put on it (``set_std_ceiling``) is not in the checkpoint.
        seed: of the samples.
        forgetful: clears the memory before every step (the ablation that shows what the memory is worth).
    """

    def __init__(
        self,
        network: ActorNetwork,
        *,
        port: Port = ZVEZDA_AFT,
        device: str | torch.device = "cpu",
        stochastic: bool = False,
        seed: int = 0,
        forgetful: bool = False,
    ) -> None:
        self.network = network.to(device).eval()
        self.device = torch.device(device)
        self._observation_signs = self._tensor(observation_signs(port))
        self._action_signs = self._tensor(action_signs(port))
        self._nominal = self._tensor(ZVEZDA_AFT.q_nominal)
        self._scale = network.config.action_scale.to(self.device)
        self._limits = network.config.action_limits.to(self.device)
        self._stochastic, self._forgetful = stochastic, forgetful
        self._generator = torch.Generator(device=self.device).manual_seed(seed)
        self._memory: Memory = None
        self._last = torch.zeros(0, ACTION_DIM, device=self.device)

    @classmethod
    def load(cls, checkpoint: str | Path | None = None, **options: object) -> MetaRlPolicy:
        """The policy of a checkpoint; ``options`` as of the constructor."""
        return cls(load_actor(checkpoint)[0], **options)

    def reset(self, count: int) -> None:
        """Starts ``count`` episodes with an empty memory."""
        self._memory = None
        self._last = torch.zeros(count, ACTION_DIM, device=self.device)

    def act(self, observation: np.ndarray) -> np.ndarray:
        """(N, 13) ``observation.state`` → (N, 6) float64 N and N·m, body axes, within the limits."""
        checked = check_observation(observation, len(self._last))
        action = self.act_tensor(self._tensor(checked))
        return action.cpu().numpy().astype(np.float64)

    @torch.no_grad()
    def act_tensor(self, observation: Tensor) -> Tensor:
        """The same on tensors of this policy's device, float32, unchecked. (N, 13) → (N, 6)."""
        if self._forgetful:
            self._memory = None
        features = actor_features(observation * self._observation_signs, self._last, self._nominal)
        output, self._memory = self.network(features, self._memory)
        if self._stochastic:
            noise = torch.randn(output.shape, generator=self._generator, device=self.device)
            output = output + noise * self.network.log_std.exp()
        command = torch.clamp(output * self._scale, -self._limits, self._limits)
        self._last = command / self._scale
        return command * self._action_signs

    def _tensor(self, value: object) -> Tensor:
        return torch.as_tensor(np.asarray(value), dtype=torch.float32, device=self.device)
