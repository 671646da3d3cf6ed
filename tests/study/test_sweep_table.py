"""The table of a sweep: what varies, in order, with every training seed."""

import json
from pathlib import Path

import pytest

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.study.results import read_trials
from lerobot_spacedock.study.table import main, table


def trial(seed, number, docked):
    row = {
        "task": "SpaceDockContact-v0/same",
        "coefficient": 0.01,
        "episodes": 50,
        "idss": docked,
        "contact": 50,
        "distance_m": {"mean": 0.012 + seed / 1000, "p95": 0.02},
        "closing_m_s": {"median": 0.07},
        "smoothness": {"mean": 1.2, "std": 0.1},
    }
    point = {"seed": seed, "demonstrations": "kicked", "chunk_size": 5, "num_demonstrations": number, "steps": 2000}
    return {"point": point, "rows": [row, row | {"task": "SpaceDock-v0/same", "contact": 0}]}


def test_a_line_a_setting_with_every_seed(tmp_path, capsys):
    path = tmp_path / "sweep.json"
    path.write_text(json.dumps({"trials": [trial(1, 100, 50), trial(0, 100, 49), trial(0, 10, 5), trial(1, 10, 5)]}))
    assert main([str(path), "--tasks", "SpaceDockContact-v0/same"]) == 0
    head, _, *lines = capsys.readouterr().out.splitlines()
    assert head.startswith("| num demonstrations | task |")
    assert "steps" not in head
    assert [line.split(" | ")[0] for line in lines] == ["| 10", "| 100"]
    assert "| 98 / 100 | 100 | 1.2 / 1.3 | 2.0 | 0.070 | 1.20 |" in lines[1]
    assert "| 10 | 100 |" in lines[0]


def test_what_is_no_sweep_is_named(tmp_path, capsys):
    assert main([str(tmp_path / "none.json")]) == 2
    assert "none.json" in capsys.readouterr().err


def test_a_file_without_trials_is_told_of(tmp_path, capsys):
    path = tmp_path / "sweep.json"
    path.write_text('{"trials": []}')
    assert main([str(path)]) == 2
    assert "results: got no trial" in capsys.readouterr().err


def test_coefficients_are_picked(capsys):
    path = Path(__file__).parents[2] / "results" / "sweep_frontier.json"
    assert main([str(path), "--tasks", "SpaceDock-v0/same", "--coefficients", "0.01", "-1"]) == 0
    _, _, *lines = capsys.readouterr().out.splitlines()
    assert {line.split(" | ")[3] for line in lines} == {"+0.01", "-1"}
    assert main([str(path), "--coefficients", "0.5"]) == 2
    assert "--coefficients: got 0.5; allowed: -1.0 | -0.1 | 0.01 | 0.1" in capsys.readouterr().err


def test_a_task_that_was_not_flown_is_named():
    with pytest.raises(InputError, match="allowed: "):
        table(read_trials([Path(__file__).parents[2] / "results" / "sweep_number.json"]), ["SpaceDockContact-v0/sme"])
