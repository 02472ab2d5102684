"""Light and the motion of a camera -> the image of a detector of lines."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import Floats, Light, Refused
from startrack.detector.collect import diffuse_electrons, electron_rate
from startrack.detector.exposure import Turn, frame_of
from startrack.detector.maps import response
from startrack.detector.parameters import Detector, Line
from startrack.detector.stamp import stamp

NODES = 8  # Gauss-Legendre nodes in a line's exposure: 1e-6 of the flux at one pixel of smear


@dataclass(frozen=True, eq=False)
class LineExposure:
    """All inputs of the image of a line detector except its noise.

    light           light at the entrance pupil
    icrs_to_camera  attitude at time zero
    turn            function: seconds (m,) -> rotation vectors (m, 3) as in LineOfSight
    camera          true camera; lines lie at its rows
    count           number of rows of the image
    detector        detector with one row for each line; `exposure` is the exposure of one line
    throughput      (k,) electron m^2 / photon in each spectral bin
    """

    light: Light
    psf: core.Psf
    icrs_to_camera: Rotation
    turn: Turn
    camera: core.Camera
    lines: tuple[Line, ...]
    count: int
    detector: Detector
    throughput: Floats


def scan(exposure: LineExposure, streams: core.Streams) -> core.Frame:
    """One image of `count` rows; each row is the sum of the lines that add to it.

        electrons_i = sum over lines: gain integral of the line's electron rate,
                      from (i - count / 2 + delay) exposure, for one exposure

    Each line has its own direction and time, so that a star is smeared if it does not move with
    the charge.

    Raises          ValueError if sizes differ, or for a `read_noise_spread`.
    Accuracy        model: blooming, hits and settling act on the image as on a matrix; diffuse
                    light is taken at time zero.
    """
    return frame_of(scanned(exposure), exposure.detector, streams)


def scanned(exposure: LineExposure) -> Floats:
    """The expected electrons (count, columns * phases) of `scan`."""
    light, camera, lines = exposure.light, exposure.camera, exposure.lines
    detector, throughput, count = exposure.detector, exposure.throughput, exposure.count
    core.whole(1, 2**20, count=count)
    if camera.columns != detector.columns or len(lines) != detector.rows:
        raise Refused(
            "detector must have the camera's columns and a row for each line, got "
            f"{detector.columns} x {detector.rows} for {camera.columns} and {len(lines)}"
        )
    if detector.read_noise_spread:
        raise Refused(
            "read_noise_spread must be 0 for a detector that scans, got "
            f"{detector.read_noise_spread}"
        )
    star_rate, sky_rate = electron_rate(light, detector, throughput)
    sky = sky_rate * camera.focal_length_px**-2 * detector.exposure
    diffuse = diffuse_electrons(light, camera, detector, throughput)
    phases = 1 + max(line.phase for line in lines)
    core.require_memory(
        8 * (phases + 3) * count * detector.columns,
        f"an image of {count} lines of {phases * detector.columns} pixels",
    )
    image = np.zeros((phases, count, detector.columns))
    gain = response(detector)
    for number, line in enumerate(lines):
        start = (np.arange(count) - count / 2 + line.delay) * detector.exposure
        expected = np.full((count, detector.columns), sky)
        if diffuse is not None:
            expected += diffuse[number]
        for row, x, y, electrons in _star_positions(exposure, star_rate, line, start):
            stamp(expected[row : row + 1], exposure.psf, x, y, electrons)
        if gain is not None:
            expected *= gain[number]
        image[line.phase] += line.gain * (expected + detector.dark_rate * detector.exposure)
    return image.transpose(1, 2, 0).reshape(count, -1)


def _star_positions(
    exposure: LineExposure, star_rate: Floats, line: Line, start: NDArray[np.floating[Any]]
) -> Iterator[tuple[int, Floats, Floats, Floats]]:
    """For each row of the image with stars, their positions during its exposure.

    Yields  row; x, y (k,) pixel from the line's first; electrons (k,)
    """
    here = exposure.icrs_to_camera.apply(exposure.light.direction)
    duration, half_width = exposure.detector.exposure, exposure.psf.half_width + 1

    def position(time: Floats, towards: Floats) -> Floats:
        turned = Rotation.from_rotvec(exposure.turn(time)).apply(towards)
        return exposure.camera.project(turned) - (line.shift, line.row)

    ends = np.append(start, start[-1] + duration)
    all_ends = np.repeat(ends, len(here)), np.tile(here, (len(ends), 1))
    across = position(*all_ends)[:, 1].reshape(len(ends), len(here))
    # The image of a star can touch the line in an exposure if it is near the line at the start or
    # at the end, or crosses the line in between.
    low, high = np.minimum(across[:-1], across[1:]), np.maximum(across[:-1], across[1:])
    near = (low < half_width) & (high > -half_width)
    row, star = np.nonzero(near)
    node, weight = np.polynomial.legendre.leggauss(NODES)
    time = start[row, None] + (node + 1) / 2 * duration
    pixel = position(time.ravel(), np.repeat(here[star], NODES, axis=0))
    electrons = np.outer(star_rate[star], weight / 2 * duration).ravel()
    edge = np.searchsorted(row, np.arange(len(start) + 1)) * NODES
    for number in np.unique(row):
        part = slice(edge[number], edge[number + 1])
        x, y = pixel[part].T.copy()
        yield number, x, y, electrons[part]
