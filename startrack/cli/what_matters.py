"""`startrack what-matters`: sensitivity of the error and the margins of a design."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

from startrack.cli.options import (
    Exit,
    Option,
    Options,
    WrongUse,
    power_of_two,
    study,
    wanted,
    whole,
)

if wanted(__name__):
    from startrack import optimise, plots
    from startrack.cli import terminal
    from startrack.cli.campaign import open_runner, read_study
    from startrack.cli.units import gains_of
    from startrack.design import Campaign, Case, DesignSpace
    from startrack.io import finite, save_json, save_text
    from startrack.metrics import PERCENT, PURE, Column, Interval, Table
    from startrack.optimise import Influence, Tolerance, TrackerSource, WhatMatters
    from startrack.report import write_study_page
    from startrack.verification import margins as margins_of

# forecasts for the estimate of the time, and minutes above which it is printed
TIMED, LONG = 4, 2.0
UNITS = 6  # default number of units of a design that varies from unit to unit
FEW = 3  # largest number of variables, steps or margins in a sentence
# Least share of the variance of a variable that matters.
NOTHING = 0.01
LITTLE = 1e-3  # least relative change of the objective by a useful step
# Costs in tables: title, size and name of the unit.
COSTS = {
    "mass_kg": ("mass", 1e3, "g"),
    "power_w": ("power", 1e3, "mW"),
    "calibration_h": ("calibration", 1.0, "h"),
    "price": ("price", 1.0, ""),
}
MEANING = (
    "All values are forecasts, without trials. Variables of [campaign]: effect of an increase by "
    "1 % (by 1 % of the range at zero) on the objective, on the tightest margin and on the "
    "costs; the objective with the variable alone at its bounds; the total Sobol index of "
    "ln(objective) over the ranges, with the 95 % interval of the emulator; and the range in "
    "which the objective stays within {precision:g} % of {best}, while the other variables are "
    "optimised. Margins are fractions of their limits; the margin of stars in the sky is in "
    "magnitudes."
)
STEPS = (
    "Steps of parameters that the campaign does not vary, by budgets {of}. Gains do not add; an "
    "empty cost: no law gives the cost of better lens, detector or structure."
)

declare = Options(
    "Prints the sensitivity of a design's error and of its tightest margin, by forecasts: a row "
    "for each variable of [campaign], with its effect, its Sobol index with an interval, and the "
    "range in which the error stays within `precision` of the best; and a row for each lever and "
    "tolerance, with gain and cost of a step. Without a campaign only levers and tolerances are "
    "printed. Writes what-matters.md, what-matters.html, tornado.png, result.json and "
    "ledger.sqlite, from which the same command continues.",
    *study("what-matters"),
    Option(
        "--full",
        "also print slopes, first-order indices, every margin, limits missed at the bounds, all "
        "steps, and the region in which all variables may vary together (emcee; corner.png)",
    ),
    Option(
        "--designs N",
        "number of designs over the ranges for the Sobol indices, a power of two",
        power_of_two,
        64,
    ),
    Option(
        "--units N",
        "number of units for levers and tolerances at the end of life; 0: leave them out "
        f"(default: {UNITS} if the design varies from unit to unit, else the design itself)",
        whole(0, 10**4),
    ),
    problems=True,
)


class MatterRow(NamedTuple):
    """A variable of a campaign, or a step of a lever or tolerance.

    objective  relative change
    margin     change of the tightest margin; empty if the step does not change it
    over       objective at the bounds
    total      total Sobol index; empty for steps
    """

    name: str
    value: str
    step: str
    objective: float | Interval
    margin: float | str
    costs: str
    over: str = ""
    total: Interval | str = ""
    span: str = ""


class Steps(NamedTuple):
    """Rows of levers and tolerances, their description, and their values for JSON."""

    rows: tuple[MatterRow, ...] = ()
    text: str = ""
    values: Mapping[str, Any] = {}


def command(options: argparse.Namespace) -> int:
    """Write the table, its page, tornado.png and result.json; print the answer and the table."""
    path = options.campaign or terminal.example()
    design = terminal.read_design(path, options.set)
    if not (design.asked and design.asked.variables):
        steps = _steps(options, design.case, design.asked or Campaign())
        return _write_steps_alone(options, steps)
    opened, region = read_study(options), None
    case, campaign = opened.design.case, opened.campaign
    with open_runner(options, opened, "computing what matters in") as runner:
        space = DesignSpace(case, campaign.variables, campaign.links)
        source = TrackerSource(space, campaign.of_errors, runner)
        found = forecast(options, source)
        if options.full:
            region = sampled_region(source)
    objective = campaign.goal_of(case)
    steps = _steps(options, case, campaign, found.tightest, source.names)
    return write_what_matters(options, source, found, objective, "_arcsec", steps, region)


def forecast(options: argparse.Namespace, source: Any) -> WhatMatters:
    """Forecast the sensitivities of a source's designs."""
    needed = optimise.forecasts_needed(len(source.names), options.designs)
    with terminal.progress("forecasts", needed) as advance:
        return optimise.what_matters(source, options.designs, _timed(advance, needed))


