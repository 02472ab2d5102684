"""The truth of a unit changes nothing that its tracker believes."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest

from startrack.attitude import Mounting
from startrack.core import YEAR
from startrack.design import Case, Fidelity, aged, load_design, replaced
from startrack.detection import DarkMap
from startrack.detector import Defects, Thermal, to_frame
from startrack.detector.ageing import Age
from startrack.io import shipped
from startrack.motion import Motion, Tone
from startrack.observation import as_believed, detection_plan
from startrack.response import knowledge_of
from startrack.trial import run_trials
from tests.trial.designs import CASE


def whole_case() -> Case:
    """A small case whose instrument has most of the optional parts of a design."""
    case = CASE
    detector = replace(
        case.instrument.detector,
        thermal=Thermal(283.0),
        defects=Defects(5.0, 0.001, 500.0),
        prnu=0.01,
        crosstalk=0.01,
    )
    motion = Motion(1e-4, 2e-4, 3e-5, (Tone(20.0, 1e-6, 1e-6, 1e-6, 0.3),))
    instrument = replace(
        case.instrument,
        detector=detector,
        motion=motion,
        delay=0.01,
        mounting=Mounting(1e-3, 2e-3, 3e-3, 1e-5, 1e-5, 1e-5),
    )
    detection = replace(case.tracker.detection, dark_map=DarkMap(frames=2))
    return replace(case, instrument=instrument, tracker=replace(case.tracker, detection=detection))


def numbers(owner: object, place: str):
    """The dotted names of all numbers of a parameter object."""
    for each in dataclasses.fields(owner):  # type: ignore[arg-type]
        value, name = getattr(owner, each.name), f"{place}.{each.name}"
        parts = enumerate(value) if isinstance(value, tuple) else [(None, value)]
        for at, one in parts:
            inner = name if at is None else f"{name}.{at}"
            if dataclasses.is_dataclass(one):
                yield from numbers(one, inner)
            elif isinstance(one, int | float) and not isinstance(one, bool):
                yield inner, one


def other(case: Case, name: str, value: float) -> Case | None:
    """The case with another truth; None if the instrument refuses all other values tried."""
    for tried in (value * 1.01, value * 0.99, value + 1, value - 1, 1e-3):
        if tried != value and math.isfinite(tried):
            try:
                changed = replaced(case, name, tried)
            except ValueError:
                continue
            if changed.instrument != case.instrument:
                return changed
    return None


def beliefs(case: Case) -> tuple[object, ...]:
    """The beliefs of the tracker as values to compare."""
    plan = detection_plan(case)
    believed = as_believed(case, to_frame(np.zeros((4, 4)), case.instrument.detector))
    return (
        case.believed_camera,
        case.believed_mounting,
        case.believed_motion,
        case.believed_catalog,
        case.calibrated,
        case.instrument.delay - case.time_tag_error,
        knowledge_of(case).stretch,
        plan.settings,
        plan.kernel.whole.tobytes(),
        plan.star.psf.table.tobytes(),
        plan.correction.offset.tobytes(),
        plan.correction.hot.tobytes(),
        believed.electrons_per_dn,
        believed.offset,
        believed.read_noise,
        believed.exposure,
    )


def test_no_belief_sees_the_truth_of_any_number_of_an_instrument():
    case = whole_case()
    unit = replace(case, design=case)
    known, knowledge = beliefs(unit), knowledge_of(unit)
    assert known == beliefs(case)
    tried = 0
    for name, value in numbers(case.instrument, "instrument"):
        changed = other(unit, name, value)
        if changed is None:
            continue
        tried += 1
        assert beliefs(changed) == known, name
        assert knowledge_of(changed) is knowledge, name
    assert tried > 60


def test_no_belief_sees_the_truth_of_the_sky_and_the_scene():
    case = whole_case()
    unit = replace(case, design=case)
    deeper = replace(unit, catalog=replace(unit.catalog, limit_g=unit.catalog.limit_g + 1))
    brighter = replaced(unit, "scene.background_g", 20.0)
    for changed in (deeper, brighter):
        assert beliefs(changed) == beliefs(case)
        assert knowledge_of(changed) is knowledge_of(unit)


def test_without_a_design_beliefs_follow_the_instrument():
    case = whole_case()
    longer = replaced(
        case, "instrument.optics.focal_length", 1.01 * case.instrument.optics.focal_length
    )
    assert beliefs(longer) != beliefs(case)


def test_a_calibrated_camera_is_believed():
    case = whole_case()
    camera = case.instrument.camera.scaled(1.001)
    unit = replace(case, design=case, tracker=replace(case.tracker, camera=camera))
    assert unit.believed_camera == camera
    # Weights come from the design: a calibration of the camera costs no new ones.
    assert knowledge_of(unit) is knowledge_of(replace(case, design=case))


@pytest.mark.slow
def test_covariances_hold_what_hot_pixels_do_at_the_age_of_a_unit():
    """The squared errors of 150 windows over the stated ones are nearer to 3, for the same errors.

    Without the effect of hot pixels near stars they are 4.9 on these frames, with equal weights of
    all stars; 3.6 if 400 covariances are drawn.
    """
    age = Age(time=2 * YEAR, fluence=3e3)
    case = load_design(shipped("designs/noise_only.toml")).case
    case = replace(
        case,
        instrument=replace(case.instrument, detector=replace(case.instrument.detector, age=age)),
    )
    young = aged(case, 0.0).unit_of(case)
    assert not knowledge_of(young).hot.any()
    old = aged(case, 4 * YEAR).unit_of(case)
    assert (knowledge_of(old).hot[:50] > knowledge_of(case).hot[:50]).all()
    outcomes = run_trials(case, 3, range(150), Fidelity.WINDOW)
    right = outcomes[outcomes["solved"] & ~outcomes["false"]]
    assert len(right) > 140
    square = right["nees"]
    assert abs(square.mean() - 3) < 4 * square.std() / len(square) ** 0.5
    assert square.mean() < 4
    drawn = run_trials(case, 3, range(400), Fidelity.COVARIANCE)
    assert drawn["nees"][drawn["solved"] & ~drawn["false"]].mean() < 3.3
