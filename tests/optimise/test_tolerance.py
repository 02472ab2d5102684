import dataclasses

import numpy as np
import pytest
from intervals_oracles import posterior_error
from scipy import stats

from startrack.design import DesignSpace
from startrack.optimise import TrackerSource
from startrack.optimise.ensemble import Ensembles, draw
from startrack.optimise.runner import TrialRunner
from startrack.optimise.tolerance import designs_needed, fit_surface, region_of, sample


def tracker(small, campaign, seed):
    space = DesignSpace(small.case, campaign.variables, campaign.links)
    return TrackerSource(space, campaign, TrialRunner(seed))


def test_the_sampled_region_is_that_of_a_grid():
    """Means and deviations of two variables, against sums over a million points.

    Chains end with at least 400 independent samples: 0.05 of a deviation is one standard error of a
    mean, and 0.2 four of them, so that one of four figures exceeds it with 3e-4.
    """
    assert posterior_error(150) < 0.2


@pytest.mark.slow
def test_the_region_of_a_known_surface_is_found():
    """ln rms = (x/a)^2 + (y/b)^2 below a sharp limit: a uniform ellipse, variances a^2 / 4."""
    rng = np.random.default_rng(0)
    coordinates = rng.uniform(-1, 1, (60, 2))
    result = ((coordinates / [0.4, 0.8]) ** 2).sum(axis=1, keepdims=True)
    chains = draw(
        region_of(fit_surface(coordinates, result), 1.0),
        lambda rng, n: 0.2 * rng.uniform(-1, 1, (n, 2)),
        seed=4,
        settings=Ensembles(count=2, walkers=32, stretch=2400),
    )
    assert chains.converged, chains.reason_unconverged
    chain = chains.flat
    np.testing.assert_allclose(chain.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(chain.std(axis=0), [0.2, 0.4], rtol=0.03)
    # Odd, so that it takes turns through the walkers, of which there are 32.
    stride = 4 * len(chain) // int(chains.effective.min()) | 1
    thinned = chain[::stride]
    radius = np.hypot(*(thinned / [0.4, 0.8]).T)
    assert stats.kstest(radius**2, "uniform").pvalue > 1e-3


def test_a_signal_in_the_density_ends_it_without_a_word(capfd):
    """emcee prints the traceback of any exception of its function."""
    calls = []

    def density(points):
        calls.append(len(points))
        if len(calls) > 100:
            raise KeyboardInterrupt
        return -(points**2).sum(axis=1)

    with pytest.raises(KeyboardInterrupt):
        draw(density, lambda rng, n: rng.normal(size=(n, 2)), seed=1)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_the_tolerance_region_of_a_small_tracker(small):
    campaign = dataclasses.replace(small.campaign, variables=small.campaign.variables[:2])
    count = []
    tolerance = sample(tracker(small, campaign, 3), watch=count.append)
    assert sum(count) == designs_needed(2) == tolerance.designs
    assert tolerance.chains.converged
    assert tolerance.checks > 6
    assert 0 < tolerance.check_error < 1
    space = tolerance.source
    spread = np.ptp(tolerance.samples, axis=0)
    assert (tolerance.samples >= space.start - campaign.span - 1e-9).all()
    assert (tolerance.samples <= space.start + campaign.span + 1e-9).all()
    assert (spread > 0.1).all()
    assert tolerance.centre.trials == campaign.sample_trials
    assert tolerance.limit == pytest.approx(tolerance.centre.error * (1 + campaign.margin))


@pytest.mark.slow
def test_the_probability_of_the_region_is_kept_by_the_budget(small):
    """Twelve designs of the region: the surface predicts a fraction, the budget finds one.

    Three standard errors of a binomial of 12 around one half: 0.43.
    """
    campaign = dataclasses.replace(
        small.campaign, variables=small.campaign.variables[:2], sample_trials=40
    )
    tolerance = sample(tracker(small, campaign, 4))
    assert tolerance.kept == pytest.approx(tolerance.expected, abs=0.43)


def test_a_design_that_misses_what_cannot_be_changed_is_refused(small, monkeypatch):
    monkeypatch.setattr("startrack.optimise.tolerance.DESIGNS_PER_TERM", 0.5)  # one and two
    tight = dataclasses.replace(small.campaign.requirements, max_power=0.01)
    campaign = dataclasses.replace(
        small.campaign, requirements=tight, variables=small.campaign.variables[2:3], sample_trials=4
    )
    with pytest.raises(ValueError, match="no variable changes"):
        sample(tracker(small, campaign, 3))
