"""The gymnasium environment: the batched simulator with one chaser, a camera, and an episode log."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lerobot_spacedock.camera import extrinsics, intrinsics, make_renderer, sensor_noise
from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.reward import STEP_TERMS
from lerobot_spacedock.env.start import check_action, check_start, check_time_steps
from lerobot_spacedock.env.sunlight import SunPath
from lerobot_spacedock.env.termination import OUTCOMES, RUNNING
from lerobot_spacedock.episode_log import EpisodeLog, log_path, observed_columns, write_episode_log
from lerobot_spacedock.errors import InputError, SimulationError
from lerobot_spacedock.physics.frames import (
    POSITION,
    QUATERNION,
    STATE_NAMES,
    observed_indices,
    state_to_dataset_units,
)

CAMERA_NAME = "camera"
TASK_DESCRIPTION = "dock with the International Space Station"
_REWARD_NAMES = tuple(f"reward_{name}" for name in STEP_TERMS)
# LeRobot marks the first reset of each rollout with it
_IGNORED_OPTIONS = {"lerobot_new_rollout"}


class SpaceDockEnv(gym.Env):
    """A chaser docks with the International Space Station; a POMDP ⟨S, A, O, T, R, Ω, γ⟩.

    | part | what it is |
    |---|---|
    | state S | position and velocity (Hill frame), mass, attitude, body rates: 14 values; in the meta task also the chaser's and the sensors' hidden parameters, constant over an episode |
    | action A | `Box(6,)`: thrust ±60 N and torque ±20 N·m per body axis, held over the step; clipped, and the clip counted |
    | observation O | `agent_pos` and/or `pixels` |
    | observation model Ω | exact, but in the meta task, where each reading carries a constant bias and fresh Gaussian noise (`MetaRanges`); the picture shows the true pose |
    | transition T | HCW translation under the body-fixed thrust, Euler's equations, mass flow; the step's length is drawn from N(0.907, 0.077) s within 0.6 to 1.25 s, unless fixed or given |
    | reward R | each step bounded costs of closing speed, drift, lateral offset, attitude and rates, and one in proportion to the change of command; a bonus at the end (`env/reward.py`); each term in `info` as `reward_<term>` |
    | discount γ | 0.99 is what the expert is trained with; the environment has none of its own |

    Observation:

    | key | shape | dtype | values |
    |---|---|---|---|
    | `agent_pos` | (13,) | float32 | x, y, z [m], vx, vy, vz [m/s], q0, q1, q2, q3, w1, w2, w3 [deg/s] |
    | `agent_pos`, with_mass | (14,) | float32 | the same with the mass [kg] after the velocity |
    | `agent_pos`, withhold_pose | (6,) | float32 | vx, vy, vz [m/s], w1, w2, w3 [deg/s] |
    | `pixels` → `camera` | (480, 640, 3) | uint8 | the picture of the body camera; size by `camera.height`, `camera.width` |

    w1, w2, w3 are the rates against the station in `SpaceDock-v0`, and inertial with `hill_coupling` (the contact ids).

    `reset(options={"state": …, "time_steps": …})` starts from 13 or 14 values (dataset order and units) and flies on
    the given step lengths [s], whose number is then the horizon: a recorded episode can be flown again.

    Terminal `info`: `is_success`, `outcome` (docked, contact, collision, corridor, volume, timeout, horizon), and
    `contact_<quantity>` for every quantity and box condition of `physics/contact.py`.

    Args:
        render_mode: None or "rgb_array".
        config: all options; left out, they are built from ``options``.
        options: fields of ``SpaceDockConfig`` by name; nested ones may be dicts.
    """  # noqa: E501

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, config: SpaceDockConfig | None = None, **options: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError("render_mode", render_mode, "None or rgb_array")
        if config is None:
            config = SpaceDockConfig.from_options(**options)
        elif options:
            raise InputError("options", sorted(options), "either config or single options, not both")
        self.config, self.render_mode = config, render_mode
        self.task, self.task_description = config.env_id, TASK_DESCRIPTION
        self._max_episode_steps = config.max_steps
        self._log_dir = None if config.log_dir is None else Path(config.log_dir)
        self._simulator = BatchedSpaceDock(1, config)
        self._indices = _observed_indices(config)
        self._renderer: Any = None
        self._sun = SunPath(config.sun, config.port)
        self._frame: np.ndarray | None = None
        self._running = False

        limits = np.float32([config.thrust_limit_N] * 3 + [config.torque_limit_Nm] * 3)
        self.action_space = spaces.Box(-limits, limits, dtype=np.float32)
        parts: dict[str, spaces.Space] = {}
        if config.uses_camera:
            shape = (config.camera.height, config.camera.width, 3)
            parts["pixels"] = spaces.Dict({CAMERA_NAME: spaces.Box(0, 255, shape, np.uint8)})
        if config.obs_type != "pixels":
            bound = np.array([_bound(STATE_NAMES[i]) for i in self._indices], dtype=np.float32)
            low = np.where([STATE_NAMES[i] == "mass" for i in self._indices], np.float32(0.0), -bound)
            parts["agent_pos"] = spaces.Box(low, bound, dtype=np.float32)
            self._low, self._high = low, bound
        self.observation_space = spaces.Dict(parts)

    # --- gymnasium ------------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Starts an episode: from the seed, or from ``options`` (see the class).

        Raises:
            InputError: an unknown option, or a state or time grid that cannot be flown.
        """
        super().reset(seed=seed)
        self._running = False  # until the start is found good
        options = dict(options or {})
        unknown = set(options) - {"state", "time_steps"} - _IGNORED_OPTIONS
        if unknown:
            raise InputError("reset options", sorted(unknown), "state (13 or 14 values), time_steps (s)")
        grid = options.get("time_steps")
        grid = None if grid is None else check_time_steps(grid)
        start = options.get("state")

        self._seed = int(self.np_random.integers(2**31)) if seed is None else seed
        self._simulator.reset([self._seed])
        if start is not None or grid is not None:
            placed = self._simulator.sim.state[0].copy()
            if start is not None:
                placed = check_start(start, default_mass_kg=placed[6])
            self._simulator.place(placed[None], grid)
        self._max_episode_steps = self.config.max_steps if grid is None else len(grid)
        self._sun.start(self._seed)
        self._running = True
        self._given_start = start is not None
        self._trace: dict[str, list] = {
            "time": [0.0],
            "state": [self._true_state()],
            "action": [],
            "dt": [],
            "reward": [],
        }
        self._readings: list[np.ndarray] = []  # what imperfect sensors showed before each step, for the log
        info = self._info(self._true_state())
        if self.config.uses_camera:
            info["camera_intrinsics"] = intrinsics(self.config.camera)
        return self._observation(), info

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Flies one step under a held command (6,), N and N·m in body axes.

        Raises:
            InputError: wrong shape, not numeric or not finite.
            SimulationError: the state is no longer finite, or the chaser has no mass left; the episode has ended.
            gymnasium.error.ResetNeeded: the episode has ended.
        """
        if not self._running:
            raise gym.error.ResetNeeded("no episode is running: call reset() before the next step()")
        try:
            result = self._simulator.step(check_action(action)[None], observe=False)
        except SimulationError as error:
            self._running = False
            raise SimulationError(f"seed {self._seed}, {error}") from error
        sim = self._simulator.sim
        reward, state = float(result.reward[0]), self._true_state()
        for name, value in (
            ("time", float(sim.time[0])),
            ("state", state),
            ("action", sim.action[0].copy()),
            ("dt", float(sim.dt[0])),
            ("reward", reward),
        ):
            self._trace[name].append(value)
        info = self._info(state.copy())
        info |= zip(_REWARD_NAMES, sim.terms[0].tolist(), strict=True)
        info["reward_terminal"] = reward - float(np.add.reduce(sim.terms[0]))
        terminated, truncated = bool(result.terminated[0]), bool(result.truncated[0])
        if terminated or truncated:
            self._running = False
            report = {name: values[0].item() for name, values in result.report.items()}
            info["is_success"] = self._succeeded(report)
            info["outcome"] = self._simulator.outcome(0, report)
            info |= {f"contact_{name}": value for name, value in report.items()}
            self._write_log(report, info)
        return self._observation(), reward, terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """The picture of the last observation, (H, W, 3) uint8; drawn now where the observation holds none."""
        if self.render_mode is None:
            return None
        if self._frame is None:
            self._frame = self._draw()
        return self._frame

    def close(self) -> None:
        """Gives the renderer back; may be called twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    @property
    def dynamics(self) -> dict[str, np.ndarray]:
        """Chaser and sensors of this episode, SI, drawn in the meta task: what its log says under ``dynamics``."""
        return {name: np.asarray(values) for name, values in self._simulator.dynamics(0).items()}

    # --- parts ----------------------------------------------------------------------------------------------------

    def _true_state(self) -> np.ndarray:
        return state_to_dataset_units(self._simulator.sim.state[0])

    def _observation(self) -> dict[str, Any]:
        observation: dict[str, Any] = {}
        self._frame = None
        if self._log_dir is not None and self.config.dynamics == "meta":
            self._readings.append(self._simulator.observe()[0])
        if self.config.uses_camera:
            self._frame = self._draw()
            observation["pixels"] = {CAMERA_NAME: self._frame.copy()}
        if self.config.obs_type != "pixels":
            values = self._simulator.observe(self._indices)[0]
            # unit quaternions may leave [-1, 1] by a float32 rounding
            observation["agent_pos"] = np.minimum(np.maximum(values, self._low), self._high)
        return observation

    def _draw(self) -> np.ndarray:
        if self._renderer is None:
            config = self.config
            pose = None if config.station_pose is None else np.reshape(config.station_pose, (4, 4))
            self._renderer = make_renderer(config.camera, config.renderer, config.station_mesh, pose)
        state, time_s = self._simulator.sim.state[0], float(self._simulator.sim.time[0])
        noise = sensor_noise(self.config.camera, self._seed, time_s)
        return self._renderer.render(state[POSITION], state[QUATERNION], self._sun.at(time_s), generator=noise)

    def _info(self, state: np.ndarray) -> dict[str, Any]:
        sim = self._simulator.sim
        info = {
            "is_success": False,
            "outcome": OUTCOMES[RUNNING],
            "time_s": float(sim.time[0]),
            "dt_s": float(sim.dt[0]) if self._trace["dt"] else 0.0,
            "mass_kg": float(sim.state[0, 6]),
            "clipped_actions": int(sim.clipped[0]),
            "state": state,
            "sun_H": self._sun.at(float(sim.time[0])),
        }
        if self.config.uses_camera:
            info["camera_extrinsics"] = extrinsics(sim.state[0, POSITION], sim.state[0, QUATERNION])
        return info

    def _succeeded(self, report: dict[str, Any]) -> bool:
        """The IDSS box, at contact; in the fixed-horizon task, at the last state."""
        if not self.config.contact:
            return bool(report["idss"])
        return self._simulator.outcome(0, report) == "docked"

    def _write_log(self, report: dict[str, Any], info: dict[str, Any]) -> None:
        if self._log_dir is None:
            return
        from lerobot_spacedock import __version__

        trace = {name: np.array(values) for name, values in self._trace.items()}
        seen = observed_columns(np.stack(self._readings)) if self._readings else {}
        metadata = {
            "version": __version__,
            "env_id": self.config.env_id,
            "config": _plain(dataclasses.asdict(self.config) | {"log_dir": None}),
            "seed": self._seed,
            "initial_conditions": "given" if self._given_start else self.config.initial_conditions,
            "label": self.config.label,
            "outcome": info["outcome"],
            "success": info["is_success"],
            "contact": report,
            "clipped_actions": info["clipped_actions"],
            "dynamics": self._simulator.dynamics(0),
        }
        write_episode_log(log_path(self._log_dir, self._seed), EpisodeLog(**trace, metadata=metadata, extra=seen))


def observation_names(config: SpaceDockConfig) -> tuple[str, ...]:
    """Names of the values of ``agent_pos`` under this configuration."""
    return tuple(STATE_NAMES[i] for i in _observed_indices(config))


def _observed_indices(config: SpaceDockConfig) -> np.ndarray:
    return observed_indices(with_mass=config.with_mass, withhold_pose=config.withhold_pose)


def _bound(name: str) -> float:
    return 1.0 if name.startswith("q") else np.inf


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value))
