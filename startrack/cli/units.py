"""Units in `startrack budget` and `montecarlo`: classes of error, levels, yields, worst unit."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from startrack.cli.imports import wanted

if wanted(__name__):
    import numpy as np
    from numpy.typing import NDArray

    from startrack.budget import Term, UnitBudgets, unit_budgets
    from startrack.cli.options import as_wrong_use
    from startrack.cli.terminal import progress
    from startrack.core import arcsec
    from startrack.design import YEAR, Accuracy, Campaign, Case, Fidelity, Objective
    from startrack.io import aligned
    from startrack.metrics import ARCSEC, LEVELS, Interpretation, Interval, bounds_json
    from startrack.montecarlo import Sampling
    from startrack.optimise import allocation, halved
    from startrack.population import explain, per_unit
    from startrack.verification import USUAL, units_expected, yield_of

if TYPE_CHECKING:
    from startrack.core import Floats

AXES = {"across": (0, 1), "about": (2,)}


def require_units(case: Case) -> None:
    """Refuse a design whose units are all alike.

    Raises  ValueError that says what they could differ by.
    """
    if not case.differs:
        raise ValueError(
            "--units needs a design with [[variation]] tables, [instrument.residual] or "
            "[instrument.detector.age]"
        )


def budgets_of(
    case: Case, required: tuple[Accuracy, ...], options: argparse.Namespace
) -> tuple[list[dict[str, Any]], str]:
    """What the budgets of some units say: values for JSON, one for each age, and their text."""
    with as_wrong_use():
        require_units(case)
    ages = list(dict.fromkeys((0.0, case.end_of_life)))
    found = []
    with progress("units", options.units * len(ages)) as advance:
        for age in ages:
            found.append(unit_budgets(case, options.seed, options.units, age, progress=advance))
    values = [_values(one, required) for one in found]
    return values, _text(values)


def tolerances_of(
    case: Case, campaign: Campaign | None, options: argparse.Namespace
) -> tuple[dict[str, Any], str]:
    """What halving each tolerance buys: values for JSON, and a table."""
    campaign = campaign or Campaign()
    objective, required = Objective.read(campaign.objective), campaign.requirements.accuracy
    fraction = campaign.units or USUAL
    with progress("units", options.units * (1 + len(list(halved(case))))) as advance:
        found = allocation(
            case, objective, required, fraction, options.seed, options.units, advance
        )
    values = {
        "objective": str(objective),
        "fraction": fraction,
        "age_years": found.age / YEAR,
        "level_arcsec": found.level / arcsec,
        "halved": [
            {
                "tolerance": one.name,
                "gain_arcsec": bounds_json(one.level, ARCSEC),
                "yields": [
                    {"requirement": str(limit.objective), "most_arcsec": limit.most / arcsec}
                    | asdict(more)
                    for limit, more in zip(required, one.yields, strict=True)
                ],
                "price": one.price,
            }
            for one in found.each
        ],
    }
    rows = [["halved", "gain (arcsec)", *(f"yield, {one.name} (%)" for one in required), "price"]]
    for one in found.each:
        yields = [_bracket(each, 0.01, 1) for each in one.yields]
        rows.append([one.name, _bracket(one.level, arcsec, 3), *yields, f"{one.price:.4g}"])
    text = [
        f"{objective} that {100 * fraction:g} % of {options.units} units at "
        f"{found.age / YEAR:g} yr do not exceed: {found.level / arcsec:.3f} arcsec",
        *aligned(rows, (0,)),
        "by the formula, on the same draws of the same units, with their biases; brackets hold "
        "with 95 % for other units",
    ]
    return values, "\n".join(text)


def _bracket(one: Interval, unit: float, digits: int) -> str:
    value, low, high = (f"{each / unit:+.{digits}f}" for each in (one.value, one.low, one.high))
    return f"{value} [{low}, {high}]"


def trials_of(
    case: Case,
    seed: int,
    sampling: Sampling,
    outcomes: NDArray[np.void],
    required: tuple[Accuracy, ...],
) -> tuple[dict[str, Any], list[str]]:
    """What trials of units say: their errors, the yield of each accuracy, and the worst unit."""
    units, fidelity = sampling.units, sampling.fidelity
    assert units
    found = per_unit(outcomes)
    years = units.age / YEAR
    values: dict[str, Any] = {"count": len(found.unit), "age_years": years}
    lines = []
    for name, each in (("across", found.across), ("about", found.about)):
        middle, high = (float(np.nanquantile(each, part)) / arcsec for part in (0.5, 0.95))
        values |= {f"{name}_median_arcsec": middle, f"{name}_95_arcsec": high}
        lines.append(
            f"of {len(found.unit)} units at {years:g} yr, rms {name}: {middle:.3f} arcsec in the "
            f"median, {high:.3f} in 95 %"
        )
    values["yields"] = [
        yield_values(one, found.meets(outcomes, one.objective, one.most)) for one in required
    ]
    lines += [f"{yield_name(one)}: {yield_share(one)}" for one in values["yields"]]
    worst = found.worst
    if worst is not None and fidelity is Fidelity.COVARIANCE:
        parts = explain(case, seed, units, worst)
        values["worst"] = {"unit": worst, "removes": dict(parts)}
        shown = "; ".join(f"{name} {100 * part:+.0f} %" for name, part in parts[:4])
        lines.append(f"worst unit {worst}; as designed instead changes its rms across by: {shown}")
    return values, lines


def yield_values(one: Accuracy, share: Interval) -> dict[str, Any]:
    """A yield for JSON: requirement and limit, share of the units with its 95 % interval."""
    return {"requirement": str(one.objective), "most_arcsec": one.most / arcsec} | asdict(share)


def yield_name(one: dict[str, Any]) -> str:
    """Of what a yield is."""
    return f"yield, {one['requirement']} at most {one['most_arcsec']:g} arcsec"


def yield_share(one: dict[str, Any]) -> str:
    """A yield in percent, with its interval."""
    return f"{100 * one['value']:.0f} % [{100 * one['low']:.0f}, {100 * one['high']:.0f}]"


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
            yield_values(one, yield_of(one, units_expected(one.objective, found)))
            for one in required
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


def _text(found: list[dict[str, Any]]) -> str:
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
            f"{yield_share(one)} at {age}" for age, one in zip(ages, each, strict=True)
        )
        lines.append(f"{yield_name(each[0])}: {shares}")
    return "\n".join(
        [*lines, "by the formula, per axis; a bias is constant for a unit, counts in yields and is "
         "left out below it else"]
    )  # fmt: skip


def _row(label: str, cells: list[Any]) -> str:
    texts = [cell if isinstance(cell, str) else f"{cell:.3f}" for cell in cells]
    return f"{label:36s}" + "".join(f"{text:>16s}" for text in texts)
