"""The scene as the rasteriser wants it: triangles at one port, culling clusters, shading table, shadow maps.

Scenes are shared: every renderer in the process that asks for the same station and port gets the same one.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np

from lerobot_spacedock.station import MATERIALS, StationMesh

from .kernels_resolve import TRIANGLE_SIZE
from .openness import corner_openness

REGION_TRIANGLES = 768  # neighbours, sorted by the way they face
CLUSTER_TRIANGLES = 64  # culled as one, within a region and facing one way
SHADOW_LAYOUT = ((1.15, 1536), (7.0, 1536), (0.0, 2048))  # half width about the port m (0: all of it), texels a side
MAX_SUNS = 4


@dataclass
class Scene:
    """Arrays of one station at one port. See ``kernels_raster`` and ``kernels_shade`` for their layouts."""

    mesh: StationMesh
    corners: np.ndarray
    faces: np.ndarray
    segment: np.ndarray
    table: np.ndarray
    clusters: np.ndarray
    spheres: np.ndarray
    cones: np.ndarray
    materials: np.ndarray
    lock: threading.Lock = field(default_factory=threading.Lock)
    shadows: OrderedDict = field(default_factory=OrderedDict)

    def shadow_maps(self, sun: np.ndarray) -> ShadowMaps:
        """The maps for a direction to the Sun, drawn on first use; the last few directions are kept."""
        key = sun.astype(np.float32).tobytes()
        with self.lock:
            if key not in self.shadows:
                self.shadows[key] = draw_shadow_maps(self, sun)
                while len(self.shadows) > MAX_SUNS:
                    self.shadows.popitem(last=False)
            self.shadows.move_to_end(key)
            return self.shadows[key]


@dataclass(frozen=True)
class ShadowMaps:
    """All cascades in one flat array, the tightest first."""

    maps: np.ndarray
    start: np.ndarray
    size: np.ndarray
    reach: np.ndarray  # m², squared distance from the port up to which each tight map is good
    affine: (
        np.ndarray
    )  # (cascades, 13): u, v, height as affine functions of position, and the push along the normal in m


def build_scene(mesh: StationMesh) -> Scene:
    """Sort a mesh into clusters and work out its shading table."""
    corners = np.asarray(mesh.corners, np.float64)
    order, starts = _cluster_order(corners, np.asarray(mesh.two_sided))
    corners = corners[order]
    normals = np.asarray(mesh.normals, np.float64)[order]
    uvs = np.asarray(mesh.uvs, np.float64)[order]
    openness = corner_openness(mesh)[order]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = _cross(e1, e2)
    length = np.sqrt(_dot(cross, cross))
    normal = cross / np.maximum(length, 1e-20)[:, None]
    faces = np.empty((len(corners), 5), np.float32)
    faces[:, :3] = normal
    faces[:, 3] = _dot(normal, corners[:, 0])
    faces[:, 4] = np.asarray(mesh.two_sided)[order]
    table = np.zeros((len(corners), TRIANGLE_SIZE), np.float32)
    for place, values in ((0, normals), (12, uvs), (20, openness[..., None])):
        table[:, place : place + 4 * values.shape[2]] = _affine(corners, e1, e2, values)
    # the normal's constants come first, then its gradients row by row
    block = table[:, :12].copy()
    table[:, 0:3] = block[:, 0::4]
    for row in range(3):
        table[:, 3 + 3 * row : 6 + 3 * row] = block[:, 4 * row + 1 : 4 * row + 4]
    table[:, 24] = mesh.material[order]
    table[:, 25] = np.asarray(mesh.two_sided)[order]
    clusters = np.stack([starts, np.append(starts[1:], len(corners))], -1).astype(np.int32)
    spheres, cones = _bounds(corners, normal, faces[:, 4] > 0.0, clusters)
    return Scene(
        mesh=mesh,
        corners=np.ascontiguousarray(corners.reshape(-1, 9), np.float32),
        faces=faces,
        segment=np.ascontiguousarray(mesh.segment[order], np.uint8),
        table=table,
        clusters=clusters,
        spheres=spheres,
        cones=cones,
        materials=np.array([m.row() for m in MATERIALS], np.float32),
    )


def draw_shadow_maps(scene: Scene, sun: np.ndarray) -> ShadowMaps:
    """Draw every cascade for a unit direction to the Sun."""
    from .kernels_shadow import draw_depth

    helper = np.array([0.0, 0.0, 1.0]) if abs(sun[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = _cross(helper, sun)
    u = u / np.sqrt(_dot(u, u))
    v = _cross(sun, u)
    basis = np.stack([u, v, sun])
    points = scene.corners.reshape(-1, 3).astype(np.float64)
    start = np.zeros(len(SHADOW_LAYOUT), np.int64)
    size = np.array([s for _, s in SHADOW_LAYOUT], np.int64)
    start[1:] = np.cumsum(size * size)[:-1]
    maps = np.empty(int((size * size).sum()), np.float32)
    affine = np.zeros((len(SHADOW_LAYOUT), 13), np.float32)
    for c, (half, texels) in enumerate(SHADOW_LAYOUT):
        if half > 0.0:
            low_u = low_v = -half
            width = 2.0 * half
        else:
            pu, pv = _dot(points, u), _dot(points, v)
            low_u, low_v = pu.min(), pv.min()
            width = max(pu.max() - low_u, pv.max() - low_v) * 1.01
            low_u, low_v = low_u - 0.005 * width, low_v - 0.005 * width
        per_m = texels / width
        draw_depth(scene.corners, basis, low_u, low_v, per_m, texels, maps[start[c] : start[c] + texels * texels])
        # bilinear taps sit half a texel in; the push hides the staircase of the map on slanted faces
        affine[c, 0:3], affine[c, 3] = u * per_m, -low_u * per_m - 0.5
        affine[c, 4:7], affine[c, 7] = v * per_m, -low_v * per_m - 0.5
        affine[c, 8:11], affine[c, 11] = sun, 0.35 / per_m + 2e-4
        affine[c, 12] = 1.6 / per_m
    # a sphere about the port lies within its map from every direction; the push needs a little room
    reach = np.array([(0.97 * half) ** 2 for half, _ in SHADOW_LAYOUT[:-1]], np.float32)
    return ShadowMaps(maps, start, size, reach, affine)


def _affine(corners, e1, e2, values) -> np.ndarray:
    """Values at corners (F, 3, C) → per channel constant and gradient over position, (F, 4 C).

    The gradient lies in the triangle's plane. Written out, so that no BLAS of another CPU can change a bit.
    """
    d11, d12, d22 = _dot(e1, e1), _dot(e1, e2), _dot(e2, e2)
    det = np.maximum(d11 * d22 - d12 * d12, 1e-24)
    g1 = (d22[:, None] * e1 - d12[:, None] * e2) / det[:, None]
    g2 = (d11[:, None] * e2 - d12[:, None] * e1) / det[:, None]
    out = np.empty((len(corners), 4 * values.shape[2]))
    for c in range(values.shape[2]):
        v0 = values[:, 0, c]
        grad = (values[:, 1, c] - v0)[:, None] * g1 + (values[:, 2, c] - v0)[:, None] * g2
        out[:, 4 * c] = v0 - _dot(grad, corners[:, 0])
        out[:, 4 * c + 1 : 4 * c + 4] = grad
    return out


def _dot(a, b) -> np.ndarray:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _cross(a, b) -> np.ndarray:
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        -1,
    )


def _cluster_order(corners: np.ndarray, two_sided: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Order of the triangles (F,), so that neighbours that face one way stand together, and the clusters' starts."""
    order = _morton_order(corners.mean(axis=1))
    cross = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[order]
    axis = np.abs(cross).argmax(axis=1)
    side = 2 * axis + (np.take_along_axis(cross, axis[:, None], 1)[:, 0] > 0.0)
    side = np.where(two_sided[order], 6, side)
    region = np.arange(len(order)) // REGION_TRIANGLES
    group = 7 * region + side
    by_group = np.argsort(group, kind="stable")
    order, group = order[by_group], group[by_group]
    first = np.flatnonzero(np.diff(group, prepend=-1))  # of each group
    within = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    return order, np.flatnonzero(within % CLUSTER_TRIANGLES == 0)


def _bounds(corners, normal, two_sided, clusters) -> tuple[np.ndarray, np.ndarray]:
    """For each cluster a sphere (centre, radius in m) and a cone that holds its normals (axis, sine; 2 where none)."""
    spheres = np.empty((len(clusters), 4), np.float32)
    cones = np.tile(np.float32([0.0, 0.0, 0.0, 2.0]), (len(clusters), 1))  # no axis: never turned away
    for k, (a, b) in enumerate(clusters):
        points = corners[a:b].reshape(-1, 3)
        centre = 0.5 * (points.min(0) + points.max(0))
        spheres[k, :3] = centre
        spheres[k, 3] = 1e-4 + 1.0001 * np.sqrt(_dot(points - centre, points - centre).max())
        axis = normal[a:b].sum(0)
        length = np.sqrt(_dot(axis, axis))
        if length < 1e-6 or two_sided[a:b].any():
            continue
        axis = axis / length
        cos = _dot(normal[a:b], axis).min()
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
