"""The lens over the field of an Earth image: images, places, illumination, smile, keystone."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from startrack.core import Curve
from startrack.core.units import deg, nm, um
from startrack.detector import Detector, Scan
from startrack.detector.stamp import stamp_paths
from startrack.earth.geometry import Aircraft, inside_pixel, observe_earth
from startrack.earth.geometry.scene import Fractal, Terrain
from startrack.earth.imager import (
    Channel,
    Cover,
    Imager,
    Land,
    Picture,
    Spectrometer,
    Survey,
    lens_registration,
    prepare,
    render,
)
from startrack.earth.imager.band import band_of
from startrack.earth.imager.figures import figures
from startrack.earth.imager.lens import FieldLens, field_blur, field_lens, image_pixels
from startrack.earth.product import calibrate
from startrack.earth.product.ortho import Locator
from startrack.earth.product.retrieval import to_radiance
from startrack.optics import Optics, open_optics
from startrack.optics.lens_psf import lens_stars

FLAT = Terrain(fractal=Fractal(10 * deg, 47 * deg, 20.0, 64, 1e-3), highest=100.0, lowest=-10.0)
PLANE = Aircraft("2026-06-21T10:00:00", 10 * deg, 47 * deg, 3e3, speed=100.0)
LINE = Detector(
    800,
    12,
    20e-6,
    1e-3,
    Curve((), (0.5,)),
    full_well=1e6,
    bits=14,
    offset=20,
    pixel_rate=1e6,
    scan=Scan(),
)
MATRIX = replace(LINE, columns=480, rows=320, scan=None)
BRIGHT = 1e6  # electron of a star whose image is interpolated as well as it can be
GREEN, NEAR = (540 * nm, 560 * nm), (890 * nm, 910 * nm)


def box(low: float, high: float) -> Curve:
    return Curve((low - 0.1 * nm, low, high, high + 0.1 * nm), (0.0, 1.0, 1.0, 0.0))


def channel(detector: Detector = LINE, band=GREEN, name="one", **more) -> Channel:
    lens = {"f_number": 4.0, "lens_family": "double-gauss", "psf_tolerance": 0.05} | more
    ahead = lens.pop("forwards", 0.0)
    return Channel(name, Optics(0.05, **lens), detector, box(*band), ahead)


def survey(*channels: Channel, **rest) -> Survey:
    land = rest.pop("land", Land(lapse=0.0))
    spectrometer = rest.pop("spectrometer", None)
    return Survey(Imager(channels, spectrometer), FLAT, aircraft=PLANE, land=land, rays=1, **rest)


@cache
def lens_of(one: Channel) -> FieldLens:
    """Of light of the channel's band, even over its wavelengths."""
    sensor = survey(one).scene(one).sensor
    wavelength = np.linspace(*one.band.wavelength[1:3], 21)
    return field_lens(one, sensor, one.optics, wavelength, np.ones(21))


