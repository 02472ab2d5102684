"""Case and catalogue -> shift of each star caused by the light of its neighbours."""

import math
from typing import NamedTuple

import numpy as np

from startrack.catalog import Selection, open_sky
from startrack.core import Floats, Ints, kept
from startrack.design import Case
from startrack.observation import (
    colour_correction,
    detection_plan,
    index_resolution,
    near_pairs,
    separated,
    with_images_of,
)
from startrack.response.star_inputs import unmapped_inputs
from startrack.response.star_response import RING, cell_side, measure, phases, scale, star_images

CONTRAST = np.arange(-2.0, 6.0)  # magnitude of the neighbour minus magnitude of the star
STEP = 0.5  # pixel, between two distances; beyond EVEN, each step is longer by GROWTH
EVEN, GROWTH = 4.0, 1.125
PIXELS = 2**21  # number of pixels that are measured at once
MERGED = 1.5  # pixel beyond the window's half side, within which two stars are one spot
TILT = math.radians(30)  # angle between the columns and the line from the star to its neighbour
# Angles between a streak, which is not round, and the line to the neighbour, with weights. They are
# denser along the streak, where a neighbour shifts a star most: angle = t^2 pi / 2, in the middles
# of halves of t. Other angles are mirror images.
TILTS = math.pi / 32, 9 * math.pi / 32
WEIGHTS = 0.25, 0.75
LOST = 1e4  # pixel, shift of a star that is not detected beside its neighbour
SNR = 100.0  # of the brightest pixel of the star in the chart
WIDER = math.log(2)  # step of ln(reach): cases with reaches in one step share the pairs
FAINTER = 1.0  # magnitude beyond the tracker's catalogue from which on stars have no shift


@kept(8, reads=unmapped_inputs)
def blending_shift(case: Case, catalog: Selection) -> Floats:
    """Shift of each separable star of a catalogue by the light of its neighbours.

    The shift is along the line to the neighbour. It depends on distance and contrast, and is
    measured on a chart of pairs; shifts by several neighbours are added. If two stars are in one
    window, the brighter star has the spot, and the other star is LOST. Stars that the tracker's
    index merges count as one star, with the spot at the centre of their light.

    catalog  the true catalogue, or the catalogue of the tracker
    Returns  (n, 3) pixel, ICRS axes, in the order of `separated`; zero for stars that are
             FAINTER than the tracker's catalogue
    Accuracy  model: pairs at one angle to the columns represent all; smear and scale are those of
              the boresight. numerical: streaks are measured at two angles only. This changes the
              error of an attitude by 0.1 % for streaks below 6 pixels, and by 1 % at 13 pixels.
    """
    camera = case.instrument.camera
    resolution = index_resolution(camera)
    stars = separated(catalog, resolution).sky.stars
    # The angle is rounded up, so that cameras of similar focal lengths share the pairs.
    angle = math.exp(math.ceil(math.log(_reach(case) / camera.focal_length_px) / WIDER) * WIDER)
    near = _pairs(catalog, resolution, angle, case.believed_catalog.limit_g + FAINTER).within(
        _reach(case) / camera.focal_length_px
    )
    distance = near.angle * camera.focal_length_px
    magnitude, other = near.magnitude + colour_correction(case, near.colour)
    contrast = other - magnitude
    shift = _shift(with_images_of(case), distance, contrast)
    shift[(distance < _merged(case)) & (contrast < 0)] = LOST
    relative = shift / np.maximum(near.angle, 1e-12)
    total = np.empty((len(stars), 3))
    for axis, apart in enumerate(near.apart):
        total[:, axis] = np.bincount(near.star, relative * apart, len(stars))
    return total


def _shift(case: Case, distance: Floats, contrast: Floats) -> Floats:
    """Shift (k,) towards neighbours that are near enough, pixel."""
    table, node = _table(case), _distances(case)
    j = np.clip(np.searchsorted(node, distance, side="right") - 1, 0, len(node) - 2)
    t = np.minimum((distance - node[j]) / (node[j + 1] - node[j]), 1.0)
    step = CONTRAST[1] - CONTRAST[0]
    index = np.clip((contrast - CONTRAST[0]) / step, 0, len(CONTRAST) - 1.001)
    i = index.astype(int)
    s = index - i
    shift = (1 - s) * ((1 - t) * table[i, j] + t * table[i, j + 1])
    shift += s * ((1 - t) * table[i + 1, j] + t * table[i + 1, j + 1])
    # The shift by a fainter neighbour is proportional to its light.
    shift *= 10 ** (-0.4 * np.maximum(contrast - CONTRAST[-1], 0))
    return shift


