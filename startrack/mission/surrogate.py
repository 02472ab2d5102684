"""Case and ranges of conditions -> Surrogate: the error of a head in any direction of the sky."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from startrack.budget import stray_light_levels, survey
from startrack.core import Floats, Refused, deg, printed
from startrack.design import Case, turning
from startrack.mission.heads import HeadView, Mounted, Shadow
from startrack.scene import added

# Directions of a survey: as far apart as a third of the half diagonal of the field. Chosen by hand:
# a quarter of the error by interpolation between nodes; the error by the roll is smaller.
FEWEST_PLACES, PLACES = 768, 12288
APART = 1 / 3
ROWS, COLUMNS = 90, 180  # cells of two degrees on the sky
# Most rates, smear between two, and magnitudes between two backgrounds. Chosen by hand: variances
# between them are 0.4 % off across and 1 % about, those of a design of 1.5 arcsec.
RATES, SMEAR, MAGNITUDE = 4, 0.3, 1.6
STATES = 3  # temperatures, and ages
CLOSE_RATES = 0.05  # relative range of rates represented by one rate
LEVELS: Floats = np.linspace(0, math.pi, 721)  # radian, of the tables of stray light


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions that the error of a head depends on, at n instants.

    line        (3, n) unit vectors of the boresight, ICRS axes
    rate        (n,) radian / second across the boresight
    background  (n,) magnitude per square arcsecond; None: that of the sky alone
    warmer      (n,) kelvin above the design; None: at one temperature
    age         (n,) second in orbit; None: at one age
    """

    line: Floats
    rate: Floats
    background: Floats | None = None
    warmer: Floats | None = None
    age: Floats | None = None


@printed
@dataclass(frozen=True, eq=False)
class SurrogateCorrection:
    """Correction of a surrogate by trials: a factor on its variances, by the conditions.

        variance of trials / variance of the budget = exp(features . coefficient)

    feature      names: "all", "rate", "background", "stars", "temperature", "age"
    scale        (k, 2) middle and half range of the value that each feature is -1 ... 1 over
    coefficient  (2, k) across and about
    spread       (2, k) standard errors
    """

    feature: tuple[str, ...]
    scale: Floats
    coefficient: Floats
    spread: Floats

    def features(self, values: dict[str, Floats]) -> Floats:
        """(n, k) of the values of each feature but "all"."""
        size = len(next(iter(values.values())))
        columns = [
            np.ones(size) if name == "all" else np.clip((values[name] - middle) / half, -1, 1)
            for name, (middle, half) in zip(self.feature, self.scale, strict=True)
        ]
        return np.stack(columns, axis=1)


