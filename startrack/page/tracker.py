"""Star tracker's file, changed values -> budget, sky, frame and margins, as by the commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from startrack import budget as budgets
from startrack import design as designs
from startrack import optimise, verification
from startrack.core import Refused, Rows, Streams, arcsec, deg
from startrack.design import Campaign, Case, Design, Fidelity
from startrack.io import celestial, to_table
from startrack.metrics import correct, summarise, summary_rows, to_lines
from startrack.observation import random_attitude
from startrack.page import form
from startrack.page.pictures import TOP, picture
from startrack.page.trials import Runner, TrialColumns, TrialSource
from startrack.plots import stretch
from startrack.response import errors
from startrack.trial import observe, searched

# Sliders of a design without campaign variables; they range from half to twice the value.
USUAL = ("optics.focal_length", "optics.f_number", "detector.exposure")
FASTEST = 10.0  # radian / second
BLOCK = 4  # trials between checks for a stop; chosen by hand


@dataclass(frozen=True)
class TrackerPage:
    """A design file and the seed of its skies and noise. Changes are texts KEY=VALUE."""

    path: Path
    seed: int

    kind: ClassVar[str] = "tracker"
    command: ClassVar[str] = "budget"
    fidelities: ClassVar = tuple(Fidelity)
    all_keys: ClassVar = staticmethod(designs.design_keys)
    not_shown: ClassVar[str] = (
        "units one by one, tolerances, stray light of bodies, missions and sequences in time: see "
        "the commands budget --units, mission and sequence"
    )

    def load(self, changes: Sequence[str]) -> Design:
        """The design with changed values. Raises Refused, as `load_design`."""
        return designs.load_design(self.path, changes)

    def form(self, changes: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each key."""
        design = self.load(changes)
        campaign = {"campaign": to_table(design.campaign)} if design.campaign else {}
        return form.rows(to_table(design.case) | campaign, self.all_keys())

    def paint(self, changes: Sequence[str]) -> dict[str, Any]:
        """All results by formula, of the design as designed."""
        design = self.load(changes)
        case, campaign = design.case, design.campaign
        shown: dict[str, Any] = {"sliders": _sliders(case, campaign)}
        margins = dict[str, float]()
        try:
            budget, sky = budgets.budget_and_sky(case)
        except Refused as reason:
            shown["blind"] = str(reason)
        else:
            if campaign:
                needs = campaign.judged(case)[0].needs
                margins = verification.expected_margins(needs, budget)
            limits = campaign.requirements.accuracy if campaign else ()
            shown |= {"answer": budgets.answer(budget, limits), **_budget(budget)}
            shown["sky"] = _sky(sky)
            shown["rates"] = budgets.slew_rates(case, budgets.LONGEST).tolist()
        shown["requirements"] = _requirements(case, campaign, margins)
        shown["later"] = bool(
            campaign and (campaign.over_units(case) or len(campaign.judged(case)) > 1)
        )
        return shown

    def images(self, changes: Sequence[str], trial: int, condition: str) -> dict[str, Any]:
        """The frame of a trial, its spots and the error, of the design's own condition; and the
        errors of single stars by formula."""
        case, view = self.load(changes).case, dict[str, Any]()
        try:
            view = _frame(case, self.seed, trial)
        except Refused as reason:
            view["refused"] = str(reason)
        with suppress(Refused):  # the budget is refused for the same reason, which is shown
            view["stars"] = _stars(case)
        return view

    def trials(self, changes: Sequence[str], fidelity: str, run: Runner) -> TrialSource:
        """The trials of `startrack montecarlo` without units."""
        case = self.load(changes).case
        runner = optimise.TrialRunner(self.seed, run.executor, run.workers, run.ledger)
        return TrialSource(
            rows=lambda count: runner.run(case, count, Fidelity(fidelity)),
            columns=_columns,
            lines=lambda rows: to_lines(summary_rows(summarise(rows))),
            block=BLOCK,
        )

    def later(self, changes: Sequence[str], rate: Any = None) -> dict[str, Any]:
        """All margins, over units and conditions, as printed by `startrack requirements`.

        rate  radian / second about x: the error (arcsec) at this rate (deg / s) instead
        """
        design = self.load(changes)
        case, campaign = design.case, design.campaign
        if rate is not None:
            if not (isinstance(rate, int | float) and 0 <= rate < FASTEST):
                raise Refused(f"rate must be a number from 0 to {FASTEST:g} rad / s, got {rate!r}")
            curve = budgets.analytic_curve(case, np.array([float(rate)]))
            across, about = (float(error[0]) / arcsec for error in (curve.across, curve.about))
            return {"rate": rate / deg, "across": across, "about": about}
        if campaign is None:
            return {"requirements": []}
        expected = optimise.expect(case, campaign, self.seed)
        return {
            "requirements": _requirements(case, campaign, expected.margins, expected),
            "objective": campaign.goal_of(case),
            "expected": optimise.expected_objective(case, campaign, self.seed) / arcsec,
        }

    def write(self, changes: Sequence[str], path: Path, note: str) -> None:
        """Write the design as an overlay."""
        designs.save_overlay(path, self.load(changes), self.path, note)


