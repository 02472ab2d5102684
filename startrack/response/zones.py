"""Case with a lens table -> how single stars are measured over the frame and over their colour."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import FieldPsf, Floats, Ints, kept
from startrack.design import Case
from startrack.observation import (
    field_psf_of,
    mean_by_colour,
    psf_of,
    sorted_wavelengths,
    sunlike_colour,
    with_images_of,
)
from startrack.optics import mirrored
from startrack.response import star_errors, star_response
from startrack.response.star_inputs import star_inputs

PLACES = 5  # zones along each side of the frame
COLOURS = 3  # classes of stars, each a third of them
# Sub-pixel positions, each with its own x and its own y: a lattice that takes the means of waves of
# one and of two a pixel along the axes and of their products, except for one pair.
POSITIONS, TURN = 5, 2
EVERY = 3  # magnitudes of `errors` between two of a zone
STILL = 1.0  # pixel of smear; chosen by hand
HALF = 0.5  # of the largest signal of a pixel, for the star whose shifts are measured
LENS_FIELD = "PSF over the field"


class Zones(NamedTuple):
    """Cells of the frame, and classes of colour; the middle of a zone stands for all of it.

    x, y    (p,), (q,) pixel, middles of the columns and of the rows of cells
    colour  (c,) metre, mean wavelength of the stars of each class
    edge    (c - 1,) metre, between two classes
    """

    x: Floats
    y: Floats
    colour: Floats
    edge: Floats

    @property
    def middles(self) -> list[tuple[float, float, float]]:
        """x, y and colour of each zone, in the order of their numbers."""
        return [
            (float(x), float(y), float(colour))
            for colour in self.colour
            for y in self.y
            for x in self.x
        ]

    def colour_class(self, colour: Floats) -> Ints:
        """The class (n,) of each colour."""
        return np.searchsorted(self.edge, colour)

    def of(self, x: Floats, y: Floats, colour: Floats) -> Ints:
        """The number (n,) of the zone of each star; beyond the frame, the nearest."""
        i, j = (
            np.clip(np.floor((at + 0.5) / (2 * (nodes[0] + 0.5))), 0, len(nodes) - 1)
            for at, nodes in ((x, self.x), (y, self.y))
        )
        number = (self.colour_class(colour) * len(self.y) + j) * len(self.x) + i
        return np.asarray(number, np.int64)


@kept(8, reads=star_inputs)
def zones_of(case: Case) -> Zones:
    """The zones of a case; kept for the 8 last cases."""
    camera = case.instrument.camera
    colour = sorted_wavelengths(case.catalog, mean_by_colour(case))
    classes = [stars for stars in np.array_split(colour, COLOURS) if len(stars)]
    if not classes:
        classes = [np.array([sunlike_colour(case.instrument)])]
    middle = (np.arange(PLACES) + 0.5) / PLACES
    return Zones(
        middle * camera.columns - 0.5,
        middle * camera.rows - 0.5,
        np.array([stars.mean() for stars in classes]),
        np.array([stars[0] for stars in classes[1:]]),
    )


@kept(8, reads=star_inputs)
def centroid_shift(case: Case) -> FieldPsf:
    """Shift of the tracker's centroid from the place that the camera projects to.

    The shift of the image, and by how much more the tracker's centroid of it is displaced than that
    of the mean image, in the mean over sub-pixel positions; measured at the nodes of the images for
    a star whose brightest pixel is half full, or fainter.

    Returns  a FieldPsf without tables: shifts and relative flux. Kept for the 8 last cases
    """
    images = field_psf_of(case.instrument)
    nodes = [
        (float(x), float(y), float(c)) for c in images.colour for y in images.y for x in images.x
    ]
    unique, which, mirror = unique_places(case, nodes)
    images_of_all = _images(case, unique)
    offset = star_response.chart(case, _typical(case), images_of_all, both_signs=False).offset[0]
    offset = np.nan_to_num(offset.reshape(len(unique) + 1, POSITIONS, 2)).mean(axis=1)
    apart = (mirror @ (offset[1:] - offset[0])[which][..., None])[..., 0]
    value = images.value[..., :3].copy()
    value[..., :2] += apart.reshape(*value.shape[:3], 2)
    return replace(images, table=np.empty((0, 1, 1)), value=value)


def focal_stretch(case: Case, colour: Floats) -> Floats:
    """Relative excess (n,) of the tracker's focal length for stars of a colour over that for
    sunlike ones.

    A least-squares fit to `centroid_shift` over the frame, as the lens was when the camera was
    calibrated. Zero where the tracker does not correct the colour.

    colour  (n,) metre
    """
    if not case.tracker.focal_length_by_colour:
        return np.zeros(len(colour))
    calibrated = replace(case.as_designed, instrument=case.calibrated)
    shift, place = centroid_shift(calibrated), _from_centre(calibrated)
    sunlike = shift.of_one_colour(sunlike_colour(calibrated.instrument))
    apart = shift.value[..., :2] - sunlike.value[..., :2]
    return shift.over_colour((apart * place).sum(axis=(1, 2, 3)) / (place**2).sum(), colour)


def _from_centre(case: Case) -> Floats:
    """The nodes (q, p, 2) of the images over the frame, pixel from the principal point."""
    images = field_psf_of(case.instrument)
    x, y = case.instrument.camera.centre
    return np.stack(np.meshgrid(images.x - x, images.y - y), axis=-1)


@kept(8, reads=star_inputs)
def residual_shift(case: Case) -> tuple[FieldPsf, FieldPsf]:
    """`centroid_shift` of a sunlike star, and what that of others differs by.

    The tracker's own correction of the star's colour is taken off. Kept for the 8 last cases.
    """
    shift = centroid_shift(with_images_of(case))
    sunlike = shift.of_one_colour(sunlike_colour(case.instrument))
    rest = shift.value.copy()
    rest[..., :2] -= sunlike.value[..., :2]
    rest[..., :2] -= focal_stretch(case, shift.colour)[:, None, None, None] * _from_centre(case)
    return sunlike, replace(shift, value=rest)


def lens_variance(case: Case, colour: Floats) -> Floats:
    """Variance per axis (n,) over the frame of `residual_shift` for stars of a colour, pixel^2.

    colour  (n,) metre
    """
    sunlike, rest = residual_shift(case)
    nodes = np.linspace(rest.colour[0], rest.colour[-1], 4 * len(rest.colour))
    x, y = (np.linspace(axis[0], axis[-1], 17) for axis in (rest.x, rest.y))
    light, down, across = (grid.ravel() for grid in np.meshgrid(nodes, y, x, indexing="ij"))
    shift = sunlike.at(across, down, light)[:, :2] + rest.at(across, down, light)[:, :2]
    variance = (shift**2).mean(axis=1).reshape(len(nodes), -1).mean(axis=1)
    return np.interp(colour, nodes, variance)


class ZoneErrors(NamedTuple):
    """Errors of single stars in z zones, at m magnitudes of sunlike stars on the axis.

    magnitude  (m,) G
    point      (u, p, side, side) 1, different images of a star at p sub-pixel positions
    which      (z,) of these images
    kept       (z, m) chance that the tracker measures a detected star and takes it for no hot pixel
    stated     (z, m, 2, 2) pixel^2, by the tracker
    random     (z, m, 2, 2) pixel^2 by cause, covariance over positions and times
    """

    magnitude: Floats
    point: Floats
    which: Ints
    kept: Floats
    stated: Floats
    random: dict[str, Floats]


@kept(8, reads=star_inputs)
def zone_errors(case: Case) -> ZoneErrors:
    """Errors of single stars in each zone; kept for the 8 last cases.

    Measured at five sub-pixel positions and at every third magnitude of `errors`, as ratios to
    those of the mean image, which are interpolated. What the tracker's centroids of a zone's image
    and of the mean image differ by, beside the mean over all positions, is the random error
    LENS_FIELD.

    Accuracy  model: noise and detection are those of the middle of the zone.
    """
    star = star_errors.errors(case)
    coarse = np.unique(np.append(np.arange(0, len(star.magnitude), EVERY), len(star.magnitude) - 1))
    magnitude = star.magnitude[coarse]
    unique, which, mirror = unique_places(case, zones_of(case).middles)
    # One sign, because only differences from the mean image count.
    images, count = _images(case, unique), len(unique) + 1
    every = star_errors.noisy_stars(case, magnitude, images, both_signs=False, groups=count)
    mean, *parts = (
        every.at(slice(k, k + POSITIONS)) for k in range(0, len(images.place), POSITIONS)
    )
    stated, shot, read, field, kept = [], [], [], [], []
    for zone in parts:
        both_stated, both_noise, both_shot = (
            (star_errors.mean_of(here, zone.kept), star_errors.mean_of(there, mean.kept))
            for here, there in (
                (zone.plain.covariance, mean.plain.covariance),
                (zone.noise, mean.noise),
                (zone.shot, mean.shot),
            )
        )
        stated.append(scaled_to_zone(star, star.stated, magnitude, *both_stated))
        shot.append(scaled_to_zone(star, star.random[star_errors.SHOT], magnitude, *both_shot))
        # Read noise alone is nearly none, of either sign, where the brightest stars saturate.
        noise = star.random[star_errors.SHOT] + star.random[star_errors.READ]
        read.append(scaled_to_zone(star, noise, magnitude, *both_noise) - shot[-1])
        apart = zone.plain.offset - mean.plain.offset
        both = np.minimum(zone.kept, mean.kept)
        moved = star_errors.moment_of(apart - star_errors.mean_of(apart, both)[:, None], both)
        field.append(_between(star.magnitude, magnitude, moved))
        ratio = zone.kept.mean(axis=1) / np.maximum(mean.kept.mean(axis=1), 1e-9)
        kept.append(np.minimum(star.kept * np.interp(star.magnitude, magnitude, ratio), 1.0))
    by_tracker, by_shot, by_read, by_field = (
        mirror[:, None] @ np.stack(covariances)[which] @ mirror[:, None].transpose(0, 1, 3, 2)
        for covariances in (stated, shot, read, field)
    )
    zones = len(which)
    random = {
        cause: np.broadcast_to(covariance, (zones, *covariance.shape))
        for cause, covariance in star.random.items()
    } | {star_errors.SHOT: by_shot, star_errors.READ: by_read, LENS_FIELD: by_field}
    point = images.point.reshape(count, POSITIONS, *images.point.shape[1:])[1:]
    return ZoneErrors(star.magnitude, point, which, np.stack(kept)[which], by_tracker, random)


def scaled_to_zone(
    star: star_errors.Errors, covariance: Floats, magnitude: Floats, zone: Floats, mean: Floats
) -> Floats:
    """Covariances (m, 2, 2) of the mean image, scaled to those of a zone.

    star        whose magnitudes the covariances are of
    zone, mean  (k, 2, 2) those of the zone and of the mean image, at a few magnitudes (k,)
    """
    size = []
    for a in (0, 1):
        ratio = np.maximum(zone[:, a, a], 1e-16) / np.maximum(mean[:, a, a], 1e-16)
        size.append(np.exp(np.interp(star.magnitude, magnitude, np.log(ratio)) / 2))
    apart = np.interp(star.magnitude, magnitude, _correlation(zone) - _correlation(mean))
    x, y = (np.sqrt(np.maximum(covariance[:, a, a], 0)) * size[a] for a in (0, 1))
    cross = np.clip(_correlation(covariance) + apart, -1, 1) * x * y
    return np.stack([x * x, cross, cross, y * y], axis=-1).reshape(-1, 2, 2)


def _correlation(covariance: Floats) -> Floats:
    size = np.maximum(covariance[:, 0, 0], 1e-16) * np.maximum(covariance[:, 1, 1], 1e-16)
    return np.asarray(np.clip(covariance[:, 0, 1] / np.sqrt(size), -1, 1))


def _between(at: Floats, magnitude: Floats, covariance: Floats) -> Floats:
    """Covariances (m, 2, 2) at other magnitudes."""
    elements = covariance.reshape(len(magnitude), 4).T
    between = [np.interp(at, magnitude, element) for element in elements]
    return np.stack(between, axis=-1).reshape(-1, 2, 2)


def zone_detection(
    case: Case, magnitude: Floats, search: star_response.StarSearch | None = None
) -> Floats:
    """Fraction (z, m) of the stars of a magnitude that pass the threshold in each zone.

    search  as for `detection_probability`
    """
    zones = zone_errors(case)
    fractions = [
        star_response.detection_probability(case, magnitude, point, search) for point in zones.point
    ]
    return np.stack(fractions)[zones.which]


def unique_places(
    case: Case, places: list[tuple[float, float, float]]
) -> tuple[list[tuple[float, float, float]], Ints, Floats]:
    """The places (x, y, colour) of which those of a frame are mirror images.

    Where the lens is centred, stars are measured alike in eight places of a frame, except for a
    smear below a pixel, whose direction is the same in all.

    Returns  them; which of them each place (n,) is; the mirror (n, 2, 2) of its displacements
    """
    instrument = case.instrument
    detector = instrument.detector
    alike = mirrored(instrument.optics, instrument.camera) and not detector.settling
    alike = alike and not detector.impulse_response
    alike = alike and star_response.smear_extent(instrument) < STILL
    centre_x, centre_y = instrument.camera.centre
    numbers: dict[tuple[float, float, float], int] = {}
    unique, which, mirror = list[tuple[float, float, float]](), [], []
    for x, y, colour in places:
        across, down = x - centre_x, y - centre_y
        matrix = np.eye(2)
        if alike:
            matrix = np.diag([-1.0 if across < 0 else 1.0, -1.0 if down < 0 else 1.0])
            across, down = abs(across), abs(down)
            if down > across:
                across, down = down, across
                matrix = matrix[:, ::-1]
        key = round(across, 6), round(down, 6), colour
        if key not in numbers:
            numbers[key] = len(unique)
            unique.append((centre_x + across, centre_y + down, colour))
        which.append(numbers[key])
        mirror.append(matrix)
    return unique, np.array(which), np.array(mirror)


@lru_cache(maxsize=1)
def _positions() -> Floats:
    step = np.arange(POSITIONS)
    return np.stack([step, step * TURN % POSITIONS], axis=-1) / POSITIONS - (1 - 1 / POSITIONS) / 2


def _images(case: Case, places: list[tuple[float, float, float]]) -> star_response.StarImages:
    """Stars at a few sub-pixel positions: of the mean image, then of each place and colour."""
    instrument, images = case.instrument, field_psf_of(case.instrument)
    side = star_response.cell_side(instrument, case.tracker.detection)
    psfs = [psf_of(instrument), *images.images(*np.array(places).T)]
    points = [star_response.star_images(instrument, _positions(), side, psf) for psf in psfs]
    every = np.tile(_positions(), (len(psfs), 1))
    return star_response.StarImages(np.concatenate(points), every)


def _typical(case: Case) -> Floats:
    """Magnitude (1,) of the star whose shifts are measured."""
    size = star_response.scale(case)
    room = max(HALF * size.largest - size.background, 1.0)
    full = -2.5 * math.log10(room / (size.star * float(star_response.point_images(case).max())))
    return np.array([max(star_errors.TYPICAL, full)])
