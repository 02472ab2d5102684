"""Case and fields -> how far stars that stand near others are moved by their light."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from startrack.budget.chart import RING, cell, images, measure, phases, scale
from startrack.budget.fields import WIDER, Fields
from startrack.case import Case
from startrack.catalog import Sky
from startrack.values import Floats, Ints

CONTRAST = np.arange(-2.0, 6.0)  # magnitude, of the neighbour less that of the star
STEP = 0.5  # pixel
MERGED = 1.5  # pixel beyond the window's half side, within which two stars are one spot
TILT = math.radians(30)  # of the line from the star to its neighbour against the columns
LOST = 1e4  # pixel, the pull of a neighbour beside which a star is not found
SNR = 100.0  # of the brightest pixel of the star in the chart


class Pairs(NamedTuple):
    """Stars that are near each other: the neighbours of star i are other[first[i] : first[i + 1]].

    first  (n + 1,)
    other  (k,) index into the catalogue
    """

    first: Ints
    other: Ints


def displaced(case: Case, view: Fields, inside: Ints, magnitude: Floats, fainter: Floats) -> Floats:
    """Pixel (n, 2) by which the light of its neighbours moves each star of the fields.

    A shift along the line to the neighbour, by its distance and contrast, measured on a chart of
    pairs; those of several neighbours are added. Of two stars in one window the brighter has the
    spot, and the other is LOST. Stars that the tracker takes for one are one here: their spot is
    where their light is.

    inside     (n,) which stars of the fields
    magnitude  (n,) G of the sunlike star that is as bright
    fainter    (stars,) magnitude that the colour of a star adds to its G
    Errors     model: pairs at one angle to the columns stand for all, and the smear is that of
               the boresight.
    """
    camera, stars = case.instrument.camera, view.sky.stars
    reach = _reach(case) / camera.focal_length_px
    step = math.log(WIDER)
    pairs = _pairs(view.sky, math.exp(math.ceil(math.log(reach) / step) * step))
    star = view.star[inside]
    count = pairs.first[star + 1] - pairs.first[star]
    one = np.repeat(np.arange(len(inside)), count)
    start = np.repeat(pairs.first[star] - np.cumsum(count) + count, count)
    other = pairs.other[start + np.arange(len(one))]
    seen = (
        view.attitude[view.field[inside[one]]].apply(stars.direction[other])
        if len(one)
        else np.ones((0, 3))
    )
    apart = seen[:, :2] / seen[:, 2:] - np.column_stack([view.x, view.y])[inside[one]]
    distance = np.hypot(*apart.T)
    contrast = stars.magnitude_g[other] + fainter[other] - magnitude[one]
    pull = _pull(case, distance * camera.focal_length_px, contrast)
    merged = distance * camera.focal_length_px < case.tracker.detection.window // 2 + MERGED
    pull[merged & (contrast < 0)] = LOST
    shift = np.zeros((len(inside), 2))
    np.add.at(shift, one, pull[:, None] * apart / np.maximum(distance, 1e-12)[:, None])
    return shift


def _pull(case: Case, distance: Floats, contrast: Floats) -> Floats:
    """Pixel towards the neighbour (k,), zero where it is too far or too faint."""
    table = _table(case)
    u = np.clip(distance / STEP, 0, table.shape[1] - 1.001)
    v = np.clip((contrast - CONTRAST[0]) / (CONTRAST[1] - CONTRAST[0]), 0, len(CONTRAST) - 1.001)
    i, j = v.astype(int), u.astype(int)
    s, t = v - i, u - j
    pull = (1 - s) * ((1 - t) * table[i, j] + t * table[i, j + 1])
    pull += s * ((1 - t) * table[i + 1, j] + t * table[i + 1, j + 1])
    # A fainter neighbour pulls by its share of the light.
    pull *= 10 ** (-0.4 * np.maximum(contrast - CONTRAST[-1], 0))
    return np.where(distance < _reach(case), pull, 0.0)


@lru_cache(maxsize=8)
def _table(case: Case) -> Floats:
    """Pull by contrast and distance, pixel; large where the star is lost at any of its places."""
    instrument, detection = case.instrument, case.tracker.detection
    reach = _reach(case)
    distance = np.arange(0, reach + STEP, STEP)
    side = cell(instrument, detection) + 2 * math.ceil(reach)
    place = phases()[::4]  # a diagonal pattern of nine
    star, size = images(instrument, place, side), scale(case)
    light = SNR * size.pixel / float(star.max())
    line = np.array([math.cos(TILT), math.sin(TILT)])
    other = np.stack([images(instrument, place + far * line, side) for far in distance])
    ratio = 10 ** (-0.4 * CONTRAST[:, None, None, None, None])
    shape = len(CONTRAST), len(distance), len(place)
    both = light * (star + ratio * other)
    seen, _ = measure(case, both.reshape(-1, side, side))
    alone, _ = measure(case, light * star)
    pull = (seen.reshape(*shape, 2) - alone) @ line
    return np.where(np.isfinite(pull), pull, LOST).mean(axis=2)


def _reach(case: Case) -> float:
    """Pixel, from where on a neighbour does not matter."""
    return case.tracker.detection.window // 2 + RING + 2.0


@lru_cache(maxsize=8)
def _pairs(sky: Sky, radius: float) -> Pairs:
    """All pairs of stars within an angle, radian."""
    direction = sky.stars.direction
    pair = cKDTree(direction).query_pairs(2 * math.sin(radius / 2), output_type="ndarray")
    both = np.concatenate([pair, pair[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    first = np.searchsorted(both[:, 0], np.arange(len(direction) + 1))
    return Pairs(first, both[:, 1].copy())
