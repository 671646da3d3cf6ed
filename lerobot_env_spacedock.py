"""What LeRobot's plugin discovery imports: registers ``--env.type=spacedock`` and the SpaceDock policy types."""

import lerobot_spacedock
import lerobot_spacedock.adapters

__version__ = lerobot_spacedock.__version__
