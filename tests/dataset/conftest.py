"""Real flights, once a session."""

from __future__ import annotations

from pathlib import Path

import pytest
from dataset_samples import fly_some, short, write_raw_export

from lerobot_spacedock.dataset.disturbance import KickConfig
from lerobot_spacedock.episode_log import EpisodeLog, write_episode_log


@pytest.fixture(scope="session")
def flights() -> list[EpisodeLog]:
    """Five dockings of the hand-designed law, kicked on the way."""
    return fly_some(range(100_000, 100_005), kicks=KickConfig(probability=0.12, quiet_m=3.0))


@pytest.fixture(scope="session")
def log_folder(flights, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    for log in flights:
        write_episode_log(folder / f"episode_{log.metadata['seed']:06d}.parquet", log)
    return folder


@pytest.fixture
def raw_export(flights, tmp_path) -> Path:
    folder = tmp_path / "raw"
    write_raw_export(folder, [short(log, 6) for log in flights[:2]], pictures=True)
    return folder
