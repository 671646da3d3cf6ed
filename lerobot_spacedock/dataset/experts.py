"""The experts by name, for an environment."""

from __future__ import annotations

from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.policy import Policy
from lerobot_spacedock.physics.contact import get_port

EXPERTS = {
    "meta_rl": "the recurrent meta-RL policy (--checkpoint: another than the one that ships)",
    "feedback": "the hand-designed time-invariant law W; feedback:V and feedback:Q are its relatives",
    "mpc": "minimum-energy MPC with a free end time",
    "mpc_fixed": "minimum-energy MPC that arrives at step 65",
    "zem": "ZEM/ZEV guidance that arrives at step 65",
}


def check_expert(name: str, checkpoint: str | None) -> None:
    """Raises InputError for a name that is not known, or a checkpoint where none is read."""
    if name.partition(":")[0] not in EXPERTS:
        listed = "; ".join(f"{key}: {text}" for key, text in EXPERTS.items())
        raise InputError("--expert", name, listed)
    if checkpoint is not None and name != "meta_rl":
        raise InputError("--checkpoint", checkpoint, "nothing, unless --expert=meta_rl")


def make_expert(name: str, config: SpaceDockConfig, *, checkpoint: str | None = None) -> Policy:
    """The expert of that name for an environment.

    Args:
        name: a key of ``EXPERTS``; ``feedback`` may name its law after a colon.
        config: port and attitude model are taken from it.
        checkpoint: of the meta-RL policy; None is the one that ships.
    """
    check_expert(name, checkpoint)
    kind, _, variant = name.partition(":")
    options = {"port": get_port(config.port), "hill_coupling": config.hill_coupling}
    if kind == "feedback":
        from lerobot_spacedock.expert.feedback import FeedbackPolicy

        return FeedbackPolicy(variant or "W", **options)
    if kind == "zem":
        from lerobot_spacedock.expert.zem import ZemZevPolicy

        return ZemZevPolicy(**options)
    if kind in ("mpc", "mpc_fixed"):
        from lerobot_spacedock.expert.mpc import MpcPolicy

        return MpcPolicy(mode="fixed" if kind == "mpc_fixed" else "receding", **options)
    from lerobot_spacedock.expert.meta_rl import load_meta_rl

    return load_meta_rl(checkpoint, **options)
