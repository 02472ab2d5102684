"""Signal chain of a pixel, and tables of the exact distribution of its digital number."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray
from scipy import special

from startrack.core import Floats, Ints, Singles, instead_of, kernel
from startrack.detector.parameters import Detector

Image = NDArray[np.uint16] | NDArray[np.uint32]


class SignalLaw(NamedTuple):
    """Law from electrons to a digital number, without the random draws.

        charge = min(electrons, full_well)
        signal = charge (1 - nonlinearity charge / full_well)
        x      = (signal + read noise) gain + offset
        y      = clip(x / largest, 0, 1)
        number = clip(floor(x + 4 adc_inl y (1 - y) + 1/2), 0, largest)

    Source: Krutz et al. (2011), eq. (5); EMVA 1288 release 4.0, section 2.2. The non-linearity is
    the first term of a power series. The integral non-linearity (INL) is a parabola, its most
    common form.

    noise         electron rms
    full_well     electron
    nonlinearity  1, fraction by which the signal of a full pixel is too small
    gain          digital number / electron
    offset        digital number
    adc_inl       digital number, INL of the converter at half scale
    largest       digital number
    """

    noise: float
    full_well: float
    nonlinearity: float
    gain: float
    offset: float
    adc_inl: float
    largest: float


COUNT = SignalLaw(
    noise=0.0,
    full_well=math.inf,
    nonlinearity=0.0,
    gain=1.0,
    offset=0.0,
    adc_inl=0.0,
    largest=math.inf,
)  # numbers equal electrons


def law_of(detector: Detector) -> SignalLaw:
    """The law of a detector's pixels."""
    largest = 2**detector.bits - 1
    return SignalLaw(
        noise=math.hypot(detector.read_noise, detector.reset_noise),
        full_well=detector.full_well,
        nonlinearity=detector.nonlinearity,
        gain=detector.gain * largest / detector.full_well,
        offset=float(detector.offset),
        adc_inl=detector.adc_inl,
        largest=float(largest),
    )


@register_jitable(error_model="numpy")
def nonlinear_signal(charge, full_well, nonlinearity):  # type: ignore[no-untyped-def]
    """Signal (electron) of a charge; for scalars in kernels and for arrays."""
    return charge * (1.0 - nonlinearity * charge / full_well)


@register_jitable(error_model="numpy")
def with_adc_inl(x, y, adc_inl):  # type: ignore[no-untyped-def]
    """Output of the converter before rounding, for scalars or arrays; y is x / largest number."""
    return x + 4.0 * adc_inl * y * (1.0 - y)


@kernel
def signal(electrons, full_well, nonlinearity):  # type: ignore[no-untyped-def]
    """Signal of the collected electrons; a pixel holds at most its full well."""
    return nonlinear_signal(min(electrons, full_well), full_well, nonlinearity)


@kernel
def unrounded(level, gain, offset, adc_inl, largest):  # type: ignore[no-untyped-def]
    """Output of the converter for a signal, before rounding and within the range."""
    x = level * gain + offset
    y = min(max(x / largest, 0.0), 1.0)
    return min(max(with_adc_inl(x, y, adc_inl), 0.0), largest)


@kernel
def number(level, gain, offset, adc_inl, largest):  # type: ignore[no-untyped-def]
    """The digital number of a signal with its noise."""
    return float(math.floor(unrounded(level, gain, offset, adc_inl, largest) + 0.5))


def converted(level: Floats, law: SignalLaw) -> Floats:
    """Digital numbers of signals that contain their noise, element by element."""
    level = np.asarray(level, dtype=float)
    flat = _numbers(level.ravel(), law.gain, law.offset, law.adc_inl, law.largest)
    return flat.reshape(level.shape)


@kernel
def _numbers(level, gain, offset, adc_inl, largest):  # type: ignore[no-untyped-def]
    numbers = np.empty(len(level))
    for i in range(len(level)):
        numbers[i] = number(level[i], gain, offset, adc_inl, largest)
    return numbers


def expected_signal(electrons: Floats, law: SignalLaw) -> Floats:
    """Signal (electron) of expected electrons, element by element."""
    electrons = np.asarray(electrons, dtype=float)
    flat = _expected_signal(electrons.ravel(), law.full_well, law.nonlinearity)
    return flat.reshape(electrons.shape)


