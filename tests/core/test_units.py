import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from startrack.core.units import parse, write


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
        ("1 arcsec", "rad", math.pi / 648000),
        ("40 Mpix / s", "pix / s", 40e6),
    ],
)
def test_a_quantity_becomes_si(text, unit, value):
    assert parse(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("text", ["50 kg", "50 parsnips", "50 mm/s"])
def test_a_wrong_unit_is_refused(text):
    with pytest.raises(ValueError, match=r"must have a unit that converts to m, got"):
        parse(text, "m")


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


@pytest.mark.parametrize(
    ("value", "text"),
    [(5.5e-6, "5.5 um"), (0.0, "0 um"), (1.0, "1000000 um"), (1e-12, "0.000001 um")],
)
def test_what_is_written_is_short(value, text):
    assert write(value, "m", "um") == text
