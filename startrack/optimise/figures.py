"""Design -> its errors, availability, margins and costs, by formula or by trials."""

import json
import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

from startrack import verification
from startrack.core import Advance, Refused
from startrack.design import COSTS, Campaign, Case, Fidelity, Judged
from startrack.metrics import Interval, summarise
from startrack.optimise import forecast
from startrack.optimise.forecast import SHOWN, Forecast, blind, expect, forecasts, name_by_condition
from startrack.optimise.population import population_of
from startrack.optimise.runner import TrialRunner

SWEPT = b"figures"  # kind of the notes of a ledger
TAIL = 0.025  # probability beyond each end of an interval
Figure = float | Interval


class DesignFigures(NamedTuple):
    """Figures of one design: intervals of 95 % by trials, numbers by formula.

    across        radian, rms per axis of the error across the boresight; if the design is judged
                  over units, the error that a fraction of the units does not exceed
    about         radian, rms of the error about the boresight; over units as for `across`
    availability  1, fraction of trials with a correct attitude
    stars         mean number of matched stars
    margins       of the requirements, as fractions of the limits (stars: magnitude)
    costs         SI, in the units of `COSTS`
    note          why there are no errors, or empty
    """

    across: Figure
    about: Figure
    availability: Figure
    stars: float
    margins: Mapping[str, Figure]
    costs: Mapping[str, float]
    note: str = ""

    def text(self) -> str:
        """The figures as JSON; for figures by formula alone."""
        return json.dumps(self)

    @classmethod
    def read(cls, text: str) -> "DesignFigures":
        """Inverse of `text`."""
        return cls(*json.loads(text))


def middle(figure: Figure) -> float:
    """The value of a figure."""
    return figure.value if isinstance(figure, Interval) else figure


def by_formula(asked: tuple[Case, Campaign], seed: int) -> DesignFigures:
    """The figures of a design by the analytic budget, as by `expect`.

    seed    of the units, where it is judged over units
    Raises  Refused if a condition or a cost does not fit the design.
    """
    case, campaign = asked
    try:
        budget, margins, errors, *_ = expect(case, campaign, seed)
    except Refused as reason:
        margins = verification.margins(campaign.requirements, case)
        for condition in campaign.judged(case):
            margins |= name_by_condition(condition.name, blind(condition.needs))
        nothing = math.nan, math.nan, 0.0, 0.0
        return DesignFigures(*nothing, margins, _costs(case, campaign), str(reason))
    return DesignFigures(
        errors["across"],
        errors["about"],
        budget.availability,
        budget.stars,
        margins,
        _costs(case, campaign),
    )


def all_by_formula(
    asked: list[tuple[Case, Campaign]], runner: TrialRunner, progress: Advance | None = None
) -> list[DesignFigures | Refused]:
    """`by_formula` of several designs, each by a worker; the ledger of the runner keeps them."""
    keys = [runner.forecast_key(case, campaign, ()) for case, campaign in asked]
    notes = {key: runner.ledger.note(SWEPT, key) for key in keys}
    new = {key: one for key, one in zip(keys, asked, strict=True) if not notes[key]}
    if progress and len(asked) > len(new):
        progress(len(asked) - len(new))
    refused = dict[bytes, Refused]()
    computed = runner.map(partial(_or_refused, seed=runner.seed), new.values(), progress)
    for key, figures in zip(new, computed, strict=True):
        if isinstance(figures, Refused):
            refused[key] = figures
            continue
        notes[key] = figures.text()
        runner.ledger.keep_note(SWEPT, key, notes[key])
    return [refused.get(key) or DesignFigures.read(notes[key]) for key in keys]


def _or_refused(asked: tuple[Case, Campaign], seed: int) -> DesignFigures | Refused:
    try:
        return by_formula(asked, seed)
    except Refused as reason:
        return reason


def by_trials(
    case: Case,
    campaign: Campaign,
    runner: TrialRunner,
    trials: int,
    fidelity: Fidelity,
    progress: Advance | None = None,
) -> DesignFigures:
    """The figures of a design by the first trials of a seed, in all conditions of the campaign.

    Each design has the same skies and noise. Errors and availability are those of the design's own
    condition. For a design that is judged over units, an error is, as by formula, the error that a
    fraction of the units does not exceed.

    progress  called with the number of trials that were just done
    Raises    Refused if the design cannot be built or rendered.
    """
    needs, judged = campaign.requirements, campaign.judged(case)
    margins: dict[str, Figure] = dict(verification.margins(needs, case))
    for condition in judged:
        rows = population_of(condition).first_trials(trials, fidelity, runner, progress)
        counted = verification.counted(condition.needs, condition.case, runner.seed, rows)
        foreseen = None
        if condition.units is not None:
            _, every = forecasts([condition], campaign.goal, runner)
            foreseen = every[condition.name]
        if condition is judged[0]:
            summary = summarise(counted, condition.needs.limits)
            across, about = (
                _scaled(error, forecast.over_units(condition, rows, SHOWN[name], foreseen))
                for name, error in (("across", summary.across), ("about", summary.about))
            )
        own = _measured(condition, rows, counted, runner, foreseen)
        margins |= name_by_condition(condition.name, own)
    return DesignFigures(
        across=across,
        about=about,
        availability=summary.availability,
        stars=summary.stars,
        margins=margins,
        costs=_costs(case, campaign),
        note="" if math.isfinite(summary.across.value) else "no trial has a correct attitude",
    )


def _scaled(error: Interval, scale: float) -> Interval:
    return Interval(*(scale * end for end in (error.value, error.low, error.high)))


def _measured(
    condition: Judged, rows: Any, counted: Any, runner: TrialRunner, foreseen: Forecast | None
) -> dict[str, Interval]:
    """Margins of errors and availability by trials, with their intervals."""
    boresight, found = verification.boresights(runner.seed, counted), dict[str, Interval]()
    for claim in verification.claims_of(condition.needs):
        bounds = claim.bounds(counted, boresight, TAIL, TAIL)
        scale = 1.0
        if claim.accuracy:
            objective = claim.accuracy.objective
            scale = forecast.over_units(condition, rows, objective, foreseen)
        ends = [claim.margin(scale * end) for end in (bounds.value, bounds.low, bounds.high)]
        found[claim.name] = Interval(ends[0], min(ends[1:]), max(ends[1:]))
    return found


def _costs(case: Case, campaign: Campaign) -> dict[str, float]:
    return {name: campaign.requirements.cost_named(name, case) for name in COSTS}
