"""Pushing to a hub that the test starts: what arrives, what comes back, and what a failing hub costs."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from dataset_samples import HEIGHT, WIDTH, short, write_raw_export
from local_hub import TOKEN, LocalHub

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.hub import HubError
from lerobot_spacedock.dataset.push import PushConfig, push
from lerobot_spacedock.errors import InputError

REPO = "test/docking"


@pytest.fixture(scope="module")
def dataset(flights, tmp_path_factory):
    folder = tmp_path_factory.mktemp("push")
    write_raw_export(folder / "raw", [short(log, 6) for log in flights[:2]], pictures=True)
    camera = CameraConfig(height=HEIGHT, width=WIDTH)
    root = folder / "docking"
    convert(ConvertConfig(str(folder / "raw"), REPO, format="raw", root=str(root), camera=camera, num_workers=1))
    return root


@pytest.fixture
def hub(monkeypatch):
    from huggingface_hub import constants

    with LocalHub() as running:
        monkeypatch.setattr(constants, "ENDPOINT", running.url)
        monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
        monkeypatch.setenv("HF_TOKEN", TOKEN)
        yield running


def send(dataset, **options) -> int:
    return push(PushConfig(REPO, root=str(dataset), **options))


def test_everything_arrives_in_one_commit_private_and_tagged(hub, dataset, capsys):
    send(dataset, tags=["iss"], revision_tag="v1.0")
    repository = hub.repositories[("dataset", REPO)]
    assert repository.private
    assert set(repository.tags) == {"v3.0", "v1.0"}
    assert len(repository.commits) == 2, "the empty one, and one with data and card together"
    local = {str(p.relative_to(dataset)): p.read_bytes() for p in dataset.rglob("*") if p.is_file()}
    assert repository.files("v3.0") == local
    header = yaml.safe_load(local["README.md"].decode().split("---")[1])
    assert header["license"] == "unknown", "of rollouts that others made"
    assert "iss" in header["tags"]
    assert TOKEN not in capsys.readouterr().out + "".join(hub.requests)


def test_pushing_again_sends_no_file_twice_and_moves_the_tag(hub, dataset):
    send(dataset)
    first = hub.repositories[("dataset", REPO)].tags["v3.0"]
    sent = sum("/blobs/" in request for request in hub.requests)
    hub.requests.clear()
    send(dataset, tags=["again"])
    assert sent > 0
    assert not any("/blobs/" in request for request in hub.requests)
    repository = hub.repositories[("dataset", REPO)]
    assert repository.tags["v3.0"] != first
    assert b"again" in repository.files("v3.0")["README.md"]


@pytest.mark.parametrize("large", ["never", "always"])
def test_files_of_a_larger_version_do_not_stay_behind(hub, dataset, large):
    send(dataset)
    repository = hub.repositories[("dataset", REPO)]
    late = {"data/chunk-000/file-007.parquet": b"", "videos/a/chunk-000/file-007.mp4": b"", "notes/mine.md": b"kept"}
    repository.commit("main", repository.files() | late)
    send(dataset, large=large)
    left = set(repository.files("v3.0"))
    assert not left & {"data/chunk-000/file-007.parquet", "videos/a/chunk-000/file-007.mp4"}
    assert left >= {"notes/mine.md", "data/chunk-000/file-000.parquet"}


def test_a_branch_leaves_main_alone(hub, dataset):
    send(dataset, branch="wip")
    repository = hub.repositories[("dataset", REPO)]
    assert repository.files("main") == {}
    assert "meta/info.json" in repository.files("wip")


def test_what_everybody_loads_stays_when_a_branch_is_pushed(hub, dataset, capsys):
    send(dataset, revision_tag="v1.0")
    repository = hub.repositories[("dataset", REPO)]
    before = dict(repository.tags)
    send(dataset, branch="wip", tags=["other"])
    assert repository.tags == before
    shown = capsys.readouterr().out
    assert "to load this: --dataset.revision=wip" in shown
    assert "--dataset.revision=wip" in shown[shown.index("Next: lerobot-train") :]
    sent = len(repository.commits)
    with pytest.raises(InputError, match=r"v1\.0, which is set already"):
        send(dataset, branch="wip", tags=["again"], revision_tag="v1.0")
    assert repository.tags == before
    assert len(repository.commits) == sent


def test_a_dry_run_says_what_and_sends_nothing(hub, dataset, capsys):
    send(dataset, dry_run=True)
    assert hub.requests == []
    shown = capsys.readouterr().out
    assert "meta/info.json" in shown
    assert "2 episodes" in shown
    card = (dataset / "README.md").read_text().splitlines()
    whole = shown.partition("--- README.md\n")[2].splitlines()
    assert whole[:60] == card[:60], "line by line"
    assert whole[60] == f"… {len(card) - 60} more lines, in {dataset / 'README.md'}"


def test_without_a_token_nothing_is_sent(hub, dataset, monkeypatch, tmp_path):
    from huggingface_hub import constants

    monkeypatch.delenv("HF_TOKEN")
    monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(tmp_path / "none"))
    with pytest.raises(InputError, match="hf auth login"):
        send(dataset)
    assert hub.requests == []


def test_a_refused_token_is_said_without_showing_it(hub, dataset, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", "hf_wrongsecret")
    with pytest.raises(HubError, match="refused the token") as caught:
        send(dataset)
    assert "hf_wrongsecret" not in str(caught.value)
    assert hub.repositories == {}


@pytest.mark.parametrize("way", ["drop", 503])
@pytest.mark.parametrize("place", ["commit", "tag", "create"])
def test_a_hub_that_fails_on_the_way_costs_only_a_second_try(hub, dataset, way, place):
    before = {p: p.read_bytes() for p in dataset.rglob("*") if p.is_file()}
    hub.fail = lambda method, path: way if f"/{place}" in path and method == "POST" else None
    with pytest.raises(HubError, match="run the same command again"):
        send(dataset)
    assert {p: p.read_bytes() for p in before} == before
    hub.fail = lambda method, path: None
    hub.requests.clear()
    send(dataset)
    if place != "create":
        assert not any("/blobs/" in request for request in hub.requests), "what arrived is not sent again"
    assert "v3.0" in hub.repositories[("dataset", REPO)].tags


def test_a_broken_dataset_is_not_pushed(hub, dataset, tmp_path):
    broken = tmp_path / "broken"
    shutil.copytree(dataset, broken)
    info = json.loads((broken / "meta" / "info.json").read_text())
    (broken / "meta" / "info.json").write_text(json.dumps(info | {"total_frames": 99}))
    with pytest.raises(InputError, match="total_frames"):
        send(broken)
    assert hub.requests == []


def test_a_large_push_leaves_nothing_out_wherever_it_goes(hub, dataset):
    """In several commits with a record on disk; the record of one place must not make another go without files."""
    local = {str(p.relative_to(dataset)) for p in dataset.rglob("*") if p.is_file() and ".cache" not in p.parts}
    for repo_id in (REPO, "test/elsewhere"):
        push(PushConfig(repo_id, root=str(dataset), large="always"))
        assert set(hub.repositories[("dataset", repo_id)].files("v3.0")) - {".gitattributes"} == local
    hub.requests.clear()
    push(PushConfig("test/elsewhere", root=str(dataset), large="always"))
    assert not any("/blobs/" in request for request in hub.requests)
    del hub.repositories[("dataset", "test/elsewhere")]
    push(PushConfig("test/elsewhere", root=str(dataset), large="always"))
    assert set(hub.repositories[("dataset", "test/elsewhere")].files("v3.0")) == local


def test_a_large_push_goes_on_after_the_hub_failed(hub, dataset):
    hub.fail = lambda method, path: 503 if "/commit/" in path and method == "POST" else None
    with pytest.raises(HubError, match="run the same command again"):
        send(dataset, large="always")
    hub.fail = lambda method, path: None
    hub.requests.clear()
    send(dataset, large="always")
    assert not any("/blobs/" in request for request in hub.requests), "what arrived is not sent again"
    assert "meta/info.json" in hub.repositories[("dataset", REPO)].files("v3.0")


def test_a_policy_goes_with_its_measured_results(hub, flights, log_folder, tmp_path):
    folder = tmp_path / "pretrained_model"
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps({"type": "act", "chunk_size": 5, "input_features": {}}))
    (folder / "train_config.json").write_text(json.dumps({"steps": 7, "dataset": {"repo_id": REPO}}))
    (folder / "model.safetensors").write_bytes(b"weights")
    logs = shutil.copytree(log_folder, tmp_path / "logs")
    shutil.copytree(log_folder, logs / "surplus")  # of the last vector batch: nobody asked for them
    push(PushConfig("test/act", kind="policy", root=str(folder), log_dir=str(logs)))
    files = hub.repositories[("model", "test/act")].files()
    docked = sum(log.metadata["success"] for log in flights)
    assert f"| 5 | {docked} of 5, {docked / 5:.1%} [".encode() in files["README.md"]
    assert files["model.safetensors"] == b"weights"


def client(hub, code: str, tmp_path, timeout_s: float = 240.0) -> str:
    """Runs Python in a process whose hub is the local one, from an empty home."""
    environment = os.environ | {
        "HF_ENDPOINT": hub.url, "HF_TOKEN": TOKEN, "HF_HUB_DISABLE_XET": "1", "HF_HOME": str(tmp_path / "hf"),
        "HF_LEROBOT_HOME": str(tmp_path / "lerobot"), "OMP_NUM_THREADS": "1",
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=timeout_s, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def test_it_loads_back_by_its_name(hub, dataset, tmp_path):
    send(dataset)
    code = f"""
