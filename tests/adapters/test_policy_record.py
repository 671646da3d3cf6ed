"""``policy.json``: what flew and what it learnt from, as the report's bill reads it; and scalars while training."""

import json
import sys
from types import SimpleNamespace

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from lerobot_spacedock.adapters.policy_record import policy_record
from lerobot_spacedock.adapters.training_scalars import log_training_scalars
from lerobot_spacedock.env.spacedock import SpaceDockEnv
from lerobot_spacedock.expert.checkpoint import SHIPPED
from lerobot_spacedock.report.samples import read_samples


@pytest.fixture
def command(monkeypatch):
    return lambda *arguments: monkeypatch.setattr(sys, "argv", list(arguments))


@pytest.fixture
def dataset(tmp_path):
    meta = tmp_path / "dataset" / "meta"
    meta.mkdir(parents=True)
    (meta / "info.json").write_text(json.dumps({"total_episodes": 100, "total_frames": 6539}))
    made = {"expert": {"name": "meta_rl", "checkpoint": None}, "selection": {"kept": 100, "flown": 150}}
    (meta / "spacedock.json").write_text(json.dumps(made))
    return meta.parent


@pytest.fixture
def shipped():
    training = json.loads(SHIPPED.with_suffix(".json").read_text())["training"]
    return {"episodes": training["episodes"], "interactions": training["interactions"]}


def bill(tmp_path):
    (tmp_path / "policy.json").write_text(json.dumps(policy_record()))
    return read_samples([], [], {"A": [tmp_path / "missing.json", tmp_path / "policy.json"]})["A"]


def test_an_imitator_pays_for_its_demonstrations_and_for_the_expert_that_flew_them(command, tmp_path, dataset, shipped):
    checkpoint = tmp_path / "pretrained_model"
    checkpoint.mkdir()
    (checkpoint / "config.json").write_text(json.dumps({"type": "act"}))
    (checkpoint / "train_config.json").write_text(json.dumps({"dataset": {"root": str(dataset), "repo_id": "a/b"}}))
    command("lerobot-eval", f"--policy.path={checkpoint}")
    samples = bill(tmp_path)
    assert (samples.training_episodes, samples.training_interactions) == tuple(shipped.values())
    assert (samples.demonstrations, samples.demonstration_interactions, samples.flown_episodes) == (100, 6539, 150)
    assert samples.expert == "meta_rl"
    command("lerobot-train", "--policy.type=act", f"--dataset.root={dataset}")
    assert bill(tmp_path) == samples


def test_an_expert_pays_for_its_own_training_alone(command, tmp_path, shipped):
    command("lerobot-eval", "--policy.type=spacedock_meta_rl")
    samples = bill(tmp_path)
    assert (samples.training_episodes, samples.training_interactions) == tuple(shipped.values())
    assert (samples.demonstrations, samples.demonstration_interactions) == (0, 0)
    command("lerobot-eval", "--policy.type=spacedock_mpc")
    assert bill(tmp_path).training_interactions == 0


def test_what_is_written_nowhere_stays_open(command, tmp_path):
    command("notebook.py")
    assert policy_record() is None
    command("lerobot-eval", "--policy.path=user/from_the_hub")
    assert policy_record()["learnt_from"] is None
    (tmp_path / "policy.json").write_text(json.dumps(policy_record()))
    assert read_samples([], [], {"A": [tmp_path / "policy.json"]}) == {}


def test_what_the_user_states_goes_before_what_the_evaluation_wrote(command, tmp_path):
    command("lerobot-eval", "--policy.type=spacedock_mpc")
    (tmp_path / "policy.json").write_text(json.dumps(policy_record()))
    (tmp_path / "stated.json").write_text(json.dumps({"episodes": 3, "interactions": 70}))
    samples = read_samples([f"A={tmp_path / 'stated.json'}"], [], {"A": [tmp_path / "policy.json"]})
    assert (samples["A"].training_episodes, samples["A"].training_interactions) == (3, 70)


def test_an_evaluation_in_training_becomes_scalars_at_its_step(command, tmp_path, monkeypatch):
    folder = tmp_path / "evaluation_0007"  # others lie beside it
    env = SpaceDockEnv(obs_type="agent_pos", max_steps=2, log_dir=str(folder))
    env.reset(seed=1)
    env.step([0.0] * 6)
    env.step([0.0] * 6)
    logged = []
    wandb = SimpleNamespace(run=object(), log=lambda data, commit: logged.append((data, commit)))
    monkeypatch.setitem(sys.modules, "wandb", wandb)
    state = tmp_path / "checkpoints" / "001200" / "training_state" / "training_step.json"
    state.parent.mkdir(parents=True)
    state.write_text('{"step": 1200}')
    config = state.parents[1] / "pretrained_model" / "train_config.json"
    config.parent.mkdir()
    config.write_text("{}")
    command("lerobot-train", "--env_eval_freq=500", "--resume=true", f"--config_path={config}")
    log_training_scalars(folder)
    events = EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    ((data, commit),) = logged
    assert commit is False  # a row of its own would push LeRobot's out
    for name in ("spacedock_same/final_distance_m", "spacedock_same/steps"):
        (event,) = events.Tensors(name)
        assert event.step == 1500
        assert data[name] == pytest.approx(event.tensor_proto.float_val[0])
    assert data["spacedock_same/steps"] == 2


def test_scalars_that_cannot_be_written_do_not_end_a_training(command, tmp_path, caplog):
    command("lerobot-train", "--env_eval_freq=500")
    (tmp_path / "tensorboard").write_text("a file in the way")
    (tmp_path / "evaluation_0001").mkdir()
    log_training_scalars(tmp_path / "evaluation_0001")
    assert "no scalars" in caplog.text
