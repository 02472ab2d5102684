"""Case and fields -> what causes that do not change move: each star, or the camera as a whole."""

from __future__ import annotations

import numpy as np

from startrack.budget.causes import Cause, Term
from startrack.budget.fields import Fields
from startrack.budget.visible import believed_place
from startrack.case import Case
from startrack.catalog import Selection, open_sky
from startrack.motion import wander
from startrack.single.neighbours import pulls
from startrack.values import Floats, Ints

OF_STARS = ("camera model", "proper motion", "parallax", "aberration")  # what moves each its way


def moved(case: Case, cause: Cause, view: Fields, inside: Ints) -> Floats:
    """Pixel (n, 2) by which a fixed cause moves each star of the fields."""
    right = cause.without(case)
    camera = case.believed_camera
    x, y = view.x[inside], view.y[inside]
    if camera != right.believed_camera:
        pixel = right.believed_camera.project(np.column_stack([x, y, np.ones(len(x))]))
        seen = camera.unproject(pixel)
        plane = seen[:, :2] / seen[:, 2:]
        return camera.focal_length_px * (plane - np.column_stack([x, y]))
    attitude, star = view.attitude[view.field[inside]], view.name[view.star[inside]]
    wrong, true = (
        _plane(attitude.apply(_directions(case.catalog, one.believed_catalog, star)))
        for one in (case, right)
    )
    return camera.focal_length_px * (true - wrong)


def displaced(case: Case, view: Fields, inside: Ints) -> Floats:
    """Pixel (n, 2) by which the light of its neighbours moves each star of the fields."""
    x, y = view.x[inside], view.y[inside]
    move = view.attitude[view.field[inside]].apply(pulls(case, case.catalog)[view.star[inside]])
    return (move[:, :2] - np.column_stack([x, y]) * move[:, 2:]) * np.sqrt(1 + x * x + y * y)[
        :, None
    ]


def _directions(true: Selection, believed: Selection, star: Ints) -> Floats:
    """Where a believed sky has stars of the true one."""
    return open_sky(believed).stars.direction[believed_place(true, believed)[star]]


def _plane(direction: Floats) -> Floats:
    return direction[:, :2] / direction[:, 2:]


def of_the_camera(case: Case, cause: Cause) -> tuple[Floats, Floats] | None:
    """Mean and sigma (3,), radian, of a cause that turns the whole camera; None for others."""
    instrument = case.instrument
    if cause.term is Term.BIAS:
        wrong = case.believed_mounting.camera_to_body().inv()
        return -(wrong * instrument.mounting.camera_to_body()).as_rotvec(), np.zeros(3)
    if cause.term is Term.HEAT:
        swing = instrument.mounting
        amplitude = np.array([swing.swing_x, swing.swing_y, swing.swing_z])
        return np.zeros(3), amplitude / np.sqrt(2)
    if cause.term is Term.DATE:
        motion = instrument.motion
        rate = np.array([motion.rate_x, motion.rate_y, motion.rate_z])
        return rate * case.lateness, np.zeros(3)
    if cause.name == "jitter":
        return np.zeros(3), wander(instrument.motion, instrument.detector.exposure)
    return None
