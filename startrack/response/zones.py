"""Case with a lens table -> errors of single stars, by place in the frame and by colour."""

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
from startrack.response.star_inputs import star_inputs, unmapped_inputs

PLACES = 5  # zones along each side of the frame
COLOURS = 3  # classes of colour, each with a third of the stars
# Sub-pixel positions, with different x and different y. Means over this lattice are exact for waves
# of one and of two periods in a pixel along the axes, and for their products except one pair.
POSITIONS, TURN = 5, 2
EVERY = 3  # a zone uses every third magnitude of `errors`
STILL = 1.0  # pixel of smear, below which mirror images of a zone are equal; by hand
HALF = 0.5  # brightest pixel of the star whose shifts are measured, over the largest signal
LENS_FIELD = "PSF over the field"


class Zones(NamedTuple):
    """Cells of the frame, and classes of colour; the middle of a zone represents the whole zone.

    x, y    (p,), (q,) pixel, middles of the columns and of the rows of cells
    colour  (c,) metre, mean wavelength of the stars of each class
    edge    (c - 1,) metre, wavelength between two classes
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
        """The number (n,) of the zone of each star; outside the frame, the nearest zone."""
        i, j = (
            np.clip(np.floor((at + 0.5) / (2 * (nodes[0] + 0.5))), 0, len(nodes) - 1)
            for at, nodes in ((x, self.x), (y, self.y))
        )
        number = (self.colour_class(colour) * len(self.y) + j) * len(self.x) + i
        return np.asarray(number, np.int64)


@kept(8, reads=unmapped_inputs)
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


@kept(8, reads=unmapped_inputs)
def centroid_shift(case: Case) -> FieldPsf:
    """Shift of the tracker's centroid from the projection of the star by the camera model.

    It is the sum of two shifts, averaged over sub-pixel positions: the shift of the image, and the
    tracker's centroid in this image minus its centroid in the mean image. It is measured at the
    nodes of the images, for a star whose brightest pixel is half full, or fainter. Cached for the
    last 8 cases.

    Returns  a FieldPsf without tables: shifts and relative flux
    """
    images = field_psf_of(case.instrument)
    nodes = [
        (float(x), float(y), float(c)) for c in images.colour for y in images.y for x in images.x
    ]
    unique, which, mirror = unique_places(case, nodes)
    images_of_all = _images(case, unique)
    offset = star_response.chart(case, _typical(case), images_of_all, both_signs=False).offset[0]
    offset = np.nan_to_num(offset.reshape(len(unique) + 1, POSITIONS, 2)).mean(axis=1)
    from_mean_image = (mirror @ (offset[1:] - offset[0])[which][..., None])[..., 0]
    value = images.value[..., :3].copy()
    value[..., :2] += from_mean_image.reshape(*value.shape[:3], 2)
    return replace(images, table=np.empty((0, 1, 1)), value=value)


def focal_stretch(case: Case, colour: Floats) -> Floats:
    """Relative excess (n,) of the tracker's focal length by colour over that of sunlike stars.

    It is a least-squares fit to `centroid_shift` over the frame, with the lens in its state at the
    calibration of the camera. It is zero if the tracker does not correct the colour.

    colour  (n,) metre
    """
    if not case.tracker.focal_length_by_colour:
        return np.zeros(len(colour))
    calibrated = replace(case.as_designed, instrument=case.calibrated)
    shift, place = centroid_shift(calibrated), _from_centre(calibrated)
    sunlike = shift.of_one_colour(sunlike_colour(calibrated.instrument))
    lateral = shift.value[..., :2] - sunlike.value[..., :2]
    return shift.over_colour((lateral * place).sum(axis=(1, 2, 3)) / (place**2).sum(), colour)


def _from_centre(case: Case) -> Floats:
    """The nodes (q, p, 2) of the images over the frame, pixel from the principal point."""
    images = field_psf_of(case.instrument)
    x, y = case.instrument.camera.centre
    return np.stack(np.meshgrid(images.x - x, images.y - y), axis=-1)


@kept(8, reads=unmapped_inputs)
def residual_shift(case: Case) -> tuple[FieldPsf, FieldPsf]:
    """`centroid_shift` of a sunlike star, and the difference of other stars from it.

    The tracker's correction for the star's colour is subtracted. Cached for the last 8 cases.
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
    which      (z,) index of the image of each zone
    kept       (z, m) probability that the tracker measures a detected star and does not reject it
    stated     (z, m, 2, 2) pixel^2, covariance that the tracker states
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
    """Errors of single stars in each zone; cached for the last 8 cases.

    They are measured at five sub-pixel positions and at every third magnitude of `errors`. Their
    ratios to the errors of the mean image are interpolated. The random error LENS_FIELD is the
    difference between the tracker's centroids in a zone's image and in the mean image, minus the
    mean of this difference over the positions.

    Accuracy  model: noise and detection in the middle of a zone hold for the whole zone.
    """
    star = star_errors.errors(case)
    coarse = np.unique(np.append(np.arange(0, len(star.magnitude), EVERY), len(star.magnitude) - 1))
    magnitude = star.magnitude[coarse]
    unique, which, mirror = unique_places(case, zones_of(case).middles)
    # One sign, because only differences from the mean image count.
    images, count = _images(case, unique), len(unique) + 1
    every = star_errors.noisy_stars(case, magnitude, images, both_signs=False, groups=count)
    mean, *places = (
        every.at(slice(k, k + POSITIONS)) for k in range(0, len(images.place), POSITIONS)
    )
    of_places = [_place_errors(star, place, mean) for place in places]
    kept, *covariances = (np.stack(column)[which] for column in zip(*of_places, strict=True))
    stated, shot, read, field = (
        mirror[:, None] @ covariance @ mirror[:, None].transpose(0, 1, 3, 2)
        for covariance in covariances
    )
    random = {
        cause: np.broadcast_to(covariance, (len(which), *covariance.shape))
        for cause, covariance in star.random.items()
    } | {star_errors.SHOT: shot, star_errors.READ: read, LENS_FIELD: field}
    point = images.point.reshape(count, POSITIONS, *images.point.shape[1:])[1:]
    return ZoneErrors(star.magnitude, point, which, kept, stated, random)


