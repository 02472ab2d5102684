"""Flat and dark frames -> samples of the detector's constants (emcee)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import NON_NEGATIVE, Floats, Parameters, Refused, parameter, printed
from startrack.optimise import Chains, Ensembles, Ledger, draw, median_and_interval

NAMES = ("electrons_per_dn", "read_noise", "dark_current", "prnu", "dark_pattern", "offset")
# Bounds of the uniform priors of all logarithms; the offset has none. Chosen by hand, beyond all
# detectors: wider ones change nothing where the levels constrain a constant.
LOW = np.array([1e-3, 1e-2, 1e-3, 1e-5, 1e-3])
HIGH = np.array([1e4, 1e4, 1e7, 0.5, 1e4])
ROUNDING = 1 / 12  # digital number squared, variance of the quantisation
SPREAD = 0.1  # of the logarithms at the start; by hand: wider than usual posteriors
# Fraction of pixels with a level's largest number, above which it is saturated. Chosen by hand: few
# pixels bias the variance little.
SATURATED = 0.05


class Level(Parameters, eq=False):
    """Two or more frames of the same exposure and light.

    frames    (m, rows, columns) digital number
    exposure  second
    lit       whether they have uniform light; else dark
    """

    frames: NDArray[np.number]
    exposure: float = parameter(limit=NON_NEGATIVE)
    lit: bool

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.frames.ndim != 3 or len(self.frames) < 2:
            raise Refused(
                f"frames must be (m, rows, columns) with m of 2 or more, got {self.frames.shape}"
            )
        if self.lit and (self.frames == self.frames.max()).mean() > SATURATED:
            raise Refused("frames must not be saturated, but many pixels have one largest value")


@printed
@dataclass(frozen=True, eq=False)
class DetectorPosterior:
    """Samples of a detector's constants, in the columns of NAMES.

    chains  natural logarithms, except of the offset
    """

    chains: Chains

    @property
    def samples(self) -> Floats:
        """(n, 6) electron / digital number, electron, electron / s, 1, electron, digital number."""
        return np.column_stack([np.exp(self.chains.flat[:, :-1]), self.chains.flat[:, -1]])

    def interval(self, name: str, fraction: float = 0.95) -> tuple[float, float, float]:
        """Median and the ends of the middle fraction of one column."""
        return median_and_interval(self.samples[:, NAMES.index(name)], fraction)


def sample_detector(
    levels: Sequence[Level],
    seed: int,
    settings: Ensembles | None = None,
    ledger: Ledger | None = None,
) -> DetectorPosterior:
    """Sample gain K, read noise, dark current, PRNU, dark pattern and offset (photon transfer).

        temporal variance  s^2 = (read^2 + dark t + e) / K^2 + 1/12 of a pixel over the frames
        spatial variance   s^2 / m + (pattern^2 + (prnu e)^2) / K^2 of the means over m frames
        dark mean          offset + dark t / K, e = K (mean - offset) - dark t if lit

    Source: EMVA 1288 release 4.0, 2.2, 3.1 and 4.1, with K the inverse of its system gain. For
    normal pixels both sample variances have gamma distributions, independent of each other and of
    the mean, so that three numbers per level have the likelihood of all pixels. Priors: uniform in
    the logarithms and in the offset.

    levels  at least one lit level, and two dark levels of different exposures
    Raises    ValueError if levels are missing, or if lit levels are not brighter.
    Accuracy  model: pixels normal and independent, more than a few tens of photons per pixel or
              dominant read noise; the signal of a lit level known to 1 / sqrt(pixels); the
              same dark pattern at all exposures.
    """
    dark = {level.exposure for level in levels if not level.lit}
    if len(dark) < 2 or not any(level.lit for level in levels):
        raise Refused("levels must hold a lit one and dark ones of two exposures")
    law = _Law([_statistics(level) for level in levels])
    middle = law.guess()

    def start(rng: np.random.Generator, n: int) -> Floats:
        return middle + law.scale * rng.standard_normal((n, len(NAMES)))

    return DetectorPosterior(draw(law, start, seed, settings, ledger))


class _LevelStatistics(NamedTuple):
    """Statistics of the frames of a level.

    mean, temporal, spatial  digital number, and squared: of all pixels, of a pixel over the
                             frames, and of the pixels' means
    """

    lit: bool
    exposure: float
    frames: int
    pixels: int
    mean: float
    temporal: float
    spatial: float


def _statistics(level: Level) -> _LevelStatistics:
    frames = np.asarray(level.frames, float)
    means = frames.mean(axis=0)
    temporal, spatial = float(frames.var(axis=0, ddof=1).mean()), float(means.var(ddof=1))
    return _LevelStatistics(
        lit=level.lit,
        exposure=level.exposure,
        frames=len(frames),
        pixels=means.size,
        mean=float(means.mean()),
        temporal=temporal,
        spatial=spatial,
    )


class _Law:
    """The logarithm of the posterior at points (w, 6)."""

    def __init__(self, levels: list[_LevelStatistics]) -> None:
        self.levels = sorted(levels, key=lambda darkest: darkest.lit)
        self.unlit = sum(not level.lit for level in levels)
        darkest = self.levels[0]
        self.scale = np.array([SPREAD] * 5 + [math.sqrt(darkest.spatial / darkest.pixels)])
        # (levels, 1), the unlit ones first
        self.columns = np.array(self.levels).T[1:, :, None]

    def __call__(self, points: Floats) -> Floats:
        clipped = np.clip(points[:, :-1], np.log(LOW), np.log(HIGH))
        gain, read, dark, prnu, pattern = np.exp(clipped).T
        exposure, frames, pixels, mean, temporal, spatial = self.columns
        off, charge, unlit = mean - points[:, -1], dark * exposure, slice(self.unlit)
        light = gain * off - charge
        light[unlit] = 0.0
        inside = (clipped == points[:, :-1]).all(axis=1) & (light >= 0).all(axis=0)
        light = np.maximum(light, 0)
        noise = (read**2 + charge + light) / gain**2 + ROUNDING
        spread = noise / frames + (pattern**2 + (prnu * light) ** 2) / gain**2
        score = _gamma(temporal, noise, pixels * (frames - 1)) + _gamma(spatial, spread, pixels - 1)
        error = (off - charge / gain)[unlit] ** 2 / (spread / pixels)[unlit]
        score[unlit] -= 0.5 * (error + np.log(spread[unlit]))
        return np.where(inside, score.sum(axis=0), -np.inf)

    def guess(self) -> Floats:
        """Estimate by classical photon transfer, from two levels for each constant."""
        unlit = sorted(
            (level for level in self.levels if not level.lit), key=lambda level: level.exposure
        )
        lit = max((level for level in self.levels if level.lit), key=lambda level: level.mean)
        short, long = unlit[0], unlit[-1]
        gain = (lit.mean - short.mean) / max(lit.temporal - short.temporal, 1e-9)
        rate = (long.mean - short.mean) / (long.exposure - short.exposure)
        light = lit.mean - short.mean
        if not light > 0:
            raise Refused(
                f"levels that are lit must be brighter than the dark ones, got means of "
                f"{lit.mean:g} and {short.mean:g}"
            )
        values = [
            gain,
            gain * math.sqrt(max(short.temporal - ROUNDING, 1e-6)),
            max(gain * rate, 1e-2),
            math.sqrt(max(lit.spatial - lit.temporal / lit.frames, 1e-9)) / light,
            gain * math.sqrt(max(short.spatial - short.temporal / short.frames, 1e-6)),
        ]
        logs = np.log(np.clip(values, 2 * LOW, HIGH / 2))
        return np.append(logs, short.mean - rate * short.exposure)


def _gamma(sample: Floats, variance: Floats, freedom: Floats) -> Floats:
    """ln density of a sample variance of normal numbers, without the constant terms."""
    return -0.5 * freedom * (np.log(variance) + sample / variance)
