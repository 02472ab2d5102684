"""Outcomes of any number of trials -> a Sketch of fixed size: moments, quantiles, tails.

Sketches of parts of a campaign add up to the sketch of the whole, with equal bytes in any order.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from startrack import metrics
from startrack.core import Advance, Floats, Ints, Rows, inputs_of, printed, software
from startrack.design import Case
from startrack.io import read_bytes, save_text, to_table
from startrack.montecarlo.resume import last_words, missing
from startrack.montecarlo.run import blocks, require_whole, touching_runs
from startrack.montecarlo.sampling import Sampling
from startrack.montecarlo.store import difference

FORMAT = "startrack sketch 2"
EARLIER = "startrack sketch 1"  # without a checksum
LARGEST = 2**27  # byte; a usual sketch has 1 MB
# Errors of reading another file as a sketch.
DAMAGED = ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError
HALVES = 9  # leading fraction bits that name a bin: 512 bins per octave
BITS = 52 - HALVES  # remaining fraction bits of a float
RELATIVE = 2.0 ** -(HALVES + 1)  # largest relative error of a value by its bin
UNIT = 1074  # sums are integers in units of 2^-1074, as all floats are
BLOCK = 8192  # trials that a worker sketches at a time; chosen by hand: a second of work
SAVED_EVERY = 20.0  # second
COUNTS = ("trials", "solved", "false", "judged", "correct", "beyond", "stars")
# For attitudes that are solved and not false: sums of powers, and values in bins.
SUMS = ("x", "y", "z", "across^2", "across^4", "about^2", "about^4", "nees")
BINNED = ("x", "-x", "y", "-y", "z", "-z", "across", "nees")


@printed
@dataclass(eq=False)
class Bins:
    """Numbers of positive values in bins; a bin is named by the first bits of a float.

    index  (k,) rising; bin i holds the values from `edge(i)` to below `edge(i + 1)`
    count  (k,)
    """

    index: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    count: Ints = field(default_factory=lambda: np.empty(0, np.int64))

    @classmethod
    def of(cls, values: Floats) -> Bins:
        """Count values in bins; values that are not positive are in no bin."""
        positive = np.ascontiguousarray(values[values > 0], np.float64)
        return cls(*np.unique(positive.view(np.int64) >> BITS, return_counts=True))

    def with_those(self, other: Bins) -> Bins:
        """The sum of both."""
        index = np.concatenate([self.index, other.index])
        if not len(index):
            return self
        order = np.argsort(index, kind="stable")
        index, count = index[order], np.concatenate([self.count, other.count])[order]
        first = np.flatnonzero(np.diff(index, prepend=-1))
        return Bins(index[first], np.add.reduceat(count, first))


@printed
@dataclass(eq=False)
class Sketch:
    """Summary of trials in constant memory.

    about   the campaign: design, seed, sampling, limits of a correct attitude, software
    ranges  first trial and end (exclusive) of each unbroken run of trials, in order
    counts  by the names of COUNTS; "judged": solved and not false; "stars": sum of their stars
    sums    by the names of SUMS, exact, in units of 2^-1074; errors in radian
    bins    by the names of BINNED; "-x": magnitudes of the negative values of x
    worst   largest error across of a judged attitude, radian, and minus its trial; the first of
            several
    """

    about: dict[str, Any]
    ranges: list[tuple[int, int]] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COUNTS, 0))
    sums: dict[str, int] = field(default_factory=lambda: dict.fromkeys(SUMS, 0))
    bins: dict[str, Bins] = field(default_factory=lambda: {name: Bins() for name in BINNED})
    worst: tuple[float, int] = (-1.0, 0)

    @property
    def trials(self) -> int:
        """Number of trials."""
        return self.counts["trials"]

    def add(self, other: Sketch) -> None:
        """Add the trials of another sketch of the same campaign.

        Raises  ValueError if it is of another campaign, or has trials that this sketch has.
        """
        if other.about != self.about:
            raise ValueError(f"it is of another campaign: {difference(other.about, self.about)}")
        self.ranges = _joined([*self.ranges, *other.ranges])
        for name in COUNTS:
            self.counts[name] += other.counts[name]
        for name in SUMS:
            self.sums[name] += other.sums[name]
        for name in BINNED:
            self.bins[name] = self.bins[name].with_those(other.bins[name])
        self.worst = max(self.worst, other.worst)

    def mean(self, name: str) -> float:
        """Mean over the judged attitudes, from a sum, correctly rounded; NaN without attitudes."""
        if not self.counts["judged"]:
            return math.nan
        return float(Fraction(self.sums[name], self.counts["judged"] << UNIT))

    def rms(self, which: str) -> metrics.Interval:
        """Radian, rms per axis "across" or "about" the boresight, with its 95 % interval."""
        count, mean = self.counts["judged"], self.mean(f"{which}^2")
        if count < 3:
            return metrics.Interval(
                math.sqrt(mean), *((0.0, math.inf) if count else [math.nan] * 2)
            )
        scatter = Fraction(self.sums[f"{which}^4"], 1 << UNIT)
        scatter -= Fraction(self.sums[f"{which}^2"], 1 << UNIT) ** 2 / count
        variance = max(float(scatter / (count - 1)), 0.0)
        bounds = metrics.bounds_of_mean(count, mean, variance, 0.025, 0.025)
        return metrics.Interval(*(math.sqrt(square) for square in (mean, *bounds)))

    def quantile(self, name: str, fraction: float) -> metrics.Interval:
        """A quantile of "across" or "nees" over the judged attitudes, and of |x|, |y| or |z|.

        Returns   the middle of its bin; bounds that contain the true quantile with 95 % confidence,
                  including errors by the bins; unbounded above if there are too few trials
        Accuracy  numerical: RELATIVE (0.1 %) of the value. statistical: ranks of a binomial law.
        """
        bins = self.bins[name].with_those(self.bins.get(f"-{name}", Bins()))
        count = self.counts["judged"]
        if not count:
            return metrics.Interval(math.nan, math.nan, math.nan)
        zero = count - int(bins.count.sum())  # zeros, which come first
        up_to = np.cumsum(bins.count) + zero

        def bounds(rank: int) -> tuple[float, float]:
            if rank <= zero:
                return 0.0, 0.0
            index = int(bins.index[np.searchsorted(up_to, rank)])
            return edge(index), edge(index + 1)

        rank = min(max(math.ceil(count * fraction), 1), count)
        low, high = metrics.level_ranks(count, fraction, 0.025, 0.025)
        return metrics.Interval(
            sum(bounds(rank)) / 2,
            bounds(low)[0] if low > 0 else 0.0,
            bounds(high)[1] if high <= count else math.inf,
        )

    @property
    def availability(self) -> metrics.Interval:
        """Fraction of trials with a correct attitude, with its exact interval."""
        return metrics.fraction_interval(self.counts["correct"], self.trials)


def edge(index: int) -> float:
    """The lower edge of a bin.

    >>> edge(1023 << HALVES), edge((1023 << HALVES) + 1)
    (1.0, 1.001953125)
    """
    return float(np.int64(index << BITS).view(np.float64))


def about_of(
    case: Case, seed: int, sampling: Sampling, limits: metrics.ErrorLimits
) -> dict[str, Any]:
    """Description that sketches of one campaign share, as in JSON."""
    about = {
        "case": to_table(case),
        "inputs": inputs_of(case),
        "seed": seed,
        "sampling": str(sampling),
        "limits": limits._asdict(),
        "startrack": software(),
    }
    return dict(json.loads(json.dumps(about)))


def _sketch_of(
    sampling: Sampling,
    limits: metrics.ErrorLimits,
    about: dict[str, Any],
    case: Case,
    seed: int,
    numbers: range,
) -> Sketch:
    """The sketch of some trials first, first + 1, ..., made in a worker."""
    return sketched(sampling.trials(case, seed, numbers), limits, about)


def sketched(outcomes: Rows, limits: metrics.ErrorLimits, about: dict[str, Any]) -> Sketch:
    """Sketch of the outcomes (n,), n > 0, of trials with successive numbers."""
    first = int(outcomes["trial"][0])
    judged = outcomes[outcomes["solved"] & ~outcomes["false"]]
    solved = outcomes[outcomes["solved"]]
    x, y, z = (judged[f"error_{axis}"] for axis in "xyz")
    square, across = (x * x + y * y) / 2, np.sqrt(x * x + y * y)
    values = {
        "x": x,
        "y": y,
        "z": z,
        "across^2": square,
        "across^4": square * square,
        "about^2": z * z,
        "about^4": (z * z) * (z * z),
        "nees": judged["nees"],
    }
    counts = (
        len(outcomes),
        len(solved),
        outcomes["false"].sum(),
        len(judged),
        metrics.correct(outcomes, limits).sum(),
        metrics.beyond_ten_sigma(solved),
        judged["stars"].sum(),
    )
    made = Sketch(about, [(first, first + len(outcomes))])
    made.counts = {name: int(count) for name, count in zip(COUNTS, counts, strict=True)}
    made.sums = {name: exact_sum(values[name]) for name in SUMS}
    for name, error in (("x", x), ("y", y), ("z", z)):
        made.bins[name], made.bins[f"-{name}"] = Bins.of(error), Bins.of(-error)
    made.bins["across"], made.bins["nees"] = Bins.of(across), Bins.of(judged["nees"])
    if len(judged):
        at = int(across.argmax())
        made.worst = float(across[at]), -int(judged["trial"][at])
    return made


def exact_sum(values: Floats) -> int:
    """The sum of finite floats without rounding, in units of 2^-1074.

    >>> exact_sum(np.array([1e300, 1.0, -1e300])) == 1 << UNIT
    True
    """
    fraction, exponent = np.frexp(values)
    mantissa = np.ldexp(fraction, 53).astype(np.int64)
    total = 0
    for power in np.unique(exponent):
        part = mantissa[exponent == power]
        # In two halves; a block is too short for them to overflow.
        both = (int((part >> 26).sum()) << 26) + int((part & (2**26 - 1)).sum())
        shift = int(power) - 53 + UNIT
        total += both << shift if shift >= 0 else both >> -shift
    return total


def _joined(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Runs of trials in order; touching runs are joined.

    Raises  ValueError if two overlap.
    """
    for (_, before), (first, end) in pairwise(sorted(ranges)):
        if first < before:
            raise ValueError(f"trials {first} to {min(end, before) - 1} are in two of them")
    return touching_runs(ranges)


