"""The simulator: N chasers at once, on NumPy arrays. The gymnasium environment is this with N = 1."""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from lerobot_spacedock.env import kernels
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.env.random import bits
from lerobot_spacedock.env.reward import STEP_TERMS, packed_weights, terminal_bonus
from lerobot_spacedock.env.scenario import SENSOR_BIAS, SENSOR_DIM, SENSOR_NOISE, SENSOR_RANGE_NOISE
from lerobot_spacedock.env.scenario_config import get_initial_conditions
from lerobot_spacedock.env.termination import BROKEN, CONTACT, DOCKED, HORIZON, OUTCOMES, RUNNING, TIMEOUT
from lerobot_spacedock.errors import InputError, SimulationError
from lerobot_spacedock.physics import chaser as p
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.contact import contact_report, contact_state, get_port
from lerobot_spacedock.physics.frames import ACTION_DIM, OBSERVATION_INDICES, STATE_DIM

# arrays of one simulation, and the constants of its task, as the kernels take them
Sim = namedtuple(
    "Sim",
    "key state parameters sensor step time dt action previous clipped clipped_now code reward terms",
)
Task = namedtuple(
    "Task",
    "meta ranges start_bounds mirror q_nominal axial_sign contact coupling mean_motion max_steps fixed_step "
    "step_mean step_std step_min step_max limits corridor corridor_tangent corridor_mouth capture_radius "
    "station_radius volume_radius weights",
)


_OBSERVED = np.array(OBSERVATION_INDICES)
_NOTHING = np.zeros((0, len(_OBSERVED)), dtype=np.float32)


class StepResult(NamedTuple):
    """What a step of the batch gives; the arrays are the simulator's own and change with the next step.

    Attributes:
        observation: (N, 13) float32, dataset order and units; after an automatic reset, of the new episode.
        reward: (N,) float64.
        terminated: (N,) bool: the task ended the episode.
        truncated: (N,) bool: the step limit ended it.
        final_state: (N, 14) SI state before any automatic reset; meaningful where an episode ended.
        code: (N,) int8 outcome codes (``termination.OUTCOMES``); 0 while running.
        report: ``contact_report`` of the rows ``ended``, in their order.
        ended: (M,) indices of the rows whose episode ended in this step.
    """

    observation: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    final_state: np.ndarray
    code: np.ndarray
    report: dict[str, np.ndarray]
    ended: np.ndarray


