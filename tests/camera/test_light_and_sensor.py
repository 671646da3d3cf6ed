"""Light and film: what Sun, eclipse, lamp, noise, blur and lens must do to a picture."""

import numpy as np
import pytest

from lerobot_spacedock.camera import FIXED_SUN_H, CameraConfig, SensorConfig, make_renderer
from lerobot_spacedock.camera.contact_sheet import ECLIPSE_SUN_H, port_pose
from lerobot_spacedock.camera.exposure import light_array
from lerobot_spacedock.camera.sensor import Sensor, distort

pytestmark = pytest.mark.render
SUN = FIXED_SUN_H["zvezda_aft"]
SMALL = {"height": 96, "width": 128}


def mean(**options):
    sun = options.pop("sun", SUN)
    return make_renderer(CameraConfig(**SMALL, **options)).render(*port_pose("zvezda_aft", 2.0), sun).mean()


def test_eclipse_is_dark_without_the_lamp_and_readable_with_it():
    assert mean(sun=ECLIPSE_SUN_H, lamp="off") < 0.35 * mean()
    assert mean(sun=ECLIPSE_SUN_H) > 2.0 * mean(sun=ECLIPSE_SUN_H, lamp="off")
    assert mean(sun=ECLIPSE_SUN_H, lamp="auto") == mean(sun=ECLIPSE_SUN_H, lamp="on")


def test_shadows_only_darken_and_exposure_only_brightens():
    pose = port_pose("zvezda_aft", 3.0)
    with_shadow = make_renderer(CameraConfig(**SMALL)).render(*pose, SUN).astype(int)
    without = make_renderer(CameraConfig(**SMALL, shadows=False)).render(*pose, SUN).astype(int)
    assert (with_shadow <= without).all()
    assert (with_shadow < without).mean() > 0.02
    assert mean(exposure=0.3) < mean(exposure=0.9) < mean(exposure=2.0)


def test_target_is_seen_all_the_way_in():
    """The white cross stands out of its black plate from 3 m to 5 cm."""
    for port in ("zvezda_aft", "harmony_forward"):
        renderer = make_renderer(CameraConfig(port=port))
        for d in (3.0, 1.0, 0.5, 0.2, 0.05):
            image = renderer.render(*port_pose(port, d), FIXED_SUN_H[port]).astype(int)
            f = 240 / np.tan(np.radians(30))
            half = max(4, int(0.15 * f / (d + 0.4)))
            patch = image[240 - half : 240 + half, 320 - half : 320 + half].mean(-1)
            assert np.ptp(patch) > 90, (port, d)


def test_noise_has_the_stated_spread_and_follows_its_generator():
    sensor = SensorConfig(read_noise=0.02, full_well_electrons=2000.0)
    camera = Sensor(CameraConfig(height=200, width=200, sensor=sensor))
    level = 0.4
    flat = np.full((200, 200, 3), level, np.float32)
    a = camera.expose(flat, np.random.default_rng(1))
    b = camera.expose(flat, np.random.default_rng(1))
    c = camera.expose(flat, np.random.default_rng(2))
    assert (a == b).all()
    assert (a != c).any()
    x = a / 255.0
    linear = np.where(x < 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)  # the sRGB standard's own inverse
    assert linear.mean() == pytest.approx(level, abs=2e-3)
    assert linear.std() == pytest.approx(np.sqrt(0.02**2 + level / 2000.0), rel=0.03)
    fresh = Sensor(CameraConfig(height=200, width=200, sensor=sensor))
    again = Sensor(CameraConfig(height=200, width=200, sensor=sensor))
    first, second = fresh.expose(flat, None), fresh.expose(flat, None)
    assert (first != second).any()
    assert (again.expose(flat, None) == first).all()


def test_encoding_is_srgb_to_one_level():
    camera = Sensor(CameraConfig(height=1, width=1000, sensor=SensorConfig(bloom=1e-9)))
    ramp = np.repeat(np.linspace(0, 1, 1000, dtype=np.float32)[None, :, None], 3, 2)
    x = ramp[..., 0].astype(float)
    standard = 255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    assert np.abs(camera.expose(ramp, None)[..., 0] - standard).max() < 1.6


def test_blur_keeps_light_and_widens_a_point():
    from lerobot_spacedock.camera.sensor import _blur

    point = np.zeros((61, 61, 3), np.float32)
    point[30, 30] = 1.0
    out = _blur(point, 2.0)[..., 0].astype(float)
    assert out.sum() == pytest.approx(1.0, abs=1e-4)
    y, x = np.mgrid[:61, :61] - 30.0
    assert (out * x * x).sum() == pytest.approx(4.0, rel=0.03)
    assert (out * y * y).sum() == pytest.approx(4.0, rel=0.03)


