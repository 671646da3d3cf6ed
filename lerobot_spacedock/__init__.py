"""SpaceDock: spacecraft docking with the International Space Station, as a LeRobot plugin.

Importing this registers the gymnasium ids and loads nothing heavy (no numba, GL, matplotlib or rsl-rl).
"""

from lerobot_spacedock.env.registration import register_envs

__version__ = "0.1.0"

register_envs()