@kernel
def _expected_signal(electrons, full_well, nonlinearity):  # type: ignore[no-untyped-def]
    level = np.empty(len(electrons))
    for i in range(len(electrons)):
        level[i] = signal(electrons[i], full_well, nonlinearity)
    return level


def unrounded_numbers(level: Floats, law: SignalLaw) -> Floats:
    """Output of the converter before it rounds, element by element."""
    flat = _unrounded_numbers(level.ravel(), law.gain, law.offset, law.adc_inl, law.largest)
    return flat.reshape(level.shape)


@kernel
def _unrounded_numbers(level, gain, offset, adc_inl, largest):  # type: ignore[no-untyped-def]
    numbers = np.empty(len(level))
    for i in range(len(level)):
        numbers[i] = unrounded(level[i], gain, offset, adc_inl, largest)
    return numbers


def alternating_numbers(level: Floats, ripple: float, law: SignalLaw) -> Singles:
    """Output of the converter before it rounds, for signals with a chessboard pattern.

    level   (rows, columns) electron
    ripple  electron, added to and subtracted from alternate pixels, like a chessboard
    """
    return _alternating(level, ripple, law.gain, law.offset, law.adc_inl, law.largest)


@kernel
def _alternating(level, ripple, gain, offset, adc_inl, largest):  # type: ignore[no-untyped-def]
    numbers = np.empty(level.shape, np.float32)
    for row in range(level.shape[0]):
        for column in range(level.shape[1]):
            moved = level[row, column] + ripple * (1 - 2 * ((row + column) & 1))
            numbers[row, column] = unrounded(moved, gain, offset, adc_inl, largest)
    return numbers


def blank(shape: tuple[int, ...], law: SignalLaw) -> Image:
    """An empty image of the smaller integer type that holds its numbers."""
    return np.empty(shape, np.uint16) if law.largest < 2**16 else np.empty(shape, np.uint32)


def upper_edge(law: SignalLaw, numbers: Floats) -> Floats:
    """Signal (electron) at the limit between each digital number and the next."""
    wanted = numbers + 0.5
    inside = (wanted > 0) & (wanted < law.largest)
    parabola = np.where(inside, 4 * law.adc_inl, 0.0)
    # The root of x (1 + b) - b x^2 / largest = wanted, in the form that loses no digits.
    middle = 1 + parabola / law.largest
    root = np.sqrt(middle**2 - 4 * parabola / law.largest**2 * wanted)
    return (2 * wanted / (middle + root) - law.offset) / law.gain


STEPS = 64  # least number of levels in a standard deviation
BITS = 48  # bits of the uniform number
ENTRY_BITS = 22  # bits of the uniform number that the entries compare
UNSETTLED = 0xFFFF  # in an entry: the cell does not determine the number
FARTHEST = 8.2  # standard deviations; the probability beyond is less than 2^-48
LEAST_VARIANCE = 1e-6  # electron^2, least variance of levels; a smaller one has no visible effect
SKEW = 25.0  # electrons by which the upper tail of a Poisson distribution exceeds a normal one
# Chosen by hand for time and memory; the numbers of a frame hardly depend on these values.
BLOCK = 16  # levels: tables are rounded up to a multiple, so that similar frames share one
MOST_LEVELS = 1024
MOST_NUMBERS = 4096
# Bits of the cells. With fewer cells, a cell in the tails has several limits, and its pixels take
# 20 times as long as others. Tables of more cells do not fit into a cache.
LEAST_CELLS, MOST_CELLS = 10, 12
FEWEST_PIXELS = 2**14  # least number of pixels of a frame with tables
MOST_TERMS = 100_000_000  # most terms of the sums for a table: a tenth of a second


class Tables(NamedTuple):
    """The distributions of consecutive levels.

    entry    (levels << cells,) and an unsettled entry at the end: threshold << 16 | number -
             lowest, the threshold for the ENTRY_BITS - cells bits after those of the cell
    cells    number of bits that choose a cell
    limit    (levels, d) P(number <= lowest + d) of each level, in units of 2^-48
    lowest   digital number of the first column of `limit`
    first    index of the first level: its expectation over the spacing
    levels   number of levels
    spacing  electron, difference of the expectations of two levels
    """

    entry: NDArray[np.uint32]
    cells: int
    limit: NDArray[np.uint64]
    lowest: int
    first: int
    levels: int
    spacing: float


