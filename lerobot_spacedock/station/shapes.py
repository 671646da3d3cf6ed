"""Building blocks: patches of triangles with corner normals and texture coordinates in metres.

Every function returns a :class:`Patch` in its own local axes; axis-symmetric shapes stand on ``z``. Patches are
triangle soups (no shared indices), which suits a rasteriser that transforms only the triangles it does not cull.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Patch:
    """Triangles: corners (F, 3, 3) m, unit normals (F, 3, 3), texture coordinates (F, 3, 2) m."""

    corners: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray

    def __len__(self) -> int:
        return len(self.corners)


def join(*patches: Patch) -> Patch:
    """Several patches as one."""
    return Patch(
        np.concatenate([p.corners for p in patches]),
        np.concatenate([p.normals for p in patches]),
        np.concatenate([p.uvs for p in patches]),
    )


def place(patch: Patch, pose: np.ndarray) -> Patch:
    """A patch moved by a (4, 4) pose; mirrored poses keep outward faces outward."""
    rot = pose[:3, :3]
    corners = patch.corners @ rot.T + pose[:3, 3]
    normals = patch.normals @ np.linalg.inv(rot)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    uvs = patch.uvs
    if np.linalg.det(rot) < 0:
        corners, normals, uvs = corners[:, ::-1], normals[:, ::-1], uvs[:, ::-1]
    return Patch(corners, normals, uvs)


def pose(origin=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0), up=None) -> np.ndarray:
    """(4, 4) pose that puts local z along ``axis`` and local x as near to ``up`` as it can be."""
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    if up is None:
        up = (0.0, 0.0, 1.0) if abs(z[2]) < 0.9 else (1.0, 0.0, 0.0)
    x = np.asarray(up, float) - z * np.dot(up, z)
    x = x / np.linalg.norm(x)
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2], out[:3, 3] = x, np.cross(z, x), z, origin
    return out


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """(4, 4) translation, m."""
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def turn(angle: float, axis: int = 2) -> np.ndarray:
    """(4, 4) rotation by ``angle`` rad about local axis 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    out = np.eye(4)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def quads(p: np.ndarray, n: np.ndarray, uv: np.ndarray) -> Patch:
    """(Q, 4, 3) corners, counter-clockwise from outside, with normals and uv → two triangles each."""
    a, b = [0, 1, 2], [0, 2, 3]
    return Patch(
        np.concatenate([p[:, a], p[:, b]]), np.concatenate([n[:, a], n[:, b]]), np.concatenate([uv[:, a], uv[:, b]])
    )


def revolve(profile, sides: int, *, smooth: bool = False, start: float = 0.0, sweep: float = 2 * np.pi) -> Patch:
    """Surface of revolution about z from ``profile`` rows (radius m, height m), outward to the left of travel up.

    A profile that climbs in z at constant radius faces outward; one that descends faces the axis.

    Args:
        profile: (P, 2) radius and height, m.
        sides: facets in a full turn of ``sweep``.
        smooth: round the normals along the profile too (domes, spheres, tori).
        start: rad, where the sweep begins.
        sweep: rad.
    """
    profile = np.asarray(profile, float)
    angle = start + np.linspace(0.0, sweep, sides + 1)
    if sweep >= 2 * np.pi - 1e-9:
        angle[-1] = angle[0]
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    step = np.diff(profile, axis=0)
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-12)
    normal = np.stack([step[:, 1], -step[:, 0]], -1) / length[:, None]
    along = np.concatenate([[0.0], np.cumsum(length)])
    if smooth:
        mean = np.concatenate([normal[:1], normal[:-1] + normal[1:], normal[-1:]])
        if np.allclose(profile[0], profile[-1]):
            mean[0] = mean[-1] = normal[0] + normal[-1]
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
        low, high = mean[:-1], mean[1:]
    else:
        low = high = normal
    reference = max(profile[:, 0].max(), 1e-6)
    arc = reference * np.linspace(0.0, sweep, sides + 1)
    points, normals, uvs = [], [], []
    for k in range(len(step)):
        p = np.empty((sides, 4, 3))
        n = np.empty((sides, 4, 3))
        uv = np.empty((sides, 4, 2))
        for c, (i, row, nrm) in enumerate(((0, k, low[k]), (1, k, low[k]), (1, k + 1, high[k]), (0, k + 1, high[k]))):
            r = ring[i : sides + i]
            p[:, c, :2], p[:, c, 2] = r * profile[row, 0], profile[row, 1]
            n[:, c, :2], n[:, c, 2] = r * nrm[0], nrm[1]
            uv[:, c, 0], uv[:, c, 1] = arc[i : sides + i], along[row]
        points.append(p)
        normals.append(n)
        uvs.append(uv)
    patch = quads(np.concatenate(points), np.concatenate(normals), np.concatenate(uvs))
    return drop_degenerate(patch)


