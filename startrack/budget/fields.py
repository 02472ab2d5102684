"""Sky and camera -> the stars of many fields, and attitude errors from star errors."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, Sky, open_sky
from startrack.core import GOLDEN_ANGLE, Camera, Floats, Ints, assign, kernel, local_weights
from startrack.design import Case
from startrack.observation import index_resolution, rotations_from_cube, separated

FIELDS = 512
LEAST = 1e-4  # least probability at which a star counts; chosen by hand
LATTICE = 33  # places along each side of a frame, at which units displace stars
WIDER = 1.25  # cameras whose fields of view differ by less than this factor share fields


class Fields(NamedTuple):
    """The stars of m fields evenly distributed over the sky, one field after the other.

    sky       single stars; stars that the camera cannot separate count as one
    name      (stars,) index of each single star in the catalogue
    attitude  icrs_to_camera of the m fields
    field     (n,) index of the field
    x, y      (n,) 1, x / z and y / z in camera axes; brightest first in each field
    star      (n,) index into the single stars
    """

    sky: Sky
    name: Ints
    attitude: Rotation
    field: Ints
    x: Floats
    y: Floats
    star: Ints


def fields(
    selection: Selection,
    camera: Camera,
    spread: Callable[[int], Rotation],
    count: int = FIELDS,
    listed: Selection | None = None,
) -> Fields:
    """The stars within the camera's half diagonal, and some stars beyond it.

    spread  function that makes the attitudes of a number of fields: `attitudes` or `boresights`
    listed  the tracker's catalogue: stars fainter than its faintest star are left out, because they
            never count; None: all stars
    """
    step = math.log(WIDER)
    radius = math.exp(math.ceil(math.log(camera.half_diagonal) / step) * step)
    resolution = index_resolution(camera)
    return _fields(selection, resolution, min(radius, 1.5), spread, count, listed)


def listed_fields(case: Case, spread: Callable[[int], Rotation], count: int = FIELDS) -> Fields:
    """The stars of a case's sky that its tracker may know."""
    camera = case.instrument.camera
    return fields(case.catalog, camera, spread, count, case.believed_catalog)


@lru_cache(maxsize=16)
def believed_index(true: Selection, believed: Selection) -> Ints:
    """Index of each true star in the believed sky; -1 if the believed sky lacks it."""
    star, there = open_sky(believed).stars.find(open_sky(true).stars.identifier)
    return np.where(there, star, -1)


@lru_cache(maxsize=16)
def _fields(
    selection: Selection,
    resolution: float,
    radius: float,
    spread: Callable[[int], Rotation],
    count: int,
    listed: Selection | None,
) -> Fields:
    stars, sky = separated(selection, resolution), open_sky(selection)
    attitude = spread(count)
    boresight = attitude.inv().apply([0.0, 0.0, 1.0])
    # The whole sky is searched, because its sorted order is cached for all resolutions.
    place = stars.places(len(sky))
    if listed is not None:
        known = np.flatnonzero(believed_index(selection, listed) >= 0)
        sky = Sky(sky.stars[: known.max(initial=-1) + 1])
    near = (place[cone] for cone in sky.cones(boresight, radius + resolution))
    members = [np.sort(cone[cone >= 0]) for cone in near]
    field = np.repeat(np.arange(count), [len(star) for star in members])
    seen = [
        turn.apply(stars.sky.stars.direction[star]) if len(star) else np.empty((0, 3))
        for turn, star in zip(attitude, members, strict=True)
    ]
    x, y, z = np.concatenate(seen).T
    return Fields(
        sky=stars.sky,
        name=stars.name,
        attitude=attitude,
        field=field,
        x=x / z,
        y=y / z,
        star=np.concatenate(members),
    )


def attitudes(count: int) -> Rotation:
    """Attitudes that cover all rotations evenly, from a Sobol sequence."""
    return rotations_from_cube(sobol_points(count))


def sobol_points(count: int) -> Floats:
    """The first points (n, 3) of the Sobol sequence in [0, 1), not scrambled.

    They equal those of scipy.stats.qmc.Sobol to the last bit. Importing that part of scipy would
    delay each command by half a second.

    Source: Joe and Kuo (2008), SIAM Journal on Scientific Computing 30, 2635, direction numbers of
    the first three dimensions; Antonov and Saleev (1979), the order by Gray code.
    """
    place = np.arange(count)
    gray = place ^ (place >> 1)
    column = np.ones((3, max(int(count).bit_length(), 3)), int)  # direction numbers m_k, odd
    column[2, 1] = 3
    for k in range(1, column.shape[1]):
        column[1, k] = 2 * column[1, k - 1] ^ column[1, k - 1]  # polynomial x + 1
        if k > 1:  # polynomial x^2 + x + 1
            column[2, k] = 2 * column[2, k - 1] ^ 4 * column[2, k - 2] ^ column[2, k - 2]
    points = np.zeros((3, count), int)
    for k, direction in enumerate(column.T):
        points ^= np.where(gray >> k & 1, direction[:, None] << (29 - k), 0)
    return points.T / 2**30


