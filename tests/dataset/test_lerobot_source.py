"""A dataset as the source of another: chosen from, cut, scaled; with what it has not got said."""

import json

import numpy as np
import pytest
from dataset_samples import HEIGHT, WIDTH, picture_of, short, write_raw_export
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.env_flags import dataset_env_flags
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.record import DatasetLayout, DatasetRecorder, Storage
from lerobot_spacedock.physics.frames import STATE_NAMES

CAMERA = CameraConfig(height=HEIGHT, width=WIDTH)


def run(source, root, **options) -> None:
    options = {"camera": CAMERA, "num_workers": 1, "images": "none"} | options
    assert convert(ConvertConfig(source=str(source), repo_id="test/again", root=str(root), **options)) == 0


def logs_of(root) -> list:
    return [episode.log() for episode in DatasetReader(root).iterate()]


def test_it_comes_through_unchanged_and_knows_how_it_was_made(log_folder, tmp_path):
    run(log_folder, tmp_path / "one")
    run(tmp_path / "one", tmp_path / "two", format="lerobot")
    for before, after in zip(logs_of(tmp_path / "one"), logs_of(tmp_path / "two"), strict=True):
        for name in ("time", "state", "action", "dt", "reward"):
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
        assert {name: values.tolist() for name, values in after.extra.items()} == {
            name: values.tolist() for name, values in before.extra.items()
        }
        assert after.metadata == before.metadata
    assert check_dataset(tmp_path / "two").errors == []
    assert "which was made by: `" in (tmp_path / "two" / "README.md").read_text()


@pytest.mark.parametrize("kind", ["video", "image"])
def test_a_part_of_it_keeps_its_pictures(flights, tmp_path, kind):
    write_raw_export(tmp_path / "raw", [short(log, 6) for log in flights[:3]], pictures=True)
    run(tmp_path / "raw", tmp_path / "one", format="raw", images="auto", storage=Storage(kind))
    options = {"segment": "last:4", "num_episodes": 2, "select": "smoothness", "storage": Storage("image")}
    run(tmp_path / "one", tmp_path / "two", format="lerobot", images="auto", **options)
    dataset = LeRobotDataset("test/again", root=tmp_path / "two")
    assert (dataset.num_episodes, dataset.num_frames) == (2, 8)
    for index in range(8):
        frame = (dataset[index][schema.IMAGE].numpy().transpose(1, 2, 0) * 255.0).round()
        assert np.abs(frame - picture_of(2 + index % 4)).max() < (1 if kind == "image" else 4)
    assert check_dataset(tmp_path / "two").errors == []


def test_what_a_foreign_one_has_not_got_is_said(flights, tmp_path, capsys):
    """Another camera name, no times, no mass, no rewards, no terminal state: as a recording of another tool."""
    log = short(flights[0], 9)
    names = [name for name in STATE_NAMES if name != "mass"]
    features = {
        "observation.state": {"dtype": "float32", "shape": (13,), "names": names},
        "action": {"dtype": "float32", "shape": (6,), "names": None},
        "observation.images.front": {"dtype": "image", "shape": (HEIGHT, WIDTH, 3), "names": None},
    }
    dataset = LeRobotDataset.create("test/foreign", fps=1, features=features, root=tmp_path / "one", use_videos=False)
    seen = np.delete(log.state, 6, axis=1).astype(np.float32)
    for k in range(9):
        action = log.action[k].astype(np.float32)
        dataset.add_frame(
            {"observation.state": seen[k], "action": action, "observation.images.front": picture_of(k), "task": "dock"}
        )
    dataset.save_episode()
    dataset.finalize()
    run(tmp_path / "one", tmp_path / "two", format="lerobot", images="auto", storage=Storage("image"), step_s=0.9)
    shown = capsys.readouterr().out
    for what in ("mass", "rewards", "times", "last state"):
        assert f"{what} not in the source" in shown
    again = LeRobotDataset("test/again", root=tmp_path / "two")
    assert again.num_frames == 8, "the last frame became the terminal state"
    assert float(again[3]["control_dt"]) == pytest.approx(0.9)
    np.testing.assert_array_equal((again[5][schema.IMAGE].numpy().transpose(1, 2, 0) * 255).round(), picture_of(5))
    assert check_dataset(tmp_path / "two").errors == []
    facts = json.loads((tmp_path / "two" / "meta" / "spacedock.json").read_text())
    assert facts["pictures"] == "stored"
    assert "--env.task=…" in " ".join(dataset_env_flags(DatasetReader(tmp_path / "one"))), "which nothing says"


