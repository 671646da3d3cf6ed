"""HCW transition: against textbook cases, its group property, and an independent integrator."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s as N
from lerobot_spacedock.physics.relative_motion import hcw_transition_matrix

PERIOD_s = 2.0 * np.pi / N


def test_orbit_is_that_of_the_reference():
    assert pytest.approx(1.129117e-3, rel=1e-6) == N
    assert pytest.approx(5564.7, abs=0.05) == PERIOD_s


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0, 3000.0), st.floats(0.0, 3000.0))
def test_transitions_compose(a, b):
    product = hcw_transition_matrix(a, N) @ hcw_transition_matrix(b, N)
    whole = hcw_transition_matrix(a + b, N)
    scale = np.array([1, 1, 1, 1 / N, 1 / N, 1 / N])  # positions and velocities on one scale
    assert np.allclose(product * scale / scale[:, None], whole * scale / scale[:, None], atol=1e-10)


def test_a_point_on_v_bar_stays():
    assert np.allclose(hcw_transition_matrix(1234.5, N) @ [0, -25.0, 0, 0, 0, 0], [0, -25.0, 0, 0, 0, 0], atol=1e-12)


def test_radial_offset_drifts_twelve_pi_offsets_a_revolution():
    # released at rest in H, x0 above: secular drift -12 pi x0 along-track (Fehse 2003, sec. 3.3.1)
    end = hcw_transition_matrix(PERIOD_s, N) @ [10.0, 0, 0, 0, 0, 0]
    assert np.allclose(end[:3], [10.0, -12.0 * np.pi * 10.0, 0.0], atol=1e-8)


def test_drift_free_ellipse_closes_and_is_two_to_one():
    start = np.array([10.0, 0, 0, 0, -2.0 * N * 10.0, 0])  # vy0 = -2 n x0
    assert np.allclose(hcw_transition_matrix(PERIOD_s, N) @ start, start, atol=1e-9)
    quarter = hcw_transition_matrix(PERIOD_s / 4, N) @ start
    assert np.allclose(quarter[:2], [0.0, -20.0], atol=1e-9)


def test_out_of_plane_motion_is_harmonic():
    end = hcw_transition_matrix(PERIOD_s / 4, N) @ [0, 0, 3.0, 0, 0, 0]
    assert np.allclose(end[[2, 5]], [0.0, -3.0 * N], atol=1e-12)


def test_against_an_independent_integrator():
    def rates(_, s):
        return [*s[3:], 3 * N**2 * s[0] + 2 * N * s[4], -2 * N * s[3], -(N**2) * s[2]]

    start = np.array([1.0, -25.0, 2.0, 0.1, 0.3, -0.2])
    reference = solve_ivp(rates, (0.0, 600.0), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert np.allclose(hcw_transition_matrix(600.0, N) @ start, reference, rtol=0, atol=1e-9)
