"""Case and attitude -> the spots of one trial, drawn without an image."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.catalog import belt
from startrack.core import (
    Floats,
    Rows,
    Spots,
    Streams,
    assign,
    bits,
    distort,
    inverse_normal,
    kernel,
    poisson_of_uniform,
    uniform,
)
from startrack.design import Case, Instrument
from startrack.observation import mean_attitude
from startrack.response import (
    COMPANION_RADIUS,
    COMPANION_RATIOS,
    FLUX_STEP,
    PHASES,
    HotPixels,
    SpotResponse,
)
from startrack.trial.spot_plan import SpotPlan, Through, plan_spots, refuse

MARGIN = 8.0  # pixel; a lens table moves no star into the frame from farther outside it
FALSE = np.uint64(2**63)  # key of the draws of false spots; numbers of stars are smaller


# The spot of a star in one trial:
# star        index into the field
# x, y        pixel, true position;  dx, dy  from it to the centroid
# xx, yx, yy  pixel, triangular root of the centroid's covariance
# flux        digital number, expected;  blur  1, its relative standard deviation
# surplus sigma, excess of the flux by noise
SIGHT = np.dtype(
    [
        ("star", np.int64),
        *((name, np.float64) for name in ("x", "y", "dx", "dy", "xx", "yx", "yy")),
        *((name, np.float64) for name in ("flux", "blur", "surplus")),
    ]
)


@kernel
def sights(a: Floats, key: np.uint64, plan: SpotPlan) -> Rows:
    """The stars (k,) that are detected at the attitude `a`, in the trial with a key."""
    response, pull, field, companions, view, _, _, through, hot = plan
    near = in_view(a, field.direction, view)
    sighted = np.empty(len(near), SIGHT)
    count, lens = 0, len(through.table) > 0
    for i in near:
        x, y = _project(a, field.direction[i], view)
        zone, flux, shift_x, shift_y = 0, field.flux[i], 0.0, 0.0
        if lens and -MARGIN < x < view.columns + MARGIN and -MARGIN < y < view.rows + MARGIN:
            zone, more, shift_x, shift_y = _shifted(x, y, field.colour[i], through)
            zone, flux = zone + field.zone[i], flux + more
            x, y = x + shift_x, y + shift_y
        column, row = round(x), round(y)
        if not (
            view.border <= column < view.columns - view.border
            and view.border <= row < view.rows - view.border
        ):
            continue
        start, seen = bits(key, field.number[i]), sighted[count]
        if not _measure(x, y, column, row, flux, zone, start, response, hot, seen):
            continue
        if lens:
            x, y = x - shift_x, y - shift_y
            seen.dx, seen.dy = seen.dx + shift_x, seen.dy + shift_y
        for k in range(companions.start[i], companions.start[i + 1]):
            u, v = _project(a, companions.direction[k], view)
            dx, dy = _pulled(u - x, v - y, companions.flux[k] - field.flux[i], pull)
            seen.dx += dx
            seen.dy += dy
        if not np.isnan(seen.dx):
            seen.star, seen.x, seen.y = i, x, y
            count += 1
    return sighted[:count]


def trial_keys(seed: int, numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The keys of the draws of some trials of a seed."""
    return _keys(Streams(seed, 0).key("covariance"), numbers)


@kernel
def _keys(start, numbers):  # type: ignore[no-untyped-def]
    keys = np.empty(len(numbers), np.uint64)
    for n in range(len(numbers)):
        keys[n] = bits(start, numbers[n])
    return keys


@kernel
def false_spots(key, mean):  # type: ignore[no-untyped-def]
    """Number of false spots in the trial of a key."""
    return int(poisson_of_uniform(mean, uniform(bits(key, FALSE))))


@kernel
def in_view(a, direction, view):  # type: ignore[no-untyped-def]
    """Indices (k,) of the stars in the cone around the frame; directions (n, 3) sorted by z."""
    first, last = belt(direction, a[2, 2], math.acos(view.cosine))
    inside = np.empty(last - first, np.int64)
    count = 0
    for i in range(first, last):
        d = direction[i]
        if a[2, 0] * d[0] + a[2, 1] * d[1] + a[2, 2] * d[2] >= view.cosine:
            inside[count] = i
            count += 1
    return inside[:count]


@kernel(inline="always")
def _project(a, d, view):  # type: ignore[no-untyped-def]
    """`Camera.project` of one direction in front of the camera."""
    z = a[2, 0] * d[0] + a[2, 1] * d[1] + a[2, 2] * d[2]
    u = (a[0, 0] * d[0] + a[0, 1] * d[1] + a[0, 2] * d[2]) / z
    v = (a[1, 0] * d[0] + a[1, 1] * d[1] + a[1, 2] * d[2]) / z
    x, y = distort(u, v, view.k1, view.k2, view.p1, view.p2, view.k3)
    return view.centre_x + view.focal * x, view.centre_y + view.focal * y


