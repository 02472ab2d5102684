"""Filter and thresholds -> pixels where noise alone exceeds them, and the digital numbers there.

Noise rarely exceeds a high level in the filtered frame. Therefore the numbers under the filter are
drawn from a tilted law, with which it often does: the law of each pixel times exp(theta weight
number). These proposals are accepted with a probability that restores the true law:

    rate of proposals   exp(K(theta) - theta level)
    accepted with       exp(-theta (filtered - level)),   filtered > level

K is the logarithm of the expectation of exp(theta filtered). Accepted proposals have exactly the
rate of crossings. Their numbers have the law of the numbers given that the filtered pixel exceeds
the level.

Source: Siegmund (1976), Importance sampling in the Monte Carlo study of sequential tests, Annals
of Statistics 4, 673, for the tilted law; here with rejection in place of weights.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from startrack.core import Flags, Floats, Ints, Singles, Streams, bits, kernel, uniform
from startrack.detector.collect import background
from startrack.detector.law import BITS, build, law_of, level_spacing, lowest_mean
from startrack.detector.parameters import Detector

LEAST_CUMULANT = -1e9  # K for tiles without pixels
OUTSIDE = -1
BISECTIONS = 30  # steps of the search for theta
CUMULANT_ERROR = 1e-6  # error of K, by its interpolation over levels and by its rank
COUNTED = 64  # sums: up to this number, counting is faster than bisection; by hand


class NumberDistributions(NamedTuple):
    """The laws of the numbers of a frame without stars.

    probability  (levels, n) of the numbers lowest, lowest + 1, ...
    place        (rows, columns) level of each pixel, between two of them; NaN for one that takes
                 the mean of its neighbours instead of its own number
    lowest       digital number
    """

    probability: Floats
    place: Singles
    lowest: int


def number_distributions(
    detector: Detector, sky: float, outliers: Ints, replaced: Ints | None = None
) -> NumberDistributions | None:
    """The laws of a uniform background, with outlier pixels replaced by the median pixel.

    outliers  (k,) row * columns + column of these pixels
    replaced  (k,) of the pixels that take the mean of their neighbours; None: none
    Returns   None if the noise spans too many numbers (4096) for a table
    """
    law, mean = law_of(detector), background(detector, sky).copy()
    mean.ravel()[outliers] = np.median(mean)
    if replaced is not None:
        mean.ravel()[replaced] = np.median(mean)
    lowest = lowest_mean(float(mean.min()), float(np.median(mean)), law.noise)
    spacing = level_spacing(lowest, law.noise)
    place = mean / spacing
    first, last = math.floor(place.min()), math.ceil(place.max())
    tables = build(law, first, last - first + 1, spacing)
    if not tables.levels:
        return None
    fraction = np.diff(tables.limit.astype(float), axis=1, prepend=0.0) / 2.0**BITS
    place -= first
    if replaced is not None:
        place.ravel()[replaced] = np.nan
    return NumberDistributions(fraction, place.astype(np.float32), tables.lowest)


class TiltedLaw(NamedTuple):
    """The tilted law of a frame, a filter and a typical level.

    theta     1 / digital number
    most      (tiles,) the largest K of a pixel in each tile, row by row
    among     (tiles, mesh^2) cumulative sums of exp(K - most) over the pixels of a tile, row by
              row; their rounding moves one of some thousand crossings by a pixel
    weight    (2 m + 1, 2 n + 1) of the filter
    kind      (2 m + 1, 2 n + 1) index of each weight among the different weights
    sums      (kinds, levels, n) of the tilted law, of the numbers up to the lowest, lowest + 1, ...
    complete  (rows, columns) whether the filter is neither mirrored at the border nor covers a
              replaced pixel, as for most pixels
    shift     (rows, columns) digital number that a correction subtracts from the filtered frame;
              one element if there is no correction
    """

    theta: float
    most: Floats
    among: Singles
    weight: Floats
    kind: Ints
    sums: Floats
    complete: Flags
    shift: Singles


NO_SHIFT = np.zeros((1, 1), np.float32)


def tilted_law(
    numbers: NumberDistributions,
    weight: Floats,
    level: float,
    mesh: int,
    border: int,
    shift: Singles = NO_SHIFT,
) -> TiltedLaw:
    """The theta whose mean is the level, and K of each pixel with its neighbours.

    weight  weights of the filter, which is mirrored at the frame's border; with a border of zeros
            if pixels are replaced, so that their neighbours lie under it
    level   digital number in the filtered frame
    mesh    pixel, side of a tile
    border  pixel; no crossing is drawn nearer to the frame's border
    shift   as in TiltedLaw
    """
    middle = float(np.nanmedian(numbers.place))
    theta = _theta(numbers, weight, level - numbers.lowest * weight.sum(), middle)
    weights, kind = np.unique(weight, return_inverse=True)
    kind = kind.reshape(weight.shape)
    tilted = np.exp(theta * np.outer(weights, np.arange(numbers.probability.shape[1])))
    sums = np.cumsum(numbers.probability * tilted[:, None], axis=2)
    complete = _whole(numbers.place, weight)
    tiles = _cumulants(numbers, theta, weight, kind, sums[:, :, -1], complete, shift, mesh, border)
    most = np.maximum(tiles.max(axis=1), LEAST_CUMULANT)
    tiles -= most[:, None]
    np.cumsum(np.exp(tiles, out=tiles), axis=1, out=tiles)
    return TiltedLaw(
        theta=theta,
        most=most,
        among=tiles.astype(np.float32),
        weight=weight,
        kind=kind,
        sums=sums,
        complete=complete,
        shift=shift,
    )


def _whole(place: Singles, weight: Floats) -> Flags:
    rows, columns = place.shape
    down, across = weight.shape[0] // 2, weight.shape[1] // 2
    complete = np.zeros(place.shape, bool)
    complete[down : max(rows - down, 0), across : max(columns - across, 0)] = True
    for y, x in np.argwhere(np.isnan(place)):
        complete[max(y - down, 0) : y + down + 1, max(x - across, 0) : x + across + 1] = False
    return complete


class ProposalRates(NamedTuple):
    """Expected number of proposals in each tile, (tiles,) row by row.

    level  digital number to exceed, minus the filtered number if all numbers are the lowest
    fraction  1, of all proposals, cumulated over the tiles
    total  proposals in a frame
    """

    level: Floats
    fraction: Floats
    total: float


def proposal_rates(numbers: NumberDistributions, tilt: TiltedLaw, level: Floats) -> ProposalRates:
    """Rates of proposals for the levels of tiles.

    level  (down, across) digital number, of each tile
    """
    shift = level.ravel() - numbers.lowest * tilt.weight.sum()
    rate = np.exp(tilt.most - tilt.theta * shift) * tilt.among[:, -1]
    total = float(rate.sum())
    return ProposalRates(shift, np.cumsum(rate) / total, total)


def threshold_crossings(
    numbers: NumberDistributions,
    tilt: TiltedLaw,
    rates: ProposalRates,
    mesh: int,
    border: int,
    regions: Ints,
    streams: Streams,
) -> tuple[Ints, Ints]:
    """Draw where the noise of a frame exceeds the levels of its tiles.

    regions  (w, 4) left, top, right, bottom, the last two exclusive: regions without crossings
    Returns  (k,) row * columns + column of the crossings, and (k, 2 m + 1, 2 n + 1) the digital
             numbers around them
    Accuracy  model: crossings are independent, which is exact if they are a filter's width apart.
              Crossings that overlap have the frequency of independent ones.
    """
    count = int(streams("false spots").poisson(rates.total))
    start = streams.key("numbers of false spots")
    pixel, drawn = np.empty(count, np.int64), np.empty((count, *tilt.weight.shape), np.int64)
    kept = _propose(pixel, drawn, start, rates, mesh, border, regions, tilt, *numbers[:2])
    return pixel[:kept], drawn[:kept] + numbers.lowest


def _theta(numbers: NumberDistributions, weight: Floats, level: float, middle: float) -> float:
    """Theta with K'(theta) = level, so that about half of the proposals exceed the level."""
    low, high = 0.0, 1.0
    law = numbers.probability

    def typical(theta: float) -> float:
        step = 1e-4 * max(theta, 1e-3)
        ends = (_cumulant(law, middle, (theta + s * step) * weight) for s in (1, -1))
        return float(np.subtract(*ends)) / (2 * step)

    most = weight.sum() * (law.shape[1] - 1)
    level = min(level, 0.99 * most)
    while typical(high) < level and high < 1e6:
        high *= 2
    for _ in range(BISECTIONS):
        middle_theta = (low + high) / 2
        low, high = (middle_theta, high) if typical(middle_theta) < level else (low, middle_theta)
    return (low + high) / 2


