"""Case, attitude and image of a trial -> its linearised error, and the exact mean of it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude import attitude_gain, refine
from startrack.core import Camera, Flags, Floats, Frame, Ints, Refused, Stars
from startrack.design import Case
from startrack.detection import Response, half_of, joined, peak_border, response
from startrack.detector import Detector, law_of, require_independent_pixels
from startrack.observation import detection_plan
from startrack.response import knowledge_of
from startrack.trial import pattern_indexes

FEWEST = 3  # stars; two determine an attitude, one more checks it
SAME = 2.0  # pixel, between two stars that make one spot
NEAR = 2.0  # pixel beyond the border, within which a spot's star may lie
FULL = 0.8  # of the full well; above, a pixel's number is not linear in its light


class Control(NamedTuple):
    """A trial to first order in its pixel noise; its expectation over that noise is exact.

    linear    (3,) radian, error of the attitude about the camera's axes
    middle    (3,) radian, its mean: the error without noise
    variance  (3,) radian^2, about that mean
    """

    linear: Floats
    middle: Floats
    variance: Floats


def control(
    case: Case, icrs_to_camera: Rotation, stars: Stars, electrons: Floats, image: Floats
) -> Control | None:
    """Linearise a trial about its expected image.

        error = e0 + G sum_p g_p (N_p - mean N_p),   variance = sum_p (G g_p)^2 var N_p

    G is the weighted least-squares gain of the attitude, g_p the derivative of a centroid by pixel
    p. The choice of stars and their weights depend only on the attitude, never on the noise. Mean
    and variance therefore follow from a fixed linear function of independent pixels.

    electrons  (rows, columns) expected, as `expected` gives them
    image      (rows, columns) digital numbers drawn from them
    Returns    None if fewer than three stars are bright enough
    Raises     ValueError for pixels that depend on each other, or a non-linear converter.
    Accuracy   numerical: rounding counts as uniform noise of variance 1/12, which is right within
               1e-8 for noise above 1 digital number; saturated pixels are left out.
    """
    detector, camera = case.instrument.detector, case.instrument.camera
    mean, variance = _law(detector, electrons)
    sigma = np.sqrt(variance)
    settings = case.tracker.detection
    plan = detection_plan(case)
    side = half_of(plan)
    pixel = _inside(stars.direction, icrs_to_camera, camera, max(side, peak_border(settings)))[0]
    x, y = np.rint(pixel).astype(np.int64).T
    frame = Frame(
        mean.astype(np.float32),
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        detector.noise,
    )
    if not len(pixel):
        return None
    answer = _apart(
        pixel, 2 * side + 2, lambda part: response(frame, x[part], y[part], sigma, plan)
    )
    good = (answer.snr > settings.threshold) & ~_merged(answer.place)
    good &= np.isfinite(answer.slope).all(axis=(1, 2, 3))
    answer, direction, systematic = _known(answer.of(good), case, icrs_to_camera)
    weight = answer.covariance + systematic[:, None, None] * np.eye(2)
    kept = _agreeing(answer.place, weight, direction, icrs_to_camera, case)
    if len(kept) < FEWEST:
        return None
    answer, direction = answer.of(kept), direction[kept]
    weight = weight[kept]
    believed, tolerance = case.believed_camera, case.tracker.identification.focal_tolerance
    fitted = refine(answer.place, weight, direction, believed, icrs_to_camera, tolerance)
    gain = _gain(direction, weight, case, fitted.icrs_to_camera)
    place, slope = _by_pixel(answer, gain, detector.columns)
    slope = slope * (electrons.ravel()[place] < FULL * detector.full_well)
    middle = (fitted.icrs_to_camera * icrs_to_camera.inv()).as_rotvec()
    noise = image.ravel()[place] - mean.ravel()[place]
    return Control(middle + slope @ noise, middle, slope**2 @ variance.ravel()[place])


def _apart(pixel: Floats, distance: float, answer: Callable[[Flags], Response]) -> Response:
    """Responses of stars, computed in groups without shared pixels."""
    near = np.tril(np.abs(pixel[:, None] - pixel).max(axis=2) < distance, -1)
    parts, left = [], np.ones(len(pixel), bool)
    while left.any():
        turn = left.copy()
        for star in np.flatnonzero(left):
            turn[star] = not (near[star] & turn).any()
        parts.append((turn, answer(turn)))
        left &= ~turn
    order = np.argsort(np.concatenate([np.flatnonzero(turn) for turn, _ in parts]))
    return joined([answered for _, answered in parts]).of(order)


def _agreeing(
    place: Floats, covariance: Floats, direction: Floats, start: Rotation, case: Case
) -> Ints:
    """The stars within the tracker's gate; the worst is removed first."""
    camera, tolerance = case.believed_camera, case.tracker.identification.focal_tolerance
    kept = np.arange(len(place))
    while len(kept) >= FEWEST:
        fitted = refine(place[kept], covariance[kept], direction[kept], camera, start, tolerance)
        worst = int(np.argmax(fitted.chi_square))
        if fitted.chi_square[worst] <= case.tracker.attitude.gate**2:
            break
        kept = np.delete(kept, worst)
    return kept


