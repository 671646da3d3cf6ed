"""What the cards say: valid for the hub, and commands that fit what they describe."""

import json
import shlex
import types
from dataclasses import asdict, dataclass

import draccus
import lerobot.policies.act.configuration_act  # noqa: F401 - registers --policy.type=act
import numpy as np
import pytest
from dataset_samples import fly_some, short, write_raw_export
from huggingface_hub import DatasetCard, ModelCard
from lerobot.configs.train import TrainPipelineConfig
from lerobot.envs.configs import EnvConfig

import lerobot_spacedock.adapters.env_config  # noqa: F401 - registers --env.type=spacedock
from lerobot_spacedock import cli
from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset.card import write_card, write_own
from lerobot_spacedock.dataset.check import CheckConfig, check
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.demos import DemosConfig, demos
from lerobot_spacedock.dataset.env_flags import dataset_env_flags, env_flags
from lerobot_spacedock.dataset.model_card import evaluation_command, write_model_card
from lerobot_spacedock.dataset.next_commands import evaluate_command, train_command
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.record import Storage
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.episode_log import write_episode_log
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.metrics.statistics import clopper_pearson


def picture(*shape: int, name: str = "camera") -> dict:
    return {f"observation.images.{name}": {"shape": list(shape)}}


def state(size: int) -> dict:
    return {"observation.state": {"shape": [size]}}


@pytest.mark.parametrize(
    ("features", "env_id", "expected", "absent"),
    [
        (
            picture(96, 128, 3) | state(13),
            "SpaceDockContact-v0",
            ["height=96", "task=SpaceDockContact-v0"],
            "with_mass",
        ),
        (picture(3, 96, 128) | state(14), None, ["width=128", "with_mass=true", "task=SpaceDock-v0"], "rename_map"),
        (state(13), None, ["obs_type=agent_pos"], "camera.height"),
        (picture(3, 96, 128), None, ["obs_type=pixels"], "with_mass"),
        (picture(3, 96, 128) | state(6), "SpaceDockVision-v0", ["task=SpaceDockVision-v0"], "withhold_pose"),
        (picture(3, 96, 128) | state(6), None, ["withhold_pose=true"], "with_mass"),
        (
            picture(3, 96, 128, name="front") | state(13),
            None,
            ["--rename_map='{", "observation.images.front"],
            "pixels",
        ),
    ],
)
def test_the_environment_that_fits_is_said_in_flags(features, env_id, expected, absent):
    flags = " ".join(env_flags(features, {"env_id": env_id}))
    assert all(text in flags for text in expected), flags
    assert absent not in flags


def test_a_policy_is_flown_in_the_task_that_it_was_trained_for(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"input_features": picture(3, 96, 128) | state(13)}))
    assert "--env.task=SpaceDock-v0" in " ".join(evaluation_command(tmp_path, "me/act")), "nothing is known"
    (tmp_path / "train_config.json").write_text(json.dumps({"env": {"task": "SpaceDockContact-v0"}}))
    words = " ".join(evaluation_command(tmp_path, "me/act"))
    assert "--env.task=SpaceDockContact-v0" in words
    assert "--env.camera.height=96" in words


@dataclass
class Command:
    """What of LeRobot's commands these flags are for."""

    env: EnvConfig


def parsed(flags: list[str]) -> SpaceDockConfig:
    """The environment that LeRobot's own parser makes of them."""
    return draccus.parse(Command, args=shlex.split(" ".join(flags))).env.space_dock_config()


OPTIONS = {
    "port": "harmony_forward",
    "sun": "random",
    "initial_conditions": "random",
    "max_steps": 90,
    "station_mesh": "my station.glb",
    "corridor": {"enabled": False},
    "camera": {"vfov_deg": 45.0, "lamp": "on", "sensor": {"read_noise": 0.01}},
}


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_every_option_that_differs_from_the_tasks_own_is_a_flag_that_lerobot_reads(env_id):
    size = {"height": 96, "width": 128}
    given = OPTIONS | {"camera": OPTIONS["camera"] | size}
    if env_id == "SpaceDock-v0":
        given |= {"dynamics": "meta", "contact": True, "station_pose": [float(k) for k in range(16)]}
    if env_id in ("SpaceDock-v0", "SpaceDockMeta-v0"):
        given |= {"meta": {"thrust_scale": [0.9, 1.0]}}
    env = SpaceDockConfig.from_options(env_id=env_id, **(ENV_IDS[env_id] | given))
    features = picture(96, 128, 3) | state(6 if env.withhold_pose else 13)
    assert parsed(env_flags(features, asdict(env))) == env
    assert parsed(env_flags(features, given | {"env_id": env_id, "fps": 1, "dynamics": given.get("dynamics")})) == env
    plain = env_flags(features, asdict(SpaceDockConfig(env_id=env_id, **ENV_IDS[env_id])))
    assert plain == [f"--env.type=spacedock --env.task={env_id}", "--env.camera.height=96 --env.camera.width=128"]


