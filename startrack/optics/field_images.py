"""Images at places and wavelengths -> the FieldPsf of a frame, and the camera that fits places."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np
import scipy

from startrack.core import Camera, FieldPsf, Floats, Psf, Refused, lagrange_weights, nm
from startrack.optics.lens_table import spline
from startrack.optics.parameters import Optics
from startrack.optics.pixel_psf import gauss_band
from startrack.optics.psf_file import FINE, PsfFile, averaged, open_psf_file
from startrack.optics.pupil import noll_to_nm

# Wavelengths of a band: errors of 0.2 % (double Gauss) and 0.7 % (Petzval) of the peak. With the
# smaller number, for designs with the tolerance COARSE, errors are 2 % and 6 %.
BAND_NODES, FEW_NODES, COARSE = 12, 6, 0.05
NODES = 5  # places along the longer side of the frame, at least four along the shorter
KEPT = 4e-3  # limit of the left-out terms, as a fraction of the norm of an image
FITTED = 48  # number of angles to which a camera is fitted
SMALLEST_SIZE = 0.1  # size of an image over its size on the axis, below which growth is refused


class FieldImagePlan(Protocol):
    """Values that all images of a frame share.

    side          samples along a side of a table
    oversampling  samples per pixel
    """

    side: int
    oversampling: int

    def image(self, away_x: float, away_y: float) -> tuple[Floats, Floats]:
        """Table (c, m, m) of each spectrum at a place (pixel from the axis); its shift (pixel) and
        relative flux, (c, 3).
        """
        ...


class ColourBand(NamedTuple):
    """Spectra as weights of a few wavelengths.

    wavelength  (n,) metre;  weight  (c, n) 1, of each spectrum, whose sum is one
    """

    wavelength: Floats
    weight: Floats


def band_of(wavelength: Floats, spectra: Floats, count: int = BAND_NODES) -> ColourBand:
    """Wavelengths whose weighted sums represent whole spectra.

    The nodes are those of a Gaussian quadrature of the mean spectrum; each spectrum is integrated
    with the polynomial through the nodes.

    wavelength  (k,) metre;  spectra  (c, k) detected photons, each on any scale
    count       of the wavelengths
    Accuracy    numerical: exact for polynomials of degree n - 1 in the wavelength.
    """
    fraction = spectra / spectra.sum(axis=1, keepdims=True)
    nodes, _ = gauss_band(wavelength, fraction.mean(axis=0), count)
    nodes = np.sort(nodes)
    return ColourBand(nodes, fraction @ lagrange_weights(nodes, wavelength))


def node_count(optics: Optics) -> int:
    """Number of wavelengths that represent a band."""
    return BAND_NODES if optics.psf_tolerance < COARSE else FEW_NODES


def refuse_band(key: str, of_file: Floats, wavelength: Floats, spectra: Floats) -> None:
    """Refuse detected light beyond the wavelengths (metre) that a file holds.

    key  key of the design that names the file
    """
    detected = (spectra > 1e-4 * spectra.max(axis=1, keepdims=True)).any(axis=0)
    first, last = wavelength[detected][[0, -1]]
    low, high = of_file[[0, -1]]
    bin_width = float(np.diff(wavelength).max(initial=0.0))
    if first < low - bin_width or last > high + bin_width:
        raise Refused(
            f"{key} must hold the wavelengths that the instrument detects, {first / nm:.0f} to "
            f"{last / nm:.0f} nm, but its file holds {low / nm:.0f} to {high / nm:.0f} nm"
        )


def camera_through(
    places: Callable[[Floats], Floats],
    last: float,
    key: str,
    columns: int,
    rows: int,
    pitch: float,
    principal: tuple[float, float],
) -> Camera:
    """The camera that best fits places over the field: focal length and three radial coefficients.

    A least-squares fit over the field to the farthest corner, weighted by area.

    places     function of field angles (n,) radian that returns (n,) metre from the axis
    last       radian, largest angle
    key        key of the design that names the file
    principal  pixel (x, y) from the centre of the array
    Raises     ValueError if the places do not reach the corner of the frame.
    """
    width, height = columns / 2 + abs(principal[0]), rows / 2 + abs(principal[1])
    corner = math.hypot(width, height) * pitch
    coarse = np.linspace(0, last, 17)
    reached = places(coarse)
    if reached[-1] < corner:
        raise Refused(
            f"{key} must reach the corner of the detector, {corner * 1e3:.4g} mm from the "
            f"axis, but its file ends at {reached[-1] * 1e3:.4g} mm "
            f"({math.degrees(last):.4g} deg)"
        )
    # Evenly over the area of the circle through the corner.
    edge = float(np.interp(corner, reached, coarse))
    angles = edge * np.sqrt((np.arange(FITTED) + 0.5) / FITTED)
    image, tangent = places(angles), np.tan(angles)
    scale = tangent[-1] ** np.arange(0, 8, 2)
    powers = tangent[:, None] ** np.arange(1, 9, 2) / scale
    coefficients = np.linalg.lstsq(powers, image, rcond=None)[0] / scale
    k1, k2, k3 = (float(coefficient) for coefficient in coefficients[1:] / coefficients[0])
    return Camera(columns, rows, float(coefficients[0]) / pitch, *principal, k1=k1, k2=k2, k3=k3)


def images_over_frame(
    plan: FieldImagePlan, optics: Optics, camera: Camera, colour: Floats, nodes: int
) -> FieldPsf:
    """The images of a plan at nodes over the frame, as sums of their principal components.

    Enough components are kept to represent every image within 4e-3 of its norm. The error between
    the nodes is measured if the tolerance of the design is below COARSE; otherwise it is NaN.

    colour  (c,) metre, mean wavelength of each spectrum of the plan
    nodes   number of nodes along the longer side of the frame
    """
    x, y = frame_nodes(camera, nodes)
    symmetric = mirrored(optics, camera)
    made: dict[tuple[float, float], tuple[Floats, Floats]] = {}

    def node(at_x: float, at_y: float) -> tuple[Floats, Floats]:
        """Table (c, m, m) and centre, flux (c, 3) of an image at a place."""
        away_x, away_y = at_x - camera.centre[0], at_y - camera.centre[1]
        if not symmetric:
            return plan.image(away_x, away_y)
        first, second = sorted((abs(away_x), abs(away_y)), reverse=True)
        key = round(first, 6), round(second, 6)
        if key not in made:
            made[key] = plan.image(first, second)
        return _reflected(*made[key], away_x, away_y)

    images = [node(float(u), float(v)) for v in y for u in x]
    tables = np.array([table for table, _ in images]).reshape(len(images) * len(colour), -1)
    basis, coefficient = _components(tables)
    centre = np.array([centre for _, centre in images]).reshape(-1, 3)
    value = np.concatenate([centre, coefficient], axis=-1).reshape(len(y), len(x), len(colour), -1)
    value = np.ascontiguousarray(value.transpose(2, 0, 1, 3))
    basis = basis.reshape(-1, plan.side, plan.side)
    made_of = FieldPsf(
        table=basis,
        oversampling=plan.oversampling,
        x=x,
        y=y,
        colour=colour,
        value=value,
        error=math.nan,
        place_error=math.nan,
    )
    if optics.psf_tolerance >= COARSE:
        return made_of
    error, place_error = _checked(made_of, plan, camera)
    return replace(made_of, error=error, place_error=place_error)


def mirrored(optics: Optics, camera: Camera) -> bool:
    """Whether each image occurs eight times in a frame, by reflection and rotation."""
    centred = camera.principal_x == camera.principal_y == 0
    if optics.psf_file:
        return centred and open_psf_file(optics.psf_file).even and not (camera.p1 or camera.p2)
    constant = any(aberration.growth == 0 for aberration in optics.aberrations)
    odd = any(noll_to_nm(aberration.noll)[1] < 0 for aberration in optics.aberrations)
    return centred and not constant and not odd


def angles_at(camera: Camera, away_x: float, away_y: float) -> tuple[float, float]:
    """Field angle and azimuth (radian) of a place, pixel from the axis."""
    place = np.array([[away_x, away_y]]) + camera.centre
    x, y, z = camera.unproject(place)[0]
    return math.atan2(math.hypot(x, y), z), math.atan2(y, x)


def frame_nodes(camera: Camera, nodes: int = NODES) -> tuple[Floats, Floats]:
    """Evenly spaced places from border to border of the frame."""
    longer, axes = max(camera.columns, camera.rows), []
    for size in (camera.columns, camera.rows):
        count = max(math.ceil((nodes - 1) * size / longer) + 1, 4)
        # The middle is one of an odd number of places, so that mirror images have common nodes.
        axes.append(np.linspace(-0.5, size - 0.5, count + 1 - count % 2))
    return axes[0], axes[1]


def _reflected(table: Floats, centre: Floats, x: float, y: float) -> tuple[Floats, Floats]:
    """The image at (x, y), by symmetry from the image at max and min of |x| and |y|."""
    centre = centre.copy()
    if abs(y) > abs(x):
        table, centre[:, :2] = table.transpose(0, 2, 1), centre[:, 1::-1]
    if x < 0:
        table, centre[:, 0] = table[:, :, ::-1], -centre[:, 0]
    if y < 0:
        table, centre[:, 1] = table[:, ::-1], -centre[:, 1]
    return table, centre


def _components(tables: Floats) -> tuple[Floats, Floats]:
    """Principal components (k, s) of tables (n, s), and their coefficients (n, k)."""
    value, vector = np.linalg.eigh(tables @ tables.T)
    value, vector = np.maximum(value[::-1], 0), vector[:, ::-1]
    # Fraction of an image's norm in each component and all later ones.
    part = value * vector**2
    rest = np.cumsum(part[:, ::-1], axis=1)[:, ::-1] / part.sum(axis=1, keepdims=True)
    left = np.sqrt(rest.max(axis=0))
    count = max(int((left > KEPT).sum()), 1)
    return vector[:, :count].T @ tables, vector[:, :count]


def _checked(psf: FieldPsf, plan: FieldImagePlan, camera: Camera) -> tuple[float, float]:
    """Error of images between the nodes, over their peak; and error of their places, pixel."""
    last_x, last_y = len(psf.x) - 1, len(psf.y) - 1
    worst = far = 0.0
    for i, j in ((0, 0), (last_x // 2, last_y // 2)):
        x = float(psf.x[i] + psf.x[min(i + 1, last_x)]) / 2
        y = float(psf.y[j] + psf.y[min(j + 1, last_y)]) / 2
        table, centre = plan.image(x - camera.centre[0], y - camera.centre[1])
        values = psf.at(np.full_like(psf.colour, x), np.full_like(psf.colour, y), psf.colour)
        made = np.tensordot(values[:, 3:], psf.table, 1)
        worst = max(worst, float(np.abs(made - table).max() / table.max()))
        far = max(far, float(np.abs(values[:, :2] - centre[:, :2]).max()))
    return worst, far


DEGREE = 3  # degree of the splines between the nodes of a file


def cube_psf(
    optics: Optics,
    camera: Camera,
    pitch: float,
    wavelength: Floats,
    spectra: Floats,
    colour: Floats,
    fill_factor: float,
    diffusion: float,
    nodes: int = NODES,
) -> FieldPsf:
    """Images of stars over the frame and over colour, from the images of a `psf_file`.

    Between its nodes, images are interpolated by cubic splines over the field angle, including
    mirror images of the nodes, and over the inverse of the wavelength. Images off the axis are
    rotated to the azimuth of the star. Arguments as for `field_psf`.

    Raises    ValueError if the file does not hold the frame or the band.
    Accuracy  numerical: that of the splines; the error between the nodes of the frame is measured.
    """
    cube = open_psf_file(optics.psf_file)
    _refuse_colours(cube, wavelength, spectra)
    band = band_of(wavelength, spectra, node_count(optics))
    plan = _FieldPlan(optics, cube, camera, pitch, band, fill_factor, diffusion)
    return images_over_frame(plan, optics, camera, colour, nodes)


def camera_of_cube(
    optics: Optics,
    columns: int,
    rows: int,
    pitch: float,
    principal: tuple[float, float],
    wavelength: Floats,
    spectrum: Floats,
) -> Camera:
    """The camera that fits the places of a `psf_file`, in light of one spectrum.

    As `fit_camera`, to the centroids of the images.
    """
    cube = open_psf_file(optics.psf_file)
    assert cube.place is not None
    _refuse_colours(cube, wavelength, spectrum[None])
    band = band_of(wavelength, spectrum[None])
    n = cube.image.shape[-1]
    at = (np.arange(n) - n // 2) * cube.spacing
    light = cube.image.sum(axis=2)
    centroid = cube.place + light @ at / light.sum(axis=-1)

    def places(angles: Floats) -> Floats:
        over_field = _over_field(cube, angles, odd=True)  # (a, f)
        return np.asarray(band.weight[0] @ (_over_colour(cube, band) @ centroid) @ over_field.T)

    return camera_through(
        places, float(cube.angle[-1]), "psf_file", columns, rows, pitch, principal
    )


def _refuse_colours(cube: PsfFile, wavelength: Floats, spectra: Floats) -> None:
    if len(cube.wavelength) > 1:
        refuse_band("psf_file", cube.wavelength, wavelength, spectra)


def _over_colour(cube: PsfFile, band: ColourBand) -> Floats:
    """Weights (n, w) of the images at the wavelengths of a band."""
    nodes = cube.wavelength
    unit = np.eye(len(nodes))
    return spline(-1 / nodes, unit, -1 / np.clip(band.wavelength, nodes[0], nodes[-1]), 0, DEGREE)


def _over_field(cube: PsfFile, angles: Floats, odd: bool = False) -> Floats:
    """Weights (a, f) of the values at field angles; the values are odd or even in the angle."""
    nodes = cube.angle
    if len(nodes) == 1:
        return np.ones((len(angles), 1))
    unit = np.eye(len(nodes))
    mirrored = np.concatenate([(-unit if odd else unit)[:0:-1], unit])
    both = np.concatenate([-nodes[:0:-1], nodes])
    return spline(both, mirrored, angles, 0, DEGREE)


def grown_psf(psf: Psf, optics: Optics, camera: Camera, x: float, y: float) -> Psf:
    """The one image of a file at a place (pixel), larger or smaller than on the axis.

        size = 1 + growth (angle / field_edge)^2, along and across the field

    An image out of focus has the shape of the pupil, and a size that is proportional to the
    distance from the focus. Third-order field curvature and astigmatism move the focus of each
    direction in proportion to the square of the field angle.

    psf       PSF on the axis
    Source    Born & Wolf, Principles of Optics, section 5.3.
    Raises    Refused if an image would have no size in the frame.
    Accuracy  model: geometrical; pixels that a measured image contains are stretched with it.
    """
    growth = np.array([optics.growth_along, optics.growth_across])
    smallest = float((1 + growth * (camera.half_diagonal / optics.field_edge) ** 2).min())
    if smallest < SMALLEST_SIZE:
        raise Refused(
            f"growth_along and growth_across must leave {SMALLEST_SIZE:g} of the image's size in "
            f"the corner of the frame, got {smallest:.3g}"
        )
    angle, azimuth = angles_at(camera, x - camera.centre[0], y - camera.centre[1])
    size = 1 + growth * (angle / optics.field_edge) ** 2
    turn = np.array(
        [[math.cos(azimuth), math.sin(azimuth)], [-math.sin(azimuth), math.cos(azimuth)]]
    )
    back = turn.T @ np.diag(1 / size) @ turn
    middle = len(psf.table) // 2
    room = math.ceil(middle * max(float(size.max()), 1.0))
    axis = np.arange(-room, room + 1)
    u, v = (row[0] * axis[None] + row[1] * axis[:, None] + middle for row in back)
    table = scipy.ndimage.map_coordinates(psf.table, [v, u], order=3)
    table *= psf.table.sum() / table.sum()
    return Psf(table, psf.oversampling, psf.energy)


class _FieldPlan:
    """Values that the images of all places share."""

    def __init__(
        self,
        optics: Optics,
        cube: PsfFile,
        camera: Camera,
        pitch: float,
        band: ColourBand,
        fill_factor: float,
        diffusion: float,
    ) -> None:
        self.found, self.camera, self.pitch, self.band = cube, camera, pitch, band
        corner = camera.half_diagonal
        last = float(cube.angle[-1])
        if len(cube.angle) > 1 and corner > last * (1 + 1e-6) + 1e-9:
            raise Refused(
                f"psf_file must hold the field to the corner of the detector, "
                f"{math.degrees(corner):.4g} deg, but ends at {math.degrees(last):.4g} deg"
            )
        self.blur = math.hypot(optics.total_blur, diffusion) / pitch
        self.pixel = math.sqrt(fill_factor)
        light = cube.image / cube.image.sum(axis=(2, 3), keepdims=True)
        if light.shape[-1] % 2 == 0:  # the middle sample is that of n // 2
            light = light[..., 1:, 1:]
        # At negative angles an image is rotated by 180 degrees: its even and odd parts.
        self.even = (light + light[..., ::-1, ::-1]) / 2
        self.odd = (light - light[..., ::-1, ::-1]) / 2
        self.over_colour = _over_colour(cube, band)
        half = light.shape[-1] // 2 * cube.spacing / pitch
        self.oversampling = FINE
        lateral = 0.0 if cube.place is None else float(np.ptp(cube.place, axis=0).max()) / pitch
        self.half = math.ceil((math.ceil(half + lateral) + 0.5) * FINE)
        more = math.ceil((self.pixel / 2 + 5 * self.blur) * FINE)
        self.room = math.ceil((self.half + more) / FINE + 0.5) * FINE + FINE // 2 + 3
        self.side = 2 * self.room + 1

    def image(self, away_x: float, away_y: float) -> tuple[Floats, Floats]:
        """Table (c, m, m) of each spectrum; its shift (pixel) and relative flux, (c, 3)."""
        cube, spectra = self.found, self.band.weight
        angle, azimuth = angles_at(self.camera, away_x, away_y)
        at = np.array([min(angle, float(cube.angle[-1]))])
        even, odd = _over_field(cube, at)[0], _over_field(cube, at, odd=True)[0]
        light = np.tensordot(even, self.even, (0, 1)) + np.tensordot(odd, self.odd, (0, 1))
        shift = np.zeros((len(spectra), 2))
        turn = np.array([math.cos(azimuth), math.sin(azimuth)])
        if cube.place is None:
            mixed = np.tensordot(spectra @ self.over_colour, light, 1)
            tables = [self._averaged(self._turned(image, 0.0, azimuth)) for image in mixed]
        else:
            radial = self.over_colour @ (cube.place @ odd)  # metre, at each wavelength
            centre = spectra @ radial
            coloured = np.tensordot(self.over_colour, light, 1)
            tables = []
            for weight, middle in zip(spectra, centre, strict=True):
                parts = [
                    w * self._turned(image, (here - middle) / self.pitch, azimuth)
                    for w, image, here in zip(weight, coloured, radial, strict=True)
                ]
                tables.append(self._averaged(np.sum(parts, axis=0)))
            shift = np.outer(centre / self.pitch, turn) - [away_x, away_y]
        return np.array(tables), np.column_stack([shift, np.ones(len(spectra))])

    def _turned(self, image: Floats, along: float, azimuth: float) -> Floats:
        """An image on the grid of the table, shifted along its x axis (pixel), then rotated."""
        axis = np.arange(-self.half, self.half + 1) / self.oversampling
        x, y = axis[None], axis[:, None]
        size = self.pitch / self.found.spacing
        middle = len(image) // 2
        u = (x * math.cos(azimuth) + y * math.sin(azimuth) - along) * size + middle
        v = (y * math.cos(azimuth) - x * math.sin(azimuth)) * size + middle
        return np.asarray(scipy.ndimage.map_coordinates(image, [v, u], order=3, mode="constant"))

    def _averaged(self, image: Floats) -> Floats:
        table = averaged(image, self.oversampling, self.pixel, self.blur)
        table = np.pad(table, self.room - len(table) // 2)
        return np.asarray(table * (self.found.energy * self.oversampling**2 / table.sum()))
