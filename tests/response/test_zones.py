"""Single stars behind a lens table: mirrors, focal length by colour, trials of all fidelities."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from startrack.budget import analytic, differences
from startrack.catalog import open_sky
from startrack.design import Fidelity, load_design
from startrack.detector import stamp
from startrack.detector.stamp import stamp_paths
from startrack.io import shipped
from startrack.metrics import summarise
from startrack.observation import mean_colour
from startrack.observation.images import field_psf_of
from startrack.optics import save_lens
from startrack.response import residual_shift, zones_of
from startrack.response.spot_response import ResponseGrid, _mirrored, response_of
from startrack.response.zones import focal_stretch, unique_places
from startrack.trial import run_trials, spot_plan
from tests.optics.lenses import ideal

CASE = load_design(shipped("designs/noise_only.toml")).case


def behind(lens: str, pixels: int, **tracker):
    """The nanosatellite's tracker with coarse images of a lens, at rest."""
    optics = dataclasses.replace(
        CASE.instrument.optics, psf="auto", lens_file=lens, psf_tolerance=0.05
    )
    detector = dataclasses.replace(CASE.instrument.detector, columns=pixels, rows=pixels)
    motion = dataclasses.replace(CASE.instrument.motion, rate_x=0.0, rate_y=0.0)
    instrument = dataclasses.replace(
        CASE.instrument, optics=optics, detector=detector, motion=motion
    )
    believed = dataclasses.replace(CASE.tracker, **tracker)
    return dataclasses.replace(CASE, instrument=instrument, tracker=believed)


def turned(case, rate_x: float, rate_y: float):
    """A case that turns; rates in radian per second."""
    motion = dataclasses.replace(case.instrument.motion, rate_x=rate_x, rate_y=rate_y)
    instrument = dataclasses.replace(case.instrument, motion=motion)
    return dataclasses.replace(case, instrument=instrument)


@pytest.fixture(scope="module")
def fast(tmp_path_factory):
    """A lens at f/2.4 with coma, vignetting, and a focal length that rises with the wavelength."""
    table = ideal(vignetting=0.4)
    pupil = table.pupil.copy()
    pupil[..., [1, 2, 4, 5]] *= 4 / 2.4
    wavefront = np.zeros(table.wavefront.shape)
    wavefront[..., 1] = 600e-9 * table.field / table.field[-1]  # coma
    place = table.place * (1 + 1e-3 * np.linspace(-1, 1, 5)[:, None])
    path = tmp_path_factory.mktemp("lens") / "fast.fits"
    changed = {"wavefront": wavefront, "place": place, "pupil": pupil, "f_number": 2.4}
    save_lens(path, dataclasses.replace(table, area=table.area * (4 / 2.4) ** 2, **changed))
    return str(path)


def test_stars_in_mirrored_places_are_measured_alike(fast):
    """Responses derived by a mirror, against those of the images at these places."""
    case = behind(fast, 300)
    place = (40.0, 200.0, 650e-9)
    unique, which, mirror = unique_places(case, [place])
    assert unique[0] == pytest.approx((259.0, 200.0, 650e-9))
    images = field_psf_of(case.instrument)
    first, direct = (
        response_of(ResponseGrid(case, 10.0, images.image(*one)[0]), 2000.0, 9000.0)
        for one in (unique[which[0]], place)
    )
    derived = _mirrored(first, mirror[0])
    # The pixels of the background alternate, which no mirror turns: 0.003 pixel, 1 %.
    apart, size = (np.sqrt(np.mean(one**2)) for one in (derived.bias - direct.bias, direct.bias))
    assert apart < 0.5 * size
    assert apart < 0.4 * np.sqrt(np.mean((first.bias - direct.bias) ** 2))
    largest = direct.covariance_root.max()
    np.testing.assert_allclose(
        derived.covariance_root, direct.covariance_root, rtol=0, atol=0.02 * largest
    )
    np.testing.assert_allclose(derived.threshold_margin, direct.threshold_margin, rtol=0.03)


@pytest.mark.parametrize(
    ("rate", "places"), [((0.0, 0.0), 6), ((0.0, 0.01), 9), ((0.01, 0.0), 9), ((0.01, 0.01), 13)]
)
def test_smeared_stars_are_alike_where_a_mirror_keeps_the_smear(fast, rate, places):
    """Of 25 places: an eighth, a quarter and a half of the frame with its borders are different."""
    case = turned(behind(fast, 300), *rate)
    x, y = case.instrument.camera.centre
    grid = [(x + 50.0 * i, y + 50.0 * j, 650e-9) for j in range(-2, 3) for i in range(-2, 3)]
    unique, which, mirror = unique_places(case, grid)
    assert len(unique) == places
    along = np.array(rate)[::-1]
    for place, u, turn in zip(grid, which, mirror, strict=True):
        from_centre = turn @ (np.array(unique[u][:2]) - (x, y))
        np.testing.assert_allclose(from_centre, np.array(place[:2]) - (x, y), atol=1e-9)
        assert np.allclose(turn @ along, along) or np.allclose(turn @ along, -along)


