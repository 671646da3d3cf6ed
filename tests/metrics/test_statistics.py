"""Statistics against statsmodels, closed forms and worked examples from the literature; degenerate input."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from statsmodels.stats import multitest, oneway, proportion
from statsmodels.stats.contingency_tables import mcnemar as sm_mcnemar
from statsmodels.stats.meta_analysis import effectsize_smd
from statsmodels.stats.weightstats import DescrStatsW, ttest_ind

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.metrics import paired
from lerobot_spacedock.metrics import statistics as s

# Student 1908, Biometrika 6, p. 13: extra hours of sleep under two drugs
SLEEP_1 = np.array([0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0])
SLEEP_2 = np.array([1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4])
SAMPLES = st.lists(st.floats(-1e3, 1e3).map(lambda v: round(v, 3)), min_size=3, max_size=30)


def test_clopper_pearson_inverts_the_binomial_tails():
    for k, n in ((1, 10), (7, 10), (43, 100), (99, 100)):
        i = s.clopper_pearson(k, n)
        assert stats.binom.sf(k - 1, n, i.low) == pytest.approx(0.025, abs=1e-9)
        assert stats.binom.cdf(k, n, i.high) == pytest.approx(0.025, abs=1e-9)
        assert (i.low, i.high) == pytest.approx(proportion.proportion_confint(k, n, method="beta"))


def test_clopper_pearson_at_the_ends_has_closed_forms():
    none, every = s.clopper_pearson(0, 100), s.clopper_pearson(100, 100)
    assert (none.low, every.high) == (0.0, 1.0)
    assert none.high == pytest.approx(1 - 0.025 ** (1 / 100))
    assert every.low == pytest.approx(0.025 ** (1 / 100))


def test_welch_gives_the_published_result_for_students_sleep_data():
    t = s.welch(SLEEP_1, SLEEP_2)
    assert (t.statistic, t.df, t.p) == pytest.approx((-1.8608, 17.776, 0.07939), rel=1e-4)
    assert (t.statistic, t.p, t.df) == pytest.approx(ttest_ind(SLEEP_1, SLEEP_2, usevar="unequal"))


def test_welch_from_summary_gives_the_degrees_of_freedom_that_the_paper_prints():
    t = s.welch_from_summary(1.71, 0.32, 100, 9.39, 0.74, 100)
    assert round(t.df) == 135
    whole = s.welch(SLEEP_1, SLEEP_2)
    again = s.welch_from_summary(SLEEP_1.mean(), SLEEP_1.std(ddof=1), 10, SLEEP_2.mean(), SLEEP_2.std(ddof=1), 10)
    assert (again.statistic, again.df, again.p) == pytest.approx((whole.statistic, whole.df, whole.p))


def test_shapiro_wilk_gives_the_worked_example_of_its_authors():
    weights = [148, 154, 158, 160, 161, 162, 166, 170, 182, 195, 236]  # Shapiro and Wilk 1965, p. 606: W = 0.79
    assert s.shapiro_wilk(weights).statistic == pytest.approx(0.79, abs=0.005)


def test_mann_whitney_and_wilcoxon_give_hollander_and_wolfes_examples():
    x = [0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46]  # Hollander and Wolfe 1973, p. 69 f.
    y = [1.15, 0.88, 0.90, 0.74, 1.21]
    u = s.mann_whitney(x, y)
    assert (u.statistic, u.p) == pytest.approx((35, 2 * 0.1272), abs=2e-4)
    before = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30]  # p. 29 f.: T+ = 40 of 45, one-sided p = 0.0195
    after = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29]
    w = paired.wilcoxon(before, after)
    assert (w.statistic, w.p) == pytest.approx((45 - 40, 2 * 0.01953), abs=1e-4)


def test_levene_is_an_analysis_of_variance_of_the_deviations():
    deviations = [np.abs(v - np.median(v)) for v in (SLEEP_1, SLEEP_2**2)]
    reference = oneway.anova_oneway(deviations, use_var="equal")
    test = s.levene(SLEEP_1, SLEEP_2**2)
    assert (test.statistic, test.p, test.df) == pytest.approx((reference.statistic, reference.pvalue, 18))


def test_hedges_g():
    g = s.hedges_g(SLEEP_1, SLEEP_2)
    parts = [(v.mean(), v.std(ddof=1), len(v)) for v in (SLEEP_1, SLEEP_2)]
    approximate, _ = effectsize_smd(*parts[0], *parts[1])  # its small-sample factor is the usual approximation
    assert g.estimate == pytest.approx(float(approximate), rel=2e-3)
    tiny = s.hedges_g([0.0, 2.0], [3.0, 5.0])  # two degrees of freedom: the exact factor is 1/√π
    assert tiny.estimate == pytest.approx(-3.0 / math.sqrt(2.0) / math.sqrt(math.pi))
    assert g.low < g.estimate < g.high


@settings(max_examples=60, deadline=None)
@given(SAMPLES, SAMPLES)
def test_cliffs_delta_counts_every_pair(a, b):
    brute = np.mean([np.sign(x - y) for x in a for y in b])
    assert s.cliffs_delta(a, b).estimate == pytest.approx(brute, abs=1e-12)
    assert s.cliffs_delta(b, a).estimate == pytest.approx(-brute, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(SAMPLES, SAMPLES)
def test_mann_whitney_and_cliffs_delta_tell_the_same_story(a, b):
    u, delta = s.mann_whitney(a, b), s.cliffs_delta(a, b)
    assert delta.estimate == pytest.approx(2 * u.statistic / (len(a) * len(b)) - 1, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_matches_statsmodels(p):
    assert paired.holm(p) == pytest.approx(multitest.multipletests(p, method="holm")[1])


def test_holm_passes_over_tests_that_were_not_defined():
    assert paired.holm([0.01, None, 0.04]) == [pytest.approx(0.02), None, pytest.approx(0.04)]
    assert paired.holm([]) == []
    with pytest.raises(InputError, match="p_values"):
        paired.holm([1.5])


def test_mcnemar_matches_statsmodels():
    rng = np.random.default_rng(3)
    a, b = rng.random(80) < 0.7, rng.random(80) < 0.4
    table = [[np.sum(a & b), np.sum(a & ~b)], [np.sum(~a & b), np.sum(~a & ~b)]]
    reference = sm_mcnemar(table, exact=True)
    test = paired.mcnemar(a, b)
    assert (test.statistic, test.p) == pytest.approx((reference.statistic, reference.pvalue))


def test_bootstrap_of_a_mean_agrees_with_the_normal_interval():
    x = np.random.default_rng(1).normal(5.0, 2.0, 400)
    i = s.bootstrap(x, resamples=4000)
    half = 1.96 * x.std() / math.sqrt(len(x))
    assert (i.low, i.high) == pytest.approx((x.mean() - half, x.mean() + half), abs=0.1 * half)
    assert s.bootstrap(x) == s.bootstrap(x)


def test_bootstrap_interval_of_the_median_covers_as_often_as_it_says():
    rng = np.random.default_rng(2)
    hits = 0
    for _ in range(200):
        i = s.bootstrap(rng.exponential(1.0, 60), np.median, resamples=300, rng=rng)
        hits += i.low <= math.log(2.0) <= i.high
    assert 0.89 <= hits / 200 <= 0.99


def test_spread_over_seeds_is_students_interval():
    x = [0.31, 0.44, 0.38]
    i = paired.spread_over_seeds(x)
    assert (i.low, i.high) == pytest.approx(DescrStatsW(x).tconfint_mean(0.05))


def test_normal_quantiles_use_fillibens_medians():
    theoretical, ordered = paired.normal_quantiles([3.0, 1.0, 2.0])
    assert list(ordered) == [1.0, 2.0, 3.0]
    end = stats.norm.ppf(0.5 ** (1 / 3))
    assert theoretical == pytest.approx([-end, 0.0, end], abs=1e-9)


def test_summary_percentiles_interpolate_linearly():
    summary = s.summarize(np.arange(101.0))
    assert (summary.median, summary.p75, summary.p95, summary.p99) == (50.0, 75.0, 95.0, 99.0)
    assert summary.std == pytest.approx(math.sqrt(101 * 102 / 12))
    assert s.summarize([7.0]).std is None
    assert s.summarize([]).mean is None


TWO_SAMPLE = (s.welch, s.levene, s.mann_whitney, s.hedges_g, s.cliffs_delta)


@pytest.mark.parametrize("bad", [[1.0, np.nan, 2.0], [np.inf, 1.0, 2.0]])
@pytest.mark.parametrize("function", [*TWO_SAMPLE, s.summarize, s.bootstrap, s.shapiro_wilk, paired.wilcoxon])
def test_what_is_not_finite_is_an_error_that_names_the_place(function, bad):
    arguments = (bad,) if function in (s.summarize, s.bootstrap, s.shapiro_wilk) else (bad, [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="at index"):
        function(*arguments)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("x", [[], [1.0], [1.0, 1.0, 1.0], [0.1] * 3])
@pytest.mark.parametrize("y", [[], [1.0], [1.0, 1.0, 1.0], [1.0, 2.0, 4.0]])
@pytest.mark.parametrize("function", TWO_SAMPLE)
def test_degenerate_samples_give_a_stated_result(function, x, y):
    result = function(x, y)
    main = result.statistic if isinstance(result, s.Test) else result.estimate
    assert main is None or math.isfinite(main)
    if main is None:
        assert result.note
    if isinstance(result, s.Test):
        assert (result.p is None) == (result.statistic is None)
        assert result.p is None or 0.0 <= result.p <= 1.0


@pytest.mark.filterwarnings("error")
def test_degenerate_single_samples_give_a_stated_result():
    assert s.shapiro_wilk([1.0, 2.0]).note == "fewer than three episodes"
    assert s.shapiro_wilk([2.0] * 5).note == "all values equal"
    assert "not calibrated" in s.shapiro_wilk(np.random.default_rng(0).normal(size=6000)).note
    assert s.bootstrap([3.0]).note
    assert s.bootstrap([3.0]).low is None
    assert (s.bootstrap([3.0, 3.0]).low, s.bootstrap([3.0, 3.0]).high) == (3.0, 3.0)
    assert s.clopper_pearson(0, 0).estimate is None
    assert paired.wilcoxon([1.0, 2.0], [1.0, 2.0]).p == 1.0
    assert paired.wilcoxon([], []).p is None
    assert paired.mcnemar([True], [True]).p == 1.0
    assert paired.spread_over_seeds([0.4]).low is None
    with pytest.raises(InputError, match="successes"):
        s.clopper_pearson(3, 2)


def test_starts_match_across_order_rounding_and_repeats():
    rng = np.random.default_rng(5)
    a = rng.normal(size=(20, 13))
    order = rng.permutation(20)
    b = np.concatenate([a[order].astype(np.float32).astype(np.float64), a[:3]])
    in_a, in_b = paired.match_starts(a, b)
    assert np.array_equal(in_a[order], in_b[:20])
    assert np.array_equal(in_a[:3], in_b[20:])
    assert len(np.unique(in_a)) == 20
    other_a, other_b = paired.match_starts(a, a + 1.0)
    assert (other_a == -1).all()
    assert (other_b == -1).all()


def test_ten_thousand_equal_starts_take_little_memory():
    assert np.array_equal(np.unique(paired.group_starts(np.ones((10_000, 13)))), [0])


@pytest.mark.filterwarnings("error")
def test_starts_beyond_all_reason_are_still_told_apart():
    assert list(paired.group_starts(np.array([[1e13, 0.0], [2e13, 0.0], [1e13, -0.0]]))) == [0, 1, 0]
