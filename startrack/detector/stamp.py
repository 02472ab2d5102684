"""Stars onto pixels: six-point Lagrange interpolation of the table of the PSF."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from startrack.core import LEAST, FieldPsf, Floats, Psf, instead_of, kernel

UNIT_GAIN = np.ones((1, 1))
UNIT_GAIN.flags.writeable = False
EMPTY = np.empty(0)
NO_BEND = np.array([np.inf])
TAPS = 6
PRODUCT_TOLERANCE = (
    1e-14  # of the peak, by which a table may differ from the product of its middle lines
)


class PsfTable(NamedTuple):
    """The tables of a PSF, arranged for the kernels.

    The pixels of a star are `oversampling` samples apart. So a star is the sum of 36 images, one
    for each interpolation weight, whose pixels are neighbours when the table is sorted by strides.

    strides       (oversampling, oversampling, k) 1, for each first row and column of samples: the
                  pixels row by row, `across` of them in a row; of the first table
    several       (tables, oversampling, oversampling, k) float32, of all tables of a FieldPsf
    bend          (tables,) 1, error of straight lines between the samples of each table of a
                  FieldPsf; infinite otherwise
    line, column  (m,) along x and along y, whose product is the only table; empty otherwise
    samples       along a side of a table
    oversampling  samples per pixel
    across        pixels of a side of the table, rounded up
    """

    strides: Floats
    several: NDArray[np.float32]
    bend: Floats
    line: Floats
    column: Floats
    samples: int
    oversampling: int
    across: int


_shapes: WeakKeyDictionary[Psf | FieldPsf, PsfTable] = WeakKeyDictionary()


def stamp(
    image: Floats, psf: Psf, x: Floats, y: Floats, electrons: Floats, gain: Floats | None = None
) -> None:
    """Add the images of points to `image`, in place.

    If the table is the product of a line and a column, as a Gaussian's, only these are read.

    image      (rows, columns) electron
    x, y       (n,) pixel; light outside the image is lost
    electrons  (n,) electron
    gain       (rows, columns) 1, response of each pixel, None: all are one
    Accuracy   numerical: 4e-6 of the peak, 1e-5 pixel in the centroid, with the sampling that
               optics gives its tables; Gaussians 4e-7 of the peak, 1e-7 pixel.
    """
    stamp_paths(image, psf, np.ones(1), x[None], y[None], electrons[:, None], gain)


def stamp_paths(
    image: Floats,
    psf: Psf | FieldPsf,
    weight: Floats,
    x: Floats,
    y: Floats,
    electrons: Floats,
    gain: Floats | None = None,
) -> None:
    """As `stamp`, for points that move along paths.

    weight     (m,) 1, fraction of the electrons at each point of a path
    x, y       (m, n) pixel
    electrons  (n, k) electron of each table of the PSF
    Accuracy   numerical: as `stamp`; neighbouring points of a faint star on a FieldPsf count as one
               where that changes no pixel by more than LEAST electrons.
    """
    even = UNIT_GAIN if gain is None else gain
    _stamp(image, psf_table(psf), weight, x, y, electrons, even)


def psf_table(psf: Psf | FieldPsf) -> PsfTable:
    """The arranged tables of a PSF, made once."""
    if psf not in _shapes:
        tables = psf.table if isinstance(psf, FieldPsf) else psf.table[None]
        count, side, _ = tables.shape
        step = psf.oversampling
        across = -(-side // step)
        padded = np.zeros((count, across * step, across * step))
        padded[:, :side, :side] = tables
        strides = padded.reshape(count, across, step, across, step).transpose(0, 2, 4, 1, 3)
        # Kernels read whole rows, also from the last pixels on.
        room = np.zeros((count, step, step, across * (across + 2)))
        room[..., : across**2] = strides.reshape(count, step, step, -1)
        lines = (EMPTY, EMPTY) if isinstance(psf, FieldPsf) else _separate(psf.table)
        several, bend = np.empty((0, *room.shape[1:]), np.float32), NO_BEND
        if isinstance(psf, FieldPsf):
            several = np.ascontiguousarray(room, np.float32)
            bend = np.array([_bend(one) for one in tables])
        _shapes[psf] = PsfTable(room[0].copy(), several, bend, *lines, side, step, across)
    return _shapes[psf]


def _bend(table: Floats) -> float:
    """Largest error of straight lines between samples: an eighth of the second differences."""
    return sum(float(np.abs(np.diff(table, 2, axis=axis)).max()) for axis in (0, 1)) / 8


def _separate(table: Floats) -> tuple[Floats, Floats]:
    """The line (along x) and the column of which the table is the product, if it is one."""
    middle = table.shape[0] // 2
    line, column, peak = table[middle], table[:, middle], table[middle, middle]
    alike = (
        peak > 0
        and np.abs(np.outer(column, line) - table * peak).max() <= PRODUCT_TOLERANCE * peak**2
    )
    return (line / np.sqrt(peak), column / np.sqrt(peak)) if alike else (EMPTY, EMPTY)


@kernel
def _stamp(image, shape, weight, x, y, electrons, gain):  # type: ignore[no-untyped-def]
    room = work_array(shape)
    for n in range(len(electrons)):
        add_path(image, shape, weight, x[:, n], y[:, n], 0, 0, electrons[n], gain, room)


@kernel
def add_path(image, shape, weight, x, y, left, top, electrons, gain, room):  # type: ignore[no-untyped-def]
    """Add the image of a point that moves along a path: `add_star`.

    left, top  pixel (x, y) of the first one of the image
    """
    count = len(weight)
    size = _together(shape, weight, x, y, electrons)
    for first in range(0, count, size):
        share, along, down = _mean_of(weight, x, y, first, min(first + size, count))
        if share != 0.0:
            add_star(image, shape, along - left, down - top, share, electrons, gain, room)


@kernel
def _together(shape, weight, x, y, electrons):  # type: ignore[no-untyped-def]
    """How many neighbouring points of a path count as one, at their mean.

    With w the weights and d the distances from the mean, a pixel changes by at most

        (1/2) electrons max|f''| sum w d^2,   max|f''| = 8 bend oversampling^2

    of each table, which may be LEAST.
    """
    if shape.bend[0] == np.inf:
        return 1
    curved = 0.0
    for k in range(len(electrons)):
        curved += abs(electrons[k]) * shape.bend[k]
    most = LEAST / (4 * curved * shape.oversampling**2 + 1e-300)
    size = len(weight)
    while size > 1:
        spread = 0.0
        for first in range(0, len(weight), size):
            last = min(first + size, len(weight))
            _, along, down = _mean_of(weight, x, y, first, last)
            for m in range(first, last):
                spread += weight[m] * ((x[m] - along) ** 2 + (y[m] - down) ** 2)
        if spread <= most:
            break
        size = (size + 1) // 2
    return size


@kernel
def _mean_of(weight, x, y, first, last):  # type: ignore[no-untyped-def]
    """Weight and mean place of some points; the place of one is its own, to the bit."""
    share = along = down = 0.0
    for m in range(first, last):
        share += weight[m]
        along += weight[m] * (x[m] - x[first])
        down += weight[m] * (y[m] - y[first])
    if share != 0.0:
        along, down = along / share, down / share
    return share, x[first] + along, y[first] + down


@kernel
def work_array(shape):  # type: ignore[no-untyped-def]
    """Work array for `add_star`."""
    return np.empty(2 * TAPS + shape.across * (shape.across + 1))


@kernel
def add_star(image, shape, x, y, share, electrons, gain, room):  # type: ignore[no-untyped-def]
    """Add the image of one point: a share of the electrons of each table.

    One element of gain is for all pixels.
    """
    rows, columns = image.shape
    step = shape.oversampling
    reach = (shape.samples // 2 - 3) // step
    # NaN, behind the camera, reaches nothing.
    if not (-reach - 1 < x < columns + reach and -reach - 1 < y < rows + reach):
        return
    wx, wy, star = room[:TAPS], room[TAPS : 2 * TAPS], room[2 * TAPS :]
    column, left, right, start_x = _place(x, columns, shape.samples, step, wx)
    row, lowest, highest, start_y = _place(y, rows, shape.samples, step, wy)
    if right < left or highest < lowest:
        return
    start_x, start_y = start_x + left * step, start_y + lowest * step
    star = star[: (highest - lowest + 1) * shape.across]
    first = 1
    if len(shape.line):
        _product(star, shape, start_x, start_y, wx, wy, right - left + 1)
    elif abs(electrons[0]) * shape.bend[0] <= LEAST:
        star[:] = 0.0
        first = 0
    else:
        _sum(star, shape, start_x, start_y, wx, wy)
    # In units of the light of the first table, which no image is without.
    for k in range(first, len(electrons)):
        if electrons[k] != 0.0:
            _add_table(star, shape, k, start_x, start_y, wx, wy, electrons[k] / electrons[0])
    light = share * electrons[0]
    top, bottom, left, right = row + lowest, row + highest, column + left, column + right
    _add_light(image, star, shape.across, top, bottom, left, right, light, gain)


@kernel
def _add_light(image, star, across, top, bottom, left, right, light, gain):  # type: ignore[no-untyped-def]
    even = gain.size == 1
    for j in range(top, bottom + 1):
        line = star[(j - top) * across :]
        for i in range(left, right + 1):
            seen = 1.0 if even else gain[j, i]
            image[j, i] += light * line[i - left] * seen


@instead_of(_add_light)
def _add_light_of_arrays(image, star, across, top, bottom, left, right, light, gain):  # type: ignore[no-untyped-def]
    part = slice(top, bottom + 1), slice(left, right + 1)
    lines = star.reshape(-1, across)[:, : right - left + 1]
    image[part] += light * lines * (1.0 if gain.size == 1 else gain[part])


@kernel
def _place(centre, pixels, samples, oversampling, weight):  # type: ignore[no-untyped-def]
    """Along one axis: the nearest pixel, the first and last around it, and their first sample.

    Pixel p + i reads the samples from `start` + i * oversampling on, with the six weights: one
    pixel is one stride of the table, so all pixels of a star share them.
    """
    middle = samples // 2
    reach = (middle - 3) // oversampling
    pixel = int(np.floor(centre + 0.5))
    at = middle + (pixel - centre) * oversampling
    base = int(np.floor(at))
    _lagrange(at - base, weight)
    first = max(-reach, -pixel, -((base - 2) // oversampling))
    last = min(reach, pixels - 1 - pixel, (samples - 4 - base) // oversampling)
    return pixel, first, last, base - 2


@kernel
def _sum(star, shape, x, y, wx, wy):  # type: ignore[no-untyped-def]
    """The sum of the weighted images, all rows in one loop."""
    step = shape.oversampling
    star[:] = 0.0
    for b in range(TAPS):
        for a in range(TAPS):
            weight = wy[b] * wx[a]
            start = (y + b) // step * shape.across + (x + a) // step
            # A slice, because the compiler would check the index for values below zero.
            part = shape.strides[(y + b) % step, (x + a) % step][start : start + len(star)]
            for k in range(len(star)):
                star[k] += weight * part[k]


@instead_of(_sum)
def _sum_of_arrays(star, shape, x, y, wx, wy):  # type: ignore[no-untyped-def]
    step = shape.oversampling
    star[:] = 0.0
    for b in range(TAPS):
        for a in range(TAPS):
            start = (y + b) // step * shape.across + (x + a) // step
            part = shape.strides[(y + b) % step, (x + a) % step][start : start + len(star)]
            star += wy[b] * wx[a] * part


@kernel
def _product(star, shape, x, y, wx, wy, width):  # type: ignore[no-untyped-def]
    for j in range(0, len(star), shape.across):
        star[j] = _read(shape.column, y + j // shape.across * shape.oversampling, wy)
    # The first column last, which the others need.
    for i in range(width - 1, -1, -1):
        fraction = _read(shape.line, x + i * shape.oversampling, wx)
        for j in range(0, len(star), shape.across):
            star[j + i] = star[j] * fraction


@kernel
def _read(line, start, weight):  # type: ignore[no-untyped-def]
    total = 0.0
    for a in range(TAPS):
        total += weight[a] * line[start + a]
    return total


@kernel
def _add_table(star, shape, which, x, y, wx, wy, size):  # type: ignore[no-untyped-def]
    """Add one of the tables of a FieldPsf, with straight lines between samples.

    The centroid stays that of the polynomials of the fifth degree.
    """
    step, across, many = shape.oversampling, shape.across, len(star)
    u = v = 0.0
    for a in range(TAPS):
        u, v = u + wx[a] * (a - 2), v + wy[a] * (a - 2)
    x, y = x + 2, y + 2
    upper, lower = y // step * across, (y + 1) // step * across
    left, right = x // step, (x + 1) // step
    table = shape.several[which]
    a = table[y % step, x % step][upper + left : upper + left + many]
    b = table[y % step, (x + 1) % step][upper + right : upper + right + many]
    c = table[(y + 1) % step, x % step][lower + left : lower + left + many]
    d = table[(y + 1) % step, (x + 1) % step][lower + right : lower + right + many]
    wa, wb = np.float32(size * (1 - v) * (1 - u)), np.float32(size * (1 - v) * u)
    wc, wd = np.float32(size * v * (1 - u)), np.float32(size * v * u)
    _add_weighted(star, a, b, c, d, wa, wb, wc, wd)


@kernel
def _add_weighted(star, a, b, c, d, wa, wb, wc, wd):  # type: ignore[no-untyped-def]
    for k in range(len(star)):
        star[k] += wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k]


@instead_of(_add_weighted)
def _add_weighted_arrays(star, a, b, c, d, wa, wb, wc, wd):  # type: ignore[no-untyped-def]
    star += wa * a + wb * b + wc * c + wd * d


@kernel
def _lagrange(t, weight):  # type: ignore[no-untyped-def]
    """Weights of the samples -2 ... 3 for a value at t in [0, 1), product form written out."""
    a, b, c, d, e, f = t + 2, t + 1, t, t - 1, t - 2, t - 3
    weight[0] = -b * c * d * e * f / 120
    weight[1] = a * c * d * e * f / 24
    weight[2] = -a * b * d * e * f / 12
    weight[3] = a * b * c * e * f / 12
    weight[4] = -a * b * c * d * f / 24
    weight[5] = a * b * c * d * e / 120
