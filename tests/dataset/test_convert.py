"""Rollouts of other origin: what comes in comes out, and what is broken is named."""

import csv
import dataclasses
import json
import pickle
import shutil
import sys
import types

import gymnasium as gym
import h5py
import numpy as np
import pytest
from dataset_samples import HEIGHT, WIDTH, fly_some, picture_of, short, write_raw_export
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_spacedock.camera import CameraConfig, SensorConfig
from lerobot_spacedock.cli import parse_config
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.camera_flags import CameraFlags, SensorFlags, over
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.env_flags import dataset_env_flags, env_flags
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.dataset.record import Storage
from lerobot_spacedock.episode_log import read_episode_log, write_episode_log
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.physics.frames import QUATERNION

CAMERA = CameraConfig(height=HEIGHT, width=WIDTH)


def run(source, root, **options) -> None:
    options = {"camera": CAMERA, "num_workers": 1} | options
    assert convert(ConvertConfig(source=str(source), repo_id="test/converted", root=str(root), **options)) == 0


def logs_of(root) -> list:
    return [episode.log() for episode in DatasetReader(root).iterate()]


def test_logs_to_dataset_to_logs_is_exact_to_float32(flights, log_folder, tmp_path):
    run(log_folder, tmp_path / "d", images="none")
    for log, back in zip(flights, logs_of(tmp_path / "d"), strict=True):
        np.testing.assert_array_equal(back.state[:-1], log.state[:-1].astype(np.float32))
        np.testing.assert_array_equal(back.state[-1], log.state[-1])
        np.testing.assert_array_equal(back.action, log.action.astype(np.float32))
        np.testing.assert_array_equal(back.dt, log.dt.astype(np.float32))
        np.testing.assert_array_equal(back.extra["label_Lz"], log.extra["label_Lz"].astype(np.float32))
        assert back.metadata == json.loads(json.dumps(log.metadata))
    assert check_dataset(tmp_path / "d").errors == []


def flown_logs(folder, env_id, steps=6):
    """Flies a few steps into ``folder``; what the environment showed before each of them."""
    env = gym.make(env_id, obs_type="agent_pos", max_steps=steps, log_dir=str(folder))
    shown = [env.reset(seed=5)[0]["agent_pos"]]
    ended = False
    while not ended:
        observation, _, terminated, truncated, _ = env.step(np.ones(6))
        shown.append(observation["agent_pos"])
        ended = terminated or truncated
    env.close()
    return np.array(shown[:-1])


def test_logs_of_imperfect_sensors_give_what_the_policy_saw(tmp_path):
    shown = flown_logs(tmp_path / "logs", "SpaceDockMeta-v0")
    run(tmp_path / "logs", tmp_path / "d", images="none")
    (rows,) = [episode.rows for episode in DatasetReader(tmp_path / "d").iterate()]
    np.testing.assert_array_equal(rows["observation.state"], shown)
    assert np.abs(rows["observation.state"] - np.delete(rows["true_state"], 6, axis=1)).max() > 1e-3
    assert check_dataset(tmp_path / "d").errors == []


def test_logs_that_lost_the_readings_say_so(tmp_path, capsys):
    flown_logs(tmp_path / "logs", "SpaceDockMeta-v0")
    (path,) = (tmp_path / "logs").glob("*.parquet")
    write_episode_log(path, dataclasses.replace(read_episode_log(path), extra={}))
    run(tmp_path / "logs", tmp_path / "d", images="none")
    assert "readings of the imperfect sensors not in the source" in capsys.readouterr().out


def test_logs_of_a_task_that_withholds_the_pose_give_what_the_policy_saw(tmp_path):
    shown = flown_logs(tmp_path / "logs", "SpaceDockVision-v0")
    run(tmp_path / "logs", tmp_path / "d", images="none")
    (rows,) = [episode.rows for episode in DatasetReader(tmp_path / "d").iterate()]
    np.testing.assert_array_equal(rows["observation.state"], shown)
    run(tmp_path / "logs", tmp_path / "whole", images="none", withhold_pose=False)
    features = DatasetReader(tmp_path / "whole").features
    assert list(features["observation.state"]["shape"]) == [13]
    assert "--env.withhold_pose=false" in env_flags(features, {"env_id": "SpaceDockVision-v0"})


@pytest.mark.parametrize("kind", ["video", "image"])
def test_raw_export_keeps_every_picture_with_its_state(raw_export, tmp_path, kind):
    root = tmp_path / "d"
    run(raw_export, root, format="raw", storage=Storage(kind))
    dataset = LeRobotDataset("test/converted", root=root, video_backend="pyav")
    assert (dataset.num_episodes, dataset.num_frames, dataset.fps) == (2, 12, 1)
    for index in range(12):
        item = dataset[index]
        frame = (item[schema.IMAGE].numpy().transpose(1, 2, 0) * 255.0).round()
        error = np.abs(frame - picture_of(index % 6)).max()
        assert error == 0 if kind == "image" else error < 4  # a step is 8 grey levels
        assert item["timestamp"] == index % 6
    report = check_dataset(root)
    assert report.errors == []
    assert report.worst["position_m"] < 1e-5