@kept(8)
def _table(case: Case) -> Floats:
    """Shift by contrast and distance, pixel; LOST if the star is lost at any position."""
    x, y = detection_plan(case).settings.smear
    if not (x or y):
        return _at_angle(case, TILT)
    squares = [_at_angle(case, math.atan2(y, x) + tilt) ** 2 for tilt in TILTS]
    return np.sqrt(np.tensordot(WEIGHTS, squares, 1))


def _at_angle(case: Case, tilt: float) -> Floats:
    """`_table` for neighbours at one angle to the columns."""
    instrument, detection = case.instrument, case.tracker.detection
    distance = _distances(case)
    side = cell_side(instrument, detection) + 2 * math.ceil(distance[-1])
    place = phases()[::4]  # nine positions on a diagonal pattern
    star, size = star_images(instrument, place, side), scale(case)
    light = SNR * size.pixel / float(star.max())
    line = np.array([math.cos(tilt), math.sin(tilt)])
    alone, _ = measure(case, light * star, both_signs=False)
    pull = np.full((len(distance), len(CONTRAST), len(place)), LOST)
    # A star with a brighter neighbour in its window is lost in any case.
    counts = (np.append(distance[1:], math.inf) > _merged(case))[:, None] | (CONTRAST >= 0)
    many = max(1, PIXELS // star.size)
    for part in np.split(np.argwhere(counts), range(many, int(counts.sum()), many)):
        j, k = part.T
        other = {n: star_images(instrument, place + distance[n] * line, side) for n in set(j)}
        ratio = 10 ** (-0.4 * CONTRAST[k][:, None, None, None])
        both = light * (star + ratio * np.stack([other[n] for n in j]))
        seen, _ = measure(case, both.reshape(-1, side, side), both_signs=False)
        moved = (seen.reshape(len(part), len(place), 2) - alone) @ line
        pull[j, k] = np.where(np.isfinite(moved), moved, LOST)
    return pull.mean(axis=2).T


def _distances(case: Case) -> Floats:
    """Pixel, the distances of `_table`."""
    node = list(np.arange(0, EVEN + STEP, STEP))
    while node[-1] < _reach(case):
        node.append(node[-1] + max(STEP, (GROWTH - 1) * node[-1]))
    return np.array(node)


def _merged(case: Case) -> float:
    """Pixel, distance within which two stars form one spot."""
    return case.tracker.detection.window // 2 + MERGED


def _reach(case: Case) -> float:
    """Pixel, distance beyond which a neighbour has no effect."""
    smear = math.hypot(*detection_plan(case).settings.smear)
    return case.tracker.detection.window // 2 + RING + 2.0 + smear


class _Pairs(NamedTuple):
    """Pairs of close stars, each pair in both orders; the closest pair first.

    star       (k,) indices of separable stars
    magnitude, colour  (2, k) G and BP - RP, of these stars and of their neighbours
    angle      (k,) radian, distance
    apart      (3, k) vector from the star to its neighbour, ICRS axes
    """

    star: Ints
    magnitude: Floats
    colour: Floats
    angle: Floats
    apart: Floats

    def within(self, angle: float) -> "_Pairs":
        """The pairs whose distance is below an angle (radian)."""
        many = int(np.searchsorted(self.angle, angle))
        return _Pairs(
            self.star[:many],
            self.magnitude[:, :many],
            self.colour[:, :many],
            self.angle[:many],
            self.apart[:, :many],
        )


@kept(32)
def _pairs(catalog: Selection, resolution: float, radius: float, faintest: float) -> _Pairs:
    """All pairs of separable stars within a radius (radian), of stars to a magnitude.

    A merged star counts if its brightest star is not fainter than this magnitude.
    """
    several = separated(catalog, resolution)
    stars, place = several.sky.stars, several.places(len(open_sky(catalog)))
    # Merged stars are not farther from their common centre than the resolution.
    within = radius + 2 * 2.0 ** math.ceil(math.log2(resolution))
    both = place[near_pairs(catalog, within, faintest)]
    both = both[:, (both >= 0).all(axis=0)]
    apart = stars.direction[both[1]] - stars.direction[both[0]]
    angle = np.linalg.norm(apart, axis=1)
    near = np.argsort(angle, kind="stable")
    near = near[: np.searchsorted(angle[near], 2 * math.sin(radius / 2))]
    both, angle, along = both[:, near], angle[near], np.ascontiguousarray(apart[near].T)
    return _Pairs(both[0], stars.magnitude_g[both], stars.colour[both], angle, along)
