"""Spots and Matches -> Estimate: attitude, covariance and status; also by user code."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy import special
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude.consensus import consensus
from startrack.attitude.parameters import UNKNOWN_FLOOR, SolverSettings
from startrack.attitude.refine import Refinement, SharedErrors, attitude_gain, independent, refine
from startrack.attitude.wahba import svd
from startrack.core import Estimate, Floats, Ints, Refused, Unit

GROUP = "attitudes"
EXACT = 1e-6  # largest element of R R^T - 1 that is accepted for a rotation matrix
NO_COVARIANCE = np.full((3, 3), np.nan)
MEDIAN_CHI_SQUARE = 2 * np.log(2)  # of two degrees of freedom
# Probability of larger residuals by noise alone below which the covariance is enlarged. Chosen by
# hand: a larger one enlarges it too often, a smaller one ignores distortion and catalogue errors.
SIGNIFICANCE = 1e-3
FEWEST = 4  # matches that are always kept: with fewer, residuals do not show an outlier


@dataclass(frozen=True, eq=False)
class AttitudeInput:
    """Matched stars from which a user's function estimates the attitude.

    seen       (n, 3) unit vectors in camera axes, by the tracker's camera model
    direction  (n, 3) unit vectors of the same stars, ICRS axes
    sigma      (n,) radian, standard deviation of each star per axis, systematic part included

    The function returns the rotation matrix icrs_to_camera (3, 3); then startrack computes the
    covariance from the change of the attitude with each star. Or it returns (6, 3): below the
    matrix its covariance, radian^2 about the camera's axes.
    """

    seen: Floats
    direction: Floats
    sigma: Floats


def attitude_by_code(name: str, given: AttitudeInput) -> tuple[Rotation, Floats]:
    """The attitude icrs_to_camera and its covariance (3, 3), from user code that a design names.

    Raises  ValueError if the function raises an error, or returns an invalid result.
    """
    estimate = _estimated(name, given)
    attitude = Rotation.from_matrix(estimate[:3])
    if len(estimate) == 6:
        covariance = (estimate[3:] + estimate[3:].T) / 2
        if (np.linalg.eigvalsh(covariance) <= 0).any():
            raise ValueError(
                f"{core.POINTS[GROUP]} {name} must return a positive definite covariance"
            )
        return attitude, covariance
    return attitude, _propagated(name, given, attitude)


def _estimated(name: str, given: AttitudeInput) -> Floats:
    result = core.returned(GROUP, name, core.call_code(GROUP, name, given), ((3, 6), 3))
    turn = result[:3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > EXACT or np.linalg.det(turn) < 0:
        raise ValueError(f"{core.POINTS[GROUP]} {name} must return a rotation matrix, got {turn}")
    return result


def _propagated(name: str, given: AttitudeInput, attitude: Rotation) -> Floats:
    """Covariance from the noise of each star along two directions, to first order.

    C = sum_i r_i r_i^T,   r_i the rotation of the attitude when a direction moves by its sigma
    """
    total = np.zeros((3, 3))
    for n, (direction, sigma) in enumerate(zip(given.seen, given.sigma, strict=True)):
        least = np.eye(3)[np.abs(direction).argmin()]
        first = np.cross(direction, least)
        first /= np.linalg.norm(first)
        for across in (first, np.cross(direction, first)):
            moved = given.seen.copy()
            moved[n] += sigma * across
            moved[n] /= np.linalg.norm(moved[n])
            estimate = _estimated(name, AttitudeInput(moved, given.direction, given.sigma))
            turn = (Rotation.from_matrix(estimate[:3]) * attitude.inv()).as_rotvec()
            total += np.outer(turn, turn)
    return total


@core.printed
@dataclass(frozen=True, eq=False)
class KnownErrors:
    """Known errors of m matched stars, in addition to the noise of their centroids.

    systematic  (m,) pixel^2 per axis, variance by causes other than noise; None: the square of
                `SolverSettings.centroid_floor`
    shared      errors that stars share, which the covariance then includes; None: none are known
    hot         (m,) pixel^2 per axis, mean variance by hot pixels; which stars have them is
                unknown. It changes no weight; the covariance includes it if the residuals are not
                larger than noise; None: zero
    """

    systematic: Annotated[Floats | None, Unit("pixel2")] = None
    shared: SharedErrors | None = None
    hot: Annotated[Floats | None, Unit("pixel2")] = None


NONE_KNOWN = KnownErrors()


def solve(
    spots: core.Spots,
    matches: core.Matches,
    settings: SolverSettings,
    tolerance: float = 0.0,
    known: KnownErrors = NONE_KNOWN,
) -> Estimate:
    """The attitude from matched stars, weighted by the covariance of their centroids.

    Stars beyond the gate are left out, the worst first, as long as more than half stay. The other
    residuals may be larger than the noise of the centroids explains: noise exceeds their chi-square
    with a probability below 0.001. In that case the covariance is multiplied by chi-square over its
    degrees of freedom, to include errors of distortion and catalogue. Otherwise it is not changed:
    enlarging it for every upward fluctuation would overstate the error on average.

    spots      all spots of the frame
    matches    matches of these spots; their `camera` is used
    tolerance  1, prior standard deviation of the relative focal length, which is estimated with the
               attitude; 0: it is fixed
    known      known errors of the matched stars
    Returns    Estimate; not solved if the matches are not solved or do not determine the attitude
    """
    if matches.status is not core.Status.SOLVED:
        return _unsolved(matches, matches.status, matches.reason)
    pixel = np.column_stack([spots.x, spots.y])[matches.spot]
    systematic = known.systematic
    if systematic is None:
        floor = settings.centroid_floor
        systematic = np.full(len(matches), (UNKNOWN_FLOOR if floor is None else floor) ** 2)
    covariance = spots.covariance[matches.spot] + systematic[:, None, None] * np.eye(2)
    if core.is_code(settings.method):
        return _by_code(settings.method, pixel, covariance, matches)
    try:
        best, used = _fit_within_gate(pixel, covariance, matches, settings, tolerance)
    except (Refused, np.linalg.LinAlgError) as error:
        return _unsolved(matches, core.Status.TOO_FEW, str(error))
    freedom = 2 * len(used) - (4 if tolerance else 3)
    total = float(best.chi_square.sum())
    chance = special.chdtrc(freedom, total) if freedom > 0 else 1.0
    excess = total / freedom if chance < SIGNIFICANCE else 1.0
    stated, shared, hot = best.covariance * excess, known.shared, known.hot
    if excess > 1 or (hot is not None and not hot.any()):
        hot = None
    if shared is not None or hot is not None:
        # The places of the stars, predicted by the attitude.
        direction = best.icrs_to_camera.apply(matches.direction[used])
        plane, focal = direction[:, :2] / direction[:, 2:], matches.camera.focal_length_px
        inverse: Floats = np.linalg.inv(covariance[used]).astype(np.float64)
        gain = attitude_gain(plane, inverse, focal, tolerance)
        if shared is not None:
            stated = stated + shared.added(gain, pixel[used])
        if hot is not None:
            stated = stated + independent(gain, hot[used])
    return Estimate(
        status=core.Status.SOLVED,
        reason=matches.reason,
        icrs_to_camera=best.icrs_to_camera,
        covariance=stated,
        residual_rms=float(np.sqrt(np.mean(best.residual**2))),
        stars=len(used),
        false_probability=matches.false_probability,
        used=used,
    )


def _fit_within_gate(
    pixel: Floats,
    covariance: Floats,
    matches: core.Matches,
    settings: SolverSettings,
    tolerance: float,
) -> tuple[Refinement, Ints]:
    """The fit to the stars within the gate, and their numbers; arguments as for `solve`."""
    used = np.arange(len(matches))
    if settings.sift:
        used = _agreeing(pixel, covariance, matches, settings.gate)
    allowed = len(used)
    best = _fit(pixel, covariance, matches, used, tolerance)
    while len(used) > FEWEST:
        typical = np.median(best.chi_square) / MEDIAN_CHI_SQUARE
        gate = settings.gate**2 * max(1.0, typical)
        worst = np.argmax(best.chi_square)
        if best.chi_square[worst] <= gate or len(used) <= allowed / 2:
            break
        used = np.delete(used, worst)
        best = _fit(pixel, covariance, matches, used, tolerance)
    return best, used


def _by_code(name: str, pixel: Floats, covariance: Floats, matches: core.Matches) -> Estimate:
    """The estimate by user code that the design names."""
    camera = matches.camera
    sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2) / camera.focal_length_px
    given = AttitudeInput(camera.unproject(pixel), matches.direction, sigma)
    attitude, attitude_covariance = attitude_by_code(name, given)
    residual = pixel - camera.project(attitude.apply(matches.direction))
    return Estimate(
        *(core.Status.SOLVED, matches.reason, attitude, attitude_covariance),
        *(float(np.sqrt(np.mean(residual**2))), len(matches), matches.false_probability),
    )


def _fit(
    pixel: Floats, covariance: Floats, matches: core.Matches, used: Ints, tolerance: float
) -> Refinement:
    pixel, covariance, direction = pixel[used], covariance[used], matches.direction[used]
    weight = 2 / np.trace(covariance, axis1=1, axis2=2)
    start = svd(matches.camera.unproject(pixel), direction, weight)
    return refine(pixel, covariance, direction, matches.camera, start, tolerance)


def _agreeing(pixel: Floats, covariance: Floats, matches: core.Matches, gate: float) -> Ints:
    """Indices of the stars that agree on one attitude; all stars if fewer than 4 agree."""
    sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2) / matches.camera.focal_length_px
    agree = consensus(matches.camera.unproject(pixel), matches.direction, sigma, gate)
    return np.flatnonzero(agree) if agree.sum() >= FEWEST else np.arange(len(matches))


def _unsolved(matches: core.Matches, status: core.Status, reason: str) -> Estimate:
    return Estimate(
        status=status,
        reason=reason,
        icrs_to_camera=None,
        covariance=NO_COVARIANCE,
        residual_rms=float("nan"),
        stars=len(matches),
        false_probability=matches.false_probability,
    )
