"""Motion -> LineOfSight of an exposure, its drift, blur and transfer function."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import eval_legendre, roots_jacobi

from startrack import core
from startrack.core import Camera, Floats, LineOfSight, Refused, Streams, read_only
from startrack.motion.parameters import AXES, Motion, Tone
from startrack.motion.realisation import MotionRealisation, bands, realise_motion

SHARPEST = 0.5  # pixel, sigma of the sharpest PSF for which smear is accurate
TOLERANCE = 1e-6  # tolerance of the contrast of each wave, and about of the flux
PROBES = (0.15, 0.3, 0.5, 0.75, 1.0, 1.25, 1.5)  # cycle / pixel, frequencies of the compared waves
# First number of points, and its growth until two results agree. Chosen by hand; they change the
# computing time, not the error.
FEWEST_POINTS = 3
POINTS_PER_PIXEL = 1.2
POINTS_PER_CYCLE = 2.0
GROWTH = 1.25
MOST_POINTS = 2**15  # enough for a smear of some 15 000 pixel
WIDEST = 1.55  # radian, half of the largest field of a plane detector
HALF_FIELD = math.pi / 4  # radian, larger than for most star trackers


def sample_jitter(
    motion: Motion,
    exposure: float,
    pixel_angle: float,
    streams: Streams,
    half_field: float = HALF_FIELD,
) -> LineOfSight:
    """The line of sight in the exposure of one trial.

    A motion without random numbers is computed once. Arguments and errors as `slew`.
    """
    if motion.drawn:
        return trace(realise_motion(motion, exposure, streams), exposure, pixel_angle, half_field)
    return slew(motion, exposure, pixel_angle, half_field)


@lru_cache(maxsize=64)
def slew(
    motion: Motion, exposure: float, pixel_angle: float, half_field: float = HALF_FIELD
) -> LineOfSight:
    """The line of sight of a motion without random numbers.

    A star's image is the mean of its PSF over the exposure. Gauss-Lobatto points in time give
    that mean with an error that falls exponentially, because the PSF is smooth. Their number
    increases until the image no longer changes.

    exposure     second
    pixel_angle  radian, angle of a pixel on the boresight
    half_field   radian from the boresight to the corner, where smear by roll is largest
    Returns      line of sight; its first and last points are the start and end of the exposure
    Raises       ValueError if more than 32768 points are needed, for a smear of some 15 000
                 pixel. TypeError where the motion has random numbers.
    Accuracy     numerical: 1e-6 of the flux for a PSF of sigma 0.5 pixel or wider; at 0.35 pixel,
                 usually 2e-6, at worst 1e-4.
    """
    return trace(realise_motion(motion, exposure), exposure, pixel_angle, half_field)


def trace(
    motion: MotionRealisation, exposure: float, pixel_angle: float, half_field: float
) -> LineOfSight:
    """The line of sight of one realisation of a motion; arguments and errors as `slew`."""
    core.positive(exposure=exposure, pixel_angle=pixel_angle)
    named = "half of the diagonal field of view (instrument.optics.focal_length, detector)"
    if not 0 <= half_field <= WIDEST:
        rule = f"must be at most {math.degrees(WIDEST):.1f} deg"
        raise core.Refused(f"{named} {rule}, got {math.degrees(half_field):.4g} deg", key=named)
    if not motion.speed.any():
        return LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
    wave, damping = _probes(pixel_angle, half_field)
    # Motion of a star in the corner, in pixel, by a rotation of one radian about x, y or z.
    lever = np.array([1 + math.tan(half_field) ** 2] * 2 + [math.tan(half_field)]) / pixel_angle
    smear = float(np.linalg.norm(motion.speed * lever)) * exposure
    visible = np.hypot(motion.cosine, motion.sine) @ lever > TOLERANCE
    cycles = motion.frequency.max(where=visible, initial=0.0) * exposure
    count = FEWEST_POINTS + max(POINTS_PER_PIXEL * smear, POINTS_PER_CYCLE * cycles)
    coarse: LineOfSight | None = None
    before = np.full(len(wave), np.inf)
    while count <= MOST_POINTS:
        start, step, weight = lobatto_points(math.ceil(count))
        path = LineOfSight(
            exposure * join_panels(np.add.outer(start, step)),
            weight,
            join_panels(motion.over(exposure * start, exposure * step)),
        )
        # Transfer function of the smear for waves on the detector.
        now = weight @ np.exp(1j * (path.rotation @ wave.T))
        if coarse is not None and np.abs((now - before) * damping).max() < TOLERANCE:
            return coarse
        coarse, before = path, now
        count = len(weight) * GROWTH
    raise Refused(
        f"exposure must be short enough for a path of at most {MOST_POINTS} points, got "
        f"{exposure:g} s in which a star moves over some {smear:.0f} pixel"
    )


@lru_cache(maxsize=64)
def _probes(pixel_angle: float, half_field: float) -> tuple[Floats, Floats]:
    """Waves on the detector, as functions of the rotation vector, at the centre and two corners.

    Returns  (k, 3) radian per radian, and (k,) 1, transfer function of the sharpest PSF
    """
    side = math.tan(half_field) / math.sqrt(2)
    direction = np.array([[1, 0], [0, 1], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
    frequency = np.repeat(PROBES, len(direction))
    waves = np.tile(direction, (len(PROBES), 1)) * frequency[:, None]
    flows = np.concatenate([waves @ _flow(u, v) for u, v in ((0, 0), (side, side), (side, -side))])
    damping = np.exp(-2 * (np.pi * SHARPEST * frequency) ** 2)
    return 2 * np.pi / pixel_angle * flows, np.tile(damping, 3)


def _flow(u: float, v: float) -> Floats:
    """Derivative (2, 3) of (x / z, y / z) of a direction (u, v, 1) with a small rotation vector."""
    return np.array([[-u * v, 1 + u * u, -v], [-(1 + v * v), u * v, u]])


PANEL = 64  # points of a panel, chosen by hand: the cost of finding them is quadratic


@lru_cache(maxsize=128)
def lobatto_points(count: int) -> tuple[Floats, Floats, Floats]:
    """About `count` Gauss-Lobatto points of an exposure from -1/2 to 1/2, both ends included.

    More than 64 points are divided into panels with common ends.

    Returns   (p,) 1, starts of the panels; (j,) 1, points of each panel from its start; (m,) 1,
              weights of all points in the order of `join_panels`, with the sum 1
    Accuracy  numerical: exact for polynomials of degree 2 j - 3 in each panel.
    """
    panels = math.ceil((count - 1) / (PANEL - 1))
    nodes = max(math.ceil((count - 1) / panels), 2) + 1
    node, weight = _lobatto(nodes)
    total = np.zeros(panels * (nodes - 1) + 1)
    for k in range(panels):
        total[k * (nodes - 1) : (k + 1) * (nodes - 1) + 1] += weight / (2 * panels)
    return np.arange(panels) / panels - 0.5, (node + 1) / (2 * panels), total


def join_panels(panels: Floats) -> Floats:
    """Values at the points of each panel (p, j, ...) as one row (m, ...), with common ends once."""
    return np.concatenate([panels[:, :-1].reshape(-1, *panels.shape[2:]), panels[-1:, -1]])


def _lobatto(count: int) -> tuple[Floats, Floats]:
    """Points and weights on [-1, 1] (Abramowitz and Stegun 1964, 25.4.32)."""
    node = np.concatenate([[-1.0], roots_jacobi(count - 2, 1, 1)[0], [1.0]])
    weight = 2 / (count * (count - 1) * eval_legendre(count - 1, node) ** 2)
    return node, weight


MIN_BLUR_POINTS, BLUR_PER_CYCLE = 32, 8  # for a mean square, which doubles frequencies


class Stability(NamedTuple):
    """Drift and blur in an exposure; rotation vectors (3,) in radian, in camera axes.

    start  at the start of the exposure, relative to its middle
    end    at its end, relative to its middle
    mean   mean over the exposure, relative to its middle: the smallest possible error of a tracker;
           the mean performance error (MPE) of ECSS-E-ST-60-10C, if the attitude refers to the
           middle
    rms    rms about the mean: the blur; the relative performance error (RPE)
    """

    start: Floats
    end: Floats
    mean: Floats
    rms: Floats


def stability(path: LineOfSight) -> Stability:
    """Drift and blur of one line of sight, from the start to the end of the exposure.

    path      result of `sample_jitter` or `slew`
    Accuracy  numerical: the path has only the points that the image needs: the error is 1e-8 of an
              rms of 0.1 pixel, but 5 % of an rms of 1e-3 pixel. `blur` has no such limit.
    """
    mean = path.weight @ path.rotation
    rms = np.sqrt(path.weight @ (path.rotation - mean) ** 2)
    return Stability(path.rotation[0], path.rotation[-1], mean, rms)


def blur(motion: Motion, exposure: float) -> Floats:
    """Expected blur: rms about the mean of an exposure, over all trials; `jitter` is left out.

        blur^2 = deterministic part + Int S(f) [1 - sinc(f T)^2] df,   sinc(a) = sin(pi a) / (pi a)

    Frequencies below 1 / T act as drift, higher frequencies as blur.
    Source: Lucke, Sirlin and San Martin (1992), J. Astronautical Sciences 40, 557.

    exposure  second, T
    Returns   (3,) radian, about the camera's axes
    Accuracy  numerical: 1e-6 of the blur.
    """
    core.positive(exposure=exposure)
    given = tuple(tone for tone in motion.tones if tone.phase is not None)
    certain = replace(motion, tones=given, broadband=(), jitter=())
    square = _deterministic_square(realise_motion(certain, exposure), exposure)
    drawn = [tone for tone in motion.tones if tone.phase is None]
    return np.sqrt(
        _with_lines(square, drawn, motion, lambda hertz: _blurred_fraction(hertz * exposure))
    )


@lru_cache(maxsize=64)
def jitter_rms(motion: Motion, exposure: float) -> Floats:
    """Rms, over trials, of an exposure's mean line of sight minus the line of sight at its middle.

    `motion.jitter` is left out.

        jitter_rms^2 = Int S(f) [1 - sinc(f T)]^2 df

    exposure  second, T
    Returns   (3,) radian, about the camera's axes, read-only; the phase of a tone is random
    Accuracy  numerical: 1e-6.
    """
    square = _with_lines(
        np.zeros(3), motion.tones, motion, lambda hertz: (1 - np.sinc(hertz * exposure)) ** 2
    )
    return read_only(np.sqrt(square))


def exposure_mean_rms(
    motion: Motion, exposure: float, passed: Callable[[Any], Any] = np.ones_like
) -> Floats:
    """Rms, over exposures at rest, of the mean line of sight of an exposure under jitter.

        rms^2 = Int S(f) sinc(f T)^2 passed(f) df

    exposure  second, T
    passed    1, function of hertz: fraction of the power that passes a filter over the sequence of
              exposures
    Returns   (3,) radian, about the camera's axes; `motion.jitter` is left out
    """
    return np.sqrt(
        _with_lines(
            np.zeros(3),
            motion.tones,
            motion,
            lambda hertz: np.sinc(hertz * exposure) ** 2 * passed(hertz),
        )
    )


def _with_lines(
    square: Floats, tones: Sequence[Tone], motion: Motion, part: Callable[[Any], Any]
) -> Floats:
    """A mean square (3,), radian^2, plus a fraction of the power of tones and of broadband jitter.

    part  1, the fraction as a function of hertz
    """
    square, power = square.copy(), motion.jitter_factor**2
    for tone in tones:
        rms = np.array([tone.rms_x, tone.rms_y, tone.rms_z])
        square += power * rms**2 * part(tone.frequency)
    node, weight = np.polynomial.legendre.leggauss(6)
    for spectrum in motion.broadband:
        table = bands(spectrum)
        # Frequencies at equal fractions of a band's power, so that they follow the density.
        seen = part(table.frequency_at((node[:, None] + 1) / 2))
        square[AXES.index(spectrum.axis)] += power * (weight / 2 @ seen @ table.power)
    return square


def _deterministic_square(motion: MotionRealisation, exposure: float) -> Floats:
    """Mean square (3,) of a motion about its mean, radian^2."""
    cycles = motion.frequency.max(initial=0.0) * exposure
    start, step, weight = lobatto_points(math.ceil(MIN_BLUR_POINTS + BLUR_PER_CYCLE * cycles))
    angle = join_panels(motion.over(exposure * start, exposure * step))
    return weight @ (angle - weight @ angle) ** 2


def _blurred_fraction(cycles: Floats | float) -> Floats:
    """Fraction of a line's power that blurs, for an exposure of the given number of cycles."""
    x = np.square(np.pi * np.asarray(cycles, float))
    # A series is used where the difference would lose digits.
    return np.where(x < 1e-3, x / 3 * (1 - x * (2 / 15 - x / 105)), 1 - np.sinc(cycles) ** 2)


