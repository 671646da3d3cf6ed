"""Tests, effect sizes and intervals over per-episode numbers: arrays in, numbers out.

Every function states what it does with degenerate input: where a statistic is not defined, the result holds ``None``
and ``note`` says why. A value that is not finite is an error, never a silent NaN. SciPy does the arithmetic.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from lerobot_spacedock.errors import InputError

SHAPIRO_MAX_N = 5000  # scipy's p-value (Royston 1995) is not calibrated beyond
BOOTSTRAP_BLOCK = 2_000_000  # resampled values held at a time: keeps memory flat for large runs


@dataclass(frozen=True)
class Test:
    """A hypothesis test. ``None`` where it is not defined; ``note`` then says why."""

    __test__ = False  # not a pytest class

    name: str
    statistic: float | None
    p: float | None
    df: float | None = None
    n: tuple[int, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Interval:
    """An estimate and its two-sided confidence interval; ``None`` where there is none."""

    estimate: float | None
    low: float | None
    high: float | None
    n: int
    note: str = ""


@dataclass(frozen=True)
class Summary:
    """Location and spread; ``std`` is the sample's (n − 1), ``None`` for a single value."""

    n: int
    mean: float | None = None
    std: float | None = None
    median: float | None = None
    p75: float | None = None
    p95: float | None = None
    p99: float | None = None
    min: float | None = None
    max: float | None = None


def finite(values: Sequence[float] | np.ndarray, what: str = "values") -> np.ndarray:
    """Values as a float64 vector.

    Raises:
        InputError: a value is not finite, or the shape is not (N,).
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise InputError(what, f"shape {array.shape}", "a vector, one value an episode")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise InputError(what, f"{array[bad[0]]} at index {bad[0]}", "finite numbers", "Mend or name that episode.")
    return array


def summarize(values: Sequence[float] | np.ndarray, what: str = "values") -> Summary:
    """Mean, sample standard deviation, and percentiles by linear interpolation (NumPy's, and the paper's)."""
    x = finite(values, what)
    if not x.size:
        return Summary(0)
    median, p75, p95, p99 = np.percentile(x, [50, 75, 95, 99])
    std = float(x.std(ddof=1)) if x.size > 1 else None
    return Summary(
        x.size, float(x.mean()), std, float(median), float(p75), float(p95), float(p99), float(x.min()), float(x.max())
    )


def clopper_pearson(successes: int, n: int, confidence: float = 0.95) -> Interval:
    """The exact interval of a proportion (Clopper and Pearson 1934), through the beta distribution.

    No episode gives no estimate; 0 of n and n of n give one-sided ends at 0 and 1.
    """
    if n < 0 or not 0 <= successes <= n:
        raise InputError("successes of n", f"{successes} of {n}", "0 <= successes <= n")
    if n == 0:
        return Interval(None, None, None, 0, "no episode")
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if successes == 0 else float(special.betaincinv(successes, n - successes + 1, tail))
    high = 1.0 if successes == n else float(special.betaincinv(successes + 1, n - successes, 1.0 - tail))
    return Interval(successes / n, low, high, n)


def bootstrap(
    values: Sequence[float] | np.ndarray,
    statistic: Callable[..., np.ndarray] = np.mean,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
    rng: np.random.Generator | None = None,
) -> Interval:
    """The percentile bootstrap interval of a statistic of one sample.

    Args:
        values: (N,).
        statistic: called as ``statistic(block, axis=1)`` on blocks (B, N).
        confidence: of the two-sided interval.
        resamples: bootstrap resamples.
        rng: generator; seeded with 0 where none is given, so that a report is reproducible.

    Returns:
        For one value the interval is absent; for a constant sample it is the constant.

    Source: Efron and Tibshirani (1993), An Introduction to the Bootstrap, section 13.3.
    """
    x = finite(values)
    if not x.size:
        return Interval(None, None, None, 0, "no episode")
    estimate = float(statistic(x[None, :], axis=1)[0])
    if x.size == 1:
        return Interval(estimate, None, None, 1, "one episode: no interval")
    rng = rng or np.random.default_rng(0)
    block = max(1, BOOTSTRAP_BLOCK // x.size)
    draws = []
    for start in range(0, resamples, block):
        rows = min(block, resamples - start)
        draws.append(statistic(x[rng.integers(0, x.size, (rows, x.size), dtype=np.int32)], axis=1))
    tail = 50.0 * (1.0 - confidence)
    low, high = np.percentile(np.concatenate(draws), [tail, 100.0 - tail])
    return Interval(estimate, float(low), float(high), x.size)


def shapiro_wilk(values: Sequence[float] | np.ndarray) -> Test:
    """Shapiro–Wilk test of normality; needs three values that differ."""
    x = finite(values)
    if x.size < 3:
        return Test("Shapiro–Wilk", None, None, n=(x.size,), note="fewer than three episodes")
    if np.ptp(x) == 0.0:
        return Test("Shapiro–Wilk", None, None, n=(x.size,), note="all values equal")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the remark on n > 5000, made in the note below
        result = stats.shapiro(x)
    note = f"n > {SHAPIRO_MAX_N}: the p-value is not calibrated" if x.size > SHAPIRO_MAX_N else ""
    return Test("Shapiro–Wilk", float(result.statistic), float(result.pvalue), n=(x.size,), note=note)


def levene(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray) -> Test:
    """Levene's test of equal variances about the medians (Brown–Forsythe); needs two values a side."""
    x, y = finite(a), finite(b)
    n = (x.size, y.size)
    if min(n) < 2:
        return Test("Levene", None, None, n=n, note="fewer than two episodes in one run")
    if np.ptp(np.abs(x - np.median(x))) == 0.0 and np.ptp(np.abs(y - np.median(y))) == 0.0:
        return Test("Levene", None, None, n=n, note="no spread of the deviations in either run")
    result = stats.levene(x, y, center="median")
    return Test("Levene", float(result.statistic), float(result.pvalue), df=float(sum(n) - 2), n=n)


