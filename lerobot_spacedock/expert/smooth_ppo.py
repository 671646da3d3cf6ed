"""PPO whose loss also holds the change of the mean command from step to step.

The reward charges every newton by which the flown command changes, but exploration drowns that: a mean that changes by
2 N under noise of 8 N costs hardly more than one that stands still, so its gradient all but vanishes. The mean itself
is differentiable: its change along the sequences flown goes into the loss directly, at the same price.

Sources: Schulman et al., "Proximal Policy Optimization Algorithms", arXiv:1707.06347 (2017); Mysore et al.,
"Regularizing Action Policies for Smooth Control with Reinforcement Learning", ICRA 2021 (temporal smoothness).
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from lerobot_spacedock.expert.rsl import PPO, RolloutStorage

LEARNING_RATE_RANGE = (1e-5, 1e-2)
LEARNING_RATE_STEP = 1.5


class SmoothPPO(PPO):
    """rsl_rl's PPO with an update of its own.

    Attributes:
        mean_change_coef: loss per N (and N·m) of mean norm of the change of the mean command.
        action_scale: (6,) N and N·m per unit of output.
        action_limits: (6,) N and N·m; what lies beyond flies as the limit, and costs nothing when it changes.
    """

    mean_change_coef: float = 0.0
    action_scale: Tensor
    action_limits: Tensor

    def update(self) -> dict[str, float]:
        """Several passes over the stored episodes; returns mean losses and clears the storage."""
        make_batches = self.storage.recurrent_mini_batch_generator if self.actor.is_recurrent else self._whole_episodes
        totals: dict[str, float] = {}
        for batch in make_batches(self.num_mini_batches, self.num_learning_epochs):
            losses = self._losses(batch)
            loss = (
                losses["surrogate"]
                + self.value_loss_coef * losses["value"]
                + self.mean_change_coef * losses["mean_change"]
            )
            self.optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.actor.parameters(), self.max_grad_norm)
            torch.nn.utils.clip_grad_norm_(self.critic.parameters(), self.max_grad_norm)
            self.optimizer.step()
            for name, value in losses.items():
                totals[name] = totals.get(name, 0.0) + value.item()
        observations = self.storage.observations.flatten(0, 1)
        self.actor.update_normalization(observations)
        self.critic.update_normalization(observations)
        self.storage.clear()
        count = self.num_mini_batches * self.num_learning_epochs
        return {name: value / count for name, value in totals.items()}

    def _losses(self, batch: RolloutStorage.Batch) -> dict[str, Tensor]:
        masks, memory = batch.masks, batch.hidden_states[0]
        self.actor(batch.observations, masks=masks, hidden_state=memory, stochastic_output=True)
        log_prob = self.actor.get_output_log_prob(batch.actions)
        self._adapt_learning_rate(batch)
        advantages = batch.advantages.squeeze(-1)
        ratio = torch.exp(log_prob - batch.old_actions_log_prob.squeeze(-1))
        clipped = ratio.clamp(1.0 - self.clip_param, 1.0 + self.clip_param)
        surrogate = -torch.minimum(advantages * ratio, advantages * clipped).mean()

        values = self.critic(batch.observations, masks=masks, hidden_state=batch.hidden_states[1])
        near = batch.values + (values - batch.values).clamp(-self.clip_param, self.clip_param)
        value = torch.maximum((values - batch.returns) ** 2, (near - batch.returns) ** 2).mean()

        mean = (self.actor.output_mean * self.action_scale).clamp(-self.action_limits, self.action_limits)
        # the small constant keeps the norm differentiable where nothing changes
        change = torch.sqrt((mean[1:] - mean[:-1]).square().sum(dim=-1) + 1e-4).mean()
        return {"surrogate": surrogate, "value": value, "mean_change": change}

    @torch.no_grad()
    def _adapt_learning_rate(self, batch: RolloutStorage.Batch) -> None:
        """Keeps the step of an update near ``desired_kl``."""
        kl = self.actor.get_kl_divergence(batch.old_distribution_params, self.actor.output_distribution_params)
        kl = kl.mean().item()
        least, most = LEARNING_RATE_RANGE
        if kl > 2.0 * self.desired_kl:
            self.learning_rate = max(least, self.learning_rate / LEARNING_RATE_STEP)
        elif 0.0 < kl < 0.5 * self.desired_kl:
            self.learning_rate = min(most, self.learning_rate * LEARNING_RATE_STEP)
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate

    def _whole_episodes(self, parts: int, epochs: int) -> Iterator[RolloutStorage.Batch]:
        """What the recurrent generator gives, for an actor without memory: some environments, all their steps."""
        storage = self.storage
        size = storage.num_envs // parts
        for _ in range(epochs):
            for order in torch.randperm(storage.num_envs, device=self.device)[: size * parts].split(size):
                yield RolloutStorage.Batch(
                    observations=storage.observations[:, order],
                    actions=storage.actions[:, order],
                    values=storage.values[:, order],
                    advantages=storage.advantages[:, order],
                    returns=storage.returns[:, order],
                    old_actions_log_prob=storage.actions_log_prob[:, order],
                    old_distribution_params=tuple(p[:, order] for p in storage.distribution_params),
                )
