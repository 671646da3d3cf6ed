"""Every option of ``spacedock train-expert``, with its meaning; YAML and flags hold overrides only."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.scenario_config import MetaRanges, get_initial_conditions
from lerobot_spacedock.errors import InputError


def _check(group: str, config: object, allowed: str, fine: Callable[[float], bool], *names: str) -> None:
    """Raises InputError for the first of the named options that is not ``fine``, or not a finite number."""
    for name in names:
        value = getattr(config, name)
        if not (math.isfinite(value) and fine(value)):
            raise InputError(group + name, value, allowed)


def _check_sizes(name: str, sizes: list[int]) -> None:
    if not sizes or min(sizes) < 1:
        raise InputError(name, sizes, "at least one positive size")


@dataclass(frozen=True)
class TaskShare:
    """One kind of task in the training distribution."""

    # fraction of the environments that fly it
    share: float = 1.0
    # same | random | same_dispersed | wide
    initial_conditions: str = "wide"
    # nominal | meta
    dynamics: str = "meta"
    # the attitude feels the Hill frame turn (the contact ids do, SpaceDock-v0 does not)
    hill_coupling: bool = True
    # random shoves of the chaser during the episode, so that the policy knows its way back
    shoves: bool = False

    def __post_init__(self) -> None:
        get_initial_conditions(self.initial_conditions)
        if not 0.0 < self.share <= 1.0:
            raise InputError("tasks.share", self.share, "a fraction above 0 and at most 1")
        if self.dynamics not in ("nominal", "meta"):
            raise InputError("tasks.dynamics", self.dynamics, "nominal | meta")


@dataclass(frozen=True)
class ShoveConfig:
    """Shoves: what a disturbance within one step does to the chaser; the policy sees its effect only."""

    # probability per step
    probability: float = 0.06
    # m/s, standard deviation of the change of velocity, each axis: 40 N over a step of 0.9 s
    velocity_m_s: float = 0.036
    # deg/s, standard deviation of the change of rate, each axis: 3 N·m over a step of 0.9 s
    rate_deg_s: float = 0.23

    def __post_init__(self) -> None:
        _check("shoves.", self, "from 0 to 1", lambda value: 0.0 <= value <= 1.0, "probability")
        _check("shoves.", self, "a number ≥ 0", lambda value: value >= 0.0, "velocity_m_s", "rate_deg_s")


@dataclass(frozen=True)
class ActorConfig:
    """Shape of the actor, units of its output."""

    # hidden units of the LSTM; 0 trains a feed-forward actor instead
    lstm_size: int = 64
    # hidden layers of the MLP behind it
    hidden_sizes: list[int] = field(default_factory=lambda: [64])
    # N per unit of output
    thrust_scale_N: float = 40.0
    # N·m per unit of output
    torque_scale_Nm: float = 1.5
    # N, the policy's own limit of each thrust component; the gentlest that is strong enough makes the smoothest flight
    thrust_limit_N: float = 40.0
    # N·m, the same for torque
    torque_limit_Nm: float = 20.0
    # standard deviation of the first actions, in units of output
    initial_std: float = 0.5

    def __post_init__(self) -> None:
        _check("actor.", self, "an integer ≥ 0; 0 is feed-forward", lambda value: value >= 0, "lstm_size")
        _check_sizes("actor.hidden_sizes", self.hidden_sizes)
        scales = ("thrust_scale_N", "torque_scale_Nm", "thrust_limit_N", "torque_limit_Nm", "initial_std")
        _check("actor.", self, "a number > 0", lambda value: value > 0.0, *scales)


@dataclass(frozen=True)
class PpoConfig:
    """Proximal policy optimisation (rsl-rl)."""

    # passes over each batch of episodes
    epochs: int = 4
    # parts of the batch per pass
    mini_batches: int = 4
    # how far an update may change the probability of an action: by this share, up or down
    clip: float = 0.2
    # discount per step
    gamma: float = 0.99
    # trace decay of the advantages
    gae_lambda: float = 0.95
    # at the start; adapted to `desired_kl` from then on
    learning_rate: float = 1e-3
    # how far the policy may move in an update
    desired_kl: float = 0.01
    # the same at the end of the training: smaller steps settle the last millimetres
    final_desired_kl: float = 0.004
    # loss per N by which the mean command changes from step to step, …
    mean_change_coef: float = 0.0
    # … nothing before this fraction of the training (a policy that may not change its command never starts to fly),
    # then growing until the reward's smoothness weight has grown
    mean_change_from: float = 0.0
    # bound on the standard deviation of the exploration when the smoothness weight has grown, in units of output, …
    std_ceiling: float = 1.0
    # … and at the end of the training
    final_std_ceiling: float = 1.0
    # a longer gradient is cut to this length
    max_grad_norm: float = 1.0
    # hidden layers of the critic
    critic_hidden_sizes: list[int] = field(default_factory=lambda: [128, 128])

    def __post_init__(self) -> None:
        _check("ppo.", self, "an integer ≥ 1", lambda value: value >= 1, "epochs", "mini_batches")
        steps = ("clip", "learning_rate", "desired_kl", "final_desired_kl", "max_grad_norm")
        _check("ppo.", self, "a number > 0", lambda value: value > 0.0, *steps, "std_ceiling", "final_std_ceiling")
        shares = ("gamma", "gae_lambda", "mean_change_from")
        _check("ppo.", self, "from 0 to 1", lambda value: 0.0 <= value <= 1.0, *shares)
        _check("ppo.", self, "a number ≥ 0", lambda value: value >= 0.0, "mean_change_coef")
        _check_sizes("ppo.critic_hidden_sizes", self.critic_hidden_sizes)


def default_tasks() -> list[TaskShare]:
    """Mostly the meta distribution from wide starts; the paper's exact chaser too, in both attitude models."""
    return [
        TaskShare(0.375, "wide", "meta", True),
        TaskShare(0.125, "wide", "meta", True, shoves=True),
        TaskShare(0.125, "same", "meta", True),
        TaskShare(0.25, "random", "nominal", False),
        TaskShare(0.125, "same", "nominal", False),
    ]


