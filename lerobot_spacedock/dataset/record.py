"""Writes episodes as a LeRobotDataset v3.0, with the settings that this task needs.

LeRobot's streaming encoder drops a frame when its queue stays full for 0.1 s, and every later frame of that episode
then shows another state's picture: here the queue is unbounded (memory: one episode's frames), and each episode's
encoded length is compared with its rows.
"""

from __future__ import annotations

import contextlib
import gc
import shutil
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.encoder import encoder_config, quiet_encoders
from lerobot_spacedock.dataset.episode import rows_of
from lerobot_spacedock.dataset.segments import MIN_STEPS
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.folders import free_space


@dataclass(frozen=True)
class Storage:
    """How frames are kept. Flags as in ``--storage.kind=image``."""

    # video: streamed to the encoder; image: lossless PNG inside Parquet
    kind: str = "video"
    # libsvtav1 | libaom-av1 | h264 | hevc, or of a GPU: h264_nvenc | hevc_nvenc
    vcodec: str = "libsvtav1"
    # the encoder's quality: lower is better and larger
    crf: int = 30
    # a key frame every so many frames; small numbers make random reads fast
    gop: int = 2

    def __post_init__(self) -> None:
        if self.kind not in schema.STORAGES:
            raise InputError("--storage.kind", self.kind, " or ".join(schema.STORAGES))
        for name in ("vcodec", "crf", "gop"):
            value = getattr(self, name)
            if self.kind == "image" and value != getattr(Storage, name):
                raise InputError(f"--storage.{name}", value, "nothing, with --storage.kind=image: PNG has no encoder")


@dataclass(frozen=True)
class DatasetLayout:
    """What every episode of one dataset shares: the arguments of its schema, its storage, and its task.

    Without a task the episodes have those of their source, or ``schema.TASK``.
    """

    repo_id: str
    height: int = 480
    width: int = 640
    with_mass: bool = False
    withhold_pose: bool = False
    image: bool = True
    task: str | None = schema.TASK
    storage: Storage = field(default_factory=Storage)

    def columns(self) -> dict[str, schema.Column]:
        return schema.columns(
            height=self.height,
            width=self.width,
            storage=self.storage.kind,
            with_mass=self.with_mass,
            withhold_pose=self.withhold_pose,
            image=self.image,
        )

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> DatasetLayout:
        return cls(**(values | {"storage": Storage(**values["storage"])}))


