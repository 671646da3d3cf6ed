"""Kill -9 in the long commands, a few moments each; ``python tests/faults/run.py --moments=100`` takes more."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import COMMANDS, LIBRARIES, hub
from killed import run_killed


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_random_moments_it_goes_on_to_the_same_result(name, tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    hub()
    outcome = run_killed(COMMANDS[name](), tmp_path / name, moments=4, seed=1, libraries=LIBRARIES)
    assert outcome.differences == []
    assert outcome.kills >= 4
    assert outcome.rounds >= 1


def namespaces() -> bool:
    """Whether this user may make file systems and networks of their own."""
    if shutil.which("unshare") is None:
        return False
    return (
        subprocess.run(["unshare", "--user", "--map-root-user", "--mount", "--net", "true"], check=False).returncode
        == 0
    )


@pytest.mark.slow
@pytest.mark.skipif(not namespaces(), reason="no user namespaces here")
@pytest.mark.parametrize("name", ["demos", "convert", "sweep", "train-expert", "eval"])
def test_a_full_disk_is_said_and_with_room_it_goes_on(name):
    script = Path(__file__).with_name("full_disk.py")
    unshare = ["unshare", "--user", "--map-root-user", "--mount"]
    done = subprocess.run(
        [*unshare, sys.executable, str(script), f"--only={name}", "--tries=3"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not namespaces(), reason="no user namespaces here")
def test_demonstrations_and_their_check_need_no_network(tmp_path):
    unshare = ["unshare", "--user", "--map-root-user", "--net"]
    cli = [sys.executable, "-m", "lerobot_spacedock.cli"]
    options = ["--repo_id=a/b", "--root=data", "--expert=V", "--num_episodes=1", "--image=false", "--num_workers=1"]
    for arguments in (["demos", *options], ["check", "--root=data"]):
        done = subprocess.run([*unshare, *cli, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
