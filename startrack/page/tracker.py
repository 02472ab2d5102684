"""Star tracker's file, changed values -> budget, sky, frame and margins, as commands have."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from startrack import verification
from startrack.budget import (
    ADVICE,
    LONGEST,
    Budget,
    ErrorLaw,
    RateSurvey,
    advice,
    analytic_curve,
    answer,
    budget_and_sky,
    slew_rates,
)
from startrack.core import Refused, Streams, arcsec, deg
from startrack.design import (
    COSTS,
    Campaign,
    Case,
    Design,
    Variable,
    bounds_of,
    design_keys,
    found_at,
    load_design,
    save_overlay,
    search_keys,
    unit_at,
)
from startrack.io import celestial, to_table
from startrack.observation import random_attitude
from startrack.optimise import expect, expected_objective, units_text
from startrack.page import form
from startrack.plots import stretch
from startrack.response import errors
from startrack.trial import observe, searched

# Sliders of a design whose campaign varies nothing, and by which factor they go down and up.
USUAL = (
    "instrument.optics.focal_length",
    "instrument.optics.f_number",
    "instrument.detector.exposure",
)
DOWN, UP = 0.5, 2.0
NOT_SHOWN = (
    "stray light of bodies, missions and sequences in time: see the commands mission and sequence"
)


@dataclass(frozen=True)
class TrackerPage:
    """A design file and the seed of its skies and noise. Changes are texts KEY=VALUE."""

    path: Path
    seed: int

    kind = "tracker"
    not_shown = NOT_SHOWN

    def load(self, changes: Sequence[str]) -> Design:
        """The design with changed values. Raises Refused, as `load_design`."""
        return load_design(self.path, changes)

    def form(self, changes: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each key."""
        design = self.load(changes)
        table: dict[str, Any] = to_table(design.case)
        if design.campaign:
            table["campaign"] = to_table(design.campaign)
        return form.rows(table, design_keys())

    def keys(self, words: str) -> list[str]:
        """Names of the keys that words of a datasheet mean."""
        return [key.name for key in search_keys(words, design_keys())]

    def paint(self, changes: Sequence[str], trial: int) -> dict[str, Any]:
        """All that is shown of the design as designed, without a trial but the one of the frame.

        trial  number of the frame's sky and noise
        """
        design = self.load(changes)
        case, campaign = design.case, design.campaign
        shown: dict[str, Any] = {"sliders": _sliders(case, campaign)}
        try:
            budget, sky = budget_and_sky(case)
        except Refused as reason:
            shown["blind"] = str(reason)
            shown["requirements"] = _requirements(case, campaign, {})
        else:
            limits = campaign.requirements.accuracy if campaign else ()
            margins = {}
            if campaign and campaign.judged(case)[0].units is None:
                margins = verification.expected_margins(campaign.requirements, budget)
            elif campaign:
                needs = campaign.judged(case)[0].needs
                margins = verification.expected_margins(needs, budget)
            shown |= {"answer": answer(budget, limits), **_budget(budget), "sky": _sky(sky)}
            shown |= {"requirements": _requirements(case, campaign, margins)}
            shown |= {"stars": _stars(case), "rates": slew_rates(case, LONGEST).tolist()}
        try:
            shown["frame"] = _frame(case, self.seed, trial)
        except Refused as reason:
            shown["frame"] = {"refused": str(reason)}
        units = campaign.over_units(case) if campaign else None
        shown["later"] = bool(campaign and (units or len(campaign.judged(case)) > 1))
        shown["over"] = units_text(units, campaign) if units and campaign else ""
        return shown

    def requirements(self, changes: Sequence[str]) -> dict[str, Any]:
        """All margins, over units and conditions, as `startrack requirements` has them."""
        design = self.load(changes)
        if not design.campaign:
            return {"requirements": [], "objective": "", "expected": None}
        _, margins = expect(design.case, design.campaign, self.seed)
        error = expected_objective(design.case, design.campaign, self.seed) / arcsec
        over = design.campaign.over_units(design.case)
        words = units_text(over, design.campaign) if over else str(design.campaign.goal)
        found = _requirements(design.case, design.campaign, margins)
        return {"requirements": found, "objective": words, "expected": error}

    def at_rate(self, changes: Sequence[str], rate: float) -> dict[str, Any]:
        """The error at a slew rate about x, radian / second."""
        curve = analytic_curve(self.load(changes).case, np.array([rate]))
        across, about = curve.across[0] / arcsec, curve.about[0] / arcsec
        return {"rate": rate / deg, "across": float(across), "about": float(about)}

    def save(self, changes: Sequence[str], path: Path) -> str:
        """Write the design as an overlay; returns what was done."""
        design = self.load(changes)
        save_overlay(path, design, self.path, f"saved by startrack page, from {self.path.name}")
        return f"{path} is written; startrack budget {path} has the numbers shown here"


