"""Expected electrons -> digital numbers: one uniform number a pixel, exact distribution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    GOLDEN,
    Floats,
    Streams,
    bits,
    instead_of,
    inverse_normal,
    kernel,
    key,
    mixed,
    poisson_of_uniform,
    uniform,
)
from startrack.detector.law import COUNT, Image, Law, blank, number, signal
from startrack.detector.tables import STEPS, Tables, tables_for


def digitise(electrons: Floats, law: Law, streams: Streams, tables: Tables | None = None) -> Image:
    """The digital image of expected electrons.

    Most pixels of a frame are near its background and take their number from a table of the exact
    distribution. The others, in stars, draw their electrons and then their read noise. The uniform
    number of a pixel is the same for each design, so that two designs have the same noise.

    electrons  (rows, columns) expectation of photo- and dark electrons
    tables     for most pixels of the frame; None: made from `electrons`
    Returns    (rows, columns) digital numbers
    Accuracy   numerical: between the levels of the tables, total variation 2e-5 from the exact
               distribution, relative variance 6e-5 too large; exact on the levels and in stars.
    """
    image = blank(electrons.shape, law)
    tables = tables_for(electrons, law) if tables is None else tables
    _digitise(image, electrons, *keys(law, streams), law, tables)
    return image


def shot(electrons: Floats, streams: Streams) -> Floats:
    """Poisson numbers of electrons (rows, columns); accuracy as `digitise`."""
    caught = np.empty(electrons.shape)
    _digitise(caught, electrons, *keys(COUNT, streams), COUNT, tables_for(electrons, COUNT))
    return caught


def digitise_hit(
    image: Image,
    electrons: Floats,
    pixel: NDArray[np.int64],
    extra: Floats,
    law: Law,
    streams: Streams,
) -> None:
    """Replace some pixels of an image, in place, by their numbers with extra electrons.

    pixel  (k,) row * columns + column
    extra  (k,) electron
    """
    _digitise_hit(image.ravel(), electrons.ravel(), pixel, extra, *keys(law, streams), law)


def normals(shape: tuple[int, ...], streams: Streams, cause: str) -> Floats:
    """Standard normal numbers of a cause; those of the read noise are the ones of `digitise`."""
    out = np.empty(shape)
    _normals(out.ravel(), key(streams, cause))
    return out


def keys(law: Law, streams: Streams) -> tuple[np.uint64, np.uint64]:
    """Keys of shot noise and read noise; the latter is not drawn where there is none."""
    read = key(streams, "read noise") if law.noise else np.uint64(0)
    return key(streams, "shot noise"), read


@kernel
def _digitise(image, electrons, shot, read, law, tables):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    room = work_row()
    for row in range(rows):
        start = np.uint64(row * columns)
        digitise_row(image[row], electrons[row], start, shot, read, law, tables, room)


U32, F32 = np.uint32, np.float32
LOW = np.uint32(0xFFFF)
COUNTED = 64  # limits that take less time to be counted than to be searched; chosen by hand
# Pixels of a row in one step: with the tables of their levels they fit the first cache of a core
# (32 KiB). More are slower by a fifth, fewer spend the time at the ends of the loops.
PART = 512
WORK = 3  # rows of the workspace


@kernel
def work_row():  # type: ignore[no-untyped-def]
    """Work array for `digitise_row`."""
    return np.empty((WORK, PART), np.uint32)


@kernel
def digitise_row(out, mean, start, shot, read, law, tables, room):  # type: ignore[no-untyped-def]
    """Write the numbers of pixels in a row, the first of which is pixel number `start`.

    room  from `work_row`
    """
    for first in range(0, len(mean), PART):
        part, pixel = mean[first : first + PART], start + np.uint64(first)
        _digitise_part(out[first : first + PART], part, pixel, shot, read, law, tables, room)


# The loops of a part are separate so that each has numbers of one width: a processor works on as
# many at once as the widest of them allows, and those without AVX-512 convert between 64-bit
# integers and floats one by one. Each sum is cut to 32 bits at once, because numba would go on in
# 64.
@kernel
def _digitise_part(out, mean, start, shot, read, law, tables, room):  # type: ignore[no-untyped-def]
    many = len(mean)
    at, rest, other = room[0, :many], room[1, :many], room[2, :many]
    none = len(tables.entry) - 1
    _random_cells(shot, start, tables.cells, at, rest)
    near = other.view(np.float32)
    for column in range(many):
        near[column] = F32(mean[column])
    _cells_of_levels(near, F32(law.noise), tables, at, rest)
    for k in range(_settle(out, at, rest, other, tables.entry, U32(tables.lowest))):
        column = np.int64(other[k])
        pixel = start + np.uint64(column)
        random = bits(shot, pixel)
        if at[column] == none:
            out[column] = _draw_number(mean[column], 0.0, random, read, pixel, law)
        else:
            line = np.int64(at[column] >> tables.cells)
            out[column] = tables.lowest + _number_by_all_bits(random, line, tables.limit)


@kernel
def _random_cells(shot, start, cells, at, rest):  # type: ignore[no-untyped-def]
    """Cell of each pixel in its level, and two numbers of 16 bits: for the level, for the entry."""
    of_cell, of_entry = np.uint64(64 - cells), np.uint64(48 - cells)
    # Summed, because a product of 64 bits is many operations on processors without AVX-512.
    state = shot + GOLDEN * start
    for column in range(len(at)):
        state += GOLDEN
        random = mixed(state)
        at[column] = U32(random >> of_cell)
        rest[column] = U32((random << np.uint64(16)) | ((random >> of_entry) & np.uint64(LOW)))


@instead_of(_random_cells)
def _random_cells_of_arrays(shot, start, cells, at, rest):  # type: ignore[no-untyped-def]
    random = bits(shot, start + np.arange(len(at), dtype=np.uint64))
    at[:] = random >> np.uint64(64 - cells)
    rest[:] = (random << np.uint64(16)) | ((random >> np.uint64(48 - cells)) & np.uint64(LOW))


@kernel
def _cells_of_levels(mean, noise, tables, at, rest):  # type: ignore[no-untyped-def]
    """Move the cells of pixels to one of the two levels about their expectation, or to none.

    In 32 bits: the mean of a pixel is right to 1e-4 of its standard deviation up to 1e6 electrons.
    """
    none = U32(len(tables.entry) - 1)
    # Not 1 << cells, which the compiler makes a shift of, in 64 bits.
    size = U32((len(tables.entry) - 1) // max(tables.levels, 1))
    first, count = U32(tables.first), U32(max(tables.levels - 1, 0))
    steps, step, two, whole = F32(STEPS), F32(1.0 / STEPS), F32(2.0), F32(65536.0)
    square = noise * noise
    for column in range(len(mean)):
        level = np.int32((np.sqrt(mean[column] + square) - noise) * steps)
        low = F32(level) * step
        # The upper level with probability above / width, without a division.
        above = mean[column] - low * (two * noise + low)
        width = step * (two * (noise + low) + step)
        line = U32(U32(level) - first)
        cell = U32(U32(line * size) + at[column])
        upper = U32(cell + size)
        cell = upper if F32(np.int32(rest[column] >> U32(16))) * width < above * whole else cell
        at[column] = cell if line < count else none  # below the first, the line is a huge number


@instead_of(_cells_of_levels)
def _cells_of_levels_of_arrays(mean, noise, tables, at, rest):  # type: ignore[no-untyped-def]
    none = U32(len(tables.entry) - 1)
    size = U32((len(tables.entry) - 1) // max(tables.levels, 1))
    first, count = U32(tables.first), U32(max(tables.levels - 1, 0))
    steps, step, two, whole = F32(STEPS), F32(1.0 / STEPS), F32(2.0), F32(65536.0)
    level = ((np.sqrt(mean + noise * noise) - noise) * steps).astype(np.int32)
    low = level.astype(np.float32) * step
    above = mean - low * (two * noise + low)
    width = step * (two * (noise + low) + step)
    line = level.astype(np.uint32) - first
    upper = (rest >> U32(16)).astype(np.float32) * width < above * whole
    cell = line * size + at + size * upper.astype(np.uint32)
    at[:] = np.where(line < count, cell, none)


@kernel
def _settle(out, at, rest, other, entry, lowest):  # type: ignore[no-untyped-def]
    """Write the numbers that entries settle, and the columns of the other pixels; how many."""
    many = 0
    for column in range(len(at)):
        found = entry[at[column]]
        threshold, step, bit = found >> U32(16), found & LOW, rest[column] & LOW
        if bit != threshold and step != LOW:
            out[column] = U32(lowest + step + (bit > threshold))
        else:
            other[many] = column
            many += 1
    return many


@instead_of(_settle)
def _settle_arrays(out, at, rest, other, entry, lowest):  # type: ignore[no-untyped-def]
    found, bit = entry[at], rest & LOW
    threshold, step = found >> U32(16), found & LOW
    settled = (bit != threshold) & (step != LOW)
    out[settled] = (lowest + step + (bit > threshold).astype(np.uint32))[settled]
    columns = np.flatnonzero(~settled)
    other[: len(columns)] = columns
    return len(columns)


@kernel
def _number_by_all_bits(random, line, limit):  # type: ignore[no-untyped-def]
    """Index of the number of a pixel in the tables, by all 48 bits: the limits up to them."""
    wanted = random >> np.uint64(16)
    low, high = 0, limit.shape[1]
    while high - low > COUNTED:
        middle = (low + high) // 2
        low, high = (low, middle) if limit[line, middle] > wanted else (middle, high)
    count = low
    for k in range(low, high):  # without branches, each of which is wrong half of the time
        count += limit[line, k] <= wanted
    return count


@kernel
def _draw_number(mean, extra, random, read, pixel, law):  # type: ignore[no-untyped-def]
    """The number of a pixel outside the tables."""
    level = signal(
        poisson_of_uniform(mean, uniform(random)) + extra, law.full_well, law.nonlinearity
    )
    if law.noise > 0.0:
        level += law.noise * inverse_normal(uniform(bits(read, pixel)))
    return number(level, law.gain, law.offset, law.adc_inl, law.largest)


@kernel
def _digitise_hit(image, electrons, pixels, extra, shot, read, law):  # type: ignore[no-untyped-def]
    for i in range(len(pixels)):
        mean, pixel = electrons[pixels[i]], np.uint64(pixels[i])
        image[pixels[i]] = digitise_pixel(mean, extra[i], pixel, shot, read, law)


@kernel
def digitise_pixel(mean, extra, pixel, shot, read, law):  # type: ignore[no-untyped-def]
    """The number of one pixel with extra electrons."""
    return _draw_number(mean, extra, bits(shot, pixel), read, pixel, law)


@kernel
def _normals(out, read):  # type: ignore[no-untyped-def]
    for pixel in range(len(out)):
        out[pixel] = inverse_normal(uniform(bits(read, np.uint64(pixel))))
