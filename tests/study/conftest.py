"""A small tracker: its trials take milliseconds."""

import dataclasses

import pytest

from startrack.case import Case
from startrack.catalog import shipped
from startrack.curve import Curve
from startrack.design import Design, load_design


@pytest.fixture(scope="session")
def small() -> Design:
    """The example with a quarter of the pixels, twice as wide, and few trials."""
    design = load_design(shipped("designs/nanosatellite.toml"))
    assert design.campaign is not None
    instrument = design.case.instrument
    detector = dataclasses.replace(
        instrument.detector, columns=256, rows=256, pixel_pitch=2 * instrument.detector.pixel_pitch
    )
    optics = dataclasses.replace(instrument.optics, blur=2 * instrument.optics.blur)
    instrument = dataclasses.replace(instrument, detector=detector, optics=optics)
    campaign = dataclasses.replace(
        design.campaign,
        trials=12,
        most_trials=24,
        evaluations=20,
        prospects=8,
        fresh_trials=60,
        sample_trials=12,
        # What so few fresh trials can show.
        requirements=dataclasses.replace(design.campaign.requirements, min_availability=0.95),
    )
    return Design(dataclasses.replace(design.case, instrument=instrument), campaign)


@pytest.fixture(scope="session")
def blind(small) -> Case:
    """A lens that passes no light that Gaia's band has: it cannot be rendered."""
    infrared = Curve((2e-6, 3e-6), (1.0, 1.0))
    optics = dataclasses.replace(small.case.instrument.optics, transmission=infrared)
    return dataclasses.replace(
        small.case, instrument=dataclasses.replace(small.case.instrument, optics=optics)
    )