class BatchedSpaceDock:
    """N chasers flown by one set of kernels; the same to the bit for any N, any thread count, any order.

    Args:
        count: N.
        config: the task; see ``TaskConfig``.
        threads: numba threads to use; 1 starts none (and is what a single environment wants).
        auto_reset: an ended row starts its next episode within the same step (for training).

    The arrays (``state``, ``action``, …) are allocated once and written in place: ``torch.from_numpy`` shares them.
    """

    def __init__(
        self, count: int, config: TaskConfig | None = None, *, threads: int = 1, auto_reset: bool = False
    ) -> None:
        if count < 1:
            raise InputError("count", count, "an integer ≥ 1")
        self.config = config = config or TaskConfig()
        self.count, self.threads, self.auto_reset = count, threads, auto_reset
        self.port = get_port(config.port)
        self.task = _pack_task(config)
        self.sim = Sim(
            key=np.zeros(count, dtype=np.uint64),
            state=np.zeros((count, STATE_DIM)),
            parameters=np.zeros((count, p.PARAMETER_DIM)),
            sensor=np.zeros((count, SENSOR_DIM)),
            step=np.zeros(count, dtype=np.int64),
            time=np.zeros(count),
            dt=np.zeros(count),
            action=np.zeros((count, ACTION_DIM)),
            previous=np.zeros((count, ACTION_DIM)),
            clipped=np.zeros(count, dtype=np.int64),
            clipped_now=np.zeros(count, dtype=np.bool_),
            code=np.full(count, TIMEOUT, dtype=np.int8),
            reward=np.zeros(count),
            terms=np.zeros((count, len(STEP_TERMS))),
        )
        self._blocks = 1 if threads <= 1 else min(4 * threads, count)
        self._grid = np.zeros(0)
        self._all_rows = np.arange(count)

    # --- episodes -------------------------------------------------------------------------------------------------

    def reset(self, seeds: Sequence[int] | np.ndarray) -> np.ndarray:
        """Starts an episode in every row; row i is a function of ``seeds[i]`` alone. Returns the observation."""
        seeds = np.asarray(seeds)
        if seeds.shape != (self.count,):
            raise InputError("seeds", f"shape {seeds.shape}", f"({self.count},), one seed a row")
        self.sim.key[:] = [episode_key(int(seed)) for seed in seeds]
        self._grid = np.zeros(0)
        kernels.reset_rows(self._all_rows, self.sim, self.task)
        return self.observe()

    def place(self, state: np.ndarray, time_grid_s: np.ndarray | None = None) -> np.ndarray:
        """Puts every row into a given state and, if a grid is given, onto its step lengths. Returns the observation.

        Args:
            state: SI with rad/s, (N, 14); unit quaternions.
            time_grid_s: s, (K,) step lengths for all rows; K is then the horizon.
        """
        self.sim.state[:] = state
        self._grid = np.zeros(0) if time_grid_s is None else np.array(time_grid_s, dtype=np.float64)
        return self.observe()

    def step(self, action: np.ndarray, *, observe: bool = True) -> StepResult:
        """One step of every row that is running.

        Args:
            action: N and N·m, (N, 6), body axes; clipped to the limits (and the clip counted in ``sim.clipped``).
            observe: read the sensors too; False leaves ``observation`` empty, for callers that read them otherwise.

        Raises:
            InputError: wrong shape, or a value that is not finite.
            SimulationError: a state that is not finite, or a chaser without mass left.
        """
        action = np.ascontiguousarray(action, dtype=np.float64)
        if action.shape != (self.count, ACTION_DIM):
            raise InputError("action", f"shape {action.shape}", f"({self.count}, {ACTION_DIM})")
        if not np.isfinite(action).all():
            row, column = np.argwhere(~np.isfinite(action))[0]
            raise InputError("action", f"{action[row, column]} in row {row}, column {column}", "finite N and N·m")
        sim = self.sim
        running = sim.code == RUNNING
        if self._blocks > 1:
            kernels.step_parallel(self._blocks, action, self._grid, sim, self.task)
        else:
            kernels.step_rows(0, self.count, action, self._grid, sim, self.task)
        ended = (running & (sim.code != RUNNING)).nonzero()[0]
        code, reward, final_state = sim.code, sim.reward, sim.state
        report: dict[str, np.ndarray] = {}
        if ended.size:
            self._refuse_broken(ended)
            touched = sim.code[ended] == CONTACT
            report = self.report(sim.state[ended], at_plane=touched)
            miss = np.where(touched, report["lateral_m"], np.hypot(report["lateral_m"], report["axial_m"]))
            counts = touched | (sim.code[ended] == HORIZON)
            reward[ended] += np.where(counts, terminal_bonus(report, miss, self.config.reward), 0.0)
            if self.auto_reset:
                code, reward, final_state = sim.code.copy(), reward.copy(), sim.state.copy()
                kernels.next_keys(ended, sim)
                kernels.reset_rows(ended, sim, self.task)
        truncated = code >= TIMEOUT
        return StepResult(
            observation=self.observe() if observe else _NOTHING,
            reward=reward,
            terminated=(code > RUNNING) & (code < TIMEOUT),
            truncated=truncated,
            final_state=final_state,
            code=code,
            report=report,
            ended=ended,
        )

    # --- views ----------------------------------------------------------------------------------------------------

    def observe(self, columns: np.ndarray = _OBSERVED) -> np.ndarray:
        """(N, 13) float32: the sensors' reading of every row, dataset order and units.

        Args:
            columns: indices into ``frames.STATE_NAMES`` of the values wanted, if others; (M,) int64.
        """
        out = np.empty((self.count, len(columns)), dtype=np.float32)
        if self._blocks > 1:
            kernels.observe_parallel(self._blocks, self.sim, out, columns)
        else:
            kernels.observe_rows(0, self.count, self.sim, out, columns)
        return out

    def report(self, state: np.ndarray, *, at_plane: bool | np.ndarray = False) -> dict[str, np.ndarray]:
        """Contact quantities and box conditions of SI states (M, 14); ``at_plane`` as ``contact_report`` takes it."""
        contact = contact_state(state, self.port, hill_coupling=self.config.hill_coupling)
        return contact_report(contact, at_plane=at_plane)

    def outcome(self, row: int, report: dict[str, Any]) -> str:
        """The name of how the episode of ``row`` ended; ``report``: of that row."""
        code = int(self.sim.code[row])
        return DOCKED if code == CONTACT and bool(report["idss"]) else OUTCOMES[code]

    def dynamics(self, row: int) -> dict[str, Any]:
        """What was drawn for the episode of ``row``: chaser and sensor, JSON-ready, SI."""
        packed, sensor = self.sim.parameters[row], self.sim.sensor[row]
        return {
            "inertia_kg_m2": packed[p.INERTIA : p.INERTIA + 9].reshape(3, 3).tolist(),
            "thrust_map": packed[p.THRUST_MAP : p.THRUST_MAP + 9].reshape(3, 3).tolist(),
            "torque_map": packed[p.TORQUE_MAP : p.TORQUE_MAP + 9].reshape(3, 3).tolist(),
            "torque_bias_Nm": packed[p.TORQUE_BIAS : p.TORQUE_BIAS + 3].tolist(),
            "com_offset_m": packed[p.COM_OFFSET : p.COM_OFFSET + 3].tolist(),
            "sensor_bias": sensor[SENSOR_BIAS:SENSOR_NOISE].tolist(),
            "sensor_noise": sensor[SENSOR_NOISE:SENSOR_RANGE_NOISE].tolist(),
            "sensor_range_noise": float(sensor[SENSOR_RANGE_NOISE]),
        }

    def _refuse_broken(self, ended: np.ndarray) -> None:
        broken = ended[self.sim.code[ended] == BROKEN]
        if broken.size:
            row = int(broken[0])
            raise SimulationError(
                f"row {row}, step {int(self.sim.step[row])}: the state is no longer finite or the chaser has no mass "
                f"left: {self.sim.state[row].tolist()}"
            )


