"""A LeRobotDataset v2.1 of the authors' schema, through LeRobot's own converter.

Columns keep their names and pictures their files. Two things are mended on the way: statistics are made exact, and
real times that stand in ``timestamp``, where LeRobot would look up wrong video frames by them, become ``sim_time`` and
``control_dt`` beside a ``timestamp`` of frame_index / fps.
"""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.card import write_card
from lerobot_spacedock.dataset.job import Job
from lerobot_spacedock.dataset.licence import stated_license
from lerobot_spacedock.dataset.provenance import write_dataset_facts
from lerobot_spacedock.dataset.record import datasets_cache, prepare_libraries
from lerobot_spacedock.dataset.statistics import repair_statistics
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.files import aside, read_object, write_json
from lerobot_spacedock.invocation import command_line

if TYPE_CHECKING:
    from lerobot_spacedock.dataset.convert import ConvertConfig

TIME_TOLERANCE_s = 1e-4
MEAN_STEP_s = 0.907  # for the last step of an episode, whose length a list of times does not tell
MOVED = "real times were in timestamp; they are in sim_time and control_dt now"
NO_TIMES = "timestamp counted frames in the source: it has no real times, and none were made up"
# options that shape what is written here, and not in LeRobot's converter
UNUSED = ("num_episodes", "select", "successes_first", "skip_bad", "segment", "repeat_terminal", "with_mass")
UNUSED += ("withhold_pose", "images", "port", "camera", "renderer", "sun", "storage", "task", "step_s")


def convert_v21(config: ConvertConfig, root: Path) -> int:
    """Converts the dataset at ``config.source`` to v3.0 at ``root``; the source is not touched.

    Raises:
        InputError: the source is not a v2.1 dataset or holds the root, or an option that this format has no use for.
        FileFormatError: LeRobot's converter failed.
    """
    source = Path(config.source)
    info_path = source / "meta" / "info.json"
    if not info_path.exists():
        raise InputError("--source", str(source), "the folder of a LeRobotDataset v2.1 (it holds meta/info.json)")
    version = read_object(info_path).get("codebase_version")
    if version != "v2.1":
        raise InputError("--source", f"{source}, {version}", "a LeRobotDataset v2.1", "v3.0 needs no conversion.")
    _refuse_unused(config)
    if root.resolve().is_relative_to(source.resolve()):
        raise InputError("--root", str(root), "a folder outside of --source, all of which is copied")
    job = Job(root)
    with job.lock(), job.disk_errors():
        job.begin(config.settings())
        work = job.folder / "complete"
        for stale in (work, work.with_name("complete_old"), work.with_name("complete_v30")):
            shutil.rmtree(stale, ignore_errors=True)
        shutil.copytree(source, work, ignore=shutil.ignore_patterns(".cache", ".git"))
        _run_converter(config.repo_id, work)
        moved = mend_times(work)
        repair_statistics(work)
        facts = {
            "made_by": "spacedock convert",
            "command": command_line(),
            "source": {"format": "v21", "description": "a LeRobotDataset v2.1, through LeRobot's converter"},
            "pictures": "stored",
            "license": stated_license(source),
            "times": MOVED if moved else NO_TIMES,
        }
        write_dataset_facts(work, facts, _described(work))
        write_card(work, config.repo_id)
        job.finish(work)
    info = json.loads((root / "meta" / "info.json").read_text())
    print(f"Wrote {info['total_episodes']} episodes, {info['total_frames']} frames to {root}")
    print(f"  {MOVED if moved else NO_TIMES}")
    print(f"Next: spacedock check --repo_id={config.repo_id} --root={root}")
    return 0


def _refuse_unused(config: ConvertConfig) -> None:
    plain = type(config)(config.source, config.repo_id)
    given = [f"--{name}" for name in UNUSED if getattr(config, name) != getattr(plain, name)]
    if given:
        then = "Choose from it, cut it or scale it with spacedock convert --format=lerobot afterwards."
        raise InputError("--format", f"v21 with {' '.join(given)}", "v21 alone: it converts all of it, as it is", then)


