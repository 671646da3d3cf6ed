"""Demonstrations of a sweep: the kinds that are compared, flown once for each setting and kept.

They are those of ``spacedock demos`` with the same options (a test compares them with the dataset that it writes), but
stay in memory and in one file: writing a LeRobotDataset takes longer than training on it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_STATE

from lerobot_spacedock import __version__, expert
from lerobot_spacedock.dataset.demos import DemosConfig, flight_blocks, fly_block
from lerobot_spacedock.dataset.disturbance import KickConfig, NoiseConfig
from lerobot_spacedock.dataset.episode import rows_of, succeeded
from lerobot_spacedock.dataset.segments import Segment, pieces
from lerobot_spacedock.dataset.selection import best, score
from lerobot_spacedock.dataset.statistics import vector_statistics
from lerobot_spacedock.env.registration import withholds_pose
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.checkpoint import GENTLE, HOLD, find_checkpoint
from lerobot_spacedock.expert.controllers import META_RL
from lerobot_spacedock.files import aside, remove_abandoned

_KICKS = KickConfig(probability=0.12)
# what each kind changes of `spacedock demos`
KINDS: dict[str, dict[str, Any]] = {
    # the paper's: its starts, no disturbance
    "clean": {},
    # the same flown with sampled actions, the label being what flew
    "sampled": {"expert": "meta_rl_sampled"},
    # wider starts alone
    "wide_starts": {"initial_conditions": "random"},
    # sparse kicks from the paper's starts
    "kicked_same": {"kicks": _KICKS},
    # sparse kicks and wider starts
    "kicked": {"kicks": _KICKS, "initial_conditions": "random"},
    # the same with none near the port, so that the demonstrations themselves dock
    "kicked_quiet": {"kicks": KickConfig(probability=0.12, quiet_m=3.0), "initial_conditions": "random"},
    # coloured noise on every step
    "noisy": {"noise": NoiseConfig(thrust_N=8.0, torque_Nm=0.5), "initial_conditions": "random"},
    # the last ten metres alone, and shown twice more
    "terminal": {"kicks": _KICKS, "initial_conditions": "random", "segment": "last:10m"},
    "oversampled": {"kicks": _KICKS, "initial_conditions": "random", "segment": "last:10m", "repeat_terminal": 2},
    # of the paper's task (no contact, 65 steps): sampled actions, as its recipe has them, and kicks
    "sampled_paper": {"expert": "meta_rl_sampled", "env_id": "SpaceDock-v0"},
    "kicked_paper": {"kicks": _KICKS, "env_id": "SpaceDock-v0"},
    # the same by the teacher that stops at the port, from wider starts: configs/demos_horizon_cpu.yaml
    "kicked_hold": {
        "kicks": _KICKS,
        "initial_conditions": "random",
        "env_id": "SpaceDock-v0",
        "checkpoint": HOLD,
    },
    # the slower meta-RL teacher, that of configs/demos_cpu.yaml
    "kicked_gentle": {"kicks": _KICKS, "initial_conditions": "random", "checkpoint": GENTLE},
    # other teachers
    "kicked_W": {"kicks": _KICKS, "initial_conditions": "random", "expert": "W"},
    "kicked_V": {"kicks": _KICKS, "initial_conditions": "random", "expert": "V"},
    "kicked_mpc": {"kicks": _KICKS, "initial_conditions": "random", "expert": "mpc"},
    # where it is only the camera shows, and these students have none: configs/demos_vision_cpu.yaml
    "kicked_vision": {
        "kicks": KickConfig(probability=0.15),
        "initial_conditions": "random,wide",
        "env_id": "SpaceDockVision-v0",
        "checkpoint": GENTLE,
    },
    # the distribution of unknown chasers and imperfect sensors
    "kicked_meta": {
        "kicks": _KICKS,
        "initial_conditions": "random",
        "env_id": "SpaceDockMeta-v0",
        "checkpoint": GENTLE,
    },
    # the same by a teacher without memory, whose command is a function of what the student sees
    "kicked_meta_W": {"kicks": _KICKS, "initial_conditions": "random", "env_id": "SpaceDockMeta-v0", "expert": "W"},
}
FIRST_SEED = 500_000  # where configs/demos_cpu.yaml begins; evaluations begin at 1000 and at 900,000
SEEDS_EACH = 10_000  # training seed s flies from FIRST_SEED + s * SEEDS_EACH on
SEEDS = 40  # training seeds for which that stays below the evaluations'


def demos_config(kind: str, num_episodes: int, seed: int) -> DemosConfig:
    """The options of ``spacedock demos`` for a kind, a number of demonstrations and a training seed.

    Raises:
        InputError: unknown kind.
    """
    if kind not in KINDS:
        raise InputError("demonstrations", kind, " | ".join(KINDS))
    return DemosConfig(
        repo_id=f"spacedock/{kind}",
        num_episodes=num_episodes,
        num_candidates=num_episodes,
        select="first",
        successes_first=False,
        seed=FIRST_SEED + seed * SEEDS_EACH,
        image=False,
        **KINDS[kind],
    )


@dataclass(frozen=True)
class Frames:
    """The frames of a set of demonstrations in memory.

    Attributes:
        state: (F, 13) float32, dataset units; (F, 6) of a task that withholds the pose.
        action: (F, 6) float32, N and N·m.
        starts: (E,) first frame of each episode.
        ends: (E,) one past its last.
        docked: of the E, how many docked.
    """

    state: np.ndarray
    action: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    docked: int

    @property
    def stats(self) -> dict[str, dict[str, np.ndarray]]:
        """LeRobot's statistics of the dataset."""
        state = vector_statistics(self.state)
        return {OBS_STATE: state, OBS_ENV_STATE: state, ACTION: vector_statistics(self.action)}

    def chunks(self, size: int) -> dict[str, torch.Tensor]:
        """What LeRobotDataset gives for every frame: the state, ``size`` actions from it on, and which are padding."""
        end = torch.from_numpy(np.repeat(self.ends, self.ends - self.starts))[:, None]
        index = torch.arange(len(self.state))[:, None] + torch.arange(size)[None]
        state = torch.from_numpy(self.state)
        return {
            OBS_STATE: state,
            OBS_ENV_STATE: state,
            ACTION: torch.from_numpy(self.action)[torch.minimum(index, end - 1)],
            f"{ACTION}_is_pad": index >= end,
        }


