"""The lens of a channel over its field: its camera, its images of points, weights of rays."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator
from scipy.ndimage import map_coordinates, shift

from startrack.core import Camera, Displacement, FieldPsf, Floats, Psf, Singles, node_places
from startrack.earth.geometry import Sensor, inside_pixel
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

FAINT = 1e-3  # largest fraction of light beyond the weights; less costs time; chosen by hand
SMEARED = 16  # instants of an exposure for the average of smear; chosen by hand
WEIGHT_NODES = 17  # nodes of weights along a side of the field; a spline between
LEFT = 2e-3  # largest fraction of a point's light in the omitted kernels; chosen by hand
# nodes along a line, increased until images between them are within the tolerance
NODES = 5, 9, 17, 33
MOST_NODES = 9  # of a matrix
UNMEASURED = 9  # nodes for a tolerance so coarse that the error is not measured
MOST_NUMBERS = 40_000_000  # largest number of values of all images at the nodes
LARGEST_ERROR = 0.1  # relative to the peak, error of an image between the nodes; chosen by hand
SETTLED = 3  # iterations that place a line at its angle; each leaves a hundredth of the error
LIGHT_NODES = 33  # nodes of the illumination along a side; a spline between them
STEP = 1.0  # pixel, step of slopes of directions


def blur_weights(psf: Psf, side: int, across: float, along: float, smear: float) -> Floats:
    """Weights of the rays of a pixel and of the pixels around it.

    The rays at the same position in all pixels form a lattice; the weights have the same sum over
    each lattice, and the total sum one. So a uniform scene does not change.

    psf      PSF of the pixels, the pixel's square included
    side     rays along each side of a pixel
    across   pixel between columns of the image: 1, or 1/2 for staggered lines
    along    pixel between its lines
    smear    pixel, motion of the ground along the track in an exposure
    Returns  (side^2, k, k) 1, k odd; lines first
    Accuracy  model: light beyond the weights, 1e-3 of the light, and haze beyond the PSF's table
              are distributed over the weights. numerical: 1 % of the modulation at Nyquist with two
              rays a side, 0.3 % with four.
    """
    half = _reach(psf, across, along, smear)
    at = (np.arange(psf.table.shape[0]) - psf.table.shape[0] // 2) / psf.oversampling
    psf_at = RegularGridInterpolator((at, at), psf.table, bounds_error=False, fill_value=0.0)
    return _even(_samples(psf_at, side, across, along, smear, half))


def smeared(psf: Psf, smear: float) -> Psf:
    """Images of points that move by `smear` pixel along the lines in an exposure."""
    room = math.ceil(smear / 2 * psf.oversampling) + 1
    table = np.pad(psf.table, room)
    late = ((np.arange(SMEARED) + 0.5) / SMEARED - 0.5) * smear * psf.oversampling
    table = np.mean([shift(table, (delay, 0.0), order=1) for delay in late], 0)
    return Psf(table, psf.oversampling, psf.energy)


def point_images(psf: Psf, place: Floats, across: float, along: float) -> Floats:
    """Images of points: fraction of each point's light in the pixels around it.

    psf            PSF of the pixels, the pixel's square and the smear included
    place          (n, 2) pixel of the image from the centre of the images, columns first
    across, along  pixel of the detector between columns and between lines of the image
    Returns        (n, k, k), k odd; lines first. Light beyond the PSF's table is lost
    Accuracy       numerical: linear between the samples of the PSF's table.
    """
    half = _reach(psf, across, along, 0.0) + 1
    middle, fine = psf.table.shape[0] // 2, psf.oversampling
    step = np.arange(-half, half + 1)
    right = (step - place[:, :1]) * (across * fine) + middle
    down = (step - place[:, 1:]) * (along * fine) + middle
    shape = len(place), len(step), len(step)
    at = [np.broadcast_to(down[:, :, None], shape), np.broadcast_to(right[:, None], shape)]
    images: Floats = map_coordinates(psf.table, at, order=1)
    return images


def _reach(psf: Psf, across: float, along: float, smear: float) -> int:
    """Pixels of the image from the centre of the weights to their edge."""
    last = psf.table.shape[0] // 2 / psf.oversampling
    return int(np.ceil(min(_radius(psf) + smear / 2, last) / min(across, along, 1.0)))


def _spline(table: Floats, oversampling: int) -> Callable[[Floats], Floats]:
    """A table at places (..., 2) pixel, rows first; tables of lenses may be coarse."""
    half = table.shape[0] // 2 / oversampling
    at = np.linspace(-half, half, table.shape[0])
    spline = RectBivariateSpline(at, at, table)

    def psf_at(place: Floats) -> Floats:
        inside = (np.abs(place) <= half).all(-1)
        return np.where(inside, spline.ev(place[..., 0], place[..., 1]), 0.0)

    return psf_at


def _samples(
    psf_at: Callable[[Floats], Floats],
    side: int,
    across: float,
    along: float,
    smear: float,
    half: int,
) -> Floats:
    """A table at the places of rays, (side^2, k, k)."""
    late = ((np.arange(SMEARED) + 0.5) / SMEARED - 0.5) * smear
    step = np.arange(-half, half + 1)
    out = np.empty((side**2, len(step), len(step)))
    for n, (x, y) in enumerate(inside_pixel(side)):
        down, right = np.meshgrid(step * along + y, step * across + x, indexing="ij")
        # The table points from the point's image to the pixel, the weights from the pixel to the
        # ray.
        out[n] = sum(psf_at(np.stack([-down - delay, -right], -1)) for delay in late)
    return out


def _even(samples: Floats) -> Floats:
    """Samples (..., side^2, k, k) as weights of the same sum over each lattice."""
    out = np.maximum(samples, 0)
    return out / out.sum((-2, -1), keepdims=True) / out.shape[-3]


class FieldBlur(NamedTuple):
    """Weights of rays that change over the field.

        image = weights_0 * scene + sum_k weights_k * (part_k scene),   * a convolution

    weights_0 is the mean over the field. The other weights have the sum zero over each lattice, so
    that they do not change a uniform scene.

    weights  (1 + k, side^2, s, s)
    parts    parts of each k, over lines and columns of the image
    lines    whether the parts change from line to line (matrix)
    left     1, bound of the fraction of a point's light in wrong pixels, because the number of
             kernels is limited
    """

    weights: Floats
    parts: tuple[RectBivariateSpline, ...]
    lines: bool
    left: float

    def strips(self, strips: Iterator[Singles]) -> Iterator[Singles]:
        """Strips (lines, columns, rays) with their parts appended as further rays."""
        first = 0
        for strip in strips:
            lines, columns, _ = strip.shape
            down = np.arange(first, first + lines) if self.lines else np.zeros(1)
            parts = [weights(down, np.arange(columns))[..., None] for weights in self.parts]
            yield np.concatenate([strip, *(strip * part.astype(np.float32) for part in parts)], 2)
            first += lines

    def blurred(self, strips: Iterator[Singles]) -> Iterator[Singles]:
        """As `blur_strips`."""
        return blur_strips(self.strips(strips), self.weights.reshape(-1, *self.weights.shape[2:]))


def field_blur(
    psf: FieldPsf,
    columns: Floats,
    rows: Floats,
    side: int,
    across: float,
    along: float,
    smear: float,
) -> FieldBlur:
    """Weights of rays by images that change over the field.

    The weights of `blur_weights` at the places of a lattice are approximated by their mean and
    their first principal components. Components are added until, at every place, the absolute
    errors of the weights sum to less than 2e-3. The image of a scene with radiance in [0, 1] then
    changes by less than 2e-3.

    columns, rows  (n,), (m,) pixel of the camera's grid at which the image has its columns and its
                   lines; one row for a scanner
    """
    many = 1 if len(rows) == 1 else WEIGHT_NODES
    x, y = np.linspace(columns[0], columns[-1], WEIGHT_NODES), np.linspace(rows[0], rows[-1], many)
    place = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    colour = float(psf.colour[0])
    coefficients = psf.at(place[:, 0], place[:, 1], np.full(len(place), colour))[:, 3:]
    some = place[:: max(1, len(place) // WEIGHT_NODES)].tolist()
    images = (psf.image(right, down, colour)[0] for right, down in [*some, place[-1].tolist()])
    half = max(_reach(image, across, along, smear) for image in images)
    splines = (_spline(image, psf.oversampling) for image in psf.table)
    given = [_samples(spline, side, across, along, smear, half) for spline in splines]
    weights = _even(np.tensordot(coefficients, np.array(given), 1))
    mean = weights.mean(0)
    off = (weights - mean).reshape(len(place), -1)
    vector = np.linalg.eigh(off @ off.T)[1][:, ::-1]
    count, left = 0, float(np.abs(off).sum(1).max())
    while left > LEFT:
        count += 1
        rest = off - vector[:, :count] @ (vector[:, :count].T @ off)
        left = float(np.abs(rest).sum(1).max())
    kernels = (vector[:, :count].T @ off).reshape(count, *mean.shape)
    # Coordinates of the image, whose first column and line are zero.
    right = np.linspace(0, len(columns) - 1, WEIGHT_NODES)
    down = np.linspace(0, len(rows) - 1, many)
    parts = tuple(_over_image(down, right, column.reshape(many, -1)) for column in vector.T[:count])
    return FieldBlur(np.concatenate([mean[None], kernels]), parts, many > 1, left)


def _over_image(down: Floats, right: Floats, values: Floats) -> RectBivariateSpline:
    """A spline over lines and columns; constant over lines for one row of nodes."""
    if len(down) == 1:
        down, values = np.arange(2.0), np.repeat(values, 2, 0)
    return RectBivariateSpline(down, right, values, kx=min(3, len(down) - 1))


def blur_strips(strips: Iterator[Singles], weights: Floats) -> Iterator[Singles]:
    """The blurred image of an unblurred one that arrives in strips.

    strips  (lines, columns, rays of a pixel) each
    Yields  (lines, columns). The total number of lines is that of the strips. The scene continues
            beyond its edges with the last line and column.
    """
    half = weights.shape[1] // 2
    buffer: Singles | None = None
    for strip in strips:
        ahead = np.repeat(strip[:1], half, 0) if buffer is None else buffer
        buffer = np.concatenate([ahead, strip])
        if len(buffer) > 2 * half:
            yield _sum(buffer, weights)
            buffer = buffer[len(buffer) - 2 * half :]
    if buffer is not None and half:
        yield _sum(np.concatenate([buffer, np.repeat(buffer[-1:], half, 0)]), weights)


def _sum(strip: Singles, weights: Floats) -> Singles:
    half = weights.shape[1] // 2
    total: Any = 0.0
    for n, row in enumerate(weights):
        rays = np.ascontiguousarray(strip[:, :, n])
        total = total + cv2.filter2D(rays, cv2.CV_32F, row, borderType=cv2.BORDER_REPLICATE)
    return total[half : len(strip) - half]


def _radius(psf: Psf) -> float:
    """Half the side, pixel, of the box that contains all light of the table except FAINT."""
    middle, total = psf.table.shape[0] // 2, psf.table.sum()
    for radius in range(psf.oversampling, middle, psf.oversampling):
        part = slice(middle - radius, middle + radius + 1)
        if psf.table[part, part].sum() > (1 - FAINT) * total:
            return radius / psf.oversampling
    return middle / psf.oversampling


class FieldLens(NamedTuple):
    """Effect of a channel's lens over its field.

    camera  directions of its pixels, with distortion, lateral colour of the band and keystone
    images  images of points: one for the whole field, or images of a lens table
    light   relative illumination, (1, columns) for a scanner's image, (rows, columns) for a matrix;
            None: uniform
    """

    camera: Camera
    images: Psf | FieldPsf
    light: Floats | None


def field_lens(
    channel: Channel,
    sensor: Sensor,
    optics: Optics,
    wavelength: Floats,
    weight: Floats,
    keystone: float = 0.0,
    half: float = 1.0,
) -> FieldLens:
    """The lens of a channel over its image.

    With a lens table, the channel's line lies in the common focal plane at the angle `forwards`
    ahead of the lens axis, and the images are of light of the channel's band. The relative
    illumination follows from the conservation of etendue,

        E / E_axis = A(direction) dOmega / (A_axis dOmega_axis)

    A is the cross-section of the beam before the lens, dOmega the solid angle of a pixel.

    sensor    sensor of the channel's geometry
    optics    optics of the channel, with the blur of its motion
    wavelength, weight  (f,) metre; (f,) 1, detected photons
    keystone  metre along the columns, outward displacement of images at the end of the line
    half      metre, half the line of the full detector
    Raises    ValueError if the lens table does not contain the field or the band, or images
              between the nodes err by more than 0.1 of the peak.
    Accuracy  model: `field_psf`, for a lens at 293.15 K; a pixel's illumination is taken at its
              centre. numerical: `images.error` is the error of images between the nodes.
    """
    detector = channel.detector
    if not optics.tabulated:
        images: Psf | FieldPsf = pixel_psf(
            optics, detector.pitch, wavelength, weight, detector.fill_factor, detector.diffusion
        )
        camera = _with_keystone(sensor.camera, keystone, half, detector.pitch)
        return FieldLens(camera, images, None)
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
    """The camera with stretched columns, so that the end of the line moves by `keystone`."""
    if not keystone:
        return camera
    places = node_places(camera.columns, camera.rows)
    shift = np.zeros_like(places) if camera.residual is None else camera.residual(places)
    shift[:, 0] += keystone / half * (places[:, 0] - camera.centre[0])
    return replace(camera, residual=_displacement(camera, shift))


def nominal(channel: Channel, sensor: Sensor) -> Camera:
    """The camera without distortion; with a lens table, the middle looks `forwards`."""
    camera = sensor.camera
    if not channel.optics.tabulated:
        return camera
    return replace(camera, principal_y=-math.tan(channel.forwards) * camera.focal_length_px)


def _ahead(
    channel: Channel, camera: Camera, optics: Optics, wavelength: Floats, weight: Floats
) -> Camera:
    """The camera that fits the lens; its middle looks `forwards` ahead of the axis."""
    pitch, ahead = channel.detector.pitch, math.tan(channel.forwards)
    columns, rows, row = camera.columns, camera.rows, (camera.rows - 1) / 2
    down = -ahead * camera.focal_length_px
    traced = optics.traced
    if not traced and open_psf_file(optics.psf_file).place is None:
        return replace(camera, principal_y=down)
    for _ in range(SETTLED if ahead else 1):
        frame = columns, rows, pitch, (0.0, down), wavelength, weight
        if traced:
            fitted = fit_camera(open_optics(optics, ROOM), *frame)
        else:
            fitted = camera_of_cube(optics, *frame)
        down -= float(fitted.project(np.array([[0.0, ahead, 1.0]]))[0, 1]) - row
    return fitted


def _images(
    channel: Channel, camera: Camera, optics: Optics, wavelength: Floats, weight: Floats
) -> FieldPsf:
    """The images of a lens table at as many nodes as their tolerance needs."""
    detector = channel.detector
    colour = np.array([weight @ wavelength / weight.sum()])
    light = weight[None], colour, detector.fill_factor, detector.diffusion
    largest = MOST_NODES if channel.kind == "matrix" else NODES[-1]
    for count in (nodes for nodes in NODES if nodes <= largest):
        if optics.traced:
            lens = open_optics(optics, ROOM)
            images = field_psf(lens, camera, detector.pitch, wavelength, *light, count)
        else:
            images = cube_psf(optics, camera, detector.pitch, wavelength, *light, count)
        numbers = 4 * len(images.x) * len(images.y) * images.table[0].size
        measured = math.isfinite(images.error)  # false with a coarse tolerance
        good = images.error <= optics.psf_tolerance if measured else count >= UNMEASURED
        if good or numbers > MOST_NUMBERS:
            break
    if images.error > LARGEST_ERROR:
        raise ValueError(
            f"images of the lens must change so slowly over the field that images between "
            f"{len(images.x)} places err by at most {LARGEST_ERROR:g} of the peak, got "
            f"{images.error:.2g}; stop the lens down, or use a smaller field"
        )
    return images if optics.lens_field else images.of_one_place(float(colour[0]))


def _illumination(channel: Channel, camera: Camera, images: FieldPsf, sensor: Sensor) -> Floats:
    """Relative illumination of the pixels of an image."""
    x = np.linspace(-0.5, camera.columns - 0.5, LIGHT_NODES)
    y = np.linspace(-0.5, camera.rows - 0.5, LIGHT_NODES)
    place = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    step = np.array([[STEP / 2, 0.0], [0.0, STEP / 2]])
    right, down = (camera.unproject(place + d) - camera.unproject(place - d) for d in step)
    solid = np.linalg.norm(np.cross(right, down), axis=1) / STEP**2
    flux = images.at(place[:, 0], place[:, 1], np.full(len(place), images.colour[0]))[:, 2]
    nominal_angle = (channel.detector.pitch / channel.optics.image_distance) ** 2
    over = (flux * solid / nominal_angle).reshape(LIGHT_NODES, LIGHT_NODES)
    columns, rows = image_pixels(channel, sensor)
    return np.asarray(RectBivariateSpline(y, x, over)(rows, columns))


def image_pixels(channel: Channel, sensor: Sensor) -> tuple[Floats, Floats]:
    """Columns and rows of an image on the camera's grid."""
    columns = np.arange(float(channel.columns)) * sensor.camera.columns / channel.columns
    if channel.kind == "matrix":
        return columns, np.arange(float(sensor.camera.rows))
    return columns, np.array([(sensor.camera.rows - 1) / 2])