def test_a_student_of_another_port_sun_and_lens_is_flown_there(tmp_path, capsys):
    root, camera = tmp_path / "d", CameraConfig(height=32, width=48, vfov_deg=45.0)
    options = {"port": "harmony_forward", "sun": "random", "camera": camera, "segment": "last:2", "num_workers": 1}
    demos(DemosConfig("me/harmony", str(root), 1, num_candidates=1, expert="V", storage=Storage("image"), **options))
    wanted = ["--env.port=harmony_forward", "--env.sun=random", "--env.camera.vfov_deg=45.0"]
    assert all(flag in (root / "README.md").read_text() for flag in wanted)
    env = parsed(dataset_env_flags(DatasetReader(root)))
    assert (env.port, env.sun, env.camera, env.env_id) == (
        "harmony_forward", "random", CameraConfig(32, 48, 45.0, port="harmony_forward"), "SpaceDockContact-v0"
    )  # fmt: skip
    facts = root / "meta" / "spacedock.json"
    several = json.loads(facts.read_text()) | {"initial_conditions": ["random", "wide"]}
    several["env"]["initial_conditions"] = "random"
    facts.write_text(json.dumps(several))
    assert parsed(dataset_env_flags(DatasetReader(root))).initial_conditions == "same", "no single one is theirs"


def test_logs_of_several_starts_name_them_all_and_no_single_one(tmp_path):
    logs = [*fly_some([1], initial_conditions="random"), *fly_some([2, 3])]
    logs[2].metadata["initial_conditions"] = "given"  # as of an episode that was begun from a state
    for number, log in enumerate(logs):
        write_episode_log(tmp_path / "logs" / f"episode_{number}.parquet", short(log, 3))
    first = {"num_episodes": 1, "num_workers": 1, "images": "none"}
    everything = first | {"num_episodes": 0}
    convert(ConvertConfig(str(tmp_path / "logs"), "me/all", root=str(tmp_path / "all"), **everything))
    assert "starts random, same, given\n" in (tmp_path / "all" / "README.md").read_text()
    assert parsed(dataset_env_flags(DatasetReader(tmp_path / "all"))).initial_conditions == "same", "the default"
    convert(ConvertConfig(str(tmp_path / "all"), "me/one", root=str(tmp_path / "one"), format="lerobot", **first))
    assert "starts random\n" in (tmp_path / "one" / "README.md").read_text()
    assert parsed(dataset_env_flags(DatasetReader(tmp_path / "one"))).initial_conditions == "random"


def commands_after(text: str) -> list[list[str]]:
    """The words of each command that is shown after "Next:"; remarks in brackets are none."""
    lines = [line.removeprefix("Next:").strip() for line in text[text.index("Next:") :].splitlines()]
    return [shlex.split(line) for line in lines if not line.startswith("(")]


def test_the_next_command_trains_what_docks_in_the_datasets_own_task(tmp_path, capsys, monkeypatch):
    """By demos, by check and on the card alike, as LeRobot's own parser reads it."""
    root, camera = tmp_path / "d", CameraConfig(height=32, width=48)
    options = {"env_id": "SpaceDockVision-v0", "camera": camera, "segment": "last:2", "num_workers": 1}
    demos(DemosConfig("me/vision", str(root), 1, num_candidates=1, expert="V", storage=Storage("image"), **options))
    _, from_demos = commands_after(capsys.readouterr().out)
    assert check(CheckConfig("me/vision", str(root), redraw=False)) == 0
    (from_check,) = commands_after(capsys.readouterr().out)
    assert from_demos == from_check
    on_card = (root / "README.md").read_text().replace("\\\n", " ")
    (on_card,) = [shlex.split(line) for line in on_card.splitlines() if line.startswith("lerobot-train")]
    assert on_card == [word for word in from_demos if not word.startswith("--dataset.root=")]
    monkeypatch.setattr("sys.argv", from_demos)
    config = draccus.parse(TrainPipelineConfig, args=[*from_demos[1:], "--policy.device=cpu"])
    policy = config.policy
    assert (policy.type, policy.chunk_size, policy.n_action_steps) == ("act", 5, 1)
    assert (config.env.task, config.dataset.root) == ("SpaceDockVision-v0", str(root))


