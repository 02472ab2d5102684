"""The response of single stars is computed once for cases that do not differ in it."""

import dataclasses

import numpy as np
import pytest

from startrack import load_design, shipped
from startrack.design import Case, Moment, replaced
from startrack.observation import sky_electrons
from startrack.population import unit_of
from startrack.response import errors, residual_shift, star_inputs, zone_errors, zones_of
from startrack.response.dark_pattern import empty_frame


def _arrays(value: object) -> list[np.ndarray]:
    if dataclasses.is_dataclass(value):
        return _arrays([getattr(value, part.name) for part in dataclasses.fields(value)])
    if isinstance(value, dict):
        return _arrays(list(value.values()))
    if isinstance(value, list | tuple):
        return [array for part in value for array in _arrays(part)]
    return [np.asarray(value, float)]


def _same(one: object, other: object) -> bool:
    pairs = zip(_arrays(one), _arrays(other), strict=True)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


@pytest.fixture(scope="module")
def nanosatellite() -> Case:
    return load_design(shipped("designs/nanosatellite.toml")).case


@pytest.mark.parametrize("function", [errors, zones_of, residual_shift, zone_errors])
def test_what_is_left_out_of_the_key_is_not_read(nanosatellite: Case, function) -> None:
    unit = unit_of(nanosatellite, 1, Moment(3, 1, 1, nanosatellite.end_of_life))
    for case in (nanosatellite, unit):
        assert star_inputs(case) != case
        assert _same(function(case), function.__wrapped__(case))


@pytest.mark.parametrize("function", [errors, residual_shift])
def test_the_age_of_the_dark_map_changes_no_centroid(nanosatellite: Case, function) -> None:
    older = replaced(nanosatellite, "tracker.detection.dark_map_age", 0.0)
    assert star_inputs(older) != star_inputs(nanosatellite)
    assert function(older) is function(nanosatellite)
    assert _same(function(older), function.__wrapped__(older))


def test_search_of_an_empty_frame_reads_no_more(nanosatellite: Case) -> None:
    sky = sky_electrons(nanosatellite)
    assert _same(empty_frame(nanosatellite, sky), empty_frame.__wrapped__(nanosatellite, sky))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("instrument.structure.heater", 0.3),
        ("tracker.calibration.map", 5),
        ("tracker.identification.min_matches", 7),
        ("instrument.mounting.x", 1e-3),
    ],
)
def test_these_keys_leave_single_stars_as_they_are(
    nanosatellite: Case, key: str, value: float
) -> None:
    other = replaced(nanosatellite, key, value)
    assert other != nanosatellite
    assert errors(other) is errors(nanosatellite)


@pytest.mark.parametrize(
    ("key", "factor"),
    [
        ("instrument.detector.exposure", 1.1),
        ("instrument.optics.f_number", 1.1),
        ("tracker.detection.max_spots", 2),
    ],
)
def test_these_keys_do_not(nanosatellite: Case, key: str, factor: float) -> None:
    case = nanosatellite
    for part in key.split("."):
        case = getattr(case, part)
    other = replaced(nanosatellite, key, case * factor)
    assert errors(other) is not errors(nanosatellite)
