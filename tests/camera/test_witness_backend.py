"""The pyrender backend and the software renderer see the same station: silhouette, depth, shade."""

import ctypes.util
import os
import subprocess
import sys

import numpy as np
import pytest
from ray_witness import cast, random_pose, ray_mesh, rays
from scipy.ndimage import maximum_filter, minimum_filter

from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, make_renderer
from lerobot_spacedock.camera.contact_sheet import port_pose
from lerobot_spacedock.camera.pyrender_backend import SHADOW_REACH_m
from lerobot_spacedock.errors import MissingDependencyError, SimulationError
from lerobot_spacedock.station import station_for_port

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def pyrender():
    """Makes renderers of that backend, where there is an OpenGL library."""
    pytest.importorskip("OpenGL")

    def make(**options):
        return make_renderer(CameraConfig(**options), backend="pyrender")

    try:
        make(height=4, width=4).render((0, -5, 0), (1, 0, 0, 0), (0, -1, 0))
    except MissingDependencyError as error:
        pytest.skip(str(error))
    return make


@pytest.fixture(scope="module")
def pair(pyrender):
    size = {"height": 180, "width": 240, "shadows": False}
    return make_renderer(CameraConfig(**size)), pyrender(**size)


def test_silhouette_depth_and_shade_agree_over_random_poses(pair):
    software, other = pair
    rng = np.random.default_rng(11)
    sun = FIXED_SUN_H["zvezda_aft"]
    for _ in range(8):
        r, q = random_pose(rng, low=0.5)
        a, b = software.render_buffers(r, q, sun), other.render_buffers(r, q, sun)
        station = a.segmentation > 0
        assert (station == (b.segmentation > 0)).mean() > 0.998
        assert (a.segmentation == b.segmentation).mean() > 0.995
        both = station & (b.depth_m < 399)
        # pyrender resolves a pixel to one of its samples, not to its centre: allow the range of the neighbours
        low, high = minimum_filter(a.depth_m, 3)[both], maximum_filter(a.depth_m, 3)[both]
        step = 1e-3 + 3e-4 * a.depth_m[both] ** 2  # an OpenGL depth step grows as z²
        assert ((b.depth_m[both] > low - step) & (b.depth_m[both] < high + step)).mean() > 0.99
        if both.sum() < 500:
            continue
        shade_a, shade_b = a.image[both].mean(-1), b.image[both].mean(-1)
        assert np.corrcoef(shade_a, shade_b)[0, 1] > 0.88
        assert abs(shade_a.mean() - shade_b.mean()) < 26  # other highlights, no openness term
        np.testing.assert_allclose(a.image[both].mean(0), b.image[both].mean(0), atol=30)


@pytest.mark.parametrize(("port", "distance_m"), [("zvezda_aft", 60.0), ("zvezda_aft", 3.0), ("harmony_forward", 1.2)])
def test_its_shadows_are_where_rays_to_the_sun_are_blocked(pyrender, port, distance_m):
    size, sun = {"height": 120, "width": 160, "port": port}, FIXED_SUN_H[port]
    lit, shaded, pose = pyrender(**size, shadows=False), pyrender(**size), port_pose(port, distance_m)
    drop = (lit.render(*pose, sun).astype(int) - shaded.render(*pose, sun)).sum(axis=-1)
    mesh = station_for_port(port, "low")
    solid = ray_mesh(mesh)
    rows, columns = (axis.ravel() for axis in np.mgrid[2:118:2, 2:158:2])
    origin, direction = rays(lit.config, *pose, columns, rows)
    z, which = cast(solid, origin, direction, nearest=0.05)
    corners = mesh.corners[which]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    around = np.stack([drop[rows + i, columns + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    dark, bright = (around > 40).all(axis=0), (np.abs(around) <= 15).all(axis=0)
    sure = np.isfinite(z) & (normal @ sun > 0.25) & (dark | bright)
    point = (origin + z[:, None] * direction + 2e-3 * normal)[sure]
    blocked = np.isfinite(cast(solid, point, np.broadcast_to(sun, point.shape))[0])
    beyond = np.linalg.norm(point - np.outer(point @ sun, sun), axis=1) > 1.42 * SHADOW_REACH_m  # half its diagonal
    assert len(point) > 60
    assert not dark[sure][beyond].any()  # the map ends there
    near = np.linalg.norm(point, axis=1) < SHADOW_REACH_m
    assert (dark[sure] == blocked)[near].mean() > 0.96


def test_several_renderers_and_closing_one_leaves_the_others(pair, pyrender):
    _, other = pair
    small = pyrender(height=48, width=64)
    assert small.render((0, -10, 0), (0.5**0.5, -(0.5**0.5), 0, 0), (0, -1, 0)).shape == (48, 64, 3)
    small.close()
    small.close()
    with pytest.raises(SimulationError, match="closed"):
        small.render((0, -10, 0), (1, 0, 0, 0), (0, -1, 0))
    assert other.render((0, -10, 0), (0.5**0.5, -(0.5**0.5), 0, 0), (0, -1, 0)).max() > 50


def test_without_gl_libraries_the_message_says_what_to_install():
    code = (
        "import ctypes.util; ctypes.util.find_library = lambda name: None\n"
        "from lerobot_spacedock.camera import make_renderer\n"
        "make_renderer(backend='pyrender')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ, check=False)
    assert done.returncode != 0
    assert all(word in done.stderr for word in ("MissingDependencyError", "libegl1", "software"))
    assert ctypes.util.find_library is not None