def _timed(advance: Callable[[int], None], needed: int) -> Callable[[int], None]:
    """The forecasts, with one message on the time if it is long."""
    begun, done = time.monotonic(), 0

    def count(number: int) -> None:
        nonlocal done
        before, done = done, done + number
        advance(number)
        if before < TIMED <= done:
            minutes = (time.monotonic() - begun) / done * needed / 60
            if minutes > LONG:
                terminal.print_message(
                    f"startrack: {needed} forecasts take about {minutes:.0f} min; fewer --designs "
                    "take less"
                )

    return count


def sampled_region(source: Any) -> Tolerance:
    """The region in which all variables may vary together."""
    needed = optimise.designs_needed(len(source.names))
    with terminal.progress("designs of the region", needed) as advance:
        return optimise.sample(source, advance)


def _steps(
    options: argparse.Namespace,
    case: Case,
    campaign: Campaign,
    tightest: str = "",
    varied: Collection[str] = (),
) -> Steps:
    """Levers and tolerances that are not among the variables of the campaign.

    tightest  name of the tightest margin; rows have it if it needs no trial
    """
    # One unit suffices for a design whose units are all equal.
    count = UNITS if options.units is None else options.units
    options.units = min(count, 1) if not case.differs else count
    named = {change.name: change for change in (*optimise.halved(case), *optimise.levers(case))}
    changes = [change for name, change in named.items() if name not in varied]
    if not options.units or not changes:
        return Steps()
    values, _ = gains_of(case, campaign, changes, options)
    needs, rows = campaign.requirements, list[MatterRow]()
    left = margins_of(needs, case).get(tightest)
    for entry in values["levers"]:
        name, gain = entry["lever"], entry["gain_arcsec"]
        ends = (-gain[end] / values["level_arcsec"] for end in ("value", "high", "low"))
        effect = Interval(*ends)
        margin: float | str = ""
        if left is not None:
            margin = margins_of(needs, named[name].case)[tightest] - left
        rows.append(
            MatterRow(
                name,
                "",
                entry["change"] or "halved",
                effect if options.units > 1 else effect.value,
                margin,
                _costs_text({cost: entry[cost] for cost in COSTS}),
            )
        )
    of = "of the design as designed"
    if options.units > 1:
        of = (
            f"of {options.units} units at the end of life ({100 * values['fraction']:g} % of "
            "them do not exceed the error; brackets: 95 % intervals for other units)"
        )
    return Steps(tuple(rows), STEPS.format(of=of), values)


def _costs_text(costs: Mapping[str, float]) -> str:
    """Changes of costs, without zero changes."""
    parts = list[str]()
    for name, change in costs.items():
        title, size, unit = COSTS.get(name, (name, 1.0, ""))
        text = f"{size * change:+.3g}"
        if float(text):
            parts.append(f"{title} {text} {unit}".strip())
    return ", ".join(parts)


def _write_steps_alone(options: argparse.Namespace, steps: Steps) -> int:
    """Print and write levers and tolerances of a design without a campaign."""
    if not steps.rows:
        raise WrongUse(
            "the design must have [campaign] with variables, or levers and --units above 0"
        )
    first = steps.rows[0]
    answer = (
        f"{first.name} {first.step} has the largest gain: it changes the error by "
        f"{_per_cent(first.objective)}; the design has no [campaign] with variables"
    )
    result = {"out": str(options.out), "answer": answer, "changes": steps.values}
    return _write(options, [answer, steps.text], _table(steps.rows, "", "", 0.0), result, [])