def _sliders(case: Case, campaign: Campaign | None) -> list[dict[str, Any]]:
    variables = campaign.variables if campaign else ()
    if not variables:
        variables = tuple(_usual(case, name) for name in USUAL)
    return [
        form.slider(bounds, type(found_at(case, bounds.name)) is int)
        for bounds in bounds_of(case, variables)
    ]


def _usual(case: Case, name: str) -> Variable:
    value, unit = found_at(case, name), unit_at(case, name)
    ends = (
        f"{float(f'{unit.of(factor * value):.3g}')} {unit.shown}" if unit else factor * value
        for factor in (DOWN, UP)
    )
    low, high = ends
    return Variable(name, low, high, "log")


def _budget(budget: Budget[ErrorLaw]) -> dict[str, Any]:
    """Causes and sums, arcsec rms per axis."""
    causes = [
        {
            "name": line.name,
            "term": line.term.value if line.term else "",
            "across": line.across / arcsec,
            "about": line.about / arcsec,
            "advice": ADVICE.get(line.name, ""),
        }
        for line in budget.lines
    ]
    return {
        "causes": causes,
        "across": budget.across / arcsec,
        "about": budget.about / arcsec,
        "availability": budget.availability,
        "matched": budget.stars,
        "left_out": list(budget.left_out),
        "advice": advice(budget)[:3],
    }


def _sky(sky: RateSurvey) -> dict[str, Any]:
    x, y, z = sky.direction.T
    return {
        "ra": np.degrees(np.arctan2(y, x)).round(3).tolist(),
        "dec": np.degrees(np.arcsin(z)).round(3).tolist(),
        "stars": sky.stars.round(3).tolist(),
        "across": (sky.across / arcsec).round(5).tolist(),
        "faintest": sky.faintest.round(3).tolist(),
    }


def _stars(case: Case) -> dict[str, Any]:
    """The error of single stars over their magnitude, by formula; pixel per axis."""
    star = errors(case)
    variance = sum(np.trace(part, axis1=1, axis2=2) / 2 for part in star.random.values())
    return {
        "magnitude": star.magnitude.tolist(),
        "error": np.sqrt(np.maximum(variance, 0.0)).tolist(),
    }


def _requirements(
    case: Case, campaign: Campaign | None, more: dict[str, float]
) -> list[dict[str, Any]]:
    """Each margin with its value and limit; costs without a limit have no margin.

    more  margins of errors and availability
    """
    if campaign is None:
        return []
    needs = campaign.requirements
    needed = verification.needed_magnitude(case, needs.min_stars, needs.sky_fraction)
    margins = verification.margins(needs, case) | more
    rows = []
    for name, margin in margins.items():
        value, limit = verification.limited(needs, name, margin, needed)
        rows.append({"name": name, "value": value, "limit": limit, "margin": float(margin)})
    for name, unit in COSTS.items():
        cost = needs.cost_named(name, case)
        if name not in margins and cost > 0:
            rows.append({"name": name, "value": f"{cost:.4g} {unit.removesuffix('1')}".strip()})
    return rows


def _frame(case: Case, seed: int, trial: int) -> dict[str, Any]:
    """The frame of a trial as its tracker searches it, its spots and its error."""
    streams = Streams(seed, trial)
    attitude = random_attitude(streams)
    record = observe(case, attitude, streams)
    frame = record.frame if case.instrument.detector.scan else searched(case, record.frame)
    shown = stretch(frame.image, case.tracker.detection.saturation)
    # Most pixels are as dark as the background.
    level, bright = np.zeros(shown.image.shape), shown.image > shown.black
    level[bright] = np.minimum(shown.level(shown.image[bright]), 1.0)
    rows, columns = frame.image.shape
    ra, dec, roll = celestial(attitude)
    matched = np.zeros(len(record.spots), bool)
    matched[record.matches.spot] = True
    outcome = record.outcome
    return {
        "rows": rows,
        "columns": columns,
        "block": shown.block,
        "shape": list(shown.image.shape),
        "pixels": base64.b64encode((255 * level + 0.5).astype(np.uint8).tobytes()).decode(),
        "black": float(shown.black),
        "white": float(shown.white),
        "saturated": shown.saturated,
        "x": record.spots.x.round(2).tolist(),
        "y": record.spots.y.round(2).tolist(),
        "matched": matched.tolist(),
        "ra": ra,
        "dec": dec,
        "roll": roll,
        "trial": trial,
        "status": str(record.estimate.status),
        "solved": bool(outcome.solved),
        "errors": [getattr(outcome, f"error_{axis}") / arcsec for axis in "xyz"],
    }