EMPTY = Tables(
    entry=np.full(1, UNSETTLED, np.uint32),
    cells=1,
    limit=np.zeros((1, 1), np.uint64),
    lowest=0,
    first=0,
    levels=0,
    spacing=1.0,
)


def level_spacing(lowest: float, noise: float) -> float:
    """Electrons between two levels, a power of two; the lowest level has this expectation."""
    deviation = math.sqrt(max(lowest + noise**2, LEAST_VARIANCE))
    return 2.0 ** math.floor(math.log2(deviation / STEPS))


def lowest_mean(low: float, middle: float, noise: float) -> float:
    """The least expectation with a level; a few dark pixels must not make the levels narrower.

    low, middle  electron, of the darkest pixels and of the median pixel
    """
    return max(low, (middle + noise**2) / 4 - noise**2, 0.0)


def tables_for(mean: Floats, law: SignalLaw, wings: float = 0.1) -> Tables:
    """The tables for most pixels of a frame; empty if they would take more time than they save.

    They depend on this frame alone, so that a frame does not depend on earlier frames.

    mean   (rows, columns) electron
    wings  standard deviations above the highest level that are included
    """
    if mean.size < FEWEST_PIXELS:
        return EMPTY
    sample = mean.ravel()[:: mean.size // 4096 | 1]  # odd step, to visit all columns
    low, middle, high = np.quantile(np.maximum(sample, 0.0), [0.002, 0.5, 0.99])
    spread = math.sqrt(middle + law.noise**2)
    # The range is wider than the sample, but excludes stars.
    lowest = lowest_mean(low - 0.1 * spread, middle, law.noise)
    spacing = level_spacing(lowest, law.noise)
    first = max(math.floor(lowest / spacing), math.floor(middle / spacing) - MOST_LEVELS // 2)
    last = min(math.floor((high + wings * spread) / spacing) + 1, first + MOST_LEVELS)
    first, last = first // BLOCK, -(-last // BLOCK)
    # A pixel that is drawn alone takes 60 ns; making a level takes about 100 microseconds.
    if mean.size < 64 * (last - first) * BLOCK:
        return EMPTY
    return build(law, first * BLOCK, (last - first) * BLOCK + 1, spacing)


@lru_cache(maxsize=4)
def build(law: SignalLaw, first: int, count: int, spacing: float) -> Tables:
    """The tables of some levels; empty if the numbers spread too far."""
    mean = np.arange(first, first + count) * spacing
    least = max(math.floor(mean[0] - FARTHEST * math.sqrt(mean[0])), 0.0)
    most = math.ceil(mean[-1] + FARTHEST * math.sqrt(mean[-1]) + SKEW)
    if count * (most - least) > MOST_TERMS:
        return EMPTY
    electrons = np.arange(least, most)
    means = expected_signal(electrons, law)
    far = FARTHEST * law.noise
    least, most = (int(converted(means[i] + s * far, law)) for i, s in ((0, -1), (-1, 1)))
    if most - least >= MOST_NUMBERS:
        return EMPTY
    span = np.arange(least, most + 1.0)
    # Fewer electrons than `start` give at most a number, `end` or more give a larger one; between,
    # the read noise decides.
    edge = upper_edge(law, span)
    if law.noise:
        start, end = (np.searchsorted(means, edge + s * far) for s in (-1, 1))
    else:
        start = end = np.searchsorted(converted(means, law), span, side="right")
    between = np.minimum(start[:, None] + np.arange((end - start).max()), len(means) - 1)
    z = (edge[:, None] - means[between]) / law.noise
    if count * z.size > MOST_TERMS:
        return EMPTY
    log = special.xlogy(electrons, mean[:, None]) - special.gammaln(electrons + 1) - mean[:, None]
    probability = np.exp(log)
    lower, upper = _sums(probability, start, end, special.ndtr(z), special.ndtr(-z))
    # The smaller of the two sums has no cancellation.
    limit = np.where(lower < 0.5, lower * 2.0**BITS, 2.0**BITS - upper * 2.0**BITS)
    limit = np.rint(limit).astype(np.uint64)
    limit[:, -1] = 2**BITS
    deviation = math.sqrt(mean[-1] + law.noise**2) * law.gain
    cells = math.ceil(math.log2(32 * max(deviation, 0.1)))
    cells = min(max(cells, LEAST_CELLS), MOST_CELLS)
    entry = np.append(_entries(limit, cells), np.uint32(UNSETTLED))
    return Tables(
        entry=entry,
        cells=cells,
        limit=limit,
        lowest=least,
        first=first,
        levels=count,
        spacing=spacing,
    )


@kernel
def _sums(
    probability: Floats, start: Ints, end: Ints, below: Floats, above: Floats
) -> tuple[Floats, Floats]:
    """P(number <= d) and P(number > d) of each level, each summed separately to keep its digits."""
    levels, electrons = probability.shape
    lower = np.empty((levels, len(start)))
    upper = np.empty((levels, len(start)))
    head, tail = np.zeros(electrons + 1), np.zeros(electrons + 1)
    for level in range(levels):
        chance = probability[level]
        for n in range(electrons):
            head[n + 1] = head[n] + chance[n]
            back = electrons - 1 - n
            tail[back] = tail[back + 1] + chance[back]
        for d in range(len(start)):
            less, more = head[start[d]], tail[end[d]]
            for k in range(end[d] - start[d]):
                less += chance[start[d] + k] * below[d, k]
                more += chance[start[d] + k] * above[d, k]
            lower[level, d], upper[level, d] = less, more
    return lower, upper


@instead_of(_sums)
def _sums_of_arrays(probability, start, end, below, above):  # type: ignore[no-untyped-def]
    edge = np.zeros((len(probability), 1))
    head = np.cumsum(np.concatenate([edge, probability], axis=1), axis=1)
    tail = np.cumsum(np.concatenate([edge, probability[:, ::-1]], axis=1), axis=1)[:, ::-1]
    lower, upper = head[:, start], tail[:, end]
    for k in range(below.shape[1]):
        among = start + k < end
        chance = probability[:, np.where(among, start + k, 0)] * among
        lower, upper = lower + chance * below[:, k], upper + chance * above[:, k]
    return lower, upper


@kernel
def _entries(limit: NDArray[np.uint64], cells: int) -> NDArray[np.uint32]:
    """The entries of all levels, one after the other.

    A cell with one limit contains the next bits of the limit; a cell with several is unsettled.
    """
    levels, numbers = limit.shape
    entry = np.empty((levels, 2**cells), np.uint32)
    for level in range(levels):
        lower = 0
        while lower < numbers and limit[level, lower] <= np.uint64(0):
            lower += 1
        for cell in range(2**cells):
            start, upper = np.uint64(cell) << np.uint64(BITS - cells), lower
            if cell + 1 < 2**cells:
                end = np.uint64(cell + 1) << np.uint64(BITS - cells)
                while upper < numbers and limit[level, upper] <= end:
                    upper += 1
            else:
                upper = numbers - 1
            threshold, number = np.uint64(UNSETTLED), np.uint64(lower)
            if upper - lower == 1:
                bound = limit[level, min(lower, numbers - 1)]
                threshold = (bound - start) >> np.uint64(BITS - ENTRY_BITS)
            elif upper - lower > 1:
                number = np.uint64(UNSETTLED)
            entry[level, cell] = threshold << np.uint64(16) | number
            lower = upper
    return entry.ravel()


@instead_of(_entries)
def _entries_of_arrays(limit, cells):  # type: ignore[no-untyped-def]
    return np.concatenate([_entries_of_level(of_level, cells) for of_level in limit])


def _entries_of_level(limit: NDArray[np.uint64], cells: int) -> NDArray[np.uint32]:
    start = np.arange(2**cells, dtype=np.uint64) << np.uint64(BITS - cells)
    lower = np.searchsorted(limit, start, side="right")
    upper = np.append(lower[1:], len(limit) - 1)
    inside = upper - lower
    threshold = np.where(
        inside == 1,
        (limit[np.minimum(lower, len(limit) - 1)] - start) >> np.uint64(BITS - ENTRY_BITS),
        np.uint64(UNSETTLED),
    )
    number = np.where(inside > 1, UNSETTLED, lower)
    return (threshold << np.uint64(16) | number.astype(np.uint64)).astype(np.uint32)
