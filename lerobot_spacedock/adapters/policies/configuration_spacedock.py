"""``--policy.type=spacedock_meta_rl | spacedock_mpc | spacedock_zem | spacedock_feedback``: their options."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.configs import PreTrainedConfig
from lerobot.optim import AdamWConfig
from lerobot.utils.constants import OBS_STATE

from lerobot_spacedock.adapters import command_line
from lerobot_spacedock.errors import InputError, in_range, one_of
from lerobot_spacedock.expert.checkpoint import existing_checkpoint
from lerobot_spacedock.expert.deadline import RANGES, Deadline
from lerobot_spacedock.physics.contact import get_port
from lerobot_spacedock.physics.frames import ACTION_DIM, OBSERVATION_NAMES, STATE_NAMES

WHOLE_STATE = "The experts need the whole state: --env.obs_type=agent_pos, and not SpaceDockVision-v0."
STATE_DIMS = (len(OBSERVATION_NAMES), len(STATE_NAMES))


@dataclass
class ExpertConfig(PreTrainedConfig):
    """What all experts share. They read ``observation.state`` and look at no picture."""

    # zvezda_aft | harmony_forward: where to dock; left out, the port of the command's env, whatever was saved
    port: str | None = None

    # experts are evaluated, not trained by lerobot-train; push one with policy.push_to_hub(repo_id)
    push_to_hub: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.port is None or command_line.env_decides("port"):
            self.port = command_line.env_option("port") or "zvezda_aft"
        with command_line.option_errors():
            get_port(self.port)
            shown = command_line.env_option("obs_type")
            if str(command_line.env_option("withhold_pose")).lower() == "true" or shown == "pixels":
                given = f"an env that shows {'pictures alone' if shown == 'pixels' else 'no position and attitude'}"
                raise InputError(f"--policy.type={self.type}", given, "an env that shows the whole state", WHOLE_STATE)

    def validate_features(self) -> None:
        """Raises InputError unless the state is observed whole and the action is a body wrench."""
        state, action = self.robot_state_feature, self.action_feature
        if state is None or tuple(state.shape) not in {(dim,) for dim in STATE_DIMS}:
            given = "none" if state is None else f"shape {tuple(state.shape)}"
            raise InputError(
                f"{OBS_STATE} for --policy.type={self.type}",
                given,
                f"{' or '.join(map(str, STATE_DIMS))} values: {', '.join(OBSERVATION_NAMES)}, the mass at choice",
                WHOLE_STATE,
            )
        if action is None or tuple(action.shape) != (ACTION_DIM,):
            given = "none" if action is None else f"shape {tuple(action.shape)}"
            raise InputError(f"action for --policy.type={self.type}", given, f"({ACTION_DIM},), thrust and torque")

    @property
    def observation_delta_indices(self) -> None:
        return None

    @property
    def action_delta_indices(self) -> list[int]:
        return [0]

    @property
    def reward_delta_indices(self) -> None:
        return None

    def get_optimizer_preset(self) -> AdamWConfig:
        return AdamWConfig()

    def get_scheduler_preset(self) -> None:
        return None


@PreTrainedConfig.register_subclass("spacedock_meta_rl")
@dataclass
class SpaceDockMetaRlConfig(ExpertConfig):
    """The recurrent meta-RL policy."""

    # .safetensors of spacedock train-expert (its .json beside it), or the name of another that ships: gentle, slower,
    # for docking without a deadline; hold, which stops at the port within the 65 steps of SpaceDock-v0. Left out, the
    # one that passes the port after them
    checkpoint: str | None = None
    # sample the commands as in training, instead of flying their mean
    stochastic: bool = False
    # clear the memory before every step: what the memory is worth
    forgetful: bool = False
    # the network's shape and scales, filled in from the checkpoint; leave them out
    lstm_size: int | None = None
    hidden_sizes: tuple[int, ...] | None = None
    thrust_scale_N: float | None = None
    torque_scale_Nm: float | None = None
    thrust_limit_N: float | None = None
    torque_limit_Nm: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        with command_line.option_errors():
            existing_checkpoint(self.checkpoint)

    @property
    def network_options(self) -> dict[str, object]:
        """Shape and scales that are known; empty for a policy whose checkpoint has not been read yet."""
        names = (
            "lstm_size",
            "hidden_sizes",
            "thrust_scale_N",
            "torque_scale_Nm",
            "thrust_limit_N",
            "torque_limit_Nm",
        )
        options = {name: getattr(self, name) for name in names}
        return {name: value for name, value in options.items() if value is not None}


@dataclass
class ClassicalConfig(ExpertConfig):
    """What the classical controllers share."""

    # the attitude model flown in: true where rates are inertial (the contact ids); left out, that of the command's env,
    # whatever was saved
    hill_coupling: bool | None = None
    # the law's thrust is divided by an estimate of how much of it acts: the experts W_adaptive (--policy.law=W) and
    # mpc_adaptive (--policy.mode=receding)
    adaptive: bool = False

    @property
    def step_s(self) -> float:
        """s, mean length of a step, which the estimate counts on: the one that the command's env is given, if any."""
        return float(command_line.env_option("time_step_mean_s") or Deadline.step_s)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hill_coupling is None or command_line.env_decides("hill_coupling"):
            self.hill_coupling = str(command_line.env_option("hill_coupling")).lower() == "true"


@dataclass
class DeadlineConfig(ClassicalConfig):
    """What the controllers with a clock share."""

    # step at which to arrive; 65 is the paper's horizon
    deadline_steps: int = Deadline.steps
    # s, expected length of a step, as the controller sees no clock; left out, that of the command's env, whatever was
    # saved
    deadline_step_s: float | None = None
    # m/s, closing speed at arrival (IDSS: 0.05 to 0.10); 0 stops at the port
    closing_speed_m_s: float = Deadline.closing_speed_m_s

    @property
    def step_s(self) -> float:
        return float(command_line.env_option("time_step_mean_s") or self.deadline_step_s)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.deadline_step_s is None or command_line.env_decides("deadline_step_s"):
            self.deadline_step_s = super().step_s
        with command_line.option_errors():
            in_range("--policy.deadline_steps", self.deadline_steps, *RANGES["steps"])
            in_range("--policy.deadline_step_s", self.deadline_step_s, *RANGES["step_s"])
            in_range("--policy.closing_speed_m_s", self.closing_speed_m_s, *RANGES["closing_speed_m_s"])


@PreTrainedConfig.register_subclass("spacedock_mpc")
@dataclass
class SpaceDockMpcConfig(DeadlineConfig):
    """Minimum-energy model-predictive control."""

    # fixed | receding: arrive at the deadline, or whenever energy and time together cost least
    mode: str = "fixed"

    def __post_init__(self) -> None:
        super().__post_init__()
        with command_line.option_errors():
            one_of("--policy.mode", self.mode, ("fixed", "receding"))


@PreTrainedConfig.register_subclass("spacedock_zem")
@dataclass
class SpaceDockZemConfig(DeadlineConfig):
    """ZEM/ZEV guidance with quaternion feedback."""


@PreTrainedConfig.register_subclass("spacedock_feedback")
@dataclass
class SpaceDockFeedbackConfig(ClassicalConfig):
    """The time-invariant state-feedback law that demonstrations can be made with."""

    # W | V | Q: smoothest, fastest, between
    law: str = "W"

    def __post_init__(self) -> None:
        super().__post_init__()
        with command_line.option_errors():
            one_of("--policy.law", self.law, ("W", "V", "Q"))
