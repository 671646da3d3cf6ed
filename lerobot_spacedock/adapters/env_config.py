"""``--env.type=spacedock``: the environments as LeRobot sees them; every option is ``--env.<option>``."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.envs.utils import freeze_after_episode_end
from lerobot.processor import PolicyProcessorPipeline
from lerobot.processor.pipeline import ObservationProcessorStep
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE, OBS_STR

from lerobot_spacedock.adapters import command_line
from lerobot_spacedock.adapters.command_line import option_errors
from lerobot_spacedock.adapters.evaluation_log import EvaluationLog, evaluation_folder
from lerobot_spacedock.adapters.policy_record import policy_record
from lerobot_spacedock.adapters.training_scalars import log_training_scalars
from lerobot_spacedock.adapters.vector_env import LoggingAsyncVectorEnv, LoggingSyncVectorEnv
from lerobot_spacedock.camera.config import CameraConfig, SensorConfig
from lerobot_spacedock.env.config import CorridorConfig, SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.scenario_config import MetaRanges
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.frames import ACTION_DIM

DEFAULT_LOG_FOLDER = "episodes"  # inside --output_dir


@dataclass(frozen=True)
class SensorOptions(SensorConfig):
    """``SensorConfig`` whose refusals LeRobot's commands print as one line."""

    def __post_init__(self) -> None:
        with option_errors():
            super().__post_init__()


@dataclass(frozen=True)
class CameraOptions(CameraConfig):
    """``CameraConfig`` whose refusals LeRobot's commands print as one line."""

    sensor: SensorOptions = field(default_factory=SensorOptions)

    def __post_init__(self) -> None:
        with option_errors():
            super().__post_init__()

    def plain(self) -> CameraConfig:
        """The same as the rest of the package has it."""
        options = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return CameraConfig(**options | {"sensor": SensorConfig(**vars(self.sensor))})