def test_raw_values_survive(flights, raw_export, tmp_path):
    run(raw_export, tmp_path / "d", format="raw", images="none")
    for log, back in zip(flights[:2], logs_of(tmp_path / "d"), strict=True):
        np.testing.assert_array_equal(back.state[:-1], log.state[:6].astype(np.float32))
        np.testing.assert_array_equal(back.state[-1], log.state[6])
        np.testing.assert_allclose(back.dt, log.dt[:6], rtol=1e-6)


def edit_csv(folder, line: int, column: int, value: str | None) -> None:
    file = folder / "states" / "trajectory_1.csv"
    rows = list(csv.reader(file.open()))
    if value is None:
        rows[line - 1] = rows[line - 1][:column]
    else:
        rows[line - 1][column] = value
    csv.writer(file.open("w", newline="")).writerows(rows)


BROKEN_RAW = {
    "word": (lambda f: edit_csv(f, 4, 3, "abc"), r"trajectory_1\.csv, line 4.*'z'.*'abc'"),
    "nan": (lambda f: edit_csv(f, 5, 8, "nan"), r"trajectory_1\.csv, line 5.*'q0'.*not finite"),
    "cut line": (lambda f: edit_csv(f, 3, 7, None), r"trajectory_1\.csv, line 3: 7 values, the header has 21"),
    "time": (lambda f: edit_csv(f, 6, 0, "0.5"), r"trajectory_1\.csv, line 6: time 0\.5 s does not come after"),
    "header": (lambda f: edit_csv(f, 1, 2, "why"), r"trajectory_1\.csv, line 1.*\['y'\]"),
    "no picture": (lambda f: (f / "imgs" / "img_traj_1_step_3.png").unlink(), r"img_traj_1_step_3\.png: missing"),
    "truncated": (
        lambda f: (f / "imgs" / "img_traj_1_step_4.png").write_bytes(
            (f / "imgs" / "img_traj_1_step_4.png").read_bytes()[:90]
        ),
        r"img_traj_1_step_4\.png: not readable as a picture",
    ),
    "not a picture": (lambda f: (f / "imgs" / "img_traj_1_step_0.png").write_text("hello"), r"img_traj_1_step_0\.png"),
    "not text": (lambda f: (f / "states" / "trajectory_1.csv").write_bytes(b"\xff\xfe\x00time"), r"trajectory_1\.csv"),
}


@pytest.mark.parametrize("name", BROKEN_RAW)
def test_a_broken_export_is_named_and_nothing_is_half_written(raw_export, tmp_path, name):
    damage, message = BROKEN_RAW[name]
    damage(raw_export)
    root = tmp_path / "d"
    with pytest.raises(FileFormatError, match=message):
        run(raw_export, root, format="raw")
    assert not root.exists()


@pytest.mark.parametrize("name", ["word", "truncated", "no picture"])
def test_skip_bad_goes_on_and_lists_what_it_left_out(raw_export, tmp_path, name, capsys):
    damage, _ = BROKEN_RAW[name]
    damage(raw_export)
    root = tmp_path / "d"
    run(raw_export, root, format="raw", skip_bad=True)
    assert "Left out 1:" in capsys.readouterr().out
    report = check_dataset(root)
    assert (report.episodes, report.errors) == (1, [])
    left_out = json.loads((root / "meta" / "spacedock.json").read_text())["left_out"]
    assert len(left_out) == 1
    assert "raw#1" in left_out[0][0]


def test_what_cannot_be_read_while_choosing_is_listed_too(flights, log_folder, tmp_path, capsys):
    source = shutil.copytree(log_folder, tmp_path / "logs")
    victim = min(source.glob("*.parquet"))
    victim.write_bytes(b"nothing")
    root, readable = tmp_path / "d", len(flights) - 1
    run(source, root, images="none", select="distance", num_episodes=len(flights), skip_bad=True)
    assert "Left out 1:" in capsys.readouterr().out
    facts = json.loads((root / "meta" / "spacedock.json").read_text())
    assert facts["left_out"][0][0] == victim.name
    assert (facts["selection"]["kept"], facts["selection"]["of"]) == (readable, readable)


def test_a_renderer_that_there_is_not_is_said_at_once(log_folder, tmp_path):
    with pytest.raises(InputError, match=r"software \| pyrender"):
        run(log_folder, tmp_path / "d", renderer="foo", skip_bad=True)
    assert not (tmp_path / "d.part" / "plan.json").exists()


def test_stored_pictures_keep_the_sun_they_were_taken_under(log_folder, tmp_path):
    run(log_folder, tmp_path / "sun", sun="random", storage=Storage("image"))
    run(tmp_path / "sun", tmp_path / "cut", format="lerobot", num_episodes=1, storage=Storage("image"))
    facts = json.loads((tmp_path / "cut" / "meta" / "spacedock.json").read_text())
    assert (facts["pictures"], facts["env"]["sun"], facts["drawing"]["sun"]) == ("stored", "random", "random")


def test_nothing_readable_is_an_error_even_with_skip_bad(raw_export, tmp_path):
    for file in (raw_export / "states").iterdir():
        file.write_text("nothing\n")
    with pytest.raises(FileFormatError, match="None of 2 episodes"):
        run(raw_export, tmp_path / "d", format="raw", skip_bad=True)
    assert not (tmp_path / "d").exists()