@kernel
def _moment(probability, place, tilt):  # type: ignore[no-untyped-def]
    """Expectation of exp(tilt number) at a level between two."""
    k = min(int(place), len(probability) - 1)
    above = min(k + 1, len(probability) - 1)
    t = place - k
    total, factor, growth = 0.0, 1.0, math.exp(tilt)
    for d in range(probability.shape[1]):
        total += ((1 - t) * probability[k, d] + t * probability[above, d]) * factor
        factor *= growth
    return total


@kernel
def _cumulant(probability, place, tilts):  # type: ignore[no-untyped-def]
    """K of a filter whose pixels all have one level."""
    total = 0.0
    for tilt in tilts.ravel():
        total += math.log(_moment(probability, place, tilt))
    return total


@kernel
def _folded_weights(weight: Floats, x: int, y: int, place: Singles) -> Floats:
    """The filter weights around a pixel, moved to the pixels that provide the numbers.

    Weights beyond the border are added to the mirrored pixels, and the weight of a replaced pixel
    to its neighbours. If all neighbours are replaced too, which is rare, the weight is left out.
    """
    rows, columns = place.shape
    down, across = weight.shape[0] // 2, weight.shape[1] // 2
    folded = np.zeros_like(weight)
    for j in range(weight.shape[0]):
        v = y + j - down
        v = -1 - v if v < 0 else (2 * rows - 1 - v if v >= rows else v)
        for i in range(weight.shape[1]):
            u = x + i - across
            u = -1 - u if u < 0 else (2 * columns - 1 - u if u >= columns else u)
            folded[v - y + down, u - x + across] += weight[j, i]
    for j in range(1, weight.shape[0] - 1):
        for i in range(1, weight.shape[1] - 1):
            if folded[j, i] != 0.0 and np.isnan(place[y + j - down, x + i - across]):
                _give_to_neighbours(folded, j, i, y - down, x - across, place)
    return folded


