"""Expected electrons -> numbers at once: one uniform number a pixel, through the exact law."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.core import Floats, Streams, bits, drawn, inverse_normal, key, uniform
from startrack.detector.law import COUNT, Image, Law, blank, number, signal
from startrack.detector.tables import OPEN, STEPS, Tables, tables_for


def digitise(electrons: Floats, law: Law, streams: Streams, tables: Tables | None = None) -> Image:
    """The digital image of expected electrons.

    Most pixels of a frame lie near its background and take their number from a table of the exact
    law. The others, in stars, draw their electrons and their read noise one after the other. A
    pixel's uniform number stays the same whatever the design, so that two designs share their
    noise.

    electrons  (rows, columns) expectation of photo- and dark electrons
    tables     of the law where most pixels lie, None for those of the electrons
    Returns    (rows, columns) digital numbers
    Accuracy   numerical: between the levels of the tables, 2e-5 total variation from the exact law,
               6e-5 more variance; none on the levels and none in stars.
    """
    image = blank(electrons.shape, law)
    tables = tables_for(electrons, law) if tables is None else tables
    _digitise(image, electrons, *keys(law, streams), law, tables)
    return image


def shot(electrons: Floats, streams: Streams) -> Floats:
    """The electrons that pixels catch: Poisson numbers (rows, columns); errors as in `digitise`."""
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
    """Draw some pixels of an image anew, in place, with extra electrons in them.

    pixel  (k,) row * columns + column
    extra  (k,) electron
    """
    _digitise_hit(image.ravel(), electrons.ravel(), pixel, extra, *keys(law, streams), law)


def normals(shape: tuple[int, ...], streams: Streams, cause: str) -> Floats:
    """Standard normal numbers, those of the read noise the same as in `digitise`."""
    out = np.empty(shape)
    _normals(out.ravel(), key(streams, cause))
    return out


def keys(law: Law, streams: Streams) -> tuple[np.uint64, np.uint64]:
    """The keys of shot and read noise; what a design does not have is not drawn."""
    read = key(streams, "read noise") if law.noise else np.uint64(0)
    return key(streams, "shot noise"), read


@njit(cache=True, error_model="numpy")
def _digitise(image, electrons, shot, read, law, tables):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    room = np.empty((2, columns), np.uint32)
    for row in range(rows):
        start = np.uint64(row * columns)
        digitise_row(image[row], electrons[row], start, shot, read, law, tables, room)


@njit(cache=True, error_model="numpy")
def digitise_row(out, mean, start, shot, read, law, tables, room):  # type: ignore[no-untyped-def]
    """Write the numbers of pixels in a row, from the one numbered `start` on.

    room  (2, n) for the work, at least as long as the row
    """
    at, rest = room[0, : len(mean)], room[1, : len(mean)]
    none = len(tables.entry) - 1
    entry = tables.entry
    # All in 32 bits: mixed integers would be widened, at a tenth of the time.
    lowest, unsettled = np.uint32(tables.lowest), np.uint32(OPEN)
    _place(mean, shot, start, law.noise, tables, at, rest)
    for column in range(len(mean)):
        found = entry[at[column]]
        threshold = found >> np.uint32(16)
        step = found & unsettled
        if rest[column] != threshold and step != unsettled:
            out[column] = lowest + step + np.uint32(rest[column] > threshold)
            continue
        pixel = start + np.uint64(column)
        random = bits(shot, pixel)
        if at[column] == none:
            out[column] = _one(mean[column], 0.0, random, read, pixel, law)
        else:
            out[column] = _settle(random, at[column] >> tables.cells, tables)


@njit(cache=True, error_model="numpy")
def _place(mean, shot, start, noise, tables, at, rest):  # type: ignore[no-untyped-def]
    """Where in the tables each pixel of a row looks, and the 16 bits to compare there.

    One straight loop without a branch, which the compiler runs on eight pixels at once.
    """
    none = len(tables.entry) - 1
    cells = tables.cells
    first, last = tables.first, tables.first + tables.levels - 1
    step = 1.0 / STEPS
    for column in range(len(mean)):
        random = bits(shot, start + np.uint64(column))
        level = math.floor((math.sqrt(mean[column] + noise * noise) - noise) * STEPS)
        low = level * step
        # The upper level with probability above / width, without a division.
        above = mean[column] - low * (2 * noise + low)
        width = step * (2 * (noise + low) + step)
        up = np.float64(np.int64(random & np.uint64(0xFFFF))) * width < above * 65536.0
        line = np.int64(level - first) + np.int64(up)
        inside = (level >= first) & (level < last)
        cell = (line << cells) + np.int64(random >> np.uint64(64 - cells))
        at[column] = np.uint32(cell if inside else none)
        rest[column] = np.uint32((random >> np.uint64(48 - cells)) & np.uint64(0xFFFF))


@njit(cache=True, error_model="numpy")
def _settle(random, line, tables):  # type: ignore[no-untyped-def]
    """The number, by all 48 bits."""
    limit = tables.limit[line]
    return tables.lowest + np.searchsorted(limit, random >> np.uint64(16), side="right")


@njit(cache=True, error_model="numpy")
def _one(mean, extra, random, read, pixel, law):  # type: ignore[no-untyped-def]
    """The number of a pixel beyond the tables."""
    level = signal(drawn(mean, uniform(random)) + extra, law.full_well, law.nonlinearity)
    if law.noise > 0.0:
        level += law.noise * inverse_normal(uniform(bits(read, pixel)))
    return number(level, law.gain, law.offset, law.adc_inl, law.largest)


@njit(cache=True, error_model="numpy")
def _digitise_hit(image, electrons, pixels, extra, shot, read, law):  # type: ignore[no-untyped-def]
    for i in range(len(pixels)):
        mean, pixel = electrons[pixels[i]], np.uint64(pixels[i])
        image[pixels[i]] = digitised(mean, extra[i], pixel, shot, read, law)


@njit(cache=True, error_model="numpy")
def digitised(mean, extra, pixel, shot, read, law):  # type: ignore[no-untyped-def]
    """The number of one pixel in which there are extra electrons."""
    return _one(mean, extra, bits(shot, pixel), read, pixel, law)


@njit(cache=True, error_model="numpy")
def _normals(out, read):  # type: ignore[no-untyped-def]
    for pixel in range(len(out)):
        out[pixel] = inverse_normal(uniform(bits(read, np.uint64(pixel))))
