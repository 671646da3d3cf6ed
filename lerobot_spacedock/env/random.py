"""Counter-based random numbers: a value is a function of (episode key, stream, index) and of nothing else.

So an episode is the same whether its environment flies alone, in a batch of thousands, or in any order; no generator
state is carried, and none of it is global. The mixing function is SplitMix64's finaliser (Steele, Lea and Flood, "Fast
splittable pseudorandom number generators", OOPSLA 2014), applied twice.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit
from lerobot_spacedock.physics.elementary import cosine_sine_of_turns, log_positive

# streams: what a draw is for
STREAM_START, STREAM_CHASER, STREAM_SENSOR, STREAM_STEP, STREAM_NOISE, STREAM_NEXT, STREAM_SUN = range(7)

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_M1, _M2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11, _S40 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11), np.uint64(40)
_TO_UNIT = 1.0 / 9007199254740992.0  # 2**-53


@jit(forceinline=True)
def _mix(x):
    x = (x ^ (x >> _S30)) * _M1
    x = (x ^ (x >> _S27)) * _M2
    return x ^ (x >> _S31)


@jit(forceinline=True)
def bits(key, stream, index):
    """64 random bits, uint64."""
    counter = (np.uint64(stream) << _S40) + np.uint64(index) + np.uint64(1)
    return _mix(_mix(np.uint64(key) + _GOLDEN * counter) + _GOLDEN)


@jit(forceinline=True)
def uniform(key, stream, index):
    """Uniform in (0, 1): 53 bits, never 0."""
    return (np.float64(bits(key, stream, index) >> _S11) + 0.5) * _TO_UNIT


@jit(forceinline=True)
def uniform_between(key, stream, index, low, high):
    """Uniform in (low, high); ``low`` itself where the two are equal."""
    return low + (high - low) * uniform(key, stream, index)


@jit(forceinline=True)
def normal_pair(key, stream, index):
    """Two independent standard normals (Box–Muller), from the draws ``2 index`` and ``2 index + 1``."""
    radius = math.sqrt(-2.0 * log_positive(uniform(key, stream, 2 * index)))
    cosine, sine = cosine_sine_of_turns(uniform(key, stream, 2 * index + 1))
    return radius * cosine, radius * sine
