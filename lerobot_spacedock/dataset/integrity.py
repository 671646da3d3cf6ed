"""Is a dataset what it claims to be? One function, used by ``spacedock check``, by the pipeline and by the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.episode_check import check_episode
from lerobot_spacedock.dataset.findings import Report, component_names
from lerobot_spacedock.dataset.pictures_check import check_pictures
from lerobot_spacedock.dataset.reader import INDEX_COLUMNS, DatasetReader, Episode
from lerobot_spacedock.dataset.totals_check import Totals, check_statistics, check_totals
from lerobot_spacedock.errors import InputError, SpaceDockError, reading
from lerobot_spacedock.physics.frames import OBSERVATION_NAMES


def check_dataset(
    root: Path, *, sample_frames: int = 16, redraw: bool = True, progress: Callable[[int], object] | None = None
) -> Report:
    """Checks the LeRobotDataset v3.0 at ``root``.

    Args:
        root: its folder.
        sample_frames: how many frames are decoded, spread over all episodes.
        redraw: draw them again as well, where the dataset says how.
        progress: called with 1 after each episode.

    Returns:
        The report. Problems of the data are in it; nothing is raised for them.
    """
    report = Report()
    try:
        with reading(root, "a dataset"):  # what no check below has thought of
            _check(root, report, sample_frames, redraw, progress)
    except (SpaceDockError, FileNotFoundError) as error:
        report.errors.append(str(error))
    return report


def _check(
    root: Path, report: Report, sample_frames: int, redraw: bool, progress: Callable[[int], object] | None
) -> None:
    reader = DatasetReader(root)
    if not _check_features(reader, report):
        return
    sampled = _sample(reader.lengths, sample_frames)
    watched: dict[int, Episode] = {}
    seen: dict[str, int] = {}
    totals = Totals()
    for position, episode in enumerate(reader.iterate()):
        check_episode(reader, episode, position, report, seen)
        totals.add(episode)
        if episode.index in sampled:
            watched[episode.index] = episode
        if progress is not None:
            progress(1)
    check_totals(reader, totals, report)
    check_statistics(reader, totals, report)
    check_pictures(reader, watched, sampled, redraw, report)


def _check_features(reader: DatasetReader, report: Report) -> bool:
    report.checks["features"] += 1
    where, info = "meta/info.json", reader.info
    version = str(info.get("codebase_version"))
    if not version.startswith("v3."):
        report.errors.append(
            f"{where}: codebase_version is {version}; v3.0 is needed (spacedock convert --format=v21)."
        )
        return False
    if info.get("fps") != schema.FPS:
        report.warnings.append(f"{where}: fps is {info.get('fps')}; this variable-step task is stored at {schema.FPS}.")
    for name in (schema.STATE, schema.ACTION, *INDEX_COLUMNS):
        if name not in reader.features:
            report.errors.append(f"{where}: feature {name!r} is missing.")
    if report.errors:
        return False
    try:
        observed = schema.observed_names(*reader.features[schema.STATE]["shape"])
    except (InputError, TypeError):  # unlike any: the comparison below says so
        observed = OBSERVATION_NAMES
    options = {"with_mass": "mass" in observed, "withhold_pose": "x" not in observed}
    expected = schema.columns(**options, image=False)
    missing = [name for name in expected if name not in reader.features]
    if missing:
        report.notes.append(f"{where}: no {', '.join(missing)}; what needs them is not checked.")
    for name, column in expected.items():
        feature = reader.features.get(name)
        if feature is None:
            continue
        if tuple(feature["shape"]) != column.shape or feature["dtype"] != column.dtype:
            report.errors.append(
                f"{where}: {name!r} is {feature['dtype']} {feature['shape']}, not {column.dtype} {list(column.shape)}."
            )
        elif component_names(feature) not in (None, list(column.names)):
            report.warnings.append(
                f"{where}: {name!r} has components {component_names(feature)}, not {list(column.names)}."
            )
    for name in reader.features:
        if name.startswith(("observation.", "action")) and name not in (schema.STATE, schema.ACTION, *reader.cameras):
            report.warnings.append(f"{where}: {name!r} will be an input or a target of every policy, by its prefix.")
    return report.ok


def _sample(lengths: np.ndarray, count: int) -> dict[int, list[int]]:
    """Frames to look at: evenly over all of them, first and last included; {episode: [steps]}."""
    total = int(lengths.sum())
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(int)
    chosen: dict[int, list[int]] = {}
    for at in np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int)) if total else []:
        episode = int(np.searchsorted(starts, at, side="right")) - 1
        chosen.setdefault(episode, []).append(int(at - starts[episode]))
    return chosen
