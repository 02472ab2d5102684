"""Boxes of several branches enter; the branch that wins leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.study.bench import Bench
from startrack.study.box import Box
from startrack.study.campaign import Campaign
from startrack.study.evaluate import Evaluation, evaluate
from startrack.study.objective import Objective
from startrack.study.refine import FIRST_STEP, Watch
from startrack.study.search import Search, least

ROUND = 4  # evaluations for each variable, and once more, that a branch has in a round at most
SHARE = 2 / 3  # of the evaluations that all rounds together may take; the rest refine the winner
SURE = 0.997  # confidence at which a branch is worse than the leader

Floats = NDArray[np.float64]


@dataclass
class _Runner:
    """A branch, its best place so far, and the step that its next search begins with."""

    label: str
    box: Box
    place: Floats
    step: float = FIRST_STEP
    best: Evaluation | None = None


def race(
    boxes: Mapping[str, Box],
    starts: Mapping[str, Floats],
    campaign: Campaign,
    bench: Bench,
    watch: Watch,
) -> tuple[str, Floats]:
    """Search all branches in rounds; each round keeps the better half, and no clear loser.

    Source: successive halving, Jamieson and Talwalkar (2016), with the test of a race (Maron and
    Moore 1994), here in pairs on the same trials.

    campaign  of whose evaluations it takes two thirds at most, but one a branch in each round
    Returns   the winner and its best place; at once where there is one branch alone
    """
    field = [_Runner(label, box, starts[label]) for label, box in boxes.items()]
    runs = _runs(len(field))
    each = max(1, int(SHARE * campaign.evaluations) // runs) if runs else 0
    while len(field) > 1:
        for runner in field:
            _run(runner, each, campaign, bench, watch)
        field.sort(key=_score)
        half = field[: math.ceil(len(field) / 2)]
        field = [
            one for one in half if one is half[0] or not _beaten(one, half[0], campaign, bench)
        ]
    return field[0].label, field[0].place


def _runs(branches: int) -> int:
    """How often branches run in all rounds of a race in which none is beaten early."""
    return branches + _runs(math.ceil(branches / 2)) if branches > 1 else 0


def _run(runner: _Runner, most: int, campaign: Campaign, bench: Bench, watch: Watch) -> None:
    def score(place: Floats) -> float:
        done = evaluate(runner.box, campaign, place, bench, spare=True)
        watch(done)
        if runner.best is None or done.score < runner.best.score:
            runner.best = done
        return done.score

    evaluations = min(most, ROUND * (len(runner.box) + 1))
    search = Search(evaluations=evaluations, first_step=runner.step)
    runner.place = least(score, runner.place, search).place
    runner.step /= 2


def _score(runner: _Runner) -> float:
    return runner.best.score if runner.best else math.inf


def _beaten(one: _Runner, leader: _Runner, campaign: Campaign, bench: Bench) -> bool:
    if not (one.best and leader.best and one.best.error > 0 and leader.best.error > 0):
        return False
    rms = Objective(Objective.read(campaign.objective).axes)
    mine, theirs = (
        rms.squares(bench.run(each.box.design(each.place), campaign.trials, campaign.fidelity))
        for each in (one, leader)
    )
    return rms.ratio(mine, theirs, bench.seed, confidence=SURE).low > 1
