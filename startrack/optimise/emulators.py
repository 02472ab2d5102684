"""Forecasts of designs -> emulators of the objective and of each margin, and their least score."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from startrack.core import Flags, Floats, Refused
from startrack.optimise.correction import Correction
from startrack.optimise.evaluate import PENALTY, Foresight
from startrack.optimise.explorer_settings import DEFAULTS, ExplorerSettings
from startrack.optimise.gaussian_process import Emulator, emulator
from startrack.optimise.search import minimise_smooth

SOLVED = "solved"  # an emulated margin: 1 if a design has a forecast, -1 if it has none


class Scale(NamedTuple):
    """Scale on which a margin is emulated: from -1 to 1, with the sign of the margin.

    It is most sensitive near zero:

        other margins     m / sqrt(m^2 + margin_width^2)
        of probabilities  x / sqrt(x^2 + 1),   x = ln(room / (room - m))

    x compares the unavailability with its limit.

    room      1, for a probability: one minus the required probability; 0 for any other margin
    settings  settings, of which the scale uses `margin_width` and `least_chance`
    """

    room: float = 0.0
    settings: ExplorerSettings = DEFAULTS

    def of(self, margin: Floats) -> Floats:
        """The place on the scale of margins."""
        if not self.room:
            return np.asarray(margin / np.hypot(margin, self.settings.margin_width))
        least = self.settings.least_chance * self.room
        log = np.log(self.room / np.maximum(self.room - margin, least))
        return np.asarray(log / np.hypot(log, 1.0))

    def missing(self, place: Floats) -> Floats:
        """Amounts by which margins are missed, from their places on the scale."""
        short = np.clip(-place, 0.0, 0.999)
        ratio = short / np.sqrt(1 - short**2)
        if self.room:
            return self.room * np.expm1(np.minimum(ratio, 20.0))
        return self.settings.margin_width * ratio


class WholeNumbers(Protocol):
    """Designs with some coordinates that stand for whole numbers."""

    @property
    def whole(self) -> Flags:
        """Flags (d,): which coordinates stand for whole numbers."""

    def snapped(self, point: Floats) -> Floats:
        """The point (d,) with its whole numbers rounded."""


@dataclass(frozen=True, eq=False)
class Emulators:
    """Expected values of any design, from all forecasts together.

    objective  emulator of ln(error / arcsec)
    margins    emulators of the margins that some design misses, by name, each on its scale
    scales     scales of the margins that are probabilities, by name
    settings   settings of the other scales, and by how much a limit must be met
    """

    objective: Emulator
    margins: dict[str, Emulator]
    scales: Mapping[str, Scale]
    settings: ExplorerSettings = DEFAULTS

    def scale(self, name: str) -> Scale:
        """The scale of a margin."""
        return self.scales.get(name, Scale(settings=self.settings))

    def score(self, points: Floats, sigmas: float = 0.0) -> Floats:
        """The score (m,) of designs (m, d), with all values better by some standard deviations."""
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
        steps: WholeNumbers | None = None,
    ) -> tuple[Floats, float]:
        """The design of the least score, by nlopt's SLSQP (Kraft 1994) from some starts (m, d).

        correction  correction that is added to the objective
        box         (d,) least and largest coordinates; None: the whole cube
        steps       whole numbers among the coordinates, which the starts respect. After they are
                    rounded, the other coordinates are searched again. None: there are none
        Returns     the design (d,) and its score
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
            return self.settings.safe_margin / self.settings.margin_width - bound

        limits = [partial(missing, margin=margin) for margin in self.margins.values()]
        for start in starts:
            found = minimise_smooth(value, limits, start, (low, high))
            if steps and steps.whole.any():
                found = steps.snapped(found)
                held = np.where(steps.whole, found, low), np.where(steps.whole, found, high)
                found = minimise_smooth(value, limits, found, held)
            for end in (start, found):
                score = float(self.score(end[None], sigmas)[0])
                score += correction(end) if correction else 0.0
                if score < least:
                    best, least = end, score
        return best, least

    def with_point(self, point: Floats) -> Emulators:
        """The emulators with their own prediction as the value at one more design (d,)."""
        margins = {name: margin.with_point(point) for name, margin in self.margins.items()}
        return replace(self, objective=self.objective.with_point(point), margins=margins)


def emulators(
    points: Floats,
    values: Sequence[Foresight],
    scales: Mapping[str, Scale],
    like: Emulators | None = None,
    settings: ExplorerSettings = DEFAULTS,
) -> Emulators:
    """The emulators of some forecasts.

    scales   scales of the margins that are probabilities, by name
    like     emulators of fewer forecasts of the same space
    Raises   Refused if no design has a forecast.
    """
    beyond = settings.inexact_objective
    expected = np.array([value.expected for value in values])
    finite = np.isfinite(expected)
    if not finite.any():
        raise Refused("none of the designs that were tried has a forecast")
    least = expected[finite].min()
    above = np.clip(np.where(finite, expected - least, 0.0), 0.0, settings.clipped_objective)
    fewest = np.sort(above[finite])[: settings.exact_per_variable * points.shape[1]][-1]
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
            place = scales.get(name, Scale(settings=settings)).of(margin)
            # Margins that all designs have are of costs, which are smooth everywhere.
            missed = settings.inexact_margin
            short = np.maximum(-place - missed, 0.0) / missed
            unsure = None if present.all() else doubt[present] + short**2
            margins[name] = emulator(points[present], place, alike.get(name), unsure)
    return Emulators(objective, margins, scales, settings)
