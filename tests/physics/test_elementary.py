"""The branch-free elementary functions against extended precision, and their exact values."""

import math

import numpy as np
import pytest

from lerobot_spacedock.physics.elementary import angle_of, cosine_sine_of_turns, log_positive

COUNT = 2000


def test_logarithm():
    generator = np.random.default_rng(0)
    values = np.concatenate([generator.random(COUNT), 10.0 ** generator.uniform(-18, 18, COUNT)])
    found = np.array([log_positive(value) for value in values])
    exact = np.log(values.astype(np.longdouble))
    # two units in the last place, or of what is left where the argument is near 1
    assert np.all(np.abs(found - exact) <= 2 * np.maximum(np.spacing(np.abs(exact).astype(float)), 1.2e-16))


@pytest.mark.parametrize(("value", "expected"), [(1.0, 0.0), (2.0, math.log(2.0)), (2.0**-54, -54 * math.log(2.0))])
def test_logarithm_of_powers_of_two(value, expected):
    assert log_positive(value) == pytest.approx(expected, rel=1e-16, abs=0.0)


def test_cosine_and_sine_of_turns():
    turns = np.random.default_rng(1).random(COUNT)
    found = np.array([cosine_sine_of_turns(value) for value in turns])
    angle = 2 * np.longdouble("3.14159265358979323846264338327950288") * turns.astype(np.longdouble)
    np.testing.assert_allclose(found[:, 0].astype(np.longdouble), np.cos(angle), rtol=0, atol=2.5e-16)
    np.testing.assert_allclose(found[:, 1].astype(np.longdouble), np.sin(angle), rtol=0, atol=2.5e-16)


def test_quarter_turns_are_exact():
    found = [cosine_sine_of_turns(value) for value in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert found == [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 0)]


def test_angle_on_the_unit_circle():
    generator = np.random.default_rng(2)
    angles = np.concatenate([generator.uniform(0, math.pi / 2, 1000), 10.0 ** generator.uniform(-12, 0, 1000)])
    found = np.array([angle_of(math.sin(angle), math.cos(angle)) for angle in angles])
    np.testing.assert_allclose(found, angles, rtol=1e-15)
