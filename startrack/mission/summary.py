"""Flown -> availability, times without an attitude, reacquisition, verdicts; table of steps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from startrack.core import Advance, Flags, Floats, Ints, Rows, Unit, arcsec, deg, printed, utc
from startrack.design import Case
from startrack.io import save_netcdf
from startrack.mission import files
from startrack.mission.engine import CHUNK, Chunk, Flown, MissionPlan, at
from startrack.mission.heads import Blind
from startrack.mission.parameters import MissionRequirements

EDGES = (0.0, 10.0, 30.0, 60.0, 300.0, 900.0, 3600.0, np.inf)  # second, of the histogram


@printed
@dataclass(frozen=True, eq=False)
class TimeIntervals:
    """Uninterrupted times in which something holds.

    begin   (k,) second after the begin of the mission
    length  (k,) second; each end is right to a step
    """

    begin: Annotated[Floats, Unit("s")]
    length: Annotated[Floats, Unit("s")]

    @property
    def longest(self) -> float:
        """Second; 0 where it never holds."""
        return float(self.length.max(initial=0.0))

    def histogram(self) -> Ints:
        """Number of intervals in each of the classes of EDGES, the upper edge included."""
        inside = np.searchsorted(EDGES, self.length, side="left") - 1
        return np.bincount(inside, minlength=len(EDGES) - 1)

    def worst(self, count: int) -> list[tuple[float, float]]:
        """Begin and length of the longest, longest first."""
        order = np.argsort(-self.length, kind="stable")[:count]
        return [(float(self.begin[k]), float(self.length[k])) for k in order]


def intervals_of(holds: Flags, step: float) -> TimeIntervals:
    """The times in which (m,) steps hold."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    begin, end = edge[::2], edge[1::2]
    return TimeIntervals(step * begin.astype(float), step * (end - begin).astype(float))


@printed
@dataclass(frozen=True, eq=False)
class Availability:
    """Fractions of time in which heads are valid.

    heads   (h + 1,) fraction of the time with exactly 0, 1, ... valid heads
    causes  Blind -> (h,) fraction of the time in which it blinds each head
    alone   (h,) fraction of the time in which each head is valid
    known   (h + 1,) fraction of the time with an attitude of exactly 0, 1, ... heads; a valid
            head has one with the probability that it detects enough stars
    none    times without a valid head
    each    times in which each head is blind
    """

    heads: Floats
    causes: dict[Blind, Floats]
    alone: Floats
    known: Floats
    none: TimeIntervals
    each: tuple[TimeIntervals, ...]

    def at_least(self, count: int) -> float:
        """Fraction of the time with attitudes of at least `count` heads."""
        return float(self.known[count:].sum())


def availability_of(flown: Flown) -> Availability:
    """Availability of a mission. Each cause counts where it blinds a head, alone or with others."""
    valid = flown.valid
    exactly = np.bincount(valid, minlength=len(flown.blind) + 1) / len(valid)
    return Availability(
        exactly,
        {cause: ((flown.blind & cause) > 0).mean(axis=1) for cause in Blind},
        (flown.blind == 0).mean(axis=1),
        flown.exactly / len(valid) if flown.exactly.any() else exactly,
        intervals_of(valid == 0, flown.step),
        tuple(intervals_of(blind > 0, flown.step) for blind in flown.blind),
    )


@printed
@dataclass(frozen=True)
class Reacquisition:
    """Time of a head from the end of a blinding to its next attitude.

    times   number of reacquisitions in the mission
    mean    second, expected over them
    level   second, 99 % of these times are shorter
    """

    times: int
    mean: Annotated[float, Unit("s")]
    level: Annotated[float, Unit("s")]


def reacquisition_of(case: Case, chances: Sequence[float]) -> Reacquisition:
    """The reacquisitions of a head.

    The frames after a blinding lie at a random phase of the frame rate, each has an attitude with
    the probability of the sky there, and its result comes after half of the exposure and the
    read-out:

        time = latency + (n - u) period,   n frames to the first attitude, u uniform in [0, 1]

    chances   probability of an attitude at each end of a blinding
    Accuracy  model: frames are independent; the time that the tracker computes, and stray light
              that fades after the blinding, are left out.
    """
    period, latency = timing_of(case)
    chance = np.clip(np.array(chances, float), 1e-6, 1.0)
    if not len(chance):
        return Reacquisition(0, math.nan, math.nan)
    mean = float((1 / chance - 0.5).mean()) * period + latency

    def later(time: float) -> float:
        """Fraction of the reacquisitions that take longer."""
        frames = max((time - latency) / period, 0.0)
        full = math.floor(frames)
        rest = (1 - chance) ** full * (1 - (frames - full) * chance)
        return float(rest.mean()) - 0.01

    high = latency + period
    while later(high) > 0:
        high *= 2
    return Reacquisition(len(chance), mean, float(brentq(later, latency, high)))


def timing_of(case: Case) -> tuple[float, float]:
    """Second between two frames, and from the middle of an exposure to the end of its read-out."""
    detector = case.instrument.detector
    reading = detector.rows * detector.columns / detector.pixel_rate
    return 1 / detector.update_rate, detector.exposure / 2 + reading


@printed
@dataclass(frozen=True)
class OfBeta:
    """The mission while the Sun is at some angles to the plane of the orbit.

    low, high   radian
    time        1, fraction of the mission
    one, two    fraction of that time with at least one, and two, valid heads
    error       radian, rms of the fused attitude about its worst axis
    """

    low: Annotated[float, Unit("rad", "deg")]
    high: Annotated[float, Unit("rad", "deg")]
    time: float
    one: float
    two: float
    error: Annotated[float, Unit("rad", "arcsec")]


