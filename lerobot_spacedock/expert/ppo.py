"""rsl-rl's pieces put together: recurrent actor, privileged critic, PPO; and one iteration of learning."""

from __future__ import annotations

import math

import torch

from lerobot_spacedock.expert.rsl import MLPModel, RNNModel, RolloutStorage, TensorDict
from lerobot_spacedock.expert.smooth_ppo import SmoothPPO
from lerobot_spacedock.expert.train_config import TrainExpertConfig
from lerobot_spacedock.expert.training_tasks import TrainingTasks
from lerobot_spacedock.physics.frames import ACTION_DIM

_STD_RANGE = (0.005, 1.0)


def make_ppo(config: TrainExpertConfig, observations: TensorDict) -> SmoothPPO:
    """The algorithm with fresh networks; torch's global generator is seeded, since rsl_rl samples from it."""
    torch.manual_seed(config.seed)
    groups = {"actor": ["actor"], "critic": ["critic"]}
    actor, ppo = config.actor, config.ppo
    distribution = {
        "class_name": "GaussianDistribution",
        "init_std": actor.initial_std,
        "std_type": "log",
        "std_range": _STD_RANGE,
    }
    common = (observations, groups, "actor", ACTION_DIM, list(actor.hidden_sizes), "elu", True, distribution)
    if actor.lstm_size:
        actor_model = RNNModel(*common, rnn_type="lstm", rnn_hidden_dim=actor.lstm_size, rnn_num_layers=1)
    else:
        actor_model = MLPModel(*common)
    critic_model = MLPModel(observations, groups, "critic", 1, list(ppo.critic_hidden_sizes), "elu", True)
    storage = RolloutStorage(
        "rl", config.num_envs, config.episode_steps, observations, [ACTION_DIM], device=config.device
    )
    algorithm = SmoothPPO(
        actor_model,
        critic_model,
        storage,
        num_learning_epochs=ppo.epochs,
        num_mini_batches=ppo.mini_batches,
        clip_param=ppo.clip,
        gamma=ppo.gamma,
        lam=ppo.gae_lambda,
        entropy_coef=0.0,
        learning_rate=ppo.learning_rate,
        max_grad_norm=ppo.max_grad_norm,
        schedule="adaptive",
        desired_kl=ppo.desired_kl,
        device=config.device,
    )
    scale = [actor.thrust_scale_N] * 3 + [actor.torque_scale_Nm] * 3
    limits = [actor.thrust_limit_N] * 3 + [actor.torque_limit_Nm] * 3
    algorithm.action_scale = torch.tensor(scale, device=config.device)
    algorithm.action_limits = torch.tensor(limits, device=config.device)
    algorithm.train_mode()
    return algorithm


def set_std_ceiling(algorithm: SmoothPPO, ceiling: float) -> None:
    """Bounds the standard deviation of the exploration from above, in units of output."""
    least, _ = _STD_RANGE
    algorithm.actor.distribution.log_std_range = [math.log(least), math.log(max(ceiling, least))]


def clear_memory(algorithm: SmoothPPO, count: int) -> None:
    """Gives the actor an empty memory: zeros, stored with the first step like any other."""
    if algorithm.actor.is_recurrent:
        lstm = algorithm.actor.rnn.rnn
        zeros = [torch.zeros(1, count, lstm.hidden_size, device=algorithm.device) for _ in range(2)]
        algorithm.actor.reset(hidden_state=tuple(zeros))


@torch.no_grad()
def collect(algorithm: SmoothPPO, tasks: TrainingTasks, iteration: int, steps: int) -> float:
    """Flies one episode in every environment into the storage; returns their mean undiscounted return."""
    observations = tasks.reset(iteration).to(algorithm.device)
    count = observations.batch_size[0]
    clear_memory(algorithm, count)
    total = 0.0
    for step in range(steps):
        observations, rewards = tasks.step(algorithm.act(observations))
        observations, rewards = observations.to(algorithm.device), rewards.to(algorithm.device)
        total += rewards.mean().item()
        last = step == steps - 1
        if last:
            # cut, not ended: what would follow is worth the critic's estimate of the state reached
            rewards = rewards + algorithm.gamma * algorithm.critic(observations).squeeze(1)
        dones = torch.full((count,), float(last), device=algorithm.device)
        algorithm.process_env_step(observations, rewards, dones, {})
    algorithm.compute_returns(observations)
    return total
