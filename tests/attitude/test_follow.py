import numpy as np
import pytest
from scipy import linalg, stats
from scipy.spatial.transform import Rotation

from startrack.attitude import (
    Gyroscope,
    LastingErrors,
    MeasuredAttitude,
    correct,
    correct_together,
    predict,
    start,
)
from startrack.core.units import arcsec, deg
from startrack.mission.fusion import fused_variance

GYROSCOPE = Gyroscope(angle_random_walk=2 * arcsec, rate_random_walk=0.05 * arcsec)
SEEN = np.diag([3.0, 3.0, 20.0]) ** 2 * arcsec**2
STEP = 0.25


def run(seed: int, steps: int, rate_size: float):
    """Filter a camera with random walks of rate and bias; error (6,) and covariance at the end."""
    rng = np.random.default_rng(seed)
    truth, bias = Rotation.from_quat(rng.standard_normal(4)), 5 * arcsec * rng.standard_normal(3)
    state = start(turned(truth, rng), SEEN, 5 * arcsec)
    for k in range(steps):
        rate = rate_size * np.array([np.sin(0.01 * k), np.cos(0.02 * k), 0.5])
        # What the gyroscope shows over a step, in ten parts so that the truth is not ours.
        white, walk = rng.standard_normal((2, 10, 3))
        walk = GYROSCOPE.rate_random_walk * np.sqrt(STEP / 10) * np.cumsum(walk, axis=0)
        white *= GYROSCOPE.angle_random_walk / np.sqrt(STEP / 10)
        shown = rate + bias + white.mean(axis=0) + walk[:-1].sum(axis=0) / 10
        bias = bias + walk[-1]
        truth = Rotation.from_rotvec(-rate * STEP) * truth
        state = predict(state, shown, STEP, GYROSCOPE)
        state = correct(state, turned(truth, rng), SEEN)
    error = (truth * state.icrs_to_camera.inv()).as_rotvec()
    return np.concatenate([error, bias - state.bias]), state.covariance


def turned(truth, rng):
    return Rotation.from_rotvec(np.sqrt(np.diag(SEEN)) * rng.standard_normal(3)) * truth


@pytest.mark.parametrize("rate", [pytest.param(0.0, marks=pytest.mark.slow), 1.0 * deg])
def test_errors_follow_the_covariance(rate):
    """Normalised error squared, 6 degrees of freedom, 12 runs; false alarm 1e-4."""
    total = 0.0
    for seed in range(12):
        error, covariance = run(seed, 40, rate)
        total += error @ np.linalg.solve(covariance, error)
    assert stats.chi2.cdf(total, 72) == pytest.approx(0.5, abs=0.5 - 1e-4)


def test_the_steady_state_solves_riccati():
    """At rest each axis is Farrenkopf's filter; scipy solves its Riccati equation."""
    state = start(Rotation.identity(), SEEN, 5 * arcsec)
    for _ in range(1500):
        prior = predict(state, np.zeros(3), STEP, GYROSCOPE)
        state = correct(prior, prior.icrs_to_camera, SEEN)
    white, walk = GYROSCOPE.angle_random_walk**2, GYROSCOPE.rate_random_walk**2
    carry = np.array([[1, STEP], [0, 1]])
    noise = np.array([[white * STEP, 0], [0, walk * STEP]])
    noise += walk * np.array([[STEP**3 / 3, STEP**2 / 2], [STEP**2 / 2, 0]])
    for axis in (0, 2):
        scale = SEEN[axis, axis]
        want = linalg.solve_discrete_are(
            carry.T, np.array([[1.0], [0]]), noise / scale, np.array([[1.0]])
        )
        got = prior.covariance[np.ix_([axis, axis + 3], [axis, axis + 3])] / scale
        np.testing.assert_allclose(got, want, rtol=1e-6)


def test_filtering_beats_single_attitudes():
    errors = np.array([run(seed, 100, 0.1 * deg)[0] for seed in range(8)])
    assert np.sqrt((errors[:, 2] ** 2).mean()) < 0.5 * np.sqrt(SEEN[2, 2])


