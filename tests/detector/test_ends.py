"""Designs and scenes at the ends of their ranges."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import special
from scipy.spatial.transform import Rotation

from startrack.core import read_only
from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.values import Light, LineOfSight, Psf
from startrack.detector import (
    Defects,
    Detector,
    Exposure,
    Hits,
    Pattern,
    Thermal,
    expected,
    expose,
    read_out,
)
from startrack.detector.digitise import _digitise
from startrack.detector.stamp import _stamp, stamp_paths

REST = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
WAVELENGTH, THROUGHPUT = np.array([600e-9]), np.ones(1)


def gaussian(sigma=0.7) -> Psf:
    half = int(6 * sigma + 2) * 16 + 3
    x = np.arange(-half, half + 1) / 16
    line = special.ndtr((x + 0.5) / sigma) - special.ndtr((x - 0.5) / sigma)
    return Psf(np.outer(line, line), 16, 1.0)


def scene(camera, pixel=(20.0, 20.0), electrons=0.0, sky=0.0, exposure=0.1) -> Light:
    return Light(
        camera.unproject(np.atleast_2d(pixel)),
        WAVELENGTH,
        np.full((1, 1), electrons / exposure),
        np.full(1, sky / exposure * camera.focal_length_px**2),
    )


def view(detector, trial=0, **light):
    camera = Camera(detector.columns, detector.rows, 1000.0)
    sources = scene(camera, exposure=detector.exposure, **light)
    return Exposure(sources, gaussian(), REST, Rotation.identity(), camera, detector, THROUGHPUT)


def frame(detector, trial=0, **light):
    return expose(view(detector, **light), Streams(1, trial)).image


DETECTOR = Detector(64, 48, 5e-6, 0.1, offset=100, full_well=20_000.0)


def test_no_photons():
    np.testing.assert_array_equal(frame(DETECTOR), 100)
    noisy = frame(replace(DETECTOR, read_noise=20.0, columns=256, rows=256))
    assert noisy.mean() == pytest.approx(100, abs=0.1)


@pytest.mark.parametrize("bits", [16, 24])
def test_a_thousand_million_photons_in_a_pixel(bits):
    """The flux is kept to 1e-6; the shot noise of a mean over 3072 pixels is 6e-7."""
    one = replace(DETECTOR, full_well=2e9, bits=bits)
    image = frame(one, sky=1e9).astype(float)
    flux = (image - 100) * one.electrons_per_dn
    step = one.electrons_per_dn / math.sqrt(12 * image.size)
    assert flux.mean() == pytest.approx(1e9, abs=4 * (math.sqrt(1e9 / image.size) + step))
    assert flux.std() == pytest.approx(
        math.hypot(math.sqrt(1e9), one.electrons_per_dn / 12**0.5), rel=0.06
    )


@pytest.mark.parametrize("electrons", [1e-3, 1.0, 1e4, 1e9])
def test_flux_is_kept_until_something_clips(electrons):
    image = expected(view(DETECTOR, pixel=(31.37, 22.81), electrons=electrons))
    assert image.sum() == pytest.approx(electrons, rel=1e-6)


@pytest.mark.parametrize("corner", [(0, 0), (63, 0), (0, 47), (63, 47)])
def test_a_star_on_a_corner_leaves_a_quarter_outside(corner):
    """For a star on the outer corner of the corner pixel, a quarter of the light is inside."""
    outer = [c + math.copysign(0.5, c - 1) for c in corner]
    image = expected(view(DETECTOR, pixel=outer, electrons=1e5))
    assert image.sum() == pytest.approx(25_000, rel=1e-5)
    assert np.unravel_index(image.argmax(), image.shape) == (corner[1], corner[0])


@pytest.mark.parametrize("row", [0.0, 24.0, 47.0])
def test_a_saturated_star_blooms(row):
    """All charge stays on the array, except the charge that overflows its edge."""
    # A gain below one leaves room above the full well, so that the converter hides nothing.
    one = replace(DETECTOR, blooming=True, bits=16, gain=0.98)
    image = frame(one, pixel=(30.0, row), electrons=4e5)
    column = image[:, 30]
    full = round(20_000 / one.electrons_per_dn) + 100
    assert image.max() == full
    assert (column == full).sum() >= 4
    flux = (image.astype(float) - 100).sum() * one.electrons_per_dn
    clipped = frame(replace(one, blooming=False), pixel=(30.0, row), electrons=4e5)
    assert flux > 1.2 * (clipped.astype(float) - 100).sum() * one.electrons_per_dn
    if row == 24.0:
        assert flux == pytest.approx(4e5, abs=5 * math.sqrt(4e5))
    else:
        assert flux < 3e5


def test_frozen_and_hot():
    for kelvin, low, high in ((0.0, 0, 0), (400.0, 1000, 3000)):
        thermal = Thermal(kelvin, doubling=8.0)
        one = replace(DETECTOR, dark_current=1.0, thermal=thermal, bits=16)
        level = (frame(one).mean() - 100) * one.electrons_per_dn
        assert low <= level <= high


@pytest.mark.parametrize(
    ("bits", "kind"),
    [(1, np.uint16), (8, np.uint16), (16, np.uint16), (17, np.uint32), (24, np.uint32)],
)
def test_depths(bits, kind):
    """The mean of 3072 pixels within four standard errors, of which one is 1.9e-4."""
    one = replace(DETECTOR, bits=bits, offset=0, read_noise=3.0)
    image = frame(one, sky=9_000.0)
    assert image.dtype == kind
    wanted = 0.0 if bits == 1 else 9000 / 20_000 * (2**bits - 1)
    assert image.mean() == pytest.approx(wanted, rel=8e-4, abs=1e-3)


@pytest.mark.parametrize("exposure", [1e-6, 1000.0])
def test_exposures(exposure):
    one = replace(DETECTOR, exposure=exposure, dark_current=10.0, read_noise=2.0, bits=16)
    image = frame(one, electrons=3000.0)
    flux = (image.astype(float) - 100).sum() * one.electrons_per_dn
    wanted = 3000 + 10 * exposure * 64 * 48
    noise = math.sqrt(wanted + 4 * 64 * 48)
    assert flux == pytest.approx(wanted, abs=4 * noise)


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (16_384, 1), (1, 16_384)])
def test_shapes(columns, rows):
    everything = Detector(
        columns,
        rows,
        5e-6,
        0.1,
        offset=100,
        full_well=20_000.0,
        read_noise=5.0,
        prnu=0.01,
        dark_current=10.0,
        crosstalk=0.02,
        lag=0.01,
        blooming=True,
        nonlinearity=0.01,
        settling=0.01,
        adc_inl=1.0,
        hits=Hits(1e8),
        pattern=Pattern(1.0, 1.0, 1.0),
        thermal=Thermal(300.0),
        defects=Defects(1.0, 0.01, 100.0, 0.01, 1),
        read_noise_spread=0.3,
        em_gain=2.0,
    )
    for one in (replace(DETECTOR, columns=columns, rows=rows), everything):
        image = frame(one, pixel=(0.0, 0.0), electrons=5000.0, sky=10.0)
        assert image.shape == (rows, columns)
        assert image.max() <= 4095


def test_everything_at_once_repeats():
    everything = replace(
        DETECTOR,
        read_noise=5.0,
        prnu=0.01,
        crosstalk=0.02,
        lag=0.01,
        blooming=True,
        nonlinearity=0.01,
        settling=0.01,
        adc_inl=1.0,
        hits=Hits(1e9),
        pattern=Pattern(1.0, 1.0, 1.0),
        defects=Defects(1.0, 0.01, 100.0, 0.01, 1),
        read_noise_spread=0.3,
        em_gain=2.0,
    )
    light = {"electrons": 5000.0, "sky": 10.0}
    np.testing.assert_array_equal(frame(everything, 3, **light), frame(everything, 3, **light))
    assert (frame(everything, 3, **light) != frame(everything, 4, **light)).any()


def test_a_mean_map_with_everything_in_it():
    """One frame from no electrons to far beyond the full well, by tables and pixel by pixel."""
    mean = np.geomspace(1e-6, 1e7, 512 * 512).reshape(512, 512)
    one = Detector(512, 512, 5e-6, 0.1, full_well=50_000.0, bits=16, read_noise=3.0, offset=50)
    image = read_out(mean, one, Streams(1, 0)).astype(float)
    block = (image.reshape(64, 8, 512).mean(axis=(1, 2)) - 50) * one.electrons_per_dn
    wanted = np.minimum(mean, 50_000 - 50 * one.electrons_per_dn).reshape(64, 8, 512).mean((1, 2))
    error = np.sqrt((wanted + 9 + 1) / 4096)
    assert (np.abs(block - wanted) < 5 * error + 2e-3 * wanted).all()


def test_kernels_serve_arrays_of_any_layout_without_compiling_anew():
    """Arrays that are writable or not, with elements in either order."""
    streams, psf, device = Streams(1, 0), gaussian(), Detector(40, 40, 5e-6, 0.1)
    path = np.array([[10.0, 20.0, 30.0], [10.5, 20.5, 30.5]])
    known, images, numbers = [], [], []
    for place in (path, np.asfortranarray(path), path.repeat(2, 0)[::2]):
        for gain in (None, np.ones((40, 40)), read_only(np.ones((40, 40)))):
            images.append(np.full((40, 40), 50.0))
            stamp_paths(images[-1], psf, np.full(2, 0.5), place, place, np.ones((3, 1)), gain)
            for image in (images[-1], read_only(images[-1])):
                numbers.append(read_out(image, device, streams))
                known.append((len(_stamp.overloads), len(_digitise.overloads)))
    assert known[-1] == known[0]
    assert all((one == images[0]).all() for one in images)
    assert all((one == numbers[0]).all() for one in numbers)
