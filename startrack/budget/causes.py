"""Causes of error, under the terms of the standard, and the case without each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from startrack.core import Refused
from startrack.design import Case
from startrack.trial import METHOD, READ, SHOT, Term, present


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
ALWAYS = ((SHOT, Term.NOISE), (READ, Term.NOISE), (METHOD, Term.PIXEL), (NEIGHBOURS, Term.FIELD))


def causes(case: Case) -> tuple[Cause, ...]:
    """The causes that a case has, from pixels to the spacecraft, except those of all cases."""
    return tuple(
        Cause(effect.cause, effect.term, effect.without)
        for effect in present("cause", case)
        if effect.without
    )


def refuse_scans(case: Case) -> None:
    """Refuse a detector that scans: its frame has no single time to which an attitude refers."""
    if case.instrument.detector.scan:
        raise Refused("detector.scan must be absent for an error budget, got one")


def bare(case: Case) -> Case:
    """The case without any of its causes."""
    for cause in causes(case):
        case = cause.without(case)
    return case
