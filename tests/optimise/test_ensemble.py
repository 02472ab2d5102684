import numpy as np
import pytest
from scipy import special, stats

from startrack.optimise.ensemble import Chains, Ensembles, draw
from startrack.optimise.ledger import Ledger

# As many samples as four ensembles of 16 walkers, in half of the time.
FEW = Ensembles(count=2, walkers=32)
COVARIANCE = np.array([[1.0, 0.9], [0.9, 2.0]])


def gauss(coordinates):
    return -0.5 * np.einsum("ni,ij,nj->n", coordinates, np.linalg.inv(COVARIANCE), coordinates)


def wide(rng, n):
    return rng.normal(0, 2, (n, 2))


def banana(coordinates):
    """y - x^2 normal around 0 with sigma 0.5, x with sigma 1: E y = 1, var y = 2 + 0.25."""
    x, y = coordinates.T
    return -0.5 * x**2 - 0.5 * ((y - x**2) / 0.5) ** 2


def test_a_gaussian_has_its_moments():
    chains = draw(gauss, wide, seed=1, settings=FEW)
    assert chains.converged, chains.reason_unconverged
    effective = chains.effective.min()
    # Six standard errors of a mean, and of a variance; false alarm 1e-8.
    np.testing.assert_allclose(chains.flat.mean(axis=0), 0, atol=6 * np.sqrt(2 / effective))
    np.testing.assert_allclose(
        np.cov(chains.flat.T), COVARIANCE, atol=6 * 2 * np.sqrt(2 / effective)
    )


def test_a_banana_has_its_moments():
    chains = draw(banana, wide, seed=2, settings=FEW)
    assert chains.converged, chains.reason_unconverged
    x, y = chains.flat.T
    error = np.sqrt(1 / chains.effective.min())
    assert x.mean() == pytest.approx(0, abs=6 * error)
    assert x.var() == pytest.approx(1, abs=6 * 1.5 * error)
    assert y.mean() == pytest.approx(1, abs=6 * 1.5 * error)
    assert y.var() == pytest.approx(2.25, abs=6 * 10 * error)  # y is nearly a chi-square


@pytest.mark.slow
def test_ensembles_that_found_different_peaks_are_not_believed():
    """Two peaks 40 sigma apart; each ensemble starts at one of them."""

    def two(coordinates):
        return np.logaddexp(
            -0.5 * (coordinates[:, 0] - 20) ** 2, -0.5 * (coordinates[:, 0] + 20) ** 2
        )

    def start(rng, n):
        return rng.choice([-20, 20]) + rng.normal(0, 1, (n, 1))

    settings = Ensembles(count=2, stretch=1500, most_steps=1500)
    chains = draw(two, start, seed=1, settings=settings)
    assert not chains.converged
    assert "ensembles differ" in chains.reason_unconverged


def test_a_short_chain_is_not_believed():
    chains = draw(banana, wide, seed=2, settings=Ensembles(stretch=100, most_steps=100))
    assert "autocorrelation" in chains.reason_unconverged


def test_a_chain_goes_on_where_it_was_cut_short(tmp_path):
    settings = Ensembles(stretch=100, most_steps=200)
    whole = draw(banana, wide, 3, settings)

    class Cut(Exception):
        pass

    calls = []

    def fails(coordinates):
        calls.append(1)
        if len(calls) == 600:
            raise Cut
        return banana(coordinates)

    with Ledger(tmp_path / "chains.sqlite") as ledger, pytest.raises(Cut):
        draw(fails, wide, 3, settings, ledger)
    with Ledger(tmp_path / "chains.sqlite") as ledger:
        again = draw(banana, wide, 3, settings, ledger)
    np.testing.assert_array_equal(again.samples, whole.samples)
    assert again.acceptance == whole.acceptance


def test_a_noisy_log_probability_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="noisier than 1"):
        draw(lambda p: gauss(p) + rng.normal(0, 3, len(p)), wide, 1)


@pytest.mark.slow
def test_noise_that_is_small_leaves_the_law_as_it_is():
    """exp(noise) has the same mean everywhere, so that the samples follow the law
    (pseudo-marginal)."""
    rng = np.random.default_rng(0)
    chains = draw(
        lambda p: -0.5 * p[:, 0] ** 2 + rng.normal(0, 0.5, len(p)),
        lambda rng, n: rng.normal(0, 2, (n, 1)),
        1,
        Ensembles(count=2, walkers=32, stretch=1800),
    )
    assert chains.converged, chains.reason_unconverged
    assert chains.flat.var() == pytest.approx(1, abs=6 * np.sqrt(2 / chains.effective.min()))


def test_nan_is_refused():
    with pytest.raises(ValueError, match="NaN"):
        draw(lambda p: np.full(len(p), np.nan), wide, 1)


def test_r_hat_of_independent_halves_is_one():
    """ANOVA: (B / W) n has a chi-square over its freedom; its 99.9 % quantile is not exceeded."""
    samples = np.random.default_rng(1).normal(size=(4, 1000, 10, 1))
    r_hat = Chains(samples, 0.5, np.ones(1)).split_r_hat[0]
    assert r_hat**2 - 1 < stats.chi2.isf(1e-3, 7) / 7 / 5000


@pytest.mark.slow
def test_a_corner_between_limits_of_eight_variables_is_left():
    """A wedge of the first two variables; by symmetry the mean of the first is 0."""

    def log_probability(x):
        across, along = x[:, 0], 0.5 * x[:, 1]
        inside = special.log_ndtr((0.3 - 0.2 * np.abs(x).sum(axis=1)) / 0.01)
        inside += special.log_ndtr((0.02 - across - along) / 5e-4)
        inside += special.log_ndtr((0.02 + across - along) / 5e-4)
        return np.where((np.abs(x) <= 1).all(axis=1), inside, -np.inf)

    def start(rng, n):
        return 0.3 * rng.uniform(-1, 1, (n, 8))

    found = draw(log_probability, start, 1, Ensembles(most_steps=4000))
    assert found.converged, found.reason_unconverged
    first = found.flat[:, 0]
    assert abs(first.mean()) < 4 * first.std() / np.sqrt(found.effective[0])
