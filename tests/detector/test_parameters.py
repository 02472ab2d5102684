"""Limits of each parameter, and values derived from the parameters."""

import math
from dataclasses import replace

import pytest

from startrack.detector import Defects, Detector, Pattern, RegionOfInterest, Scan, Thermal

DETECTOR = Detector(300, 200, 5e-6, 0.1, full_well=30_000.0, bits=12)
BEYOND = 1e-9


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("fill_factor", 0.01, 1.0),
        ("prnu", 0.0, 0.5),
        ("crosstalk", 0.0, 0.25),
        ("lag", 0.0, 0.99),
        ("settling", 0.0, 0.99),
        ("em_gain", 1.0, 1e5),
        ("nonlinearity", -0.49, 0.49),
        ("read_noise_spread", 0.0, 2.0),
    ],
)
def test_a_share_may_be_at_the_end_of_its_range_and_not_beyond(name, low, high):
    for end, outwards in ((low, -1), (high, 1)):
        assert getattr(replace(DETECTOR, **{name: end}), name) == end
        with pytest.raises(ValueError, match=name):
            replace(DETECTOR, **{name: end + outwards * max(1, abs(end)) * BEYOND})


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("columns", 1, 2**16),
        ("rows", 1, 2**16),
        ("bits", 1, 24),
        ("offset", 0, 2**12 - 2),
        ("binning", 1, 64),
        ("device_seed", 0, 2**63 - 1),
    ],
)
def test_so_may_a_number(name, low, high):
    for end, outwards in ((low, -1), (high, 1)):
        assert getattr(replace(DETECTOR, **{name: end}), name) == end
        with pytest.raises(ValueError, match=name):
            replace(DETECTOR, **{name: end + outwards})


@pytest.mark.parametrize("name", ["pixel_pitch", "exposure", "full_well", "pixel_rate", "gain"])
def test_what_is_divided_by_is_not_zero(name):
    with pytest.raises(ValueError, match=name):
        replace(DETECTOR, **{name: 0.0})


@pytest.mark.parametrize("name", ["dark_current", "read_noise", "row_delay", "diffusion"])
def test_what_there_is_none_of_is_zero_and_not_less(name):
    assert getattr(replace(DETECTOR, **{name: 0.0}), name) == 0
    with pytest.raises(ValueError, match=name):
        replace(DETECTOR, **{name: -BEYOND})


def test_a_bow_stays_under_a_quarter_of_the_range():
    assert replace(DETECTOR, adc_inl=-4095 / 4 + 0.01).adc_inl < -1023
    with pytest.raises(ValueError, match=r"a quarter of the converter's range, got 1023\.75"):
        replace(DETECTOR, adc_inl=4095 / 4)


def test_a_region_ends_with_its_array():
    fits = replace(
        DETECTOR, columns=100, rows=50, binning=2, region=RegionOfInterest(40, 30, 240, 130)
    )
    # The image's centre, 49.5 and 24.5, is the array's pixel 139.5 and 79.5 of 119.5 and 64.5.
    assert fits.shift == (-10.0, -7.5)
    for region, name in (
        (RegionOfInterest(41, 30, 240, 130), "columns"),
        (RegionOfInterest(40, 31, 240, 130), "rows"),
    ):
        with pytest.raises(ValueError, match=f"array's .* {name}"):
            replace(fits, region=region)


def test_a_second_pitch_is_that_of_square_pixels_or_refused_with_those_that_come_closest():
    """Pixels of 5 um x 3.2 um have the area of 4 um x 4 um; 375 x 160 of these have the same
    field."""
    assert replace(DETECTOR, pixel_pitch_y=5e-6).pitch == 5e-6
    with pytest.raises(
        ValueError,
        match=r"pixel_pitch_y must be pixel_pitch, 5 um, .* got 3\.2 um; 375 columns and 160 rows "
        "of 4 um",
    ):
        replace(DETECTOR, pixel_pitch_y=3.2e-6)


