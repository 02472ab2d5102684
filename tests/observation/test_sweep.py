"""Lines, staggered lines and TDI as designs: rendered over a slew, detected, judged."""

import dataclasses

import numpy as np
import pytest

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.values import Spots
from startrack.design.files import Design, load_design, save_design
from startrack.detector import Detector, Line, Scan
from startrack.io import shipped
from startrack.motion import Motion
from startrack.observation.exposure import out_of_step, straighten
from startrack.observation.pointing import random_attitude
from startrack.trial.chain import observe, run_random_trial
from startrack.verification.accuracy import limiting_magnitude

CASE = load_design(shipped("designs/scanner.toml")).case
ARCSEC = 206264.8


def with_scan(scan: Scan, exposure: float, f_number: float = 2.0, sign: float = 1.0):
    """The design with other lines, at the rate that matches them."""
    instrument = CASE.instrument
    rate = sign / (exposure * instrument.camera.focal_length_px)
    return dataclasses.replace(
        CASE,
        instrument=dataclasses.replace(
            instrument,
            optics=dataclasses.replace(instrument.optics, f_number=f_number),
            detector=dataclasses.replace(instrument.detector, scan=scan, exposure=exposure),
            motion=Motion(rate_x=rate),
        ),
    )


def with_rate(case, true: float = 1.0, believed: float | None = None):
    """The design with rates changed by factors."""
    motion = case.instrument.motion
    instrument = dataclasses.replace(case.instrument, motion=Motion(rate_x=motion.rate_x * true))
    belief = None if believed is None else Motion(rate_x=motion.rate_x * believed)
    tracker = dataclasses.replace(case.tracker, motion=belief)
    return dataclasses.replace(case, instrument=instrument, tracker=tracker)


KINDS = {
    "tdi": with_scan(Scan("tdi", stages=16), 5e-3),
    "tdi upward": with_scan(Scan("tdi", stages=16, upward=True), 5e-3, sign=-1.0),
    "line": with_scan(Scan(), 30e-3, 1.6),
    "staggered": with_scan(Scan("staggered"), 30e-3, 1.6),
    "two lines": with_scan(Scan("lines", lines=(Line(-3.0), Line(3.0, delay=6.0))), 30e-3, 1.6),
}


@pytest.mark.parametrize("kind", KINDS)
def test_an_image_made_line_by_line_has_its_attitude(kind):
    """The error is as large as stated: the mean of 2 x 3 squares lies in 99.9 % of chi-square's
    range, and none is 5 sigma off."""
    outcomes = [run_random_trial(KINDS[kind], 4, number) for number in range(2)]
    assert all(one.solved and not one.false for one in outcomes)
    normal = np.array(
        [
            (one.error_x / one.sigma_x, one.error_y / one.sigma_y, one.error_z / one.sigma_z)
            for one in outcomes
        ]
    )
    assert np.abs(normal).max() < 5
    assert (normal**2).sum() < 22.5  # six degrees of freedom
    for one in outcomes:
        assert np.hypot(one.error_x, one.error_y) * ARCSEC < 5


def test_stages_add_light():
    """Sixteen stages detect as many stars as one line sixteen times as long, which smears the
    sky."""
    one, many = (
        observe(
            with_scan(Scan("tdi", stages=n), 5e-3), random_attitude(Streams(4, 1)), Streams(4, 1)
        )
        for n in (1, 16)
    )
    assert len(many.spots) > 3 * max(len(one.spots), 1)


def test_charge_out_of_step_smears_along_the_scan():
    """At a pace of 1.2 pixel a line, 16 stages see a star 16 (1 - 1 / 1.2) lines apart.

    Time is the coordinate along the scan, so that the star itself is narrower by the pace. Measured
    on the three brightest isolated stars, without read noise, which would change the variance of
    faint ones by more than the tolerance.
    """
    detector = dataclasses.replace(CASE.instrument.detector, read_noise=0.0, bits=16)
    instrument = dataclasses.replace(CASE.instrument, detector=detector)
    quiet = dataclasses.replace(CASE, instrument=instrument)
    attitude, pace = random_attitude(Streams(4, 1)), 1.2
    variance = []
    for factor in (1.0, pace):
        record = observe(with_rate(quiet, factor), attitude, Streams(4, 1))
        image, spots = record.frame.image.astype(float), detected(record)
        assert len(spots) >= 3
        variance.append(np.mean([spread(image, x, y) for x, y in spots[:3]], axis=0))
    (along, across), (smeared, still) = variance
    wanted = across * (pace**-2 - 1) + (16 * (1 - 1 / pace)) ** 2 / 12
    assert smeared - along == pytest.approx(wanted, rel=0.15)
    assert still == pytest.approx(across, abs=0.05)


def detected(record):
    """Places of spots on the image of the lines, brightest first, excluding its edge."""
    from startrack.detection import detect

    spots = detect(record.frame, CASE.tracker.detection)
    place = np.column_stack([spots.x, spots.y])
    rows, columns = record.frame.image.shape
    inside = (place > 8).all(axis=1) & (place[:, 0] < columns - 8) & (place[:, 1] < rows - 8)
    alone = [np.sort(np.hypot(*(place - one).T))[1] > 20 for one in place]
    return place[inside & np.array(alone)]


