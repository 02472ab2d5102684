"""Units in `startrack budget` and `montecarlo`: classes of error, levels, yields, worst unit."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from startrack.cli.options import wanted

if wanted(__name__):
    import numpy as np

    from startrack import design
    from startrack.budget import PUBLISHED, Term, UnitBudgets, errors_text, unit_budgets
    from startrack.cli.terminal import progress
    from startrack.core import YEAR, Rows, arcsec
    from startrack.design import Accuracy, Campaign, Case
    from startrack.io import aligned, recalled
    from startrack.metrics import ARCSEC, LEVELS, Interpretation, Interval, bounds_json, bracketed
    from startrack.montecarlo import Sampling
    from startrack.optimise import LeverChange, LeverGain, allocation, costs_of
    from startrack.population import Units, explain, per_unit
    from startrack.verification import USUAL, units_expected, yield_of

if TYPE_CHECKING:
    from startrack.core import Floats

if wanted(__name__):
    # Explanations of the classes of error that only units have, not the unit as designed.
    ADVICE = {
        Term.BIAS: "mounting and camera differ from their calibration: tracker.calibration, "
        "[[variation]] per unit, launch and life",
        Term.THERMO_ELASTIC: "heat turns the boresight over an orbit: instrument.structure, "
        "instrument.mounting in [[variation]] per environment",
        Term.FIELD: "residual errors of stars' places after calibration, with heat, and "
        "neighbours: tracker.calibration, instrument.residual, tracker.detection.max_spots",
    }
AXES = {"across": (0, 1), "about": (2,)}
BRIEF = ("NEA", "and thermo-elastic: accuracy")  # rows of PUBLISHED without --full


def require_units(case: Case) -> None:
    """Refuse a design whose units do not differ.

    Raises  ValueError, which names the tables that would make them differ.
    """
    if not case.differs:
        raise ValueError(
            "--units needs a design with [[variation]] tables, [instrument.residual] or "
            "[instrument.detector.age]"
        )


def budgets_of(
    case: Case, required: tuple[Accuracy, ...], options: argparse.Namespace
) -> tuple[list[dict[str, Any]], UnitBudgets]:
    """Budgets of units: values for JSON, one for each age; budgets at the last age."""
    ages = list(dict.fromkeys((0.0, case.end_of_life)))
    with progress("units", options.units * len(ages)) as advance:
        budgets = [
            recalled(unit_budgets)(case, options.seed, options.units, age, progress=advance)
            for age in ages
        ]
    with_levels = bool(options.full or options.json or options.out)
    return [_values(at_age, required, with_levels) for at_age in budgets], budgets[-1]


def units_answer(units: UnitBudgets, required: tuple[Accuracy, ...]) -> str:
    """The error of the median unit with its limits, and the largest class of error.

    Both are medians over the units; in each unit, no class of error exceeds the error.
    """
    limits = {limit.name: limit for limit in required if limit.objective.rms_per_axis}
    medians = float(np.median(units.across())), float(np.median(units.about()))
    per_axis = {
        term: np.sqrt((errors[:, :2] ** 2).mean(axis=1)) for term, errors in units.terms.items()
    }
    classes = {term: float(np.median(errors)) / arcsec for term, errors in per_axis.items()}
    largest = max(classes, key=lambda term: classes[term])
    short = [
        f"{_yield_share(_yield_values(limit, share))} of the units keep {name}"
        for name, limit in limits.items()
        if (share := yield_of(limit, units_expected(limit.objective, units))).value < 1
    ]
    return "; ".join(
        [
            f"{errors_text(*medians, required, '.3g')} for the median of {len(units)} units at "
            f"{units.age / YEAR:g} yr, without bias",
            f"largest class across: {largest}, {classes[largest]:.3g} arcsec",
            *short,
            f"available in {100 * float(units.availability.mean()):.2f} % of the sky",
        ]
    )


def gains_of(
    case: Case, campaign: Campaign, changes: list[LeverChange], options: argparse.Namespace
) -> tuple[dict[str, Any], str]:
    """Gain and cost of each change of a design: values for JSON, and a table."""
    objective, needs = campaign.goal, campaign.requirements
    required, fraction = needs.accuracy, campaign.units or USUAL
    with progress("units", options.units * (1 + len(changes))) as advance:
        allocated = allocation(
            case, objective, required, fraction, options.seed, options.units, changes, advance
        )
    before = costs_of(needs, case)
    lever = any(change.text for change in changes)
    yields = [f"yield, {limit.name} (%)" for limit in required]
    costs = ["mass (g)", "power (mW)", "calibration (h)"] if lever else []
    rows = [["change" if lever else "halved", "gain (arcsec)", *yields, *costs, "price"]]
    entries = list[dict[str, Any]]()
    for gain in allocated.gains:
        after = costs_of(needs, gain.change.case)
        added = {name: after[name] - before[name] for name in before}
        added["price"] = gain.change.price or added["price"]
        entries.append(_gain_values(gain, added, required, lever))
        rows.append(_gain_row(gain, added, lever))
    values = {
        "objective": str(objective),
        "fraction": fraction,
        "age_years": allocated.age / YEAR,
        "level_arcsec": allocated.level / arcsec,
        "levers" if lever else "halved": entries,
    }
    text = [
        f"{objective} not exceeded by {100 * fraction:g} % of {options.units} units at "
        f"{allocated.age / YEAR:g} yr: {allocated.level / arcsec:.3f} arcsec",
        *aligned(rows, (0,)),
        *(f"not possible: {reason}" for reason in allocated.refused),
        "by the formula, on the same draws of the same units, with biases; brackets: 95 % "
        "intervals for other units",
    ]
    if lever:
        text.append(
            "gains do not add; a price of 0: no law gives the cost of better lens, detector or "
            "structure"
        )
    return values, "\n".join(text)


def _gain_values(
    gain: LeverGain, added: dict[str, float], required: tuple[Accuracy, ...], lever: bool
) -> dict[str, Any]:
    """A gain for JSON; `added`: additional costs of the change."""
    change = gain.change
    values = {
        "lever" if lever else "tolerance": change.name,
        "gain_arcsec": bounds_json(gain.level, ARCSEC),
        "yields": list(map(_yield_values, required, gain.yields)),
    }
    return values | ({"change": change.text, **added} if lever else {"price": change.price})


def _gain_row(gain: LeverGain, added: dict[str, float], lever: bool) -> list[str]:
    """A gain as a row of the table; `added`: additional costs of the change."""
    costs = [
        f"{1e3 * added['mass_kg']:+.3g}",
        f"{1e3 * added['power_w']:+.3g}",
        f"{added['calibration_h']:+.3g}",
    ]
    return [
        f"{gain.change.name} {gain.change.text}".strip(),
        bracketed(gain.level, "+.3f", arcsec),
        *(bracketed(share, "+.1f", 0.01) for share in gain.yields),
        *(costs if lever else []),
        f"{added['price']:.4g}",
    ]


def trials_of(
    case: Case, seed: int, sampling: Sampling, outcomes: Rows, required: tuple[Accuracy, ...]
) -> tuple[dict[str, Any], list[str]]:
    """Results of trials of units: errors, the yield of each accuracy, and the worst unit."""
    units = sampling.units
    assert isinstance(units, Units)
    by_unit, years, lines = per_unit(outcomes), units.age / YEAR, list[str]()
    values: dict[str, Any] = {"count": len(by_unit.unit), "age_years": years}
    for name, rms in (("across", by_unit.across), ("about", by_unit.about)):
        middle, high = (float(np.nanquantile(rms, part)) / arcsec for part in (0.5, 0.95))
        values |= {f"{name}_median_arcsec": middle, f"{name}_95_arcsec": high}
        lines.append(
            f"of {len(by_unit.unit)} units at {years:g} yr, rms {name}: {middle:.3f} arcsec in the "
            f"median, {high:.3f} in 95 %"
        )
    values["yields"], lacking = [], []
    for limit in required:
        fewest = design.fewest_trials_beyond(limit.objective)
        if units.trials < fewest:
            lacking.append(
                f"no yield of {limit.objective} at most {limit.most / arcsec:g} arcsec: it needs "
                f"--trials {fewest} for each unit, so that one trial exceeds the level"
            )
            continue
        share = _yield_values(limit, by_unit.meets(outcomes, limit.objective, limit.most))
        values["yields"].append(share)
        lines.append(f"{_yield_name(share)}: {_yield_share(share)}")
    worst, lines = by_unit.worst, lines + lacking
    if worst is not None and sampling.fidelity is design.Fidelity.COVARIANCE:
        parts = explain(case, seed, units, worst)
        values["worst"] = {"unit": worst, "removes": dict(parts)}
        shown = "; ".join(f"{name} {100 * part:+.0f} %" for name, part in parts[:4])
        lines.append(
            f"worst unit {worst}; change of its rms across with the value as designed: {shown}"
        )
    return values, lines


def _yield_values(limit: Accuracy, share: Interval) -> dict[str, Any]:
    """A yield for JSON: requirement, limit, and fraction of the units with its 95 % interval."""
    return {"requirement": str(limit.objective), "most_arcsec": limit.most / arcsec} | asdict(share)


def _yield_name(values: dict[str, Any]) -> str:
    return f"yield, {values['requirement']} at most {values['most_arcsec']:g} arcsec"


def _yield_share(values: dict[str, Any]) -> str:
    value, low, high = (100 * values[end] for end in ("value", "low", "high"))
    return f"{value:.0f} % [{low:.0f}, {high:.0f}]"


def _values(
    budgets: UnitBudgets, required: tuple[Accuracy, ...], with_levels: bool
) -> dict[str, Any]:
    levels = {
        kind.value: {
            f"{100 * fraction:g}": {
                name: budgets.level(axes, fraction, kind) / arcsec for name, axes in AXES.items()
            }
            for fraction in LEVELS
        }
        for kind in (Interpretation if with_levels else ())
    }
    return {
        "age_years": budgets.age / YEAR,
        "units": len(budgets),
        "classes_rms_arcsec": {
            term.value: _pair(errors) for term, errors in _classes(budgets).items()
        },
        "rms_arcsec": {
            name: {"median": float(np.median(rms)) / arcsec, "worst": float(rms.max()) / arcsec}
            for name, rms in (("across", budgets.across()), ("about", budgets.about()))
        },
        "as_published_arcsec": {
            name: _pair(_sum(budgets, terms)) for name, terms in PUBLISHED.items()
        },
        "levels_arcsec": levels,
        "yields": [
            _yield_values(limit, yield_of(limit, units_expected(limit.objective, budgets)))
            for limit in required
        ],
    }


def _classes(budgets: UnitBudgets) -> dict[Term, Floats]:
    return {Term.BIAS: budgets.bias} | budgets.terms


def _sum(budgets: UnitBudgets, terms: tuple[Term, ...]) -> Floats:
    """Root sum square (n, 3) of classes of error of each unit, radian."""
    every = _classes(budgets)
    square = [every[term] ** 2 for term in terms if term in every]
    return np.asarray(np.sqrt(np.sum(square, axis=0)) if square else np.zeros_like(budgets.bias))


def _pair(values: Floats) -> dict[str, float]:
    """Rms over the units, per axis."""
    mean = (values**2).mean(axis=0)
    return {
        "across": float(np.sqrt(mean[:2].mean())) / arcsec,
        "about": float(np.sqrt(mean[2])) / arcsec,
    }


def units_text(ages: list[dict[str, Any]], full: bool) -> str:
    """The values of `budgets_of` as a table with two columns for each age; `full`: all rows."""
    years = [f"{values['age_years']:g} yr" for values in ages]

    def row(label: str, pairs: list[dict[str, float]]) -> str:
        return _row(label, [f"{pair[axis]:.3f}" for pair in pairs for axis in AXES])

    head = [f"{axis}, {age}" for age in years for axis in AXES]
    lines = [_row(f"{ages[0]['units']} units, arcsec", head)]
    for name in ages[0]["classes_rms_arcsec"]:
        lines.append(row(f"{name}, rms per axis", [at["classes_rms_arcsec"][name] for at in ages]))
    lines.append("-" * len(lines[0]))
    for name in PUBLISHED if full else BRIEF:
        lines.append(row(f"{name}, 1 sigma", [at["as_published_arcsec"][name] for at in ages]))
        triple = [{axis: 3 * at["as_published_arcsec"][name][axis] for axis in AXES} for at in ages]
        lines.append(row(f"{name}, 3 sigma", triple))
    for which in ("median", "worst"):
        pairs = [{axis: at["rms_arcsec"][axis][which] for axis in AXES} for at in ages]
        lines.append(row(f"all but bias, rms, {which} unit", pairs))
    for kind, levels in ages[0]["levels_arcsec"].items() if full else ():
        for level in levels:
            pairs = [at["levels_arcsec"][kind][level] for at in ages]
            lines.append(row(f"{level} % below, {kind}", pairs))
    for yields in zip(*(at["yields"] for at in ages), strict=True):
        shares = [
            f"{_yield_share(share)} at {age}" for age, share in zip(years, yields, strict=True)
        ]
        lines.append(f"{_yield_name(yields[0])}: {', '.join(shares)}")
    lines.append(
        "by the formula, per axis; the bias of a unit is constant; it counts in yields, but not "
        "in other rows below it"
    )
    last = ages[-1]["classes_rms_arcsec"]
    lines += [
        f"{term} ({last[term]['across']:.3g} arcsec across): {text}"
        for term, text in ADVICE.items()
        if last.get(term, {}).get("across", 0.0) > 0
    ]
    lines.append("`startrack what-matters` prints gain and cost of a step of each")
    return "\n".join(lines)


def _row(label: str, cells: list[str]) -> str:
    return f"{label:36s}" + "".join(f"{cell:>16s}" for cell in cells)
