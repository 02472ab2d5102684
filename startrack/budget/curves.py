"""Case -> attitude error over the sky and over slew rate, and errors of single stars."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np

from startrack.budget.analytic import analytic, of_fields
from startrack.budget.blind import blind
from startrack.budget.budget import Budget, ErrorLaw
from startrack.budget.fields import Fields, attitudes, boresights, listed_fields
from startrack.budget.left_out import TrialCheck, check
from startrack.budget.single_stars import Residuals, residuals
from startrack.core import Advance, Floats, Refused, Unit, printed
from startrack.design import Case
from startrack.metrics import Interval, summarise
from startrack.montecarlo import Serial, run
from startrack.response import Errors, errors
from startrack.trial import SingleStars, boxed, boxed_stars

SMEARS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # pixel in an exposure
LONGEST = 8.0  # pixel, longest smear of an analytic budget; a longer smear takes ten seconds
BETWEEN = 1  # extra rates of the analytic budget between two rates of the trials
TRIALS = 60  # trials whose stars are evaluated


@printed
class BudgetCurve(NamedTuple):
    """Analytic error over the slew rate.

    rate     (n,) radian / second
    budgets  at each rate; None if no field is solved
    """

    rate: Annotated[Floats, Unit("rad / s", "deg / s")]
    budgets: tuple[Budget[Any] | None, ...]

    @property
    def across(self) -> Floats:
        """Radian, rms per axis; NaN where no field is solved."""
        return np.array([budget.across if budget else math.nan for budget in self.budgets])

    @property
    def about(self) -> Floats:
        """Radian, rms; NaN where no field is solved."""
        return np.array([budget.about if budget else math.nan for budget in self.budgets])

    @property
    def available(self) -> Floats:
        """Fraction of the sky."""
        return np.array([budget.availability if budget else 0.0 for budget in self.budgets])

    @property
    def left_out(self) -> tuple[tuple[str, ...], ...]:
        """Effects that the formula does not count at each rate."""
        return tuple(budget.left_out if budget else () for budget in self.budgets)

    @property
    def first_left_out(self) -> int | None:
        """Index of the first rate at which the formula leaves out more than at rest."""
        rest = len(self.left_out[0])
        return next((k for k, sentences in enumerate(self.left_out) if len(sentences) > rest), None)

    @property
    def new_left_out(self) -> str:
        """Effects that the budget leaves out at `first_left_out`, but not at rest."""
        first = self.first_left_out
        if first is None:
            return ""
        # The phrases of one effect differ only in their numbers.
        at_rest = {_words(text) for text in self.left_out[0]}
        return "; ".join(text for text in self.left_out[first] if _words(text) not in at_rest)


def _words(phrase: str) -> str:
    return "".join(letter for letter in phrase if not letter.isdigit() and letter != ".")


def slewing(case: Case, rate: float) -> Case:
    """The design at another slew rate (radian / second) about x, otherwise unchanged."""
    motion = replace(case.instrument.motion, rate_x=rate, rate_y=0.0, rate_z=0.0)
    return replace(case, instrument=replace(case.instrument, motion=motion))


def slew_rates(case: Case, longest: float = math.inf) -> Floats:
    """Radian / second: rates that give the smears `SMEARS`, up to the longest (pixel)."""
    instrument = case.instrument
    pixel = 1 / instrument.camera.focal_length_px
    smears = np.array([smear for smear in SMEARS if smear <= longest])
    return smears * pixel / instrument.detector.exposure


def analytic_curve(
    case: Case, rates: Floats, advance: Callable[[float], None] | None = None
) -> BudgetCurve:
    """The analytic budget at some slew rates (n,), radian / second.

    advance  called with 1 after each rate
    """
    budgets = []
    for rate in rates:
        budgets.append(_budget(case, float(rate)))
        if advance:
            advance(1)
    return BudgetCurve(rates, tuple(budgets))


def _budget(case: Case, rate: float) -> Budget[Any] | None:
    """The analytic budget at a slew rate (radian / second); None if no field is solved."""
    try:
        return analytic(slewing(case, rate))
    except Refused:
        return None


def between(rates: Floats) -> Floats:
    """The rates with `BETWEEN` more rates in equal steps between neighbouring ones."""
    steps = BETWEEN + 1
    return np.interp(np.arange(steps * (len(rates) - 1) + 1) / steps, range(len(rates)), rates)


class Slew(NamedTuple):
    """Error and availability at one slew rate.

    rate      radian / second
    smear     pixel
    across    radian, rms per axis
    fraction  of trials with a correct attitude
    """

    rate: float
    smear: float
    across: Interval
    fraction: Interval


def slews(case: Case, seed: int, trials: int, progress: Advance) -> list[Slew]:
    """Run the same trials at several slew rates about x; all else is as in the design."""
    result = []
    for smear, rate in zip(SMEARS, slew_rates(case).tolist(), strict=True):
        turned = slewing(case, rate)
        summary = summarise(run(turned, trials, seed, Serial(), progress=progress))
        result.append(Slew(rate, smear, summary.across, summary.availability))
    return result


class ErrorCurves(NamedTuple):
    """Error of a case over slew rate and over the magnitude of stars.

    curve   the analytic budget over slew rates
    steps   number of rates in `curve` for each rate of the trials
    tried   results of trials at some slew rates
    stars   analytic errors of single stars over their magnitude, for a search of the whole frame
    boxed   errors of stars in boxes; None: the tracker searches the whole frame
    seen    measured errors of the stars of some trials
    trials  number of these trials
    """

    curve: BudgetCurve
    steps: int
    tried: tuple[tuple[float, TrialCheck], ...]
    stars: Errors
    boxed: SingleStars | None
    seen: Residuals
    trials: int


def error_curves(
    case: Case, seed: int, trials: int = TRIALS, advance: Callable[[float], None] = lambda _: None
) -> ErrorCurves:
    """The error over slew rate, and the errors of single stars.

    seed, trials  seed and number of the trials whose stars are evaluated
    advance       called after each of `curve_steps`
    """
    rates = slew_rates(case, LONGEST)
    curve = analytic_curve(case, between(rates), advance)
    tried = list[tuple[float, TrialCheck]]()
    for rate, budget in zip(rates.tolist(), curve.budgets[:: BETWEEN + 1], strict=True):
        if budget:
            tried.append((rate, check(slewing(case, rate), budget, seed)))
        advance(1)
    seen = residuals(case, seed, trials, lambda frames: advance(frames / trials))
    in_boxes = boxed_stars(case) if boxed(case) else None
    return ErrorCurves(
        curve=curve,
        steps=BETWEEN + 1,
        tried=tuple(tried),
        stars=errors(case),
        boxed=in_boxes,
        seen=seen,
        trials=trials,
    )


def curve_steps(case: Case) -> int:
    """Number of calls of `advance` by `error_curves`.

    There is one for each rate of the formula and of the trials, and one for all frames of stars.
    """
    rates = slew_rates(case, LONGEST)
    return len(between(rates)) + len(rates) + 1


DIRECTIONS = 3072  # directions of a survey: one in 13 square degrees


@printed
@dataclass(frozen=True, eq=False)
class RateSurvey:
    """Stars, availability and error in m directions, evenly distributed over the sky.

    direction      (m, 3) unit vectors of the boresight, ICRS axes
    stars          (m,) 1, expected number of detected stars
    solved         (m,) 1, probability that they are enough for an attitude
    across, about  (m,) radian, rms error across (per axis) and about the boresight; NaN where
                   there is no attitude
    faintest       (m,) G of a sunlike star as bright as the faintest star that is likely to count;
                   NaN where there is none
    """

    direction: Floats
    stars: Floats
    solved: Floats
    across: Annotated[Floats, Unit("rad", "arcsec")]
    about: Annotated[Floats, Unit("rad", "arcsec")]
    faintest: Annotated[Floats, Unit("mag")]

    def fraction(self, stars: float) -> float:
        """Fraction of the sky with at least a number of stars."""
        return float((self.stars >= stars - 0.5).mean())


def budget_and_sky(case: Case) -> tuple[Budget[ErrorLaw], RateSurvey]:
    """The budget of `analytic`, and the errors in each of its fields."""
    return _surveyed(case, listed_fields(case, attitudes))


def survey(case: Case, places: int = DIRECTIONS) -> RateSurvey:
    """The analytic budget in each direction. Exceptions and accuracy are those of `analytic`."""
    return _surveyed(case, listed_fields(case, boresights, places))[1]


def _surveyed(case: Case, view: Fields) -> tuple[Budget[ErrorLaw], RateSurvey]:
    solved = of_fields(case, view)
    if solved is None:
        raise blind(case)
    per_field, law = solved.attitudes, solved.budget.whole.spread
    square = np.where(per_field.solved[:, None] > 0, law.mean**2 + law.sigma**2, np.nan)
    counts, seen = per_field.gain[:, 3, 0] > 0.5, solved.stars
    faintest = np.full(len(per_field.stars), np.nan)
    inside = np.repeat(np.arange(len(per_field.stars)), np.diff(seen.first))
    np.fmax.at(faintest, inside[counts], seen.magnitude[counts])
    direction = view.attitude.inv().apply([0.0, 0.0, 1.0])
    across, about = np.sqrt(square[:, :2].mean(axis=1)), np.sqrt(square[:, 2])
    sky = RateSurvey(direction, per_field.stars, per_field.solved, across, about, faintest)
    return solved.budget, sky