@EnvConfig.register_subclass("spacedock")
@dataclass
class SpaceDockEnvConfig(EnvConfig):
    """Spacecraft docking with the International Space Station."""

    # gymnasium id: SpaceDock-v0 | SpaceDockContact-v0 | SpaceDockMeta-v0 | SpaceDockVision-v0. spacedock demos flies
    # SpaceDockContact-v0 unless --env_id names another
    task: str | None = "SpaceDock-v0"
    # frames a second of the evaluation videos, one a step (the task's steps vary in length, about 0.9 s each); 1 where
    # an evaluation is recorded as a dataset
    fps: int = 1

    # same | random | same_dispersed | wide: where episodes start
    initial_conditions: str = "same"
    # pixels_agent_pos | agent_pos | pixels; agent_pos renders nothing but the videos that LeRobot asks for
    obs_type: str = "pixels_agent_pos"
    # the camera: --env.camera.height, --env.camera.width, ...
    camera: CameraOptions = field(default_factory=CameraOptions)
    # software | pyrender
    renderer: str = "software"
    # fixed | random | orbit | eclipse: the Sun, as in the paper, drawn per episode, moving with the orbit, or hidden
    sun: str = "fixed"
    # a mesh file (glb, obj, ...) to show in place of the built-in station
    station_mesh: str | None = None
    # 16 numbers in brackets, row by row: 4x4 transform of that mesh's coordinates (m) into Hill axes at the port
    station_pose: tuple[float, ...] | None = None
    # zvezda_aft | harmony_forward
    port: str = "zvezda_aft"
    # the state carries the mass after the velocity, as the authors' published dataset does
    with_mass: bool = False
    # folder for one log an episode and eval_metrics.jsonl; left out, OUTPUT_DIR/episodes where --output_dir is given
    log_dir: str | None = None
    # in training, the means of each evaluation become scalars: TensorBoard in LOG_DIR/tensorboard, and wandb where on
    scalars: bool = True
    # name of the policy that flies, kept in the logs
    label: str | None = None

    # the episode ends at the port plane; false flies a fixed horizon through it (left out: as the task's id says)
    contact: bool | None = None
    # the attitude feels the Hill frame turn; false takes it as inertial (left out: as the task's id says)
    hill_coupling: bool | None = None
    # nominal | meta: the reference chaser, or one drawn per episode from meta (left out: as the task's id says)
    dynamics: str | None = None
    # most steps in an episode; exactly as many where contact is false (left out: as the task's id says)
    max_steps: int | None = None
    # the state holds velocity and rates only: the pose is seen by the camera (left out: as the task's id says)
    withhold_pose: bool | None = None

    # normal | fixed: step lengths drawn per step, or all of time_step_mean_s
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
    # m, distance from the port beyond which the episode ends; contact tasks only
    volume_radius_m: float = 60.0
    # the approach corridor, leaving which ends the episode; contact tasks only
    corridor: CorridorConfig = field(default_factory=CorridorConfig)
    # the distribution of chasers and sensors where dynamics is meta
    meta: MetaRanges = field(default_factory=MetaRanges)
    # weights and scales of the reward
    reward: RewardConfig = field(default_factory=RewardConfig)

    def __post_init__(self) -> None:
        config = self.space_dock_config()
        self.features = {ACTION: PolicyFeature(type=FeatureType.ACTION, shape=(ACTION_DIM,))}
        if not (isinstance(self.fps, int) and self.fps >= 1):
            with option_errors():
                raise InputError("--env.fps", self.fps, "1 or more")
        if config.uses_camera:
            self._check_picture_size(config.camera)
            shape = (config.camera.height, config.camera.width, 3)
            self.features[f"{OBS_IMAGES}.camera"] = PolicyFeature(type=FeatureType.VISUAL, shape=shape)
        if config.obs_type != "pixels":
            self.features[OBS_STATE] = PolicyFeature(type=FeatureType.STATE, shape=(_observation_dim(config),))
        # Named as in the datasets, so that what --eval.recording=true writes can be trained on as it is.
        self.features_map = {name: name for name in self.features}

    @property
    def gym_id(self) -> str:
        return str(self.task)

    @property
    def package_name(self) -> str:
        return "lerobot_spacedock"

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Keywords for ``gymnasium.make``: every option but those left to the id."""
        names = {f.name for f in dataclasses.fields(SpaceDockConfig)} - {"env_id"}
        options = {name: getattr(self, name) for name in sorted(names)}
        if isinstance(self.camera, CameraOptions):
            options["camera"] = self.camera.plain()
        return {name: value for name, value in options.items() if value is not None}

    def space_dock_config(self) -> SpaceDockConfig:
        """The environment's configuration that these options make.

        Raises:
            OptionError: an unknown task, or an option out of its range.
        """
        with option_errors():
            command_line.refuse_missing_checkpoint()
            if self.task not in ENV_IDS:
                raise InputError("--env.task", self.task, " | ".join(ENV_IDS))
            return SpaceDockConfig.from_options(env_id=self.task, **(ENV_IDS[self.task] | self.gym_kwargs))

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, gym.vector.VectorEnv]]:
        """``{"spacedock": {0: vector env}}``, as LeRobot's evaluation takes it.

        Raises:
            InputError: the log folder holds the episodes of another evaluation.
        """
        config = self.space_dock_config()
        if config.uses_camera:
            self._check_picture_size(config.camera)  # again: by now LeRobot has fetched what a hub repository holds
        folder = self._log_folder()
        if folder is None and command_line.running_command() is not None:
            print(
                "No episode logs: they go to OUTPUT_DIR/episodes with --output_dir, or to --env.log_dir.",
                file=sys.stderr,
            )
        options = self.gym_kwargs | {"log_dir": None if folder is None else str(folder)}
        options["disable_env_checker"] = self.disable_env_checker
        one = freeze_after_episode_end(partial(make_env, self.gym_id, options))
        training = command_line.running_command() == "lerobot_train"
        at_end = log_training_scalars if training and self.scalars else None
        log = (
            None
            if folder is None
            else EvaluationLog(folder, n_envs, command_line.num_episodes(), policy=policy_record, at_end=at_end)
        )
        many = LoggingAsyncVectorEnv if use_async_envs and n_envs > 1 else LoggingSyncVectorEnv
        env = many([one] * n_envs, log=log)
        env.metadata = env.metadata | {"render_fps": self.fps}
        return {self.type: {0: env}}

    def get_env_processors(self) -> tuple[PolicyProcessorPipeline, PolicyProcessorPipeline]:
        return PolicyProcessorPipeline(steps=[DropRecordedNames()]), PolicyProcessorPipeline(steps=[])

    def _check_picture_size(self, camera: CameraConfig) -> None:
        own = (camera.height, camera.width)
        with option_errors():
            trained = command_line.trained_picture_size()
            if trained is not None and trained != own:
                raise InputError(
                    "--env.camera",
                    f"{own[0]} x {own[1]} pixels",
                    f"{trained[0]} x {trained[1]}, the pictures that the policy learns from",
                    f"Add --env.camera.height={trained[0]} --env.camera.width={trained[1]}.",
                )

    def _log_folder(self) -> Path | None:
        training = command_line.running_command() == "lerobot_train"
        if self.log_dir is not None:
            return evaluation_folder(Path(self.log_dir).expanduser(), numbered=training)
        output_dir = command_line.output_dir()
        return None if output_dir is None else evaluation_folder(output_dir / DEFAULT_LOG_FOLDER, numbered=training)


class DropRecordedNames(ObservationProcessorStep):
    """Takes away again what the vector envs add for recordings, before a policy sees it."""

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in observation.items() if name != f"{OBS_STR}.{OBS_STATE}"}

    def transform_features(self, features: dict) -> dict:
        return features


def _observation_dim(config: SpaceDockConfig) -> int:
    from lerobot_spacedock.env.spacedock import observation_names  # loads numba: not for discovery

    return len(observation_names(config))


def make_env(gym_id: str, options: dict[str, Any]) -> gym.Env:
    """One environment; a function of its own so that worker processes can import it."""
    import lerobot_spacedock  # noqa: F401 - registers the ids in a worker

    return gym.make(gym_id, render_mode="rgb_array", **options)
