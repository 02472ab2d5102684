"""Case and fields of stars -> errors that are constant from frame to frame."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import observation, response, trial
from startrack.budget.budget import Cause
from startrack.budget.fields import Fields, believed_index
from startrack.catalog import Selection, open_sky
from startrack.core import Camera, Floats, Ints, kernel
from startrack.design import Case
from startrack.motion import jitter_rms


def visible(case: Case, view: Fields, faintest: float, like: Case) -> tuple[Ints, Floats]:
    """Indices of the stars of the fields whose window fits into the frame, and their magnitudes.

    like  a case whose stars have the same magnitudes
    """
    camera, detection = case.instrument.camera, case.tracker.detection
    stars = view.sky.stars
    edge = np.tan(min(1.1 * camera.half_diagonal, 1.5))
    # Red stars give more signal than a sunlike star of the same G: one magnitude of margin.
    near = _within(view.x, view.y, view.star, stars.magnitude_g, edge, faintest + 1)
    pixel = camera.project(np.column_stack([view.x[near], view.y[near], np.ones(len(near))]))
    near = near[camera.holds(pixel, -(detection.window // 2 + detection.edge))]
    star = view.star[near]
    magnitude = stars.magnitude_g[star] + observation.colour_correction(like, stars.colour[star])
    believed = believed_index(case.catalog, case.believed_catalog)[view.name[star]]
    seen = (magnitude < faintest) & (believed >= 0)
    return near[seen], magnitude[seen]


@kernel
def _within(
    x: Floats, y: Floats, star: Ints, magnitude: Floats, edge: float, faintest: float
) -> Ints:
    """Indices of the stars with |x| and |y| below an edge that are brighter than a magnitude."""
    index, count = np.empty(len(x), np.int64), 0
    for k in range(len(x)):
        if abs(x[k]) < edge and abs(y[k]) < edge and magnitude[star[k]] < faintest:
            index[count] = k
            count += 1
    return index[:count]


# Causes that displace single stars.
OF_STARS = (
    response.LENS_FIELD,
    trial.LENS_COLOUR,
    "camera model",
    "proper motion",
    "parallax",
    "aberration",
    trial.SHUTTER,
)


class ThroughLens(NamedTuple):
    """Effect of a lens table on n stars.

    zone     (n,) index of the zone, of the frame and of colour
    fainter  (n,) magnitude lost by vignetting
    shift    for each cause, (n, 2) pixel shift of the centroid
    """

    zone: Ints
    fainter: Floats
    shift: dict[str, Floats]


def through_lens(case: Case, camera: Camera, view: Fields, inside: Ints) -> ThroughLens:
    """Effect of a case's lens table on stars of the fields; without a table, no effect.

    camera  camera that sees the stars; for a unit it may differ from the camera of the case
    """
    count = len(inside)
    if not case.instrument.optics.tabulated:
        return ThroughLens(np.zeros(count, np.int64), np.zeros(count), {})
    colour = observation.mean_colour(case, view.sky.stars.colour[view.star[inside]])
    x, y = camera.project(np.column_stack([view.x[inside], view.y[inside], np.ones(count)])).T
    sunlike, rest = response.residual_shift(case)
    field, other = sunlike.at(x, y, colour), rest.at(x, y, colour)
    return ThroughLens(
        response.zones_of(case).of(x, y, colour),
        -2.5 * np.log10(np.maximum(other[:, 2], 1e-6)),
        {response.LENS_FIELD: field[:, :2], trial.LENS_COLOUR: other[:, :2]},
    )


def moved(case: Case, cause: Cause, view: Fields, inside: Ints) -> Floats:
    """Pixel (n, 2): displacement of each star of the fields by a fixed cause."""
    correct = cause.without(case)
    camera = case.believed_camera
    x, y = view.x[inside], view.y[inside]
    if cause.name == trial.SHUTTER:
        return _sheared(case, x, y)
    if camera != correct.believed_camera:
        pixel = correct.believed_camera.project(np.column_stack([x, y, np.ones(len(x))]))
        plane = _plane(camera.unproject(pixel))
        return camera.focal_length_px * (plane - np.column_stack([x, y]))
    attitude, star = view.attitude[view.field[inside]], view.name[view.star[inside]]
    wrong, right = (
        _plane(attitude.apply(_directions(case.catalog, variant.believed_catalog, star)))
        for variant in (case, correct)
    )
    return camera.focal_length_px * (right - wrong)


def displacement(
    true: Camera, believed: Camera, pixel: Floats, turn: Rotation | None = None
) -> Floats:
    """Pixel (n, 2): displacement of stars at n places of the frame by a wrong camera model.

    turn  rotation from the axes of the true camera to the axes of the believed camera
    """
    seen, there = believed.unproject(pixel), true.unproject(pixel)
    if turn is not None:
        there = turn.apply(there)
    return believed.focal_length_px * (_plane(seen) - _plane(there))


def _sheared(case: Case, x: Floats, y: Floats) -> Floats:
    """Pixel (n, 2): motion of stars between the exposures of the middle row and of their row.

    The tracker's correction is subtracted. It uses the row delay and rates that the tracker
    assumes.
    """
    camera, delay = case.instrument.camera, case.instrument.detector.row_delay
    direction = np.column_stack([x, y, np.ones(len(x))])
    row = camera.project(direction)[:, 1] - (camera.rows - 1) / 2
    true, believed = case.instrument.motion.rates, case.believed_motion.rates
    turn = np.multiply.outer(row, delay * true - case.believed_row_delay * believed)
    turned = Rotation.from_rotvec(-turn).apply(direction)
    return camera.focal_length_px * (_plane(turned) - np.column_stack([x, y]))


def displaced(case: Case, view: Fields, inside: Ints) -> Floats:
    """Pixel (n, 2): displacement of each star of the fields by the light of its neighbours.

    Stars that only the camera of the case merges are not displaced.
    """
    x, y = view.x[inside], view.y[inside]
    # The camera of the fields and the camera of the case may merge different stars.
    resolution = observation.index_resolution(case.instrument.camera)
    stars = observation.separated(case.catalog, resolution)
    place = stars.places(len(open_sky(case.catalog)))[view.name[view.star[inside]]]
    of_stars = response.blending_shift(case, case.catalog)
    shift = np.where((place >= 0)[:, None], of_stars[place], 0.0)
    move = view.attitude[view.field[inside]].apply(shift)
    slant = np.sqrt(1 + x * x + y * y)[:, None]
    return (move[:, :2] - np.column_stack([x, y]) * move[:, 2:]) * slant


def _directions(true: Selection, believed: Selection, star: Ints) -> Floats:
    """Directions of stars of the true sky in the believed sky."""
    return open_sky(believed).stars.direction[believed_index(true, believed)[star]]


def _plane(direction: Floats) -> Floats:
    return np.asarray(direction[:, :2] / direction[:, 2:])


def of_the_camera(case: Case, cause: Cause) -> tuple[Floats, Floats] | None:
    """Mean and sigma (3,), radian, of a cause that rotates the camera; None for other causes."""
    instrument = case.instrument
    if cause.term is trial.Term.BIAS:
        wrong = case.believed_mounting.camera_to_body().inv()
        return -(wrong * instrument.mounting.camera_to_body()).as_rotvec(), np.zeros(3)
    if cause.term is trial.Term.THERMO_ELASTIC:
        swing = instrument.mounting
        amplitude = np.array([swing.swing_x, swing.swing_y, swing.swing_z])
        return np.zeros(3), amplitude / np.sqrt(2)
    if cause.term is trial.Term.MEASUREMENT_DATE:
        return instrument.motion.rates * case.time_tag_error, np.zeros(3)
    if cause.name in (trial.JITTER, trial.JITTER_OF_HEAD):
        if case.tracker.reference == "mean":
            return np.zeros(3), np.zeros(3)
        return np.zeros(3), jitter_rms(instrument.motion, instrument.detector.exposure)
    return None
