"""Detector -> the mean of dark frames that are taken to calibrate it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from startrack.core import Floats, Refused, Streams, kept
from startrack.detector.collect import background, background_tables
from startrack.detector.maps import device_streams
from startrack.detector.parameters import Detector
from startrack.detector.readout import read_out


@kept(2)
def dark_frames(detector: Detector, frames: int) -> tuple[Floats, float]:
    """Mean of dark frames of a device, and the noise of a pixel in one of them.

    The noise of the mean belongs to the device: it is the same in all trials.

    detector  as it is when the frames are taken
    Returns   (rows, columns) digital number, read-only; digital number rms, of a median pixel
    Raises    ValueError for a detector of lines.
    """
    if detector.scan:
        raise Refused("dark_map must be left out where lines scan")
    # On the ground no particle hits, and no star leaves a charge.
    detector = replace(detector, hits=None, lag=0.0)
    electrons, tables = background(detector, 0.0), background_tables(detector, 0.0)
    seed = int(device_streams(detector)("dark frames").integers(2**62))
    total = np.zeros((detector.rows, detector.columns))
    for number in range(frames):
        total += read_out(electrons, detector, Streams(seed, number), tables)
    total /= frames
    total.flags.writeable = False
    step = detector.electrons_per_dn
    noise = math.hypot(math.sqrt(float(np.median(electrons))), detector.noise) / step
    return total, math.hypot(noise, 1 / math.sqrt(12))
