"""The station against the dimensions it was built from, and as geometry that a renderer can trust."""

import numpy as np
import pytest

from lerobot_spacedock.station import MATERIALS, SEGMENTS, cache, station_for_port
from lerobot_spacedock.station.builder import Builder
from lerobot_spacedock.station.mesh import HILL_FROM_STATION, PORT_ORIGIN_S, GRID_m


@pytest.fixture(scope="module", params=["low", "high"])
def station(request):
    return station_for_port("zvezda_aft", request.param)


def extent(mesh, segment):
    """Lowest and highest corner (2, 3) of a segment in station axes, relative to their origin."""
    points = mesh.corners[mesh.segment == SEGMENTS.index(segment)].reshape(-1, 3)
    points = points @ HILL_FROM_STATION + PORT_ORIGIN_S["zvezda_aft"]
    return points.min(0), points.max(0)


def test_levels_of_detail():
    low, high = (len(station_for_port("zvezda_aft", d)) for d in ("low", "high"))
    assert 28_000 < low < 36_000
    assert 95_000 < high < 120_000


def test_every_segment_is_there(station):
    assert {SEGMENTS[s] for s in np.unique(station.segment)} == set(SEGMENTS) - {"sky", "user"}
    assert station.material.max() < len(MATERIALS)


def test_dimensions_are_those_of_the_reference(station):
    low, high = extent(station, "zvezda")
    assert high[0] - low[0] == pytest.approx(29.7, abs=0.6)  # arrays, tip to tip
    low, high = extent(station, "truss")
    assert low[0] == pytest.approx(-51, abs=0.5)
    assert high[0] == pytest.approx(51, abs=0.5)
    low, high = extent(station, "arrays")
    assert high[2] - low[2] == pytest.approx(2 * 37, abs=4)
    assert high[0] == pytest.approx(55.8, abs=0.5)
    low, high = extent(station, "columbus")
    assert low[0] < -8.5
    assert high[0] < 0
    low, high = extent(station, "kibo")
    assert low[0] > 0
    assert high[0] > 13
    low, high = extent(station, "destiny")
    assert high[1] - low[1] == pytest.approx(8.5, abs=0.1)
    low, high = extent(station, "nauka")
    assert high[2] - low[2] == pytest.approx(13.1, abs=1.6)


@pytest.mark.parametrize(
    ("segment", "axis", "skin", "ends", "length", "diameter"),
    [
        ("destiny", 1, "white_shield", "aluminium", 8.5, 4.3),
        ("harmony", 1, "white_shield", "aluminium", 7.19, 4.42),
        ("columbus", 0, "white_shield", "aluminium", 6.9, 4.5),
        ("zvezda", 1, "russian_white", "anodised", 13.1 + 1.1, 4.15),
        ("zarya", 1, "russian_white", "russian_mli", 12.6 + 0.7, 4.1),
        ("nauka", 2, "russian_white", "russian_mli", 13.1, 4.25),
    ],
)
def test_modules_measure_what_the_agencies_say(station, segment, axis, skin, ends, length, diameter):
    """Round their skin and along their axis, from end ring to end ring.

    The model's Zvezda and Zarya reach from one measured port to the next, which is 1.1 m and 0.7 m more than the
    modules' own lengths.

    Figures as NASA, ESA and Roscosmos publish them; for Harmony those of nasa.gov, "Node 2: Harmony".
    """
    points = station.corners @ HILL_FROM_STATION + PORT_ORIGIN_S["zvezda_aft"]
    here = station.segment == SEGMENTS.index(segment)
    name = np.array([material.name for material in MATERIALS])[station.material]
    across = [i for i in range(3) if i != axis]
    barrel = points[here & (name == skin)].reshape(-1, 3)[:, across]
    centre = 0.5 * (barrel.min(0) + barrel.max(0))
    assert 2 * np.linalg.norm(barrel - centre, axis=1).max() == pytest.approx(diameter, abs=0.1)
    rings = points[here & (name == ends)].reshape(-1, 3)
    rings = rings[np.linalg.norm(rings[:, across] - centre, axis=1) < 1.1]
    assert np.ptp(rings[:, axis]) == pytest.approx(length, abs=0.1)


def test_radiators_trail_aft_of_the_truss(station):
    """The six big panels of some twenty metres point away from the flight direction."""
    low, high = extent(station, "radiators")
    truss = np.mean(extent(station, "truss"), axis=0)
    assert low[1] > truss[1] - 0.5
    assert 20.0 < high[1] - truss[1] < 26.0
    assert low[0] == pytest.approx(-high[0], abs=1e-3)