@kernel(inline="always")
def _shifted(x: float, y: float, colour: int, through: Through) -> tuple[int, float, float, float]:
    """Zone of a place and colour, logarithm of the relative flux, and shift in pixel."""
    table = through.table
    p, q = table.shape[2], table.shape[1]
    u = min(max((x + 0.5) / through.step_x, 0.0), p - 1.0)
    v = min(max((y + 0.5) / through.step_y, 0.0), q - 1.0)
    i, j = min(int(u), p - 2), min(int(v), q - 2)
    u, v = u - i, v - j
    column = min(max(int((x + 0.5) / through.wide), 0), through.across - 1)
    row = min(max(int((y + 0.5) / through.high), 0), through.down - 1)
    corners = table[colour, j : j + 2, i : i + 2]
    zone = row * through.across + column
    return (
        zone,
        _bilinear(corners, u, v, 2),
        _bilinear(corners, u, v, 0),
        _bilinear(corners, u, v, 1),
    )


@kernel(inline="always")
def _bilinear(corners, u, v, k):  # type: ignore[no-untyped-def]
    a, b, c, d = (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v
    return a * corners[0, 0, k] + b * corners[0, 1, k] + c * corners[1, 0, k] + d * corners[1, 1, k]


@kernel
def _measure(
    x: float,
    y: float,
    column: int,
    row: int,
    flux: float,
    zone: int,
    start: np.uint64,
    response: SpotResponse,
    hot: HotPixels,
    seen: Any,
) -> bool:
    """Whether a single star is detected at a position in a pixel; writes its measurement."""
    i = min(int((x - column + 0.5) * PHASES), PHASES - 1)
    j = min(int((y - row + 0.5) * PHASES), PHASES - 1)
    at = (flux - response.first) / FLUX_STEP
    k = min(max(int(at), 0), response.threshold_margin.shape[1] - 2)
    t = min(max(at - k, 0.0), 1.0)
    above = (1 - t) * response.threshold_margin[zone, k, j, i] + t * response.threshold_margin[
        zone, k + 1, j, i
    ]
    seen.surplus = inverse_normal(uniform(bits(start, np.uint64(0))))
    kept = (1 - t) * response.pass_probability[zone, k, j, i] + t * response.pass_probability[
        zone, k + 1, j, i
    ]
    if not above + seen.surplus > 0 or uniform(bits(start, np.uint64(3))) > kept:
        return False
    normal_x = inverse_normal(uniform(bits(start, np.uint64(1))))
    normal_y = inverse_normal(uniform(bits(start, np.uint64(2))))
    electrons = math.exp(flux)
    seen.xx = _between(response.covariance_root, zone, k, t, j, i, 0) / electrons
    seen.yx = _between(response.covariance_root, zone, k, t, j, i, 1) / electrons
    seen.yy = _between(response.covariance_root, zone, k, t, j, i, 2) / electrons
    seen.dx = _between(response.bias, zone, k, t, j, i, 0) + seen.xx * normal_x
    seen.dy = _between(response.bias, zone, k, t, j, i, 1) + seen.yx * normal_x + seen.yy * normal_y
    seen.flux = _between(response.light, zone, k, t, j, i, 0) * electrons
    seen.blur = _between(response.light, zone, k, t, j, i, 1)
    if hot.chance > 0 and uniform(bits(start, np.uint64(4))) < hot.chance:
        n = int(uniform(bits(start, np.uint64(5))) * hot.shift.shape[1])
        seen.dx += (1 - t) * hot.shift[k, n, 0] + t * hot.shift[k + 1, n, 0]
        seen.dy += (1 - t) * hot.shift[k, n, 1] + t * hot.shift[k + 1, n, 1]
    return not np.isnan(seen.dx + seen.dy)


@kernel(inline="always")
def _between(table, zone, k, t, j, i, c):  # type: ignore[no-untyped-def]
    return (1 - t) * table[zone, k, j, i, c] + t * table[zone, k + 1, j, i, c]


@kernel
def _pulled(dx: float, dy: float, ratio: float, pull: Floats) -> tuple[float, float]:
    """Shift of a centroid by a companion; NaN where only the companion is detected."""
    ratios, radius = COMPANION_RATIOS, COMPANION_RADIUS
    r, q = (ratio - ratios[0]) / (ratios[1] - ratios[0]), len(ratios) - 1
    if not (abs(dx) < radius and abs(dy) < radius) or r < 0:
        return 0.0, 0.0
    if np.isnan(pull[min(int(r + 0.5), q), round(dy) + radius, round(dx) + radius, 0]):
        return np.nan, np.nan
    k, i, j = min(int(r), q - 1), int(dx + radius), int(dy + radius)
    t, u, v = min(r - k, 1.0), dx + radius - i, dy + radius - j
    x = y = total = 0.0
    for n in range(8):
        c, b, a = n // 4, (n // 2) % 2, n % 2
        weight = (t if c else 1 - t) * (v if b else 1 - v) * (u if a else 1 - u)
        shift = pull[k + c, j + b, i + a]
        if not np.isnan(shift[0]):
            x, y, total = x + weight * shift[0], y + weight * shift[1], total + weight
    return x / total, y / total


ROWS = 3  # iterations; each multiplies the error by the motion of a star between two rows (pixel)
ROW = 7  # columns: x, y, flux, its sigma, xx, xy, yy


def spots_of(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Spots:
    """The spots of one trial: detected stars, and false spots among them.

        s = 1 + blur N(0, 1),   flux = s expected flux
        centroid = projection + (bias + root N(0, 1)) / s,   covariance = root root^T / s^2

    The stars are those of `outcomes`, including stars that the tracker's catalogue lacks. Noise
    that lifts a star over the threshold also makes it brighter. Its error, which is divided by the
    flux, then becomes smaller. A star is at its mean place in the exposure, jitter included. All
    trials have the mean blur by jitter; its variation between trials is left out. With a rolling
    shutter each star is at its place at the time of its row, by the rates alone. False spots are
    distributed uniformly. They have the covariance of stars at the threshold. Their excess over the
    threshold is drawn from the tail of a normal distribution.

    icrs_to_camera  true attitude at the middle of the exposure
    Returns         Spots, brightest first; their areas are unknown and set to 0
    Raises          as `outcomes`
    """
    refuse(case)
    plan = plan_spots(case)
    key = trial_keys(streams.seed, np.array([streams.trial], np.uint64))[0]
    seen = mean_attitude(case.instrument, icrs_to_camera, streams)
    table = _draw(seen.as_matrix(), key, plan)
    table = table[np.argsort(-table[:, 2], kind="stable")][: case.tracker.detection.max_spots]
    x, y, flux, sigma, xx, xy, yy = table.T.copy()
    covariance = np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)
    x, y = _rolled(case.instrument, np.column_stack([x, y])).T.copy()
    return Spots(x, y, flux, covariance, flux / sigma, np.zeros(len(x), np.int64))


def _rolled(instrument: Instrument, place: Floats) -> Floats:
    """Places (n, 2) at the time of their rows, from places at the middle of the exposure."""
    detector, camera, motion = instrument.detector, instrument.camera, instrument.motion
    if not (detector.row_delay and motion.rate and len(place)):
        return place
    direction, moved = camera.unproject(place), place
    for _ in range(ROWS):  # time of the row to which the star has moved
        late = detector.row_delay * (moved[:, 1] - (camera.rows - 1) / 2)
        turn = Rotation.from_rotvec(np.multiply.outer(-late, motion.rates))
        moved = camera.project(turn.apply(direction))
    return moved


@kernel
def _draw(a: Floats, key: np.uint64, plan: SpotPlan) -> Floats:
    """The table of all spots, stars first; the gate is applied by the solver."""
    response, _, _, _, view, _, false, _, _ = plan
    stars, noise = sights(a, key, plan), false_spots(key, false)
    table = np.empty((len(stars) + noise, ROW))
    for n in range(len(stars)):
        _write(table[n], stars[n])
    for n in range(noise):
        start = bits(key, FALSE + np.uint64(1 + n))
        _write_false(table[len(stars) + n], start, response.star_at_threshold, view)
    return table


@kernel
def _write(row, seen):  # type: ignore[no-untyped-def]
    """Write a star; noise that makes it brighter also makes its error smaller."""
    fraction = max(1 + seen.blur * seen.surplus, seen.blur)
    row[0], row[1] = seen.x + seen.dx / fraction, seen.y + seen.dy / fraction
    row[2], row[3] = seen.flux * fraction, seen.flux * seen.blur
    row[4] = seen.xx * seen.xx / fraction**2
    row[5] = seen.xx * seen.yx / fraction**2
    row[6] = (seen.yx * seen.yx + seen.yy * seen.yy) / fraction**2


@kernel
def _write_false(row, start, least, view):  # type: ignore[no-untyped-def]
    """Write a false spot: anywhere, its flux from the tail of a normal distribution."""
    across, down = view.columns - 2 * view.border, view.rows - 2 * view.border
    row[0] = view.border - 0.5 + across * uniform(bits(start, np.uint64(0)))
    row[1] = view.border - 0.5 + down * uniform(bits(start, np.uint64(1)))
    assign(row[2:], least)
    row[2] -= math.log(uniform(bits(start, np.uint64(2)))) * least[1] ** 2 / least[0]
