"""StarModel: image of a star that the tracker assumes, and values that centroids compute from
it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft

from startrack.core import Floats, Ints, Psf, PsfTable, bilinear, finite, kernel
from startrack.detection.gravity import FLUX, FLUX_SIGMA, WINDOW_X, WINDOW_Y, XX, XY, YY, X, Y

TAPS = 6
# Row k holds the polynomial that is 1 at tap k of -2 ... 3 and 0 at the others, lowest power first.
LAGRANGE = np.ascontiguousarray(
    np.linalg.inv(np.vander(np.arange(-2.0, TAPS - 2), increasing=True)).T
)
OVERSAMPLING = 8
REACH = 6.0  # sigma
FRACTION = 0.996  # of the light along one axis that a window must hold to lose no accuracy
LARGEST = 15  # pixel, half side of a window


def gaussian_psf(sigma: float) -> Psf:
    """A Gaussian star of `sigma` pixel, integrated over pixels; for trackers without a PSF."""
    samples = OVERSAMPLING * max(1, math.ceil(0.5 / sigma))
    half = math.ceil((REACH * sigma + 1) * samples) + TAPS
    place = np.arange(-half, half + 1) / samples
    scale = sigma * math.sqrt(2)
    line = np.array([math.erf((p + 0.5) / scale) - math.erf((p - 0.5) / scale) for p in place]) / 2
    return Psf(np.outer(line, line), samples, 1.0)


@kernel
def expected(table: PsfTable, x: float, y: float, left: int, top: int, star: Floats) -> None:
    """Write the fraction of a star's light in the pixels of a window, and its slopes.

    Six-point Lagrange interpolation along x, then along y. A pixel is one stride of the table, so
    that all pixels of a star share their weights, and the samples of a row of pixels are
    neighbours.

    x, y       pixel, of the star
    left, top  pixel, first column and row of the window
    star       (3, rows, columns) 1, slope by x, slope by y, written here; 0 beyond the table
    Accuracy   numerical: 1e-6 of the peak for a PSF with four samples a sigma.
    """
    step, samples = table.oversampling, table.samples
    _, rows, columns = star.shape
    at_x, at_y = samples // 2 + (left - x) * step, samples // 2 + (top - y) * step
    base_x, base_y = math.floor(at_x), math.floor(at_y)
    wx, sx = np.empty(TAPS), np.empty(TAPS)
    wy, sy = np.empty(TAPS), np.empty(TAPS)
    _weights(at_x - base_x, wx, sx)
    _weights(at_y - base_y, wy, sy)
    star[:] = 0
    # The columns with all taps in the table: 0 <= base_x + i step - 2 <= samples - TAPS.
    first = max(0, -((base_x - 2) // step))
    end = min(columns, (samples - TAPS + 2 - base_x) // step + 1)
    count = end - first
    if count <= 0:
        return
    flat, width = table.strides.reshape(-1), table.strides.shape[2]
    value, slope, at = np.empty(count), np.empty(count), np.empty(TAPS, np.uint64)
    for j in range(rows):
        for b in range(TAPS):
            row = base_y + j * step + b - 2
            if row < 0 or row >= samples:
                continue
            for a in range(TAPS):
                column = base_x + first * step + a - 2
                start = row // step * table.across + column // step
                at[a] = (row % step * step + column % step) * width + start
            _weigh(flat, at, wx, value)
            _weigh(flat, at, sx, slope)
            for i in range(count):
                star[0, j, first + i] += wy[b] * value[i]
                star[1, j, first + i] -= wy[b] * slope[i] * step
                star[2, j, first + i] -= sy[b] * value[i] * step


@kernel
def _weigh(flat: Floats, at: Ints, weight: Floats, total: Floats) -> None:
    """Weighted sum of six rows of numbers; one sum in each loop, so that it is vectorised."""
    a0, a1, a2, a3, a4, a5 = at[0], at[1], at[2], at[3], at[4], at[5]
    w0, w1, w2 = weight[0], weight[1], weight[2]
    w3, w4, w5 = weight[3], weight[4], weight[5]
    for i in range(np.uint64(len(total))):
        near = w0 * flat[a0 + i] + w1 * flat[a1 + i] + w2 * flat[a2 + i]
        total[i] = near + w3 * flat[a3 + i] + w4 * flat[a4 + i] + w5 * flat[a5 + i]


@kernel
def _weights(t: float, value: Floats, slope: Floats) -> None:
    """Lagrange's weights at t in [0, 1), and their slopes, by Horner's scheme."""
    for k in range(TAPS):
        v, s = 0.0, 0.0
        for power in range(TAPS - 1, -1, -1):
            s = s * t + v
            v = v * t + LAGRANGE[k, power]
        value[k], slope[k] = v, s


STEPS = 32  # per pixel; linear interpolation then has an error of 1e-4 of the bias
SIDE = 2 * STEPS + 1  # from -1 to 1 pixel
ROUNDS = 20
FLATTEST = 0.1  # slope of centre of gravity over place, below which it is not used


@kernel
def _s_curve(table: PsfTable, half: int) -> Floats:
    """Centre of gravity x, y (pixel) and light in a window, (3, SIDE, SIDE) by place."""
    curve = np.empty((3, SIDE, SIDE))
    star = np.empty((3, 2 * half + 1, 2 * half + 1))
    for j in range(SIDE):
        for i in range(SIDE):
            x, y = i / STEPS - 1, j / STEPS - 1
            expected(table, x, y, -half, -half, star)
            light, gx, gy = 0.0, 0.0, 0.0
            for v in range(2 * half + 1):
                for u in range(2 * half + 1):
                    light += star[0, v, u]
                    gx += star[0, v, u] * (u - half)
                    gy += star[0, v, u] * (v - half)
            curve[0, j, i], curve[1, j, i], curve[2, j, i] = gx / light, gy / light, light
    return curve


@kernel
def compensate(table: Floats, curve: Floats) -> None:
    """Correct plain centres of gravity by the S-curve, and fluxes by the cut light, in place.

    Newton's method, with one slope for each axis, finds the place that gives the measured centre.
    Noise grows by the inverse of the slopes. A centre that no star can give is not changed.

    table  (n, COLUMNS) as `gravity` gives it
    curve  as `StarModel.s_curve`
    """
    step = 1 / STEPS
    for n in range(len(table)):
        if np.isnan(table[n, FLUX]):
            continue
        gx, gy = table[n, X] - table[n, WINDOW_X], table[n, Y] - table[n, WINDOW_Y]
        x, y = gx, gy
        slope_x, slope_y = 1.0, 1.0
        for _ in range(ROUNDS):
            here_x, here_y = _at(curve[0], x, y), _at(curve[1], x, y)
            slope_x = (_at(curve[0], x + step, y) - _at(curve[0], x - step, y)) / (2 * step)
            slope_y = (_at(curve[1], x, y + step) - _at(curve[1], x, y - step)) / (2 * step)
            slope_x, slope_y = max(slope_x, FLATTEST), max(slope_y, FLATTEST)
            x += (gx - here_x) / slope_x
            y += (gy - here_y) / slope_y
        if not (abs(x) < 1 - step and abs(y) < 1 - step):
            continue
        fraction = _at(curve[2], x, y)
        table[n, X], table[n, Y] = table[n, WINDOW_X] + x, table[n, WINDOW_Y] + y
        table[n, FLUX] /= fraction
        table[n, FLUX_SIGMA] /= fraction
        table[n, XX] /= slope_x * slope_x
        table[n, XY] /= slope_x * slope_y
        table[n, YY] /= slope_y * slope_y


@kernel
def _at(grid: Floats, x: float, y: float) -> float:
    """Bilinear interpolation; beyond the grid the values of its edge."""
    u = min(max((x + 1) * STEPS, 0.0), SIDE - 1.001)
    v = min(max((y + 1) * STEPS, 0.0), SIDE - 1.001)
    return bilinear(grid, v, u)


MARGIN = 2  # pixel, so that no light wraps around


@dataclass(frozen=True, eq=False)
class StarModel:
    """The image of a star of one plan; derived values are computed at first use.

    psf   with the smear of the star in the frames
    half  pixel, half side of the window of the centre of gravity
    """

    psf: Psf
    half: int

    @cached_property
    def fit_window(self) -> tuple[int, int]:
        """Half sides (columns, rows) of the window that a fit of the PSF needs, pixel."""
        middle = self.psf.table.shape[0] // 2
        halves = []
        for axis in (0, 1):
            line = np.cumsum(self.psf.table.sum(axis=axis)) / self.psf.table.sum()
            outside = (1 - FRACTION) / 2
            first, last = np.searchsorted(line, [outside, 1 - outside])
            widest = max(middle - first, last - middle) / self.psf.oversampling
            # Half a pixel for the star's place within its pixel, and one pixel for the background.
            halves.append(min(math.ceil(widest + 0.5), LARGEST))
        return halves[0], halves[1]

    @cached_property
    def s_curve(self) -> Floats:
        """Centre of gravity, without noise, of a window of 2 half + 1 pixels.

        Source: Alexander and Ng (1991). The S-curve is the error of the centre of gravity over the
        place of the star within its pixel; it is named after its shape.

        Returns  (3, 65, 65) along x and along y, pixel, and the fraction of the light within the
                 window; by the star's place [row, column] from -1 to 1 pixel from its centre
        """
        return _s_curve(self.psf.arranged, self.half)


def smeared(psf: Psf, x: float, y: float) -> Psf:
    """Smear a PSF along a line whose middle is the middle of the motion.

        P(f) -> P(f) sinc(f . l),   l = (x, y)

    With a smeared PSF, a tracker that knows its rate finds streaks by a matched filter and measures
    them by maximum likelihood.

    Source: transform of the uniform law on a segment.

    x, y      pixel, motion of the star's image in the exposure
    Raises    ValueError if the motion is not finite.
    Accuracy  numerical: 1e-6 of the peak if the table contains the whole star.
    """
    finite(x=x, y=y)
    if x == 0 and y == 0:
        return psf
    more = math.ceil((max(abs(x), abs(y)) / 2 + MARGIN) * psf.oversampling) + TAPS
    wide = np.pad(psf.table, more)
    side = fft.next_fast_len(wide.shape[0], real=True)
    frequency_x = fft.rfftfreq(side) * psf.oversampling
    frequency_y = fft.fftfreq(side)[:, None] * psf.oversampling
    drawn = fft.rfft2(wide, s=(side, side)) * np.sinc(frequency_x * x + frequency_y * y)
    table = fft.irfft2(drawn, s=(side, side))[: wide.shape[0], : wide.shape[1]]
    return Psf(np.ascontiguousarray(table), psf.oversampling, psf.energy)
