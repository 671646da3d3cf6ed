"""Contact quantities and boxes: hand-made states with known answers, limits from the standard."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.constants import MEAN_MOTION_rad_s
from lerobot_spacedock.physics.contact import (
    HARMONY_FORWARD,
    PORTS,
    ZVEZDA_AFT,
    contact_report,
    contact_state,
    get_port,
)

GOOD = {"closing": 0.075, "lateral": 0.0, "drift": 0.0, "tilt": 0.0, "roll": 0.0, "tilt_rate": 0.0, "roll_rate": 0.0}


def state_at(port, *, axial=0.0, **changes):
    """A state with the given contact quantities, built in the -V-bar axes and turned to the port."""
    want = GOOD | changes
    r = np.array([want["lateral"], -axial, 0.0])
    v = np.array([0.0, want["closing"], want["drift"]])
    if port is HARMONY_FORWARD:  # half a turn about x
        r, v = r * [1, -1, -1], v * [1, -1, -1]
    nominal = Rotation.from_quat(port.q_nominal, scalar_first=True)
    tilt = Rotation.from_rotvec(np.deg2rad(want["tilt"]) * np.array([0.6, 0.8, 0.0]))
    q = nominal * tilt * Rotation.from_rotvec([0, 0, np.deg2rad(want["roll"])])
    w = np.deg2rad([0.6 * want["tilt_rate"], -0.8 * want["tilt_rate"], want["roll_rate"]])
    return np.concatenate([r, v, [1000.0], q.as_quat(scalar_first=True), w])


@pytest.mark.parametrize("port", PORTS.values(), ids=PORTS)
def test_quantities_of_a_known_state(port):
    changes = {
        "closing": 0.08,
        "lateral": 0.05,
        "drift": 0.02,
        "tilt": 3.0,
        "roll": -2.0,
        "tilt_rate": 0.1,
        "roll_rate": 0.15,
    }
    contact = contact_state(state_at(port, axial=1.5, **changes), port, hill_coupling=False)
    expected = [1.5, 0.08, 0.05, 0.02, 3.0, -2.0, 0.1, 0.15]
    assert np.allclose(list(contact.values()), expected, atol=1e-12)


@pytest.mark.parametrize("port", PORTS.values(), ids=PORTS)
@pytest.mark.parametrize(
    ("condition", "quantity", "inside", "outside"),
    [
        ("closing_speed", "closing", 0.0999, 0.1001),
        ("closing_speed", "closing", 0.0501, 0.0499),
        ("lateral", "lateral", 0.0999, 0.1001),
        ("lateral_speed", "drift", 0.0399, 0.0401),
        ("pitch_yaw", "tilt", 3.99, 4.01),
        ("roll", "roll", -3.99, -4.01),
        ("pitch_yaw_rate", "tilt_rate", 0.199, 0.201),
        ("roll_rate", "roll_rate", -0.199, -0.201),
    ],
)
def test_each_idss_condition_alone(port, condition, quantity, inside, outside):
    for value, passes in ((inside, True), (outside, False)):
        report = contact_report(contact_state(state_at(port, **{quantity: value}), port, hill_coupling=False))
        conditions = {k: bool(v) for k, v in report.items() if k.startswith("idss_")}
        failed = {k for k, v in conditions.items() if not v}
        assert failed == (set() if passes else {f"idss_{condition}"})
        assert bool(report["idss"]) is passes
    assert len(conditions) == 7


def test_atv_box_asks_for_speed_and_place_only():
    tumbling = contact_report(contact_state(state_at(ZVEZDA_AFT, tilt=20.0, roll_rate=5.0), hill_coupling=False))
    assert bool(tumbling["atv"])
    assert not bool(tumbling["idss"])
    wide = contact_report(contact_state(state_at(ZVEZDA_AFT, lateral=0.12), hill_coupling=False))
    assert not bool(wide["atv"])


def test_off_the_plane_the_whole_distance_counts():
    contact = contact_state(state_at(ZVEZDA_AFT, axial=0.08, lateral=0.08), hill_coupling=False)
    assert bool(contact_report(contact)["idss"])
    assert not bool(contact_report(contact, at_plane=False)["idss"])  # 0.113 m


def test_rates_are_relative_to_a_station_that_turns():
    state = state_at(ZVEZDA_AFT)
    turn = Rotation.from_quat(state[7:11], scalar_first=True)
    state[11:] = turn.inv().apply([0, 0, MEAN_MOTION_rad_s])
    at_rest = contact_state(state, hill_coupling=True)
    assert np.hypot(at_rest["pitch_yaw_rate_deg_s"], at_rest["roll_rate_deg_s"]) < 1e-12
    inertial = contact_state(state, hill_coupling=False)
    assert inertial["pitch_yaw_rate_deg_s"] == pytest.approx(np.rad2deg(MEAN_MOTION_rad_s))


def test_roll_stays_itself_across_the_whole_turn():
    rolls = np.linspace(-179.0, 179.0, 25)
    states = np.array([state_at(ZVEZDA_AFT, roll=r) for r in rolls])
    assert np.allclose(contact_state(states, hill_coupling=False)["roll_deg"], rolls, atol=1e-9)
    states[:, 7:11] *= -1.0  # the same attitudes
    assert np.allclose(contact_state(states, hill_coupling=False)["roll_deg"], rolls, atol=1e-9)


def test_unknown_port_lists_the_known():
    with pytest.raises(InputError, match=r"zvezda_aft \| harmony_forward"):
        get_port("zarya")
