"""``--select``: episodes made by hand, whose order under each rule is known."""

import numpy as np
import pytest

from lerobot_spacedock.dataset.episode import teaching_columns
from lerobot_spacedock.dataset.selection import RULES, best, score
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import InputError


def episode(*, start_m: float, end_m: float, used_kg: float, label, executed, reward: float) -> EpisodeLog:
    """Three steps along a line through the port that is none of the axes.

    Args:
        start_m: m, distance at the start.
        end_m: m, distance at the end.
        used_kg: kg of propellant.
        label: (Tx N, Lz N·m), which the label takes on in its second step and keeps.
        executed: the same for what flew.
        reward: of each step.
    """
    state = np.zeros((4, 14))
    state[:, :3] = np.outer([start_m, start_m, end_m, end_m], [2.0, -3.0, 6.0]) / 7.0
    state[:, 6] = [1000.0, 999.0, 998.0, 1000.0 - used_kg]
    commands = np.zeros((2, 3, 6))
    commands[0, 1:, [0, 5]] = np.reshape(label, (2, 1))
    commands[1, 1:, [0, 5]] = np.reshape(executed, (2, 1))
    extra = teaching_columns(label=commands[0])
    return EpisodeLog(np.arange(4.0), state, commands[1], np.ones(3), np.full(3, reward), extra=extra)


FLIGHTS = [
    episode(start_m=21.0, end_m=0.7, used_kg=2.5, label=(36.0, 16.0), executed=(6.0, 0.0), reward=-1.0),
    episode(start_m=14.0, end_m=7.0, used_kg=3.5, label=(30.0, 0.0), executed=(12.0, 0.0), reward=4.0),
    episode(start_m=7.0, end_m=1.4, used_kg=2.0, label=(0.0, 12.0), executed=(18.0, 0.0), reward=3.0),
    episode(start_m=28.0, end_m=2.8, used_kg=5.0, label=(0.0, 2.0), executed=(60.0, 0.0), reward=-7.0),
]


@pytest.mark.parametrize(
    ("rule", "order"),
    [
        ("first", [0, 1, 2, 3]),
        ("distance", [0, 2, 3, 1]),
        ("propellant", [2, 0, 1, 3]),
        ("smoothness", [3, 1, 2, 0]),
        ("return", [1, 2, 0, 3]),
    ],
)
def test_each_rule_keeps_the_best_by_its_own_number(rule, order):
    scores = [score(log, rule) for log in FLIGHTS]
    for keep in range(5):
        assert best(scores, [True] * 4, keep, successes_first=True) == sorted(order[:keep])


def test_every_rule_has_a_known_order_here():
    assert set(RULES) == {"first", "distance", "propellant", "smoothness", "return"}


def test_scores_are_the_numbers_that_the_rules_name():
    """One of two changes of the label is none, the other 36 of 60 N and 16 of 20 N·m: 0.6 and 0.8, whose norm is 1."""
    first = {rule: score(FLIGHTS[0], rule) for rule in RULES}
    assert first == pytest.approx({"first": 0, "distance": 0.7, "propellant": 2.5, "smoothness": 0.5, "return": 3})


def test_the_executed_command_counts_where_no_label_is():
    log = FLIGHTS[1]
    unlabelled = EpisodeLog(log.time, log.state, log.action, log.dt, log.reward)
    assert score(unlabelled, "smoothness") == pytest.approx(0.5 * 12.0 / 60.0)


def test_a_single_step_changes_nothing():
    log = FLIGHTS[0]
    single = EpisodeLog(log.time[:2], log.state[:2], log.action[:1], log.dt[:1], log.reward[:1])
    assert score(single, "smoothness") == 0.0


def test_successes_rank_before_failures_only_if_asked():
    scores, successes = [1.0, 5.0, 2.0, 4.0], [False, True, False, True]
    assert best(scores, successes, 1, successes_first=True) == [3]
    assert best(scores, successes, 2, successes_first=True) == [1, 3]
    assert best(scores, successes, 3, successes_first=True) == [0, 1, 3]
    assert best(scores, successes, 2, successes_first=False) == [0, 2]
    assert best(scores, successes, 9, successes_first=True) == [0, 1, 2, 3]


def test_ties_go_to_the_earlier():
    assert best([2.0, 1.0, 1.0, 1.0], [True] * 4, 2, successes_first=True) == [1, 2]


def test_an_unknown_rule_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="least propellant"):
        score(FLIGHTS[0], "luck")
