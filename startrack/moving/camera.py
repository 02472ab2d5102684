"""Design -> what is constant over its images: electrons, noise, and the image of an object."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from startrack.core import Floats, Psf, Stars, Streams, printed
from startrack.detector import electron_rate
from startrack.motion import blur, realise_motion
from startrack.moving.study import MovingDesign
from startrack.optics import pixel_psf
from startrack.scene import SUN, SUN_G_MINUS_V, WAVELENGTH, illuminate

JANSKY_V = 3636.0  # jansky of V = 0: Bessell (1979), PASP 91, 589
HALF = 4  # pixel, of the image of an object
COG = 3  # pixel, half a side of the window around a guide star
PHASES = (0.0, 0.5)  # pixel, of the places that are searched
FEWEST, PER_CYCLE, MOST = 3, 4, 48  # times within a frame, at least, for each cycle, at most
SEEN = 0.01  # pixel, amplitude of a motion from which on its cycles count
REPEATS = 16  # realisations of the motion, of which the rest after shifts is the mean


@printed
class MovingCamera(NamedTuple):
    """Constant inputs of the images of a design.

    psf         image of a point in a frame without motion
    rate        electron / second of V = 0
    sky         electron in a pixel and a frame
    dark        likewise, of the dark current
    variance    electron^2 of a pixel of a frame without stars, at the register's input
    excess      1, variance of detected light over its mean
    smear       (2,) pixel, rms of the motion within a frame
    registered  pixel, rms per axis of a frame's place by its guide stars
    rest        (2,) pixel, rms of the frames of an image about their mean, after shifts by whole
                pixels
    """

    psf: Psf
    rate: float
    sky: float
    dark: float
    variance: float
    excess: float
    smear: Floats
    registered: float
    rest: Floats

    def electrons(self, flux: float, seconds: float) -> float:
        """Electrons of an object of a flux in microjansky, in an image without losses."""
        return self.rate * flux * 1e-6 / JANSKY_V * seconds


def flux_of(magnitude: float) -> float:
    """Microjansky of a V magnitude."""
    return float(JANSKY_V * 1e6 * 10 ** (-0.4 * magnitude))


def magnitude_of(flux: float) -> float:
    """V magnitude of a flux in microjansky."""
    return -2.5 * math.log10(flux * 1e-6 / JANSKY_V)


@lru_cache(maxsize=32)
def camera_of(design: MovingDesign) -> MovingCamera:
    """Constant inputs of the images of a design.

    The error of a frame's place is that of the mean centre of gravity of the guide stars:

        sigma^2 = (F^2 N s^2 + v sum x^2) / (n N^2)

    with N electrons of each of n stars, the rms s of their image, the excess F^2, the variance v of
    a pixel and its distances x in the window. Source: Newberry (1991), PASP 103, 122.
    """
    instrument, own = design.instrument, design.moving_object
    detector, optics = instrument.detector, instrument.optics
    sunlike = Stars(
        np.zeros(2, np.int64),
        np.zeros((2, 3)),
        np.array([SUN_G_MINUS_V, own.guide_g]),
        np.full(2, np.nan),
    )
    light = illuminate(design.scene, sunlike)
    rates, background = electron_rate(light, detector, optics.area * instrument.response)
    sky = float(background) * design.pixel**2 * detector.exposure
    dark = detector.dark_rate * detector.exposure
    variance = detector.excess_noise * (sky + dark) + detector.noise**2
    variance += detector.electrons_per_dn**2 / 12
    psf = _psf(design)
    smear = blur(instrument.motion, detector.exposure)[[1, 0]] / design.pixel
    side = np.arange(-COG, COG + 1.0)
    square = float((side**2).sum()) * len(side)
    guide = float(rates[1]) * detector.exposure
    offsets = (np.arange(len(psf.table)) - len(psf.table) // 2) / psf.oversampling
    spread = float(psf.table.sum(0) @ offsets**2 / psf.table.sum()) + float((smear**2).mean())
    places = (detector.excess_noise * guide * spread + variance * square) / guide**2
    registered = math.sqrt(places / own.guides)
    rate = float(rates[0])
    return MovingCamera(
        psf, rate, sky, dark, variance, detector.excess_noise, smear, registered, _rest(design)
    )


@lru_cache(maxsize=32)
def frame_nodes(design: MovingDesign) -> tuple[Floats, Floats]:
    """Times (n,) within a frame in halves of its exposure, and their weights, of sum 1."""
    motion, exposure = design.instrument.motion, design.instrument.detector.exposure
    lines = realise_motion(motion, exposure, Streams(1, 0))
    size = np.hypot(lines.cosine, lines.sine).max(axis=1, initial=0.0) / design.pixel
    cycles = exposure * lines.frequency.max(where=size > SEEN, initial=0.0)
    count = min(FEWEST + math.ceil(PER_CYCLE * cycles), MOST)
    node, weight = np.polynomial.legendre.leggauss(count)
    return node, weight / 2


@lru_cache(maxsize=32)
def frame_times(design: MovingDesign) -> Floats:
    """Second (images, frames, nodes) within all exposures, from the middle of all."""
    own, exposure = design.moving_object, design.instrument.detector.exposure
    frames = (np.arange(own.frames) - (own.frames - 1) / 2) * exposure
    middles = np.add.outer(np.array(own.times), frames)
    return np.asarray(np.add.outer(middles, frame_nodes(design)[0] * exposure / 2))


def sight_of(design: MovingDesign, streams: Streams) -> Floats:
    """Pixel (images, frames, nodes, 2) by which the field is shifted in each frame.

    Each image has another place of the field in the pixels.
    """
    motion = realise_motion(design.instrument.motion, design.instrument.detector.exposure, streams)
    time = frame_times(design)
    turned = motion.at(time.ravel()).reshape(*time.shape, 3)[..., [1, 0]] / design.pixel
    pointed = streams("pointing of images").uniform(-0.5, 0.5, (len(time), 1, 1, 2))
    return np.asarray(turned - turned.mean((1, 2), keepdims=True) + pointed)


def _rest(design: MovingDesign) -> Floats:
    """Error of place that shifts by whole pixels leave, (2,) pixel rms."""
    squares, (_, weight) = [], frame_nodes(design)
    for number in range(REPEATS):
        frames = np.einsum("kfnx,n->kfx", sight_of(design, Streams(1, number)), weight)
        squares.append((frames - np.rint(frames)).var(axis=1).mean(0))
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))


def _psf(design: MovingDesign) -> Psf:
    instrument = design.instrument
    detector = instrument.detector
    spectrum = instrument.detected_spectra(np.array([SUN]))[0]
    return pixel_psf(
        instrument.optics,
        detector.pitch,
        WAVELENGTH,
        spectrum,
        detector.fill_factor,
        detector.diffusion,
    )


@lru_cache(maxsize=32)
def object_image(design: MovingDesign, angle: float) -> Floats:
    """The image of an object that moves, in the sum of the frames, on a fine grid.

        T = psf * smear * registration * rest of the shifts by whole pixels * trail

    by the product of transfer functions; the rest is a box of its rms. Source: Reed, Gagliardi and
    Stotts (1983), IEEE Trans. Aerospace and Electronic Systems 19, 898, for the image as the filter
    of a moving target.

    angle    radian, of its motion from the columns
    Returns  (m, m) 1, fraction of the light in a pixel, with the samples of the PSF's table
    """
    step, own = camera_of(design).psf.oversampling, design.moving_object
    side, still = _still_image(design)
    samples = len(still)
    seconds = own.frames * design.instrument.detector.exposure
    trail = own.rate * seconds / design.pixel
    x, y = fft.rfftfreq(samples, 1 / step), fft.fftfreq(samples, 1 / step)[:, None]
    moved = still * np.sinc(trail * (math.cos(angle) * x + math.sin(angle) * y))
    return np.asarray(fft.irfft2(moved, (samples, samples))[:side, :side])


@lru_cache(maxsize=32)
def _still_image(design: MovingDesign) -> tuple[int, NDArray[np.complex128]]:
    """Samples along a side of the image of an object that is still, and its transform."""
    camera = camera_of(design)
    step = camera.psf.oversampling
    padded = np.pad(camera.psf.table, 3 * step)
    samples = fft.next_fast_len(len(padded), real=True)
    x, y = fft.rfftfreq(samples, 1 / step), fft.fftfreq(samples, 1 / step)[:, None]
    sigma = 2 * math.pi**2 * (camera.smear**2 + camera.registered**2)
    box = math.sqrt(12) * camera.rest
    columns = np.exp(-sigma[0] * x**2) * np.sinc(box[0] * x)
    rows = np.exp(-sigma[1] * y**2) * np.sinc(box[1] * y)
    return len(padded), fft.rfft2(padded, (samples, samples)) * columns * rows


def sampled(fine: Floats, step: int, x: float, y: float) -> Floats:
    """Pixels (k, k) of a fine image whose object lies (x, y) pixel from the middle one."""
    middle = len(fine) // 2
    side = np.arange(-HALF, HALF + 1)
    columns, rows = ((side - place) * step + middle for place in (x, y))
    return bilinear(fine, rows, columns)


def bilinear(fine: Floats, rows: NDArray[Any], columns: NDArray[Any]) -> Floats:
    """Values (r, c) of a table between its samples; 0 beyond its edges."""
    last = len(fine) - 2
    row, column = np.floor(rows).astype(int), np.floor(columns).astype(int)
    inside = ((row >= 0) & (row <= last))[:, None] & ((column >= 0) & (column <= last))[None, :]
    u, v = (rows - row)[:, None], (columns - column)[None, :]
    i, j = np.clip(row, 0, last)[:, None], np.clip(column, 0, last)[None, :]
    upper = (1 - v) * fine[i, j] + v * fine[i, j + 1]
    lower = (1 - v) * fine[i + 1, j] + v * fine[i + 1, j + 1]
    return np.where(inside, (1 - u) * upper + u * lower, 0.0)
