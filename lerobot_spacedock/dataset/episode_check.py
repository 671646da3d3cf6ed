"""Checks of one episode: its rows, and whether its states follow from its commands."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.findings import Problems, Report
from lerobot_spacedock.dataset.reader import DatasetReader, Episode
from lerobot_spacedock.dataset.residuals import TOLERANCES, best_coupling, residuals
from lerobot_spacedock.dataset.segments import MIN_STEPS
from lerobot_spacedock.dataset.sources import NO_CHASER
from lerobot_spacedock.env.start import MAX_QUATERNION_ERROR
from lerobot_spacedock.episode_log import OBSERVED
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.metrics.episode import limits_of
from lerobot_spacedock.physics.frames import (
    MASS,
    POSITION,
    QUATERNION,
    RATE,
    STATE_DIM,
    STATE_NAMES,
    VELOCITY,
)

MAX_POSITION_m, MAX_SPEED_m_s, MAX_RATE_deg_s = 1000.0, 50.0, 180.0
TIME_TOLERANCE_s = 1e-4
UNKNOWN_MASS = 20.0  # a mass that is off by 2 kg changes a full thrust's speed by 8e-5 m/s


def check_episode(reader: DatasetReader, episode: Episode, position: int, report: Report, seen: dict[str, int]) -> None:
    """Adds to the report what is wrong with one episode.

    Args:
        reader: of the dataset.
        episode: its rows.
        position: its place among the episodes, from 0.
        report: to add to.
        seen: {digest: episode} of those before; this one is added.
    """
    rows, steps, before = episode.rows, len(episode.rows["index"]), report.frames
    problems = Problems(report, f"episode {episode.index}")
    report.episodes, report.frames = report.episodes + 1, report.frames + steps
    report.checks["episode"] += 1
    if episode.index != position:
        problems.error(f"stands where episode {position} should be")
    if steps < MIN_STEPS:
        problems.error(f"has {steps} frame; at least {MIN_STEPS} are needed")
    if not problems.all_rows(rows["frame_index"][:, 0] == np.arange(steps), "frame_index does not count from 0"):
        return
    problems.all_rows(rows["index"][:, 0] == before + np.arange(steps), "index does not count the dataset's frames")
    expected = np.arange(steps) / reader.info["fps"]
    problems.all_rows(
        np.abs(rows["timestamp"][:, 0] - expected) < TIME_TOLERANCE_s, "timestamp is not frame_index / fps"
    )
    for name, values in rows.items():
        if values.dtype.kind == "f":
            report.checks["finite"] += 1
            if not problems.all_rows(np.isfinite(values).all(axis=1), f"{name} is not finite"):
                return
    try:
        limits = limits_of({"config": reader.facts.get("env")})
    except InputError as error:
        problems.error(f"its dataset's env: {error}")
        return
    _check_ranges(rows, problems, limits)
    _check_times(rows, problems)
    if schema.DONE in rows:
        problems.all_rows(
            rows[schema.DONE][:, 0] == (np.arange(steps) == steps - 1), "next.done is not true on the last frame alone"
        )
    if episode.about and episode.about["length"] != steps:
        problems.error(f"has {steps} frames, its provenance says {episode.about['length']}")
    _check_duplicate(episode, problems, seen)
    _check_dynamics(reader, episode, problems)


def _check_ranges(rows: dict[str, np.ndarray], problems: Problems, limits: np.ndarray) -> None:
    values = rows.get(schema.TRUE_STATE, rows[schema.STATE])
    state = dict(zip(schema.observed_names(values.shape[1]), values.T.astype(np.float64), strict=True))
    problems.report.checks["ranges"] += 1

    def norm(names: tuple[str, ...]) -> np.ndarray:
        return np.linalg.norm([state[name] for name in names], axis=0)

    if "x" in state:
        error = np.abs(norm(STATE_NAMES[QUATERNION]) - 1.0)
        problems.all_rows(error < MAX_QUATERNION_ERROR, "the quaternion is not of unit length")
        problems.all_rows(norm(STATE_NAMES[POSITION]) < MAX_POSITION_m, f"farther than {MAX_POSITION_m:g} m")
    problems.all_rows(norm(STATE_NAMES[VELOCITY]) < MAX_SPEED_m_s, f"faster than {MAX_SPEED_m_s:g} m/s")
    rates = np.abs([state[name] for name in STATE_NAMES[RATE]]).max(axis=0)
    problems.all_rows(rates < MAX_RATE_deg_s, f"turns faster than {MAX_RATE_deg_s:g} deg/s")
    if "mass" in state:
        mass = state["mass"]
        problems.all_rows(mass > 0.0, "the mass is not positive")
        problems.all_rows(np.diff(mass, prepend=mass[0]) <= 0.0, "the mass grows")
    for name in (schema.ACTION, schema.EXECUTED_ACTION):
        if name in rows:
            problems.all_rows(
                (np.abs(rows[name]) <= 1.001 * limits).all(axis=1),
                f"{name} is beyond the chaser's limits",
                warning=True,
            )


def _check_times(rows: dict[str, np.ndarray], problems: Problems) -> None:
    if schema.CONTROL_DT not in rows or schema.SIM_TIME not in rows:
        return
    problems.report.checks["times"] += 1
    dt, time = rows[schema.CONTROL_DT][:, 0].astype(np.float64), rows[schema.SIM_TIME][:, 0].astype(np.float64)
    problems.all_rows(dt > 0.0, "control_dt is not positive")
    gap = np.abs(np.diff(time) - dt[:-1])
    problems.all_rows(np.append(gap < TIME_TOLERANCE_s, True), "sim_time does not advance by control_dt")


def _check_duplicate(episode: Episode, problems: Problems, seen: dict[str, int]) -> None:
    problems.report.checks["duplicates"] += 1
    if episode.about.get("repeat"):
        return
    digest = hashlib.sha256(episode.rows[schema.STATE].tobytes() + episode.rows[schema.ACTION].tobytes()).hexdigest()
    if digest in seen:
        problems.error(f"is the same as episode {seen[digest]}")
    seen.setdefault(digest, episode.index)


def _check_dynamics(reader: DatasetReader, episode: Episode, problems: Problems) -> None:
    rows = episode.rows
    if schema.CONTROL_DT not in rows or schema.SIM_TIME not in rows or not reader.has_pose:
        return
    log = episode.log()
    if log.num_steps < 1:
        return
    env = log.metadata.get("config") or reader.facts.get("env") or {}
    varied = isinstance(env, dict) and env.get("dynamics") == "meta"  # or, where nothing says, as the sensors show
    if "dynamics" not in log.metadata and (varied or any(name.startswith(OBSERVED) for name in log.extra)):
        problems.note_once(f"the chaser {NO_CHASER}.")
        return
    unsure = "times" in log.metadata
    if unsure:
        problems.note_once(f"times are {log.metadata['times']}: states that do not follow from commands only warn.")
    widen = {}
    if assumed := log.metadata.get("mass"):
        problems.note_once(f"the mass is {assumed}: it is not checked, and speeds {UNKNOWN_MASS:g} times less closely.")
        log = replace(log, state=np.where(np.arange(STATE_DIM) == MASS, np.nan, log.state))  # integrated instead
        widen = {"velocity_m_s": UNKNOWN_MASS}
    problems.report.checks["dynamics"] += 1
    coupling = env["hill_coupling"] if "hill_coupling" in env else best_coupling(log)
    for name, values in residuals(log, hill_coupling=bool(coupling)).items():
        known = "mass" not in log.metadata and rows.get(schema.TRUE_STATE, rows[schema.STATE]).shape[1] == STATE_DIM
        if name == "mass_kg" and not known:
            continue
        problems.report.worst[name] = max(problems.report.worst.get(name, 0.0), float(values.max()))
        good = values <= TOLERANCES[name] * widen.get(name, 1.0)
        ok = np.append(good, np.ones(len(rows["index"]) - len(values), dtype=bool))
        if not unsure:
            problems.all_rows(ok, f"the next state does not follow from the command: {name} off by {values.max():.3g}")
        elif not ok.all():
            problems.report.unsure[name] += 1
