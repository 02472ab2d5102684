"""Lines, staggered lines, TDI and the rolling shutter over a slew."""

import math

import numpy as np
import pytest
from scipy import special
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.values import DiffuseLight, Light, LineOfSight, Psf
from startrack.detection import Detection, detect
from startrack.detector import Detector, Exposure, expected, scan, staggered, tdi
from startrack.detector.parameters import Line
from startrack.detector.scan import LineExposure, scanned

FOCAL = 4e5  # pixel, so long that a turn is a shift
PERIOD = 1e-3
SIGMA = 0.7
WAVELENGTH = np.array([600e-9])
THROUGHPUT = np.ones(1)
COUNT = 80


def gaussian(sigma: float = SIGMA) -> Psf:
    half = int(6 * sigma + 2) * 16 + 3
    x = np.arange(-half, half + 1) / 16
    line = special.ndtr((x + 0.5) / sigma) - special.ndtr((x - 0.5) / sigma)
    return Psf(np.outer(line, line), 16, 1.0)


def walking(pixels_per_line: float):
    """A camera that rotates about +x, so that stars move to larger rows."""

    def turn(time):
        return np.multiply.outer(time, [-pixels_per_line / PERIOD / FOCAL, 0.0, 0.0])

    return turn


def star_at(camera: Camera, x: float, y: float, rate: float) -> Light:
    direction = camera.unproject(np.array([[x, y]]))
    return Light(direction, WAVELENGTH, np.full((1, 1), rate), np.zeros(1))


def box(at, length, sigma=SIGMA):
    """A Gaussian convolved with a pixel and with a box of this length, at these distances."""

    def second(u):  # the second integral of a Gaussian
        return u * special.ndtr(u / sigma) + sigma / math.sqrt(2 * math.pi) * np.exp(
            -((u / sigma) ** 2) / 2
        )

    h, p = length / 2, 0.5
    return (second(at + p + h) - second(at + p - h) - second(at - p + h) + second(at - p - h)) / (
        length
    )


def lines_image(lines, pace=1.0, rate=1e6, x=20.3, y=None, **changes):
    rows = len(lines)
    camera = Camera(40, rows, FOCAL)
    y = camera.centre[1] if y is None else y
    one = Detector(40, rows, 5e-6, PERIOD, **changes)
    light = star_at(camera, x, y, rate)
    return scanned(exposure(light, pace, camera, lines, one))


def exposure(light, pace, camera, lines, detector, count=COUNT, psf=None):
    """Lines of a camera whose stars move by a number of pixels per line."""
    psf = psf or gaussian()
    attitude, turn = Rotation.identity(), walking(pace)
    return LineExposure(light, psf, attitude, turn, camera, lines, count, detector, THROUGHPUT)


def test_walking_goes_to_larger_rows():
    camera = Camera(40, 40, FOCAL)
    later = Rotation.from_rotvec(walking(1.0)(PERIOD)).apply(camera.unproject([[19.5, 19.5]]))
    np.testing.assert_allclose(camera.project(later), [[19.5, 20.5]], atol=1e-6)


def test_a_line_sees_a_star_walk_over_it():
    """Along time, the Gaussian through the pixel and the exposure; across, through the pixel.

    The star is at row 0 at time zero, between rows 39 and 40 of the image.
    """
    image = lines_image((Line(0.0),), y=0.0)
    across = box(np.arange(40) - 20.3, 1e-9)
    along = box(np.arange(COUNT) - (COUNT / 2 - 0.5), 1.0)
    np.testing.assert_allclose(image, 1e6 * PERIOD * np.outer(along, across), atol=2e-3)


@pytest.mark.parametrize("pace", [12.5, -12.5])
def test_a_star_that_passes_a_line_within_one_exposure_is_seen(pace):
    """At both ends of the exposure the image, cut off at 2.25 sigma, lies outside of the line.

    It is on the line for 1 / 12.5 of the exposure for each pixel; 2 Phi(2.25) - 1 = 0.976 of its
    light is inside the cut, where the image is not smooth, therefore 3 %.
    """
    x = np.arange(-80, 81) / 16
    line = special.ndtr((x + 0.5) / 2) - special.ndtr((x - 0.5) / 2)
    cut = Psf(np.outer(line, line), 16, 1.0)
    camera, one = Camera(40, 1, FOCAL), Detector(40, 1, 5e-6, PERIOD)
    # Six and a quarter pixels before the line where row 3 begins, which is at time zero.
    light = star_at(camera, 20.0, -pace / 2, 1e6)
    image = scanned(exposure(light, pace, camera, (Line(0.0),), one, 6, cut))
    assert image[3].sum() == pytest.approx(1e6 * PERIOD / 12.5 * 0.976**2, rel=0.03)
    assert (image[[0, 1, 2, 4, 5]] == 0).all()


