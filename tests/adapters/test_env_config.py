"""``--env.type=spacedock``: its options are the environment's, its features the datasets'."""

import dataclasses
import json
import sys

import gymnasium as gym
import numpy as np
import pytest
from lerobot.configs import FeatureType, parser
from lerobot.configs.eval import EvalPipelineConfig
from lerobot.envs.factory import make_env, make_env_config, make_env_pre_post_processors
from lerobot.envs.utils import env_to_policy_features, preprocess_observation

from lerobot_spacedock.adapters import SpaceDockEnvConfig, SpaceDockMpcConfig, command_line
from lerobot_spacedock.adapters.policy_record import policy_record
from lerobot_spacedock.camera.config import CameraConfig
from lerobot_spacedock.dataset.schema import features as dataset_features
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.errors import InputError, SpaceDockError

SMALL = CameraConfig(height=24, width=32, samples=1, shadows=False)


def test_every_option_of_the_environment_is_an_option_here_with_the_same_default():
    ours = {f.name: f for f in dataclasses.fields(SpaceDockEnvConfig)}
    of_the_id = set().union(*ENV_IDS.values())
    for field in dataclasses.fields(SpaceDockConfig):
        if field.name == "env_id":
            continue
        assert field.name in ours
        if field.name in of_the_id:
            assert ours[field.name].default is None
        else:
            assert SpaceDockEnvConfig().gym_kwargs.get(field.name) == getattr(SpaceDockConfig(), field.name)


@pytest.mark.parametrize("task", ENV_IDS)
def test_the_task_decides_what_is_left_out_and_a_value_overrides_it(task):
    config = SpaceDockEnvConfig(task=task)
    env = gym.make(task, obs_type="agent_pos")
    expected = dataclasses.replace(env.unwrapped.config, obs_type=config.obs_type)
    assert config.space_dock_config() == expected
    assert SpaceDockEnvConfig(task=task, max_steps=7).space_dock_config().max_steps == 7


@pytest.mark.parametrize("with_mass", [False, True])
def test_features_are_named_and_shaped_as_in_the_datasets(with_mass):
    config = SpaceDockEnvConfig(camera=SMALL, with_mass=with_mass)
    schema = dataset_features(height=24, width=32, with_mass=with_mass)
    assert set(config.features) <= set(schema)
    for name, feature in config.features.items():
        assert tuple(feature.shape) == tuple(schema[name]["shape"])
    policy = env_to_policy_features(config)
    assert policy["observation.images.camera"].shape == (3, 24, 32)
    assert policy["action"].type is FeatureType.ACTION


def test_the_camera_may_be_given_as_a_mapping():
    config = make_env_config("spacedock", camera={"height": 24, "width": 32})
    assert config.features["observation.images.camera"].shape == (24, 32, 3)
    assert config.space_dock_config().camera.width == 32


@pytest.mark.render
def test_what_a_policy_is_given_is_what_the_features_promise():
    config = SpaceDockEnvConfig(camera=SMALL)
    env = make_env(config, n_envs=2)["spacedock"][0]
    observation, _ = env.reset(seed=[1, 2])
    pre, _ = make_env_pre_post_processors(config, None)
    batch = pre(preprocess_observation(observation))
    expected = {name: (2, *f.shape) for name, f in env_to_policy_features(config).items() if name != "action"}
    assert {k: tuple(v.shape) for k, v in batch.items() if k.startswith("observation.")} == expected
    env.close()


@pytest.mark.parametrize(
    ("options", "fragment"),
    [
        ({"task": "SpaceDock-v1"}, "SpaceDockContact-v0"),
        ({"initial_conditions": "samme"}, "same_dispersed"),
        ({"obs_type": "image"}, "pixels_agent_pos"),
        ({"port": "zvezda"}, "zvezda_aft"),
        ({"max_steps": 0}, "integer"),
        ({"thrust_limit_N": float("nan")}, "finite"),
    ],
)
def test_a_bad_option_is_refused_before_anything_is_made(options, fragment):
    with pytest.raises(SpaceDockError, match=fragment):
        make_env_config("spacedock", **options)


def test_lerobots_command_prints_a_bad_option_as_one_clear_line(monkeypatch, capsys):
    from lerobot.scripts.lerobot_eval import eval_main

    monkeypatch.setattr(sys, "argv", ["lerobot-eval", "--env.type=spacedock", "--env.initial_conditions=samme"])
    with pytest.raises(SystemExit) as stopped:
        eval_main()
    assert stopped.value.code == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    assert line == "error: initial_conditions: got samme; allowed: same | random | same_dispersed | wide."


def test_an_action_that_is_not_a_number_is_refused():
    env = make_env(SpaceDockEnvConfig(obs_type="agent_pos"), n_envs=1)["spacedock"][0]
    env.reset(seed=[1])
    with pytest.raises(InputError, match="finite"):
        env.step(np.full((1, 6), np.nan, dtype=np.float32))
    env.close()