def write_hdf5(file, log, *, compressed: bool = False, **replaced) -> None:
    frames = np.stack([picture_of(k) for k in range(log.num_steps + 1)])
    with h5py.File(file, "w") as content:
        data = {
            "action": np.vstack([log.action, log.action[-1:]]).astype(np.float32),
            "observations/qpos": log.state.astype(np.float32),
            "dt": log.dt.astype(np.float32),
        } | replaced
        for name, values in data.items():
            if values is not None:
                content[name] = values
        if compressed:
            import cv2

            encoded = [cv2.imencode(".png", frame[:, :, ::-1])[1].reshape(-1) for frame in frames]
            width = max(map(len, encoded))
            frames = np.stack([np.pad(row, (0, width - len(row))) for row in encoded])
        content["observations/images/camera"] = frames
        content.attrs["success"] = True


@pytest.mark.parametrize("compressed", [False, True])
def test_act_style_hdf5(flights, tmp_path, compressed):
    log = short(flights[0], 6)
    (tmp_path / "h").mkdir()
    write_hdf5(tmp_path / "h" / "episode_0.hdf5", log, compressed=compressed)
    run(tmp_path / "h", tmp_path / "d", format="hdf5", storage=Storage("image"))
    dataset = LeRobotDataset("test/converted", root=tmp_path / "d")
    np.testing.assert_array_equal((dataset[4][schema.IMAGE].numpy().transpose(1, 2, 0) * 255).round(), picture_of(4))
    back = logs_of(tmp_path / "d")[0]
    np.testing.assert_array_equal(back.state, log.state.astype(np.float32))
    assert back.metadata["success"] is True
    report = check_dataset(tmp_path / "d")
    assert report.errors == []


def test_a_second_camera_is_said_to_be_left_out(flights, tmp_path, capsys):
    log, wrist = short(flights[0], 6), np.zeros((7, HEIGHT, WIDTH, 3), dtype=np.uint8)
    (tmp_path / "h").mkdir()
    write_hdf5(tmp_path / "h" / "episode_0.hdf5", log, **{"observations/images/wrist": wrist})
    run(tmp_path / "h", tmp_path / "d", format="hdf5", storage=Storage("image"))
    assert "further columns of the source left out: images/wrist (1 episodes)" in capsys.readouterr().out


def test_an_attitude_that_is_none_is_refused_with_its_state(flights, log_folder, tmp_path):
    path = sorted(log_folder.glob("*.parquet"))[0]
    flight = read_episode_log(path)
    flight.state[3, QUATERNION] = 0.0
    folder = tmp_path / "logs"
    folder.mkdir()
    write_episode_log(folder / path.name, flight)
    with pytest.raises(FileFormatError, match=r"quaternion of state 3 has the length 0, not 1"):
        run(folder, tmp_path / "d", images="none")
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize("damage", ["gap", "lost"])
def test_a_label_that_is_not_whole_is_refused(flights, tmp_path, damage):
    log = short(flights[0], 6)
    log.extra["label_Ty"] = np.where(np.arange(6) == 4, np.nan, log.extra["label_Ty"])
    if damage == "lost":
        del log.extra["label_Ty"]
    write_episode_log(tmp_path / "logs" / "episode_1.parquet", log)
    message = r"'label_Ty' holds nan in row 4" if damage == "gap" else "all six are needed, or none"
    with pytest.raises(FileFormatError, match=rf"episode_1\.parquet: .*{message}"):
        run(tmp_path / "logs", tmp_path / "d", images="none")


def test_as_many_as_were_asked_for_are_kept_where_some_cannot_be_read(flights, tmp_path):
    for number, log in enumerate(flights[:3]):
        write_episode_log(tmp_path / "logs" / f"episode_{number}.parquet", short(log, 3))
    (tmp_path / "logs" / "episode_0.parquet").write_bytes(b"damaged")
    run(tmp_path / "logs", tmp_path / "d", images="none", num_episodes=2, skip_bad=True)
    assert DatasetReader(tmp_path / "d").about.column("source").tolist() == ["episode_1.parquet", "episode_2.parquet"]


def test_an_episode_that_is_too_short_is_named(flights, tmp_path):
    for number, steps in enumerate((9, 1)):
        write_episode_log(tmp_path / "logs" / f"episode_{number}.parquet", short(flights[0], steps))
    with pytest.raises(FileFormatError, match=r"episode_1\.parquet: episode: got 1 steps; allowed: at least 2 steps"):
        run(tmp_path / "logs", tmp_path / "d", images="none")
    assert not (tmp_path / "d").exists()


def test_hdf5_of_objects_is_refused_unread(flights, tmp_path):
    (tmp_path / "h").mkdir()
    objects = np.array([pickle.dumps("x").hex()] * 7, dtype=object)
    write_hdf5(tmp_path / "h" / "episode_0.hdf5", short(flights[0], 6), action=objects)
    with pytest.raises(FileFormatError, match=r"episode_0\.hdf5: 'action' has dtype object"):
        run(tmp_path / "h", tmp_path / "d", format="hdf5")
    assert not (tmp_path / "d").exists()


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("an object was unpickled",))