def test_states_alone_are_drawn_first_which_act_refuses(tmp_path, capsys, monkeypatch):
    root = tmp_path / "my d"
    options = {"image": False, "segment": "last:3", "num_workers": 1}
    demos(DemosConfig("me/states", str(root), 1, num_candidates=1, expert="V", **options))
    _, words = commands_after(capsys.readouterr().out)
    assert "lerobot-train" not in (root / "README.md").read_text()
    monkeypatch.chdir(tmp_path)
    assert words[0] == "spacedock"
    small = ["--camera.height=16", "--camera.width=24", "--storage.kind=image", "--num_workers=1"]
    assert cli.main([*words[1:], *small]) == 0
    assert DatasetReader(tmp_path / "outputs" / "states_pictures").cameras == ["observation.images.camera"]


def test_a_camera_of_another_name_is_not_renamed_in_training():
    features = {name: feature | {"dtype": "image"} for name, feature in picture(32, 48, 3, name="front").items()}
    reader = types.SimpleNamespace(features=features | state(13), facts={}, cameras=list(features))
    assert not any("env." in line or "rename_map" in line for line in train_command(reader, "a/b"))
    assert any("--rename_map" in line for line in evaluate_command(reader))


def test_a_policy_is_flown_under_the_sun_and_lens_of_its_training_or_of_its_measurement(tmp_path):
    inputs = picture(3, 96, 128) | state(13)
    (tmp_path / "config.json").write_text(json.dumps({"type": "act", "input_features": inputs}))
    trained = {"type": "spacedock", "task": "SpaceDockContact-v0", "sun": "orbit", "max_steps": None, "scalars": True}
    (tmp_path / "train_config.json").write_text(json.dumps({"env": trained | {"camera": {"vfov_deg": 45.0}}}))
    env = parsed(evaluation_command(tmp_path, "me/act")[1:])
    assert (env.env_id, env.sun, env.camera.vfov_deg, env.max_steps) == ("SpaceDockContact-v0", "orbit", 45.0, 100)
    for number, log in enumerate(fly_some([1, 2], port="harmony_forward", initial_conditions="random")):
        write_episode_log(tmp_path / "logs" / f"episode_{number:06d}.parquet", log)
    text = write_model_card(tmp_path, "me/act", str(tmp_path / "logs"), license_id="mit").read_text()
    assert "--env.port=harmony_forward" in text
    assert "--env.sun" not in text
    assert "--env.initial_conditions" not in text, "the table has several"


def test_a_card_by_somebody_else_is_kept_and_one_of_ours_written_anew(tmp_path, capsys):
    card, kept = tmp_path / "README.md", tmp_path / "README.orig.md"
    write_own(card, "# first")
    write_own(card, "# second")
    assert card.read_text().startswith("# second")
    assert not kept.exists()
    card.write_text("# by hand")
    write_own(card, "# third")
    assert kept.read_text() == "# by hand"
    assert "README.orig.md" in capsys.readouterr().out
    card.write_text("# by hand again")
    write_own(card, "# fourth")
    assert kept.read_text() == "# by hand"
    assert kept.with_name("README.orig1.md").read_text() == "# by hand again"
    assert card.read_text().startswith("# fourth")


def docked_of(flights) -> list:
    return [log for log in flights if log.metadata["success"]]


@pytest.fixture
def raw_dataset(flights, tmp_path):
    write_raw_export(tmp_path / "raw", [short(flights[0], 6), docked_of(flights)[0]], pictures=False)
    root = tmp_path / "authors"
    given = {"root": str(root), "images": "none", "num_workers": 1, "with_mass": True}
    convert(ConvertConfig(str(tmp_path / "raw"), "me/authors", format="raw", **given))
    return root


def test_a_datasets_card_is_valid_and_true(raw_dataset):
    text = write_card(raw_dataset, "me/authors", tags=("iss",)).read_text()
    header = DatasetCard(text).data
    assert (header.task_categories, header.size_categories) == (["robotics"], ["n<1K"])
    assert header.license == "unknown", "whose rollouts these are is not ours to say"
    assert DatasetCard(write_card(raw_dataset, "me/authors", license_id="mit").read_text()).data.license == "mit"
    assert "iss" in header.tags
    assert "--env.with_mass=true" in text
    assert "rewards not in the source: 0 stands in their place (2 episodes)" in text
    assert "selection: 2 of 2: all of them" in text
    assert "| docked inside the IDSS box | 1 of 2 |" in text, "a raw export does not say so; its states do"
    assert "disturbance of the executed" not in text, "nobody disturbed what others flew"


