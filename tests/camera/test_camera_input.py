"""What the camera refuses, and how it says so."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from lerobot_spacedock.camera import (
    CameraConfig,
    SensorConfig,
    contact_sheet,
    draw_sun,
    make_renderer,
    sun_from_orbit,
    sunlit_share,
)
from lerobot_spacedock.errors import FileFormatError, InputError, SpaceDockError

pytestmark = pytest.mark.render
POSE = ((0.0, -10.0, 0.0), (0.5**0.5, -(0.5**0.5), 0.0, 0.0))
SUN = (0.0, -1.0, 0.0)
bad_number = st.sampled_from([math.nan, math.inf, -math.inf])


@pytest.fixture(scope="module")
def renderer():
    return make_renderer(CameraConfig(height=24, width=32))


@settings(max_examples=30, deadline=None)
@given(place=st.integers(0, 9), value=bad_number)
def test_a_number_that_is_not_finite_is_named(renderer, place, value):
    numbers = [*POSE[0], *POSE[1], *SUN]
    numbers[place] = value
    name = "r_H" if place < 3 else "q_HB" if place < 7 else "sun_H"
    with pytest.raises(InputError, match=name):
        renderer.render(numbers[:3], numbers[3:7], numbers[7:])


@settings(max_examples=40, deadline=None)
@given(
    r=st.lists(st.floats(-500, 500), min_size=3, max_size=3),
    q=st.lists(st.floats(-1, 1), min_size=4, max_size=4),
    sun=st.lists(st.floats(-1, 1), min_size=3, max_size=3),
)
def test_any_pose_gives_a_picture_or_an_input_error(renderer, r, q, sun):
    try:
        image = renderer.render(r, q, sun)
    except InputError:
        assert np.linalg.norm(sun) < 1e-8 or not 0.9 < np.linalg.norm(q) < 1.1
        return
    assert image.shape == (24, 32, 3)
    assert image.dtype == np.uint8


@pytest.mark.parametrize(
    ("r", "q", "sun", "name"),
    [
        ((0, 0), POSE[1], SUN, "r_H"),
        (POSE[0], (1, 0, 0), SUN, "q_HB"),
        (POSE[0], (0, 0, 0, 0), SUN, "q_HB"),
        (POSE[0], (3, 0, 0, 0), SUN, "q_HB"),
        (POSE[0], POSE[1], (0, 0, 0), "sun_H"),
        ("here", POSE[1], SUN, "r_H"),
        ((1e9, 0, 0), POSE[1], SUN, "r_H"),
    ],
)
def test_wrong_shapes_and_zero_directions(renderer, r, q, sun, name):
    with pytest.raises(InputError, match=name):
        renderer.render(r, q, sun)


@pytest.mark.parametrize(
    "options",
    [
        {"height": 0}, {"width": -3}, {"height": 2.5}, {"height": 10**6}, {"vfov_deg": 0.0}, {"vfov_deg": 180.0},
        {"vfov_deg": math.nan}, {"near_m": 0.0}, {"far_m": 1.0}, {"port": "zarya"}, {"detail": "ultra"}, {"samples": 3},
        {"lamp": "maybe"}, {"exposure": -1.0},
    ],
)  # fmt: skip
def test_bad_options_say_what_is_allowed(options):
    with pytest.raises(InputError) as caught:
        CameraConfig(**options)
    assert next(iter(options)) in str(caught.value)
    assert "allowed" in str(caught.value)


@pytest.mark.parametrize("options", [{"read_noise": -0.1}, {"blur_px": math.nan}, {"distortion_k1": 3.0}])
def test_bad_sensor_options(options):
    with pytest.raises(InputError, match=r"camera\.sensor"):
        SensorConfig(**options)


def test_a_contact_sheet_of_no_width_is_refused(tmp_path):
    with pytest.raises(InputError, match="--width: got 0"):
        contact_sheet.main(["--width=0", f"--out={tmp_path / 'sheet.png'}"])
    assert not list(tmp_path.iterdir())


def test_a_lens_that_folds_the_picture_is_refused():
    with pytest.raises(InputError, match="distortion"):
        make_renderer(CameraConfig(height=24, width=32, vfov_deg=120, sensor=SensorConfig(distortion_k1=-0.9)))


def test_unknown_backend():
    with pytest.raises(InputError, match=r"software \| pyrender"):
        make_renderer(backend="vulkan")


@pytest.mark.parametrize("content", [b"", b"glTF but not really", b"solid nothing\nendsolid nothing\n"])
@pytest.mark.parametrize("suffix", [".glb", ".stl", ".obj"])
def test_broken_mesh_files(tmp_path, content, suffix):
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="broken"):
        make_renderer(station_mesh=path)


def test_missing_mesh_zeros_and_bad_transform(tmp_path):
    with pytest.raises(InputError, match="station_mesh"):
        make_renderer(station_mesh=tmp_path / "absent.glb")
    path = tmp_path / "point.ply"
    trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False).export(path)
    with pytest.raises(FileFormatError, match="one place"):
        make_renderer(station_mesh=path)
    good = tmp_path / "box.glb"
    trimesh.creation.box().export(good)
    for pose in (np.zeros((4, 4)), np.eye(3), "identity", np.full((4, 4), np.nan)):
        with pytest.raises(InputError, match="station_pose"):
            make_renderer(station_mesh=good, station_pose=pose)


def test_a_users_mesh_with_a_transform(tmp_path):
    path = tmp_path / "box.glb"
    trimesh.creation.box(extents=(2, 2, 2)).export(path)
    pose = np.eye(4)
    pose[1, 3] = 7.0
    buffers = make_renderer(CameraConfig(height=60, width=80), station_mesh=path, station_pose=pose).render_buffers(
        *POSE, SUN
    )
    assert buffers.depth_m[30, 40] == pytest.approx(16.0, abs=1e-3)


def test_closed_renderer_and_all_errors_share_a_root(renderer):
    other = make_renderer(CameraConfig(height=24, width=32))
    other.close()
    other.close()
    with pytest.raises(SpaceDockError, match="closed"):
        other.render(*POSE, SUN)
    renderer.render(*POSE, SUN)


def test_eclipse_share_of_an_orbit_is_the_closed_form():
    """In the orbit plane the shadow's half angle is asin(R / (R + h)) (cylindrical shadow, refraction left out)."""
    shares = [sunlit_share(sun_from_orbit(t, beta_rad=0.0)) for t in np.linspace(0, 5564.7, 20001)[:-1]]
    half = math.asin(6378.137 / 6787.137)
    assert 1.0 - np.mean(shares) == pytest.approx(half / math.pi, abs=2e-4)
    assert min(sunlit_share(sun_from_orbit(t, beta_rad=1.3)) for t in range(0, 5565, 50)) == 1.0


