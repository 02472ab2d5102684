"""A mission as one HTML page: requirements, heads, times without attitude, beta angle, checks."""

import math
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import tomli_w

from startrack import mission
from startrack.core import arcsec, deg, utc_text
from startrack.io import to_table
from startrack.metrics import ARCSEC, PERCENT, SECOND, Column, DisplayUnit, Table
from startrack.report.page import Section, code, embedded, page, paragraph, records, table

DEGREE = DisplayUnit("deg", deg, deg)
MINUTE = DisplayUnit("min", 60.0, 1.0)
BLIND = DisplayUnit("", 0.01, 1.0)  # percent, stated in the caption
MOST = 10  # rows of a list of worst moments


class ReportedFlight(NamedTuple):
    """A simulated mission: plan, trials that check it, steps, and availability of heads."""

    plan: mission.MissionPlan
    checks: tuple[mission.Checked, ...]
    flown: mission.Flown
    available: mission.Availability

    @property
    def verdicts(self) -> list[mission.MissionVerdict]:
        """One verdict for each requirement."""
        requirements = self.plan.loaded.mission.requirements
        return mission.verdicts(requirements, self.available, float(self.flown.rms.max()))

    @property
    def met(self) -> bool:
        """Whether all requirements are met."""
        return all(verdict.met for verdict in self.verdicts)


def write_mission_report(
    flight: ReportedFlight, pictures: Sequence[tuple[str, Path]], title: str
) -> str:
    """The page as HTML.

    pictures  captions and PNG files, which the page embeds
    """
    plan, time = flight.plan, flight.plan.loaded.mission.time
    lead = (
        f"{time.steps} steps of {time.step:g} s from {time.begin} UTC, "
        f"{number_of_heads(len(plan.heads))}, {100 * flight.flown.eclipse.mean():.1f} % of the "
        "time in eclipse. Begin and end of intervals are accurate to a step."
    )
    text = tomli_w.dumps(to_table(plan.loaded.mission))
    beta = "By the angle from the Sun to the plane of the orbit"
    sections = [
        _requirements(flight.verdicts),
        _heads(flight),
        _errors(flight),
        _blinded(flight),
        _reacquired(flight),
        Section("Beta angle", records(beta, beta_table(flight.flown))),
        Section("Pictures", "".join(embedded(caption, file) for caption, file in pictures)),
        Section("Inputs", code("Mission, with the paths of its files", text)),
    ]
    return page(title, lead, sections)


def verdict_table(met: Sequence[mission.MissionVerdict]) -> Table:
    """Requirements of the mission; errors in arcsecond, all values in SI in JSON."""
    units = {"max_error": ARCSEC, "max_blind": SECOND}

    def shown(verdict: mission.MissionVerdict, value: float) -> str:
        if math.isinf(value):
            return "no attitude"
        unit = units.get(verdict.name, DisplayUnit("of the time", 1.0, 1.0))
        return f"{value / unit.size:.6g} {unit.name}"

    return Table(
        [
            Column("name", "requirement", lambda row: row.name),
            Column("limit", "", lambda row: row.limit),
            Column("value", "", lambda row: row.value),
            Column("met", "", lambda row: row.met),
            Column("", "value", lambda row: shown(row, row.value)),
            Column("", "required", lambda row: shown(row, row.limit)),
            Column("", "verdict", lambda row: "met" if row.met else "NOT MET"),
        ],
        met,
    )


def number_of_heads(count: int) -> str:
    """Words such as "1 head" and "3 heads"."""
    return f"{count} head{'s' * (count != 1)}"


def heads_table(flight: ReportedFlight) -> Table:
    """Table of each head's blind time, and of its error while valid."""
    plan, _, flown, available = flight
    error = flown.head_rms
    names = ("Sun", "Moon", "Earth", "ground", "SAA", "structure")
    causes = [
        Column("", name, available.causes[cause].item, BLIND, ".2f")
        for name, cause in zip(names, mission.Blind, strict=True)
    ]
    return Table(
        [
            Column("", "head", lambda h: plan.heads[h].name),
            *causes,
            Column("", "any", lambda h: 1 - available.alone[h], BLIND, ".2f"),
            Column("", "longest", lambda h: available.each[h].longest, MINUTE, ".1f"),
            Column("", "across", error[:, 0].item, ARCSEC, ".2f"),
            Column("", "about", error[:, 1].item, ARCSEC, ".2f"),
        ],
        range(len(plan.heads)),
    )


def beta_table(flown: mission.Flown) -> Table:
    """Availability and error over the angle from the Sun to the plane of the orbit."""
    return Table(
        [
            Column("", "beta (deg)", lambda row: f"{row.low / deg:.3g} to {row.high / deg:.3g}"),
            Column("low_deg", "", lambda row: row.low, DEGREE),
            Column("high_deg", "", lambda row: row.high, DEGREE),
            Column("time", "of the time", lambda row: row.time, PERCENT, ".2f"),
            Column("one", "one head", lambda row: row.one, PERCENT, ".4f"),
            Column("two", "two heads", lambda row: row.two, PERCENT, ".4f"),
            Column("error_arcsec", "worst axis", lambda row: row.error, ARCSEC, ".3g"),
        ],
        mission.over_beta(flown),
    )


