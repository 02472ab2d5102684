"""The solvers against 60-digit solutions, rotated copies of these, and published scenarios."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from startrack.attitude import Observability, align, davenport, foam, quest, svd
from startrack.core.units import arcsec, deg

EPS = 2.0**-52
# Eight fixed turns, half turns among them.
TURNS = Rotation.concatenate(
    [
        Rotation.from_rotvec(np.pi * np.eye(3)),
        Rotation.from_rotvec([[2.0, -1.0, 0.3], [1e-9, 0, 0], [0, 0, 1.5], [-1.9, 1.9, 1.6]]),
        Rotation.identity(1),
    ]
)


@pytest.fixture(scope="module")
def cases(oracle):
    return oracle("wahba_cases.json")["cases"]


def vectors(case):
    return np.array(case["b"]), np.array(case["r"]), np.array(case["weight"])


def one(solver, case):
    """The attitude by one solver for one set of vectors."""
    return solver(*vectors(case))


def test_98_solvable_cases_to_the_last_digits(cases):
    solvable = [case for case in cases if case["observable"]]
    assert len(solvable) == 98
    for case in solvable:
        b, r, weight = vectors(case)
        got = align(b[None], r[None], weight[None])
        error = (got.source_to_target[0] * Rotation.from_matrix(case["A"]).inv()).magnitude()
        assert error < 50 * EPS * np.sqrt(case["info_cond"]), case["name"]
        assert got.observability[0] == Observability.OBSERVED, case["name"]
        assert got.loss[0] == pytest.approx(case["loss"], rel=1e-6, abs=1e-15 * weight.sum())


def test_rotated_copies_of_each_case(cases):
    """Rotating both sides rotates the attitude; the rounding of the rotated vectors adds a few
    eps."""
    for case in (case for case in cases if case["observable"]):
        b, r, weight = vectors(case)
        truth = Rotation.from_matrix(case["A"])
        for left, right in zip(TURNS, TURNS[::-1], strict=True):
            got = align(left.apply(b)[None], right.apply(r)[None], weight[None])
            error = (left.inv() * got.source_to_target[0] * right * truth.inv()).magnitude()
            assert error < 50 * EPS * np.sqrt(case["info_cond"]), case["name"]


def test_the_condition_is_that_of_the_information(cases):
    """The condition equals the 60-digit one if there is no noise; with noise its definition
    differs."""
    for case in cases:
        b, r, weight = vectors(case)
        if case["observable"] and case["loss"] < 1e-24 * weight.sum():
            got = align(b[None], r[None], weight[None]).condition[0]
            rounding = 10 * EPS * case["info_cond"]  # of the reference, which squares the vectors
            assert got == pytest.approx(case["info_cond"], rel=max(1e-7, rounding)), case["name"]


def test_unobservable_sets_are_reported(cases):
    open_cases = [case for case in cases if not case["observable"]]
    assert len(open_cases) == 4
    for case in open_cases:
        b, r, weight = vectors(case)
        for left in TURNS:
            got = align(left.apply(b)[None], r[None], weight[None])
            assert got.observability[0] != Observability.OBSERVED, case["name"]
            assert np.isinf(got.covariance).all()
            assert np.isfinite(got.source_to_target.as_matrix()).all()


def test_a_tie_between_two_attitudes_is_reported():
    """With three mirrored axes, rotations by 180 deg about each axis fit equally well."""
    got = align(-np.eye(3)[None], np.eye(3)[None], np.ones((1, 3)))
    assert got.observability[0] == Observability.CONTRADICTORY


@pytest.mark.parametrize("solver", [svd, davenport, quest, foam])
def test_textbook_solvers_on_well_conditioned_cases(cases, solver):
    for case in cases:
        if case["observable"] and case["info_cond"] < 1e3:
            error = (one(solver, case) * Rotation.from_matrix(case["A"]).inv()).magnitude()
            assert error < 1e4 * EPS * np.sqrt(case["info_cond"]), case["name"]


@pytest.mark.parametrize("solver", [svd, davenport, quest, foam, "align"])
def test_stars_that_disagree_by_half_a_radian_are_fitted_as_scipy_fits_them(solver):
    """The result is Kabsch's rotation, although Newton's steps begin far from the largest
    eigenvalue."""
    rng = np.random.default_rng(6)
    b, r = rng.standard_normal((2, 20, 4, 3))
    turn = Rotation.from_quat(rng.standard_normal((20, 4))).as_matrix()
    b /= np.linalg.norm(b, axis=2, keepdims=True)
    r = np.einsum("mji,mnj->mni", turn, b) + 0.5 * r
    r /= np.linalg.norm(r, axis=2, keepdims=True)
    weight = rng.uniform(0.2, 5, (20, 4))
    got = align(b, r, weight).source_to_target if solver == "align" else solver(b, r, weight)
    for k in range(20):
        best, _ = Rotation.align_vectors(b[k], r[k], weights=weight[k])
        assert (got[k] * best.inv()).magnitude() < 1e-12


@pytest.mark.parametrize("solver", [svd, davenport, quest, foam])
def test_textbook_solvers_never_warn_nor_fail(cases, solver):
    """Textbook solvers lose digits on the hard cases but return a rotation; a warning fails this
    test."""
    for case in cases:
        assert np.isfinite(one(solver, case).as_matrix()).all()


@pytest.mark.parametrize("solver", [svd, davenport, quest, foam])
def test_many_sets_at_once_give_what_each_gives(solver):
    rng = np.random.default_rng(3)
    b = rng.standard_normal((5, 7, 3))
    b /= np.linalg.norm(b, axis=2, keepdims=True)
    turn = Rotation.from_quat(rng.standard_normal((5, 4)))
    r = np.einsum("mji,mnj->mni", turn.as_matrix(), b)
    weight = rng.uniform(0.5, 2, (5, 7))
    many = solver(b, r, weight)
    assert (many * turn.inv()).magnitude().max() < 1e-13
    for k in range(5):
        assert (many[k] * solver(b[k], r[k], weight[k]).inv()).magnitude() < 1e-13


@pytest.mark.parametrize("solver", [svd, davenport, quest, foam, "align"])
def test_a_rotation_by_90_deg_about_z_takes_x_to_y(solver):
    """Sign, handedness and order of the quaternion (x, y, z, w), whichever solver made it."""
    reference, observed = np.eye(3), np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    if solver == "align":
        got = align(observed[None], reference[None], np.ones((1, 3))).source_to_target[0]
    else:
        got = solver(observed, reference, np.ones(3))
    np.testing.assert_allclose(got.apply(reference), observed, atol=1e-14)
    np.testing.assert_allclose(got.as_quat(canonical=True), [0, 0, 0.5**0.5, 0.5**0.5], atol=1e-14)


def test_rows_taken_for_columns_show_in_the_loss():
    """A mirrored field is not a rotation of the sky: no attitude fits, and the loss is large."""
    b, r, weight = random_set(np.random.default_rng(8), 6)
    right = align(b[None], r[None], weight[None])
    swapped = align(b[None][..., [1, 0, 2]], r[None], weight[None])
    assert right.loss[0] < 1e-25
    assert swapped.loss[0] > 0.1


def test_weights_count_and_zero_leaves_out():
    rng = np.random.default_rng(0)
    b, r, weight = random_set(rng, 6)
    b[5] = [0, 0, -1]
    weight[5] = 0
    all_six = align(b[None], r[None], weight[None])
    five = align(b[None, :5], r[None, :5], weight[None, :5])
    assert (all_six.source_to_target * five.source_to_target.inv()).magnitude()[0] < 10 * EPS
    np.testing.assert_allclose(all_six.covariance, five.covariance, rtol=1e-12)


def test_no_star_at_all_is_not_observed():
    for count in (0, 3):
        got = align(np.zeros((1, count, 3)), np.zeros((1, count, 3)), np.zeros((1, count)))
        assert got.observability[0] == Observability.ONE_DIRECTION


def test_wrong_input_is_refused():
    with pytest.raises(ValueError, match="shapes"):
        align(np.zeros((1, 2, 3)), np.zeros((1, 3, 3)), np.zeros((1, 2)))
    with pytest.raises(ValueError, match=r"weight must be finite and not negative, got -1\.0"):
        align(np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), np.array([[1.0, -1.0]]))
    with pytest.raises(ValueError, match="must be finite"):
        align(np.full((1, 2, 3), np.nan), np.zeros((1, 2, 3)), np.ones((1, 2)))


def random_set(rng, count):
    b = rng.standard_normal((count, 3))
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    return b, Rotation.from_quat(rng.standard_normal(4)).inv().apply(b), rng.uniform(1, 2, count)


# Scenarios of Markley and Mortari (2000), J. Astronaut. Sci. 48, 359: vectors in the body's axes,
# true noise of each and that which the weights state, radian.
CROSS = np.array(
    [
        [1, 0, 0],
        *[[0.99712, y, z] for y, z in [(0.07584, 0), (-0.07584, 0), (0, 0.07584), (0, -0.07584)]],
    ]
)
WIDE = np.array([[1, 0, 0], [-0.99712, 0.07584, 0], [-0.99712, -0.07584, 0]])
SCENARIOS = {
    "MM1": (CROSS, np.full(5, 6 * arcsec), np.full(5, 6 * arcsec)),
    "MM2": (WIDE, np.array([1 * arcsec, deg, deg]), np.array([1 * arcsec, deg, deg])),
    "MM3": (WIDE, np.array([1, 0.1, 0.1]) * deg, np.full(3, 0.1 * deg)),
}


def scenario(name, trials, seed):
    """Errors (trials, 3) radian in body axes, and the alignment of noisy trials."""
    rng = np.random.default_rng(seed)
    body, noise, stated = SCENARIOS[name]
    body = body / np.linalg.norm(body, axis=1, keepdims=True)
    truth = Rotation.from_quat(rng.standard_normal((trials, 4)))
    reference = np.einsum("mji,nj->mni", truth.as_matrix(), body)
    reference = reference + rng.standard_normal(reference.shape) * noise[:, None]
    reference /= np.linalg.norm(reference, axis=2, keepdims=True)
    got = align(
        np.broadcast_to(body, reference.shape),
        reference,
        np.broadcast_to(stated**-2, reference.shape[:2]),
    )
    return (got.source_to_target * truth.inv()).as_rotvec(), got


def test_markley_mortari_scenario_1():
    """The published covariance about the boresight (x) and across it, and a mean loss of 5 -
    3/2."""
    error, got = scenario("MM1", 5000, 1)
    rms = np.sqrt((error**2).mean(axis=0)) / arcsec
    np.testing.assert_allclose(rms, [39.557, 2.6864, 2.6864], rtol=0.03)
    sigma = np.sqrt(np.diagonal(got.covariance.mean(axis=0))) / arcsec
    np.testing.assert_allclose(sigma, [39.557, 2.6864, 2.6864], rtol=0.001)
    assert got.loss.mean() == pytest.approx(3.50, abs=0.08)


def test_markley_mortari_scenario_2():
    """With one accurate vector and two poor ones, only the rotation about the accurate one is
    poor."""
    error, got = scenario("MM2", 5000, 2)
    np.testing.assert_allclose(
        np.sqrt((error[:, 1:] ** 2).mean(axis=0)) / arcsec, [1.0, 1.0], rtol=0.04
    )
    assert np.sqrt((error[:, 0] ** 2).mean()) / arcsec == pytest.approx(33871.9, rel=0.04)
    assert got.loss.mean() == pytest.approx(1.505, abs=0.08)


def test_markley_mortari_scenario_3_is_flagged_by_its_loss():
    """With wrong weights the errors are six times the stated ones, and the loss is large."""
    error, got = scenario("MM3", 5000, 3)
    rms = np.sqrt((error**2).mean(axis=0)) / arcsec
    np.testing.assert_allclose(rms, [3359, 1222, 1210], rtol=0.04)
    assert got.loss.mean() == pytest.approx(67.4, rel=0.06)
    limit = stats.chi2.isf(1e-3, 3) / 2
    assert (got.loss > limit).mean() > 0.75


def test_errors_follow_the_covariance():
    """Normalised error squared of 3 degrees of freedom over 20000 trials; false alarm 1e-4."""
    error, got = scenario("MM1", 20000, 5)
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(got.covariance), error)
    assert stats.chi2.cdf(nees.sum(), 60000) == pytest.approx(0.5, abs=0.5 - 1e-4)
    assert stats.kstest(nees, stats.chi2(3).cdf).pvalue > 1e-4
