"""``spacedock view``: pictures, films and Rerun recordings of logs and of datasets."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from synthetic_logs import fly

from lerobot_spacedock.camera.config import CameraConfig
from lerobot_spacedock.camera.pinhole import project_points
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.stored_episode import DatasetEpisode
from lerobot_spacedock.episode_log import write_episode_log
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.physics.contact import ZVEZDA_AFT, contact_state
from lerobot_spacedock.report.instruments import overlay, readings
from lerobot_spacedock.report.interpolate import dense, slerp, states_at
from lerobot_spacedock.report.rerun_scene import show_episode
from lerobot_spacedock.report.video import film_times, write_film
from lerobot_spacedock.report.view import ViewConfig, view


@pytest.fixture(scope="module")
def log_file(tmp_path_factory):
    return write_episode_log(tmp_path_factory.mktemp("log") / "episode_000007.parquet", fly(7, steps=6))


def make_dataset(root, log, frames, camera=schema.IMAGE):
    """A v3 dataset of one episode with its pictures as PNG, laid out by hand as LeRobot does."""
    import io

    steps = log.num_steps
    cells = []
    for frame in frames:
        buffer = io.BytesIO()
        Image.fromarray(frame).save(buffer, "PNG")
        cells.append({"bytes": buffer.getvalue(), "path": None})
    columns = {
        schema.STATE: list(log.state[:-1, [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12, 13]].astype(np.float32)),
        schema.ACTION: list(log.action.astype(np.float32)),
        schema.CONTROL_DT: [[v] for v in log.dt.astype(np.float32)],
        schema.SIM_TIME: [[v] for v in log.time[:-1].astype(np.float32)],
        camera: cells,
        "timestamp": np.arange(steps, dtype=np.float32),
        "episode_index": np.zeros(steps, np.int64),
    }
    (root / "data" / "chunk-000").mkdir(parents=True)
    pq.write_table(pa.table(columns), root / "data" / "chunk-000" / "file-000.parquet")
    (root / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
    listing = {"episode_index": [0], "length": [steps], "data/chunk_index": [0], "data/file_index": [0]}
    pq.write_table(pa.table(listing), root / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    features = {name: {"dtype": "image" if name == camera else "float32"} for name in columns}
    info = {
        "codebase_version": "v3.0",
        "total_episodes": 1,
        "fps": 1,
        "features": features,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    }
    (root / "meta" / "info.json").write_text(json.dumps(info))
    return root


def test_a_recording_holds_scene_motion_and_box(log_file, tmp_path):
    rerun = pytest.importorskip("rerun")
    path = tmp_path / "a.rrd"
    rerun.init("strict", strict=True)
    assert view(ViewConfig(log=log_file, save=path, camera=False)) == 0
    content = path.read_bytes()
    assert content[:4] == b"RRF2"
    assert len(content) > 300_000  # the station's mesh is in it
    for entity in (
        b"world/station",
        b"world/chaser",
        b"world/path",
        b"world/thrust",
        b"plots/box/idss",
        b"flight_time",
    ):
        assert entity in content, entity


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """An episode whose attitude turns about no axis of its own, and what a recording of it holds, by entity."""
    reader = pytest.importorskip("rerun.chunk").RrdReader
    triangle = np.eye(3), np.eye(3), np.zeros((3, 3), np.uint8)
    monkeypatch.setattr("lerobot_spacedock.report.rerun_scene.station_vertices", lambda port, detail: triangle)
    log = fly(3, steps=2)
    log.state[:, 7:11] = np.array([[4, -6, 2, 5], [5, -5, 1, 7], [1, 9, -3, -3]]) / [[9], [10], [10]]
    frames = [np.zeros((12, 16, 3), np.uint8)] * 2
    show_episode(log, frames, vfov_deg=50.0, save=tmp_path / "a.rrd", name="a")
    found = {}
    for chunk in reader(str(tmp_path / "a.rrd")).stream():
        batch = chunk.to_record_batch()
        columns = {name: batch.column(name).to_pylist() for name in batch.schema.names if ":" in name}
        found.setdefault(chunk.entity_path, {}).update(columns)
    return log, found


def test_a_recorded_camera_sees_a_point_where_the_packages_own_does(recorded):
    """Rerun's chain: matrices column by column, quaternions xyzw, and a camera that looks along z with y down."""
    log, found = recorded
    (focal,), (turn,), (size,) = (
        np.array(found["/world/chaser/camera"][name][0])
        for name in ("Pinhole:image_from_camera", "Transform3D:mat3x3", "Pinhole:resolution")
    )
    assert size.tolist() == [16, 12]
    camera = CameraConfig(height=12, width=16, vfov_deg=50.0)
    points = np.array([[3.0, -9.0, 2.0], [0.0, 0.0, 0.0], [40.0, 1.0, -7.0]])
    pose = found["/world/chaser"]
    for k, state in enumerate(log.state):
        (translation,), (xyzw,) = pose["Transform3D:translation"][k], pose["Transform3D:quaternion"][k]
        in_chaser = Rotation.from_quat(xyzw).inv().apply(points - translation)
        in_camera = in_chaser @ turn.reshape(3, 3, order="F")
        image = in_camera @ focal.reshape(3, 3, order="F").T
        expected = project_points(camera, state[:3], state[7:11], points)
        np.testing.assert_allclose(image[:, :2] / image[:, 2:], expected[:, :2], atol=1e-3, rtol=1e-4)
        np.testing.assert_allclose(image[:, 2], expected[:, 2], atol=1e-4)