class DatasetRecorder:
    """A LeRobotDataset that is being written; a context manager that closes it.

    Args:
        root: folder to create; must not exist.
        layout: schema and storage.
        encoder_threads: of the video encoder; None lets it decide.
    """

    def __init__(self, root: Path, layout: DatasetLayout, *, encoder_threads: int | None = None) -> None:
        quiet_encoders()
        from lerobot.datasets.lerobot_dataset import LeRobotDataset

        prepare_libraries()
        gc.freeze()  # what the libraries have loaded stays; without this it is walked through again every few episodes
        if root.exists():
            raise InputError("--root", str(root), "a folder that does not exist", "Give another, or delete it.")
        self.layout = layout
        self.root = root
        video = layout.image and layout.storage.kind == "video"
        features = {name: column.as_feature() for name, column in layout.columns().items()}
        self.dataset = LeRobotDataset.create(
            layout.repo_id,
            fps=schema.FPS,
            features=features,
            root=root,
            robot_type=schema.ROBOT_TYPE,
            use_videos=video,
            video_backend="pyav",
            rgb_encoder=encoder_config(layout.storage) if video else None,
            streaming_encoding=video,
            encoder_queue_maxsize=0,
            encoder_threads=encoder_threads,
            image_writer_threads=0 if video or not layout.image else 2,
        )

    def add_episode(
        self, log: EpisodeLog, frames: Iterable[np.ndarray] | None = None, tasks: Sequence[str] | None = None
    ) -> None:
        """Writes one episode.

        Args:
            log: of at least ``MIN_STEPS`` steps.
            frames: uint8 (height, width, 3), one a step, in order; None where the layout has no image. Taken one by
                one, so that drawing and encoding overlap.
            tasks: one a step, of the source; the layout's own comes first.

        Raises:
            InputError: too few steps, too few frames, or a frame of another size or type.
            SpaceDockError: the encoder failed or lost a frame, or the disk is full.
        """
        if log.num_steps < MIN_STEPS:
            raise InputError("episode", f"{log.num_steps} steps", f"at least {MIN_STEPS} steps")
        rows = rows_of(log, with_mass=self.layout.with_mass, withhold_pose=self.layout.withhold_pose)
        source = iter(frames) if self.layout.image and frames is not None else None
        try:
            for k in range(log.num_steps):
                row: dict[str, Any] = {name: values[k] for name, values in rows.items()}
                row["task"] = self.layout.task if self.layout.task is not None else (tasks[k] if tasks else schema.TASK)
                if self.layout.image:
                    row[schema.IMAGE] = self._next_frame(source, k)
                self.dataset.add_frame(row)
            self.dataset.save_episode()
        except (RuntimeError, OSError) as error:
            raise SpaceDockError(f"{self.root}: writing failed ({error}). {free_space(self.root)}") from error
        self._check_encoded_length(log.num_steps)

    def _next_frame(self, source: Iterable[np.ndarray] | None, k: int) -> np.ndarray:
        frame = next(source, None) if source is not None else None  # type: ignore[call-overload]
        if frame is None:
            raise InputError("frames", f"{k} of them", "one a step")
        expected = (self.layout.height, self.layout.width, 3)
        if frame.shape != expected or frame.dtype != np.uint8:
            raise InputError(f"frame {k}", f"{frame.dtype} {frame.shape}", f"uint8 {expected}")
        return frame

    def _check_encoded_length(self, steps: int) -> None:
        latest = self.dataset.meta.latest_episode or {}
        if f"videos/{schema.IMAGE}/to_timestamp" not in latest:
            return
        start, end = (latest[f"videos/{schema.IMAGE}/{edge}_timestamp"][0] for edge in ("from", "to"))
        if round((end - start) * schema.FPS) != steps:
            written = (end - start) * schema.FPS
            raise SpaceDockError(
                f"{self.root}: the encoder wrote {written:g} frames of {steps}. {free_space(self.root)}"
            )

    def discard_episode(self) -> None:
        """Forgets the frames of an episode that ``add_episode`` could not finish."""
        self.dataset.clear_episode_buffer()

    def close(self) -> None:
        """Finishes the files; a dataset without it cannot be read. Idempotent."""
        try:
            self.dataset.finalize()
        except (RuntimeError, OSError) as error:
            raise SpaceDockError(f"{self.root}: closing failed ({error}). {free_space(self.root)}") from error

    def __enter__(self) -> DatasetRecorder:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self.close()
        else:
            self.dataset.clear_episode_buffer()
            self.dataset.finalize()


@contextlib.contextmanager
def datasets_cache(folder: Path) -> Iterator[None]:
    """Whatever the datasets library reads from Parquet it copies as well, into the user's home and for good.

    Here into ``folder``, which is removed at the end.
    """
    from datasets import config

    before, config.HF_DATASETS_CACHE = config.HF_DATASETS_CACHE, folder
    try:
        yield
    finally:
        config.HF_DATASETS_CACHE = before
        shutil.rmtree(folder, ignore_errors=True)


def prepare_libraries() -> None:
    """What LeRobot and datasets do by default and would cost more than the work: for writing and for merging."""
    from datasets.utils import disable_progress_bars
    from lerobot.datasets import dataset_writer, io_utils

    disable_progress_bars()  # one an episode, for milliseconds
    dataset_writer.embed_images = io_utils.embed_images = embed_at_once


def embed_at_once(dataset: Any) -> Any:
    """What LeRobot's ``embed_images`` does, the whole episode in one call and nothing where there are no pictures.

    LeRobot goes row by row, which takes longer than encoding a small video.

    Args:
        dataset: Hugging Face dataset of one episode, whose pictures are files.

    Returns:
        The same with the files' bytes in it.
    """
    from datasets import Dataset, Image
    from datasets.table import embed_table_storage

    if not any(isinstance(feature, Image) for feature in dataset.features.values()):
        return dataset
    table = embed_table_storage(dataset.with_format("arrow")[:])
    return Dataset(table, info=dataset.info, split=dataset.split, fingerprint=dataset._fingerprint)
