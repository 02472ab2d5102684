"""Chains of matches from an inaccurate prediction, with more false spots than stars."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.identification import Identification
from startrack.identification.agree import Agreed
from startrack.identification.fit import derivatives
from startrack.identification.grids import VerificationStars, sky_grid
from startrack.identification.seen import see
from startrack.identification.track import _away, _chain, _misfit, _update, follow
from startrack.identification.verify import log_evidence_with_prior

IN_PYTHON = pytest.mark.usefixtures("in_python")

CAMERA = Camera(1024, 1024, 2000.0)
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0])
STAR = np.array([[500.0, 480.0], [200.0, 700.0], [850.0, 300.0], [400.0, 150.0], [760.0, 810.0]])


def seen_at(spots_at, pixel, sigma=0.5):
    settings = Identification(focal_tolerance=0.0)
    return see(spots_at(np.array(pixel), sigma), np.arange(len(pixel)), CAMERA, settings)


def expected_at(pixel):
    """Positions (m, 2) in the image plane and their derivatives (m, 2, 3) by the attitude."""
    star = TURN.inv().apply(CAMERA.unproject(np.array(pixel)))
    rows = np.array([derivatives(TURN.as_matrix(), d, 1.0)[:, :3] for d in star])
    return (np.array(pixel) - CAMERA.centre) / CAMERA.focal_length_px, rows


def voters():
    """The stars in the order of their brightness."""
    sky = sky_grid(TURN.inv().apply(CAMERA.unproject(STAR)), 0.1)
    return VerificationStars(sky, 3.0 + 0.3 * sky.member, np.full(len(STAR), 0.3))


def test_each_match_makes_the_windows_of_the_next_smaller(design, spots_at):
    """Eight stars and twenty false spots, the attitude known to 0.3 degrees.

    A window holds a false spot as often as not, so that chains are right only if each match shifts
    and sharpens the attitude as it should. They were right in some 75 % of such skies; half of 30
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


@IN_PYTHON
def test_a_match_adds_its_information(spots_at):
    """The state after three matches equals one weighted least-squares fit, by another algebra."""
    rng = np.random.default_rng(4)
    root = 2e-3 * rng.standard_normal((3, 3))
    spread = covariance = root @ root.T
    place, rows = expected_at(STAR)
    sigma = np.array([0.3, 0.9, 0.5, 0.5, 0.5])
    spots = spots_at(STAR + rng.normal(0, 2, STAR.shape), 0.5)
    spots.covariance[:] = np.eye(2) * sigma[:, None, None] ** 2
    seen = see(spots, np.arange(5), CAMERA, Identification())
    start = state = np.array([1e-3, -2e-3, 3e-3])
    information, right = np.linalg.inv(covariance), np.linalg.inv(covariance) @ start
    for k in (1, 0, 2):
        weight = 1 / seen.sigma[k] ** 2
        error = seen.plane[k] - place[k] - rows[k] @ state
        window = rows[k] @ spread @ rows[k].T + np.eye(2) / weight
        misfit = _misfit(seen, k, place[k], rows[k], state, spread)
        assert misfit == pytest.approx(error @ np.linalg.solve(window, error), rel=1e-9)
        information = information + weight * rows[k].T @ rows[k]
        right = right + weight * rows[k].T @ (seen.plane[k] - place[k])
        state, spread = _update(seen, k, place[k], rows[k], state, spread)
        np.testing.assert_allclose(spread, np.linalg.inv(information), rtol=1e-6)
        np.testing.assert_allclose(state, np.linalg.solve(information, right), rtol=1e-6)


@IN_PYTHON
@pytest.mark.parametrize("angle", [1e-6, 0.01, 0.5])
def test_the_difference_of_attitudes_is_a_rotation_vector(angle):
    """Times sin a / a, which is nearly one for small angles."""
    axis = np.array([2.0, -1.0, 2.0]) / 3
    other = Rotation.from_rotvec(angle * axis) * TURN
    away = _away(TURN.as_matrix(), other.as_matrix())
    np.testing.assert_allclose(away, np.sin(angle) * axis, atol=1e-15)


TIGHT = np.eye(3) * 1e-14  # radian^2, so that windows are those of the spots' noise


def chain(spots_at, spot, star, first=(0, 0)):
    place, rows = expected_at(star)
    spots, stars = _chain(seen_at(spots_at, spot), *first, place, rows, TIGHT)
    return list(zip(spots.tolist(), stars.tolist(), strict=True))


@IN_PYTHON
def test_a_spot_is_matched_to_one_star_only(spots_at):
    """If stars have one position, the brightest is matched and the others are not, in every
    rank."""
    twice = [STAR[0], STAR[1], STAR[1], STAR[0], STAR[2]]
    assert chain(spots_at, STAR[:3], twice) == [(0, 0), (1, 1), (2, 4)]
    assert chain(spots_at, STAR[:3], twice, (0, 3)) == [(0, 3), (1, 1), (2, 4)]
    assert chain(spots_at, STAR[:3], twice, (2, 4)) == [(2, 4), (0, 0), (1, 1)]


@IN_PYTHON
def test_a_star_is_matched_to_the_nearest_spot_only(spots_at):
    aside = [STAR[0], STAR[0] + [0.3, 0.0], STAR[1] + [0.0, 0.9], STAR[1], STAR[1] - [0.9, 0.0]]
    assert chain(spots_at, aside, STAR[:2]) == [(0, 0), (3, 1)]
    assert chain(spots_at, aside, STAR[:2], (1, 0)) == [(1, 0), (3, 1)]