def test_a_pickle_in_an_archive_is_never_opened(flights, tmp_path):
    log = short(flights[0], 6)
    (tmp_path / "n").mkdir()
    file = tmp_path / "n" / "episode_0.npz"
    np.savez(file, state=log.state, action=np.array([Bomb()] * 6, dtype=object))
    with pytest.raises(FileFormatError, match=r"episode_0\.npz: 'action' holds Python objects"):
        run(tmp_path / "n", tmp_path / "d", format="npz", images="none")
    file.write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(FileFormatError, match=r"episode_0\.npz"):
        run(tmp_path / "n", tmp_path / "d2", format="npz", images="none")


def test_numpy_archives_without_times_take_the_given_step(flights, tmp_path):
    log = short(flights[0], 6)
    (tmp_path / "n").mkdir()
    np.savez(tmp_path / "n" / "episode_3.npz", state=np.delete(log.state, 6, axis=1), action=log.action)
    run(tmp_path / "n", tmp_path / "d", format="npz", images="none", step_s=0.5)
    rows = next(DatasetReader(tmp_path / "d").iterate()).rows
    np.testing.assert_array_equal(rows[schema.CONTROL_DT][:, 0], np.float32(0.5))
    report = check_dataset(tmp_path / "d")
    assert report.errors == [], "nobody claimed these times"
    (position,) = (text for text in report.warnings if "position_m" in text)
    assert position.startswith("1 of 1 episodes: the next state does not follow"), "physics finds out wrong times"


