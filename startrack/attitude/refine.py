"""Gauss-Newton on residuals in the image plane; covariance of the attitude, with shared errors."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude.linear import invert, least_squares
from startrack.core import Flags, Floats, Unit, kernel, plane_slopes, turn_by

MOST_STEPS = 10  # limit of the steps: the start is close to the minimum
SMALLEST_STEP = 1e-15  # radian, several eps
# Ratio to the largest diagonal element below which all stars lie in one direction. Chosen by hand:
# between rounding, 1e-16, and the narrowest fields.
LEAST_RANK = 1e-12


@dataclass(frozen=True, eq=False)
class Refinement:
    """An attitude at the minimum of the weighted residuals.

    icrs_to_camera  attitude
    covariance      (3, 3) radian^2, of the small rotation about the camera's axes
    residual        (n, 2) pixel, measured minus predicted
    chi_square      (n,) squared residuals over their covariance
    scale           1, focal length over that of the camera
    """

    icrs_to_camera: Rotation
    covariance: Floats
    residual: Floats
    chi_square: Floats
    scale: float


def refine(
    pixel: Floats,
    covariance: Floats,
    direction: Floats,
    camera: core.Camera,
    start: Rotation,
    tolerance: float = 0.0,
) -> Refinement:
    """Minimise sum_i r_i^T C_i^-1 r_i + (s - 1)^2 / tolerance^2 over rotations and the scale s.

    The residuals are taken in the undistorted image plane. There a small rotation d about the
    camera's axes changes x/z of a direction by s (-xy, 1 + x^2, -y) d, and y/z by s (-(1 + y^2),
    xy, x) d. Both are proportional to s. The covariance of the attitude includes the uncertainty of
    the estimated scale.

    pixel       (n, 2) measured centroids
    covariance  (n, 2, 2) pixel^2
    direction   (n, 3) unit vectors, ICRS axes
    start       icrs_to_camera near the minimum
    tolerance   1, prior standard deviation of the scale; 0: the scale is fixed
    Returns     Refinement
    Raises      ValueError if the attitude is not observable (fewer than two directions).
    Accuracy    model: the covariance of a centroid is assumed to be the same without distortion.
                numerical: rounding only, because the residuals are differences of nearly equal
                numbers.
    """
    seen = camera.unproject(pixel)
    seen_plane = seen[:, :2] / seen[:, 2:]
    # (n, 3) lower triangle of a matrix that whitens the noise of a position.
    root = np.linalg.inv(np.linalg.cholesky(covariance)) * camera.focal_length_px
    whitener = np.ascontiguousarray(root[:, [0, 1, 1], [0, 0, 1]])
    direction = np.ascontiguousarray(direction)  # rotated directions are not contiguous
    matrix = start.as_matrix()
    inverse, chi_square = np.empty((3, 3)), np.empty(len(pixel))
    residual = np.empty_like(seen_plane)
    scale = _refine(
        seen_plane, whitener, direction, tolerance, matrix, inverse, residual, chi_square
    )
    if np.isnan(scale):
        raise core.Refused("the stars must lie in at least two directions to fix an attitude")
    return Refinement(
        core.rotation_of(matrix),
        inverse @ inverse.T,
        residual * camera.focal_length_px,
        chi_square,
        scale,
    )


class Refinements(NamedTuple):
    """The minima of m sets of stars; fields as in `Refinement`.

    source_to_target  m rotations
    covariance        (m, 3, 3) radian^2; infinite if not observable
    chi_square        (m,) 1, sum over the stars
    observed          (m,) whether the stars determine the attitude
    """

    source_to_target: Rotation
    covariance: Floats
    chi_square: Floats
    observed: Flags


def refine_all(
    plane: Floats,
    inverse: Floats,
    direction: Floats,
    focal: float,
    start: Floats,
    tolerance: float = 0.0,
) -> Refinements:
    """`refine` for m sets of up to n stars each.

    plane      (m, n, 2) measured places in the undistorted image plane
    inverse    (m, n, 2, 2) 1 / pixel^2, inverse covariances; zero for missing stars
    direction  (m, n, 3) unit vectors, ICRS axes, in front of the camera
    focal      pixel
    start      (m, 3, 3) icrs_to_camera near the minima
    tolerance  as for `refine`
    """
    many = len(plane)
    # An upper triangle whose square is the inverse covariance.
    yy = np.sqrt(inverse[..., 1, 1])
    xy = inverse[..., 0, 1] / np.where(yy > 0, yy, 1.0)
    xx = np.sqrt(np.maximum(inverse[..., 0, 0] - xy**2, 0.0))
    whitener = focal * np.stack([xx, xy, yy], axis=-1)
    matrix, covariance, chi_square = start.copy(), np.empty((many, 3, 3)), np.empty(many)
    _refine_all(plane, whitener, direction, tolerance, matrix, covariance, chi_square)
    observed = np.isfinite(chi_square)
    return Refinements(core.rotation_of(matrix), covariance, chi_square, observed)


@kernel
def _refine_all(plane, whitener, direction, tolerance, matrix, covariance, chi_square):  # type: ignore[no-untyped-def]
    """Write attitudes, covariances and the sums of chi-square; not finite where not observed."""
    count = plane.shape[1]
    inverse, residual, of_star = np.empty((3, 3)), np.empty((count, 2)), np.empty(count)
    for k in range(len(plane)):
        args = plane[k], whitener[k], direction[k], tolerance, matrix[k]
        if np.isnan(_refine(*args, inverse, residual, of_star)):
            covariance[k] = chi_square[k] = np.inf
            continue
        chi_square[k] = 0.0
        for n in range(count):
            chi_square[k] += of_star[n]
        for i in range(3):
            for j in range(3):
                covariance[k, i, j] = 0.0
                for n in range(3):
                    covariance[k, i, j] += inverse[i, n] * inverse[j, n]


@kernel
def _refine(seen, whitener, direction, tolerance, matrix, inverse, residual, chi_square):  # type: ignore[no-untyped-def]
    """Gauss-Newton to the minimum, in place; returns the scale, NaN if not observable."""
    columns, stretch = np.zeros((4, 2 * len(seen) + 1)), np.zeros(2 * len(seen) + 1)
    triangle, step, along = np.zeros((3, 3)), np.empty(3), np.zeros(4)
    scale = 1.0
    for _ in range(MOST_STEPS):
        _linearise(seen, whitener, direction, matrix, scale, columns, stretch, residual)
        if tolerance > 0:
            _free(stretch, columns, scale, tolerance, along)
        least_squares(columns, triangle, step)
        size = np.abs(np.diag(triangle))
        if not size.min() > LEAST_RANK * size.max():
            return np.nan
        turn_by(step, matrix)
        stretched = along[3] - along[0] * step[0] - along[1] * step[1] - along[2] * step[2]
        scale += stretched
        if np.abs(step).max() < SMALLEST_STEP and abs(stretched) < SMALLEST_STEP:
            break
    _linearise(seen, whitener, direction, matrix, scale, columns, stretch, residual)
    for n in range(len(seen)):
        chi_square[n] = columns[3, 2 * n] ** 2 + columns[3, 2 * n + 1] ** 2
    if tolerance > 0:
        _free(stretch, columns, scale, tolerance, along)
    least_squares(columns, triangle, step)
    invert(triangle, inverse)
    return scale


@kernel
def _linearise(seen, whitener, direction, matrix, scale, columns, stretch, residual):  # type: ignore[no-untyped-def]
    """Write residuals (n, 2) in the image plane; as columns, the whitened derivatives and
    residuals.

    The derivative by the scale is in `stretch`; the last row is reserved for the scale's prior.
    """
    columns[:, -1] = stretch[-1] = 0.0
    for n in range(len(seen)):
        u, v, w = direction[n]
        px = matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2] * w
        py = matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2] * w
        pz = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2] * w
        x, y = px / pz, py / pz
        slope_x, slope_y = plane_slopes(x, y)
        residual[n, 0], residual[n, 1] = seen[n, 0] - scale * x, seen[n, 1] - scale * y
        a, b, c = whitener[n]
        for k in range(3):
            columns[k, 2 * n] = scale * a * slope_x[k]
            columns[k, 2 * n + 1] = scale * (b * slope_x[k] + c * slope_y[k])
        columns[3, 2 * n] = a * residual[n, 0]
        columns[3, 2 * n + 1] = b * residual[n, 0] + c * residual[n, 1]
        stretch[2 * n], stretch[2 * n + 1] = a * x, b * x + c * y


@kernel
def _free(stretch, columns, scale, tolerance, along):  # type: ignore[no-untyped-def]
    """Make the columns orthogonal to the column of the scale; write their projections on it
    (4,)."""
    stretch[-1], columns[3, -1] = 1 / tolerance, (1 - scale) / tolerance
    square = (stretch**2).sum()
    for k in range(4):
        along[k] = (stretch * columns[k]).sum() / square
        for n in range(len(stretch)):
            columns[k, n] -= along[k] * stretch[n]


def tangent(plane: Floats) -> Floats:
    """Derivatives (n, 2, 3) of positions (n, 2) in the image plane by a small rotation."""
    design = np.empty((len(plane), 2, 3))
    for row, slopes in enumerate(plane_slopes.py_func(*plane.T)):
        for column, slope in enumerate(slopes):
            design[:, row, column] = slope
    return design


@core.printed
@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Errors that close stars, or all stars, share, as far as the tracker knows their statistics.

    columns, rows  pixel, size of the frame
    table          (q, p, 2, k) pixel, x and y at q x p places that span the frame: a root of the
                   covariance of the displacements, table table^T summed over k
    variance       pixel^2 per axis, mean over the frame; the systematic variance of stars contains
                   it
    turn           (3,) radian^2, variance of rotations between camera and spacecraft about the
                   camera's axes
    """

    columns: Annotated[int, Unit("pixel")]
    rows: Annotated[int, Unit("pixel")]
    table: Annotated[Floats, Unit("pixel")]
    variance: Annotated[float, Unit("pixel2")]
    turn: Annotated[Floats, Unit("rad2", "arcsec2")]

    def at(self, pixel: Floats) -> Floats:
        """The root (..., 2, k) at places (..., 2) pixel, from the nearest place of the table."""
        down, across = self.table.shape[:2]
        x = np.rint((pixel[..., 0] + 0.5) / self.columns * (across - 1)).astype(np.int64)
        y = np.rint((pixel[..., 1] + 0.5) / self.rows * (down - 1)).astype(np.int64)
        return self.table[np.clip(y, 0, down - 1), np.clip(x, 0, across - 1)]

    def added(self, gain: Floats, pixel: Floats) -> Floats:
        """Covariance to add to a covariance that assumes independent errors of all stars.

            G (S - variance 1) G^T + turn,   S = table table^T at the stars

        gain     (..., 3, n, 2) radian per pixel, of the attitude; zero for missing stars
        pixel    (..., n, 2) places of the stars
        Returns  (..., 3, 3) radian^2
        Accuracy  model: to first order in the errors; rotations about different axes are
                  independent.
        """
        root, flat = self.at(pixel), gain.reshape(*gain.shape[:-2], -1)
        moved = flat @ root.reshape(*flat.shape[:-2], flat.shape[-1], -1)
        apart = self.variance * flat @ flat.swapaxes(-1, -2)
        return moved @ moved.swapaxes(-1, -2) - apart + np.diag(self.turn)