def drop_degenerate(patch: Patch) -> Patch:
    """Without triangles of (nearly) no area."""
    e1 = patch.corners[:, 1] - patch.corners[:, 0]
    e2 = patch.corners[:, 2] - patch.corners[:, 0]
    keep = np.linalg.norm(np.cross(e1, e2), axis=1) > 2e-9
    return Patch(patch.corners[keep], patch.normals[keep], patch.uvs[keep])


def cylinder(radius: float, z0: float, z1: float, sides: int, caps: bool = True) -> Patch:
    """Closed cylinder about z between two heights, m."""
    if caps:
        return revolve([(0, z0), (radius, z0), (radius, z1), (0, z1)], sides)
    return revolve([(radius, z0), (radius, z1)], sides)


def peg(radius: float, z0: float, z1: float, sides: int) -> Patch:
    """Cylinder that stands on a surface: no lower cap."""
    return revolve([(radius, z0), (radius, z1), (0, z1)], sides)


def disc(inner: float, outer: float, z: float, sides: int) -> Patch:
    """Annulus at height z that faces +z, with texture coordinates (x, y) about its centre."""
    patch = revolve([(outer, z), (inner, z)], sides)
    return Patch(patch.corners, patch.normals, patch.corners[..., :2].copy())


def sphere(radius: float, sides: int, low: float = -0.5 * np.pi, high: float = 0.5 * np.pi) -> Patch:
    """Sphere about the origin between two latitudes, rad."""
    rows = max(3, round(sides * (high - low) / (2 * np.pi)))
    lat = np.linspace(low, high, rows + 1)
    return revolve(np.stack([radius * np.cos(lat), radius * np.sin(lat)], -1), sides, smooth=True)


def torus(major: float, minor: float, sides: int, ring: int = 6, z: float = 0.0) -> Patch:
    """Ring about z."""
    a = np.linspace(-np.pi, np.pi, ring + 1)
    return revolve(np.stack([major + minor * np.cos(a), z + minor * np.sin(a)], -1), sides, smooth=True)


_FACES = np.array(
    [[1, 5, 7, 3], [0, 2, 6, 4], [2, 3, 7, 6], [0, 4, 5, 1], [4, 6, 7, 5], [0, 1, 3, 2]], dtype=int
)  # +x, -x, +y, -y, +z, -z of the corners numbered by bits (x, y, z)
_FACE_NORMAL = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
_FACE_UV = ((1, 2), (1, 2), (0, 2), (0, 2), (0, 1), (0, 1))


def box(size, centre=(0.0, 0.0, 0.0), bevel: float = 0.0) -> Patch:
    """Box of edge lengths ``size`` m; a bevel narrows its top (+z) face on each side by that many metres."""
    half = 0.5 * np.asarray(size, float)
    bits = np.array([[(k >> i) & 1 for i in range(3)] for k in range(8)], float)
    corner = (2 * bits - 1) * half
    if bevel:
        corner[4:, :2] -= np.sign(corner[4:, :2]) * bevel
    corner = corner + np.asarray(centre, float)
    p = corner[_FACES]
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
    flip = np.einsum("fi,fi->f", n, _FACE_NORMAL) < 0
    p[flip] = p[flip][:, ::-1]
    n[flip] *= -1
    uv = np.stack([p[f][:, list(_FACE_UV[f])] for f in range(6)])
    return quads(p, np.repeat(n[:, None], 4, 1), uv)


