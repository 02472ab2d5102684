"""Frame -> its spots at several scales, the motion of the stars, and their shape."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack.core import Flags, Frame, Spots
from startrack.detection import Detection, detect, plan_detection, refined, streak_of
from startrack.observation import with_smear

# Sigma of the detection: an image of few faint stars is searched twice.
THRESHOLDS = (5.0, 4.0)
SCALES = (1, 2, 4, 8)  # reductions of the image, so that stars of any size fit a window
LEAST_SIDE = 100  # pixel of a reduced image; a smaller one shows too few stars
MOST_OF_A_SCALE = 400  # spots, brightest first
PARTS = 4  # of an image, along each side
LARGEST = 1500  # pixel of the longer side of an image in whose streaks a motion is looked for
LEAST_STREAK = 4.0  # pixel of that image; shorter ones are stars elongated by the lens
# Ratio of a coarse spot's flux to the flux of the finer spots that it covers; above it, they have
# lost light. Chosen by hand: below, a star of the width that the windows are made for would be
# replaced.
GROWTH, SURE = 1.4, 2.0  # 1, and sigma of the coarse flux
COVERED = 2.5  # pixel of the reduced image: half the side of the window that measures a spot
FLOOR = 0.05  # pixel of the reduced image, error of a centroid beyond its noise
# Least number of pixels with the highest value for saturation, and the fraction of that value.
FEW_CLIPPED, CLIPPED = 4, 0.98
MOST_SHAPES, LEAST_SHAPES, THINNEST = 60, 4, 0.99  # stars whose shape is measured
# What a refusal names, chosen by hand: area that is saturated, range of the background over its
# level, number of spots, length over width of stars, and degrees from rows or columns.
MUCH_CLIPPED, UNEVEN, FEW, DRAWN_OUT, ALONG = 0.001, 0.5, 10, 1.4, 10.0


class ScaledSpots:
    """The spots of a frame, by threshold and scales, each found once.

    smear  pixel of the frame, that each star moved
    """

    def __init__(self, frame: Frame, smear: tuple[float, float] = (0.0, 0.0)) -> None:
        self.frame, self.smear = frame, smear
        self._reduced = {1: frame}
        self._spots: dict[tuple[float, int], Spots] = {}

    def __call__(self, threshold: float, scales: tuple[int, ...]) -> Spots:
        """The spots of these scales, in pixels of the frame, brightest first.

        A star is measured at the finest scale whose window holds its light: if a coarser spot has
        far more light than the finer spots that it covers, it replaces them.
        """
        least = min(self.frame.image.shape)
        used = [s for s in scales if least // s >= LEAST_SIDE] or [1]
        kept = self._at(threshold, used[0])
        for scale in used[1:]:
            kept = _grown(kept, self._at(threshold, scale), COVERED * scale)
        return chosen(kept, np.argsort(-kept.flux, kind="stable"))

    @cached_property
    def turned(self) -> tuple[float, float] | None:
        """Pixel of the frame that each star moved, where its streaks show it."""
        scale = 1
        while max(self.frame.image.shape) > LARGEST * scale:
            scale *= 2
        settings = Detection(saturation=self.clipped)
        frame, plan = self._frame(scale), plan_detection(settings, None)
        streak = streak_of(frame, plan)
        if not streak.seen or math.hypot(streak.x, streak.y) < LEAST_STREAK:
            return None
        spots = detect(frame, replace(settings, smear_x=streak.x, smear_y=streak.y))
        streak = refined(frame, plan, spots, streak)
        return scale * streak.x, scale * streak.y

    @cached_property
    def clipped(self) -> float | None:
        """Digital number from which pixels are saturated; None without saturation."""
        image = self.frame.image
        highest = float(np.nanmax(image))
        at_top = np.count_nonzero(image == highest)
        return CLIPPED * highest if highest > 0 and at_top >= FEW_CLIPPED else None

    def _at(self, threshold: float, scale: int) -> Spots:
        if (threshold, scale) not in self._spots:
            settings = Detection(
                threshold=threshold, saturation=self.clipped, max_spots=MOST_OF_A_SCALE
            )
            settings = with_smear(settings, *(part / scale for part in self.smear))
            self._spots[threshold, scale] = _enlarged(detect(self._frame(scale), settings), scale)
        return self._spots[threshold, scale]

    def _frame(self, scale: int) -> Frame:
        """The frame with the mean of each square of N x N pixels."""
        if scale not in self._reduced:
            finer = self._frame(scale // 2)
            rows, columns = (side // 2 for side in finer.image.shape)
            image = np.asarray(finer.image[: 2 * rows, : 2 * columns], np.float32)
            self._reduced[scale] = Frame(
                cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA),
                finer.exposure,
                4 * finer.electrons_per_dn,
                finer.offset,
                2 * finer.read_noise,
            )
        return self._reduced[scale]


def chosen(spots: Spots, which: slice | NDArray[np.integer] | Flags) -> Spots:
    """Some of the spots."""
    return Spots(*(values[which] for values in vars(spots).values()))


def evenly_spread(spots: Spots, columns: int, rows: int) -> Spots:
    """The spots in a new order: first the brightest of each part of the image, then the second
    brightest.

    So parts full of leaves or lamps do not have more of the first spots than other parts.
    """
    across, down = (spots.x + 0.5) / columns, (spots.y + 0.5) / rows
    part = np.floor(PARTS * across) * PARTS + np.floor(PARTS * down)
    rank = np.array([np.count_nonzero(part[:k] == here) for k, here in enumerate(part)], np.int64)
    return chosen(spots, np.argsort(rank, kind="stable"))


def _enlarged(spots: Spots, scale: int) -> Spots:
    """Spots of a reduced frame in pixels of the frame, with the error of centroids by its
    pixels."""
    if scale == 1:
        return spots
    floor = (FLOOR * scale) ** 2 * np.eye(2)
    return Spots(
        (spots.x + 0.5) * scale - 0.5,
        (spots.y + 0.5) * scale - 0.5,
        spots.flux * scale**2,
        spots.covariance * scale**2 + floor,
        spots.snr,
        spots.area * scale**2,
    )


def _grown(fine: Spots, coarse: Spots, half_side: float) -> Spots:
    """Fine spots, and coarse ones in the place of those that have lost their light.

    half_side  pixel, half the side of the square that a coarse spot is measured in
    """
    off_x, off_y = (
        np.abs(np.subtract.outer(values, others))
        for values, others in ((coarse.x, fine.x), (coarse.y, fine.y))
    )
    covered = np.maximum(off_x, off_y) <= half_side
    light = coarse.flux * (1 - SURE / np.maximum(coarse.snr, SURE))
    taken = np.asarray(light > GROWTH * (covered @ np.maximum(fine.flux, 0.0)))
    kept = np.asarray(~covered[taken].any(axis=0))
    fine, coarse = chosen(fine, kept), chosen(coarse, taken)
    pairs = zip(vars(fine).values(), vars(coarse).values(), strict=True)
    return Spots(*(np.concatenate(pair) for pair in pairs))


class StarShape(NamedTuple):
    """Shape of the typical star.

    length      1, over its width
    angle       degree, of its length from the rows, clockwise
    elongation  1, its length along the rows over that along the columns
    """

    length: float = 1.0
    angle: float = 0.0
    elongation: float = 1.0


def star_shape(image: NDArray[np.number], spots: Spots) -> StarShape:
    """The typical shape from the second moments of the light above a fifth of the peak."""
    rows, columns = image.shape
    tensors = []
    for x, y, area in zip(spots.x, spots.y, spots.area, strict=True):
        half = int(np.clip(1.5 * math.sqrt(area), 5, 40))
        left, top = round(x) - half, round(y) - half
        if min(left, top) < 0 or left + 2 * half >= columns or top + 2 * half >= rows:
            continue
        window = np.asarray(image[top : top + 2 * half + 1, left : left + 2 * half + 1], float)
        light = window - np.median(window)
        light[light < 0.2 * light.max()] = 0.0
        if light.sum() > 0:
            v, u = np.indices(light.shape)
            weight = light / light.sum()
            du, dv = u - (weight * u).sum(), v - (weight * v).sum()
            tensors.append([(weight * both).sum() for both in (du * du, du * dv, dv * dv)])
        if len(tensors) == MOST_SHAPES:
            break
    if len(tensors) < LEAST_SHAPES:
        return StarShape()
    # A pixel spreads light; so no star is thinner than that.
    xx, xy, yy = np.median(tensors, axis=0) + np.array([1, 0, 1]) / 12
    middle = (xx + yy) / 2
    # Medians of single moments belong to no real star, and may be thinner than a line.
    apart = min(math.hypot((xx - yy) / 2, xy), THINNEST * middle)
    angle = math.degrees(0.5 * math.atan2(2 * xy, xx - yy)) % 180
    return StarShape(math.sqrt((middle + apart) / (middle - apart)), angle, math.sqrt(xx / yy))


def seen_text(frame: Frame, scaled: ScaledSpots) -> str:
    """Possible reasons why an image is not solved, in words, beginning with "The image ..."."""
    image, spots = frame.image, scaled(THRESHOLDS[0], SCALES)
    seen = []
    if scaled.clipped is not None:
        share = np.count_nonzero(image >= scaled.clipped) / image.size
        if share > MUCH_CLIPPED:
            seen.append(f"is saturated over {100 * share:.2g} % of its area")
    grid = cv2.resize(np.asarray(image, np.float32), (16, 16), interpolation=cv2.INTER_AREA)
    low, high = np.nanpercentile(grid, (5, 95))
    if high - low > UNEVEN * max(float(np.nanmedian(grid)), 1.0):
        seen.append(f"has a background from {low:.3g} to {high:.3g}")
    if len(spots) < FEW:
        seen.append(f"has {len(spots)} spots, where a solution needs some ten stars")
    shape = star_shape(image, spots)
    if shape.length > DRAWN_OUT:
        off = abs((shape.angle + 45) % 90 - 45)
        why = "oblong pixels, which --aspect takes, or motion" if off < ALONG else "motion"
        seen.append(
            f"has stars {shape.length:.1f} times as long as wide, at {shape.angle:.0f} deg ({why})"
        )
    return f"The image {'; it '.join(seen)}" if seen else "The image shows no reason"
