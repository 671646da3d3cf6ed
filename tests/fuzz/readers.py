"""Every reader of files that others may have made: good files by our own writers, the call that reads, the mutations.

A reader is given a file or a folder and may return, or raise a ``SpaceDockError`` that names the file. Nothing else.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
from dataclasses import asdict, replace
from pathlib import Path

import mutations
import numpy as np
from dataset_readers import DATASET_READERS
from reader import Reader, an_episode, some_arrays

from lerobot_spacedock.episode_log import log_path, write_episode_log

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
    with h5py.File(folder / "episode_1.hdf5", "w") as file:  # each picture a PNG file, filled up with zeros
        file["observations/qpos"], file["action"] = found["state"], found["action"]
        file["observations/images/camera"] = _encoded(found["images"])
    return [(folder / f"episode_{i}.hdf5", mutations.hdf5) for i in (0, 1)]


def _encoded(pictures: np.ndarray) -> np.ndarray:
    from PIL import Image

    rows = np.zeros((len(pictures), 400), dtype=np.uint8)
    for row, picture in zip(rows, pictures, strict=True):
        stream = io.BytesIO()
        Image.fromarray(picture).save(stream, "PNG")
        row[: len(stream.getvalue())] = np.frombuffer(stream.getvalue(), np.uint8)
    return rows


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


def read_view(path: Path) -> object:
    """``spacedock view``: the last state, drawn as the log says that it was seen."""
    from lerobot_spacedock.report.view import ViewConfig, view

    with contextlib.redirect_stdout(None):
        return view(ViewConfig(log=path, detail="low", height=16, width=24, render=path.with_suffix(".png")))


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


# ---- weights, meshes, results


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


def make_training(folder: Path) -> list:
    """A checkpoint of a small training, as ``train-expert`` leaves it to be resumed."""
    from lerobot_spacedock.expert.ppo import make_ppo
    from lerobot_spacedock.expert.train_config import ActorConfig, PpoConfig, TrainExpertConfig
    from lerobot_spacedock.expert.train_state import save_checkpoint
    from lerobot_spacedock.expert.training_tasks import TrainingTasks

    small = PpoConfig(critic_hidden_sizes=[4], mini_batches=1)
    config = TrainExpertConfig(num_envs=8, episode_steps=4, actor=ActorConfig(4, [4]), ppo=small)
    algorithm = make_ppo(config, TrainingTasks(config).reset(0))
    _TRAINING[:] = [config, algorithm]
    progress = {"iteration": 1, "episodes": 8, "interactions": 32, "wall_s": 0.5, "curve": []}
    resolved = {"actor": asdict(config.actor), "resume": False}
    saved = save_checkpoint(folder / "checkpoints", config, algorithm, progress, resolved)
    return [
        (saved / "training.safetensors", mutations.safetensors_header),
        (saved / "training.json", mutations.json_text),
    ]


_TRAINING: list = []  # what a checkpoint is read into; one in each process that fuzzes


def read_training(path: Path) -> object:
    from lerobot_spacedock.expert.train_state import load_checkpoint, load_networks

    config, algorithm = _TRAINING
    load_networks(replace(config, init_from=str(path.parent)), algorithm)
    return load_checkpoint(path.parents[1], algorithm, {"actor": asdict(config.actor), "resume": True})


def make_results(folder: Path) -> list:
    row = {"task": "t", "coefficient": 0.01, "episodes": 2, "idss": 1, "contact": 2, "closing_m_s": {"median": 0.1}}
    row |= {"smoothness": {"mean": 1.0}, "distance_m": {"mean": 0.1, "p95": 0.2}}
    trials = [{"point": {"seed": 0, "demonstrations": "clean", "chunk_size": n}, "rows": [row] * 2} for n in (5, 10)]
    (folder / "sweep.json").write_text(json.dumps({"name": "a", "trials": trials}))
    return [(folder / "sweep.json", mutations.json_text)]


def read_results(path: Path) -> object:
    from lerobot_spacedock.study.figure import frontier
    from lerobot_spacedock.study.results import read_trials
    from lerobot_spacedock.study.table import table

    trials = read_trials([path])
    return frontier(trials, "t"), table(trials)


def make_mesh(folder: Path) -> list:
    import trimesh

    trimesh.creation.box((1, 2, 3)).export(folder / "box.glb")
    return [(folder / "box.glb", mutations.glb_json)]


def read_mesh(path: Path) -> object:
    from lerobot_spacedock.station.mesh import load_station

    return load_station(path)


READERS = (
    Reader("raw export (CSV)", make_csv, read_csv),
    Reader("pictures (PNG)", make_png, read_png),
    Reader("arrays (NPZ)", make_npz, read_arrays),
    Reader("arrays (HDF5)", make_hdf5, read_arrays, needs=("h5py",)),
    Reader("episode logs (Parquet)", make_log, read_log),
    Reader("episode logs, to be looked at", make_log, read_view),
    Reader("policy and training records (JSON)", make_samples, read_samples),
    Reader("options and sweeps (YAML)", make_yaml, read_yaml),
    Reader("expert checkpoints", make_checkpoint, read_checkpoint),
    Reader("training checkpoints", make_training, read_training),
    Reader("results of sweeps (JSON)", make_results, read_results),
    Reader("station meshes (GLB)", make_mesh, read_mesh),
    *DATASET_READERS,
)
