"""Values of a case by name, one or several at once; keys of earlier design files."""

import dataclasses
import warnings

import numpy as np
import pytest

from startrack.design import Choice, DesignSpace, Link, Variable, branches, replaced, replaced_all
from startrack.design.files import load_design
from startrack.design.parameter import find
from startrack.detector.parameters import RegionOfInterest
from startrack.io import shipped

CASE = load_design(shipped("designs/noise_only.toml")).case
DETECTOR = "instrument.detector"
SATURATED = replaced(CASE, "tracker.detection.saturation", 16_000.0)  # above 12 bits
REGION = replaced(CASE, f"{DETECTOR}.region", RegionOfInterest(256, 256, 1024, 1024))


@pytest.mark.parametrize(
    ("case", "values"),
    [
        (REGION, {"columns": 1024, "region.left": 0}),
        (REGION, {"columns": 2000, "rows": 1024, "region": RegionOfInterest(24, 0, 2048, 1024)}),
        (CASE, {"adc_inl": 4000.0, "bits": 16}),
        (SATURATED, {"offset": 5000, "bits": 14, "full_well": 30e3}),
    ],
)
def test_what_is_valid_together_can_be_given_together(case, values):
    """In either order, although the first value alone would be refused."""
    named = {f"{DETECTOR}.{name}": value for name, value in values.items()}
    first = next(iter(named))
    with pytest.raises(ValueError):
        replaced(case, first, named[first])
    changed = replaced_all(case, named)
    assert changed == replaced_all(case, dict(reversed(named.items())))
    for name, value in named.items():
        assert find(changed, name) == value
    assert changed.instrument.optics == case.instrument.optics


def test_one_value_at_a_time_is_the_same_where_each_is_valid():
    values = {
        "instrument.optics.focal_length": 0.04,
        "instrument.detector.columns": 400.4,
        "tracker.detection.threshold": 5.0,
    }
    case = CASE
    for name, value in values.items():
        case = replaced(case, name, value)
    assert replaced_all(CASE, values) == case
    assert case.instrument.detector.columns == 400
    assert replaced_all(CASE, {}) == CASE


def test_the_case_is_computed_anew():
    """Values that a part had computed and cached from its old values are computed again."""
    assert CASE.instrument.camera.columns == 512
    assert replaced(CASE, f"{DETECTOR}.columns", 300).instrument.camera.columns == 300


def test_a_whole_number_for_a_float_leaves_it_one():
    case = load_design(shipped("designs/noise_only.toml")).case
    detector = dataclasses.replace(case.instrument.detector, read_noise=3)
    instrument = dataclasses.replace(case.instrument, detector=detector)
    case = dataclasses.replace(case, instrument=instrument)
    changed = replaced(case, "instrument.detector.read_noise", 2.6)
    assert changed.instrument.detector.read_noise == 2.6
    assert replaced(case, "tracker.detection.max_spots", 7.6).tracker.detection.max_spots == 8


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"bits": 8, "exposure": -1.0}, f"{DETECTOR}.bits, {DETECTOR}.exposure: exposure must be"),
        ({"bits": 40}, f"{DETECTOR}.bits: bits must be a whole number"),
        ({"bitz": 8}, f"{DETECTOR}.bitz must be a parameter of the design, but bitz is none"),
    ],
)
def test_what_is_refused_names_the_parameters(values, words):
    named = {f"{DETECTOR}.{name}": value for name, value in values.items()}
    with pytest.raises(ValueError) as refused:
        replaced_all(CASE, {**named, "instrument.optics.focal_length": 0.04})
    assert str(refused.value).startswith(words)


def test_a_part_and_what_is_in_it_are_not_changed_together():
    detector = CASE.instrument.detector
    with pytest.raises(ValueError, match=r"must not be changed together"):
        replaced_all(CASE, {DETECTOR: detector, f"{DETECTOR}.bits": 10})
    with pytest.raises(ValueError, match="must not be changed"), pytest.warns(FutureWarning):
        replaced_all(CASE, {f"{DETECTOR}.bow": 1.0, f"{DETECTOR}.adc_inl": 1.0})


def test_a_box_reaches_designs_whose_variables_are_valid_only_together():
    """The side of a region grows from its corner: a change of the columns alone would be
    refused."""
    columns = Variable(f"{DETECTOR}.columns", 256, 1024)
    left = Link(f"{DETECTOR}.region.left", f"{DETECTOR}.columns", -1.0)
    case = replaced_all(
        CASE, {f"{DETECTOR}.region": RegionOfInterest(500, 0, 1280, 1280), f"{DETECTOR}.rows": 512}
    )
    detector = DesignSpace(case, (columns,), (left,)).design(np.ones(1)).instrument.detector
    assert (detector.columns, detector.region.left) == (1024, 250)
    with pytest.raises(ValueError, match=r"columns: region must lie on"):
        DesignSpace(case, (columns,))


def test_a_link_follows_what_is_computed_from_a_variable():
    """The aperture is not a field of the lens, but its focal length over its f-number."""
    f_number = Variable("instrument.optics.f_number", 1.2, 4.8)
    link = Link("instrument.detector.exposure", "instrument.optics.aperture", -2.0)
    found = DesignSpace(CASE, (f_number,), (link,)).design(np.ones(1)).instrument
    assert found.detector.exposure == pytest.approx(4 * CASE.instrument.detector.exposure)


def test_choices_are_made_together():
    offset = Choice(f"{DETECTOR}.offset", (5000.0,))
    bits = Choice(f"{DETECTOR}.bits", (14.0,))
    (one,) = branches(SATURATED, (offset, bits))
    assert (one.case.instrument.detector.offset, one.case.instrument.detector.bits) == (5000, 14)


def test_a_product_is_chosen_with_its_exposure():
    """A rolling shutter refuses an exposure that is shorter than the delay of its rows."""
    choices = (Choice(DETECTOR, ("cmv4000",)), Choice(f"{DETECTOR}.exposure", ("30 ms",)))
    for order in (choices, choices[::-1]):
        (one,) = branches(CASE, order)
        detector = one.case.instrument.detector
        assert (detector.columns, detector.exposure) == (2048, pytest.approx(0.03))
    assert one.label == "exposure 30 ms, detector cmv4000"


def test_a_variable_keeps_its_earlier_name():
    case = replaced(CASE, f"{DETECTOR}.nonlinearity", 0.01)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        space = DesignSpace(case, (Variable(f"{DETECTOR}.bend", 0.0, 0.1),))
        found = space.design(np.ones(1))
    assert found == replaced(case, f"{DETECTOR}.nonlinearity", 0.1)
    assert {str(one.message) for one in caught} == {
        "instrument.detector.bend is now called instrument.detector.nonlinearity"
    }
    assert dataclasses.replace(found) == found
