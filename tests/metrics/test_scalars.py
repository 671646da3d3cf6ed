"""In-training evaluations as TensorBoard scalars, read back by TensorBoard's own reader."""

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from lerobot_spacedock.episode_log import EpisodeLog, log_path, write_episode_log
from lerobot_spacedock.metrics.scalars import main, write_scalars


def write_evaluation(folder, distances):
    for seed, distance in enumerate(distances):
        state = np.zeros((3, 14))
        state[:, 1], state[:, 6], state[:, 7] = (-25.0, -10.0, -distance), 1000.0, 1.0
        log = EpisodeLog(
            np.arange(3.0), state, np.ones((2, 6)), np.ones(2), np.zeros(2), {"initial_conditions": "same"}
        )
        write_episode_log(log_path(folder, seed), log)


def read(folder):
    events = EventAccumulator(str(folder))
    events.Reload()
    return {
        tag: [(e.step, float(e.tensor_proto.float_val[0])) for e in events.Tensors(tag)]
        for tag in events.Tags()["tensors"]
    }


def test_each_evaluation_is_a_point_at_its_training_step(tmp_path):
    write_evaluation(tmp_path / "evaluation_0001", [2.0, 4.0])
    write_evaluation(tmp_path / "evaluation_0002", [1.0])
    assert main([str(tmp_path), "--eval_freq=500"]) == 0
    scalars = read(tmp_path / "tensorboard")
    assert scalars["spacedock_same/final_distance_m"] == [(500, 3.0), (1000, 1.0)]
    assert scalars["spacedock_same/episodes"] == [(500, 2.0), (1000, 1.0)]
    assert scalars["spacedock_same/idss"] == [(500, 0.0), (1000, 0.0)]
    assert "spacedock_same/crossing_time_s" not in scalars  # never defined here


def test_what_was_written_is_not_written_again(tmp_path):
    write_evaluation(tmp_path / "evaluation_0001", [2.0])
    done = set()
    assert write_scalars(tmp_path, tmp_path / "tb", done=done) == [1]
    write_evaluation(tmp_path / "evaluation_0002", [2.0])
    assert write_scalars(tmp_path, tmp_path / "tb", done=done) == [2]
    assert write_scalars(tmp_path, tmp_path / "tb", done=done) == []


@pytest.mark.parametrize("option", ["--follow=-1", "--follow=0", "--follow=nan", "--eval_freq=0"])
def test_a_pace_that_cannot_be_kept_is_refused(tmp_path, option, capsys):
    write_evaluation(tmp_path / "evaluation_0001", [2.0])
    assert main([str(tmp_path), option]) == 2
    assert option.partition("=")[0] in capsys.readouterr().err


@pytest.mark.parametrize("folder", ["", "missing"])
def test_nothing_to_read_is_said(tmp_path, folder, capsys):
    assert main([str(tmp_path / folder)]) == 2
    assert "error:" in capsys.readouterr().err
