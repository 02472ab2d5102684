"""Units in `startrack budget`: classes of error, levels and yield at the begin and end of life."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from startrack.cli.imports import deferred

with deferred():
    import numpy as np

    from startrack.budget import Term, UnitBudgets, unit_budgets
    from startrack.cli.options import WrongUse
    from startrack.cli.terminal import progress
    from startrack.core import arcsec
    from startrack.design import YEAR, Accuracy, Case
    from startrack.metrics import LEVELS, Interpretation, Interval

if TYPE_CHECKING:
    from startrack.core import Floats

AXES = {"across": (0, 1), "about": (2,)}


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
    values = [_values(one, required) for one in found]
    return values, _text(values, required)


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
            | asdict(_yield(found, one))
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


def _yield(found: UnitBudgets, one: Accuracy) -> Interval:
    objective, axes = one.objective, AXES[one.name]
    length = len(axes) ** 0.5 if objective.radial and objective.fraction is None else 1.0
    return found.meets(one.most / length, axes, objective.fraction)


def _text(found: list[dict[str, Any]], required: tuple[Accuracy, ...]) -> str:
    """The values of `_values` as a table, a pair of columns for each age."""
    ages = [f"{one['age_years']:g} yr" for one in found]
    lines = [_row(f"{found[0]['units']} units, arcsec",
                  [f"{name}, {age}" for age in ages for name in AXES])]  # fmt: skip
    for name in found[0]["classes_rms_arcsec"]:
        pairs = [one["classes_rms_arcsec"][name] for one in found]
        lines.append(_row(f"{name}, rms per axis", [pair[axis] for pair in pairs for axis in AXES]))
    lines.append("-" * len(lines[0]))
    for label in ("median", "worst"):
        cells = [one["rms_arcsec"][axis][label] for one in found for axis in AXES]
        lines.append(_row(f"all but bias, rms, {label} unit", cells))
    for kind, levels in found[0]["levels_arcsec"].items():
        for level in levels:
            pairs = [one["levels_arcsec"][kind][level] for one in found]
            row = [pair[axis] for pair in pairs for axis in AXES]
            lines.append(_row(f"{level} % below, {kind}", row))
    for each in zip(*(one["yields"] for one in found), strict=True):
        shares = ", ".join(
            f"{100 * one['value']:.0f} % [{100 * one['low']:.0f}, {100 * one['high']:.0f}] at {age}"
            for age, one in zip(ages, each, strict=True)
        )
        what = f"{each[0]['requirement']} at most {each[0]['most_arcsec']:g} arcsec"
        lines.append(f"yield, {what}: {shares}")
    lines += [
        f"yield, {one.objective}: levels of lengths need trials: montecarlo --units"
        for one in required
        if not _is_judged(one)
    ]
    return "\n".join(
        [*lines, "by the formula, per axis; a bias is constant for a unit and left out below it"]
    )


def _row(label: str, cells: list[Any]) -> str:
    texts = [cell if isinstance(cell, str) else f"{cell:.3f}" for cell in cells]
    return f"{label:36s}" + "".join(f"{text:>16s}" for text in texts)