def test_smeared_stars_in_mirrored_places_are_measured_alike(fast):
    """Stars of 5 pixels: the response by a mirror, against that of the image at this place."""
    case, place = turned(behind(fast, 300), 0.0, 0.01), (40.0, 200.0, 650e-9)
    unique, which, mirror = unique_places(case, [place])
    assert unique[0] == pytest.approx((259.0, 200.0, 650e-9))
    images = field_psf_of(case.instrument)
    first, direct = (
        response_of(ResponseGrid(case, 10.0, images.image(*one)[0]), 2000.0, 9000.0)
        for one in (unique[which[0]], place)
    )
    derived = _mirrored(first, mirror[0])
    largest = direct.covariance_root.max()
    np.testing.assert_allclose(
        derived.covariance_root, direct.covariance_root, rtol=0, atol=0.02 * largest
    )
    np.testing.assert_allclose(derived.threshold_margin, direct.threshold_margin, rtol=0.03)


def test_mirrored_places_do_not_limit_the_stars_of_a_plan_again(monkeypatch, fast):
    """The filter is applied to the mean image, and to 6 of 25 places in each of three colours."""
    profile, filtered = spot_plan.star_profile, []
    monkeypatch.setattr(
        spot_plan, "star_profile", lambda psf, kernel: filtered.append(1) or profile(psf, kernel)
    )
    spot_plan.limits_of(behind(fast, 300))
    assert len(filtered) == 1 + 3 * 6


def test_a_focal_length_by_colour_takes_off_a_lateral_colour_that_grows_with_the_field(fast):
    """The focal length changes by 2e-3 over the table; coma, which is wider in red, adds to it."""
    plain, knowing = (behind(fast, 300, focal_length_by_colour=knows) for knows in (False, True))
    colour = np.array([560e-9, 740e-9])
    blue, red = focal_stretch(knowing, colour)
    assert red - blue == pytest.approx(2e-3 * 180 / 600, rel=0.08)
    x, y = np.array([10.0, 290.0]), np.array([20.0, 150.0])
    off, left = (residual_shift(one)[1].at(x, y, colour)[:, :2] for one in (plain, knowing))
    assert np.abs(left).max() < 0.15 * np.abs(off).max()


@pytest.mark.parametrize(("light", "terms", "error"), [(1e7, 4, 3000.0), (2000.0, 2, 1.0)])
def test_a_star_that_is_drawn_as_terms_is_its_image(fast, light, terms, error):
    """Terms after the first are interpolated linearly, and for a faint star also the first.

    The summed table is interpolated by polynomials. The difference is 1e-3 of the peak for a bright
    star, and half an electron for each of the two omitted terms of a faint one.
    """
    images = field_psf_of(behind(fast, 300).instrument)
    x, y, colour = np.array([[20.3]]), np.array([[251.7]]), np.array([600e-9])
    *place, part = images.split(x, y, np.array([light]), np.ones(1), colour)
    assert np.count_nonzero(part) >= terms
    drawn, whole = np.zeros((2, 300, 300))
    stamp_paths(drawn, images, np.ones(1), *place, part)
    psf, flux = images.image(20.3, 251.7, 600e-9)
    stamp(whole, psf, *(one[0, :1] for one in place), np.array([light * flux]))
    assert np.abs(drawn - whole).max() < error
    away = np.arange(300) @ (drawn - whole) / whole.sum()
    assert abs(away.sum()) < 1e-4


def test_each_star_has_the_zone_of_its_cell_and_of_its_third_of_the_colours():
    case = behind("double_gauss", 300)
    zones = zones_of(case)
    colour = mean_colour(case, open_sky(case.catalog).stars.colour)
    x, y = np.random.default_rng(1).uniform(-0.5, 299.5, (2, len(colour)))
    middle = np.array(zones.middles)[zones.of(x, y, colour)]
    assert np.abs(middle[:, 0] - x).max() <= 30
    assert np.abs(middle[:, 1] - y).max() <= 30
    many = [(middle[:, 2] == one).mean() for one in zones.colour]
    assert many == pytest.approx([1 / 3] * 3, abs=0.02)
    assert zones.of(np.array([-50.0]), np.array([900.0]), colour[:1])[0] % 25 == 20


def test_trials_of_all_fidelities_and_the_budget_agree_behind_a_fast_lens(fast):
    """Each rms is within the 95 % intervals of the others and 15 % of the formula; three
    comparisons."""
    case = behind(fast, 300)
    windows = summarise(run_trials(case, 1, range(50), Fidelity.WINDOW))
    drawn = summarise(run_trials(case, 2, range(600), Fidelity.COVARIANCE))
    for name in ("across", "about"):
        one, other = getattr(windows, name), getattr(drawn, name)
        assert one.low < other.high
        assert other.low < one.high
    assert not list(differences(analytic(case), windows))


@pytest.mark.slow
@pytest.mark.parametrize("lens", ["double_gauss", "petzval"])
def test_trials_and_the_budget_agree_behind_the_shipped_lenses(lens):
    case = behind(lens, 512)
    if lens == "petzval":
        optics = dataclasses.replace(case.instrument.optics, focal_length=0.05, f_number=2.0)
        detector = dataclasses.replace(case.instrument.detector, pixel_pitch=7.7e-6)
        instrument = dataclasses.replace(case.instrument, optics=optics, detector=detector)
        case = dataclasses.replace(case, instrument=instrument)
    windows, spots, drawn = (
        summarise(run_trials(case, 1, range(count), fidelity))
        for fidelity, count in (
            (Fidelity.WINDOW, 400),
            (Fidelity.SPOTS, 1000),
            (Fidelity.COVARIANCE, 2000),
        )
    )
    for other in (spots, drawn):
        for name in ("across", "about"):
            one, two = getattr(windows, name), getattr(other, name)
            assert one.low < two.high
            assert two.low < one.high
    assert not list(differences(analytic(case), windows))