def test_a_recorded_chaser_lies_behind_the_tip_that_docks(recorded):
    body = recorded[1]["/world/chaser/body"]
    centre, half = np.array(body["Boxes3D:centers"][0][0]), np.array(body["Boxes3D:half_sizes"][0][0])
    assert (centre - half).tolist() == [-1, -1, -2]
    assert (centre + half).tolist() == [1, 1, 0]


def test_a_dataset_gives_its_states_commands_and_frames_back(tmp_path):
    log = fly(3, steps=5)
    frames = [np.full((12, 16, 3), 40 * k, np.uint8) for k in range(5)]
    episode = DatasetEpisode(make_dataset(tmp_path / "set", log, frames), 0)
    back = episode.log()
    assert back.state[:, :3] == pytest.approx(log.state[:-1, :3], abs=1e-5)  # no terminal state is kept here
    assert back.action == pytest.approx(log.action[:-1], abs=1e-5)
    assert back.time == pytest.approx(log.time[:-1], abs=1e-5)
    assert all(np.array_equal(a, b) for a, b in zip(episode.frames(), frames, strict=True))
    pytest.importorskip("rerun")
    assert view(ViewConfig(dataset=tmp_path / "set", save=tmp_path / "d.rrd")) == 0
    assert b"world/chaser/camera" in (tmp_path / "d.rrd").read_bytes()


def test_the_pictures_of_a_dataset_are_shown_whatever_its_only_camera_is_called(tmp_path, monkeypatch):
    frames = [np.full((12, 16, 3), 40 * k, np.uint8) for k in range(5)]
    root = make_dataset(tmp_path / "set", fly(3, steps=5), frames, camera="observation.images.front")
    shown = []
    monkeypatch.setattr("lerobot_spacedock.report.view.show_episode", lambda log, seen, **_: shown.extend(seen))
    assert view(ViewConfig(dataset=root, save=tmp_path / "d.rrd")) == 0
    assert len(shown) == 5
    assert all(np.array_equal(a, b) for a, b in zip(shown, frames, strict=True))


