"""One episode of a LeRobotDataset (v3), as an episode log and its frames, read with pyarrow and PyAV alone."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from lerobot_spacedock.dataset import provenance, schema
from lerobot_spacedock.dataset.episode import log_of_rows
from lerobot_spacedock.dataset.roots import dataset_file
from lerobot_spacedock.dataset.sources.pictures import decode_picture
from lerobot_spacedock.episode_log import MAX_STATES, EpisodeLog
from lerobot_spacedock.errors import FileFormatError, InputError, reading

READ = (
    schema.STATE,
    schema.ACTION,
    schema.CONTROL_DT,
    schema.SIM_TIME,
    schema.REWARD,
    schema.SUCCESS,
    schema.TRUE_STATE,
    schema.EXECUTED_ACTION,
)


class DatasetEpisode:
    """An episode of a dataset on disk.

    Args:
        root: folder with ``meta/info.json``.
        episode: index.

    Raises:
        InputError: no dataset there, or no such episode.
        FileFormatError: another version of the format, or a file that is missing or damaged.
    """

    def __init__(self, root: Path, episode: int) -> None:
        self.root, self.episode = root, episode
        path = root / "meta" / "info.json"
        if not path.is_file():
            raise InputError("--dataset", str(root), "the root of a LeRobotDataset (with meta/info.json)")
        with reading(path, "a dataset's description"):
            self._open(path, episode)

    def _open(self, path: Path, episode: int) -> None:
        self.info: dict[str, Any] = json.loads(path.read_text())
        if not str(self.info.get("codebase_version", "")).startswith("v3"):
            version = self.info.get("codebase_version")
            raise FileFormatError(f"{path}: format {version}, not v3; LeRobot's converter brings it up to date.")
        self.features: dict[str, Any] = self.info["features"]
        total = int(self.info["total_episodes"])
        if not 0 <= episode < total:
            raise InputError("--episode", episode, f"0 to {total - 1}")
        self.place = self._place()

    def log(self) -> EpisodeLog:
        """The episode's states and commands; without the terminal state, where the dataset does not keep it."""
        with reading(self.root, "a dataset"):
            return self._log()

    def _log(self) -> EpisodeLog:
        table = self._rows([name for name in READ if name in self.features] + ["timestamp"])
        rows = {name: np.array(table.column(name).to_pylist()) for name in table.column_names}
        time = rows.pop("timestamp").astype(np.float64)
        steps = len(time)
        said = {"success": bool(rows.pop(schema.SUCCESS).any())} if schema.SUCCESS in rows else {}
        if schema.CONTROL_DT in rows:
            held = rows[schema.CONTROL_DT].astype(np.float64).reshape(steps)
            rows.setdefault(schema.SIM_TIME, np.cumsum(held) - held)
        elif schema.SIM_TIME in rows:
            held = np.diff(rows[schema.SIM_TIME].astype(np.float64).reshape(steps))
            rows[schema.CONTROL_DT] = np.append(held, held[-1:] if steps > 1 else 1.0)
        else:
            rows[schema.SIM_TIME] = time - time[0]
            rows[schema.CONTROL_DT] = np.full(steps, 1.0 / float(self.info["fps"]))
        kept = provenance.episode_rows(self.root)
        row = kept.row(self.episode) if kept is not None else None
        metadata = json.loads(row["metadata"]) if row else {}
        metadata = {"label": self.root.name} | said | metadata
        return log_of_rows(rows, terminal_state=provenance.terminal_state(row) if row else None, metadata=metadata)

    def tasks(self) -> list[str]:
        """What the episode is said to do, one sentence a row."""
        path = self.root / "meta" / "tasks.parquet"
        with reading(path, "the tasks of a dataset"):
            table = pq.read_table(path, partitioning=None)
            (name,) = (column for column in table.column_names if column != "task_index")  # LeRobot does not name it
            said = dict(zip(table.column("task_index").to_pylist(), table.column(name).to_pylist(), strict=True))
            return [str(said[index]) for index in self._rows(["task_index"]).column("task_index").to_pylist()]

    def frames(self) -> Iterator[np.ndarray]:
        """uint8 (H, W, 3), one a row; nothing where the dataset has no camera."""
        with reading(self.root, "a dataset"):
            yield from self._frames()

    def _frames(self) -> Iterator[np.ndarray]:
        if not self.cameras:
            return
        camera = self.camera()
        if self.features[camera]["dtype"] == "image":
            for step, cell in enumerate(self._rows([camera]).column(camera).to_pylist()):
                yield decode_picture(cell["bytes"], f"{self.root}, episode {self.episode}, frame {step}")
            return
        yield from self._video_frames(camera)

    @property
    def cameras(self) -> list[str]:
        return [name for name, feature in self.features.items() if feature["dtype"] in ("image", "video")]

    def camera(self) -> str:
        """The camera of this schema, or the only one."""
        if schema.IMAGE in self.cameras:
            return schema.IMAGE
        if len(self.cameras) > 1:
            raise FileFormatError(f"{self.root}: cameras {self.cameras}; one of them has to be {schema.IMAGE!r}.")
        return self.cameras[0]

    def _video_frames(self, camera: str) -> Iterator[np.ndarray]:
        import av

        path = self._path("video_path", f"videos/{camera}", video_key=camera)
        start = float(self.place[f"videos/{camera}/from_timestamp"])
        left, half = int(self.place["length"]), 0.5 / float(self.info["fps"])
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            container.seek(max(0, int((start - half) / stream.time_base)), stream=stream)
            for frame in container.decode(stream):
                if left and frame.time >= start - half:
                    left -= 1
                    yield frame.to_ndarray(format="rgb24")
                if not left:
                    return

    def _place(self) -> dict[str, Any]:
        for path in sorted((self.root / "meta" / "episodes").rglob("*.parquet")):
            found = self._table(path, None, self.episode)
            if found.num_rows:
                names = [n for n in found.column_names if n.startswith(("data/", "videos/")) or n == "length"]
                return {name: found.column(name)[0].as_py() for name in names}
        raise FileFormatError(f"{self.root / 'meta' / 'episodes'}: episode {self.episode} is not listed.")

    def _rows(self, columns: list[str]) -> pa.Table:
        return self._table(self._path("data_path", "data"), columns, self.episode)

    def _path(self, template: str, prefix: str, **words: str) -> Path:
        chunk, file = self.place[f"{prefix}/chunk_index"], self.place[f"{prefix}/file_index"]
        path = dataset_file(self.root, self.info[template], chunk_index=chunk, file_index=file, **words)
        if not path.is_file():
            raise FileFormatError(f"{path}: missing; episode {self.episode} is said to be in it.")
        return path

    @staticmethod
    def _table(path: Path, columns: list[str] | None, episode: int) -> pa.Table:
        try:
            own = ds.field("episode_index") == episode
            found = ds.dataset(path, format="parquet").scanner(columns=columns, filter=own).head(MAX_STATES + 1)
        except (pa.ArrowException, OSError, KeyError) as error:
            raise FileFormatError(f"{path}: not readable ({error}).") from error
        if found.num_rows > MAX_STATES:
            raise FileFormatError(f"{path}: episode {episode} has more than {MAX_STATES:,} rows.")
        return found
