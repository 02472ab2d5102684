"""One-to-one matches against a scan of all pairs, by their definition."""

import numpy as np
import pytest

from startrack.identification.agree import pair

pytestmark = pytest.mark.usefixtures("in_python")


def scan(plane, place, radius):
    """Each star takes its nearest spot within the radius, and each spot its nearest star."""
    apart = np.linalg.norm(place[:, None] - plane, axis=2)
    within = np.where(apart <= radius, apart, np.inf)
    takers = {}
    for star in range(len(place)):
        spot = int(np.argmin(within[star]))
        if np.isfinite(within[star, spot]):
            takers.setdefault(spot, []).append(star)
    return {spot: min(stars, key=lambda s: apart[s, spot]) for spot, stars in takers.items()}


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("even", [True, False])
def test_pairs_are_those_of_a_scan(seed, even):
    """So dense that stars compete for spots; with equal or different radii, some of them zero."""
    rng = np.random.default_rng(seed)
    plane, place = rng.random((40, 2)), rng.random((50, 2))
    radius = np.full(40, 0.1) if even else np.maximum(0.2 * rng.random(40) - 0.02, 0)
    spot, star, distance = pair(plane, place, radius)
    assert dict(zip(spot.tolist(), star.tolist(), strict=True)) == scan(plane, place, radius)
    assert (np.diff(spot) > 0).all()
    np.testing.assert_allclose(distance, np.linalg.norm(plane[spot] - place[star], axis=1))


def test_a_spot_just_at_its_radius_is_matched_on_either_side():
    radius = np.full(1, 0.5)
    for away in ([0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]):
        spot, star, distance = pair(np.array([away]), np.zeros((1, 2)), radius)
        assert (spot.tolist(), star.tolist(), distance.tolist()) == ([0], [0], [0.5])
    assert len(pair(np.array([[0.5000001, 0.0]]), np.zeros((1, 2)), radius)[0]) == 0


def test_the_first_of_two_spots_equally_near_is_taken():
    plane = np.array([[-0.25, 0.0], [0.25, 0.0]])
    spot, _, _ = pair(plane, np.zeros((1, 2)), np.full(2, 0.5))
    assert spot.tolist() == [0]


def test_nothing_pairs_with_nothing():
    none, some = np.empty((0, 2)), np.zeros((3, 2))
    for plane, place in ((none, none), (none, some), (some, none)):
        assert [len(part) for part in pair(plane, place, np.ones(len(plane)))] == [0, 0, 0]