def test_minari(flights, tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    import gymnasium as gym
    from minari.data_collector import EpisodeBuffer

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    env = gym.make("SpaceDock-v0", obs_type="agent_pos", max_steps=8)
    buffers = []
    for number, seed in enumerate((3, 4)):
        observation, info = env.reset(seed=seed)
        seen, infos, rewards = [observation["agent_pos"]], [info], []
        for k in range(8):
            observation, reward, *_, info = env.step(np.full(6, float(k), dtype=np.float32))
            seen.append(observation["agent_pos"])
            infos.append(info)
            rewards.append(reward)
        buffers.append(
            EpisodeBuffer(
                id=number,
                seed=seed,
                observations={"agent_pos": np.array(seen)},
                actions=np.repeat(np.arange(8.0, dtype=np.float32)[:, None], 6, axis=1),
                rewards=rewards,
                terminations=[False] * 8,
                truncations=[False] * 7 + [True],
                infos={name: np.array([info[name] for info in infos]) for name in ("time_s", "state", "is_success")},
            )
        )
    minari.create_dataset_from_buffers("spacedock/test-v0", buffers, env=env, algorithm_name="ramp")
    env.close()
    run(tmp_path / "minari" / "spacedock" / "test-v0", tmp_path / "d", format="minari", images="none")
    logs = logs_of(tmp_path / "d")
    assert [log.num_steps for log in logs] == [8, 8]
    np.testing.assert_array_equal(logs[1].action[:, 0], np.arange(8.0))
    report = check_dataset(tmp_path / "d")
    assert report.errors == []
    assert report.worst["position_m"] < 1e-4, "the true times and states came with the infos"


def recorded(monkeypatch, env_id, seed=3, *, dynamics=True, **options):
    """Flies a few steps as Minari records them; Minari itself is stood for by the three things that are read of it.

    Returns what the environment showed, and its true states.
    """
    env = gym.make(env_id, obs_type="agent_pos", **options)
    observation, info = env.reset(seed=seed)
    seen, infos = [observation["agent_pos"]], [info | {"dynamics": env.unwrapped.dynamics}]
    for _ in range(6):
        observation, *_, info = env.step(np.ones(6, dtype=np.float32))
        seen.append(observation["agent_pos"])
        infos.append(info | {"dynamics": env.unwrapped.dynamics})
    env.close()
    kept = {name: np.array([info[name] for info in infos]) for name in ("time_s", "state", "is_success")}
    drawn = {name: np.array([info["dynamics"][name] for info in infos]) for name in infos[0]["dynamics"]}
    episode = types.SimpleNamespace(
        observations={"agent_pos": np.array(seen)},
        actions=np.ones((6, 6), dtype=np.float32),
        rewards=np.zeros(6),
        infos=kept | ({"dynamics": drawn} if dynamics else {}),
    )
    held = types.SimpleNamespace(
        episode_indices=[0],
        iterate_episodes=lambda indices: iter([episode]),
        env_spec=env.spec,
        storage=types.SimpleNamespace(get_episode_metadata=lambda indices: [{"seed": seed}]),
    )
    monkeypatch.setitem(sys.modules, "minari", types.SimpleNamespace(load_dataset=lambda name: held))
    return np.array(seen), kept["state"]


@pytest.mark.parametrize("env_id", ["SpaceDockMeta-v0", "SpaceDock-v0", "SpaceDockVision-v0"])
def test_what_imperfect_sensors_showed_is_kept_beside_the_truth(tmp_path, monkeypatch, env_id):
    seen, states = recorded(monkeypatch, env_id)
    run("some/where-v0", tmp_path / "d", format="minari", images="none")
    rows = next(DatasetReader(tmp_path / "d").iterate()).rows
    np.testing.assert_array_equal(rows["observation.state"], seen[:-1])
    np.testing.assert_array_equal(rows["true_state"], states[:-1].astype(np.float32))
    (log,) = logs_of(tmp_path / "d")
    assert bool(log.extra.keys() & {"observed_x", "observed_vx"}) is (env_id == "SpaceDockMeta-v0")


def test_a_recording_knows_its_environment_its_seed_and_the_chaser_that_was_drawn(tmp_path, monkeypatch):
    seed = 2**63 + 7  # Minari draws seeds of 64 bits
    recorded(monkeypatch, "SpaceDockMeta-v0", seed, sun="random", port="harmony_forward")
    run("some/where-v0", tmp_path / "d", format="minari", images="none", camera=CameraFlags())
    reader = DatasetReader(tmp_path / "d")
    assert reader.about.column("seed").tolist() == [seed]
    flags = " ".join(dataset_env_flags(reader))
    assert all(f"--env.{flag}" in flags for flag in ("task=SpaceDockMeta-v0", "sun=random", "port=harmony_forward"))
    report = check_dataset(tmp_path / "d")
    assert (report.errors, report.checks["dynamics"]) == ([], 1)
    assert report.worst["attitude_rad"] < 1e-5


def test_a_chaser_that_the_recording_does_not_know_is_not_held_against_it(tmp_path, monkeypatch, capsys):
    recorded(monkeypatch, "SpaceDockMeta-v0", dynamics=False)
    run("some/where-v0", tmp_path / "d", format="minari", images="none")
    assert "chaser that was drawn not in the source" in capsys.readouterr().out
    report = check_dataset(tmp_path / "d")
    assert (report.errors, report.checks["dynamics"]) == ([], 0)
    assert any("chaser that was drawn not in the source" in note for note in report.notes)


def test_select_keeps_the_best_by_the_stated_rule(flights, log_folder, tmp_path):
    run(log_folder, tmp_path / "d", images="none", num_episodes=2, select="propellant")
    used = [log.state[0, 6] - log.state[-1, 6] for log in flights]
    kept = [log.metadata["seed"] for log in logs_of(tmp_path / "d")]
    assert kept == sorted(flights[i].metadata["seed"] for i in np.argsort(used)[:2])


def test_segments_and_their_repeats(flights, log_folder, tmp_path):
    run(log_folder, tmp_path / "d", images="none", segment="last:10m", repeat_terminal=2)
    reader = DatasetReader(tmp_path / "d")
    assert len(reader.lengths) == 3 * len(flights)
    assert reader.about.column("repeat")[:3].tolist() == [0, 1, 2]
    assert reader.lengths[0] == flights[0].num_steps
    assert reader.lengths[1] == reader.lengths[2] < reader.lengths[0]
    assert check_dataset(tmp_path / "d").errors == []


@pytest.mark.parametrize(
    ("options", "flag"),
    [
        ({"format": "rosbag"}, "--format"),
        ({"select": "luck"}, "--select"),
        ({"images": "maybe"}, "--images"),
        ({"num_episodes": 99}, "--num_episodes"),
        ({"segment": "half"}, "--segment"),
        ({"repeat_terminal": 2}, "--repeat_terminal"),
        ({"select": "distance"}, "--num_episodes"),
        ({"successes_first": True}, "--num_episodes"),
        ({"source": "/nonexistent"}, "--source"),
        ({"repo_id": "nouser"}, "--repo_id"),
        ({"repo_id": "me/two--dashes"}, "--repo_id"),
        ({"repo_id": "me/dot."}, "--repo_id"),
        ({"num_workers": -1}, "--num_workers"),
        ({"storage": Storage("video", vcodec="gif")}, "--storage"),
    ],
)
def test_what_cannot_be_used_is_said_by_its_flag(log_folder, tmp_path, options, flag):
    base = {"source": str(log_folder), "repo_id": "test/x", "root": str(tmp_path / "d"), "camera": CAMERA}
    with pytest.raises(InputError, match=flag):
        convert(ConvertConfig(**(base | {"num_workers": 1} | options)))
    assert not (tmp_path / "d").exists()


def test_an_existing_root_is_left_alone(log_folder, tmp_path):
    root = tmp_path / "d"
    root.mkdir()
    (root / "mine.txt").write_text("precious")
    with pytest.raises(InputError, match="does not exist"):
        run(log_folder, root)
    assert (root / "mine.txt").read_text() == "precious"
    assert [p.name for p in tmp_path.iterdir()] == ["d"]


def test_an_unfinished_job_goes_on_only_with_its_own_settings(raw_export, tmp_path):
    BROKEN_RAW["truncated"][0](raw_export)
    root = tmp_path / "d"
    with pytest.raises(FileFormatError):
        run(raw_export, root, format="raw")
    with pytest.raises(InputError, match="with_mass was None, now True"):
        run(raw_export, root, format="raw", with_mass=True)
    shutil.copy(raw_export / "imgs" / "img_traj_1_step_3.png", raw_export / "imgs" / "img_traj_1_step_4.png")
    run(raw_export, root, format="raw")
    assert check_dataset(root).errors == []


def test_what_cannot_be_read_may_be_skipped_by_the_job_that_stopped_at_it(raw_export, tmp_path, monkeypatch):
    BROKEN_RAW["truncated"][0](raw_export)
    root = tmp_path / "d"
    with pytest.raises(FileFormatError):
        run(raw_export, root, format="raw")
    done = [path.stat().st_mtime_ns for path in (tmp_path / "d.part" / "shards").glob("shard_*")]
    assert len(done) == 1
    monkeypatch.setattr("sys.argv", ["spacedock", "convert", "--skip_bad"])
    run(raw_export, root, format="raw", skip_bad=True)
    assert check_dataset(root).errors == []
    facts = json.loads((root / "meta" / "spacedock.json").read_text())
    assert [name for name, _ in facts["left_out"]] == ["raw#1"]
    assert facts["command"] == "spacedock convert --skip_bad"
    assert str(tmp_path) not in json.dumps(facts), "nothing of this machine is published"


def test_a_job_that_failed_before_it_made_anything_begins_anew_with_other_settings(log_folder, tmp_path):
    with pytest.raises(InputError, match="--source"):
        run(tmp_path / "mistyped", tmp_path / "d")
    run(log_folder, tmp_path / "d")
    assert check_dataset(tmp_path / "d").errors == []


def test_pictures_of_another_size_are_scaled(flights, tmp_path):
    folder = tmp_path / "raw"
    write_raw_export(folder, [short(flights[0], 6)], pictures=True)
    run(folder, tmp_path / "d", format="raw", camera=CameraConfig(height=24, width=32), storage=Storage("image"))
    dataset = LeRobotDataset("test/converted", root=tmp_path / "d")
    assert tuple(dataset[2][schema.IMAGE].shape) == (3, 24, 32)
    np.testing.assert_allclose(dataset[2][schema.IMAGE][0].numpy() * 255, picture_of(2)[0, 0, 0], atol=1)


@pytest.mark.render
def test_arrays_without_pictures_are_drawn_and_the_check_compares_them(flights, tmp_path):
    log = short(flights[0], 4)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "episode_0.npz").write_bytes(b"damaged")
    np.savez(tmp_path / "in" / "episode_1.npz", state=log.state, action=log.action, time=log.time)
    run(tmp_path / "in", tmp_path / "d", format="npz", skip_bad=True, storage=Storage("image"))
    assert json.loads((tmp_path / "d" / "meta" / "spacedock.json").read_text())["pictures"] == "drawn"
    report = check_dataset(tmp_path / "d")
    assert report.errors == []
    assert report.psnr_dB[0] > 45.0


