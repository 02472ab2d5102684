"""Printed results: each value with its unit, on one screen."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pytest
from astropy import units
from scipy.spatial.transform import Rotation

from startrack import Streams, load_design, observe, pointing, shipped
from startrack.core import Floats, Unit, arcsec, printed
from startrack.core.printing import text_of
from startrack.observation import light_of

DESIGN = load_design(shipped("designs/noise_only.toml"))
SCREEN = 1000  # characters


@printed
@dataclass(frozen=True)
class Measured:
    angle: Annotated[float, Unit("rad", "arcsec")]
    places: Annotated[Floats, Unit("m", "mm")]
    of: str = "<b>"
    _inside: int = 3


@printed
class Pair(NamedTuple):
    first: Measured | None
    count: int


def test_a_value_is_in_the_unit_of_its_field():
    one = Measured(2 * arcsec, np.array([0.001, 0.0025]))
    assert repr(one) == "Measured(angle: 2 arcsec, places: 1, 2.5 mm, of: <b>)"
    assert "&lt;b&gt;" in one._repr_html_()
    assert repr(Pair(None, 7)) == "Pair(first: none, count: 7)"
    assert "first: Measured(2 arcsec" not in repr(Pair(one, 7))  # it has an array


@pytest.mark.parametrize(
    "unit",
    [Unit("rad", "arcsec"), Unit("rad2", "arcsec2"), Unit("rad / s", "deg / s"), Unit("m2", "mm2")],
)
def test_the_numbers_are_those_of_another_program(unit):
    number, shown = text_of(0.123, unit).split(" ", 1)
    assert shown == unit.in_files
    expected = (0.123 * units.Unit(unit.si)).to_value(units.Unit(unit.in_files))
    assert float(number) == pytest.approx(expected, rel=1e-3)


def test_a_temperature_is_in_degrees_and_not_a_difference():
    assert text_of(293.15, Unit("K", "degC")) == "20 degC"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.zeros(0), "(0)"),
        (np.full(9, np.nan), "none known (9)"),
        (np.array([[np.nan, -1], [3, 2]]), "-1 to 3 (2 x 2)"),
        (np.array([True, False, True]), "2 true (3)"),
        (np.zeros(2, [("trial", int), ("error", float)]), "2 rows of trial, error"),
        (np.float32(0.5), "0.5"),
        (True, "True"),
        (np.array(["a", "b"]), "(2)"),
        ((), "none"),
        ((1, "a"), "1, a"),
        ((Pair(None, 1),) * 9, "9 of Pair"),
        ({"nees": 3.0}, "nees 3"),
        (Pair(None, 1), "Pair"),
        (Rotation.identity(), "z axis at 0.0000, +90.0000 deg"),
        (Rotation.identity(5), "5 rotations"),
        ("word " * 50, "word " * 15 + "w ..."),
    ],
)
def test_other_values(value, text):
    assert text_of(value) == text


def test_all_that_a_trial_makes_fits_one_screen():
    case = DESIGN.case
    record = observe(case, pointing(84, -1, 0), Streams(seed=1, trial=0))
    light = light_of(case, record.stars, record.icrs_to_camera, Streams(1, 0))
    parts = [
        case,
        record,
        light,
        *(one for one in vars(record).values() if one is not record.icrs_to_camera),
    ]
    for part in parts:
        assert len(repr(part)) < SCREEN
        assert "\n" not in repr(part)
    assert "icrs_to_camera: z axis at 84.0000, -1.0000 deg" in repr(record)
    assert "wavelength: 325 to 1095 nm" in repr(light)
    assert "arcsec2" in repr(record.estimate)
    assert repr(record.spots).count("pixel") == 3
