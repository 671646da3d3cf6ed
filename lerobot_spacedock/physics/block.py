"""A block: the scratch array in which a few chasers fly side by side, one a lane; which row holds what, and access.

Flat, with offsets known when it is compiled: so the compiler sees that rows do not overlap, and puts the lanes of a
loop into vector registers (``propagate.py``, ``env/kernels.py``). SI, as the state.
"""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics.chaser import PARAMETER_DIM
from lerobot_spacedock.physics.frames import ACTION_DIM, STATE_DIM

# (BLOCK_ROWS, LANES), flat: what each row holds
LANES = 32
BLOCK_STATE = 0  # 14, before the step
BLOCK_ACTION = BLOCK_STATE + STATE_DIM  # 6
BLOCK_STEP = BLOCK_ACTION + ACTION_DIM  # 1, s
BLOCK_CHASER = BLOCK_STEP + 1  # PARAMETER_DIM, as packed
BLOCK_AFTER = BLOCK_CHASER + PARAMETER_DIM  # 14, after the step
BLOCK_UNUSUAL = BLOCK_AFTER + STATE_DIM  # 1: not flown, other than 0 if so
BLOCK_ROWS = BLOCK_UNUSUAL + 1


@jit(forceinline=True)
def get(b, row, k):
    """Value of lane ``k`` in a row of a block; flat, so that the compiler sees that rows do not overlap."""
    return b[np.uintp(row * LANES) + k]


@jit(forceinline=True)
def get3(b, row, k):
    """Three rows from ``row`` on, of lane ``k``, as a tuple."""
    return get(b, row, k), get(b, row + 1, k), get(b, row + 2, k)


@jit(forceinline=True)
def get4(b, row, k):
    """Four rows."""
    return get(b, row, k), get(b, row + 1, k), get(b, row + 2, k), get(b, row + 3, k)


@jit(forceinline=True)
def get6(b, row, k):
    """Six rows."""
    return (
        get(b, row, k), get(b, row + 1, k), get(b, row + 2, k), get(b, row + 3, k), get(b, row + 4, k),
        get(b, row + 5, k),
    )  # fmt: skip


@jit(forceinline=True)
def get9(b, row, k):
    """Nine rows: a matrix."""
    return (
        get(b, row, k), get(b, row + 1, k), get(b, row + 2, k), get(b, row + 3, k), get(b, row + 4, k),
        get(b, row + 5, k), get(b, row + 6, k), get(b, row + 7, k), get(b, row + 8, k),
    )  # fmt: skip


@jit
def get14(b, row, k):
    """Fourteen rows: a state."""
    return (
        get(b, row, k), get(b, row + 1, k), get(b, row + 2, k), get(b, row + 3, k), get(b, row + 4, k),
        get(b, row + 5, k), get(b, row + 6, k), get(b, row + 7, k), get(b, row + 8, k), get(b, row + 9, k),
        get(b, row + 10, k), get(b, row + 11, k), get(b, row + 12, k), get(b, row + 13, k),
    )  # fmt: skip


@jit(forceinline=True)
def put(b, row, k, value):
    """Sets what ``get`` gets."""
    b[np.uintp(row * LANES) + k] = value


@jit(forceinline=True)
def put3(b, row, k, values):
    """Sets three rows from a tuple."""
    put(b, row, k, values[0])
    put(b, row + 1, k, values[1])
    put(b, row + 2, k, values[2])


@jit(forceinline=True)
def put4(b, row, k, values):
    """Sets four rows from a tuple."""
    put(b, row, k, values[0])
    put3(b, row + 1, k, (values[1], values[2], values[3]))


@jit
def put14(b, row, k, values):
    """Sets fourteen rows from a tuple."""
    for j in range(14):
        put(b, row + j, k, values[j])