@IN_PYTHON
@pytest.mark.parametrize(("off", "found"), [(3.95, True), (4.05, False)])
@pytest.mark.parametrize("side", [[1, 0], [0, 1], [-1, 0], [0.6, -0.8]])
def test_windows_end_at_four_sigma(spots_at, off, found, side):
    spot = [STAR[0], STAR[1] + 0.5 * off * np.array(side)]
    assert (len(chain(spots_at, spot, STAR[:2])) == 2) is found


@pytest.mark.parametrize(("sigmas", "found"), [(3.9, 5), (4.1, 0)])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_first_match_lies_within_four_sigma_of_the_prediction(spots_at, sigmas, found, axis):
    sigma = 2e-3
    off = Rotation.from_rotvec(sigmas * sigma * np.eye(3)[axis]) * TURN
    seen = seen_at(spots_at, STAR, 0.1)
    _, matches, _ = follow(seen, voters(), off.as_matrix(), np.eye(3) * sigma**2)
    assert matches == found


def test_one_match_is_no_chain(spots_at):
    rotation, matches, log_p = follow(
        seen_at(spots_at, STAR[:1]), voters(), TURN.as_matrix(), np.eye(3) * 1e-6
    )
    assert (matches, log_p) == (0, 0.0)
    np.testing.assert_array_equal(rotation, TURN.as_matrix())


NOTHING = np.empty((0, 0))


def evidence(seen, rotation, prior=NOTHING, log_prior=0.0):
    """ln of the evidence about an attitude, all spots being their stars."""
    sky = voters()
    every = np.arange(len(STAR))
    place = CAMERA.project(rotation.apply(sky.sky.direction))
    spot = sky.sky.member.astype(int)
    plane = (place - CAMERA.centre) / CAMERA.focal_length_px
    distance = np.linalg.norm(seen.plane[spot] - plane, axis=1)
    turn = rotation.as_matrix()
    match = Agreed(spot, every, distance, turn, 1.0)
    return log_evidence_with_prior(seen, sky, every, match, prior, log_prior)


@IN_PYTHON
def test_an_attitude_known_well_enough_is_no_unknown(spots_at):
    seen = seen_at(spots_at, STAR)
    _, matches, log_p = follow(seen, voters(), TURN.as_matrix(), TIGHT)
    assert matches == 5
    assert -log_p == pytest.approx(evidence(seen, TURN), abs=1e-4)


def test_the_attitude_of_a_chain_is_that_of_least_squares(spots_at):
    """Residuals over the noise of each spot, by scipy."""
    sigma = np.array([0.1, 0.9, 0.3, 0.6, 0.2])
    noise = np.random.default_rng(6).normal(0, sigma[:, None], STAR.shape)
    spots = spots_at(STAR + noise, 0.5)
    spots.covariance[:] = np.eye(2) * sigma[:, None, None] ** 2
    seen = see(spots, np.arange(5), CAMERA, Identification(focal_tolerance=0.0))
    direction = TURN.inv().apply(CAMERA.unproject(STAR))

    def residual(turn):
        pixel = CAMERA.project((Rotation.from_rotvec(turn * 1e-3) * TURN).apply(direction))
        return ((pixel - STAR - noise) / sigma[:, None]).ravel()

    best = Rotation.from_rotvec(least_squares(residual, np.zeros(3), xtol=1e-14).x * 1e-3) * TURN
    rotation, matches, _ = follow(seen, voters(), TURN.as_matrix(), np.eye(3) * 1e-4)
    assert matches == 5
    assert (Rotation.from_matrix(rotation) * best.inv()).magnitude() < 1e-8


@IN_PYTHON
def test_the_prior_of_the_attitude_is_a_gaussian(spots_at):
    """Its density by scipy at the solution, with ten times the sigma about each of three axes."""
    noise = np.random.default_rng(5).normal(0, 0.5, STAR.shape)
    seen = seen_at(spots_at, STAR + noise)
    root = np.array([[0.01, 0.0, 0.0], [0.004, 0.008, 0.0], [0.01, -0.01, 0.02]])
    covariance = root @ root.T
    off = Rotation.from_rotvec([0.002, -0.004, 0.003]) * TURN
    rotation, _, log_p = follow(seen, voters(), off.as_matrix(), covariance)
    fitted = Rotation.from_matrix(rotation)
    density = multivariate_normal(cov=covariance).logpdf((fitted * off.inv()).as_rotvec())
    assert -log_p == pytest.approx(
        evidence(seen, fitted, np.linalg.inv(covariance), density), abs=1e-3
    )
    loose = follow(seen, voters(), TURN.as_matrix(), covariance * 100)[2]
    looser = follow(seen, voters(), TURN.as_matrix(), covariance * 10_000)[2]
    assert looser - loose == pytest.approx(3 * np.log(10), abs=1e-3)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sigmas", [1.0, 2.0])
def test_a_wrong_prediction_reduces_the_evidence_as_a_gaussian(spots_at, axis, sigmas):
    """The spots are far more accurate, so that the loss is half of the squared error in sigmas."""
    sigma = np.array([0.004, 0.003, 0.01])
    covariance = np.diag(sigma**2)
    seen = seen_at(spots_at, STAR, 0.1)
    off = Rotation.from_rotvec(sigmas * sigma * np.eye(3)[axis]) * TURN
    best = follow(seen, voters(), TURN.as_matrix(), covariance)[2]
    rotation, matches, worse = follow(seen, voters(), off.as_matrix(), covariance)
    assert matches == 5
    assert (Rotation.from_matrix(rotation) * TURN.inv()).magnitude() < 1e-7
    assert worse - best == pytest.approx(sigmas**2 / 2, rel=0.02)