def boresights(count: int) -> Rotation:
    """Attitudes with boresights evenly over the sphere and rolls evenly over the circle.

    They lie on a golden-angle spiral: Gonzalez (2010), Mathematical Geosciences 42, 49.
    """
    k = np.arange(count) + 0.5
    declination = np.arcsin(1 - 2 * k / count)
    # The boresight is +z. It is rotated from the pole down to its declination.
    turn = [GOLDEN_ANGLE * k, np.pi / 2 - declination, GOLDEN_ANGLE * k * np.sqrt(2)]
    return Rotation.from_euler("ZYZ", np.column_stack(turn)).inv()


class FieldResponse(NamedTuple):
    """Detection and measurement of stars by the tracker, over their magnitude.

    start, step  magnitude of the first entry, and between two entries
    fraction     (z, k) 1, fraction detected in each zone (of the frame and of colour)
    stated       (z, k, 2, 2) pixel^2, covariance of the noise that the tracker states
    causes       (z, c, k, 2, 2) pixel^2, true covariance of each random cause
    false        (k,) number of brighter false spots; each takes the place of a star
    """

    start: float
    step: float
    fraction: Floats
    stated: Floats
    causes: Floats
    false: Floats


class Attitudes(NamedTuple):
    """Errors of the attitudes of m fields, in camera axes.

    stars     (m,) 1, expected number of detected stars
    solved    (m,) 1, probability that enough stars for an attitude are detected
    variance  (m, c, 3) radian^2, error variance by each random cause
    shift     (m, d, 3) radian, error by each displacement
    stated    (m, 3, 3) radian^-2, information that the tracker states
    gain      (n, 4, 2) radian / pixel, for each star: rotation about three axes by an error in x
              and y; the last row holds twice the probability that the star counts
    """

    stars: Floats
    solved: Floats
    variance: Floats
    shift: Floats
    stated: Floats
    gain: Floats

    def by_lattice(self, first: Ints, pixel: Floats, camera: Camera) -> Floats:
        """Matrix from displacements (2, LATTICE^2) pixel at a lattice to errors (3, m) radian.

        Between the lattice nodes, displacements are interpolated by local cubic polynomials.

        first    `FieldStars.first`
        pixel    (n, 2) positions of the stars
        Returns  (3, m, 2, LATTICE^2) radian / pixel
        Accuracy  numerical: 1e-3 of the attitude errors by calibration residuals of units.
        """
        (left, across), (top, down) = (
            local_weights(nodes, at)
            for nodes, at in zip(lattice_nodes(camera), pixel.T, strict=True)
        )
        near = np.arange(4)
        place = (top[:, None, None] + near[:, None]) * LATTICE + left[:, None, None] + near
        weight = down[:, :, None] * across[:, None, :]
        rows, size = np.arange(len(pixel) + 1) * 16, (len(pixel), LATTICE**2)
        between = csr_array((weight.ravel(), place.ravel(), rows), size)
        gain = (self.gain[:, :3] * self.gain[:, 3:, :1]).transpose(1, 2, 0)
        index, shape = np.arange(len(pixel)), (len(first) - 1, len(pixel))
        response = np.empty((3, len(first) - 1, 2, LATTICE**2))
        for axis, xy in np.ndindex(3, 2):
            of_fields = csr_array((gain[axis, xy], index, first), shape)
            response[axis, :, xy] = (of_fields @ between).toarray()
        return response


def lattice_nodes(camera: Camera) -> tuple[Floats, Floats]:
    """Columns and rows (LATTICE,) pixel of a lattice that spans a frame."""
    x, y = (np.linspace(-0.5, size - 0.5, LATTICE) for size in (camera.columns, camera.rows))
    return x, y


class FieldStars(NamedTuple):
    """The n stars that count, one field after the other, brightest first in each field.

    first         (m + 1,) index of the first star of each field, and n
    x, y          (n,) 1, x / z and y / z in camera axes
    magnitude     (n,) G of a sunlike star of equal brightness
    zone          (n,) index of the zone in the `FieldResponse`
    kept          (n,) 1, probability that a detected star is kept
    systematic    (n,) pixel^2 per axis, systematic variance that the tracker assumes
    displacement  (d, n, 2) pixel, fixed errors of the positions
    """

    first: Ints
    x: Floats
    y: Floats
    magnitude: Floats
    zone: Ints
    kept: Floats
    systematic: Floats
    displacement: Floats


