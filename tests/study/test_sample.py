import dataclasses

import numpy as np
import pytest
from scipy import stats

from startrack.study.montecarlo import Serial
from startrack.study.sample import WALKERS, _walk, designs_needed, sample
from startrack.study.surface import fit


def test_the_walk_finds_a_known_region():
    """ln rms = (x/a)^2 + (y/b)^2 below a sharp limit: a uniform ellipse, variances a^2 / 4."""
    rng = np.random.default_rng(0)
    place = rng.uniform(-1, 1, (60, 2))
    result = ((place / [0.4, 0.8]) ** 2).sum(axis=1, keepdims=True)
    surface = fit(place, result)
    sampler, autocorrelation = _walk(surface, 1.0, 2, seed=4)
    chain = sampler.get_chain(discard=sampler.iteration // 5, flat=True)
    np.testing.assert_allclose(chain.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(chain.std(axis=0), [0.2, 0.4], rtol=0.03)
    assert sampler.iteration > 50 * autocorrelation
    thinned = chain[:: int(4 * autocorrelation) * WALKERS + 7]
    radius = np.hypot(*(thinned / [0.4, 0.8]).T)
    assert stats.kstest(radius**2, "uniform").pvalue > 1e-3


def test_the_walk_is_reproducible():
    place = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    surface = fit(place, (place**2).sum(axis=1, keepdims=True))
    one, other = (_walk(surface, 0.5, 2, seed=9)[0].get_chain()[-1] for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_the_tolerance_region_of_a_small_tracker(small):
    campaign = dataclasses.replace(small.campaign, variables=small.campaign.variables[:2])
    count = []
    tolerance = sample(small.case, campaign, 3, Serial(), watch=lambda _: count.append(1))
    assert len(count) == designs_needed(2) == len(tolerance.evaluations)
    assert tolerance.converged
    assert tolerance.checks > 6
    assert 0 < tolerance.check_error < 1
    box = tolerance.box
    spread = np.ptp(tolerance.samples, axis=0)
    assert (tolerance.samples >= box.start - campaign.span - 1e-9).all()
    assert (tolerance.samples <= box.start + campaign.span + 1e-9).all()
    assert (spread > 0.1).all()
    centre = tolerance.evaluations[0].rms("across")
    assert tolerance.limit == pytest.approx(centre * (1 + campaign.margin))
