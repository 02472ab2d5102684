"""Units in `startrack budget`: classes of error, levels and yield at the begin and end of life."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from startrack.cli.imports import deferred

with deferred():
    import numpy as np

    from startrack.budget import Term, UnitBudgets, unit_budgets
    from startrack.cli.options import WrongUse
    from startrack.cli.terminal import progress
    from startrack.core import arcsec
    from startrack.design import YEAR, Accuracy, Case
    from startrack.metrics import LEVELS, Interpretation

AXES = {"across": (0, 1), "about": (2,)}


if TYPE_CHECKING:
    from startrack.core import Floats


def units_of(
    case: Case, required: tuple[Accuracy, ...], options: argparse.Namespace
) -> tuple[list[dict[str, Any]], str]:
    """What the budgets of some units say: values for JSON, one for each age, and their text."""
    if not case.variation:
        raise WrongUse("--units needs a design with [[variation]] tables")
    ages = list(dict.fromkeys((0.0, case.lifetime)))
    found = []
    with progress("units", options.units * len(ages)) as advance:
        for age in ages:
            found.append(unit_budgets(case, options.seed, options.units, age, progress=advance))
    return [_values(one, required) for one in found], _text(found, required)


def _values(found: UnitBudgets, required: tuple[Accuracy, ...]) -> dict[str, Any]:
    return {
        "age_years": found.age / YEAR,
        "units": len(found),
        "classes_rms_arcsec": {name: _pair(values) for name, values in _classes(found).items()},
        "rms_arcsec": {
            name: {"median": float(np.median(each)) / arcsec, "worst": float(each.max()) / arcsec}
            for name, each in (("across", found.across()), ("about", found.about()))
        },
        "levels_arcsec": {
            kind.value: {
                f"{100 * fraction:g}": {
                    name: found.level(axes, fraction, kind) / arcsec for name, axes in AXES.items()
                }
                for fraction in LEVELS
            }
            for kind in Interpretation
        },
        "yields": [
            {"requirement": str(one.objective), "most_arcsec": one.most / arcsec}
            | dict(zip(("value", "low", "high"), _yield(found, one), strict=True))
            for one in required
            if _is_judged(one)
        ],
    }


def _classes(found: UnitBudgets) -> dict[str, Floats]:
    """(n, 3) radian of each class of error."""
    return {Term.BIAS.value: found.bias} | {
        term.value: values for term, values in found.terms.items()
    }


def _pair(values: Floats) -> dict[str, float]:
    """Rms over the units, per axis."""
    mean = (values**2).mean(axis=0)
    return {
        "across": float(np.sqrt(mean[:2].mean())) / arcsec,
        "about": float(np.sqrt(mean[2])) / arcsec,
    }


def _is_judged(one: Accuracy) -> bool:
    """Whether the formula has the statistic: an rms, or a level about single axes."""
    return one.objective.fraction is None or not one.objective.radial or one.name == "about"


def _yield(found: UnitBudgets, one: Accuracy) -> tuple[float, float, float]:
    objective, axes = one.objective, AXES[one.name]
    length = len(axes) ** 0.5 if objective.radial and objective.fraction is None else 1.0
    interval = found.meets(one.most / length, axes, objective.fraction)
    return interval.value, interval.low, interval.high


def _text(found: list[UnitBudgets], required: tuple[Accuracy, ...]) -> str:
    ages = [f"{one.age / YEAR:g} yr" for one in found]
    heads = "".join(f"{f'{name}, {age}':>16s}" for age in ages for name in AXES)
    lines = [f"{f'{len(found[0])} units, arcsec':36s}{heads}"]
    classes = [{name: _pair(each) for name, each in _classes(one).items()} for one in found]
    for name in classes[0]:
        cells = "".join(f"{one[name][axis]:16.3f}" for one in classes for axis in AXES)
        lines.append(f"{name + ', rms per axis':36s}{cells}")
    lines.append("-" * len(lines[0]))
    for label, of in (("median", np.median), ("worst", np.max)):
        cells = "".join(
            f"{float(of(each)) / arcsec:16.3f}"
            for one in found
            for each in (one.across(), one.about())
        )
        lines.append(f"{f'all but bias, rms, {label} unit':36s}{cells}")
    for kind in Interpretation:
        for fraction in LEVELS:
            cells = "".join(
                f"{one.level(axes, fraction, kind) / arcsec:16.3f}"
                for one in found
                for axes in AXES.values()
            )
            lines.append(f"{f'{100 * fraction:g} % below, {kind.value}':36s}{cells}")
    for one in required:
        if not _is_judged(one):
            lines.append(
                f"yield, {one.objective}: levels of lengths need trials: montecarlo --units"
            )
            continue
        cells = ", ".join(
            f"{100 * value:.0f} % [{100 * low:.0f}, {100 * high:.0f}] at {age}"
            for age, (value, low, high) in zip(ages, (_yield(b, one) for b in found), strict=True)
        )
        lines.append(f"yield, {one.objective} at most {one.most / arcsec:g} arcsec: {cells}")
    return "\n".join(
        [*lines, "by the formula, per axis; a bias is constant for a unit and left out below it"]
    )
