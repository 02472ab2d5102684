import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from startrack.attitude import KnownErrors, SolverSettings, refine, solve
from startrack.attitude.refine import refine_all
from startrack.core.camera import Camera
from startrack.core.values import Matches, Spots, Status

CAMERA = Camera(1024, 1024, 4800.0)
EXACT = SolverSettings(centroid_floor=0.0)


def sky(n: int, seed: int = 0, camera: Camera = CAMERA):
    """Stars in the field of a random attitude: attitude, pixels, ICRS directions."""
    rng = np.random.default_rng(seed)
    attitude = Rotation.from_quat(rng.standard_normal(4))
    pixel = rng.uniform(0, 1023, (n, 2))
    return attitude, pixel, attitude.inv().apply(camera.unproject(pixel))


def spots_of(pixel, sigma) -> Spots:
    n = len(pixel)
    one = np.ones(n)
    return Spots(*pixel.T, one, np.tile(np.eye(2) * sigma**2, (n, 1, 1)), one, np.ones(n, int))


def matches_of(direction, camera=CAMERA) -> Matches:
    index = np.arange(len(direction))
    return Matches(Status.SOLVED, "", index, index, direction, camera, None, 1e-9)


def test_markley_mortari_scenario_1():
    """Published: 40, 2.7, 2.7 arcsec about the boresight (x there) and across it.

    Markley & Mortari (2000), J. Astronaut. Sci. 48, 359: five stars 4.35 degrees apart, noise
    6 arcsec per axis. Here the boresight is z; 39.56 and 2.686 are the model's exact values.
    """
    plane = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * 0.07584 / 0.99712
    noise = 6 / 206265 * CAMERA.focal_length_px
    pixel = plane * CAMERA.focal_length_px + CAMERA.centre
    covariance = np.tile(np.eye(2) * noise**2, (5, 1, 1))
    got = refine(pixel, covariance, CAMERA.unproject(pixel), CAMERA, Rotation.identity())
    sigma = np.degrees(np.sqrt(np.diag(got.covariance))) * 3600
    np.testing.assert_allclose(sigma, [2.686, 2.686, 39.56], rtol=0.006)


def test_noise_free_stars_give_the_attitude_to_the_last_digits():
    for seed in range(20):
        attitude, pixel, direction = sky(8, seed)
        got = solve(spots_of(pixel, 0.1), matches_of(direction), EXACT)
        assert (got.icrs_to_camera * attitude.inv()).magnitude() < 3e-15
        assert got.residual_rms < 1e-10


def test_refinement_restores_what_a_bad_start_lost():
    attitude, pixel, direction = sky(6)
    start = Rotation.from_rotvec([0.02, -0.03, 0.05]) * attitude
    got = refine(pixel, np.tile(np.eye(2), (6, 1, 1)), direction, CAMERA, start)
    assert (got.icrs_to_camera * attitude.inv()).magnitude() < 3e-15


def test_errors_follow_the_reported_covariance():
    """Normalised error squared over 1000 noisy fields: chi-square of 3000; false alarm 1e-4."""
    rng = np.random.default_rng(4)
    total, loss = 0.0, 0.0
    for seed in range(1000):
        attitude, pixel, direction = sky(7, seed)
        covariance = np.array([np.diag(s) for s in rng.uniform(0.02, 0.5, (7, 2)) ** 2])
        noise = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * rng.standard_normal((7, 2))
        got = refine(pixel + noise, covariance, direction, CAMERA, attitude)
        error = (got.icrs_to_camera * attitude.inv()).as_rotvec()
        total += error @ np.linalg.solve(got.covariance, error)
        loss += got.chi_square.sum()
    assert stats.chi2.cdf(total, 3000) == pytest.approx(0.5, abs=0.5 - 1e-4)
    assert stats.chi2.cdf(loss, 1000 * 11) == pytest.approx(0.5, abs=0.5 - 1e-4)