def frame_along(tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across each tangent (K, 3)."""
    helper = np.where(np.abs(tangent[:, 2:3]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(helper, tangent)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(tangent, u)


def tube(path, radius, sides: int = 6, caps: bool = True) -> Patch:
    """Round tube along a polyline (K, 3) m; ``radius`` m, one or one a point."""
    path = np.asarray(path, float)
    radius = np.broadcast_to(np.asarray(radius, float), (len(path),))
    step = np.diff(path, axis=0)
    length = np.linalg.norm(step, axis=1)
    unit = step / np.maximum(length[:, None], 1e-12)
    tangent = np.concatenate([unit[:1], unit[:-1] + unit[1:], unit[-1:]])
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    u, v = frame_along(tangent)
    for k in range(1, len(path)):  # carry the frame along, so that bends do not twist
        u[k] = u[k - 1] - tangent[k] * np.dot(u[k - 1], tangent[k])
        u[k] /= np.linalg.norm(u[k])
        v[k] = np.cross(tangent[k], u[k])
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    angle[-1] = 0.0
    along = np.concatenate([[0.0], np.cumsum(length)])
    spoke = np.cos(angle)[None, :, None] * u[:, None] + np.sin(angle)[None, :, None] * v[:, None]
    point = path[:, None] + radius[:, None, None] * spoke
    arc = radius.max() * 2 * np.pi * np.arange(sides + 1) / sides
    uv = np.stack(np.broadcast_arrays(arc[None, :], along[:, None]), -1)
    grid = lambda a: np.stack([a[:-1, :-1], a[:-1, 1:], a[1:, 1:], a[1:, :-1]], 2).reshape(-1, 4, a.shape[-1])  # noqa: E731
    out = [quads(grid(point), grid(spoke), grid(uv))]
    if caps:
        for end, sign in ((0, -1.0), (-1, 1.0)):
            p = np.stack([np.broadcast_to(path[end], (sides, 3)), point[end, :-1], point[end, 1:]][::1], 1)
            if sign < 0:
                p = p[:, [0, 2, 1]]
            n = np.broadcast_to(sign * tangent[end], p.shape).copy()
            out.append(Patch(p, n, p[..., :2].copy()))
    return drop_degenerate(join(*out))


def strut(a, b, radius: float, sides: int = 4) -> Patch:
    """Straight open tube between two points."""
    return tube([a, b], radius, sides, caps=False)


def sheet(p00, p10, p11, p01, *, both: bool = True, cells: tuple[int, int] = (1, 1)) -> Patch:
    """Flat quadrilateral in ``cells`` pieces, uv in metres along two edges; seen from both sides by default."""
    p00, p10, p11, p01 = (np.asarray(p, float) for p in (p00, p10, p11, p01))
    s = np.linspace(0, 1, cells[0] + 1)
    t = np.linspace(0, 1, cells[1] + 1)
    ss, tt = np.meshgrid(s, t, indexing="ij")
    point = (1 - ss)[..., None] * ((1 - tt)[..., None] * p00 + tt[..., None] * p01) + ss[..., None] * (
        (1 - tt)[..., None] * p10 + tt[..., None] * p11
    )
    uv = np.stack([ss * np.linalg.norm(p10 - p00), tt * np.linalg.norm(p01 - p00)], -1)
    grid = lambda a: np.stack([a[:-1, :-1], a[1:, :-1], a[1:, 1:], a[:-1, 1:]], 2).reshape(-1, 4, a.shape[-1])  # noqa: E731
    n = np.cross(p11 - p00, p01 - p10)
    n = n / np.maximum(np.linalg.norm(n), 1e-12)
    p, uv = grid(point), grid(uv)
    front = drop_degenerate(quads(p, np.broadcast_to(n, p.shape).copy(), uv))
    if not both:
        return front
    back = Patch(front.corners[:, ::-1].copy(), -front.normals, front.uvs[:, ::-1].copy())
    return join(front, back)
