"""The Kirchhoff integral against 30-digit references and other formulations."""

import math

import numpy as np
import pytest
from krutz_2011 import ThinLens, _equal_phase, on_axis, point, profile
from scipy import integrate, special

from startrack.optics.diffraction import airy

GREEN = 550e-9


def cartesian(lens: ThinLens, image, source, count=160):
    """Eq. (7) as printed except for its two errors: strips over the lens, plain square roots.

    Along each strip and over the strips the nodes are Gauss's; x = R sin(t) removes the singular
    ends.
    """
    node, weight = np.polynomial.legendre.leggauss(count)
    t = node * np.pi / 2
    x = lens.radius * np.sin(t)
    chord = lens.radius * np.cos(t)
    y = chord[:, None] * node
    xi = x[:, None].astype(np.longdouble)
    to_source = np.sqrt(
        (xi - source[0]) ** 2 + (y - source[1]) ** 2 + np.longdouble(lens.distance) ** 2
    )
    to_image = np.sqrt((xi - image[0]) ** 2 + (y - image[1]) ** 2 + np.longdouble(lens.image) ** 2)
    k = 2 * np.pi / np.longdouble(lens.wavelength)
    phase = k * (to_source + to_image - lens.distance - lens.image)
    phase -= np.pi / (np.longdouble(lens.wavelength) * lens.focal_length) * (xi**2 + y**2)
    size = (lens.distance * lens.image / (to_source * to_image)) ** 2
    value = (size * np.exp(1j * phase)).astype(complex)
    area = np.outer(weight * np.pi / 2 * chord**2, weight)
    return complex((area * value).sum()) / (np.pi * lens.radius**2)


def test_on_axis_within_1e8_of_thirty_digits(oracle):
    reference = oracle("kirchhoff.json")
    errors = []
    for name, entry in reference["wavelengths"].items():
        for row in entry["rows"]:
            lens = ThinLens(0.02, float(row["R"]), 1.0, float(name) * 1e-9)
            wanted = float(row["kirchhoff"]) / float(row["fresnel"])
            errors.append(abs(on_axis(lens)) ** 2 / wanted - 1)
    assert len(errors) > 80
    assert np.abs(errors).max() < 1e-11


def test_the_effort_grows_with_the_oscillations():
    """The number of panels per wave of phase stays one, from a tenth of a wave to thousands."""
    for radius in (1e-3, 3e-3, 0.01, 0.02):
        lens = ThinLens(0.02, radius, 1.0, GREEN)
        waves = abs(float(lens.phase_defect(radius))) / (2 * np.pi)
        panels = len(_equal_phase(lens, lens.image, 0.0)) - 1
        assert waves <= panels <= waves + 2


@pytest.mark.parametrize("f_number", [4.0, 8.0, 16.0])
@pytest.mark.parametrize("lens", ["parabolic", "perfect"])
def test_off_axis_is_what_the_full_integral_gives(f_number, lens):
    thin = ThinLens(0.02, 0.01 / f_number, 1.0, GREEN, lens)
    radius = np.array([0.0, 0.3, 1.22, 5.0, 11.0]) * GREEN * f_number
    fast = profile(thin, radius)
    slow = [point(thin, np.array([0.6, -0.8]) * r, np.zeros(2), 160) for r in radius]
    np.testing.assert_allclose(fast, slow, atol=1e-11)
    if lens == "parabolic":
        plain = [cartesian(thin, (r, 0.0), (0.0, 0.0)) for r in radius]
        np.testing.assert_allclose(fast, plain, atol=1e-8)


@pytest.mark.parametrize("source", [(0.03, 0.0), (0.02, -0.05)])
def test_an_object_off_the_axis(source):
    """Against the integral over strips, at the geometric image and beside it."""
    thin = ThinLens(0.02, 0.0012, 1.0, GREEN)
    there = -np.array(source) * thin.image / thin.distance
    for beside in (0.0, 2e-6, 7e-6):
        image = there + np.array([beside, 0.0])
        assert abs(point(thin, image, np.array(source), 160)) == pytest.approx(
            abs(cartesian(thin, image, source)), abs=1e-8
        )


