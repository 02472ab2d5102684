"""Design -> values that are constant over its images: electrons, noise, image of an object."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import fft

from startrack.core import Floats, Psf, Stars, Streams, printed
from startrack.detector import electron_rate
from startrack.motion import Motion, blur, realise_motion
from startrack.moving.study import MovingDesign, MovingObject
from startrack.optics import pixel_psf
from startrack.scene import SUN, SUN_G_MINUS_V, WAVELENGTH, illuminate

JANSKY_V = 3636.0  # jansky of V = 0: Bessell (1979), PASP 91, 589
HALF = 4  # pixel, of the image of an object
MARGIN = 3  # pixel beyond the table of a PSF, for smear and trail
COG = 3  # pixel, half a side of the window around a guide star
PHASES = (0.0, 0.5)  # pixel, of the places that are searched
FEWEST, PER_CYCLE, MOST = 3, 4, 48  # times within a frame, at least, for each cycle, at most
SEEN = 0.01  # pixel, least amplitude of a motion whose cycles count
BRIGHT = 0.5  # of the saturation signal, upper limit for the brightest pixel of a guide star
FLAT = 1e-3  # least slope of a centre of gravity with the place of a star
PLACES = np.linspace(-1, 1, 81)  # pixel, of a star along an axis
REPEATS = 16  # realisations of the motion, over which means are taken


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
    guide       electron of a guide star in a frame
    registered  pixel, rms per axis of a frame's place by its guide stars
    gravity     (2, n) pixel along columns and rows, mean centre of gravity of a star at `PLACES`
    rest        (realisations, images, frames, 2) pixel, remaining shift of the field in each frame
                after shifts by whole pixels
    within      (realisations, images, frames, nodes, 2) pixel, motion within each frame
    """

    psf: Psf
    rate: float
    sky: float
    dark: float
    variance: float
    excess: float
    smear: Floats
    guide: float
    registered: float
    gravity: Floats
    rest: Floats
    within: Floats

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

    The error of a frame's place is the error of the mean centre of gravity of the guide stars:

        sigma^2 = (F^2 N s^2 + v sum x^2) / (n N^2)

    with N electrons of each of n stars, the rms s of their image, the excess F^2, the variance v of
    a pixel and its distances x in the window, times the mean square slope of a star's place with
    its centre of gravity. Source: Newberry (1991), PASP 103, 122.
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
    full = min(detector.full_well, (2**detector.bits - 1) * detector.electrons_per_dn)
    guide = min(float(rates[1]) * detector.exposure, BRIGHT * full / float(psf.table.max()))
    offsets = (np.arange(len(psf.table)) - len(psf.table) // 2) / psf.oversampling
    spread = float(psf.table.sum(0) @ offsets**2 / psf.table.sum()) + float((smear**2).mean())
    places = (detector.excess_noise * guide * spread + variance * square) / guide**2
    gravity = _gravity(psf, smear)
    steep = float(np.mean((np.diff(PLACES) / np.diff(gravity)) ** 2))
    rest, within = _rest(ImageMotion.of(design))
    return MovingCamera(
        psf=psf,
        rate=float(rates[0]),
        sky=sky,
        dark=dark,
        variance=variance,
        excess=detector.excess_noise,
        smear=smear,
        guide=guide,
        registered=math.sqrt(places * steep / own.guides),
        gravity=gravity,
        rest=rest,
        within=within,
    )


class ImageMotion(NamedTuple):
    """Inputs of the motion of a field over the pixels, which do not depend on the f-number.

    pixel  radian, a side
    """

    motion: Motion
    exposure: float
    pixel: float
    moving_object: MovingObject

    @classmethod
    def of(cls, design: MovingDesign) -> ImageMotion:
        """The inputs of a design."""
        instrument = design.instrument
        exposure = instrument.detector.exposure
        return cls(instrument.motion, exposure, design.pixel, design.moving_object)


@lru_cache(maxsize=32)
def frame_nodes(moved: ImageMotion) -> tuple[Floats, Floats]:
    """Times (n,) within a frame in halves of its exposure, and their weights, of sum 1."""
    lines = realise_motion(moved.motion, moved.exposure, Streams(1, 0))
    size = np.hypot(lines.cosine, lines.sine).max(axis=1, initial=0.0) / moved.pixel
    cycles = moved.exposure * lines.frequency.max(where=size > SEEN, initial=0.0)
    count = min(FEWEST + math.ceil(PER_CYCLE * cycles), MOST)
    node, weight = np.polynomial.legendre.leggauss(count)
    return node, weight / 2


def frame_times(moved: ImageMotion) -> Floats:
    """Second (images, frames, nodes) within all exposures, from the middle of all."""
    own, exposure = moved.moving_object, moved.exposure
    frames = (np.arange(own.frames) - (own.frames - 1) / 2) * exposure
    middles = np.add.outer(np.array(own.times), frames)
    return np.asarray(np.add.outer(middles, frame_nodes(moved)[0] * exposure / 2))


def sight_of(moved: ImageMotion, streams: Streams) -> Floats:
    """Pixel (images, frames, nodes, 2): shift of the field in each frame.

    The place of the field relative to the pixels differs between images.
    """
    motion, time = realise_motion(moved.motion, moved.exposure, streams), frame_times(moved)
    turned = motion.at(time.ravel()).reshape(*time.shape, 3)[..., [1, 0]] / moved.pixel
    pointed = streams("pointing of images").uniform(-0.5, 0.5, (len(time), 1, 1, 2))
    return np.asarray(turned - turned.mean((1, 2), keepdims=True) + pointed)


def _gravity(psf: Psf, smear: Floats) -> Floats:
    """Mean centres of gravity (2, n) of a star at `PLACES` from the middle of a pixel.

    Pixels sample a sharp image too coarsely for its centre of gravity to equal its place.
    """
    side, step = np.arange(-COG, COG + 1), psf.oversampling
    grid = (np.arange(len(psf.table)) - len(psf.table) // 2) / step
    seen = []
    for axis, moved in enumerate(smear):
        line = scipy.ndimage.gaussian_filter1d(psf.table.sum(axis), moved * step, mode="constant")
        pixel = np.interp(side - PLACES[:, None], grid, line, 0.0, 0.0)
        seen.append(pixel @ side / pixel.sum(1))
    # A star far inside a pixel has the same centre of gravity wherever it is.
    return np.maximum.accumulate(np.array(seen), axis=1) + FLAT * PLACES


def _rest(moved: ImageMotion) -> tuple[Floats, Floats]:
    """Realisations of the motion: `rest` and `within` as in `MovingCamera`."""
    _, weight = frame_nodes(moved)
    sights = np.array([sight_of(moved, Streams(1, number)) for number in range(REPEATS)])
    frames = np.einsum("rkfnx,n->rkfx", sights, weight)
    return frames - np.rint(frames), sights - frames[..., None, :]


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
    camera, frame = camera_of(design), _frame_image(design, angle)
    sigma = 2 * (math.pi * camera.registered) ** 2
    box = np.sqrt(12 * camera.rest.var(axis=2).mean((0, 1)))
    columns = np.exp(-sigma * frame.x**2) * np.sinc(box[0] * frame.x)
    rows = np.exp(-sigma * frame.y**2) * np.sinc(box[1] * frame.y)
    return frame.image(columns * rows)


def image_without_smear(design: MovingDesign, angle: float) -> Floats:
    """`object_image` in a frame without shift and without motion of the camera."""
    frame = _frame_image(design, angle)
    return frame._replace(smear=np.ones(1)).image(np.ones(1))


def image_in_frames(design: MovingDesign, angle: float, rest: Floats) -> Floats:
    """`object_image` for frames with known remaining shifts (n, 2), pixel."""
    frame = _frame_image(design, angle)
    rows, columns = (
        np.exp(-2j * math.pi * frequency.ravel() * rest[:, axis : axis + 1])
        for frequency, axis in ((frame.y, 1), (frame.x, 0))
    )
    return frame.image(rows.T @ columns / len(rest))


class _FrameImage(NamedTuple):
    """The image of a moving object in frames that are not shifted, by its transfer function.

    x, y      (1, k), (m, 1) cycle / pixel
    transfer  (m, k), without the motion of the camera within a frame
    smear     (m, k), of this motion
    samples   along a side of the image
    """

    x: Floats
    y: Floats
    transfer: NDArray[np.complex128]
    smear: Floats
    samples: int

    def image(self, more: NDArray[Any]) -> Floats:
        """The image after another transfer function."""
        padded = (len(self.y), len(self.y))
        return np.asarray(
            fft.irfft2(self.transfer * self.smear * more, padded)[: self.samples, : self.samples]
        )


@lru_cache(maxsize=32)
def _spectrum(design: MovingDesign) -> NDArray[np.complex128]:
    """The transform of the PSF's table within its margins."""
    psf = camera_of(design).psf
    padded = np.pad(psf.table, MARGIN * psf.oversampling)
    samples = fft.next_fast_len(len(padded), real=True)
    return np.asarray(fft.rfft2(padded, (samples, samples)))


@lru_cache(maxsize=32)
def _frame_image(design: MovingDesign, angle: float) -> _FrameImage:
    camera, own = camera_of(design), design.moving_object
    spectrum, step = _spectrum(design), camera.psf.oversampling
    samples = len(spectrum)
    x, y = fft.rfftfreq(samples, 1 / step)[None], fft.fftfreq(samples, 1 / step)[:, None]
    sigma = 2 * (math.pi * camera.smear) ** 2
    smear = np.exp(-sigma[0] * x**2) * np.exp(-sigma[1] * y**2)
    trail = own.rate * own.frames * design.instrument.detector.exposure / design.pixel
    moved = np.sinc(trail * (math.cos(angle) * x + math.sin(angle) * y))
    size = len(camera.psf.table) + 2 * MARGIN * step
    return _FrameImage(x, y, spectrum * moved, smear, size)


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


def points(table: Floats, step: int, place: Floats, weights: Floats, size: int) -> Floats:
    """Images (..., f, size, size) of a point at places (f, nodes, 2) from the middle, over nodes.

    table     (..., m, m) image of a point, with `step` samples a pixel; or several
    Accuracy  numerical: the nearest sample, half a sample of the table at most.
    """
    edge = [(0, 0)] * (table.ndim - 2) + [(1, 1)] * 2
    padded = np.pad(table, edge)
    samples = padded.shape[-1]
    flat = padded.reshape(*table.shape[:-2], samples**2)
    side = np.arange(size) - size // 2
    total = np.zeros((*table.shape[:-2], len(place), size, size))
    for node, weight in enumerate(weights):
        index = np.rint((side - place[:, node, :, None]) * step).astype(int) + samples // 2
        index = np.minimum(np.maximum(index, 0), samples - 1)
        total += weight * flat.take(index[:, 1, :, None] * samples + index[:, 0, None, :], axis=-1)
    return total
