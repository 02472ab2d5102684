"""Case -> centroid errors of single stars: by formula, in boxes, and in trials."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import observation, response, trial
from startrack.budget.analytic import HOT, measured_response
from startrack.catalog import open_sky
from startrack.core import Advance, Floats, Ints, Streams
from startrack.design import Case
from startrack.motion import stability

STEP = 10  # every tenth row of the formula's table is used


def single_stars(case: Case, seed: int = 0) -> trial.SingleStars:
    """Errors of single stars by the formula of the budget, or by stars drawn in boxes.

    The formula's errors are means over zones of the frame and over colours; its usual error is the
    error without hot pixels. Common shifts of all stars of a frame, and neighbours, are left out.

    seed      seed of the drawn stars
    Accuracy  as for `boxed_stars` and `analytic`.
    """
    if trial.boxed(case):
        return trial.boxed_stars(case, seed)
    of_stars = measured_response(case)
    table, rows = of_stars.table, slice(None, None, STEP)
    by_cause = {
        name: np.trace(table.causes[:, k, rows], axis1=2, axis2=3).mean(axis=0) / 2
        for k, name in enumerate(of_stars.random)
    }

    def rms(*without: str, only: tuple[str, ...] = tuple(by_cause)) -> Floats:
        parts = [by_cause[name] for name in only if name not in without]
        return np.asarray(np.sqrt(np.sum(parts, axis=0)))

    measured = table.fraction[:, rows].mean(axis=0)
    magnitude: Floats = table.start + table.step * STEP * np.arange(len(measured), dtype=float)
    stated = np.sqrt(np.trace(table.stated[:, rows], axis1=2, axis2=3).mean(axis=0) / 2)
    noise, method = rms(only=(response.SHOT, response.READ)), rms(only=(response.METHOD,))
    return trial.SingleStars(
        magnitude=magnitude,
        measured=measured,
        stated=stated,
        temporal=noise,
        method=method,
        total=rms(),
        usual=rms(HOT),
    )


class Residuals(NamedTuple):
    """Matched stars of some trials.

    trial      (n,)
    position   (n, 2) pixel, true
    magnitude  (n,) G of a sunlike star of equal brightness
    error      (n, 2) pixel, measured minus true
    """

    trial: Ints
    position: Floats
    magnitude: Floats
    error: Floats


def residuals(case: Case, seed: int, trials: int, progress: Advance = lambda _: None) -> Residuals:
    """Measured positions of stars minus true positions, by the true attitude and camera.

    progress  called after each trial
    """
    stars, believed = open_sky(case.catalog).stars, open_sky(case.believed_catalog).stars
    true, _ = stars.find(believed.identifier)
    faint = observation.colour_correction(case, stars.colour)
    parts = []
    for number in range(trials):
        streams = Streams(seed, number)
        record = trial.observe(case, observation.random_attitude(streams), streams)
        matches, spots = record.matches, record.spots
        star = true[matches.star]
        # If the tracker merges two stars, their light has one position.
        pixel = case.instrument.camera.project(record.icrs_to_camera.apply(matches.direction))
        seen = np.column_stack([spots.x, spots.y])[matches.spot]
        magnitude = stars.magnitude_g[star] + faint[star]
        parts.append(Residuals(np.full(len(star), number), pixel, magnitude, seen - pixel))
        progress(1)
    return Residuals(*(np.concatenate(column) for column in zip(*parts, strict=True)))


class StarErrors(NamedTuple):
    """Matched stars of some trials.

    magnitude  (n,) G
    radius     (n,) pixel, from the middle of the frame
    error      (n, 2) pixel, centroid minus true position at the middle of the exposure
    trials     number of trials
    """

    magnitude: Floats
    radius: Floats
    error: Floats
    trials: int


def star_errors(
    case: Case, seed: int, numbers: Sequence[int], icrs_to_camera: Rotation, progress: Advance
) -> StarErrors:
    """Repeat trials, and keep the error of each star, which `Outcome` does not contain.

    icrs_to_camera  the true attitude of each trial
    """
    rows = [np.empty((0, 4))]
    for number, attitude in zip(numbers, icrs_to_camera, strict=True):
        rows.append(_stars(case, trial.observe(case, attitude, Streams(seed, number))))
        progress(1)
    magnitude, radius, x, y = np.concatenate(rows).T
    return StarErrors(magnitude, radius, np.column_stack([x, y]), len(numbers))


def _stars(case: Case, record: trial.Record) -> Floats:
    """(m, 4): magnitude, radius and error of the matched stars, at the mean line of sight."""
    if not record.outcome.solved or record.outcome.false:
        return np.empty((0, 4))
    camera, matches = case.instrument.camera, record.matches
    # A centroid measures the mean position during the exposure, so the true position is taken at
    # the
    # mean line of sight.
    mean = stability(record.path).mean
    turned = record.icrs_to_camera.apply(matches.direction)
    position = camera.project(turned + np.cross(mean, turned))
    spots = np.column_stack([record.spots.x, record.spots.y])[matches.spot]
    # The directions come from the tracker's catalogue, so magnitudes are looked up by direction.
    near = np.argmax(matches.direction @ record.stars.direction.T, axis=1)
    radius = np.hypot(*(position - camera.centre).T)
    return np.column_stack([record.stars.magnitude_g[near], radius, spots - position])