def test_rates_of_a_matrix():
    """Exposure, then read-out: 0.1 s and 60,000 pixel at 1.2 million a second."""
    one = replace(DETECTOR, pixel_rate=1.2e6)
    assert one.update_rate == pytest.approx(1 / 0.15)
    assert one.data_rate == pytest.approx(60_000 * 12 / 0.15)
    assert one.integration == 0.1
    # Read while the next frame is exposed: at most ten a second.
    assert replace(one, frame_rate=4.0).data_rate == pytest.approx(60_000 * 12 * 4)
    with pytest.raises(ValueError, match=r"frame_rate must be at most 10 Hz, .* got 10\.5 Hz"):
        replace(one, frame_rate=10.5)
    with pytest.raises(ValueError, match=r"at most 5 Hz, .* read-out of 200 ms"):
        replace(one, pixel_rate=3e5, frame_rate=6.0)


def test_rates_of_lines():
    """16 stages of 1 ms each see a star 16 ms; the image's 200 lines take 0.2 s."""
    one = replace(DETECTOR, exposure=1e-3, scan=Scan("tdi", 16))
    assert one.update_rate == pytest.approx(5)
    assert one.integration == pytest.approx(16e-3)
    staggered = replace(DETECTOR, exposure=1e-3, scan=Scan("staggered"))
    assert staggered.integration == pytest.approx(1e-3)
    just = replace(staggered, pixel_rate=600 / 1e-3)
    with pytest.raises(ValueError, match="pixel_rate must read 600 pixel"):
        replace(just, pixel_rate=599 / 1e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("row_delay", 1e-6),
        ("region", RegionOfInterest(0, 0, 300, 200)),
        ("lag", 0.1),
        ("read_noise_spread", 0.1),
    ],
)
def test_lines_are_without_what_a_matrix_has(name, value):
    with pytest.raises(ValueError, match=f"{name} must be left out for a detector that scans"):
        replace(DETECTOR, exposure=1e-2, scan=Scan(), **{name: value})


def test_noise_adds_in_squares_and_is_seen_before_the_register():
    """20 fF at 300 K have 56.8 electrons; the rms of a log-normal spread is the exponential of
    its squared sigma."""
    one = replace(
        DETECTOR,
        read_noise=30.0,
        read_noise_spread=0.5,
        em_gain=10.0,
        pattern=Pattern(4.0, 3.0, 9.0),
        thermal=Thermal(300.0, capacitance=20e-15),
    )
    wanted = math.sqrt((30 * math.exp(0.25)) ** 2 + 4**2 + 3**2 + 56.81**2) / 10
    assert one.noise == pytest.approx(wanted, rel=1e-4)
    assert one.electrons_per_dn == pytest.approx(30_000 / 4095 / 10)


def test_defects_end_where_all_pixels_are_taken():
    assert Defects(hot=1.0, dead=1.0, dead_columns=2**16).hot == 1
    for wrong in (
        {"hot": 1 + BEYOND},
        {"dead": -BEYOND},
        {"dead_columns": 2**16 + 1},
        {"dsnu": -1.0},
    ):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            Defects(**wrong)


def test_a_region_is_as_large_as_an_array_may_be():
    assert RegionOfInterest(0, 0, 2**16, 2**16).array_rows == 2**16
    beyond = 2**16 + 1
    for wrong in (
        *((-1, 0, 9, 9), (0, -1, 9, 9), (beyond, 0, 9, 9), (0, beyond, 9, 9)),
        *((0, 0, beyond, 9), (0, 0, 9, beyond), (0, 0, 0, 9), (0, 0, 9, 0)),
    ):
        with pytest.raises(ValueError, match="must"):
            RegionOfInterest(*wrong)


@pytest.mark.parametrize("name", ["row", "column", "column_offset"])
def test_patterns_have_no_negative_rms(name):
    with pytest.raises(ValueError, match=name):
        Pattern(**{name: -1.0})
