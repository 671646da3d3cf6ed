"""Where things are in the picture: projection, depth, segmentation and shadow, against closed forms and ray casts."""

import numpy as np
import pytest
import trimesh
from ray_witness import cast, random_pose, ray_mesh, rays
from scipy.spatial.transform import Rotation

from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, extrinsics, intrinsics, make_renderer, project_points
from lerobot_spacedock.camera.contact_sheet import port_pose
from lerobot_spacedock.physics.frames import QUATERNION
from lerobot_spacedock.station import SEGMENTS, station_for_port

SUN = FIXED_SUN_H["zvezda_aft"]
NOMINAL = (0.5**0.5, -(0.5**0.5), 0.0, 0.0)
pytestmark = pytest.mark.render


def closed_form(config, r_H, q_HB, point):
    """Pinhole by the words of physics/frames.py: body +z forward, +y right, -x down."""
    b = Rotation.from_quat([q_HB[1], q_HB[2], q_HB[3], q_HB[0]]).inv().apply(np.asarray(point) - r_H)
    f = config.height / 2 / np.tan(np.radians(config.vfov_deg) / 2)
    return config.width / 2 + f * b[1] / b[2], config.height / 2 - f * b[0] / b[2], b[2]


def test_nominal_attitude_looks_along_the_track_with_zenith_up():
    config = CameraConfig()
    places = project_points(config, (0, -25, 0), NOMINAL, np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1.0]]))
    np.testing.assert_allclose(places[0], [320, 240, 25], atol=1e-9)
    assert places[1, 1] < 239, "zenith is up in the picture"
    assert places[2, 0] < 319, "orbit normal (+z_H, port side) is left when looking along +V-bar"
    assert slice(7, 11) == QUATERNION


def test_intrinsics_and_extrinsics_make_the_pinhole(tmp_path):
    config = CameraConfig(height=300, width=500, vfov_deg=47.0)
    rng = np.random.default_rng(3)
    for _ in range(50):
        r, q = random_pose(rng)
        point = rng.uniform(-3, 3, 3)
        p = extrinsics(r, q) @ np.append(point, 1.0)
        u = intrinsics(config) @ p[:3]
        np.testing.assert_allclose([u[0] / u[2], u[1] / u[2], u[2]], closed_form(config, r, q, point), atol=1e-8)


