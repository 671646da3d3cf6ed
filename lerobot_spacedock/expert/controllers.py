"""Experts by name."""

from __future__ import annotations

from pathlib import Path

from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.adaptive import AdaptiveThrust
from lerobot_spacedock.expert.deadline import Deadline
from lerobot_spacedock.expert.feedback import LAWS, FeedbackPolicy
from lerobot_spacedock.expert.mpc import MpcPolicy
from lerobot_spacedock.expert.policy import Policy
from lerobot_spacedock.expert.zem import ZemZevPolicy
from lerobot_spacedock.physics.contact import get_port

ADAPTIVE = {"mpc_adaptive": "mpc", "W_adaptive": "W"}  # each with the law behind its estimate
EXPERTS = ("meta_rl", "meta_rl_sampled", "meta_rl_forgetful", "mpc", "mpc_fixed", "zem", *LAWS, *ADAPTIVE)
PAPER_HORIZON_STEPS = 65


def make_expert(name: str, task: TaskConfig, *, checkpoint: str | Path | None = None, seed: int = 0) -> Policy:
    """The expert of that name, set up for a task.

    Args:
        name: one of ``EXPERTS``: the learnt policy (its mean, sampled, or with its memory cleared every step), MPC with
            free time to go or to a deadline, ZEM/ZEV, the feedback laws W, V and Q, and two of these with an estimate
            of the thrust that acts.
        task: gives port, attitude model and horizon. Where there is contact the classical laws with a deadline arrive
            with a closing speed in the middle of the allowed band; in the fixed-horizon task they stop at the port.
        checkpoint: of the learnt policy: file, folder, ``gentle``, ``hold``; the shipped one by default.
        seed: of the noise of sampled actions.
    """
    if name in ADAPTIVE:
        return AdaptiveThrust(make_expert(ADAPTIVE[name], task), step_s=task.time_step_mean_s)
    where = {"port": get_port(task.port)}
    if name in ("meta_rl", "meta_rl_sampled", "meta_rl_forgetful"):
        from lerobot_spacedock.expert.meta_rl import MetaRlPolicy

        options = {"stochastic": name == "meta_rl_sampled", "forgetful": name == "meta_rl_forgetful", "seed": seed}
        return MetaRlPolicy.load(checkpoint, **where, **options)
    where["hill_coupling"] = task.hill_coupling
    if name in LAWS:
        return FeedbackPolicy(name, **where)
    if task.contact:
        deadline = Deadline(steps=PAPER_HORIZON_STEPS, step_s=task.time_step_mean_s)
    else:
        deadline = Deadline(steps=task.max_steps, step_s=task.time_step_mean_s, closing_speed_m_s=0.0)
    if name == "mpc_fixed":
        return MpcPolicy(deadline, **where)
    if name == "mpc":
        return MpcPolicy(Deadline(step_s=task.time_step_mean_s), mode="receding", **where)
    if name == "zem":
        return ZemZevPolicy(deadline, **where)
    raise InputError("expert", name, " | ".join(EXPERTS))
