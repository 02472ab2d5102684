"""Source of designs -> forecasts where they tell most, and emulators of all that they say."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import islice
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused, Streams, printed
from startrack.optimise.correction import Correction, Evidence, Limit
from startrack.optimise.emulator import Emulator, emulator
from startrack.optimise.evaluate import PENALTY, Foresight, missed
from startrack.optimise.forecast import named
from startrack.optimise.search import least_smooth
from startrack.optimise.source import DesignSource, affordable

# All chosen by hand.
FIRST, FIRST_MORE = 3, 5  # forecasts per variable, and besides, before the first emulator
BATCH = 4  # forecasts between two emulators: the same for any number of workers
ENOUGH = 0.2  # of the precision, below which an expected gain does not justify a forecast
SIGMAS = 2.0  # by which a design may be better than expected: 98 % of a normal law
BOLD = 6.0  # the same where no other design is left: near a cliff, emulators are wrong by as much
AROUND = 0.1  # of each range, on either side of the best, within which they lie
LIKELY = 0.15  # by which all emulators together may expect them to be worse than the best
IN_VAIN = 2  # batches of such designs, none of which is better, after which the search ends
BAD = 0.5  # of a score above the least, beyond which no condition without a weight is forecast
GOOD = 0.2  # the same, up to which a design tells whether they matter
ENOUGH_MET = 8  # good designs that meet all limits in these conditions by far, after which none is
CLIPPED = 2.0  # ln(error) above the least, beyond which a design is only bad
# The same, from which on an emulator need not go through a design, the less the worse it is: else
# the worst would decide its lengths.
BEYOND = 0.7
NEAR = 0.25  # the same, where only the neighbourhood of the best is looked at
MISSED = 0.4  # the same of a margin that is missed, on its scale
FEWEST = 2  # designs per variable at least that an emulator goes through
WIDTH = 0.2  # margin beyond which its scale grows slowly
LEAST_CHANCE = 1e-4  # of the unavailability that is allowed: below it all is as good
SAFE = 1e-3  # by which an emulated margin must be met, as it is wrong by as much at a limit
POOL, LEADERS, NEARBY = 256, 6, 0.05  # random designs, those kept, how near others are to these
CLOSE = 0.5  # of the load that is allowed, from which on trials are worth it in any condition
SHORT = 0.1  # of it, by which a design may miss what fresh trials can show, and yet be tried
APART = 1e-3  # of each range: nearer points are the same design
RELAXED = 0.01  # of a limit, by which `prices` relaxes it
NODES = 25  # of each variable, at which its span is looked for
ALL = 0.9  # of its range, from which on a variable that may have any value does not matter
SOLVED = "solved"  # an emulated margin: 1 where a design has a forecast, -1 where it has none


class Scale(NamedTuple):
    """On which a margin is emulated: between -1 and 1, of its sign, with most of it near zero.

        margins    m / sqrt(m^2 + WIDTH^2)
        of chances the same of ln(room / (room - m)) and 1: the unavailability against its limit

    room  1, of a chance: one less the least that is asked; 0: of any other margin
    """

    room: float = 0.0

    def of(self, margin: Floats) -> Floats:
        """The place on the scale of margins."""
        if not self.room:
            return np.asarray(margin / np.hypot(margin, WIDTH))
        log = np.log(self.room / np.maximum(self.room - margin, LEAST_CHANCE * self.room))
        return np.asarray(log / np.hypot(log, 1.0))

    def missing(self, place: Floats) -> Floats:
        """The amounts by which margins at places on the scale are missed."""
        short = np.clip(-place, 0.0, 0.999)
        ratio = short / np.sqrt(1 - short**2)
        return self.room * np.expm1(np.minimum(ratio, 20.0)) if self.room else WIDTH * ratio


@dataclass(frozen=True, eq=False)
class Emulators:
    """What all forecasts together expect of any design.

    objective  ln(error / arcsec)
    margins    of those that some design misses, by name, each on its scale
    scales     of the margins that are chances, by name
    """

    objective: Emulator
    margins: dict[str, Emulator]
    scales: Mapping[str, Scale]

    def scale(self, name: str) -> Scale:
        """The scale of a margin."""
        return self.scales.get(name, Scale())

    def score(self, points: Floats, sigmas: float = 0.0) -> Floats:
        """The score (m,) of designs (m, d) if all is better by some standard deviations."""
        score, sigma = self.objective.expected_and_sigma(points)
        score = score - sigmas * sigma
        for name, margin in self.margins.items():
            mean, sigma = margin.expected_and_sigma(points)
            score = score + PENALTY * self.scale(name).missing(mean + sigmas * sigma)
        return np.asarray(score)

    def least(
        self,
        starts: Floats,
        sigmas: float = 0.0,
        correction: Correction | None = None,
        box: tuple[Floats, Floats] | None = None,
        allowed: Callable[[Floats], bool] | None = None,
    ) -> tuple[Floats, float]:
        """The design of the least score, by nlopt's SLSQP (Kraft 1994) from some starts (m, d).

        correction  is added to the objective
        box         (d,) least and largest coordinates; None: the whole cube
        allowed     whether a design may be the answer; None: each may
        Returns     the design (d,) and its score, infinite where none is allowed
        """
        low, high = box or (np.zeros(starts.shape[1]), np.ones(starts.shape[1]))
        starts = np.clip(starts, low, high)
        best, least = starts[0], np.inf

        def value(point: Floats, gradient: Floats) -> float:
            bound, slope = self.objective.bound(point, -sigmas)
            if correction:
                bound, slope = bound + correction(point), slope + correction.slope
            if gradient.size:
                gradient[:] = slope
            return bound

        def missing(point: Floats, gradient: Floats, margin: Emulator) -> float:
            bound, slope = margin.bound(point, sigmas)
            if gradient.size:
                gradient[:] = -slope
            return SAFE / WIDTH - bound

        limits = [partial(missing, margin=margin) for margin in self.margins.values()]
        for start in starts:
            for end in (start, least_smooth(value, limits, start, (low, high))):
                if allowed and not allowed(end):
                    continue
                score = float(self.score(end[None], sigmas)[0])
                score += correction(end) if correction else 0.0
                if score < least:
                    best, least = end, score
        return best, least

    def with_point(self, point: Floats) -> Emulators:
        """The emulators if they were right at one more design (d,)."""
        margins = {name: margin.with_point(point) for name, margin in self.margins.items()}
        return Emulators(self.objective.with_point(point), margins, self.scales)


def emulators(
    points: Floats,
    values: Sequence[Foresight],
    scales: Mapping[str, Scale],
    like: Emulators | None = None,
    beyond: float = BEYOND,
) -> Emulators:
    """The emulators of some forecasts.

    scales   of the margins that are chances, by name
    like     of fewer forecasts of the same space
    beyond   ln(error) above the least, from which on the objective need not go through a design
    Raises   Refused where no design has a forecast.
    """
    expected = np.array([value.expected for value in values])
    finite = np.isfinite(expected)
    if not finite.any():
        raise Refused("none of the designs that were tried has a forecast")
    least = expected[finite].min()
    above = np.clip(np.where(finite, expected - least, 0.0), 0.0, CLIPPED)
    fewest = np.sort(above[finite])[: FEWEST * points.shape[1]][-1]
    doubt = (np.maximum(above - max(beyond, fewest), 0.0) / beyond) ** 2
    before = like.objective if like else None
    objective = emulator(points[finite], least + above[finite], before, doubt[finite])
    alike, margins = like.margins if like else {}, dict[str, Emulator]()
    tried = ~np.array([value.left_out for value in values])
    if not finite[tried].all():
        solved = np.where(finite[tried], 1.0, -1.0)
        margins[SOLVED] = emulator(points[tried], solved, alike.get(SOLVED))
    names = dict.fromkeys(name for value in values for name in value.margins)
    for name in names:
        present = np.array([name in value.margins for value in values])
        margin = np.array([value.margins[name] for value in values if name in value.margins])
        if (margin < 0).any():
            place = scales.get(name, Scale()).of(margin)
            # What all designs have are costs, which are smooth everywhere.
            short = np.maximum(-place - MISSED, 0.0) / MISSED
            unsure = None if present.all() else doubt[present] + short**2
            margins[name] = emulator(points[present], place, alike.get(name), unsure)
    return Emulators(objective, margins, scales)


@printed
class Span(NamedTuple):
    """Between which unit-cube coordinates of a variable the score stays within the precision.

    at_low, at_high  (d,) the designs there
    """

    low: float
    high: float
    at_low: Floats
    at_high: Floats

    @property
    def everywhere(self) -> bool:
        """Whether the variable does not matter."""
        return self.high - self.low >= ALL


@dataclass(eq=False)
class Explorer:
    """The forecasts of a design space so far, and what they let expect of any other design.

    The next designs are where the emulators' means, and their bounds of SIGMAS, are least: lower
    confidence bounds, see Cox and John (1992), IEEE Conference on Systems, Man and Cybernetics.

    label   of the branch that the designs belong to
    points  unit-cube coordinates of the designs
    limits  of the margins that trials decide, by name: what the fresh trials can show, and what
            trials said of the forecasts; none: forecasts are taken as they are
    raw     their forecasts
    values  the same with these limits
    ending  why no more are worth it; empty as long as some are
    watch   called after new forecasts
    """

    source: DesignSource
    label: str = ""
    points: list[Floats] = field(default_factory=list)
    limits: Mapping[str, Limit] = field(default_factory=dict)
    raw: list[Foresight] = field(default_factory=list)
    values: list[Foresight] = field(default_factory=list)
    ending: str = ""
    watch: Callable[[], None] | None = None
    _emulators: tuple[int, Emulators] | None = None
    _spanned: float = np.inf  # a score below it is so much lower that its spans are others
    _in_vain: int = 0  # batches of bold designs since the last gain

    @cached_property
    def scales(self) -> dict[str, Scale]:
        """Of the margins that are chances."""
        return {name: Scale(room) for name, room in self.source.rooms.items()}

    def forecast(self, points: Sequence[Floats]) -> None:
        """Add the forecasts of some designs, and that of the best one in all conditions."""
        self._add(points)
        self.complete()

    def _add(self, points: Sequence[Floats]) -> None:
        new = [np.clip(point, 0, 1) for point in points]
        enough = self.score + BAD if self._all_matter else -math.inf
        raw = self.source.foresee(new, enough)
        self.values += map(self._limited, new, raw)
        self.raw += raw
        self.points += new
        if self.watch:
            self.watch()

    def _limited(self, point: Floats, raw: Foresight) -> Foresight:
        margins = {
            name: self.limits[name].corrected(point, margin) if name in self.limits else margin
            for name, margin in raw.margins.items()
        }
        return raw._replace(margins=margins)

    def learn(self, evidence: Mapping[str, Sequence[Evidence]]) -> None:
        """Correct the forecasts of margins by all that trials say of them, by the margins' names.

        Only margins that are among `limits`.
        """
        self.limits = {
            name: limit.fitted(evidence.get(name, ())) for name, limit in self.limits.items()
        }
        self.values = list(map(self._limited, self.points, self.raw))
        self._forget()
        self.complete()

    def _forget(self) -> None:
        """Fit the emulators again, because values of known designs are others."""
        if self._emulators:
            self._emulators = 0, self._emulators[1]

    def complete(self) -> bool:
        """Forecast the best design in all conditions, until the best one is.

        Returns  whether a score changed
        """
        done, before = set[int](), [value.score for value in self.values]
        while np.isfinite(self.score):
            best = self._leader
            if best in done or not self._complete(best):
                break
            done.add(best)
        return [value.score for value in self.values] != before

    def _complete(self, number: int) -> bool:
        """Forecast a design in all conditions; whether some had no forecast."""
        if self.source.conditions.keys() <= self.raw[number].conditions.keys():
            return False
        point = self.points[number]
        self.raw[number] = self.source.complete(point, self.raw[number])
        self.values[number] = self._limited(point, self.raw[number])
        self._forget()
        return True

    @property
    def _all_matter(self) -> bool:
        """Whether conditions without a weight may limit a design, as far as the good ones tell."""
        good = [
            value
            for value in self.values
            if value.score <= self.score + GOOD and len(value.conditions) > 1
        ]
        if len(good) < ENOUGH_MET:
            return True
        weighted = {name for name, weight in self.source.conditions.items() if weight}
        return not all(
            name in weighted
            or all(part < 1 - WIDTH for part in self._parts(value, named(name, own.margins)))
            for value in good
            for name, own in value.conditions.items()
        )

    def _parts(self, value: Foresight, names: Iterable[str]) -> list[float]:
        """The parts that a design takes of what some margins allow."""
        rooms = [(name, self.scales.get(name, Scale()).room or 1.0) for name in names]
        return [(room - value.margins[name]) / room for name, room in rooms]

    def close(self, point: Floats) -> list[str]:
        """Names of the conditions in which a design is not far from a limit, as far as known."""
        value = self.forecast_of(point)
        return [
            name
            for name, own in value.conditions.items()
            if any(part > CLOSE for part in self._parts(value, named(name, own.margins)))
        ]

    def met(self, point: Floats) -> bool:
        """Whether a design is expected to be shown to meet all limits, or nearly so."""
        value = self.forecast_of(point)
        needless = [margin for name, margin in value.margins.items() if name not in self.limits]
        limited = value.margins.keys() & self.limits.keys()
        parts = self._parts(value, limited)
        return all(margin >= 0 for margin in needless) and all(part <= 1 + SHORT for part in parts)

    def unlimited(self, point: Floats) -> Foresight:
        """The forecast of a design in all conditions, as no trial has corrected it."""
        self.forecast_of(point)
        number = next(i for i, other in enumerate(self.points) if (other == point).all())
        self._complete(number)
        return self.raw[number]

    def forecast_of(self, point: Floats) -> Foresight:
        """The forecast of a design, which is added where it is not known."""
        for other, value in zip(self.points, self.values, strict=True):
            if (other == point).all():
                return value
        self.forecast([point])
        return self.values[-1]

    @property
    def emulators(self) -> Emulators:
        """Of all forecasts so far."""
        if self._emulators is None or self._emulators[0] < len(self.points):
            like = self._emulators[1] if self._emulators else None
            fitted = emulators(np.array(self.points), self.values, self.scales, like)
            self._emulators = len(self.points), fitted
        return self._emulators[1]

    @property
    def best(self) -> Floats:
        """The design of the least score of those that meet all limits; of all where none does."""
        return self.points[self._leader]

    @property
    def _leader(self) -> int:
        ranks = [(missed(value.margins) > 0, value.score) for value in self.values]
        return min(range(len(ranks)), key=ranks.__getitem__)

    @property
    def score(self) -> float:
        """The score of the best design so far; infinite where none has one."""
        return self.values[self._leader].score if self.values else math.inf

    def begin(self, start: Floats, most: int) -> None:
        """Forecast the start, and designs over the whole space that do not cost too much."""
        count = min(FIRST * len(self.source.names) + FIRST_MORE, most)
        random = self._random(0, "first designs to forecast")
        others = list(islice(affordable(self.source, random), count - 1))
        # The first ones say which others are bad.
        self._add([start, *others[: BATCH - 1]])
        self._add(others[BATCH - 1 :])

    def step(self, most: int) -> None:
        """Forecast the next designs, as many as are allowed, or say in `ending` why none.

        Where none is proposed, the ends of the spans are forecast, which the emulators expect to be
        as good: they show whether the emulators are right, and how far a variable may go. At last,
        those that would be better if the emulators were wrong by far more than they say.
        """
        points = self._proposals()
        if not points and self.complete():
            return
        if not points and self.score < self._spanned and np.isfinite(self.score):
            self._spanned = self.score - self.source.precision
            ends = [end for span in self.spans(self.best) for end in (span.at_low, span.at_high)]
            for end in ends:
                if self.is_new(end, points):
                    points.append(end)
        if not points and self._in_vain < IN_VAIN:
            points, self._in_vain = self._proposals(bold=True), self._in_vain + 1
        if points:
            before = self.score
            self._add(points[:most])
            if self.score < before - ENOUGH * self.source.precision:
                self._in_vain = 0
        else:
            gain = 100 * self.source.precision
            self.ending = f"a further gain is expected to be below {gain:g} %"

    def _proposals(self, bold: bool = False) -> list[Floats]:
        """The next designs; none where no design can be expected to gain what is asked.

        First the one that the emulators expect to be the best, then those that may be the best, as
        if the emulators were right about those before.

        bold  only near the best, where a design may be far better than expected
        """
        model, starts = self.emulators, self.starts()
        least, worth = self.score, ENOUGH * self.source.precision
        proposed = list[Floats]()
        bound, box = SIGMAS, None
        if bold:
            model = emulators(np.array(self.points), self.values, self.scales, model, NEAR)
            box = np.maximum(self.best - AROUND, 0), np.minimum(self.best + AROUND, 1)
            bound = BOLD
        for sigmas, gain in ((0.0, worth), *[(bound, 2.5 * worth)] * (BATCH - 1)):

            def may_be(point: Floats) -> bool:
                expected = float(self.emulators.score(point[None])[0])
                return expected < self.score + LIKELY and self.is_new(point, proposed)

            point, score = model.least(starts, sigmas, box=box, allowed=may_be if bold else None)
            if least - score > gain and self.is_new(point, proposed):
                proposed.append(point)
                model = model.with_point(point)
                least = min(least, float(model.score(point[None])[0]))
        return proposed

    def is_new(self, point: Floats, others: Sequence[Floats]) -> bool:
        """Whether a design is apart from all that have a forecast, and from others."""
        every = np.array([*self.points, *others])
        return bool(np.abs(every - point).max(axis=1).min() > APART)

    def starts(self) -> Floats:
        """Designs (m, d) to search from: the best ones, and others that may be good."""
        random = self._random(len(self.points), "designs to forecast")
        order = np.argsort([value.score for value in self.values], kind="stable")[:LEADERS]
        leaders = np.array([self.points[number] for number in order])
        pool = random.random((POOL, len(self.source.names)))
        near = leaders[:, None] + NEARBY * random.standard_normal((len(leaders), *pool.shape))
        pool = np.vstack([pool, np.clip(near.reshape(-1, len(self.source.names)), 0, 1)])
        good = np.argsort(self.emulators.score(pool, SIGMAS), kind="stable")[:LEADERS]
        return np.vstack([leaders[:2], pool[good]])

    def _random(self, number: int, what: str) -> np.random.Generator:
        return Streams(self.source.seed, number)(f"{what} {self.label}".strip())

    def lowest(self) -> float:
        """The score below which no design is with 98 % confidence, as the emulators see it."""
        return min(self.score, self.emulators.least(self.starts(), SIGMAS)[1])

    def spans(self, best: Floats) -> list[Span]:
        """For each variable, where the score stays within the precision of that of a design.

        The other variables follow: at each value they are where the score is least.
        """
        model, spans = self.emulators, list[Span]()
        limit = float(model.score(best[None])[0]) + self.source.precision
        nodes = np.linspace(0, 1, NODES)
        for axis, middle in enumerate(best):
            ends = [best, best]
            for side, way in enumerate((nodes[nodes < middle][::-1], nodes[nodes > middle])):
                for value in way:
                    starts, fixed = np.array([ends[side], best]), np.arange(len(best)) == axis
                    box = np.where(fixed, value, 0.0), np.where(fixed, value, 1.0)
                    point, score = model.least(starts, box=box)
                    if score > limit:
                        break
                    ends[side] = point
            spans.append(Span(float(ends[0][axis]), float(ends[1][axis]), *ends))
        return spans

    def prices(self, best: Floats) -> dict[str, float]:
        """What limits a design: for each margin, by how much ln(error) falls if it is relaxed.

        By one per cent of its limit; of margins that are met by more, and of those whose price is
        below a tenth of the precision, none.
        """
        model, least = self.emulators, float(self.emulators.score(best[None])[0])
        prices = dict[str, float]()
        for name, margin in model.margins.items():
            expected = float(margin.expected(best[None])[0])
            scale = model.scale(name)
            step = float(scale.of(np.array(RELAXED * (scale.room or 1.0))))
            if name == SOLVED or expected > 2 * step:
                continue
            easier = replace(margin, mean=margin.mean + step)
            relaxed = replace(model, margins=model.margins | {name: easier})
            price = least - relaxed.least(best[None])[1]
            if price > self.source.precision / 10:
                prices[name] = price
        return dict(sorted(prices.items(), key=lambda item: -item[1]))


@printed
class Landscape(NamedTuple):
    """What the forecasts say of a design space around its best design.

    forecasts  unit-cube coordinates of the designs
    expected   of these ln(arcsec) of the objective, NaN where no attitude is expected
    met        of these whether all requirements are met, as expected
    left       by how much ln(error) may yet fall, with 98 % confidence
    spans      of each variable, by its name
    prices     by how much ln(error) falls if a limit is relaxed by 1 %, by the margin's name
    ending     why there are no more
    """

    forecasts: tuple[tuple[float, ...], ...]
    expected: tuple[float, ...]
    met: tuple[bool, ...]
    left: float
    spans: dict[str, Span]
    prices: dict[str, float]
    ending: str

    @property
    def unimportant(self) -> list[str]:
        """Names of the variables that do not matter."""
        return [name for name, span in self.spans.items() if span.everywhere]


def landscape_of(explorer: Explorer, best: Floats) -> Landscape:
    """The landscape around a design."""
    every = zip(explorer.points, explorer.values, strict=True)
    tried = [(point, value) for point, value in every if not value.left_out]
    spans = dict(zip(explorer.source.names, explorer.spans(best), strict=True))
    return Landscape(
        tuple(tuple(point.tolist()) for point, _ in tried),
        tuple(value.expected for _, value in tried),
        tuple(math.isfinite(value.expected) and not missed(value.margins) for _, value in tried),
        max(0.0, explorer.score - explorer.lowest()),
        spans,
        explorer.prices(best),
        explorer.ending,
    )
