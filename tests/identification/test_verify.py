"""Hypotheses from two stars, and the evidence with an uncertain focal length."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.identification import Identification
from startrack.identification.agree import Agreed
from startrack.identification.grids import VerificationStars, sky_grid
from startrack.identification.seen import see
from startrack.identification.verify import attempt_attitude, log_evidence_of_match, verify

pytestmark = pytest.mark.usefixtures("in_python")

CAMERA = Camera(1024, 1024, 2000.0)
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0])
STAR = np.random.default_rng(5).uniform(0, 1023, (12, 2))


def seen_at(spots_at, pixel, focal):
    settings = Identification(focal_tolerance=focal)
    return see(spots_at(pixel, 0.1), np.arange(len(pixel)), CAMERA, settings)


def voters():
    """The stars, each fainter than the one before."""
    sky = sky_grid(TURN.inv().apply(CAMERA.unproject(STAR)), 0.1)
    return VerificationStars(sky, 3.0 + 0.3 * sky.member, np.full(12, 0.3))


@pytest.mark.parametrize("scale", [0.95, 1.0, 1.08])
def test_two_stars_give_attitude_and_focal_length(spots_at, scale):
    """The separation determines any focal length."""
    spot = (STAR - CAMERA.centre) * scale + CAMERA.centre
    direction = TURN.inv().apply(CAMERA.unproject(STAR))
    seen = seen_at(spots_at, spot, 0.1)
    rotation, found = attempt_attitude(seen, np.array([3, 7, 1]), direction[3], direction[7])
    assert found == pytest.approx(scale, rel=2e-4)
    assert (Rotation.from_matrix(rotation) * TURN.inv()).magnitude() < 2e-4
    held = seen_at(spots_at, spot, 0.0)
    assert attempt_attitude(held, np.array([3, 7, 1]), direction[3], direction[7])[1] == 1.0


def evidence(spots_at, focal, scale=1.0):
    sky = voters()
    every = np.arange(12)
    seen = seen_at(spots_at, STAR[sky.sky.member], focal)
    zero = np.zeros(12)
    match = Agreed(every, every, zero, TURN.as_matrix(), scale)
    return log_evidence_of_match(seen, sky, every, match)


def test_a_focal_length_known_well_enough_is_no_unknown(spots_at):
    assert evidence(spots_at, 1e-7) == pytest.approx(evidence(spots_at, 0.0), abs=1e-5)
    assert evidence(spots_at, 0.01) < evidence(spots_at, 0.0) - 1


def test_a_focal_length_two_sigma_off_reduces_the_evidence_as_a_gaussian(spots_at):
    """For stars near the axis hardly anything else changes with the scale."""
    loss = evidence(spots_at, 0.003, 1.006) - evidence(spots_at, 0.003)
    assert loss == pytest.approx(-2, abs=0.1)


def test_a_true_hypothesis_is_verified_and_a_false_one_is_none(spots_at):
    sky = voters()
    seen = seen_at(spots_at, STAR, 0.01)
    true = verify(seen, sky, TURN.as_matrix(), 1.0, 4)
    assert true.matches == 12
    assert true.log_p < -60
    elsewhere = (Rotation.from_rotvec([0.05, 0.02, 0.0]) * TURN).as_matrix()
    false = verify(seen, sky, elsewhere, 1.0, 4)
    assert (false.matches, false.log_p) == (0, 0.0)
    # The same stars where the focal length lies far beyond its tolerance.
    wide = seen_at(spots_at, (STAR - CAMERA.centre) * 1.05 + CAMERA.centre, 0.01)
    assert verify(wide, sky, TURN.as_matrix(), 1.05, 4).matches == 0