def test_excess_residuals_enlarge_the_covariance():
    _, pixel, direction = sky(500, 3)
    noise = np.random.default_rng(1).standard_normal(pixel.shape)
    stated, honest = (
        solve(spots_of(pixel + noise, sigma), matches_of(direction), EXACT).covariance
        for sigma in (0.1, 1.0)
    )
    assert np.trace(stated) == pytest.approx(np.trace(honest), rel=0.1)


def test_a_distorted_camera_is_undone():
    camera = Camera(1024, 1024, 1500.0, 5.0, -3.0, k1=-0.15, k2=0.03, p1=1e-3)
    attitude, pixel, direction = sky(10, 2, camera)
    got = solve(spots_of(pixel, 0.1), matches_of(direction, camera), EXACT)
    assert (got.icrs_to_camera * attitude.inv()).magnitude() < 1e-11


def test_permuting_the_stars_changes_nothing():
    _, pixel, direction = sky(9, 6)
    pixel = pixel + np.random.default_rng(0).normal(0, 0.2, pixel.shape)
    order = np.random.default_rng(1).permutation(9)
    one = solve(spots_of(pixel, 0.2), matches_of(direction), EXACT)
    other = solve(spots_of(pixel[order], 0.2), matches_of(direction[order]), EXACT)
    assert (one.icrs_to_camera * other.icrs_to_camera.inv()).magnitude() < 1e-14


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_stars_are_a_status(count):
    _, pixel, direction = sky(5)
    got = solve(spots_of(pixel[:count], 0.1), matches_of(direction[:count]), EXACT)
    assert got.status is Status.TOO_FEW
    assert got.icrs_to_camera is None
    assert "direction" in got.reason


def test_the_same_star_twice_is_too_few():
    _, pixel, direction = sky(5)
    got = solve(spots_of(pixel[[0, 0]], 0.1), matches_of(direction[[0, 0]]), EXACT)
    assert got.status is Status.TOO_FEW


def test_an_unsolved_match_stays_unsolved():
    index = np.zeros(0, int)
    none = Matches(Status.NO_MATCH, "why", index, index, np.zeros((0, 3)), CAMERA, None, 1.0)
    got = solve(spots_of(np.zeros((0, 2)), 1.0), none, EXACT)
    assert (got.status, got.reason) == (Status.NO_MATCH, "why")
    assert got.covariance.shape == (3, 3)
    assert np.isnan(got.covariance).all()
    assert np.isnan(got.residual_rms)
    assert (got.icrs_to_camera, got.stars, got.false_probability) == (None, 0, 1.0)


def test_the_covariance_is_enlarged_by_significant_residuals_alone():
    """The covariance is enlarged if noise explains the chi-square one time in 1000 or less.

    Seeds whose probability, by scipy, lies on both sides of that; a fitted scale takes one more
    degree of freedom.
    """
    sides = set()
    for seed in range(40):
        _, pixel, direction = sky(5, seed)
        pixel = pixel + np.random.default_rng(seed).normal(0, 0.1 * 1.12**seed, pixel.shape) / 10
        for tolerance, freedom in ((0.0, 7), (1e-3, 6)):
            spots, matches = spots_of(pixel, 0.1), matches_of(direction)
            wide = SolverSettings(centroid_floor=0.0, gate=1e3)
            got = solve(spots, matches, wide, tolerance)
            best = refine(pixel, spots.covariance, direction, CAMERA, got.icrs_to_camera, tolerance)
            total = best.chi_square.sum()
            surprise = stats.chi2.sf(total, freedom) < 1e-3
            factor = total / freedom if surprise else 1.0
            np.testing.assert_allclose(got.covariance, best.covariance * factor, rtol=1e-6)
            residual = CAMERA.scaled(best.scale).project(got.icrs_to_camera.apply(direction))
            rms = np.sqrt(np.mean((pixel - residual) ** 2))
            assert got.residual_rms == pytest.approx(rms, rel=1e-6)
            sides.add(bool(surprise))
    assert sides == {True, False}


