"""The gymnasium ids: what each one overrides in ``SpaceDockConfig``."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

_CONTACT = {"contact": True, "hill_coupling": True, "max_steps": 100}

ENV_IDS: dict[str, dict[str, Any]] = {
    # the paper's task: fixed horizon, no contact, exact state, nominal chaser
    "SpaceDock-v0": {},
    # ends at the port plane, on leaving the corridor, or in time-out
    "SpaceDockContact-v0": _CONTACT,
    # contact, over the meta-RL distribution of chasers and sensors
    "SpaceDockMeta-v0": _CONTACT | {"dynamics": "meta"},
    # contact; position and attitude are withheld from the state
    "SpaceDockVision-v0": _CONTACT | {"withhold_pose": True},
}


def withholds_pose(env_id: str) -> bool:
    """Whether the state of an environment holds velocity and rates alone; False of an id that is not ours."""
    return bool(ENV_IDS.get(env_id, {}).get("withhold_pose"))


def register_envs() -> None:
    """Registers every id of ``ENV_IDS``; calling it again changes nothing."""
    for env_id, overrides in ENV_IDS.items():
        if env_id not in gym.registry:
            gym.register(
                env_id,
                entry_point="lerobot_spacedock.env.spacedock:SpaceDockEnv",
                kwargs={"env_id": env_id, **overrides},
                order_enforce=True,
            )
