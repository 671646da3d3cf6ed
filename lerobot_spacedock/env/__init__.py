"""The environments. Importing this registers their gymnasium ids and loads no numba and no renderer."""

from lerobot_spacedock.env.registration import ENV_IDS, register_envs

__all__ = ["ENV_IDS", "register_envs"]
