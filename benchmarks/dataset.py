"""How fast datasets are written: this package beside the encoder alone and beside LeRobot's plain ``add_frame`` loop.

    python benchmarks/dataset.py --episodes=8 --height=480 --width=640

All three get the same frames, drawn beforehand, and encode with the same settings on the same threads. Then what the
storages cost: bytes and random reads, and the error that the codec leaves near the port.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
from lerobot.configs import RGBEncoderConfig
from lerobot.datasets import dataset_writer, io_utils
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from table import Row

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig
from lerobot_spacedock.dataset.encoder import quiet_encoders
from lerobot_spacedock.dataset.episode import rows_of
from lerobot_spacedock.dataset.flight import fly
from lerobot_spacedock.dataset.frames import Artist, drawing_options
from lerobot_spacedock.dataset.pictures_check import psnr_dB
from lerobot_spacedock.dataset.record import DatasetLayout, DatasetRecorder, Storage
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.expert.feedback import FeedbackPolicy

NEAR_PORT_m = 2.0
ENCODER = "the encoder alone"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--height", type=int, default=480)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--threads", type=int, default=2, help="of the encoder")
    parser.add_argument("--reads", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=2, help="of each writer, in turn; the fastest counts")
    parser.add_argument("--part", choices=("speed", "storage", "all"), default="all")
    arguments = parser.parse_args()
    quiet_encoders()
    logs, frames, draw_s = make(arguments)
    count = sum(map(len, frames))
    print(f"{len(logs)} episodes, {count} frames of {arguments.height} × {arguments.width}")
    print(f"drawing                            {count / draw_s:7.1f} frames/s")
    with tempfile.TemporaryDirectory() as scratch:
        if arguments.part != "storage":
            report_speed(Path(scratch), logs, frames, arguments)
        if arguments.part == "speed":
            return
        print(f"{'storage':24s} {'MB':>7s} {'read ms':>8s} {'PSNR dB':>8s} {'near port':>9s}")
        for label, storage in {
            "av1 crf 30": Storage("video", crf=30),
            "av1 crf 18": Storage("video", crf=18),
            "h264 crf 18": Storage("video", vcodec="h264", crf=18),
            "png": Storage("image"),
        }.items():
            report_storage(Path(scratch) / label.replace(" ", "_"), label, storage, logs, frames, arguments)


def rows(quick: bool) -> Iterator[Row]:
    """For the table of ``python benchmarks``."""
    arguments = argparse.Namespace(
        episodes=1 if quick else 3, height=480, width=640, threads=2, repeats=1 if quick else 2
    )
    quiet_encoders()
    logs, frames, _ = make(arguments)
    count = sum(map(len, frames))
    with tempfile.TemporaryDirectory() as scratch:
        spent_s = write_in_turn(Path(scratch), logs, frames, arguments)
    encoder = count / spent_s.pop(ENCODER)
    for name, taken_s in spent_s.items():
        yield Row(f"dataset writing, 480 × 640, AV1: {name}", count / taken_s, "frames/s", ENCODER, encoder)


def report_speed(scratch: Path, logs, frames, arguments) -> None:
    """Prints the rate of the encoder, of LeRobot's loop and of this package."""
    count = sum(map(len, frames))
    spent_s = write_in_turn(scratch, logs, frames, arguments)
    for name, taken_s in spent_s.items():
        print(f"{name:34s} {count / taken_s:7.1f} frames/s  {taken_s / spent_s[ENCODER]:.2f} × the encoder")


def write_in_turn(scratch: Path, logs, frames, arguments) -> dict[str, float]:
    """Writer → s, the fastest of ``repeats``; each warms up on one episode."""
    writers = {
        ENCODER: lambda root, logs, frames: encoder_alone(root, frames, arguments.threads),
        "LeRobot's plain add_frame loop": lambda root, logs, frames: plain_loop(root, logs, frames, arguments),
        "DatasetRecorder": lambda root, logs, frames: recorder(root, logs, frames, arguments, "video"),
    }
    spent_s: dict[str, list[float]] = {name: [] for name in writers}
    for repeat in range(-1, arguments.repeats):
        for name, write in writers.items():
            root = scratch / f"{len(name)}_{repeat}"
            part = slice(0, 1) if repeat < 0 else slice(None)
            taken_s = timed(lambda write=write, root=root, part=part: write(root, logs[part], frames[part]))
            if repeat >= 0:
                spent_s[name].append(taken_s)
            shutil.rmtree(root)
    return {name: min(taken) for name, taken in spent_s.items()}


