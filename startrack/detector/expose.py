"""Exposure: what a frame depends on; Exposure -> expected electrons, and a Frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import (
    Camera,
    FieldPsf,
    Floats,
    Frame,
    Light,
    LineOfSight,
    Psf,
    Refused,
    Streams,
    require_memory,
)
from startrack.detector.ageing import Flickering, trailed
from startrack.detector.collect import (
    apply_response,
    background,
    background_tables,
    diffuse_electrons,
    electron_rate,
    mean_wavelength,
)
from startrack.detector.effects import carry, diffuse
from startrack.detector.maps import flickering, response
from startrack.detector.parameters import Detector
from startrack.detector.readout import read_out
from startrack.detector.shutter import MotionFunction, Places, at_once, row_by_row
from startrack.detector.stamp import stamp_paths
from startrack.detector.tables import Tables

FRAME_BYTES = 56  # of a pixel while a frame is made and searched; measured: 42 to 52


@dataclass(frozen=True, eq=False)
class Exposure:
    """What a frame depends on, except its noise.

    light            at the entrance pupil
    line_of_sight    its motion in the exposure
    icrs_to_camera   attitude at the middle of the exposure (of the middle row)
    camera           the true one
    throughput       (k,) square metre in each spectral bin, area of the aperture times transmission
    motion_function  motion of the camera at any time; needed by a rolling shutter
    residual_charge  (rows, columns) electron, the expected electrons of the frame before, of which
                     the detector adds its fraction `lag`; None: none, as in a first frame
    """

    light: Light
    psf: Psf | FieldPsf
    line_of_sight: LineOfSight
    icrs_to_camera: Rotation
    camera: Camera
    detector: Detector
    throughput: Floats
    motion_function: MotionFunction | None = None
    residual_charge: Floats | None = None


def expose(exposure: Exposure, streams: Streams) -> Frame:
    """One frame with its noise. Raises and accuracy as `expected`."""
    electrons, detector = expected(exposure), exposure.detector
    _, sky = arriving(exposure.light, exposure.camera, detector, exposure.throughput)
    # Of a uniform background, the frame before leaves as much as this one keeps back.
    evened = detector if exposure.residual_charge is None else replace(detector, lag=0.0)
    tables = None if exposure.light.diffuse else background_tables(evened, sky)
    return frame_of(electrons, detector, streams, tables)


def frame_of(
    electrons: Floats,
    detector: Detector,
    streams: Streams,
    tables: Tables | None = None,
    state: Flickering | None = None,
) -> Frame:
    """Read out expected electrons (rows, columns), and say what the numbers mean.

    state  of the pixels that flicker; None: a random one
    """
    if detector.age and detector.age.flicker:
        state = state or flickering(detector, streams)
        assert state
        electrons = state.add_to(electrons, detector.exposure)
    if detector.age and detector.age.deferred:
        top = detector.region.top if detector.region else 0
        electrons = trailed(electrons, detector.age.deferred, top)
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


def expected(exposure: Exposure) -> Floats:
    """The expected electrons of each pixel: stars along their paths, background, dark current.

    Returns   (rows, columns) electron
    Raises    ValueError where camera and detector differ in size, or for a line detector.
              TypeError where a rolling shutter has no `motion_function`.
    Accuracy  model: the solid angle of a pixel is that on the boresight.
    """
    light, camera, detector = exposure.light, exposure.camera, exposure.detector
    if detector.scan:
        raise Refused("detector must be a matrix where a frame is exposed at once, got lines")
    if (camera.rows, camera.columns) != (detector.rows, detector.columns):
        raise Refused(
            f"camera and detector must have the same size, got {camera.columns} x {camera.rows} "
            f"and {detector.columns} x {detector.rows} pixel"
        )
    require_memory(
        FRAME_BYTES * detector.rows * detector.columns,
        f"a frame of {detector.columns} x {detector.rows} pixels",
    )
    # Photons.
    star, sky = arriving(light, camera, detector, exposure.throughput)
    places = seen(
        light.direction,
        exposure.line_of_sight,
        exposure.icrs_to_camera,
        camera,
        detector,
        exposure.motion_function,
    )
    # Charge.
    electrons = background(detector, sky).copy()
    glow = diffuse_electrons(light, camera, detector, exposure.throughput)
    if glow is not None:
        electrons += apply_response(glow, detector)
    colour = None
    if isinstance(exposure.psf, FieldPsf):
        colour = mean_wavelength(light, detector, exposure.throughput)
    draw(electrons, exposure.psf, places, star, detector, colour)
    return carry(electrons, exposure.residual_charge, detector.lag) if detector.lag else electrons


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
    motion_function: MotionFunction | None,
) -> Iterable[Places]:
    """Where the stars are during the exposure, with its shutter."""
    view = direction, path, icrs_to_camera, camera
    if not detector.row_delay:
        return at_once(*view)
    if motion_function is None:
        raise TypeError("motion_function must be given where row_delay is not zero, got None")
    return row_by_row(*view, detector.row_delay, motion_function)


def draw(
    electrons: Floats, psf: Psf | FieldPsf, places: Iterable[Places], star: Floats,
    detector: Detector, colour: Floats | None = None,
) -> None:  # fmt: skip
    """Add what the stars leave in the pixels, in place.

    places  weights (m,), x and y (m, n) of some points of the paths after the other
    star    (n,) electron of each star in the whole exposure
    colour  (n,) metre, mean wavelength of each star's light; needed by a FieldPsf
    """
    gain = response(detector)
    image = np.zeros_like(electrons) if detector.crosstalk else electrons
    for weight, x, y in places:
        if isinstance(psf, FieldPsf):
            x, y, part = psf.split(x, y, star, weight, colours(colour))
        else:
            part = star[:, None]
        stamp_paths(image, psf, weight, x, y, part, gain)
    if detector.crosstalk:
        electrons += diffuse(image, detector.crosstalk)


def colours(colour: Floats | None) -> Floats:
    """The colours of stars, which a FieldPsf needs. Raises TypeError where there are none."""
    if colour is None:
        raise TypeError("colour must be given where the image changes with it, got None")
    return colour
