"""Peaks -> peaks that are significant like stars, and peaks that are hot pixels."""

import math

import numpy as np
from numpy.typing import NDArray

from startrack.core import Flags, Floats, Ints, Singles, Streams, kernel
from startrack.detection.background import SkyBackground, between
from startrack.detection.matched import highest_between
from startrack.detection.robust import around, around_among

# The ring's pixels are correlated: they give its noise within 15 %, and its mean within a third of
# the noise. A ring that differs by less may do so by chance; then the tile is more accurate.
UNEVEN = 1.5
HIGHER = 1.0  # sigma, by hand: less would raise the level by chance, more would pass halos
PATTERNS = 400  # patterns of noise: a probability of 0.9 has an error of 0.015
SURE = 0.5  # sigma, by hand: more would pass hot columns without finding more faint stars


@kernel
def stands_out(
    image: Singles,
    filtered: Singles,
    filters: Floats,
    x: Ints,
    y: Ints,
    ring_half: int,
    sigmas: Singles,
    sky: SkyBackground,
    floor: float,
) -> Flags:
    """Whether peaks exceed the level of their tile, and of the ring around them if it is uneven.

    The edge of a tree, of the limb or of a bright star's halo exceeds the tile's level, but its
    ring is as uneven as the edge is high. The ring excludes other peaks, which may be the other
    star of a pair.

    filters    of stars between the pixels, (rows, columns, k)
    sigmas     how far a peak must stand out, on the grid of the Sky
    floor      digital number, least noise
    """
    good = np.empty(len(x), np.bool_)
    for i in range(len(x)):
        level, noise, far = _of_tile(x[i], y[i], sigmas, sky)
        good[i] = _stands_out(image, filtered, filters, x[i], y[i], level, far * noise)
        if good[i]:
            others = _others(x[i], y[i], ring_half, x, y)
            level, noise = _of_ring(filtered, x[i], y[i], ring_half, floor, others, level, noise)
            good[i] = _stands_out(image, filtered, filters, x[i], y[i], level, far * noise)
    return good


@kernel
def levels_to_pass(
    filtered: Singles,
    x: Ints,
    y: Ints,
    ring_half: int,
    sigmas: Singles,
    sky: SkyBackground,
    floor: float,
    peaks: Ints,
) -> Floats:
    """Digital number (n,) that a star at some places needs to pass `stands_out`.

    peaks  (2, k) x and y of the peaks of the frame, which rings exclude; else as `stands_out`
    """
    levels = np.empty(len(x))
    for i in range(len(x)):
        level, noise, far = _of_tile(x[i], y[i], sigmas, sky)
        others = _others(x[i], y[i], ring_half, peaks[0], peaks[1])
        level, noise = _of_ring(filtered, x[i], y[i], ring_half, floor, others, level, noise)
        levels[i] = level + far * noise
    return levels


@kernel
def _of_tile(x: int, y: int, sigmas: Singles, sky: SkyBackground) -> tuple[float, float, float]:
    """Level, noise, and the number of sigma by which a peak must exceed the level."""
    # At the edge of trees, their own tile describes them better than the neighbouring tiles.
    mesh = sky.mesh
    v, u = y // mesh + 1, x // mesh + 1
    level = between(sky.mean, mesh, x, y)
    noise = max(between(sky.rms, mesh, x, y), sky.rms[v, u])
    return level, noise, max(between(sigmas, mesh, x, y), sigmas[v, u])


@kernel
def _others(x: int, y: int, ring_half: int, peaks_x: Ints, peaks_y: Ints) -> Ints:
    """Other peaks (2, k) whose squares may touch the ring around a peak."""
    far_off = 2 * ring_half + 4
    near = (np.abs(peaks_x - x) <= far_off) & (np.abs(peaks_y - y) <= far_off)
    near &= (peaks_x != x) | (peaks_y != y)
    return np.stack((peaks_x[near], peaks_y[near]))


@kernel
def _of_ring(
    filtered: Singles,
    x: int,
    y: int,
    ring_half: int,
    floor: float,
    others: Ints,
    level: float,
    noise: float,
) -> tuple[float, float]:
    """Level and noise of the tile, or of the ring if it is brighter or less even."""
    ring, _, _, spread, _ = around_among(filtered, x, y, ring_half, floor, others[0], others[1])
    level = ring if ring > level + HIGHER * noise else level
    return level, spread if spread > UNEVEN * noise else noise


@kernel
def _stands_out(
    image: Singles, filtered: Singles, filters: Floats, x: int, y: int, level: float, height: float
) -> bool:
    """Bright stars pass on the pixel; only faint ones are also examined between the pixels."""
    if filtered[y, x] - level > height:
        return True
    return bool(highest_between(image, x, y, level, filters) > height)


