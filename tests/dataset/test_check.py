"""The check finds what it is for: every kind of damage, done to a good dataset, is named."""

import json
import re
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from dataset_samples import HEIGHT, WIDTH, fly_some
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.check import CheckConfig, check
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.record import Storage
from lerobot_spacedock.episode_log import write_episode_log
from lerobot_spacedock.errors import InputError


@pytest.fixture(scope="module")
def good(log_folder, tmp_path_factory):
    root = tmp_path_factory.mktemp("check") / "good"
    convert(ConvertConfig(str(log_folder), "test/good", root=str(root), images="none", num_workers=1))
    return root


@pytest.fixture
def copy(good, tmp_path):
    return shutil.copytree(good, tmp_path / "copy")


def edit(root, column: str, change) -> None:
    """Applies ``change`` to a column, (n, d), of the first data file."""
    path = root / "data" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(path)
    index = table.column_names.index(column)
    values = np.array(table.column(column).to_pylist())
    flat = values[:, None] if values.ndim == 1 else values
    changed = change(flat.copy())
    changed = changed[:, 0] if values.ndim == 1 else changed
    field = table.schema.field(column)
    table = table.set_column(index, field, pa.array(changed.tolist(), field.type))
    pq.write_table(table, path)


def edit_json(root, name: str, change) -> None:
    path = root / "meta" / name
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


def edit_listed(root, column: str, more: list[int]) -> None:
    """Adds to a column of ``meta/episodes``."""
    path = root / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(path)
    values = pa.array(np.array(table.column(column).to_pylist()) + more)
    pq.write_table(table.set_column(table.column_names.index(column), column, values), path)


def put(row: int, column: int, value: float):
    def change(values):
        values[row, column] = value
        return values

    return change


def swap_rows(values):
    values[[20, 30]] = values[[30, 20]]
    return values


def copy_episode(root) -> None:
    """The first frames of episode 0 written over those of episode 1, for all columns that tell them apart."""
    reader_lengths = pq.read_table(root / "meta" / "episodes" / "chunk-000" / "file-000.parquet")["length"].to_pylist()
    first, second = reader_lengths[:2]
    shorter = min(first, second)

    def change(values):
        values[first : first + shorter] = values[:shorter]
        return values

    for column in ("observation.state", "action", "true_state", "executed_action", "control_dt", "sim_time"):
        edit(root, column, change)


DAMAGE = {
    "not a number": (lambda r: edit(r, "action", put(7, 2, np.nan)), r"episode 0, frame 7: action is not finite"),
    "quaternion": (lambda r: edit(r, "true_state", put(9, 8, 0.9)), "episode 0, frame 9: the quaternion"),
    "time": (lambda r: edit(r, "sim_time", put(5, 0, 1.0)), "sim_time does not advance by control_dt"),
    "step": (lambda r: edit(r, "control_dt", put(5, 0, -0.9)), "control_dt is not positive"),
    "timestamp": (lambda r: edit(r, "timestamp", put(5, 0, 4.9)), "timestamp is not frame_index / fps"),
    "frame index": (lambda r: edit(r, "frame_index", put(5, 0, 50)), "frame_index does not count"),
    "swapped states": (lambda r: edit(r, "true_state", swap_rows), "does not follow from the command"),
    "swapped commands": (lambda r: edit(r, "executed_action", swap_rows), "does not follow from the command"),
    "shifted position": (lambda r: edit(r, "true_state", put(12, 0, 0.2)), "position_m off by"),
    "mass": (lambda r: edit(r, "true_state", put(12, 6, 1001.0)), "the mass grows"),
    "done": (lambda r: edit(r, "next.done", put(3, 0, True)), "next.done"),
    "far away": (lambda r: edit(r, "true_state", put(3, 1, -5e4)), "farther than"),
    "mean": (
        lambda r: edit_json(r, "stats.json", lambda s: s["action"]["mean"].__setitem__(1, 3.0)),
        r"mean of action\[Ty\] is 3",
    ),
    "std of the mass": (
        lambda r: edit_json(r, "stats.json", lambda s: s["true_state"]["std"].__setitem__(6, 0.7)),
        r"std of true_state\[mass\] is 0\.7",
    ),
    "least": (
        lambda r: edit_json(r, "stats.json", lambda s: s["action"]["min"].__setitem__(2, -1e-3)),
        r"min of action\[Tz\] is -0\.001",
    ),
    "most": (
        lambda r: edit_json(r, "stats.json", lambda s: s["observation.state"]["max"].__setitem__(1, 9.0)),
        r"max of observation\.state\[y\] is 9",
    ),
    "no statistics": (
        lambda r: edit_json(r, "stats.json", lambda s: s.pop("action")),
        r"stats\.json: nothing on 'action'",
    ),
    "index": (lambda r: edit(r, "index", put(7, 0, 70)), "episode 0, frame 7: index does not count"),
    "task": (lambda r: edit(r, "task_index", put(7, 0, 1)), r"tasks\.parquet: 1 tasks, the data name task_index 1"),
    "lengths": (
        lambda r: edit_listed(r, "length", [1, -1, 0, 0, 0]),
        r"meta/episodes, episode 0: length is \d+, the data give \d+ \(and 1 more\)",
    ),
    "where it begins": (
        lambda r: edit_listed(r, "dataset_from_index", [0, 0, 3, 0, 0]),
        "meta/episodes, episode 2: dataset_from_index is",
    ),
    "where it ends": (
        lambda r: edit_listed(r, "dataset_to_index", [0, 0, 0, 0, 1]),
        "meta/episodes, episode 4: dataset_to_index is",
    ),
    "frames": (lambda r: edit_json(r, "info.json", lambda i: i.update(total_frames=1)), "total_frames is 1"),
    "shape": (
        lambda r: edit_json(r, "info.json", lambda i: i["features"]["action"].update(shape=[7])),
        r"'action' is float32 \[7\]",
    ),
    "no action": (lambda r: edit_json(r, "info.json", lambda i: i["features"].pop("action")), "'action' is missing"),
    "old": (lambda r: edit_json(r, "info.json", lambda i: i.update(codebase_version="v2.1")), "v2.1; v3.0 is needed"),
    "truncated": (
        lambda r: (r / "data/chunk-000/file-000.parquet").write_bytes(
            (r / "data/chunk-000/file-000.parquet").read_bytes()[:5000]
        ),
        r"file-000\.parquet: not a readable",
    ),
    "no data": (lambda r: shutil.rmtree(r / "data"), "the data hold 0"),
    "no info": (lambda r: (r / "meta/info.json").unlink(), r"info\.json: missing"),
    "not JSON": (lambda r: (r / "meta/info.json").write_text("{"), r"info\.json: not JSON"),
}


