"""Optics with a lens table -> the camera that fits it, and the FieldPsf of a detector."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from startrack.core import Camera, FieldPsf, Floats, Ints, Refused, Singles
from startrack.optics import field_images, lens_table
from startrack.optics.diffraction import blur_transfer, pixel_transfer
from startrack.optics.field_images import COARSE, NODES, ColourBand, band_of, node_count
from startrack.optics.lens_family import family_table
from startrack.optics.parameters import Optics
from startrack.optics.pixel_psf import at_field
from startrack.optics.pupil import MARGIN, noll_to_nm, soft_step, zernike

ROOM = 293.15  # kelvin, default temperature of a lens
RINGS, SPOKES = 16, 24  # rings and spokes of rays for widths
GAUSS, TURNS = 7, 16  # rings and azimuths of rays of half a pupil, for centroids
STEP = 1e-5  # step for slopes, over the radius of the pupil
AIRY_BOX = 6.0  # wavelength * f-number, margin beyond the outermost ray
PER_SIGMA = 4.0  # samples per sigma of the core: interpolation has an error of 2e-5 of the peak
LEAST_CORE = 1 / 8  # pixel; a finer image is blurred to this sigma
FINEST, COARSEST = 32, 12  # samples per pixel
ROUGH = 9, 10  # samples per pixel with the tolerance COARSE
# With the tolerance COARSE: the distance in pixels beyond which light is left out, and the largest
# number of points along a side of the irradiance.
ROUGH_REACH, ROUGH_POINTS = 20.0, 900
SAMPLED = 1.025  # sampling over the least sampling for the highest distinguished frequency
PASSED = 1e-5  # transfer of a blur below which it hides aliases
ALIAS = 1.3  # least points of a transform over the points of an image, unless rough
MORE_NODES = 10  # nodes beyond the degree of a wavefront, for the sphere of a defocus
GUARD, ROUGH_GUARD = (6.0, 24), (4.0, 4)  # margin of an image: sigma of the blur, and points
LEAST_POINTS = 320  # least points of a transform
FILLED = 0.6  # largest fraction of a transform that the pupil may fill
MOST_POINTS = 3072  # most points along a side of an irradiance
MOST_NUMBERS = 60_000_000  # most numbers in all tables together
CAMERA_NODES = 25  # number of field angles for the fit of a camera
AROUND = np.linspace(0, math.pi, 49)  # radian, azimuths at which the rim of a pupil is computed
RIM_STEPS = 12  # iterations; each reduces the error to a third or less
KEPT_RAYS = 2e-3  # fraction of the light of a star that may fall outside the tables


class Lens(NamedTuple):
    """A lens table of a design: scaled to the focal length, stopped down, focused.

    optics       optics of the design; the table is scaled to its focal length
    temperature  kelvin
    """

    optics: Optics
    table: lens_table.LensTable
    temperature: float

    @property
    def scale(self) -> float:
        """Size of the lens over the traced lens."""
        return self.optics.focal_length / self.table.focal_length

    def at(self, wavelength: Floats, field: Floats) -> lens_table.LensPoints:
        """Points of the lens, in the design's size.

        A change of the stop's size scales its image in the pupil; vignetting by other apertures
        does not change. In `pupil`, the first ellipse belongs to the traced stop; the terms of the
        wavefront are functions on it. Seen from a detector that a defocus d has moved, a pupil at
        the distance 1 / c is smaller by the factor 1 + c d.

        Raises  ValueError if the table does not contain these values.
        """
        traced = self.table.at(self.temperature, wavelength, field)
        size, opening = self.scale, self.table.f_number / self.optics.f_number
        stop, clear = traced.pupil[..., :3], traced.pupil[..., 3:]
        low = np.maximum(clear[..., 0] - clear[..., 1], stop[..., 0] - opening * stop[..., 1])
        high = np.minimum(clear[..., 0] + clear[..., 1], stop[..., 0] + opening * stop[..., 1])
        across = np.minimum(clear[..., 2], opening * stop[..., 2])
        if not (high > low).all():
            raise Refused("f_number must leave the pupil open over the field of lens_file")
        used = np.stack([(low + high) / 2, (high - low) / 2, across], axis=-1)
        outline, area = traced.outline, traced.area
        if opening < 1:
            outline = _stopped(stop * (1, opening, opening), clear, traced.outline, used)
            area = area * (_rim_area(used, outline) / _rim_area(clear, traced.outline))
        curvature = traced.curvature / size
        nearer = 1 + curvature[..., None] * self.optics.defocus
        return lens_table.LensPoints(
            wavefront=traced.wavefront * size,
            place=traced.place * size,
            pupil=np.concatenate([stop, used], axis=-1) / nearer,
            outline=outline,
            area=area * size**2,
            amplitude=traced.amplitude,
            curvature=curvature,
        )

    def defocus(self, curvature: Floats) -> Floats:
        """Metre: change of the wavefront by a detector moved by d, times sqrt(1 - p^2 - q^2).

            d (1 + c d) = (p^2 + q^2) / 2 over the difference of the spheres' curvatures

        The curvatures are c and c / (1 + c d), at the same point of the pupil.

        curvature  (n, m) 1 / metre, c
        """
        moved = self.optics.defocus
        return np.asarray(moved * (1 + curvature * moved))


def _stopped(stop: Floats, clear: Floats, outline: Floats, used: Floats) -> Floats:
    """The outline of the area common to the ellipse `stop` and the pupil with `outline`.

    The result is relative to the ellipse `used`, `outline` to the ellipse `clear`. Each ellipse is
    (n, m, 3), each outline (n, m, h).
    """
    if not outline.shape[-1]:
        return outline
    distance = np.ones((*outline.shape[:-1], len(AROUND)))

    def within(ellipse: Floats) -> tuple[Floats, Floats]:
        centre, half_p, half_q = np.moveaxis(ellipse, -1, 0)[..., None]
        p = used[..., :1] + distance * used[..., 1:2] * COSINES
        return (p - centre) / half_p, distance * used[..., 2:] * SINES / half_q

    for _ in range(RIM_STEPS):
        distance /= np.maximum(
            lens_table.rim_distance(outline, *within(clear)), np.hypot(*within(stop))
        )
    return lens_table.rim_harmonics(distance * COSINES, distance * SINES, outline.shape[-1])


def _rim_area(ellipse: Floats, outline: Floats) -> Floats:
    """Area (n, m) of a pupil, in direction cosines squared."""
    if not outline.shape[-1]:
        return np.asarray(math.pi * ellipse[..., 1] * ellipse[..., 2])
    # The mean of the square of 1 + sum_k outline_k cos(k a).
    mean = (1 + outline[..., 0]) ** 2 + (outline[..., 1:] ** 2).sum(axis=-1) / 2
    return np.asarray(math.pi * ellipse[..., 1] * ellipse[..., 2] * mean)


def open_optics(optics: Optics, temperature: float = ROOM) -> Lens:
    """The lens of a design.

    Raises  ValueError if there is no such table, or if the design's aperture is wider than traced.
    """
    if optics.lens_family:
        table = family_table(optics.lens_family, optics.f_number, optics.family_field)
    else:
        table = lens_table.open_lens(optics.lens_file)
    if optics.f_number < table.f_number * (1 - 1e-6):
        raise Refused(
            f"f_number must be at least {table.f_number:g}, that of the lens table of "
            f"{table.name}, got {optics.f_number:g}"
        )
    return Lens(optics, table, temperature)


@dataclass(frozen=True, eq=False)
class _Star:
    """A star at one wavelength through a lens; p runs along the radius.

    extra       optics of the design, with the aberrations that it adds at this field angle
    wavelength  metre
    azimuth     radian, of the star's image on the detector
    power       (i, j) metre, coefficients of u^i v^(2 j) of the table's wavefront
    amplitude   (i, j) 1, coefficients of the amplitude; empty if the amplitude is uniform
    defocus     metre, `Lens.defocus`
    """

    lens: Lens
    extra: Optics
    wavelength: float
    azimuth: float
    power: Floats
    place: float
    pupil: Floats
    outline: Floats
    area: float
    amplitude: Floats
    defocus: float

    def path(self, p: lens_table.Reals, q: lens_table.Reals) -> lens_table.Reals:
        """W(p, q) of the table, with focus and added aberrations."""
        u, v = self._in_stop(p, q)
        total = _polynomial(self.power, u, v * v)
        if self.defocus:
            total += self.defocus * np.sqrt(1 - p * p - q * q)
        if self.extra.aberrations:
            opening = self.lens.table.f_number / self.lens.optics.f_number
            u, v = u / opening, v / opening
            cosine, sine = math.cos(self.azimuth), math.sin(self.azimuth)
            x, y = u * cosine - v * sine, u * sine + v * cosine
            for aberration in self.extra.aberrations:
                total += aberration.rms * zernike(aberration.noll, x, y)
        return total

    def light(self, p: Floats, q: Floats) -> Floats:
        """A(p, q) of the table."""
        if not self.amplitude.size:
            return np.ones_like(p)
        u, v = self._in_stop(p, q)
        return np.asarray(_polynomial(self.amplitude, u, v * v), float)

    def _in_stop(self, p: Any, q: Any) -> tuple[Any, Any]:
        """The coordinates in the image of the stop."""
        centre, half_p, half_q = self.pupil[:3].tolist()  # numbers of Python keep the type of p
        return (centre - p) / half_p, q / -half_q

    def path_over_square(self, coordinate: Floats, u: float, v: float) -> Floats:
        """`path` to points near a position in the image, over the square of the pupil.

        coordinate  (n,) rising, direction cosines from the middle of the pupil, along the columns
                    and the rows of the detector
        u, v        metre, position in the image, along the radius and across it
        Returns     (n, n) metre
        """
        added = [noll_to_nm(aberration.noll)[0] for aberration in self.extra.aberrations]
        degree = max([self.power.shape[0] - 1, *added])

        def path(p: Floats, q: Floats) -> Floats:
            return self.path(p, q) + p * (u - self.place) + q * v

        return self._over_square(coordinate, degree + MORE_NODES, path)

    def light_over_square(self, coordinate: Singles) -> Singles:
        """`light` over the pupil's square, (n, n)."""
        return self._over_square(coordinate, len(self.amplitude), self.light)

    def _over_square(
        self, coordinate: lens_table.Reals, nodes: int, values: Callable[[Floats, Floats], Floats]
    ) -> NDArray[Any]:
        """A product of polynomials along both sides, through Chebyshev nodes."""
        node, through = _chebyshev(nodes)
        extent = float(np.abs(coordinate).max())
        x, y = node * extent, node[:, None] * extent
        cosine, sine = math.cos(self.azimuth), math.sin(self.azimuth)
        p, q = self.pupil[3] - (x * cosine + y * sine), x * sine - y * cosine
        at_nodes: NDArray[Any] = values(p.ravel(), q.ravel()).reshape(p.shape)
        weight: NDArray[Any] = (
            np.polynomial.chebyshev.chebvander(coordinate / extent, len(node) - 1) @ through
        )
        at_nodes, weight = at_nodes.astype(coordinate.dtype), weight.astype(coordinate.dtype)
        return np.asarray(weight @ at_nodes @ weight.T)

    def open_pupil(self, coordinate: Singles, cell: float) -> tuple[Singles, Ints]:
        """Transmission of the points of the pupil with light, soft at the rim; and their indices.

        coordinate, cell  coordinates of a square as in `path_over_square`, and their spacing
        """
        cosine, sine = np.float32(math.cos(self.azimuth)), np.float32(math.sin(self.azimuth))
        half_p, half_q = (np.float32(half) for half in self.pupil[4:])
        column = coordinate[:, None]
        # The direction cosines from the centre, in half axes.
        a = coordinate * (-cosine / half_p) + column * (-sine / half_p)
        b = coordinate * (sine / half_q) - column * (cosine / half_q)
        square = a * a + b * b
        soft = MARGIN * cell / float(min(half_p, half_q))
        near = np.flatnonzero(square < (1 / self.around.min() + soft) ** 2)
        a, b, square = a.ravel()[near], b.ravel()[near], square.ravel()[near]
        opened = np.ones_like(square)
        edge = np.flatnonzero(square > max(1 / self.around.max() - soft, 0) ** 2)
        a, b = a[edge], b[edge]
        rim = lens_table.rim_distance(self.outline, a, b)
        # For an ellipse, the gradient of the distance is this over the distance itself.
        steep = np.hypot(a / half_p, b / half_q)
        opened[edge] = soft_step((rim - 1) * (a * a + b * b) / (rim * steep * np.float32(cell)))
        return opened, near

    @cached_property
    def rays(self) -> tuple[Floats, Floats, Floats]:
        """Points (metre from `place`) where rays of the whole pupil meet the detector; weights.

        The weights are the light of the rays; their sum is one.
        """
        return self._rays(*EVEN)

    def _rays(self, u: Floats, v: Floats, weight: Floats) -> tuple[Floats, Floats, Floats]:
        """`rays` at places (n,) of the unit disk."""
        centre, half_p, half_q = self.pupil[3:]
        farther = np.hypot(u, v) / lens_table.rim_distance(self.outline, u, v)
        p, q = centre + half_p * u * farther, half_q * v * farther
        step_p, step_q = STEP * half_p, STEP * half_q
        # One call for the four shifted sets of rays.
        path = self.path(
            np.concatenate([p + step_p, p - step_p, p, p]),
            np.concatenate([q, q, q + step_q, q - step_q]),
        ).reshape(4, -1)
        x, y = (path[1] - path[0]) / (2 * step_p), (path[3] - path[2]) / (2 * step_q)
        weight = weight * (farther * self.light(p, q)) ** 2
        return x, y, weight / weight.sum()

    @cached_property
    def centroid(self) -> tuple[float, float]:
        """Centroid of the star's light: along the radius from the axis and across it, metre."""
        x, y, weight = self._rays(*GAUSSIAN)
        return self.place + float(x @ weight), float(y @ weight)

    @cached_property
    def radius(self) -> float:
        """Largest distance from the centre of the pupil to its rim, 1."""
        return float(max(self.pupil[4], self.pupil[5])) / float(self.around.min())

    @cached_property
    def around(self) -> Floats:
        """Distance of the ellipse from the centre over that of the rim, in the directions
        AROUND."""
        return np.asarray(lens_table.rim_distance(self.outline, COSINES, SINES), float)