from lerobot.datasets.lerobot_dataset import LeRobotDataset
d = LeRobotDataset("{REPO}", video_backend="pyav")
print(d.num_episodes, d.num_frames, tuple(d[7]["observation.images.camera"].shape), int(d[7]["frame_index"]))
"""
    assert client(hub, code, tmp_path).split("\n")[-2] == f"2 12 (3, {HEIGHT}, {WIDTH}) 1"


def test_what_lerobot_has_downloaded_is_checked_and_seen_where_it_is(hub, dataset, tmp_path):
    send(dataset)
    code = f"""
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot_spacedock.cli import main
from lerobot_spacedock.dataset.stored_episode import DatasetEpisode
root = LeRobotDataset("{REPO}", video_backend="pyav").root
assert main(["check", "--repo_id={REPO}"]) == 0
print(sum(1 for _ in DatasetEpisode(root, 1).frames()))
"""
    assert client(hub, code, tmp_path).split("\n")[-2] == "6"


@pytest.mark.parametrize("name", ["../../../escaped.txt", "/escaped.txt", "meta/../../../escaped.txt", "a\\..\\b"])
def test_a_repository_whose_paths_climb_out_writes_nothing_outside(hub, dataset, tmp_path, name):
    send(dataset)
    repository = hub.repositories[("dataset", REPO)]
    for sha, files in list(repository.commits.items()):
        repository.commits[sha] = files | {name: b"escaped"}
    target = tmp_path / "home"
    target.mkdir()
    code = f"""
