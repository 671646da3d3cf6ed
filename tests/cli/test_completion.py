"""Tab completion, tried in the shell that it is for."""

import subprocess

import pytest
import shtab

from lerobot_spacedock.cli import VERBS
from lerobot_spacedock.completion import CompletionConfig, command_line, completion
from lerobot_spacedock.errors import InputError


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    path = tmp_path_factory.mktemp("completion") / "spacedock.bash"
    path.write_text(shtab.complete(command_line(), "bash"))
    return path


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("spacedock re", {"report"}),
        ("spacedock demos --kicks.p", {"--kicks.probability"}),
        ("spacedock nothing --f", set()),
    ],
)
def test_bash_offers_verbs_and_flags(script, typed, offered):
    words = typed.split()
    ask = (
        f"source {script}; COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _shtab_spacedock; echo ${{COMPREPLY[@]}}"
    )
    answer = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert set(answer.stdout.split()) == offered


@pytest.mark.parametrize(
    "flag",
    ["view --dataset", "view --render", "check --json", "report --training", "push --root"],
)
def test_files_are_offered_where_a_path_is_meant_and_nowhere_else(script, flag):
    verb, _, name = flag.partition(" ")
    assert f"_shtab_spacedock_{verb}_{name.replace('-', '_')}_COMPGEN=_shtab_compgen_files" in script.read_text()
    assert "_repo_id_COMPGEN" not in script.read_text()


def test_every_verb_is_there(script, capsys):
    ask = f"source {script}; COMP_WORDS=(spacedock ''); COMP_CWORD=1; _shtab_spacedock; echo ${{COMPREPLY[@]}}"
    answer = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert set(VERBS) <= set(answer.stdout.split())
    assert completion(CompletionConfig(shell="zsh")) == 0
    assert "#compdef spacedock" in capsys.readouterr().out
    with pytest.raises(InputError, match="bash"):
        CompletionConfig(shell="elvish")