@kernel
def _give_to_neighbours(
    folded: Floats, j: int, i: int, top: int, left: int, place: Singles
) -> None:
    """Spread the weight of a replaced pixel evenly over its neighbours that are not replaced.

    top, left  row and column of the first weight
    """
    rows, columns = place.shape
    upper, lower = max(top + j - 1, 0), min(top + j + 2, rows)
    first, last = max(left + i - 1, 0), min(left + i + 2, columns)
    count = 0
    for v in range(upper, lower):
        for u in range(first, last):
            count += not np.isnan(place[v, u])
    for v in range(upper, lower):
        for u in range(first, last):
            if not np.isnan(place[v, u]):
                folded[v - top, u - left] += folded[j, i] / count
    folded[j, i] = 0.0


def _cumulants(
    numbers: NumberDistributions,
    theta: float,
    weight: Floats,
    kind: Ints,
    moment: Floats,
    complete: Flags,
    shift: Singles,
    mesh: int,
    border: int,
) -> Floats:
    """K of each pixel, (tiles, mesh^2); minus infinity where no crossing is drawn.

    moment    (kinds, levels) expectation of exp(theta weight number)
    Accuracy  numerical: 1e-5; 1e-6 each from the interpolation over levels and from the rank of
              the sum, the rest from single precision.
    """
    probability, place = numbers.probability, numbers.place
    total = _complete_cumulants(place, kind, np.log(moment))
    rows, columns = place.shape
    down, across = -(-rows // mesh), -(-columns // mesh)
    tiles = np.full((down * across, mesh * mesh), -np.inf)
    _arrange(tiles, total, probability, place, theta, weight, complete, shift, mesh, border)
    return tiles


def _complete_cumulants(place: Singles, kind: Ints, log_moment: Floats) -> Singles:
    """K of each pixel (rows, columns) as if all filters were complete.

    The logarithm of the moment is a function of weight and level. By singular values it becomes a
    short sum of products of a function of the weight and a function of the level, so that K is a
    sum of filtered images.
    """
    size, levels = kind.size, log_moment.shape[1]
    largest = float(np.abs(np.diff(log_moment, axis=1)).max(initial=0.0))
    steps = math.ceil(largest * math.sqrt(size / (8 * CUMULANT_ERROR))) + 1
    node = np.arange((levels - 1) * steps + 1) / steps
    k = np.minimum(node.astype(int), max(levels - 2, 0))
    above, t = np.minimum(k + 1, levels - 1), node - k
    usual = log_moment[:, levels // 2]
    ratio = np.exp(log_moment - usual[:, None])
    departure = np.log((1 - t) * ratio[:, k] + t * ratio[:, above])
    of_weight, singular, of_level = np.linalg.svd(departure, full_matrices=False)
    total = np.full(place.shape, usual[kind].sum(), np.float32)
    image = np.empty(place.shape, np.float32)
    for r in range(len(singular)):
        parts = of_weight[:, r:] * singular[r:] @ of_level[r:]
        if size * np.abs(parts).max() < CUMULANT_ERROR:
            break
        _interpolate(image, place, singular[r] * of_level[r], steps)
        factor = of_weight[:, r][kind]
        total += cv2.filter2D(image, -1, factor, borderType=cv2.BORDER_REFLECT)
    return total


@kernel
def _interpolate(image: Singles, place: Singles, value: Floats, steps: int) -> None:
    """Write the value at the level of each pixel; 0 at replaced pixels."""
    last = max(len(value) - 2, 0)
    for y in range(place.shape[0]):
        for x in range(place.shape[1]):
            if np.isnan(place[y, x]):
                image[y, x] = 0.0
                continue
            at = place[y, x] * steps
            k = min(int(at), last)
            image[y, x] = value[k] + (at - k) * (value[min(k + 1, len(value) - 1)] - value[k])


@kernel
def _arrange(
    tiles: Floats,
    total: Singles,
    probability: Floats,
    place: Singles,
    theta: float,
    weight: Floats,
    complete: Flags,
    shift: Singles,
    mesh: int,
    border: int,
) -> None:
    """Write K into tiles; pixels without a complete filter are computed one by one."""
    rows, columns = place.shape
    across = -(-columns // mesh)
    for y in range(border, rows - border):
        for x in range(border, columns - border):
            cumulant = float(total[y, x])
            if not complete[y, x]:
                folded = _folded_weights(weight, x, y, place)
                cumulant = _folded_cumulant(probability, place, x, y, theta * folded)
            tile, at = (y // mesh) * across + x // mesh, (y % mesh) * mesh + x % mesh
            tiles[tile, at] = cumulant - theta * _shift(shift, x, y)


@kernel
def _folded_cumulant(probability, place, x, y, tilts):  # type: ignore[no-untyped-def]
    """K of a pixel near the border of the frame, or near a replaced pixel."""
    rows, columns = place.shape
    total = 0.0
    for j in range(tilts.shape[0]):
        for i in range(tilts.shape[1]):
            v, u = y + j - tilts.shape[0] // 2, x + i - tilts.shape[1] // 2
            if 0 <= v < rows and 0 <= u < columns and not np.isnan(place[v, u]):
                total += math.log(_moment(probability, place[v, u], tilts[j, i]))
    return total


@kernel
def _propose(
    pixel: Ints,
    drawn: Ints,
    start: np.uint64,
    rates: ProposalRates,
    mesh: int,
    border: int,
    regions: Ints,
    tilt: TiltedLaw,
    probability: Floats,
    place: Singles,
) -> int:
    """Write the accepted proposals; returns their number."""
    size = np.uint64(3 + tilt.weight.size)
    tiles, x, y = _places(len(pixel), start, size, rates, mesh, border, tilt)
    levels = _levels_about(x, y, tilt, place)
    kept = 0
    for n in range(len(pixel)):
        u, v, at = x[n], y[n], np.uint64(n) * size
        if u == OUTSIDE or _in_region(u, v, regions):
            continue
        first = at + np.uint64(3)
        if tilt.complete[v, u]:
            filtered = _draw_by_sums(drawn[kept], start, first, levels[n], tilt)
        else:
            folded = _folded_weights(tilt.weight, u, v, place)
            filtered = _draw(
                drawn[kept], start, first, u, v, tilt.theta, folded, probability, place
            )
        over = filtered - rates.level[tiles[n]] - _shift(tilt.shift, u, v)
        chance = uniform(bits(start, at + np.uint64(2)))
        if over > 0 and chance < math.exp(-tilt.theta * over):
            pixel[kept] = v * place.shape[1] + u
            kept += 1
    return kept


@kernel
def _places(
    count: int,
    start: np.uint64,
    size: np.uint64,
    rates: ProposalRates,
    mesh: int,
    border: int,
    tilt: TiltedLaw,
) -> tuple[Ints, Ints, Ints]:
    """Tiles, x and y (n,) of proposals.

    Each step is done for all proposals, so that the processor waits for memory only once.

    size  number of random numbers of a proposal
    """
    rows, columns = tilt.complete.shape
    across = -(-columns // mesh)
    tiles = np.empty(count, np.int64)
    x, y = np.empty((2, count), np.int64)
    for n in range(count):
        tile = np.searchsorted(rates.fraction, uniform(bits(start, np.uint64(n) * size)), "right")
        tiles[n] = min(tile, len(rates.fraction) - 1)
    for n in range(count):
        fraction = uniform(bits(start, np.uint64(n) * size + np.uint64(1)))
        inside = _index_of_sum(tilt.among[tiles[n]], fraction)
        x[n] = (tiles[n] % across) * mesh + inside % mesh
        y[n] = (tiles[n] // across) * mesh + inside // mesh
        if not (border <= x[n] < columns - border and border <= y[n] < rows - border):
            x[n] = y[n] = OUTSIDE  # by rounding
    return tiles, x, y


@kernel
def _levels_about(x: Ints, y: Ints, tilt: TiltedLaw, place: Singles) -> Singles:
    """Levels (n, 2 m + 1, 2 n + 1) around the pixels whose filter is not folded."""
    levels = np.empty((len(x), *tilt.weight.shape), np.float32)
    down, aside = tilt.weight.shape[0] // 2, tilt.weight.shape[1] // 2
    for n in range(len(x)):
        if x[n] != OUTSIDE and tilt.complete[y[n], x[n]]:
            top, left = y[n] - down, x[n] - aside
            for j in range(levels.shape[1]):
                for i in range(levels.shape[2]):
                    levels[n, j, i] = place[top + j, left + i]
    return levels


@kernel(inline="always")
def _index_of_sum(sums, fraction):  # type: ignore[no-untyped-def]
    """Index of the first sum that exceeds a fraction of the last sum; the sums rise nearly evenly.

    Bisection would read distant memory in each step.
    """
    last, wanted = len(sums) - 1, sums[-1] * fraction
    k = min(int(fraction * len(sums)), last)
    while k > 0 and sums[k - 1] > wanted:
        k -= 1
    while k < last and sums[k] <= wanted:
        k += 1
    return k


@kernel(inline="always")
def _in_region(x, y, regions):  # type: ignore[no-untyped-def]
    for k in range(len(regions)):
        if regions[k, 0] <= x < regions[k, 2] and regions[k, 1] <= y < regions[k, 3]:
            return True
    return False


@kernel(inline="always")
def _shift(shift, x, y):  # type: ignore[no-untyped-def]
    return shift[y, x] if shift.size > 1 else shift[0, 0]


@kernel
def _draw_by_sums(
    numbers: Ints, start: np.uint64, at: np.uint64, levels: Singles, tilt: TiltedLaw
) -> float:
    """Like `_draw`, with precomputed sums, for weights that are not folded.

    levels  (2 m + 1, 2 n + 1) of the pixels
    """
    height, width = tilt.weight.shape
    filtered = 0.0
    for j in range(height):
        for i in range(width):
            level = levels[j, i]
            kind, k = tilt.kind[j, i], min(int(level), tilt.sums.shape[1] - 1)
            t, above = level - k, min(k + 1, tilt.sums.shape[1] - 1)
            low, high = tilt.sums[kind, k], tilt.sums[kind, above]
            fraction = uniform(bits(start, at + np.uint64(j * width + i)))
            wanted = fraction * ((1 - t) * low[-1] + t * high[-1])
            first, most = 0, len(low) - 1
            while most - first > COUNTED:
                middle = (first + most) // 2
                above = (1 - t) * low[middle] + t * high[middle] > wanted
                first, most = (first, middle) if above else (middle + 1, most)
            # Slices, or the compiler would check for negative indices; no branches, which would be
            # mispredicted half of the time.
            low, high, number = low[first:most], high[first:most], first
            for d in range(len(low)):
                number += (1 - t) * low[d] + t * high[d] <= wanted
            filtered += tilt.weight[j, i] * number
            numbers[j, i] = number
    return filtered


@kernel
def _draw(
    numbers: Ints,
    start: np.uint64,
    at: np.uint64,
    x: int,
    y: int,
    theta: float,
    folded: Floats,
    probability: Floats,
    place: Singles,
) -> float:
    """Write numbers of the tilted law around a pixel; returns the filtered number."""
    rows, columns = place.shape
    down, across = folded.shape[0] // 2, folded.shape[1] // 2
    filtered = 0.0
    for j in range(folded.shape[0]):
        v = y + j - down
        for i in range(folded.shape[1]):
            u = x + i - across
            if not (0 <= v < rows and 0 <= u < columns):
                numbers[j, i] = -1
                continue
            tilt = theta * folded[j, i]
            if np.isnan(place[v, u]):
                numbers[j, i] = 0
                continue
            moment = _moment(probability, place[v, u], tilt)
            wanted = uniform(bits(start, at + np.uint64(j * folded.shape[1] + i))) * moment
            number = _number_at(probability, place[v, u], tilt, wanted)
            filtered += folded[j, i] * number
            numbers[j, i] = number
    return filtered


@kernel
def _number_at(probability: Floats, place: float, tilt: float, wanted: float) -> int:
    """The number at which the sum of `_moment` exceeds a value."""
    k = min(int(place), len(probability) - 1)
    above = min(k + 1, len(probability) - 1)
    t = place - k
    total, factor, growth = 0.0, 1.0, math.exp(tilt)
    last = probability.shape[1] - 1
    for d in range(last):
        total += ((1 - t) * probability[k, d] + t * probability[above, d]) * factor
        if total > wanted:
            return d
        factor *= growth
    return last
