"""Stars and windows -> a Frame whose numbers are valid only inside these windows."""

import math
from typing import NamedTuple

import numpy as np

from startrack import core
from startrack.core import Floats, Ints, kept, kernel
from startrack.detector.collect import background, background_tables
from startrack.detector.digitise import digitise_window, draw_number, draws_of, work_row
from startrack.detector.exposure import Places, colours, to_frame
from startrack.detector.imperfections import tracks
from startrack.detector.law import SignalLaw, Tables, law_of
from startrack.detector.maps import dark, response
from startrack.detector.parameters import Detector
from startrack.detector.stamp import UNIT_GAIN, Work, add_path, work_arrays

NO_HITS = np.empty(0, np.int64), np.empty(0)


class PixelMaps(NamedTuple):
    """Maps of the pixels, for the kernels; a map of one element applies to all pixels.

    sky        electron of the uniform background in a pixel of mean response
    gain       (rows, columns) 1, response
    crosstalk  1, fraction that goes to each of the four sides
    dark       (rows, columns) electron
    """

    sky: float
    gain: Floats
    crosstalk: float
    dark: Floats


class StarPaths(NamedTuple):
    """Stars along their paths, for the kernels.

    shape   tables of the PSF
    weight  (m,), x and y (m, n), of the points of the paths
    star    (n, k) electron of each table
    """

    shape: core.PsfTable
    weight: Floats
    x: Floats
    y: Floats
    star: Floats


def expose_within(
    windows: Ints,
    places: Places,
    star: Floats,
    psf: core.Psf | core.FieldPsf,
    detector: Detector,
    sky: float,
    streams: core.Streams,
    workspace: core.Workspace,
    colour: Floats | None = None,
) -> core.Frame:
    """The numbers of `expose` inside windows, and the mean of the uniform background elsewhere.

    windows  (w, 4) left, top, right, bottom, the last two exclusive; they may overlap
    places   weights (m,), x and y (m, n) of the points of the stars' paths
    star     (n,) electron in the exposure
    sky      electron in a pixel of mean response
    workspace  owns the frame's image; the next call with it overwrites the image
    colour   (n,) metre, mean wavelength of each star's light; needed by a FieldPsf
    Returns  Frame of float32, which represents all numbers of 24 bits exactly
    """
    level, pixels, law, tables = _device(detector, sky)
    shape, hits = (detector.rows, detector.columns), NO_HITS
    image = workspace.canvas("digital numbers", shape, level, windows)
    if detector.hits:
        hits = tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
    if isinstance(psf, core.FieldPsf):
        weight, x, y = places
        x, y, part = psf.split(x, y, star, weight, colours(colour))
        places = weight, x, y
    else:
        part = star[:, None]
    points = StarPaths(psf.arranged, *places, part)
    _render(image, windows, pixels, points, *hits, draws_of(law, tables, streams))
    return to_frame(image, detector)


@kept(4)
def _device(detector: Detector, sky: float) -> tuple[float, PixelMaps, SignalLaw, Tables]:
    """Values that all exposures of one background share; the mean digital number without stars is
    first.
    """
    gain, electrons = response(detector), np.atleast_2d(dark(detector)) * detector.exposure
    empty = (sky + detector.dark_rate * detector.exposure) / detector.electrons_per_dn
    pixels = PixelMaps(sky, UNIT_GAIN if gain is None else gain, detector.crosstalk, electrons)
    return detector.offset + empty, pixels, law_of(detector), background_tables(detector, sky)


def write_numbers(frame: core.Frame, pixel: Ints, numbers: Ints) -> None:
    """Write numbers (k, 2 m + 1, 2 n + 1) around pixels into a frame of `expose_within`.

    pixel  (k,) row * columns + column
    """
    _put(frame.image, pixel, numbers)


def independent_pixels(detector: Detector, outliers: Ints, streams: core.Streams) -> Ints:
    """The pixels that a trial always searches: outliers, and pixels with hits.

    Returns  (k,) row * columns + column
    """
    if not detector.hits:
        return outliers
    shape = (detector.rows, detector.columns)
    pixel, _ = tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
    return np.concatenate([outliers, pixel])


