import numpy as np
import pytest
from scipy import stats

from startrack.montecarlo.attitudes import Regions


@pytest.mark.parametrize("regions", [Regions(), Regions(1, 7), Regions(9, 1)])
def test_directions_at_random_fall_evenly_into_the_regions(regions):
    """A normal vector has a direction at random; chi-square, false alarm 1e-4."""
    direction = np.random.default_rng(2).standard_normal((20_000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    count = np.bincount(regions.of(direction), minlength=len(regions))
    assert len(count) == len(regions)
    assert stats.chisquare(count).pvalue > 1e-4


def test_what_is_placed_in_a_region_lies_there_and_nowhere_else():
    regions = Regions(5, 8)
    cell = np.repeat(np.arange(len(regions)), 50)
    place = regions.place(cell, np.random.default_rng(3).random((len(cell), 2)))
    np.testing.assert_allclose(np.linalg.norm(place, axis=1), 1)
    np.testing.assert_array_equal(regions.of(place), cell)


def test_the_poles_have_a_region():
    poles = Regions().of(np.array([[0.0, 0, 1], [0, 0, -1]]))
    assert poles[0] >= len(Regions()) - 12
    assert poles[1] < 12
