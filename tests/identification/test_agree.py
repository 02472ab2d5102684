"""Matching and fitting in turn, about a group of stars with one false spot far from it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.identification import Identification
from startrack.identification.agree import agree, settle
from startrack.identification.seen import see

CAMERA = Camera(1024, 1024, 4000.0)
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0])
GROUP = np.array([[60.0, 50.0], [90.0, 55.0], [70.0, 85.0], [95.0, 80.0], [75.0, 60.0]])
LURED = np.array([900.0, 880.0])


def seen_at(spots_at, pixel, sigma=0.1, **settings):
    return see(spots_at(pixel, sigma), np.arange(len(pixel)), CAMERA, Identification(**settings))


def stars_at(pixel):
    """Directions in the sky, and their places in the plane."""
    return TURN.inv().apply(CAMERA.unproject(pixel)), (pixel - CAMERA.centre) / 4000.0


@pytest.mark.parametrize("number", range(6))
def test_what_is_left_out_of_the_first_fit_pulls_no_more(spots_at, number):
    """The false spot, 15 pixels from a star, is believed with the group, and is not without it."""
    star = np.insert(GROUP, number, LURED, axis=0)
    spot = star.copy()
    spot[number] += [10.0, -11.0]
    direction, place = stars_at(star)
    seen = seen_at(spots_at, spot)
    reach, every = 20 / 4000, np.arange(6)
    start = TURN.as_matrix()
    lured = agree(seen, direction, every, place, start, 1.0, reach, 3)
    assert number in lured.spot
    free = agree(seen, direction, every, place, start, 1.0, reach, 3, number)
    assert free.spot.tolist() == [k for k in range(6) if k != number]
    assert (Rotation.from_matrix(free.rotation) * TURN.inv()).magnitude() < 1e-6


def test_an_attitude_some_pixels_off_is_brought_back(spots_at):
    """All stars within the match radius of one another's noise are found, and the scale."""
    rng = np.random.default_rng(2)
    star = rng.uniform(0, 1023, (20, 2))
    direction, _ = stars_at(star)
    spot = (star - CAMERA.centre) * 1.002 + CAMERA.centre
    off = Rotation.from_rotvec([4e-4, -5e-4, 1e-3]) * TURN
    x, y, z = off.apply(direction).T
    found = agree(
        seen_at(spots_at, spot), direction, np.arange(20), np.column_stack([x / z, y / z]),
        off.as_matrix(), 1.0, 6 / 4000, 4,
    )  # fmt: skip
    assert found.spot.tolist() == found.taken.tolist() == list(range(20))
    assert found.scale == pytest.approx(1.002, rel=1e-6)
    assert (Rotation.from_matrix(found.rotation) * TURN.inv()).magnitude() < 1e-8
    assert found.distance.max() < 1e-6


def test_given_matches_are_weighed_by_their_noise_and_what_all_show_beyond_it(spots_at):
    """Two noise levels: errors of 1500 fits are as small as those of the best weights.

    With equal weights they would be larger by a fifth. With all noise unstated, weights become
    equal, and nothing else changes.
    """
    rng = np.random.default_rng(3)
    sigma = np.where(np.arange(24) % 2, 0.1, 0.6)
    errors = {"stated": [], "unstated": []}
    best = []
    for _ in range(300):
        star = rng.uniform(0, 1023, (24, 2))
        direction, _ = stars_at(star)
        spots = spots_at(star + sigma[:, None] * rng.standard_normal((24, 2)), 0.1)
        every = np.arange(24)
        for name, errors_of in errors.items():
            spots.covariance[:] = np.eye(2) * (
                sigma[:, None, None] ** 2 if name == "stated" else 1e-4
            )
            seen = see(spots, every, CAMERA, Identification(focal_tolerance=0.0))
            rotation, scale = settle(seen, direction, every, every, TURN.as_matrix(), 1.0)
            assert scale == 1.0
            away = (Rotation.from_matrix(rotation) * TURN.inv()).as_rotvec()[:2] * 4000
            errors_of.append((away**2).mean())
        best.append(1 / (sigma**-2).sum())
    # Means of 600 squares are known to 6 %; with equal weights, 0.5 (0.1^2 + 0.6^2) / 24.
    assert np.mean(errors["stated"]) == pytest.approx(np.mean(best), rel=0.25)
    assert np.mean(errors["unstated"]) == pytest.approx(0.185 / 24, rel=0.25)
