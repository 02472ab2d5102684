"""The example, and the changes that tests make to it."""

import dataclasses

from startrack.design.files import load_design
from startrack.detection import Detection
from startrack.io import shipped

CASE = load_design(shipped("designs/noise_only.toml")).case


def changed(**parts):
    instrument = dataclasses.replace(CASE.instrument, **parts)
    return dataclasses.replace(CASE, instrument=instrument)


def with_detector(**changes):
    return changed(detector=dataclasses.replace(CASE.instrument.detector, **changes))


def marginal(exposure):
    """A quarter of the pixels, and a threshold that noise exceeds now and then."""
    case = with_detector(columns=256, rows=256, pixel_pitch=22e-6, exposure=exposure)
    optics = dataclasses.replace(CASE.instrument.optics, blur=10e-6)
    instrument = dataclasses.replace(case.instrument, optics=optics)
    tracker = dataclasses.replace(CASE.tracker, detection=Detection(threshold=4.6))
    return dataclasses.replace(case, instrument=instrument, tracker=tracker)
