"""Do the stored frames show their states? A sample is decoded, drawn again, and compared with its neighbours too."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.findings import Report
from lerobot_spacedock.dataset.frames import Artist
from lerobot_spacedock.dataset.reader import DatasetReader, Episode
from lerobot_spacedock.dataset.roots import dataset_file
from lerobot_spacedock.dataset.sources.pictures import decode_picture
from lerobot_spacedock.errors import FileFormatError

# below the first the picture is of something else; the others are what the storage costs, with room to spare
WRONG_PICTURE_dB = 12.0
LEAST_PSNR_dB = {"image": 45.0, "video": 24.0}


@dataclass(frozen=True)
class Comparison:
    """One stored frame beside its state drawn again.

    Attributes:
        episode: index.
        step: frame within the episode.
        psnr_dB: against its own state; infinite where they are equal.
        neighbour_psnr_dB: the best against the states before and after.
    """

    episode: int
    step: int
    psnr_dB: float
    neighbour_psnr_dB: float

    @property
    def shows_its_state(self) -> bool:
        return self.psnr_dB >= self.neighbour_psnr_dB


def psnr_dB(a: np.ndarray, b: np.ndarray) -> float:
    """Peak signal-to-noise ratio of two uint8 pictures, dB."""
    error = np.mean((a.astype(np.float64) - b.astype(np.float64)) ** 2)
    return float("inf") if error == 0.0 else float(10.0 * np.log10(255.0**2 / error))


class FrameStore:
    """Decodes single frames of a dataset, from its videos or from its Parquet files."""

    def __init__(self, reader: DatasetReader, camera: str) -> None:
        self.reader, self.camera = reader, camera
        self.kind = reader.features[camera]["dtype"]

    def frame(self, episode: int, step: int) -> np.ndarray:
        """uint8 (height, width, 3).

        Raises:
            FileFormatError: the file is missing or damaged.
        """
        about = self.reader.listed(episode)
        if self.kind == "video":
            return self._video_frame(about, step)
        return self._stored_picture(about, step)

    def path(self, about: dict[str, Any]) -> Path:
        prefix = f"videos/{self.camera}/" if self.kind == "video" else "data/"
        template = self.reader.info["video_path" if self.kind == "video" else "data_path"]
        chunk, file = about[f"{prefix}chunk_index"], about[f"{prefix}file_index"]
        words = {"video_key": self.camera, "chunk_index": chunk, "file_index": file}
        return dataset_file(self.reader.root, template, **words)

    def _video_frame(self, about: dict[str, Any], step: int) -> np.ndarray:
        from lerobot.datasets.video_utils import decode_video_frames

        path = self.path(about)
        fps = self.reader.info["fps"]
        at = about[f"videos/{self.camera}/from_timestamp"] + step / fps
        if not path.exists():
            raise FileFormatError(f"{path}: missing.")
        try:
            frames = decode_video_frames(path, [at], 0.1 / fps, backend="pyav")
        except Exception as error:  # PyAV and LeRobot raise a dozen kinds for a damaged file
            raise FileFormatError(f"{path}: frame at {at:g} s cannot be decoded ({error}).") from error
        picture = frames[0].numpy()
        if picture.dtype != np.uint8:
            picture = np.rint(picture * 255.0).astype(np.uint8)
        return picture.transpose(1, 2, 0)

    def _stored_picture(self, about: dict[str, Any], step: int) -> np.ndarray:
        path = self.path(about)
        wanted = about["dataset_from_index"] + step
        try:
            table = pq.read_table(path, columns=["index", self.camera], filters=[("index", "==", wanted)])
            content = table.column(self.camera)[0].as_py()["bytes"]
        except Exception as error:
            raise FileFormatError(f"{path}: the picture of row {wanted} cannot be read ({error}).") from error
        return decode_picture(content, f"{path}, row {wanted}")


def compare(store: FrameStore, artist: Artist, episode: Episode, steps: list[int]) -> list[Comparison]:
    """Draws the states at ``steps`` again, and their neighbours, beside the stored frames."""
    log = episode.log()
    found = []
    for step in steps:
        stored = store.frame(episode.index, step)
        near = [k for k in (step - 1, step, step + 1) if 0 <= k < len(log.state)]
        drawn = {k: next(artist.draw(log, k, k + 1)) for k in near}
        if stored.shape != drawn[step].shape:
            raise FileFormatError(f"episode {episode.index}, frame {step}: {stored.shape}, not {drawn[step].shape}.")
        own = psnr_dB(stored, drawn.pop(step))
        others = max((psnr_dB(stored, picture) for picture in drawn.values()), default=-np.inf)
        found.append(Comparison(episode.index, step, own, others))
    return found


def check_pictures(
    reader: DatasetReader, watched: dict[int, Episode], sampled: dict[int, list[int]], redraw: bool, report: Report
) -> None:
    """Decodes the sampled frames and, where this package drew them, compares them with their states.

    Args:
        reader: of the dataset.
        watched: the episodes that ``sampled`` names.
        sampled: {episode: frames in it}.
        redraw: False decodes only.
        report: to add to.
    """
    if not reader.cameras or not sampled:
        return
    camera = schema.IMAGE if schema.IMAGE in reader.cameras else reader.cameras[0]
    store = FrameStore(reader, camera)
    drawing = reader.facts.get("drawing")
    drawn_here = reader.facts.get("pictures", "drawn") == "drawn"
    artist = None
    if redraw and drawing and drawn_here and reader.has_pose:
        artist = Artist(**drawing)
    elif redraw:
        report.notes.append(f"{camera}: frames cannot be drawn again here; they are decoded, not compared.")
    found = []
    try:
        for index, steps in sampled.items():
            report.checks["pictures"] += len(steps)
            if artist is not None:
                found += compare(store, artist, watched[index], steps)
                continue
            for step in steps:
                shape = list(store.frame(index, step).shape)
                if shape != list(reader.features[camera]["shape"]):
                    report.errors.append(
                        f"episode {index}, frame {step}: {shape}, not {reader.features[camera]['shape']}."
                    )
    except FileFormatError as error:
        report.errors.append(str(error))
    finally:
        if artist is not None:
            artist.close()
    _judge(found, LEAST_PSNR_dB[store.kind], report)


def _judge(found: list[Comparison], least_dB: float, report: Report) -> None:
    if not found:
        return
    for item in found:
        where = f"episode {item.episode}, frame {item.step}"
        if not item.shows_its_state:
            report.errors.append(f"{where}: the picture shows a neighbouring state ({item.neighbour_psnr_dB:.1f} dB).")
        elif item.psnr_dB < WRONG_PICTURE_dB:
            report.errors.append(f"{where}: the picture is not of this state ({item.psnr_dB:.1f} dB).")
    values = [item.psnr_dB for item in found]
    report.psnr_dB = (float(np.min(values)), float(np.median(values)))
    if report.psnr_dB[1] < least_dB:
        report.warnings.append(
            f"frames are {report.psnr_dB[1]:.1f} dB from their states drawn again (≥ {least_dB:g} dB expected): they "
            "were drawn by another renderer or another version of it, and a policy trained on them would see other "
            "pictures when it is evaluated here."
        )
