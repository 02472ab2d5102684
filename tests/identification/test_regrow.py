"""A patch of true stars, and a distant false match that determines the roll or focal length."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import Status
from startrack.core.camera import Camera
from startrack.identification import Identification, identify
from startrack.identification.agree import Gathered
from startrack.identification.grids import VerificationStars, sky_grid
from startrack.identification.regrow import is_doubtful, is_held_by_one, regrown
from startrack.identification.seen import see

IN_PYTHON = pytest.mark.usefixtures("in_python")

CAMERA = Camera(1024, 1024, 2900.0)
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0])
PATCH = np.array([[640.0, 450.0], [672.0, 455.0], [625.0, 440.0], [660.0, 478.0], [645.0, 486.0]])
OTHERS = np.random.default_rng(4).uniform(0, 1023, (15, 2))
NOISE = 0.3  # pixel


def sky_of(spots_at, scale, focal):
    """Spots of twenty stars for a scaled focal length, and the stars that verify."""
    rng = np.random.default_rng(8)
    star = np.concatenate([PATCH, OTHERS])
    spot = (star - CAMERA.centre) * scale + CAMERA.centre + NOISE * rng.standard_normal((20, 2))
    seen = see(spots_at(spot, NOISE), np.arange(20), CAMERA, Identification(focal_tolerance=focal))
    sky = sky_grid(TURN.inv().apply(CAMERA.unproject(star)), 0.1)
    stars = VerificationStars(sky, 2.0 + 0.15 * sky.member, np.full(20, 0.3))
    return seen, stars, TURN.inv().apply(CAMERA.unproject(star))


def held_by(seen, direction, roll, false):
    """The patch rotated about its middle, and one false match at a star's predicted place."""
    middle = TURN.inv().apply(CAMERA.unproject(PATCH.mean(axis=0))).reshape(3)
    rotation = TURN * Rotation.from_rotvec(roll * middle)
    spot = np.array([0, 1, 2, 3, 4, false])
    seen_at = np.append(seen.plane[false], 1.0)
    lured = rotation.inv().apply(seen_at / np.linalg.norm(seen_at))
    ray = np.vstack([direction[:5], lured])
    return Gathered(spot, spot.copy(), ray, rotation.as_matrix(), rotation.as_quat(), 1.0)


def off(rotation):
    return (Rotation.from_matrix(rotation) * TURN.inv()).magnitude()


@IN_PYTHON
@pytest.mark.parametrize("focal", [0.0, 0.01])
def test_the_other_stars_are_found_from_the_patch(spots_at, focal):
    """After a rotation by 2 deg about the patch, no other star is within 2 pixels of its spot."""
    seen, stars, direction = sky_of(spots_at, 1.0, focal)
    held = held_by(seen, direction, 0.035, 11)
    assert is_doubtful(seen, held)
    rotation, scale = regrown(seen, stars, held, 4)
    assert off(held.rotation) > 0.03
    assert off(rotation) < 3e-4
    assert scale == pytest.approx(1.0, abs=5e-4)


@IN_PYTHON
def test_a_focal_length_far_beyond_its_tolerance_is_found(spots_at):
    seen, stars, direction = sky_of(spots_at, 1.03, 0.01)
    rotation, scale = regrown(seen, stars, held_by(seen, direction, 0.03, 11), 4)
    assert scale == pytest.approx(1.03, abs=5e-4)
    assert off(rotation) < 3e-4


@IN_PYTHON
def test_matches_that_check_each_other_are_not_doubtful(spots_at):
    """Seven matches spread over the frame; a patch of five with one far match has no such check."""
    seen, _, direction = sky_of(spots_at, 1.0, 0.01)
    turn = TURN.as_matrix(), TURN.as_quat(), 1.0
    spread, alone = np.arange(5, 12), np.array([0, 1, 2, 3, 4, 9])
    assert not is_doubtful(seen, Gathered(spread, spread, direction[spread], *turn))
    assert is_doubtful(seen, Gathered(alone, alone, direction[alone], *turn))
    assert is_held_by_one(seen, Gathered(alone, alone, direction[alone], *turn), 0.8)
    most = np.arange(10)
    assert not is_doubtful(seen, Gathered(most, most, direction[most], *turn))


def test_a_cluster_and_one_match_alone_are_ambiguous(design, towards, spots_at):
    """Six Pleiades and a spot at a star's place for a wrong roll, with false spots but no other
    star."""
    known = design(20, 5.0)
    ra, dec = np.radians([56.75, 24.12])
    pleiades = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    turn = towards(pleiades)
    ahead = turn.apply(known.stars.direction)
    pixel = known.camera.project(ahead)
    near = np.linalg.norm(pixel - known.camera.centre, axis=1) < 60
    group = np.flatnonzero((ahead[:, 2] > 0.9) & near & (known.stars.magnitude_g < 5))
    rolled = turn * Rotation.from_rotvec(0.04 * pleiades)
    inside = rolled.apply(known.stars.direction)
    place = known.camera.project(inside)
    bright = (inside[:, 2] > 0.9) & known.camera.holds(place) & (known.stars.magnitude_g < 4.2)
    far = np.flatnonzero(bright)[
        np.argmax(np.linalg.norm(place - known.camera.centre, axis=1)[bright])
    ]
    false = np.random.default_rng(3).uniform(0, 1023, (12, 2))
    spots = np.concatenate([pixel[group], place[[far]], false])
    magnitude = np.concatenate([known.stars.magnitude_g[[*group, far]], np.full(12, 5.5)])
    brightest = np.argsort(magnitude)
    seen = spots_at(spots[brightest], 0.2)
    seen = replace(seen, flux=10 ** (-0.4 * magnitude[brightest]))
    found = known.solve(seen)
    assert len(group) == 6
    assert found.status is Status.AMBIGUOUS
    assert "one alone determines the roll" in found.reason


@pytest.mark.parametrize("seed", [23, 61, 124])
def test_the_pleiades_and_one_false_match_are_no_sky(design, towards, seed):
    """A focal length 3 % off: six Pleiades and a false spot determined the roll in an earlier
    version."""
    known = design(20, 5.0)
    ra, dec = np.radians([56.75, 24.12])
    pleiades = [np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)]
    rng = np.random.default_rng(seed)
    aside = Rotation.from_rotvec([*rng.uniform(-0.15, 0.15, 2), 0])
    attitude = aside * towards(pleiades, rng.uniform(0, 6.28))
    seen = known.look(rng, attitude=attitude, noise=0.2, false=5, missing=0.1)
    far = identify(
        seen.spots, known.camera.scaled(1.03), known.stars, known.index, Identification()
    )
    assert far.icrs_to_camera is None
    assert "spots are stars for a focal length -2.9 % off" in far.reason
    near = known.solve(seen.spots)
    assert seen.error(near) < 1
    assert (seen.star[near.spot] == near.star).mean() > 0.9
