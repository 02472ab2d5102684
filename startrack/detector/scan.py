"""Light and the motion of a camera -> the image of a detector of lines."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import (
    Camera,
    Floats,
    Frame,
    Light,
    Psf,
    Refused,
    Streams,
    require_memory,
    whole,
)
from startrack.detector.collect import diffuse_electrons, electron_rate
from startrack.detector.exposure import Turn, frame_of
from startrack.detector.lines import Line
from startrack.detector.maps import response
from startrack.detector.parameters import Detector
from startrack.detector.stamp import stamp

NODES = 8  # of Gauss-Legendre in the exposure of a line: 1e-6 of the flux at one pixel of smear


def scan(
    light: Light,
    psf: Psf,
    icrs_to_camera: Rotation,
    turn: Turn,
    camera: Camera,
    lines: tuple[Line, ...],
    count: int,
    detector: Detector,
    throughput: Floats,
    streams: Streams,
) -> Frame:
    """One image of `count` rows, each the sum of the lines that add to it.

        electrons_i = sum over lines: gain integral of the line's electron rate,
                      from (i - count / 2 + delay) exposure, for one exposure

    Each line has its own direction and time, so that a star is smeared if it does not move with
    the charge.

    icrs_to_camera  attitude at time zero
    turn            seconds (m,) -> rotation vectors (m, 3) as in LineOfSight
    camera          the true one; lines lie at its rows
    detector        as many rows as there are lines; `exposure` is that of one line
    Raises          ValueError where sizes differ, or for a `read_noise_spread`.
    Accuracy        model: blooming, hits and settling act on the image as on a matrix; diffuse
                    light is that of time zero.
    """
    electrons = scanned(
        light, psf, icrs_to_camera, turn, camera, lines, count, detector, throughput
    )
    return frame_of(electrons, detector, streams)


def scanned(
    light: Light,
    psf: Psf,
    icrs_to_camera: Rotation,
    turn: Turn,
    camera: Camera,
    lines: tuple[Line, ...],
    count: int,
    detector: Detector,
    throughput: Floats,
) -> Floats:
    """The expected electrons (count, columns * phases) of `scan`."""
    whole(1, 2**20, count=count)
    if camera.columns != detector.columns or len(lines) != detector.rows:
        raise Refused(
            "detector must have the camera's columns and a row for each line, got "
            f"{detector.columns} x {detector.rows} for {camera.columns} and {len(lines)}"
        )
    if detector.read_noise_spread:
        raise Refused(
            f"read_noise_spread must be 0 where lines scan, got {detector.read_noise_spread}"
        )
    star_rate, sky_rate = electron_rate(light, detector, throughput)
    sky = sky_rate * camera.focal_length_px**-2 * detector.exposure
    diffuse = diffuse_electrons(light, camera, detector, throughput)
    phases = 1 + max(line.phase for line in lines)
    require_memory(
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
        for row, x, y, electrons in _star_positions(
            light.direction, star_rate, psf, icrs_to_camera, turn, camera, line, start, detector
        ):
            stamp(expected[row : row + 1], psf, x, y, electrons)
        if gain is not None:
            expected *= gain[number]
        image[line.phase] += line.gain * (expected + detector.dark_rate * detector.exposure)
    return image.transpose(1, 2, 0).reshape(count, -1)


def _star_positions(  # type: ignore[no-untyped-def]
    direction, star_rate, psf, icrs_to_camera, turn, camera, line, start, detector
):
    """For each row of the image with stars, their positions during its exposure.

    Yields  row; x, y (k,) pixel from the line's first; electrons (k,)
    """
    here = icrs_to_camera.apply(direction)

    def position(time: Floats, towards: Floats) -> Floats:
        pixel = camera.project(Rotation.from_rotvec(turn(time)).apply(towards))
        return pixel - (line.shift, line.row)

    ends = np.append(start, start[-1] + detector.exposure)
    all_ends = np.repeat(ends, len(here)), np.tile(here, (len(ends), 1))
    across = position(*all_ends)[:, 1].reshape(len(ends), len(here))
    # The image of a star can touch the line in an exposure if it is near at the start or the end,
    # or passes the line between them.
    low, high = np.minimum(across[:-1], across[1:]), np.maximum(across[:-1], across[1:])
    near = (low < psf.half_width + 1) & (high > -psf.half_width - 1)
    row, star = np.nonzero(near)
    node, weight = np.polynomial.legendre.leggauss(NODES)
    time = start[row, None] + (node + 1) / 2 * detector.exposure
    pixel = position(time.ravel(), np.repeat(here[star], NODES, axis=0))
    electrons = np.outer(star_rate[star], weight / 2 * detector.exposure).ravel()
    edge = np.searchsorted(row, np.arange(len(start) + 1)) * NODES
    for number in np.unique(row):
        part = slice(edge[number], edge[number + 1])
        x, y = pixel[part].T.copy()
        yield number, x, y, electrons[part]