def test_without_a_display_nothing_is_drawn_for_one(log_file, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("lerobot_spacedock.report.view.show_episode", lambda *_, **__: pytest.fail("drawn"))
    with pytest.raises(InputError, match=r"--save: got nothing, where there is no display; allowed: --save=FILE\.rrd"):
        view(ViewConfig(log=log_file))


def test_mistakes_are_named(log_file, tmp_path):
    for options, message in (
        ({}, "one of the two"),
        ({"log": tmp_path / "no.parquet"}, "--log"),
        ({"log": log_file, "video": tmp_path / "a.avi"}, r"\.mp4 or \.gif"),
        ({"log": log_file, "save": tmp_path / "a.txt"}, r"\.rrd"),
        ({"log": log_file, "fps": 0.0}, "--fps"),
        ({"log": log_file, "video": tmp_path / "a.gif", "fps": 60.0}, "up to 50 in a GIF"),
        ({"dataset": tmp_path}, "meta/info.json"),
    ):
        with pytest.raises(InputError, match=message):
            view(ViewConfig(**options))
    old = tmp_path / "old"
    (old / "meta").mkdir(parents=True)
    (old / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v2.1", "total_episodes": 1}))
    with pytest.raises(FileFormatError, match="v3"):
        DatasetEpisode(old, 0)


@pytest.mark.render
def test_a_picture_shows_the_station_and_its_instruments(log_file, tmp_path):
    path = tmp_path / "p.png"
    assert view(ViewConfig(log=log_file, render=path, height=72, width=128, at=1.0, detail="low")) == 0
    image = np.asarray(Image.open(path))
    assert image.shape[1] == 128
    assert image.shape[0] > 72
    assert image[:72].std() > 10


def test_instruments_read_what_the_contact_box_limits():
    state = np.zeros(14)
    state[[1, 4, 0]], state[7:11] = (-3.0, 0.12, 0.05), (np.sqrt(0.5), -np.sqrt(0.5), 0, 0)
    shown = {r.name: r for r in readings(contact_state(state, ZVEZDA_AFT, hill_coupling=False), 3.0)}
    assert (shown["RANGE"].value, shown["RANGE"].inside) == ("3.00", None)
    assert (shown["CLOSING"].value, shown["CLOSING"].inside) == ("+0.120", False)
    assert (shown["LATERAL"].value, shown["LATERAL"].inside) == ("0.050", True)
    picture = overlay(np.zeros((101, 201, 3), np.uint8), tuple(shown.values()), time_s=1.0, caption="x")
    assert picture.shape[0] % 2 == picture.shape[1] % 2 == 0
    assert picture.shape[0] > 101


def test_states_between_are_exact_where_the_flight_is_simple():
    log = fly(1, steps=4)
    t = log.time
    log.state[:, 1] = -20 + 0.3 * t - 0.01 * t**2
    log.state[:, 4] = 0.3 - 0.02 * t
    time = np.linspace(0, t[-1], 37)
    states = states_at(log, time)
    assert states[:, 1] == pytest.approx(-20 + 0.3 * time - 0.01 * time**2, abs=1e-12)
    assert states[:, 4] == pytest.approx(0.3 - 0.02 * time, abs=1e-12)
    assert states_at(log, t)[:, :6] == pytest.approx(log.state[:, :6])
    assert dense(log, time).num_steps == 36


def test_slerp_turns_at_constant_rate_the_short_way():
    angle = np.radians(50.0)
    p, q = np.array([[1.0, 0, 0, 0]]), np.array([[np.cos(angle / 2), np.sin(angle / 2), 0, 0]])
    for s in (0.0, 0.25, 0.8, 1.0):
        expected = [np.cos(s * angle / 2), np.sin(s * angle / 2), 0, 0]
        assert slerp(p, -q, np.array([[s]]))[0] == pytest.approx(expected, abs=1e-12)
    assert slerp(p, p, np.array([[0.5]]))[0] == pytest.approx(p[0])


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_films_decode_to_what_was_put_in(ending, tmp_path):
    colours = (30, 120, 220)
    pictures = [np.full((64, 96, 3), c, np.uint8) for c in colours]
    path = write_film(tmp_path / f"film{ending}", iter(pictures), 10.0)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    if ending == ".gif":
        with Image.open(path) as image:
            assert image.n_frames == 3
            seen = []
            for k in range(3):
                image.seek(k)
                seen.append(np.asarray(image.convert("RGB")).mean())
    else:
        import av

        with av.open(str(path)) as container:
            seen = [frame.to_ndarray(format="rgb24").mean() for frame in container.decode(video=0)]
        assert len(seen) == 3 + 20  # the last picture is held for two seconds
    assert seen[:3] == pytest.approx(colours, abs=6)


def test_a_film_runs_as_many_times_faster_as_it_says():
    log = fly(1)
    times = film_times(log, fps=24.0, speed=4.0)
    assert (len(times) - 1) / 24.0 * 4.0 == pytest.approx(log.time[-1], abs=4.0 / 24.0)
    assert (times[0], times[-1]) == (0.0, log.time[-1])


@pytest.mark.parametrize("fps", [7.0, 24.0, 30.0, 50.0])
def test_a_gif_lasts_as_long_as_its_pictures_a_second_say(fps, tmp_path):
    pictures = np.random.default_rng(0).integers(0, 255, (60, 16, 16, 3), dtype=np.uint8)
    with Image.open(write_film(tmp_path / "film.gif", iter(pictures), fps)) as image:
        held_ms = []
        for k in range(image.n_frames):
            image.seek(k)
            held_ms.append(image.info["duration"])
    assert sum(held_ms[:-1]) == pytest.approx(59_000 / fps, abs=10)
    assert held_ms[-1] == 2000


def test_a_film_too_long_to_hold_is_refused_before_it_is_drawn():
    log = fly(1)
    log.time[-1] = 1e12
    with pytest.raises(InputError, match="fewer than 100,000 pictures"):
        film_times(log, fps=24.0, speed=4.0)


@pytest.mark.parametrize("camera", [{"aperture": 3}, {"height": "tall"}, {"vfov_deg": []}, {"sensor": {"blur_px": -1}}])
@pytest.mark.parametrize("as_film", [True, False])
def test_a_camera_that_a_log_states_and_that_is_none_is_named_with_the_log(tmp_path, camera, as_film):
    path = write_episode_log(tmp_path / "odd.parquet", fly(1, steps=3, config={"camera": camera}))
    wanted = {"video": tmp_path / "a.mp4"} if as_film else {"render": tmp_path / "a.png"}
    with pytest.raises(FileFormatError, match=r"odd\.parquet"):
        view(ViewConfig(log=path, **wanted))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_options_that_the_user_gave_are_named_as_such(log_file, tmp_path):
    for option in ({"detail": "fine"}, {"renderer": "vulkan"}, {"height": 0}, {"at": float("nan")}):
        with pytest.raises(InputError, match=f"{next(iter(option))}: got"):
            view(ViewConfig(log=log_file, render=tmp_path / "a.png", **option))