class Solver(NamedTuple):
    """Settings of the tracker's solver that the propagation of errors needs.

    focal_length_px  pixel, focal length that the tracker assumes
    tolerance        1, prior sigma of the fitted scale about one; 0 if no scale is fitted
    lost             (k,) probability that 0, 1, ... k - 1 detected stars give no attitude; k or
                     more stars always give one
    most             number of the brightest spots that are kept
    """

    focal_length_px: float
    tolerance: float
    lost: Floats
    most: int


def propagate(seen: FieldStars, response: FieldResponse, solver: Solver) -> Attitudes:
    """Attitude errors from star errors, by the gain of each star.

        e = sum_i gain_i error_i,   gain_i = I^-1 H_i^T W_i - b r_i,   I = sum_i H_i^T W_i H_i

    H_i is the change of a star's position with a rotation and W_i its weight. A tracker that fits
    its focal length first moves every star p_i by r error_i p_i, which gives the second term, b =
    I^-1 sum_i H_i^T W_i p_i. Each star counts by its probability of detection.

    Accuracy  model: to first order in the errors. A star with a detection probability below 1
              counts as a fraction of a star; if few stars are detected, the predicted error is too
              small.
    """
    count, causes, shifts = len(seen.first) - 1, response.causes.shape[1], len(seen.displacement)
    errors = Attitudes(
        np.zeros(count),
        np.zeros(count),
        np.zeros((count, causes, 3)),
        np.zeros((count, shifts, 3)),
        np.zeros((count, 3, 3)),
        np.zeros((len(seen.x), 4, 2)),
    )
    _propagate(seen, response, solver, errors)
    return errors


@kernel
def _propagate(
    seen: FieldStars, response: FieldResponse, solver: Solver, errors: Attitudes
) -> None:
    """Write the errors of each field, in two passes over its stars."""
    full, chance = np.empty((4, 4)), np.empty(len(solver.lost))
    for f in range(len(seen.first) - 1):
        end, errors.stars[f] = _information(f, seen, response, solver, full, chance)
        info = full[:3, :3].copy()
        for a in range(3):
            assign(errors.stated[f, a], info[a])
        errors.solved[f] = 1 - (chance * solver.lost).sum()
        unsolvable = errors.stars[f] < 2.0 or not np.linalg.cond(info) < 1e15
        if errors.solved[f] < 1e-6 or unsolvable:
            errors.solved[f] = 0.0
            continue
        inverse = np.linalg.inv(info)
        by_scale = inverse @ full[:3, 3].copy()
        row = np.zeros(4)
        if solver.tolerance > 0:
            full[3, 3] += solver.tolerance**-2
            row = np.linalg.inv(full)[3].copy()
        _gains(seen.first[f], end, seen, response, solver, inverse, by_scale, row, errors.gain)
        _errors(f, end, seen, response, errors)


@kernel
def _entry(magnitude: float, response: FieldResponse) -> tuple[int, float]:
    """Index of the table entry before a magnitude, and the fraction of the step beyond it."""
    last = response.fraction.shape[1] - 2
    place = min(max((magnitude - response.start) / response.step, 0.0), last + 0.999)
    return int(place), place - int(place)


@kernel
def _detected(i: int, k: int, t: float, seen: FieldStars, response: FieldResponse) -> float:
    """Probability that a star is detected and kept; `k` and `t` are from `_entry`."""
    fraction = response.fraction[seen.zone[i]]
    return seen.kept[i] * (fraction[k] + t * (fraction[k + 1] - fraction[k]))


@kernel
def _information(
    f: int, seen: FieldStars, response: FieldResponse, solver: Solver, full: Floats, chance: Floats
) -> tuple[int, float]:
    """Information of a field about rotation and scale, and the probability of each star count.

    full     (4, 4) radian^-2, information; written in place
    chance   (k,) 1, probability of exactly 0, 1, ... detected stars; written in place
    Returns  the index after the last star that counts, and the expected number of stars
    """
    design, weight = np.empty((2, 4)), np.empty((2, 2))
    full[:] = 0.0
    chance[:] = 0.0
    chance[0] = 1.0
    end, total = seen.first[f], 0.0
    while end < seen.first[f + 1] and total < solver.most:
        k, t = _entry(seen.magnitude[end], response)
        # The last star counts only by the fraction that still fits into the list of spots.
        p = min(_detected(end, k, t, seen, response), solver.most - response.false[k] - total)
        if p > LEAST:
            design_row(seen.x[end], seen.y[end], solver.focal_length_px, design)
            _inverse(response.stated[seen.zone[end]], k, t, seen.systematic[end], weight)
            for a in range(4):
                left0 = design[0, a] * weight[0, 0] + design[1, a] * weight[1, 0]
                left1 = design[0, a] * weight[0, 1] + design[1, a] * weight[1, 1]
                for b in range(4):
                    full[a, b] += p * (left0 * design[0, b] + left1 * design[1, b])
            for n in range(len(chance) - 1, 0, -1):
                chance[n] = chance[n] * (1 - p) + chance[n - 1] * p
            chance[0] *= 1 - p
            total += p
        end += 1
    return end, total


