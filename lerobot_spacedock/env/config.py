"""Every option of the environments, with its meaning; YAML and flags hold overrides only."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

from lerobot_spacedock.camera.config import BACKENDS, CameraConfig
from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.scenario_config import MetaRanges, get_initial_conditions
from lerobot_spacedock.errors import InputError, one_of
from lerobot_spacedock.physics.constants import CHASER_INERTIA_kg_m2
from lerobot_spacedock.physics.contact import get_port

OBS_TYPES = ("pixels_agent_pos", "agent_pos", "pixels")
TIME_STEP_MODES = ("normal", "fixed")
DYNAMICS = ("nominal", "meta")
SUNS = ("fixed", "random", "orbit", "eclipse")


@dataclass(frozen=True)
class CorridorConfig:
    """The approach corridor: a cone about the docking axis, open towards the chaser."""

    # leaving it ends the episode (outcome "corridor")
    enabled: bool = True
    # deg, half angle of the cone
    half_angle_deg: float = 10.0
    # m, radius of the cone where it meets the port plane
    mouth_radius_m: float = 1.5


@dataclass(frozen=True)
class TaskConfig:
    """The task that a simulator flies; `BatchedSpaceDock` and the gymnasium class share it."""

    # same | random | same_dispersed | wide: where episodes start
    initial_conditions: str = "same"
    # zvezda_aft | harmony_forward
    port: str = "zvezda_aft"
    # the episode ends at the port plane; False flies the paper's fixed horizon through it
    contact: bool = False
    # the attitude feels the Hill frame turn; False takes it as inertial, as the reference rollouts do
    hill_coupling: bool = False
    # nominal | meta: the reference chaser, or one drawn per episode from `meta`
    dynamics: str = "nominal"
    # most steps in an episode; exactly as many where contact is False
    max_steps: int = 65
    # normal | fixed: step lengths drawn per step, or all of `time_step_mean_s`
    time_step: str = "normal"
    # s, mean of the step length (reference rollouts)
    time_step_mean_s: float = 0.907
    # s, its standard deviation
    time_step_std_s: float = 0.077
    # s, shortest step
    time_step_min_s: float = 0.6
    # s, longest step
    time_step_max_s: float = 1.25
    # N, limit of each thrust component
    thrust_limit_N: float = 60.0
    # N·m, limit of each torque component
    torque_limit_Nm: float = 20.0
    # m, distance from the port beyond which the episode ends (outcome "volume"); contact tasks only
    volume_radius_m: float = 60.0
    corridor: CorridorConfig = field(default_factory=CorridorConfig)
    meta: MetaRanges = field(default_factory=MetaRanges)
    reward: RewardConfig = field(default_factory=RewardConfig)

    def __post_init__(self) -> None:
        get_initial_conditions(self.initial_conditions)
        get_port(self.port)
        one_of("dynamics", self.dynamics, DYNAMICS)
        one_of("time_step", self.time_step, TIME_STEP_MODES)
        if isinstance(self.max_steps, bool) or not isinstance(self.max_steps, int) or self.max_steps < 1:
            raise InputError("max_steps", self.max_steps, "an integer ≥ 1")
        _check_switches(self)
        for name in ("time_step_mean_s", "time_step_min_s", "thrust_limit_N", "torque_limit_Nm", "volume_radius_m"):
            if not (_is_finite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise InputError(name, getattr(self, name), "a finite number > 0")
        given = (self.time_step_std_s, self.time_step_min_s, self.time_step_max_s)
        if not (all(map(_is_finite, given)) and given[0] >= 0.0 and given[1] <= given[2]):
            raise InputError("time_step_std_s, time_step_min_s, time_step_max_s", given, "0 ≤ std, min ≤ max, finite")
        if self.time_step == "normal" and not given[1] <= self.time_step_mean_s <= given[2]:
            allowed = f"{given[1]:g} to {given[2]:g} s, the least and most that every step is clipped to"
            mend = "Give time_step_min_s and time_step_max_s too, or time_step=fixed."
            raise InputError("time_step_mean_s", self.time_step_mean_s, allowed, mend)
        for group in ("corridor", "meta", "reward"):
            _check_numbers(group, getattr(self, group))
        # so that the inertia is positive definite, whatever is drawn
        most = 0.5 * CHASER_INERTIA_kg_m2 * (1.0 - self.meta.inertia_fraction)
        if self.meta.inertia_product_kg_m2 > most:
            given = f"{self.meta.inertia_product_kg_m2:g} with meta.inertia_fraction {self.meta.inertia_fraction:g}"
            raise InputError("meta.inertia_product_kg_m2", given, f"at most {most:g}, half the least moment")
        if self.corridor.half_angle_deg >= 90.0:
            raise InputError("corridor.half_angle_deg", self.corridor.half_angle_deg, "0 < angle < 90")
        if self.reward.cruise_speed_m_s < self.reward.closing_speed_m_s:
            least = f"reward.closing_speed_m_s ({self.reward.closing_speed_m_s:g}) or more"
            raise InputError("reward.cruise_speed_m_s", self.reward.cruise_speed_m_s, least)


@dataclass(frozen=True)
class SpaceDockConfig(TaskConfig):
    """The gymnasium environment: a task, and what is seen and kept of it."""

    # the gymnasium id that this configuration was made under
    env_id: str = "SpaceDock-v0"
    # pixels_agent_pos | agent_pos | pixels; agent_pos renders nothing at all
    obs_type: str = "pixels_agent_pos"
    # the state carries the mass after the velocity, as the authors' published dataset does
    with_mass: bool = False
    # the state holds velocity and rates only: position and attitude are seen by the camera
    withhold_pose: bool = False
    camera: CameraConfig = field(default_factory=CameraConfig)
    # software | pyrender
    renderer: str = "software"
    # fixed | random | orbit | eclipse: the Sun, as in the paper, drawn per episode, moving with the orbit, or hidden
    sun: str = "fixed"
    # a mesh file (glb, obj, …) to show in place of the built-in station
    station_mesh: str | None = None
    # 16 numbers in brackets, row by row: 4×4 transform of that mesh's coordinates (m) into Hill axes at the port
    station_pose: tuple[float, ...] | None = None
    # folder into which each finished episode is written as a log; none are written without it
    log_dir: str | None = None
    # name of the policy that flies, kept in the logs
    label: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("obs_type", self.obs_type, OBS_TYPES)
        one_of("renderer", self.renderer, BACKENDS)
        one_of("sun", self.sun, SUNS)
        changed = [name for name, value in vars(self.meta).items() if value != getattr(MetaRanges, name)]
        if changed and self.dynamics != "meta":
            mend = "Add dynamics=meta, or take SpaceDockMeta-v0."
            raise InputError("meta", ", ".join(changed), "nothing where dynamics is nominal, which draws none", mend)
        pose = self.station_pose
        if pose is not None and not (isinstance(pose, tuple | list) and len(pose) == 16 and all(map(_is_finite, pose))):
            raise InputError("station_pose", pose, "16 finite numbers, a 4×4 matrix row by row")
        if self.camera.port not in (self.port, CameraConfig.port):
            raise InputError("camera.port", self.camera.port, f"{self.port}, the env's port", "Give port itself.")
        if self.camera.port != self.port:
            object.__setattr__(self, "camera", dataclasses.replace(self.camera, port=self.port))

    @property
    def uses_camera(self) -> bool:
        """Whether an observation holds a picture."""
        return self.obs_type != "agent_pos"

    @classmethod
    def from_options(cls, **options: Any) -> SpaceDockConfig:
        """Builds a configuration from keywords; nested ones (``camera``, ``reward``, …) may be dicts of overrides.

        Raises:
            InputError: an unknown option; the message lists the known ones.
        """
        return _build(cls, options, "env")


def _build(cls: type, options: dict[str, Any], path: str) -> Any:
    known = {f.name: f for f in dataclasses.fields(cls)}
    for name in options:
        if name not in known:
            raise InputError(f"{path}.{name}", options[name], f"one of the options {', '.join(sorted(known))}")
    values = dict(options)
    for name, value in options.items():
        group = known[name].default_factory
        if isinstance(value, list):
            values[name] = tuple(value)
        elif dataclasses.is_dataclass(group) and isinstance(value, dict):
            values[name] = _build(group, value, f"{path}.{name}")
        elif dataclasses.is_dataclass(group) and not isinstance(value, group):
            names = ", ".join(sorted(item.name for item in dataclasses.fields(group)))
            raise InputError(f"{path}.{name}", value, f"a dict of some of the options {names}")
    return cls(**values)


def _is_finite(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def _check_switches(config: Any, prefix: str = "") -> None:
    """What is on or off by default is on or off: the word "false" would count as true."""
    for item in dataclasses.fields(config):
        if isinstance(item.default, bool) and getattr(config, item.name) not in (True, False):
            raise InputError(prefix + item.name, getattr(config, item.name), "True | False")


# what is divided by, or is a speed that the profile is made of
_POSITIVE = re.compile(r"_(scale_m|scale_m_s|scale_deg|scale_deg_s|time_s|speed_m_s|power)$|^half_angle_deg$")


def _check_numbers(group: str, config: Any) -> None:
    """Every number of a nested configuration is finite and not negative, those of ``_POSITIVE`` and ranges above 0."""
    _check_switches(config, f"{group}.")
    for item in dataclasses.fields(config):
        name, value = f"{group}.{item.name}", getattr(config, item.name)
        if isinstance(item.default, bool):
            continue
        if isinstance(item.default, tuple):
            pair = isinstance(value, tuple | list) and len(value) == 2 and all(map(_is_finite, value))
            if not (pair and 0.0 < value[0] <= value[1]):
                raise InputError(name, value, "least and most: two finite numbers, 0 < least ≤ most")
        elif _POSITIVE.search(item.name) and not (_is_finite(value) and value > 0.0):
            raise InputError(name, value, "a finite number > 0")
        elif not (_is_finite(value) and value >= 0.0):
            raise InputError(name, value, "a finite number ≥ 0")
        elif item.name.endswith("_fraction") and value >= 1.0:
            raise InputError(name, value, "a fraction, 0 ≤ fraction < 1")
