"""An episode in Rerun: station, chaser, camera, path, wrench, and plots, on one timeline."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import MissingDependencyError
from lerobot_spacedock.metrics.crossing import range_rate
from lerobot_spacedock.metrics.episode import hill_coupled, limits_of, port_of
from lerobot_spacedock.physics import rotations
from lerobot_spacedock.physics.contact import BOXES, IDSS, box_conditions, contact_state
from lerobot_spacedock.physics.frames import (
    ACTION_NAMES,
    MASS,
    POSITION,
    QUATERNION,
    VELOCITY,
    state_from_dataset_units,
)

TIMELINE = "flight_time"
CHASER_EDGE_m = 2.0
ARROW_m = 4.0  # length of a command at its limit
PATH_COLOUR, THRUST_COLOUR, TORQUE_COLOUR = (0, 114, 178), (213, 94, 0), (0, 158, 115)
AXIS_COLOURS = ((86, 180, 233), (213, 94, 0), (0, 158, 115))
CONTACT_PLOTS = {
    "closing_speed_m_s": "closing rate (m/s)",
    "lateral_m": "lateral miss (m)",
    "lateral_speed_m_s": "lateral rate (m/s)",
    "pitch_yaw_deg": "pitch/yaw (deg)",
    "roll_deg": "roll (deg)",
    "pitch_yaw_rate_deg_s": "pitch/yaw rate (deg/s)",
    "roll_rate_deg_s": "roll rate (deg/s)",
}


def import_rerun():
    """Rerun's SDK.

    Raises:
        MissingDependencyError: it is not installed.
    """
    try:
        import rerun
    except ImportError as error:
        message = "spacedock view needs the Rerun SDK: pip install '.[viz]' in SpaceDock's folder."
        raise MissingDependencyError(message) from error
    return rerun


def show_episode(
    log: EpisodeLog,
    frames: Iterable[np.ndarray],
    *,
    vfov_deg: float,
    save: Path | None,
    name: str,
    detail: str = "low",
) -> None:
    """Sends an episode to a viewer window, or to a file.

    Args:
        log: the episode.
        frames: pictures of its first states, in order; may be fewer than there are states, or none.
        vfov_deg: vertical field of view of those pictures, degrees.
        save: ``.rrd`` file; ``None`` opens a window.
        name: of the recording.
        detail: of the station's model.
    """
    rr = import_rerun()
    recording = rr.RecordingStream("spacedock", recording_id=None)
    if save is None:
        recording.spawn(default_blueprint=_blueprint())
    else:
        save.parent.mkdir(parents=True, exist_ok=True)
        recording.save(str(save), default_blueprint=_blueprint())
    state = state_from_dataset_units(log.state)
    _log_scene(rr, recording, log, state, name, detail)
    _log_motion(rr, recording, log, state)
    _log_plots(rr, recording, log, state)
    _log_frames(rr, recording, log, frames, vfov_deg)
    recording.flush()
    if save is not None:
        recording.disconnect()


def contact_series(log: EpisodeLog, state: np.ndarray) -> dict[str, np.ndarray]:
    """What is plotted of the contact box over an episode: ``contact_state``'s numbers, roll without its sign."""
    contact = contact_state(state, port_of(log.metadata), hill_coupling=hill_coupled(log.metadata))
    return {key: np.abs(contact[key]) if "roll" in key else contact[key] for key in CONTACT_PLOTS}


def _blueprint():
    import rerun.blueprint as rrb

    plots = [
        rrb.TimeSeriesView(origin="plots/range", name="Range (m)"),
        rrb.TimeSeriesView(origin="plots/closing_speed_m_s", name="Closing rate (m/s) and its limits"),
        rrb.TimeSeriesView(origin="plots/lateral_m", name="Lateral miss (m) and its limit"),
        rrb.TimeSeriesView(origin="plots/attitude", name="Attitude error (deg) and its limit"),
        rrb.TimeSeriesView(origin="plots/rates", name="Angular rates (deg/s) and their limit"),
        rrb.TimeSeriesView(origin="plots/thrust", name="Thrust, body axes (N)"),
        rrb.TimeSeriesView(origin="plots/torque", name="Torque, body axes (N m)"),
        rrb.TimeSeriesView(origin="plots/box", name="Inside the box: IDSS, ATV"),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(origin="world", name="Scene, Hill axes (m)"),
                rrb.Horizontal(
                    rrb.Spatial2DView(origin="world/chaser/camera", name="Camera"),
                    rrb.TextDocumentView(origin="episode", name="Episode"),
                    column_shares=[2, 1],
                ),
                row_shares=[3, 2],
            ),
            rrb.Grid(*plots, grid_columns=2),
            column_shares=[1, 1],
        ),
        collapse_panels=True,
    )


def _log_scene(rr, recording, log: EpisodeLog, state: np.ndarray, name: str, detail: str) -> None:
    port = port_of(log.metadata)
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_X_UP, static=True)
    vertices, normals, colours = station_vertices(port.name, detail)
    mesh = rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, vertex_colors=colours)
    recording.log("world/station", mesh, static=True)
    axes = rr.Arrows3D(vectors=np.eye(3) * 3.0, colors=[(213, 94, 0), (0, 158, 115), (0, 114, 178)], labels=list("xyz"))
    recording.log("world/port_axes", axes, static=True)
    body = rr.Boxes3D(
        centers=[[0.0, 0.0, -0.5 * CHASER_EDGE_m]], half_sizes=[[0.5 * CHASER_EDGE_m] * 3], colors=[(200, 205, 215)]
    )
    recording.log("world/chaser/body", body, static=True)
    path = rr.LineStrips3D([state[:, POSITION]], colors=[PATH_COLOUR], radii=[0.03])
    recording.log("world/path", path, static=True)
    ring = np.linspace(0.0, 2 * np.pi, 49)
    circle = IDSS.lateral_m * np.stack([np.cos(ring), 0 * ring, np.sin(ring)], axis=1)
    recording.log("world/capture_limit", rr.LineStrips3D([circle], colors=[(227, 179, 65)]), static=True)
    recording.log("episode", rr.TextDocument(_summary(log, name), media_type="text/markdown"), static=True)


