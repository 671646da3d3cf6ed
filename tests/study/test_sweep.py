"""The sweep itself: nothing run twice, nothing lost, and a kill costs one trial."""

import dataclasses
import json
import os
import socket
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas
from optuna.trial import TrialState

from lerobot_spacedock import cli
from lerobot_spacedock.cli import parse_config
from lerobot_spacedock.dataset.disturbance import Disturbance, KickConfig, NoiseConfig
from lerobot_spacedock.dataset.flight import fly
from lerobot_spacedock.episode_log import log_path, write_episode_log
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.expert.controllers import make_expert
from lerobot_spacedock.study import demonstrations
from lerobot_spacedock.study import sweep as sweep_module
from lerobot_spacedock.study import table as table_module
from lerobot_spacedock.study.config import SweepConfig
from lerobot_spacedock.study.demonstrations import demos_config
from lerobot_spacedock.study.figure import FigureConfig, _draw, frontier, sweep_figure
from lerobot_spacedock.study.results import read_trials
from lerobot_spacedock.study.rollout import env_config
from lerobot_spacedock.study.summarize import main
from lerobot_spacedock.study.sweep import OWNER, POINT, open_study, requeue_abandoned, sweep
from lerobot_spacedock.study.trial import summary

SWEEPS = Path(__file__).parents[2] / "configs" / "sweeps"


@pytest.fixture
def config(tmp_path):
    return SweepConfig(
        name="little",
        output_dir=str(tmp_path),
        results=str(tmp_path / "little.json"),
        seeds=[0, 1],
        chunk_sizes=[5, 10],
        coefficients=[-0.3, 0.01],
        tasks=["SpaceDockContact-v0/same", "SpaceDock-v0/same"],
    )


def result_of(point, config):
    """As ``run_trial`` gives it; distance grows with the chunk, and smoothness with minus the coefficient."""
    rows = [
        {
            "task": task,
            "coefficient": c,
            "episodes": 100,
            "idss": 100 - point["chunk_size"],
            "contact": 100,
            "distance_m": {"mean": 0.01 * point["chunk_size"] + 0.001 * point["seed"], "p95": 0.5},
            "closing_m_s": {"median": 0.08},
            "smoothness": {"mean": 1.5 - c, "std": 0.1},
        }
        for task in config.tasks
        for c in config.weightings
    ]
    return {"point": point, "rows": rows}


def test_a_sweep_runs_each_point_once_and_goes_on_after_a_failure(config, monkeypatch):
    flown = []

    def breaks_at_the_third(point, config):
        flown.append((point["seed"], point["chunk_size"]))
        if len(flown) == 3:
            raise KeyboardInterrupt
        return result_of(point, config)

    monkeypatch.setattr(sweep_module, "run_trial", breaks_at_the_third)
    with pytest.raises(KeyboardInterrupt):
        sweep(config)
    assert len(read_trials([Path(config.results)])) == 2  # what is finished is there already
    assert sweep(config) == 0
    assert sweep(config) == 0  # nothing left
    assert flown == [(0, 5), (0, 10), (1, 5), (1, 5), (1, 10)] or flown == [(0, 5), (0, 10), (1, 5), (1, 10), (1, 5)]
    found = [(t["point"]["seed"], t["point"]["chunk_size"]) for t in read_trials([Path(config.results)])]
    assert found == [(0, 5), (0, 10), (1, 5), (1, 10)]  # in the order of the grid, whatever the order of the runs


def test_trials_of_a_killed_process_are_taken_up_again_and_those_of_a_living_one_are_not(config):
    study = open_study(config)
    for point in config.points():
        study.enqueue_trial(point, user_attrs={POINT: point})
    killed, alive, elsewhere = study.ask(), study.ask(), study.ask()
    killed.set_user_attr(OWNER, (socket.gethostname(), 2**22 + 1))  # beyond the kernel's greatest process id
    alive.set_user_attr(OWNER, (socket.gethostname(), os.getpid()))
    elsewhere.set_user_attr(OWNER, ("another-machine", 2**22 + 1))
    assert requeue_abandoned(study) == 1
    states = [trial.state for trial in study.get_trials()]
    assert states.count(TrialState.RUNNING) == 2
    assert states.count(TrialState.WAITING) == 2
    waiting = [t.user_attrs[POINT] for t in study.get_trials() if t.state == TrialState.WAITING]
    assert config.points()[killed.number] in waiting


