"""Frames that mislead detection: limbs, leaves, hot pixels, dead pixels, touching stars."""

from __future__ import annotations

import numpy as np

from startrack.benchmark.detection import paint
from startrack.core.streams import Streams
from startrack.core.values import Frame
from startrack.detection import Detection, detect
from tests.hard.case import hard, refused

SIDE = 256


def sky(x, y, flux, sigma: float = 0.8, background=10.0):
    image = np.zeros((SIDE, SIDE)) + background
    paint(image, np.atleast_1d(x), np.atleast_1d(y), flux, sigma)
    return image


def noisy(image):
    streams = Streams(8, 0)
    return streams("shot noise").poisson(image) + streams("read noise").normal(0, 3, image.shape)


def worst(image, x, y, **settings) -> float:
    """Pixel, largest distance of a star from its spot; infinite if there are more or fewer
    spots."""
    spots = detect(Frame(image), Detection(**settings))
    if len(spots) != len(x):
        return np.inf
    apart = np.hypot(spots.x - np.array(x)[:, None], spots.y - np.array(y)[:, None])
    return float(apart.min(axis=1).max())


X, Y = np.array([30.0, 60.4, 110.2, 90.5]), np.array([40.2, 200.6, 128.3, 90.1])


@hard("detection", "an even frame without noise, spots", (0, 0))
def _even() -> float:
    return float(len(detect(Frame(np.full((SIDE, SIDE), 7.0)), Detection())))


@hard("detection", "a bright limb over a third of the frame: worst of four stars, pixel", (0, 0.3))
def _limb() -> float:
    row, column = np.mgrid[:SIDE, :SIDE]
    limb = 20_000 / (1 + np.exp((np.hypot(column - 570, row - 128) - 400) / 2))
    return worst(noisy(sky(X, Y, 5000.0, background=10 + limb)), X, Y)


@hard("detection", "a ramp from 10 to 4000 electrons: worst of four stars, pixel", (0, 0.3))
def _ramp() -> float:
    return worst(noisy(sky(X, Y, 9000.0, background=np.linspace(10, 4000, SIDE))), X, Y)


@hard("detection", "a pedestal of a thousand million: worst of four stars, pixel", (0, 0.1))
def _pedestal() -> float:
    return worst(noisy(sky(X, Y, 9000.0)) + 1e9, X, Y)


@hard("detection", "two stars six pixels apart: worse of the two, pixel", (0, 0.1))
def _touching() -> float:
    x, y = np.array([100.0, 106.0]), np.array([80.0, 80.0])
    return worst(noisy(sky(x, y, 9000.0, 1.0)), x, y)


@hard("detection", "a hundred hot pixels beside one star, spots", (1, 3))
def _hot() -> float:
    image = noisy(sky(100.3, 90.8, 5000.0, 0.7))
    row, column = Streams(5, 0)("hot").integers(3, SIDE - 3, (2, 100))
    far = np.hypot(column - 100.3, row - 90.8) > 8
    image[row[far], column[far]] += 3000
    return float(len(detect(Frame(image), Detection())))


@hard("detection", "dead rows between the stars: worst of two, pixel", (0, 0.1))
def _rows() -> float:
    x, y = np.array([40.3, 150.7]), np.array([45.0, 101.0])
    image = noisy(sky(x, y, 9000.0, 0.6))
    image[::14] = np.nan
    return worst(image, x, y)


@hard("detection", "a star that the border cuts, spots", (0, 0))
def _cut() -> float:
    return float(len(detect(Frame(noisy(sky(0.4, 100.0, 5000.0))), Detection())))


@hard("detection", "an image that is no image", "must have two dimensions")
def _cube() -> str:
    return refused(lambda: detect(Frame(np.zeros((3, 8, 8))), Detection()))