def save_sketch(path: Path, sketch: Sketch) -> None:
    """Write a sketch as JSON: equal bytes for equal trials, for any division into parts."""
    table = {
        "format": FORMAT,
        "about": sketch.about,
        "ranges": sketch.ranges,
        "counts": sketch.counts,
        "sums": {name: hex(total) for name, total in sketch.sums.items()},
        "worst": [sketch.worst[0].hex(), sketch.worst[1]],
        "bins": {
            name: [bins.index.tolist(), bins.count.tolist()] for name, bins in sketch.bins.items()
        },
    }
    save_text(path, _text(table | {"checksum": _checksum(table)}) + "\n")


def _text(table: dict[str, Any]) -> str:
    return json.dumps(table, sort_keys=True, separators=(",", ":"))


def _checksum(table: dict[str, Any]) -> str:
    return hashlib.blake2b(_text(table).encode(), digest_size=8).hexdigest()


def load_sketch(path: Path) -> Sketch:
    """Read a sketch. Raises ValueError, one sentence with the file, if it is no sketch."""
    data = read_bytes(path, "a sketch of trials", LARGEST)
    try:
        table = json.loads(data)
        if table["format"] not in (FORMAT, EARLIER):
            raise ValueError(f"its format is {table['format']!r}")
        if table["format"] == FORMAT and table.pop("checksum") != _checksum(table):
            raise ValueError("it is damaged, its checksum is wrong")
        made = Sketch(dict(table["about"]), _joined([(int(a), int(b)) for a, b in table["ranges"]]))
        made.counts = {name: int(table["counts"][name]) for name in COUNTS}
        made.sums = {name: int(table["sums"][name], 16) for name in SUMS}
        made.worst = float.fromhex(table["worst"][0]), int(table["worst"][1])
        for name in BINNED:
            index, count = (np.array(numbers, np.int64) for numbers in table["bins"][name])
            made.bins[name] = Bins(index, count)
        _check(made)
    except DAMAGED as error:
        raise ValueError(f"{path} must be a sketch of trials, but is none: {error}") from None
    return made


