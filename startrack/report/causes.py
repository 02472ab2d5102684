"""The error budget of a design, analytic and measured, as a section of the page."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from startrack.budget import (
    Budget,
    Line,
    Sample,
    analytic,
    caveats,
    differences,
    measured,
)
from startrack.core import Refused, arcsec
from startrack.design import Case
from startrack.metrics import Summary, rms_interval
from startrack.montecarlo import Serial
from startrack.report.page import Section, paragraph, table

TITLE = "Error budget"


def budget(
    case: Case, seed: int, members: int, summary: Summary, advance: Callable[[int], None]
) -> Section:
    """Each cause in the terms of ECSS-E-ST-60-20C, analytic and measured; or why there is none.

    summary  of the campaign's trials, with which the formulas are compared

    A detector that scans has no budget, nor has a design that finds no attitude.
    """
    try:
        expected = analytic(case)
        found = measured(case, members, seed, Serial(), progress=advance)
    except Refused as error:
        return Section(TITLE, paragraph(f"There is none for this design: {error}."))
    beside = {line.name: line for line in found.lines}
    named = {line.name: line for line in expected.lines}
    rows = []
    for name in [*named, *(name for name in beside if name not in named)]:
        pair = named.get(name), beside.get(name)
        term = next(line.term.value for line in pair if line and line.term)
        rows.append([name, term, *_cells(pair[0]), *_intervals(pair[1])])
    rows.append(["root sum square", "", *_sum(expected), *_sum(found)])
    rows.append(["end to end", "", *_cells(expected.whole), *_intervals(found.whole)])
    head = ["cause", "term", "across", "about", "across, measured", "about, measured"]
    return Section(
        TITLE,
        table("Rms per axis, arcsec", head, rows)
        + paragraph(
            "By the analytic budget an attitude is available in "
            f"{100 * expected.availability:.2f} % of the sky with {expected.stars:.1f} stars; "
            f"over {members} trials, in which each cause is switched off in turn, "
            f"in {100 * found.availability:.2f} % with {found.stars:.1f}."
        )
        + "".join(
            paragraph(f"{one[0].upper()}{one[1:]}.")
            for one in (
                *caveats(case, expected.left_out, expected.refused),
                *(f"formula and trials differ: {one}" for one in differences(expected, summary)),
            )
        ),
    )


def _cells(line: Any) -> list[str]:
    if line is None:
        return ["none", "none"]
    return [f"{line.across / arcsec:.3f}", f"{line.about / arcsec:.3f}"]


def _intervals(line: Line[Sample] | None) -> list[str]:
    """Measured, with their 95 % intervals over the members."""
    if line is None:
        return ["none", "none"]
    square = (line.spread.error**2).mean(axis=1)
    found = rms_interval(square[:, :2].mean(axis=1)), rms_interval(square[:, 2])
    return [
        f"{one.value / arcsec:.3f} [{one.low / arcsec:.3f}, {one.high / arcsec:.3f}]"
        for one in found
    ]


def _sum(one: Budget[Any]) -> list[str]:
    across, about = one.sum
    return [f"{across / arcsec:.3f}", f"{about / arcsec:.3f}"]