def test_mismatched_stars_are_left_out_the_worst_first():
    """Ten stars, three of them displaced; the others are without noise."""
    attitude, pixel, direction = sky(10, 12)
    pixel[[2, 5, 9]] += [[40.0, 0], [0, -9.0], [3.0, 3.0]]
    got = solve(spots_of(pixel, 0.1), matches_of(direction), EXACT)
    assert got.stars == 7
    assert (got.icrs_to_camera * attitude.inv()).magnitude() < 3e-15


def test_of_four_stars_none_is_left_out():
    narrow = SolverSettings(centroid_floor=0.0, gate=2.0)
    for count in (4, 5):
        _, pixel, direction = sky(count, 7)
        pixel[0] += 50.0
        assert solve(spots_of(pixel, 0.1), matches_of(direction), narrow).stars == 4


def test_half_of_the_stars_stay_however_wrong_they_are():
    """Each error is four times the previous one, so that the largest is always an outlier."""
    for count, left in ((12, 6), (13, 6)):
        _, pixel, direction = sky(count, 7)
        pixel[:, 0] += 1e-5 * 4.0 ** np.arange(count)
        narrow = SolverSettings(centroid_floor=0.0, gate=2.0)
        assert solve(spots_of(pixel, 1e-6), matches_of(direction), narrow).stars == left


def test_a_star_on_the_gate_stays():
    """The gate is in standard deviations of one star's residual: sqrt(chi-square)."""
    _, pixel, direction = sky(40, 9)
    pixel[3, 0] += 0.55
    spots, matches = spots_of(pixel, 0.1), matches_of(direction)
    everything = solve(spots, matches, SolverSettings(centroid_floor=0.0, gate=1e3)).icrs_to_camera
    off = np.linalg.norm(pixel[3] - CAMERA.project(everything.apply(direction[3])))
    for fraction, left in ((0.999, 39), (1.001, 40)):
        settings = SolverSettings(centroid_floor=0.0, gate=fraction * off / 0.1)
        assert solve(spots, matches, settings).stars == left


def test_the_gate_widens_with_the_noise():
    """Noise three times as large as stated widens the gate from five sigma to fifteen.

    The noise is estimated from the median over 2000 stars, to 2.2 % of a standard deviation.
    """
    _, true, direction = sky(2000, 5)
    pixel = true + np.random.default_rng(3).normal(0, 0.3, true.shape)
    for away, left in ((0.9, 2000), (1.1, 1999)):
        pixel[7] = true[7, 0] + away * 15 * 0.1, true[7, 1]
        assert solve(spots_of(pixel, 0.1), matches_of(direction), EXACT).stars == left


def test_systematic_errors_add_to_the_noise_in_squares():
    """One systematic error for all stars, one for each star, or noise that contains it; 0.015
    pixel if unknown."""
    _, pixel, direction = sky(6, 8)
    matches = matches_of(direction)

    def stated(sigma, floor, own=None):
        return solve(
            spots_of(pixel, sigma),
            matches,
            SolverSettings(centroid_floor=floor),
            known=KnownErrors(own),
        ).covariance

    wanted = stated(0.05, 0.0)
    np.testing.assert_allclose(stated(0.03, 0.04), wanted, rtol=1e-9)
    np.testing.assert_allclose(stated(0.03, None, np.full(6, 0.04**2)), wanted, rtol=1e-9)
    np.testing.assert_allclose(stated(0.02, None), stated(0.025, 0.0), rtol=1e-9)


def test_a_fitted_scale_is_found_with_the_attitude():
    """A camera 3e-4 longer than believed: without noise, attitude and scale to the last digits."""
    longer = CAMERA.scaled(1.0003)
    for seed in range(10):
        attitude, pixel, direction = sky(7, seed, longer)
        covariance = np.tile(np.eye(2) * 1e-8, (7, 1, 1))
        got = refine(pixel, covariance, direction, CAMERA, attitude, tolerance=1e3)
        assert got.scale == pytest.approx(1.0003, rel=1e-13)
        assert (got.icrs_to_camera * attitude.inv()).magnitude() < 1e-13