def test_what_a_kill_and_a_full_disk_leave_in_the_journal_stops_nobody(config, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sweep_module, "run_trial", result_of)
    monkeypatch.setattr(sweep_module, "LOCK_GIVEN_UP_AFTER_s", 3)
    config = dataclasses.replace(config, output_dir="study", seeds=[0])
    open_study(config)
    with Path("study/little.journal").open("a") as journal:
        journal.write('{"op_code": 4, "work')  # the disk was full
    os.symlink(Path("study/little.journal").resolve(), "study/little.journal.lock")  # killed while it held the lock
    assert sweep(config) == 0
    assert len(read_trials([Path(config.results)])) == 2
    assert sweep(config) == 0


def test_a_search_stops_at_its_number_of_trials_and_finds_the_small_chunk(config, monkeypatch):
    monkeypatch.setattr(sweep_module, "run_trial", result_of)
    search = dataclasses.replace(config, name="search", sampler="tpe", num_trials=6)
    sweep(search)
    trials = open_study(search).get_trials()
    assert len(trials) == 6
    assert max(trial.values[0] for trial in trials) == pytest.approx(0.95)
    points = {json.dumps(trial.params, sort_keys=True) for trial in trials}
    assert len(points) < 6  # of four points: some come again
    assert len(read_trials([Path(search.results)])) == len(points)


def test_a_study_keeps_its_axes(config, monkeypatch):
    monkeypatch.setattr(sweep_module, "run_trial", result_of)
    sweep(config)
    with pytest.raises(InputError, match="new name"):
        sweep(dataclasses.replace(config, chunk_sizes=[5, 20]))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sampler", "guess"),
        ("demonstrations", ["tidy"]),
        ("chunk_sizes", []),
        ("tasks", ["SpaceDockVision-v0/same"]),
        ("coefficients", [-30.0]),
        ("evaluation_seed", 500_050),
        ("evaluation_seed", 499_901),
        ("evaluation_seed", 899_999),
        ("seeds", [0, 40]),
        ("num_demonstrations", [10_001]),
        ("steps", [0]),
        ("episodes", 0),
        ("tasks", []),
        ("dim_models", [50]),
        ("dropouts", [2.0]),
        ("learning_rates", [-1.0]),
        ("learning_rates", [float("nan")]),
        ("coefficients", [float("nan")]),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(config, field, value):
    with pytest.raises(InputError, match=f"--{field}"):
        dataclasses.replace(config, **{field: value})


@pytest.mark.parametrize("path", sorted(SWEEPS.glob("*.yaml")), ids=lambda path: path.stem)
def test_each_sweep_that_ships_can_be_read_and_names_itself(path):
    config = parse_config(SweepConfig, [f"--config_path={path}"], prog="spacedock sweep")
    assert config.name == path.stem
    assert len(config.points()) >= 3
    assert f"--config_path=configs/sweeps/{path.name}" in path.read_text()


def test_a_summary_counts_every_episode():
    row = {
        "crossed": True,
        "final_speed_m_s": 0.07,
        "final_closing_m_s": 0.07,
        "smoothness": 1.3,
        "steps": 66,
    }
    episodes = [row | {"idss": i < 9, "final_distance_m": 0.01 * (i + 1)} for i in range(10)]
    found = summary(episodes)
    assert (found["idss"], found["episodes"], found["contact"]) == (9, 10, 10)
    assert found["idss_interval"] == pytest.approx([0.5550, 0.9975], abs=1e-4)  # Clopper and Pearson, 9 of 10
    assert found["distance_m"]["mean"] == pytest.approx(0.055)
    assert found["distance_m"]["min"] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("axes", "shows"),
    [
        ({"tasks": ["SpaceDockContact-v0/wide"]}, "spacedock sweep-figure --results={}"),
        ({"steps": [2000, 4000]}, "python -m lerobot_spacedock.study.table {}"),
    ],
)
def test_the_next_command_of_a_sweep_works_and_leaves_published_figures_alone(
    config, monkeypatch, capsys, tmp_path, axes, shows
):
    monkeypatch.setattr(sweep_module, "run_trial", result_of)
    monkeypatch.chdir(tmp_path)
    assert sweep(dataclasses.replace(config, **axes)) == 0
    command = capsys.readouterr().out.splitlines()[-1]
    assert command == "Next: " + shows.format(config.results)
    if "sweep-figure" in shows:
        assert cli.main(["sweep-figure", f"--results={config.results}"]) == 0
        then = f"Next: python -m lerobot_spacedock.study.table {config.results}"
        assert capsys.readouterr().out.splitlines()[-1] == then
        assert (tmp_path / "outputs" / "figures" / "little.png").is_file()
        assert not (tmp_path / "docs").exists()
    else:
        assert table_module.main([config.results]) == 0