def welch(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray) -> Test:
    """Welch's t-test, two-sided, of ``mean(a) = mean(b)``; needs two values a side, and spread in one."""
    x, y = finite(a), finite(b)
    n = (x.size, y.size)
    if min(n) < 2:
        return Test("Welch t", None, None, n=n, note="fewer than two episodes in one run")
    if np.ptp(x) == 0.0 and np.ptp(y) == 0.0:
        return Test("Welch t", None, None, n=n, note="both runs constant: t is not defined")
    return welch_from_summary(float(x.mean()), _spread(x), x.size, float(y.mean()), _spread(y), y.size)


def welch_from_summary(mean_a: float, std_a: float, n_a: int, mean_b: float, std_b: float, n_b: int) -> Test:
    """Welch's test from published means and sample standard deviations."""
    result = stats.ttest_ind_from_stats(mean_a, std_a, n_a, mean_b, std_b, n_b, equal_var=False)
    variance_a, variance_b = std_a**2 / n_a, std_b**2 / n_b
    df = (variance_a + variance_b) ** 2 / (variance_a**2 / (n_a - 1) + variance_b**2 / (n_b - 1))
    return Test("Welch t", float(result.statistic), float(result.pvalue), df=df, n=(n_a, n_b))


def _spread(x: np.ndarray) -> float:
    """Sample standard deviation; exactly 0 for equal values, whose computed mean may differ from them by rounding."""
    return float(x.std(ddof=1)) if np.ptp(x) > 0.0 else 0.0


def mann_whitney(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray) -> Test:
    """Mann–Whitney U of the first sample, two-sided; all values tied gives p = 1."""
    x, y = finite(a), finite(b)
    n = (x.size, y.size)
    if min(n) < 1:
        return Test("Mann–Whitney U", None, None, n=n, note="no episode in one run")
    if np.ptp(np.concatenate([x, y])) == 0.0:
        return Test("Mann–Whitney U", x.size * y.size / 2.0, 1.0, n=n, note="all values tied")
    result = stats.mannwhitneyu(x, y, alternative="two-sided")
    return Test("Mann–Whitney U", float(result.statistic), float(result.pvalue), n=n)


def hedges_g(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray) -> Interval:
    """Hedges' g: the standardised mean difference with the exact small-sample factor; normal-theory interval.

    Source: Hedges (1981), J. Educational Statistics 6, eq. 6e; variance after Hedges and Olkin (1985), p. 86.
    """
    x, y = finite(a), finite(b)
    n = x.size + y.size
    if min(x.size, y.size) < 2:
        return Interval(None, None, None, n, "fewer than two episodes in one run")
    df = n - 2
    pooled = math.sqrt(((x.size - 1) * _spread(x) ** 2 + (y.size - 1) * _spread(y) ** 2) / df)
    if pooled == 0.0:
        return Interval(None, None, None, n, "both runs constant: g is not defined")
    factor = math.exp(special.gammaln(df / 2) - special.gammaln((df - 1) / 2)) / math.sqrt(df / 2)
    g = factor * float(x.mean() - y.mean()) / pooled
    half = 1.959963984540054 * math.sqrt(n / (x.size * y.size) + g * g / (2 * n))
    return Interval(g, g - half, g + half, n)


def cliffs_delta(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray) -> Interval:
    """Cliff's delta, P(a > b) − P(a < b), by sorting: O(n log n)."""
    x, y = finite(a), np.sort(finite(b))
    n = x.size + y.size
    if not x.size or not y.size:
        return Interval(None, None, None, n, "no episode in one run")
    above = np.searchsorted(y, x, side="left").sum()
    below = (y.size - np.searchsorted(y, x, side="right")).sum()
    return Interval(float((int(above) - int(below)) / (x.size * y.size)), None, None, n)
