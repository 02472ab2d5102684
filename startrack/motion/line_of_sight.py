"""Motion -> Path, with as many points as the smear of a star needs."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from startrack.core import Floats, LineOfSight, Streams, positive, within
from startrack.motion.parameters import Motion
from startrack.motion.quadrature import joined, points
from startrack.motion.realisation import MotionRealisation, realise_motion

SHARPEST = 0.5  # pixel, sigma of the sharpest PSF whose smear must be right
TOLERANCE = 1e-6
PROBES = (0.15, 0.3, 0.5, 0.75, 1.0, 1.25, 1.5)  # cycles per pixel
FEWEST_POINTS = 3
POINTS_PER_PIXEL = 1.2  # to start with
POINTS_PER_CYCLE = 2.0
GROWTH = 1.25
MOST_POINTS = 2**15
HALF_FIELD = math.pi / 4


def sample_jitter(
    motion: Motion,
    exposure: float,
    pixel_angle: float,
    streams: Streams,
    half_field: float = HALF_FIELD,
) -> LineOfSight:
    """The path of the line of sight in the exposure of one trial.

    A motion in which nothing is drawn is computed once; see `slew` for the rest.
    """
    if motion.drawn:
        return trace(realise_motion(motion, exposure, streams), exposure, pixel_angle, half_field)
    return slew(motion, exposure, pixel_angle, half_field)


@lru_cache(maxsize=64)
def slew(
    motion: Motion, exposure: float, pixel_angle: float, half_field: float = HALF_FIELD
) -> LineOfSight:
    """The path of a motion in which nothing is drawn.

    A star's image is the mean of its PSF over the exposure. Gauss-Lobatto points in time give
    that mean with an error that falls exponentially, because the PSF is smooth. There are as
    many as it takes until more of them do not change the image any more.

    exposure     second
    pixel_angle  radian that a pixel spans on the boresight
    half_field   radian from the boresight to the corner, where roll smears most
    Returns      its first and last points are the start and the end of the exposure
    Raises       ValueError where the path needs more than 32768 points, some 15 000 pixel.
                 TypeError where a phase or a spectrum would have to be drawn.
    Accuracy     numerical: 1e-6 of the flux for a PSF of sigma 0.5 pixel or wider; at 0.35 pixel,
                 2e-6 as a rule and 1e-4 at worst.
    """
    return trace(realise_motion(motion, exposure), exposure, pixel_angle, half_field)


def trace(
    motion: MotionRealisation, exposure: float, pixel_angle: float, half_field: float
) -> LineOfSight:
    """The path of a motion that is known already; arguments and errors as `slew`."""
    positive(exposure=exposure, pixel_angle=pixel_angle)
    within(0, 1.55, half_field=half_field)
    if not motion.speed.any():
        return LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
    wave, damping = _probes(pixel_angle, half_field)
    # In the corner, a turn about x, y or z moves a star by so many pixel.
    reach = np.array([1 + math.tan(half_field) ** 2] * 2 + [math.tan(half_field)]) / pixel_angle
    smear = float(np.linalg.norm(motion.speed * reach)) * exposure
    line = np.hypot(motion.cosine, motion.sine) @ reach > TOLERANCE
    cycles = motion.frequency.max(where=line, initial=0.0) * exposure
    count = FEWEST_POINTS + max(POINTS_PER_PIXEL * smear, POINTS_PER_CYCLE * cycles)
    coarse: LineOfSight | None = None
    before = np.full(len(wave), np.inf)
    while count <= MOST_POINTS:
        start, step, weight = points(math.ceil(count))
        path = LineOfSight(
            exposure * joined(np.add.outer(start, step)),
            weight,
            joined(motion.over(exposure * start, exposure * step)),
        )
        # What the smear does to the contrast of waves on the detector.
        now = weight @ np.exp(1j * (path.rotation @ wave.T))
        if coarse is not None and np.abs((now - before) * damping).max() < TOLERANCE:
            return coarse
        coarse, before = path, now
        count = len(weight) * GROWTH
    raise ValueError(
        f"exposure must be so short that a path needs at most {MOST_POINTS} points, got "
        f"{exposure:g} s in which a star moves over some {smear:.0f} pixel"
    )


@lru_cache(maxsize=64)
def _probes(pixel_angle: float, half_field: float) -> tuple[Floats, Floats]:
    """Waves on the detector, as functions of the rotation vector, at the centre and two corners.

    Returns  (k, 3) radian per radian, and (k,) 1, the contrast that the PSF leaves of each
    """
    side = math.tan(half_field) / math.sqrt(2)
    direction = np.array([[1, 0], [0, 1], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
    frequency = np.repeat(PROBES, len(direction))
    waves = np.tile(direction, (len(PROBES), 1)) * frequency[:, None]
    flows = np.concatenate([waves @ _flow(u, v) for u, v in ((0, 0), (side, side), (side, -side))])
    damping = np.exp(-2 * (np.pi * SHARPEST * frequency) ** 2)
    return 2 * np.pi / pixel_angle * flows, np.tile(damping, 3)


def _flow(u: float, v: float) -> Floats:
    """(2, 3), how (x / z, y / z) of a direction (u, v, 1) changes with a small rotation."""
    return np.array([[-u * v, 1 + u * u, -v], [-(1 + v * v), u * v, u]])
