"""Stars that a tracker measures in its search boxes: in a frame, or single stars by magnitude."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.catalog import Selection, open_sky
from startrack.core import Camera, Floats, Frame, Ints, Matches, Spots, Streams, Unit, kept
from startrack.design import Case, Tracker
from startrack.detection import Detection, DetectionPlan, Taken, box_reach, take
from startrack.detector import dark, flickering, frame_of, response, to_frame
from startrack.observation import as_believed, detection_plan, electrons_of, nearby, sky_electrons
from startrack.response import magnitudes, point_images, scale, star_images, within_frame
from startrack.trial.window import frame_in_windows

BOX = "box"
# Catalogue number of a star -> pixel (column, row) right below the middle of its image.
Images = dict[int, tuple[int, int]]
MARGIN = 4  # pixel, margin around a box, for the images of stars at its border


def boxed(case: Case) -> bool:
    """Whether the tracker searches boxes once it has an attitude."""
    return case.tracker.acquisition == BOX


def expected_attitude(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Rotation:
    """The attitude that the tracker expects in a trial: the true one plus the prior's error."""
    error = case.tracker.box.prior * streams("expected attitude").standard_normal(3)
    return Rotation.from_rotvec(error) * icrs_to_camera


def targets(case: Case, camera: Camera, expected: Rotation) -> tuple[Ints, Floats]:
    """Stars (m,) of the tracker's catalogue whose boxes lie inside the frame, and their places.

    They are in the order of brightness, brightest first.
    """
    sky, box = open_sky(case.believed_catalog), case.tracker.box
    near = nearby(sky, expected, camera)
    place = camera.project(expected.apply(sky.stars.direction[near]))
    border = box_reach(box, camera.focal_length_px) + MARGIN + 1
    complete = (place >= border).all(axis=1)
    complete &= (place <= np.array([camera.columns, camera.rows]) - 1 - border).all(axis=1)
    chosen = np.flatnonzero(complete)[: box.stars]
    return near[chosen], place[chosen]


def follow_boxes(
    case: Case,
    frame: Frame,
    camera: Camera,
    expected: Rotation,
    images: Images,
    plan: DetectionPlan | None = None,
) -> tuple[Spots, Matches, Images]:
    """Measure stars in boxes around the places where the tracker expects them.

    images   images of stars after the previous exposure. Stars without an image, and stars whose
             image has left their box, are searched for
    Returns  the spots, their matches with the stars of their boxes, and `images` after this
             exposure
    """
    star, place = targets(case, camera, expected)
    flux = believed_electrons(case)[star]
    half_side = box_reach(case.tracker.box, camera.focal_length_px)
    frame = as_believed(case, frame)
    plan = plan or detection_plan(case)
    corners = np.array([images.get(int(n), (-1, -1)) for n in star], np.int64).reshape(-1, 2)
    flux = flux / frame.electrons_per_dn
    taken = take(frame, place, flux, half_side, case.tracker.box, plan, corners)
    after = {
        int(n): (int(x), int(y))
        for n, (x, y), measured in zip(star, taken.corner, taken.found, strict=True)
        if measured
    }
    return taken.spots(), matched(case, taken, star, camera, expected), after


def boxes_in_windows(
    case: Case, icrs_to_camera: Rotation, streams: Streams
) -> tuple[Spots, Matches]:
    """`follow_boxes` of a single trial; only the boxes of its frame are rendered."""
    camera, expected = case.believed_camera, expected_attitude(case, icrs_to_camera, streams)
    _, place = targets(case, camera, expected)
    far = box_reach(case.tracker.box, camera.focal_length_px) + MARGIN + 2
    corner = np.clip(np.floor(place - far), 0, None).astype(np.int64)
    end = np.minimum(np.ceil(place + far).astype(np.int64), [camera.columns, camera.rows])
    frame = frame_in_windows(case, icrs_to_camera, streams, np.hstack([corner, end]))
    return follow_boxes(case, frame, camera, expected, {})[:2]


