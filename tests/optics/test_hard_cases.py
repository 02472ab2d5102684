"""Extreme cases: the result is right, or is refused with the reason."""

import math

import numpy as np
import pytest

from startrack.optics import Aberration, Optics, Pupil, Segment, pixel_psf
from startrack.optics.pixel_psf import irradiance
from tests.optics.closed import airy_encircled

ONE = np.ones(1)
GREEN = np.array([550e-9])


@pytest.mark.parametrize("wavelength", [100e-9, 20e-6])
@pytest.mark.parametrize("model", ["airy", "fraunhofer", "kirchhoff"])
def test_only_ratios_to_the_wavelength_count(wavelength, model):
    """The same optics in units of the wavelength have the same table, from UV to infrared."""

    def table(scale):
        optics = Optics(1e5 * scale, 3.0, 2 * scale, model)
        return pixel_psf(optics, 8 * scale, np.array([scale]), ONE)

    here, there = table(wavelength), table(1e-6)
    np.testing.assert_allclose(here.table, there.table, atol=1e-11)
    assert here.energy == pytest.approx(there.energy, abs=1e-11)


def test_f_100_is_the_airy_pattern_in_every_model():
    tables = [
        pixel_psf(Optics(1.0, 100.0, psf=model), 20e-6, GREEN, ONE).table
        for model in ("airy", "fraunhofer", "fresnel", "kirchhoff")
    ]
    for each in tables[1:]:
        np.testing.assert_allclose(each, tables[0], atol=2e-5 * tables[0].max())


def test_f_one_half_of_an_aplanatic_lens_is_refused():
    with pytest.raises(ValueError, match=r"f_number must be at least 0\.6"):
        Optics(0.02, 0.5)
    table = pixel_psf(Optics(0.02, 0.5, lens="perfect"), 1e-6, GREEN, ONE)
    assert 0.9 < table.energy < 1


def test_an_object_at_twice_the_focal_length_is_imaged_one_to_one():
    near = Optics(0.05, 4.0, psf="airy", object_distance=0.1)
    assert near.image_distance == pytest.approx(0.1)
    table = pixel_psf(near, 5e-6, GREEN, ONE)
    far = pixel_psf(Optics(0.1, 8.0, psf="airy"), 5e-6, GREEN, ONE)
    np.testing.assert_allclose(table.table, far.table, rtol=1e-9, atol=1e-15)


def test_an_object_nearly_at_the_focus_is_imaged_far_away():
    near = Optics(0.05, 4.0, psf="airy", object_distance=0.0505)
    assert near.working_f_number == pytest.approx(4 * 101)
    disk = 550e-9 * 404
    table = pixel_psf(near, disk / 2, GREEN, ONE)
    assert airy_encircled(6 * disk, 550e-9, 404) < table.energy
    for distance in (0.05, 0.03):
        with pytest.raises(ValueError, match="beyond the focal length"):
            Optics(0.05, 4.0, object_distance=distance)


@pytest.mark.parametrize("waves", [0.5, 1.0, 1.5, 5.5, 20.5])
def test_defocus_on_the_axis_is_a_sinc(waves):
    """For W waves at the rim: [sin(pi W) / (pi W)]^2 of the focus."""
    defocus = 8 * 4.0**2 * waves * 550e-9
    optics = Optics(0.5, 4.0, psf="fraunhofer", defocus=defocus)
    focal = Optics(0.5, 4.0, psf="fraunhofer")
    here, there = (
        irradiance(each, "fraunhofer", GREEN, ONE, 1e-6, 41)[20, 20] for each in (optics, focal)
    )
    assert here / there == pytest.approx(np.sinc(waves) ** 2, abs=1e-5)


