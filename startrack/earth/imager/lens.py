"""The lens of a channel over its field: where it looks, its images of points, its illumination."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from startrack.core import Camera, Displacement, FieldPsf, Floats, Psf, node_places
from startrack.earth.geometry import Sensor
from startrack.earth.imager.parameters import Channel
from startrack.optics import (
    ROOM,
    Optics,
    camera_of_cube,
    cube_psf,
    field_psf,
    fit_camera,
    open_optics,
    open_psf_file,
    pixel_psf,
)

NODES = 5, 9, 17, 33  # places along a line, tried until images between them err by the tolerance
MOST_NODES = 9  # of a matrix
UNMEASURED = 9  # where the tolerance is so coarse that the error is not measured
MOST_NUMBERS = 40_000_000  # of all images at the nodes
LARGEST_ERROR = 0.1  # of the peak, of an image between the nodes; chosen by hand
SETTLED = 3  # rounds in which a line comes to lie at its angle; each leaves a hundredth
LATTICE = 33  # places along a side where the illumination is computed; a spline between them
STEP = 1.0  # pixel, over which slopes of directions are taken


class FieldLens(NamedTuple):
    """What the lens of a channel does over its field.

    camera  directions of its pixels, with distortion, lateral colour of the band and keystone
    images  of points: one for the whole field, or those of a lens table
    light   relative illumination, (1, columns) of a scanner's image, (rows, columns) of a matrix;
            None: the same everywhere
    """

    camera: Camera
    images: Psf | FieldPsf
    light: Floats | None


def field_lens(
    channel: Channel, sensor: Sensor, optics: Optics, wavelength: Floats, weight: Floats,
    keystone: float = 0.0, half: float = 1.0,
) -> FieldLens:  # fmt: skip
    """The lens of a channel at all places of its image.

    With a lens table, the channel's line lies in the common focal plane where the lens sees the
    angle `forwards` ahead of its axis, and light of the channel's band makes the images. The
    relative illumination follows from the conservation of etendue,

        E / E_axis = A(direction) dOmega / (A_axis dOmega_axis)

    with A the cross-section of the beam before the lens and dOmega the solid angle of a pixel.

    sensor    of the channel's geometry
    optics    of the channel, with the blur of its motion
    wavelength, weight  (f,) metre; (f,) 1, detected photons
    keystone  metre along the columns, by which images at the end of the line lie farther out
    half      metre, half the line of the whole detector
    Raises    ValueError where the lens table does not hold the field or the band, or images between
              the nodes err by more than 0.1 of the peak.
    Accuracy  model: `field_psf`, of a lens at 293.15 K; a pixel's illumination is that at its
              middle. numerical: images between the nodes as `images.error` says.
    """
    detector = channel.detector
    if not optics.tabulated:
        images: Psf | FieldPsf = pixel_psf(
            optics, detector.pitch, wavelength, weight, detector.fill_factor, detector.diffusion
        )
        return FieldLens(
            _with_keystone(sensor.camera, keystone, half, detector.pitch), images, None
        )
    try:
        camera = _ahead(channel, sensor.camera, optics, wavelength, weight)
        images = _images(channel, camera, optics, wavelength, weight)
    except ValueError as error:
        raise ValueError(f"channel {channel.name}: {error}") from None
    places = node_places(camera.columns, camera.rows)
    colour = np.full(len(places), images.colour[0])
    shift = images.at(places[:, 0], places[:, 1], colour)[:, :2]
    seen = replace(camera, residual=_displacement(camera, shift))
    light = _illumination(channel, seen, images, sensor)
    return FieldLens(_with_keystone(seen, keystone, half, detector.pitch), images, light)


def _displacement(camera: Camera, shift: Floats) -> Displacement:
    return Displacement(camera.columns, camera.rows, tuple(shift.T.ravel().tolist()))


def _with_keystone(camera: Camera, keystone: float, half: float, pitch: float) -> Camera:
    """The camera whose columns are stretched, so that the end of the line moves by `keystone`."""
    if not keystone:
        return camera
    places = node_places(camera.columns, camera.rows)
    shift = np.zeros_like(places) if camera.residual is None else camera.residual(places)
    shift[:, 0] += keystone / half * (places[:, 0] - camera.centre[0])
    return replace(camera, residual=_displacement(camera, shift))


def nominal(channel: Channel, sensor: Sensor) -> Camera:
    """The camera without distortion; with a lens table, its middle looks `forwards`."""
    camera = sensor.camera
    if not channel.optics.tabulated:
        return camera
    return replace(camera, principal_y=-math.tan(channel.forwards) * camera.focal_length_px)


def _ahead(
    channel: Channel, camera: Camera, optics: Optics, wavelength: Floats, weight: Floats
) -> Camera:
    """The camera that fits the lens, whose middle looks `forwards` ahead of the axis."""
    pitch, ahead = channel.detector.pitch, math.tan(channel.forwards)
    columns, rows, row = camera.columns, camera.rows, (camera.rows - 1) / 2
    down = -ahead * camera.focal_length_px
    traced = optics.traced
    if not traced and open_psf_file(optics.psf_file).place is None:
        return replace(camera, principal_y=down)
    for _ in range(SETTLED if ahead else 1):
        frame = columns, rows, pitch, (0.0, down), wavelength, weight
        if traced:
            found = fit_camera(open_optics(optics, ROOM), *frame)
        else:
            found = camera_of_cube(optics, *frame)
        down -= float(found.project(np.array([[0.0, ahead, 1.0]]))[0, 1]) - row
    return found


def _images(
    channel: Channel, camera: Camera, optics: Optics, wavelength: Floats, weight: Floats
) -> FieldPsf:
    """The images of a lens table at as many nodes as their tolerance needs."""
    detector = channel.detector
    colour = np.array([weight @ wavelength / weight.sum()])
    light = weight[None], colour, detector.fill_factor, detector.diffusion
    most = MOST_NODES if channel.kind == "matrix" else NODES[-1]
    for count in (each for each in NODES if each <= most):
        if optics.traced:
            lens = open_optics(optics, ROOM)
            found = field_psf(lens, camera, detector.pitch, wavelength, *light, count)
        else:
            found = cube_psf(optics, camera, detector.pitch, wavelength, *light, count)
        numbers = 4 * len(found.x) * len(found.y) * found.table[0].size
        measured = math.isfinite(found.error)  # not with a coarse tolerance
        good = found.error <= optics.psf_tolerance if measured else count >= UNMEASURED
        if good or numbers > MOST_NUMBERS:
            break
    if found.error > LARGEST_ERROR:
        raise ValueError(
            f"the images of the lens must change so slowly over the field that those between "
            f"{len(found.x)} places err by at most {LARGEST_ERROR:g} of the peak, got "
            f"{found.error:.2g}; stop the lens down, or use a smaller field"
        )
    return found if optics.lens_field else found.of_one_place(float(colour[0]))


def _illumination(channel: Channel, camera: Camera, images: FieldPsf, sensor: Sensor) -> Floats:
    """Relative illumination of the pixels of an image."""
    x = np.linspace(-0.5, camera.columns - 0.5, LATTICE)
    y = np.linspace(-0.5, camera.rows - 0.5, LATTICE)
    place = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    step = np.array([[STEP / 2, 0.0], [0.0, STEP / 2]])
    right, down = (camera.unproject(place + d) - camera.unproject(place - d) for d in step)
    solid = np.linalg.norm(np.cross(right, down), axis=1) / STEP**2
    flux = images.at(place[:, 0], place[:, 1], np.full(len(place), images.colour[0]))[:, 2]
    nominal_angle = (channel.detector.pitch / channel.optics.image_distance) ** 2
    over = (flux * solid / nominal_angle).reshape(LATTICE, LATTICE)
    columns, rows = image_pixels(channel, sensor)
    return np.asarray(RectBivariateSpline(y, x, over)(rows, columns))


def image_pixels(channel: Channel, sensor: Sensor) -> tuple[Floats, Floats]:
    """Columns and rows of the camera's grid that an image has."""
    columns = np.arange(float(channel.columns)) * sensor.camera.columns / channel.columns
    if channel.kind == "matrix":
        return columns, np.arange(float(sensor.camera.rows))
    return columns, np.array([(sensor.camera.rows - 1) / 2])