def _disk(square: Floats, weight: Floats, spokes: int) -> tuple[Floats, Floats, Floats]:
    """Places (n,) on rings of the unit disk with given squared radii and weights; and weights."""
    azimuth = (np.arange(spokes) + 0.5) * (2 * math.pi / spokes)
    radius = np.sqrt(square)[:, None]
    x, y = radius * np.cos(azimuth), radius * np.sin(azimuth)
    return x.ravel(), y.ravel(), np.repeat(weight, spokes)


@lru_cache(maxsize=8)
def _chebyshev(count: int) -> tuple[Floats, Floats]:
    """Nodes (n,) in [-1, 1], and the matrix (n, n) from values at the nodes to polynomial terms."""
    turn = (np.arange(count) + 0.5) * math.pi / count
    through = np.cos(np.outer(np.arange(count), turn)) * (2 / count)
    through[0] /= 2
    return np.cos(turn), through


EVEN = _disk((np.arange(RINGS) + 0.5) / RINGS, np.ones(RINGS), SPOKES)  # of equal weight
NODE, WEIGHT = np.polynomial.legendre.leggauss(GAUSS)
GAUSSIAN = _disk((1 + NODE) / 2, WEIGHT, TURNS)  # exact for polynomials of degree 15
COSINES, SINES = np.cos(AROUND), np.sin(AROUND)


