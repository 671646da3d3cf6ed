"""The means of an evaluation inside ``lerobot-train`` as scalars: TensorBoard, and the wandb run where one is on.

LeRobot logs reward and success of such an evaluation; what its episode logs say beyond is added here, when the
evaluation's envs close. Nothing that fails here may end a training.
"""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from lerobot_spacedock.adapters import command_line
from lerobot_spacedock.errors import SpaceDockError

TENSORBOARD_FOLDER = "tensorboard"  # beside the evaluations, below --env.log_dir


def log_training_scalars(folder: Path) -> None:
    """Logs the means over the episodes in ``LOG_DIR/evaluation_NNNN``, at the training step of that evaluation."""
    from lerobot_spacedock.metrics.scalars import evaluation_scalars, write_event

    try:
        scalars = evaluation_scalars(folder)
        write_event(folder.parent / TENSORBOARD_FOLDER, scalars, _training_step(folder))
    except (SpaceDockError, OSError) as error:
        logging.warning("no scalars of %s: %s", folder, error)
        return
    wandb = sys.modules.get("wandb")
    if wandb is not None and wandb.run is not None:
        # No step of our own: the values join the row of the step that LeRobot logs, and can never push one out.
        wandb.log(scalars, commit=False)


def _training_step(folder: Path) -> int:
    """The n-th evaluation is flown at step n × ``--env_eval_freq``."""
    from lerobot.configs.train import TrainPipelineConfig

    given = command_line.command_option("env_eval_freq")
    return int(folder.name.rpartition("_")[2]) * int(given or TrainPipelineConfig.env_eval_freq)
