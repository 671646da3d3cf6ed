"""Every reader of files that others may have made: good files by our own writers, the call that reads, the mutations.

A reader is given a file or a folder and may return, or raise a ``SpaceDockError`` that names the file. Nothing else.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mutations
import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog, log_path, write_episode_log
from lerobot_spacedock.errors import SpaceDockError

STEPS = 6
Mutation = Callable[[np.random.Generator, bytes], bytes]


@dataclass(frozen=True)
class Reader:
    """One row of the table.

    Attributes:
        name: what is read.
        make: writes good files into a folder; returns those that get mutated, each with what keeps its framing whole
            (None: bytes only).
        read: what is called with the mutated file.
        allowed: what it may raise.
        needs: optional modules.
    """

    name: str
    make: Callable[[Path], list[tuple[Path, Mutation | None]]]
    read: Callable[[Path], object]
    allowed: tuple[type[BaseException], ...] = (SpaceDockError,)
    needs: tuple[str, ...] = ()


def an_episode(seed: int = 0) -> EpisodeLog:
    """A short flight as the environment logs it."""
    rng = np.random.default_rng(seed)
    state = np.zeros((STEPS + 1, 14))
    state[:, 1], state[:, 6] = np.linspace(-3.0, 0.2, STEPS + 1), 1000.0
    state[:, 7:11] = (0.5**0.5, -(0.5**0.5), 0.0, 0.0)
    about = {
        "env_id": "SpaceDock-v0",
        "seed": seed,
        "initial_conditions": "same",
        "clipped_actions": 0,
        "success": True,
    }
    about |= {"config": {"port": "zvezda_aft", "corridor": {"half_angle_deg": 10.0, "mouth_radius_m": 1.5}}}
    about |= {"inference": {"batch": 2, "warm_up_steps": 1}}
    dt = np.full(STEPS, 0.9)
    time = np.concatenate([[0.0], np.cumsum(dt)])
    extra = {"inference_s": rng.uniform(0.01, 0.02, STEPS)}
    return EpisodeLog(time, state, rng.normal(0, 5, (STEPS, 6)), dt, np.zeros(STEPS), about, extra)


# ---- rollouts that others made


def make_csv(folder: Path) -> list:
    from lerobot_spacedock.dataset.sources.raw import HEADER

    log = an_episode()
    table = np.hstack([log.time[:, None], log.state, np.vstack([log.action, np.zeros(6)])])
    file = folder / "trajectory_0.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(HEADER), comments="", fmt="%.6g")
    return [(file, mutations.csv_text)]


def read_csv(path: Path) -> object:
    from lerobot_spacedock.dataset.sources.raw import read_table

    return read_table(path)


def make_png(folder: Path) -> list:
    from PIL import Image

    picture = np.random.default_rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    files = []
    for mode in ("RGB", "L", "P"):
        files.append((folder / f"{mode}.png", mutations.png_header))
        Image.fromarray(picture).convert(mode).save(files[-1][0])
    return files


def read_png(path: Path) -> object:
    from lerobot_spacedock.dataset.sources.pictures import read_picture

    return read_picture(path)


def some_arrays() -> dict[str, np.ndarray]:
    log = an_episode()
    images = np.random.default_rng(0).integers(0, 256, (STEPS, 4, 6, 3), dtype=np.uint8)
    return {"state": log.state[:-1, :13], "action": log.action, "dt": log.dt, "images": images}


def make_npz(folder: Path) -> list:
    for name, save in (("episode_0.npz", np.savez), ("episode_1.npz", np.savez_compressed)):
        save(folder / name, **some_arrays())
    return [(folder / "episode_0.npz", mutations.npz), (folder / "episode_1.npz", mutations.npz)]


def make_hdf5(folder: Path) -> list:
    import h5py

    found = some_arrays()
    with h5py.File(folder / "episode_0.hdf5", "w") as file:
        file["observations/qpos"], file["action"] = found["state"], found["action"]
        file["observations/images/camera"], file["dt"] = found["images"], found["dt"]
        file.attrs["success"] = True
    return [(folder / "episode_0.hdf5", mutations.hdf5)]


def read_arrays(path: Path) -> object:
    from lerobot_spacedock.dataset.sources import EpisodeRef, load

    episode = load(EpisodeRef(path.suffix[1:], str(path)))
    return [frame.shape for frame in episode.frames(0)] if episode.frames else None


# ---- what the report reads


def make_log(folder: Path) -> list:
    return [(write_episode_log(log_path(folder, seed), an_episode(seed)), mutations.parquet) for seed in (0, 1)]


def read_log(path: Path) -> object:
    from lerobot_spacedock.metrics.collect import measured

    return measured(path)


def make_samples(folder: Path) -> list:
    counts = {"episodes": 3, "interactions": 70}
    shown = {"demonstrations": 5, "demonstration_interactions": 300, "flown_episodes": 9, "expert": "meta_rl"}
    record = {"policy": "act", "type": "act", "dataset": "d", "learnt_from": {**shown, "training": counts}}
    (folder / "policy.json").write_text(json.dumps(record))
    (folder / "training.json").write_text(json.dumps({"training": counts}))
    return [(folder / name, mutations.json_text) for name in ("policy.json", "training.json")]


def read_samples(path: Path) -> object:
    from lerobot_spacedock.report.samples import read_samples as read

    if path.name == "policy.json":
        return read([], [], {"A": [path]})
    return read([f"A={path}"], [], {"A": []})


# ---- options


CONFIGS = {  # file: where its options are declared, and a good file
    "train": ("expert.train_config", "TrainExpertConfig", "output_dir: x\nactor: {lstm_size: 8}\nppo: {clip: 0.2}\n"),
    "report": ("report.build", "ReportConfig", "runs: [A=x, B=y]\nresamples: 200\ntitle: T\nreference: null\n"),
    "view": ("report.view", "ViewConfig", "log: a.parquet\nsave: b.rrd\nspeed: 4.0\ncamera: true\n"),
    "sweep": ("study.config", "SweepConfig", "name: a\nseeds: [0, 1]\nlearning_rates: [1.0e-4]\nsampler: grid\n"),
}


def make_yaml(folder: Path) -> list:
    for name, (_, _, text) in CONFIGS.items():
        (folder / f"{name}.yaml").write_text(text)
    return [(folder / f"{name}.yaml", mutations.yaml_text) for name in CONFIGS]


def read_yaml(path: Path) -> object:
    from lerobot_spacedock.cli import parse_config

    module, name, _ = CONFIGS[path.stem]
    config_class = getattr(importlib.import_module(f"lerobot_spacedock.{module}"), name)
    return parse_config(config_class, [f"--config_path={path}"], prog="spacedock")


# ---- weights, meshes, datasets


def make_checkpoint(folder: Path) -> list:
    from lerobot_spacedock.expert.checkpoint import save_actor
    from lerobot_spacedock.expert.network import ActorNetwork, NetworkConfig

    save_actor(folder / "policy.safetensors", ActorNetwork(NetworkConfig(lstm_size=4, hidden_sizes=(4,))), {})
    return [
        (folder / "policy.safetensors", mutations.safetensors_header),
        (folder / "policy.json", mutations.json_text),
    ]


def read_checkpoint(path: Path) -> object:
    from lerobot_spacedock.expert.checkpoint import load_actor

    return load_actor(path.with_suffix(".safetensors"))


def make_mesh(folder: Path) -> list:
    import trimesh

    trimesh.creation.box((1, 2, 3)).export(folder / "box.glb")
    return [(folder / "box.glb", mutations.glb_json)]


def read_mesh(path: Path) -> object:
    from lerobot_spacedock.station.mesh import load_station

    return load_station(path)


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
    files = [(root / "meta" / name, mutations.json_text) for name in ("info.json", "spacedock.json")]
    found = [*(root / "meta").rglob("*.parquet"), *(root / "data").rglob("*.parquet")]
    return files + [(file, mutations.parquet) for file in sorted(found) if file.name != "tasks.parquet"]


def read_dataset(path: Path) -> object:
    from lerobot_spacedock.dataset.reader import DatasetReader
    from lerobot_spacedock.report.dataset_reader import DatasetEpisode

    root = next(parent for parent in path.parents if parent.name == "dataset")
    found = [episode.log().num_steps for episode in DatasetReader(root).iterate()]
    episode = DatasetEpisode(root, 1)
    return found, episode.log().num_steps, [frame.shape for frame in episode.frames()]


READERS = (
    Reader("raw export (CSV)", make_csv, read_csv),
    Reader("pictures (PNG)", make_png, read_png),
    Reader("arrays (NPZ)", make_npz, read_arrays),
    Reader("arrays (HDF5)", make_hdf5, read_arrays, needs=("h5py",)),
    Reader("episode logs (Parquet)", make_log, read_log),
    Reader("policy and training records (JSON)", make_samples, read_samples),
    Reader("options and sweeps (YAML)", make_yaml, read_yaml),
    Reader("expert checkpoints", make_checkpoint, read_checkpoint),
    Reader("station meshes (GLB)", make_mesh, read_mesh),
    Reader("LeRobotDatasets", make_dataset, read_dataset),
)