def _described(root: Path) -> dict[str, schema.Column]:
    """The schema's columns that the dataset at ``root`` has."""
    features = json.loads((root / "meta" / "info.json").read_text())["features"]
    try:
        observed = schema.observed_names(*features[schema.STATE]["shape"])
    except (KeyError, InputError, TypeError):  # none of this task's: the check says so
        return {}
    known = schema.columns(with_mass="mass" in observed, withhold_pose="x" not in observed)
    return {name: column for name, column in known.items() if name in features}


def _run_converter(repo_id: str, work: Path) -> None:
    from lerobot.scripts.convert_dataset_v21_to_v30 import convert_dataset

    prepare_libraries()
    # it says three times that it will ignore total_chunks and total_videos, which every v2.1 has and v3.0 has not
    said_by = logging.getLogger("lerobot.datasets.utils")
    before = said_by.level
    said_by.setLevel(logging.ERROR)
    try:
        with datasets_cache(work.with_name(f"{work.name}_cache")):
            convert_dataset(repo_id, root=work, push_to_hub=False)
    except Exception as error:  # it raises whatever its files make it raise
        raise FileFormatError(f"{work}: LeRobot's converter failed ({type(error).__name__}: {error}).") from error
    finally:
        said_by.setLevel(before)
    shutil.rmtree(work.with_name(f"{work.name}_old"), ignore_errors=True)


def mend_times(root: Path) -> bool:
    """Moves real times out of ``timestamp``; True where there were any."""
    path = root / "meta" / "info.json"
    info: dict[str, Any] = json.loads(path.read_text())
    files = sorted((root / "data").glob("chunk-*/file-*.parquet"))
    if not any(_has_real_times(file, info["fps"]) for file in files):
        return False
    for file in files:
        table = pq.read_table(file)
        time = table.column("timestamp").to_numpy().astype(np.float64)
        frame = table.column("frame_index").to_numpy()
        step = np.append(np.diff(time), MEAN_STEP_s)
        last = np.append(frame[1:] == 0, True)
        start = np.repeat(time[frame == 0], np.diff(np.append(np.flatnonzero(frame == 0), len(frame))))
        index = table.column_names.index("timestamp")
        kind = table.schema.field("timestamp").type
        table = table.set_column(index, "timestamp", pa.array(frame / info["fps"], kind))
        for name, values in (
            (schema.SIM_TIME, time - start),
            (schema.CONTROL_DT, np.where(last, MEAN_STEP_s, step)),
        ):
            if name not in table.column_names:
                table = table.append_column(name, pa.array(values, pa.float32()))
        with aside(file) as own:
            pq.write_table(table.replace_schema_metadata(_extended_metadata(table)), own)
    for name in (schema.SIM_TIME, schema.CONTROL_DT):
        info["features"].setdefault(name, schema.columns(image=False)[name].as_feature() | {"shape": [1]})
    write_json(path, info)
    return True


def _has_real_times(file: Path, fps: int) -> bool:
    table = pq.read_table(file, columns=["timestamp", "frame_index"])
    expected = table.column("frame_index").to_numpy() / fps
    return bool((np.abs(table.column("timestamp").to_numpy() - expected) > TIME_TOLERANCE_s).any())


def _extended_metadata(table: pa.Table) -> dict | None:
    """The file's metadata with Hugging Face's list of features extended by the new columns."""
    metadata = dict(table.schema.metadata or {})
    if b"huggingface" in metadata:
        held = json.loads(metadata[b"huggingface"])
        for name in (schema.SIM_TIME, schema.CONTROL_DT):
            held["info"]["features"].setdefault(name, {"dtype": "float32", "_type": "Value"})
        metadata[b"huggingface"] = json.dumps(held).encode()
    return metadata or None
