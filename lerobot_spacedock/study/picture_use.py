"""``python -m lerobot_spacedock.study.picture_use``: does a policy's command depend on its picture?

The commands for the frames of a dataset, once as they are, once with the picture of another frame, once with none (the
dataset's mean colour): how far the first command of each chunk moves, beside how far it is from the label. Open loop.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.datasets import LeRobotDataset
from lerobot.policies import make_pre_post_processors
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE

from lerobot_spacedock.dataset.roots import existing_root
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.files import read_object
from lerobot_spacedock.folders import check_output

CAMERA = f"{OBS_IMAGES}.camera"


def changes(
    commands: np.ndarray, shuffled: np.ndarray, blank: np.ndarray, label: np.ndarray
) -> dict[str, dict[str, float]]:
    """Mean norms over frames, thrust in N and torque in N·m. All (F, 6)."""
    found = {}
    for name, other in (("shuffled", shuffled), ("blank", blank), ("label", label)):
        difference = other - commands
        found[name] = {
            "thrust_N": float(np.linalg.norm(difference[:, :3], axis=1).mean()),
            "torque_Nm": float(np.linalg.norm(difference[:, 3:], axis=1).mean()),
        }
    return found


def load_policy(checkpoint: Path) -> tuple[ACTPolicy, Any, Any]:
    """A stock ACT checkpoint with its processors.

    Raises:
        InputError: there is none (LeRobot would ask the hub for one of that name), or one that sees no picture.
    """
    if not (checkpoint / "config.json").is_file():
        raise InputError("--checkpoint", str(checkpoint), "the pretrained_model folder of an ACT (with config.json)")
    config = read_object(checkpoint / "config.json")
    seen = config.get("input_features") or {}
    if config.get("type") != "act" or CAMERA not in seen:
        given = f"{checkpoint}: {config.get('type')} of {', '.join(seen) or 'nothing'}"
        raise InputError("--checkpoint", given, f"an ACT that sees {CAMERA}")
    policy = ACTPolicy.from_pretrained(checkpoint).eval()
    return policy, *make_pre_post_processors(policy.config, pretrained_path=str(checkpoint))


def load_pictures(
    dataset_root: Path, num_frames: int, seed: int = 0
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Frames drawn from a dataset: pictures (F, 3, H, W) in [0, 1], states (F, n) as stored, actions (F, 6).

    Raises:
        InputError: there is none, or none with pictures.
    """
    dataset_root = existing_root("spacedock/pictures", str(dataset_root))
    dataset = LeRobotDataset("spacedock/pictures", root=dataset_root, video_backend="pyav")
    if CAMERA not in dataset.features:
        raise InputError("--root", str(dataset_root), f"a dataset with pictures, {CAMERA}")
    index = np.random.default_rng(seed).choice(len(dataset), size=min(num_frames, len(dataset)), replace=False)
    items = [dataset[int(i)] for i in index]
    pictures, states, actions = (torch.stack([item[name] for item in items]) for name in (CAMERA, OBS_STATE, ACTION))
    return pictures.float() / 255.0 if pictures.dtype == torch.uint8 else pictures, states, actions


def picture_use(checkpoint: Path, dataset_root: Path, *, num_frames: int = 256, seed: int = 0) -> dict[str, Any]:
    """Loads a stock ACT checkpoint and gives ``changes`` over frames drawn from a dataset with pictures.

    Raises:
        InputError: no checkpoint or no dataset there, or fewer than two frames: each is shown with another's picture.
    """
    if num_frames < 2:
        raise InputError("--frames", num_frames, "2 or more")
    policy, before, after = load_policy(checkpoint)
    pictures, states, labels = load_pictures(dataset_root, num_frames, seed)
    mean = pictures.mean(dim=(0, 2, 3), keepdim=True)

    @torch.no_grad()
    def commands(seen: torch.Tensor) -> np.ndarray:
        parts = []
        for some in torch.arange(len(states)).split(32):
            chunk = policy.predict_action_chunk(before({CAMERA: seen[some], OBS_STATE: states[some]}))
            parts.append(after(chunk[:, 0]).numpy())
        return np.concatenate(parts)

    other = torch.from_numpy(np.roll(np.arange(len(states)), 1))  # the frames are in random order already
    return {
        "frames": len(states),
        **changes(
            commands(pictures),
            commands(pictures[other]),
            commands(mean.expand_as(pictures)),
            labels.numpy(),
        ),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m lerobot_spacedock.study.picture_use", description=__doc__)
    parser.add_argument("--checkpoint", type=Path, required=True, help="CHECKPOINT/pretrained_model of an ACT")
    parser.add_argument("--root", type=Path, required=True, help="a LeRobotDataset with pictures of its size")
    parser.add_argument("--frames", type=int, default=256, help="how many to draw from it; default: 256")
    parser.add_argument("--out", type=Path, help="write the JSON here too")
    arguments = parser.parse_args(argv)
    try:
        if arguments.out:
            check_output(arguments.out, "--out")
        found = picture_use(arguments.checkpoint, arguments.root, num_frames=arguments.frames)
    except SpaceDockError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    text = json.dumps(found, indent=2)
    print(text)
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