def lens_registration(
    channel: Channel, camera: Camera, first: Channel, other: Camera
) -> tuple[float, float]:
    """Displacement by the lens of a channel's image relative to the image of the first channel.

    Places of the same direction are compared, in nominal pixels of each channel. Channels with
    different angles ahead are compared at the same ground.

    camera, other  cameras of the channel and of the first channel
    Returns        pixel of the channel, largest over its field: along columns, along lines
    Accuracy       model: flat ground straight below.
    """
    x, y = np.linspace(0, camera.columns - 1, LIGHT_NODES), np.array([(camera.rows - 1) / 2])
    if channel.kind == "matrix":
        y = np.linspace(0, camera.rows - 1, LIGHT_NODES)
    place = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    direction = camera.unproject(place)
    plane = direction[:, :2] / direction[:, 2:]
    plane[:, 1] += math.tan(first.forwards) - math.tan(channel.forwards)
    there = other.project(np.column_stack([plane, np.ones(len(plane))]))

    def metre(whole_line: Channel, grid: Camera, at: Floats) -> Floats:
        middle = np.array([(grid.columns - 1) / 2, (grid.rows - 1) / 2])
        return (at - middle) * (whole_line.detector.pitch / whole_line.optics.image_distance)

    away = metre(channel, camera, place) - metre(first, other, there)
    across, along = np.abs(away).max(0) * channel.optics.image_distance / channel.detector.pitch
    return float(across), float(along)
