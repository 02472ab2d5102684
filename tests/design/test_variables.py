import dataclasses
import math

import numpy as np
import pytest

from startrack.design.files import load_design
from startrack.design.variables import DesignSpace, Link, Variable
from startrack.io import shipped
from startrack.motion import Tone

CASE = load_design(shipped("designs/noise_only.toml")).case
FOCAL = Variable("instrument.optics.focal_length", "20 mm", "80 mm", "log")
SHARP = Variable("tracker.detection.threshold", 4.0, 10.0)


def test_corners_and_middle():
    space = DesignSpace(CASE, (FOCAL, SHARP))
    low, middle, high = (space.design(np.full(2, u)) for u in (0, 0.5, 1))
    assert low.instrument.optics.focal_length == 0.02
    assert middle.instrument.optics.focal_length == pytest.approx(0.04)
    assert high.instrument.optics.focal_length == 0.08
    assert middle.tracker.detection.threshold == 7.0
    assert middle.instrument.detector == CASE.instrument.detector


def test_place_undoes_design():
    space = DesignSpace(CASE, (FOCAL, SHARP))
    np.testing.assert_allclose(space.coordinates(space.design(np.array([0.2, 0.9]))), [0.2, 0.9])
    assert space.design(space.start).instrument.optics.focal_length == pytest.approx(
        0.035, rel=1e-15
    )


def test_a_design_on_a_bound_is_said():
    space = DesignSpace(CASE, (FOCAL, SHARP))
    assert space.on_bounds(CASE) == {}
    corner = space.design(np.array([0.0, 1.0]))
    assert space.on_bounds(corner) == {FOCAL.name: "low", SHARP.name: "high"}
    assert space.on_bounds(space.design(np.array([0.02, 0.995]))) == {SHARP.name: "high"}


def test_text_has_units():
    assert DesignSpace(CASE, (FOCAL, SHARP)).text(CASE) == {
        "instrument.optics.focal_length": "35 mm",
        "tracker.detection.threshold": "6",
    }


@pytest.mark.parametrize(
    ("variable", "words"),
    [
        (Variable("instrument.optics.focus", 1.0, 2.0), "focus is none; did you mean defocus"),
        (
            Variable("exposure", 1.0, 2.0),
            "exposure is none; did you mean instrument.detector.exposure?",
        ),
        (Variable("instrument.optics", 1.0, 2.0), "must be a number that can vary"),
        (Variable("instrument.optics.psf", 8.0, 12.0), "must be a number that can vary"),
        (Variable("instrument.motion.tones.0.rms_x", 8.0, 12.0), "0 is none"),
        (Variable("instrument.optics.focal_length", 0.02, 0.08), "must have a unit, such as"),
        (Variable("instrument.optics.focal_length", "2 kg", "3 kg"), "converts to m"),
        (Variable("instrument.optics.focal_length", "80 mm", "20 mm"), "low must be below high"),
        (Variable("instrument.optics.focal_length", "40 mm", "80 mm"), "must start in its bounds"),
        (Variable("tracker.detection.threshold", "4", 9.0), "must be a number without unit"),
        (Variable("instrument.optics.f_number", 0.1, 4.0), "f_number must lie in"),
        (Variable("instrument.optics.blur", "0 um", "9 um", "log"), "positive for a log scale"),
    ],
)
def test_wrong_variables_are_refused(variable, words):
    with pytest.raises(ValueError, match=words):
        DesignSpace(CASE, (variable,))


def test_no_variable_and_one_twice_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        DesignSpace(CASE, ())
    with pytest.raises(ValueError, match="twice"):
        DesignSpace(CASE, (FOCAL, FOCAL))


def test_a_whole_number_is_rounded():
    space = DesignSpace(CASE, (Variable("instrument.detector.bits", 8, 14),))
    places = [np.array([u]) for u in (0, 0.4, 1)]
    assert [space.design(u).instrument.detector.bits for u in places] == [8, 10, 14]
    # Tables and files of a search hold what was tried.
    assert [space.values(u)["instrument.detector.bits"] for u in places] == [8, 10, 14]


def test_a_number_in_a_list_may_vary():
    tone = Tone(10.0, rms_x=1e-5)
    motion = dataclasses.replace(CASE.instrument.motion, tones=(Tone(5.0), tone))
    case = dataclasses.replace(CASE, instrument=dataclasses.replace(CASE.instrument, motion=motion))
    space = DesignSpace(
        case, (Variable("instrument.motion.tones.1.rms_x", "1 arcsec", "5 arcsec"),)
    )
    tones = space.design(np.array([1.0])).instrument.motion.tones
    assert tones[0] == Tone(5.0)
    assert tones[1].frequency == 10.0
    assert tones[1].rms_x == pytest.approx(math.radians(5 / 3600))


def test_what_is_linked_follows():
    """The blur is proportional to the focal length, the exposure to the inverse square of the
    blur."""
    links = (
        Link("instrument.optics.blur", "instrument.optics.focal_length"),
        Link("instrument.detector.exposure", "instrument.optics.blur", -2.0),
    )
    space = DesignSpace(CASE, (FOCAL,), links)
    twice = space.design(space.start + math.log(2) / math.log(4)).instrument
    assert twice.optics.blur == pytest.approx(2 * CASE.instrument.optics.blur)
    assert twice.detector.exposure == pytest.approx(CASE.instrument.detector.exposure / 4)
    with pytest.raises(ValueError, match="twice"):
        DesignSpace(
            CASE, (FOCAL,), (Link("instrument.optics.focal_length", "instrument.optics.blur"),)
        )
    with pytest.raises(ValueError, match=r"optics\.k1 must be positive if a link uses it, got 0"):
        DesignSpace(
            CASE, (FOCAL,), (Link("instrument.optics.k1", "instrument.optics.focal_length"),)
        )


def test_a_function_makes_the_last_changes():
    def square(case):
        side = round(512 * 0.035 / case.instrument.optics.focal_length)
        detector = dataclasses.replace(case.instrument.detector, rows=side, columns=side)
        return dataclasses.replace(
            case, instrument=dataclasses.replace(case.instrument, detector=detector)
        )

    space = DesignSpace(CASE, (FOCAL,), adapt=square)
    assert space.design(np.array([1.0])).instrument.detector.rows == 224
