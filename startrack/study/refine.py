"""A box and a start enter; passes of Sbplx on ever more trials leave the best that was found."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from startrack.study.bench import Bench
from startrack.study.box import Box
from startrack.study.campaign import Campaign
from startrack.study.correction import Correction, correct
from startrack.study.evaluate import Evaluation, evaluate
from startrack.study.search import Search, least

FIRST_STEP = 0.15  # of each range; each pass starts with half the step of the one before
NEAR = 4.0  # first steps around the start of a pass, within which the budget is corrected
PATIENCE = 3  # designs for each variable, and once more, without a gain beyond the noise
SHARE = 0.6  # of the evaluations left that a pass may take, unless it is the last
LEAST_GAIN = 2e-3  # of ln(error), less than which is no gain

Floats = NDArray[np.float64]
Watch = Callable[[Evaluation], None]


def refine(
    box: Box, start: Floats, campaign: Campaign, bench: Bench, watch: Watch
) -> tuple[list[Evaluation], str]:
    """Search from a start with the campaign's trials, then with twice as many, to its most.

    What a pass has tried corrects the budget for the next; a design that cannot lead is not tried,
    which leaves the trials to those that can. A pass ends when the best has not
    gained for a while by more than the standard error of that correction between two places: what
    is won beyond that is the noise's.

    Returns  the evaluations of the last pass, best first, and a sentence on how it ended
    """
    left, step, ending = campaign.evaluations, FIRST_STEP, ""
    tried, before = list[Evaluation](), list[Evaluation]()
    plan = list(growth(campaign.trials, campaign.most_trials))
    for trials in plan:
        last = trials == plan[-1]
        share = left if last else math.ceil(SHARE * left)
        tried = []
        correction = correct(before, start, NEAR * step)
        settled = _Settled(correction)

        def score(
            place: Floats,
            trials: int = trials,
            settled: _Settled = settled,
            tried: list[Evaluation] = tried,
            correction: Correction = correction,
        ) -> float:
            # The first designs of a pass, one a term of the plane, are tried whatever they promise.
            tell = sum(one.trials > 0 for one in tried) < len(correction.terms)
            lead = math.inf if tell else min(one.score for one in tried)
            done = evaluate(box, campaign, place, bench, trials, correction, True, lead)
            tried.append(done)
            before.append(done)
            settled.see(done)
            watch(done)
            return done.score

        found = least(score, start, Search(evaluations=max(1, share), first_step=step), settled)
        left -= found.evaluations
        start, step, ending = found.place, step / 2, found.ending
        if left <= 0:
            break
    return sorted(tried, key=lambda one: (not one.feasible, one.score)), ending


def growth(first: int, most: int) -> Iterator[int]:
    """Trials of each pass: doubled until the most."""
    while first < most:
        yield first
        first = min(2 * first, most)
    yield most


class _Settled:
    """Whether a pass still gains more than its noise."""

    def __init__(self, correction: Correction) -> None:
        self._correction = correction
        self._anchor: Evaluation | None = None  # the best when it last gained
        self._quiet = 0

    def see(self, done: Evaluation) -> None:
        self._quiet += 1
        if self._anchor is None or self._gain(done, self._anchor):
            self._anchor, self._quiet = done, 0

    def __call__(self) -> str:
        patience = PATIENCE * len(self._correction.terms)
        return "a further gain would be within the noise" if self._quiet >= patience else ""

    def _gain(self, done: Evaluation, anchor: Evaluation) -> bool:
        doubt = self._correction.doubt(np.array(done.place), np.array(anchor.place))
        return anchor.score - done.score > max(doubt, LEAST_GAIN)