@pytest.mark.parametrize(("height", "width"), [(480, 640), (97, 131)])
def test_drawn_corners_lie_where_the_pinhole_puts_them(tmp_path, height, width):
    """Small balls at a box's corners: the centre of what is drawn is the projected corner to half a pixel."""
    config = CameraConfig(height=height, width=width, shadows=False)
    rng = np.random.default_rng(0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    f = height / 2 / np.tan(np.radians(30))
    seen = 0
    for k, corner in enumerate(corners):
        ball = trimesh.creation.icosphere(subdivisions=2, radius=6 * 8 / f / 2)
        ball.apply_translation(corner)
        path = tmp_path / f"corner{k}.stl"
        ball.export(path)
        renderer = make_renderer(config, station_mesh=path)
        for _ in range(4):
            r, q = random_pose(rng, low=8, high=9, tilt=0.1)
            buffers = renderer.render_buffers(r, q, SUN)
            rows, columns = np.nonzero(buffers.segmentation)
            u, v, depth = closed_form(config, r, q, corner)
            if not (8 < u < width - 8 and 8 < v < height - 8):
                continue
            seen += 1
            assert abs(columns.mean() + 0.5 - u) < 0.5
            assert abs(rows.mean() + 0.5 - v) < 0.5
            assert buffers.depth_m[rows, columns].min() == pytest.approx(depth, abs=0.4)
    assert seen > 15


@pytest.mark.parametrize("port", ["zvezda_aft", "harmony_forward"])
def test_depth_and_segments_agree_with_ray_casts(port):
    config = CameraConfig(height=120, width=160, port=port, shadows=False)
    renderer = make_renderer(config)
    mesh = station_for_port(port, "low")
    solid = ray_mesh(mesh)
    rng = np.random.default_rng(5)
    worst, compared, misses = 0.0, 0, 0
    poses = [random_pose(rng, port) for _ in range(15)] + [port_pose(port, 0.2), port_pose(port, 0.02)]
    for r, q in poses:
        buffers = renderer.render_buffers(r, q, FIXED_SUN_H[port])
        columns, rows = rng.integers(0, config.width, 4000), rng.integers(0, config.height, 4000)
        origins, directions = rays(config, r, q, columns, rows)
        depth, which = cast(solid, origins, directions, nearest=config.near_m)
        drawn = buffers.depth_m[rows, columns]
        sky = ~np.isfinite(depth)
        agree = np.where(sky, drawn == config.far_m, np.abs(drawn - depth) < 2e-4 * np.where(sky, 1, depth) + 1e-4)
        misses += int((~agree).sum())
        compared += len(agree)
        hit = agree & ~sky
        if hit.any():
            worst = max(worst, float(np.abs(drawn - depth)[hit].max()))
        same = buffers.segmentation[rows, columns][hit] == mesh.segment[which[hit]]
        assert same.mean() > 0.97  # two faces in one plane may be told apart either way
        assert (buffers.segmentation[rows, columns][agree & sky] == 0).all()
    assert misses <= 0.015 * compared, f"{misses} of {compared} rays differ (a ray may graze an edge)"
    assert worst < 5e-3


@pytest.mark.parametrize(("port", "distance"), [("zvezda_aft", 3.0), ("harmony_forward", 1.2)])
def test_shadows_agree_with_ray_casts_to_the_sun(port, distance):
    sun = FIXED_SUN_H[port]
    lit = make_renderer(CameraConfig(height=240, width=320, port=port, shadows=False))
    shaded = make_renderer(CameraConfig(height=240, width=320, port=port, shadows=True))
    r, q = port_pose(port, distance)
    free = lit.render(r, q, sun).astype(int)
    dark = shaded.render(r, q, sun).astype(int)
    drop = (free - dark).sum(-1)
    mesh = station_for_port(port, "low")
    solid = ray_mesh(mesh)
    rng = np.random.default_rng(1)
    rows, columns = rng.integers(3, 237, 8000), rng.integers(3, 317, 8000)
    origins, directions = rays(lit.config, r, q, columns, rows)
    depth, which = cast(solid, origins, directions, nearest=0.05)
    e1 = mesh.corners[which, 1] - mesh.corners[which, 0]
    normal = np.cross(e1, mesh.corners[which, 2] - mesh.corners[which, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    window = np.stack([drop[rows + i, columns + j] for i in range(-2, 3) for j in range(-2, 3)])
    in_shadow, in_light = (window > 40).all(0), (np.abs(window) <= 4).all(0)  # neither: an edge of a shadow
    use = np.isfinite(depth) & (normal @ sun > 0.25) & (in_shadow | in_light)
    points = (origins + depth[:, None] * directions + 2e-3 * normal)[use]
    blocked = np.isfinite(cast(solid, points, np.broadcast_to(sun, points.shape))[0])
    total, agree = use.sum(), (blocked == in_shadow[use]).sum()
    assert total > 1200
    assert (in_shadow & use).sum() > 160
    assert agree >= 0.98 * total, f"{agree} of {total}"


def test_no_holes_between_neighbours(tmp_path):
    """A crumpled sheet that fills the view: every sample belongs to some triangle."""
    rng = np.random.default_rng(2)
    n = 40
    x, y = np.meshgrid(np.linspace(-4, 4, n), np.linspace(-4, 4, n))
    points = np.stack([x, 3 + 0.2 * rng.random((n, n)), y], -1)
    points[1:-1, 1:-1, [0, 2]] += rng.uniform(-0.05, 0.05, (n - 2, n - 2, 2))
    i = np.arange(n * n).reshape(n, n)
    faces = np.concatenate(
        [np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:]], -1), np.stack([i[:-1, :-1], i[1:, 1:], i[1:, :-1]], -1)]
    ).reshape(-1, 3)
    path = tmp_path / "sheet.ply"
    trimesh.Trimesh(points.reshape(-1, 3), faces, process=False).export(path)
    renderer = make_renderer(CameraConfig(height=300, width=400, shadows=False), station_mesh=path)
    for k in range(5):
        buffers = renderer.render_buffers((0.05 * k, 0.1 * k, 0.03 * k), NOMINAL, SUN)
        assert (buffers.segmentation == SEGMENTS.index("user")).all()
        assert (buffers.image.sum(-1) > 0).all()


def test_looking_away_shows_no_station_and_inside_the_port_still_draws():
    renderer = make_renderer(CameraConfig(height=96, width=128))
    away = renderer.render_buffers((0, -5, 0), (0.5**0.5, 0.5**0.5, 0, 0), SUN)
    assert (away.segmentation == 0).all()
    assert (away.depth_m == 400).all()
    for y in (0.0, 0.2, 0.33, 0.5):  # through the plane, at the target, behind it
        image = renderer.render((0, y, 0), NOMINAL, SUN)
        assert image.shape == (96, 128, 3)
        assert image.dtype == np.uint8
    inside = renderer.render_buffers((0, 0.1, 0), NOMINAL, SUN)
    assert (inside.segmentation == SEGMENTS.index("zvezda_port")).mean() > 0.95
