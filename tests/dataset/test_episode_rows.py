"""Log → rows → log, exact to float32; labels and observations beside what flew."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.episode import log_of_rows, rows_of, teaching_columns
from lerobot_spacedock.dataset.provenance import EpisodeRows, first_row
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError, InputError


def test_round_trip_is_exact_to_float32(flights):
    for log in flights:
        back = log_of_rows(rows_of(log), terminal_state=log.state[-1], metadata=log.metadata)
        for name in ("state", "action", "dt", "reward"):
            wanted = getattr(log, name)[:-1] if name == "state" else getattr(log, name)
            found = back.state[:-1] if name == "state" else getattr(back, name)
            np.testing.assert_array_equal(found, wanted.astype(np.float32).astype(np.float64))
        np.testing.assert_array_equal(back.state[-1], log.state[-1])
        np.testing.assert_allclose(back.time, log.time, rtol=1e-6, atol=1e-6)
        assert set(back.extra) == set(log.extra), "the label is carried where it differs from what flew"
        for name in log.extra:
            np.testing.assert_array_equal(back.extra[name], log.extra[name].astype(np.float32))


def test_the_label_is_clean_and_the_executed_command_is_kept_apart(flights):
    rows = rows_of(flights[0])
    disturbed = (rows[schema.ACTION] != rows[schema.EXECUTED_ACTION]).any(axis=1)
    assert 0 < disturbed.sum() < len(disturbed)


def test_the_policy_sees_its_sensors_and_the_truth_is_kept_apart():
    steps = 4
    generator = np.random.default_rng(1)
    state = generator.normal(size=(steps + 1, 14))
    seen = generator.normal(size=(steps, 13))
    log = EpisodeLog(
        np.arange(steps + 1.0), state, np.zeros((steps, 6)), np.ones(steps), np.zeros(steps), {},
        teaching_columns(label=np.zeros((steps, 6)), observed=seen),
    )  # fmt: skip
    rows = rows_of(log, with_mass=True)
    np.testing.assert_array_equal(np.delete(rows[schema.STATE], 6, axis=1), seen.astype(np.float32))
    np.testing.assert_array_equal(rows[schema.STATE][:, 6], state[:-1, 6].astype(np.float32))
    np.testing.assert_array_equal(rows[schema.TRUE_STATE], state[:-1].astype(np.float32))


def test_a_withheld_pose_is_in_no_observation_and_is_not_invented_again(flights):
    for options, size in (({}, 6), ({"with_mass": True}, 7)):
        rows = rows_of(flights[0], withhold_pose=True, **options)
        assert rows[schema.STATE].shape[1] == size
        np.testing.assert_array_equal(rows[schema.STATE][:, :3], flights[0].state[:-1, 3:6].astype(np.float32))
        np.testing.assert_array_equal(rows[schema.STATE][:, -3:], flights[0].state[:-1, 11:].astype(np.float32))
        log = log_of_rows(rows, terminal_state=flights[0].state[-1])
        np.testing.assert_array_equal(log.state[:-1], rows[schema.TRUE_STATE])
    noisy = rows | {schema.STATE: rows[schema.STATE] + np.float32(0.5)}
    again = log_of_rows(noisy, terminal_state=flights[0].state[-1])
    np.testing.assert_array_equal(
        rows_of(again, withhold_pose=True, **options)[schema.STATE][:, :3], noisy[schema.STATE][:, :3]
    )
    with pytest.raises(InputError, match="withhold_pose"):
        rows_of(again)
    del rows[schema.TRUE_STATE]
    with pytest.raises(InputError, match="without the pose"):
        log_of_rows(rows)


def test_without_a_terminal_state_the_last_frame_becomes_it(flights):
    rows = {
        name: rows_of(flights[0])[name] for name in (schema.STATE, schema.ACTION, schema.CONTROL_DT, schema.SIM_TIME)
    }
    log = log_of_rows(rows)
    assert log.num_steps == flights[0].num_steps - 1
    np.testing.assert_array_equal(log.state[-1, :6], flights[0].state[-2, :6].astype(np.float32))
    assert np.isnan(log.state[:, 6]).all(), "the mass is not in a 13-value state, and is not invented"


def test_one_row_of_an_episode_is_read_however_many_a_damaged_file_repeats(tmp_path):
    count = 300_000
    table = {"episode_index": np.repeat([0, 7], count // 2), "stats/x": np.zeros(count), "text": ["a" * 40] * count}
    pq.write_table(pa.table(table), tmp_path / "rows.parquet")
    before = pa.default_memory_pool().max_memory()
    assert first_row(tmp_path / "rows.parquet", 7, leave_out="stats/") == {"episode_index": 7, "text": "a" * 40}
    assert first_row(tmp_path / "rows.parquet", 3) is None
    assert pa.default_memory_pool().max_memory() - before < 40 * count / 2, "not all of them at once"


def test_an_episode_that_comes_twice_in_the_provenance_is_refused(tmp_path):
    pq.write_table(pa.table({"episode_index": [0, 1, 1, 2]}), tmp_path / "rows.parquet")
    with pytest.raises(FileFormatError, match=r"rows\.parquet: episode 1 comes after episode 1"):
        list(EpisodeRows(tmp_path / "rows.parquet"))
