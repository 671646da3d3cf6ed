"""``python -m lerobot_spacedock.study.blindfold``: does the docking need the picture?

Whole episodes through LeRobot's own ``eval_policy``, on the same seeds: with the pictures that the camera sees, with
those of other moments (frames drawn from a dataset), and with none (the dataset's mean colour). The state is the true
one throughout. Logs are left in OUT/MODE/STARTS, so ``spacedock report`` can go on from there.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch
from lerobot.policies.act.modeling_act import ACTTemporalEnsembler
from lerobot.processor import PolicyProcessorPipeline
from lerobot.scripts.lerobot_eval import eval_policy

from lerobot_spacedock.adapters import SpaceDockEnvConfig
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.folders import check_output
from lerobot_spacedock.study.picture_use import CAMERA, load_pictures, load_policy
from lerobot_spacedock.study.summarize import summarize_folder, table, write_rows

MODES = {"seen": "pictures seen", "shuffled": "shuffled", "blank": "blank"}  # each with its name in the table
Observation = dict[str, Any]


def blindfold(mode: str, pictures: torch.Tensor, seed: int = 0) -> Callable[[Observation], Observation]:
    """What stands between the camera and the policy.

    Args:
        mode: one of ``MODES``.
        pictures: (F, 3, height, width), in [0, 1]: what is shown instead.
        seed: of the draw.

    Returns:
        a function from an observation of LeRobot's to one whose pictures are replaced.

    Raises:
        InputError: unknown mode.
    """
    if mode not in MODES:
        raise InputError("--modes", mode, " ".join(MODES))
    generator = torch.Generator().manual_seed(seed)
    mean = pictures.mean(dim=(0, 2, 3))[None, :, None, None]

    def replaced(observation: Observation) -> Observation:
        seen = observation[CAMERA]
        if mode == "blank":
            return observation | {CAMERA: mean.expand_as(seen).to(seen)}
        if mode == "shuffled":
            drawn = torch.randint(len(pictures), (len(seen),), generator=generator)
            return observation | {CAMERA: pictures[drawn].to(seen)}
        return observation

    return replaced


def fly(
    checkpoint: Path,
    pictures: torch.Tensor,
    mode: str,
    starts: str,
    log_dir: Path,
    *,
    episodes: int = 100,
    batch_size: int = 25,
    coefficient: float = 0.01,
    task: str = "SpaceDockContact-v0",
) -> list[dict[str, Any]]:
    """Flies a stock ACT checkpoint on seeds from 1000, as ``lerobot-eval`` does; rows as of ``summarize_folder``.

    Raises:
        InputError: a number of episodes that does not fill batches, or a folder that is there already.
    """
    if episodes < 1:
        raise InputError("--episodes", episodes, "1 or more")
    if episodes % min(batch_size, episodes):  # outside LeRobot's commands nothing marks what only fills a batch
        raise InputError("--episodes", episodes, f"up to {batch_size}, or a multiple of it")
    config = SpaceDockEnvConfig(task=task, initial_conditions=starts, log_dir=str(log_dir))
    policy, before, after = load_policy(checkpoint)
    try:
        log_dir.mkdir(parents=True)  # two commands that fly into one folder would count each other's episodes
    except FileExistsError as error:
        hint = "Name another, or take it away."
        raise InputError("--out", str(log_dir), "a folder that is not there yet", hint) from error
    policy.config.temporal_ensemble_coeff, policy.config.n_action_steps = coefficient, 1
    policy.temporal_ensembler = ACTTemporalEnsembler(coefficient, policy.config.chunk_size)
    height, width = pictures.shape[-2:]
    config.camera = type(config.camera)(height=height, width=width)
    env = config.create_envs(min(batch_size, episodes))["spacedock"][0]
    try:
        replace = blindfold(mode, pictures)
        nothing = PolicyProcessorPipeline(steps=[])
        eval_policy(env, policy, replace, nothing, before, after, episodes, start_seed=1000)
    finally:
        env.close()
    return summarize_folder(MODES[mode], log_dir)


def main(argv: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m lerobot_spacedock.study.blindfold", description=__doc__)
    parser.add_argument("--checkpoint", type=Path, required=True, help="CHECKPOINT/pretrained_model of an ACT")
    parser.add_argument("--root", type=Path, required=True, help="a LeRobotDataset with pictures of its size")
    parser.add_argument("--out", type=Path, default=Path("outputs/blindfold"), help="for the episode logs")
    parser.add_argument("--modes", nargs="+", default=list(MODES), choices=MODES, help="what is shown; default: all")
    parser.add_argument("--starts", nargs="+", default=["same"], help="same, random, same_dispersed")
    parser.add_argument("--task", default="SpaceDockContact-v0", help="gymnasium id")
    parser.add_argument("--episodes", type=int, default=100, help="of each; default: 100")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    arguments = parser.parse_args(argv)
    rows = []
    try:
        if arguments.json:
            check_output(arguments.json, "--json")
        pictures, _, _ = load_pictures(arguments.root, 256)
        for mode in arguments.modes:
            for starts in arguments.starts:
                folder = arguments.out / mode / starts
                options = {"episodes": arguments.episodes, "task": arguments.task}
                rows += fly(arguments.checkpoint, pictures, mode, starts, folder, **options)
                if arguments.json:
                    write_rows(arguments.json, rows)  # after each: the next takes minutes
    except SpaceDockError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(table(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
