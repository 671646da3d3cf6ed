"""Whole datasets: read by the report, checked, imitated, and fetched from a hub whose owner means harm."""

from __future__ import annotations

import base64
import contextlib
import ctypes
import json
import shutil
import sys
from pathlib import Path

import hub_mutations
import mutations
import numpy as np
from reader import Reader, some_arrays

sys.path.insert(0, str(Path(__file__).parents[1] / "dataset"))  # its hub

REPO = "test/hostile"
M_ARENA_MAX = -8  # of glibc's mallopt: else every thread reserves 64 MB of address space, which the limit counts


def make_dataset(folder: Path) -> list:
    """A dataset of two episodes with pictures, as ``spacedock convert`` writes it."""
    from lerobot_spacedock.camera.config import CameraConfig
    from lerobot_spacedock.dataset.convert import ConvertConfig, convert
    from lerobot_spacedock.dataset.record import Storage

    (folder / "in").mkdir()
    np.savez(folder / "in" / "episode_0.npz", **some_arrays())
    np.savez(folder / "in" / "episode_1.npz", **some_arrays())
    root = folder / "dataset"
    options = {"repo_id": "a/b", "root": str(root), "format": "npz", "num_workers": 1}
    small, stored = CameraConfig(height=16, width=24), Storage(kind="image")
    convert(ConvertConfig(source=str(folder / "in"), camera=small, storage=stored, **options))
    files = [(root / "meta" / name, mutations.json_text) for name in ("info.json", "spacedock.json", "stats.json")]
    found = [*(root / "meta").rglob("*.parquet"), *(root / "data").rglob("*.parquet")]
    return files + [(file, mutations.parquet) for file in sorted(found) if file.name != "tasks.parquet"]


def make_checked_dataset(folder: Path) -> list:
    """The same; and a frame is drawn, as the check does where the metadata claim that the pictures were."""
    from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, make_renderer

    make_renderer(CameraConfig(height=16, width=24)).render([0, -10, 0], [1, 0, 0, 0], FIXED_SUN_H["zvezda_aft"])
    return make_dataset(folder)


def root_of(path: Path) -> Path:
    return next(parent for parent in path.parents if parent.name == "dataset")


def read_dataset(path: Path) -> object:
    from lerobot_spacedock.dataset.reader import DatasetReader
    from lerobot_spacedock.dataset.stored_episode import DatasetEpisode

    root = root_of(path)
    found = [episode.log().num_steps for episode in DatasetReader(root).iterate()]
    episode = DatasetEpisode(root, 1)
    return found, episode.log().num_steps, [frame.shape for frame in episode.frames()]


def check_dataset(path: Path) -> object:
    """``spacedock check``: whatever is wrong belongs into its report."""
    from lerobot_spacedock.dataset.check import text_of
    from lerobot_spacedock.dataset.integrity import check_dataset

    root = root_of(path)
    return text_of(check_dataset(root, sample_frames=4), root)


def imitate_dataset(path: Path) -> object:
    from lerobot_spacedock.expert.demonstrations import load_demonstrations

    return load_demonstrations(root_of(path))


# ---- from the hub


class Hub:
    """A hub on this machine and what fetches from it, as LeRobot does: into a folder, and into the library's cache."""

    def __init__(self) -> None:
        from huggingface_hub import snapshot_download
        from huggingface_hub.utils import disable_progress_bars
        from local_hub import TOKEN, LocalHub, Repository

        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)
        disable_progress_bars()
        self._repository, self._download, self._token = Repository, snapshot_download, TOKEN
        self._hub = LocalHub()
        self._hub.__enter__()

    def fetch(self, files: dict[str, bytes], folder: Path) -> None:
        """Downloads a repository of these files; whatever the libraries raise is their own affair."""
        repository = self._repository(private=False)
        repository.commit("main", files)
        self._hub.repositories = {("dataset", REPO): repository}
        options = {"repo_type": "dataset", "endpoint": self._hub.url, "token": self._token, "max_workers": 1}
        options |= {"cache_dir": folder / "cache"}
        for place in ({"local_dir": folder / "mine"}, {}):
            with contextlib.suppress(Exception):
                self._download(REPO, **options, **place)


_HUB: list[Hub] = []  # one in each process that fuzzes


def make_repository(folder: Path) -> list:
    """The files of a small dataset as one JSON document, {path: content in base64}."""
    make_dataset(folder)
    root = folder / "dataset"
    content = {str(p.relative_to(root)): base64.b64encode(p.read_bytes()).decode() for p in _files(root)}
    document = folder / "repository.json"
    document.write_text(json.dumps(content))
    shutil.rmtree(folder / "in")
    shutil.rmtree(root)
    _HUB[:] = [Hub()]
    return [(document, hub_mutations.repository)]


def fetch_repository(path: Path) -> object:
    """Fetched, and then read from both places where it may have arrived."""
    from lerobot_spacedock.dataset.reader import DatasetReader

    files = {name: base64.b64decode(content) for name, content in json.loads(path.read_text()).items()}
    for name in ("mine", "cache"):
        shutil.rmtree(path.parent / name, ignore_errors=True)
    _HUB[0].fetch(files, path.parent)
    found = {"mine": None, "cache": None}
    for name in found:
        for info in sorted((path.parent / name).rglob("meta/info.json")):
            found[name] = [episode.log().num_steps for episode in DatasetReader(info.parents[1]).iterate()]
    return found


def _files(root: Path) -> list[Path]:
    """As few as a reader needs: each is a request and more."""
    return [root / "meta" / "info.json", *(p for part in ("data", "meta/episodes") for p in (root / part).rglob("*.*"))]


DATASET_READERS = (
    Reader("LeRobotDatasets", make_dataset, read_dataset),
    Reader("LeRobotDatasets, checked", make_checked_dataset, check_dataset),
    Reader("LeRobotDatasets, imitated", make_dataset, imitate_dataset),
    Reader("hub repositories", make_repository, fetch_repository, framed=True, loopback=True),
)
