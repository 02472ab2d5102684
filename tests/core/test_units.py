import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from startrack.core import Refused
from startrack.core.units import SCALES, fraction, parse, utc_text, write


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("50 mm", "m", 0.05),
        ("1e3um", "m", 1e-3),
        (" -2.5 deg ", "rad", math.radians(-2.5)),
        ("60 electron / s", "electron / s", 60.0),
        ("60 e-/s", "electron / s", 60.0),
        ("8e-", "electron", 8.0),
        ("5e3 e-", "electron", 5000.0),
        ("20 ke-", "electron", 20000.0),
        ("5 e- rms", "electron", 5.0),
        ("3 electrons", "electron", 3.0),
        ("0.5 e-/px/s", "electron / s", 0.5),
        ("3 krad(Si)", "Gy", 30.0),
        ("3 krad / yr", "Gy / s", 30.0 / 31557600.0),
        ("2 krad", "rad", 2000.0),
        ("3 arcmin", "rad", math.radians(0.05)),
        ("10°", "rad", math.radians(10.0)),
        ("1 arcsec", "rad", math.pi / 648000),
        ("40 Mpix / s", "pix / s", 40e6),
        ("2 in", "m", 0.0508),
        ("6 ft", "m", 1.8288),
        ("5 microns", "m", 5e-6),
        ("100 msec", "s", 0.1),
        ("1 rpm", "rad / s", math.pi / 30),
    ],
)
def test_a_quantity_becomes_si(text, unit, value):
    assert parse(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "value"), [("35 %", 0.35), ("0.1%", 0.001), ("-7 %", -0.07), ("1e2 %", 1.0)]
)
def test_a_percentage_is_a_fraction(text, value):
    assert fraction(text) == value


@pytest.mark.parametrize("text", ["35", "%", "35 %%", "1 mm", "1e999 %"])
def test_no_other_text_is_a_percentage(text):
    assert fraction(text) is None


@pytest.mark.parametrize(
    ("text", "second"),
    [("10:30", 37800.0), ("0:00", 0.0), ("22:15:07.5", 80107.5), ("2 h", 7200.0)],
)
def test_a_time_of_day_is_read_where_it_is_one(text, second):
    assert parse(text, "s", clock=True) == second


@pytest.mark.parametrize("text", ["10:60", "10:3", "10:30:60", "-1:00"])
def test_what_is_no_time_of_day_is_refused(text):
    with pytest.raises(ValueError, match="must be a number with a unit"):
        parse(text, "s", clock=True)
    with pytest.raises(ValueError, match="must be a number with a unit"):
        parse("10:30", "s")  # a duration: minutes or hours?


@pytest.mark.parametrize("text", ["50 kg", "50 parsnips", "50 mm/s", "50 m/px"])
def test_a_wrong_unit_is_refused(text):
    with pytest.raises(ValueError, match=r"must have a unit that converts to m, got"):
        parse(text, "m")


@pytest.mark.parametrize(
    ("text", "unit", "meant", "plain"),
    [
        ("50 Mm", "m", "50 mm", "50000000.0 m"),
        ("80 Ms", "s", "80 ms", "80000000.0 s"),
        ("1.5 MW", "W", "1.5 mW", "1500000.0 W"),
        ("2 Pm", "m", "2 pm", "2000000000000000.0 m"),
        ("3 Mrad / s", "rad/s", "3 mrad / s", "3000000.0 rad/s"),
        ("100 mbit / s", "bit / s", "100 Mbit / s", "0.1 bit / s"),
        ("40 mpix / s", "pix / s", "40 Mpix / s", "0.04 pix / s"),
    ],
)
def test_a_slip_of_capitals_is_asked_about(text, unit, meant, plain):
    """A value 10^9 times too large: the message guesses the unit and gives a valid spelling."""
    with pytest.raises(Refused, match="must not look like a slip of capitals") as refusal:
        parse(text, unit)
    assert f"did you mean '{meant}'" in str(refusal.value)
    assert f"write '{plain}'" in str(refusal.value)
    assert parse(plain, unit) == float(plain.partition(" ")[0])


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("20 MHz", "Hz", 2e7),
        ("10 mHz", "Hz", 1e-2),  # of a flexible structure
        ("3 Mrad", "Gy", 3e4),
        ("0 Mm", "m", 0.0),
        ("2 km", "m", 2000.0),
        ("1 mrad/s", "rad/s", 1e-3),
        ("5 mmag", "mag", 5e-3),
        ("7 ms", "s", 7e-3),
    ],
)
def test_prefixes_that_are_meant_are_read(text, unit, value):
    assert parse(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["mm", "50", "", "1,5 mm", "nan mm", "inf mm", "1 2 mm "])
def test_what_is_no_number_with_a_unit_is_refused(text):
    with pytest.raises(ValueError, match="must"):
        parse(text, "m")


@given(
    st.floats(allow_nan=False, allow_infinity=False, min_value=-1e200, max_value=1e200),
    st.sampled_from([("m", "um"), ("rad", "deg"), ("s", "ms"), ("rad/s", "deg/s")]),
)
def test_what_is_written_reads_back_to_the_last_bit(value, units):
    assert parse(write(value, *units), units[0]) == value


def test_factors_of_common_units_are_those_of_astropy():
    from astropy import units

    for (source, target), scale in SCALES.items():
        assert scale == float(units.Unit(source).to(units.Unit(target))), (source, target)


@pytest.mark.parametrize(
    ("value", "text"),
    [(5.5e-6, "5.5 um"), (0.0, "0 um"), (1.0, "1000000 um"), (1e-12, "0.000001 um")],
)
def test_what_is_written_is_short(value, text):
    assert write(value, "m", "um") == text


def test_a_moment_of_a_mission_is_a_time_of_utc_with_its_leap_seconds():
    """With the leap second at the end of 2016, 86,400 SI seconds end a second before a UTC day."""
    assert utc_text("2026-03-20T12:00:00", 86400 + 61.4) == "2026-03-21T12:01:01"
    assert utc_text("2016-12-31T12:00:00", 86400) == "2017-01-01T11:59:59"
