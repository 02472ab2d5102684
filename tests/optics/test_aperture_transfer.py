"""Piston and tilt of segments, sparse apertures, and the Wiener filter, in MTF and image."""

import math

import numpy as np
import pytest
from scipy.special import j1

from startrack.core import Refused, nm
from startrack.optics import (
    Optics,
    Pupil,
    Segment,
    aperture_transfer,
    modulation,
    pixel_psf,
    wiener_filter,
)
from startrack.optics.choose import steepest_slope

GREEN, F_NUMBER = 500 * nm, 10.0
CUTOFF = 1 / (GREEN * F_NUMBER)  # cycle / metre
SIZE, APART = 0.2, 0.7  # radii of the whole aperture


def two(piston=0.0, tilt=0.0):
    """Two circles along x: an interferometer with a baseline of 0.7 diameters."""
    pieces = (
        Segment(-APART, 0.0, SIZE, "circle"),
        Segment(APART, 0.0, SIZE, "circle", piston=piston, tilt_y=tilt),
    )
    return Optics(1.0, F_NUMBER, pupil=Pupil(segments=pieces), psf="fraunhofer")


def circle(shift):
    """Transfer function of one circle over the shift, in its diameters."""
    s = np.minimum(np.abs(shift), 1.0)
    return 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s * s))


def interferometer(frequency, phase):
    """Goodman: each circle with itself, and with the other one a baseline away."""
    shift = frequency / CUTOFF  # of the whole aperture, in its diameters
    own = circle(shift / SIZE)
    right, left = (circle((shift + side * APART) / SIZE) for side in (-1, 1))
    return np.abs(own + (np.exp(1j * phase) * right + np.exp(-1j * phase) * left) / 2)


@pytest.mark.parametrize("waves", [0.0, 0.25, 0.5])
def test_two_apertures_have_the_mtf_of_an_interferometer(waves):
    """Pistons shift fringes, which keep their contrast of 1/2 in their own band of frequencies."""
    frequency = CUTOFF * np.array([0.0, 0.05, 0.1, 0.3, 0.6, 0.7, 0.8, 0.95])
    found = aperture_transfer(two(waves * GREEN), GREEN, frequency, "x")
    np.testing.assert_allclose(found, interferometer(frequency, 2 * np.pi * waves), atol=3e-3)
    assert found[5] == pytest.approx(0.5, abs=3e-3)
    across = aperture_transfer(two(waves * GREEN), GREEN, frequency, "y")
    np.testing.assert_allclose(across, circle(frequency / CUTOFF / SIZE), atol=2e-3)


def test_half_a_wave_makes_the_middle_dark():
    spacing = 0.4 * GREEN * F_NUMBER
    images = [
        pixel_psf(two(piston), spacing, np.array([GREEN]), np.ones(1)).table
        for piston in (0.0, GREEN / 2, GREEN)
    ]
    middle = len(images[0]) // 2
    bright = images[0][middle, middle]
    assert images[1][middle, middle] < 0.08 * bright  # a pixel is 0.28 fringes wide
    np.testing.assert_allclose(images[2], images[0], atol=1e-4 * bright)


def test_the_image_has_the_same_mtf():
    """By the transform of the image in small pixels, divided by the pixel's own.

    The table of an image ends at six wavelengths times the f-number of the whole aperture, where a
    circle of a fifth of it has its first dark ring: 15 % of the contrast is lost there.
    """
    pitch = 0.3 * GREEN * F_NUMBER
    optics = two(0.2 * GREEN)
    psf = pixel_psf(optics, pitch, np.array([GREEN]), np.ones(1))
    cycles = np.array([0.06, 0.21])  # per pixel; 0.21 is that of the baseline, 0.7 of the cutoff
    image = modulation(psf, cycles, 0.0) / np.sinc(cycles) / psf.energy
    np.testing.assert_allclose(
        image, aperture_transfer(optics, GREEN, cycles / pitch, "x"), atol=0.05
    )


def test_tilt_takes_the_overlap_of_the_images():
    """Fringes vanish if the images of both circles do not overlap: tilt of two cutoffs and more.

    Their images with a radius of 1.22 wavelengths over the circle's diameter are separated by the
    tilt.
    """
    base = np.array([0.7 * CUTOFF])
    radius = 0.05
    apart = GREEN / (2 * SIZE * radius)
    contrasts = [
        aperture_transfer(two(tilt=factor * apart), GREEN, base, "x")[0]
        for factor in (0, 0.5, 1.22)
    ]
    assert contrasts[0] == pytest.approx(0.5, abs=3e-3)
    v = math.pi * 0.5  # of the circle's pattern, jinc(v) = 2 J1(v) / v
    assert contrasts[1] == pytest.approx(0.5 * 2 * j1(v) / v, abs=3e-3)
    assert contrasts[2] < 0.01


def test_steps_between_segments_are_no_slopes():
    assert steepest_slope(two(50 * GREEN), "fraunhofer") < 1e-15
    tilted = steepest_slope(two(50 * GREEN, tilt=1e-6), "fraunhofer")
    assert tilted == pytest.approx(1e-6 * 0.05)


def test_a_whole_circle_is_that_of_goodman_and_hexagons_in_phase_are_one_mirror():
    whole = Optics(1.0, F_NUMBER)
    frequency = CUTOFF * np.linspace(0, 1, 7)
    np.testing.assert_allclose(
        aperture_transfer(whole, GREEN, frequency, "x"), circle(frequency / CUTOFF), atol=1e-3
    )
    phased = Pupil(
        segments=(Segment(0.0, 0.0, 0.25, piston=30 * nm), Segment(0.0, 0.5, 0.25, piston=30 * nm))
    )
    alike = Pupil(segments=(Segment(0.0, 0.0, 0.25), Segment(0.0, 0.5, 0.25)))
    found = [
        aperture_transfer(Optics(1.0, F_NUMBER, pupil=pupil), GREEN, frequency, "x")
        for pupil in (phased, alike)
    ]
    np.testing.assert_allclose(*found, atol=1e-12)


def test_a_wiener_filter_leaves_the_least_error():
    """For many waves in noise, up to the filter's scale, which keeps the value of uniform light."""
    rng = np.random.default_rng(1)
    snr, transfer = 5.0, np.array([1.0, 0.6j, 0.05])
    phases = rng.normal(size=(2, 2, 40_000, 3))
    wave, noise = phases[0] + 1j * phases[1]
    image = transfer * snr * wave + noise
    gains = wiener_filter(transfer, snr)
    assert gains[0] == pytest.approx(1.0)

    def error(weights):
        return (np.abs(weights / (1 + snr**-2) * image - snr * wave) ** 2).mean(0)

    for change in (0.9, 1.1, np.exp(0.1j), np.exp(-0.1j)):
        assert (error(change * gains) > error(gains)).all()
    with pytest.raises(Refused, match="signal_to_noise must be positive"):
        wiener_filter(transfer, 0.0)
