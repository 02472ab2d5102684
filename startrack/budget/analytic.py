"""Case -> Budget, in milliseconds and without a trial."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.budget.budget import Budget, Law, Line
from startrack.budget.causes import METHOD, NEIGHBOURS, READ, SHOT, Cause, Term, causes, dark_spread
from startrack.budget.chart import (
    chart,
    detected,
    lone,
    magnitudes,
    pattern,
)
from startrack.budget.fields import FIELDS, Fields, Response, fields, propagate
from startrack.budget.neighbours import displaced
from startrack.case import Case
from startrack.catalog import Selection, open_sky
from startrack.detector import electron_rate
from startrack.motion import wander
from startrack.scene import illuminate
from startrack.values import Floats, Ints, Stars
from startrack.view import throughput

FINE = 0.05  # magnitude between two entries of a response
COLOURS = np.linspace(-0.6, 4.0, 24)  # BP - RP


class Errors(NamedTuple):
    """Of single stars.

    magnitude  (m,) G of a sunlike star
    kept       (m,) share of the places at which the tracker keeps a star
    stated     (m, 2, 2) pixel^2, by the tracker
    random     (m, 2, 2) pixel^2 by cause, scatter over places, times and devices
    mean       (m, 2) pixel, over the places, of the centroid's method
    """

    magnitude: Floats
    kept: Floats
    stated: Floats
    random: dict[str, Floats]
    mean: Floats


def analytic(case: Case, count: int = FIELDS) -> Budget:
    """Error budget from design parameters, the real sky, and the tracker's answer to single stars.

        error of a field = sum of gains * errors of its stars (`propagate`), rms over fields

    The errors of a star follow from noise-free images of stars over sub-pixel places: the method's
    is their offset, the noise's what the tracker states of them, PRNU's and DSNU's what a fixed
    pattern moves them by. Fixed errors (camera, catalogue) move each star of each field.

    count   fields over the sky, a power of two
    Errors  ValueError where the case contradicts itself, or no field can be solved.
            model: to first order; cosmic rays, the smear of a roll, a rolling shutter, lag and
            what the PSF does over the field are left out; a star near the threshold counts by
            its chance.
            numerical: 1 % across and 3 % about for 512 fields.
    """
    view = fields(case.catalog, case.instrument.camera, count)
    star, floor = errors(case), case.tracker.attitude.centroid_floor
    fainter = _fainter(case)
    inside, magnitude = _visible(case, view, float(star.magnitude[-1]), fainter)
    near = displaced(case, view, inside, magnitude, fainter)
    # A star that is drawn away by more than the gate is left out as a mis-match.
    spread = np.sqrt(np.interp(magnitude, star.magnitude, _size(star.stated)) + floor**2)
    kept = np.hypot(*near.T) < case.tracker.attitude.gate * spread
    inside, magnitude, near = inside[kept], magnitude[kept], near[kept]
    grid = np.arange(star.magnitude[0], star.magnitude[-1] + FINE / 2, FINE)
    table = Response(
        float(grid[0]),
        FINE,
        detected(case, grid) * np.interp(grid, star.magnitude, star.kept),
        _fine(star.magnitude, star.stated, grid) + floor**2 * np.eye(2),
        np.stack([_fine(star.magnitude, one, grid) for one in star.random.values()]),
    )
    fixed = [c for c in causes(case) if c.name in ("camera model", "proper motion", "parallax")
             or c.term is Term.ABERRATION]  # fmt: skip
    mean = np.stack([np.interp(magnitude, star.magnitude, one) for one in star.mean.T], axis=-1)
    moved = [mean, near, *(_displaced(case, cause, view, inside) for cause in fixed)]
    identification = case.tracker.identification
    found = propagate(
        view, inside, magnitude, np.stack(moved), table,
        case.believed_camera.focal_length_px, identification.focal_tolerance > 0,
        identification.min_matches, case.tracker.detection.max_spots,
    )  # fmt: skip
    total = float(found.solved.sum())
    if not total > 0:
        raise ValueError("the case must see enough stars somewhere in the sky, it does not")
    weight = found.solved / total
    none = np.zeros_like(found.shift[:, 0])
    lines = []
    for k, name in enumerate(star.random):
        term = Term.NOISE if name in (SHOT, READ) else Term.PIXEL
        middle = found.shift[:, 0] if name == METHOD else none
        lines.append(Line(name, term, Law(middle, np.sqrt(found.variance[:, k]), weight)))
    lines.append(Line(NEIGHBOURS, Term.FIELD, Law(found.shift[:, 1], none, weight)))
    for k, cause in enumerate(fixed):
        lines.append(Line(cause.name, cause.term, Law(found.shift[:, k + 2], none, weight)))
    for cause in causes(case):
        law = _of_the_body(case, cause)
        if law is not None:
            lines.append(Line(cause.name, cause.term, Law(none + law[0], none + law[1], weight)))
    laws = [line.spread for line in lines if isinstance(line.spread, Law)]
    sigma = np.sqrt(np.sum([law.sigma**2 for law in laws], axis=0))
    whole = Law(np.sum([law.mean for law in laws], axis=0), sigma, weight)
    return Budget(
        tuple(lines),
        Line("end to end", None, whole),
        total / count,
        float(weight @ found.stars),
    )


def errors(case: Case) -> Errors:
    """What single stars of each magnitude err by, cause by cause."""
    detector = case.instrument.detector
    magnitude = magnitudes(case, case.believed_catalog.limit_g)
    plain, silent = chart(case, magnitude), chart(case, magnitude, noisy=False)
    stated, shot = _mean(plain.covariance), _mean(silent.covariance)
    method = _mean(plain.offset)
    random = {
        SHOT: shot,
        READ: stated - shot,
        METHOD: _moment(plain.offset - method[:, None]),
    }
    shape = (len(magnitude), *lone(case).shape)
    if detector.prnu:
        gain = 1 + detector.prnu / detector.binning * pattern("photo response", shape)
        random["PRNU"] = _moment(chart(case, magnitude, gain=gain).offset - plain.offset)
    spread = dark_spread(detector)
    if spread:
        extra = spread * pattern("dark current", shape)
        random["DSNU"] = _moment(chart(case, magnitude, extra=extra).offset - plain.offset)
    kept = np.isfinite(plain.offset[..., 0]).mean(axis=1)
    return Errors(magnitude, kept, stated, random, method)


def _size(covariance: Floats) -> Floats:
    """Variance per axis of covariances (m, 2, 2)."""
    return np.asarray(np.trace(covariance, axis1=1, axis2=2) / 2)


def _mean(values: Floats) -> Floats:
    """Over the places (second axis) at which a star was kept; large where none was."""
    kept = np.isfinite(values)
    total = np.where(kept, values, 0).sum(axis=1)
    return total / np.maximum(kept.sum(axis=1), 1)


def _moment(offset: Floats) -> Floats:
    """Second moments (m, 2, 2) of offsets (m, p, 2)."""
    return _mean(offset[..., :, None] * offset[..., None, :])


def _fine(magnitude: Floats, table: Floats, grid: Floats) -> Floats:
    """Covariances between magnitudes, straight lines in the logarithm; (k, 2, 2) pixel^2."""
    xx, yy = (np.maximum(table[:, a, a], 1e-16) for a in (0, 1))
    correlation = np.interp(grid, magnitude, np.clip(table[:, 0, 1] / np.sqrt(xx * yy), -1, 1))
    x, y = (np.exp(np.interp(grid, magnitude, np.log(each) / 2)) for each in (xx, yy))
    cross = correlation * x * y
    return np.stack([x * x, cross, cross, y * y], axis=-1).reshape(-1, 2, 2)


def _visible(case: Case, view: Fields, faintest: float, fainter: Floats) -> tuple[Ints, Floats]:
    """Which stars of the fields lie where a window fits, and their magnitudes."""
    camera, detection = case.instrument.camera, case.tracker.detection
    stars = open_sky(case.catalog).stars
    reach = np.tan(min(1.1 * camera.half_diagonal, 1.5))
    near = (np.abs(view.x) < reach) & (np.abs(view.y) < reach)
    near &= stars.magnitude_g[view.star] < faintest + 1  # red stars are brighter than their G
    near = np.flatnonzero(near)
    pixel = camera.project(np.column_stack([view.x[near], view.y[near], np.ones(len(near))]))
    near = near[camera.holds(pixel, -(detection.window // 2 + detection.edge))]
    star = view.star[near]
    magnitude = stars.magnitude_g[star] + fainter[star]
    believed = _believed(case.catalog, case.believed_catalog)[star]
    seen = (magnitude < faintest) & (believed >= 0)
    return near[seen], magnitude[seen]


def _fainter(case: Case) -> Floats:
    """Magnitude by which each star of the sky is fainter here than a sunlike one of its G."""
    count = len(COLOURS) + 1
    colour = np.append(COLOURS, np.nan)
    stars = Stars(np.zeros(count, np.int64), np.zeros((count, 3)), np.zeros(count), colour)
    light = illuminate(case.scene, stars)
    rate, _ = electron_rate(light, case.instrument.detector, throughput(case.instrument))
    fainter = -2.5 * np.log10(rate[:-1] / rate[-1])
    known = open_sky(case.catalog).stars.colour
    return np.where(np.isnan(known), 0.0, np.interp(known, COLOURS, fainter))


@lru_cache(maxsize=16)
def _believed(true: Selection, believed: Selection) -> Ints:
    """For each star of the true sky its index in the believed one, -1 where it is not there."""
    here, there = open_sky(true).stars.identifier, open_sky(believed).stars.identifier
    order = np.argsort(there, kind="stable")
    place = np.minimum(np.searchsorted(there, here, sorter=order), len(there) - 1)
    found = order[place]
    return np.where(there[found] == here, found, -1)


def _displaced(case: Case, cause: Cause, view: Fields, inside: Ints) -> Floats:
    """Pixel (n, 2) by which a fixed cause moves each star of the fields."""
    right = cause.without(case)
    camera = case.believed_camera
    x, y = view.x[inside], view.y[inside]
    if camera != right.believed_camera:
        pixel = right.believed_camera.project(np.column_stack([x, y, np.ones(len(x))]))
        seen = camera.unproject(pixel)
        plane = seen[:, :2] / seen[:, 2:]
        return camera.focal_length_px * (plane - np.column_stack([x, y]))
    attitude, star = view.attitude[view.field[inside]], view.star[inside]
    wrong, true = (
        _plane(attitude.apply(_directions(case.catalog, one.believed_catalog, star)))
        for one in (case, right)
    )
    return camera.focal_length_px * (true - wrong)


def _directions(true: Selection, believed: Selection, star: Ints) -> Floats:
    """Where a believed sky has stars of the true one."""
    return open_sky(believed).stars.direction[_believed(true, believed)[star]]


def _plane(direction: Floats) -> Floats:
    return direction[:, :2] / direction[:, 2:]


def _of_the_body(case: Case, cause: Cause) -> tuple[Floats, Floats] | None:
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