@pytest.fixture
def command(monkeypatch):
    return lambda *arguments: monkeypatch.setattr(sys, "argv", list(arguments))


def test_outside_lerobots_commands_nothing_is_guessed(command):
    command("notebook.py", "--output_dir=x", "--eval.n_episodes=3")
    assert command_line.running_command() is None
    assert command_line.output_dir() is None
    assert command_line.num_episodes() is None


@pytest.mark.parametrize("program", ["/usr/bin/lerobot-eval", "/x/lerobot/scripts/lerobot_eval.py"])
def test_the_commands_options_are_read_from_flags_and_file(command, tmp_path, program):
    path = tmp_path / "eval.yaml"
    path.write_text("output_dir: from/file\neval:\n  n_episodes: 7\nenv:\n  task: SpaceDockContact-v0\n")
    command(program, f"--config_path={path}")
    assert command_line.running_command() == "lerobot_eval"
    assert str(command_line.output_dir()) == "from/file"
    assert command_line.num_episodes() == 7
    command(program, f"--config_path={path}", "--output_dir", "from/flag", "--eval.n_episodes=8")
    assert str(command_line.output_dir()) == "from/flag"
    assert command_line.num_episodes() == 8
    command(program)
    assert command_line.output_dir() is None
    assert command_line.num_episodes() == 50  # LeRobot's default


def test_of_a_flag_given_twice_the_one_that_lerobot_takes_counts(command):
    """As a shell function with defaults is called: the last; of --policy.path the first."""
    flags = ["--output_dir=a", "--env.type=spacedock", "--env.obs_type=agent_pos", "--policy.type=spacedock_mpc"]
    flags += ["--env.task=SpaceDock-v0", "--eval.n_episodes=3", "--policy.device=cpu"]
    flags += ["--output_dir", "b", "--env.task=SpaceDockContact-v0", "--eval.n_episodes", "2"]
    command("lerobot-eval", *flags)
    taken = parser.wrap()(_configured)()
    assert (taken.env.task, str(taken.output_dir), taken.eval.n_episodes) == ("SpaceDockContact-v0", "b", 2)
    assert taken.policy.hill_coupling is True
    assert (str(command_line.output_dir()), command_line.num_episodes()) == ("b", 2)
    command("lerobot-eval", "--policy.path=a", "--policy.path=b")
    assert command_line.command_option("policy.path") == parser.get_path_arg("policy") == "a"


def _configured(config: EvalPipelineConfig) -> EvalPipelineConfig:
    return config


@pytest.mark.parametrize(
    ("flags", "coupled"),
    [
        (("--env.task=SpaceDockContact-v0",), True),
        (("--env.task=SpaceDock-v0",), False),
        (("--env.task=SpaceDockContact-v0", "--env.hill_coupling=false"), False),
        ((), False),
    ],
)
def test_a_controller_takes_the_attitude_model_of_the_env_that_the_command_names(command, flags, coupled):
    command("lerobot-eval", *flags)
    assert SpaceDockMpcConfig(device="cpu").hill_coupling is coupled
    assert SpaceDockMpcConfig(device="cpu", hill_coupling=not coupled).hill_coupling is coupled  # as one was saved
    command("lerobot-eval", *flags, f"--policy.hill_coupling={not coupled}")
    assert SpaceDockMpcConfig(device="cpu", hill_coupling=not coupled).hill_coupling is not coupled


@pytest.mark.parametrize(
    ("flag", "file", "content"),
    [
        ("policy.path", "config.json", {"input_features": {"observation.images.camera": {"shape": [3, 96, 128]}}}),
        ("dataset.root", "meta/info.json", {"features": {"observation.images.camera": {"shape": [96, 128, 3]}}}),
    ],
)
def test_pictures_of_another_size_than_the_policy_learns_from_are_refused(command, tmp_path, flag, file, content):
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text(json.dumps(content))
    command("lerobot-eval", f"--{flag}={tmp_path}")
    with pytest.raises(SpaceDockError, match=r"Add --env\.camera\.height=96 --env\.camera\.width=128"):
        SpaceDockEnvConfig()
    SpaceDockEnvConfig(camera=CameraConfig(height=96, width=128))
    SpaceDockEnvConfig(obs_type="agent_pos")


