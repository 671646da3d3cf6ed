"""Disturbances injected into the executed command, while the label stays the expert's clean one.

An imitator drifts into states that clean demonstrations never show; disturbed ones show how to come back from there.

Source: Laskey et al., "DART: noise injection for robust imitation learning", CoRL 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_spacedock.errors import InputError, in_range
from lerobot_spacedock.physics.frames import ACTION_DIM, POSITION

_STREAM = 0x6B69636B  # keeps these draws apart from all others of the same seed


@dataclass(frozen=True)
class KickConfig:
    """Sparse kicks: at each step, with a small chance, a command of one step is added. Off by default."""

    # chance of a kick at each step, 0 to 1; 0.12 is a good teacher
    probability: float = 0.0
    # N, standard deviation of a kick on each thrust axis
    thrust_N: float = 40.0
    # N·m, standard deviation of a kick on each torque axis
    torque_Nm: float = 3.0
    # m, no disturbance nearer to the port than this; the larger, the more demonstrations dock themselves
    quiet_m: float = 0.0

    def __post_init__(self) -> None:
        in_range("--kicks.probability", self.probability, 0.0, 1.0)
        for name in ("thrust_N", "torque_Nm", "quiet_m"):
            in_range(f"--kicks.{name}", getattr(self, name), 0.0, np.inf)
        for name in ("thrust_N", "torque_Nm"):
            if not self.on and getattr(self, name) != getattr(KickConfig, name):
                mend = "Add --kicks.probability=0.12, say: it is 0, and nothing is kicked."
                raise InputError(f"--kicks.{name}", getattr(self, name), "nothing without --kicks.probability", mend)

    @property
    def on(self) -> bool:
        return self.probability > 0.0


@dataclass(frozen=True)
class NoiseConfig:
    """Coloured noise on every step: first-order autoregressive. Off by default."""

    # correlation from one step to the next, 0 (white) to below 1
    correlation: float = 0.7
    # N, standard deviation on each thrust axis
    thrust_N: float = 0.0
    # N·m, standard deviation on each torque axis
    torque_Nm: float = 0.0

    def __post_init__(self) -> None:
        in_range("--noise.correlation", self.correlation, 0.0, 0.9999)
        for name in ("thrust_N", "torque_Nm"):
            in_range(f"--noise.{name}", getattr(self, name), 0.0, np.inf)
        if not self.on and self.correlation != NoiseConfig.correlation:
            mend = "Add --noise.thrust_N=8 or --noise.torque_Nm=0.5, say: both are 0, and there is no noise."
            raise InputError("--noise.correlation", self.correlation, "nothing without a standard deviation", mend)

    @property
    def on(self) -> bool:
        return self.thrust_N > 0.0 or self.torque_Nm > 0.0


def disturbs(kicks: KickConfig, noise: NoiseConfig) -> bool:
    """Whether anything is added to the commands.

    Raises:
        InputError: a calm zone of what is calm everywhere.
    """
    if kicks.quiet_m and not (kicks.on or noise.on):
        mend = "Add --kicks.probability=0.12, say: without kicks and noise all is quiet."
        raise InputError("--kicks.quiet_m", kicks.quiet_m, "nothing without --kicks.probability or --noise", mend)
    return kicks.on or noise.on


@dataclass(frozen=True)
class Disturbance:
    """The additive commands of a batch of episodes, drawn beforehand; each row is a function of its seed alone.

    Attributes:
        commands: N and N·m, (N, steps, 6).
        quiet_m: no disturbance nearer to the port than this.
    """

    commands: np.ndarray
    quiet_m: float = 0.0

    @classmethod
    def draw(cls, seeds: np.ndarray, steps: int, kicks: KickConfig, noise: NoiseConfig) -> Disturbance:
        commands = np.stack([_draw_episode(int(seed), steps, kicks, noise) for seed in seeds])
        return cls(commands, kicks.quiet_m)

    def add(self, label: np.ndarray, step: int, state: np.ndarray) -> np.ndarray:
        """The command to execute (not yet clipped), (N, 6), for labels (N, 6) in the SI states (N, 14)."""
        near = np.linalg.norm(state[:, POSITION], axis=1) < self.quiet_m
        return label + np.where(near[:, None], 0.0, self.commands[:, step])


def _draw_episode(seed: int, steps: int, kicks: KickConfig, noise: NoiseConfig) -> np.ndarray:
    generator = np.random.default_rng([_STREAM, seed % 2**64])
    kick_sigma = np.repeat([kicks.thrust_N, kicks.torque_Nm], ACTION_DIM // 2)
    noise_sigma = np.repeat([noise.thrust_N, noise.torque_Nm], ACTION_DIM // 2)
    kicked = generator.random(steps) < kicks.probability
    commands = kicked[:, None] * kick_sigma * generator.standard_normal((steps, ACTION_DIM))
    white = generator.standard_normal((steps, ACTION_DIM))
    coloured = np.zeros(ACTION_DIM)
    rho = noise.correlation
    for k in range(steps):
        coloured = white[k] if k == 0 else rho * coloured + np.sqrt(1.0 - rho**2) * white[k]
        commands[k] += noise_sigma * coloured
    return commands