def outages_table(none: mission.TimeIntervals, begin: str) -> Table:
    """The longest times without a valid head.

    begin  of the mission, UTC
    """

    return Table(
        [
            Column("begin_s", "begin", lambda interval: interval[0], SECOND, ".0f"),
            Column("begin_utc", "begin (UTC)", lambda interval: utc_text(begin, interval[0])),
            Column("length_s", "length", lambda interval: interval[1], SECOND, "g"),
        ],
        none.worst(MOST),
    )


CHECKED = (
    "Rms of trials over rms of the budget, with standard errors; corrected: each half of the "
    "trials is corrected by the ratio of the other half"
)


def checks_table(flight: ReportedFlight) -> Table:
    """Errors of trials and errors of the budget for each group of heads."""

    def names(row: mission.Checked) -> list[str]:
        return [flight.plan.heads[h].name for h in row.heads]

    ratios = {
        "across": "across",
        "about": "about",
        "corrected_across": "across, corrected",
        "corrected_about": "about, corrected",
    }

    def ratio(name: str) -> Callable[[mission.Checked], str]:
        return lambda row: "{:.3f} +- {:.3f}".format(*getattr(row, name))

    return Table(
        [
            Column("heads", "", names),
            Column("", "heads", lambda row: ", ".join(names(row))),
            Column("trials", "trials", lambda row: row.trials, form="d"),
            Column("attitudes", "attitudes", lambda row: row.attitudes, form="d"),
            Column("attitudes_expected", "expected", lambda row: row.expected, form=".1f"),
            *(Column(f"{name}_ratio", "", attrgetter(name)) for name in ratios),
            *(Column("", title, ratio(name)) for name, title in ratios.items()),
        ],
        flight.checks,
    )


def _requirements(met: Sequence[mission.MissionVerdict]) -> Section:
    if not met:
        return Section("Requirements", paragraph("The mission has no requirements."))
    return Section("Requirements", records("Requirements of the mission", verdict_table(met)))


def _heads(flight: ReportedFlight) -> Section:
    available = flight.available
    many = [
        [
            f"{count}",
            f"{100 * available.at_least(count):.4f}",
            f"{100 * available.heads[count:].sum():.4f}",
        ]
        for count in range(len(flight.plan.heads), 0, -1)
    ]
    caption = (
        "Blind, % of the time (a time may have several causes), and rms error while it is valid"
    )
    head = ["heads", "with attitudes", "not blind"]
    shown = table("Fraction of the time with at least this number of heads, %", head, many)
    return Section("Heads", records(caption, heads_table(flight)) + shown)


def _errors(flight: ReportedFlight) -> Section:
    flown = flight.flown
    fused = [[axis, f"{rms / arcsec:.3g}"] for axis, rms in zip("xyz", flown.rms, strict=True)]
    body = table("Rms error of the fused attitude about the axes, arcsec", ["axis", "rms"], fused)
    unchecked = "By the error budget, without a check by trials (check.trials of the mission file)."
    body += records(CHECKED, checks_table(flight)) if flight.checks else paragraph(unchecked)
    begin = flight.plan.loaded.mission.time.begin
    moments = [[f"{s:.0f}", utc_text(begin, s), f"{e / arcsec:.3g}"] for s, e in flown.worst[:MOST]]
    caption = "Worst moments: error about the worst axis, the largest of each part of the mission"
    return Section("Errors", body + table(caption, ["second", "UTC", "arcsec rms"], moments))


def _blinded(flight: ReportedFlight) -> Section:
    none, names = flight.available.none, [head.name for head in flight.plan.heads]
    begin = flight.plan.loaded.mission.time.begin
    every = {"no head valid": none, **dict(zip(names, flight.available.each, strict=True))}
    head = ["", *(f"to {high:g} s" for high in mission.EDGES[1:-1]), "longer", "longest (s)"]
    rows = [
        [name, *(str(int(n)) for n in intervals.histogram()), f"{intervals.longest:g}"]
        for name, intervals in every.items()
    ]
    longest = paragraph("A head is valid at all times.")
    if len(none.length):
        longest = records("Longest times without a valid head", outages_table(none, begin))
    shown = table("Number of blind intervals of a head by duration", head, rows)
    return Section("Blindings", shown + longest)


def _reacquired(flight: ReportedFlight) -> Section:
    rows, plan = [], flight.plan
    for head, design, chances in zip(
        plan.heads, plan.loaded.designs, flight.flown.chances, strict=True
    ):
        again = mission.reacquisition_of(design.case, chances)
        if again.times:
            rows.append([head.name, str(again.times), f"{again.mean:.3g}", f"{again.level:.3g}"])
    text = "From the end of blinding to the next attitude, without the tracker's computing time"
    shown = table(text, ["head", "times", "mean (s)", "99 % (s)"], rows)
    none = paragraph("No head is blinded, or no errors are known.")
    return Section("Reacquisition", shown if rows else none)
