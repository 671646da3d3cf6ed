"""The means of an evaluation inside ``lerobot-train`` as scalars: TensorBoard, and the wandb run where one is on.

LeRobot logs reward and success of such an evaluation; what its episode logs say beyond is added here, when the
evaluation's envs close. Nothing that fails here may end a training.
"""

from __future__ import annotations

import logging
import sys
from collections import Counter
from pathlib import Path

from lerobot_spacedock.adapters import command_line

TENSORBOARD_FOLDER = "tensorboard"  # beside the evaluations, below --env.log_dir
_flown: Counter[Path] = Counter()  # evaluations of this process, by log folder


def log_training_scalars(folder: Path) -> None:
    """Logs the means over the episodes of one evaluation, at its training step."""
    from lerobot_spacedock.metrics.scalars import evaluation_scalars, write_event

    try:
        step = _training_step(folder.parent)  # first: an evaluation that cannot be read counts too
        scalars = evaluation_scalars(folder)
        write_event(folder.parent / TENSORBOARD_FOLDER, scalars, step)
        wandb = sys.modules.get("wandb")
        if wandb is not None and wandb.run is not None:
            # No step of our own: the values join the row of the step that LeRobot logs, and can never push one out.
            wandb.log(scalars, commit=False)
    except Exception as error:  # of TensorBoard's, of wandb's, of a worker that was killed
        logging.warning("no scalars of %s: %s", folder, error)


def _training_step(log_dir: Path) -> int:
    """The n-th evaluation of this process is flown at the n-th multiple of ``--env_eval_freq`` after its first step.

    The folders' numbers would not do: they go on from what lies there.
    """
    from lerobot.configs.train import TrainPipelineConfig

    _flown[log_dir] += 1
    every = int(command_line.command_option("env_eval_freq") or TrainPipelineConfig.env_eval_freq)
    return (command_line.resumed_step() // every + _flown[log_dir]) * every