def test_the_figure_has_a_curve_for_each_chunk_with_all_its_seeds(config, monkeypatch, tmp_path):
    monkeypatch.setattr(sweep_module, "run_trial", result_of)
    sweep(config)
    curves = frontier(read_trials([Path(config.results)]), "SpaceDock-v0/same")
    assert set(curves) == {("kicked", 5), ("kicked", 10)}
    smoothness, distance = curves["kicked", 10][-0.3]
    np.testing.assert_allclose(smoothness, [1.8, 1.8])
    np.testing.assert_allclose(sorted(distance), [0.1, 0.101])
    drawn = FigureConfig(results=[config.results], out=str(tmp_path / "not" / "there"), tasks=config.tasks)
    assert sweep_figure(drawn) == 0
    assert (tmp_path / "not" / "there" / "little.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="tidy"):
        sweep_figure(dataclasses.replace(drawn, demonstrations=["tidy"]))
    with pytest.raises(InputError, match="--tasks"):
        sweep_figure(dataclasses.replace(drawn, tasks=["SpaceDockMeta-v0/same"]))
    longer = dataclasses.replace(
        config, name="longer", steps=[4000], chunk_sizes=[5], results=str(tmp_path / "longer.json")
    )
    sweep(longer)
    with pytest.raises(InputError, match="differ in steps"):  # its points would be means over two lengths of training
        sweep_figure(dataclasses.replace(drawn, results=[config.results, longer.results]))
    with pytest.raises(InputError, match="twice"):  # the same trial would pass for another seed
        read_trials([Path(config.results), Path(config.results)])


@pytest.mark.parametrize(("task", "limit"), [("SpaceDockContact-v0/same", True), ("SpaceDockContact-v0/wide", False)])
def test_the_legend_names_what_a_panel_shows_and_no_more(config, monkeypatch, task, limit):
    def far_from_wide(point, config):
        found = result_of(point, config)
        for row in found["rows"]:
            row["distance_m"]["mean"] *= 100.0 if row["task"].endswith("wide") else 1.0
        return found

    monkeypatch.setattr(sweep_module, "run_trial", far_from_wide)
    sweep(dataclasses.replace(config, tasks=["SpaceDockContact-v0/same", "SpaceDockContact-v0/wide"]))
    trials = read_trials([Path(config.results)])
    axes = Canvas().add_axes((0.1, 0.1, 0.8, 0.8))
    _draw(axes, task=task, kind="kicked", chunks=[5, 10], by_task={task: frontier(trials, task)})
    named = [text.get_text() for text in axes.get_legend().get_texts()]
    assert named == ["chunk 5", "chunk 10", "coefficient 0.01", *["IDSS lateral limit"] * limit]
    assert len([line for line in axes.lines if line.get_marker() == "o" and line.get_markersize() == 10]) == 2 + 1


def test_a_point_that_only_ever_failed_comes_into_the_queue_again_and_no_other(config):
    study = open_study(config)
    point = config.points()[0]
    sweep_module._enqueue(study, point)
    sweep_module._enqueue(study, point)
    assert len(study.trials) == 1
    study.tell(study.ask(), state=TrialState.FAIL)
    sweep_module._enqueue(study, point)  # a process was killed between telling of the failure and this
    assert [trial.state for trial in study.trials] == [TrialState.FAIL, TrialState.WAITING]
    trial = study.ask()
    sweep_module._enqueue(study, point)
    study.tell(trial, (1.0, 1.0))
    sweep_module._enqueue(study, point)
    assert [trial.state for trial in study.trials] == [TrialState.FAIL, TrialState.COMPLETE]


def test_two_processes_that_find_the_same_dead_trial_are_both_content(config, monkeypatch):
    study = open_study(config)
    point = config.points()[0]
    sweep_module._enqueue(study, point)
    trial = study.ask()
    trial.set_user_attr(OWNER, (socket.gethostname(), 2**22 + 1, None))
    stale = study.get_trials(states=(TrialState.RUNNING,))
    assert requeue_abandoned(study) == 1
    real = study.get_trials
    monkeypatch.setattr(
        study, "get_trials", lambda **options: stale if options.get("deepcopy", True) else real(**options)
    )
    assert requeue_abandoned(study) == 1  # as the second process saw it
    assert [trial.state for trial in real()] == [TrialState.FAIL, TrialState.WAITING]


def test_a_file_that_is_no_result_is_named(tmp_path):
    path = tmp_path / "other.json"
    path.write_text(json.dumps([1, 2]))
    with pytest.raises(FileFormatError, match=r"other\.json"):
        read_trials([path])
    row = {"task": "t", "coefficient": 0.01, "episodes": 2, "idss": 1, "contact": 2, "closing_m_s": {"median": None}}
    row |= {"smoothness": {"mean": 1.3}, "distance_m": {"mean": 0.1, "p95": 0.2}}
    point = {"seed": 0, "demonstrations": "clean", "chunk_size": 5}

    def write(**other):
        path.write_text(json.dumps({"trials": [{"point": point, "rows": [row | other]}]}))

    write()
    assert read_trials([path]) == [{"point": point, "rows": [row]}]
    for other, named in (
        ({"smoothness": {"mean": float("nan")}}, "smoothness"),
        ({"distance_m": {"mean": 0.1}}, "p95"),
        ({"contact": 3}, "contact"),
        ({"episodes": 0, "idss": 0, "contact": 0}, "episodes"),
        ({"coefficient": "a"}, "str"),
        ({"closing_m_s": None}, "NoneType"),
    ):
        write(**other)
        with pytest.raises(FileFormatError, match=rf"other\.json.*{named}"):
            read_trials([path])
    with pytest.raises(InputError, match=r"missing\.json"):
        read_trials([tmp_path / "missing.json"])


def test_logs_become_rows_and_a_table(tmp_path, capsys):
    env, seeds = env_config("SpaceDockContact-v0", "random"), np.arange(3)
    calm = Disturbance.draw(seeds, env.max_steps, KickConfig(), NoiseConfig())
    for log in fly(make_expert("W", env), env, seeds, calm):
        write_episode_log(log_path(tmp_path, log.metadata["seed"]), log)
    write_episode_log(log_path(tmp_path / "surplus", 3), log)
    assert main(["--runs", f"W={tmp_path}", "--out", str(tmp_path / "w.json")]) == 0
    (row,) = json.loads((tmp_path / "w.json").read_text())
    assert (row["run"], row["starts"], row["idss"], row["contact"], row["episodes"]) == ("W", "random", 3, 3, 3)
    shown = capsys.readouterr()
    assert "| W | random | 3 [29.2, 100.0] | 3 |" in shown.out
    assert "surplus/episode_000003.parquet" in shown.err, "left out and named"
    assert main(["--runs", f"W={tmp_path}/nothing"]) == 2
    capsys.readouterr()
    assert main(["--runs", f"W={tmp_path}", f"W={tmp_path}/."]) == 2
    assert "twice; allowed: each folder once" in capsys.readouterr().err
    assert main(["--runs", f"W={tmp_path}", "--out", str(tmp_path)]) == 2
    assert "--out: got" in capsys.readouterr().err


def test_a_sweep_that_could_not_write_its_results_flies_nothing(config, monkeypatch, tmp_path):
    monkeypatch.setattr("lerobot_spacedock.study.sweep.run_trial", lambda *_: pytest.fail("flown"))
    with pytest.raises(InputError, match="--results"):
        sweep(dataclasses.replace(config, results=str(tmp_path)))


def test_stored_demonstrations_are_told_apart_by_what_flew_them(monkeypatch, tmp_path):
    law, learnt = demos_config("kicked_W", 2, 0), demos_config("kicked_gentle", 2, 0)
    names = {demonstrations._fingerprint(config) for config in (law, learnt, demos_config("kicked", 2, 0))}
    assert len(names) == 3
    (tmp_path / "feedback.py").write_text("# another law")
    monkeypatch.setattr(demonstrations.expert, "__file__", str(tmp_path / "__init__.py"))
    assert demonstrations._fingerprint(law) not in names
    assert demonstrations._fingerprint(learnt) in names
    monkeypatch.setattr(demonstrations, "__version__", "another")
    assert demonstrations._fingerprint(learnt) not in names


def test_a_process_that_has_the_number_of_a_dead_one_is_another(config):
    study = open_study(config)
    for point in config.points():
        study.enqueue_trial(point, user_attrs={POINT: point})
    same, recycled, unsigned = study.ask(), study.ask(), study.ask()
    same.set_user_attr(OWNER, (socket.gethostname(), os.getpid(), sweep_module._began(os.getpid())))
    recycled.set_user_attr(OWNER, (socket.gethostname(), os.getpid(), "another boot 123"))
    assert requeue_abandoned(study) == 1
    states = {trial.number: trial.state for trial in study.get_trials()}
    assert [states[t.number] for t in (same, recycled, unsigned)] == [
        TrialState.RUNNING,
        TrialState.FAIL,
        TrialState.RUNNING,  # a moment old: its process may be about to sign
    ]
