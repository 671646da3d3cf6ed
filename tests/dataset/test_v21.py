"""A v2.1 dataset of the authors' schema, made here file by file as LeRobot 2.1 wrote it, and converted."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from dataset_samples import short
from huggingface_hub import DatasetCard
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset.camera_flags import CameraFlags
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.integrity import check_dataset
from lerobot_spacedock.dataset.record import Storage
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.physics.frames import ACTION_NAMES, STATE_NAMES


def stats_of(values: np.ndarray) -> dict:
    values = np.atleast_2d(values.T).T.astype(np.float64)
    return {
        "min": values.min(0).tolist(), "max": values.max(0).tolist(), "mean": values.mean(0).tolist(),
        "std": values.std(0).tolist(), "count": [len(values)],
    }  # fmt: skip


def arrow(values: np.ndarray) -> pa.Array:
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.array(values.tolist(), pa.list_(kind) if values.ndim == 2 else kind)


def write_v21(root, logs, *, real_times: bool) -> None:
    def feature(dtype, shape, names=None):
        return {"dtype": dtype, "shape": shape, "names": names}

    features = {
        "observation.state": feature("float32", [14], list(STATE_NAMES)),
        "action": feature("float32", [6], list(ACTION_NAMES)),
        "timestamp": feature("float32", [1]),
    } | {name: feature("int64", [1]) for name in ("frame_index", "episode_index", "index", "task_index")}
    (root / "data" / "chunk-000").mkdir(parents=True)
    (root / "meta").mkdir()
    episodes, stats, total = [], [], 0
    for number, log in enumerate(logs):
        steps = log.num_steps
        columns = {
            "observation.state": log.state[:-1].astype(np.float32),
            "action": log.action.astype(np.float32),
            "timestamp": (log.time[:-1] if real_times else np.arange(steps)).astype(np.float32),
            "frame_index": np.arange(steps),
            "episode_index": np.full(steps, number),
            "index": np.arange(total, total + steps),
            "task_index": np.zeros(steps, dtype=np.int64),
        }
        table = pa.table({name: arrow(values) for name, values in columns.items()})
        pq.write_table(table, root / "data" / "chunk-000" / f"episode_{number:06d}.parquet")
        episodes.append({"episode_index": number, "tasks": ["dock"], "length": steps})
        stats.append({"episode_index": number, "stats": {name: stats_of(values) for name, values in columns.items()}})
        total += steps
    info = {
        "codebase_version": "v2.1", "robot_type": "inav", "total_episodes": len(logs), "total_frames": total,
        "total_tasks": 1, "total_videos": 0, "total_chunks": 1, "chunks_size": 1000, "fps": 1,
        "splits": {"train": f"0:{len(logs)}"}, "features": features, "video_path": None,
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
    }  # fmt: skip
    (root / "meta" / "info.json").write_text(json.dumps(info))
    (root / "meta" / "tasks.jsonl").write_text(json.dumps({"task_index": 0, "task": "dock"}) + "\n")
    for name, rows in (("episodes", episodes), ("episodes_stats", stats)):
        (root / "meta" / f"{name}.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


@pytest.mark.parametrize("real_times", [True, False])
def test_the_authors_schema_comes_through_lerobots_converter(flights, tmp_path, real_times):
    logs = [short(log, steps) for log, steps in zip(flights[:2], (9, 7), strict=True)]
    write_v21(tmp_path / "old", logs, real_times=real_times)
    (tmp_path / "old" / "README.md").write_text("---\nlicense: cc-by-4.0\n---\n# theirs\n")
    before = sorted(p.name for p in (tmp_path / "old").rglob("*"))
    root = tmp_path / "new"
    assert convert(ConvertConfig(str(tmp_path / "old"), "test/new", format="v21", root=str(root))) == 0
    assert sorted(p.name for p in (tmp_path / "old").rglob("*")) == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["new", "old"]
    dataset = LeRobotDataset("test/new", root=root)
    assert (dataset.num_episodes, dataset.num_frames) == (2, 16)
    item = dataset[11]
    np.testing.assert_array_equal(item["observation.state"].numpy(), logs[1].state[2].astype(np.float32))
    assert item["timestamp"] == 2.0
    mass = np.concatenate([log.state[:-1, 6] for log in logs]).astype(np.float32).astype(np.float64)
    assert dataset.meta.stats["observation.state"]["std"][6] == pytest.approx(mass.std(), rel=1e-9)
    assert DatasetCard.load(root / "README.md").data.license == "cc-by-4.0", "theirs, as their card states it"
    small = {"camera": CameraFlags(height=16, width=24), "storage": Storage("image"), "num_workers": 1}
    part = ConvertConfig(str(root), "test/part", "lerobot", str(tmp_path / "part"), segment="last:4", **small)
    assert convert(part) == 0, "the second conversion of docs/datasets.md"
    assert LeRobotDataset("test/part", root=tmp_path / "part").num_frames == 8
    report = check_dataset(root)
    assert report.errors == []
    if real_times:
        assert float(item["sim_time"]) == pytest.approx(logs[1].time[2], rel=1e-6)
        assert report.worst["position_m"] < 1e-4, "states follow from commands over the times that were moved"


def test_a_v3_dataset_is_not_taken_for_an_old_one(flights, tmp_path):
    write_v21(tmp_path / "old", [short(flights[0], 5)], real_times=False)
    info = json.loads((tmp_path / "old" / "meta" / "info.json").read_text())
    (tmp_path / "old" / "meta" / "info.json").write_text(json.dumps(info | {"codebase_version": "v3.0"}))
    with pytest.raises(InputError, match=r"v2\.1"):
        convert(ConvertConfig(str(tmp_path / "old"), "test/new", format="v21", root=str(tmp_path / "new")))


def test_it_is_not_copied_into_itself(flights, tmp_path):
    write_v21(tmp_path / "old", [short(flights[0], 5)], real_times=False)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match="outside of --source"):
        convert(ConvertConfig(str(tmp_path / "old"), "test/new", format="v21", root=str(tmp_path / "old" / "new")))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("content", ["{", "[1]"])
def test_a_damaged_description_is_named(tmp_path, content):
    (tmp_path / "old" / "meta").mkdir(parents=True)
    (tmp_path / "old" / "meta" / "info.json").write_text(content)
    with pytest.raises(FileFormatError, match=r"old/meta/info\.json: "):
        convert(ConvertConfig(str(tmp_path / "old"), "test/new", format="v21", root=str(tmp_path / "new")))


@pytest.mark.parametrize(
    "options",
    [{"segment": "last:10m"}, {"select": "distance"}, {"camera": CameraConfig(height=96)}, {"images": "draw"}],
)
def test_options_that_lerobots_converter_would_not_hear_are_refused(flights, tmp_path, options):
    write_v21(tmp_path / "old", [short(flights[0], 5)], real_times=False)
    with pytest.raises(InputError, match=f"--{next(iter(options))}"):
        convert(ConvertConfig(str(tmp_path / "old"), "test/new", format="v21", root=str(tmp_path / "new"), **options))
    assert not (tmp_path / "new").exists()