@pytest.mark.parametrize("stages", [4, 32])
def test_tdi_in_step_adds_up(stages):
    """The light of all stages, and no more smear than a single line."""
    image = lines_image(tdi(stages))
    assert image.sum() == pytest.approx(stages * 1e6 * PERIOD, rel=1e-5)
    profile = image.sum(axis=1) / image.sum()
    row = np.arange(COUNT)
    # Stage s sees the star s - (stages - 1) / 2 exposures after time zero, in row
    # COUNT / 2 - (stages - 1) / 2 - 1 / 2 of the image, whichever s.
    np.testing.assert_allclose(profile, box(row - (COUNT - stages) / 2, 1.0), atol=2e-6)


@pytest.mark.parametrize("mismatch", [0.02, -0.05])
def test_a_tdi_out_of_step_smears(mismatch):
    """At each stage the star is a little farther from the charge: a sum of shifted profiles."""
    stages = 32
    image = lines_image(tdi(stages), pace=1 + mismatch)
    profile = image.sum(axis=1) / (1e6 * PERIOD)
    stage = np.arange(stages)
    # The star crosses stage s at this time, in exposures, and stays a pixel for 1 / pace of one.
    crossing = (stage - (stages - 1) / 2) / (1 + mismatch)
    middle = crossing + COUNT / 2 - stage - 0.5
    row = np.arange(COUNT)[:, None]
    sigma, pixel = SIGMA / (1 + mismatch), 1 / (1 + mismatch)
    # Time is the coordinate: the exposure is the unit, the pixel is `pixel` long.
    u = row - middle

    def second(v):
        return v * special.ndtr(v / sigma) + sigma / math.sqrt(2 * math.pi) * np.exp(
            -((v / sigma) ** 2) / 2
        )

    h, p = 0.5, pixel / 2
    wanted = (second(u + h + p) - second(u + h - p) - second(u - h + p) + second(u - h - p)).sum(1)
    np.testing.assert_allclose(profile, wanted, atol=3e-5)


def test_a_tdi_against_its_charge_sees_nothing_sharp():
    wrong = lines_image(tdi(16, row=15.0, downward=False))
    assert wrong.max() < 0.2 * lines_image(tdi(16)).max()


def test_staggered_lines_sample_twice_as_finely():
    """In the interleaved image, the star is at twice its column and a Gaussian twice as wide."""
    lines = staggered(4.0)
    image = lines_image(lines, y=2.0)
    assert image.shape == (COUNT, 80)
    profile = image.sum(axis=0)
    column = np.arange(80) / 2
    np.testing.assert_allclose(profile, 1e6 * PERIOD * box(column - 20.3, 1e-9), atol=1e-2)
    even, odd = (image[:, k::2].sum(axis=1) @ np.arange(COUNT) for k in (0, 1))
    totals = [image[:, k::2].sum() for k in (0, 1)]
    # Both lines have the star in the same row, as the second waits for it.
    assert even / totals[0] == pytest.approx(odd / totals[1], abs=1e-3)


def test_a_stages_gain_and_the_dark_current_count():
    image = lines_image((Line(0.0, gain=0.5), Line(0.0, gain=2.0)), rate=0.0, dark_current=1000.0)
    np.testing.assert_allclose(image, 2.5 * 1000 * PERIOD)


def test_each_line_sees_its_own_part_of_the_sky():
    """Radiance times solid angle times time of the row's diffuse light, plus dark current, times
    the gain."""
    lines = (Line(0.0, gain=0.5), Line(3.0, gain=2.0), Line(1.0, phase=1))
    camera = Camera(7, 3, 2000.0)
    one = Detector(7, 3, 5e-6, 2e-3, dark_current=30.0)
    diffuse = DiffuseLight(
        np.array([4e9]), np.array([[1.0, 1.0], [3.0, 3.0]])
    )  # 1, 2, 3 on the three rows
    light = Light(
        np.zeros((0, 3)), WAVELENGTH, np.zeros((0, 1)), np.array([6e9]), diffuse=(diffuse,)
    )
    image = scanned(exposure(light, 1.0, camera, lines, one, 4))
    first, second, third = (6e9 + 4e9 * np.array([1, 2, 3])) / 2000**2 * 2e-3 + 30 * 2e-3
    np.testing.assert_allclose(image[:, ::2], 0.5 * first + 2 * second, rtol=1e-12)
    np.testing.assert_allclose(image[:, 1::2], third, rtol=1e-12)


