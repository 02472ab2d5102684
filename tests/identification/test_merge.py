"""Merged close stars: which are merged, their light and their direction."""

import numpy as np
import pytest

from startrack.core.values import Stars
from startrack.identification.index import local_rank, merged

ARC = 1e-4  # radian


def row(arcs, magnitude, colour=None):
    """Stars on the meridian at given angles from the pole."""
    angle = ARC * np.array(arcs)
    direction = np.column_stack([np.sin(angle), np.zeros(len(angle)), np.cos(angle)])
    colour = np.zeros(len(angle)) if colour is None else np.array(colour)
    return Stars(100 + np.arange(len(angle)), direction, np.array(magnitude), colour)


def arcs(stars):
    return np.arctan2(stars.direction[:, 0], stars.direction[:, 2]) / ARC


def test_a_star_four_times_brighter_draws_the_centre_of_light_so_much_nearer():
    left, names = merged(
        row([0.0, 0.9], [5.0, 5.0 - 2.5 * np.log10(4)], [0.3, 1.1]), resolution=ARC
    )
    assert arcs(left) == pytest.approx([0.72])
    assert left.magnitude_g == pytest.approx([5.0 - 2.5 * np.log10(5)])
    # Name and colour are those of the brighter.
    assert (left.identifier.tolist(), left.colour.tolist(), names.tolist()) == ([101], [1.1], [1])
    np.testing.assert_allclose(np.linalg.norm(left.direction, axis=1), 1, atol=1e-15)


@pytest.mark.parametrize(("apart", "count"), [(0.999, 1), (1.001, 2)])
def test_stars_merge_up_to_the_resolution(apart, count):
    assert len(merged(row([0.0, apart], [3.0, 4.0]), ARC)[0]) == count
    wide = merged(row([0.0, apart * 1e4], [3.0, 4.0]), 1e4 * ARC)  # where the chord is no arc
    assert len(wide[0]) == count


def test_a_merged_star_merges_no_other():
    """In a chain the middle star merges with the brightest end, and the other end stays alone."""
    left, names = merged(row([0.0, 0.9, 1.8], [2.0, 3.0, 4.0]), ARC)
    assert names.tolist() == [0, 2]
    np.testing.assert_array_equal(left.direction[1], row([1.8], [4.0]).direction[0])
    assert left.magnitude_g[1] == pytest.approx(4.0)


def test_a_star_between_two_goes_to_the_brighter():
    left, _ = merged(row([0.0, 0.9, 1.8], [3.0, 9.0, 2.0]), ARC)
    assert left.identifier.tolist() == [102, 100]
    assert left.magnitude_g[1] == pytest.approx(3.0)
    assert left.magnitude_g[0] == pytest.approx(-2.5 * np.log10(10**-0.8 + 10**-3.6))


def test_stars_leave_brightest_first_and_alone_to_the_last_digit():
    rng = np.random.default_rng(1)
    magnitude = rng.permutation(np.linspace(1.0, 7.0, 50))
    stars = row(10.0 * rng.permutation(50), magnitude)
    left, names = merged(stars, ARC)
    np.testing.assert_array_equal(names, np.argsort(magnitude))
    np.testing.assert_array_equal(left.direction, stars.direction[names])
    np.testing.assert_allclose(left.magnitude_g, np.sort(magnitude), rtol=1e-14)


@pytest.mark.parametrize("most", [1, 2, 5])
@pytest.mark.parametrize("radius", [0.05, 0.3, 1.0])
def test_stars_that_are_thinned_out_do_not_count_as_neighbours(most, radius):
    """Ranks by a scan over all stars; the sky has stars at the poles of all axes."""
    rng = np.random.default_rng(2)
    star = rng.standard_normal((400, 3))
    star /= np.linalg.norm(star, axis=1, keepdims=True)
    star[50:56] = np.concatenate([np.eye(3), -np.eye(3)])
    cosine = star @ star.T
    rank = np.empty(400, int)
    for s in range(400):
        near = (cosine[s, :s] >= np.cos(radius)) & (rank[:s] < most)
        rank[s] = min(near.sum(), most)
    np.testing.assert_array_equal(local_rank(star, radius, most), rank)


def test_neighbours_end_at_the_radius():
    star = np.eye(3)
    assert local_rank(star, 1.57, 10).tolist() == [0, 0, 0]
    assert local_rank(star, 1.571, 10).tolist() == [0, 1, 2]
