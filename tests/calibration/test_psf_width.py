import numpy as np
import pytest
from scipy import stats

from startrack.calibration.psf_width import width_likelihood
from startrack.core.values import Frame, Spots

LOW, HIGH = 0.3, 2.5
GRID = np.linspace(np.log(LOW), np.log(HIGH), 2001)


def image(sigma, rng, flux=20_000.0, stars=12, gain=2.0, read=8.0, known=True):
    """A frame of Gaussian stars, far apart, and the spots that a detection would give.

    Drawn on a grid of a hundredth of a pixel; the model under test integrates by a formula.
    """
    side, fine = 40 * stars, 100
    electrons = np.full((41, side), 50.0)
    x, y = 40 * np.arange(stars) + 20 + rng.uniform(-0.5, 0.5, (2, stars)) * [[1], [0]]
    y = 20 + rng.uniform(-0.5, 0.5, stars)
    at = np.arange(-10, 11)
    sub = (np.arange(fine) + 0.5) / fine - 0.5
    for one_x, one_y, one_flux in zip(x, y, np.broadcast_to(flux, stars), strict=True):
        left, top = round(one_x), round(one_y)
        along = [
            stats.norm.pdf(at[:, None] + middle + sub - one, scale=sigma).mean(axis=1)
            for middle, one in ((top, one_y), (left, one_x))
        ]
        electrons[top - 10 : top + 11, left - 10 : left + 11] += one_flux * np.outer(*along)
    value = rng.poisson(electrons) + rng.normal(0, read, electrons.shape)
    told = {"electrons_per_dn": gain, "read_noise": read} if known else {}
    frame = Frame(value / gain + 100, offset=100.0, **told)
    off = rng.normal(0, 0.02, (2, stars))
    one = np.ones(stars)
    covariance = np.tile(4e-4 * np.eye(2), (stars, 1, 1))
    return frame, Spots(x + off[0], y + off[1], flux * one, covariance, 100 * one, one.astype(int))


def posterior(likelihood):
    """The fraction of the posterior below each width of the grid."""
    log = likelihood(GRID)
    density = np.exp(log - log.max())
    return (np.cumsum(density) - density / 2) / density.sum()


@pytest.mark.parametrize("known", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_rank_of_the_true_width_is_uniform(known):
    """40 widths of the prior, by a test of Kolmogorov and Smirnov at 1e-3.

    Without the gain all pixels have the same weight, which is right if read noise dominates.
    """
    rng = np.random.default_rng(4)
    ranks = []
    for _ in range(40):
        sigma = np.exp(rng.uniform(np.log(0.5), np.log(1.5)))
        flux = rng.uniform(20_000, 60_000, 4)
        frame, spots = image(sigma, rng, flux, 4, read=8.0 if known else 100.0, known=known)
        fraction = posterior(width_likelihood([frame], [spots], LOW, HIGH))
        ranks.append(np.interp(np.log(sigma), GRID, fraction))
    assert stats.kstest(ranks, "uniform").pvalue > 1e-3


def test_more_light_tells_more():
    rng = np.random.default_rng(5)
    spread = []
    for flux in (4000.0, 16_000.0):
        frame, spots = image(0.8, rng, flux)
        fraction = posterior(width_likelihood([frame], [spots], LOW, HIGH))
        low, high = np.interp([0.16, 0.84], fraction, GRID)
        spread.append(high - low)
    # Between the laws of photons (2) and of read noise (4).
    assert 1.8 < spread[0] / spread[1] < 4.2


def test_stars_that_are_not_alone_or_saturated_say_nothing():
    rng = np.random.default_rng(6)
    frame, spots = image(0.8, rng, stars=1)
    flat = Frame(np.minimum(frame.image, 150.0))
    with pytest.raises(ValueError, match="width of the PSF, got none"):
        width_likelihood([flat], [spots], LOW, HIGH)
    frame, spots = image(0.8, rng, stars=2)
    near = Spots(
        np.array([20.0, 25.0]),
        spots.y,
        *(getattr(spots, name) for name in ("flux", "covariance", "snr", "area")),
    )
    with pytest.raises(ValueError, match="got none"):
        width_likelihood([frame], [near], LOW, HIGH)
