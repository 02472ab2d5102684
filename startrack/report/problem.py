"""The page of a problem: question, trials and formulas, verdicts, sensitivity."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from startrack.core import Rows
from startrack.metrics import Interval, bracketed, end_text
from startrack.optimise import Sensitivity, verdicts
from startrack.plots import BLACK, BLUE, SMALL, bars_of, styled, with_unit
from startrack.problem import Expectation, Judgement, Problem
from startrack.report.page import WIDE, PagePicture, Section, code, page, panels, paragraph, table

COLUMNS = 8  # largest number of columns with drawn distributions
BINS = 30


def write_problem_report(
    problem: Problem, rows: Rows, studied: Sequence[Sensitivity], title: str, author: str = ""
) -> str:
    """The page as HTML.

    rows     of trials
    studied  sensitivities; empty: the page has no section for them
    """
    judged, expected = problem.judge(rows), problem.expect()
    lead = (
        f"{problem.text().value} by {len(rows)} trials beside what formulas expect. "
        f"Intervals hold 95 %, each alone.{f' {author}.' if author else ''}"
    )
    sections = [
        Section("Question", _question(problem)),
        Section("Results", _results(problem, judged, expected)),
        Section("Requirements", _requirements(problem, judged)),
        Section("Distributions", _distributions(rows)),
    ]
    if studied:
        sections.append(Section("Sensitivity", _sensitivity(problem, studied)))
    left_out = "; ".join(expected.left_out) or "no known effect"
    sections.append(
        Section("Not counted", paragraph(f"Left out of formulas and trials: {left_out}."))
    )
    sections.append(Section("Inputs", code("All inputs of the results", problem.described())))
    return page(title, lead, sections)


def _question(problem: Problem) -> str:
    words, rows = problem.text(), list[list[str]]()
    for variable in problem.variables:
        values = variable.start, variable.low, variable.high
        rows.append([variable.name, *map(variable.shown, values)])
    asked = paragraph(f"Objective, to be minimised: {with_unit(words.value, words.unit)}.")
    if not rows:
        return asked
    return asked + table("Variables of a search", ("variable", "is", "from", "to"), rows)


def _results(problem: Problem, judged: Judgement, expected: Expectation) -> str:
    words = problem.text()
    values = {words.value: (judged.value, expected.value, words.unit)}
    for name, part in judged.parts.items():
        title, unit = words.parts[name]
        values[title] = part, expected.parts.get(name, math.nan), unit
    rows = [
        [
            name,
            end_text(tried.value, ".4g"),
            f"{end_text(tried.low, '.4g')} to {end_text(tried.high, '.4g')}",
            f"{formula:.4g}",
            unit,
        ]
        for name, (tried, formula, unit) in values.items()
    ]
    head = "", "by trials", "95 %", "by formula", "unit"
    shown = table("Trials beside formulas", head, rows)
    ratios = {
        name: _over(tried, formula) for name, (tried, formula, _) in values.items() if formula > 0
    }
    picture = PagePicture(_ratios(ratios), "trials over formula, with 95 % intervals")
    return shown + panels([picture], "ratios", "Trials over formula; 1: both agree")


def _over(tried: Interval, formula: float) -> Interval:
    return Interval(tried.value / formula, tried.low / formula, tried.high / formula)


@styled
def _ratios(ratios: dict[str, Interval]) -> Figure:
    figure = Figure((WIDE, 1.2 + 0.45 * len(ratios)), layout="constrained")
    axes = figure.subplots()
    for y, ratio in enumerate(ratios.values()):
        if math.isfinite(ratio.value):
            axes.errorbar(ratio.value, y, xerr=bars_of(ratio), fmt="o", ms=4, color=BLUE)
    axes.axvline(1.0, color=BLACK, lw=1)
    axes.set_yticks(range(len(ratios)), [_folded(name) for name in ratios], fontsize=SMALL)
    axes.set(xlabel="trials over formula")
    axes.invert_yaxis()
    return figure


def _folded(name: str) -> str:
    """The text, in two lines if it is long."""
    if len(name) < 24:
        return name
    at = name.rfind(" ", 0, len(name) // 2 + 6)
    return f"{name[:at]}\n{name[at + 1 :]}"


def _requirements(problem: Problem, judged: Judgement) -> str:
    costs = dict(problem.costs())
    every = costs | {name: margins[0] for name, margins in judged.margins.items()}
    rows = [
        [
            name,
            f"{every[name].value:.4g}",
            f"{'at most' if every[name].most else 'at least'} {every[name].limit:.4g}",
            every[name].unit,
            f"{every[name].relative:+.3f}",
            verdict if verdict == "met" else verdict.upper(),
        ]
        for name, verdict in verdicts(costs, judged).items()
    ]
    if not rows:
        return paragraph("The problem has no limits.")
    head = "requirement", "value", "limit", "unit", "margin", "verdict"
    return table("Margins are fractions of the limits", head, rows)


def _distributions(rows: Rows) -> str:
    names = [name for name in rows.dtype.names or () if np.isfinite(rows[name]).any()][:COLUMNS]
    pictures = [PagePicture(_histogram(rows, name), f"distribution of {name}") for name in names]
    return panels(pictures, "columns", "Of the trials; values that are not finite are left out")


@styled
def _histogram(rows: Rows, name: str) -> Figure:
    figure = Figure((WIDE, 2.4), layout="constrained")
    axes = figure.subplots()
    values = rows[name][np.isfinite(rows[name])]
    axes.hist(values, BINS, color=BLUE)
    axes.set(xlabel=name, ylabel="trials")
    return figure


def _sensitivity(problem: Problem, studied: Sequence[Sensitivity]) -> str:
    rows = [
        [
            row.name,
            f"{row.low:.4g} to {row.high:.4g}",
            f"{row.slope:+.2f}",
            f"{row.first.value:z.2f}",
            bracketed(row.total, "z.2f"),
        ]
        for row in studied
    ]
    words = problem.text()
    head = "variable", "at its bounds", "slope", "first-order index", "total index"
    caption = (
        f"{with_unit(words.value, words.unit)} by forecast: at the bounds of each variable alone, "
        "d ln objective / d ln variable, and Sobol indices of ln(objective)"
    )
    return table(caption, head, rows)
