"""Elementary functions without a branch or a library call, so that a loop over chasers becomes vector instructions.

Each is a series after an exact reduction of its argument, to a few units in the last place; and the same to the bit on
every machine, which the C library's are not.
"""

from __future__ import annotations

import math

import numpy as np

from lerobot_spacedock.jit import jit

_LN2 = math.log(2.0)
_MANTISSA = np.int64(0x000FFFFFFFFFFFFF)
_ONE = np.int64(0x3FF0000000000000)  # bits of 1.0
_EXPONENT_SHIFT = np.int64(52)
_MAGIC = np.int64(0x4330000000000000)  # bits of 2**52: an integer below it in the mantissa is that number
_TWO_52 = 4503599627370496.0
_SQRT2 = math.sqrt(2.0)


@jit(forceinline=True)
def log_positive(x):
    """Natural logarithm of a normal number above 0: exponent, and ``2 atanh((m - 1) / (m + 1))`` of the mantissa."""
    bits = np.float64(x).view(np.int64)
    exponent = np.int64((bits >> _EXPONENT_SHIFT) | _MAGIC).view(np.float64) - (_TWO_52 + 1023.0)
    mantissa = np.int64((bits & _MANTISSA) | _ONE).view(np.float64)
    high = mantissa > _SQRT2
    mantissa = 0.5 * mantissa if high else mantissa
    exponent = exponent + 1.0 if high else exponent
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    tail = 1 / 13 + z * (1 / 15 + z * (1 / 17 + z * (1 / 19 + z * (1 / 21))))
    tail = 1 / 3 + z * (1 / 5 + z * (1 / 7 + z * (1 / 9 + z * (1 / 11 + z * tail))))
    return exponent * _LN2 + 2.0 * (s + s * z * tail)


@jit(forceinline=True)
def cosine_sine_of_turns(turns):
    """Cosine and sine of ``2 pi turns``, for ``turns`` in [0, 1]."""
    quadrant = math.floor(4.0 * turns + 0.5)
    x = (turns - 0.25 * quadrant) * (2.0 * math.pi)
    y = x * x
    sine = 1 / 362880 - y * (1 / 39916800 - y * (1 / 6227020800 - y * (1 / 1307674368000)))
    sine = x * (1.0 - y * (1 / 6 - y * (1 / 120 - y * (1 / 5040 - y * sine))))
    cosine = 1 / 40320 - y * (1 / 3628800 - y * (1 / 479001600 - y * (1 / 87178291200 - y * (1 / 20922789888000))))
    cosine = 1.0 - y * (1 / 2 - y * (1 / 24 - y * (1 / 720 - y * cosine)))
    odd = (quadrant == 1.0) | (quadrant == 3.0)
    c, s = (sine, cosine) if odd else (cosine, sine)
    c = -c if (quadrant == 1.0) | (quadrant == 2.0) else c
    s = -s if (quadrant == 2.0) | (quadrant == 3.0) else s
    return c, s


@jit(forceinline=True)
def angle_of(sine, cosine):
    """``atan2(sine, cosine)`` of a point of the unit circle with both at least 0: halved twice, then the series."""
    t = sine / (1.0 + cosine)
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    z = t * t
    tail = 1 / 13 - z * (1 / 15 - z * (1 / 17 - z * (1 / 19 - z * (1 / 21 - z * (1 / 23)))))
    tail = 1 / 3 - z * (1 / 5 - z * (1 / 7 - z * (1 / 9 - z * (1 / 11 - z * tail))))
    return 8.0 * (t - t * z * tail)
