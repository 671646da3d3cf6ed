"""An independent witness: brute-force ray casts in double precision (Möller and Trumbore 1997), no shared code."""

import numpy as np
from scipy.spatial.transform import Rotation


def rays(config, r_H, q_HB, columns, rows):
    """Origins and directions (N, 3) in Hill axes through pixel centres; each direction covers 1 m of depth."""
    f = config.height / 2 / np.tan(np.radians(config.vfov_deg) / 2)
    right = (np.asarray(columns) + 0.5 - config.width / 2) / f
    down = (np.asarray(rows) + 0.5 - config.height / 2) / f
    body = np.stack([-down, right, np.ones(len(right))], -1)  # right in the picture is +y_B, down is -x_B
    turn = Rotation.from_quat([q_HB[1], q_HB[2], q_HB[3], q_HB[0]])
    return np.broadcast_to(np.asarray(r_H, float), body.shape), turn.apply(body)


def cast(corners, origins, directions, nearest=0.0):
    """Distance (N,) in units of each direction's length to the first triangle, inf where none; and its number (N,)."""
    a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    best, which = np.full(len(origins), np.inf), np.full(len(origins), -1)
    for k, (o, d) in enumerate(zip(origins, directions, strict=True)):
        p = np.cross(d, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inv = 1.0 / np.einsum("fi,fi->f", e1, p)
            s = o - a
            u = np.einsum("fi,fi->f", s, p) * inv
            q = np.cross(s, e1)
            v = (q @ d) * inv
            t = np.einsum("fi,fi->f", e2, q) * inv
            t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > nearest), t, np.inf)
        which[k] = int(t.argmin())
        best[k] = t[which[k]]
    return best, which


def random_pose(rng, port="zvezda_aft", low=0.6, high=30.0, tilt=0.35):
    """A position in front of the port and an attitude that looks towards it, give or take."""
    from lerobot_spacedock.camera.contact_sheet import port_pose

    d = np.exp(rng.uniform(np.log(low), np.log(high)))
    r, q = port_pose(port, d, up_m=d * rng.uniform(-0.3, 0.3), side_m=d * rng.uniform(-0.3, 0.3))
    turn = Rotation.from_quat([q[1], q[2], q[3], q[0]]) * Rotation.from_rotvec(rng.uniform(-tilt, tilt, 3))
    x, y, z, w = turn.as_quat()
    return r, np.array([w, x, y, z])
