"""Frames behind a mosaic of colour filters, against levels by hand and designs with one filter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import special
from scipy.spatial.transform import Rotation

from startrack import Refused, Streams, load_design, nm, random_attitude, shipped
from startrack.budget import analytic
from startrack.core import Camera, Curve, Light, LineOfSight, Psf
from startrack.design import Fidelity
from startrack.detector import ColourMosaic, Detector, Exposure, RegionOfInterest, expected
from startrack.response import scale
from startrack.trial import observe, require_fidelity

WAVELENGTH = np.array([450e-9, 550e-9, 650e-9])
THROUGHPUT = np.array([1e-4, 2e-4, 3e-4])
PASS = np.array([[0.0, 0.1, 0.8], [0.1, 0.9, 0.1], [0.7, 0.2, 0.0]])  # of red, green, blue filters
CAMERA = Camera(32, 24, 1000.0)
CELL = np.array([[0, 1], [1, 2]])  # RGGB


def gaussian(sigma):
    x = np.arange(-16 * 12, 16 * 12 + 1) / 16
    line = special.ndtr((x + 0.5) / sigma) - special.ndtr((x - 0.5) / sigma)
    return Psf(np.outer(line, line), 16, 1.0)


def exposed(light, psf, mosaic=None, **changes):
    detector = Detector(
        columns=32,
        rows=24,
        pixel_pitch=5e-6,
        exposure=0.1,
        mosaic=mosaic or ColourMosaic(),
        **changes,
    )
    rest = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
    view = light, psf, rest, Rotation.identity(), CAMERA, detector, np.full(3, np.nan)
    return expected(Exposure(*view, of_colours=THROUGHPUT * PASS))


def sky(brightness):
    """Uniform light with the same number of photons in each bin; a pixel is 1e-6 steradian."""
    return Light(np.zeros((0, 3)), WAVELENGTH, np.zeros((0, 3)), np.full(3, brightness * 1e6))


def star(pixel, spectrum):
    direction = CAMERA.unproject(np.atleast_2d(pixel))
    return Light(direction, WAVELENGTH, np.atleast_2d(spectrum) * 1.0, np.zeros(3))


@pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_each_pixel_has_the_light_of_its_colour(pattern):
    """0.1 s of 1000 photons: red 0.1 (0.2 + 2.4), green (0.1 + 1.8 + 0.3), blue (0.7 + 0.4)."""
    image = exposed(sky(1e6), gaussian(1.0), ColourMosaic(pattern))
    level = {"R": 26.0, "G": 22.0, "B": 11.0}
    cell = np.array([level[colour] for colour in pattern]).reshape(2, 2)
    np.testing.assert_allclose(image, np.tile(cell, (12, 16)), rtol=1e-12)


def test_the_pattern_is_that_of_the_array_and_not_of_the_part_that_is_read():
    whole = exposed(sky(1e6), gaussian(1.0))
    part = exposed(sky(1e6), gaussian(1.0), region=RegionOfInterest(3, 5, 64, 64))
    np.testing.assert_array_equal(part[1:, 1:], whole[:-1, :-1])
    assert part[0, 0] == whole[1, 1]


def test_a_red_star_leaves_no_light_in_pixels_that_pass_none():
    image = exposed(star([16.0, 12.0], [0.0, 0.0, 1e8]), gaussian(2.0))
    colour = np.tile(CELL, (12, 16))
    assert image[colour == 2].max() == 0
    assert image[colour == 0].sum() == pytest.approx(8 * image[colour == 1].sum() / 2, rel=1e-3)


def test_the_light_of_a_star_is_the_mean_of_the_filters_over_its_places():
    """Sharp stars at all places in a cell of 2 x 2 pixels; a single star may have much more or
    less."""
    places = np.arange(8) / 4 + 10
    spectrum = np.array([1e7, 2e7, 3e7])
    total = [exposed(star([x, y], spectrum), gaussian(0.4)).sum() for x in places for y in places]
    mean = (PASS[0] + 2 * PASS[1] + PASS[2]) / 4
    assert np.mean(total) == pytest.approx(0.1 * THROUGHPUT * mean @ spectrum, rel=1e-3)
    assert np.ptp(total) > 0.3 * np.mean(total)


FILTERS = {
    "red": Curve((580 * nm, 600 * nm, 700 * nm, 1000 * nm), (0.0, 0.9, 0.9, 0.8)),
    "green": Curve((480 * nm, 520 * nm, 560 * nm, 610 * nm), (0.0, 0.9, 0.9, 0.0)),
    "blue": Curve((390 * nm, 420 * nm, 480 * nm, 520 * nm), (0.0, 0.8, 0.8, 0.0)),
}


@pytest.fixture(scope="module")
def case():
    case = load_design(shipped("designs/noise_only.toml")).case
    optics = replace(case.instrument.optics, transmission=Curve())
    return replace(case, instrument=replace(case.instrument, optics=optics))


def behind(case, mosaic=None, transmission=None):
    instrument = case.instrument
    if transmission:
        optics = replace(instrument.optics, transmission=transmission)
        return replace(case, instrument=replace(instrument, optics=optics))
    detector = replace(instrument.detector, mosaic=mosaic)
    return replace(case, instrument=replace(instrument, detector=detector))


def test_formulas_have_the_mean_of_designs_with_one_filter_each(case):
    found = scale(behind(case, ColourMosaic(**FILTERS)))
    alone = {name: scale(behind(case, transmission=curve)) for name, curve in FILTERS.items()}
    weights = {"red": 0.25, "green": 0.5, "blue": 0.25}
    for name in ("star", "background"):
        mean = sum(weights[colour] * getattr(alone[colour], name) for colour in FILTERS)
        assert getattr(found, name) == pytest.approx(mean, rel=1e-9), name


def test_a_frame_has_the_numbers_of_frames_behind_each_filter(case):
    """Pixel by pixel, the expected electrons equal those of a camera whose lens has the filter."""
    attitude = random_attitude(Streams(1, 0))
    image = observe(behind(case, ColourMosaic(**FILTERS)), attitude, Streams(1, 0)).frame.image
    colour = np.tile(CELL, (image.shape[0] // 2, image.shape[1] // 2))
    step = case.instrument.detector.electrons_per_dn
    for number, curve in enumerate(FILTERS.values()):
        alone = observe(behind(case, transmission=curve), attitude, Streams(1, 0)).frame.image
        some = colour == number
        off = (image.astype(float) - alone)[some]
        noise = np.sqrt(np.maximum(alone[some], 1) / step + (8 / step) ** 2)
        assert abs(off.mean()) < 5 * noise.std() / np.sqrt(some.sum()) + 0.05
        assert np.percentile(np.abs(off), 99) < 6 * noise.mean()


def test_what_cannot_have_it_says_so(case):
    coloured = behind(case, ColourMosaic(**FILTERS))
    require_fidelity(coloured, Fidelity.FRAME)
    for fidelity in (Fidelity.WINDOW, Fidelity.SPOTS, Fidelity.COVARIANCE):
        with pytest.raises(Refused, match="mosaic"):
            require_fidelity(coloured, fidelity)
    assert any("mosaic" in one for one in analytic(coloured).left_out)
    for changes in ({"crosstalk": 0.01}, {"binning": 2}):
        with pytest.raises(Refused, match="if mosaic is given"):
            replace(coloured.instrument.detector, **changes)


def test_a_light_without_colours_of_its_pixels_is_refused():
    detector = Detector(columns=32, rows=24, pixel_pitch=5e-6, exposure=0.1, mosaic=ColourMosaic())
    rest = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
    view = sky(1.0), gaussian(1.0), rest, Rotation.identity(), CAMERA, detector, THROUGHPUT
    with pytest.raises(TypeError, match="of_colours"):
        expected(Exposure(*view))
