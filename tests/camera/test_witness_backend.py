"""The pyrender backend and the software renderer see the same station: silhouette, depth, shade."""

import ctypes.util
import os
import subprocess
import sys

import numpy as np
import pytest
from ray_witness import random_pose
from scipy.ndimage import maximum_filter, minimum_filter

from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, make_renderer
from lerobot_spacedock.errors import MissingDependencyError, SimulationError

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def pair():
    pytest.importorskip("OpenGL")
    config = CameraConfig(height=180, width=240, shadows=False)
    try:
        other = make_renderer(config, backend="pyrender")
        other.render((0, -5, 0), (1, 0, 0, 0), (0, -1, 0))
    except MissingDependencyError as error:
        pytest.skip(str(error))
    return make_renderer(config), other


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


def test_several_renderers_and_closing_one_leaves_the_others(pair):
    _, other = pair
    small = make_renderer(CameraConfig(height=48, width=64), backend="pyrender")
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
