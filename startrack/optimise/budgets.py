"""Case -> analytic budgets of a design and of its units, kept for a search."""

from copy import copy
from dataclasses import replace
from functools import lru_cache

from startrack.budget import Budget, ErrorLaw, UnitBudgets, analytic, unit_budgets
from startrack.core import Refused
from startrack.design import Case
from startrack.optics import COARSE

ENVIRONMENTS = 2  # of each unit in a search; by hand: time against the error of a unit's rms


def _coarse(case: Case) -> Case:
    """The case with images of few wavelengths: each design with a lens table needs its own."""
    optics = case.instrument.optics
    if not (optics.tabulated and optics.psf_tolerance < COARSE):
        return case
    instrument = replace(case.instrument, optics=replace(optics, psf_tolerance=COARSE))
    return replace(case, instrument=instrument)


@lru_cache(maxsize=16)
def budget_or_refusal(case: Case) -> Budget[ErrorLaw] | Refused:
    """The analytic budget, or why it expects no attitude; cached for the last 16 cases."""
    try:
        return analytic(_coarse(case))
    except Refused as reason:
        return copy(reason)  # without the traceback, whose frames keep arrays


def budget_of(case: Case) -> Budget[ErrorLaw]:
    """The analytic budget, cached as in a search; Refused if it expects no attitude."""
    budget = budget_or_refusal(case)
    if isinstance(budget, Refused):
        raise copy(budget)
    return budget


@lru_cache(maxsize=16)
def budgets_of_units(
    case: Case, seed: int, age: float, first: int, count: int, environments: int = ENVIRONMENTS
) -> UnitBudgets | Refused:
    """Analytic budgets of some units, or why one has no attitude; cached for 16 cases."""
    try:
        return unit_budgets(_coarse(case), seed, count, age, environments, first=first, apart=False)
    except Refused as reason:
        return copy(reason)  # without the traceback, whose frames keep arrays


def without_units(case: Case) -> Case:
    """The unit as designed; its budget does not list differences of units as left out."""
    alone = case.without_units
    return replace(alone, instrument=replace(alone.instrument, residual=None))
