"""LeRobot plugin: importing this registers ``--env.type=spacedock`` and the ``spacedock_*`` policy types."""

from lerobot_spacedock.adapters.env_config import SpaceDockEnvConfig

__all__ = ["SpaceDockEnvConfig"]