def test_stars_rotate_against_the_rotation_of_the_camera():
    """The camera rotates by 90 degrees about its x axis: a direction along +y is then along +z."""
    state = predict(
        start(Rotation.identity(), SEEN, 0.0), np.array([90 * deg, 0, 0]), 1.0, GYROSCOPE
    )
    np.testing.assert_allclose(state.icrs_to_camera.apply([0, 0, 1]), [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize("known", [True, False])
def test_errors_that_last_are_followed_where_they_are_known(known):
    """Two thirds of the variance stay correlated over some 20 frames: 20 runs, false alarm 1e-4."""
    keep, total = 0.95, 0.0
    part, new = SEEN * 2 / 3, SEEN / 3
    errors = LastingErrors(part[None], np.full(1, keep)) if known else None
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sigma = np.sqrt(np.diag(part))
        slow = sigma * rng.standard_normal(3)
        truth = Rotation.identity()
        white = np.sqrt(np.diag(new))
        seen = Rotation.from_rotvec(slow + white * rng.standard_normal(3)) * truth
        state = start(seen, SEEN, 0.1 * arcsec, errors)
        for _ in range(20):
            shown = GYROSCOPE.angle_random_walk / np.sqrt(STEP) * rng.standard_normal(3)
            state = predict(state, shown, STEP, GYROSCOPE, errors)
            slow = keep * slow + np.sqrt(1 - keep**2) * sigma * rng.standard_normal(3)
            seen = Rotation.from_rotvec(slow + white * rng.standard_normal(3)) * truth
            state = correct(state, seen, new if known else SEEN)
        error = (state.icrs_to_camera * truth.inv()).as_rotvec()
        total += error @ np.linalg.solve(state.covariance[:3, :3], error)
    if known:
        # The gyroscope's bias is zero here, and its walk small beside its white noise.
        assert stats.chi2.cdf(total, 60) == pytest.approx(0.5, abs=0.5 - 1e-4)
    else:
        assert total > 1.5 * 60


@pytest.mark.parametrize("sigma", [600 * arcsec, 0.0])
def test_the_axes_of_a_gyroscope_are_found_by_turning(sigma):
    """Two rotations of 40 degrees about different axes; 12 gyroscopes, false alarm 1e-4.

    If the filter does not estimate the misalignment, a rotation of 40 degrees with axes 600 arcsec
    off ends with an error of 400 arcsec.
    """
    total, left = 0.0, []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        misalignment = 600 * arcsec * rng.standard_normal(3)
        truth = Rotation.from_quat(rng.standard_normal(4))
        state = start(turned(truth, rng), SEEN, 5 * arcsec, misalignment_sigma=sigma)
        bias = 5 * arcsec * rng.standard_normal(3)
        for k in range(80):
            rate = 4 * deg * np.array([k < 40, k >= 40, 0.0])
            white = GYROSCOPE.angle_random_walk / np.sqrt(STEP) * rng.standard_normal(3)
            shown = Rotation.from_rotvec(misalignment).apply(rate) + bias + white
            truth = Rotation.from_rotvec(-rate * STEP) * truth
            state = correct(predict(state, shown, STEP, GYROSCOPE), turned(truth, rng), SEEN)
        error = (truth * state.icrs_to_camera.inv()).as_rotvec()
        error = np.concatenate([error, bias - state.bias])
        if sigma:
            left.append(misalignment - state.misalignment)
            error = np.concatenate([error, left[-1]])
        total += error @ np.linalg.solve(state.covariance, error)
    if sigma:
        assert stats.chi2.cdf(total, 12 * 9) == pytest.approx(0.5, abs=0.5 - 1e-4)
        assert np.sqrt(np.mean(np.square(left))) < 120 * arcsec
    else:
        assert total > 100 * 12 * 6


TO_HEAD = Rotation.from_rotvec([70 * deg, 0, 0]) * Rotation.from_rotvec([0, 0, 30 * deg])


def heads_of(seed, sigma, keep=0.9):
    """A camera and a second head, misaligned by 40 arcsec, at 1 deg/s; each fails in a third of 40
    frames.

    Half of each variance stays correlated over some ten frames. Returns the errors (15 + 6,) and
    the covariance at the end: of attitude, bias, correlated errors of both heads, and alignment.
    """
    rng = np.random.default_rng(seed)
    to_head = Rotation.from_rotvec(40 * arcsec * rng.standard_normal(3)) * TO_HEAD
    truth, bias = Rotation.from_quat(rng.standard_normal(4)), 5 * arcsec * rng.standard_normal(3)
    root = np.sqrt(np.diag(SEEN) / 2)
    slow = root * rng.standard_normal((2, 3))
    errors = LastingErrors(np.array([SEEN / 2] * 2), np.full(2, keep))
    first = rng.integers(2)
    turns = Rotation.identity(), to_head
    seen = Rotation.from_rotvec(slow[first] + root * rng.standard_normal(3)) * turns[first] * truth
    state = start(seen, SEEN, 5 * arcsec, errors, heads=[(TO_HEAD, sigma)], head=first)
    rate = np.array([0.3, -0.8, 0.5]) * deg
    for _ in range(40):
        white = GYROSCOPE.angle_random_walk / np.sqrt(STEP) * rng.standard_normal(3)
        state = predict(state, rate + bias + white, STEP, GYROSCOPE, errors)
        truth = Rotation.from_rotvec(-rate * STEP) * truth
        slow = keep * slow + np.sqrt(1 - keep**2) * root * rng.standard_normal((2, 3))
        for head, turn in enumerate(turns):
            if rng.random() < 2 / 3:
                error = Rotation.from_rotvec(slow[head] + root * rng.standard_normal(3))
                state = correct(state, error * turn * truth, SEEN / 2, head)
    error = (truth * state.icrs_to_camera.inv()).as_rotvec()
    align = (to_head * state.to_head(1).inv()).as_rotvec()
    lasting = (slow - state.lasting).ravel()
    return np.concatenate([error, bias - state.bias, lasting, align]), state.covariance


@pytest.mark.parametrize("sigma", [40 * arcsec, 10 * arcsec])
def test_a_head_is_aligned_by_attitudes_of_both(sigma):
    """Normalised error squared of all 15 unknowns, 15 pairs of heads; false alarm 1e-4."""
    total, left = 0.0, []
    for seed in range(15):
        error, covariance = heads_of(seed, sigma)
        total += error @ np.linalg.solve(covariance, error)
        left.append(error[-3:])
    if sigma == 40 * arcsec:
        assert stats.chi2.cdf(total, 15 * len(error)) == pytest.approx(0.5, abs=0.5 - 1e-4)
        assert np.sqrt(np.mean(np.square(left))) < 15 * arcsec
    else:
        assert total > 1.3 * 15 * len(error)


def test_heads_of_one_time_are_fused_by_their_variances():
    """Heads 70 and 20 degrees apart: the filter's variance equals that of missions, which has
    another formula."""
    for angle in (70 * deg, 20 * deg):
        to_head = Rotation.from_rotvec([angle, 0, 0])
        state = start(Rotation.identity(), SEEN, 0.0, heads=[(to_head, 0.0)])
        state = correct(state, to_head, SEEN, 1)
        axes = np.array([[0, 0, 1.0], to_head.inv().apply([0, 0, 1.0])])
        across, about = (np.full((2, 1), SEEN[k, k]) for k in (0, 2))
        want = fused_variance(axes, across, about, np.full((2, 1), True), np.zeros(3))[:, 0]
        np.testing.assert_allclose(np.diag(state.covariance)[:3], want, rtol=1e-9)


@pytest.mark.slow
def test_heads_that_share_an_error_are_no_better_than_it():
    """From a prior with little information: the fused covariance, plus the shared variance once."""
    generator = np.random.default_rng(5)
    shared = 4 * arcsec**2 * np.diag([1.0, 2.0, 0.5])
    own = np.diag([1.0, 1.0, 30.0]) * arcsec**2
    truth = Rotation.from_quat(generator.standard_normal(4))
    vague = start(truth, np.eye(3) * (1000 * arcsec) ** 2, 1e-6, heads=[(TO_HEAD, 0.0)])
    turns = Rotation.identity(), TO_HEAD
    inverse = [turn.as_matrix().T @ np.linalg.inv(own) @ turn.as_matrix() for turn in turns]
    want = np.linalg.inv(sum(inverse)) + shared
    errors = []
    for _ in range(4000):  # of a variance 2.2 %; five standard errors: false alarms of 2e-6
        motion = Rotation.from_rotvec(generator.multivariate_normal(np.zeros(3), shared))
        seen = [
            MeasuredAttitude(
                Rotation.from_rotvec(generator.multivariate_normal(np.zeros(3), own))
                * (turn * motion * truth),
                own,
                head,
            )
            for head, turn in enumerate(turns)
        ]
        state = correct_together(vague, seen, shared)
        errors.append((state.icrs_to_camera * truth.inv()).as_rotvec())
    assert state.covariance[:3, :3] == pytest.approx(want, rel=1e-3, abs=1e-3 * want.max())
    assert np.abs(np.mean(np.square(errors), axis=0) / np.diag(want) - 1).max() < 0.11