@kept(8)
def outlier_pixels(detector: Detector, sky: float, limit: float) -> Ints:
    """Outlier pixels (hot, dead, or far from the median), (k,) row * columns + column.

    limit  standard deviations of a pixel between its expectation and the median
    """
    level = background(detector, sky)
    middle = float(np.median(level[:: max(1, level.shape[0] // 256)]))
    spread = math.hypot(math.sqrt(middle), law_of(detector).noise)
    return np.flatnonzero(np.abs(level - middle) > limit * spread)


@kernel
def _render(image, windows, pixels, points, hit, extra, draws):  # type: ignore[no-untyped-def]
    """Render one window after the other, in memory that stays in the cache of the processor."""
    rows, columns = image.shape
    ends = _path_bounds(points.x, points.y)
    room, work = work_row(), work_arrays(points.shape, len(points.weight))
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        electrons = _window_electrons(windows[k], rows, columns, pixels, points, ends, work)
        electrons += _crop(pixels.dark, left, top, right, bottom)
        digitise_window(image, left, top, electrons, draws, room)
        if len(hit):
            _add_hits(image, windows[k], electrons, hit, extra, draws)


@kernel
def _add_hits(image, window, electrons, hit, extra, draws):  # type: ignore[no-untyped-def]
    """Replace the numbers of the pixels of a window that were hit."""
    left, top, right, bottom = window
    for row in range(top, bottom):
        first = row * image.shape[1]
        n = np.searchsorted(hit, first + left)
        while n < len(hit) and hit[n] < first + right:
            column = hit[n] - first
            mean = electrons[row - top, column - left]
            image[row, column] = draw_number(mean, extra[n], np.uint64(hit[n]), draws)
            n += 1


@kernel
def _window_electrons(
    window: Ints,
    rows: int,
    columns: int,
    pixels: PixelMaps,
    points: StarPaths,
    ends: Floats,
    work: Work,
) -> Floats:
    """Electrons of the background and of the stars near a window, summed in the order of a frame.

    Only the map of the response is read, not also that of `background`, because memory is slow.
    """
    left, top, right, bottom = window
    # With crosstalk, one more pixel on each side contributes.
    beyond = 1 if pixels.crosstalk > 0 else 0
    first, last = max(left - beyond, 0), min(right + beyond, columns)
    upper, lower = max(top - beyond, 0), min(bottom + beyond, rows)
    gain = _crop(pixels.gain, first, upper, last, lower)
    electrons = np.full((lower - upper, last - first), pixels.sky)
    electrons *= gain
    far = points.shape.across // 2 + 1
    for n in range(len(ends)):
        low_x, low_y, high_x, high_y = ends[n]
        # False for NaN, a point behind the camera.
        near = low_x < last + far and high_x > first - far
        if not (near and low_y < lower + far and high_y > upper - far):
            continue
        add_path(
            electrons,
            points.shape,
            points.weight,
            points.x,
            points.y,
            points.star,
            n,
            first,
            upper,
            gain,
            work,
        )
    if pixels.crosstalk > 0:
        electrons = _diffused(electrons, pixels.crosstalk)
    return electrons[top - upper : bottom - upper, left - first : right - first]


@kernel
def _diffused(electrons, fraction):  # type: ignore[no-untyped-def]
    """Like `effects.diffuse`; no electron crosses the border of the array."""
    rows, columns = electrons.shape
    after = (1 - 4 * fraction) * electrons
    for y in range(rows):
        above, below = max(y - 1, 0), min(y + 1, rows - 1)
        for x in range(columns):
            sides = electrons[y, max(x - 1, 0)] + electrons[y, min(x + 1, columns - 1)]
            after[y, x] += fraction * (sides + electrons[above, x] + electrons[below, x])
    return after


@kernel
def _crop(of, left, top, right, bottom):  # type: ignore[no-untyped-def]
    """A window of a map; a map of one element applies to all pixels."""
    return of if of.size == 1 else of[top:bottom, left:right]


@kernel
def _path_bounds(x, y):  # type: ignore[no-untyped-def]
    """(n, 4) least x and y, largest x and y of each path."""
    ends = np.empty((x.shape[1], 4))
    for n in range(len(ends)):
        ends[n, 0], ends[n, 1], ends[n, 2], ends[n, 3] = x[0, n], y[0, n], x[0, n], y[0, n]
        for m in range(1, len(x)):
            ends[n, 0], ends[n, 1] = min(x[m, n], ends[n, 0]), min(y[m, n], ends[n, 1])
            ends[n, 2], ends[n, 3] = max(x[m, n], ends[n, 2]), max(y[m, n], ends[n, 3])
    return ends


@kernel
def _put(image, pixel, numbers):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    down, across = numbers.shape[1] // 2, numbers.shape[2] // 2
    for k in range(len(pixel)):
        y, x = pixel[k] // columns, pixel[k] % columns
        for v in range(max(y - down, 0), min(y + down + 1, rows)):
            for u in range(max(x - across, 0), min(x + across + 1, columns)):
                image[v, u] = numbers[k, v - y + down, u - x + across]