@pytest.mark.parametrize("times", [False, True])
def test_arrays_without_times_or_mass_pass_the_check_which_says_what_it_left_out(flights, tmp_path, times):
    log = flights[0]
    (tmp_path / "in").mkdir()
    held = {"state": np.delete(log.state, 6, axis=1), "action": log.action} | ({"time": log.time} if times else {})
    np.savez(tmp_path / "in" / "episode_0.npz", **held)
    run(tmp_path / "in", tmp_path / "d", format="npz", images="none")
    report = check_dataset(tmp_path / "d")
    assert report.errors == []
    assert any("times are not in the source: 0.907 s a step" in note for note in report.notes) is not times
    assert any("does not follow" in text for text in report.warnings) is not times
    assert "mass_kg" not in report.worst


def test_arrays_without_mass_whose_commands_are_not_those_that_flew_fail_the_check(flights, tmp_path):
    log = flights[0]
    (tmp_path / "in").mkdir()
    np.savez(
        tmp_path / "in" / "episode_0.npz",
        state=np.delete(log.state, 6, axis=1),
        action=np.roll(log.action, 1, axis=0),
        time=log.time,
    )
    run(tmp_path / "in", tmp_path / "d", format="npz", images="none")
    assert any("does not follow from the command" in error for error in check_dataset(tmp_path / "d").errors)


def test_what_was_assumed_is_said_on_screen_and_kept(flights, tmp_path, capsys):
    (tmp_path / "in").mkdir()
    for number, log in enumerate(flights[:2]):
        held = {"state": np.delete(log.state, 6, axis=1), "action": log.action}
        np.savez(tmp_path / "in" / f"episode_{number}.npz", **held)
    run(tmp_path / "in", tmp_path / "d", format="npz", images="none")
    shown = capsys.readouterr().out
    expected = [
        "mass not in the source: the nominal mass stands in its place (2 episodes)",
        "rewards not in the source: 0 stands in their place (2 episodes)",
        "times not in the source: 0.907 s a step (2 episodes)",
    ]
    assert [line.strip() for line in shown.splitlines() if "not in the source" in line] == expected
    assert json.loads((tmp_path / "d" / "meta" / "spacedock.json").read_text())["notes"] == expected


def test_where_the_source_does_not_say_whether_it_docked_the_states_do(flights, tmp_path):
    logs = [short(flights[0], 9), *flights]
    write_raw_export(tmp_path / "raw", logs, pictures=False)
    docked = [number for number, log in enumerate(logs) if number and log.metadata["success"]]
    assert 0 < len(docked) < len(flights), "a sample that shows nothing"
    options = {"num_episodes": len(docked), "select": "propellant", "successes_first": True}
    run(tmp_path / "raw", tmp_path / "d", format="raw", images="none", **options)
    about = DatasetReader(tmp_path / "d").about
    assert about.column("success").all()
    assert about.column("source").tolist() == [f"raw#{number}" for number in docked], "the short one used least"


