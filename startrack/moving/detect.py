"""Images of a field -> the score of places and motions, and the place of an object."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from scipy import stats

from startrack.core import Floats, printed
from startrack.moving.camera import (
    PHASES,
    bilinear,
    camera_of,
    image_in_frames,
    object_image,
    sampled,
)
from startrack.moving.study import MovingDesign

STEP = PHASES[1] - PHASES[0]  # pixel, between places and between the ends of motions
FLICKER = 0.05  # of a star's light: variation from image to image; chosen by hand
STAR = 4.0  # standard deviations above the sky: brighter pixels contain a star
NEAR = 2  # steps of place within which a detection is the trial's object
TURNS = 1  # steps of motion, likewise
ITERATIONS = 6  # of the fit of a place
FINEST = 1e-3  # pixel, of the derivatives of this fit


@printed
class Scores(NamedTuple):
    """Matched filters of each image at places half a pixel apart.

    signal   (images, 2 h, 2 w) sums of T d / variance
    weight   (images, 2 h, 2 w) sums of T^2 / variance
    clean    (images, h, w) electron, without stars and sky
    variance (images, h, w) electron^2
    """

    signal: Floats
    weight: Floats
    clean: Floats
    variance: Floats


def threshold_of(design: MovingDesign) -> float:
    """The score that noise exceeds with the allowed mean number of false alarms.

        P(score > threshold) = false alarms / (places motions)

    Places are half a pixel apart, and so are the ends of motions. Source: the number of hypotheses
    of digital tracking, Heinze, Metchev and Trollo (2015), AJ 150, 125, section 2.

    Accuracy  neighbours are not independent, so that false alarms are fewer.
    """
    own, detector = design.moving_object, design.instrument.detector
    places = detector.rows * detector.columns / STEP**2
    return float(stats.norm.isf(own.false_alarms / (places * motions_of(design))))


def motions_of(design: MovingDesign) -> float:
    """Number of the motions that are searched."""
    reach = design.moving_object.fastest / design.pixel * max(design.moving_object.times)
    return max(1.0, math.pi * (reach / STEP) ** 2)


def score_maps(design: MovingDesign, images: Floats, angle: float) -> Scores:
    """Matched filters of images after subtraction of the stars, by OpenCV.

    The mean of the other images, which has the stars, but the object at other places, is subtracted
    from each image. A pixel in which this mean has a star has a larger variance.

    images  (images, h, w) electron, registered
    angle   radian, of the motion: the direction of the trail
    """
    camera, own = camera_of(design), design.moving_object
    count = own.images
    clean = images - np.median(images, axis=(1, 2), keepdims=True)
    others = (clean.sum(0) - clean) / (count - 1)
    base = own.frames * camera.variance
    star = np.where(others > STAR * math.sqrt(base / (count - 1)), others, 0.0)
    spread = count / (count - 1)
    variance = spread * (base + camera.excess * star) + (FLICKER * star) ** 2
    fine, step = object_image(design, angle), camera.psf.oversampling
    rows, columns = images.shape[1:]
    signal = np.zeros((count, 2 * rows, 2 * columns))
    weight = np.zeros_like(signal)
    ratio, inverse = (clean - others) / variance, 1 / variance
    for i, y in enumerate(PHASES):
        for j, x in enumerate(PHASES):
            image = sampled(fine, step, x, y)
            for k in range(count):
                border = cv2.BORDER_CONSTANT
                signal[k, i::2, j::2] = cv2.filter2D(ratio[k], cv2.CV_64F, image, borderType=border)
                weight[k, i::2, j::2] = cv2.filter2D(
                    inverse[k], cv2.CV_64F, image**2, borderType=border
                )
    return Scores(signal, weight, clean - others, variance)


def stacked(scores: Scores, place: Floats, ends: Floats, times: Floats, rest: Floats) -> Floats:
    """The score (n,) of places and motions: sums along the motion.

        score = sum_k signal_k / sqrt(sum_k weight_k)

    place  (n, 2) pixel from the middle at the middle time, columns first
    ends   (n, 2) pixel, moved from the middle time to the last image
    times  (images,) of the images, in units of the last
    rest   (images, frames, 2) pixel, by which the field is shifted in each frame
    """
    rows, columns = scores.signal.shape[1:]
    total, weight = np.zeros(len(place)), np.zeros(len(place))
    for k, (time, shift) in enumerate(zip(times, rest.mean(1), strict=True)):
        at = np.rint((place + ends * time + shift) / STEP).astype(int)
        x = np.clip(at[:, 0] + 2 * (columns // 4), 0, columns - 1)
        y = np.clip(at[:, 1] + 2 * (rows // 4), 0, rows - 1)
        total += scores.signal[k, y, x]
        weight += scores.weight[k, y, x]
    return np.asarray(total / np.sqrt(np.maximum(weight, 1e-300)))


def find(
    design: MovingDesign, scores: Scores, place: Floats, speed: Floats, rest: Floats
) -> tuple[float, Floats]:
    """The largest score near a true place and motion; and its position (4,): place, end; pixel.

    rest  (images, frames, 2) pixel, by which the field is shifted in each frame
    """
    times = np.array(design.moving_object.times)
    ends = speed * times[-1]
    steps = [np.arange(-n, n + 1) * STEP for n in (NEAR, NEAR, TURNS, TURNS)]
    middle = np.rint(np.concatenate([place, ends]) / STEP) * STEP
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 4) + middle
    score = stacked(scores, grid[:, :2], grid[:, 2:], times / times[-1], rest)
    best = int(score.argmax())
    return float(score[best]), grid[best]


def refined(design: MovingDesign, scores: Scores, at: Floats, angle: float, rest: Floats) -> Floats:
    """Place (2,) of an object at the middle time, by least squares of flux, place and motion.

    Gauss-Newton on the pixels around it in all images; the model is the image of an object in
    frames at the places measured by guide stars. Source: Press et al. (2007), Numerical Recipes,
    15.5; for moving objects Reed, Gagliardi and Stotts (1983).

    at    (4,) place and end, pixel from the middle, where the fit begins
    rest  (images, frames, 2) pixel, by which the field is shifted in each frame
    """
    camera, times = camera_of(design), np.array(design.moving_object.times)
    step = camera.psf.oversampling
    fine = [image_in_frames(design, angle, frames) for frames in rest]
    clean, sigma = scores.clean, np.sqrt(scores.variance)
    rows, columns = clean.shape[1:]
    values, flux = at.copy(), 0.0

    def model(values: Floats) -> Floats:
        images = []
        for time, image in zip(times / times[-1], fine, strict=True):
            x, y = values[:2] + values[2:] * time
            row = (np.arange(rows) - rows // 2 - y) * step + len(image) // 2
            column = (np.arange(columns) - columns // 2 - x) * step + len(image) // 2
            images.append(bilinear(image, row, column))
        own = np.array(images)
        # The mean of the others, which was subtracted, has the object, too.
        return own - (own.sum(0) - own) / (len(own) - 1)

    small = 0.5 / step
    for _ in range(ITERATIONS):
        here = model(values) / sigma
        slopes = [
            (model(values + small * unit) - model(values - small * unit)) / (2 * small) / sigma
            for unit in np.eye(4)
        ]
        if not flux:
            flux = float((here * clean / sigma).sum() / (here**2).sum())
        design_matrix = np.stack([here, *(flux * slope for slope in slopes)], -1).reshape(-1, 5)
        residual = (clean / sigma - flux * here).ravel()
        change = np.linalg.lstsq(design_matrix, residual, rcond=None)[0]
        flux += change[0]
        values = values + np.clip(change[1:], -STEP, STEP)
        if np.abs(change[1:]).max() < FINEST:
            break
    # Where a star is in the way, the fit may leave the object.
    inside = np.abs(values[:2] - at[:2]).max() <= 2 * STEP
    return values[:2] if inside else at[:2]
