"""All matches at an attitude, and the focal length from them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.identification import Identification
from startrack.identification.agree import _brightest, gather
from startrack.identification.grids import sky_grid
from startrack.identification.seen import see

pytestmark = pytest.mark.usefixtures("in_python")

CAMERA = Camera(1024, 1024, 2000.0)
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0])
RNG = np.random.default_rng(1)
STAR = np.concatenate([RNG.uniform(0, 1023, (12, 2)), RNG.uniform(1300, 4000, (40, 2))])
DIRECTION = TURN.inv().apply(CAMERA.unproject(STAR))
MAGNITUDE = RNG.uniform(2.0, 6.0, len(STAR))


def gathered(spots_at, pixel, sigma=0.1, focal=0.01, start=TURN):
    seen = see(
        spots_at(pixel, sigma), np.arange(len(pixel)), CAMERA, Identification(focal_tolerance=focal)
    )
    return gather(seen, sky_grid(DIRECTION, 0.1), MAGNITUDE, start.as_matrix(), 1.0)


def stretched(scale):
    return (STAR[:12] - CAMERA.centre) * scale + CAMERA.centre


def test_matches_are_indices_into_the_catalogue(spots_at):
    """Spots in another order than the stars, some of them false."""
    order = np.random.default_rng(2).permutation(12)
    pixel = np.insert(STAR[order], [3, 9], [[30.5, 1000.5], [1010.5, 20.5]], axis=0)
    found = gathered(spots_at, pixel)
    assert found.spot.tolist() == [k for k in range(14) if k not in (3, 10)]
    np.testing.assert_array_equal(found.star, order)
    np.testing.assert_array_equal(found.direction, DIRECTION[order])
    np.testing.assert_allclose(found.rotation, TURN.as_matrix(), atol=1e-9)
    assert (Rotation.from_quat(found.quaternion) * TURN.inv()).magnitude() < 1e-9


@pytest.mark.parametrize(
    ("true", "believed"), [(0.9985, 0.9985), (1.0015, 1.0015), (0.997, 0.998), (1.003, 1.002)]
)
def test_the_focal_length_stays_within_its_tolerance(spots_at, true, believed):
    """Except for the effect of the prior."""
    found = gathered(spots_at, stretched(true), focal=0.002)
    assert len(found.spot) == 12
    assert found.scale == pytest.approx(believed, abs=5e-6)


def test_a_focal_length_without_tolerance_is_kept(spots_at):
    assert gathered(spots_at, stretched(1.0004), focal=0.0).scale == 1.0


@pytest.mark.parametrize(
    ("pixel", "sigma", "count"), [(1.6, 0.1, 12), (2.4, 0.1, 0), (3.6, 1.0, 12), (4.4, 1.0, 0)]
)
def test_a_start_wrong_by_the_match_radius_or_four_sigma_is_corrected(
    spots_at, pixel, sigma, count
):
    """Two pixels, or four sigma of the noise if that is more; rotated about a distant axis."""
    off = Rotation.from_rotvec([pixel / 2000 * 0.6, pixel / 2000 * 0.8, 0.0]) * TURN
    # The place of a star off the axis moves by up to a tenth more than one at the centre.
    middle = (STAR[:12] - CAMERA.centre) * 0.3 + CAMERA.centre
    seen = see(spots_at(middle, sigma), np.arange(12), CAMERA, Identification(focal_tolerance=0.0))
    sky = sky_grid(TURN.inv().apply(CAMERA.unproject(middle)), 0.1)
    found = gather(seen, sky, MAGNITUDE[:12], off.as_matrix(), 1.0)
    assert len(found.spot) == count


@pytest.mark.parametrize("extra", [-1, 0, 1, 90])
def test_only_the_brightest_stars_are_predicted(spots_at, extra):
    """Twice as many stars as spots, plus fifty; here five spots, thus 60 stars."""
    rng = np.random.default_rng(3)
    count = 60 + extra
    direction = TURN.inv().apply(CAMERA.unproject(rng.uniform(0, 1023, (count, 2))))
    magnitude = rng.uniform(2.0, 6.0, count)
    sky = sky_grid(direction, 0.1)
    seen = see(spots_at(STAR[:5], 0.1), np.arange(5), CAMERA, Identification())
    star, place = _brightest(seen, sky, magnitude, TURN.as_matrix(), 1.0)
    wanted = np.argsort(magnitude)[:60]
    assert set(sky.member[star]) == set(wanted.tolist())
    pixel = CAMERA.project(TURN.apply(sky.direction[star]))
    np.testing.assert_allclose(place, (pixel - CAMERA.centre) / 2000, atol=1e-12)


def test_two_stars_are_enough_and_one_is_not(spots_at):
    assert len(gathered(spots_at, STAR[:2], focal=0.0).spot) == 2
    rough = Rotation.from_rotvec([2e-4, 0.0, 0.0]) * TURN
    moved = gathered(spots_at, STAR[:2], focal=0.0, start=rough)
    assert (Rotation.from_matrix(moved.rotation) * TURN.inv()).magnitude() < 1e-9
    kept = gathered(spots_at, STAR[:1], focal=0.0, start=rough)
    assert (Rotation.from_matrix(kept.rotation) * rough.inv()).magnitude() < 1e-12
