"""A mission as one HTML page: requirements, heads, times without attitude, beta angle, checks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import tomli_w

from startrack.core import arcsec, deg
from startrack.io import to_table
from startrack.mission import (
    EDGES,
    Availability,
    Blind,
    Checked,
    Flown,
    Plan,
    Spells,
    Verdict,
    over_beta,
    reacquisition_of,
)
from startrack.report.page import Section, code, embedded, page, paragraph, table

DAY = 86400.0
MOST = 10  # rows of a list of the worst


def write_mission_report(
    plan: Plan,
    flown: Flown,
    found: Availability,
    met: Sequence[Verdict],
    checks: Sequence[Checked],
    pictures: Sequence[tuple[str, Path]],
    title: str,
) -> str:
    """The page as HTML.

    pictures  caption and PNG file of each, which the page holds itself
    """
    time = plan.loaded.mission.time
    lead = (
        f"{time.steps} steps of {time.step:g} s from {time.begin} UTC, {len(plan.heads)} heads, "
        f"{100 * flown.eclipse.mean():.1f} % of the time in eclipse. Begins and ends of times are "
        "right to a step."
    )
    sections = [
        _requirements(met),
        _heads(plan, flown, found),
        _errors(plan, flown, checks),
        _blinded(plan, found),
        _reacquired(plan, flown),
        _beta(flown),
        Section("Pictures", "".join(embedded(caption, file) for caption, file in pictures)),
        Section(
            "Inputs",
            code(
                "Mission, with the paths of its files", tomli_w.dumps(to_table(plan.loaded.mission))
            ),
        ),
    ]
    return page(title, lead, sections)


def _requirements(met: Sequence[Verdict]) -> Section:
    if not met:
        return Section("Requirements", paragraph("The mission names no requirement."))
    rows = []
    for one in met:
        size = arcsec if one.name == "max_error" else 1.0
        rows.append([
            one.name, f"{one.value / size:.6g}", f"{one.limit / size:.6g}",
            {"max_error": "arcsec", "max_blind": "s"}.get(one.name, "of the time"),
            "met" if one.met else "NOT MET",
        ])  # fmt: skip
    return Section(
        "Requirements",
        table("Requirements of the mission", ["name", "value", "required", "unit", ""], rows),
    )


def _heads(plan: Plan, flown: Flown, found: Availability) -> Section:
    rows = []
    for h, head in enumerate(plan.heads):
        causes = [f"{100 * found.causes[one][h]:.2f}" for one in Blind]
        rows.append([
            head.name, *causes, f"{100 * (1 - found.alone[h]):.2f}",
            f"{found.each[h].longest / 60:.1f}",
        ])  # fmt: skip
    names = ["head", "Sun", "Moon", "Earth", "ground", "SAA", "structure", "any", "longest (min)"]
    many = [
        [f"{count}", f"{100 * found.at_least(count):.4f}", f"{100 * found.heads[count:].sum():.4f}"]
        for count in range(len(plan.heads), 0, -1)
    ]
    body = table("Blind, % of the time; a time may have several causes", names, rows)
    return Section(
        "Heads",
        body
        + table(
            "Fraction of the time with at least so many heads, %",
            ["heads", "with attitudes", "not blind"],
            many,
        ),
    )


def _errors(plan: Plan, flown: Flown, checks: Sequence[Checked]) -> Section:
    rows = []
    for h, head in enumerate(plan.heads):
        count, across, about, _ = flown.head_sum[h] / max(flown.head_sum[h, 0], 1)
        if count:
            rows.append([head.name, f"{across**0.5 / arcsec:.3g}", f"{about**0.5 / arcsec:.3g}"])
    body = table(
        "Rms error of each head while it is valid, arcsec", ["head", "across", "about"], rows
    )
    fused = [[axis, f"{one / arcsec:.3g}"] for axis, one in zip("xyz", flown.rms, strict=True)]
    body += table("Rms error of the fused attitude about the axes, arcsec", ["axis", "rms"], fused)
    if not checks:
        body += paragraph(
            "By the error budget, which no trial checked (check.trials of the mission file)."
        )
    for one in checks:
        names = ", ".join(plan.heads[h].name for h in one.heads)
        values = [
            ["across", *map("{:.3f}".format, one.across + one.corrected_across)],
            ["about", *map("{:.3f}".format, one.about + one.corrected_about)],
        ]
        columns = ["", "of the budget", "+-", "corrected, on the other half", "+-"]
        body += table(
            f"{names}: rms of {one.trials} trials over the expected rms, with standard errors; "
            f"{one.attitudes} attitudes, {one.expected:.1f} expected",
            columns,
            values,
        )
    moments = [[f"{s:.0f}", f"{s / DAY:.3f}", f"{e / arcsec:.3g}"] for s, e in flown.worst[:MOST]]
    body += table(
        "Worst moments: error about the worst axis, the largest of each part of the mission",
        ["second", "day", "arcsec rms"],
        moments,
    )
    return Section("Errors", body)


def _blinded(plan: Plan, found: Availability) -> Section:
    every = {"no head valid": found.none, **dict(zip(_names(plan), found.each, strict=True))}
    head = ["", *(f"to {high:g} s" for high in EDGES[1:-1]), "longer", "longest (s)"]
    rows = [
        [name, *(str(int(n)) for n in one.histogram()), f"{one.longest:g}"]
        for name, one in every.items()
    ]
    return Section(
        "Blindings",
        table("How often a head is blind for so long", head, rows) + _longest(found.none),
    )


def _longest(none: Spells) -> str:
    if not len(none.length):
        return paragraph("A head is valid at all times.")
    rows = [[f"{a:.0f}", f"{a / DAY:.3f}", f"{b:g}"] for a, b in none.worst(MOST)]
    return table(
        "Longest times without a valid head", ["begin (s)", "begin (day)", "length (s)"], rows
    )


def _reacquired(plan: Plan, flown: Flown) -> Section:
    rows = []
    for h, head in enumerate(plan.heads):
        one = reacquisition_of(plan.loaded.designs[h].case, flown.chances[h])
        if one.times:
            rows.append([head.name, str(one.times), f"{one.mean:.3g}", f"{one.level:.3g}"])
    if not rows:
        return Section("Reacquisition", paragraph("No head is blinded, or none has errors."))
    return Section(
        "Reacquisition",
        table(
            "From the end of a blinding to the next attitude, without the tracker's computing time",
            ["head", "times", "mean (s)", "99 % (s)"],
            rows,
        ),
    )


def _beta(flown: Flown) -> Section:
    rows = [
        [
            f"{one.low / deg:.3g} to {one.high / deg:.3g}", f"{100 * one.time:.2f}",
            f"{100 * one.one:.4f}", f"{100 * one.two:.4f}", f"{one.error / arcsec:.3g}",
        ]
        for one in over_beta(flown)
    ]  # fmt: skip
    head = ["beta (deg)", "of the time (%)", "one head (%)", "two heads (%)", "worst axis (arcsec)"]
    return Section(
        "Beta angle", table("By the angle from the Sun to the plane of the orbit", head, rows)
    )


def _names(plan: Plan) -> list[str]:
    return [one.name for one in plan.heads]