def episode_key(seed: int) -> int:
    """The key from which everything in the episode of this seed is drawn, uint64."""
    return int(bits(np.uint64(seed % 2**64), 0, 0))


def _pack_task(config: TaskConfig) -> Task:
    port = get_port(config.port)
    return Task(
        meta=config.dynamics == "meta",
        ranges=config.meta.packed(),
        start_bounds=get_initial_conditions(config.initial_conditions).bounds(),
        mirror=port.mirror,
        q_nominal=np.array(port.q_nominal),
        axial_sign=port.axis_sign,
        contact=config.contact,
        coupling=config.hill_coupling,
        mean_motion=MEAN_MOTION_rad_s,
        max_steps=config.max_steps,
        fixed_step=config.time_step == "fixed",
        step_mean=config.time_step_mean_s,
        step_std=config.time_step_std_s,
        step_min=config.time_step_min_s,
        step_max=config.time_step_max_s,
        # in single precision, as the action space holds them: what is inside it is not clipped
        limits=np.float64(np.float32([config.thrust_limit_N] * 3 + [config.torque_limit_Nm] * 3)),
        corridor=config.corridor.enabled,
        corridor_tangent=math.tan(math.radians(config.corridor.half_angle_deg)),
        corridor_mouth=config.corridor.mouth_radius_m,
        capture_radius=port.capture_radius_m,
        station_radius=port.station_radius_m,
        volume_radius=config.volume_radius_m,
        weights=packed_weights(config.reward),
    )
