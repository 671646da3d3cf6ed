"""The scene as the rasteriser wants it: triangles at one port, culling clusters, shading table.

Scenes are shared: every renderer in the process that asks for the same station and port gets the same one.
"""

from __future__ import annotations

import functools
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lerobot_spacedock.jit import jit
from lerobot_spacedock.station import MATERIALS, StationMesh
from lerobot_spacedock.station.cache import cached_arrays

from .kernels_raster import CLUSTER_TRIANGLES
from .kernels_resolve import (
    M_BASE,
    M_BUMP,
    M_PATTERN,
    M_SCALE,
    M_SECOND,
    M_TINT,
    MATERIAL_SIZE,
    PATTERN_TEXELS,
    SURFACE_SIZE,
    T_AO,
    T_BOTH,
    T_KIND,
    T_N,
    T_PLANE,
    T_U,
    T_V,
)
from .openness import corner_openness
from .shadow_maps import ShadowMaps, draw_shadow_maps
from .surfaces import corner_numbers, cross, dot, find_surfaces, fit

REGION_TRIANGLES = 768  # neighbours, sorted by the way they face and then cut into clusters
PART_WIDTHS_m = (0.02, 0.04, 0.08, 0.16)  # parts of like width make clusters together
MAX_SUNS = 4
# what the cached arrays depend on
_ROOM = Path(__file__).parent
SOURCES = tuple(str(path) for path in sorted([*_ROOM.glob("*.py"), *(_ROOM.parent / "station").glob("*.py")]))


@dataclass
class Scene:
    """Arrays of one station at one port. See ``kernels_raster`` and ``kernels_resolve`` for their layouts."""

    corners: np.ndarray
    faces: np.ndarray
    surface: np.ndarray
    segment: np.ndarray
    table: np.ndarray
    clusters: np.ndarray
    spheres: np.ndarray
    cones: np.ndarray
    materials: np.ndarray
    load_mesh: Callable[[], StationMesh]  # what it was made from
    kept_suns: dict[bytes, str] = field(default_factory=dict)  # directions whose shadow maps stay in the user's cache
    lock: threading.Lock = field(default_factory=threading.Lock)
    shadows: OrderedDict = field(default_factory=OrderedDict)

    def shadow_maps(self, sun: np.ndarray) -> ShadowMaps:
        """The maps for a direction to the Sun, drawn on first use; the last few directions are kept."""
        key = sun_key(sun)
        with self.lock:
            if key not in self.shadows:
                self.shadows[key] = self._maps(sun, self.kept_suns.get(key))
                while len(self.shadows) > MAX_SUNS:
                    self.shadows.popitem(last=False)
            self.shadows.move_to_end(key)
            return self.shadows[key]

    def _maps(self, sun: np.ndarray, name: str | None) -> ShadowMaps:
        if name is None:
            return ShadowMaps(**self._draw_maps(sun))
        return ShadowMaps(**cached_arrays(name, SOURCES, lambda: self._draw_maps(sun)))

    def _draw_maps(self, sun: np.ndarray) -> dict[str, np.ndarray]:
        return draw_shadow_maps(np.ascontiguousarray(self.corners.T), sun)


def sun_key(sun: np.ndarray) -> bytes:
    """Directions that are equal in single precision are one."""
    return np.asarray(sun, np.float32).tobytes()


def make_scene(load_mesh: Callable[[], StationMesh], name: str | None = None) -> Scene:
    """The scene of a mesh.

    Args:
        load_mesh: gives the mesh; called when it is needed.
        name: under which the arrays are kept in the user's cache; without one they are made anew in each process.
    """
    made = functools.partial(scene_arrays, load_mesh)
    return Scene(**(made() if name is None else cached_arrays(name, SOURCES, made)), load_mesh=load_mesh)


def scene_arrays(load_mesh: Callable[[], StationMesh]) -> dict[str, np.ndarray]:
    """Sorts a mesh into clusters and works out its shading table: the arrays of ``Scene``."""
    mesh = load_mesh()
    corners = np.asarray(mesh.corners, np.float64)
    width = part_widths(corners)
    order, starts = _cluster_order(corners, np.asarray(mesh.two_sided), width)
    corners, width = corners[order], width[order]
    material, two_sided = np.asarray(mesh.material)[order], np.asarray(mesh.two_sided)[order]
    across = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = across / np.maximum(np.sqrt(dot(across, across)), 1e-20)[:, None]
    plane = np.concatenate([normal, dot(normal, corners[:, 0])[:, None]], -1)
    materials = _material_table()
    textured = materials[material, M_SCALE] > 0.0
    uvs = np.asarray(mesh.uvs, np.float64)[order] * textured[:, None, None]
    openness = corner_openness(mesh)[order]
    values = np.concatenate([np.asarray(mesh.normals, np.float64)[order], uvs, openness[..., None]], -1)
    segment = np.asarray(mesh.segment)[order]
    kind = (material.astype(np.int64) * 256 + segment) * 2 + two_sided
    seeds, surface = np.unique(find_surfaces(corners, values, plane, kind), return_inverse=True)
    plane = plane[seeds]
    faces = np.concatenate([plane[surface], two_sided[:, None]], -1).astype(np.float32)
    functions = fit(surface, corners, values, plane[:, :3])
    table = np.zeros((len(seeds), SURFACE_SIZE), np.float32)
    table[:, T_N : T_N + 3] = functions[:, :3, 0]  # the normal's constants come first, then its gradients row by row
    table[:, T_N + 3 : T_N + 12] = functions[:, :3, 1:].reshape(-1, 9)
    table[:, T_U : T_U + 4], table[:, T_V : T_V + 4] = functions[:, 3], functions[:, 4]
    table[:, T_AO : T_AO + 4] = functions[:, 5]
    table[:, T_KIND], table[:, T_BOTH] = material[seeds], two_sided[seeds]
    table[:, T_PLANE : T_PLANE + 3] = plane[:, :3]
    clusters = np.stack([starts, np.append(starts[1:], len(corners))], -1).astype(np.int32)
    spheres, cones = _bounds(corners, normal, two_sided, width, clusters)
    return {
        "corners": np.ascontiguousarray(corners.reshape(-1, 9).T, np.float32),
        "faces": np.ascontiguousarray(faces.T),
        "surface": surface.astype(np.int32),
        "segment": np.ascontiguousarray(segment[seeds], np.uint8),
        "table": table,
        "clusters": clusters,
        "spheres": spheres,
        "cones": cones,
        "materials": materials,
    }


