"""The example, and what tests change of it."""

import dataclasses

from startrack.catalog import shipped
from startrack.design import load_design

CASE = load_design(shipped("designs/nanosatellite.toml")).case


def changed(**parts):
    instrument = dataclasses.replace(CASE.instrument, **parts)
    return dataclasses.replace(CASE, instrument=instrument)


def with_detector(**changes):
    return changed(detector=dataclasses.replace(CASE.instrument.detector, **changes))