class _PlaceErrors(NamedTuple):
    """Probability to be kept (m,), and covariances (m, 2, 2) pixel^2, at one place and colour.

    stated      covariance that the tracker states
    shot, read  by the noise of the star's light, and by other noise
    field       LENS_FIELD
    """

    kept: Floats
    stated: Floats
    shot: Floats
    read: Floats
    field: Floats


def _place_errors(
    star: star_errors.Errors, place: star_errors.NoisyStars, mean: star_errors.NoisyStars
) -> _PlaceErrors:
    """Errors with the mean image (`star`), scaled to those with the image of a place.

    place, mean  the same stars, at fewer magnitudes, with the image of the place and the mean image
    """
    magnitude = mean.plain.magnitude

    def scaled(covariance: Floats, by_place: Floats, by_mean: Floats) -> Floats:
        ends = star_errors.mean_of(by_place, place.kept), star_errors.mean_of(by_mean, mean.kept)
        return scaled_to_zone(star, covariance, magnitude, *ends)

    stated = scaled(star.stated, place.plain.covariance, mean.plain.covariance)
    shot = scaled(star.random[star_errors.SHOT], place.shot, mean.shot)
    # If the brightest stars saturate, the variance by read noise is almost zero, of either sign.
    noise = star.random[star_errors.SHOT] + star.random[star_errors.READ]
    read = scaled(noise, place.noise, mean.noise) - shot
    difference = place.plain.offset - mean.plain.offset
    both = np.minimum(place.kept, mean.kept)
    scatter = difference - star_errors.mean_of(difference, both)[:, None]
    field = _between(star.magnitude, magnitude, star_errors.moment_of(scatter, both))
    ratio = place.kept.mean(axis=1) / np.maximum(mean.kept.mean(axis=1), 1e-9)
    kept = np.minimum(star.kept * np.interp(star.magnitude, magnitude, ratio), 1.0)
    return _PlaceErrors(kept, stated, shot, read, field)


def scaled_to_zone(
    star: star_errors.Errors, covariance: Floats, magnitude: Floats, zone: Floats, mean: Floats
) -> Floats:
    """Covariances (m, 2, 2) of the mean image, scaled to those of a zone.

    star        errors of the mean image, whose magnitudes (m,) the covariances have
    zone, mean  (k, 2, 2) covariances of the zone and of the mean image, at k magnitudes
    """
    size = []
    for a in (0, 1):
        ratio = np.maximum(zone[:, a, a], 1e-16) / np.maximum(mean[:, a, a], 1e-16)
        size.append(np.exp(np.interp(star.magnitude, magnitude, np.log(ratio)) / 2))
    excess = np.interp(star.magnitude, magnitude, _correlation(zone) - _correlation(mean))
    x, y = (np.sqrt(np.maximum(covariance[:, a, a], 0)) * size[a] for a in (0, 1))
    cross = np.clip(_correlation(covariance) + excess, -1, 1) * x * y
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
    """The different places (x, y, colour) of a frame; the others are their mirror images.

    With a centred lens, the errors of stars are equal in eight places of a frame if its stars are
    not smeared, in four if they are smeared along x or y, and in two opposite ones if along another
    line. An extent of the smear below STILL is neglected.

    Returns  the different places; the index (n,) of each given place among them; the matrix (n, 2,
             2) that maps displacements at the different place to displacements at the given place
    """
    instrument = case.instrument
    detector = instrument.detector
    alike = (
        mirrored(instrument.optics, instrument.camera)
        and not detector.settling
        and not detector.impulse_response
    )
    smeared = [extent >= STILL for extent in star_response.smear_extent(instrument)]
    centre_x, centre_y = instrument.camera.centre
    numbers: dict[tuple[float, float, float], int] = {}
    unique, which, mirror = list[tuple[float, float, float]](), [], []
    for x, y, colour in places:
        across, down = x - centre_x, y - centre_y
        matrix = np.eye(2)
        if alike:
            sign_x, sign_y = -1.0 if across < 0 else 1.0, -1.0 if down < 0 else 1.0
            if all(smeared):
                sign_x = sign_y = sign_y if down else sign_x
            matrix = np.diag([sign_x, sign_y])
            across, down = sign_x * across, sign_y * down
            if down > across and not any(smeared):
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
