"""Expected electrons -> digital numbers of independent pixels, by the exact distribution.

A pixel has 32 random bits, half of a word of 64. The last 10 bits select one of the two levels
around its expectation. The first 22 bits select its number in the table of this level. If they do
not determine it, more bits follow from a second random number of the pixel.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    GOLDEN,
    Floats,
    Ints,
    Singles,
    Streams,
    assign,
    bits,
    instead_of,
    inverse_normal,
    kernel,
    mixed,
    poisson_of_uniform,
    read_only,
    uniform,
)
from startrack.detector.law import (
    BITS,
    COUNT,
    EMPTY,
    ENTRY_BITS,
    Image,
    SignalLaw,
    Tables,
    blank,
    number,
    signal,
    tables_for,
)

SHOT = "shot noise"  # stream of the collected electrons


def digitise(
    electrons: Floats, law: SignalLaw, streams: Streams, tables: Tables | None = None
) -> Image:
    """The digital image of expected electrons.

    Most pixels of a frame are near its background; their number is from a table of the exact
    distribution. For the other pixels, in stars, electrons and then read noise are drawn. The
    uniform number of a pixel does not depend on the design, so that two designs have the same
    noise.

    electrons  (rows, columns) expectation of photo- and dark electrons
    tables     for most pixels of the frame; None: made from `electrons`
    Returns    (rows, columns) digital numbers
    Accuracy   numerical: exact on the levels of the tables and in stars. Between levels the total
               variation from the exact distribution is 2e-5, and the variance is too large by 6e-5.
    """
    image = blank(electrons.shape, law)
    tables = tables_for(electrons, law) if tables is None else tables
    _digitise(image, read_only(electrons), draws_of(law, tables, streams))
    return image


def shot(
    electrons: Floats, streams: Streams, cause: str = SHOT, tables: Tables | None = None
) -> Floats:
    """Poisson numbers of electrons (rows, columns), by a cause's stream; accurate as `digitise`."""
    caught = np.empty(electrons.shape)
    tables = tables_for(electrons, COUNT) if tables is None else tables
    draws = draws_of(COUNT, tables, streams)
    _digitise(caught, read_only(electrons), draws._replace(shot=streams.key(cause)))
    return caught


def digitise_hit(
    image: Image, electrons: Floats, pixel: Ints, extra: Floats, law: SignalLaw, streams: Streams
) -> None:
    """Replace some pixels of an image, in place, by their numbers with extra electrons.

    pixel  (k,) row * columns + column
    extra  (k,) electron
    """
    draws = draws_of(law, EMPTY, streams)
    _digitise_hit(image.ravel(), electrons.ravel(), pixel, extra, draws)


def normals(shape: tuple[int, ...], streams: Streams, cause: str) -> Floats:
    """Standard normal numbers of a cause; for the read noise they equal those of `digitise`."""
    out = np.empty(shape)
    _normals(out.ravel(), streams.key(cause))
    return out


class Draws(NamedTuple):
    """Tables from which the numbers of pixels are drawn.

    shot, read  keys of shot noise and read noise; the latter is not drawn if it is zero
    """

    shot: np.uint64
    read: np.uint64
    law: SignalLaw
    tables: Tables


def draws_of(law: SignalLaw, tables: Tables, streams: Streams) -> Draws:
    """The draws of a law and its tables, by the streams of a trial."""
    read = streams.key("read noise") if law.noise else np.uint64(0)
    return Draws(streams.key(SHOT), read, law, tables)


@kernel
def _digitise(image, electrons, draws):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    room = work_row()
    for row in range(rows):
        start = np.uint64(row * columns)
        digitise_row(image[row], electrons[row], start, draws, room)


@instead_of(_digitise)
def _digitise_in_one(image, electrons, draws):  # type: ignore[no-untyped-def]
    room = np.empty((WORK, image.size + 2), np.uint32)
    out, mean = image.reshape(-1), electrons.reshape(-1)
    _digitise_part(out, mean, np.uint64(0), draws, room)


U32, F32 = np.uint32, np.float32
LOW = np.uint32(0xFFFF)
LEVEL_BITS = 32 - ENTRY_BITS
WHOLE = 2**LEVEL_BITS  # of the fraction between two levels
MOST = 2.0**30  # limit of the fractions; a pixel beyond it has no level
COUNTED = 64  # limits: up to this number, counting is faster than searching; by hand
# Pixels of a row in one step: with the tables of their levels they fit into the first cache of a
# core (32 KiB). More pixels are 20 % slower; with fewer, the ends of the loops take the time.
PART = 512
WORK = 5  # rows of the workspace


@kernel
def work_row():  # type: ignore[no-untyped-def]
    """Work array for `digitise_row` and `digitise_window`."""
    return np.empty((WORK, PART + 2), np.uint32)


