"""Case -> outcomes of trials from drawn spots, with identification assumed to be perfect."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.spatial.transform import Rotation

from startrack.attitude import attitude_gain, independent, refine_all
from startrack.core import Flags, Floats, Ints, Rows, Streams, kernel
from startrack.design import Case
from startrack.metrics import JUDGED, judge_all
from startrack.observation import (
    in_believed_axes,
    mean_attitude,
    random_attitudes,
    reference_attitude,
)
from startrack.response import knowledge_of
from startrack.trial.effects import require_least_squares
from startrack.trial.spot_plan import SpotPlan, plan_spots, refuse
from startrack.trial.spots import false_spots, sights, trial_keys

UNIT = np.eye(2)
SURPRISE = 1e-3  # probability of the residuals by noise below which it does not explain them


class Fitted(NamedTuple):
    """Attitudes of m trials.

    icrs_to_camera  m rotations
    covariance      (m, 3, 3) radian^2, covariance that the tracker states
    observed        (m,) whether the stars determine the attitude
    """

    icrs_to_camera: Rotation
    covariance: Floats
    observed: Flags


def fitted(
    case: Case,
    matrix: Floats,
    seen: Floats,
    reference: Floats,
    noise: Floats,
    hot: Floats,
    there: Flags,
) -> Fitted:
    """Attitudes of m trials with up to n stars each, as `solve` finds them.

    matrix     (m, 3, 3) true icrs_to_camera, at which the identification predicts its stars
    seen       (m, n, 2) pixel, measured places
    reference  (m, n, 3) directions of the stars, in front of the camera
    noise      (m, n, 2, 2) pixel^2, covariance of the noise
    hot        (m, n) pixel^2, as `TrackerKnowledge.hot`
    there      (m, n) whether the star exists
    """
    camera, tolerance = case.believed_camera, case.tracker.identification.focal_tolerance
    if tolerance:
        towards = _turned(matrix, reference)
        predicted = camera.project(towards.reshape(-1, 3)).reshape(seen.shape)
        per_axis = np.trace(noise, axis1=2, axis2=3) / 2
        scale = 1 + np.clip(
            _scales(seen, predicted, per_axis, there, tolerance), -tolerance, tolerance
        )
        seen = camera.centre + (seen - camera.centre) / scale[:, None, None]
    observed = camera.unproject(seen.reshape(-1, 2)).reshape(reference.shape)
    plane, focal = observed[..., :2] / observed[..., 2:], camera.focal_length_px
    inverse = there[..., None, None] * _inverse(noise)
    best = refine_all(plane, inverse, reference, focal, matrix, tolerance)
    # Enlarged as in the tracker's solver if the noise does not explain the residuals.
    freedom = np.maximum(2 * there.sum(axis=1) - (4 if tolerance else 3), 1)
    chance = special.chdtrc(freedom, best.chi_square)
    excess = np.where(chance < SURPRISE, best.chi_square / freedom, 1.0)
    covariance = best.covariance * excess[:, None, None]
    shared = knowledge_of(case).shared
    if shared is not None or hot.any():
        enough = best.observed
        gain = attitude_gain(plane[enough], inverse[enough], focal, tolerance)
        if shared is not None:
            covariance[enough] += shared.added(gain, seen[enough])
        covariance[enough] += independent(gain, (hot * (excess == 1)[:, None])[enough])
    return Fitted(best.source_to_target, covariance, best.observed)


def _inverse(matrix: Floats) -> Floats:
    """Inverses of symmetric matrices (..., 2, 2); equal to the last bit for any number of them."""
    xx, xy, yy = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    adjugate = np.stack([yy, -xy, -xy, xx], axis=-1).reshape(matrix.shape)
    return np.asarray(adjugate / (xx * yy - xy * xy)[..., None, None])


@kernel
def _turned(matrix, direction):  # type: ignore[no-untyped-def]
    """Directions (m, n, 3) in the axes of m cameras; equal to the last bit for any n."""
    turned = np.empty_like(direction)
    for n in range(len(direction)):
        for k in range(direction.shape[1]):
            for i in range(3):
                turned[n, k, i] = (
                    matrix[n, i, 0] * direction[n, k, 0]
                    + matrix[n, i, 1] * direction[n, k, 1]
                    + matrix[n, i, 2] * direction[n, k, 2]
                )
    return turned


@kernel
def _scales(
    seen: Floats, predicted: Floats, noise: Floats, there: Flags, tolerance: float
) -> Floats:
    """Relative error of the focal length that the identification fits, (m,) 1.

    It fits the scale together with the attitude, to stars weighted by their noise, with a normal
    prior of the tolerance as standard deviation.
    """
    scale = np.zeros(len(seen))
    for n in range(len(seen)):
        x = y = total = 0.0
        for k in range(seen.shape[1]):
            if there[n, k]:
                w = 1 / noise[n, k]
                x, y, total = x + w * predicted[n, k, 0], y + w * predicted[n, k, 1], total + w
        x, y = x / max(total, 1e-300), y / max(total, 1e-300)
        along, size = 0.0, tolerance**-2
        for k in range(seen.shape[1]):
            if there[n, k]:
                w = 1 / noise[n, k]
                arm_x, arm_y = predicted[n, k, 0] - x, predicted[n, k, 1] - y
                along += w * arm_x * (seen[n, k, 0] - predicted[n, k, 0])
                along += w * arm_y * (seen[n, k, 1] - predicted[n, k, 1])
                size += w * (arm_x * arm_x + arm_y * arm_y)
        scale[n] = along / size
    return scale


BLOCK = 1024  # number of trials that are drawn together
TOGETHER = 64  # number of trials that are solved together


def outcomes(
    case: Case,
    seed: int,
    numbers: Sequence[int],
    icrs_to_camera: Rotation | None = None,
    plan: SpotPlan | None = None,
) -> Rows:
    """The outcomes of some trials, with identification assumed to be perfect.

        centroid = projection + bias + root N(0, 1),   found with the probability kept Phi(above)

    These values come from the tracker's detection. It measures noise-free stars, rendered with
    smear and the response of the pixels, in steps of half a magnitude at 36 positions in the pixel.

    icrs_to_camera  a true attitude for each; None: the attitudes of these trials in all fidelities
    plan            plan of the case; None: `plan_spots`
    Returns  (n,) structured array, as `judge_all` gives it, in the order of `numbers`
    Raises    ValueError with the effect that needs an image.
    Accuracy  model: normal errors, to first order in the noise; single stars with the smear of the
              field's centre and shifts by companions; false spots are counted and never matched.
              For the example design the rms attitude error agrees with frames within 5 %. In
              crowded fields it is 10 % smaller, because frames have merged stars with larger
              errors.
    """
    refuse(case)
    require_least_squares(case)
    plan = plan or plan_spots(case)
    parts = []
    for at in range(0, len(numbers), BLOCK):
        block = numbers[at : at + BLOCK]
        if icrs_to_camera is None:
            attitude = random_attitudes(seed, block)
        else:
            attitude = icrs_to_camera[at : at + BLOCK]
        parts.append(_tried(case, plan, seed, block, attitude))
    return np.concatenate(parts) if parts else np.empty(0, JUDGED)


class Drawn(NamedTuple):
    """Draws of m trials, up to n stars each.

    pixel     (m, n, 2) pixel, x and y of the centroids
    star      (m, n) index into the field of the plan
    noise     (m, n, 2, 2) pixel^2, covariances of the noise
    matched   (m,) number of matched stars, at most n
    spots     (m,) number of spots, false spots included
    """

    pixel: Floats
    star: Ints
    noise: Floats
    matched: Ints
    spots: Ints


def _tried(
    case: Case, plan: SpotPlan, seed: int, numbers: Sequence[int], attitude: Rotation
) -> Rows:
    """Draw, solve and judge a block of trials."""
    many, streams = len(numbers), [Streams(seed, number) for number in numbers]
    instrument, jitters = case.instrument, case.instrument.motion.jitters
    seen_at = attitude
    if jitters:
        pairs = zip(attitude, streams, strict=True)
        seen_at = Rotation.concatenate([mean_attitude(instrument, *pair) for pair in pairs])
    matrix = seen_at.as_matrix()
    keys = trial_keys(seed, np.array(numbers, np.uint64))
    most = case.tracker.detection.max_spots
    matched, spots = np.empty((2, many), np.int64)
    pixel, noise = np.empty((many, most, 2)), np.empty((many, most, 2, 2))
    drawn = Drawn(pixel, np.empty((many, most), np.int64), noise, matched, spots)
    _draw(matrix, keys, plan, drawn)
    own = case.time_tag_error or case.instrument.mounting.swings
    if own or (jitters and case.tracker.reference == "mean"):
        trials = zip(attitude, streams, strict=True)
        truth = Rotation.concatenate([reference_attitude(case, *trial) for trial in trials])
    else:
        truth = in_believed_axes(case, attitude, streams[0])
    judged = np.empty(many, JUDGED)
    # Trials with similar numbers of stars are solved together, so that few array elements are
    # empty.
    for part in np.array_split(np.argsort(matched, kind="stable"), -(-many // TOGETHER)):
        used = max(int(matched[part[-1]]), 1)
        there = np.arange(used) < matched[part, None]
        stars = np.where(there, drawn.star[part, :used], 0)
        # Empty elements lie on the boresight, where they have no effect.
        reference = np.where(there[..., None], plan.field.believed[stars], matrix[part, None, 2])
        # Only drawn elements are summed: the other elements of the arrays are arbitrary.
        noise = np.where(there[..., None, None], drawn.noise[part, :used], UNIT)
        noise[there] += plan.field.systematic[stars[there]][..., None, None] * UNIT
        hot = np.where(there, plan.field.hot[stars], 0.0)
        seen = np.where(there[..., None], drawn.pixel[part, :used], 0.0)
        best = fitted(case, matrix[part], seen, reference, noise, hot, there)
        enough = matched[part] >= case.tracker.identification.min_matches
        solved = enough & best.observed
        judged[part] = judge_all(
            best.icrs_to_camera, best.covariance, truth[part], matched[part], spots[part], solved
        )
    return judged


@kernel
def _draw(attitude: Floats, keys: NDArray[np.uint64], plan: SpotPlan, drawn: Drawn) -> None:
    """Write the detected stars of each trial, and the numbers of its matches and spots."""
    _, _, field, _, view, gate, false, through, _ = plan
    most = drawn.star.shape[1]
    flux = np.empty(most)
    for n in range(len(attitude)):
        count = others = 0
        for seen in sights(attitude[n], keys[n], plan):
            i = seen.star
            # The tracker assumes a focal length for the star's colour.
            stretch = field.stretch[i] / (1 + field.stretch[i])
            dx = seen.dx - stretch * (seen.x + seen.dx - view.centre_x)
            dy = seen.dy - stretch * (seen.y + seen.dy - view.centre_y)
            xx, xy = seen.xx * seen.xx, seen.xx * seen.yx
            yy = seen.yx * seen.yx + seen.yy * seen.yy
            wide = field.systematic[i] + through.slack
            determinant = (xx + wide) * (yy + wide) - xy * xy
            square = (yy + wide) * dx * dx - 2 * xy * dx * dy + (xx + wide) * dy * dy
            if not field.known[i] or square > gate * gate * determinant:
                others += 1
                continue
            at = count
            if count == most:  # the brightest stars are kept
                at = int(np.argmin(flux))
                if flux[at] >= field.flux[i]:
                    continue
            else:
                count += 1
            drawn.pixel[n, at, 0], drawn.pixel[n, at, 1] = seen.x + dx, seen.y + dy
            drawn.star[n, at], flux[at] = i, field.flux[i]
            drawn.noise[n, at, 0, 0], drawn.noise[n, at, 1, 1] = xx, yy
            drawn.noise[n, at, 0, 1] = drawn.noise[n, at, 1, 0] = xy
        drawn.matched[n] = count
        drawn.spots[n] = min(count + others + false_spots(keys[n], false), most)