def independent(gain: Floats, variance: Floats) -> Floats:
    """Covariance (..., 3, 3) radian^2 by errors of stars that are independent of each other.

    gain      (..., 3, n, 2) radian per pixel, of the attitude
    variance  (..., n) pixel^2 per axis
    """
    return np.einsum("...inx,...n,...jnx->...ij", gain, variance, gain)


def attitude_gain(plane: Floats, inverse: Floats, focal: float, tolerance: float = 0.0) -> Floats:
    """Derivative of the least-squares attitude by the measured places of its stars.

        G = (H^T M H + P)^-1 H^T M

    H are the derivatives of the places by a small rotation and, if it is estimated, by the scale. P
    is the prior information of the scale.

    plane      (..., n, 2) places of the stars in the image plane
    inverse    (..., n, 2, 2) 1 / pixel^2, M: inverse covariances; zero for missing stars
    focal      pixel, focal length
    tolerance  1, prior standard deviation of the relative focal length; 0: it is fixed
    Returns    (..., 3, n, 2) radian per pixel
    """
    count = plane.shape[-2]
    slopes = focal * tangent(plane.reshape(-1, 2)).reshape(*plane.shape, 3)
    if tolerance:
        slopes = np.concatenate([slopes, focal * plane[..., None]], axis=-1)
    prior = np.zeros(slopes.shape[-1])
    prior[3:] = tolerance**-2 if tolerance else 0.0
    flat = slopes.reshape(*slopes.shape[:-3], 2 * count, -1)
    left = (inverse @ slopes).reshape(flat.shape).swapaxes(-1, -2)
    gain = np.linalg.solve(left @ flat + np.diag(prior), left)
    return np.asarray(gain[..., :3, :].reshape(*gain.shape[:-2], 3, count, 2))