@pytest.mark.parametrize("high", [False, True])
def test_a_ring_lies_on_its_circle(high):
    builder = Builder(high)
    builder.ring(np.eye(4), 2.0, 0.03, "anodised", 0.5)
    points = builder.result()[0].corners.reshape(-1, 3)
    off_axis = np.hypot(points[:, 0], points[:, 1])
    assert 1.97 - 1e-9 <= off_axis.min() <= off_axis.max() <= 2.03 + 1e-9
    assert points[:, 2].min() == pytest.approx(0.47)
    assert points[:, 2].max() == pytest.approx(0.53)


def test_ports_are_53_m_apart_and_face_away():
    apart = np.subtract(PORT_ORIGIN_S["zvezda_aft"], PORT_ORIGIN_S["harmony_forward"])
    assert apart[1] == pytest.approx(53.4, abs=0.05)
    np.testing.assert_allclose(HILL_FROM_STATION @ HILL_FROM_STATION.T, np.eye(3))
    assert np.linalg.det(HILL_FROM_STATION) == pytest.approx(1.0)


@pytest.mark.parametrize("port", ["zvezda_aft", "harmony_forward"])
def test_approach_is_free_and_the_target_stands_inside(port):
    """Nothing within 0.45 m of the axis reaches out of the docking plane; the target's plate is 0.4 m behind it."""
    mesh = station_for_port(port, "low")
    outward = -1.0 if port == "zvezda_aft" else 1.0
    points = mesh.corners.reshape(-1, 3)
    off_axis = np.hypot(points[:, 0], points[:, 2])
    reach = outward * points[:, 1]  # metres out of the port
    assert reach[off_axis < 0.45].max() <= 0.0
    white = [i for i, m in enumerate(MATERIALS) if m.name.startswith("target_")]
    on_target = np.isin(mesh.material, white) & (np.hypot(mesh.corners[..., 0], mesh.corners[..., 2]).max(1) < 0.17)
    depth = -outward * mesh.corners[on_target][..., 1]
    assert depth.min() > 0.30
    assert depth.max() < 0.42


def test_no_ship_is_at_the_free_ports(station):
    ships = [SEGMENTS.index(s) for s in ("soyuz", "progress", "dragon")]
    nearest = np.linalg.norm(station.corners[np.isin(station.segment, ships)], axis=-1).min()
    assert nearest > 8.0


def test_corners_lie_on_the_grid_and_normals_agree_with_the_faces(station):
    off = np.abs(station.corners / GRID_m - np.round(station.corners / GRID_m)).max()
    assert off < 1e-3
    e1, e2 = station.corners[:, 1] - station.corners[:, 0], station.corners[:, 2] - station.corners[:, 0]
    face = np.cross(e1, e2)
    size = np.linalg.norm(face, axis=1)
    assert size.min() > 0
    agree = np.einsum("fi,fci->fc", face / size[:, None], station.normals)
    assert (agree.min(axis=1) > 0.2).mean() > 0.995
    np.testing.assert_allclose(np.linalg.norm(station.normals, axis=-1), 1.0, atol=1e-3)


def test_two_builds_are_equal_with_and_without_the_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEDOCK_CACHE", str(tmp_path / "a"))
    first = station_for_port("zvezda_aft", "low")
    stored = station_for_port("zvezda_aft", "low")
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("SPACEDOCK_CACHE", str(tmp_path / "file"))
    anew = station_for_port("zvezda_aft", "low")
    for other in (stored, anew):
        assert (first.corners == other.corners).all()
        assert (first.normals == other.normals).all()
    assert list((tmp_path / "a").glob("station-*/*.npy"))


def test_a_slower_process_leaves_the_arrays_of_a_faster_one(monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEDOCK_CACHE", str(tmp_path))

    def slow():
        cache.cached_arrays("x", __file__, lambda: {"a": np.arange(3)})  # the other one, meanwhile
        (inode,) = [path.stat().st_ino for path in tmp_path.glob("x-*/a.npy")]
        seen.append(inode)
        return {"a": np.arange(3)}

    seen = []
    assert cache.cached_arrays("x", __file__, slow)["a"].tolist() == [0, 1, 2]
    assert [path.stat().st_ino for path in tmp_path.glob("x-*/a.npy")] == seen
    assert not list(tmp_path.glob(".x-*"))


def test_a_damaged_cache_is_made_anew(monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEDOCK_CACHE", str(tmp_path))
    source = __file__
    assert cache.cached_arrays("x", source, lambda: {"a": np.arange(3)})["a"].tolist() == [0, 1, 2]
    (path,) = tmp_path.glob("x-*/a.npy")
    for damage in (b"", b"\x93NUMPY cut short", path.read_bytes()[:60], path.read_bytes()[:-8]):
        path.write_bytes(damage)
        assert cache.cached_arrays("x", source, lambda: {"a": np.arange(3)})["a"].tolist() == [0, 1, 2]