def test_the_command_is_kept_as_a_shell_takes_it(log_folder, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["/opt/bin/spacedock", "convert", "--task=dock with the ISS", "--images=none"])
    run(log_folder, tmp_path / "d", images="none")
    kept = json.loads((tmp_path / "d" / "meta" / "spacedock.json").read_text())["command"]
    assert kept == "spacedock convert '--task=dock with the ISS' --images=none"


def test_a_source_without_rewards_is_not_ranked_by_them(raw_export, tmp_path):
    with pytest.raises(InputError, match=r"--select: got return.* not in the source"):
        run(raw_export, tmp_path / "d", format="raw", images="none", num_episodes=1, select="return")
    assert not (tmp_path / "d").exists()


@pytest.fixture(scope="module")
def harmony():
    """Dockings at the other port."""
    flown = fly_some(range(100_000, 100_003), port="harmony_forward")
    assert any(log.metadata["success"] for log in flown)
    return flown


def write_arrays(folder, logs, **more):
    folder.mkdir()
    for number, log in enumerate(logs):
        held = {"state": log.state, "action": log.action, "time": log.time} | more
        np.savez(folder / f"episode_{number}.npz", **held)


def test_flights_of_others_are_judged_at_the_port_that_is_given(harmony, tmp_path):
    write_arrays(tmp_path / "in", harmony)
    options = {"format": "npz", "images": "none", "camera": CameraFlags()}
    docked = [log.metadata["success"] for log in harmony]
    for name, port in (("a", {"port": "harmony_forward"}), ("b", {"camera": CameraFlags(port="harmony_forward")})):
        run(tmp_path / "in", tmp_path / name, **options | port)
        reader = DatasetReader(tmp_path / name)
        assert reader.about.column("success").tolist() == docked
        assert {log.metadata["port"] for log in logs_of(tmp_path / name)} == {"harmony_forward"}
        assert "--env.port=harmony_forward" in dataset_env_flags(reader)
        assert "- port: harmony_forward" in (tmp_path / name / "README.md").read_text()
    run(tmp_path / "in", tmp_path / "z", **options)
    assert not DatasetReader(tmp_path / "z").about.column("success").any()
    run(tmp_path / "z", tmp_path / "again", **options | {"format": "lerobot", "port": "harmony_forward"})
    assert DatasetReader(tmp_path / "again").about.column("success").tolist() == docked, "whoever judged did not know"
    run(tmp_path / "a", tmp_path / "part", **options | {"format": "lerobot", "segment": "last:5"})
    assert "--env.port=harmony_forward" in dataset_env_flags(DatasetReader(tmp_path / "part"))


def test_the_camera_follows_the_port(harmony, tmp_path):
    write_arrays(tmp_path / "in", [short(harmony[0], 3)])
    camera = CameraFlags(height=16, width=24)
    run(tmp_path / "in", tmp_path / "d", format="npz", port="harmony_forward", camera=camera, storage=Storage("image"))
    facts = json.loads((tmp_path / "d" / "meta" / "spacedock.json").read_text())
    assert facts["drawing"]["camera"]["port"] == "harmony_forward"


@pytest.mark.parametrize(
    ("options", "flag"),
    [
        ({"port": "moon"}, "--port.*zvezda_aft | harmony_forward"),
        ({"port": "zvezda_aft", "camera": CameraFlags(port="harmony_forward")}, "--camera.port"),
        ({"port": "harmony_forward"}, r"--port.*zvezda_aft, which episode_1\d+\.parquet names"),
        ({"camera": CameraFlags(vfov_deg=500.0)}, "camera.vfov_deg"),
        ({"renderer": "crayon", "images": "draw"}, "renderer"),
    ],
)
def test_a_port_that_contradicts_the_source_is_refused(log_folder, tmp_path, options, flag):
    with pytest.raises(InputError, match=flag):
        run(log_folder, tmp_path / "d", **{"images": "none", "camera": CameraFlags()} | options)
    assert not (tmp_path / "d").exists()


def env_of(root) -> dict:
    return json.loads((root / "meta" / "spacedock.json").read_text())["env"]


def test_pictures_of_logs_are_drawn_as_the_logs_state_and_flags_override(tmp_path):
    sensor = {"blur_px": 0.5, "bloom_px": 3.0}
    camera = {"height": 16, "width": 24, "vfov_deg": 45.0, "samples": 1, "sensor": sensor}
    log = short(fly_some([7], sun="orbit", camera=camera, renderer="software")[0], 3)
    write_episode_log(tmp_path / "logs" / "episode_000007.parquet", log)
    options = {"camera": CameraFlags(), "storage": Storage("image")}
    run(tmp_path / "logs", tmp_path / "d", **options)
    env = env_of(tmp_path / "d")
    assert (env["sun"], env["camera"]["vfov_deg"], env["camera"]["samples"]) == ("orbit", 45.0, 1)
    assert (env["camera"]["height"], env["camera"]["width"], env["camera"]["sensor"]["blur_px"]) == (16, 24, 0.5)
    report = check_dataset(tmp_path / "d")
    assert (report.errors, report.psnr_dB[0] > 45.0) == ([], True)
    # what equals a default is asked for all the same
    asked = CameraFlags(vfov_deg=60.0, height=20, sensor=SensorFlags(blur_px=0.0))
    run(tmp_path / "logs", tmp_path / "asked", **options | {"camera": asked, "sun": "fixed"})
    env = env_of(tmp_path / "asked")
    assert (env["sun"], env["camera"]["vfov_deg"], env["camera"]["samples"]) == ("fixed", 60.0, 1)
    assert (env["camera"]["height"], env["camera"]["width"]) == (20, 24)
    assert (env["camera"]["sensor"]["blur_px"], env["camera"]["sensor"]["bloom_px"]) == (0.0, 3.0)


