"""Milliseconds of one inference and seconds of one training step of an ACT checkpoint with pictures, on one thread.

``OMP_NUM_THREADS=1 python benchmarks/act_speed.py CHECKPOINT/pretrained_model``
"""

from __future__ import annotations

import sys
import time

import torch
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.utils.constants import ACTION


def random_batch(policy: ACTPolicy, size: int) -> dict[str, torch.Tensor]:
    """Normalised inputs and targets of the policy's own shapes."""
    config = policy.config
    batch = {name: torch.randn(size, *feature.shape) for name, feature in config.input_features.items()}
    batch[ACTION] = torch.randn(size, config.chunk_size, *config.output_features[ACTION].shape)
    return batch | {f"{ACTION}_is_pad": torch.zeros(size, config.chunk_size, dtype=torch.bool)}


def main() -> None:
    torch.set_num_threads(1)
    policy = ACTPolicy.from_pretrained(sys.argv[1])
    one, batch = random_batch(policy, 1), random_batch(policy, 16)
    for _ in range(5):
        policy.predict_action_chunk(one)
    began = time.perf_counter()
    for _ in range(100):
        policy.predict_action_chunk(one)
    print(f"inference: {10.0 * (time.perf_counter() - began):.1f} ms")

    policy.train()
    optimizer = torch.optim.AdamW(policy.parameters(), lr=1e-9)
    for step in range(10):
        if step == 2:  # the first steps allocate
            began = time.perf_counter()
        loss, _ = policy.forward(batch)
        loss.backward()
        optimizer.step()
        optimizer.zero_grad()
    print(f"training step, batch of 16: {(time.perf_counter() - began) / 8:.2f} s")


if __name__ == "__main__":
    main()
