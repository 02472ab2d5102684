"""Design file -> draws of its unknown values, with the classes of error of each draw's units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from startrack.budget import Term, unit_budgets
from startrack.core import Advance, Floats, Refused, printed, whole
from startrack.design import Case, Design, Moment, Unknown, load_design, stratified
from startrack.population import left_over, unit_of
from startrack.verification import expected_in_frames, expected_of_star

# Environments and fields of each unit. Chosen by hand: the error by their small number is in the
# scatter of the surface, and small compared with the width of most laws.
ENVIRONMENTS, FIELDS = 1, 32
ALL_FIELDS = 512  # fields of the middle draw; as many as in `analytic`
# The mean over these few fields is wrong by a factor that is nearly equal for all draws. This
# factor is computed for the middle draw, by a second budget over the number of fields of `startrack
# budget`. For three shipped designs the error of the noise was 5 to 12 % before the correction, and
# at most 2 % after it.
BY_FIELDS = Term.NOISE, Term.PIXEL, Term.FIELD
RESIDUAL = "residual"  # a figure that takes time; it is computed only if the design is told it
MIDDLE = -1  # number of the draw with all unknowns at their middle values


@printed
class Draw(NamedTuple):
    """One value of each unknown, and the resulting errors of the design.

    number        number of the draw; -1: all unknowns have their middle values
    unknowns      unknowns of the drawn design; they may differ from draw to draw if the design
                  includes one of several files
    quantile      quantile of each unknown, in (0, 1), by its name
    terms         radian (2,), rms over units of each class of error: per axis across the boresight,
                  and about it
    availability  1, mean over the units
    refused       reason why the design has no errors; empty if it has errors
    frames        figures that frames measure, by name, from `expected_in_frames`; also "residual"
                  and figures of stars of a magnitude, if the design is told such a figure
    """

    number: int
    unknowns: tuple[Unknown, ...]
    quantile: dict[str, float]
    terms: dict[Term, Floats]
    availability: float
    refused: str = ""
    frames: Mapping[str, float] = MappingProxyType({})


def draw_unknowns(
    path: Path,
    seed: int,
    count: int,
    units: int,
    age: float | None = None,
    changes: Sequence[str] = (),
    executor: Executor | None = None,
    progress: Advance | None = None,
    middle: bool = True,
    watch: Callable[[Draw], None] | None = None,
) -> list[Draw]:
    """The middle draw, then draws of all unknowns.

    Each of `count` equal parts of (0, 1) holds one quantile of an unknown. Their order depends only
    on the seed and the unknown's name (Latin hypercube, McKay et al. 1979, Technometrics 21, 239).
    Each draw has different units, so that the mean over draws does not depend on one set of units.

    units     number of units of each draw
    age       second; None: the end of life
    executor  executor whose workers compute the draws. This process computes the middle draw first,
              so that it is available soon; None: this process computes all
    progress  called with 1 after each draw
    middle    whether the middle draw is included; if so, the noise, pixel and field errors of the
              other draws are corrected for their few fields of the sky
    watch     called with the middle draw
    Raises    as `load_design`. If a drawn design has no budget, because no field can be solved or a
              value is outside its limits, its draw has `refused`.
    """
    whole(1, 10**4, count=count)
    whole(1, 10**4, units=units)
    load_design(path, changes)  # raises errors of the file before any draw
    plan = _DrawPlan(path, tuple(changes), seed, count, units, age)
    draws, factors = list[Draw](), dict[Term, Floats]()
    if middle:
        draws.append(_draw(plan, MIDDLE, ALL_FIELDS))
        if watch:
            watch(draws[0])
        factors = _factors(draws[0], _draw(plan, MIDDLE))
    if executor is None:
        results = (_draw(plan, number) for number in range(count))
    else:
        futures = [executor.submit(_draw, plan, number) for number in range(count)]
        results = (future.result() for future in futures)
    for draw in results:
        terms = {term: errors * factors.get(term, 1.0) for term, errors in draw.terms.items()}
        draws.append(draw._replace(terms=terms))
        if progress:
            progress(1)
    return draws


def _factors(fine: Draw, coarse: Draw) -> dict[Term, Floats]:
    """Factors (2,) on each class of error over few fields; 1 if the class is zero."""
    return {
        term: np.divide(
            fine.terms[term], coarse.terms[term], np.ones(2), where=coarse.terms[term] > 0
        )
        for term in BY_FIELDS
        if term in fine.terms and term in coarse.terms
    }


class _DrawPlan(NamedTuple):
    """Arguments of `draw_unknowns` that a draw needs."""

    path: Path
    changes: tuple[str, ...]
    seed: int
    draws: int
    units: int
    age: float | None


def _draw(plan: _DrawPlan, number: int, fields: int = FIELDS) -> Draw:
    """The draw with a number; MIDDLE: all unknowns have their middle values."""
    seed, units, quantiles = plan.seed, plan.units, dict[str, float]()
    try:
        design = drawn_design(plan.path, plan.changes, seed, number, plan.draws, quantiles)
    except Refused as error:
        return Draw(number, (), quantiles, {}, 0.0, str(error))
    try:
        first = max(number, 0) * units
        terms, available = _terms(design.case, seed, first, units, plan.age, fields)
        frames = expected_in_frames(design.case)
        for told in design.told:
            if told.magnitude is not None:
                frames[told.name] = expected_of_star(design.case, told.figure, told.magnitude)
        if any(told.figure == RESIDUAL for told in design.told):
            frames[RESIDUAL] = _residual(design.case, seed, max(number, 0) * units, units)
    except Refused as error:
        return Draw(number, design.unknowns, quantiles, {}, 0.0, str(error))
    return Draw(
        number=number,
        unknowns=design.unknowns,
        quantile=quantiles,
        terms=terms,
        availability=available,
        refused="",
        frames=frames,
    )


def drawn_design(
    path: Path,
    changes: Sequence[str],
    seed: int,
    number: int,
    count: int,
    quantiles: dict[str, float],
) -> Design:
    """The design with the values of one draw of many; its number is -1 for the middle.

    quantiles  mapping to which the quantile of each unknown is added, by its name
    """

    def quantile(name: str) -> float | None:
        if number == MIDDLE:
            return None
        quantiles[name] = float(stratified(seed, name, count)[number])
        return quantiles[name]

    return load_design(path, changes, quantile=quantile)


def drawn_cases(path: Path, seed: int, count: int, changes: Sequence[str] = ()) -> list[Case]:
    """The design with other values of its unknowns, for each draw of `draw_unknowns`.

    Raises  Refused if a drawn value is outside its limits; otherwise as `load_design`.
    """
    whole(1, 10**4, count=count)
    return [drawn_design(path, changes, seed, number, count, {}).case for number in range(count)]


def _terms(
    case: Case, seed: int, first: int, units: int, age: float | None, fields: int
) -> tuple[dict[Term, Floats], float]:
    """Radian (2,) of each class of error, rms over units, and the mean availability."""
    age = case.end_of_life if age is None else age
    budgets = unit_budgets(case, seed, units, age, ENVIRONMENTS, fields, first=first)
    square = {term: (errors**2).mean(axis=0) for term, errors in budgets.terms.items()}
    square[Term.BIAS] = (budgets.bias**2).mean(axis=0)
    terms = {
        term: np.sqrt([(values[0] + values[1]) / 2, values[2]]) for term, values in square.items()
    }
    return terms, float(budgets.availability.mean())


def _residual(case: Case, seed: int, first: int, units: int) -> float:
    """Displacements that remain after calibration: pixel rms per axis over units and the frame.

    They are computed at the begin of life, in one environment of each unit. They are zero if the
    tracker's camera model is true for all units.
    """
    if not case.differs:
        return 0.0
    drawn = [unit_of(case, seed, Moment(unit)) for unit in range(first, first + units)]
    residuals = [left_over(unit.instrument.camera, unit.believed_camera) for unit in drawn]
    return float(np.sqrt(np.mean(np.square(residuals))))