def matched(case: Case, taken: Taken, star: Ints, camera: Camera, expected: Rotation) -> Matches:
    """Match each spot with the star of its box; the solver rejects false spots."""
    star = star[taken.found]
    direction = open_sky(case.believed_catalog).stars.direction[star]
    spot = np.arange(len(star))
    if len(star) < 2:
        reason = f"{len(star)} of the search boxes had a star, 2 are needed"
        return Matches(
            status=core.Status.TOO_FEW,
            reason=reason,
            spot=spot[:0],
            star=star[:0],
            direction=direction[:0],
            camera=camera,
            icrs_to_camera=None,
            false_probability=1.0,
        )
    reason = f"{len(star)} of {len(taken.x)} search boxes had a star"
    return Matches(
        status=core.Status.SOLVED,
        reason=reason,
        spot=spot,
        star=star,
        direction=direction,
        camera=camera,
        icrs_to_camera=expected,
        false_probability=float("nan"),
    )


def agreeing(tracker: Tracker) -> Tracker:
    """The tracker with a solver that keeps the largest set of agreeing stars (rejects others)."""
    return replace(tracker, attitude=replace(tracker.attitude, sift=True))


def believed_electrons(case: Case) -> Floats:
    """Electrons (n,) that the tracker expects of each star of its catalogue in an exposure."""
    return _electrons(case.as_designed, case.believed_catalog)


@kept(4)
def _electrons(case: Case, catalog: Selection) -> Floats:
    tracker = replace(case.tracker, catalog=None)
    return electrons_of(replace(case, catalog=catalog, tracker=tracker))


SIDE = 16  # number of stars along a side of the drawn detector
TIMES = 2  # number of exposures of each star
STEP = 2  # every second magnitude of a chart is drawn
FEWEST = 8  # least number of stars of a magnitude for which errors are stated
MEDIAN = 0.6745  # median absolute value of a normal error, over its sigma
NEAR = 1.0  # pixel, distance from the true place within which a spot is the star


@core.printed
class SingleStars(NamedTuple):
    """Centroids of single stars of m magnitudes; errors are pixel rms per axis.

    magnitude  (m,) G of a sunlike star
    measured   (m,) 1, fraction of the stars that are found, false spots not counted
    stated     (m,) error that the tracker states: noise, and the light outside the box
    temporal   (m,) error from exposure to exposure on the same pixels
    method     (m,) error over places in the pixel, without noise and on equal pixels
    total      (m,) error over exposures, places and pixels, without the shift that all stars share
    usual      (m,) `total` without the few stars that hot pixels shift far
    """

    magnitude: Annotated[Floats, Unit("mag")]
    measured: Floats
    stated: Annotated[Floats, Unit("pixel")]
    temporal: Annotated[Floats, Unit("pixel")]
    method: Annotated[Floats, Unit("pixel")]
    total: Annotated[Floats, Unit("pixel")]
    usual: Annotated[Floats, Unit("pixel")]


@kept(8)
def boxed_stars(case: Case, seed: int = 0) -> SingleStars:
    """Draw stars at random places, each on other pixels, find them in boxes and follow them.

    The usual error is the median absolute error over the median absolute value of a standard normal
    variable. The magnitudes are those of the tracker's catalogue at which no star saturates.

    Accuracy  model: a star moves neither within an exposure nor between the two exposures that give
              the temporal error; pixels flicker between these two exposures. numerical: 3 % (1
              sigma) if the errors are normal. In aged detectors a few hot pixels cause most of the
              total, which then varies more.
    """
    size, peak = scale(case), float(point_images(case).max())
    of_chart = magnitudes(case, case.believed_catalog.limit_g)
    fits = size.star * 10 ** (-0.4 * of_chart) * peak + size.background < size.largest
    chosen = (of_chart[fits] if fits.any() else of_chart[-1:])[::-STEP][::-1]
    field = _Field.of(case, seed)
    rows = [_at_magnitude(field, float(magnitude), seed) for magnitude in chosen]
    return SingleStars(chosen, *np.array(rows).T)