def part_widths(corners: np.ndarray) -> np.ndarray:
    """How wide the part that each triangle belongs to looks on average, m, (F,); a part is what shares corners.

    A convex body's mean silhouette is a quarter of its surface; here it is divided by the longest side of its box.
    """
    number = corner_numbers(corners)
    points, part = int(number.max()) + 1, np.empty(len(number), np.int64)
    count = _parts(number, np.arange(points), np.full(points, -1), part)
    across = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.bincount(part, np.sqrt(dot(across, across)), count)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, corners.min(1))
    np.maximum.at(high, part, corners.max(1))
    extent = np.sqrt(dot(high - low, high - low))
    return np.round(0.25 * area / np.maximum(extent, 1e-9), 4)[part]


@jit
def _parts(number, root, names, part):
    """Fill ``part`` (F,) with the part of each triangle: those that share a corner, directly or through others.

    → their number. ``root`` comes as 0, 1, 2 … and ``names`` as -1 for each corner: to make them here would take longer
    to compile than all the rest.
    """
    for f in range(len(number)):
        a = number[f, 0]
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        for c in range(1, 3):
            b = number[f, c]
            while root[b] != b:
                root[b] = root[root[b]]
                b = root[b]
            if b < a:
                a, b = b, a
            root[b] = a
    parts = 0
    for f in range(len(number)):
        a = number[f, 0]
        while root[a] != a:
            a = root[a]
        if names[a] < 0:
            names[a] = parts
            parts += 1
        part[f] = names[a]
    return parts


def _material_table() -> np.ndarray:
    """(M, 16) float32, columns named by M_BASE and the like; the second colour as its difference from the first."""
    table = np.zeros((len(MATERIALS), MATERIAL_SIZE), np.float32)
    rows = np.array([m.row() for m in MATERIALS], np.float32)
    table[:, : rows.shape[1]] = rows
    table[:, M_SECOND : M_SECOND + 3] -= table[:, M_BASE : M_BASE + 3]
    table[:, M_PATTERN] *= PATTERN_TEXELS
    table[table[:, M_SCALE] <= 0.0, M_TINT] = 0.0
    table[table[:, M_SCALE] <= 0.0, M_BUMP] = 0.0
    return table


def _cluster_order(corners: np.ndarray, two_sided: np.ndarray, width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Order of the triangles (F,), so that neighbours that face one way stand together, and the clusters' starts."""
    order = _morton_order(corners.mean(axis=1))
    order = order[np.argsort(np.searchsorted(PART_WIDTHS_m, width[order]), kind="stable")]
    across = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[order]
    axis = np.abs(across).argmax(axis=1)
    side = 2 * axis + (np.take_along_axis(across, axis[:, None], 1)[:, 0] > 0.0)
    side = np.where(two_sided[order], 6, side)
    size = np.searchsorted(PART_WIDTHS_m, width[order])
    region = np.arange(len(order)) // REGION_TRIANGLES + 100000 * size
    group = 7 * region + side
    by_group = np.argsort(group, kind="stable")
    order, group = order[by_group], group[by_group]
    first = np.flatnonzero(np.diff(group, prepend=-1))  # of each group
    within = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    return order, np.flatnonzero(within % CLUSTER_TRIANGLES == 0)


def _bounds(corners, normal, two_sided, width, clusters) -> tuple[np.ndarray, np.ndarray]:
    """For each cluster a sphere and a cone.

    Returns:
        (K, 5) centre, radius and width of the widest part in m; (K, 4) axis of a cone that holds its normals and the
        sine of its half angle, 2 where there is none.
    """
    spheres = np.empty((len(clusters), 5), np.float32)
    cones = np.tile(np.float32([0.0, 0.0, 0.0, 2.0]), (len(clusters), 1))  # no axis: never turned away
    for k, (a, b) in enumerate(clusters):
        points = corners[a:b].reshape(-1, 3)
        centre = 0.5 * (points.min(0) + points.max(0))
        spheres[k, :3] = centre
        spheres[k, 3] = 1e-4 + 1.0001 * np.sqrt(dot(points - centre, points - centre).max())
        spheres[k, 4] = width[a:b].max()
        axis = normal[a:b].sum(0)
        length = np.sqrt(dot(axis, axis))
        if length < 1e-6 or two_sided[a:b].any():
            continue
        axis = axis / length
        cos = dot(normal[a:b], axis).min()
        if cos > 0.02:
            cones[k] = *axis, np.sqrt(max(0.0, 1.0 - cos * cos)) + 1e-4
    return spheres, cones


def _morton_order(points: np.ndarray) -> np.ndarray:
    """Order along a space-filling curve, so that neighbours share clusters and cache lines."""
    low, high = points.min(0), points.max(0)
    cell = ((points - low) / np.maximum(high - low, 1e-9) * 1023.0).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")
