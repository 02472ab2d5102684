"""A filter, its levels -> where noise alone passes them, and the numbers of the pixels there.

A pixel of the filtered frame that passes a high level is too rare to wait for. So the numbers
under the filter are drawn from a law in which it is common, each pixel's own law times
exp(theta weight number), and what is drawn is kept with the probability that makes up for it:

    rate of proposals   exp(K(theta) - theta level)
    kept with           exp(-theta (filtered - level)),   filtered > level

where K is the logarithm of the expectation of exp(theta filtered). What is kept has exactly the
law of the numbers, given that the filtered pixel passes the level, and comes at exactly its rate.

Source: Siegmund (1976), Importance sampling in the Monte Carlo study of sequential tests, Annals
of Statistics 4, 673, for the tilted law; here with rejection in place of weights.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.detector.counter import bits, key, uniform
from startrack.detector.ground import ground
from startrack.detector.law import law_of
from startrack.detector.parameters import Detector
from startrack.detector.tables import BITS, build, levels_between
from startrack.streams import Streams

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 0.02  # in K, by which a tile's bound exceeds what its pixels were found to have
MOST_PROPOSALS = 0.05  # of the pixels; beyond, the whole frame is cheaper
STEPS = 30  # of the search for theta


class Numbers(NamedTuple):
    """The laws of the numbers of a frame without stars.

    probability  (levels, n) of the numbers lowest, lowest + 1, ...
    place        (rows, columns) level of each pixel, between two of them
    lowest       digital number
    """

    probability: Floats
    place: NDArray[np.float32]
    lowest: int


@lru_cache(maxsize=2)
def numbers_of(detector: Detector, sky: float, odd: bytes) -> Numbers:
    """The laws of an even sky, some odd pixels taken for middling ones.

    odd     numbers of these pixels, as bytes of int64
    Errors  ValueError where the noise spans too many numbers for a table.
    """
    law, mean = law_of(detector), ground(detector, sky).copy()
    mean.ravel()[np.frombuffer(odd, np.int64)] = np.median(mean)
    place = levels_between(mean, law.noise)
    first, last = math.floor(place.min()), math.ceil(place.max())
    tables = build(law, first, last - first + 1)
    if not tables.levels:
        raise ValueError(
            "windows need noise that spans fewer than 4096 digital numbers, and the detector has "
            "more; choose the fidelity frame or fewer bits"
        )
    share = np.diff(tables.limit.astype(float), axis=1, prepend=0.0) / 2.0**BITS
    return Numbers(share, (place - first).astype(np.float32), tables.lowest)


class Tilt(NamedTuple):
    """What the drawing of excesses needs of a frame, a filter and a typical level.

    theta   1 / digital number
    bound   (down, across) K of the pixels of each tile, at most
    weight  (2 m + 1, 2 n + 1) of the filter
    kind    (2 m + 1, 2 n + 1) which of the weights that differ each is
    sums    (kinds, levels, n) of the tilted law, of the numbers up to the lowest, lowest + 1, ...
    """

    theta: float
    bound: Floats
    weight: Floats
    kind: Ints
    sums: Floats


def tilt_for(numbers: Numbers, weight: Floats, level: float, mesh: int, border: int) -> Tilt:
    """The theta that makes the level typical, and the bounds of tiles.

    weight  of the filter, which is mirrored at the frame's border
    level   digital number, in the filtered frame
    mesh    pixel, side of a tile
    border  pixel; nearer to the frame's border no excess is asked for
    """
    shape = numbers.place.shape
    middle = float(np.median(numbers.place))
    theta = _theta(numbers, weight, level - numbers.lowest * weight.sum(), middle)
    count = len(numbers.probability)
    cumulant = np.array([_cumulant(numbers.probability, k, theta * weight) for k in range(count)])
    # K is nearly linear in each pixel's level, with the slopes that K has by each of them.
    slope = _slopes(numbers.probability, middle, theta * weight)
    mean = cv2.filter2D(
        numbers.place, cv2.CV_32F, slope / slope.sum(), borderType=cv2.BORDER_REFLECT
    )
    down, across = -(-shape[0] // mesh), -(-shape[1] // mesh)
    highest = np.full((down * mesh, across * mesh), -np.inf)
    highest[: shape[0], : shape[1]] = np.interp(mean, np.arange(count), cumulant)
    bound = highest.reshape(down, mesh, across, mesh).max(axis=(1, 3)) + SLACK
    # Where the filter is mirrored, some of its weights fall on one pixel.
    folded = _folded(weight, border, border, (10**6, 10**6))
    more = _cumulant(numbers.probability, middle, theta * folded)
    more -= _cumulant(numbers.probability, middle, theta * weight)
    for edge in (bound[0], bound[-1], bound[:, 0], bound[:, -1]):
        edge += max(more, 0.0)
    each, kind = np.unique(weight, return_inverse=True)
    tilted = np.exp(theta * np.outer(each, np.arange(numbers.probability.shape[1])))
    sums = np.cumsum(numbers.probability * tilted[:, None], axis=2)
    return Tilt(theta, bound, weight, kind.reshape(weight.shape), sums)


class Rates(NamedTuple):
    """How often the tilted law is to be tried in each tile, (tiles,) row by row.

    level  digital number to be passed, above that of numbers that are all the lowest
    share  1, of all tries, those of the tiles before among them
    total  tries in a frame
    """

    level: Floats
    share: Floats
    total: float


def rates_for(numbers: Numbers, tilt: Tilt, level: Floats, mesh: int) -> Rates:
    """What the levels of tiles ask for.

    level   (down, across) digital number, of each tile
    Errors  ValueError where the levels are so low that whole frames are cheaper.
    """
    shift = level - numbers.lowest * tilt.weight.sum()
    rate = np.exp(tilt.bound - tilt.theta * shift) * mesh**2
    total = float(rate.sum())
    if not total < max(MOST_PROPOSALS * numbers.place.size, 100.0):
        raise ValueError(
            "windows need a detection threshold that noise seldom passes, and here it is looked at "
            f"{total:.0f} times a frame; choose the fidelity frame"
        )
    return Rates(shift.ravel(), np.cumsum(rate) / total, total)


def excesses(
    numbers: Numbers,
    tilt: Tilt,
    rates: Rates,
    mesh: int,
    border: int,
    regions: Ints,
    streams: Streams,
) -> tuple[Ints, Ints]:
    """Draw where the noise of a frame passes the levels of its tiles.

    regions  (w, 4) left, top, right, bottom, the last two not in it: where none is asked for
    Returns  (k,) row * columns + column, and (k, 2 m + 1, 2 n + 1) the digital numbers about it
    Errors   model: excesses are strewn as if each knew nothing of the others, which they do where
             they lie a filter's width apart; two that overlap come as often as chance has it.
    """
    count = int(streams("false spots").poisson(rates.total))
    start = key(streams, "numbers of false spots")
    pixel, drawn = np.empty(count, np.int64), np.empty((count, *tilt.weight.shape), np.int64)
    kept = _propose(
        *(pixel, drawn, start, rates.share, rates.level, mesh, border, regions, tilt.theta),
        *(tilt.bound.ravel(), tilt.weight, tilt.kind, tilt.sums, *numbers[:2]),
    )
    return pixel[:kept], drawn[:kept] + numbers.lowest


def _theta(numbers: Numbers, weight: Floats, level: float, middle: float) -> float:
    """Where K'(theta) is the level: there, half of what is drawn passes it."""
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
    for _ in range(STEPS):
        middle_theta = (low + high) / 2
        low, high = (middle_theta, high) if typical(middle_theta) < level else (low, middle_theta)
    return (low + high) / 2


