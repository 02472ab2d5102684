"""Images of unknown lenses: fields of 2 to 90 degrees, distortion, fisheyes."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, open_sky
from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.core.values import Matches, Status
from startrack.identification import Identification, build_index, fit_lens, identify_blind
from startrack.identification.blind import FISHEYE, cameras, fields, fisheye, tolerance_of
from startrack.identification.index import indexed_field
from startrack.identification.lens_fit import AXIS
from tests.identification.conftest import make_spots

SIZE = 1024
NOISE = 0.15  # pixel
STARS = open_sky(Selection("bright", limit_g=6.5)).stars
SLOW = pytest.mark.slow
# As 25 photographs by a camera of a single-board computer have it.
WIDE = Camera(SIZE, SIZE, 1071.0, -6.7, -25.0, k1=0.18, k2=-0.34)


@cache
def of_field(field):
    """The pattern index of a field with a quarter of the usual triangles, which is quicker to
    build."""
    return build_index(STARS, field, triangles=300_000)


def indexes(camera):
    return of_field(indexed_field(camera))


def equidistant(direction, focal):
    """Pixels of a fisheye, from the formula itself."""
    x, y, z = direction.T
    angle, apart = np.arctan2(np.hypot(x, y), z), np.hypot(x, y)
    return (SIZE - 1) / 2 + focal * angle[:, None] * direction[:, :2] / apart[:, None]


def sky(project, number, limit=5.0, most=60, half=65 * deg):
    """Spots of the brightest stars in the image, with false ones among them.

    half  radian, from the axis beyond which there is no image: OpenCV's distortion folds back
    """
    rng = np.random.default_rng([20261122, number])
    turn = Rotation.random(random_state=rng)
    bright = np.flatnonzero(STARS.magnitude_g < limit)
    bright = bright[np.argsort(STARS.magnitude_g[bright])]
    direction = turn.apply(STARS.direction[bright])
    direction = direction[direction[:, 2] > np.cos(half)]
    pixel = project(direction)
    pixel = pixel[((pixel > -0.5) & (pixel < SIZE - 0.5)).all(axis=1)][:most]
    false = rng.uniform(0, SIZE - 1, (len(pixel) // 5, 2))
    place = np.concatenate([pixel + rng.normal(0, NOISE, pixel.shape), false])
    order = np.argsort(np.concatenate([np.arange(len(pixel)), rng.uniform(5, 60, len(false))]))
    return turn, make_spots(place[order], NOISE), len(pixel)


def test_no_index_is_built_for_too_few_spots():
    """It would take seconds, and a blank image has no solution for any field."""

    def build(camera):
        raise AssertionError(f"an index of {camera.fov_x / deg:g} deg")

    place, settings = np.random.default_rng(1).uniform(0, SIZE, (9, 2)), Identification()
    for count, status in ((0, Status.BLANK), (2, Status.TOO_FEW)):
        spots = make_spots(place[:count], NOISE)
        found = identify_blind(spots, SIZE, SIZE, STARS, build, settings)
        assert found.status == status
        assert f"{count} usable spots" in found.reason
    with pytest.raises(AssertionError, match="an index of"):
        identify_blind(make_spots(place, NOISE), SIZE, SIZE, STARS, build, settings)


def axis_of(camera, turn):
    """The direction of the centre of the image, ICRS axes."""
    return turn.inv().apply(camera.unproject(np.array([[(SIZE - 1) / 2] * 2]))[0])


@pytest.mark.slow  # tests/test_real_images.py solves real ones
def test_the_distortion_of_a_wide_lens_is_found_in_one_image():
    normalised, shares = [], []
    for number in range(6):
        turn, spots, true = sky(WIDE.project, number, half=38 * deg)
        matches = identify_blind(spots, SIZE, SIZE, STARS, indexes, Identification())
        assert matches.icrs_to_camera is not None
        index = indexes(matches.camera)
        found = fit_lens(spots, matches, STARS, index, Identification())
        shares.append(len(found.matches) / true)
        error = found.icrs_to_image.apply(axis_of(WIDE, turn))[:2]
        variance = found.covariance.diagonal()[[1, 0]]
        assert np.hypot(*error) < 1.0 / WIDE.focal_length_px  # a pixel
        # Without the allowance for what the model lacks, which is nothing here.
        normalised += list(error / np.sqrt(variance - (AXIS / WIDE.focal_length_px) ** 2))
    assert np.mean(shares) > 0.95
    # 12 values: the scatter of a right sigma lies between with 99.9 %.
    assert 0.4 < np.sqrt(np.mean(np.square(normalised))) < 1.75


@pytest.mark.parametrize("field", [12, *(pytest.param(field, marks=SLOW) for field in (4, 30, 55))])
def test_a_lens_without_distortion_has_none(field):
    """Significance above ten is a false alarm in fewer than 1 of 1000 stages."""
    camera = Camera.from_field_of_view(SIZE, SIZE, field * deg)
    found = []
    for number in range(2):
        _, spots, true = sky(camera.project, number, 6.5, 40)
        if true < 10:
            continue
        matches = identify_blind(spots, SIZE, SIZE, STARS, indexes, Identification())
        if matches.icrs_to_camera is not None:
            lens = fit_lens(spots, matches, STARS, indexes(matches.camera), Identification())
            found.append(lens.matches.camera.distorted)
    assert found
    assert not any(found)


@pytest.mark.parametrize("count", [5, pytest.param(6, marks=SLOW)])
def test_few_stars_state_their_error(count):
    """Noise of 0.3 pixel that spots state as 0.1: the factor of Student's distribution covers
    it."""
    rng, over = np.random.default_rng(count), []
    for _ in range(60):
        true = Camera(SIZE, SIZE, 3900.0, *rng.normal(0, 5, 2), k1=rng.normal(0, 0.05))
        place = rng.uniform(0, SIZE - 1, (count, 2))
        axis, direction = axis_of(true, Rotation.identity()), true.unproject(place)
        spots, index = make_spots(place + rng.normal(0, 0.3, place.shape), 0.1), np.arange(count)
        start = Rotation.from_rotvec(rng.normal(0, 1e-3, 3))
        guess = Camera(SIZE, SIZE, 3900.0 * np.exp(rng.normal(0, 0.03)))
        matches = Matches(Status.SOLVED, "", index, index, direction, guess, start, 1e-9)
        lens = fit_lens(spots, matches, STARS, None, Identification())
        error = lens.icrs_to_image.apply(axis)[:2]
        over.append(np.hypot(*error) / np.sqrt(lens.covariance.diagonal()[:2].mean()))
    assert np.median(over) < 1.18
    assert np.percentile(over, 95) < 2.45


@pytest.mark.parametrize("field", [pytest.param(50, marks=SLOW), pytest.param(65, marks=SLOW), 80])
def test_fisheyes_are_solved(field):
    focal = SIZE / (field * deg)
    apart = []
    for number in range(2):
        turn, spots, _ = sky(lambda direction: equidistant(direction, focal), number)
        matches = identify_blind(spots, SIZE, SIZE, STARS, indexes, Identification())
        assert matches.icrs_to_camera is not None
        lens = fit_lens(spots, matches, STARS, indexes(matches.camera), Identification())
        error = lens.icrs_to_image.apply(turn.inv().apply([0.0, 0.0, 1.0]))[:2]
        apart.append(np.hypot(*error) * focal)
    assert np.median(apart) < 0.5
    assert max(apart) < 2.0


def test_the_camera_of_a_fisheye_images_angles_in_proportion():
    for field, most in ((50, 0.05), (60, 0.2), (75, 1.5), (90, 10)):
        camera = fisheye(SIZE, SIZE, field * deg)
        angle = np.linspace(0.01, field * deg / 2 * 1.41, 50)
        direction = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
        true = equidistant(direction, SIZE / (field * deg))
        assert np.abs(camera.project(direction) - true).max() < most


def test_the_cameras_that_are_tried_leave_no_gap():
    tried = fields()
    made = cameras(SIZE, SIZE)
    assert len(made) == len(tried) + np.count_nonzero(np.array(tried) >= FISHEYE)
    share = [tolerance_of(field) for field in tried]
    assert share == [one for _, one in made[: len(tried)]]
    # Each focal length between those of 2 and 90 degrees lies within the tolerance of a try.
    focal = np.array([camera.focal_length_px for camera, _ in made[: len(tried)]])
    low, high = focal / (1 + np.array(share)), focal / (1 - np.array(share))
    between = SIZE / 2 / np.tan(np.geomspace(2, 90, 5000) * deg / 2)
    held = (between[:, None] > low * (1 - 1e-9)) & (between[:, None] < high * (1 + 1e-9))
    assert held.any(axis=1).all()
