"""Chains of matches from a poor prediction, among more false spots than stars."""

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.identification import Identification
from startrack.identification.follow import follow
from startrack.identification.seen import see
from startrack.units import deg


def test_each_match_makes_the_windows_of_the_next_smaller(design, spots_at):
    """Eight stars and twenty false spots, the attitude known to 0.3 degrees.

    A window holds a false spot as often as not, so that chains are right only where each match
    moves and sharpens the attitude as it should. They were in some 75 % of such skies; half of 30
    is 4 standard deviations less.
    """
    camera = design(12, 6.0)
    rng, sigma = np.random.default_rng(1), np.full(3, 0.3 * deg)
    right = skies = 0
    while skies < 30:
        sky = camera.look(rng, noise=0.2)
        if len(sky.spots) < 8:
            continue
        skies += 1
        pixel = np.column_stack([sky.spots.x, sky.spots.y])[:8]
        pixel = np.concatenate([pixel, rng.random((20, 2)) * 1024 - 0.5])
        seen = see(spots_at(pixel, 0.2), np.arange(28), camera.camera, Identification())
        predicted = Rotation.from_rotvec(sigma * rng.standard_normal(3)) * sky.icrs_to_camera
        rotation, matches, log_p = follow(
            seen, camera.index.bright, predicted.as_matrix(), np.diag(sigma**2)
        )
        away = (Rotation.from_matrix(rotation) * sky.icrs_to_camera.inv()).magnitude()
        right += matches > 3 and log_p < np.log(1e-3) and away < 0.02 * deg
    assert right >= 12