@printed
@dataclass(frozen=True, eq=False)
class Surrogate:
    """Errors of a design over direction, rate across the boresight, background, temperature, age.

    rate        (r,) radian / second, rising
    background  (g,) magnitude per square arcsecond, rising: fainter
    warmer      (t,) kelvin above the design, rising
    age         (a,) second in orbit, rising
    table       (3, r, g, t, a, cells) logarithms of the variances across and about the boresight
                (radian^2), and the probability of an attitude
    stars       (cells,) logarithm of the expected number of stars, at the slowest rate
    correction  by trials; None: the errors are those of the budget
    Accuracy    model: that of `budget.analytic`, on which it is fitted: noise, neighbours and
                method of a perfect unit; turning about the boresight does not smear. numerical:
                fields of any roll count as one, and a cell of the sky (2 degrees) as its middle.
              Beside the budget of the very fields of 1024 random attitudes, the rms of the example
              mission's design is 0.4 % off across and 0.1 % about (0.9 and 1.4 % of wider fields),
              a single attitude 14 % and 24 % (68 %), and within a factor of 1.5 and 1.8 (95 %).
    """

    rate: Floats
    background: Floats
    warmer: Floats
    age: Floats
    table: Floats
    stars: Floats
    correction: SurrogateCorrection | None = None

    def __call__(self, at: Conditions) -> tuple[Floats, Floats, Floats]:
        """(n,) variances across and about (radian^2), and probabilities of an attitude.

        Beyond the table its ends hold.
        """
        cell = cell_of(at.line)
        low_rate, part_rate = _between(self.rate, at.rate)
        corners: list[tuple[tuple[Any, ...], Any]] = [((), None)]
        for grid, value in (
            (self.background, at.background),
            (self.warmer, at.warmer),
            (self.age, at.age),
        ):
            if value is None or len(grid) == 1:
                corners = [((*index, len(grid) - 1), weight) for index, weight in corners]
                continue
            low, part = _between(grid, value)
            corners = [
                ((*index, low + k), share if weight is None else weight * share)
                for index, weight in corners
                for k, share in enumerate((1 - part, part))
            ]
        values = np.zeros((3, len(cell)))
        for index, weight in corners:
            here = self.table[(slice(None), low_rate, *index, cell)]
            if part_rate is not None:
                above = self.table[(slice(None), low_rate + 1, *index, cell)]
                here = here + part_rate * (above - here)
            values += here if weight is None else weight * here
        if self.correction is not None:
            used = self.correction.features(self.values(at, cell))
            values[:2] += self.correction.coefficient @ used.T
        return np.exp(values[0]), np.exp(values[1]), values[2]

    def factor(self, at: Conditions) -> Floats:
        """(2, n) or (2, 1), by which trials correct the variances across and about."""
        if self.correction is None:
            return np.ones((2, 1))
        features = self.correction.features(self.values(at))
        return np.asarray(np.exp(self.correction.coefficient @ features.T))

    def values(self, at: Conditions, cell: NDArray[np.intp] | None = None) -> dict[str, Floats]:
        """Conditions that a correction may depend on, each (n,); those that differ alone."""
        values = {"stars": self.stars[cell_of(at.line) if cell is None else cell]}
        for name, grid, value in (
            ("rate", self.rate, at.rate),
            ("background", self.background, at.background),
            ("temperature", self.warmer, at.warmer),
            ("age", self.age, at.age),
        ):
            if len(grid) > 1 and value is not None:
                values[name] = np.clip(value, grid[0], grid[-1])
        return values


def _between(grid: Floats, value: Floats):  # type: ignore[no-untyped-def]
    """Index of the lower of the two entries around each value, and where it is between them."""
    if len(grid) == 1:
        return 0, None
    low = np.clip(np.searchsorted(grid, value) - 1, 0, len(grid) - 2)
    return low, np.clip((value - grid[low]) / (grid[low + 1] - grid[low]), 0, 1)


def cell_of(line: Floats) -> NDArray[np.intp]:
    """(n,) cell of the sky of unit vectors (3, n), by declination and right ascension."""
    up = np.arcsin(np.clip(line[2], -1, 1)) * (ROWS / math.pi) + ROWS / 2
    row = np.minimum(up.astype(np.intp), ROWS - 1)
    turn = np.arctan2(line[1], line[0]) * (COLUMNS / math.tau) + COLUMNS
    return np.asarray(row * COLUMNS + turn.astype(np.intp) % COLUMNS)


def middles() -> Floats:
    """(cells, 3) unit vectors to the middles of the cells."""
    z = np.sin(((np.repeat(np.arange(ROWS), COLUMNS) + 0.5) / ROWS - 0.5) * math.pi)
    turn = (np.tile(np.arange(COLUMNS), ROWS) + 0.5) * math.tau / COLUMNS
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


@dataclass(frozen=True)
class Ranges:
    """Ranges of a head's rate, background, temperature and age in a mission.

    rate        radian / second, slowest and fastest across the boresight
    brightest   magnitude per square arcsecond, of the sky with stray light
    warmer      kelvin above the design
    age         second in orbit; None: the design as it is
    """

    rate: tuple[float, float]
    brightest: float
    warmer: tuple[float, float] = (0.0, 0.0)
    age: tuple[float, float] | None = None


