"""The actor as plain torch: normalise, LSTM (or nothing), MLP. No rsl-rl: flying needs only this file's module."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.features import FEATURE_DIM
from lerobot_spacedock.physics.frames import ACTION_DIM

ARCHITECTURE = "spacedock_meta_rl"
ARCHITECTURE_VERSION = 1
_NORMALIZER_FLOOR = 1e-2  # as in rsl_rl's EmpiricalNormalization

Memory = tuple[Tensor, Tensor] | None


@dataclass(frozen=True)
class NetworkConfig:
    """Shape of the actor and units of its output.

    Attributes:
        lstm_size: hidden units of the LSTM; 0 leaves it out (the feed-forward ablation).
        hidden_sizes: of the MLP behind it.
        thrust_scale_N: thrust of an output of 1.
        torque_scale_Nm: torque of an output of 1.
        thrust_limit_N: the policy's own limit of each thrust component.
        torque_limit_Nm: the same for torque.
    """

    lstm_size: int = 64
    hidden_sizes: tuple[int, ...] = (64,)
    thrust_scale_N: float = 40.0
    torque_scale_Nm: float = 1.5
    thrust_limit_N: float = 40.0
    torque_limit_Nm: float = 20.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "hidden_sizes", tuple(self.hidden_sizes))
        if self.lstm_size < 0:
            raise InputError("network.lstm_size", self.lstm_size, "an integer ≥ 0; 0 is feed-forward")
        if not self.hidden_sizes or min(self.hidden_sizes) < 1:
            raise InputError("network.hidden_sizes", self.hidden_sizes, "at least one positive size")
        for name in ("thrust_scale_N", "torque_scale_Nm", "thrust_limit_N", "torque_limit_Nm"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"network.{name}", getattr(self, name), "a positive number")

    def to_json(self) -> dict[str, Any]:
        """As stored in a checkpoint's JSON."""
        return asdict(self)

    @property
    def action_scale(self) -> Tensor:
        """(6,) N and N·m per unit of output."""
        return torch.tensor([self.thrust_scale_N] * 3 + [self.torque_scale_Nm] * 3)

    @property
    def action_limits(self) -> Tensor:
        """(6,) N and N·m."""
        return torch.tensor([self.thrust_limit_N] * 3 + [self.torque_limit_Nm] * 3)


class ActorNetwork(nn.Module):
    """Features → mean action in scaled units, with the memory carried by the caller.

    Args:
        config: shape and scales.
    """

    def __init__(self, config: NetworkConfig | None = None) -> None:
        super().__init__()
        self.config = config or NetworkConfig()
        self.register_buffer("mean", torch.zeros(FEATURE_DIM))
        self.register_buffer("std", torch.ones(FEATURE_DIM))
        self.register_buffer("log_std", torch.zeros(ACTION_DIM))
        size = FEATURE_DIM
        self.lstm = nn.LSTM(size, self.config.lstm_size) if self.config.lstm_size else None
        size = self.config.lstm_size or size
        layers: list[nn.Module] = []
        for hidden in self.config.hidden_sizes:
            layers += [nn.Linear(size, hidden), nn.ELU()]
            size = hidden
        self.head = nn.Sequential(*layers, nn.Linear(size, ACTION_DIM))

    def forward(self, features: Tensor, memory: Memory = None) -> tuple[Tensor, Memory]:
        """(N, FEATURE_DIM) and the memory of the last step (None: an episode begins) → (N, 6), memory."""
        x = (features - self.mean) / (self.std + _NORMALIZER_FLOOR)
        if self.lstm is not None:
            out, memory = self.lstm(x.unsqueeze(0), memory)
            x = out.squeeze(0)
        return self.head(x), memory

    def load_rsl_rl(self, actor_state: dict[str, Tensor]) -> None:
        """Copies the weights of an rsl_rl ``RNNModel`` or ``MLPModel`` of the same shape."""
        renamed = {"mean": actor_state["obs_normalizer._mean"][0], "std": actor_state["obs_normalizer._std"][0]}
        renamed["log_std"] = actor_state["distribution.log_std_param"]
        for name, value in actor_state.items():
            if name.startswith("rnn.rnn."):
                renamed["lstm." + name.removeprefix("rnn.rnn.")] = value
            elif name.startswith("mlp."):
                renamed["head." + name.removeprefix("mlp.")] = value
        self.load_state_dict(renamed)
