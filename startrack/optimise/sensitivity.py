"""Designs around a design -> dependence of the objective on each variable, alone and with
others."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from startrack.core import Advance, Floats, Refused, Streams, whole
from startrack.metrics import Interval
from startrack.optimise.evaluate import Foresight
from startrack.optimise.gaussian_process import Emulator, emulator
from startrack.optimise.source import StudiedSource

STEP = 0.01  # step of derivatives, fraction of a range; by hand: forecasts are smooth over it
# Designs over the space. Chosen by hand: more designs narrow the intervals that the result states.
DESIGNS = 128
BASE = 2**12  # base designs of the indices, each emulated in d + 2 places: an error of 1 %
GROUPS = 16  # groups of designs; each is left out once; chosen by hand


@dataclass(frozen=True)
class Sensitivity:
    """Dependence of the objective on one variable.

    name       name of the variable
    error      the objective at the design; arcsec for a star tracker
    low, high  the objective with only this variable at its bound; NaN if there is no forecast
    slope      d ln(objective) / d ln(variable) at the design; NaN if the variable is 0
    first      first-order Sobol index with its 95 % interval: fraction of the variance of
               ln(objective) over the design space that is due to this variable alone
    total      total index: the fraction that would be left if all others were known
    """

    name: str
    error: float
    low: float
    high: float
    slope: float
    first: Interval
    total: Interval


class Probes(NamedTuple):
    """Forecasts of a design and of others around it.

    points      unit-cube coordinates: the design; for each variable two designs a step away; for
                each variable two designs at its bounds; and designs over the whole space
    foresights  forecast of each
    dimensions  number of variables
    """

    points: tuple[Floats, ...]
    foresights: tuple[Foresight, ...]
    dimensions: int

    @property
    def here(self) -> Foresight:
        """Forecast of the design."""
        return self.foresights[0]

    def beside(self, axis: int) -> tuple[tuple[Floats, Foresight], tuple[Floats, Foresight]]:
        """A step below and above along an axis: points and forecasts."""
        return self._pair(1 + 2 * axis)

    def ends(self, axis: int) -> tuple[tuple[Floats, Foresight], tuple[Floats, Foresight]]:
        """At the low and the high bound along an axis."""
        return self._pair(1 + 2 * self.dimensions + 2 * axis)

    @property
    def over(self) -> tuple[Floats, Floats]:
        """Points (n, d) over the space, and ln(objective) there."""
        first = 1 + 4 * self.dimensions
        values = [foresight.expected for foresight in self.foresights[first:]]
        return np.array(self.points[first:]), np.array(values)

    def _pair(self, at: int) -> tuple[tuple[Floats, Foresight], tuple[Floats, Foresight]]:
        low, high = zip(self.points[at : at + 2], self.foresights[at : at + 2], strict=True)
        return low, high


def sensitivities(
    source: StudiedSource, designs: int = DESIGNS, progress: Advance | None = None
) -> list[Sensitivity]:
    """Derivatives at the design, excursions to the bounds, and Sobol indices over the space.

    All values are by forecasts, which have no noise. The indices are for ln(objective), because an
    error over a wide range spans decades. They are computed from an emulator, fitted to the budgets
    of the designs of a Sobol sequence. Estimators: Saltelli et al. (2010), table 2 (b), for the
    first-order index, and Jansen (1999), table 2 (f) there, for the total index. Intervals: two
    standard errors by a jackknife over groups of the designs to which the emulator is fitted (Efron
    and Tibshirani 1993, An Introduction to the Bootstrap, 11.5).

    designs  number of designs over the space, a power of two
    progress  called with 1 for each of these designs, and for four more per variable
    Returns  sensitivities in the order of the variables; for a single variable both indices are 1
    Raises    ValueError if the design has no forecast, or if most of the space has none.
    Accuracy  model: as the forecasts; a design without a forecast has the largest objective.
    """
    return sensitivities_of(source, probe(source, designs, progress))


def probe(source: StudiedSource, designs: int, progress: Advance | None = None) -> Probes:
    """Forecast the designs that `sensitivities` needs; arguments and refusals as there.

    The design and the designs a step away are forecast in all conditions, the others only in
    conditions that have a weight.
    """
    whole(2, 2**20, designs=designs)
    if designs & (designs - 1):
        raise Refused(f"designs must be a power of two, got {designs}")
    d, centre = len(source.names), source.start
    near = [point for axis in range(d) for point in _beside(source, centre, axis)]
    far = [_moved(centre, axis, end) for axis in range(d) for end in (0.0, 1.0)]
    if d > 1:
        far += list(_spread(d, designs, Streams(source.seed, 0)("designs of the indices")))
    here = source.foresee_any([centre])
    if not math.isfinite(here[0].expected):
        raise Refused("the design must have a forecast, it has none")
    seen = source.foresee_any(near, progress=progress)
    seen += source.foresee_any(far, weighted=True, progress=progress)
    return Probes((centre, *near, *far), (*here, *seen), d)


def sensitivities_of(source: StudiedSource, probes: Probes) -> list[Sensitivity]:
    """The sensitivities by forecasts that are known."""
    fractions = [(Interval(1.0, 1.0, 1.0),) * 2]
    if probes.dimensions > 1:
        points, values = probes.over
        fractions = sobol_indices(points, _filled(values))
    result = []
    for axis, (name, value) in enumerate(source.start_values.items()):
        (before, below), (after, above) = probes.beside(axis)
        rise, step = above.expected - below.expected, source.value(after, name)
        slope = rise / (step - source.value(before, name)) * value if value else math.nan
        slope += 0.0  # not -0
        low, high = (math.exp(foresight.expected) for _, foresight in probes.ends(axis))
        here = math.exp(probes.here.expected)
        result.append(Sensitivity(name, here, low, high, slope, *fractions[axis]))
    return result


def _spread(d: int, count: int, random: np.random.Generator) -> Floats:
    """Points (n, d) of a scrambled Sobol sequence."""
    return np.asarray(scipy.stats.qmc.Sobol(d, rng=random).random(count))


def sobol_indices(points: Floats, values: Floats) -> list[tuple[Interval, Interval]]:
    """First-order and total index of each of d variables, with their 95 % intervals.

    By an emulator through the values, as for `sensitivities`.

    points    (n, d) in the unit cube
    values    (n,) there, in any unit
    Accuracy  statistical: 1 % of the base designs, and the error of the emulator, which the
              intervals state.
    """
    d = points.shape[1]
    base = _spread(2 * d, BASE, Streams(0, 0)("base designs of the indices"))
    first, second = base[:, :d], base[:, d:]
    mixed = np.array([np.where(np.arange(d) == i, second, first) for i in range(d)])
    every = np.concatenate([first, second, *mixed])

    def of(model: Emulator) -> Floats:
        f_a, f_b, *f_ab = model.expected(every).reshape(d + 2, 1, BASE)
        return np.concatenate(_saltelli_jansen(f_a, f_b, np.array(f_ab)))

    model, group = emulator(points, values), np.arange(len(points)) % min(GROUPS, len(points))
    value = of(model)
    without = np.array([of(model.of_some(group != fold)) for fold in np.unique(group)])
    count = len(without)
    error = np.sqrt((count - 1) / count * ((without - without.mean(axis=0)) ** 2).sum(axis=0))
    low, high = value - 2 * error, value + 2 * error
    alone, total = (
        [Interval(*map(float, bounds)) for bounds in zip(value[k], low[k], high[k], strict=True)]
        for k in range(2)
    )
    return list(zip(alone, total, strict=True))


def _saltelli_jansen(f_a: Floats, f_b: Floats, f_ab: Floats) -> tuple[Floats, Floats]:
    """First-order and total indices (d,).

        S = mean(f_b (f_ab - f_a)) / V,   T = mean((f_a - f_ab)^2) / (2 V)

    f_a, f_b  (1, n) values at two independent sets of points, V their variance
    f_ab      (d, 1, n) values at the points of the first with one coordinate of the second
    """
    variance = np.var([f_a, f_b], axis=(0, -1))
    first = np.mean(f_b * (f_ab - f_a), axis=-1) / variance
    total = 0.5 * np.mean((f_a - f_ab) ** 2, axis=-1) / variance
    return first.T, total.T


def _beside(source: StudiedSource, centre: Floats, axis: int) -> tuple[Floats, Floats]:
    """Designs below and above a design along an axis, far enough for whole numbers to differ."""
    name = source.names[axis]
    step, low, high = STEP, centre, centre
    while source.value(low, name) == source.value(high, name):
        ends = np.clip([centre[axis] - step, centre[axis] + step], 0, 1).tolist()
        low, high = (_moved(centre, axis, end) for end in ends)
        step *= 2
    return low, high


def _moved(coordinates: Floats, axis: int, to: float) -> Floats:
    moved = coordinates.copy()
    moved[axis] = to
    return moved


def _filled(values: Floats) -> Floats:
    """The values with the largest in place of those that are not finite."""
    finite = np.isfinite(values)
    if not finite.mean() > 0.5:
        raise Refused(
            "more than half of the design space has no forecast; its indices mean nothing"
        )
    return np.where(finite, values, values[finite].max())
