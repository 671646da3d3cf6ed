"""The commands that go on from a dataset, as its card and the verbs that made or checked it show them."""

from __future__ import annotations

import shlex
from pathlib import Path

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.env_flags import dataset_env_flags
from lerobot_spacedock.dataset.reader import DatasetReader

POLICY = "outputs/act"
# what train_command leaves to LeRobot, and how to do with less
TRAINING_HINT = (
    "(That is ACT as large as LeRobot has it, for 100,000 steps, on a GPU; for a CPU: "
    "--config_path=configs/act_cpu.yaml. Without network add --policy.pretrained_backbone_weights=null.)"
)


def train_command(reader: DatasetReader, repo_id: str, root: Path | None = None) -> list[str]:
    """The lines that train stock ACT so that it docks; of a dataset without pictures, those that draw them first.

    ACT refuses a state alone. Training is told the environment, which the policy's card then knows, unless the camera
    has a name of its own: LeRobot renames nothing in a training from scratch.

    Args:
        reader: of the dataset.
        repo_id: user/name.
        root: its folder; left out, the hub has it.
    """
    if not reader.cameras:
        source = "FOLDER" if root is None else shlex.quote(str(root))
        return [
            f"spacedock convert --format=lerobot --source={source}",
            f"--repo_id={repo_id}_pictures --root=outputs/{repo_id.rpartition('/')[2]}_pictures",
        ]
    at = "" if root is None else f" {shlex.quote(f'--dataset.root={root}')}"
    return [
        f"lerobot-train --dataset.repo_id={repo_id}{at} --dataset.video_backend=pyav",
        f"--policy.type=act --policy.push_to_hub=false --output_dir={POLICY}",
        "--policy.chunk_size=5 --policy.n_action_steps=1 --policy.temporal_ensemble_coeff=0.01",
        *(dataset_env_flags(reader) if schema.IMAGE in reader.cameras else []),
    ]


def evaluate_command(reader: DatasetReader) -> list[str]:
    """The lines that fly what ``train_command`` trains."""
    policy = f"--policy.path={POLICY}/checkpoints/last/pretrained_model"
    return [f"lerobot-eval {policy} --output_dir={POLICY}_eval", *dataset_env_flags(reader)]
