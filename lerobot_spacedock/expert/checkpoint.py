"""A trained actor on disk: ``NAME.safetensors`` with ``NAME.json`` beside it. Nothing is ever unpickled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save

from lerobot_spacedock import __version__
from lerobot_spacedock.errors import FileFormatError
from lerobot_spacedock.expert.features import FEATURE_DIM
from lerobot_spacedock.expert.network import ARCHITECTURE, ARCHITECTURE_VERSION, ActorNetwork, NetworkConfig
from lerobot_spacedock.files import aside, read_object, write_json
from lerobot_spacedock.physics.frames import ACTION_DIM

_FOLDER = Path(__file__).parent / "checkpoints"
SHIPPED = _FOLDER / "meta_rl.safetensors"  # reaches the port in the paper's 65 steps
GENTLE = "gentle"  # some nine steps slower, for docking without a deadline
HOLD = "hold"  # stops at the port within those steps, whatever the start; it does not dock
NAMED = (GENTLE, HOLD)  # the others that ship, by name


def find_checkpoint(given: str | Path | None = None) -> Path:
    """The ``.safetensors`` file of a checkpoint: None is the shipped one, a name in ``NAMED`` another that ships, else
    a file or a folder with a ``policy.safetensors``; it need not exist."""
    if given is None:
        return SHIPPED
    if str(given) in NAMED:
        return _FOLDER / f"{given}.safetensors"
    path = Path(given).expanduser()
    return path / "policy.safetensors" if path.is_dir() else path


def existing_checkpoint(given: str | Path | None = None) -> Path:
    """As ``find_checkpoint``.

    Raises:
        FileFormatError: it is not there.
    """
    path = find_checkpoint(given)
    if not path.is_file():
        raise FileFormatError(
            f"{path}: no such expert checkpoint; make one with spacedock train-expert, or leave it out or name "
            f"{' or '.join(NAMED)} for those that ship"
        )
    return path


def save_actor(path: Path, network: ActorNetwork, training: dict[str, Any]) -> None:
    """Writes weights and description, each aside and renamed.

    Args:
        path: ends in ``.safetensors``; the JSON gets the same stem.
        network: the actor.
        training: how it came about (config, interactions, …), JSON-ready.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    description = {
        "architecture": ARCHITECTURE,
        "architecture_version": ARCHITECTURE_VERSION,
        "spacedock_version": __version__,
        "feature_dim": FEATURE_DIM,
        "action_dim": ACTION_DIM,
        "network": network.config.to_json(),
        "training": training,
    }
    with aside(path) as own:
        own.write_bytes(save({k: v.detach().cpu().contiguous() for k, v in network.state_dict().items()}))
    write_json(path.with_suffix(".json"), description, indent=2, sort_keys=True)


def load_actor(checkpoint: str | Path | None = None) -> tuple[ActorNetwork, dict[str, Any]]:
    """The actor and its description, of what ``find_checkpoint`` finds.

    Raises:
        FileFormatError: no such file, another architecture or version, another action size, or shapes that differ.
    """
    path = existing_checkpoint(checkpoint)
    description = read_object(path.with_suffix(".json"))
    for name, wanted in (
        ("architecture", ARCHITECTURE),
        ("architecture_version", ARCHITECTURE_VERSION),
        ("feature_dim", FEATURE_DIM),
        ("action_dim", ACTION_DIM),
    ):
        if description.get(name) != wanted:
            raise FileFormatError(
                f"{path.with_suffix('.json')}: {name} is {description.get(name)!r}, this version flies {wanted!r}; "
                "train the expert again, or install the package version that wrote it "
                f"({description.get('spacedock_version', 'unknown')})"
            )
    try:
        network = ActorNetwork(NetworkConfig(**description["network"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path.with_suffix('.json')}: unusable 'network': {error}") from error
    try:
        network.load_state_dict(load_file(path))
    except SafetensorError as error:
        raise FileFormatError(f"{path}: not a safetensors file ({error})") from error
    except RuntimeError as error:
        raise FileFormatError(f"{path}: weights do not fit {path.with_suffix('.json')}: {error}") from error
    if not all(torch.isfinite(value).all() for value in network.state_dict().values()):
        raise FileFormatError(f"{path}: weights that are not finite")
    return network.eval(), description


def training_counts(expert: str, checkpoint: str | Path | None = None) -> dict[str, int] | None:
    """Episodes and interactions that an expert of that name was trained with; None where its file does not say.

    Args:
        expert: one of ``controllers.EXPERTS``, all of which but the meta-RL ones need no training; or one of your own,
            of which nothing is known.
        checkpoint: of the meta-RL expert, as ``find_checkpoint`` takes it.
    """
    if ":" in expert:
        return None
    if not expert.startswith("meta_rl"):
        return {"episodes": 0, "interactions": 0}
    try:
        training = read_object(find_checkpoint(checkpoint).with_suffix(".json")).get("training")
    except FileFormatError:
        return None
    counts = {name: training.get(name) for name in ("episodes", "interactions")} if isinstance(training, dict) else {}
    return counts if counts and all(isinstance(count, int) for count in counts.values()) else None