def over_beta(flown: Flown) -> list[OfBeta]:
    """The mission by the angle from the Sun to the plane of the orbit, where it occurs."""
    steps, one_head, two, _, *squares = flown.by_beta.sum(axis=2)
    edge = np.linspace(-math.pi / 2, math.pi / 2, len(steps) + 1)
    worst = np.max(squares, axis=0) / np.maximum(one_head, 1)
    return [
        OfBeta(
            *(float(edge[k]), float(edge[k + 1]), float(steps[k] / steps.sum())),
            *(float(one_head[k] / steps[k]), float(two[k] / steps[k])),
            math.sqrt(worst[k]) if one_head[k] else math.nan,
        )
        for k in np.flatnonzero(steps)
    ]


@printed
@dataclass(frozen=True)
class MissionVerdict:
    """Whether a requirement of the mission is met.

    name   key in the mission file
    limit  that it must keep, SI
    value  of the mission, SI
    met    whether it keeps it
    """

    name: str
    limit: float
    value: float
    met: bool


def verdicts(
    needs: MissionRequirements, availability: Availability, error: float | None = None
) -> list[MissionVerdict]:
    """The requirements that the mission file gives, in their order.

    error  radian, rms of the fused attitude about its worst axis; None: not known
    """
    values = {
        "max_blind": availability.none.longest,
        "availability_one": availability.at_least(1),
        "availability_two": availability.at_least(2) if len(availability.heads) > 2 else None,
        "max_error": error,
    }
    results = []
    for name, value in values.items():
        limit = getattr(needs, name)
        if limit is not None and value is not None:
            met = value >= limit if name.startswith("availability") else value <= limit
            results.append(MissionVerdict(name, limit, value, bool(met)))
    return results


DECIMALS = 5  # of a degree: 0.04 arcsec


def timeline(plan: MissionPlan, every: int = 1, advance: Advance = lambda _: None) -> Rows:
    """A row for every step, or for every k-th step; angles in degrees.

    Errors are rms, in arcseconds, with the alignment of each head; infinite without an attitude.

    every   k: every k-th step is kept, from the first on
    Returns a structured array; `blind` of a head is the sum of its Blind, 0 where it is valid
    """
    time = plan.loaded.mission.time
    step, count = time.step * every, -(-time.steps // every)
    parts = []
    for first in range(0, count, CHUNK):
        size = min(CHUNK, count - first)
        chunk = at(plan, plan.motion.at(first * step, step, size), first)
        parts.append(_rows(plan, chunk))
        advance(size)
    return np.concatenate(parts)


def write_kernels(plan: MissionPlan, every: int, orbit: Path, attitude: Path) -> None:
    """Write where the spacecraft is and how it points, at every k-th step, for SPICE.

    Raises  ImportError without spiceypy
    """
    time = plan.loaded.mission.time
    own = plan.motion.at(0.0, time.step * every, max(-(-time.steps // every), 2))
    begin = files.to_ephemeris_time(utc(time.begin))
    date = files.of_ephemeris_time(begin + own.second)
    files.write_spk(orbit, date, own.place.T, own.speed.T)
    turn = Rotation.from_matrix(own.body.transpose(2, 0, 1))
    files.write_ck(attitude, date, turn.as_quat())


UNITS = {"deg": "degree", "arcsec": "arcsec", "second": "s"}


def save_timeline(path: Path, table: Rows) -> None:
    """Write a timeline as NetCDF (classic format), which xarray, MATLAB and IDL read.

    Each column is a variable over the dimension `time`, with its unit; `blind` is a number.
    """
    names = table.dtype.names or ()
    plain = {name: name.replace("/", "_") for name in names}
    save_netcdf(
        path,
        {plain[name]: table[name].astype(np.float64) for name in names},
        {
            plain[name]: (UNITS.get(name.rpartition("_")[2], "1"), name.replace("_", " "))
            for name in names
        },
        ("time",),
    )


def _rows(plan: MissionPlan, chunk: Chunk) -> Rows:
    own = chunk.instants
    columns = {
        "second": own.second,
        "latitude_deg": own.latitude / deg,
        "longitude_deg": own.longitude / deg,
        "orbit_phase_deg": own.phase / deg,
        "eclipse": chunk.shadow.sun,
        "valid_heads": np.sum([view.blind == 0 for view in chunk.seen], axis=0),
    }
    for head, seen in zip(plan.heads, chunk.seen, strict=True):
        columns |= {
            f"{head.name}_ra_deg": np.arctan2(seen.line[1], seen.line[0]) / deg % 360,
            f"{head.name}_dec_deg": np.arcsin(np.clip(seen.line[2], -1, 1)) / deg,
            f"{head.name}_sun_deg": seen.sun / deg,
            f"{head.name}_moon_deg": seen.moon / deg,
            f"{head.name}_limb_deg": seen.limb / deg,
            f"{head.name}_lit_limb_deg": seen.earth / deg,
            f"{head.name}_blind": seen.blind,
        }
    if chunk.variance is not None:
        for head, (across, about, _) in zip(plan.heads, chunk.errors, strict=True):
            columns[f"{head.name}_across_arcsec"] = np.sqrt(across) / arcsec
            columns[f"{head.name}_about_arcsec"] = np.sqrt(about) / arcsec
        for axis, square in zip("xyz", chunk.variance, strict=True):
            columns[f"fused_{axis}_arcsec"] = np.sqrt(square) / arcsec
    table = np.empty(len(own.second), [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        table[name] = values.round(DECIMALS) if values.dtype.kind == "f" else values
    return table
