"""The tables of the documents are what the results in git give; runs of several training seeds share a line."""

import json
import re
import runpy
from pathlib import Path

import pytest

from lerobot_spacedock.study.summarize import main
from lerobot_spacedock.study.trial import summary

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results.md"


@pytest.fixture(scope="module")
def published():
    """The tool's command line, on the repository's results."""
    tool = runpy.run_path(str(ROOT / "tools" / "published_tables.py"))

    def run(*arguments):
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(ROOT)
            patch.setattr("sys.argv", ["published_tables.py", *map(str, arguments)])
            return tool["main"]()

    return run


def test_every_table_of_the_results_is_what_its_file_gives(published):
    assert "<!-- table: " in RESULTS.read_text()
    assert published("--check", RESULTS) == 0


def test_a_table_that_differs_is_found_and_mended(published, tmp_path):
    changed = tmp_path / "results.md"
    text = RESULTS.read_text()
    changed.write_text(re.sub(r"(\| ACT \| same \| )100", r"\g<1>99", text))
    assert changed.read_text() != text
    assert published("--check", changed) == 1
    assert published(changed) == 0
    assert changed.read_text() == text


def row(run, starts, docked, distance):
    episode = {"final_distance_m": distance, "final_speed_m_s": 0.08, "final_closing_m_s": 0.08, "smoothness": 1.0}
    episodes = [episode | {"idss": i < docked, "crossed": True, "steps": 70} for i in range(10)]
    return {"run": run, "starts": starts} | summary(episodes)


def test_training_seeds_share_a_line_in_their_order(tmp_path, capsys):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    first.write_text(json.dumps([row("ACT, seed 0", "same", 10, 0.004), row("MPC", "same", 10, 0.001)]))
    second.write_text(json.dumps([row("ACT, seed 1", "same", 5, 1.4)]))
    assert main(["--results", str(first), str(second)]) == 0
    _, _, act, mpc = capsys.readouterr().out.splitlines()
    assert act.startswith("| ACT | same | 10 [69.2, 100.0] / 5 [18.7, 81.3] | 10 | 0.4 / 140 |")
    assert mpc.startswith("| MPC | same | 10 [69.2, 100.0] | 10 | 0.1 |")


@pytest.mark.parametrize("content", ["{", "{}", '[{"run": "ACT"}]', '["ACT"]'])
def test_what_is_no_summary_is_named(content, tmp_path, capsys):
    path = tmp_path / "other.json"
    path.write_text(content)
    assert main(["--results", str(path)]) == 2
    assert str(path) in capsys.readouterr().err
    assert main(["--results", str(tmp_path / "absent.json")]) == 2
