"""Fraunhofer and Fresnel against closed forms and against each other."""

import math

import numpy as np
import pytest
from krutz_2011 import ThinLens, fresnel, gaussian, profile
from scipy import special

from startrack.optics import Aberration, Optics, Pupil, Segment
from startrack.optics.diffraction import airy, intensity, jinc, pupil_samples
from startrack.optics.pixel_psf import gauss_band, irradiance
from startrack.optics.pupil import area_weights, pupil_grid, zernike
from tests.optics.closed import airy_encircled, fresnel_peak

GREEN = 550e-9
FIELD = (np.arange(155) - 77) / 5  # wavelength * f-number


def sampled(pupil=Pupil(), count=None, field=FIELD):  # noqa: B008
    place, cell = pupil_grid(count or pupil_samples(field.max()))
    return place, area_weights(pupil, place, cell) * cell**2 / np.pi


def by_rings(terms, points, rings=80, spokes=240):
    """An aberrated pupil over rings and spokes, summed term by term: Gauss times trapezoid."""
    node, weight = np.polynomial.legendre.leggauss(rings)
    r = np.sqrt((node + 1) / 2)[:, None]
    angle = np.arange(spokes) * 2 * np.pi / spokes
    x, y = (r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()
    phase = sum(size * zernike(noll, x, y) for noll, size in terms)
    wave = np.repeat(weight / 2 / spokes, spokes) * np.exp(1j * phase)
    return np.abs([np.sum(wave * np.exp(-1j * np.pi * (u * x + v * y))) for u, v in points]) ** 2


def test_a_clear_circle_is_the_airy_pattern():
    place, weight = sampled()
    got = intensity(weight, np.zeros_like(weight), place, FIELD)
    np.testing.assert_allclose(got, airy(np.hypot(FIELD, FIELD[:, None]), 1, 1), atol=1e-5)


def test_an_obscured_circle_is_the_difference_of_two():
    place, weight = sampled(Pupil(obscuration=0.4))
    v = np.pi * np.hypot(FIELD, FIELD[:, None])
    wanted = (jinc(v) - 0.16 * jinc(0.4 * v)) ** 2
    np.testing.assert_allclose(
        intensity(weight, np.zeros_like(weight), place, FIELD), wanted, atol=1e-5
    )


def test_two_apertures_make_young_fringes():
    """For a sparse aperture, the pattern of one circle times the fringes of their distance."""
    pupil = Pupil(segments=(Segment(-0.6, 0, 0.3, "circle"), Segment(0.6, 0, 0.3, "circle")))
    place, weight = sampled(pupil)
    u, v = FIELD, FIELD[:, None]
    wanted = (0.18 * jinc(0.3 * np.pi * np.hypot(u, v)) * np.cos(0.6 * np.pi * u)) ** 2
    got = intensity(weight, np.zeros_like(weight), place, FIELD)
    np.testing.assert_allclose(got, wanted, atol=3e-5 * wanted.max())


def test_a_hexagon_has_its_closed_form_along_an_axis():
    """Along x, the transform of its width 2 h(x): a trapezoid of sides size and size / sqrt(3)."""
    size = 0.5
    place, weight = sampled(Pupil(segments=(Segment(0, 0, size),)), 200)
    got = intensity(weight, np.zeros_like(weight), place, FIELD)[77]
    x = np.linspace(-2 * size / np.sqrt(3), 2 * size / np.sqrt(3), 40001)
    height = np.minimum(2 * size, 2 * (2 * size / np.sqrt(3) - np.abs(x)) * np.sqrt(3))
    wanted = [(np.trapezoid(height * np.cos(np.pi * u * x), x) / np.pi) ** 2 for u in FIELD]
    np.testing.assert_allclose(got, wanted, atol=2e-4 * max(wanted))


def test_the_open_area():
    assert Pupil(obscuration=0.5).fraction == pytest.approx(0.75, abs=1e-5)
    arms = Pupil(vanes=4, vane_width=0.02).fraction
    assert arms == pytest.approx(1 - (2 * 2 * 0.02 - 0.02**2) / np.pi, abs=2e-5)
    seven = [Segment(0, 0, 0.3)] + [
        Segment(0.62 * math.sin(k * math.pi / 3), 0.62 * math.cos(k * math.pi / 3), 0.3)
        for k in range(6)
    ]
    assert Pupil(segments=tuple(seven)).fraction == pytest.approx(
        7 * 2 * math.sqrt(3) * 0.09 / math.pi, abs=1e-4
    )


@pytest.mark.parametrize("rms", [0.05, 0.1])
def test_aberrations_against_rings_and_spokes(rms):
    draw = np.random.default_rng(5)
    terms = [(noll, rms * draw.normal()) for noll in range(2, 38)]
    place, weight = sampled(count=118)
    phase = sum(size * zernike(noll, place, place[:, None]) for noll, size in terms)
    got = intensity(weight, phase, place, FIELD)
    pick = draw.integers(0, 155, (300, 2))
    wanted = by_rings(terms, FIELD[pick])
    np.testing.assert_allclose(got[pick[:, 1], pick[:, 0]], wanted, atol=1e-4)


def test_the_error_falls_at_the_stated_order():
    """With the fifth power of the samples; with a wavefront, an order half a power lower."""
    draw = np.random.default_rng(5)
    terms = [(noll, 0.1 * draw.normal()) for noll in range(2, 38)]
    pick = draw.integers(60, 95, (200, 2))
    wanted = by_rings(terms, FIELD[pick])
    counts, errors = (56, 80, 112), []
    for count in counts:
        place, weight = sampled(count=count)
        phase = sum(size * zernike(noll, place, place[:, None]) for noll, size in terms)
        got = intensity(weight, phase, place, FIELD)[pick[:, 1], pick[:, 0]]
        errors.append(np.abs(got - wanted).max())
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -8 < slope < -4.5


def test_zernike_polynomials_are_orthonormal():
    node, weight = np.polynomial.legendre.leggauss(40)
    r = np.sqrt((node + 1) / 2)[:, None]
    angle = np.arange(90) * 2 * np.pi / 90
    x, y = r * np.cos(angle), r * np.sin(angle)
    modes = np.array([zernike(noll, x, y) for noll in range(1, 67)])
    gram = np.einsum("iab,jab,a->ij", modes, modes, weight / 2 / 90)
    np.testing.assert_allclose(gram, np.eye(66), atol=1e-12)


def test_zernike_polynomials_as_noll_writes_them():
    x, y = np.random.default_rng(1).uniform(-0.7, 0.7, (2, 50))
    rho2 = x * x + y * y
    for noll, wanted in {
        2: 2 * x,
        3: 2 * y,
        4: np.sqrt(3) * (2 * rho2 - 1),
        5: np.sqrt(6) * 2 * x * y,
        6: np.sqrt(6) * (x * x - y * y),
        7: np.sqrt(8) * (3 * rho2 - 2) * y,
        8: np.sqrt(8) * (3 * rho2 - 2) * x,
        11: np.sqrt(5) * (6 * rho2**2 - 6 * rho2 + 1),
    }.items():
        np.testing.assert_allclose(zernike(noll, x, y), wanted, atol=1e-13)


@pytest.mark.parametrize(("noll", "column", "row"), [(2, 1, 0), (3, 0, 1)])
def test_a_longer_path_on_one_side_moves_the_image_there(noll, column, row):
    """The sign of wavefronts: a tilt of rms a, 2 a per radius, moves the image by 4 a f#."""
    optics = Optics(0.05, 4.0, psf="fraunhofer", aberrations=(Aberration(noll, 200e-9),))
    plane = irradiance(optics, "fraunhofer", np.array([GREEN]), np.ones(1), 0.2e-6, 61)
    at = np.unravel_index(np.argmax(plane), plane.shape)
    assert (at[1] - 30, at[0] - 30) == (16 * column, 16 * row)


@pytest.mark.parametrize("defocus", [0.0, 3e-5, -2e-4])
def test_fresnel_by_chirps_is_fresnel_by_matrices(defocus):
    optics = Optics(0.05, 4.0, psf="fresnel", defocus=defocus, aberrations=(Aberration(8, 5e-8),))
    spacing, count = 0.7e-6, 101
    unit = irradiance(optics, "fresnel", np.array([GREEN]), np.ones(1), spacing, count)
    place, cell = pupil_grid(400)
    opened = area_weights(Pupil(), place, cell)
    pupil = opened * np.exp(2j * np.pi / GREEN * 5e-8 * zernike(8, place, place[:, None]))
    got = fresnel(pupil, place, 0.00625, GREEN, 0.05, 0.05 + defocus, spacing, count)
    peak = np.pi / 4 / (GREEN * 4) ** 2  # of the open circle, per unit of energy
    np.testing.assert_allclose(np.abs(got) ** 2, unit / peak, atol=2e-5)


def test_fresnel_along_the_axis_is_a_sinc():
    """[sin(w/2) / (w/2)]^2 with w = k d R^2 / (2 b z), times (b / z)^2 of the spreading wave."""
    place, cell = pupil_grid(300)
    pupil = area_weights(Pupil(), place, cell).astype(complex)
    for defocus in (1e-5, 4e-5, 1e-4, 3e-4):
        plane = 0.05 + defocus
        got = abs(fresnel(pupil, place, 0.00625, GREEN, 0.05, plane, 1e-6, 1)[0, 0]) ** 2
        w = 2 * np.pi / GREEN * defocus * 0.00625**2 / (2 * 0.05 * plane)
        assert got == pytest.approx(np.sinc(w / 2 / np.pi) ** 2 * (0.05 / plane) ** 2, abs=1e-6)


def test_fresnel_refuses_a_pupil_that_is_too_coarse():
    place, cell = pupil_grid(32)
    pupil = area_weights(Pupil(), place, cell).astype(complex)
    with pytest.raises(ValueError, match="two samples a wave"):
        fresnel(pupil, place, 0.00625, GREEN, 0.05, 0.055, 1e-6, 11)


@pytest.mark.parametrize(
    ("lens", "f_number", "distance"),
    [
        ("perfect", 1.4, None),
        ("perfect", 0.5, None),
        ("parabolic", 6.0, 1.0),
        ("perfect", 2.0, 0.04),
    ],
)
def test_kirchhoff_by_matrices_is_kirchhoff_by_quadrature(lens, f_number, distance):
    optics = Optics(0.02, f_number, psf="kirchhoff", lens=lens, object_distance=distance)
    spacing = GREEN * optics.working_f_number / 4
    plane = irradiance(optics, "kirchhoff", np.array([GREEN]), np.ones(1), spacing, 61)
    thin = ThinLens(0.02, 0.01 / f_number, distance or math.inf, GREEN, lens)
    exact = np.abs(profile(thin, np.arange(31) * spacing)) ** 2
    np.testing.assert_allclose(plane[30, 30:] / plane.max(), exact / exact.max(), atol=3e-6)


@pytest.mark.parametrize("f_number", [0.7, 1.4])
def test_the_aplanatic_lens_against_a_hankel_integral(f_number):
    """Int cos^(1/2) sin J0(k rho sin) over the angle, up to sin = 1 / (2 f#)."""
    optics = Optics(0.02, f_number, psf="kirchhoff")
    spacing = GREEN * f_number / 4
    plane = irradiance(optics, "kirchhoff", np.array([GREEN]), np.ones(1), spacing, 41)
    node, weight = np.polynomial.legendre.leggauss(200)
    edge = math.asin(0.5 / f_number)
    angle, weight = (node + 1) / 2 * edge, weight * edge / 2
    rho = np.arange(21)[:, None] * spacing
    field = special.j0(2 * np.pi / GREEN * rho * np.sin(angle)) @ (
        weight * np.sqrt(np.cos(angle)) * np.sin(angle)
    )
    np.testing.assert_allclose(plane[20, 20:] / plane.max(), (field / field[0]) ** 2, atol=3e-6)


def test_the_irradiance_holds_all_light():
    """The light in a square of half side h lies between that of its inner and its outer circle."""
    optics = Optics(0.05, 4.0, psf="fraunhofer")
    spacing, count = GREEN * 4 / 6, 241
    plane = irradiance(optics, "fraunhofer", np.array([GREEN]), np.ones(1), spacing, count)
    half = 120.5 * spacing
    held = plane.sum() * spacing**2
    assert airy_encircled(half, GREEN, 4) < held < airy_encircled(half * 2**0.5, GREEN, 4)


def test_a_gauss_band_keeps_the_moments():
    wavelength = np.linspace(400e-9, 900e-9, 41)
    weight = np.random.default_rng(2).uniform(0, 1, 41)
    node, fraction = gauss_band(wavelength, weight, 6)
    for power in range(12):
        x = (wavelength - 650e-9) / 250e-9
        wanted = weight @ x**power / weight.sum()
        assert fraction @ ((node - 650e-9) / 250e-9) ** power == pytest.approx(wanted, abs=1e-13)
    assert ((wavelength[0] < node) & (node < wavelength[-1])).all()


def test_equation_12_holds_the_area_of_the_image():
    x = np.linspace(-60e-6, 60e-6, 241)
    distance = np.array([8.0, 10.0])[:, None, None]
    image = gaussian(x, x[:, None], 1e-3, -2e-3, 0.05, distance, 5e-6)
    total = image.sum(axis=(1, 2)) * (x[1] - x[0]) ** 2
    np.testing.assert_allclose(total, (0.05 / distance.ravel()) ** 2, rtol=1e-6)
    row, column = np.unravel_index(np.argmax(image[1]), image[1].shape)
    assert (x[column], x[row]) == pytest.approx((-5e-6, 10e-6), abs=0.3e-6)
    with pytest.raises(ValueError, match="distance must be positive, got 0"):
        gaussian(x, x, 0.0, 0.0, 0.05, np.array([10.0, 0.0]), 5e-6)


def test_equation_10_is_the_peak_of_equation_8():
    """|G pi R^2|^2 with G = 1 / (lambda^2 b g), the paper's laboratory lens at 500 nm."""
    got = fresnel_peak(0.00125, 500e-9, 1 / 49, 1.0)
    assert got == pytest.approx((math.pi * 0.00125**2 * 49 / 25e-14) ** 2, rel=1e-12)
    assert jinc(np.array([0.0, 1e-300, 1e-12])).tolist() == [1.0, 1.0, 1.0]