def surrogate_of(
    case: Case,
    ranges: Ranges,
    state: Callable[[float | None, float], Case] | None = None,
    advance: Callable[[float], None] = lambda _: None,
) -> Surrogate:
    """A surrogate, fitted on the analytic budget over the sky at each rate, background and state.

    state      age (None: as the design) and kelvin above the design -> the case; None: the case
               does not change
    advance    called after each survey with its fraction of all surveys
    Raises     ValueError if the budget refuses the case, or where no field has an attitude at
               one of the rates and states without stray light. With stray light, no attitude is a
               probability of 0.
    """
    slow, fast = ranges.rate
    close = fast - slow < CLOSE_RATES * fast or fast < 1e-6
    smear = (
        (fast - slow) * case.instrument.detector.exposure * case.instrument.camera.focal_length_px
    )
    count = min(1 + max(math.ceil(smear / SMEAR), 1), RATES)
    rate = np.array([(slow + fast) / 2]) if close else np.linspace(slow, fast, count)
    faintest = case.scene.sky_g
    steps = max(math.ceil((faintest - ranges.brightest) / MAGNITUDE - 1e-6), 0)
    background = np.linspace(min(ranges.brightest, faintest), faintest, steps + 1)
    cold, hot = ranges.warmer
    warmer = np.linspace(cold, hot, STATES) if hot > cold else np.array([cold])
    age = np.zeros(1) if ranges.age is None else np.linspace(*ranges.age, STATES)
    shape = (len(rate), len(background), len(warmer), len(age))
    tables: Floats = np.empty((3, *shape, ROWS * COLUMNS))
    stars: Floats = np.empty(0)
    for r, g, t, a in np.ndindex(*shape):
        g = len(background) - 1 - g  # the faintest first
        years = None if ranges.age is None else float(age[a])
        here, sky = state(years, float(warmer[t])) if state else case, float(background[g])
        try:
            table, stars = _survey(here, float(rate[r]), sky, sky < faintest)
        except Refused:
            if g == len(background) - 1:
                raise
            table = tables[:, r, g + 1, t, a].copy()  # so bright that no field has an attitude
            table[2] = 0.0
        tables[:, r, g, t, a] = table
        advance(1 / math.prod(shape))
    return Surrogate(rate, background, warmer, age, tables, stars)


def _survey(case: Case, rate: float, background: float, lit: bool) -> tuple[Floats, Floats]:
    """(3, cells): logarithms of the variances, probability of an attitude; (cells,) of stars."""
    case = turning(case, rate)
    if lit:
        case = replace(case, scene=replace(case.scene, background_g=background))
    places = survey(case, places_of(case))
    _, nearest = cKDTree(places.direction).query(middles())
    finite = np.isfinite(places.across)
    across, about = (
        np.log(np.where(finite, error, float(error[finite].max())) ** 2)
        for error in (places.across, places.about)
    )
    stars = np.log(np.maximum(places.stars, 1.0))
    return np.stack([across, about, places.solved])[:, nearest], stars[nearest]


def places_of(case: Case) -> int:
    """Directions of a survey over the sky with the field of a case."""
    places = 4 * math.pi / (APART * case.instrument.camera.half_diagonal) ** 2
    return min(max(round(places), FEWEST_PLACES), PLACES)


@printed
@dataclass(frozen=True, eq=False)
class StrayLight:
    """Background of a head with the light that its baffle lets through.

    sky     1 / (arcsec^2 of magnitude 0), brightness of the sky without stray light
    bodies  "sun", "moon", "earth" -> (721,) brightness at angles of LEVELS
    """

    sky: float
    bodies: dict[str, Floats]

    def __call__(self, seen: HeadView, shadow: Shadow) -> Floats:
        """(n,) magnitude per square arcsecond.

        Accuracy  model: a full Moon and a noon Earth at 600 km at all times, unless hidden or dark
                  at the limb, so that the background is too bright rather than too dark.
        """
        light = np.full(len(seen.sun), self.sky)
        for name, angle, hidden in (
            ("sun", seen.sun, shadow.sun),
            ("moon", seen.moon, shadow.moon),
            ("earth", seen.earth, ~np.isfinite(seen.earth)),
        ):
            at = np.clip(np.where(hidden, 0.0, angle), 0, math.pi) * ((len(LEVELS) - 1) / math.pi)
            light += np.where(hidden, 0.0, self.bodies[name][at.astype(np.intp)])
        return -2.5 * np.log10(light)


def stray_light_of(case: Case, head: Mounted) -> tuple[StrayLight, float] | None:
    """The stray light of a head, and its brightest background outside its exclusion angles.

    Returns  None where the case has no baffle
    """
    if case.instrument.stray is None:
        return None
    levels = stray_light_levels(case, np.maximum(LEVELS, 0.05 * deg))
    sky, limits = case.scene.sky_g, head.limits
    outside = [
        float(np.interp(angle, LEVELS, levels[name]))
        for name, angle in (("sun", limits.sun), ("moon", limits.moon), ("earth", limits.earth))
    ]
    bodies = {name: 10 ** (-0.4 * level) for name, level in levels.items()}
    return StrayLight(10 ** (-0.4 * sky), bodies), added([sky, *outside])
