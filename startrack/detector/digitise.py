"""Expected electrons -> digital numbers: one uniform number a pixel, exact distribution."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    Floats,
    Streams,
    bits,
    inverse_normal,
    kernel,
    key,
    poisson_of_uniform,
    uniform,
)
from startrack.detector.law import COUNT, Image, Law, blank, number, signal
from startrack.detector.tables import STEPS, UNSETTLED, Tables, tables_for


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
    room = np.empty((2, columns), np.uint32)
    for row in range(rows):
        start = np.uint64(row * columns)
        digitise_row(image[row], electrons[row], start, shot, read, law, tables, room)


@kernel
def digitise_row(out, mean, start, shot, read, law, tables, room):  # type: ignore[no-untyped-def]
    """Write the numbers of pixels in a row, the first of which is pixel number `start`.

    room  (2, n) workspace, at least as long as the row
    """
    at, rest = room[0, : len(mean)], room[1, : len(mean)]
    none = len(tables.entry) - 1
    entry = tables.entry
    # All in 32 bits: mixed integers would be converted, which costs a tenth of the time.
    lowest, unsettled = np.uint32(tables.lowest), np.uint32(UNSETTLED)
    _cells_of_row(mean, shot, start, law.noise, tables, at, rest)
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
            out[column] = _draw_number(mean[column], 0.0, random, read, pixel, law)
        else:
            out[column] = _number_by_all_bits(random, at[column] >> tables.cells, tables)


@kernel
def _cells_of_row(mean, shot, start, noise, tables, at, rest):  # type: ignore[no-untyped-def]
    """Cell of the tables of each pixel in a row, and the 16 bits to compare there.

    A loop without branches, which the compiler vectorises.
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


@kernel
def _number_by_all_bits(random, line, tables):  # type: ignore[no-untyped-def]
    """The number of a pixel in the tables, by all 48 bits."""
    limit = tables.limit[line]
    return tables.lowest + np.searchsorted(limit, random >> np.uint64(16), side="right")


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
