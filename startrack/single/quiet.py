"""Expected electrons -> the frame that they would make without noise, and the pixels' own noise."""

from __future__ import annotations

import numpy as np

from startrack.detector import Detector
from startrack.detector.digitise import normals
from startrack.detector.maps import device_streams, read_noise
from startrack.detector.pattern import offsets
from startrack.detector.settle import settle
from startrack.streams import Streams
from startrack.values import Floats, Frame


def quiet(electrons: Floats, detector: Detector, ripple: float, noise: float) -> Frame:
    """A frame in which the tracker's background is what it is among noise.

    Where the ring about a star is even, its clipping and its slopes are what they never are in a
    real frame. So the pixels alternate by their noise, like a chessboard: the ring has the right
    spread, and the moments of a star do not move.

    electrons  (rows, columns) expected
    ripple     electron, by which pixels alternate
    noise      electron rms, that the tracker believes a pixel to have of its own
    Returns    Frame of numbers that are not rounded
    """
    largest = 2.0**detector.bits - 1
    level = np.minimum(electrons, detector.full_well)
    if detector.bend:
        level -= detector.bend * level**2 / detector.full_well
    if detector.settling:
        level = settle(level, detector.settling)
    level += ripple
    level[::2, 1::2] -= 2 * ripple
    level[1::2, ::2] -= 2 * ripple
    level /= detector.electrons_per_dn
    level += detector.offset
    if detector.bow:
        level += 4 * detector.bow * level / largest * (1 - level / largest)
    return Frame(
        np.minimum(level, largest).astype(np.float32),
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        noise,
    )


def own_noise(detector: Detector, streams: Streams) -> Floats:
    """The noise (rows, columns) that read-out adds, electron; its draws are those of `read_out`."""
    shape = detector.rows, detector.columns
    noise = np.zeros(shape)
    if detector.read_noise:
        noise += read_noise(detector) * normals(shape, streams, "read noise")
    if detector.reset_noise:
        noise += detector.reset_noise * normals(shape, streams, "reset noise")
    if detector.pattern:
        for offset in offsets(detector.pattern, shape, device_streams(detector), streams):
            noise += offset
    return noise / detector.multiplication