def _slopes(probability: Floats, place: float, tilts: Floats) -> Floats:
    """How K changes with the level of each pixel under the filter."""
    below, above = max(place - 1, 0.0), min(place + 1, len(probability) - 1.0)
    if below == above:
        return np.ones_like(tilts)
    one = np.array([_moment(probability, above, s) for s in tilts.ravel()])
    other = np.array([_moment(probability, below, s) for s in tilts.ravel()])
    return np.maximum(np.log(one / other), 1e-12).reshape(tilts.shape)


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _cumulant(probability, place, tilts):  # type: ignore[no-untyped-def]
    """K of a filter whose pixels are all of one level."""
    total = 0.0
    for tilt in tilts.ravel():
        total += math.log(_moment(probability, place, tilt))
    return total


@njit(cache=True, error_model="numpy")
def _folded(weight, x, y, shape):  # type: ignore[no-untyped-def]
    """The weights about a pixel, those beyond the border added to the pixels that mirror them."""
    rows, columns = shape
    down, across = weight.shape[0] // 2, weight.shape[1] // 2
    folded = np.zeros_like(weight)
    for j in range(weight.shape[0]):
        v = y + j - down
        v = -1 - v if v < 0 else (2 * rows - 1 - v if v >= rows else v)
        for i in range(weight.shape[1]):
            u = x + i - across
            u = -1 - u if u < 0 else (2 * columns - 1 - u if u >= columns else u)
            folded[v - y + down, u - x + across] += weight[j, i]
    return folded