def demonstrations(config: DemosConfig, cache: Path | None = None) -> Frames:
    """The frames that ``spacedock demos`` would write, from the cache where they are there.

    Args:
        config: its options.
        cache: folder with one file for each setting.
    """
    path = None if cache is None else cache / f"{config.repo_id.rpartition('/')[2]}-{_fingerprint(config)}.npz"
    if path is not None and path.exists():
        with np.load(path) as stored:
            arrays = {name: stored[name] for name in stored.files}
        return Frames(**{**arrays, "docked": int(arrays["docked"])})
    frames = _fly(config)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(path)
        with aside(path, shared=True) as own, own.open("wb") as stream:
            np.savez_compressed(stream, **vars(frames))
    return frames


def _fly(config: DemosConfig) -> Frames:
    logs = {log.metadata["seed"]: log for block in flight_blocks(config) for log in fly_block(config, *block)}
    flown = [logs[seed] for seed in sorted(logs)]
    kept = best(
        [score(log, config.select) for log in flown],
        [succeeded(log) for log in flown],
        config.num_episodes,
        successes_first=config.successes_first,
    )
    segment = Segment.parse(config.segment)
    parts = [part for i in kept for _, part in pieces(flown[i], segment, repeat_terminal=config.repeat_terminal)]
    rows = [rows_of(part, withhold_pose=withholds_pose(config.env_id)) for part in parts]
    ends = np.cumsum([part.num_steps for part in parts])
    return Frames(
        state=np.concatenate([row[OBS_STATE] for row in rows]),
        action=np.concatenate([row[ACTION] for row in rows]),
        starts=np.concatenate([[0], ends[:-1]]),
        ends=ends,
        docked=sum(succeeded(flown[i]) for i in kept),
    )


def _fingerprint(config: DemosConfig) -> str:
    """Changes with every option, with the package's version, and with what the expert is: its weights, or its law."""
    text = json.dumps([__version__, config.settings()], sort_keys=True, default=str)
    found = hashlib.sha256(text.encode())
    if config.expert in META_RL:
        weights = find_checkpoint(config.checkpoint)
        found.update(weights.read_bytes() + weights.with_suffix(".json").read_bytes())
    else:
        for source in sorted(Path(expert.__file__).parent.glob("*.py")):
            found.update(source.read_bytes())
    return found.hexdigest()[:12]
