"""Alternate matching and fitting."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.identification import Identification
from startrack.identification.agree import agree, excess_variance, fit_matches
from startrack.identification.fit import fit
from startrack.identification.seen import see

IN_PYTHON = pytest.mark.usefixtures("in_python")

CAMERA = Camera(1024, 1024, 4000.0)
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0])


def seen_at(spots_at, pixel, sigma=0.1, **settings):
    return see(spots_at(pixel, sigma), np.arange(len(pixel)), CAMERA, Identification(**settings))


def stars_at(pixel):
    """Directions of stars, and their positions in the image plane."""
    return TURN.inv().apply(CAMERA.unproject(pixel)), (pixel - CAMERA.centre) / 4000.0


@IN_PYTHON
def test_an_attitude_wrong_by_some_pixels_is_corrected(spots_at):
    """All stars within the match radius are found, and the scale."""
    rng = np.random.default_rng(2)
    star = rng.uniform(0, 1023, (20, 2))
    direction, _ = stars_at(star)
    spot = (star - CAMERA.centre) * 1.002 + CAMERA.centre
    off = Rotation.from_rotvec([4e-4, -5e-4, 1e-3]) * TURN
    x, y, z = off.apply(direction).T
    found = agree(
        seen_at(spots_at, spot),
        direction,
        np.arange(20),
        np.column_stack([x / z, y / z]),
        off.as_matrix(),
        1.0,
        6 / 4000,
        4,
    )
    assert found.spot.tolist() == found.taken.tolist() == list(range(20))
    assert found.scale == pytest.approx(1.002, rel=1e-6)
    assert (Rotation.from_matrix(found.rotation) * TURN.inv()).magnitude() < 1e-8
    assert found.distance.max() < 1e-6


@IN_PYTHON
def test_given_matches_are_weighted_by_their_noise_plus_the_commonexcess_variance(spots_at):
    """Two noise levels: errors of 60 fits are as small as those of scipy with the best weights.

    The weights are of the stated noise if that is all, equal if all noise is unstated, and of both
    if each star has additional noise, of which the fits know only the residuals.
    """
    rng = np.random.default_rng(3)
    two, every = np.where(np.arange(24) % 2, 0.1, 0.6), np.arange(24)
    cases = {"stated": (two, two), "unstated": (0.01, two), "partly": (two, np.hypot(two, 0.6))}
    errors = {name: [] for name in cases}
    for _ in range(60):
        star = rng.uniform(0, 1023, (24, 2))
        direction, _ = stars_at(star)
        for name, (said, true) in cases.items():
            spots = spots_at(star + true[:, None] * rng.standard_normal((24, 2)), 0.1)
            spots.covariance[:] = np.eye(2) * np.reshape(said, (-1, 1, 1)) ** 2
            seen = see(spots, every, CAMERA, Identification(focal_tolerance=0.0))
            rotation, scale = fit_matches(seen, direction, every, every, TURN.as_matrix(), 1.0)
            assert scale == 1.0
            ray = CAMERA.unproject(np.column_stack([spots.x, spots.y]))
            weight = np.ones(24) if name == "unstated" else true**-2
            best, _ = Rotation.align_vectors(ray, direction, weights=weight)
            both = Rotation.concatenate([Rotation.from_matrix(rotation), best])
            errors[name].append((both * TURN.inv()).as_rotvec()[:, :2])
    for name, each in errors.items():
        ours, best = np.mean(np.square(each), axis=(0, 2))
        assert ours == pytest.approx(best, rel=0.05 if name == "partly" else 0.02)


def fits(monkeypatch, spots_at, spot, sigma, start=TURN, **settings):
    """The weights (rounds, n) of all fits in the rounds, and those of the last fits."""
    weights = []

    def noted(plane, weight, *others):
        weights.append(weight.copy())
        return fit(plane, weight, *others)

    plain = getattr(agree, "py_func", agree)
    monkeypatch.setitem(plain.__globals__, "fit", noted)
    monkeypatch.setitem(plain.__globals__, "fit_matches", lambda *these: these[-2:])
    star = np.array(
        [[300.0, 200.0], [700.0, 240.0], [520.0, 800.0], [200.0, 640.0], [800.0, 560.0]]
    )
    direction, _ = stars_at(star)
    x, y, z = start.apply(direction).T
    plain(
        seen_at(spots_at, star + spot, sigma, **settings),
        direction,
        np.arange(5),
        np.column_stack([x / z, y / z]),
        start.as_matrix(),
        1.0,
        6 / 4000,
        3,
    )
    return np.array(weights)


@IN_PYTHON
def test_rounds_end_when_nothing_changes(monkeypatch, spots_at):
    """Three of five starts are the truth: at least two rounds, and one to see that they agree."""
    assert len(fits(monkeypatch, spots_at, np.zeros((5, 2)), 0.1)) == 3


@IN_PYTHON
def test_residuals_have_the_weights_of_cauchy(monkeypatch, spots_at):
    """Those of scipy's least squares, which reduce the weight beyond two sigma.

    Four spots with little noise determine the fit; the fifth, with a noise of one pixel, is three
    pixels off. The excess noise of all spots is zero.
    """
    off = np.zeros((5, 2))
    off[4] = [1.8, -2.4]
    pixel = np.array([0.01, 0.01, 0.01, 0.01, 1.0])
    star = np.zeros((5, 2))

    def spots(place, _):
        made = spots_at(place, 0.1)
        made.covariance[:] = np.eye(2) * pixel[:, None, None] ** 2
        return made

    weight = fits(monkeypatch, spots, star + off, 0.1, focal_tolerance=0.0)
    plain = (4000 / pixel) ** 2
    np.testing.assert_allclose(weight[0], plain)
    # Of the square of a residual in sigmas over two, scipy takes the derivative of ln (1 + z).
    cauchy = 1 / (1 + (3.0 / 2.0) ** 2)
    np.testing.assert_allclose(weight[1][4] / plain[4], cauchy, rtol=1e-2)
    np.testing.assert_allclose(weight[1][:4] / plain[:4], 1.0, rtol=1e-2)


@IN_PYTHON
@pytest.mark.parametrize(("focal", "unknowns"), [(0.0, 3), (0.01, 4)])
@pytest.mark.parametrize("extra", [0.0, 0.4])
def test_the_variance_of_residuals_beyond_their_noise(spots_at, focal, unknowns, extra):
    """The given variance, for 20 000 spots; for six, the part that the fit absorbed is added
    again."""
    rng = np.random.default_rng(6)
    count = 20_000
    place = rng.uniform(-0.1, 0.1, (count, 2))
    pixel = place * 4000 + CAMERA.centre
    total = np.hypot(0.3, extra)
    seen = seen_at(
        spots_at, pixel + total * rng.standard_normal((count, 2)), 0.3, focal_tolerance=focal
    )
    every = np.arange(count)
    excess = excess_variance(seen, every, every, place) * 4000**2
    # A median of so many is known to 1 %.
    assert excess == pytest.approx(extra**2, abs=0.04 * total**2)
    few = every[:6]
    shown = np.median(((seen.plane - place)[:6] ** 2).sum(axis=1)) * 4000**2
    wanted = shown / (2 * np.log(2)) * 12 / (12 - unknowns) - 0.09
    assert excess_variance(seen, few, few, place) * 4000**2 == pytest.approx(
        max(wanted, 0), abs=1e-9
    )
