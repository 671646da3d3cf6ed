"""Processors of the experts: batch and device only. They work in physical units, so nothing is normalised."""

from __future__ import annotations

from typing import Any

import torch
from lerobot.processor import (
    AddBatchDimensionProcessorStep,
    DeviceProcessorStep,
    PolicyAction,
    PolicyProcessorPipeline,
    RenameObservationsProcessorStep,
)
from lerobot.processor.factory import make_policy_processor_pipelines

from lerobot_spacedock.adapters.policies.configuration_spacedock import ExpertConfig

Processors = tuple[
    PolicyProcessorPipeline[dict[str, Any], dict[str, Any]], PolicyProcessorPipeline[PolicyAction, PolicyAction]
]


def make_expert_processors(
    config: ExpertConfig, dataset_stats: dict[str, dict[str, torch.Tensor]] | None = None
) -> Processors:
    """Pre- and post-processor of any expert; ``dataset_stats`` is LeRobot's signature and goes unused."""
    return make_policy_processor_pipelines(
        input_steps=[
            RenameObservationsProcessorStep(rename_map={}),
            AddBatchDimensionProcessorStep(),
            DeviceProcessorStep(device=config.device),
        ],
        output_steps=[DeviceProcessorStep(device="cpu")],
    )


# LeRobot looks each one up by the policy's type.
make_spacedock_meta_rl_pre_post_processors = make_expert_processors
make_spacedock_mpc_pre_post_processors = make_expert_processors
make_spacedock_zem_pre_post_processors = make_expert_processors
make_spacedock_feedback_pre_post_processors = make_expert_processors
