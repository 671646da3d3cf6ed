"""Earth below and stars above, made from hashed lattice noise: the same texels on every machine."""

from __future__ import annotations

import numpy as np

from lerobot_spacedock.jit import inner, jit

from .kernels_sky import EARTH_SIZE

STAR_COUNT = 2600
_STAR_SEED = 409


@inner
def _hash(x, y, seed):
    h = (
        np.uint32(x) * np.uint32(374761393)
        + np.uint32(y) * np.uint32(668265263)
        + np.uint32(seed) * np.uint32(2246822519)
    )
    h = np.uint32(h ^ (h >> np.uint32(13))) * np.uint32(1274126177)
    h = np.uint32(h ^ (h >> np.uint32(16)))
    return np.float32(h & np.uint32(0xFFFFFF)) * np.float32(1.0 / 16777216.0)


@inner
def _noise(u, v, seed):
    """Value noise in 0..1, smooth between lattice points."""
    iu, iv = int(np.floor(u)), int(np.floor(v))
    fu, fv = np.float32(u - iu), np.float32(v - iv)
    fu = fu * fu * (np.float32(3.0) - np.float32(2.0) * fu)
    fv = fv * fv * (np.float32(3.0) - np.float32(2.0) * fv)
    a, b = _hash(iu, iv, seed), _hash(iu + 1, iv, seed)
    c, d = _hash(iu, iv + 1, seed), _hash(iu + 1, iv + 1, seed)
    top = a + fu * (b - a)
    low = c + fu * (d - c)
    return top + fv * (low - top)


@inner
def _layers(u, v, octaves, seed):
    """Octaves of noise, each half as large and twice as fine (both floats: literal ints are each compiled for)."""
    total = np.float32(0.0)
    weight = np.float32(0.5)
    for k in range(int(octaves)):
        total += weight * _noise(u, v, int(seed) + k)
        # turned a little each time, so that the lattices do not line up
        u, v = 1.6 * u - 1.2 * v + 3.7, 1.2 * u + 1.6 * v + 9.1
        weight *= np.float32(0.5)
    return total


@inner
def _step(low, high, x):
    t = min(max((x - low) / (high - low), np.float32(0.0)), np.float32(1.0))
    return t * t * (np.float32(3.0) - np.float32(2.0) * t)


@jit(nogil=True)
def _paint_earth(size, out):
    f = np.float32
    for i in range(size):
        for j in range(size):
            u, v = 16.0 * j / size, 16.0 * i / size
            wx, wy = _layers(0.7 * u + 5.0, 0.7 * v, 4.0, 11.0), _layers(0.7 * u, 0.7 * v + 7.0, 4.0, 23.0)
            land = _step(f(0.50), f(0.53), _layers(0.45 * u + 1.5 * wx + 40.0, 0.45 * v + 1.5 * wy + 40.0, 9.0, 31.0))
            deep = f(0.8) + f(0.4) * _layers(2.0 * u + 30.0, 2.0 * v, 4.0, 61.0)
            red, grn, blu = f(0.012) * deep, f(0.035) * deep, f(0.095) * deep
            if land > f(0.0):
                dry = _layers(0.9 * u + 70.0, 0.9 * v + 20.0, 7.0, 47.0)
                green = _step(f(0.35), f(0.6), dry)
                rough = f(0.7) + f(0.6) * _layers(9.0 * u, 9.0 * v, 4.0, 59.0)
                red += land * ((f(0.26) - f(0.19) * green) * rough - f(0.012))
                grn += land * ((f(0.20) - f(0.08) * green) * rough - f(0.035))
                blu += land * ((f(0.13) - f(0.09) * green) * rough - f(0.095))
            # weather systems: warped streaks, broken into cells at small scale
            cx, cy = (
                _layers(0.35 * u + 3.0 * wx, 0.8 * v + 3.0 * wy, 9.0, 71.0),
                _layers(6.0 * u + 4.0 * wx, 6.0 * v, 6.0, 83.0),
            )
            thick = _step(f(0.47), f(0.66), cx * f(0.72) + cy * f(0.28))
            cloud = thick
            damp = _step(f(0.35), f(0.5), cx)
            if f(0.75) * damp > thick:
                puffs = _step(f(0.56), f(0.68), _layers(14.0 * u + 2.0 * wy, 14.0 * v + 2.0 * wx, 5.0, 97.0)) * damp
                cloud = max(thick, f(0.75) * puffs)
            if cloud > f(0.0):
                white = f(0.62) + f(0.25) * _layers(4.0 * u, 4.0 * v, 5.0, 101.0)
                red += cloud * (white - red)
                grn += cloud * (white - grn)
                blu += cloud * (f(1.02) * white - blu)
            gloss = (f(1.0) - land) * (f(1.0) - cloud)
            p = np.uint32(min(max(red, f(0.0)), f(1.0)) * f(255.0))
            p |= np.uint32(min(max(grn, f(0.0)), f(1.0)) * f(255.0)) << np.uint32(8)
            p |= np.uint32(min(max(blu, f(0.0)), f(1.0)) * f(255.0)) << np.uint32(16)
            p |= np.uint32(min(max(gloss, f(0.0)), f(1.0)) * f(255.0)) << np.uint32(24)
            out[i * size + j] = p


def make_earth() -> np.ndarray:
    """The patch of Earth under the station, flat uint32: linear red, green, blue and share of open water."""
    from lerobot_spacedock.station.cache import cached_arrays

    def make() -> dict[str, np.ndarray]:
        out = np.empty(EARTH_SIZE * EARTH_SIZE, np.uint32)
        _paint_earth(EARTH_SIZE, out)
        return {"texels": out}

    return cached_arrays("earth", __file__, make)["texels"].view(np.int32)


def make_stars() -> np.ndarray:
    """(S, 6): directions spread over the sphere, denser along one great circle, few bright and many faint."""
    rng = np.random.Generator(np.random.PCG64(_STAR_SEED))
    v = rng.standard_normal((STAR_COUNT, 3))
    band = rng.random(STAR_COUNT) < 0.45
    axis = np.array([0.48, 0.6, -0.64])
    v[band] -= 0.85 * (v[band] * axis).sum(1, keepdims=True) * axis
    v /= np.sqrt((v * v).sum(1, keepdims=True))
    brightness = np.minimum(0.05 * (rng.random(STAR_COUNT) + 1e-3) ** -0.7, 1.6)
    warmth = rng.standard_normal(STAR_COUNT) * 0.16
    tint = np.stack([1.0 + warmth, np.ones(STAR_COUNT), 1.0 - warmth], -1).clip(0.6, 1.4)
    return np.round(np.concatenate([v, brightness[:, None] * tint], 1), 6)
