"""What LeRobot's own suites ask of any environment and of any dataset, asked of these."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from lerobot.configs.default import DatasetConfig
from lerobot.configs.train import TrainPipelineConfig
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.factory import make_dataset
from lerobot.datasets.sampler import EpisodeAwareSampler
from lerobot.envs.configs import EnvConfig
from lerobot.envs.factory import make_env, make_env_config
from lerobot.envs.utils import preprocess_observation
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.utils.import_utils import register_third_party_plugins

from lerobot_spacedock.camera.config import CameraConfig
from lerobot_spacedock.dataset.demos import DemosConfig, demos
from lerobot_spacedock.dataset.record import Storage
from lerobot_spacedock.env.config import OBS_TYPES
from lerobot_spacedock.env.registration import ENV_IDS

SMALL = CameraConfig(height=24, width=32, samples=1, shadows=False)
CHUNK = 5

register_third_party_plugins()  # as each of LeRobot's commands does: the plugin is found by its name


@pytest.mark.render
@pytest.mark.parametrize("obs_type", OBS_TYPES)
@pytest.mark.filterwarnings("ignore:.*infinity.*", "ignore:.*symmetric and normalized.*")
def test_gymnasiums_checker_passes_for_every_kind_of_observation(obs_type):
    env = gym.make("SpaceDockContact-v0", obs_type=obs_type, camera=SMALL)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("task", ENV_IDS)
def test_the_registry_knows_the_type_and_every_task_of_it(task):
    assert "spacedock" in EnvConfig.get_known_choices()
    config = make_env_config("spacedock", task=task)
    assert (config.type, config.task) == ("spacedock", task)


@pytest.mark.render
@pytest.mark.parametrize("use_async_envs", [False, True])
def test_the_factory_gives_vector_environments_with_pictures_between_0_and_1(use_async_envs):
    config = make_env_config("spacedock", camera=SMALL)
    suites = make_env(config, n_envs=2, use_async_envs=use_async_envs)
    (env,) = suites["spacedock"].values()
    assert isinstance(env, gym.vector.VectorEnv)
    assert isinstance(env, gym.vector.AsyncVectorEnv) is use_async_envs
    observation, _ = env.reset(seed=[1, 2])
    pictures = [value for key, value in preprocess_observation(observation).items() if "image" in key]
    assert len(pictures) == 1
    assert pictures[0].dtype == torch.float32
    assert 0.0 <= pictures[0].min() < pictures[0].max() <= 1.0
    _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert isinstance(reward, np.ndarray)
    assert reward.shape == terminated.shape == truncated.shape == (2,)
    env.close()


@pytest.fixture(scope="module", params=["image", "video"])
def dataset(request, tmp_path_factory):
    """As ``lerobot-train`` opens it for ACT."""
    root = tmp_path_factory.mktemp("contract") / request.param
    flown = {"expert": "V", "num_episodes": 2, "num_candidates": 2, "num_workers": 1, "camera": SMALL}
    demos(DemosConfig(repo_id="test/contract", root=str(root), storage=Storage(kind=request.param), **flown))
    policy = ACTConfig(chunk_size=CHUNK, n_action_steps=CHUNK, push_to_hub=False, pretrained_backbone_weights=None)
    options = DatasetConfig(repo_id="test/contract", root=str(root), video_backend="pyav")
    return make_dataset(TrainPipelineConfig(dataset=options, policy=policy, output_dir=root / "out"))


def test_each_item_is_what_the_features_promise(dataset):
    item = dataset[len(dataset) // 2]
    for name, feature in dataset.meta.features.items():
        value, shape = item[name], tuple(feature["shape"])
        if name in dataset.meta.camera_keys:
            assert tuple(value.shape) == (3, 24, 32)
            top = {torch.uint8: 255, torch.float32: 1.0}[
                value.dtype
            ]  # decoded videos stay bytes until they are batched
            assert 0 <= value.min() < value.max() <= top
        elif name == "action":
            assert tuple(value.shape) == (CHUNK, *shape)
        else:
            assert tuple(value.shape) == (() if shape == (1,) else shape), name
            assert str(value.dtype) == f"torch.{feature['dtype']}", name
    assert item["action_is_pad"].shape == (CHUNK,)
    assert isinstance(item["task"], str)


def test_indices_times_and_padding_are_lerobots(dataset):
    last = int(dataset.meta.episodes["dataset_to_index"][0]) - 1
    columns = dataset.hf_dataset.with_format("numpy")
    assert list(columns["index"]) == list(range(len(dataset)))
    assert [int(columns["frame_index"][i]) for i in (0, last, last + 1)] == [0, last, 0]
    assert [int(columns["episode_index"][i]) for i in (0, last, last + 1)] == [0, 0, 1]
    np.testing.assert_allclose(columns["timestamp"], np.array(columns["frame_index"]) / dataset.fps)
    assert [bool(pad) for pad in dataset[last]["action_is_pad"]] == [False, *[True] * (CHUNK - 1)]
    assert len({int(index) for index in EpisodeAwareSampler([0, last + 1], [last + 1, len(dataset)])}) == len(dataset)


def test_statistics_and_totals_are_those_of_the_rows(dataset):
    meta = LeRobotDatasetMetadata(dataset.repo_id, root=dataset.root)
    assert (meta.total_episodes, meta.total_frames) == (2, len(dataset))
    state = np.stack(dataset.hf_dataset.with_format("numpy")["observation.state"])
    statistics = meta.stats["observation.state"]
    for name, expected in (
        ("mean", state.mean(0)),
        ("std", state.std(0)),
        ("min", state.min(0)),
        ("max", state.max(0)),
    ):
        np.testing.assert_allclose(statistics[name], expected, rtol=1e-4, atol=1e-6)
    assert int(np.ravel(statistics["count"])[0]) == len(dataset)


def test_a_loader_gives_batches(dataset):
    batch = next(iter(torch.utils.data.DataLoader(dataset, batch_size=4)))
    assert batch["action"].shape == (4, CHUNK, 6)
    assert batch[dataset.meta.camera_keys[0]].shape == (4, 3, 24, 32)
