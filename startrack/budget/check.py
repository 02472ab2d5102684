"""Case and its analytic budget -> what some trials say of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from startrack.budget.budget import Budget, Law
from startrack.core import Refused, arcsec
from startrack.design import Case, Fidelity
from startrack.metrics import Interval, Summary, fraction_interval, summarise
from startrack.trial import run_trials

# Chosen by hand: a second or two on one core.
WINDOWS, FRAMES, DRAWN = 60, 24, 200  # trials of each fidelity
LARGEST = 2**20  # pixel, of the largest frame that is rendered more than a few times
FEWEST = 6  # frames of detectors however large
FAR = 1.15  # ratio of formula and trials up to which they agree, beside the interval
SURE = 0.99  # confidence of the interval of the availability


@dataclass(frozen=True)
class Check:
    """Trials of a design beside its analytic budget.

    fidelity  of the trials
    summary   of them
    differs   where the formula lies outside of the trials' interval, a sentence each
    """

    fidelity: Fidelity
    summary: Summary
    differs: tuple[str, ...]


def check(case: Case, budget: Budget[Law], seed: int) -> Check:
    """Compare a budget with some trials, with windows of frames where these suffice.

    Large detectors are compared by drawn spots, and where these cannot hold the design by a few
    frames.

    Raises    ValueError where no fidelity can hold the design.
    Accuracy  statistical: 60 trials know an rms to 9 %, and find a loss of 5 % of the trials with a
              probability of 95 %.
    """
    detector = case.instrument.detector
    pixels = detector.columns * detector.rows
    small = pixels <= LARGEST
    plan = (Fidelity.WINDOW, WINDOWS) if small else (Fidelity.SPOTS, DRAWN)
    try:
        outcomes = run_trials(case, seed, range(plan[1]), plan[0])
    except Refused:
        frames = FRAMES if small else max(FEWEST, FRAMES * LARGEST // pixels)
        plan = Fidelity.FRAME, frames
        outcomes = run_trials(case, seed, range(frames), Fidelity.FRAME)
    summary = summarise(outcomes)
    return Check(plan[0], summary, tuple(differences(budget, summary)))


def differences(budget: Budget[Any], summary: Summary) -> Iterator[str]:
    """Where a budget lies outside of what trials show: by more than 15 % and than the interval."""
    trials = summary.trials
    for name in ("across", "about"):
        formula, shown = getattr(budget, name) / arcsec, _in_arcsec(getattr(summary, name))
        if formula < shown.low / FAR or formula > shown.high * FAR or not shown.value > 0:
            yield (
                f"the error {name} the boresight is {formula:.3g} arcsec by formula and "
                f"{_text(shown)} arcsec by {trials} trials"
            )
    correct = round(trials * summary.availability.value)
    shown = fraction_interval(correct, trials, SURE)
    if not shown.low <= budget.availability <= shown.high:
        in_percent = Interval(*(100 * one for one in (shown.value, shown.low, shown.high)))
        yield (
            f"the availability is {100 * budget.availability:.1f} % by formula and "
            f"{_text(in_percent)} % by {trials} trials"
        )


def _in_arcsec(interval: Interval) -> Interval:
    return Interval(*(one / arcsec for one in (interval.value, interval.low, interval.high)))


def _text(interval: Interval) -> str:
    return f"{interval.value:.3g} [{interval.low:.3g}, {interval.high:.3g}]"
