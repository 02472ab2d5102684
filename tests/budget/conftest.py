from dataclasses import replace

import pytest

from startrack.design.case import Case
from startrack.design.files import load_design
from startrack.io import shipped


@pytest.fixture(scope="session")
def case() -> Case:
    """The nanosatellite's tracker."""
    return load_design(shipped("designs/noise_only.toml")).case


@pytest.fixture(scope="session")
def troubled(case) -> Case:
    """The same case with one difference of each kind that no frame shows."""
    from startrack.attitude import Mounting
    from startrack.core.units import arcsec, deg

    sky = replace(case.catalog, epoch=2036.3, aberration=True, parallax=True)
    instrument = replace(
        case.instrument,
        mounting=Mounting(x=7 * arcsec, swing_y=9 * arcsec),
        motion=replace(case.instrument.motion, rate_x=0.1 * deg),
        delay=0.01,
    )
    tracker = replace(
        case.tracker,
        catalog=replace(sky, aberration=False, parallax=False, proper_motion=False),
        mounting=Mounting(),
        delay=0.0,
    )
    return replace(case, catalog=sky, instrument=instrument, tracker=tracker)
