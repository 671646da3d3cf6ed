"""How much light there is and how long the shutter stays open: one small array that the kernels read."""

from __future__ import annotations

import functools
import math

import numpy as np

from .config import CameraConfig
from .sun import sunlit_share

# relative to a white card that faces the Sun, which is 1
EARTH_TINT = (0.20, 0.25, 0.33)  # blue sea, white cloud; albedo about 0.3 over half the sphere
OWN_FILL = (0.020, 0.020, 0.021)  # sunlight scattered by the station itself
NIGHT_FILL = (0.0010, 0.0011, 0.0014)  # moonlight and airglow
SUN_TINT = (1.0, 0.975, 0.93)
LAMP_TINT = (1.0, 0.96, 0.88)
DAY_EXPOSURE = 0.92
NIGHT_EXPOSURE = 20.0
LAMP_REACH_m = 2.5  # the beam spreads as from a source this far behind the lens


def light_array(config: CameraConfig, r_H: np.ndarray, sun_H: np.ndarray) -> tuple[np.ndarray, np.float32]:
    """The kernels' light array (float32) and the brightness of the stars on film.

    Args:
        config: exposure and lamp settings.
        r_H: m, (3,), the camera; sets the lamp's brightness at the port, as a pilot's dimmer would.
        sun_H: unit vector to the Sun, (3,).
    """
    daylight, exposure, lamp, stars = _daylight(tuple(np.asarray(sun_H, float).tolist()), config.exposure, config.lamp)
    power = 0.0
    if lamp:
        x, y, z = np.asarray(r_H, float).tolist()
        power = 0.055 * math.sqrt((x**2 + y**2 + z**2 + LAMP_REACH_m**2) * (LAMP_REACH_m**2 + 4.0))
    light = [*daylight, *(tint * power * lamp for tint in LAMP_TINT), exposure, LAMP_REACH_m**2, lamp]
    return np.array(light, np.float32), stars


@functools.lru_cache(maxsize=16)  # the Sun stands still over an episode
def _daylight(sun: tuple[float, ...], fixed: float, lamp: str) -> tuple[tuple[float, ...], float, float, np.float32]:
    """The light array's first twelve numbers, the exposure, how far the lamp is on, and the brightness of the stars."""
    share = sunlit_share(sun)
    below = max(0.0, sun[0] + 0.1) / 1.1  # how much of the Earth below is in daylight
    light = (
        *sun,
        *(tint * share for tint in SUN_TINT),
        *(tint * below + fill * 0.5 for tint, fill in zip(EARTH_TINT, NIGHT_FILL, strict=True)),
        *(own * share + fill for own, fill in zip(OWN_FILL, NIGHT_FILL, strict=True)),
    )
    exposure = fixed if fixed > 0.0 else DAY_EXPOSURE / (share + (1.0 - share) * DAY_EXPOSURE / NIGHT_EXPOSURE)
    on = {"on": 1.0, "off": 0.0, "auto": 1.0 if share < 0.5 else 0.0}[lamp]
    return light, exposure, on, np.float32(min(1.0, 0.25 + 0.75 * (1.0 - share)))