def write_what_matters(
    options: argparse.Namespace,
    source: Any,
    found: WhatMatters,
    objective: str,
    ending: str = "",
    steps: Steps = Steps(),  # noqa: B008, never changed
    region: Tolerance | None = None,
) -> int:
    """Print and write the sensitivities.

    ending  ending of JSON fields in the unit of the objective
    region  region in which all variables may vary together
    """
    unit, labels = source.unit.name, source.labels()
    answer = _answer(found, objective, unit, labels, steps)
    rows = [_row(source, found, influence) for influence in found.ordered]
    shown = _table((*rows, *steps.rows), found.tightest, unit, source.precision)
    best = f"the best of {found.count} forecasts, {_text(math.exp(found.best.expected))}"
    if not found.met:
        best += ", which misses a limit, as do all forecast designs"
    meaning = MEANING.format(precision=100 * source.precision, best=f"{best} {unit}".strip())
    studied = [influence.sensitivity for influence in found.influences]
    picture = options.out / "tornado.png"
    plots.draw_tornado(picture, studied, objective, unit)
    more = list[Table]()
    if options.full:
        more = [_details(found, labels, ending), _all_margins(found, labels)]
    result: dict[str, Any] = {"out": str(options.out), "answer": answer, "objective": objective}
    result |= {f"error{ending}": math.exp(found.here.expected), "margins": found.here.margins}
    result |= {"tightest": found.tightest, f"best{ending}": math.exp(found.best.expected)}
    result |= {"best_meets_all": found.met, "possible_gain": found.left, "forecasts": found.count}
    result["variables"] = {
        influence.sensitivity.name: values | _influence_values(source, influence)
        for influence, values in zip(
            found.ordered, _details(found, labels, ending).json(), strict=True
        )
    }
    result["changes"] = steps.values
    texts, pictures = [answer, meaning, steps.text], {"Variables": picture}
    together = ""
    if region is not None:
        result["region"] = optimise.tolerance_values(region)
        together = optimise.tolerance_table(region)
        if region.chains.converged:
            pictures["Variables that vary together"] = options.out / "corner.png"
            plots.draw_tolerance(options.out / "corner.png", region)
    return _write(options, texts, shown, result, more, pictures, together)


def _answer(
    found: WhatMatters, objective: str, unit: str, labels: Mapping[str, str], steps: Steps
) -> str:
    """The largest sensitivities, in a sentence."""
    order = found.ordered
    decide = [influence for influence in order if influence.sensitivity.total.value >= NOTHING]
    idle = [influence for influence in order if influence not in decide]
    parts = [f"{objective} {math.exp(found.here.expected):.3g} {unit}".strip()]
    shares = ", then ".join(
        f"{labels[influence.sensitivity.name]} "
        f"({100 * optimise.share(influence.sensitivity.total).value:.0f} %)"
        for influence in decide[:FEW]
    )
    if len(order) > 1:
        # Total indices, whose sum exceeds 100 % where parameters interact.
        parts.append(f"shares of its variance over the ranges, with interactions: {shares}")
    steepest = max(order, key=lambda influence: abs(influence.change))
    name = labels[steepest.sensitivity.name]
    parts.append(f"here 1 % more of {name} changes it by {_per_cent(steepest.change)}")
    if found.tightest:
        tight = (
            f"the tightest margin is {found.tightest}, {found.here.margins[found.tightest]:+.3g}"
        )
        moving = max(order, key=lambda influence: abs(influence.margins.get(found.tightest, 0.0)))
        if by := moving.margins.get(found.tightest, 0.0):
            tight += f", which {labels[moving.sensitivity.name]} moves most ({by:+.2g} by 1 %)"
        parts.append(tight)
    if steps.rows:
        first = steps.rows[0]
        if _middle(first.objective) < -LITTLE:
            buys = f"{first.name} {first.step} has the largest gain ({_per_cent(first.objective)})"
        else:
            buys = f"none buys {100 * LITTLE:g} %"
        parts.append(f"among other steps, {buys}")
    if idle:
        names = ", ".join(labels[influence.sensitivity.name] for influence in idle)
        parts.append(f"{names} do{'es' * (len(idle) == 1)} not matter")
    return "; ".join(parts)


def _row(source: Any, found: WhatMatters, influence: Influence) -> MatterRow:
    sensitivity, span = influence.sensitivity, influence.span
    name = sensitivity.name
    low, high = (source.shown(end)[name] for end in (span.at_low, span.at_high))
    ends = low if low == high else f"{low} to {high}"
    return MatterRow(
        name=source.labels()[name],
        value=source.shown()[name],
        step="+1 %",
        objective=influence.change,
        margin=influence.margins.get(found.tightest, ""),
        costs=_costs_text(influence.costs),
        over=f"{_text(sensitivity.low)} to {_text(sensitivity.high)}",
        total=optimise.share(sensitivity.total),
        span=f"{ends} (any)" if span.everywhere else ends,
    )


