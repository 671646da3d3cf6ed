"""With NUMBA_DISABLE_JIT=1, as a debugger wants it, the controllers fly as ever."""

import json
import os
import subprocess
import sys

import pytest

FLY = """
import json, sys
import numpy as np
from lerobot_spacedock.expert.mpc import MpcPolicy
from lerobot_spacedock.expert.zem import ZemZevPolicy
state = np.array([[0.5, -25.0, -0.5, 0.0, 0.1, 0.0, 0.5**0.5, -(0.5**0.5), 0.0, 0.0, 0.0, 0.0, 0.0]])
commands = []
for policy in (MpcPolicy(), MpcPolicy(mode="receding"), ZemZevPolicy()):
    policy.reset(1)
    commands += policy.act(state)[0].tolist()
print(json.dumps(commands))
"""


def test_mpc_and_zem_fly_without_the_compiler():
    commands = []
    for disabled in ("0", "1"):
        environment = os.environ | {"NUMBA_DISABLE_JIT": disabled}
        ran = subprocess.run([sys.executable, "-c", FLY], env=environment, capture_output=True, text=True)
        assert ran.returncode == 0, ran.stderr
        commands.append(json.loads(ran.stdout))
    assert commands[1] == pytest.approx(commands[0], abs=1e-9)