def write_logs(folder, *logs):
    for log in logs:
        write_episode_log(folder / f"episode_{log.metadata['seed']:06d}.parquet", short(log, 3))


def test_flights_to_two_ports_make_no_dataset(flights, harmony, tmp_path):
    write_logs(
        tmp_path / "logs", flights[4], dataclasses.replace(harmony[0], metadata={"seed": 9, "port": "harmony_forward"})
    )
    with pytest.raises(InputError, match=r"episode_100004\.parquet at zvezda_aft; allowed: flights to harmony_forward"):
        run(tmp_path / "logs", tmp_path / "d", images="none", camera=CameraFlags())
    assert not (tmp_path / "d").exists()
    run(tmp_path / "logs", tmp_path / "d", images="none", camera=CameraFlags(), skip_bad=True)
    assert len(DatasetReader(tmp_path / "d").lengths) == 1


def test_pictures_that_flights_state_differently_are_not_drawn_alike_unless_asked(tmp_path):
    write_logs(tmp_path / "logs", *fly_some([1], sun="orbit"), *fly_some([2], sun="random"))
    options = {"camera": CameraFlags(height=16, width=24, samples=1), "storage": Storage("image")}
    with pytest.raises(InputError, match=r"episode_000002\.parquet with sun=random; allowed: sun=orbit.*Give --sun"):
        run(tmp_path / "logs", tmp_path / "d", **options)
    run(tmp_path / "logs", tmp_path / "asked", **options, sun="fixed")
    assert check_dataset(tmp_path / "asked").errors == []
    run(tmp_path / "logs", tmp_path / "none", **options | {"images": "none"})


@pytest.mark.parametrize("format", ["npz", "hdf5", "logs", "lerobot"])
def test_a_source_with_nothing_in_it_leaves_no_folder_behind(tmp_path, format):
    (tmp_path / "empty").mkdir()
    with pytest.raises((InputError, FileFormatError)):
        run(tmp_path / "empty", tmp_path / "d", format=format)
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


def test_flights_of_several_environments_are_told_of_where_one_is_named(tmp_path, capsys):
    here, there = fly_some([1]), fly_some([2])
    there[0].metadata["env_id"] = "SpaceDock-v0"
    write_logs(tmp_path / "logs", *here, *there)
    run(tmp_path / "logs", tmp_path / "d", images="none", camera=CameraFlags())
    said = "flown in SpaceDock-v0, where the environment named is the first flight's, SpaceDockContact-v0"
    assert f"{said} (1 episodes)" in capsys.readouterr().out
    assert said in (tmp_path / "d" / "README.md").read_text()


def test_pictures_keep_their_size_unless_another_is_given(raw_export, tmp_path):
    options = {"format": "raw", "storage": Storage("image")}
    for camera, size in (
        (CameraFlags(), (HEIGHT, WIDTH)),
        (CameraFlags(height=480, width=640), (480, 640)),
        (CameraFlags(height=24, width=32), (24, 32)),
    ):
        root = tmp_path / str(size)
        run(raw_export, root, camera=camera, **options)
        assert tuple(DatasetReader(root).features[schema.IMAGE]["shape"][:2]) == size
    run(tmp_path / "(24, 32)", tmp_path / "again", format="lerobot", camera=CameraFlags(), storage=Storage("image"))
    assert tuple(DatasetReader(tmp_path / "again").features[schema.IMAGE]["shape"][:2]) == (24, 32)


def test_a_size_that_video_cannot_hold_is_said_with_the_flags_that_mend_it(flights, tmp_path):
    odd = np.zeros((7, 47, 63, 3), dtype=np.uint8)
    write_arrays(tmp_path / "in", [short(flights[0], 6)], images=odd)
    with pytest.raises(InputError, match=r"47x63.*--camera\.height"):
        run(tmp_path / "in", tmp_path / "d", format="npz", camera=CameraFlags())
    run(tmp_path / "in", tmp_path / "d", format="npz", camera=CameraFlags(height=46, width=62))


def test_the_flags_of_the_camera_reach_it_through_the_command_line():
    arguments = ["--source=a", "--repo_id=b/c", "--camera.height=480", "--camera.lamp=on", "--camera.shadows=false"]
    camera = parse_config(ConvertConfig, [*arguments, "--camera.sensor.seed=3"], prog="convert").camera
    assert (camera.height, camera.width, camera.lamp, camera.shadows) == (480, None, "True", False)
    assert (camera.sensor.seed, camera.sensor.blur_px) == (3, None)
    assert over(camera, CameraConfig(width=100)) == CameraConfig(
        480, 100, lamp="on", shadows=False, sensor=SensorConfig(seed=3)
    )