def image_path(path: LineOfSight, camera: Camera, direction: Floats) -> Floats:
    """Positions of the image of a star relative to its position at the middle of the exposure.

    direction  (3,) in camera axes, at the middle of the exposure
    Returns    (m, 2) pixel, (x, y) at each time of the path
    Raises     ValueError if the star is behind the camera at any time.
    """
    direction = np.asarray(direction, float)
    seen = Rotation.from_rotvec(path.rotation).apply(direction)
    if direction[2] <= 0 or (seen[:, 2] <= 0).any():
        raise Refused("the star must stay in front of the camera for the whole exposure")
    return camera.project(seen) - camera.project(direction)


def transfer(offset: Floats, weight: Floats, frequency: Floats) -> NDArray[np.complex128]:
    """The transfer function of a motion: the Fourier transform of the PSF of its time density.

        M(f) = (1 / T) Int exp(-2 pi i f . s(t)) dt

    An integral over time replaces 1 / |v_x| in eq. (14) of Krutz et al. (2011), so that rest,
    turning points and motion along y are no exceptions.

    offset     (m, 2) pixel, (x, y)
    weight     (m,) 1, fraction of the exposure
    frequency  (..., 2) cycles / pixel, along x and y
    Returns    (...) 1; its modulus is the modulation transfer function (MTF)
    Accuracy   numerical: 1e-6 up to the Nyquist frequency, by the points of the path.
    """
    phase = np.asarray(frequency, float) @ np.asarray(offset, float).T
    return np.exp(-2j * np.pi * phase) @ weight
