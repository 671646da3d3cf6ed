"""A user's own mesh under a transform, against trimesh and the shape of a convex body."""

import numpy as np
import pytest
import trimesh

from lerobot_spacedock.station import load_station

TURN, LEAN = (
    trimesh.transformations.rotation_matrix(0.9, [1, 2, -2]),
    trimesh.transformations.rotation_matrix(2.1, [3, 1, 1]),
)
STRETCH = TURN @ np.diag([1.0, 2.5, 0.4, 1.0]) @ LEAN
STRETCH[:3, 3] = 4.0, -7.0, 2.0
MIRROR = STRETCH @ np.diag([1.0, -1.0, 1.0, 1.0])


@pytest.fixture
def solid(tmp_path):
    """A box away from its origin, without shared corners: its normals are those of its faces."""
    box = trimesh.creation.box(extents=(1.0, 2.0, 3.0))
    box.apply_translation([5.0, 1.0, -2.0])
    box.export(tmp_path / "box.stl")
    return box, tmp_path / "box.stl"


@pytest.mark.parametrize("pose", [STRETCH, MIRROR], ids=["stretched", "mirrored"])
def test_faces_and_normals_are_those_of_trimesh(solid, pose):
    box, path = solid
    station, expected = load_station(path, pose), box.copy().apply_transform(pose)
    order, theirs = (np.lexsort(np.round(c.mean(1), 3).T) for c in (station.corners, expected.triangles))
    np.testing.assert_allclose(station.corners[order].mean(1), expected.triangles[theirs].mean(1), atol=1e-5)
    for corner in range(3):
        np.testing.assert_allclose(station.normals[order, corner], expected.face_normals[theirs], atol=2e-5)


@pytest.mark.parametrize("pose", [STRETCH, MIRROR], ids=["stretched", "mirrored"])
def test_faces_look_outwards(solid, pose):
    """The volume inside, which is negative where corners run clockwise, is the box's times the determinant's size."""
    station = load_station(solid[1], pose)
    inside = np.linalg.det(station.corners).sum() / 6.0
    assert inside == pytest.approx(6.0 * 2.5 * 0.4, rel=1e-4)
    cross = np.cross(station.corners[:, 1] - station.corners[:, 0], station.corners[:, 2] - station.corners[:, 0])
    assert (np.einsum("fi,fci->fc", cross, station.normals) > 0).all()


@pytest.mark.parametrize("pose", [STRETCH, MIRROR], ids=["stretched", "mirrored"])
def test_a_balls_normals_are_those_of_the_ellipsoid(tmp_path, pose):
    """On |M⁻¹ (p - t)| = 1 the normal is the gradient, M⁻ᵀ M⁻¹ (p - t)."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.export(tmp_path / "ball.ply", vertex_normal=True)
    station = load_station(tmp_path / "ball.ply", pose)
    back = np.linalg.inv(pose[:3, :3])
    gradient = (station.corners - pose[:3, 3]) @ back.T @ back
    gradient /= np.linalg.norm(gradient, axis=-1, keepdims=True)
    assert np.abs(station.normals - gradient).max() < 0.02
