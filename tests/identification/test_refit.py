"""The focal length from matches, and the fields of view that are tried for an unknown camera."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.core.values import Matches, Status
from startrack.identification import Identification
from startrack.identification.agree import refit
from startrack.identification.blind import fields

pytestmark = pytest.mark.usefixtures("in_python")

STAR = np.random.default_rng(1).uniform(0, 1023, (30, 2))
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0])


def matched(camera, turn=TURN):
    """Matches of spots of this camera, as a tracker that assumes another camera gives them."""
    every, rough = np.arange(30), Rotation.from_rotvec([3e-4, 0, -2e-4])
    direction = TURN.inv().apply(camera.unproject(STAR))
    start = None if turn is None else rough * turn
    status = Status.NO_MATCH if turn is None else Status.SOLVED
    return Matches(status, "why", every, every, direction, camera, start, 1e-9)


@pytest.mark.parametrize("distortion", [{}, {"k1": -0.2, "k2": 0.05, "p1": 1e-3}])
@pytest.mark.parametrize("factor", [0.985, 1.0, 1.02])
def test_the_focal_length_of_the_spots_is_found(spots_at, distortion, factor):
    """Without noise, except for the effect of the prior and, with distortion, after three
    rounds."""
    believed = Camera(1024, 1024, 1500.0, **distortion)
    true = believed.scaled(factor)
    settings = Identification(focal_tolerance=0.03)
    got = refit(spots_at(STAR, 0.1), matched(true), believed, settings)
    assert got.focal_length_px == pytest.approx(1500 * factor, rel=5e-6 if distortion else 1e-6)
    held = refit(spots_at(STAR, 0.1), matched(true), believed, Identification(focal_tolerance=0.0))
    assert held == believed


def test_matches_that_are_not_solved_are_refused(spots_at):
    camera = Camera(1024, 1024, 1500.0)
    with pytest.raises(ValueError, match="matches must be solved, got no match: why"):
        refit(spots_at(STAR, 0.1), matched(camera, None), camera, Identification())


def test_fields_near_twelve_degrees_come_first():
    away = np.abs(np.log(np.array(fields()) / (12 * deg)))
    assert (np.diff(away) >= 0).all()
