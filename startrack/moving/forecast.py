"""Design -> the faintest detectable object and the error of its place, by formula."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import optimize, special

from startrack.core import Floats, Streams, printed
from startrack.moving.camera import (
    HALF,
    ImageMotion,
    MovingCamera,
    camera_of,
    flux_of,
    frame_nodes,
    image_in_frames,
    image_without_smear,
    object_image,
    points,
    sampled,
)
from startrack.moving.detect import threshold_of
from startrack.moving.study import MovingDesign

ANGLES = (0.0, math.pi / 4)  # of the motion, over which the means are taken
MISSED = (-0.25, 0.0, 0.25)  # pixel, places of an object between those that are searched
FREE = 4  # parameters (place and motion) over which the score is maximised near an object
NOISE, NOISE_WEIGHT = np.polynomial.hermite_e.hermegauss(40)
MEDIAN = math.sqrt(2 * math.log(2))  # distance over the rms per axis, of a normal law
DISPLACED = 8  # realisations of the motion within frames; chosen by hand: error against time
FAINTEST, BRIGHTEST = 1e-3, 1e9  # microjansky


@printed
class MovingForecast(NamedTuple):
    """Limiting magnitudes and errors of place that the formulas expect.

    limits     microjansky, flux at which 50 % and 90 % of objects are found; inf: no such flux
    place      radian, median error of the place of an object of the required magnitude
    snr        1, of this object in all images together
    threshold  1, of the score
    """

    limits: tuple[float, float]
    place: float
    snr: float
    threshold: float


def forecast_moving(design: MovingDesign) -> MovingForecast:
    """The faintest detectable object, and the error of its place.

        S = f E sqrt(K sum T^2 / v),   v = K / (K - 1) n (F^2 (b + d) + r^2 + q^2 / 12)
        found(f) = P[(S + sqrt(1 + c) z)^2 + chi^2_4 > t^2],   z normal

    of K images of n frames, with the image T of a moving object, the excess F^2, sky b, dark
    current d, read noise r and quantisation q of a frame, the light c of the object itself and
    the threshold t of `threshold_of`; chi^2_4, as the largest score over places and motions is
    taken. The sky and the stars are taken off by the mean of the other images: K / (K - 1).

        C = A^-1 (J' V J) A^-1,   A = J' J / v,   V = (v + F^2 f T) / v^2

    is the covariance of flux, place and motion by the least squares of `refined`, with the slopes J
    of the images and the variance of their pixels, each with its frames as the motion leaves them.
    Images are far smaller than a pixel for many cameras, so that C is averaged over places of the
    object within a pixel; the median distance is sqrt(2 ln 2) times the mean error of an axis.

    Source: signal to noise of 3-D matched filters, Reed, Gagliardi and Stotts (1988), IEEE Trans.
    Aerospace and Electronic Systems 24, 327; the law of the largest score, Wilks (1938), Annals of
    Mathematical Statistics 9, 60; least squares, Press et al. (2007), Numerical Recipes, 15.4; the
    excess noise, Robbins and Hadwen (2003), IEEE Trans. Electron Devices 50, 1227.

    Accuracy  model: stars in the way, the mean of the other images where the object hardly moves,
              and differences of pixels are left out. Beside trials: tests/moving.
    """
    camera, own = camera_of(design), design.moving_object
    threshold = threshold_of(design)
    shapes = [_Shape(design, camera, object_image(design, angle)) for angle in ANGLES]
    limits = tuple(_limit(shapes, threshold, found) for found in (0.5, 0.9))
    flux = flux_of(own.magnitude)
    snr = float(np.mean([shape.score(flux) for shape in shapes]))
    place = MEDIAN * place_error(design, flux) * design.pixel
    return MovingForecast((limits[0], limits[1]), place, snr, threshold)


class _Shape:
    """The image of an object that moves in one direction, and the noise of the images."""

    def __init__(self, design: MovingDesign, camera: MovingCamera, fine: Floats) -> None:
        own, step = design.moving_object, camera.psf.oversampling
        self.images, self.excess = own.images, camera.excess
        self.variance = own.frames * camera.variance * own.images / (own.images - 1)
        self.electrons = camera.electrons(1.0, own.frames * design.instrument.detector.exposure)
        places = [(x, y) for x in MISSED for y in MISSED]
        self.shapes = [sampled(fine, step, x, y) for x, y in places]
        middle = self.shapes[len(places) // 2]
        # Loss of score if an object lies between the searched places.
        square = (middle**2).sum()
        self.kept = np.array([(shape * middle).sum() for shape in self.shapes]) / square**0.5
        self.cube = np.array([(shape * middle**2).sum() for shape in self.shapes]) / square

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


def place_error(design: MovingDesign, flux: float) -> float:
    """Error of an axis of the place at the middle time, pixel rms; mean over fields.

    Of the motion along a diagonal, for which both axes are alike. The fit takes the motion of the
    camera within a frame as a normal law of the same rms; the difference displaces the fit.
    """
    camera, own, angle = camera_of(design), design.moving_object, math.pi / 4
    rest = camera.rest
    light = camera.electrons(flux, own.frames * design.instrument.detector.exposure)
    variance = own.frames * camera.variance * own.images / (own.images - 1)
    speed = own.rate / design.pixel * np.array([math.cos(angle), math.sin(angle)])
    time = np.array(own.times) / own.times[-1]
    place = Streams(1, 0)("moving object").uniform(-0.5, 0.5, (len(rest), 1, 2))
    path = place + speed * own.times[-1] * time[:, None]
    path = (path - np.rint(path))[:, :, None] + rest
    step, still = camera.psf.oversampling, image_in_frames(design, angle, np.zeros((1, 2)))
    steep = [-np.gradient(still, 1 / step, axis=axis) for axis in (1, 0)]
    weights = np.full(own.frames, 1 / own.frames)
    image, x, y = points(
        np.stack([still, *steep]), step, path.reshape(-1, own.frames, 2), weights, 2 * HALF + 1
    )
    late = np.tile(time, len(rest))[:, None, None]
    slopes = np.stack([image, light * x, light * y, light * x * late, light * y * late], -1)
    slopes = slopes.reshape(len(rest), -1, slopes.shape[-1])
    noise = 1 + camera.excess * light * image.reshape(len(rest), -1, 1) / variance
    inverse = np.linalg.inv(slopes.mT @ slopes)
    covariance = variance * inverse @ (slopes.mT @ (noise * slopes)) @ inverse
    few = slice(DISPLACED)
    seen = _image_of_motion(design, angle, path[few]).reshape(DISPLACED, -1, 1)
    wrong = light * (seen - image.reshape(len(rest), -1, 1)[few])
    moved = (inverse[few] @ (slopes[few].mT @ wrong))[:, 1:3, 0]
    square = (covariance[:, 1, 1] + covariance[:, 2, 2]) / 2 + np.square(moved).mean()
    return float(np.sqrt(square).mean())


def _image_of_motion(design: MovingDesign, angle: float, path: Floats) -> Floats:
    """Mean image (n, k, k) over the frames, with the motion of the camera within each frame.

    path  (realisations, images, frames, 2) pixel, of the object in the frames
    """
    camera, frames = camera_of(design), design.moving_object.frames
    _, weights = frame_nodes(ImageMotion.of(design))
    moved = path[..., None, :] + camera.within[: len(path)]
    return points(
        image_without_smear(design, angle),
        camera.psf.oversampling,
        moved.reshape(-1, frames * len(weights), 2),
        np.tile(weights / frames, frames),
        2 * HALF + 1,
    )


def _limit(shapes: Sequence[_Shape], threshold: float, found: float) -> float:
    """Flux at which a fraction of objects is found, microjansky; inf where none is."""

    def excess(log_flux: float) -> float:
        flux = math.exp(log_flux)
        return float(np.mean([shape.found(flux, threshold) for shape in shapes])) - found

    low, high = math.log(FAINTEST), math.log(BRIGHTEST)
    if excess(high) < 0:
        return math.inf
    return math.exp(optimize.brentq(excess, low, high, xtol=1e-4))
