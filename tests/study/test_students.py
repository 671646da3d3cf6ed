"""The fast trainer and the batched rollout beside stock LeRobot: the same weights, the same episodes."""

import dataclasses

import numpy as np
import pytest
import torch
from lerobot.configs import FeatureType, NormalizationMode
from lerobot.configs.default import DatasetConfig
from lerobot.configs.train import TrainPipelineConfig
from lerobot.datasets import LeRobotDataset
from lerobot.datasets.dataset_tools import add_features
from lerobot.optim import AdamWConfig
from lerobot.optim.schedulers import CosineAnnealingWithWarmupSchedulerConfig
from lerobot.policies.act.modeling_act import ACTPolicy, ACTTemporalEnsembler
from lerobot.processor import PolicyProcessorPipeline
from lerobot.processor.pipeline import ObservationProcessorStep
from lerobot.scripts.lerobot_eval import eval_policy
from lerobot.scripts.lerobot_train import train as lerobot_train
from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_STATE

from lerobot_spacedock.adapters import SpaceDockEnvConfig
from lerobot_spacedock.dataset.demos import demos
from lerobot_spacedock.episode_log import log_path, read_episode_log
from lerobot_spacedock.metrics.episode import episode_metrics
from lerobot_spacedock.study.demonstrations import Frames, demonstrations, demos_config
from lerobot_spacedock.study.rollout import Pilot, env_config, evaluate
from lerobot_spacedock.study.students import StudentConfig, train

SMALL = StudentConfig(
    chunk_size=3, dim_model=16, n_heads=2, dim_feedforward=32, steps=8, num_warmup_steps=2, batch_size=64, seed=4
)


@pytest.fixture(scope="module")
def frames():
    return demonstrations(demos_config("kicked", 3, seed=0))


@pytest.fixture(scope="module")
def dataset_root(tmp_path_factory):
    """The same three demonstrations by ``spacedock demos``, with the state under ACT's other name too."""
    folder = tmp_path_factory.mktemp("demos")
    config = dataclasses.replace(demos_config("kicked", 3, seed=0), root=str(folder / "plain"), num_workers=1)
    demos(config)
    plain = LeRobotDataset(config.repo_id, root=folder / "plain")
    state = np.stack(plain.hf_dataset.with_format("numpy")[OBS_STATE])
    info = {"dtype": "float32", "shape": [13], "names": None}
    return add_features(
        plain, {OBS_ENV_STATE: (state, info)}, output_dir=folder / "both", repo_id="spacedock/both"
    ).root


def test_frames_are_those_of_the_dataset(frames, dataset_root):
    dataset = LeRobotDataset("spacedock/both", root=dataset_root, delta_timestamps={ACTION: [0.0, 1.0, 2.0]})
    assert list(dataset.meta.episodes["dataset_to_index"]) == list(frames.ends)
    chunks = frames.chunks(3)
    for index in (0, int(frames.ends[0]) - 2, int(frames.ends[0]) - 1, int(frames.ends[0]), len(frames.state) - 1):
        item = dataset[index]
        for key in (OBS_STATE, OBS_ENV_STATE, ACTION, "action_is_pad"):
            assert torch.equal(item[key], chunks[key][index]), (index, key)
    for key in (OBS_STATE, ACTION):
        for statistic in ("mean", "std"):
            np.testing.assert_allclose(dataset.meta.stats[key][statistic], frames.stats[key][statistic], rtol=1e-6)


def test_weights_are_those_of_lerobot_train(frames, dataset_root, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["lerobot-train"])
    policy = SMALL.policy()
    assert {feature.type for feature in policy.input_features.values()} == {FeatureType.STATE, FeatureType.ENV}
    assert policy.normalization_mapping["ENV"] is NormalizationMode.MEAN_STD
    lerobot_train(
        TrainPipelineConfig(
            dataset=DatasetConfig(repo_id="spacedock/both", root=str(dataset_root)),
            policy=policy,
            output_dir=tmp_path / "run",
            seed=SMALL.seed,
            steps=SMALL.steps,
            save_freq=SMALL.steps,
            batch_size=SMALL.batch_size,
            num_workers=0,
            use_policy_training_preset=False,
            optimizer=AdamWConfig(lr=SMALL.lr, weight_decay=SMALL.weight_decay, grad_clip_norm=SMALL.grad_clip_norm),
            scheduler=CosineAnnealingWithWarmupSchedulerConfig(num_warmup_steps=SMALL.num_warmup_steps),
        )
    )
    stock = ACTPolicy.from_pretrained(tmp_path / "run" / "checkpoints" / "last" / "pretrained_model").state_dict()
    # Adam makes full steps of gradients that are rounding errors: the statistics have to be the dataset's to the bit
    dataset = LeRobotDataset("spacedock/both", root=dataset_root)
    same = type("Same", (Frames,), {"stats": dataset.meta.stats})(**vars(frames))
    ours, untrained = train(SMALL, same).policy.state_dict(), train(dataclasses.replace(SMALL, steps=1), same)
    assert stock.keys() == ours.keys()
    for name, weights in stock.items():
        torch.testing.assert_close(ours[name], weights, rtol=0.0, atol=1e-6, msg=lambda text, name=name: name + text)
    moved = max((stock[name] - weights).abs().max() for name, weights in untrained.policy.state_dict().items())
    assert moved > 1e-3  # a thousand times the tolerance: the comparison is of training, not of the initial weights


class _StateAsEnvironment(ObservationProcessorStep):
    def observation(self, observation):
        return observation | {OBS_ENV_STATE: observation[OBS_STATE]}

    def transform_features(self, features):
        return features


@pytest.mark.parametrize(
    ("kind", "task", "coefficient"),
    [
        ("kicked", "SpaceDockContact-v0", 0.01),
        ("kicked", "SpaceDockContact-v0", -1.0),
        ("kicked_vision", "SpaceDockVision-v0", 0.01),
    ],
)
def test_batched_episodes_are_those_of_lerobot_eval(kind, task, coefficient, tmp_path):
    student = train(SMALL, demonstrations(demos_config(kind, 3, seed=0)))
    batched = evaluate(Pilot(student, coefficient), env_config(task, "random"), range(1000, 1003))

    policy = student.policy
    policy.config.temporal_ensemble_coeff = coefficient
    policy.temporal_ensembler = ACTTemporalEnsembler(coefficient, SMALL.chunk_size)
    options = {"initial_conditions": "random", "obs_type": "agent_pos", "log_dir": str(tmp_path)}
    env = SpaceDockEnvConfig(task=task, **options).create_envs(1)["spacedock"][0]
    before = PolicyProcessorPipeline(steps=[_StateAsEnvironment()])
    after = PolicyProcessorPipeline(steps=[])
    stock = eval_policy(env, policy, before, after, student.preprocessor, student.postprocessor, 3, start_seed=1000)
    env.close()

    single = [episode_metrics(read_episode_log(log_path(tmp_path, seed))) for seed in range(1000, 1003)]
    assert [episode["success"] for episode in stock["per_episode"]] == [episode["success"] for episode in batched]
    for one, other in zip(single, batched, strict=True):
        assert one["steps"] == other["steps"]
        for name in ("final_distance_m", "final_speed_m_s", "smoothness", "final_misalignment_deg"):
            assert one[name] == pytest.approx(other[name], rel=1e-4, abs=1e-5), name
    assert len({episode["final_distance_m"] for episode in batched}) == 3
