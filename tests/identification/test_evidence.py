"""The evidence of a match, against sums and integrals over all averaged quantities."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy import special, stats

from startrack.identification.evidence import (
    DEPTHS,
    EXCESSES,
    LOG_ATTITUDES,
    _log_determinant,
    _log_mean,
    _log_seen,
    log_evidence,
)

IN_PYTHON = pytest.mark.usefixtures("in_python")

SHIFT = np.tile(np.eye(2), (3, 1, 1))  # (k, 2, 2): the unknowns move all places alike
FLAT = np.zeros((2, 2))


def of(residual, variance, radius=0.0, area=4.0, spots=5, prior=FLAT, rows=SHIFT):
    """ln of the evidence of three matches with the three brightest of six stars."""
    square = (residual**2).sum(axis=1)
    ranks = np.arange(3)
    return log_evidence(square, variance, ranks, rows, prior, 0.0, spots, 6, area, radius)


def integral(residual, variance, radius, prior=FLAT):
    """Mean over the excess noise of the likelihood's integral over all shifts, on a grid."""
    at = np.linspace(-0.6, 0.6, 121)  # six steps in a sigma: the sum is exact
    x, y = np.meshgrid(at, at)
    total = 0.0
    for excess in EXCESSES:
        density = np.exp(-0.5 * (prior[0, 0] * x**2 + 2 * prior[0, 1] * x * y + prior[1, 1] * y**2))
        for r, v in zip(residual, variance + (excess * radius) ** 2, strict=True):
            sigma = np.sqrt(v)
            density = (
                density * stats.norm.pdf(r[0] - x, 0, sigma) * stats.norm.pdf(r[1] - y, 0, sigma)
            )
        total += density.sum() * (at[1] - at[0]) ** 2 / len(EXCESSES)
    return np.log(total)


@pytest.mark.parametrize("radius", [0.0, 0.3])
def test_unknowns_are_integrated_out(radius):
    """A Gaussian likelihood, for which Laplace's method is exact: a shift of all places.

    The factors for detected stars are the same for all, and cancel in the difference.
    """
    rng = np.random.default_rng(1)
    one = rng.normal(0, 0.05, (3, 2))
    one -= one.mean(axis=0)  # the best shift is zero
    noise = np.full(3, 0.004)
    prior = np.array([[90.0, 20.0], [20.0, 60.0]])
    for residual, variance, about in (
        (2 * one, noise, FLAT),
        (one, 2 * noise, FLAT),
        (np.zeros((3, 2)), np.array([0.004, 0.01, 0.007]), FLAT),
        (one, noise, prior),
    ):
        got = of(residual, variance, radius, prior=about) - of(one, noise, radius)
        wanted = integral(residual, variance, radius, about) - integral(one, noise, radius)
        assert got == pytest.approx(wanted, abs=1e-6)


def test_a_spot_by_chance_lies_anywhere_in_the_image():
    """Its density is one over the area: a match in a larger image is stronger evidence."""
    one, noise = np.zeros((3, 2)), np.full(3, 0.004)
    ratio = of(one, noise, area=12.0) - of(one, noise, area=4.0)
    assert ratio == pytest.approx(3 * np.log(3))


def test_without_stars_the_evidence_of_any_attitude_is_the_same():
    """The prior density, by scipy, times the volume of the unknowns' posterior is one."""
    none = np.empty((0, 2, 2))
    empty = np.empty(0)
    prior = np.array([[90.0, 20.0], [20.0, 60.0]])
    every = [
        log_evidence(empty, empty, np.empty(0, int), none, about, density, 5, 6, 4.0, 0.1)
        for about, density in (
            (prior, stats.multivariate_normal(cov=np.linalg.inv(prior)).logpdf([0, 0])),
            (2 * prior, stats.multivariate_normal(cov=np.linalg.inv(2 * prior)).logpdf([0, 0])),
        )
    ]
    unknown = log_evidence(
        empty, empty, np.empty(0, int), none[..., :0], FLAT[:0, :0], 0.0, 5, 6, 4.0, 0.1
    )
    np.testing.assert_allclose(every, unknown, atol=1e-12)


