"""The station as one soup of triangles, in Hill axes at a docking port, or a user's own mesh in its place."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lerobot_spacedock.errors import FileFormatError, InputError, reading

from .builder import SEGMENT_INDEX, SEGMENTS
from .cache import cached_arrays
from .materials import MATERIAL_INDEX

# station axes: -y forward, +z zenith, +x port; origin near Unity (measured port coordinates, m)
PORT_ORIGIN_S = {"zvezda_aft": (0.23, 32.55, -1.87), "harmony_forward": (0.19, -20.84, -3.34)}
GRID_m = 1e-5  # vertices are rounded to this, so that every machine gets the same
HILL_FROM_STATION = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])

__all__ = [
    "HILL_FROM_STATION",
    "PORT_ORIGIN_S",
    "SEGMENTS",
    "GRID_m",
    "StationMesh",
    "load_station",
    "station_for_port",
]


@dataclass(frozen=True)
class StationMesh:
    """Triangles in Hill axes, origin at the docking port.

    Args:
        corners: m, (F, 3, 3) float64, counter-clockwise from outside.
        normals: unit, (F, 3, 3) float64, at the corners.
        uvs: m, (F, 3, 2) float64.
        material: (F,) uint8, index into MATERIALS.
        segment: (F,) uint8, index into SEGMENTS.
        two_sided: (F,) bool.
    """

    corners: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray
    material: np.ndarray
    segment: np.ndarray
    two_sided: np.ndarray

    def __len__(self) -> int:
        return len(self.corners)


def station_for_port(port: str, detail: str) -> StationMesh:
    """The built-in station with ``port`` at the origin, at level of detail ``low`` or ``high``."""
    folder = Path(__file__).parent
    sources = tuple(str(p) for p in sorted(folder.glob("*.py")))
    stored = cached_arrays(f"station-{port}-{detail}", sources, lambda: _build(detail, port))
    corners = (stored["corners"].astype(np.float64) - PORT_ORIGIN_S[port]) @ HILL_FROM_STATION.T
    return StationMesh(
        corners=np.round(corners / GRID_m) * GRID_m,
        normals=np.round(stored["normals"].astype(np.float64), 5) @ HILL_FROM_STATION.T,
        uvs=stored["uvs"].astype(np.float64),
        material=stored["material"],
        segment=stored["segment"],
        two_sided=np.zeros(len(corners), bool),
    )


def _build(detail: str, port: str) -> dict[str, np.ndarray]:
    from .assembly import assemble

    patch, material, segment = assemble(detail, port)
    corners = np.round(patch.corners / GRID_m) * GRID_m
    return {
        "corners": corners,
        "normals": np.round(patch.normals, 5).astype(np.float32),
        "uvs": np.round(patch.uvs, 5).astype(np.float32),
        "material": material,
        "segment": segment,
    }


def load_station(path: str | Path, station_pose: np.ndarray | None = None) -> StationMesh:
    """A user's mesh file, moved by ``station_pose`` (4, 4) from its own coordinates, m, into Hill axes."""
    import trimesh

    path = Path(path).expanduser()
    transform = np.eye(4) if station_pose is None else checked_transform(station_pose)
    if not path.is_file():
        raise InputError("station_mesh", str(path), "a mesh file that exists (glb, gltf, obj, stl, ply)")
    with reading(path, "a station_mesh"):
        if path.suffix.lower() == ".glb":
            _check_counts(path)
        loaded = trimesh.load(path, force="mesh", process=False)
        corners = np.asarray(loaded.triangles, np.float64)
        normals = np.asarray(loaded.vertex_normals, np.float64)[np.asarray(loaded.faces)]
    corners = corners @ transform[:3, :3].T + transform[:3, 3]
    normals = normals @ np.linalg.inv(transform[:3, :3])
    if len(corners) == 0 or not np.isfinite(corners).all():
        raise FileFormatError(f"station_mesh: {path} has {len(corners)} triangles, or corners that are not finite")
    if np.ptp(corners.reshape(-1, 3), axis=0).max() < 1e-6:
        raise FileFormatError(
            f"station_mesh: every vertex of {path} is in one place. A Draco-compressed glTF does that where DracoPy is "
            "not installed; save it uncompressed or install DracoPy"
        )
    if np.linalg.det(transform[:3, :3]) < 0:
        corners, normals = corners[:, ::-1], normals[:, ::-1]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    keep = np.linalg.norm(cross, axis=1) > 1e-12
    corners, normals, cross = corners[keep], normals[keep], cross[keep]
    if len(corners) == 0:
        raise FileFormatError(f"station_mesh: {path} has only triangles without area")
    flat = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    bad = (length[..., 0] < 1e-6) | ~np.isfinite(length[..., 0])
    normals = np.where(bad[..., None], flat[:, None], normals / np.maximum(length, 1e-6))
    f = len(corners)
    return StationMesh(
        corners=np.round(corners / GRID_m) * GRID_m,
        normals=np.round(normals, 5),
        uvs=np.zeros((f, 3, 2)),
        material=np.full(f, MATERIAL_INDEX["user"], np.uint8),
        segment=np.full(f, SEGMENT_INDEX["user"], np.uint8),
        two_sided=np.ones(f, bool),
    )


def _check_counts(path: Path) -> None:
    """Refuses a binary glTF that claims more elements than it has bytes, before trimesh makes room for them."""
    size = path.stat().st_size
    content = path.read_bytes()
    at = 12
    while at + 8 <= size:
        length = int.from_bytes(content[at : at + 4], "little")
        if at + 8 + length > size:
            raise FileFormatError(f"station_mesh: {path}: a chunk claims {length} bytes; the file has {size}")
        at += 8 + length
    header = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    for kind, name in (("accessors", "count"), ("bufferViews", "byteLength"), ("buffers", "byteLength")):
        for item in header.get(kind, ()):
            if not 0 <= item.get(name, 0) <= size:
                raise FileFormatError(f"station_mesh: {path}: {kind} claim {item[name]}; the file has {size} bytes")


def checked_transform(given: object) -> np.ndarray:
    """A (4, 4) float64 transform, or an InputError."""
    allowed = "a (4, 4) finite transform with an invertible 3 x 3 part"
    try:
        out = np.array(given, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("station_pose", given, allowed) from error
    if out.shape != (4, 4) or not np.isfinite(out).all() or abs(np.linalg.det(out[:3, :3])) < 1e-12:
        raise InputError("station_pose", given, allowed)
    return out
