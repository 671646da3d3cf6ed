"""Rotations: axioms by property, values against scipy's Rotation (an independent implementation)."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lerobot_spacedock.physics import rotations

finite = st.floats(-3.0, 3.0)
vectors = st.tuples(finite, finite, finite).map(np.array)


def scipy_of(q):
    return Rotation.from_quat(np.asarray(q), scalar_first=True)


@settings(max_examples=300, deadline=None)
@given(vectors, vectors, vectors)
def test_rotations_form_a_group_that_keeps_lengths(a, b, v):
    p, q = rotations.from_rotation_vector(a), rotations.from_rotation_vector(b)
    assert np.allclose(np.linalg.norm(rotations.multiply(p, q)), 1.0, atol=1e-14)
    assert np.allclose(
        rotations.rotate(rotations.multiply(p, q), v), rotations.rotate(p, rotations.rotate(q, v)), atol=1e-13
    )
    assert np.allclose(rotations.rotate_inverse(p, rotations.rotate(p, v)), v, atol=1e-13)
    assert np.isclose(np.linalg.norm(rotations.rotate(p, v)), np.linalg.norm(v), atol=1e-13)
    assert np.allclose(rotations.multiply(p, rotations.conjugate(p)), [1.0, 0.0, 0.0, 0.0], atol=1e-14)


@settings(max_examples=300, deadline=None)
@given(vectors, vectors)
def test_values_are_those_of_scipy(a, v):
    q = rotations.from_rotation_vector(a)
    reference = Rotation.from_rotvec(a)
    assert np.allclose(rotations.rotate(q, v), reference.apply(v), atol=1e-13)


@settings(max_examples=300, deadline=None)
@given(vectors)
def test_rotation_vector_round_trip_takes_the_shorter_way(a):
    q = rotations.from_rotation_vector(a)
    back = rotations.to_rotation_vector(q)
    assert np.linalg.norm(back) <= np.pi + 1e-12
    assert np.allclose(scipy_of(rotations.from_rotation_vector(back)).as_matrix(), scipy_of(q).as_matrix(), atol=1e-12)
    assert np.allclose(rotations.to_rotation_vector(-q), back, atol=1e-9) or np.isclose(np.linalg.norm(back), np.pi)


def test_batches_broadcast():
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(5, 1, 4)), rng.normal(size=(7, 3))
    q = rotations.normalize(q)
    out = rotations.rotate(q, v)
    assert out.shape == (5, 7, 3)
    assert np.allclose(out[3, 2], scipy_of(q[3, 0]).apply(v[2]))


def test_nominal_attitude_looks_along_v_bar_with_zenith_up():
    q = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])
    assert np.allclose(rotations.rotate(q, [0, 0, 1]), [0, 1, 0])  # view axis → along-track
    assert np.allclose(rotations.rotate(q, [1, 0, 0]), [1, 0, 0])  # picture's up → radial outward
