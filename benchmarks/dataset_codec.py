"""What the codec costs a policy that has to see the last metres.

    python benchmarks/dataset_codec.py --episodes=80 --height=96 --width=128 --seeds=3

The same small network learns the relative pose (lateral offset, distance, attitude) from frames of the last 5 m, once
from lossless frames and once from what each codec left of them, with the same seeds; all are then tested on lossless
frames of other episodes, as the simulator shows them to a policy. Frames go through ``DatasetRecorder`` and LeRobot's
own decoder. Beside it: PSNR near the port, size, and how long writing and a random read take.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig
from lerobot_spacedock.dataset.encoder import quiet_encoders
from lerobot_spacedock.dataset.flight import fly
from lerobot_spacedock.dataset.frames import Artist, drawing_options
from lerobot_spacedock.dataset.pictures_check import psnr_dB
from lerobot_spacedock.dataset.record import DatasetLayout, DatasetRecorder, Storage
from lerobot_spacedock.dataset.segments import Segment, tail
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.expert.feedback import FeedbackPolicy
from lerobot_spacedock.physics.frames import POSITION, QUATERNION

LAST = "last:5m"
TEST_SHARE = 0.25
STORAGES = {
    "png": Storage("image"),
    "av1 crf 30": Storage("video", crf=30),
    "av1 crf 18": Storage("video", crf=18),
}


@dataclass(frozen=True)
class Stored:
    """What one storage made of the frames.

    Attributes:
        frames: uint8 (n, height, width, 3), as LeRobot reads them.
        kB: of the dataset, a frame.
        write_ms: a frame.
        read_ms: a frame, in random order.
    """

    frames: np.ndarray
    kB: float
    write_ms: float
    read_ms: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=80)
    parser.add_argument("--height", type=int, default=96)
    parser.add_argument("--width", type=int, default=128)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--storages", default=",".join(STORAGES))
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    quiet_encoders()
    logs, frames = make(arguments)
    lengths = [log.num_steps for log in logs]
    test = np.repeat(np.arange(len(logs)) >= (1.0 - TEST_SHARE) * len(logs), lengths)
    pose = np.concatenate([pose_of(log) for log in logs])
    lossless = np.concatenate(frames)
    spread = pose[~test].std(axis=0)
    print(f"{len(logs)} approaches, {len(pose)} frames of {arguments.height} × {arguments.width} within 5 m")
    print(
        f"{'storage':12s} {'kB':>6s} {'write ms':>8s} {'read ms':>8s} {'PSNR dB':>8s}  error of the pose, seed by seed"
    )
    for name in arguments.storages.split(","):
        storage = STORAGES[name]
        stored = store(logs, frames, storage, arguments)
        quality = np.mean([min(psnr_dB(a, b), 99.0) for a, b in zip(stored.frames, lossless, strict=True)])
        found = []
        for seed in range(arguments.seeds):
            network = train(stored.frames[~test], (pose[~test] / spread).astype(np.float32), seed, arguments.epochs)
            error = predict(network, lossless[test]) * spread - pose[test]
            lateral_mm = 1e3 * np.sqrt((error[:, [0, 2]] ** 2).sum(axis=1).mean())
            found.append((lateral_mm, np.degrees(np.sqrt((error[:, 3:] ** 2).sum(axis=1).mean()))))
        shown = "  ".join(f"{mm:.0f} mm, {deg:.2f}°" for mm, deg in found)
        mean_mm, mean_deg = np.mean(found, axis=0)
        print(
            f"{name:12s} {stored.kB:6.2f} {stored.write_ms:8.1f} {stored.read_ms:8.1f} {quality:8.1f}  {shown}"
            f"  mean {mean_mm:.0f} mm, {mean_deg:.2f}°",
            flush=True,
        )


def make(arguments: argparse.Namespace) -> tuple[list[EpisodeLog], list[np.ndarray]]:
    """The last 5 m of kicked approaches from wide starts, and their frames."""
    camera = CameraConfig(height=arguments.height, width=arguments.width)
    env = SpaceDockConfig(**ENV_IDS["SpaceDockContact-v0"], camera=camera, initial_conditions="wide")
    seeds = np.arange(100_000, 100_000 + arguments.episodes)
    kicks = Disturbance.draw(seeds, env.max_steps, KickConfig(probability=0.12), NoiseConfig())
    segment = Segment.parse(LAST)
    flown = fly(FeedbackPolicy("V", hill_coupling=True), env, seeds, kicks)
    logs = [tail(log, segment.first_step(log)) for log in flown]
    artist = Artist(**drawing_options(env))
    frames = [np.stack(list(artist.draw(log))) for log in logs]
    artist.close()
    return logs, frames


def pose_of(log: EpisodeLog) -> np.ndarray:
    """(K, 6): position from the port in m, and the small rotation from the mean attitude in rad."""
    quaternion = log.state[:-1, QUATERNION]
    docked = np.array([1.0, -1.0, 0.0, 0.0]) / np.sqrt(2.0)  # camera along +y: what every approach ends in
    sign = np.sign(quaternion @ docked)[:, None]
    w, x, y, z = (sign * quaternion).T
    a, b = docked[:2]
    vector = np.stack([a * x - b * w, a * y + b * z, a * z - b * y], axis=1)  # of conj(docked) ⊗ quaternion
    return np.hstack([log.state[:-1, POSITION], 2.0 * vector])


def store(logs: list[EpisodeLog], frames: list[np.ndarray], storage: Storage, arguments: argparse.Namespace) -> Stored:
    """Writes the frames as a dataset and reads them back."""
    layout = DatasetLayout("bench/codec", arguments.height, arguments.width, storage=storage)
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch) / "dataset"
        start = time.perf_counter()
        with DatasetRecorder(root, layout, encoder_threads=arguments.threads) as recorder:
            for log, pictures in zip(logs, frames, strict=True):
                recorder.add_episode(log, pictures)
        written_s = time.perf_counter() - start
        size = sum(file.stat().st_size for file in root.rglob("*") if file.is_file())
        dataset = LeRobotDataset("bench/codec", root=root, video_backend="pyav")
        read = np.empty((len(dataset), arguments.height, arguments.width, 3), dtype=np.uint8)
        start = time.perf_counter()
        for index in np.random.default_rng(0).permutation(len(dataset)):
            read[index] = (dataset[int(index)][schema.IMAGE].numpy().transpose(1, 2, 0) * 255.0).round()
        read_s = time.perf_counter() - start
    count = len(read)
    return Stored(read, size / 1e3 / count, 1e3 * written_s / count, 1e3 * read_s / count)


def train(frames: np.ndarray, target: np.ndarray, seed: int, epochs: int) -> torch.nn.Module:
    """A small network from uint8 (n, height, width, 3) to (n, 6), the same for the same seed."""
    torch.manual_seed(seed)
    layers: list[torch.nn.Module] = []
    for before, after in ((3, 16), (16, 32), (32, 64), (64, 64)):
        layers += [torch.nn.Conv2d(before, after, 5, stride=2, padding=2), torch.nn.ReLU()]
    flat = 64 * -(-frames.shape[1] // 16) * -(-frames.shape[2] // 16)
    network = torch.nn.Sequential(*layers, torch.nn.Flatten(), torch.nn.Linear(flat, 128), torch.nn.ReLU())
    network.append(torch.nn.Linear(128, target.shape[1]))
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    batch, count = 32, len(frames)
    steps = epochs * (count // batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
    generator = np.random.default_rng(seed)
    for step in range(steps):
        chosen = generator.integers(0, count, batch)
        loss = torch.nn.functional.mse_loss(network(as_input(frames[chosen])), torch.from_numpy(target[chosen]))
        if not torch.isfinite(loss):
            raise RuntimeError(f"seed {seed}: the loss is not finite at step {step}")
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    return network.eval()


@torch.no_grad()
def predict(network: torch.nn.Module, frames: np.ndarray) -> np.ndarray:
    return np.concatenate([network(as_input(frames[at : at + 64])).numpy() for at in range(0, len(frames), 64)])


def as_input(frames: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(frames.transpose(0, 3, 1, 2).astype(np.float32) / 255.0 - 0.5)


if __name__ == "__main__":
    main()
