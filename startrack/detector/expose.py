"""Light, Psf, Path -> Frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.detector.collect import electron_rate
from startrack.detector.effects import response
from startrack.detector.parameters import Detector
from startrack.detector.readout import read_out
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
) -> Frame:
    """One frame; see `expected` for the arguments."""
    electrons = expected(light, psf, path, icrs_to_camera, camera, detector, throughput)
    return Frame(
        read_out(electrons, detector, streams),
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        detector.read_noise,
    )


def expected(
    light: Light,
    psf: Psf,
    path: Path,
    icrs_to_camera: Rotation,
    camera: Camera,
    detector: Detector,
    throughput: Floats,
) -> Floats:
    """The expected electrons of each pixel: stars along their paths, sky, dark current.

    icrs_to_camera  attitude at the middle of the exposure
    camera          the true one
    throughput      (k,) square metre, aperture times transmission
    Returns         (rows, columns) electron
    Errors          ValueError where camera and detector differ in size.
                    model: the solid angle of a pixel is that on the boresight.
    """
    if (camera.rows, camera.columns) != (detector.rows, detector.columns):
        raise ValueError(
            f"camera and detector must have the same size, got {camera.columns} x {camera.rows} "
            f"and {detector.columns} x {detector.rows} pixel"
        )
    star_rate, sky_rate = electron_rate(light, detector, throughput)
    solid_angle = camera.focal_length_px**-2
    electrons = np.full(
        (detector.rows, detector.columns), sky_rate * solid_angle * detector.exposure
    )
    attitude = Rotation.from_rotvec(path.rotation) * icrs_to_camera
    for weight, matrix in zip(path.weight, attitude.as_matrix(), strict=True):
        x, y = camera.project(light.direction @ matrix.T).T.copy()
        stamp(electrons, psf, x, y, star_rate * (detector.exposure * weight))
    gain = response(detector)
    if gain is not None:
        electrons *= gain
    electrons += detector.dark_current * detector.exposure
    return electrons