def test_a_good_dataset_passes(good):
    report = check_dataset(good)
    assert (report.errors, report.episodes) == ([], 5)
    assert report.worst["position_m"] < 1e-5
    assert report.checks["dynamics"] == 5


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(copy, name):
    damage, message = DAMAGE[name]
    damage(copy)
    report = check_dataset(copy)
    assert not report.ok
    assert any(re.search(message, error) for error in report.errors), report.errors


def shift(column: int):
    def change(row, by):
        row[column] += by

    return change


def turn(row, by):
    """Turns an attitude by a small angle, rad, about the body's y: half of it goes along q ⊗ (0, 0, 1, 0)."""
    q0, q1, q2, q3 = row[7:11]
    row[7:11] += 0.5 * by * np.array([-q2, -q3, q0, q1])


@pytest.mark.parametrize(
    ("name", "change", "allowed"),
    [
        ("position_m", shift(0), 1e-4),
        ("velocity_m_s", shift(5), 1e-5),
        ("mass_kg", shift(6), -1e-3),
        ("attitude_rad", turn, 1e-5),
        ("rate_deg_s", shift(12), 1e-4),
    ],
)
def test_a_state_is_held_to_its_tolerance(copy, name, change, allowed):
    """One state of an episode, off by a third of what is allowed and then by three times that."""

    def off(by):
        def damage(values):
            change(values[12], by)
            return values

        return damage

    edit(copy, "true_state", off(allowed / 3))
    assert not any("does not follow" in error for error in check_dataset(copy).errors)
    edit(copy, "true_state", off(3 * allowed - allowed / 3))
    found = [error for error in check_dataset(copy).errors if f"{name} off by" in error]
    assert [error.split(": the next state")[0] for error in found] == ["episode 0, frame 11"]
    assert float(re.search(r"off by ([^ ]+?)(?: \(|\.$)", found[0])[1]) == pytest.approx(abs(3 * allowed), rel=0.1)


@pytest.mark.parametrize("key", ["mean", "std", "min", "max"])
@pytest.mark.parametrize("column", ["observation.state", "action"])
def test_statistics_are_held_to_a_ten_thousandth_of_the_spread(copy, column, key):
    data = pq.read_table(copy / "data" / "chunk-000" / "file-000.parquet")[column]
    spread = np.std(np.array(data.to_pylist(), dtype=np.float64)[:, 2])

    def off(by):
        def change(stats):
            stats[column][key][2] += by * spread

        return change

    edit_json(copy, "stats.json", off(1e-4 / 3))
    assert check_dataset(copy).errors == []
    edit_json(copy, "stats.json", off(3e-4 - 1e-4 / 3))
    (error,) = check_dataset(copy).errors
    assert re.search(rf"stats\.json: {key} of {re.escape(column)}\[", error)