def test_a_fitted_scale_enlarges_the_covariance_by_the_joint_information():
    """The block of the attitude in the inverse of a 4 x 4 information from finite differences."""
    attitude, pixel, direction = sky(5, 3)
    covariance = np.tile([[0.04, 0.01], [0.01, 0.09]], (5, 1, 1))

    def places(turn, scale):
        turned = (Rotation.from_rotvec(turn) * attitude).apply(direction)
        return CAMERA.scaled(scale).project(turned)

    steps = np.eye(4) * 1e-6
    slope = np.stack(
        [(places(s[:3], 1 + s[3]) - places(-s[:3], 1 - s[3])) / 2e-6 for s in steps], axis=-1
    )
    information = np.einsum("nia,nij,njb->ab", slope, np.linalg.inv(covariance), slope)
    information[3, 3] += 1e-3**-2
    got = refine(pixel, covariance, direction, CAMERA, attitude, tolerance=1e-3).covariance
    np.testing.assert_allclose(got, np.linalg.inv(information)[:3, :3], rtol=1e-6)


@pytest.mark.parametrize("tolerance", [0.0, 1e-3])
def test_many_sets_of_stars_are_refined_as_each_alone(tolerance):
    """Many sets of 5 of 9 stars, with errors that are larger along one axis."""
    rng, sets = np.random.default_rng(3), [sky(9, seed) for seed in range(6)]
    root = np.array([[0.3, 0.0], [0.1, 0.05]]) * rng.uniform(0.5, 2.0, (9, 1, 1))
    covariance = root @ root.swapaxes(1, 2)
    pixel = np.array([p for _, p, _ in sets]) + np.einsum(
        "nij,mnj->mni", root, rng.standard_normal((6, 9, 2))
    )
    there = np.arange(9) < np.where(np.arange(6) % 2, 5, 9)[:, None]
    seen = CAMERA.unproject(pixel.reshape(-1, 2)).reshape(6, 9, 3)
    plane = seen[..., :2] / seen[..., 2:]
    inverse = there[..., None, None] * np.linalg.inv(covariance)
    direction = np.array([d for _, _, d in sets])
    start = np.array([a.as_matrix() for a, _, _ in sets])
    got = refine_all(plane, inverse, direction, CAMERA.focal_length_px, start, tolerance)
    for k, (attitude, _, _) in enumerate(sets):
        some = there[k]
        alone = refine(
            pixel[k][some], covariance[some], direction[k][some], CAMERA, attitude, tolerance
        )
        apart = got.source_to_target[k] * alone.icrs_to_camera.inv()
        assert apart.magnitude() < 1e-12
        np.testing.assert_allclose(got.covariance[k], alone.covariance, rtol=1e-9)
        assert got.chi_square[k] == pytest.approx(alone.chi_square.sum(), rel=1e-9)
    assert got.observed.all()
    one_star = refine_all(
        plane, inverse * (np.arange(9) < 1)[:, None, None], direction, 1e3, start, tolerance
    )
    assert not one_star.observed.any()


def test_errors_with_a_fitted_scale_are_as_stated():
    """1000 trials: the normalised error squared of three axes is 3 +- 0.08; 0.22 is 2.8 sigma."""
    rng, nees, held = np.random.default_rng(8), [], []
    sigma = np.array([0.05, 0.1, 0.3, 0.3, 0.4])
    covariance = sigma[:, None, None] ** 2 * np.eye(2)
    for seed in range(1000):
        attitude, pixel, direction = sky(5, seed)
        noisy = pixel + sigma[:, None] * rng.standard_normal((5, 2))
        got = refine(noisy, covariance, direction, CAMERA, attitude, tolerance=1e-2)
        error = (got.icrs_to_camera * attitude.inv()).as_rotvec()
        nees.append(error @ np.linalg.solve(got.covariance, error))
        known = refine(noisy, covariance, direction, CAMERA, attitude).covariance
        held.append(error @ np.linalg.solve(known, error))
    assert np.mean(nees) == pytest.approx(3, abs=0.22)
    assert np.mean(held) > 3.3  # what to take the scale for known would state
