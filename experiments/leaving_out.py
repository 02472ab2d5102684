"""A model with all effects -> the error caused by leaving out each effect, and the effects that are
needed."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from startrack.core import Floats

Change = Callable[[Any], Any]
Observe = Callable[[Any, int], Floats]


@dataclass(frozen=True)
class View:
    """A scene with all effects, and changes that leave out each effect alone.

    name     of the scene
    text     description of the scene, the camera and a trial
    full     model with all effects
    effects  name -> a change that leaves the effect out of any model
    observe  a model and the number of a trial -> (p, k) values of k kinds at p places, NaN where
             there is none; two models meet the same sky and noise in the same trial
    own      a model, n trials, their values (n, p, k) -> (k,) the scene's error
    kinds    name of each of the k kinds, with its unit
    faster   a cheaper way to observe; None without
    """

    name: str
    text: str
    full: Any
    effects: Mapping[str, Change]
    observe: Observe
    own: Callable[[Any, Sequence[int], Floats], Floats]
    kinds: tuple[str, ...]
    faster: Observe | None = None

    def without(self, names: Iterable[str]) -> Any:
        """The model without some effects, which are left out in the order of the list."""
        model, left = self.full, set(names)
        for name, change in self.effects.items():
            if name in left:
                model = change(model)
        return model


class Gap(NamedTuple):
    """Difference of two models on the same trials.

    error    (k,) rms of the difference
    sigma    (k,) its standard error, from the spread over trials
    changed  number of trials in which only one model has an answer
    """

    error: Floats
    sigma: Floats
    changed: int


class Effect(NamedTuple):
    """Result of leaving out one effect.

    gap      difference from the full model
    fraction  1, its error over the scene's error, for the kind with the largest ratio
    seconds  CPU time of the effect in a trial, median of differences
    """

    name: str
    gap: Gap
    fraction: float
    seconds: float
    kept: bool


class Way(NamedTuple):
    """One way to compute the scene, on trials that were not used for the selection.

    seconds  CPU time of a trial, median
    answers  trials with an answer
    error    (k,) the scene's error, computed this way
    gap      difference from the full model
    """

    name: str
    seconds: float
    answers: int
    error: Floats
    gap: Gap


class Found(NamedTuple):
    """A scene's effects, and the remaining chain.

    own      (k,) the scene's error
    bound    (k,) root sum square of the errors of all effects left out
    refused  reason why the remaining chain has no faster way; empty if it has
    """

    view: View
    trials: int
    own: Floats
    effects: list[Effect]
    bound: Floats
    ways: list[Way]
    refused: str


def leave_out(
    view: View, trials: int, timed: int, fraction: float, tell: Callable[[str], None]
) -> Found:
    """Leave out every effect alone, then all dispensable effects together; judge the result on
    fresh trials.

    timed  number of trials repeated alternately with the full model, for the time
    fraction  1, limit of the root sum square of all omitted errors, over the scene's error
    tell   called with a text on the current step
    """
    numbers = range(trials)
    full = observed(view.observe, view.full, numbers)
    own = view.own(view.full, numbers, full)
    effects = []
    for name, change in view.effects.items():
        tell(f"{view.name}: without {name}")
        model = change(view.full)
        found = gap(observed(view.observe, model, numbers), full)
        cost = extra_time(view, model, numbers[:timed])
        effects.append(Effect(name, found, float(np.max(found.error / own)), cost, True))
    effects = choose(effects, fraction)
    spared = [effect for effect in effects if not effect.kept]
    bound = np.sqrt(sum((effect.gap.error**2 for effect in spared), np.zeros_like(own)))
    tell(f"{view.name}: only what it needs")
    lean = view.without(effect.name for effect in spared)
    fresh = range(trials, 2 * trials)
    refused = why_not(view, lean, fresh[0])
    return Found(view, trials, own, effects, bound, judge(view, lean, fresh, not refused), refused)


def observed(observe: Observe, model: Any, numbers: Sequence[int]) -> Floats:
    """Values (n, p, k) of n trials."""
    return np.array([observe(model, number) for number in numbers])


def gap(one: Floats, other: Floats) -> Gap:
    """The difference of two models' values (n, p, k); trials are independent, places are not."""
    both = np.isfinite(one) & np.isfinite(other)
    square = np.where(both, one - other, 0.0) ** 2
    weight = both.sum(1)
    mean = square.sum((0, 1)) / np.maximum(weight.sum(0), 1)
    # Standard error of a ratio of sums over trials.
    rest = square.sum(1) - weight * mean
    sigma = np.sqrt((rest**2).sum(0)) / np.maximum(weight.sum(0), 1)
    error = np.sqrt(mean)
    changed = (np.isfinite(one) != np.isfinite(other)).any((1, 2)).sum()
    return Gap(error, sigma / np.maximum(2 * error, 1e-300), int(changed))


def choose(effects: Sequence[Effect], fraction: float) -> list[Effect]:
    """Leave out the smallest effects, while the root sum square of their errors is at most `share`.

    An effect that changes a trial from solved to unsolved, or back, is kept.
    """
    spent, spared = 0.0, set()
    for effect in sorted(effects, key=lambda effect: effect.fraction):
        if not effect.gap.changed and spent + effect.fraction**2 <= fraction**2:
            spent += effect.fraction**2
            spared.add(effect.name)
    return [effect._replace(kept=effect.name not in spared) for effect in effects]


def extra_time(view: View, model: Any, numbers: Sequence[int]) -> float:
    """Additional CPU time of the full model compared with another, alternately on the same trials,
    second."""
    more = []
    for number in numbers:
        # The first run finds less in the processor's cache, so the order alternates.
        order = (view.full, model) if number % 2 else (model, view.full)
        first, second = (clocked(view.observe, each, number)[1] for each in order)
        more.append(first - second if number % 2 else second - first)
    return statistics.median(more)


def why_not(view: View, lean: Any, number: int) -> str:
    """Reason why a model cannot be observed the faster way; empty if it can."""
    if view.faster is None:
        return "there is no other way"
    try:
        view.faster(lean, number)
    except ValueError as error:
        return str(error)
    return ""


def judge(view: View, lean: Any, numbers: Sequence[int], faster: bool) -> list[Way]:
    """The full model, the reduced model and possibly its faster way, alternately."""
    ways = {"everything": (view.observe, view.full), "what is needed": (view.observe, lean)}
    if view.faster and faster:
        ways["the same, in windows"] = (view.faster, lean)
    for way in ways.values():
        clocked(*way, numbers[0])  # computations done once for a design
    turns = [[clocked(*way, number) for way in ways.values()] for number in numbers]
    everything = np.array([values for (values, _), *_ in turns])
    found = []
    for (name, (_, model)), each in zip(ways.items(), zip(*turns, strict=True), strict=True):
        values, seconds = np.array([v for v, _ in each]), statistics.median(s for _, s in each)
        answers = int(np.isfinite(values).any((1, 2)).sum())
        own = view.own(model, numbers, values)
        found.append(Way(name, seconds, answers, own, gap(values, everything)))
    return found


def clocked(observe: Observe, model: Any, number: int) -> tuple[Floats, float]:
    """The values of a trial, and its CPU time in second."""
    began = time.process_time()
    values = observe(model, number)
    return values, time.process_time() - began


def rms(values: Floats) -> Floats:
    """Rms (k,) of errors (n, p, k), without missing errors."""
    known = np.isfinite(values).any()
    return (
        np.sqrt(np.nanmean(values**2, axis=(0, 1))) if known else np.full(values.shape[2], math.nan)
    )
