"""Statistics against NumPy in float64, on channels that hardly move beside their size."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot.datasets.compute_stats import get_feature_stats

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.record import DatasetLayout, DatasetRecorder
from lerobot_spacedock.dataset.statistics import StreamStatistics, repair_statistics, vector_statistics
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError


def mass_log(seed: int, steps: int = 30, *, constant: bool = False) -> EpisodeLog:
    generator = np.random.default_rng(seed)
    state = generator.normal(size=(steps + 1, 14))
    state[:, 6] = 999.53 if constant else np.linspace(1000.0, 999.53, steps + 1)
    state[:, 7:11] /= np.linalg.norm(state[:, 7:11], axis=1, keepdims=True)
    dt = generator.uniform(0.8, 1.0, steps)
    time = np.concatenate([[0.0], np.cumsum(dt)])
    return EpisodeLog(time, state, generator.normal(size=(steps, 6)), dt, np.zeros(steps), {"seed": seed})


@pytest.fixture(params=[False, True], ids=["moving", "constant"])
def mass_dataset(request, tmp_path):
    logs = [mass_log(seed, steps, constant=request.param) for seed, steps in enumerate((30, 17, 41))]
    root = tmp_path / "mass"
    with DatasetRecorder(root, DatasetLayout("test/mass", image=False, with_mass=True)) as recorder:
        for log in logs:
            recorder.add_episode(log)
    return root, [log.state[:-1].astype(np.float32).astype(np.float64) for log in logs]


def test_a_mass_of_999_53_to_1000_kg_keeps_its_spread(mass_dataset):
    root, states = mass_dataset
    everything = np.concatenate(states)
    repair_statistics(root)
    stats = json.loads((root / "meta" / "stats.json").read_text())[schema.STATE]
    np.testing.assert_allclose(stats["std"], everything.std(axis=0), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(stats["mean"], everything.mean(axis=0), rtol=1e-12, atol=1e-12)
    for name, q in (("q01", 0.01), ("q50", 0.5), ("q99", 0.99)):
        span = np.ptp(everything, axis=0)
        neighbours = np.abs(np.sort(everything, axis=0) - np.array(stats[name])).min(axis=0)
        assert (neighbours <= span / 1e4).all(), "a quantile is one of the values, to the bin"
        share = (everything <= np.array(stats[name]) + span / 1e4).mean(axis=0)
        assert (share >= q - 1e-9).all()


def test_each_episode_keeps_its_own(mass_dataset):
    root, states = mass_dataset
    repair_statistics(root)
    table = pq.read_table(root / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    for row, state in enumerate(states):
        np.testing.assert_allclose(
            table[f"stats/{schema.STATE}/std"][row].as_py(), state.std(axis=0), rtol=1e-9, atol=1e-12
        )
        np.testing.assert_allclose(table[f"stats/{schema.STATE}/max"][row].as_py(), state.max(axis=0))


def test_a_dataset_that_counts_more_rows_than_it_holds_is_named(tmp_path):
    root = tmp_path / "short"
    with DatasetRecorder(root, DatasetLayout("test/short", image=False)) as recorder:
        recorder.add_episode(mass_log(0, 9))
    path = root / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(path)
    place = table.column_names.index("length")
    pq.write_table(table.set_column(place, "length", [[12]]), path)
    with pytest.raises(FileFormatError, match="short: meta/episodes counts 3 rows more than data/ holds"):
        repair_statistics(root)


def test_a_normalised_near_constant_channel_is_normal(mass_dataset):
    """What a policy computes with these statistics, in float32 as it does."""
    root, states = mass_dataset
    repair_statistics(root)
    stats = json.loads((root / "meta" / "stats.json").read_text())[schema.STATE]
    mean, std = np.float32(stats["mean"][6]), np.float32(stats["std"][6])
    mass = np.concatenate(states)[:, 6].astype(np.float32)
    normalised = (mass - mean) / (std + np.float32(1e-8))
    if std == 0.0:
        assert (normalised == 0.0).all()
    else:
        assert abs(normalised.mean()) < 1e-3
        assert abs(normalised.std() - 1.0) < 1e-3


def test_why_it_is_needed_lerobots_own_lose_it():
    """If this fails LeRobot has mended its statistics, and ``repair_statistics`` may go."""
    mass = np.linspace(1000.0, 999.53, 5000, dtype=np.float32)[:, None]
    theirs = get_feature_stats(mass, axis=0, keepdims=False)["std"]
    true = mass.astype(np.float64).std()
    assert abs(theirs[0] - true) > 0.05 * true


def test_batches_give_what_the_whole_gives():
    values = np.random.default_rng(3).normal(size=(1000, 4)) * [1.0, 1e-3, 1e3, 0.0] + [0.0, 1e3, -5.0, 7.0]
    stream = StreamStatistics()
    for part in np.array_split(values, 7):
        stream.update(part)
    for part in np.array_split(values, 3):
        stream.update_quantiles(part)
    found, whole = stream.result(), vector_statistics(values)
    for name in ("min", "max", "mean", "std"):
        np.testing.assert_allclose(found[name], whole[name], rtol=1e-9, atol=1e-12)
    for name in ("q01", "q50", "q99"):
        assert (np.abs(found[name] - whole[name]) <= 0.02 * np.maximum(np.ptp(values, axis=0), 1e-12)).all()
