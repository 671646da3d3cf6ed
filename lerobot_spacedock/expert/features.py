"""What the recurrent expert sees: 13 observed values and its own last action, as 21 well-scaled features.

No clock and nothing hidden: whatever the policy knows of mass, thrusters and sensors it has to infer. Position is
given twice, plain and through tanh, so that a centimetre near the port is not lost beside 25 m.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from lerobot_spacedock.physics.frames import ACTION_DIM

FEATURE_DIM = 15 + ACTION_DIM
VELOCITY_GAIN = 5.0  # per m/s
ATTITUDE_GAIN = 20.0  # on the vector part of the error quaternion: 0.17 per degree
RATE_GAIN = 50.0  # per rad/s: 0.87 per deg/s
_DEG_TO_RAD = math.pi / 180.0


def actor_features(observation: Tensor, last_action: Tensor, nominal_attitude: Tensor) -> Tensor:
    """Features of the actor.

    Args:
        observation: (N, 13), ``observation.state``: m, m/s, quaternion, deg/s.
        last_action: (N, 6), the network's own last output (scaled units), zero at the first step.
        nominal_attitude: (4,), scalar first, the attitude in which the chaser docks.

    Returns:
        (N, FEATURE_DIM).
    """
    position, velocity = observation[:, 0:3], observation[:, 3:6]
    error = attitude_error(observation[:, 6:10], nominal_attitude)
    rate = observation[:, 10:13] * _DEG_TO_RAD
    return torch.cat(
        [
            position,
            torch.tanh(position),
            VELOCITY_GAIN * velocity,
            ATTITUDE_GAIN * error,
            RATE_GAIN * rate,
            last_action,
        ],
        dim=1,
    )


def attitude_error(attitude: Tensor, nominal: Tensor) -> Tensor:
    """Vector part of ``nominal* ⊗ attitude`` on the shorter way round, body axes. (N, 4), (4,) → (N, 3)."""
    a0, a = attitude[:, :1], attitude[:, 1:]
    b0, b = nominal[0], -nominal[1:].expand_as(a)
    scalar = b0 * a0 - (b * a).sum(dim=1, keepdim=True)
    vector = b0 * a + a0 * b + torch.linalg.cross(b, a)
    return torch.where(scalar < 0.0, -vector, vector)
