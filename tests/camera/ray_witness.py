"""An independent witness: ray casts by trimesh (Embree's kernels), no shared code."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation


def rays(config, r_H, q_HB, columns, rows):
    """Origins and directions (N, 3) in Hill axes through pixel centres; each direction covers 1 m of depth."""
    f = config.height / 2 / np.tan(np.radians(config.vfov_deg) / 2)
    right = (np.asarray(columns) + 0.5 - config.width / 2) / f
    down = (np.asarray(rows) + 0.5 - config.height / 2) / f
    body = np.stack([-down, right, np.ones(len(right))], -1)  # right in the picture is +y_B, down is -x_B
    turn = Rotation.from_quat([q_HB[1], q_HB[2], q_HB[3], q_HB[0]])
    return np.broadcast_to(np.asarray(r_H, float), body.shape), turn.apply(body)


def ray_mesh(mesh):
    """The station as trimesh wants it, its triangles in the same order."""
    faces = np.arange(3 * len(mesh)).reshape(-1, 3)
    return trimesh.Trimesh(np.asarray(mesh.corners).reshape(-1, 3), faces, process=False)


def cast(solid, origins, directions, nearest=0.0):
    """Distance (N,) in units of each direction's length to the first triangle, inf where none; and its number (N,)."""
    origins, directions = np.asarray(origins, float), np.asarray(directions, float)
    start = origins + nearest * directions
    triangle, ray, place = solid.ray.intersects_id(start, directions, multiple_hits=False, return_locations=True)
    best, which = np.full(len(origins), np.inf), np.full(len(origins), -1)
    along = np.einsum("ij,ij->i", place - origins[ray], directions[ray])
    best[ray] = along / np.einsum("ij,ij->i", directions[ray], directions[ray])
    which[ray] = triangle
    return best, which


def random_pose(rng, port="zvezda_aft", low=0.6, high=30.0, tilt=0.35):
    """A position in front of the port and an attitude that looks towards it, give or take."""
    from lerobot_spacedock.camera.contact_sheet import port_pose

    d = np.exp(rng.uniform(np.log(low), np.log(high)))
    r, q = port_pose(port, d, up_m=d * rng.uniform(-0.3, 0.3), side_m=d * rng.uniform(-0.3, 0.3))
    turn = Rotation.from_quat([q[1], q[2], q[3], q[0]]) * Rotation.from_rotvec(rng.uniform(-tilt, tilt, 3))
    x, y, z, w = turn.as_quat()
    return r, np.array([w, x, y, z])
