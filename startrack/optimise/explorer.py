"""Source of designs -> forecasts of the most informative designs, and emulators of these."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import islice

import numpy as np

from startrack.core import Floats, Streams
from startrack.optimise.emulators import Emulators, Scale, emulators
from startrack.optimise.evaluate import Foresight, missed
from startrack.optimise.explorer_settings import DEFAULTS, ExplorerSettings
from startrack.optimise.forecast import name_by_condition
from startrack.optimise.landscape import Landscape, Span, prices_of, spans_of
from startrack.optimise.limit import Evidence, Limit
from startrack.optimise.search import Search, minimise_within_limits
from startrack.optimise.source import DesignSource, affordable


@dataclass(eq=False)
class Explorer:
    """The forecasts of designs so far, and emulators that predict the values of any other design.

    The next designs are those with the least mean of the emulators, and with the least lower
    confidence bound, at `sigmas`.

    Source: Cox and John (1992), IEEE Conference on Systems, Man and Cybernetics.

    label     label of the branch of the designs
    points    coordinates (d,) of the designs in the unit cube
    limits    limits of the margins that trials decide, by name: the margins that fresh trials can
              confirm, and the correction of forecasts by trials; none: no correction
    raw       forecasts of the designs by the budget, without correction
    values    the forecasts after the correction by `limits`
    ending    why the search ended; empty while it runs
    watch     called after new forecasts
    settings  of the choice of designs and of the emulators
    """

    source: DesignSource
    label: str = ""
    points: list[Floats] = field(default_factory=list)
    limits: Mapping[str, Limit] = field(default_factory=dict)
    raw: list[Foresight] = field(default_factory=list)
    values: list[Foresight] = field(default_factory=list)
    ending: str = ""
    watch: Callable[[], None] | None = None
    settings: ExplorerSettings = DEFAULTS
    _emulators: tuple[int, Emulators] | None = None
    _spanned: float = np.inf  # score below which the ends of the spans are forecast again
    _polished: float = np.inf  # score below which designs next to the best are forecast again
    _in_vain: int = 0  # batches without a gain

    @cached_property
    def scales(self) -> dict[str, Scale]:
        """Scale of each margin that is a probability, by name."""
        return {name: Scale(room, self.settings) for name, room in self.source.rooms.items()}

    def forecast(self, points: Sequence[Floats]) -> None:
        """Add the forecasts of some designs, and of the best design in all conditions."""
        self._add(points)
        self.complete()

    def _add(self, points: Sequence[Floats]) -> None:
        new = [self.source.snapped(np.clip(point, 0, 1)) for point in points]
        enough = self.score + self.settings.bad_score if self._all_conditions_matter else -math.inf
        raw = self.source.foresee(new, enough)
        self.values += map(self._corrected, new, raw)
        self.raw += raw
        self.points += new
        if self.watch:
            self.watch()

    def _corrected(self, point: Floats, raw: Foresight) -> Foresight:
        margins = {
            name: self.limits[name].corrected(point, margin) if name in self.limits else margin
            for name, margin in raw.margins.items()
        }
        return raw._replace(margins=margins)

    def correct_limits(self, evidence: Mapping[str, Sequence[Evidence]]) -> None:
        """Correct the forecasts of the margins in `limits` by trials.

        evidence  forecasts and trials, by the margin's name
        """
        self.limits = {
            name: limit.fitted(evidence.get(name, ())) for name, limit in self.limits.items()
        }
        self.values = list(map(self._corrected, self.points, self.raw))
        self._refit_emulators()
        self.complete()

    def _refit_emulators(self) -> None:
        """Fit the emulators again, because values of known designs have changed."""
        if self._emulators:
            self._emulators = 0, self._emulators[1]

    def complete(self) -> bool:
        """Forecast the best design in all conditions; repeat if another design is then the best.

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
        """Forecast a design in all conditions. Returns whether a forecast was missing."""
        if self.source.conditions.keys() <= self.raw[number].conditions.keys():
            return False
        point = self.points[number]
        self.raw[number] = self.source.complete(point, self.raw[number])
        self.values[number] = self._corrected(point, self.raw[number])
        self._refit_emulators()
        return True

    @property
    def _all_conditions_matter(self) -> bool:
        """Whether conditions without a weight may limit a design, by the good designs so far."""
        good = [
            value
            for value in self.values
            if value.score <= self.score + self.settings.good_score and len(value.conditions) > 1
        ]
        if len(good) < self.settings.good_designs:
            return True
        far = 1 - self.settings.margin_width
        weighted = {name for name, weight in self.source.conditions.items() if weight}
        return not all(
            name in weighted
            or all(
                part < far
                for part in self._used_fractions(value, name_by_condition(name, own.margins))
            )
            for value in good
            for name, own in value.conditions.items()
        )

    def _used_fractions(self, value: Foresight, names: Iterable[str]) -> list[float]:
        """Fraction of its limit that a design uses, for each of some margins."""
        rooms = [(name, self.scales.get(name, Scale()).room or 1.0) for name in names]
        return [(room - value.margins[name]) / room for name, room in rooms]

    def near_limits(self, point: Floats) -> list[str]:
        """Names of the conditions in which the forecast of a design is near a limit."""
        value, near = self.forecast_of(point), self.settings.close_part
        return [
            name
            for name, own in value.conditions.items()
            if any(
                part > near
                for part in self._used_fractions(value, name_by_condition(name, own.margins))
            )
        ]

    def met(self, point: Floats) -> bool:
        """Whether fresh trials will probably show that a design meets, or nearly meets, all
        limits."""
        value = self.forecast_of(point)
        needless = [margin for name, margin in value.margins.items() if name not in self.limits]
        limited = value.margins.keys() & self.limits.keys()
        parts = self._used_fractions(value, limited)
        most = 1 + self.settings.short_part
        return all(margin >= 0 for margin in needless) and all(part <= most for part in parts)

    def uncorrected_forecast(self, point: Floats) -> Foresight:
        """The forecast of a design in all conditions, without the correction by trials."""
        self.forecast_of(point)
        point = self.source.snapped(point)
        number = next(i for i, other in enumerate(self.points) if (other == point).all())
        self._complete(number)
        return self.raw[number]

    def forecast_of(self, point: Floats) -> Foresight:
        """The forecast of a design; a new one is added."""
        point = self.source.snapped(point)
        value = self._known(point)
        if value is None:
            self.forecast([point])
            return self.values[-1]
        return value

    def _known(self, point: Floats) -> Foresight | None:
        for other, value in zip(self.points, self.values, strict=True):
            if (other == point).all():
                return value
        return None

    @property
    def emulators(self) -> Emulators:
        """Emulators of all forecasts so far."""
        if self._emulators is None or self._emulators[0] < len(self.points):
            like = self._emulators[1] if self._emulators else None
            fitted = emulators(np.array(self.points), self.values, self.scales, like, self.settings)
            self._emulators = len(self.points), fitted
        return self._emulators[1]

    @property
    def best(self) -> Floats:
        """Design of the least score among those that meet all limits; if none does, among all."""
        return self.points[self._leader]

    @property
    def _leader(self) -> int:
        ranks = [(missed(value.margins) > 0, value.score) for value in self.values]
        return min(range(len(ranks)), key=ranks.__getitem__)

    @property
    def score(self) -> float:
        """The score of the best design so far; infinite if none has one."""
        return self.values[self._leader].score if self.values else math.inf

    def reopen(self) -> None:
        """Let `step` search again, because trials have changed the limits."""
        self.ending, self._in_vain = "", 0
        self._spanned = self._polished = np.inf

    def begin(self, start: Floats, most: int) -> None:
        """Forecast the start, and designs over the whole space whose costs meet their limits."""
        per_variable, besides = self.settings.first_per_variable, self.settings.first_besides
        count = min(per_variable * len(self.source.names) + besides, most)
        random = self._random(0, "first designs to forecast")
        others = list(islice(affordable(self.source, random), count - 1))
        # Of the others, bad designs need fewer conditions once the first ones have values.
        batch = self.settings.batch
        self._add([start, *others[: batch - 1]])
        self._add(others[batch - 1 :])

    def step(self, most: int) -> None:
        """Forecast the next designs, or say in `ending` why there are none.

        If the emulators propose no design, the ends of the spans are forecast. The emulators
        predict that these are as good as the best design, and the forecasts test this prediction.
        After these, designs next to the best are forecast, because emulators cannot resolve gains
        below the roughness of the forecasts. After several batches of proposals without a gain, no
        more proposals are made, because only this roughness causes them. One more batch follows
        the designs next to the best.

        most  largest number of forecasts
        """
        worth = self.settings.worthwhile_gain * self.source.precision
        stalled = self._in_vain >= self.settings.patience
        points = [] if stalled else self._proposals()
        if not points and self.complete():
            return
        points = points or self._new_ends_of_spans()
        before = self.score
        if points:
            self._add(points[:most])
            gained = self.score < before - worth or not np.isfinite(before)
            self._in_vain = 0 if gained else self._in_vain + 1
        elif before < self._polished:
            self._forecast_near_best(most)
            if not self.score < before - worth:
                self._polished = self.score - worth
            # The emulators know more of the valley now: one more batch of their proposals.
            self._in_vain = min(self._in_vain, self.settings.patience - 1)
        elif stalled:
            self.ending = f"designs next to the best gain less than {100 * worth:g} %"
        else:
            gain = 100 * self.source.precision
            self.ending = f"a further gain is expected to be below {gain:g} %"

    def _new_ends_of_spans(self) -> list[Floats]:
        """Ends of the spans without a forecast; none until the score has improved since the last
        ones."""
        if not (self.score < self._spanned and np.isfinite(self.score)):
            return []
        self._spanned = self.score - self.source.precision
        points = list[Floats]()
        for span in self.spans(self.best):
            for end in map(self.source.snapped, (span.at_low, span.at_high)):
                if self.is_new(end, points):
                    points.append(end)
        return points

    def _forecast_near_best(self, most: int) -> None:
        """Forecast designs next to the best, chosen by COBYLA with the margins as limits."""
        free, best = ~self.source.whole, self.best
        names = list(self.values[self._leader].margins)
        evaluations = min(self.settings.polish_per_variable * int(free.sum()), most)
        if not evaluations:
            return

        def at(place: Floats) -> Foresight:
            point = best.copy()
            point[free] = place
            known = self._known(point)
            if known is None:
                self._add([point])
                known = self.values[-1]
            return known

        def value(place: Floats) -> float:
            expected, worst = at(place).expected, self.score + self.settings.clipped_objective
            return min(expected, worst) if math.isfinite(expected) else worst

        def missing(place: Floats, name: str) -> float:
            margins = at(place).margins
            if name not in margins:  # the condition of the margin has no forecast
                return 0.0
            scale = self.scales.get(name, Scale(settings=self.settings))
            least = self.settings.safe_margin / self.settings.margin_width
            return least - float(scale.of(np.array(margins[name])))

        limits = [partial(missing, name=name) for name in names]
        steps = self.settings.polish_step, self.settings.same_design
        search = Search(evaluations=evaluations, first_step=steps[0], last_step=steps[1])
        minimise_within_limits(value, limits, best[free], search)
        self.complete()

    def _proposals(self) -> list[Floats]:
        """The next designs; none if the expected gain of each is too small.

        The first is the best by the emulators' means. The others are the best by lower bounds; for
        each, the predictions for the earlier ones are assumed to be exact.
        """
        model, starts = self.emulators, self.starts()
        least, worth = self.score, self.settings.worthwhile_gain * self.source.precision
        proposed, bound = list[Floats](), self.settings.sigmas
        for sigmas, gain in ((0.0, worth), *[(bound, 2.5 * worth)] * (self.settings.batch - 1)):
            point, score = model.least(starts, sigmas, steps=self.source)
            if least - score > gain and self.is_new(point, proposed):
                proposed.append(point)
                model = model.with_point(point)
                least = min(least, float(model.score(point[None])[0]))
        return proposed

    def is_new(self, point: Floats, others: Sequence[Floats]) -> bool:
        """Whether a design differs from all that have a forecast, and from `others`."""
        every = np.array([*self.points, *others])
        return bool(np.abs(every - point).max(axis=1).min() > self.settings.same_design)

    def starts(self) -> Floats:
        """Designs (m, d) from which searches start: the best so far, and the best of random
        ones."""
        settings, random = self.settings, self._random(len(self.points), "designs to forecast")
        order = np.argsort([value.score for value in self.values], kind="stable")
        order = order[: settings.leaders]
        leaders = np.array([self.points[number] for number in order])
        pool = random.random((settings.pool, len(self.source.names)))
        shift = settings.leader_spread * random.standard_normal((len(leaders), *pool.shape))
        near = leaders[:, None] + shift
        pool = np.vstack([pool, np.clip(near.reshape(-1, len(self.source.names)), 0, 1)])
        if self.source.whole.any():
            pool = np.array(list(map(self.source.snapped, pool)))
        good = np.argsort(self.emulators.score(pool, settings.sigmas), kind="stable")
        return np.vstack([leaders[:2], pool[good[: settings.leaders]]])

    def _random(self, number: int, what: str) -> np.random.Generator:
        return Streams(self.source.seed, number)(f"{what} {self.label}".strip())

    def lowest(self) -> float:
        """Lower bound of the score of any design, with 98 % confidence, by the emulators."""
        return min(
            self.score,
            self.emulators.least(self.starts(), self.settings.sigmas, steps=self.source)[1],
        )

    def spans(self, best: Floats) -> list[Span]:
        """Span of each variable around a design; see `spans_of`."""
        return spans_of(self.emulators, best, self.source.precision)

    def landscape(self, best: Floats) -> Landscape:
        """Forecasts of all designs, and spans and prices around one of them."""
        every = zip(self.points, self.values, strict=True)
        tried = [(point, value) for point, value in every if not value.left_out]
        return Landscape(
            forecasts=tuple(tuple(point.tolist()) for point, _ in tried),
            expected=tuple(value.expected for _, value in tried),
            met=tuple(
                math.isfinite(value.expected) and not missed(value.margins) for _, value in tried
            ),
            left=max(0.0, self.score - self.lowest()),
            spans=dict(zip(self.source.names, self.spans(best), strict=True)),
            prices=prices_of(self.emulators, best, self.source.precision),
            ending=self.ending,
        )