@kernel
def digitise_row(out, mean, start, draws, room):  # type: ignore[no-untyped-def]
    """Write the numbers of pixels in a row, the first of which is pixel number `start`.

    room  from `work_row`
    """
    for first in range(0, len(mean), PART):
        part, pixel = mean[first : first + PART], start + np.uint64(first)
        _digitise_part(out[first : first + PART], part, pixel, draws, room)


# The loops of a part are separate so that each has numbers of one width: the widest numbers limit
# how many a processor handles at once, and processors without AVX-512 convert between 64-bit
# integers and floats one by one. Each sum is cut to 32 bits at once, because numba would continue
# with 64.
@kernel
def _digitise_part(
    out: NDArray[Any], mean: Floats, start: np.uint64, draws: Draws, room: NDArray[np.uint32]
) -> None:
    """`digitise_row` of at most PART pixels."""
    many, tables = len(mean), draws.tables
    odd = np.int64(start & np.uint64(1))
    pairs, at, other = room[0], room[1, :many], room[2, :many]
    words = pairs.view(np.uint64)[: (odd + many + 1) // 2]
    _random_pairs(draws.shot, start >> np.uint64(1), words)
    random = pairs[odd : odd + many]
    near = other.view(np.float32)
    assign(near, mean)
    _cells_of_levels(near, random, tables, at)
    for k in range(_settle(out, at, random, other, tables)):
        column = np.int64(other[k])
        pixel = start + np.uint64(column)
        out[column] = _unsettled(mean[column], at[column], pixel, draws)


@kernel
def digitise_window(
    image: Image, left: int, top: int, mean: Floats, draws: Draws, room: NDArray[np.uint32]
) -> None:
    """Like `digitise_row`, for a window of an image, several short rows in one step.

    A loop over one short row would end before the processor handles many pixels at once.
    """
    (height, width), columns = mean.shape, image.shape[1]
    together = PART // width
    if together < 2:
        for j in range(height):
            out, start = image[top + j, left : left + width], (top + j) * columns + left
            digitise_row(out, mean[j], np.uint64(start), draws, room)
        return
    for first in range(0, height, together):
        rows = min(together, height - first)
        many, begin = rows * width, (top + first) * columns + left
        at, other = room[1, :many], room[2, :many]
        random, numbers, near = room[3, :many], room[4, :many], other.view(np.float32)
        for j in range(rows):
            start = begin + j * columns
            odd = start & 1
            pairs = room[0].view(np.uint64)[: (odd + width + 1) // 2]
            _random_pairs(draws.shot, np.uint64(start >> 1), pairs)
            row = slice(j * width, (j + 1) * width)
            assign(random[row], room[0, odd : odd + width])
            assign(near[row], mean[first + j])
        _cells_of_levels(near, random, draws.tables, at)
        left_over = _settle(numbers, at, random, other, draws.tables)
        for j in range(rows):
            out = image[top + first + j, left : left + width]
            assign(out, numbers[j * width : (j + 1) * width])
        for k in range(left_over):
            j, i = np.int64(other[k]) // width, np.int64(other[k]) % width
            pixel = np.uint64(begin + j * columns + i)
            number = _unsettled(mean[first + j, i], at[other[k]], pixel, draws)
            image[top + first + j, left + i] = number


@kernel
def _unsettled(mean, cell, pixel, draws):  # type: ignore[no-untyped-def]
    """The number of a pixel that its table entry does not determine."""
    tables = draws.tables
    if cell == len(tables.entry) - 1:
        return draw_number(mean, 0.0, pixel, draws)
    line = np.int64(cell >> tables.cells)
    return float(tables.lowest + _number_by_all_bits(draws.shot, pixel, line, tables.limit))


@kernel
def _random_pairs(shot, start, out):  # type: ignore[no-untyped-def]
    """`bits` of consecutive numbers; each half is for one pixel, the low half first."""
    # Summed, because a product of 64 bits is many operations on processors without AVX-512.
    state = shot + GOLDEN * start
    for k in range(len(out)):
        state += GOLDEN
        out[k] = mixed(state)


@instead_of(_random_pairs)
def _random_pairs_of_arrays(shot, start, out):  # type: ignore[no-untyped-def]
    out[:] = bits(shot, start + np.arange(len(out), dtype=np.uint64))


@kernel
def _random_bits(shot, pixel):  # type: ignore[no-untyped-def]
    """64 random bits of a pixel: the bits that the entries compare, and more."""
    half = (pixel & np.uint64(1)) << np.uint64(5)
    first = (bits(shot, pixel >> np.uint64(1)) >> half) & np.uint64(2**32 - WHOLE)
    return (first << np.uint64(32)) | (bits(mixed(shot), pixel) >> np.uint64(ENTRY_BITS))


@kernel
def _cells_of_levels(
    mean: Singles, random: NDArray[np.uint32], tables: Tables, at: NDArray[np.uint32]
) -> None:
    """The cell of each pixel in one of the two levels about its expectation, or none.

    In 32 bits: the mean of a pixel is right to 1e-4 of its standard deviation up to 1e6 electrons.
    """
    none = U32(len(tables.entry) - 1)
    # Not 1 << cells, which the compiler would make a 64-bit shift.
    size = U32((len(tables.entry) - 1) // max(tables.levels, 1))
    last = U32(WHOLE * max(tables.levels - 1, 0))
    first, scale = F32(tables.first * tables.spacing), F32(WHOLE / tables.spacing)
    half, most = F32(0.5), F32(MOST)
    past, mask = U32(32 - tables.cells), U32(WHOLE - 1)
    for column in range(len(mean)):
        # Below the first level this wraps to a huge number.
        place = U32(np.int32(min((mean[column] - first) * scale + half, most)))
        # The upper level with the probability of the fraction.
        line = U32(U32(place + (random[column] & mask)) >> U32(LEVEL_BITS))
        cell = U32(U32(line * size) + (random[column] >> past))
        at[column] = cell if place < last else none


@instead_of(_cells_of_levels)
def _cells_of_levels_of_arrays(mean, random, tables, at):  # type: ignore[no-untyped-def]
    none = U32(len(tables.entry) - 1)
    size = U32((len(tables.entry) - 1) // max(tables.levels, 1))
    first, scale = F32(tables.first * tables.spacing), F32(WHOLE / tables.spacing)
    place = np.minimum((mean - first) * scale + F32(0.5), F32(MOST))
    place = place.astype(np.int32).astype(np.uint32)
    line = (place + (random & U32(WHOLE - 1))) >> U32(LEVEL_BITS)
    cell = line * size + (random >> U32(32 - tables.cells))
    at[:] = np.where(place < U32(WHOLE * max(tables.levels - 1, 0)), cell, none)


@kernel
def _settle(
    out: NDArray[Any],
    at: NDArray[np.uint32],
    random: NDArray[np.uint32],
    other: NDArray[np.uint32],
    tables: Tables,
) -> int:
    """Write the numbers that entries determine, and the columns of the other pixels; return their
    count."""
    entry, lowest = tables.entry, U32(tables.lowest)
    mask = U32((1 << (ENTRY_BITS - tables.cells)) - 1)
    many = 0
    for column in range(len(at)):
        cell = entry[at[column]]
        threshold, step = cell >> U32(16), cell & LOW
        bit = (random[column] >> U32(LEVEL_BITS)) & mask
        if bit != threshold and step != LOW:
            out[column] = U32(lowest + step + (bit > threshold))
        else:
            other[many] = column
            many += 1
    return many


@instead_of(_settle)
def _settle_arrays(out, at, random, other, tables):  # type: ignore[no-untyped-def]
    cell = tables.entry[at]
    bit = (random >> U32(LEVEL_BITS)) & U32((1 << (ENTRY_BITS - tables.cells)) - 1)
    threshold, step = cell >> U32(16), cell & LOW
    settled = (bit != threshold) & (step != LOW)
    out[settled] = (U32(tables.lowest) + step + (bit > threshold).astype(np.uint32))[settled]
    columns = np.flatnonzero(~settled)
    other[: len(columns)] = columns
    return len(columns)


@kernel
def _number_by_all_bits(shot, pixel, line, limit):  # type: ignore[no-untyped-def]
    """Index of a pixel's number in the tables: the count of limits up to all of its 48 bits."""
    wanted = _random_bits(shot, pixel) >> np.uint64(64 - BITS)
    low, high = 0, limit.shape[1]
    while high - low > COUNTED:
        middle = (low + high) // 2
        low, high = (low, middle) if limit[line, middle] > wanted else (middle, high)
    count = low
    for k in range(low, high):  # without branches, which would be mispredicted half of the time
        count += limit[line, k] <= wanted
    return count


@kernel
def draw_number(mean, extra, pixel, draws):  # type: ignore[no-untyped-def]
    """The number of a pixel outside the tables, with extra electrons."""
    law = draws.law
    caught = poisson_of_uniform(mean, uniform(_random_bits(draws.shot, pixel)))
    level = signal(caught + extra, law.full_well, law.nonlinearity)
    if law.noise > 0.0:
        level += law.noise * inverse_normal(uniform(bits(draws.read, pixel)))
    return number(level, law.gain, law.offset, law.adc_inl, law.largest)


@kernel
def _digitise_hit(image, electrons, pixels, extra, draws):  # type: ignore[no-untyped-def]
    for i in range(len(pixels)):
        mean, pixel = electrons[pixels[i]], np.uint64(pixels[i])
        image[pixels[i]] = draw_number(mean, extra[i], pixel, draws)


@kernel
def _normals(out, read):  # type: ignore[no-untyped-def]
    for pixel in range(len(out)):
        out[pixel] = inverse_normal(uniform(bits(read, np.uint64(pixel))))
