import numpy as np
import pytest
from scipy import special, stats

from startrack.core import variates

poisson_quantile = np.vectorize(variates.poisson_quantile)
MEANS = [1e-3, 0.3, 3.0, 5.9, 6.0, 6.1, 9.0, 20.0, 55.5, 300.0, 1e4]


@pytest.mark.parametrize("mean", MEANS)
def test_quantiles_are_scipys(mean):
    """Number by number, to 6.5 sigma in both tails."""
    rng = np.random.default_rng(1)
    normal = np.concatenate([rng.standard_normal(5000), rng.uniform(-6.5, 6.5, 5000)])
    lower = stats.poisson.ppf(special.ndtr(normal), mean)
    upper = stats.poisson.isf(special.ndtr(-normal), mean)  # keeps the digits of the upper tail
    np.testing.assert_array_equal(
        poisson_quantile(mean, normal), np.where(normal < 0, lower, upper)
    )


@pytest.mark.parametrize("mean", [7.0, 40.0, 300.0, 5e3, 1e5])
def test_a_number_gives_way_to_the_next_where_the_sum_says(mean):
    """Quantiles 3e-9 sigma before and after each step, to six sigma."""
    k = np.unique(np.round(mean + np.sqrt(mean) * np.linspace(-6, 6.5, 800)))
    k = k[k >= 0]
    lower = special.ndtri(special.pdtr(k, mean))
    step = np.where(k < mean, lower, -special.ndtri(special.pdtrc(k, mean)))
    near = np.abs(step) < 6.5
    k, step = k[near], step[near]
    np.testing.assert_array_equal(poisson_quantile(mean, step - 3e-9), k)
    np.testing.assert_array_equal(poisson_quantile(mean, step + 3e-9), k + 1)


@pytest.mark.parametrize(
    "mean", [0.5, *(pytest.param(mean, marks=pytest.mark.slow) for mean in (5.0, 50.0)), 5000.0]
)
def test_the_law_is_poissons(mean):
    """Chi-square of a histogram of a million draws; false alarm 1e-4 each."""
    draw = poisson_quantile(mean, np.random.default_rng(2).standard_normal(10**6))
    edges = np.unique(stats.poisson.ppf(np.linspace(0.001, 0.999, 30), mean))
    cell = np.searchsorted(edges, draw, side="left")
    count = np.bincount(cell, minlength=len(edges) + 1)
    fraction = np.diff(np.concatenate([[0], stats.poisson.cdf(edges, mean), [1]]))
    assert stats.chisquare(count, fraction * len(draw)).pvalue > 1e-4


def test_mean_and_variance_of_huge_means():
    """Mean and variance of large numbers within four standard errors (1e-4)."""
    draw = poisson_quantile(1e9, np.random.default_rng(3).standard_normal(10**5)) - 1e9
    assert abs(draw.mean()) < 4 * np.sqrt(1e9 / 1e5)
    assert draw.var() == pytest.approx(1e9, rel=4 * np.sqrt(2 / 1e5))


def test_more_light_never_gives_fewer_electrons():
    """This keeps the noise of two designs correlated."""
    mean = np.geomspace(1e-3, 1e4, 2000)
    for normal in (-6.0, -2.0, 0.0, 0.1, 2.0, 6.0):
        assert (np.diff(poisson_quantile(mean, normal)) >= 0).all()


def test_edges():
    assert poisson_quantile(0.0, 3.0) == 0
    assert poisson_quantile(-1.0, 3.0) == 0
    assert np.isfinite(poisson_quantile(5.0, np.array([-40.0, 40.0]))).all()