def _influence_values(source: Any, influence: Influence) -> dict[str, Any]:
    """The further figures of a variable, for JSON."""
    name, span = influence.sensitivity.name, influence.span
    ends = [source.values(end)[name] for end in (span.at_low, span.at_high)]
    return {
        "value_si": source.start_values[name],
        "per_cent": influence.change,
        "per_cent_margins": dict(influence.margins),
        "per_cent_costs": dict(influence.costs),
        "missed_at_low": list(influence.missed[0]),
        "missed_at_high": list(influence.missed[1]),
        "range_si": ends,
        "any": span.everywhere,
    }


def _table(rows: Collection[MatterRow], tightest: str, unit: str, precision: float) -> Table:
    columns = [
        Column("", "what", lambda row: row.name),
        Column("", "is", lambda row: row.value),
        Column("", "step", lambda row: row.step),
        Column("", "objective", lambda row: row.objective, PERCENT, "+.2f"),
        Column("", f"margin: {tightest}", lambda row: row.margin, PURE, "+.2g"),
        Column("", "costs", lambda row: row.costs),
        Column("", plots.with_unit("at its bounds", unit), lambda row: row.over),
        Column("", "total index", lambda row: row.total, form="z.2f"),
        Column("", f"within {100 * precision:g} % of the best", lambda row: row.span),
    ]
    if not tightest:
        columns = [column for column in columns if not column.title.startswith("margin")]
    if not any(row.over for row in rows):
        columns = [column for column in columns[:-3] if column.title != "is"]
    return Table(columns, list(rows))


def _details(found: WhatMatters, labels: Mapping[str, str], ending: str) -> Table:
    """Slopes, indices and limits of the variables, the most important first."""

    def missed(influence: Influence) -> str:
        ends = zip(("low", "high"), influence.missed, strict=True)
        return "; ".join(f"{end}: {', '.join(names)}" for end, names in ends if names)

    return Table(
        [
            Column("", "variable", lambda row: labels[row.sensitivity.name]),
            Column(f"low{ending}", "", lambda row: row.sensitivity.low),
            Column(f"high{ending}", "", lambda row: row.sensitivity.high),
            Column("slope", "", lambda row: row.sensitivity.slope),
            Column("", "d ln objective / d ln variable", lambda row: _slope(row.sensitivity.slope)),
            Column("first", "first-order index", lambda row: row.sensitivity.first, form="z.2f"),
            Column("total", "total index", lambda row: row.sensitivity.total, form="z.2f"),
            Column("", "missed at its bounds", missed),
        ],
        found.ordered,
    )


def _all_margins(found: WhatMatters, labels: Mapping[str, str]) -> Table:
    """Effect of 1 % of each variable on each margin."""

    def column(margin: str) -> Column:
        left = found.here.margins[margin]
        title = f"{margin} {left:+.3g}"
        return Column("", title, lambda row: row.margins.get(margin, math.nan), form="+.2g")

    margins = map(column, found.here.margins)
    name = Column("", "+1 % of", lambda row: labels[row.sensitivity.name])
    return Table([name, *margins], found.ordered)


def _write(
    options: argparse.Namespace,
    texts: list[str],
    shown: Table,
    result: dict[str, Any],
    more: list[Table],
    pictures: Mapping[str, Any] = {},
    together: str = "",
) -> int:
    """Write Markdown, page and JSON; print the answer, the table and its meaning.

    together  Markdown of the region in which all variables may vary together
    """
    answer, *meanings = [text for text in texts if text]
    tables = [shown, *more]
    parts = [answer, *("\n".join(table.markdown()) for table in tables), *meanings]
    parts += [together] if together else []
    save_text(options.out / "what-matters.md", "\n\n".join(parts) + "\n")
    title = f"What matters in {(options.campaign or terminal.example()).stem}"
    named = {"The region in which all variables vary together": together} if together else {}
    html = write_study_page(title, answer, tables, meanings, pictures, named)
    save_text(options.out / "what-matters.html", html)
    save_json(options.out / "result.json", finite(result))
    lines = [line for table in tables for line in ("", *table.text((0, 1, 2)))]
    where = f"results are in {options.out}, what-matters.html has all"
    terminal.print_result(
        options, result, answer, *lines, "", *meanings, *filter(None, [together]), where
    )
    return Exit.DONE


def _middle(effect: float | Interval) -> float:
    return effect.value if isinstance(effect, Interval) else effect


def _per_cent(effect: float | Interval) -> str:
    return f"{100 * _middle(effect):+.2g} %"


def _slope(slope: float) -> str:
    return "none at zero" if math.isnan(slope) else f"{slope:+.2f}"


def _text(error: float) -> str:
    if not math.isfinite(error):
        return "no forecast"
    return f"{error:.3f}" if error >= 1 else f"{error:.3g}"