@pytest.mark.parametrize(("options", "size"), [({"with_mass": True}, 14), ({"withhold_pose": True}, 6), ({}, 13)])
def test_the_state_keeps_what_it_holds_unless_asked_otherwise(log_folder, tmp_path, options, size):
    run(log_folder, tmp_path / "one", **options)
    (tmp_path / "one" / "meta" / "spacedock.json").unlink()  # as one that another tool has written
    run(tmp_path / "one", tmp_path / "two", format="lerobot")
    before, after = (DatasetReader(tmp_path / name) for name in ("one", "two"))
    assert list(after.features["observation.state"]["shape"]) == [size]
    for old, new in zip(before.iterate(), after.iterate(), strict=True):
        np.testing.assert_array_equal(new.rows["observation.state"], old.rows["observation.state"])
    run(tmp_path / "one", tmp_path / "asked", format="lerobot", with_mass=False, withhold_pose=False)
    assert list(DatasetReader(tmp_path / "asked").features["observation.state"]["shape"]) == [13]


def foreign(root, log, *, success: bool, **columns) -> None:
    """A recording of another tool: two tasks, one a half, and further columns of one value a step."""
    names = [name for name in STATE_NAMES if name != "mass"]
    features = {
        "observation.state": {"dtype": "float32", "shape": (13,), "names": names},
        "action": {"dtype": "float32", "shape": (6,), "names": None},
        "next.success": {"dtype": "bool", "shape": (1,), "names": None},
    } | {name: {"dtype": "float32", "shape": (1,), "names": None} for name in columns}
    dataset = LeRobotDataset.create("test/foreign", fps=1, features=features, root=root, use_videos=False)
    seen = np.delete(log.state, 6, axis=1).astype(np.float32)
    for k in range(log.num_steps):
        row = {name: values[k : k + 1].astype(np.float32) for name, values in columns.items()}
        row |= {"observation.state": seen[k], "action": log.action[k].astype(np.float32)}
        last = np.array([success and k == log.num_steps - 1])
        dataset.add_frame(row | {"next.success": last, "task": "come near" if 2 * k < log.num_steps else "dock"})
    dataset.save_episode()
    dataset.finalize()


@pytest.mark.parametrize("success", [True, False])
def test_what_a_foreign_one_says_of_success_and_tasks_is_kept(flights, tmp_path, success, capsys):
    """The last frame becomes the terminal state: judged by it alone, what just docked has not."""
    foreign(tmp_path / "one", short(flights[0], 9), success=success, wind=np.zeros(9))
    run(tmp_path / "one", tmp_path / "two", format="lerobot", segment="last:6")
    assert "further columns of the source left out: wind (1 episodes)" in capsys.readouterr().out
    reader = DatasetReader(tmp_path / "two")
    (rows,) = [episode.rows for episode in reader.iterate()]
    assert rows["next.success"].any() == reader.about.column("success")[0] == success
    again = LeRobotDataset("test/again", root=tmp_path / "two")
    assert [again[k]["task"] for k in range(6)] == ["come near"] * 3 + ["dock"] * 3
    run(tmp_path / "two", tmp_path / "asked", format="lerobot", task="fly")
    assert LeRobotDataset("test/again", root=tmp_path / "asked")[0]["task"] == "fly"
    assert "further columns" not in capsys.readouterr().out


def test_each_episode_keeps_its_task_whatever_shards_are_merged(flights, tmp_path, monkeypatch):
    from lerobot_spacedock.dataset import merge

    monkeypatch.setattr(merge, "MERGE_AT_ONCE", 2)
    layout = DatasetLayout("test/tasks", image=False, task=None)
    tasks = ["dock", "hold", "dock", "leave", "hold"]
    with DatasetRecorder(tmp_path / "one", layout) as recorder:
        for log, task in zip(flights, tasks, strict=True):
            recorder.add_episode(short(log, 4), tasks=[task] * 4)
    run(tmp_path / "one", tmp_path / "two", format="lerobot")
    again = LeRobotDataset("test/again", root=tmp_path / "two")
    assert [again[3 * episode]["task"] for episode in range(5)] == tasks, "the last frames became terminal states"
    assert sorted(again.meta.tasks.index) == ["dock", "hold", "leave"]
    assert check_dataset(tmp_path / "two").errors == []


@pytest.mark.parametrize("kept", ["control_dt", "sim_time"])
def test_times_come_of_whichever_column_there_is(flights, tmp_path, kept, capsys):
    log = flights[0]
    foreign(tmp_path / "one", log, success=True, **{kept: log.dt if kept == "control_dt" else log.time[:-1]})
    run(tmp_path / "one", tmp_path / "two", format="lerobot")
    assert "times not in the source" not in capsys.readouterr().out
    (back,) = logs_of(tmp_path / "two")
    np.testing.assert_allclose(back.time, log.time[:-1], atol=2e-5)
    np.testing.assert_allclose(back.dt, log.dt[:-1], atol=2e-5)
    assert check_dataset(tmp_path / "two").errors == []
