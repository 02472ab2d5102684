"""Light, Psf, Path -> Frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Floats, Frame, Light, LineOfSight, Psf, Streams
from startrack.detector.background import background, background_tables, caught
from startrack.detector.collect import electron_rate, glow_of
from startrack.detector.effects import carry, diffuse
from startrack.detector.maps import response
from startrack.detector.parameters import Detector
from startrack.detector.readout import read_out
from startrack.detector.shutter import Course, Places, at_once, row_by_row
from startrack.detector.stamp import stamp_paths
from startrack.detector.tables import Tables


def expose(
    light: Light,
    psf: Psf,
    path: LineOfSight,
    icrs_to_camera: Rotation,
    camera: Camera,
    detector: Detector,
    throughput: Floats,
    streams: Streams,
    course: Course | None = None,
    before: Floats | None = None,
) -> Frame:
    """One frame; see `expected` for the arguments."""
    electrons = expected(
        light, psf, path, icrs_to_camera, camera, detector, throughput, course, before
    )
    _, sky = arriving(light, camera, detector, throughput)
    # Of an even sky, the frame before leaves as much as this one keeps back.
    evened = detector if before is None else replace(detector, lag=0.0)
    tables = None if light.diffuse else background_tables(evened, sky)
    return frame_of(electrons, detector, streams, tables)


def frame_of(
    electrons: Floats, detector: Detector, streams: Streams, tables: Tables | None = None
) -> Frame:
    """Read out expected electrons (rows, columns), and say what the numbers mean."""
    return to_frame(read_out(electrons, detector, streams, tables), detector)


def to_frame(image: NDArray[np.number], detector: Detector) -> Frame:
    """An image with what its detector knows of its numbers."""
    return Frame(
        image,
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        detector.noise,
    )


def expected(
    light: Light,
    psf: Psf,
    path: LineOfSight,
    icrs_to_camera: Rotation,
    camera: Camera,
    detector: Detector,
    throughput: Floats,
    course: Course | None = None,
    before: Floats | None = None,
) -> Floats:
    """The expected electrons of each pixel: stars along their paths, sky, dark current.

    icrs_to_camera  attitude at the middle of the exposure (of the middle row)
    camera          the true one
    throughput      (k,) square metre, aperture times transmission
    course          how the camera turns at any time; a rolling shutter needs it
    before          what this function gave for the frame before, for the lag
    Returns         (rows, columns) electron
    Raises          ValueError where camera and detector differ in size. TypeError where a rolling
                    shutter has no `course`.
    Accuracy        model: the solid angle of a pixel is that on the boresight.
    """
    if detector.scan:
        raise ValueError("detector must be a matrix where a frame is exposed at once, got lines")
    if (camera.rows, camera.columns) != (detector.rows, detector.columns):
        raise ValueError(
            f"camera and detector must have the same size, got {camera.columns} x {camera.rows} "
            f"and {detector.columns} x {detector.rows} pixel"
        )
    # Photons.
    star, sky = arriving(light, camera, detector, throughput)
    places = seen(light.direction, path, icrs_to_camera, camera, detector, course)
    # Charge.
    electrons = background(detector, sky).copy()
    glow = glow_of(light, camera, detector, throughput)
    if glow is not None:
        electrons += caught(glow, detector)
    draw(electrons, psf, places, star, detector)
    return carry(electrons, before, detector.lag) if detector.lag else electrons


def arriving(
    light: Light, camera: Camera, detector: Detector, throughput: Floats
) -> tuple[Floats, float]:
    """Electrons of each star (n,), and of the sky in a pixel of mean response, in the exposure."""
    star, sky = electron_rate(light, detector, throughput)
    return star * detector.exposure, float(sky) * detector.exposure / camera.focal_length_px**2


def seen(
    direction: Floats,
    path: LineOfSight,
    icrs_to_camera: Rotation,
    camera: Camera,
    detector: Detector,
    course: Course | None,
) -> Iterable[Places]:
    """Where the stars are in the course of the exposure, by its shutter."""
    view = direction, path, icrs_to_camera, camera
    if not detector.row_delay:
        return at_once(*view)
    if course is None:
        raise TypeError("course must be given where row_delay is not zero, got None")
    return row_by_row(*view, detector.row_delay, course)


def draw(
    electrons: Floats, psf: Psf, places: Iterable[Places], star: Floats, detector: Detector
) -> None:
    """Add what the stars leave in the pixels, in place.

    places  weights (m,), x and y (m, n) of some points of the paths after the other
    star    (n,) electron of each star in the whole exposure
    """
    gain = response(detector)
    image = np.zeros_like(electrons) if detector.crosstalk else electrons
    for some in places:
        stamp_paths(image, psf, *some, star, gain)
    if detector.crosstalk:
        electrons += diffuse(image, detector.crosstalk)
