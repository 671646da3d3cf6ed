"""``python -m lerobot_spacedock.expert.evaluate``: its options."""

import json

import pytest

from lerobot_spacedock.expert import evaluate
from lerobot_spacedock.expert.evaluate import main


def test_a_checkpoint_that_no_policy_would_fly_is_refused(capsys):
    options = ["--tasks=fixed same", "--episodes=1", "--checkpoint=/nonexistent"]
    assert main(["--policies=W,mpc", *options]) == 2
    said = capsys.readouterr().err
    assert "--checkpoint: got /nonexistent; allowed: nothing, unless --policies names a meta_rl" in said
    assert main(["--policies=W,meta_rl", *options]) == 2


@pytest.mark.parametrize(
    "options",
    [
        ["--tasks=fixed same,typo"],
        ["--tasks=fixed same", "--policies=W,typo"],
        ["--tasks=fixed same", "--policies=W,meta_rl", "--checkpoint=/nonexistent"],
    ],
)
def test_what_cannot_be_flown_is_refused_before_anything_is(options, capsys, monkeypatch):
    flown = []
    monkeypatch.setattr(evaluate, "fly", lambda *given: flown.append(given))
    assert main(["--policies=W", "--episodes=1", *options]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    assert flown == []


def test_the_record_says_what_flew(tmp_path):
    options = ["--tasks=fixed same", "--episodes=2", "--seed=7", "--checkpoint=gentle"]
    assert main(["--policies=W,meta_rl", *options, f"--json={tmp_path / 'e.json'}"]) == 0
    law, learnt = json.loads((tmp_path / "e.json").read_text())
    assert (law["policy"], law["checkpoint"], law["seed"]) == ("W", None, 7)
    assert (learnt["policy"], learnt["checkpoint"]) == ("meta_rl", "gentle")


def test_an_unknown_policy_is_named_by_its_flag(capsys):
    assert main(["--policies=W,nope"]) == 2
    assert capsys.readouterr().err.startswith("error: --policies: got nope; allowed: meta_rl | ")