@njit(cache=True, error_model="numpy")
def _propose(  # type: ignore[no-untyped-def]
    pixel, drawn, start, share, level, mesh, border, regions, theta, bound, weight,
    kind, sums, probability, place,
):  # fmt: skip
    """Write the proposals that are kept; returns how many."""
    rows, columns = place.shape
    across = -(-columns // mesh)
    size = np.uint64(4 + weight.size)
    kept = 0
    for n in range(len(pixel)):
        at = np.uint64(n) * size
        tile = min(np.searchsorted(share, uniform(bits(start, at)), side="right"), len(share) - 1)
        x = (tile % across) * mesh + int(uniform(bits(start, at + np.uint64(1))) * mesh)
        y = (tile // across) * mesh + int(uniform(bits(start, at + np.uint64(2))) * mesh)
        if not (border <= x < columns - border and border <= y < rows - border):
            continue
        if _held(x, y, regions):
            continue
        chance = uniform(bits(start, at + np.uint64(3)))
        first = at + np.uint64(4)
        if _inside(x, y, place, weight):
            cumulant, filtered = _look_up(
                drawn[kept], start, first, x, y, weight, kind, sums, place
            )
        else:
            folded = _folded(weight, x, y, place.shape)
            cumulant, filtered = _draw(
                drawn[kept], start, first, x, y, theta, folded, probability, place
            )
        over = filtered - level[tile]
        if over > 0 and chance < math.exp(cumulant - bound[tile] - theta * over):
            pixel[kept] = y * columns + x
            kept += 1
    return kept


@njit(cache=True, error_model="numpy", inline="always")
def _held(x, y, regions):  # type: ignore[no-untyped-def]
    for k in range(len(regions)):
        if regions[k, 0] <= x < regions[k, 2] and regions[k, 1] <= y < regions[k, 3]:
            return True
    return False


@njit(cache=True, error_model="numpy")
def _inside(x, y, place, weight):  # type: ignore[no-untyped-def]
    """Whether all that the filter sees about a pixel lies in the frame."""
    down, across = weight.shape[0] // 2, weight.shape[1] // 2
    return down <= y < place.shape[0] - down and across <= x < place.shape[1] - across


@njit(cache=True, error_model="numpy")
def _look_up(numbers, start, at, x, y, weight, kind, sums, place):  # type: ignore[no-untyped-def]
    """As `_draw`, by the sums that are known already where no weight is folded."""
    height, width = weight.shape
    moment, filtered = 1.0, 0.0
    for j in range(height):
        for i in range(width):
            level = place[y + j - height // 2, x + i - width // 2]
            k = min(int(level), sums.shape[1] - 1)
            t = level - k
            low, high = sums[kind[j, i], k], sums[kind[j, i], min(k + 1, sums.shape[1] - 1)]
            total = (1 - t) * low[-1] + t * high[-1]
            wanted = total * uniform(bits(start, at + np.uint64(j * width + i)))
            least, most = 0, len(low) - 1
            while least < most:
                middle = (least + most) // 2
                if (1 - t) * low[middle] + t * high[middle] > wanted:
                    most = middle
                else:
                    least = middle + 1
            moment *= total
            filtered += weight[j, i] * least
            numbers[j, i] = least
    return math.log(moment), filtered


@njit(cache=True, error_model="numpy")
def _draw(numbers, start, at, x, y, theta, folded, probability, place):  # type: ignore[no-untyped-def]
    """Write numbers of the tilted law about a pixel; returns K and the filtered number."""
    rows, columns = place.shape
    down, across = folded.shape[0] // 2, folded.shape[1] // 2
    cumulant = filtered = 0.0
    for j in range(folded.shape[0]):
        v = y + j - down
        for i in range(folded.shape[1]):
            u = x + i - across
            if not (0 <= v < rows and 0 <= u < columns):
                numbers[j, i] = -1
                continue
            tilt = theta * folded[j, i]
            moment = _moment(probability, place[v, u], tilt)
            wanted = uniform(bits(start, at + np.uint64(j * folded.shape[1] + i))) * moment
            number = _picked(probability, place[v, u], tilt, wanted)
            cumulant += math.log(moment)
            filtered += folded[j, i] * number
            numbers[j, i] = number
    return cumulant, filtered


@njit(cache=True, error_model="numpy")
def _picked(probability, place, tilt, wanted):  # type: ignore[no-untyped-def]
    """The number at which the sum behind `_moment` passes a value."""
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