@pytest.mark.parametrize(("spots", "stars"), [(4, 3), (9, 12), (30, 60)])
def test_bright_stars_are_stronger_evidence_than_faint_ones(spots, stars):
    """A missing bright star is evidence against a match, as is a star fainter than all detected
    ones."""

    def seen(ranks):
        many = len(ranks)
        zero, noise, rows = np.zeros(many), np.full(many, 0.01), np.empty((many, 2, 0))
        return log_evidence(
            zero, noise, np.array(ranks), rows, FLAT[:0, :0], 0.0, spots, stars, 4.0, 0.1
        )

    best = seen([0, 1, 2])
    for ranks in combinations(range(min(stars, 8)), 3):
        assert seen(ranks) <= best
    if stars > 2 * DEPTHS[0]:
        assert seen([0, 1, stars - 1]) < seen([0, 1, 2 * DEPTHS[0] - 1]) < best


def test_evidence_by_chance_is_one_in_the_mean():
    """The sum over all ways in which two spots may be two of three stars: at most one, and not
    small.

    Two spots at random in the unit square, no unknowns. The mean over chance of the sum over all
    matches is that of a model's likelihood ratio, thus one except for spots outside the image and
    for the number of spots, which the model would often have otherwise; 0.1 % alarms.
    """
    rng = np.random.default_rng(3)
    star = np.array([[0.3, 0.3], [0.7, 0.4], [0.5, 0.8]])
    nothing = FLAT[:0, :0]
    sums = []
    for _ in range(4000):
        spot = rng.random((2, 2))
        square = ((spot[:, None] - star) ** 2).sum(axis=2)
        total = 0.0
        for first in range(-1, 3):
            for second in range(-1, 3):
                if first == second >= 0:
                    continue
                pairs = [(i, j) for i, j in enumerate((first, second)) if j >= 0]
                near = np.array([square[pair] for pair in pairs])
                ranks = np.array([j for _, j in pairs], int)
                rows = np.empty((len(pairs), 2, 0))
                total += np.exp(
                    log_evidence(
                        near, np.full(len(pairs), 0.01), ranks, rows, nothing, 0.0, 2, 3, 1.0, 0.0
                    )
                )
        sums.append(total)
    mean, error = np.mean(sums), np.std(sums) / np.sqrt(len(sums))
    assert mean < 1 + 3.1 * error
    assert mean > 0.3


def test_random_attitudes_have_the_stated_density():
    """A fraction (a - sin a) / pi of them is closer than an angle a to a given one: a ball of
    radius a."""
    angle = 1e-2
    fraction = (angle - np.sin(angle)) / np.pi
    assert np.exp(-LOG_ATTITUDES) * 4 / 3 * np.pi * angle**3 == pytest.approx(fraction, rel=1e-5)


@IN_PYTHON
@pytest.mark.parametrize("unknowns", range(6))
def test_the_determinant_is_numpys(unknowns):
    root = np.random.default_rng(unknowns).standard_normal((unknowns, unknowns + 2)) * 30
    matrix = root @ root.T
    wanted = np.linalg.slogdet(matrix)[1]
    # Only the lower half is given.
    assert _log_determinant(np.tril(matrix)) == pytest.approx(wanted, abs=1e-9)


@IN_PYTHON
def test_the_mean_of_large_numbers_is_scipys():
    logarithm = np.array([-3000.0, 2000.0, 2001.5, 1999.0])
    wanted = special.logsumexp(logarithm) - np.log(4)
    assert _log_mean(logarithm) == pytest.approx(wanted, rel=1e-14)


@IN_PYTHON
@pytest.mark.parametrize("ranks", [[], [0], [3], [4], [7], [8], [17, 18], [0, 2, 5, 9, 20]])
def test_detected_stars_are_binomial_and_clutter_is_poisson(ranks):
    """The factors of L by scipy: the number of false spots for this hypothesis and for clutter
    alone, each star detected or missed, and the accuracy of the first."""
    for depth, stars in product((4, 9), (3, 4, 7, 8, 9, 18, 40)):
        seen = np.array([rank for rank in ranks if rank < stars], int)
        place = np.arange(stars)
        shown = np.where(place < depth, 0.85, np.where(place < 2 * depth, 0.2, 0.01))
        coin = stats.bernoulli(shown)
        known = coin.logpmf(np.isin(place, seen)).sum()
        for spots in (5, 12, 30):
            clutter, left = max(spots - shown.sum(), 1.0), spots - len(seen)
            wanted = known + stats.poisson.logpmf(left, clutter)
            wanted -= stats.poisson.logpmf(left, spots)
            spread = clutter + coin.var()[: 2 * depth].sum()
            wanted += min(0.5 * np.log(spread / spots), 0.0)
            found = _log_seen(seen, depth, spots, stars)
            assert found == pytest.approx(wanted, abs=1e-9), (depth, stars, spots)
