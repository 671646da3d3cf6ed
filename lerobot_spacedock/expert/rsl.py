"""What training takes from rsl-rl, in one place: flying a trained expert needs none of it."""

from lerobot_spacedock.errors import MissingDependencyError

try:
    from rsl_rl.algorithms import PPO
    from rsl_rl.models import MLPModel, RNNModel
    from rsl_rl.storage import RolloutStorage
    from tensordict import TensorDict
except ImportError as error:
    message = "spacedock train-expert needs rsl-rl: pip install '.[expert]' in SpaceDock's folder."
    raise MissingDependencyError(message) from error

__all__ = ["PPO", "MLPModel", "RNNModel", "RolloutStorage", "TensorDict"]