def test_a_models_card_is_valid_and_its_command_fits_the_policy(log_folder, flights, tmp_path):
    folder = tmp_path / "pretrained_model"
    folder.mkdir()
    inputs = picture(3, 96, 128) | state(14)
    config = {"type": "act", "chunk_size": 50, "temporal_ensemble_coeff": None, "input_features": inputs}
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "train_config.json").write_text(json.dumps({"steps": 7, "dataset": {"repo_id": "me/docking"}}))
    text = write_model_card(folder, "me/act", str(log_folder), license_id="mit").read_text()
    header = ModelCard(text).data
    assert (header.license, header.datasets, header.pipeline_tag) == ("mit", ["me/docking"], "robotics")
    assert "--env.task=SpaceDockContact-v0" in text
    assert "--env.camera.height=96 --env.camera.width=128" in text
    assert "--env.with_mass=true" in text
    miss = np.mean([np.linalg.norm(log.state[-1, :3]) for log in flights])
    docked = len(docked_of(flights))
    sure = clopper_pearson(docked, 5)
    assert f"| 5 | {docked} of 5, {docked / 5:.1%} [{sure.low:.1%}, {sure.high:.1%}] | {miss:.3f} /" in text


def test_a_models_card_shows_the_command_that_measured_it(log_folder, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"type": "act"}))
    assert "Measured by" not in write_model_card(tmp_path, "a/b", str(log_folder), license_id="mit").read_text()
    logs = tmp_path / "logs"
    logs.mkdir()
    for path in log_folder.iterdir():
        (logs / path.name).write_bytes(path.read_bytes())
    (logs / "policy.json").write_text(json.dumps({"command": "lerobot-eval --policy.n_action_steps=1"}))
    text = write_model_card(tmp_path, "a/b", str(logs), license_id="mit").read_text()
    assert "```bash\nlerobot-eval --policy.n_action_steps=1\n```" in text


def test_a_models_card_shows_every_evaluation_below_the_folder(log_folder, flights, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"type": "act"}))
    for name in ("first", "second"):
        logs = tmp_path / "evaluations" / name / "episodes"
        logs.mkdir(parents=True)
        for path in log_folder.iterdir():
            (logs / path.name).write_bytes(path.read_bytes())
        (logs / "policy.json").write_text(json.dumps({"command": f"lerobot-eval --output_dir={name}"}))
    text = write_model_card(tmp_path, "a/b", str(tmp_path / "evaluations"), license_id="mit").read_text()
    assert f"| {2 * len(flights)} | {2 * len(docked_of(flights))} of {2 * len(flights)}," in text
    assert "lerobot-eval --output_dir=first\nlerobot-eval --output_dir=second\n" in text


@pytest.mark.parametrize(
    ("config", "train"),
    [
        ({"input_features": {"observation.images.camera": {"shape": [3, 3, 640]}}}, {}),
        ({"input_features": {"observation.state": {}}}, {}),
        ({"input_features": {"observation.state": 3}}, {}),
        ({}, {"dataset": 3}),
        ({}, {"env": "none"}),
    ],
)
def test_a_policy_whose_description_cannot_be_used_is_named(config, train, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"type": "act"} | config))
    (tmp_path / "train_config.json").write_text(json.dumps(train))
    with pytest.raises(FileFormatError, match=f"{tmp_path.name}: not readable as a policy"):
        write_model_card(tmp_path, "a/b", None, license_id="mit")
    assert not (tmp_path / "README.md").exists()


@pytest.mark.parametrize("facts", [{"made_by": "me"}, {"env": 3}, {"expert": {}}, {"selection": {"flown": 3}}])
def test_a_dataset_whose_account_of_itself_cannot_be_used_is_named(facts, raw_dataset):
    (raw_dataset / "meta" / "spacedock.json").write_text(json.dumps(facts))
    with pytest.raises(FileFormatError, match="not readable as a dataset that says how it was made"):
        write_card(raw_dataset, "me/authors")


def test_a_folder_without_logs_is_no_measurement(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"type": "act"}))
    with pytest.raises(InputError, match="--log_dir"):
        write_model_card(tmp_path, "a/b", str(tmp_path), license_id="mit")
    assert "Not measured" in write_model_card(tmp_path, "a/b", None, license_id="mit").read_text()
