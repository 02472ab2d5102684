"""Light, Psf, Path -> Frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.detector.collect import electron_rate
from startrack.detector.crosstalk import diffuse
from startrack.detector.lag import carry
from startrack.detector.maps import dark, response
from startrack.detector.parameters import Detector
from startrack.detector.readout import read_out
from startrack.detector.shutter import Turn, at_once, row_by_row
from startrack.detector.stamp import stamp
from startrack.streams import Streams
from startrack.values import Frame, Light, Path, Psf

Floats = NDArray[np.float64]


def expose(
    light: Light,
    psf: Psf,
    path: Path,
    icrs_to_camera: Rotation,
    camera: Camera,
    detector: Detector,
    throughput: Floats,
    streams: Streams,
    turn: Turn | None = None,
    before: Floats | None = None,
) -> Frame:
    """One frame; see `expected` for the arguments."""
    electrons = expected(
        light, psf, path, icrs_to_camera, camera, detector, throughput, turn, before
    )
    return frame_of(electrons, detector, streams)


def frame_of(electrons: Floats, detector: Detector, streams: Streams) -> Frame:
    """Read out expected electrons (rows, columns), and say what the numbers mean."""
    return Frame(
        read_out(electrons, detector, streams),
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        detector.noise,
    )


def expected(
    light: Light,
    psf: Psf,
    path: Path,
    icrs_to_camera: Rotation,
    camera: Camera,
    detector: Detector,
    throughput: Floats,
    turn: Turn | None = None,
    before: Floats | None = None,
) -> Floats:
    """The expected electrons of each pixel: stars along their paths, sky, dark current.

    icrs_to_camera  attitude at the middle of the exposure (of the middle row)
    camera          the true one
    throughput      (k,) square metre, aperture times transmission
    turn            how the camera turns at any time; a rolling shutter needs it
    before          what this function gave for the frame before, for the lag
    Returns         (rows, columns) electron
    Errors          ValueError where camera and detector differ in size.
                    TypeError where a rolling shutter has no `turn`.
                    model: the solid angle of a pixel is that on the boresight.
    """
    if (camera.rows, camera.columns) != (detector.rows, detector.columns):
        raise ValueError(
            f"camera and detector must have the same size, got {camera.columns} x {camera.rows} "
            f"and {detector.columns} x {detector.rows} pixel"
        )
    # Photons.
    star_rate, sky_rate = electron_rate(light, detector, throughput)
    solid_angle = camera.focal_length_px**-2
    electrons = np.full(
        (detector.rows, detector.columns), sky_rate * solid_angle * detector.exposure
    )
    view = light.direction, path, icrs_to_camera, camera
    if not detector.row_delay:
        places = at_once(*view)
    elif turn is not None:
        places = row_by_row(*view, detector.row_delay, turn)
    else:
        raise TypeError("turn must be given where row_delay is not zero, got None")
    for weight, x, y in places:
        stamp(electrons, psf, x, y, star_rate * (detector.exposure * weight))
    # Charge.
    gain = response(detector)
    if gain is not None:
        electrons *= gain
    if detector.crosstalk:
        electrons = diffuse(electrons, detector.crosstalk)
    electrons += dark(detector) * detector.exposure
    return carry(electrons, before, detector.lag) if detector.lag else electrons