def test_distortion_moves_points_by_its_formula(tmp_path):
    """A ball off the axis appears where r (1 + k1 r² + k2 r⁴) puts it."""
    import trimesh

    sensor = SensorConfig(distortion_k1=-0.18, distortion_k2=0.03)
    bent = CameraConfig(height=300, width=400, sensor=sensor, shadows=False, lamp="on", exposure=5.0)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.06)
    ball.apply_translation([2.0, 0.0, -3.0])
    path = tmp_path / "ball.stl"
    ball.export(path)
    image = (
        make_renderer(bent, station_mesh=path)
        .render((0, -5, 0), (0.5**0.5, -(0.5**0.5), 0, 0), SUN)
        .astype(float)
        .mean(-1)
    )
    f = 150 / np.tan(np.radians(30))
    straight = np.array([[200 + f * 3 / 5, 150 - f * 2 / 5]])
    expected = distort(bent, straight)[0]
    assert np.linalg.norm(expected - straight[0]) > 5
    j, i = expected.astype(int)
    window = image[i - 12 : i + 13, j - 12 : j + 13]
    window = window * (window > 60)
    y, x = np.mgrid[i - 12 : i + 13, j - 12 : j + 13]
    found = np.array([(window * x).sum(), (window * y).sum()]) / window.sum() + 0.5
    assert np.linalg.norm(found - expected) < 0.7


def with_bloom(linear, bloom=0.5):
    """A grey picture through bloom of 2 px above 0.6 alone, (H, W) uint8."""
    sensor = SensorConfig(bloom=bloom, bloom_px=2.0, bloom_threshold=0.6)
    camera = Sensor(CameraConfig(height=linear.shape[0], width=linear.shape[1], sensor=sensor))
    return camera.expose(np.repeat(linear[..., None], 3, 2).astype(np.float32), None)[..., 0]


def test_nothing_blooms_below_the_threshold():
    fields = [np.full((20, 20), level) for level in (0.1, 0.35, 0.599)]
    for field in (*fields, np.linspace(0.0, 0.599, 400).reshape(20, 20)):
        assert (with_bloom(field) == with_bloom(field, bloom=0.0)).all()


def test_a_light_blooms_by_what_is_above_the_threshold_and_near_itself():
    """0.8 above it in one pixel: half of that, 0.4, in a Gaussian of 2 px, 0.4 / (2π 2²) at its middle."""
    y, x = np.mgrid[:41, :41] - 20.0
    r2 = x * x + y * y
    x = with_bloom(np.where(r2 == 0, 1.4, 0.0)) / 255.0
    found = np.where(x < 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)  # the sRGB standard's own inverse
    expected = 0.4 / (2.0 * np.pi * 4.0) * np.exp(-r2 / 8.0)
    around = (r2 > 0) & (r2 < 100)  # the point itself is beyond full scale
    assert np.abs(found - expected)[around].max() < 1e-3
    assert found[around].sum() == pytest.approx(expected[around].sum(), rel=0.05)
    assert (found[r2 >= 100] == 0).all()


def through_the_penumbra(count):
    """What Sun, Earth and shade put on film, (count, 9), and the exposure, over 0.8 degrees about Earth's limb."""
    limb = -np.arccos(6378.137 / 6787.137)
    elevation = limb + np.radians(np.linspace(-0.4, 0.4, count))
    config = CameraConfig(lamp="off")
    light = np.array(
        [light_array(config, (0.0, -5.0, 0.0), (np.sin(e), -np.cos(e), 0.0))[0].astype(float) for e in elevation]
    )
    return light[:, 3:12] * light[:, 15:16], light[:, 15]


def test_brightness_goes_through_the_penumbra_without_a_jump():
    """Half the step, half the change; and a card in the Sun is never brighter on film than by day."""
    coarse, fine = (np.abs(np.diff(through_the_penumbra(n)[0], axis=0)).max() for n in (401, 801))
    assert fine == pytest.approx(0.5 * coarse, rel=0.1)
    film, exposure = through_the_penumbra(401)
    assert (np.diff(exposure) <= 0).all()
    assert exposure[0] > 10 * exposure[-1]
    assert (film[:, :3] <= film[-1, :3] * 1.001).all()


def test_the_lamp_is_equal_at_equal_range():
    def lamp(*r):
        return light_array(CameraConfig(lamp="on"), r, SUN)[0][12:15]

    for r in ((3.0, -4.0, 0.0), (0.0, -3.0, -4.0), (1.4, -0.0, 4.8)):
        np.testing.assert_allclose(lamp(*r), lamp(0.0, -5.0, 0.0), rtol=1e-6)
    assert (lamp(0.0, -10.0, 0.0) > 1.5 * lamp(0.0, -5.0, 0.0)).all()
