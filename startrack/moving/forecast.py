"""Design -> the faintest object that is found and the error of its place, by formula."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import optimize, special

from startrack.core import Floats, printed
from startrack.moving.camera import MovingCamera, camera_of, flux_of, object_image, sampled
from startrack.moving.detect import threshold_of
from startrack.moving.study import MovingDesign

ANGLES = (0.0, math.pi / 4)  # of the motion, over which the means are taken
MISSED = (-0.25, 0.0, 0.25)  # pixel, places of an object between those that are searched
FREE = 4  # place and motion, over which the score is the largest of all near an object
NOISE, NOISE_WEIGHT = np.polynomial.hermite_e.hermegauss(40)
MEDIAN = math.sqrt(2 * math.log(2))  # distance over the rms per axis, of a normal law
FAINTEST, BRIGHTEST = 1e-3, 1e9  # microjansky


@printed
class MovingForecast(NamedTuple):
    """Limiting magnitudes and errors of place that the formulas expect.

    limits     microjansky of the objects of which 50 % and 90 % are found; inf: of none
    place      radian, median distance from its place of an object of the magnitude that is asked
    snr        1, of this object in all images together
    threshold  1, of the score
    """

    limits: tuple[float, float]
    place: float
    snr: float
    threshold: float


def forecast_moving(design: MovingDesign) -> MovingForecast:
    """The faintest object that is found, and the error of its place.

        S = f E sqrt(K sum T^2 / v),   v = K / (K - 1) n (F^2 (b + d) + r^2 + q^2 / 12)
        found(f) = P[(S + sqrt(1 + c) z)^2 + chi^2_4 > t^2],   z normal

    of K images of n frames, with the image T of a moving object, the excess F^2, sky b, dark
    current d, read noise r and quantisation q of a frame, the light c of the object itself and
    the threshold t of `threshold_of`; chi^2_4, as the largest score over places and motions is
    taken. The sky and the stars are taken off by the mean of the other images: K / (K - 1).

        1 / sigma_x^2 = K sum (f dT/dx)^2 / (v + F^2 f T)

    is the bound of the place at the middle time, at which it does not depend on the motion; the
    median distance is sqrt(2 ln 2) times that.

    Source: signal to noise of 3-D matched filters, Reed, Gagliardi and Stotts (1988), IEEE Trans.
    Aerospace and Electronic Systems 24, 327; the law of the largest score, Wilks (1938), Annals of
    Mathematical Statistics 9, 60; the bound, Kay (1993), Fundamentals of Statistical Signal
    Processing, 3.9; the excess noise, Robbins and Hadwen (2003), IEEE Trans. Electron Devices 50,
    1227.

    Accuracy  model: stars in the way, the mean of the other images where the object hardly moves,
              and differences of pixels are left out. Beside trials: tests/moving.
    """
    camera, own = camera_of(design), design.moving_object
    threshold = threshold_of(design)
    shapes = [_Shape(design, camera, object_image(design, angle)) for angle in ANGLES]
    limits = tuple(_limit(shapes, threshold, found) for found in (0.5, 0.9))
    flux = flux_of(own.magnitude)
    places = [shape.place(flux) ** 2 for shape in shapes]
    snr = float(np.mean([shape.score(flux) for shape in shapes]))
    place = MEDIAN * math.sqrt(float(np.mean(places))) * design.pixel
    return MovingForecast((limits[0], limits[1]), place, snr, threshold)


class _Shape:
    """The image of an object that moves in one direction, beside the noise of the images."""

    def __init__(self, design: MovingDesign, camera: MovingCamera, fine: Floats) -> None:
        own, step = design.moving_object, camera.psf.oversampling
        self.images, self.excess = own.images, camera.excess
        self.variance = own.frames * camera.variance * own.images / (own.images - 1)
        self.electrons = camera.electrons(1.0, own.frames * design.instrument.detector.exposure)
        places = [(x, y) for x in MISSED for y in MISSED]
        self.shapes = [sampled(fine, step, x, y) for x, y in places]
        middle = self.shapes[len(places) // 2]
        # By how much the score falls where an object lies between the places that are searched.
        square = (middle**2).sum()
        self.kept = np.array([(shape * middle).sum() for shape in self.shapes]) / square**0.5
        self.cube = np.array([(shape * middle**2).sum() for shape in self.shapes]) / square
        half = 0.5 / step
        self.slopes = [
            (sampled(fine, step, x + half, y) - sampled(fine, step, x - half, y)) / (2 * half)
            for x, y in places
        ]

    def score(self, flux: float) -> float:
        """Mean over places."""
        return self._scale(flux) * float(np.mean(self.kept))

    def _scale(self, flux: float) -> float:
        return flux * self.electrons * math.sqrt(self.images / self.variance)

    def found(self, flux: float, threshold: float) -> float:
        """Probability, mean over places."""
        own = self.excess * flux * self.electrons / self.variance
        noise = np.sqrt(1 + own * self.cube)[:, None] * NOISE
        score = self._scale(flux) * self.kept[:, None] + noise
        rest = np.where(score > 0, threshold**2 - score**2, threshold**2)
        beyond = special.chdtrc(FREE, np.maximum(rest, 0))
        return float((beyond @ NOISE_WEIGHT).mean() / NOISE_WEIGHT.sum())

    def place(self, flux: float) -> float:
        """Pixel rms per axis."""
        light = flux * self.electrons
        information = [
            float((((light * slope) ** 2) / (self.variance + self.excess * light * shape)).sum())
            for shape, slope in zip(np.maximum(self.shapes, 0), self.slopes, strict=True)
        ]
        return 1 / math.sqrt(self.images * float(np.mean(information)))


def _limit(shapes: Sequence[_Shape], threshold: float, found: float) -> float:
    """Microjansky of the objects of which a fraction is found; inf where none is."""

    def excess(log_flux: float) -> float:
        flux = math.exp(log_flux)
        return float(np.mean([shape.found(flux, threshold) for shape in shapes])) - found

    low, high = math.log(FAINTEST), math.log(BRIGHTEST)
    if excess(high) < 0:
        return math.inf
    return math.exp(optimize.brentq(excess, low, high, xtol=1e-4))
