"""Stars onto pixels, by six-point Lagrange interpolation of the table of the PSF."""

from typing import NamedTuple

import numpy as np

from startrack import core
from startrack.core import LEAST, Flags, Floats, Ints, PsfTable, Singles, instead_of, kernel

UNIT_GAIN = core.read_only(np.ones((1, 1)))
TAPS = 6


def stamp(
    image: Floats,
    psf: core.Psf,
    x: Floats,
    y: Floats,
    electrons: Floats,
    gain: Floats | None = None,
) -> None:
    """Add the images of points to `image`, in place.

    If the table is the product of a line and a column, as for a Gaussian, only these are read.

    image      (rows, columns) electron
    x, y       (n,) pixel; light outside the image is lost
    electrons  (n,) electron
    gain       (rows, columns) 1, response of each pixel; None: 1 for all
    Accuracy   numerical: 4e-6 of the peak, 1e-5 pixel in the centroid, with the sampling that
               optics gives its tables; Gaussians 4e-7 of the peak, 1e-7 pixel.
    """
    stamp_paths(image, psf, np.ones(1), x[None], y[None], electrons[:, None], gain)


def stamp_paths(
    image: Floats,
    psf: core.Psf | core.FieldPsf,
    weight: Floats,
    x: Floats,
    y: Floats,
    electrons: Floats,
    gain: Floats | None = None,
) -> None:
    """Like `stamp`, for points that move along paths.

    weight     (m,) 1, fraction of the electrons at each point of a path
    x, y       (m, n) pixel
    electrons  (n, k) electron of each table of the PSF
    Accuracy   numerical: as `stamp`
    """
    even = UNIT_GAIN if gain is None else core.read_only(gain)
    # One array layout, because the kernel is compiled again for each layout.
    x, y = np.ascontiguousarray(x), np.ascontiguousarray(y)
    _stamp(image, psf.arranged, weight, x, y, electrons, even)


class Work(NamedTuple):
    """Work arrays for `add_path`, of paths of m points.

    about          (m, 6) along x, then y: the pixel of a point, and the first and last pixel of its
                   visible image relative to it
    start          (m, 2) sample of the table, x and y, before the point
    part           (m, 3) 1, weight of a point, and its distance from that sample, x and y
    across, down   (6,) 1, weights of samples along x and y
    done           (m,) points that are added
    box            (b, b) 1, weights of samples; zero between two uses
    begin          (b * b,) where in the tables the image of a sample begins
    share, short   (b * b,) 1, weight of the sample; `short` in float32
    star           (k,) electron
    """

    about: Ints
    start: Ints
    part: Floats
    across: Floats
    down: Floats
    done: Flags
    box: Floats
    begin: Ints
    share: Floats
    short: Singles
    star: Floats


@kernel
def work_arrays(shape: PsfTable, points: int) -> Work:
    """Work arrays for `add_path`."""
    side = shape.oversampling + 2 * TAPS
    return Work(
        np.empty((points, 6), np.int64),
        np.empty((points, 2), np.int64),
        np.empty((points, 3)),
        np.empty(TAPS),
        np.empty(TAPS),
        np.empty(points, np.bool_),
        np.zeros((side, side)),
        np.empty(side * side, np.int64),
        np.empty(side * side),
        np.empty(side * side, np.float32),
        np.empty(shape.across * (shape.across + 1)),
    )


@kernel
def _stamp(image, shape, weight, x, y, electrons, gain):  # type: ignore[no-untyped-def]
    work = work_arrays(shape, len(weight))
    if len(shape.line):  # a separate loop, in which the compiler removes all reference counts
        for n in range(len(electrons)):
            for m in range(len(weight)):
                _add_product(image, shape, weight[m], x[m, n], y[m, n], electrons[n, 0], gain, work)
        return
    for n in range(len(electrons)):
        add_path(image, shape, weight, x, y, electrons, n, 0, 0, gain, work)


@kernel(borrows=True, forceinline=True)
def add_path(
    image: Floats,
    shape: PsfTable,
    weight: Floats,
    x: Floats,
    y: Floats,
    electrons: Floats,
    n: int,
    left: int,
    top: int,
    gain: Floats,
    work: Work,
) -> None:
    """Add the image of the point n, which moves along a path, with the electrons of each table.

    Points near one pixel share samples of the table, so the weights of each sample are summed
    first.

    left, top  pixel (x, y), position of the first pixel of the image
    gain       response; a single element applies to all pixels
    """
    if len(shape.line):
        for m in range(len(weight)):
            u, v = x[m, n] - left, y[m, n] - top
            _add_product(image, shape, weight[m], u, v, electrons[n, 0], gain, work)
        return
    many = _places(image.shape, shape, weight, x, y, n, left, top, work)
    for first in range(many):
        if not work.done[first]:
            _add_about(image, shape, first, many, electrons[n], gain, work)