class _Field(NamedTuple):
    """A case whose detector has a box for each of n stars.

    place      (n, 2) pixel, true places of the stars
    expected   (n, 2) pixel, places where the tracker expects the stars
    point      (rows, columns) fraction of a star's light in each pixel, sum over all stars
    half_side  pixel, half side of a box
    """

    case: Case
    place: Floats
    expected: Floats
    point: Floats
    half_side: float

    @classmethod
    def of(cls, case: Case, seed: int) -> _Field:
        focal = case.instrument.camera.focal_length_px
        box, streams = case.tracker.box, Streams(seed, 0)
        half_side = box_reach(box, focal)
        tile = within_frame(2 * math.ceil(half_side + MARGIN) + 7, case.instrument.detector)
        case = _with_array(case, SIDE * tile)
        if case.design:  # dark maps are taken on the same array
            case = replace(case, design=_with_array(case.design, SIDE * tile))
        count = SIDE * SIDE
        within = streams("places of stars").uniform(-0.5, 0.5, (count, 2))
        images = star_images(case.instrument, within, tile)
        point = images.reshape(SIDE, SIDE, tile, tile).transpose(0, 2, 1, 3)
        row, column = np.divmod(np.arange(count), SIDE)
        place = np.column_stack([column, row]) * tile + tile // 2 + within
        error = box.prior * focal * streams("expected attitude").standard_normal((count, 2))
        return cls(case, place, place + error, point.reshape(SIDE * tile, SIDE * tile), half_side)


def _with_array(case: Case, side: int) -> Case:
    """The case with a square detector of `side` pixels, all of which are read."""
    detector = replace(case.instrument.detector, columns=side, rows=side, region=None)
    return replace(case, instrument=replace(case.instrument, detector=detector))


def _at_magnitude(field: _Field, magnitude: float, seed: int) -> list[float]:
    """The values of `SingleStars` at one magnitude, magnitude first."""
    case, settings = field.case, field.case.tracker.detection
    size, detector = scale(case), case.instrument.detector
    streams = Streams(seed, round(100 * (magnitude + 10)))
    electrons = size.star * 10 ** (-0.4 * magnitude)
    flux = np.full(len(field.place), electrons / detector.electrons_per_dn)

    def taken_in(frame: Frame, settings: Detection, corners: Ints | None) -> Taken:
        plan = detection_plan(case, settings)
        return take(frame, field.expected, flux, field.half_side, case.tracker.box, plan, corners)

    light, gain, state = electrons * field.point, response(detector), flickering(detector, streams)
    pixels = sky_electrons(case) + np.asarray(dark(detector)) * detector.exposure
    seen, corners, parts = pixels + light * (1.0 if gain is None else gain), None, []
    stated = list[Floats]()
    for time in range(TIMES):
        if state and time:
            state.later(1 / detector.update_rate)
        noise = Streams(seed, 10**6 * (1 + time) + streams.trial)
        frame = as_believed(case, frame_of(seen, detector, noise, state=state))
        taken = taken_in(frame, settings, corners)
        corners = taken.corner if corners is None else corners
        parts.append(_places(taken) - field.place)
        stated.append(taken.covariance)
    error = np.array(parts)  # (times, n, 2) pixel
    good = (np.hypot(error[..., 0], error[..., 1]) < NEAR).all(axis=0)
    if good.sum() < FEWEST:
        return [float(good.mean()), *[math.nan] * 5]
    error = error[:, good]
    number = (light + size.background) / detector.electrons_per_dn + detector.offset
    noise_free = _places(taken_in(to_frame(number, detector), settings.without_map, corners))
    by_method = (noise_free - field.place)[good]
    scatter = error - np.median(error.reshape(-1, 2), axis=0)
    variances = (
        np.trace(np.array(stated)[:, good], axis1=2, axis2=3).mean() / 2,
        error.var(axis=0, ddof=1).mean(),
        by_method.var(axis=0).mean(),
        (scatter**2).mean(),
    )
    return [float(good.mean()), *np.sqrt(variances), float(np.median(np.abs(scatter))) / MEDIAN]


def _places(taken: Taken) -> Floats:
    return np.column_stack([taken.x, taken.y])