def station_vertices(port: str, detail: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The station's corners (V, 3) m, normals (V, 3) and sRGB colours (V, 3) uint8, in Hill axes."""
    from lerobot_spacedock.station import MATERIALS, station_for_port
    from lerobot_spacedock.station.materials import srgb_bytes

    mesh = station_for_port(port, detail)
    colours = srgb_bytes(np.array([material.base for material in MATERIALS]))
    colours = np.repeat(colours[mesh.material], 3, axis=0)
    return mesh.corners.reshape(-1, 3), mesh.normals.reshape(-1, 3), colours


def _times(rr, time: np.ndarray):
    return [rr.TimeColumn(TIMELINE, duration=time)]


def _log_motion(rr, recording, log: EpisodeLog, state: np.ndarray) -> None:
    xyzw = state[:, QUATERNION][:, [1, 2, 3, 0]]
    pose = rr.Transform3D.columns(translation=state[:, POSITION], quaternion=xyzw)
    recording.send_columns("world/chaser", _times(rr, log.time), pose)
    limits = limits_of(log.metadata)
    thrust = rotations.rotate(state[:-1, QUATERNION], log.action[:, :3] / limits[:3] * ARROW_m)
    torque = rotations.rotate(state[:-1, QUATERNION], log.action[:, 3:] / limits[3:] * ARROW_m)
    for name, vectors, colour in (("thrust", thrust, THRUST_COLOUR), ("torque", torque, TORQUE_COLOUR)):
        recording.log(f"world/{name}", rr.Arrows3D.from_fields(colors=[colour]), static=True)
        columns = rr.Arrows3D.columns(vectors=vectors, origins=state[:-1, POSITION])
        recording.send_columns(f"world/{name}", _times(rr, log.time[:-1]), columns)


def _log_plots(rr, recording, log: EpisodeLog, state: np.ndarray) -> None:
    def series(path: str, time: np.ndarray, values: np.ndarray, name: str, colour: tuple | None = None) -> None:
        style = rr.SeriesLines(names=name, colors=[colour] if colour else None)
        recording.log(path, style, static=True)
        keep = np.isfinite(values)
        recording.send_columns(path, _times(rr, time[keep]), rr.Scalars.columns(scalars=values[keep]))

    distance, _ = range_rate(state[:, POSITION], state[:, VELOCITY])
    series("plots/range/range", log.time, distance, "range")
    series("plots/mass", log.time, state[:, MASS], "mass (kg)")
    contact = contact_series(log, state)
    ends = log.time[[0, -1]]
    least, most = IDSS.closing_speed_m_s
    groups = {"pitch_yaw_deg": "attitude", "roll_deg": "attitude"}
    groups |= {"pitch_yaw_rate_deg_s": "rates", "roll_rate_deg_s": "rates"}
    for key, label in CONTACT_PLOTS.items():
        group = groups.get(key, key)
        colour = AXIS_COLOURS[1] if "roll" in key else AXIS_COLOURS[0]
        series(f"plots/{group}/{key}", log.time, contact[key], label, colour)
        limits = (least, most) if key == "closing_speed_m_s" else (getattr(IDSS, key),)
        for i, limit in enumerate(limits):
            series(f"plots/{group}/limit_{i}", ends, np.full(2, limit), "IDSS limit", (227, 179, 65))
    for i, name in enumerate(ACTION_NAMES):
        group = "thrust" if i < 3 else "torque"
        series(f"plots/{group}/{name}", log.time[:-1], log.action[:, i], name, AXIS_COLOURS[i % 3])
    for label, box in BOXES.items():
        inside = np.logical_and.reduce(list(box_conditions(contact, box).values()))
        series(f"plots/box/{label}", log.time, inside.astype(float), label.upper(), AXIS_COLOURS[label == "atv"])


def _log_frames(rr, recording, log: EpisodeLog, frames: Iterable[np.ndarray], vfov_deg: float) -> None:
    first = True
    for time, frame in zip(log.time, frames, strict=False):
        if first:
            height, width = frame.shape[:2]
            focal = float(0.5 * height / np.tan(0.5 * np.radians(vfov_deg)))
            pinhole = rr.Pinhole(focal_length=focal, width=width, height=height, image_plane_distance=2.0)
            # camera axes (right, down, forward) from body axes (+y, -x, +z)
            turn = rr.Transform3D(mat3x3=np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
            recording.log("world/chaser/camera", turn, pinhole, static=True)
            first = False
        recording.set_time(TIMELINE, duration=float(time))
        recording.log("world/chaser/camera", rr.Image(frame).compress(jpeg_quality=90))
    recording.reset_time()


def _summary(log: EpisodeLog, name: str) -> str:
    keys = ("label", "env_id", "seed", "initial_conditions", "outcome", "success")
    lines = [f"- {key.replace('_', ' ')}: {log.metadata[key]}" for key in keys if log.metadata.get(key) is not None]
    ending = f"- {log.num_steps} steps, {log.time[-1] - log.time[0]:.1f} s"
    return "\n".join([f"### {name}", *lines, ending, "- arrows: thrust orange, torque green; full length at the limit"])
