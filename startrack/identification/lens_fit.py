"""Matches of one image -> its attitude with the distortion of the lens.

`fit_lens` estimates the lens of an unknown camera, `fit_frame` the scale of a calibrated one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import Floats, Refused, Spots
from startrack.identification.identify import refined
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.seen import usable

# Unknowns that may be estimated with the attitude, with the standard deviations of their priors:
# relative focal length, principal point over the width of the image, radial distortion, and
# difference of pitches and shear of the pixel grid (by resampling or a rolling shutter).
PRIORS = {
    "focal": 0.2, "k1": 0.5, "x": 0.03, "y": 0.03, "k2": 0.5, "oblong": 0.05, "shear": 0.05,
}  # fmt: skip
NAMES = tuple(PRIORS)
# Standard deviations of unknowns that are not estimated; the covariance counts them.
UNSEEN = PRIORS | {"k2": 0.2, "oblong": 0.002, "shear": 0.002}
STAGES = (("focal",), ("focal", "k1"), ("focal", "k1", "x", "y"), ("focal", "k1", "x", "y", "k2"))
GRID = ("oblong", "shear")  # unknowns of the last stage
# Unknowns of one frame of a calibrated camera: to first order, the effects of refraction of the
# air, focus and resampling. The other unknowns have these standard deviations about the
# calibration. Chosen by hand: about three times the scatter of calibrations in one series.
FRAME = ("focal", *GRID)
CALIBRATED = UNSEEN | {"focal": 3e-4, "k1": 0.03, "x": 2e-3, "y": 2e-3, "k2": 0.2}
# Match radius of the rounds of a stage, over the match radius of the settings. It begins large,
# because an unknown lens displaces stars by several pixels.
RADII = (4.0, 2.0, 1.0)
# Chosen by hand.
SIGNIFICANT = 10.0  # Fisher's F above which a stage is kept; a smaller limit fits noise
LEAST_FREE = 8  # least number of coordinates minus unknowns with which a stage is tried
LEAST_GRID = 24  # the same for the pixel grid: few images need it, and ten stars fit it by chance
FLOOR = 0.05  # pixel, least sigma of a centroid: no lens is known more accurately
# Error of the axis that does not decrease with the number of stars: pixel, and least fraction of
# the scatter of residuals beyond their noise. Its causes are not modelled: a tilted lens, or motion
# with a rolling shutter. Chosen by hand with 45 photographs of ten cameras.
AXIS, COMMON = 0.05, 0.5
REFRACTION = 58.3 * core.arcsec  # factor of tan z, at sea level
LOWEST = 0.05  # sine of the elevation, below which the tangent law is invalid
OUTLIER = 2.0  # sigma, beyond which a residual counts less (soft L1)
BLOCKS, LEAST_IN_BLOCK = (3, 2), 3  # jackknife: blocks across and down; least stars in a block
BY_CHANCE = 1.8  # chi-square per degree of freedom (2 x 5) that chance exceeds in 5 %
STEPS, CLOSE = 20, 1e-6  # most Gauss-Newton steps; chi-square of a step that ends them
ROUNDS = 8  # most rounds of a stage; ends when the matches stay the same


class LensFit(NamedTuple):
    """The attitude of an image, and the camera with the distortion of its lens.

    matches            matches, with the camera that was found and its attitude
    icrs_to_image      attitude of the axis through the image centre. It is the camera's attitude,
                       whose axis goes through the principal point, turned by the shortest rotation
    covariance         (3, 3) radian^2, of the small rotation about these axes. It includes the
                       errors of the camera's unknowns; unknowns that the stars do not determine
                       have the variance of their priors
    residual_rms       pixel, root mean square over both axes of all matches
    """

    matches: core.Matches
    icrs_to_image: Rotation
    covariance: Floats
    residual_rms: float


def fit_lens(
    spots: Spots,
    matches: core.Matches,
    stars: core.Stars,
    index: PatternIndex,
    settings: Identification,
) -> LensFit:
    """Estimate the lens from the matches, and match more stars with it, alternately.

    Radial distortion, principal point, a second radial term, and an oblong and sheared grid of
    pixels are added in this order. Each is kept if it is significant together with the earlier
    ones. One image determines the principal point only if its field is wide: at 50 degrees and with
    40 stars, a displacement of 20 pixels is found to 1 pixel.

    spots, matches  as for `identify`; the matches are solved
    stars, index    as for `identify`
    settings        settings; `match_radius` holds for the fitted lens
    Raises          ValueError if the matches are not solved.
    Accuracy        model: OpenCV's radial distortion of second order about the principal point. For
                    25 photographs with a field of 50 degrees, the boresights differ by 0.3 arcmin
                    (median) and at most 0.7 from boresights with a camera fitted to all
                    photographs. This is 0.9 times the stated sigma (median), and 1.8 times at 95 %.
    """
    if matches.icrs_to_camera is None:
        raise Refused(f"matches must be solved, got {matches.status}: {matches.reason}")
    best = _CameraFit(spots, matches, STAGES[0])
    for stage in (*STAGES[1:], GRID):
        free = best.free + GRID if stage is GRID else stage
        if 2 * len(best.matches) - 3 - len(free) < (LEAST_GRID if stage is GRID else LEAST_FREE):
            continue
        better = _rematched(spots, best, free, stars, index, settings)
        if better.significant(best.free):
            best = better
    return _stated(spots, best)


def fit_frame(spots: Spots, matches: core.Matches) -> LensFit:
    """The attitude of a frame of a calibrated camera, with the frame's scale and grid of pixels.

    The frame's relative focal length, and its oblong and sheared grid, are estimated with the
    attitude if they are significant. Refraction of the air changes these three. At the zenith
    distance z it shortens an image by 2.9e-4 along the horizon, and by 2.9e-4 / cos(z)^2 along the
    vertical (Smart, Textbook on spherical astronomy, section 35: R = 60" tan z). The covariance is
    as in `fit_lens`: errors that neighbouring stars share do not average out with many stars.

    spots, matches  solved by `identify` with the calibrated camera
    Returns         the calibrated camera, with this frame's scale and grid
    Raises          ValueError if the matches are not solved.
    Accuracy        model: the noise of a centroid is assumed to be the same without distortion;
                    refraction beyond its first derivative is not corrected, but stated as an error:
                    0.3 pixel of 1280 for a field of 27 degrees at 20 degrees above the horizon.
    """
    if matches.icrs_to_camera is None:
        raise Refused(f"matches must be solved, got {matches.status}: {matches.reason}")
    camera, focal = matches.camera, matches.camera.focal_length_px
    centre = np.array([(camera.columns - 1) / 2, (camera.rows - 1) / 2])
    # A pinhole camera with the same image centre, whose stars lie at their undistorted places.
    direction = camera.unproject(np.vstack([np.column_stack([spots.x, spots.y]), centre]))
    plane = focal * direction[:, :2] / direction[:, 2:]
    principal_x, principal_y = (-plane[-1]).tolist()
    x, y = (plane[:-1] - plane[-1] + centre).T
    pinhole = core.Camera(camera.columns, camera.rows, focal, principal_x, principal_y)
    straight = replace(spots, x=x, y=y)
    best = _CameraFit(straight, replace(matches, camera=pinhole), (), CALIBRATED)
    if 2 * len(matches) - 3 - len(FRAME) >= LEAST_GRID:
        better = _CameraFit(straight, best.matches, FRAME, CALIBRATED)
        if better.significant(()):
            best = better
    lens, left = _stated(straight, best), best.refraction_left()
    lens = lens._replace(covariance=lens.covariance + np.outer(left, left))
    polynomial, grid = camera.polynomial, lens.matches.camera.polynomial
    if grid is not None:
        polynomial = grid.plus(polynomial) if polynomial else grid
    focal = lens.matches.camera.focal_length_px if best.free else focal
    own = replace(camera, focal_length_px=focal, polynomial=polynomial)
    return lens._replace(matches=replace(lens.matches, camera=own))


def fit_again(spots: Spots, matches: core.Matches) -> LensFit:
    """Fit attitude and lens again, with the same matches and the same unknowns of the camera.

    spots, matches  as `fit_lens` returns them; directions of stars may have moved a little
    Raises          ValueError if the matches are not solved.
    Accuracy        as `fit_lens`
    """
    if matches.icrs_to_camera is None:
        raise Refused(f"matches must be solved, got {matches.status}: {matches.reason}")
    values = _values_of(matches.camera)
    shown = tuple(name for name, value in zip(NAMES[1:], values[1:], strict=True) if value)
    return _stated(spots, _CameraFit(spots, matches, (*STAGES[0], *shown)))


def _stated(spots: Spots, best: _CameraFit) -> LensFit:
    """The result of a fit, with the covariance from the jackknife over parts of the image."""
    lens = best.lens()
    blocks = _without_blocks(spots, best)
    if len(blocks) < 2:
        return lens
    # Neighbouring stars share errors that the model lacks. The rms of all residuals does not show
    # these.
    turn = [(_axis(fit.matches) * lens.icrs_to_image.inv()).as_rotvec() for fit in blocks]
    square = float(np.var(turn, axis=0)[:2].sum()) * (len(blocks) - 1)
    more = max(1.0, square / BY_CHANCE / float(np.trace(lens.covariance[:2, :2])))
    return lens._replace(covariance=lens.covariance * more)


def _without_blocks(spots: Spots, best: _CameraFit) -> list[_CameraFit]:
    """Fits that each leave out one of BLOCKS parts of the image; none if there are few stars.

        cov = (m - 1) / m  sum_k (a_k - mean a)(a_k - mean a)^T

    Source: Kuensch (1989), Ann. Statist. 17, 1217, the jackknife for blocks of neighbours.
    """
    matches, (across, down) = best.matches, BLOCKS
    if len(matches) < LEAST_IN_BLOCK * across * down:
        return []
    x, y = spots.x[matches.spot], spots.y[matches.spot]
    block = np.empty(len(x), np.int64)
    for i, column in enumerate(np.array_split(np.argsort(x), across)):
        for j, part in enumerate(np.array_split(column[np.argsort(y[column])], down)):
            block[part] = i * down + j
    fits = []
    for left_out in range(across * down):
        kept = block != left_out
        some = replace(
            matches,
            spot=matches.spot[kept],
            star=matches.star[kept],
            direction=matches.direction[kept],
        )
        fits.append(_CameraFit(spots, some, best.free, best.unseen))
    return fits


def _rematched(
    spots: Spots,
    start: _CameraFit,
    free: tuple[str, ...],
    stars: core.Stars,
    index: PatternIndex,
    settings: Identification,
) -> _CameraFit:
    """The fit with more unknowns, repeated until the matches stay the same."""
    fit = _CameraFit(spots, start.matches, free)
    log_p = math.log(max(start.matches.false_probability, 1e-300))
    for turn in range(ROUNDS):
        wider = RADII[min(turn, len(RADII) - 1)]
        fixed = replace(settings, focal_tolerance=0.0, match_radius=settings.match_radius * wider)
        assert fit.matches.icrs_to_camera is not None
        again = refined(
            spots,
            usable(spots),
            fit.matches.camera,
            stars,
            index,
            fixed,
            fit.matches.icrs_to_camera.as_matrix(),
            1.0,
            log_p,
        )
        if again.icrs_to_camera is None or len(again) < LEAST_FREE // 2 + len(free):
            break
        same = np.array_equal(again.star, fit.matches.star)
        fit = _CameraFit(spots, again, free)
        if same and wider == RADII[-1]:
            break
    return fit


class _CameraFit:
    """Robust least squares of attitude and camera for given matches, by Gauss-Newton.

    free    names of the estimated unknowns of the camera; the others keep their start values
    unseen  standard deviations of the others, which the covariance counts
    """

    def __init__(
        self,
        spots: Spots,
        matches: core.Matches,
        free: tuple[str, ...],
        unseen: Mapping[str, float] = UNSEEN,
    ) -> None:
        assert matches.icrs_to_camera is not None
        self.free, self.camera, self.before = free, matches.camera, matches
        self.unseen = unseen
        self.place = np.column_stack([spots.x, spots.y])[matches.spot]
        covariance = spots.covariance[matches.spot]
        noise = (covariance[:, 0, 0] + covariance[:, 1, 1]) / 2
        self.noise = np.where(np.isfinite(noise), noise, 1.0) + FLOOR**2
        self.rotation, self.values = matches.icrs_to_camera, _values_of(matches.camera)
        # The prior of the focal length is about its start value; all other priors are about zero.
        self.mean = np.zeros(len(NAMES))
        self.mean[0] = self.values[0]
        self.prior = np.array([(PRIORS if name in free else unseen)[name] for name in NAMES])
        self.used = np.concatenate([np.ones(3, bool), [name in free for name in NAMES]])
        self.excess = 0.0
        for _ in range(2):  # the second time with weights from the residuals of the first
            self._converge()
            self.excess = self._excess()
        self.matches = replace(
            matches, camera=_with_values(self.camera, self.values), icrs_to_camera=self.rotation
        )

    def _converge(self) -> None:
        """Gauss-Newton with soft-L1 weights, until the steps are small compared with the errors."""
        for _ in range(STEPS):
            residual, slopes = self._residual()
            information, right = self._normal(residual, slopes)
            step = np.zeros(len(self.used))
            chosen = information[np.ix_(self.used, self.used)]
            step[self.used] = np.linalg.lstsq(chosen, right[self.used])[0]
            self.rotation = Rotation.from_rotvec(step[:3]) * self.rotation
            self.values = self.values + step[3:]
            if float(step @ information @ step) < CLOSE:
                break

    def _residual(self) -> tuple[Floats, Floats]:
        """Pixel (n, 2), spots minus stars, and the slopes (n, 2, 3 + names) of the stars' places.

        A star behind the camera is set far outside, with zero slopes.
        """
        place, slopes = _project(
            self.camera, self.values, self.rotation.apply(self.before.direction)
        )
        return np.nan_to_num(self.place - place, nan=1e6), np.nan_to_num(slopes)

    def _weight(self, residual: Floats) -> Floats:
        """Pixel^-2, of each coordinate (n, 2)."""
        sigma = np.sqrt(self.noise + self.excess)[:, None]
        return np.asarray(1 / np.hypot(1, residual / sigma / OUTLIER) / sigma**2)

    def _normal(self, residual: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """The normal equations with the priors: information, and its product with the step."""
        weight = self._weight(residual)
        information = np.einsum("nci,nc,ncj->ij", slopes, weight, slopes)
        right = np.einsum("nci,nc,nc->i", slopes, weight, residual)
        information[np.diag_indices(len(right))] += [0.0] * 3 + [s**-2 for s in self.prior]
        right[3:] -= (self.values - self.mean) / self.prior**2
        return information, right

    def _excess(self) -> float:
        """Variance of the residuals per axis beyond the noise; see `agree`."""
        square = (self._residual()[0] ** 2).sum(axis=1)
        left = max(2 * len(square) - self.used.sum(), 1) / (2 * len(square))
        typical = float(np.median(square)) / (2 * math.log(2) * left)
        return max(typical - float(np.median(self.noise)), 0.0)

    def significant(self, before: tuple[str, ...]) -> bool:
        """Whether the newly estimated unknowns differ significantly from zero."""
        information, _ = self._normal(*self._residual())
        index = np.flatnonzero(self.used)
        covariance = np.linalg.pinv(information[np.ix_(index, index)])
        added = [3 + NAMES.index(name) for name in self.free if name not in before]
        offset = (self.values - self.mean)[np.array(added) - 3]
        rows = np.searchsorted(index, added)
        chi_square = float(offset @ np.linalg.solve(covariance[np.ix_(rows, rows)], offset))
        return chi_square / len(added) > SIGNIFICANT * self._chi_square()

    @property
    def _freedom(self) -> int:
        return 2 * len(self.place) - int(self.used.sum())

    def _chi_square(self) -> float:
        """Robust chi-square per degree of freedom; at least 1."""
        residual = self._residual()[0] / np.sqrt(self.noise + self.excess)[:, None]
        cost = 2 * OUTLIER**2 * (np.hypot(1, residual / OUTLIER) - 1).sum()
        return max(1.0, float(cost) / self._freedom) if self._freedom > 0 else 1.0

    def lens(self) -> LensFit:
        """The result; its covariance is from the derivatives by all unknowns."""
        residual, slopes = self._residual()
        information, _ = self._normal(residual, slopes)
        # The scatter of few residuals is uncertain, therefore the variance of Student's
        # distribution is used.
        few = self._freedom / (self._freedom - 2) if self._freedom > 2 else 3.0
        covariance = np.linalg.pinv(information) * self._chi_square() * few
        rows = self._turns_of_axis()
        axis_covariance = rows @ covariance @ rows.T
        # Errors that neighbouring stars share vary with the position, as the error of the axis
        # does.
        most = OUTLIER * np.sqrt(self.noise + self.excess)[:, None]
        bounded = np.clip(residual, -most, most)
        near = cKDTree(self.place).query(self.place, 2)[1][:, 1]
        shared = float(np.mean(bounded * bounded[near]))
        common = AXIS**2 + max(COMMON**2 * self.excess, shared)
        axis_covariance[[0, 1], [0, 1]] += common / self.camera.focal_length_px**2
        rms = float(np.sqrt(np.mean(residual**2)))
        return LensFit(self.matches, _axis(self.matches), axis_covariance, rms)

    def _turns_of_axis(self) -> Floats:
        """Derivatives (3, 3 + names) of the rotation of the image's axis by the unknowns."""
        camera, turn = self.matches.camera, _centre(self.matches.camera)
        _, slope = _project(camera, self.values, camera.unproject(_middle(camera)))
        # The position of the middle is fixed, so its direction moves; the camera rotates about it.
        rows = np.zeros((3, len(self.used)))
        rows[:, :3] = np.eye(3)
        rows[:, 3:] = np.linalg.lstsq(slope[0, :, :3], slope[0, :, 3:])[0]
        return np.asarray(turn.inv().as_matrix() @ rows)

    def refraction_left(self) -> Floats:
        """Rotation (3,), radian, of the axis by refraction that scale and grid do not model.

        The compression of the grid gives the zenith distance, by R = 58.3" tan z, and the line
        through the zenith in the image. At which end of the line the zenith lies is unknown, so the
        sign of the rotation is unknown.
        """
        _, oblong, shear = self.values[[0, -2, -1]].tolist()
        squeeze = math.hypot(oblong, shear)
        if squeeze == 0:
            return np.zeros(3)
        camera, place = self.matches.camera, np.vstack([self.place, _middle(self.matches.camera)])
        seen = _centre(camera).inv().apply(camera.unproject(place))
        line = (math.atan2(shear, oblong) + math.pi) / 2  # direction of the compression
        distance = math.atan(math.sqrt(squeeze / REFRACTION))
        zenith = math.sin(distance) * np.array([math.cos(line), math.sin(line), 0.0])
        zenith[2] = math.cos(distance)
        up = np.maximum(seen @ zenith, LOWEST)[:, None]
        moved = seen + REFRACTION * (zenith / up - seen)  # by tan z towards the zenith
        moved = _centre(camera).apply(moved)
        shift = np.nan_to_num(camera.project(moved) - place)
        residual, slopes = self._residual()
        information, _ = self._normal(residual, slopes)
        right = np.einsum("nci,nc,nc->i", slopes, self._weight(residual), shift[:-1])
        step, used = np.zeros(len(self.used)), self.used
        step[used] = np.linalg.lstsq(information[np.ix_(used, used)], right[used])[0]
        x, y = shift[-1] / camera.focal_length_px
        return np.asarray(self._turns_of_axis() @ step - np.array([-y, x, 0.0]))


def _values_of(camera: core.Camera) -> Floats:
    """Values of a camera in the order of `NAMES`: logarithm of the focal length, principal point
    over width.
    """
    grid = camera.polynomial
    return np.array(
        [
            math.log(camera.focal_length_px),
            camera.k1,
            camera.principal_x / camera.columns,
            camera.principal_y / camera.columns,
            camera.k2,
            2 * grid.x[1] if grid else 0.0,
            grid.x[2] if grid else 0.0,
        ]
    )


def _with_values(camera: core.Camera, values: Floats) -> core.Camera:
    """Inverse of `_values_of`; other parameters of the camera do not change."""
    focal, k1, x, y, k2, oblong, shear = values.tolist()
    grid = core.FieldPolynomial((0.0, oblong / 2, shear), (0.0, 0.0, -oblong / 2))
    return replace(
        camera,
        focal_length_px=math.exp(focal),
        k1=k1,
        k2=k2,
        principal_x=x * camera.columns,
        principal_y=y * camera.columns,
        polynomial=grid if oblong or shear else None,
    )


def _project(camera: core.Camera, values: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Places (n, 2) of directions by these values, and their slopes (n, 2, 3 + names).

    Slopes by a small rotation about the camera's axes, and by the values. As `Camera.project`,
    without tangential distortion; NaN for directions behind the camera.
    """
    focal, k1, x, y, k2, oblong, shear = values.tolist()
    focal, k3 = math.exp(focal), camera.k3
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(direction[:, 2] > 0, direction[:, 2], np.nan)
        u, v = (direction[:, :2] / ahead[:, None]).T
    r2 = u * u + v * v
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bend = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    distorted = np.stack([u * (radial + oblong / 2) + shear * v, v * (radial - oblong / 2)], 1)
    centre = np.array([(camera.columns - 1) / 2, (camera.rows - 1) / 2])
    place = focal * distorted + centre + np.array([x, y]) * camera.columns
    by_u = np.stack([radial + bend * u * u + oblong / 2, bend * u * v], 1)
    by_v = np.stack([bend * u * v + shear, radial + bend * v * v - oblong / 2], 1)
    turn_u, turn_v = core.plane_slopes.py_func(u, v)
    none = np.zeros_like(u)
    slopes = np.empty((len(u), 2, 3 + len(NAMES)))
    for k in range(3):
        slopes[:, :, k] = focal * (by_u * turn_u[k][:, None] + by_v * turn_v[k][:, None])
    width = float(camera.columns)
    columns = (
        focal * distorted,
        focal * np.stack([u * r2, v * r2], 1),
        np.array([[width, 0.0]]),
        np.array([[0.0, width]]),
        focal * np.stack([u * r2 * r2, v * r2 * r2], 1),
        focal / 2 * np.stack([u, -v], 1),
        focal * np.stack([v, none], 1),
    )
    for k, column in enumerate(columns):
        slopes[:, :, 3 + k] = column
    return place, slopes


def _axis(matches: core.Matches) -> Rotation:
    """The attitude of the axis through the middle of the image."""
    assert matches.icrs_to_camera is not None
    return _centre(matches.camera).inv() * matches.icrs_to_camera


def _middle(camera: core.Camera) -> Floats:
    """Pixel (1, 2), position of the image centre."""
    return np.array([[(camera.columns - 1) / 2, (camera.rows - 1) / 2]])


def _centre(camera: core.Camera) -> Rotation:
    """The shortest rotation from the camera's axis to the direction of the image centre."""
    x, y, z = camera.unproject(_middle(camera))[0]
    apart = math.hypot(x, y)
    turn = np.array([-y, x, 0.0]) * (math.atan2(apart, z) / apart if apart else 0.0)
    return Rotation.from_rotvec(turn)
