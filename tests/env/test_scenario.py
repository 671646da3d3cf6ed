"""What is drawn per episode: ranges as published, distributions as named, independence of what else is drawn."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.env.random import STREAM_START, bits, normal_pair, uniform
from lerobot_spacedock.env.scenario_config import MetaRanges
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics import chaser as p
from lerobot_spacedock.physics.frames import state_to_dataset_units

COUNT = 3000


def drawn(**options):
    batch = BatchedSpaceDock(COUNT, TaskConfig(**options))
    batch.reset(np.arange(COUNT))
    return batch


def assert_uniform(values, low, high):
    assert values.min() >= low
    assert values.max() <= high
    assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > 1e-4


# Table 2 of the paper, and what the published rollouts add to it
@pytest.mark.parametrize(
    ("name", "lateral", "axial", "dispersed"),
    [
        ("same", 1.0, (-26.0, -24.0), False),
        ("random", 2.5, (-27.5, -22.5), True),
        ("same_dispersed", 1.0, (-26.0, -24.0), True),
    ],
)
def test_starts_fill_the_published_boxes(name, lateral, axial, dispersed):
    state = drawn(initial_conditions=name).sim.state
    for column in (0, 2):
        assert_uniform(state[:, column], -lateral, lateral)
    assert_uniform(state[:, 1], *axial)
    turn = Rotation.from_quat([np.sqrt(0.5), -np.sqrt(0.5), 0, 0], scalar_first=True).inv()
    angles = (turn * Rotation.from_quat(state[:, 7:11], scalar_first=True)).as_euler("XYZ", degrees=True)
    rates = np.rad2deg(state[:, 11:])
    if dispersed:
        for column, (low, high) in zip((3, 4, 5), ((-0.1, 0.1), (0.0, 0.2), (-0.1, 0.1)), strict=True):
            assert_uniform(state[:, column], low, high)
        for j in range(3):
            assert_uniform(angles[:, j], -1.0, 1.0)
            assert_uniform(rates[:, j], -0.1, 0.1)
    else:
        assert (state[:, 3:6] == 0.0).all()
        assert np.abs(angles).max() < 1e-6
        assert (rates == 0.0).all()
    assert (state[:, 6] == 1000.0).all()


def test_harmony_starts_mirror_zvezdas():
    aft, forward = drawn(initial_conditions="random"), drawn(initial_conditions="random", port="harmony_forward")
    half_turn = np.array([1.0, -1.0, -1.0])
    assert np.allclose(forward.sim.state[:, :3], aft.sim.state[:, :3] * half_turn)
    assert np.allclose(forward.sim.state[:, 3:6], aft.sim.state[:, 3:6] * half_turn)
    reports = [b.report(b.sim.state) for b in (aft, forward)]
    for name in ("axial_m", "lateral_m", "closing_speed_m_s", "pitch_yaw_deg", "roll_deg"):
        assert np.allclose(reports[0][name], reports[1][name], atol=1e-9), name


def test_meta_chasers_fill_their_ranges():
    ranges = MetaRanges()
    batch = drawn(dynamics="meta")
    params, sensor = batch.sim.parameters, batch.sim.sensor
    assert_uniform(batch.sim.state[:, 6], 800.0, 1200.0)
    inertia = params[:, p.INERTIA : p.INERTIA + 9].reshape(-1, 3, 3)
    for j in range(3):
        assert_uniform(inertia[:, j, j], 666.667 * 0.8 - 1e-3, 666.667 * 1.2 + 1e-3)
        assert_uniform(params[:, p.TORQUE_BIAS + j], -ranges.torque_bias_Nm, ranges.torque_bias_Nm)
        assert_uniform(params[:, p.COM_OFFSET + j], -ranges.com_offset_m, ranges.com_offset_m)
        assert_uniform(params[:, p.TORQUE_MAP + 4 * j], *ranges.torque_scale)
        assert_uniform(sensor[:, j], -ranges.position_bias_m, ranges.position_bias_m)
    inverse = params[:, p.INERTIA_INVERSE : p.INERTIA_INVERSE + 9].reshape(-1, 3, 3)
    assert np.allclose(inertia @ inverse, np.eye(3), atol=1e-12)
    assert (np.linalg.eigvalsh(inertia) > 0.0).all()
    # thrust map = rotation by a small normal vector, columns scaled
    maps = params[:, p.THRUST_MAP : p.THRUST_MAP + 9].reshape(-1, 3, 3)
    scale = np.linalg.norm(maps, axis=1)
    for j in range(3):
        assert_uniform(scale[:, j], *ranges.thrust_scale)
    tilt = Rotation.from_matrix(maps / scale[:, None, :]).as_rotvec(degrees=True)
    assert stats.kstest(tilt.ravel(), stats.norm(0, ranges.thrust_misalignment_deg).cdf).pvalue > 1e-4
    draws = np.column_stack([batch.sim.state[:, 6], inertia[:, 0, 0], scale, params[:, p.TORQUE_BIAS], sensor[:, :3]])
    correlation = np.corrcoef(draws.T) - np.eye(draws.shape[1])
    assert np.abs(correlation).max() < 0.08  # 4.4 standard deviations at 3,000


def test_sensor_noise_has_the_stated_spread():
    batch = drawn(dynamics="meta")
    observed = batch.observe(np.arange(14))
    errors = observed[:, :3] - batch.sim.state[:, :3] - batch.sim.sensor[:, :3]
    distance = np.linalg.norm(batch.sim.state[:, :3], axis=1, keepdims=True)
    assert stats.kstest((errors / (0.01 + 0.001 * distance)).ravel(), stats.norm.cdf).pvalue > 1e-4
    assert np.array_equal(observed, batch.observe(np.arange(14)))  # reading again draws nothing new


# a meta distribution of nominal chasers with perfect sensors, into which a test puts what it looks at
NOTHING = {name: 0.0 for name in MetaRanges.__dataclass_fields__} | {"thrust_scale": (1, 1), "torque_scale": (1, 1)}


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("position_bias_m", [0, 1, 2]),
        ("position_noise_m", [0, 1, 2]),
        ("position_noise_fraction", [0, 1, 2]),
        ("velocity_bias_m_s", [3, 4, 5]),
        ("velocity_noise_m_s", [3, 4, 5]),
        ("attitude_bias_deg", [7, 8, 9, 10]),
        ("attitude_noise_deg", [7, 8, 9, 10]),
        ("rate_bias_deg_s", [11, 12, 13]),
        ("rate_noise_deg_s", [11, 12, 13]),
    ],
)
def test_each_sensor_error_acts_alone_and_as_large_as_stated(name, columns):
    size = 0.1  # of the name's unit
    batch = drawn(dynamics="meta", meta=MetaRanges(**NOTHING | {name: size}))
    observed, truth = batch.observe(np.arange(14)), state_to_dataset_units(batch.sim.state)
    wrong = observed != truth.astype(np.float32)
    assert wrong[:, columns].any(axis=1).all()
    assert not np.delete(wrong, columns, axis=1).any()
    error = (observed - truth)[:, columns]
    if "attitude" in name:
        true, seen = (Rotation.from_quat(q[:, columns], scalar_first=True) for q in (truth, observed))
        error = (true.inv() * seen).as_rotvec(degrees=True)
    if "fraction" in name:
        error /= np.linalg.norm(truth[:, :3], axis=1, keepdims=True)
    for j in range(3):
        if "bias" in name:
            assert_uniform(error[:, j], -size - 1e-5, size + 1e-5)  # single precision
        else:
            assert stats.kstest(error[:, j], stats.norm(0, size).cdf).pvalue > 1e-4


def test_an_offset_centre_of_mass_acts_alone():
    """A cube, nominal but for the offset d: thrust T turns it at -d × T / J."""
    ranges = MetaRanges(**NOTHING | {"com_offset_m": 0.02})
    batch = BatchedSpaceDock(40, TaskConfig(dynamics="meta", meta=ranges, time_step="fixed"))
    batch.reset(np.arange(40))
    thrust = np.array([10.0, -20.0, 5.0])
    batch.step(np.tile([*thrust, 0.0, 0.0, 0.0], (40, 1)))
    offset = batch.sim.parameters[:, p.COM_OFFSET : p.COM_OFFSET + 3]
    assert np.abs(offset).max() > 0.01
    expected = np.cross(-offset, thrust) / (2000.0 / 3.0) * 0.907
    np.testing.assert_allclose(batch.sim.state[:, 11:], expected, rtol=1e-9, atol=1e-15)


def test_step_lengths_are_those_of_the_rollouts():
    batch = BatchedSpaceDock(200)
    batch.reset(np.arange(200))
    steps = []
    for _ in range(60):
        batch.step(np.zeros((200, 6)))
        steps.append(batch.sim.dt.copy())
    steps = np.concatenate(steps)
    assert steps.mean() == pytest.approx(0.907, abs=0.003)
    assert steps.std() == pytest.approx(0.077, abs=0.003)
    assert steps.min() >= 0.6
    assert steps.max() <= 1.25
    assert abs(np.corrcoef(steps[:-200], steps[200:])[0, 1]) < 0.05


def test_generator_is_uniform_normal_and_counter_based():
    key = np.uint64(12345)
    values = np.array([uniform(key, STREAM_START, i) for i in range(20000)])
    assert stats.kstest(values, "uniform").pvalue > 1e-3
    assert stats.chisquare(np.bincount((values * 64).astype(int), minlength=64)).pvalue > 1e-3
    normals = np.array([normal_pair(key, 1, i) for i in range(10000)])
    assert stats.kstest(normals.ravel(), "norm").pvalue > 1e-3
    assert abs(np.corrcoef(normals.T)[0, 1]) < 0.04
    words = np.array([int(bits(np.uint64(k), 0, 0)) for k in range(4096)], dtype=np.uint64)
    assert len(set(words.tolist())) == 4096
    ones = np.unpackbits(words.view(np.uint8)).mean()
    assert ones == pytest.approx(0.5, abs=0.005)  # neighbouring keys look unrelated


def test_unknown_names_list_the_known():
    with pytest.raises(InputError, match=r"same \| random \| same_dispersed"):
        TaskConfig(initial_conditions="samee")
    with pytest.raises(InputError, match=r"nominal \| meta"):
        TaskConfig(dynamics="met")