@pytest.mark.parametrize(
    "detector", [LINE, pytest.param(MATRIX, marks=pytest.mark.slow)], ids=["line", "matrix"]
)
def test_an_extended_scene_is_the_sum_of_its_points(detector):
    """Random radiance in [0, 1] for each ray, against a sum of all rays as stars of the lens table.

    Light outside of the table of a star is in the rest of its image.
    """
    one = channel(detector)
    lens, sensor = lens_of(one), survey(one).scene(one).sensor
    columns, rows = image_pixels(one, sensor)
    blur = field_blur(lens.images, columns, rows, 2, 1.0, 1.0, 0.0)
    many = 24 if detector.scan else len(rows)
    rays = np.random.default_rng(1).random((many, len(columns), 4)).astype(np.float32)
    image = np.concatenate(list(blur.blurred(iter([rays[:15], rays[15:]]))))
    half = blur.weights.shape[-1] // 2
    energy = lens.images.table.sum((1, 2)) / lens.images.oversampling**2
    assert len(blur.parts) > 1
    down = [12] if detector.scan else [half, 100, many // 2, many - half - 1]
    error = []
    across = [half, 150, len(columns) // 2, len(columns) - half - 1]
    for j, i in zip(down * (4 // len(down)), across, strict=True):
        box = slice(j - half, j + half + 1), slice(i - half, i + half + 1)
        y, x = np.mgrid[box]
        wanted = np.zeros((2 * half + 1, 2 * half + 1))
        for n, (off_x, off_y) in enumerate(inside_pixel(2)):
            at_x = x.ravel() + off_x
            at_y = y.ravel() + off_y
            seen_y = np.full(at_y.size, rows[0]) if detector.scan else at_y
            found = lens.images.at(at_x, seen_y, np.full(at_x.size, lens.images.colour[0]))
            light = BRIGHT * rays[box][..., n].ravel() / 4 / (found[:, 3:] @ energy)
            electrons = found[:, 3:] * light[:, None]
            at = (at_x - i + half)[None], (at_y - j + half)[None]
            stamp_paths(wanted, lens.images, np.ones(1), *at, electrons)
        error.append(abs(image[j, i] - wanted[half, half] / BRIGHT))
    assert max(error) < 2e-3


def test_illumination_is_that_of_the_solid_angle_of_the_pupil():
    """Etendue before and behind the lens: flux times solid angle, against the size of the exit
    pupil.

    Irradiance is radiance times the area of the pupil in direction cosines (p, q), within the 1 %
    to which areas and pupils of the table agree at 9 degrees.
    """
    one = channel()
    lens, table = lens_of(one), open_optics(one.optics)
    assert lens.light is not None
    (row,) = image_pixels(one, survey(one).scene(one).sensor)[1]
    place = np.stack([np.arange(0, 800, 50.0), np.full(16, row)], 1)
    angle = np.arccos(lens.camera.unproject(place)[:, 2])
    found = table.at(np.array([550 * nm]), angle)
    turn = np.linspace(0, 2 * math.pi, 721)[:-1]
    rim = 1 + np.cos(turn[:, None] * np.arange(found.outline.shape[-1])) @ found.outline[0].T
    area = found.pupil[0, :, 4] * found.pupil[0, :, 5] * (rim**2).mean(0) * math.pi
    wanted = area / (math.pi / (2 * one.optics.f_number) ** 2)
    np.testing.assert_allclose(lens.light[0, ::50], wanted, rtol=0.011)
    assert wanted.min() < 0.97 * wanted.max()


@pytest.mark.slow
def test_flats_take_the_illumination_out_of_the_radiance(tmp_path):
    one = channel()
    seen = survey(one)
    picture = Picture.blank(12, 800)
    setting = render(seen, one, tmp_path, 1, picture)
    frames = calibrate(seen, one, setting, 1)
    signal = picture.numbers.mean(0) - frames.dark[0]
    # The rays of this lens give its edge 0.963 of the light of its middle.
    assert signal[:40].mean() < 0.97 * signal[380:420].mean()
    radiance = to_radiance(picture.numbers, frames).mean(0)
    truth = sum(each.mean(0) for each in picture.terms)
    for part in np.split(radiance / truth, 4):
        assert part.mean() == pytest.approx(1, abs=2e-3)  # 2,400 pixels of 60:1


def test_channels_are_apart_by_the_lateral_colour_of_their_rays():
    """Centroids of rays at the middle of each band, for the last pixel of the line."""
    pair = [channel(name=str(band), band=band, f_number=8.0) for band in (GREEN, NEAR)]
    first, second = (lens_of(each).camera for each in pair)
    across, along = lens_registration(pair[1], second, pair[0], first)
    middle = np.array([550 * nm, 900 * nm])
    rays = lens_stars(open_optics(pair[0].optics), middle, math.atan(0.16), 0.0)
    green, near = (star.centroid[0] / LINE.pitch for star in rays)
    assert across == pytest.approx(abs(green - near), abs=2e-3)
    assert abs(green - near) > 0.009
    assert along < 2e-3


@pytest.mark.parametrize(
    "forwards", [0.0, pytest.param(6 * deg, marks=pytest.mark.slow)], ids=["below", "ahead"]
)
def test_a_point_is_found_in_the_pixel_that_sees_it_through_a_lens(forwards, tmp_path):
    """A line ahead of the axis sees its ground at its angle, and the distortion bends it."""
    one = replace(channel(replace(LINE, columns=400) if forwards else LINE), forwards=forwards)
    columns = one.columns
    seen = survey(one)
    lens = lens_of(one)
    (strip,) = observe_earth(seen.scene(one), tmp_path, None, lens.camera)
    found = Locator(seen.scene(one), lens.camera).locate(strip.ground.point)
    line, column = np.divmod(np.arange(len(found)), columns)
    np.testing.assert_allclose(found, np.stack([column, line], 1), atol=1e-5)
    direction = lens.camera.unproject(np.array([[(columns - 1) / 2, (lens.camera.rows - 1) / 2]]))[
        0
    ]
    assert math.atan2(direction[1], direction[2]) == pytest.approx(forwards, abs=1e-5)


def test_a_spectral_line_bends_by_smile(tmp_path):
    """Ground that is bright above 550 nm, in bands of 10 nm that smile shifts by 2 nm."""
    edge = Cover(Curve((549.9 * nm, 550.1 * nm), (0.0, 0.6)), 288.0)
    step = Curve((549.9 * nm, 550.1 * nm, 900 * nm), (0.0, 0.6, 0.6))
    plain = {"lens_family": "", "psf": "airy", "psf_tolerance": 0.01}
    one = channel(replace(LINE, columns=400), (545 * nm, 555 * nm), **plain)
    bent = survey(
        one,
        land=Land((replace(edge, reflectance=step),), lapse=0.0),
        spectrometer=Spectrometer(smile=2 * nm),
        surroundings=0.0,
    )
    even = replace(bent, land=Land((Cover(Curve((), (0.6,))),), lapse=0.0))
    light = []
    for each in (bent, even):
        picture = Picture.blank(12, 400)
        render(each, one, tmp_path, 1, picture)
        light.append(picture.terms.direct.mean(0))
    place = (np.arange(400) - 199.5) / 200
    wanted = 0.5 + 2 * place**2 / 10
    np.testing.assert_allclose(light[0] / light[1], wanted, atol=0.01)


def test_the_spectrum_of_a_point_is_oblique_by_keystone(tmp_path):
    plain = {"lens_family": "", "psf": "airy", "psf_tolerance": 0.01}
    bands = [(450 * nm, 460 * nm), (500 * nm, 510 * nm), (650 * nm, 660 * nm)]
    channels = [channel(name=f"{low:.3g}", band=(low, high), **plain) for low, high in bands]
    seen = survey(*channels, spectrometer=Spectrometer(keystone=12 * um), columns=400)
    cameras = [prepare(seen, each, tmp_path).camera for each in seen.channels]
    direction = np.array([[0.0, 0.0, 1.0], [-199.5 * 20e-6 / 0.05, 0.0, 1.0]])
    moved = np.array([each.project(direction)[:, 0] for each in cameras]) - [199.5, 0.0]
    # Half of the line's 800 columns away from its middle: half of 12 um, which is 0.3 pixel.
    np.testing.assert_allclose(moved[:, 0], 0, atol=1e-9)
    np.testing.assert_allclose(moved[:, 1], [0.3, 0.15, -0.3], atol=2e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: channel(lens_colour=False), "optics.lens_colour must be left out: the band"),
        (lambda: lens_of(channel(band=(1500 * nm, 1600 * nm))), "one: lens_file must hold the"),
        (lambda: lens_of(channel(replace(LINE, pixel_pitch=50e-6))), "one: lens_file must reach"),
        (lambda: Imager((channel(MATRIX),), Spectrometer(smile=nm)), "channel .* is not a line"),
        (lambda: Imager((channel(),), Spectrometer(keystone=um)), "spectrometer.keystone must be"),
        (lambda: Imager((replace(channel(), band=Curve()),), Spectrometer(nm)), "must have band"),
    ],
    ids=["colour", "band", "field", "matrix", "one channel", "no band"],
)
def test_what_no_lens_can_show_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.slow
def test_figures_are_the_lowest_over_the_field():
    """The traced lens at f/2.8, whose images grow towards the edge, against one with diffraction
    alone."""
    one = channel(f_number=2.8)
    band = band_of(one, None, 3e3, 1.0)
    found = figures(one, band, 3e3, 0.03)
    ideal = replace(one, optics=Optics(0.05, 2.8))
    best = figures(ideal, band, 3e3, 0.03)
    assert found.snr == pytest.approx(best.snr)
    assert 0.2 * best.mtf_across < found.mtf_across < best.mtf_across
    assert found.mtf_along < best.mtf_along
    assert found.illumination == pytest.approx(math.cos(math.atan(0.16)) ** 4, abs=0.02)