def _check(sketch: Sketch) -> None:
    """Refuse counts that contradict each other."""
    trials, judged = sum(end - first for first, end in sketch.ranges), sketch.counts["judged"]
    if trials != sketch.trials or not 0 <= judged <= sketch.trials:
        raise ValueError("its counts contradict its trials")
    for name in BINNED:
        index, count = sketch.bins[name].index, sketch.bins[name].count
        wrong = index.ndim != 1 or index.shape != count.shape or (np.diff(index) <= 0).any()
        if wrong or (count <= 0).any() or count.sum() > judged:
            raise ValueError(f"its bins of {name} contradict its counts")


def resume_sketch(
    path: Path,
    case: Case,
    seed: int,
    sampling: Sampling,
    numbers: range,
    executor: Executor,
    workers: int = 1,
    limits: metrics.ErrorLimits = metrics.STATED_ALONE,
    progress: Advance | None = None,
    block: int = BLOCK,
) -> Sketch:
    """The sketch of trials, after running those that the file lacks.

    The file is rewritten from time to time, so that the same call continues after an interruption,
    with the same bytes at the end.

    limits    of a correct attitude
    progress  called with the number of trials that were just done, or were in the file
    Raises    ValueError if the file is no sketch, of another campaign, or also has other trials;
              RuntimeError if a trial fails.
    """
    sketch = Sketch(about_of(case, seed, sampling, limits))
    if path.exists():
        earlier = load_sketch(path)
        try:
            sketch.add(earlier)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        if earlier.ranges and not all(
            numbers.start <= first and end <= numbers.stop for first, end in earlier.ranges
        ):
            raise ValueError(f"{path} holds other trials than {numbers.start} to {numbers[-1]}")
        if progress:
            progress(earlier.trials)
    done = [range(*ends) for ends in sketch.ranges]
    plan = missing(done, numbers.stop, block, numbers.start)
    saved = time.monotonic()
    make = partial(_sketch_of, sampling, limits, sketch.about)
    for which, result in blocks(case, seed, plan, executor, workers, make=make):
        if isinstance(result, Exception):
            save_sketch(path, sketch)
            words = last_words(f"{type(result).__name__}: {result}")
            raise RuntimeError(f"trials {which.start} to {which[-1]} failed: {words}") from result
        sketch.add(result)
        if progress:
            progress(len(which))
        if time.monotonic() - saved > SAVED_EVERY:
            save_sketch(path, sketch)
            saved = time.monotonic()
    save_sketch(path, sketch)
    return sketch


def merge_sketches(
    paths: Iterable[Path],
    progress: Advance | None = None,
    partial: bool = False,
    count: int | None = None,
) -> Sketch:
    """The sketch of all trials of several files.

    progress  called with the number of files that were just read
    partial, count  as for `merge_stores`
    Raises  ValueError, with the file, if it is no sketch, of another campaign, or has trials that
            another file has; Refused with the numbers of missing trials.
    """
    every = list(paths)
    merged = load_sketch(every[0])
    for path in every[1:]:
        try:
            merged.add(load_sketch(path))
        except ValueError as error:
            text = str(error)
            raise ValueError(text if text.startswith(str(path)) else f"{path}: {text}") from None
        if progress:
            progress(1)
    require_whole(merged.ranges, count, partial)
    return merged
