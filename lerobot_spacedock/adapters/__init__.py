"""LeRobot plugin: importing this registers ``--env.type=spacedock`` and the ``spacedock_*`` policy types."""

from lerobot_spacedock.adapters.env_config import SpaceDockEnvConfig
from lerobot_spacedock.adapters.policies.configuration_spacedock import (
    SpaceDockFeedbackConfig,
    SpaceDockMetaRlConfig,
    SpaceDockMpcConfig,
    SpaceDockZemConfig,
)

__all__ = [
    "SpaceDockEnvConfig",
    "SpaceDockFeedbackConfig",
    "SpaceDockMetaRlConfig",
    "SpaceDockMpcConfig",
    "SpaceDockZemConfig",
]