@kernel
def _gains(
    first: int,
    end: int,
    seen: FieldStars,
    response: FieldResponse,
    solver: Solver,
    inverse: Floats,
    by_scale: Floats,
    row: Floats,
    gain: Floats,
) -> None:
    """Gains of the stars of a field, each with the probability that it counts.

    inverse   (3, 3) radian^2, of the information
    by_scale  (3,) radian, change of the attitude by a scale error of 1
    row       (4,) row of the scale in the inverse of the information about rotation and scale
    gain      (n, 4, 2) radian / pixel, the last row holds the probability twice; written in place
    """
    design, weight = np.empty((2, 4)), np.empty((2, 2))
    room = float(solver.most)
    for i in range(first, end):
        k, t = _entry(seen.magnitude[i], response)
        p = min(_detected(i, k, t, seen, response), room - response.false[k])
        if not p > LEAST:
            continue
        room -= p
        gain[i, 3] = p
        design_row(seen.x[i], seen.y[i], solver.focal_length_px, design)
        _inverse(response.stated[seen.zone[i]], k, t, seen.systematic[i], weight)
        for b in range(2):
            fitted = 0.0
            for a in range(4):
                fitted += row[a] * (design[0, a] * weight[0, b] + design[1, a] * weight[1, b])
            for a in range(3):
                gain[i, a, b] = -by_scale[a] * fitted
                for c in range(3):
                    gain[i, a, b] += inverse[a, c] * (
                        design[0, c] * weight[0, b] + design[1, c] * weight[1, b]
                    )


@kernel
def _errors(f: int, end: int, seen: FieldStars, response: FieldResponse, errors: Attitudes) -> None:
    """Variance and shifts of the attitude of a field, by the gains of its stars."""
    for i in range(seen.first[f], end):
        p = errors.gain[i, 3, 0]
        if not p > LEAST:
            continue
        k, t = _entry(seen.magnitude[i], response)
        for c in range(response.causes.shape[1]):
            cause = response.causes[seen.zone[i], c]
            xx = cause[k, 0, 0] + t * (cause[k + 1, 0, 0] - cause[k, 0, 0])
            xy = cause[k, 0, 1] + t * (cause[k + 1, 0, 1] - cause[k, 0, 1])
            yy = cause[k, 1, 1] + t * (cause[k + 1, 1, 1] - cause[k, 1, 1])
            for a in range(3):
                u, v = errors.gain[i, a, 0], errors.gain[i, a, 1]
                errors.variance[f, c, a] += p * max(u * u * xx + 2 * u * v * xy + v * v * yy, 0.0)
        for d in range(len(seen.displacement)):
            x, y = seen.displacement[d, i]
            for a in range(3):
                errors.shift[f, d, a] += p * (errors.gain[i, a, 0] * x + errors.gain[i, a, 1] * y)


@kernel
def design_row(x, y, focal, design):  # type: ignore[no-untyped-def]
    """Derivatives of a star's position (pixel) by a rotation of the sky and by the scale."""
    design[0, 0], design[0, 1] = focal * (-x * y), focal * (1 + x * x)
    design[0, 2], design[0, 3] = -focal * y, focal * x
    design[1, 0], design[1, 1] = -focal * (1 + y * y), focal * x * y
    design[1, 2], design[1, 3] = focal * x, focal * y


@kernel
def _inverse(table, k, t, systematic, out):  # type: ignore[no-untyped-def]
    """Inverse of a covariance between two entries of a table, plus the systematic variance."""
    xx = systematic + table[k, 0, 0] + t * (table[k + 1, 0, 0] - table[k, 0, 0])
    xy = table[k, 0, 1] + t * (table[k + 1, 0, 1] - table[k, 0, 1])
    yy = systematic + table[k, 1, 1] + t * (table[k + 1, 1, 1] - table[k, 1, 1])
    scale = xx * yy - xy * xy
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = yy / scale, -xy / scale, -xy / scale, xx / scale
