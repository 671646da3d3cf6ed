"""Paired comparison on matched starts, correction for many tests, and the spread over training seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse, spatial, stats
from scipy.sparse import csgraph

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.metrics.statistics import Interval, Test, finite

START_TOLERANCE = 1e-4  # m, m/s, –, deg/s: starts that went through float32 still match


def group_starts(starts: np.ndarray, tolerance: float = START_TOLERANCE) -> np.ndarray:
    """Labels equal for episodes that began in the same state. (N, D) → (N,) int, numbered by first appearance."""
    starts = np.asarray(starts, dtype=np.float64)
    if len(starts) == 0:
        return np.empty(0, dtype=int)
    coarse = np.round(starts / (tolerance * 1e-3))
    _, first, inverse = np.unique(coarse, axis=0, return_index=True, return_inverse=True)
    pairs = spatial.cKDTree(starts[first]).query_pairs(tolerance, p=np.inf, output_type="ndarray")
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(first), len(first)))
    component = csgraph.connected_components(graph, directed=False)[1][inverse.ravel()]
    _, order, labels = np.unique(component, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(order))[labels]


def match_starts(a: np.ndarray, b: np.ndarray, tolerance: float = START_TOLERANCE) -> tuple[np.ndarray, np.ndarray]:
    """Which groups of equal starts the two runs share.

    Args:
        a: start states, (N, D).
        b: start states, (M, D).
        tolerance: largest difference in any component.

    Returns:
        One label an episode, (N,) and (M,): equal labels began in the same state, −1 where the other run has none.
    """
    labels = group_starts(np.concatenate([a, b]), tolerance)
    in_a, in_b = labels[: len(a)], labels[len(a) :]
    return np.where(np.isin(in_a, in_b), in_a, -1), np.where(np.isin(in_b, in_a), in_b, -1)


def pair_means(values: np.ndarray, labels: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Mean value of each shared start (several training seeds may have flown it). → (len(shared),)."""
    return np.array([np.mean(values[labels == label]) for label in shared])


def wilcoxon(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray) -> Test:
    """Wilcoxon's signed-rank test on pairs, two-sided, zeros dropped (Wilcoxon 1945); no difference gives p = 1."""
    x, y = finite(a), finite(b)
    if x.size != y.size:
        raise InputError("pairs", f"{x.size} and {y.size} values", "as many on both sides")
    n = (x.size,)
    if x.size == 0:
        return Test("Wilcoxon signed-rank", None, None, n=n, note="no pair")
    if not np.any(x - y):
        return Test("Wilcoxon signed-rank", 0.0, 1.0, n=n, note="no pair differs")
    result = stats.wilcoxon(x, y, zero_method="wilcox", alternative="two-sided")
    zeros = int(np.sum(x == y))
    note = f"{zeros} pairs without a difference carry no rank" if zeros else ""
    return Test("Wilcoxon signed-rank", float(result.statistic), float(result.pvalue), n=n, note=note)


def mcnemar(a: Sequence[bool] | np.ndarray, b: Sequence[bool] | np.ndarray) -> Test:
    """McNemar's exact test on paired successes; the statistic is the smaller count of discordant pairs."""
    x, y = np.asarray(a, dtype=bool), np.asarray(b, dtype=bool)
    if x.shape != y.shape:
        raise InputError("pairs", f"{x.size} and {y.size} outcomes", "as many on both sides")
    only_a, only_b = int(np.sum(x & ~y)), int(np.sum(~x & y))
    n = (x.size,)
    if x.size == 0:
        return Test("McNemar exact", None, None, n=n, note="no pair")
    note = f"{only_a} won by the first alone, {only_b} by the second alone"
    if only_a + only_b == 0:
        return Test("McNemar exact", 0.0, 1.0, n=n, note="no discordant pair")
    p = stats.binomtest(only_a, only_a + only_b, 0.5).pvalue
    return Test("McNemar exact", float(min(only_a, only_b)), float(p), n=n, note=note)


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Holm's step-down adjustment over one family; tests that were not defined (None) are not counted.

    Source: Holm (1979), Scandinavian Journal of Statistics 6, 65–70.
    """
    known = [(p, i) for i, p in enumerate(p_values) if p is not None]
    if any(not 0.0 <= p <= 1.0 for p, _ in known):
        raise InputError("p_values", list(p_values), "numbers in [0, 1], or None")
    adjusted: list[float | None] = [None] * len(p_values)
    running = 0.0
    for rank, (p, i) in enumerate(sorted(known)):
        running = max(running, min(1.0, (len(known) - rank) * p))
        adjusted[i] = running
    return adjusted


def spread_over_seeds(means: Sequence[float] | np.ndarray, confidence: float = 0.95) -> Interval:
    """Mean over training seeds with Student's t interval; one seed has no spread, and says so."""
    x = finite(means)
    if not x.size:
        return Interval(None, None, None, 0, "no training seed")
    if x.size == 1:
        return Interval(float(x[0]), None, None, 1, "one training seed: spread not known")
    half = float(stats.t.ppf(0.5 + confidence / 2, x.size - 1) * x.std(ddof=1) / np.sqrt(x.size))
    return Interval(float(x.mean()), float(x.mean()) - half, float(x.mean()) + half, x.size)


def normal_quantiles(values: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of a normal Q–Q plot with Filliben's medians: (theoretical, ordered sample), each (N,)."""
    x = finite(values)
    if not x.size:
        return np.empty(0), np.empty(0)
    theoretical, ordered = stats.probplot(x, dist="norm", fit=False)
    return np.asarray(theoretical), np.asarray(ordered)