def spread(image, x, y):
    """Variance along (rows) and across, pixel^2, without background, of the pixels near a spot."""
    column, row = round(float(x)), round(float(y))
    patch = image[row - 5 : row + 6, column - 5 : column + 6]
    patch = patch - np.median(image)
    patch[patch < 0.02 * patch.max()] = 0.0
    step = np.arange(-5, 6)
    down, over = patch.sum(axis=1) / patch.sum(), patch.sum(axis=0) / patch.sum()
    return np.array([down @ step**2 - (down @ step) ** 2, over @ step**2 - (over @ step) ** 2])


def test_a_wrong_rate_turns_into_a_stretched_sky():
    """If the believed rate is 2 % too high, a spot half an image away moves by 5 pixel.

    The first lines saw the ground ahead, so that the image is upside down relative to a matrix.
    """
    scan, camera, exposure = Scan(), Camera(512, 512, 3182.0), 5e-3
    rate = 1 / (exposure * camera.focal_length_px)
    spots = Spots(
        np.array([255.5, 255.5]),
        np.array([0.0, 511.0]),
        np.ones(2),
        np.tile(np.eye(2), (2, 1, 1)),
        np.ones(2),
        np.ones(2, np.int64),
    )
    right, fast = (
        straighten(spots, scan, exposure, Motion(rate_x=rate * factor), camera).y
        for factor in (1.0, 1.02)
    )
    np.testing.assert_allclose(fast - right, [5.1, -5.1], atol=0.1)
    # The scan is even in angle, a matrix in its tangent: half a pixel apart at 4.6 degrees.
    angle = 255.5 / 3182.0
    np.testing.assert_allclose(right - 255.5, np.tan([angle, -angle]) * 3182.0, rtol=1e-9)


def test_staggered_spots_come_back_to_the_lines_pixels():
    scan, camera = Scan("staggered", distance=4.0), Camera(512, 512, 3182.0)
    covariance = np.tile(np.eye(2), (1, 1, 1))
    spots = Spots(
        np.array([301.0]),
        np.array([255.5]),
        np.ones(1),
        covariance,
        np.ones(1),
        np.ones(1, np.int64),
    )
    still = straighten(spots, scan, 1e-3, Motion(), camera)
    assert (still.x[0], still.y[0]) == pytest.approx((150.5, 255.5))
    np.testing.assert_allclose(still.covariance[0], [[0.25, 0.0], [0.0, 1.0]])


def test_a_scanning_design_survives_a_file(tmp_path):
    for kind in ("tdi upward", "two lines"):
        save_design(tmp_path / "copy.toml", Design(KINDS[kind]))
        assert load_design(tmp_path / "copy.toml").case == KINDS[kind]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scan": Scan(), "lag": 0.1}, "lag must be left out for a detector that scans"),
        (
            {"scan": Scan(), "row_delay": 1e-6},
            "row_delay must be left out for a detector that scans",
        ),
        (
            {"scan": Scan("staggered"), "pixel_rate": 1.5e5},
            "must read 200 pixel within an exposure",
        ),
    ],
)
def test_what_lines_cannot_do_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        Detector(100, 50, 1e-5, 1e-3, **changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "tdl"}, "kind must be one of line, staggered, tdi, lines, got 'tdl'"),
        ({"kind": "lines"}, "lines must be given only for the kind 'lines'"),
        ({"kind": "line", "stages": 3}, "stages must be 1 for the kind 'line', got 3"),
    ],
)
def test_lines_that_contradict_themselves_are_refused(changes, words):
    with pytest.raises(ValueError) as error:
        Scan(**changes)
    assert words in str(error.value)


def test_a_fits_file_of_lines_claims_no_matrix(tmp_path):
    """Its rows are times, which a gnomonic projection cannot describe."""
    from astropy.io import fits

    from startrack.cli.main import main

    path = str(shipped("designs/scanner.toml"))
    assert main(["simulate", path, "--out", str(tmp_path), "--json"]) == 0
    with fits.open(tmp_path / "frame.fits") as file:
        assert len(file) == 1
        assert "CTYPE1" not in file[0].header
        assert file[0].data.shape == (512, 512)


def test_stages_count_in_what_a_design_is_said_to_see():
    """Sixteen stages collect 16 times the light: with little sky, up to 3 magnitudes more."""
    one, many = (limiting_magnitude(with_scan(Scan("tdi", stages=n), 5e-3)) for n in (1, 16))
    assert 2.0 < many - one < 3.02


def test_a_slew_that_does_not_fit_the_lines_is_named():
    """At half of the rate a star moves half a pixel a line: 15 stages lag by 7.5."""
    assert out_of_step(CASE.instrument) == ""
    rate = CASE.instrument.motion.rate_x
    upward = dataclasses.replace(CASE.instrument.detector, scan=Scan("tdi", stages=16, upward=True))
    for detector, sign in ((CASE.instrument.detector, 1), (upward, -1)):
        motion = dataclasses.replace(CASE.instrument.motion, rate_x=sign * rate / 2)
        words = out_of_step(dataclasses.replace(CASE.instrument, detector=detector, motion=motion))
        assert "-7.5 pixel ahead of the charge over 16 stages" in words
        assert f"rate_x = {sign * 3.6014:.5g} deg / s, or lines of 10 ms" in words
    line = dataclasses.replace(CASE.instrument.detector, scan=Scan("line"))
    assert out_of_step(dataclasses.replace(CASE.instrument, detector=line)) == ""