def test_sun_falls_behind_after_noon_and_draws_light_the_port():
    assert sun_from_orbit(600.0)[1] < 0 < sun_from_orbit(600.0)[0]
    rng = np.random.default_rng(0)
    drawn = np.array([draw_sun(rng) for _ in range(200)])
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0)
    assert (drawn[:, 1] <= -0.15).all()
    assert min(map(sunlit_share, drawn)) == 1.0


def test_beta_is_the_elevation_towards_the_orbit_normal():
    for beta in (-1.0, 0.4, math.pi / 2):
        for time_s in (0.0, 1234.0):
            assert math.asin(sun_from_orbit(time_s, beta_rad=beta)[2]) == pytest.approx(beta)
    assert sun_from_orbit(0.0, beta_rad=0.0) == pytest.approx([1.0, 0.0, 0.0])  # noon
    assert sun_from_orbit(0.0, beta_rad=0.3, phase_rad=math.pi) == pytest.approx([-math.cos(0.3), 0, math.sin(0.3)])


def test_the_sun_lights_the_port_that_is_named():
    """Harmony's forward port faces +V-bar, Zvezda's aft port -V-bar; each cosine from the smallest to 1 is drawn."""
    for port, outward in (("harmony_forward", 1.0), ("zvezda_aft", -1.0)):
        rng = np.random.default_rng(0)
        facing = outward * np.array([draw_sun(rng, port=port, min_facing=0.4) for _ in range(200)])[:, 1]
        assert 0.4 <= facing.min() < 0.45
        assert 0.95 < facing.max() <= 1.0