def test_a_duplicate_is_found(good, log_folder, tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    source = min(log_folder.iterdir())
    for name in ("episode_000001.parquet", "episode_000002.parquet"):
        shutil.copy(source, logs / name)
    root = tmp_path / "twice"
    convert(ConvertConfig(str(logs), "test/twice", root=str(root), images="none", num_workers=1))
    assert "episode 1: is the same as episode 0." in check_dataset(root).errors


def test_the_verb_fails_for_a_pipeline_and_writes_its_report(good, copy, tmp_path, capsys):
    assert check(CheckConfig(root=str(good), json=str(tmp_path / "ok.json"))) == 0
    edit(copy, "executed_action", swap_rows)
    assert check(CheckConfig(root=str(copy), json=str(tmp_path / "bad.json"))) == 1
    assert json.loads((tmp_path / "ok.json").read_text())["ok"] is True
    assert json.loads((tmp_path / "bad.json").read_text())["errors"]
    assert "does not follow" in capsys.readouterr().out
    with pytest.raises(InputError, match="--root"):
        check(CheckConfig(root=str(tmp_path)))


@pytest.mark.parametrize("content", ["{", "[1]", '{"total_episodes": "many"}'])
def test_the_verb_says_what_is_wrong_with_a_damaged_description(copy, tmp_path, content, capsys):
    (copy / "meta" / "info.json").write_text(content)
    assert check(CheckConfig(root=str(copy), json=str(tmp_path / "new" / "bad.json"))) == 1
    assert "info.json" in capsys.readouterr().out
    assert json.loads((tmp_path / "new" / "bad.json").read_text())["ok"] is False


def test_a_report_that_cannot_be_written_is_said_before_the_check(good, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match=r"--json.*a folder that can be written"):
        check(CheckConfig(root=str(good), json=str(tmp_path / "file" / "report.json")))
    assert "episodes" not in capsys.readouterr().out


@pytest.mark.render
@pytest.mark.parametrize("kind", ["video", "image"])
def test_pictures_are_drawn_again_and_a_shifted_one_is_found(flights, tmp_path, kind):
    """Frames one step late, as a dropped frame leaves them, are nearer to their neighbour's state than to their own."""
    from dataset_samples import short

    from lerobot_spacedock.episode_log import write_episode_log

    logs = tmp_path / "logs"
    write_episode_log(logs / "episode_000001.parquet", short(flights[0], 8))
    root = tmp_path / "d"
    camera = CameraConfig(height=2 * HEIGHT, width=2 * WIDTH, samples=1, shadows=False)
    options = {"camera": camera, "num_workers": 1, "storage": Storage("image") if kind == "image" else Storage(crf=18)}
    convert(ConvertConfig(str(logs), "test/drawn", root=str(root), **options))
    report = check_dataset(root, sample_frames=8)
    assert report.errors == []
    assert report.psnr_dB[0] > (60.0 if kind == "image" else 25.0)
    edit(root, "true_state", lambda values: np.roll(values, 1, axis=0))
    found = check_dataset(root, sample_frames=8).errors
    assert any("shows a neighbouring state" in error for error in found)


def test_an_empty_dataset_is_said_to_be_one(tmp_path):
    features = schema.features(image=False)
    LeRobotDataset.create("test/empty", fps=1, features=features, root=tmp_path / "d", use_videos=False).finalize()
    assert check_dataset(tmp_path / "d").errors[0].startswith("no episode")


def test_a_video_that_is_shorter_than_its_episode_is_found(raw_export, tmp_path):
    """As an encoder that drops frames leaves it, and LeRobot without a word."""
    root = tmp_path / "d"
    convert(ConvertConfig(str(raw_export), "test/video", root=str(root), format="raw", num_workers=1))
    assert check_dataset(root).errors == []
    edit_listed(root, "videos/observation.images.camera/to_timestamp", [0, -1])
    error = "meta/episodes, episode 1: 5 frames of observation.images.camera for 6 rows."
    assert error in check_dataset(root, sample_frames=0).errors


def test_drawn_chasers_that_a_tool_has_dropped_are_not_held_against_the_data(tmp_path):
    """LeRobot's own tools keep neither of the files that say how a dataset was made."""
    log = fly_some([1], env_id="SpaceDockMeta-v0")[0]
    write_episode_log(tmp_path / "logs" / "episode_000001.parquet", log)
    root = tmp_path / "d"
    convert(ConvertConfig(str(tmp_path / "logs"), "test/meta", root=str(root), images="none", num_workers=1))
    assert check_dataset(root).checks["dynamics"] == 1
    for name in ("spacedock.json", "spacedock_episodes.parquet"):
        (root / "meta" / name).unlink()
    report = check_dataset(root)
    assert (report.errors, report.checks["dynamics"]) == ([], 0)
    assert any("chaser that was drawn" in note for note in report.notes)


def test_pictures_without_statistics_are_found(raw_export, tmp_path):
    """As LeRobot's conversion of pictures to video leaves them; lerobot-train stops at it."""
    root = tmp_path / "d"
    options = {"format": "raw", "num_workers": 1, "storage": Storage("image")}
    convert(ConvertConfig(str(raw_export), "test/pictures", root=str(root), **options))
    assert check_dataset(root).errors == []
    edit_json(root, "stats.json", lambda stats: stats.pop("observation.images.camera"))
    assert any("nothing on 'observation.images.camera'" in error for error in check_dataset(root).errors)
