"""A small tracker: its frames take milliseconds."""

import dataclasses

import pytest

from startrack.design.files import Design, load_design
from startrack.io import shipped


@pytest.fixture(scope="session")
def small() -> Design:
    """The example with a quarter of the pixels, twice as wide."""
    design = load_design(shipped("designs/noise_only.toml"))
    instrument = design.case.instrument
    detector = dataclasses.replace(
        instrument.detector, columns=256, rows=256, pixel_pitch=2 * instrument.detector.pixel_pitch
    )
    optics = dataclasses.replace(instrument.optics, blur=2 * instrument.optics.blur)
    instrument = dataclasses.replace(instrument, detector=detector, optics=optics)
    return Design(dataclasses.replace(design.case, instrument=instrument))