def test_many_waves_of_defocus_fill_the_geometric_disk():
    """Ten waves: rays fill a disk of radius d / (2 f#); diffraction puts a tenth of the light
    outside."""
    defocus = 8 * 4.0**2 * 10 * 550e-9
    table = pixel_psf(Optics(0.5, 4.0, defocus=defocus), 10e-6, GREEN, ONE)
    edge = defocus / 8 / 10e-6
    at = (np.arange(table.table.shape[0]) - table.table.shape[0] // 2) / table.oversampling
    radius = np.hypot(at, at[:, None])
    inside = table.table[radius < edge].sum() / table.oversampling**2
    half = table.table[radius < edge / 2].sum() / table.oversampling**2
    assert inside > 0.9
    assert half == pytest.approx(0.25, abs=0.02)
    assert table.energy > 0.99


def test_too_many_waves_are_refused():
    with pytest.raises(ValueError, match="use `blur` instead"):
        pixel_psf(Optics(0.5, 4.0, defocus=0.02), 10e-6, GREEN, ONE)
    with pytest.raises(ValueError, match="defocus must be at most a tenth"):
        Optics(0.05, 4.0, defocus=0.01)
    with pytest.raises(ValueError, match="use `blur` instead"):
        pixel_psf(Optics(0.5, 4.0, aberrations=(Aberration(100, 1e-4),)), 10e-6, GREEN, ONE)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Pupil(obscuration=1.0), r"obscuration must lie in \[0, 0.95\], got 1.0"),
        (lambda: Pupil(vanes=3), "vanes and vane_width must both be zero or both be positive"),
        (lambda: Segment(0.9, 0, 0.3), "segment must lie inside the aperture"),
        (lambda: Pupil(segments=(Segment(0, 0, 0.3), Segment(0.2, 0.4, 0.3))), "must not overlap"),
        (
            lambda: Pupil(segments=(Segment(0, 0, 0.3, "circle"), Segment(0.5, 0, 0.21, "circle"))),
            "segments must not overlap, got Segment",
        ),
        (lambda: Segment(0, 0, 0.3, "square"), "shape must be one of circle, hexagon"),
        (lambda: Aberration(0, 1e-9), r"noll must be a whole number in \[1, 231\], got 0"),
        (lambda: Optics(0.05, 4, psf="airy", defocus=1e-6), "psf must be auto, fraunhofer"),
        (lambda: Optics(0.05, 4, lens="perfect", pupil=Pupil(0.3)), "lens must be aplanatic"),
        (lambda: Optics(0.05, 4, object_distance=math.nan), "object_distance must be finite"),
    ],
)
def test_what_makes_no_sense_is_named(build, words):
    with pytest.raises(ValueError, match=words):
        build()


def test_growing_aberrations_vanish_on_the_axis_and_turn_with_the_field():
    from startrack.optics import over_field
    from startrack.optics.pixel_psf import at_field

    coma = Aberration(8, 60e-9, growth=1)  # tail along x for a star along x
    optics = Optics(0.05, 4.0, aberrations=(coma,), field_edge=0.1)
    assert at_field(optics, 0.0, 0.0).aberrations == ()
    right, down, corner = over_field(
        optics, [(0.1, 0.0), (0.0, 0.1), (0.05, 0.0)], 3e-6, GREEN, ONE
    )
    np.testing.assert_allclose(right.table.T, down.table, atol=1e-9)
    np.testing.assert_allclose(right.table, right.table[::-1], atol=1e-9)
    assert np.abs(right.table - right.table[:, ::-1]).max() > 0.02 * right.table.max()
    assert corner.table.max() > right.table.max()
    (astigmatism,) = at_field(
        Optics(0.05, 4.0, aberrations=(Aberration(6, 1e-8, 2),), field_edge=0.1), 0.0, 0.1
    ).aberrations
    assert (astigmatism.noll, astigmatism.rms) == (6, pytest.approx(-1e-8))


@pytest.mark.parametrize("disks", [20, 40, 62, 122, 1000])
def test_a_pixel_of_many_disks_holds_what_its_circles_do(disks):
    """The light in a square lies between that of its inner and its outer circle; all is counted.

    For any phase, its pixels add up to the energy, except the part outside of the table's box.
    """
    psf = pixel_psf(Optics(0.05, 2.0, psf="airy"), disks * 1.1e-6, GREEN, ONE)
    half = disks * 0.55e-6
    inner, outer = airy_encircled(half * np.array([1, math.sqrt(2)]), 550e-9, 2.0)
    assert inner < psf.table.max() < outer
    assert psf.table.min() > -1e-9
    middle, step = psf.table.shape[0] // 2, psf.oversampling
    sums = [psf.table[(middle + k) % step :: step].sum() / step for k in range(0, step, 7)]
    np.testing.assert_allclose(sums, psf.energy, atol=1e-3)


def test_two_ways_to_a_pixel_of_many_disks():
    one, two = (
        pixel_psf(Optics(0.05, 2.0, psf=model), 62 * 1.1e-6, GREEN, ONE)
        for model in ("airy", "fraunhofer")
    )
    np.testing.assert_allclose(one.table, two.table, atol=2e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pitch": 0.0}, "pitch must be positive"),
        ({"fill_factor": 1.5}, r"fill_factor must lie in \[0, 1\]"),
        ({"diffusion": -1e-6}, "diffusion must not be negative"),
    ],
)
def test_pixels_that_cannot_be_are_named(change, words):
    usual = {"pitch": 5e-6, "fill_factor": 1.0, "diffusion": 0.0} | change
    with pytest.raises(ValueError, match=words):
        pixel_psf(Optics(0.05, 4.0), wavelength=GREEN, weight=ONE, **usual)