@kernel(borrows=True)
def _places(
    size: tuple[int, int],
    shape: PsfTable,
    weight: Floats,
    x: Floats,
    y: Floats,
    n: int,
    left: int,
    top: int,
    work: Work,
) -> int:
    """Write the places of the points whose light reaches an image; return their number."""
    rows, columns = size
    many = 0
    for m in range(len(weight)):
        u, v = x[m, n] - left, y[m, n] - top
        if weight[m] == 0.0 or not _is_seen(u, v, rows, columns, shape):
            continue
        about, start, part = work.about[many], work.start[many], work.part[many]
        part[0] = weight[m]
        about[0], about[1], about[2], start[0], part[1] = _place(u, columns, shape)
        about[3], about[4], about[5], start[1], part[2] = _place(v, rows, shape)
        work.done[many] = about[2] < about[1] or about[5] < about[4]
        many += 1
    return many


@kernel(borrows=True)
def _is_seen(u, v, rows, columns, shape):  # type: ignore[no-untyped-def]
    """Whether light of a point reaches an image; false for NaN, a point behind the camera."""
    half = (shape.samples // 2 - 3) // shape.oversampling
    return -half - 1 < u < columns + half and -half - 1 < v < rows + half


@kernel(borrows=True)
def _place(centre: float, pixels: int, shape: PsfTable) -> tuple[int, int, int, int, float]:
    """Along one axis: the nearest pixel, and the first and last pixel of the point's visible image.

    Also returned: the sample before the point, and the distance of the point from this sample.
    Pixel p + i reads samples that are i * oversampling further, with the same weights: a pixel is a
    stride of the table.
    """
    samples, step = shape.samples, shape.oversampling
    middle = samples // 2
    half = (middle - 3) // step
    pixel = int(np.floor(centre + 0.5))
    at = middle + (pixel - centre) * step
    base = int(np.floor(at))
    first = max(-half, -pixel, -((base - 2) // step))
    last = min(half, pixels - 1 - pixel, (samples - 4 - base) // step)
    return pixel, first, last, base, at - base


@kernel(borrows=True, forceinline=True)
def _add_product(
    image: Floats,
    shape: PsfTable,
    weight: float,
    u: float,
    v: float,
    light: float,
    gain: Floats,
    work: Work,
) -> None:
    """Add the image of one point, for a table that is the product of a line and a column."""
    rows, columns = image.shape
    if weight == 0.0 or not _is_seen(u, v, rows, columns, shape):
        return
    step, across = shape.oversampling, shape.across
    column, left, right, sample_x, behind_x = _place(u, columns, shape)
    row, lowest, highest, sample_y, behind_y = _place(v, rows, shape)
    if right < left or highest < lowest:
        return
    along_x, along_y, star = work.across, work.down, work.star[: (highest - lowest + 1) * across]
    _lagrange(behind_x, along_x)
    _lagrange(behind_y, along_y)
    x, y = sample_x - 2 + left * step, sample_y - 2 + lowest * step
    for j in range(0, len(star), across):
        star[j] = weight * _read(shape.column, y + j // across * step, along_y)
    # The first column comes last, because the others need it.
    for i in range(right - left, -1, -1):
        fraction = _read(shape.line, x + i * step, along_x)
        for j in range(0, len(star), across):
            star[j + i] = star[j] * fraction
    top, bottom, left, right = row + lowest, row + highest, column + left, column + right
    _add_light(image, star, across, top, bottom, left, right, light, gain)


@kernel(borrows=True)
def _add_about(image, shape, first, many, electrons, gain, work):  # type: ignore[no-untyped-def]
    """Add the light of all points near the pixel of the first point."""
    column, left, right, row, lowest, highest = work.about[first]
    star = work.star[: (highest - lowest + 1) * shape.across]
    star[:] = 0.0
    _sum(star, shape, electrons, first, many, work)
    for m in range(first, many):
        work.done[m] = work.done[m] or _alike(work.about[m], work.about[first])
    top, bottom, left, right = row + lowest, row + highest, column + left, column + right
    _add_light(image, star, shape.across, top, bottom, left, right, electrons[0], gain)


@kernel(borrows=True)
def _sum(
    star: Floats, shape: PsfTable, electrons: Floats, first: int, many: int, work: Work
) -> None:
    """Add the tables, relative to the light of the first table, which every image has."""
    curved = abs(electrons[0]) * shape.bend[0] > LEAST
    if curved:
        count = _collect(shape, first, many, True, work)
        _add_images(star, shape.strides.reshape(-1), work.begin, work.share, count)
    if curved and len(electrons) == 1:
        return
    count = _collect(shape, first, many, False, work)
    for k in range(1 if curved else 0, len(electrons)):
        if electrons[k] != 0.0:
            for c in range(count):
                work.short[c] = work.share[c] * (electrons[k] / electrons[0])
            _add_images(star, shape.several[k].reshape(-1), work.begin, work.short, count)


@kernel(borrows=True)
def _alike(about, other):  # type: ignore[no-untyped-def]
    alike = True
    for k in range(6):
        alike = alike and about[k] == other[k]
    return alike


@kernel(borrows=True)
def _collect(shape: PsfTable, first: int, many: int, curved: bool, work: Work) -> int:
    """Write where the images of samples begin, and their weights; return their number (a
    multiple of four).

    curved  interpolate by polynomials of degree five; else linearly, with the same centroid
    """
    step, box = shape.oversampling, work.box
    about = work.about[first]
    corner = shape.samples // 2 - (step + 1) // 2 - 3
    low_x, low_y, high_x, high_y = len(box), len(box), 0, 0
    for m in range(first, many):
        if not _alike(work.about[m], about):
            continue
        x, y = work.start[m, 0] - 2 - corner, work.start[m, 1] - 2 - corner
        low_x, low_y = min(low_x, x), min(low_y, y)
        high_x, high_y = max(high_x, x + TAPS), max(high_y, y + TAPS)
        share, u, v = work.part[m]
        if curved:
            _lagrange(u, work.across)
            _lagrange(v, work.down)
            for b in range(TAPS):
                for a in range(TAPS):
                    box[y + b, x + a] += share * work.down[b] * work.across[a]
        else:
            box[y + 2, x + 2] += share * (1 - v) * (1 - u)
            box[y + 2, x + 3] += share * (1 - v) * u
            box[y + 3, x + 2] += share * v * (1 - u)
            box[y + 3, x + 3] += share * v * u
    # The image of a sample: its index among step * step images, and the start of its first pixel.
    count, size, before = 0, shape.strides.shape[2], corner + about[1] * step
    for j in range(low_y, high_y):
        y = corner + j + about[4] * step
        which, begin = y % step * step, y // step * shape.across
        for i in range(low_x, high_x):
            if box[j, i] != 0.0:
                column = (before + i) // step
                work.begin[count] = (which + before + i - column * step) * size + begin + column
                work.share[count] = box[j, i]
                box[j, i] = 0.0
                count += 1
    while count % 4:
        work.begin[count], work.share[count] = work.begin[0], 0.0
        count += 1
    return count


@kernel(borrows=True)
def _add_images(star, table, begin, share, count):  # type: ignore[no-untyped-def]
    """Add the weighted images of samples, all rows in one loop."""
    many = len(star)
    for k in range(0, count, 4):
        # Slices, because the compiler would check an index for negative values.
        a = table[begin[k] : begin[k] + many]
        b = table[begin[k + 1] : begin[k + 1] + many]
        c = table[begin[k + 2] : begin[k + 2] + many]
        d = table[begin[k + 3] : begin[k + 3] + many]
        wa, wb, wc, wd = share[k], share[k + 1], share[k + 2], share[k + 3]
        for n in range(many):
            star[n] += wa * a[n] + wb * b[n] + wc * c[n] + wd * d[n]


@instead_of(_add_images)
def _add_images_of_arrays(star, table, begin, share, count):  # type: ignore[no-untyped-def]
    star += share[:count] @ table[begin[:count, None] + np.arange(len(star))]


@kernel(borrows=True)
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
def _read(line, start, weight):  # type: ignore[no-untyped-def]
    total = 0.0
    for a in range(TAPS):
        total += weight[a] * line[start + a]
    return total


@kernel
def _lagrange(t, weight):  # type: ignore[no-untyped-def]
    """Weights of the samples -2 ... 3 for a value at t in [0, 1), in explicit product form."""
    a, b, c, d, e, f = t + 2, t + 1, t, t - 1, t - 2, t - 3
    weight[0] = -b * c * d * e * f / 120
    weight[1] = a * c * d * e * f / 24
    weight[2] = -a * b * d * e * f / 12
    weight[3] = a * b * c * e * f / 12
    weight[4] = -a * b * c * d * f / 24
    weight[5] = a * b * c * d * e / 120