def _sliders(case: Case, campaign: Campaign | None) -> list[dict[str, Any]]:
    variables = campaign.variables if campaign else ()
    every = variables or [_usual(case, f"instrument.{name}") for name in USUAL]
    return form.sliders(case, designs.bounds_of(case, every))


def _usual(case: Case, name: str) -> designs.Variable:
    value, unit = designs.found_at(case, name), designs.unit_at(case, name)
    low, high = (f"{unit.of(end)} {unit.shown}" if unit else end for end in (value / 2, 2 * value))
    return designs.Variable(name, low, high, "log")


def _budget(budget: budgets.Budget[Any]) -> dict[str, Any]:
    """Causes and sums, arcsec rms per axis."""
    causes = [
        {
            "name": line.name,
            "term": line.term.value if line.term else "",
            "across": line.across / arcsec,
            "about": line.about / arcsec,
            "advice": budgets.ADVICE.get(line.name, ""),
        }
        for line in budget.lines
    ]
    return {
        "causes": causes,
        "across": budget.across / arcsec,
        "about": budget.about / arcsec,
        "value": budget.across / arcsec,
        "availability": budget.availability,
        "matched": budget.stars,
        "left_out": list(budget.left_out),
        "advice": budgets.advice(budget)[:1],
    }


def _sky(sky: budgets.RateSurvey) -> dict[str, Any]:
    x, y, z = sky.direction.T
    columns = {
        "ra": np.degrees(np.arctan2(y, x)),
        "dec": np.degrees(np.arcsin(z)),
        "stars": sky.stars,
        "across": sky.across / arcsec,
        "faintest": sky.faintest,
    }
    return {name: column.round(4).tolist() for name, column in columns.items()}


def _stars(case: Case) -> dict[str, Any]:
    """The error of single stars over their magnitude, by formula; pixel per axis."""
    star = errors(case)
    variance = sum(np.trace(part, axis1=1, axis2=2) / 2 for part in star.random.values())
    error = np.sqrt(np.maximum(variance, 0.0))
    return {"magnitude": star.magnitude.tolist(), "error": error.tolist()}


def _requirements(
    case: Case,
    campaign: Campaign | None,
    more: Mapping[str, float],
    expected: optimise.ExpectedDesign | None = None,
) -> list[dict[str, Any]]:
    """Each margin with value and limit; costs without a limit have no margin.

    more      margins of errors and availability
    expected  all margins, with conditions that have no forecast; None: those of the design's own
    """
    if campaign is None:
        return []
    needs, rows = campaign.requirements, list[dict[str, Any]]()
    needed = verification.needed_magnitude(case, needs.min_stars, needs.sky_fraction)
    margins = verification.margins(needs, case) | dict(more)
    for name, margin in margins.items():
        value, limit = (
            expected.value_and_limit(needs, name, needed)
            if expected
            else verification.limited(needs, name, margin, needed)
        )
        rows.append({"name": name, "value": value, "limit": limit, "margin": float(margin)})
    for name, unit in designs.COSTS.items():
        cost = needs.cost_named(name, case)
        if name not in margins and cost > 0:
            rows.append({"name": name, "value": f"{cost:.4g} {unit.removesuffix('1')}".strip()})
    return rows


def _frame(case: Case, seed: int, trial: int) -> dict[str, Any]:
    """The frame of a trial as searched by the tracker, its spots and the error."""
    streams, limit = Streams(seed, trial), case.tracker.detection.saturation
    attitude = random_attitude(streams)
    record = observe(case, attitude, streams)
    frame = record.frame if case.instrument.detector.scan else searched(case, record.frame)
    shown, outcome = stretch(frame.image, limit), record.outcome
    # Most pixels are as dark as the background.
    level, bright = np.zeros(shown.image.shape), shown.image > shown.black
    level[bright] = np.minimum(shown.level(shown.image[bright]), 1.0)
    matched = np.isin(np.arange(len(record.spots)), record.matches.spot)
    places = np.stack([record.spots.x, record.spots.y], 1)
    marks = {"spot matched": places[matched], "spot not matched": places[~matched]}
    right_ascension, declination = celestial(attitude)[:2]
    errors = [getattr(outcome, f"error_{axis}") / arcsec for axis in "xyz"]
    error = f"error {', '.join(f'{value:.3g}' for value in errors)} arcsec about x, y, z"
    notes = [
        f"RA {right_ascension:.2f}°, Dec {declination:.2f}°",
        error if outcome.solved else str(record.estimate.status),
    ]
    if shown.block > 1:
        notes.append(f"each point is the largest of {shown.block} by {shown.block} pixels")
    if shown.saturated:
        notes.append(f"{shown.saturated} pixels saturated")
    drawn = picture("frame, bright pixels compressed", frame.image.shape, TOP * level, marks)
    ends = {"unit": "digital number", "low": shown.black, "high": shown.white, "grey": True}
    return {"text": "; ".join(notes), "images": [drawn | {"block": shown.block} | ends]}


def _columns(rows: Rows) -> TrialColumns:
    """Errors in arcsec and stars of each trial."""
    radial = np.sqrt((rows["error_x"] ** 2 + rows["error_y"] ** 2) / 2)
    values = {
        "error across (arcsec rms per axis)": radial / arcsec,
        "about (arcsec)": np.abs(rows["error_z"]) / arcsec,
        "stars": rows["stars"],
    }
    return TrialColumns(values, correct(rows))
