"""A controller of your own, judged as the shipped ones are, and flown for demonstrations.

    python examples/own_controller.py
    PYTHONPATH=examples spacedock demos --expert=own_controller:make --repo_id=me/own --num_episodes=10

A controller is a class with ``reset(count)`` and ``act(observation)``, for any number of chasers at once. This one is
the textbook's: a PD on the nominal chaser with a closing speed that falls as the square root of the distance.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.expert.classical import attitude_torque, hill_acceleration
from lerobot_spacedock.expert.evaluate import HELD_OUT_SEED, TASKS, fly, table
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.contact import get_port

MASS_kg, BRAKING_m_s2, CLOSING_m_s = 1000.0, 0.008, 0.075


class SquareRoot:
    """Along the port's axis a speed that constant braking brings down to 0.075 m/s; across it a damped spring."""

    def __init__(self, task: TaskConfig) -> None:
        self.task, self.port = task, get_port(task.port)

    def reset(self, count: int) -> None:
        """Nothing is remembered."""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """(N, 13) x..z m, vx..vz m/s, q0..q3, w1..w3 °/s → (N, 6) N and N·m, body axes."""
        r, v, q, w = np.split(np.asarray(observation, dtype=np.float64), [3, 6, 10], axis=1)
        left = np.maximum(self.port.axis_sign * r[:, 1], 0.0)
        wanted = -self.port.axis_sign * np.sqrt(CLOSING_m_s**2 + 2.0 * BRAKING_m_s2 * left)
        pull = -(0.12**2) * r - 2.0 * 0.12 * v
        pull[:, 1] = 0.2 * (wanted - v[:, 1]) + self.port.axis_sign * BRAKING_m_s2
        pull -= hill_acceleration(r, v)  # free motion, fed forward
        force = MASS_kg * rotations.rotate_inverse(q, pull)
        nominal = np.array(self.port.q_nominal)
        torque = attitude_torque(q, np.radians(w), nominal, hill_coupling=self.task.hill_coupling)
        return np.concatenate([force, torque], axis=1)


make = SquareRoot  # what --expert=own_controller:make calls, with the task


if __name__ == "__main__":
    seeds = range(HELD_OUT_SEED, HELD_OUT_SEED + 200)
    names = ("contact same", "contact random", "meta random")
    print(table([("own", name, fly(make(TASKS[name]), TASKS[name], seeds).summary()) for name in names]))