def test_so_are_those_of_a_policy_and_a_dataset_that_were_fetched_from_the_hub(command, tmp_path, monkeypatch):
    def fetch(cache, kind, revision, file, content):
        snapshot = cache / f"{kind}--me--act" / "snapshots" / "0123"
        (snapshot / file).parent.mkdir(parents=True)
        (snapshot / file).write_text(json.dumps(content))
        (cache / f"{kind}--me--act" / "refs").mkdir()
        (cache / f"{kind}--me--act" / "refs" / revision).write_text("0123")

    from huggingface_hub import constants, file_download
    from lerobot.utils import constants as lerobot_constants

    cache = tmp_path / "cache"
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(cache))
    monkeypatch.setattr(lerobot_constants, "HF_LEROBOT_HUB_CACHE", cache)
    monkeypatch.setattr(lerobot_constants, "HF_LEROBOT_HOME", tmp_path / "home")
    monkeypatch.setattr(file_download, "HF_HUB_CACHE", str(cache), raising=False)
    camera = "observation.images.camera"
    command("lerobot-eval", "--policy.path=me/act")
    config = SpaceDockEnvConfig()  # nothing is there yet
    fetch(cache, "models", "main", "config.json", {"type": "act", "input_features": {camera: {"shape": [3, 96, 128]}}})
    with pytest.raises(SpaceDockError, match=r"Add --env\.camera\.height=96 --env\.camera\.width=128"):
        config.create_envs(1)  # by now LeRobot has fetched it
    assert policy_record()["type"] == "act"
    command("lerobot-train", "--dataset.repo_id=me/act")
    SpaceDockEnvConfig()
    fetch(cache, "datasets", "v3.0", "meta/info.json", {"features": {camera: {"shape": [96, 128, 3]}}})
    with pytest.raises(SpaceDockError, match=r"Add --env\.camera\.height=96 --env\.camera\.width=128"):
        SpaceDockEnvConfig()


def test_who_gets_no_episode_logs_is_told(command, capsys, tmp_path):
    config = SpaceDockEnvConfig(obs_type="agent_pos")
    make_env(config, n_envs=1)["spacedock"][0].close()
    assert capsys.readouterr().err == ""  # no command of LeRobot's
    command("lerobot-eval")
    make_env(config, n_envs=1)["spacedock"][0].close()
    assert "--output_dir" in capsys.readouterr().err
    command("lerobot-eval", f"--output_dir={tmp_path}")
    make_env(config, n_envs=1)["spacedock"][0].close()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("use_async_envs", [False, True])
def test_films_play_as_fast_as_was_asked_for(use_async_envs):
    config = SpaceDockEnvConfig(obs_type="agent_pos", fps=4)
    env = config.create_envs(2, use_async_envs)["spacedock"][0]
    assert env.unwrapped.metadata["render_fps"] == 4  # where LeRobot's evaluation reads it
    env.close()
    with pytest.raises(SpaceDockError, match="1 or more"):
        SpaceDockEnvConfig(fps=0)


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"input_features": {"observation.images.camera": {"shape": [3, 3, 640]}}}']
)
def test_a_damaged_checkpoint_is_named_in_one_line(command, tmp_path, content):
    (tmp_path / "config.json").write_text(content)
    command("lerobot-eval", f"--policy.path={tmp_path}")
    with pytest.raises(command_line.OptionError, match=r"config\.json: "):
        SpaceDockEnvConfig()


def test_logs_go_to_the_output_folder_and_never_over_older_ones(command, tmp_path):
    command("lerobot-eval", f"--output_dir={tmp_path}")
    config = SpaceDockEnvConfig(obs_type="agent_pos", max_steps=2)
    env = make_env(config, n_envs=1)["spacedock"][0]
    env.reset(seed=[5])
    for _ in range(2):
        env.step(np.zeros((1, 6), dtype=np.float32))
    env.close()
    assert sorted(path.name for path in (tmp_path / "episodes").iterdir()) == [
        "episode_000005.parquet",
        "eval_metrics.jsonl",
    ]
    with pytest.raises(InputError, match=r"--env\.log_dir"):
        make_env(config, n_envs=1)
    command("lerobot-train", f"--output_dir={tmp_path}")
    env = make_env(config, n_envs=1)["spacedock"][0]
    assert env.get_attr("config")[0].log_dir.endswith("evaluation_0001")
    env.close()


def test_a_log_folder_that_cannot_be_written_is_refused_before_an_environment_is_made(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    made = []
    monkeypatch.setattr("lerobot_spacedock.adapters.env_config.make_env", lambda *given: made.append(given))
    for folder in (tmp_path / "file", tmp_path / "file" / "logs" / "deeper"):
        config = SpaceDockEnvConfig(obs_type="agent_pos", log_dir=str(folder))
        with pytest.raises(InputError, match=r"--env\.log_dir.*a folder that can be written.*Not a directory"):
            make_env(config, n_envs=2)
    assert made == []
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.parametrize("path", ["outputs/none/pretrained_model", "./none", "/none/at/all"])
def test_a_checkpoint_that_is_not_there_is_named_before_the_hub_is_asked(path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["lerobot-eval", "--env.type=spacedock", f"--policy.path={path}"])
    with pytest.raises(Exception, match=r"--policy\.path: got .*a folder that exists"):
        SpaceDockEnvConfig()
    monkeypatch.setattr("sys.argv", ["lerobot-eval", "--env.type=spacedock", "--policy.path=user/name"])
    SpaceDockEnvConfig()
