"""Experts by name."""

from __future__ import annotations

import importlib
import re
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
META_RL = ("meta_rl", "meta_rl_sampled", "meta_rl_forgetful")  # the mean, sampled, with the memory cleared every step
EXPERTS = (*META_RL, "mpc", "mpc_fixed", "zem", *LAWS, *ADAPTIVE)
PAPER_HORIZON_STEPS = 65


def make_expert(name: str, task: TaskConfig, *, checkpoint: str | Path | None = None, seed: int = 0) -> Policy:
    """The expert of that name, set up for a task.

    Args:
        name: ``MODULE:FACTORY`` of your own (a callable from the task to a ``Policy``, imported from Python's path), or
            one of ``EXPERTS``: the learnt policy (its mean, sampled, or with its memory cleared every step), MPC with
            free time to go or to a deadline, ZEM/ZEV, the feedback laws W, V and Q, and two of these with an estimate
            of the thrust that acts.
        task: gives port, attitude model and horizon. Where there is contact the classical laws with a deadline arrive
            with a closing speed in the middle of the allowed band; in the fixed-horizon task they stop at the port.
        checkpoint: of the learnt policy: file, folder, ``gentle``, ``hold``; the shipped one by default.
        seed: of the noise of sampled actions.

    Raises:
        InputError: none of that name, or one that cannot be imported or is no policy.
    """
    check_expert(name)
    if ":" in name:
        return _own(name, task)
    if name in ADAPTIVE:
        return AdaptiveThrust(make_expert(ADAPTIVE[name], task), step_s=task.time_step_mean_s)
    where = {"port": get_port(task.port)}
    if name in META_RL:
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
    return ZemZevPolicy(deadline, **where)


def check_expert(name: str, flag: str = "--expert") -> None:
    """Raises InputError unless it is one of ``EXPERTS``, or may be a ``MODULE:FACTORY``."""
    if name not in EXPERTS and not re.fullmatch(r"[\w.]+:\w+", name):
        raise InputError(flag, name, f"{' | '.join(EXPERTS)} | MODULE:FACTORY of your own")


def _own(name: str, task: TaskConfig) -> Policy:
    module, _, factory = name.partition(":")
    allowed = "MODULE:FACTORY that Python can import, a callable from the task to a policy"
    try:
        policy = getattr(importlib.import_module(module), factory)(task)
    except Exception as error:  # of somebody else's code, any
        mend = f"{type(error).__name__}: {error}. PYTHONPATH=FOLDER adds a folder."
        raise InputError("--expert", name, allowed, mend) from error
    if not all(callable(getattr(policy, method, None)) for method in ("reset", "act")):
        made = f"{name}, which made a {type(policy).__name__}"
        raise InputError("--expert", made, "a policy: reset(count), act(observation)")
    return policy