def _polynomial(power: Floats, u: lens_table.Reals, w: lens_table.Reals) -> lens_table.Reals:
    """Sum of power[..., i, j] u^i w^j of u and w (..., n), by Horner's rule."""
    degree, squares = power.shape[-2:]
    total = np.zeros_like(u)
    terms = np.moveaxis(power, (-2, -1), (0, 1))[..., None].astype(u.dtype)
    for j in range(squares - 1, -1, -1):
        inner = np.zeros_like(u)
        for i in range(degree - 1, -1, -1):
            if i + 2 * j < degree:
                inner *= u
                inner += terms[i, j]
        total *= w
        total += inner
    return total


@lru_cache(maxsize=8)
def _powers(noll: tuple[int, ...]) -> Floats:
    """(k, i, j) coefficients of u^i v^(2 j) of Zernike polynomials that are even in v."""
    degree = max(noll_to_nm(j)[0] for j in noll)
    table = np.zeros((len(noll), degree + 1, degree // 2 + 1))
    for row, index in enumerate(noll):
        n, m = noll_to_nm(index)
        size = math.sqrt((n + 1) * (2 if m else 1))
        for s in range((n - m) // 2 + 1):
            # The term rho^(n - 2 s), of which rho^m cos(m theta) is Re (u + i v)^m.
            radial = (
                (-1) ** s
                * math.factorial(n - s)
                / (
                    math.factorial(s)
                    * math.factorial((n + m) // 2 - s)
                    * math.factorial((n - m) // 2 - s)
                )
            )
            squares = (n - m) // 2 - s
            for a in range(squares + 1):
                for b in range(m // 2 + 1):
                    table[row, 2 * (squares - a) + m - 2 * b, a + b] += (
                        size * radial * math.comb(squares, a) * math.comb(m, 2 * b) * (-1) ** b
                    )
    return table


def _power_series(
    table: lens_table.LensTable, points: lens_table.LensPoints
) -> tuple[Floats, Floats]:
    """Coefficients (n, m, i, j) of u^i v^(2 j) of the wavefront (metre) and of the amplitude.

    A uniform amplitude has an empty array.
    """
    noll = tuple(table.noll.tolist())
    wavefront = np.tensordot(points.wavefront, _powers(noll), 1)
    terms = points.amplitude.shape[-1]
    if not terms:
        return wavefront, np.empty((*points.place.shape, 0, 0))
    amplitude = np.tensordot(points.amplitude, _powers(noll[:terms]), 1)
    amplitude[..., 0, 0] += 1
    return wavefront, amplitude


def lens_stars(lens: Lens, wavelength: Floats, field: float, azimuth: float) -> list[_Star]:
    """A star of a field angle at each wavelength."""
    points = lens.at(wavelength, np.array([field]))
    power, amplitude = _power_series(lens.table, points)
    defocus, extra = lens.defocus(points.curvature), lens.optics
    if extra.aberrations:
        extra = at_field(extra, field * math.cos(azimuth), field * math.sin(azimuth))
    return [
        _Star(
            lens=lens,
            extra=extra,
            wavelength=float(length),
            azimuth=azimuth,
            power=power[j, 0],
            place=float(points.place[j, 0]),
            pupil=points.pupil[j, 0],
            outline=points.outline[j, 0],
            area=float(points.area[j, 0]),
            amplitude=amplitude[j, 0],
            defocus=float(defocus[j, 0]),
        )
        for j, length in enumerate(wavelength)
    ]


def fit_camera(
    lens: Lens,
    columns: int,
    rows: int,
    pitch: float,
    principal: tuple[float, float],
    wavelength: Floats,
    spectrum: Floats,
) -> Camera:
    """The camera that fits the lens best in light of one spectrum: a perfect calibration.

    Focal length and radial coefficients are a least-squares fit to the centroids of stars over the
    field to the farthest corner, weighted by area; the design's own aberrations are left out.

    principal  pixel (x, y) from the centre of the array
    Raises     ValueError if the table does not reach the corner of the frame, or the band.
    Accuracy   the residual of the four coefficients is in the images of a frame: the shift of
               `field_psf`.
    """
    field_images.refuse_band("lens_file", lens.table.wavelength, wavelength, spectrum[None])
    band = band_of(wavelength, spectrum[None], node_count(lens.optics))
    last = float(lens.table.field[-1])
    nodes = np.linspace(0, last, CAMERA_NODES)
    points = lens.at(band.wavelength, nodes)
    flux = band.weight[0][:, None] * points.area
    centroid = (flux * _centroids(lens, points)).sum(axis=0) / flux.sum(axis=0)
    mirrored = np.concatenate([-nodes[:0:-1], nodes]), np.concatenate([-centroid[:0:-1], centroid])

    def places(angles: Floats) -> Floats:
        return lens_table.spline(*mirrored, angles, 0)

    return field_images.camera_through(places, last, "lens_file", columns, rows, pitch, principal)


def _centroids(lens: Lens, points: lens_table.LensPoints) -> Floats:
    """Centroids (n, m) of stars along the radius, metre, without the design's aberrations."""
    power, amplitude = _power_series(lens.table, points)
    centre, half_p, half_q, middle, open_p, open_q = np.moveaxis(points.pupil, -1, 0)[..., None]
    u, v, weight = GAUSSIAN
    farther = np.hypot(u, v) / lens_table.rim_distance(
        points.outline, *np.broadcast_arrays(u, v, middle)[:2]
    )
    p, q = middle + open_p * u * farther, open_q * v * farther
    # A ray meets the detector at -dW/dp.
    along = power[..., 1:, :] * np.arange(1.0, power.shape[-2])[:, None]
    in_stop = (centre - p) / half_p, (q / half_q) ** 2
    x = _polynomial(along, *in_stop) / half_p
    x += lens.defocus(points.curvature)[..., None] * p / np.sqrt(1 - p * p - q * q)
    light = _polynomial(amplitude, *in_stop) if amplitude.size else 1.0
    weight = weight * (farther * light) ** 2
    return np.asarray(points.place + (x * weight).sum(axis=-1) / weight.sum(axis=-1))


def field_psf(
    lens: Lens,
    camera: Camera,
    pitch: float,
    wavelength: Floats,
    spectra: Floats,
    colour: Floats,
    fill_factor: float = 1.0,
    diffusion: float = 0.0,
    nodes: int = NODES,
) -> FieldPsf:
    """Images of stars over the frame and over their colour.

    For each node of a grid over the frame, and each of some spectra, the image is the sum of the
    irradiances of some wavelengths, each centred on its rays, shifted by the lateral colour and
    averaged over pixels. The images of all nodes are written as sums of their principal components;
    enough components are kept for every image within 4e-3 of its norm.

    camera       to which the shifts refer
    pitch        metre, side of a pixel
    wavelength   (k,) metre
    spectra      (c, k) detected photons per bin of stars of rising `colour`
    colour       (c,) metre, mean wavelength of each
    fill_factor, diffusion  as in `pixel_psf`
    nodes        along the longer side of the frame, between which images are interpolated
    Raises       ValueError if the table does not hold the frame or the band, or if the aberrations
                 need more than 3072 points across the image.
    Accuracy     model: the integral of LensTable. numerical: the error between the nodes is
                 measured at the places farthest from them, and returned. If the tolerance is
                 COARSE, this error is NaN. Then 0.3 % of the light (the outermost rings) may be
                 spread evenly over the image instead of lying beyond it, and light beyond 20 pixels
                 is left out. This changes the budget of a tracker by less than 0.2 %.
    """
    field_images.refuse_band("lens_file", lens.table.wavelength, wavelength, spectra)
    band = band_of(wavelength, spectra, node_count(lens.optics))
    plan = LensImages(lens, camera, pitch, band, fill_factor, diffusion)
    return field_images.images_over_frame(plan, lens.optics, camera, colour, nodes)


class LensImages:
    """Values that all images share.

    rough          whether the tolerance of the design is COARSE
    side_of_pixel  metre, side of the active square of a pixel
    blur           metre, sigma of the Gaussian blur of all images
    oversampling   samples per pixel of a table
    side           samples along a side of a table
    fine           points of an irradiance per sample
    spacing        metre between two points
    margin         number of points between the edge of an irradiance and the first sample
    count          number of points along a side of an irradiance
    """

    def __init__(
        self,
        lens: Lens,
        camera: Camera,
        pitch: float,
        band: ColourBand,
        fill_factor: float,
        diffusion: float,
    ) -> None:
        self.lens, self.camera, self.pitch, self.band = lens, camera, pitch, band
        self.side_of_pixel = pitch * math.sqrt(fill_factor)
        self._known = dict[tuple[float, float], list[_Star]]()
        self.rough = lens.optics.psf_tolerance >= COARSE
        places = self._extreme_places()
        stars = [star for u, v in places for star in self.stars(u, v)]
        fastest = min(1 / (2 * star.radius) for star in stars)
        self.blur, core = self._blurred(math.hypot(lens.optics.total_blur, diffusion), fastest)
        # The narrower axis of an ellipse makes the wider image.
        f_number = max(1 / (2 * float(min(star.pupil[4:6]))) for star in stars)
        airy = AIRY_BOX * float(band.wavelength.max()) * f_number
        spread, shift = max(self._spread(u, v) for u, v in places), self._lateral(places)
        extent = (airy + 4 * self.blur + spread + shift) / pitch
        points = self._points_per_pixel(fastest)
        if self.rough:  # pixels average finer details of a wide image
            extent = min(extent, ROUGH_REACH)
            points = min(points, ROUGH_POINTS / (2 * extent + 2))
        self.oversampling = sampling = self._sampling(core, points, extent)
        half = math.ceil((math.ceil(max(extent, 1.0)) + 0.5) * sampling) + 3
        self.side, self.fine = 2 * half + 1, math.ceil(points / sampling)
        self.spacing = pitch / sampling / self.fine
        sigmas, more = ROUGH_GUARD if self.rough else GUARD
        around = self.side_of_pixel / 2 + sigmas * self.blur + shift
        self.margin = math.ceil(around / self.spacing) + more
        self.count = 2 * (half * self.fine + self.margin) + 1
        if self.count > MOST_POINTS:
            self._refuse_points(self.count, spread)

    def _extreme_places(self) -> list[tuple[float, float]]:
        """Places (pixel from the axis) with the widest images: the corners, and the axis."""
        columns, rows = (nodes[[0, -1]] for nodes in field_images.frame_nodes(self.camera))
        x, y = self.camera.centre
        corners = [(u - x, v - y) for u in columns for v in rows]
        if field_images.mirrored(self.lens.optics, self.camera):
            corners = corners[-1:]
        return [*corners, (0.0, 0.0), (corners[-1][0] / 2, corners[-1][1] / 2)]

    def _blurred(self, blur: float, fastest: float) -> tuple[float, float]:
        """The blur (metre), enlarged so that the finest core is wide enough; and this core.

        fastest  least f-number of all stars
        """
        core = math.hypot(0.45 * float(self.band.wavelength.mean()) * fastest, blur)
        least = LEAST_CORE * self.pitch
        if core < least:
            return math.sqrt(blur**2 + least**2 - core**2), least
        return blur, core

    def _points_per_pixel(self, fastest: float) -> float:
        """Number of points of an irradiance per pixel.

        With it, of two aliased frequencies either the higher one is beyond the cutoff of the lens,
        or the lower one is hidden by the blur.
        """
        highest = 1 / (float(self.band.wavelength.min()) * fastest)
        passed = math.sqrt(-math.log(PASSED) / 2) / math.pi / max(self.blur, 1e-12)
        return SAMPLED * (highest + min(highest, passed)) * self.pitch

    def _sampling(self, core: float, points: float, extent: float) -> int:
        """Samples per pixel of a table; extent, pixel, is half its side."""
        sampling = int(np.clip(math.ceil(PER_SIGMA * self.pitch / core), COARSEST, FINEST))
        if self.rough:
            sampling = min(
                ROUGH, key=lambda samples: (samples * math.ceil(points / samples), samples)
            )
        tables = NODES**2 * len(self.band.weight)
        while sampling > COARSEST and tables * (2 * (extent + 1) * sampling) ** 2 > MOST_NUMBERS:
            sampling -= 1
        return sampling

    @staticmethod
    def _refuse_points(count: float, spread: float) -> NoReturn:
        """Refuse an image with too many points a side, whose rays spread `spread` metre."""
        raise Refused(
            f"the images of lens_file must fit {MOST_POINTS} points a side, got {count:.0f}: "
            f"rays spread over {spread * 1e6:.0f} um; focus the lens, stop it down or use a "
            "smaller field"
        )

    def stars(self, away_x: float, away_y: float) -> list[_Star]:
        """A star at each wavelength, which the camera projects to a place (pixel from the axis)."""
        place = away_x, away_y
        if place not in self._known:
            field, azimuth = field_images.angles_at(self.camera, *place)
            field = min(field, float(self.lens.table.field[-1]))
            self._known[place] = lens_stars(self.lens, self.band.wavelength, field, azimuth)
        return self._known[place]

    def _spread(self, away_x: float, away_y: float) -> float:
        """Metre: radius outside which KEPT_RAYS of the light meets the detector."""
        x, y, share = np.array([star.rays for star in self.stars(away_x, away_y)]).swapaxes(0, 1)
        middle_x, middle_y = ((at * share).sum(axis=1)[:, None] for at in (x, y))
        radius = np.hypot(x - middle_x, y - middle_y).ravel()
        order = np.argsort(radius)
        light = np.maximum(self.band.weight, 0)
        weight = (light[:, :, None] * share).reshape(len(light), -1)[:, order]
        inside = np.cumsum(weight, axis=1) <= (1 - KEPT_RAYS) * weight.sum(axis=1, keepdims=True)
        return float(radius[order][np.minimum(inside.sum(axis=1), len(order) - 1)].max())

    def _lateral(self, away: list[tuple[float, float]]) -> float:
        """Metre: largest distance of a wavelength's centroid from the common centroid."""
        places = ([star.centroid[0] for star in self.stars(*place)] for place in away)
        return max(float(np.ptp(place)) for place in places)

    def image(self, away_x: float, away_y: float) -> tuple[Floats, Floats]:
        """Table (c, m, m) of each spectrum; its shift (pixel) and relative flux, (c, 3)."""
        stars = self.stars(away_x, away_y)
        azimuth, optics = stars[0].azimuth, self.lens.optics
        x, y = np.array([star.centroid for star in stars]).T
        flux = self.band.weight * (np.array([star.area for star in stars]) / optics.area)
        total = flux.sum(axis=1)
        along, across = flux @ x / total, flux @ y / total
        # All wavelengths about the centre of the first spectrum, then each spectrum about its own
        # centre.
        planes = np.array([self._irradiance(star, along[0], across[0]) for star in stars])
        sums = np.tensordot((flux / total[:, None]).astype(np.float32), planes, 1)
        cosine, sine = math.cos(azimuth), math.sin(azimuth)
        middle_x, middle_y = along * cosine - across * sine, along * sine + across * cosine
        tables = [
            self._pixels((middle_y[0] - v) / self.spacing)
            @ plane
            @ self._pixels((middle_x[0] - u) / self.spacing).T
            for plane, u, v in zip(sums, middle_x, middle_y, strict=True)
        ]
        centre = np.column_stack(
            [middle_x / self.pitch - away_x, middle_y / self.pitch - away_y, total]
        )
        return np.array(tables, float), centre

    def _irradiance(self, star: _Star, u: float, v: float) -> Singles:
        """Irradiance of one wavelength about a place (metre, along the radius and across it).

        Its integral is one. It is a fast transform of the pupil. The samples of the pupil depend on
        the wavelength, so that the points of the image are always `spacing` apart.
        """
        x, y, _ = star.rays
        far = float(np.hypot(star.place + x - u, y - v).max()) / self.spacing
        # Light beyond the period is aliased to the other side, outside the image.
        size = max(far + self.count / 2, LEAST_POINTS)
        if not self.rough:
            size = max(size, ALIAS * self.count)
        if size > MOST_POINTS:
            self._refuse_points(size, far * self.spacing)
        wavelength, radius = star.wavelength, star.radius
        # The samples of the pupil must fit, with their soft edge.
        fine = math.ceil(2 * radius * self.spacing / (FILLED * wavelength))
        size = int(fft.next_fast_len(math.ceil(size * fine)))
        cell = wavelength * fine / (size * self.spacing)
        half = math.ceil(radius / cell) + MARGIN
        coordinate = cell * np.arange(-float(half), half)
        path = star.path_over_square(coordinate, u, v)
        single = coordinate.astype(np.float32)
        opened, near = star.open_pupil(single, cell)
        light = opened
        if star.amplitude.size:
            amplitude = star.light_over_square(single).ravel()[near]
            opened = opened * amplitude
            light = opened * amplitude
        phase = path.ravel()[near] / wavelength
        phase = ((phase - np.rint(phase)) * (2 * math.pi)).astype(np.float32)
        pupil = np.zeros(4 * half * half, np.complex64)
        pupil.real[near], pupil.imag[near] = opened * np.cos(phase), opened * np.sin(phase)
        # The image's y runs down, and its x along the columns, as the coordinates of the pupil.
        middle = (np.arange(self.count) - self.count // 2) * fine % size
        lines = fft.fft(pupil.reshape(2 * half, 2 * half), size, axis=1)[:, middle]
        field = fft.fft(lines, size, axis=0)[middle]
        unit = (cell / wavelength) ** 2 / float(light.sum())
        return np.asarray((field.real**2 + field.imag**2) * np.float32(unit))

    @cached_property
    def size(self) -> int:
        """Points along a side of its transform."""
        more = math.ceil((self.side_of_pixel / 2 + 6 * self.blur) / self.spacing)
        return int(fft.next_fast_len(self.count + more, real=True))

    def _pixels(self, shift: float) -> Singles:
        """Weights (m, n) of the points of an image along an axis for the samples of its table.

        shift  points, by which the image is moved
        """
        frequency = fft.rfftfreq(self.size, self.spacing)
        transfer = pixel_transfer(frequency, self.side_of_pixel)
        transfer = transfer * blur_transfer(frequency, self.blur)
        turned = np.exp(-2j * np.pi * shift * self.spacing * frequency)
        line = fft.irfft(transfer * turned, self.size) * self.pitch
        at = np.arange(self.margin, self.count - self.margin, self.fine)
        return np.asarray(line[at[:, None] - np.arange(self.count)], np.float32)
