"""Causes of error, under the terms of the standard, and the case without each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

from startrack.core import Refused
from startrack.design import Case
from startrack.trial import LENS_FIELD, METHOD, READ, SHOT, dark_currents


class Term(StrEnum):
    """The parts of a star tracker's error, as ECSS-E-ST-60-20C names them."""

    BIAS = "bias"
    THERMO_ELASTIC = "thermo-elastic"
    FIELD = "FOV spatial"
    PIXEL = "pixel spatial"
    NOISE = "temporal noise"
    ABERRATION = "aberration"
    MEASUREMENT_DATE = "measurement date"


@dataclass(frozen=True)
class Cause:
    """One cause of error.

    name     of the cause
    term     that it belongs to
    without  gives the case without the cause; the sky and all other draws stay the same
    """

    name: str
    term: Term
    without: Callable[[Case], Case]


# Causes that every case has, so that there is no case without them.
NEIGHBOURS = "neighbours"
ALWAYS = (
    (SHOT, Term.NOISE),
    (READ, Term.NOISE),
    (METHOD, Term.PIXEL),
    (NEIGHBOURS, Term.FIELD),
)
HITS = "hits"
SHUTTER = "rolling shutter"
LENS_COLOUR = "lateral colour"


def causes(case: Case) -> tuple[Cause, ...]:
    """The causes that a case has, from pixels to the spacecraft, except those of all cases."""
    return tuple(_present(case))


def _present(case: Case) -> Iterator[Cause]:
    detector, motion = case.instrument.detector, case.instrument.motion
    if motion.tones or motion.broadband:
        yield Cause("jitter", Term.NOISE, _calm)
    if detector.hits:
        yield Cause(HITS, Term.NOISE, lambda one: _with(one, hits=None))
    if detector.prnu:
        yield Cause("PRNU", Term.PIXEL, lambda one: _with(one, prnu=0.0))
    if detector.defects or case.tracker.detection.dark_map:
        yield Cause("DSNU", Term.PIXEL, _flawless)
    if detector.settling or detector.lag or detector.nonlinearity or detector.adc_inl:
        yield Cause("read-out", Term.PIXEL, _linear)
    if case.instrument.optics.tabulated and case.instrument.optics.lens_field:
        yield Cause(LENS_FIELD, Term.FIELD, lambda one: _through(one, lens_field=False))
    if case.instrument.optics.tabulated and case.instrument.optics.lens_colour:
        yield Cause(LENS_COLOUR, Term.FIELD, lambda one: _through(one, lens_colour=False))
    if case.believed_camera != case.instrument.camera:
        yield Cause("camera model", Term.FIELD, _calibrated)
    true, believed = case.catalog, case.believed_catalog
    if (true.proper_motion, true.epoch) != (believed.proper_motion, believed.epoch):
        yield Cause("proper motion", Term.FIELD, _moved)
    if true.parallax != believed.parallax:
        yield Cause("parallax", Term.FIELD, _near)
    seen = true.aberration, true.orbital_velocity
    if seen != (believed.aberration, believed.orbital_velocity):
        yield Cause("aberration", Term.ABERRATION, _corrected)
    if case.instrument.mounting.still != case.believed_mounting:
        yield Cause("mounting", Term.BIAS, _aligned)
    if case.instrument.mounting.swings:
        yield Cause("mounting swing", Term.THERMO_ELASTIC, _cool)
    if detector.row_delay and motion.rate:
        yield Cause(SHUTTER, Term.FIELD, lambda one: _with(one, row_delay=0.0))
    if case.time_tag_error and motion.rate:
        yield Cause("time stamp", Term.MEASUREMENT_DATE, _punctual)


def refuse_scans(case: Case) -> None:
    """Refuse a detector that scans: its frame has no single time to which an attitude refers."""
    if case.instrument.detector.scan:
        raise Refused("detector.scan must be absent for an error budget, got one")


def bare(case: Case) -> Case:
    """The case without any of its causes."""
    for cause in causes(case):
        case = cause.without(case)
    return case


def _with(case: Case, **changes: object) -> Case:
    detector = replace(case.instrument.detector, **changes)  # type: ignore[arg-type]
    return replace(case, instrument=replace(case.instrument, detector=detector))


def _through(case: Case, **changes: object) -> Case:
    optics = replace(case.instrument.optics, **changes)  # type: ignore[arg-type]
    return replace(case, instrument=replace(case.instrument, optics=optics))


def _believing(case: Case, **changes: object) -> Case:
    return replace(case, tracker=replace(case.tracker, **changes))  # type: ignore[arg-type]


def _calm(case: Case) -> Case:
    motion = replace(case.instrument.motion, tones=(), broadband=(), jitter=())
    return replace(case, instrument=replace(case.instrument, motion=motion))


def _flawless(case: Case) -> Case:
    mean, _ = dark_currents(case.instrument.detector)
    detection = replace(case.tracker.detection, dark_map=None)
    return _believing(_with(case, defects=None, dark_current=mean), detection=detection)


def _linear(case: Case) -> Case:
    return _with(case, settling=0.0, lag=0.0, nonlinearity=0.0, adc_inl=0.0)


def _calibrated(case: Case) -> Case:
    known = None if case.design is None else case.instrument.camera
    return _believing(case, camera=known, camera_model="radial", calibrated_at=None)


def _moved(case: Case) -> Case:
    true = case.catalog
    return _believing(
        case,
        catalog=replace(case.believed_catalog, proper_motion=true.proper_motion, epoch=true.epoch),
    )


def _near(case: Case) -> Case:
    catalog = replace(case.believed_catalog, parallax=case.catalog.parallax)
    return _believing(case, catalog=catalog)


def _corrected(case: Case) -> Case:
    true = case.catalog
    return _believing(
        case,
        catalog=replace(
            case.believed_catalog,
            aberration=true.aberration,
            orbital_velocity=true.orbital_velocity,
        ),
    )


def _aligned(case: Case) -> Case:
    known = None if case.design is None else case.instrument.mounting.still
    return _believing(case, mounting=known)


def _cool(case: Case) -> Case:
    mounting = case.instrument.mounting
    still = replace(case, instrument=replace(case.instrument, mounting=mounting.still))
    return _believing(still, mounting=case.believed_mounting)


def _punctual(case: Case) -> Case:
    known = None if case.design is None else case.instrument.delay
    return _believing(case, delay=known)