from lerobot.datasets.lerobot_dataset import LeRobotDataset
for root in (None, "{target}/mine"):
    try:
        LeRobotDataset("{REPO}", root=root, video_backend="pyav")
    except Exception as error:
        print(type(error).__name__)
"""
    client(hub, code, target)
    assert [path.name for path in tmp_path.iterdir()] == ["home"]
    for path in target.rglob("*"):
        allowed = [target / "hf", target / "lerobot", target / "mine"]
        assert any(path.is_relative_to(place) for place in allowed), path
    assert not Path("/escaped.txt").exists()


def test_a_link_that_leads_out_is_not_pushed(hub, dataset, tmp_path):
    """A dataset from elsewhere must not take its new owner's files along to the hub."""
    (tmp_path / "secret.txt").write_text("secret")
    shutil.copytree(dataset, tmp_path / "mine")
    (tmp_path / "mine" / "notes.txt").symlink_to(tmp_path / "secret.txt")
    with pytest.raises(InputError, match=r"notes\.txt.*link to .*secret\.txt"):
        send(tmp_path / "mine")
    assert hub.requests == []


@pytest.mark.parametrize("large", ["never", "always"])
def test_what_a_killed_writer_left_is_neither_listed_nor_sent(hub, dataset, tmp_path, large, capsys):
    mine = shutil.copytree(dataset, tmp_path / "mine")
    (mine / "later.part").mkdir()
    left = [".frames.jpg.4711.tmp", "notes.tmp", "meta/.info.json.tmp", "later.part/plan.json"]
    for name in left:
        (mine / name).write_text("half")
    send(mine, dry_run=True)
    shown = capsys.readouterr().out
    assert not any(name in shown for name in left)
    send(mine, large=large)
    assert not set(left) & set(hub.repositories[("dataset", REPO)].files("v3.0"))


def test_the_environment_is_made_from_the_hub(hub, tmp_path):
    push(PushConfig("test/env", kind="env"))
    code = """
from lerobot.envs.factory import make_env
envs = make_env("test/env", n_envs=1, trust_remote_code=True)
(suite, tasks), = envs.items()
print(suite, tasks[0].num_envs, tasks[0].single_action_space.shape)
import dataclasses
from lerobot.envs.configs import EnvConfig, HubEnvConfig
@EnvConfig.register_subclass("mine")
@dataclasses.dataclass
class Mine(HubEnvConfig):
    initial_conditions: str = "random"
    obs_type: str = "agent_pos"
env = make_env(Mine(task="SpaceDockContact-v0", hub_path="test/env"), n_envs=1, trust_remote_code=True)["spacedock"][0]
config = env.get_attr("config")[0]
print(config.env_id, config.initial_conditions, config.obs_type)
"""
    lines = client(hub, code, tmp_path).split("\n")
    assert lines[-3] == "spacedock 1 (6,)"
    assert lines[-2] == "SpaceDockContact-v0 random agent_pos"


@pytest.mark.slow
def test_act_trains_from_it_by_its_name(hub, dataset, tmp_path):
    send(dataset)
    code = f"""
import sys
from lerobot.scripts.lerobot_train import main
sys.argv = ["lerobot-train", "--dataset.repo_id={REPO}", "--dataset.video_backend=pyav", "--policy.type=act",
    "--policy.push_to_hub=false", "--policy.device=cpu", "--policy.pretrained_backbone_weights=null", "--steps=2",
    "--policy.dim_model=32", "--policy.n_heads=2", "--policy.dim_feedforward=32", "--policy.chunk_size=4",
    "--policy.n_action_steps=4", "--batch_size=2", "--num_workers=0", "--output_dir={tmp_path}/out",
    "--save_freq=2", "--env_eval_freq=0", "--policy.n_decoder_layers=1", "--policy.n_encoder_layers=1"]
main()
"""
    client(hub, code, tmp_path)
    assert list((tmp_path / "out" / "checkpoints").rglob("model.safetensors"))