def test_it_becomes_fresnel_where_that_holds():
    """At f/40 the profile is the Airy pattern within the inclination R^2 / b^2 = 1.6e-4."""
    thin = ThinLens(0.02, 0.00025, math.inf, GREEN)
    radius = np.linspace(0, 4, 40) * GREEN * 40
    np.testing.assert_allclose(
        np.abs(profile(thin, radius)) ** 2, airy(radius, GREEN, 40), atol=3e-4
    )


def test_the_difference_to_fresnel_falls_with_the_second_power_of_the_aperture():
    """For a perfect lens the difference is its inclination: R^2 / b^2 on the axis."""
    loss = [
        1 - abs(on_axis(ThinLens(0.02, radius, math.inf, GREEN, "perfect"))) ** 2
        for radius in (1e-4, 2e-4, 4e-4)
    ]
    np.testing.assert_allclose(np.diff(np.log2(loss)), 2, atol=0.01)


def test_out_of_focus_against_scipy():
    thin = ThinLens(0.02, 0.002, 1.0, GREEN)
    k, b, plane = thin.wavenumber, thin.image, thin.image + 3e-4

    def integrand(s, part):
        r = np.sqrt(s)
        path = np.hypot(r, plane) - plane + np.hypot(r, 1.0) - 1.0
        value = b**2 / (plane**2 + s) / (1 + s) * np.exp(1j * (k * path - np.pi * s / GREEN / 0.02))
        return getattr(value, part) / thin.radius**2

    parts = [
        integrate.quad(integrand, 0, thin.radius**2, (part,), limit=500, epsabs=1e-11)[0]
        for part in ("real", "imag")
    ]
    assert abs(on_axis(thin, 3e-4)) == pytest.approx(math.hypot(*parts), abs=1e-8)


@pytest.mark.parametrize("radius", [1e-12, 1e-9, 1e-6])
def test_a_vanishing_aperture_is_paraxial(radius):
    thin = ThinLens(0.02, radius, 1.0, GREEN)
    assert abs(on_axis(thin)) ** 2 == pytest.approx(1, abs=(radius / 0.02) ** 2 + 1e-13)


def test_a_perfect_lens_of_f_one_half_against_a_hankel_integral():
    """Over the sine of the angle at the focus, exact on the axis of the image, by scipy."""
    thin = ThinLens(0.02, 0.02, math.inf, GREEN, "perfect")
    radius = np.array([0.0, 0.4, 0.9, 1.7]) * 1e-6
    got = np.abs(profile(thin, radius)) / abs(on_axis(thin))

    def debye(rho):
        return integrate.quad(
            lambda a: np.tan(a) * special.j0(thin.wavenumber * rho * np.sin(a)), 0, np.pi / 4
        )[0]

    np.testing.assert_allclose(got, np.abs([debye(rho) / debye(0) for rho in radius]), atol=1e-6)


def test_what_cannot_be_computed_is_refused():
    with pytest.raises(ValueError, match="evaluations"):
        profile(ThinLens(0.02, 0.02, 1.0, 100e-9), np.linspace(0, 1e-3, 1000))
    with pytest.raises(ValueError, match="beyond the focal length"):
        ThinLens(0.02, 0.001, 0.02, GREEN)
    thin = ThinLens(0.02, 0.001, 1.0, GREEN)
    with pytest.raises(ValueError, match=r"defocus must leave the plane behind the lens.*-0.03 m"):
        on_axis(thin, -0.03)
    with pytest.raises(ValueError, match="radius must be finite, got nan"):
        profile(thin, np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match="finite for an object off the axis"):
        point(ThinLens(0.02, 0.001, math.inf, GREEN), np.zeros(2), np.zeros(2), 10)
