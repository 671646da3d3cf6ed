"""Every option of the environments, with its meaning; YAML and flags hold overrides only."""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.scenario_config import MetaRanges

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
