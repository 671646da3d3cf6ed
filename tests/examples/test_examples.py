"""The examples run as they stand."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.slow
def test_stable_baselines3_trains_on_the_environment():
    pytest.importorskip("stable_baselines3")
    command = [sys.executable, str(EXAMPLES / "train_sb3_ppo.py"), "--steps=2048"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert "after:" in done.stdout
