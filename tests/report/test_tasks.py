"""Runs of several tasks in one report: each is named, and none is set beside another without a word."""

import json

import pytest
from synthetic_logs import write_run

from lerobot_spacedock.cli import main
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.metrics.collect import collect
from lerobot_spacedock.report.build import ReportConfig, load_study
from lerobot_spacedock.report.comparison_tables import matched_table, pairs_table
from lerobot_spacedock.report.docking_tables import at_a_glance
from lerobot_spacedock.report.paper_tables import table3
from lerobot_spacedock.report.table import text_of

CONTACT = {"env_id": "SpaceDockContact-v0", "config": {"contact": True, "port": "harmony_forward"}}


def study_of(folder, **runs):
    """A study of runs by label, the same starts in each; values are what their logs say of themselves."""
    for label, metadata in runs.items():
        write_run(folder / label, range(4), jitter=float(len(label)), **metadata)
    return load_study(ReportConfig(runs=[f"{label}={folder / label}" for label in runs]))


def test_the_task_and_the_port_of_each_run_are_on_the_page_in_the_tables_and_in_the_numbers(tmp_path):
    write_run(tmp_path / "contact", range(2), **CONTACT)
    write_run(tmp_path / "fixed", range(2), jitter=1.0)
    runs = [f"ACT={tmp_path / 'contact'}", f"MPC={tmp_path / 'fixed'}"]
    assert main(["report", "--runs", *runs, f"--out={tmp_path / 'out'}", "--resamples=100"]) == 0
    shown = ("SpaceDockContact-v0 at harmony_forward, to contact", "SpaceDock-v0 at zvezda_aft")
    for file in ("index.html", "report.md"):
        text = (tmp_path / "out" / file).read_text()
        assert all(task in text for task in shown), file
    head = (tmp_path / "out" / "index.html").read_text().partition("<nav>")[0]
    assert all(task in head for task in shown)
    tasks = [run["task"] for run in json.loads((tmp_path / "out" / "report.json").read_text())["runs"]]
    assert tasks == [
        {"env_id": "SpaceDockContact-v0", "port": "harmony_forward", "contact": True},
        {"env_id": "SpaceDock-v0", "port": "zvezda_aft", "contact": False},
    ]


@pytest.mark.parametrize(
    "other",
    [
        {"env_id": "SpaceDockContact-v0"},
        {"config": {"port": "harmony_forward"}},
        {"config": {"contact": True}},
    ],
)
def test_runs_of_different_tasks_or_ports_get_no_paired_test(tmp_path, other):
    study = study_of(tmp_path, ACT={}, RL={}, other=other)
    table = matched_table(study)
    assert {text_of(row[1]) for row in table.rows} == {"ACT − RL"}
    said = [note for note in table.notes if "different tasks" in note]
    assert [note.partition(",")[0] for note in said] == ["ACT − other", "RL − other"]
    for own in (at_a_glance(study), pairs_table(study)):
        assert any("is the task's as well as the policy's" in note for note in own.notes), own.key


def test_runs_of_one_task_are_compared_as_ever(tmp_path):
    study = study_of(tmp_path, ACT={}, silent={"env_id": None})  # a log of other makers may not name its task
    assert matched_table(study).rows
    assert not any("task" in note for table in (at_a_glance(study), pairs_table(study)) for note in table.notes[1:])


def test_runs_to_contact_do_not_stand_beside_the_papers_65_steps_without_a_word(tmp_path):
    notes = table3(study_of(tmp_path / "a", ACT={}, RL=CONTACT)).notes
    assert "RL: a task that ends at contact" in notes[-1]
    assert "65 steps without contact" in notes[-1]
    assert "contact" not in " ".join(table3(study_of(tmp_path / "b", ACT={})).notes)


def test_episodes_at_two_ports_are_no_run(tmp_path):
    write_run(tmp_path, range(2))
    write_run(tmp_path, range(2, 4), config={"port": "harmony_forward"})
    with pytest.raises(InputError, match=r"SpaceDock-v0 at harmony_forward .*at one port"):
        collect([sorted(tmp_path.glob("*.parquet"))])