def lens_registration(
    channel: Channel, camera: Camera, first: Channel, other: Camera
) -> tuple[float, float]:
    """How far the lens displaces the image of a channel against that of the first channel.

    Places of the same direction, as multiples of each one's nominal pixel; channels that look ahead
    by other angles are compared where each sees the same ground.

    camera, other  of both
    Returns        pixel of the channel, the largest over its field: along columns, along lines
    Accuracy       model: flat ground straight below.
    """
    x = np.linspace(0, camera.columns - 1, LATTICE)
    rows = np.linspace(0, camera.rows - 1, LATTICE) if channel.kind == "matrix" else None
    y = np.array([(camera.rows - 1) / 2]) if rows is None else rows
    place = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    direction = camera.unproject(place)
    plane = direction[:, :2] / direction[:, 2:]
    plane[:, 1] += math.tan(first.forwards) - math.tan(channel.forwards)
    there = other.project(np.column_stack([plane, np.ones(len(plane))]))

    def metre(one: Channel, grid: Camera, at: Floats) -> Floats:
        middle = np.array([(grid.columns - 1) / 2, (grid.rows - 1) / 2])
        return (at - middle) * (one.detector.pitch / one.optics.image_distance)

    away = metre(channel, camera, place) - metre(first, other, there)
    across, along = np.abs(away).max(0) * channel.optics.image_distance / channel.detector.pitch
    return float(across), float(along)