@dataclass
class TrainExpertConfig:
    """Recurrent PPO on the batched simulator, over a distribution of chasers and starts."""

    # where checkpoints, logs and the policy go; must not exist, unless `resume` is given
    output_dir: str = "outputs/expert/meta_rl"
    # go on from the last checkpoint in `output_dir`, exactly as if it had never stopped
    resume: bool = False
    # seed of weights, tasks and exploration
    seed: int = 0
    # cpu | cuda | cuda:1 …: where the networks are; the simulator is on the CPU
    device: str = "cpu"
    # torch threads on the CPU; more than one rarely pays at this size
    threads: int = 1
    # environment steps to train on
    interactions: int = 8_000_000
    # chasers flown at once; each iteration is one whole episode of each
    num_envs: int = 256
    # steps in a training episode; it flies on through the port, so that nothing ends it early
    episode_steps: int = 80
    # the training distribution, best given in a file (configs/expert_meta_rl.yaml): a list of share,
    # initial_conditions (same | random | same_dispersed | wide), dynamics (nominal | meta), hill_coupling and shoves
    tasks: list[TaskShare] = field(default_factory=default_tasks)
    shoves: ShoveConfig = field(default_factory=ShoveConfig)
    meta: MetaRanges = field(default_factory=MetaRanges)
    reward: RewardConfig = field(default_factory=RewardConfig)
    # weight of the reward's `smoothness` at the start; it grows to its value in `reward` exponentially, …
    smoothness_start: float = 0.003
    # … over this fraction of the training: first to fly, then to fly smoothly
    smoothness_ramp: float = 0.7
    # percent: whenever fewer validation episodes than this end in the IDSS box, the price of smoothness halves, and it
    # grows back while enough do; 0 leaves it alone
    smoothness_guard_percent: float = 0.0
    actor: ActorConfig = field(default_factory=ActorConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)
    # iterations between checkpoints
    checkpoint_every: int = 25
    # iterations between evaluations on validation episodes
    evaluate_every: int = 25
    # validation episodes of each kind
    evaluation_episodes: int = 256
    # stop after this many iterations, keeping a checkpoint to resume from; 0: at the end only
    stop_after: int = 0
    # folder of a LeRobot dataset, or the repo id of a cached one: imitate it first, then go on with PPO (warm start);
    # or the checkpoint folder of another training: start from its networks
    init_from: str | None = None
    # passes over the demonstrations in the warm start
    init_epochs: int = 100
    # standard deviation of the actions after the warm start, in units of output
    init_std: float = 0.1
    # iterations after the warm start in which the critic alone learns
    init_critic_iterations: int = 10

    def __post_init__(self) -> None:
        TaskConfig(meta=self.meta, reward=self.reward)  # refuses here what no task can fly, before a folder is made
        total = sum(task.share for task in self.tasks)
        if not self.tasks or abs(total - 1.0) > 1e-6:
            raise InputError("tasks", f"shares that add up to {total:g}", "shares that add up to 1")
        counts = ("interactions", "num_envs", "episode_steps", "checkpoint_every", "evaluate_every", "threads")
        counts += ("evaluation_episodes", "init_epochs")
        _check("", self, "an integer ≥ 1", lambda value: value >= 1, *counts)
        _check("", self, "an integer ≥ 0", lambda value: value >= 0, "stop_after", "init_critic_iterations")
        _check("", self, "an integer from 0 to 2^63 - 1", lambda value: 0 <= value < 2**63, "seed")
        if self.num_envs % self.ppo.mini_batches:
            raise InputError("num_envs", self.num_envs, f"a multiple of ppo.mini_batches ({self.ppo.mini_batches})")
        if not 0.0 <= self.smoothness_ramp <= 1.0 or not self.smoothness_start > 0.0:
            raise InputError(
                "smoothness_ramp, smoothness_start",
                (self.smoothness_ramp, self.smoothness_start),
                "a fraction from 0 to 1, and a positive weight",
            )
        if not 0.0 <= self.smoothness_guard_percent <= 100.0:
            raise InputError("smoothness_guard_percent", self.smoothness_guard_percent, "from 0 to 100")
        if not 0.005 <= self.init_std <= 1.0:
            raise InputError("init_std", self.init_std, "from 0.005 to 1")
        for task, count in zip(self.tasks, self.environments(), strict=True):
            if count == 0:
                raise InputError("num_envs", self.num_envs, f"enough that a share of {task.share:g} has one at least")
        self._refuse_unused()

    def _refuse_unused(self) -> None:
        """Raises InputError for an option that is given and changes nothing."""
        unused = []
        if self.init_from is None:
            for name in ("init_epochs", "init_std", "init_critic_iterations"):
                unused.append((name, getattr(TrainExpertConfig, name), "--init_from"))
        if not any(task.shoves for task in self.tasks):
            unused.append(("shoves", ShoveConfig(), "a task with shoves"))
        if all(task.dynamics == "nominal" for task in self.tasks):
            unused.append(("meta", MetaRanges(), "a task with dynamics: meta"))
        for name, default, needed in unused:
            value = getattr(self, name)
            if value != default:
                raise InputError(f"--{name}", value, f"the default, without {needed}", "It would change nothing.")
        if self.reward.terminal != RewardConfig.terminal:
            mend = "Nothing ends an episode of the training, so none is paid."
            raise InputError("--reward.terminal", self.reward.terminal, f"the default, {RewardConfig.terminal:g}", mend)

    def environments(self) -> list[int]:
        """How many of ``num_envs`` fly each of the tasks."""
        shares = list(itertools.accumulate(task.share for task in self.tasks))
        edges = [0, *(round(share / shares[-1] * self.num_envs) for share in shares)]
        return [end - begin for begin, end in itertools.pairwise(edges)]

    @property
    def iterations(self) -> int:
        """Updates in the whole training."""
        return max(1, round(self.interactions / (self.num_envs * self.episode_steps)))
