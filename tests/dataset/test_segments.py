"""The terminal approach, by metres, seconds and steps."""

import numpy as np
import pytest

from lerobot_spacedock.dataset.segments import MIN_STEPS, Segment, pieces, tail
from lerobot_spacedock.errors import InputError


@pytest.mark.parametrize("text", ["last", "last:", "last:-3m", "last:0", "first:3", "last:3km", "last:3e1m"])
def test_other_forms_are_refused_with_the_right_ones(text):
    with pytest.raises(InputError, match="last:10m"):
        Segment.parse(text)


def test_metres_take_every_state_within_and_none_before(flights):
    for log in flights:
        first = Segment.parse("last:10m").first_step(log)
        distance = np.linalg.norm(log.state[:, :3], axis=1)
        assert (distance[first:] <= 10.0).all()
        assert distance[first - 1] > 10.0


def test_seconds_and_steps(flights):
    log = flights[0]
    assert tail(log, Segment.parse("last:12").first_step(log)).num_steps == 12
    part = tail(log, Segment.parse("last:20s").first_step(log))
    assert part.time[0] == 0.0
    assert 20.0 - log.dt.max() < part.time[-1] <= 20.0
    np.testing.assert_array_equal(part.state[-1], log.state[-1])


def test_more_than_there_is_takes_all_and_little_leaves_two(flights):
    log = flights[0]
    assert Segment.parse("last:9999").first_step(log) == 0
    assert Segment.parse("last:900m").first_step(log) == 0
    assert tail(log, Segment.parse("last:0.001s").first_step(log)).num_steps == MIN_STEPS


def test_oversampling_writes_the_whole_once_and_the_segment_again(flights):
    log = flights[0]
    found = pieces(log, Segment.parse("last:10m"), repeat_terminal=3)
    assert [first for first, _ in found] == [0, *[Segment.parse("last:10m").first_step(log)] * 3]
    with pytest.raises(InputError):
        pieces(log, Segment(), repeat_terminal=1)


def test_a_tail_of_a_tail_knows_where_it_begins_in_the_whole(flights):
    log = flights[0]
    twice = tail(tail(log, 5), 3)
    once = tail(log, 8)
    assert twice.metadata["segment_first_step"] == once.metadata["segment_first_step"] == 8
    assert twice.metadata["segment_start_s"] == pytest.approx(log.time[8])
    np.testing.assert_allclose(twice.time, once.time, atol=1e-12)
