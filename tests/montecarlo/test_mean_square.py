"""Mean squares of errors from outcomes whose law is known."""

import math

import numpy as np
import pytest
from scipy import stats

from startrack.design.case import Fidelity
from startrack.montecarlo.estimate import combined, mean_square
from startrack.montecarlo.sampling import Sampling
from startrack.trial.chain import OUTCOMES

REPETITIONS = 120
FRAME, WINDOW, SPOTS, COVARIANCE = Fidelity
LOST = 0.1


def skies(rng, n):
    """Variance of the errors for each of several skies, 1 on average."""
    return rng.gamma(2.0, 0.5, n)


def outcomes(variance, noise, lost, fields=OUTCOMES):
    """Trials with errors of that variance, axis z three times as large, and some without any."""
    table = np.zeros(len(variance), fields)
    table["trial"] = np.arange(len(variance))
    for axis, one, scale in zip("xyz", noise, (1, 1, 3), strict=True):
        table[f"error_{axis}"] = scale * np.sqrt(variance) * one
        table[f"sigma_{axis}"] = scale * np.sqrt(variance)
    table["solved"] = ~lost
    for axis in "xyz":
        table[f"error_{axis}"][lost] = math.nan
        table[f"sigma_{axis}"][lost] = math.nan
    return table


def campaigns(rng, frames=200, windows=2000, drawn=4000):
    """Frames with controls, windows with a bias of a tenth, and covariance with separate noise."""
    variance, noise = skies(rng, drawn), rng.standard_normal((3, drawn))
    lost = rng.random(drawn) < LOST
    linear = 0.95 * noise + math.sqrt(1 - 0.95**2) * rng.standard_normal((3, drawn))
    fine = outcomes(variance, noise, lost, Sampling(control=True).dtype)
    across = variance * ((linear[:2] ** 2).mean(axis=0) - 1)
    fine["surplus_across"], fine["surplus_about"] = across, 9 * variance * (linear[2] ** 2 - 1)
    window = outcomes(variance, 1.1 * noise, lost)
    fast = outcomes(0.8 * variance, rng.standard_normal((3, drawn)), lost)
    return fine[:frames], window[:windows], fast


def by_ratio(rng):
    return mean_square(campaigns(rng, drawn=200)[1]), 1.21


def by_control(rng):
    return mean_square(campaigns(rng, drawn=200)[0]), 1.0


def by_windows(rng):
    fine, window, _ = campaigns(rng, drawn=2000)
    return combined([(fine, FRAME), (window, WINDOW)]), 1.0


def by_covariance(rng):
    fine, _, fast = campaigns(rng)
    return combined([(fine, FRAME), (fast, COVARIANCE)], about=True), 9.0


def by_spots(rng):
    fine, _, fast = campaigns(rng)
    return combined([(fine, FRAME), (fast, SPOTS)]), 1.0


def by_all(rng):
    fine, window, fast = campaigns(rng)
    levels = [(fine, FRAME), (window, WINDOW), (fast, COVARIANCE)]
    return combined(levels), 1.0


@pytest.mark.parametrize(
    ("estimate", "gain"),
    [
        (by_ratio, 0.8),
        (by_control, 1.4),
        (by_windows, 6.0),
        (by_covariance, 2.5),
        (by_spots, 1.8),
        (by_all, 6.0),
    ],
)
def test_they_are_unbiased_state_their_error_and_help(estimate, gain):
    """120 times: mean within 4 sigma, intervals within 92 % and their binomial bound (1e-4).

    `gain` is relative to the variance of frames alone. Across, the skies give 2 E v^2 - 1 = 2;
    about, 3 E v^2 - 1 = 3.5 times the square of the mean.
    """
    rng = np.random.default_rng(4)
    values, errors, hits = [], [], 0
    for _ in range(REPETITIONS):
        mean, truth = estimate(rng)
        interval = mean.interval()
        hits += interval.low <= truth <= interval.high
        values.append(mean.value)
        errors.append(mean.error)
    scatter = np.std(values)
    assert abs(np.mean(values) - truth) < 4 * scatter / np.sqrt(REPETITIONS)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(scatter, rel=0.2)
    assert hits >= stats.binom.ppf(1e-4, REPETITIONS, 0.92)
    alone = truth**2 * (3.5 if truth == 9 else 2) / (200 * (1 - LOST))
    assert alone / scatter**2 > gain


def test_sobol_takes_its_error_from_the_scrambles():
    """Each scramble has all variances once: no scatter. An incomplete round is not counted."""
    rng = np.random.default_rng(1)
    variance = np.array([rng.permutation(np.linspace(0.5, 1.5, 10)) for _ in range(16)]).T.ravel()
    table = outcomes(np.append(variance, np.full(7, 9.0)), np.ones((3, 167)), np.zeros(167, bool))
    mean = mean_square(table, sobol=True)
    assert mean.freedom == 15
    assert mean.value == pytest.approx(1)
    assert mean.error < 1e-9 < 0.02 < mean_square(table[:160]).error


def test_levels_that_share_too_little_are_refused():
    fine, window, fast = campaigns(np.random.default_rng(2))
    with pytest.raises(ValueError, match="frame and window must share at least 16 trials, got 10"):
        combined([(fine, FRAME), (window[:10], WINDOW)])
    with pytest.raises(ValueError, match="window must have at least 16 separate trials, got 0"):
        combined([(fine, FRAME), (window[:200], WINDOW)])
    nothing = fine.copy()
    nothing["solved"] = False
    assert math.isnan(combined([(nothing, FRAME), (fast, COVARIANCE)]).value)
    assert math.isnan(mean_square(nothing).value)