def test_the_pixels_of_a_line_keep_their_response():
    """The response varies by 5 % and is equal in all rows of the image; a TDI averages it over
    stages."""
    sky = Light(np.zeros((0, 3)), WAVELENGTH, np.zeros((0, 1)), np.array([1e12]))
    spread = {}
    for stages in (1, 16):
        camera, one = Camera(400, stages, 1e4), Detector(400, stages, 5e-6, PERIOD, prnu=0.05)
        image = scanned(exposure(sky, 1.0, camera, tdi(stages), one, 3))
        assert (image == image[0]).all()
        spread[stages] = image[0].std() / image[0].mean()
    # Of 400 pixels, the deviation is known to 3.5 %.
    assert spread[1] == pytest.approx(0.05, rel=0.14)
    assert spread[16] == pytest.approx(0.05 / 4, rel=0.14)


def test_a_tdi_star_is_detected_where_it_is():
    """Nineteen stars along one scan, each at its geometric place within the noise of its
    centroid."""
    stages = 16
    camera = Camera(600, stages, FOCAL)
    columns = np.arange(20, 590, 30) + np.linspace(0, 0.9, 19)
    rows = np.linspace(-20, 20, 19)
    direction = camera.unproject(np.column_stack([columns, camera.centre[1] - rows]))
    light = Light(direction, WAVELENGTH, np.full((19, 1), 4e5), np.zeros(1))
    one = Detector(600, stages, 5e-6, PERIOD, read_noise=5.0, offset=50, full_well=20_000.0)
    frame = scan(exposure(light, 1.0, camera, tdi(stages), one), Streams(1, 0))
    spots = detect(frame, Detection())
    assert len(spots) == 19
    order = np.argsort(spots.x)
    assert np.abs(spots.x[order] - columns).max() < 0.15
    wanted = (COUNT - stages) / 2 + rows
    assert np.abs(spots.y[order] - wanted).max() < 0.15


def test_a_scan_of_the_wrong_size_is_refused():
    camera = Camera(40, 3, FOCAL)
    light, detector = star_at(camera, 0, 0, 1.0), Detector(40, 2, 5e-6, PERIOD)
    wrong = exposure(light, 1.0, camera, tdi(3), detector, 10)
    with pytest.raises(ValueError, match="a row for each line, got 40 x 2 for 40 and 3"):
        scanned(wrong)


def test_a_rolling_shutter_shears_the_frame():
    """Stars that move along the rows are displaced in lower rows by rate times delay times rows."""
    camera = Camera(200, 100, FOCAL)
    pixel = np.array([[50.0, 10.0], [50.0, 49.5], [50.0, 90.0]])
    light = Light(camera.unproject(pixel), WAVELENGTH, np.full((3, 1), 1e5), np.zeros(1))
    rate = 2000.0  # pixel / second

    def motion_function(start, step):
        return np.multiply.outer(np.add.outer(start, step), [0.0, rate / FOCAL, 0.0])

    rest = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
    one = Detector(200, 100, 5e-6, 1e-3, row_delay=50e-6)
    level = Rotation.identity()
    image = expected(
        Exposure(light, gaussian(), rest, level, camera, one, THROUGHPUT, motion_function)
    )
    for row in (10, 49.5, 90):
        band = image[int(row) - 8 : int(row) + 9].sum(axis=0)
        x = band @ np.arange(200) / band.sum()
        assert x - 50 == pytest.approx(rate * 50e-6 * (row - 49.5), abs=0.01)


def test_a_rolling_shutter_must_know_the_motion():
    camera = Camera(20, 10, FOCAL)
    rest = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
    exposure = Exposure(
        star_at(camera, 5, 5, 1.0),
        gaussian(),
        rest,
        Rotation.identity(),
        camera,
        Detector(20, 10, 5e-6, 1e-3, row_delay=1e-6),
        THROUGHPUT,
    )
    with pytest.raises(TypeError, match="motion_function must be given"):
        expected(exposure)