def _merged(place: Floats) -> Flags:
    """Stars that share the spot of a brighter one, which precedes them."""
    distance = np.abs(place[:, None] - place).max(axis=2)
    return np.asarray(np.tril(distance < SAME, -1).any(axis=1))


def _by_pixel(answer: Response, gain: Floats, columns: int) -> tuple[Ints, Floats]:
    """Pixels (m,) as indices of the flat image, and derivatives (3, m) of the attitude by them."""
    slope = np.einsum("kna,naji->knji", gain, answer.slope).reshape(3, -1)
    step = np.arange(answer.slope.shape[-1])
    rows = (answer.corner[:, 1, None] + step)[:, :, None]
    place = rows * columns + (answer.corner[:, 0, None] + step)[:, None, :]
    unique, where = np.unique(place, return_inverse=True)
    summed = [np.bincount(where.ravel(), line, len(unique)) for line in slope]
    return unique, np.array(summed, float)


def _law(detector: Detector, electrons: Floats) -> tuple[Floats, Floats]:
    """Mean and variance of the numbers of independent pixels, away from the limits of the
    converter."""
    require_independent_pixels(detector)
    if detector.nonlinearity or detector.adc_inl or detector.hits:
        raise Refused("a control variate needs a detector without nonlinearity, adc_inl and hits")
    law = law_of(detector)
    mean = electrons * law.gain + law.offset
    return mean, law.gain**2 * (electrons + law.noise**2) + 1 / 12


def _known(
    answer: Response, case: Case, icrs_to_camera: Rotation
) -> tuple[Response, Floats, Floats]:
    """The spots near stars of the tracker's catalogue; their directions and systematic variances.

    The catalogue of the identification merges the stars that make one spot. A spot belongs to
    the nearest.
    """
    camera = case.believed_camera
    index = pattern_indexes(case.believed_catalog)(camera)
    pixel, direction, star = _inside(index.faint.direction, icrs_to_camera, camera, -NEAR)
    systematic = knowledge_of(case).systematic[index.faint.member[star]]
    if not len(pixel):
        return answer.of(np.zeros(len(answer.place), bool)), direction, systematic
    square = ((answer.place[:, None] - pixel) ** 2).sum(axis=2)
    nearest = np.argmin(square, axis=1)
    near = square.min(axis=1) < case.tracker.identification.match_radius**2
    chosen = nearest[near]
    return answer.of(near), direction[chosen], systematic[chosen]


def _inside(
    direction: Floats, icrs_to_camera: Rotation, camera: Camera, border: float
) -> tuple[Floats, Floats, Ints]:
    """Pixels and directions of the stars at least `border` inside the frame, and their indices."""
    boresight = icrs_to_camera.inv().apply([0.0, 0.0, 1.0])
    radius = camera.half_diagonal + NEAR / camera.focal_length_px
    ahead = np.flatnonzero(direction @ boresight > math.cos(radius))
    pixel = camera.project(icrs_to_camera.apply(direction[ahead]))
    inside = camera.holds(pixel, -border)
    return pixel[inside], direction[ahead[inside]], ahead[inside]


def _gain(direction: Floats, covariance: Floats, case: Case, attitude: Rotation) -> Floats:
    """(3, n, 2) radian per pixel: derivative of the attitude by its centroids.

    A tracker that refines its focal length fits it together with the attitude.
    """
    x, y, z = attitude.apply(direction).T
    plane, tolerance = np.column_stack([x / z, y / z]), case.tracker.identification.focal_tolerance
    focal = case.believed_camera.focal_length_px
    inverse: Floats = np.linalg.inv(covariance).astype(np.float64)
    return attitude_gain(plane, inverse, focal, tolerance)