@kernel
def is_hot(image: Singles, x: int, y: int, ring_half: int, fraction: float) -> bool:
    """Whether a peak is sharper than the sharpest star: a hot pixel, row or column.

    The four neighbours of a hot pixel hold less light than the sharpest star would have there. For
    a hot row or column, this holds for its other pixels, within their noise. The image itself is
    tested, because the filter has rounded the peak.

    fraction  1, largest fraction of the sharpest star's light in one row of pixels
    """
    level, _, _, noise, _ = around(image, x, y, ring_half, 0.0)
    core = image[y - 1 : y + 2, x - 1 : x + 2].astype(np.float64) - level
    return bool(_is_sharp(core, noise, fraction))


@kernel
def _is_sharp(core, noise, fraction):  # type: ignore[no-untyped-def]
    """Whether a peak, (3, 3) above the level, is too sharp for a star."""
    sides = core[0, 1] + core[1, 0] + core[1, 2] + core[2, 1]
    if sides < 2 * (1 - fraction) / fraction * core[1, 1]:
        return True
    light, most = 0.0, -np.inf
    for k in range(3):
        row = core[k, 0] + core[k, 1] + core[k, 2]
        most = max(most, row, core[0, k] + core[1, k] + core[2, k])
        light += row
    return most - fraction * light > SURE * _line_sigma(fraction) * noise


@kernel
def _passed(core, spread, patterns, noise, fraction):  # type: ignore[no-untyped-def]
    """Number of noise patterns (k, 3, 3) with which each peak (3, 3, n) is not a hot pixel."""
    count, noisy = np.zeros(core.shape[2]), np.empty((3, 3))
    for n in range(len(count)):
        for k in range(len(patterns)):
            for j in range(3):
                for i in range(3):
                    noisy[j, i] = core[j, i, n] + spread[j, i, n] * patterns[k, j, i]
            count[n] += not _is_sharp(noisy, noise, fraction)
    return count


def chance_to_pass(
    image: Singles, x: Ints, y: Ints, level: float, noise: float, shot: float, fraction: float
) -> Floats:
    """Probability that `is_hot` does not take peaks for hot pixels, rows or columns, (n,) 1.

    Noise may make the middle pixel brighter, and its sides fainter, than the star alone.

    image  expected digital numbers; level expected digital number without a star
    noise  digital number, of an empty pixel;  shot  variance for each digital number of light
    fraction  as `is_hot` takes it
    Accuracy  model: normal noise, independent of the other tests. numerical: counted on 400
              patterns of noise, the same for all peaks: 0.015 at a probability of 0.9.
    """
    patterns = Streams(0, 0)("noise of a core").standard_normal((PATTERNS, 3, 3))
    step = np.arange(-1, 2)
    core = image[y + step[:, None, None], x + step[:, None]].astype(float) - level
    spread = np.sqrt(noise * noise + shot * np.maximum(core, 0.0))
    largest = float(np.sqrt((patterns**2).sum(axis=(1, 2)).max()))
    chance, unsure = _without_doubt(core, spread, largest, noise, fraction)
    core, spread = (np.ascontiguousarray(values[..., unsure]) for values in (core, spread))
    chance[unsure] = _passed(core, spread, patterns, noise, fraction) / len(patterns)
    return chance


def _without_doubt(
    core: Floats, spread: Floats, largest: float, noise: float, fraction: float
) -> tuple[Floats, Flags]:
    """Peaks (3, 3, n), above the level, for which `_is_sharp` does not depend on the noise.

    It compares weighted sums of pixels with zero. Noise of some length changes such a sum by at
    most this length times the length of weights times spread (Cauchy and Schwarz).

    spread   (3, 3, n) of each pixel
    largest  length of the largest pattern (3, 3) of noise, in units of the spread
    Returns  probability (n,), 1 or 0, that they are not sharp; which of them (n,) are undecided
    """
    weights = np.full((7, 3, 3), -fraction)
    for k in range(3):
        weights[k, k] += 1
        weights[3 + k, :, k] += 1
    weights[6] = 0.0
    weights[6, [0, 1, 1, 2], [1, 0, 2, 1]] = -1.0
    weights[6, 1, 1] = 2 * (1 - fraction) / fraction
    above = np.tensordot(weights, core, 2)
    above[:6] -= SURE * _line_sigma(fraction) * noise
    room = largest * np.sqrt(np.tensordot(weights**2, spread**2, 2)) * (1 + 1e-9)
    never, always = (above + room < 0).all(axis=0), (above - room > 0).any(axis=0)
    return np.asarray(never, float), np.asarray(~(never | always))


@kernel
def _line_sigma(fraction: float) -> float:
    """Sigma of `most - fraction * sum`: three pixels count 1 - fraction, six -fraction."""
    return math.sqrt(3 * (1 - fraction) ** 2 + 6 * fraction**2)


@kernel
def has_dead_pixel(dead: NDArray[np.uint8], x: int, y: int, half: int) -> bool:
    """Whether a peak has a dead pixel in a square of some half side around it."""
    left, top = max(x - half, 0), max(y - half, 0)
    return bool(dead[top : y + half + 1, left : x + half + 1].any())


def largest_fraction(sigma: float) -> float:
    """Largest fraction of a Gaussian star's light in one row of pixels."""
    return math.erf(0.5 / (sigma * math.sqrt(2)))