def make(arguments: argparse.Namespace) -> tuple[list[EpisodeLog], list[list[np.ndarray]], float]:
    """Episodes and their frames, drawn once; and how long the drawing took, s."""
    camera = CameraConfig(height=arguments.height, width=arguments.width)
    env = SpaceDockConfig(**ENV_IDS["SpaceDockContact-v0"], camera=camera)
    seeds = np.arange(100_000, 100_000 + arguments.episodes)
    calm = Disturbance.draw(seeds, env.max_steps, KickConfig(), NoiseConfig())
    logs = list(fly(FeedbackPolicy("V", hill_coupling=True), env, seeds, calm))
    artist = Artist(**drawing_options(env))
    next(artist.draw(logs[0]))  # compiles, and builds the scene
    start = time.perf_counter()
    frames = [list(artist.draw(log)) for log in logs]
    return logs, frames, time.perf_counter() - start


def timed(work) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def encoder_alone(folder: Path, frames: list[list[np.ndarray]], threads: int) -> None:
    config = RGBEncoderConfig(crf=Storage().crf, g=Storage().gop)
    folder.mkdir()
    for number, pictures in enumerate(frames):
        with av.open(str(folder / f"{number}.mp4"), "w") as container:
            options = config.get_codec_options(threads, as_strings=True)
            stream = container.add_stream(config.vcodec, schema.FPS, options=options)
            stream.pix_fmt, (stream.height, stream.width) = config.pix_fmt, pictures[0].shape[:2]
            for picture in pictures:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            container.mux(stream.encode())


def recorder(root: Path, logs, frames, arguments, storage: str | Storage) -> None:
    storage = Storage(storage) if isinstance(storage, str) else storage
    layout = DatasetLayout("bench/mark", arguments.height, arguments.width, storage=storage)
    with DatasetRecorder(root, layout, encoder_threads=arguments.threads) as writer:
        for log, pictures in zip(logs, frames, strict=True):
            writer.add_episode(log, pictures)


def plain_loop(root: Path, logs, frames, arguments) -> None:
    """What LeRobot's documentation shows: frames as PNG files first, encoded when the episode is saved."""
    dataset_writer.embed_images = io_utils.embed_images  # DatasetRecorder has put another one there
    features = schema.features(height=arguments.height, width=arguments.width)
    dataset = LeRobotDataset.create(
        "bench/mark",
        schema.FPS,
        features,
        root,
        schema.ROBOT_TYPE,
        video_backend="pyav",
        encoder_threads=arguments.threads,
    )
    for log, pictures in zip(logs, frames, strict=True):
        rows = rows_of(log)
        for k, picture in enumerate(pictures):
            dataset.add_frame({n: v[k] for n, v in rows.items()} | {schema.IMAGE: picture, "task": schema.TASK})
        dataset.save_episode()
    dataset.finalize()


def report_storage(root: Path, label: str, storage: Storage, logs, frames, arguments) -> None:
    recorder(root, logs, frames, arguments, storage)
    size = sum(file.stat().st_size for file in root.rglob("*") if file.is_file())
    dataset = LeRobotDataset("bench/mark", root=root, video_backend="pyav")
    flat = [picture for pictures in frames for picture in pictures]
    near = np.concatenate([np.linalg.norm(log.state[:-1, :3], axis=1) < NEAR_PORT_m for log in logs])
    chosen = np.random.default_rng(0).permutation(len(flat))[: arguments.reads]
    start = time.perf_counter()
    read = [dataset[int(i)][schema.IMAGE] for i in chosen]
    each_ms = 1e3 * (time.perf_counter() - start) / len(chosen)
    pictures = [(p.numpy().transpose(1, 2, 0) * 255.0).round().astype(np.uint8) for p in read]
    quality = np.array([min(psnr_dB(p, flat[i]), 99.0) for p, i in zip(pictures, chosen, strict=True)])
    close = quality[near[chosen]].mean() if near[chosen].any() else float("nan")
    print(f"{label:24s} {size / 1e6:7.2f} {each_ms:8.1f} {quality.mean():8.1f} {close:9.1f}")
    shutil.rmtree(root)


if __name__ == "__main__":
    main()
