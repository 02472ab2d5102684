"""Case -> outcomes of trials whose spots are drawn from the bias and covariance of centroids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import special
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from startrack.attitude import Alignment, Observability, align, scale_unknown
from startrack.case import Case
from startrack.catalog import Selection, open_sky
from startrack.detection import (
    Expectation,
    expect,
    false_alarms,
    margin,
    peak_border,
    star_filter,
    star_profile,
    threshold_of,
)
from startrack.detector import arriving, only_lone_pixels, star_grid
from startrack.detector.counter import bits, key, uniform
from startrack.detector.normal import inverse_normal
from startrack.detector.poisson import drawn
from startrack.error import JUDGED, judge_all
from startrack.scene import Scene, illuminate
from startrack.single import trust
from startrack.streams import Streams
from startrack.values import Floats, Ints, Light
from startrack.view import asked_for, path_of, psf_of, random_attitudes, throughput

PHASES = 6  # places in the pixel, along either axis
STEP = 0.2 * math.log(10)  # of the logarithm of flux: half a magnitude
FAINTEST = 4.5  # sigma below the threshold: a star passes it three times in a million
LEAST = 0.5  # sigma, where the threshold is so low that all stars would count
SURPRISE = 1e-3  # chance below which residuals are too large to be the noise alone
MOST_ROLL = 0.5  # pixel of smear in the corner, by a turn about the boresight
REACH = 7  # pixel, from which a companion pulls at a star
RATIOS = np.arange(-4, 4) * 0.8  # logarithm of a companion's flux over the star's
TYPICAL = 5.0  # faintest stars' flux: that of the stars whose companions are tried
BLOCK = 1024  # trials that are drawn together
TOGETHER = 64  # trials that are solved together


class Response(NamedTuple):
    """What the detection makes of a star, by its flux and its place in the pixel.

    first  logarithm of the least flux in electron; the others follow in equal steps
    bias   (l, p, p, 2) pixel x and y, by row and column of the place
    root   (l, p, p, 3) pixel electron, triangular root xx, yx, yy of the covariance, times flux
    above  (l, p, p) sigma, by which a star passes the threshold
    """

    first: float
    bias: Floats
    root: Floats
    above: Floats


class Field(NamedTuple):
    """The stars that can be found, in order of the last coordinate of their directions.

    direction, believed  (n, 3) unit vectors, true and in the tracker's catalogue
    known                (n,) whether they are in that
    flux                 (n,) logarithm of electrons
    number               (n,) index into the sky, which names a star in the draws
    own                  (n,) pixel^2, that the tracker reckons with beside the noise
    """

    direction: Floats
    believed: Floats
    known: NDArray[np.bool_]
    flux: Floats
    number: NDArray[np.uint64]
    own: Floats


class Companions(NamedTuple):
    """The stars near each star of a Field: those from start[i] to start[i + 1] are near star i.

    direction  (k, 3) unit vectors
    flux       (k,) logarithm of electrons
    """

    start: Ints
    direction: Floats
    flux: Floats


class View(NamedTuple):
    """A camera and what of it the search looks at, for the kernel.

    focal .. k3   as in Camera; centre_x, centre_y of the principal point, pixel
    border        pixel, that a star must stay from the edge
    cosine        of the angle from the boresight to the farthest corner
    """

    columns: int
    rows: int
    focal: float
    centre_x: float
    centre_y: float
    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    border: int
    cosine: float


class Plan(NamedTuple):
    """All that the trials of a case share."""

    response: Response
    pull: Floats
    field: Field
    companions: Companions
    view: View
    gate: float
    false: float


def outcomes(
    case: Case, seed: int, numbers: Sequence[int], icrs_to_camera: Rotation | None = None
) -> NDArray[np.void]:
    """The outcomes of some trials, matches taken as known.

        place = projection + bias + root N(0, 1),   found with the probability Phi(above)

    Bias, root and above come from the detection itself, which measures stars of half-magnitude
    steps at 36 places in the pixel, rendered without noise but with smear and with the response
    of the pixels.

    icrs_to_camera  a true attitude for each; None: those of the same trials of other fidelities
    Returns  (n,) structured array, as `startrack.error.judge_all` gives it, in the order asked for
    Errors   ValueError that names what in the case needs an image.
             model: normal errors, as small as the noise is beside the star; each star alone, with
             the smear of the field's centre; false spots are counted and never matched. On
             nominal designs the rms of the attitude's error is that of frames within 5 %.
    """
    refuse(case)
    plan = plan_of(case)
    parts = []
    for at in range(0, len(numbers), BLOCK):
        block = numbers[at : at + BLOCK]
        if icrs_to_camera is None:
            attitude = random_attitudes(seed, block)
        else:
            attitude = icrs_to_camera[at : at + BLOCK]
        parts.append(_tried(case, plan, seed, block, attitude))
    return np.concatenate(parts) if parts else np.empty(0, JUDGED)


def refuse(case: Case) -> None:
    """Refuse what spots alone cannot show.

    Errors  ValueError that names it.
    """
    instrument = case.instrument
    detector, motion = instrument.detector, instrument.motion
    only_lone_pixels(detector)
    corner = math.tan(instrument.camera.half_diagonal) * instrument.camera.focal_length_px
    there = {
        "hits": detector.hits,
        "defects": detector.defects,
        "row_delay": detector.row_delay,
        "jitter that each trial draws": motion.drawn,
        "a rate_z that smears stars in the corners": (
            abs(motion.rate_z) * detector.exposure * corner > MOST_ROLL
        ),
        "lights of the scene": case.scene.lights,
    }
    named = [name for name, is_there in there.items() if is_there]
    if named:
        raise ValueError(
            f"covariance needs a case without {' and '.join(named)}; choose the fidelity window "
            "or frame"
        )


@lru_cache(maxsize=8)
def plan_of(case: Case) -> Plan:
    """Measure the stars of a design, once."""
    instrument, settings = case.instrument, case.tracker.detection
    detector, camera, psf = instrument.detector, instrument.camera, psf_of(instrument)
    stars = open_sky(case.catalog).stars
    flux, sky = arriving(_light(case.catalog, case.scene), camera, detector, throughput(instrument))
    background = sky + detector.dark_rate * detector.exposure
    rounding = detector.electrons_per_dn / math.sqrt(12)
    noise = math.hypot(math.sqrt(background), detector.noise, rounding)
    noise *= float(np.linalg.norm(star_filter(settings, psf)))
    threshold = threshold_of(settings, detector.columns, detector.rows, psf)
    faintest = max(threshold - FAINTEST, LEAST) * noise / float(star_profile(psf, settings)[0])
    found = np.flatnonzero(flux >= min(faintest, flux.max()))  # one at least, to have arrays
    found = found[np.argsort(stars.direction[found, 2])]
    there, known = _believed(case, found)
    x, y = camera.centre
    view = View(
        *(camera.columns, camera.rows, camera.focal_length_px, x, y),
        *(camera.k1, camera.k2, camera.p1, camera.p2, camera.k3),
        *(peak_border(settings), math.cos(camera.half_diagonal)),
    )
    brightest = float(flux[found].max(initial=faintest))
    grid = Grid(case, sky)
    radius = (REACH + 1) / camera.focal_length_px
    return Plan(
        _response(grid, faintest, brightest),
        _pull(grid, TYPICAL * faintest),
        Field(
            np.ascontiguousarray(stars.direction[found]),
            np.ascontiguousarray(open_sky(case.believed_catalog).stars.direction[there]), known,
            np.log(flux[found]), found.astype(np.uint64), trust(case)[there],
        ),
        _companions(stars.direction, flux, found, radius),
        view,
        case.tracker.attitude.gate,
        false_alarms(settings, detector.columns, detector.rows, psf),
    )  # fmt: skip


@lru_cache(maxsize=2)
def _light(catalog: Selection, scene: Scene) -> Light:
    """The light of all stars of a sky."""
    return illuminate(scene, open_sky(catalog).stars)


def _believed(case: Case, found: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Which of the tracker's catalogue some stars of the sky are, and whether it has them."""
    true, own = open_sky(case.catalog).stars, open_sky(case.believed_catalog).stars
    order = np.argsort(own.identifier)
    wanted = true.identifier[found]
    at = np.minimum(np.searchsorted(own.identifier[order], wanted), len(own) - 1)
    there = order[at]
    return there, own.identifier[there] == wanted


@dataclass(frozen=True)
class Grid:
    """Stars laid out for the detection to measure, and what of it they share."""

    case: Case
    sky: float

    def expect(self, stars: Floats, companions: Floats, across: int) -> tuple[Expectation, Floats]:
        """What is to be expected of stars (n, 3), and their places; arguments as `star_grid`."""
        detector, settings = self.case.instrument.detector, self.case.tracker.detection
        psf, smear = psf_of(self.case.instrument), _smear(self.case)
        longest = math.ceil(np.abs(smear[:, 1:]).max())
        side = 2 * (margin(settings, psf) + longest + 2) + 1
        frame, place = star_grid(stars, companions, across, side, smear, psf, detector, self.sky)
        dark = self.sky + detector.dark_rate * detector.exposure
        level = detector.offset + dark / detector.electrons_per_dn
        area = detector.columns * detector.rows
        return expect(frame, place, level, area, settings, psf), place


def _response(grid: Grid, faintest: float, brightest: float) -> Response:
    """The detection's answer to stars of all fluxes at all places in the pixel."""
    count = math.ceil(math.log(brightest / faintest) / STEP) + 2
    flux = faintest * np.exp(STEP * np.arange(count))
    at = (np.arange(PHASES) + 0.5) / PHASES - 0.5
    y, x = np.meshgrid(at, at, indexing="ij")
    stars = np.column_stack(
        [np.tile(x.ravel(), count), np.tile(y.ravel(), count), np.repeat(flux, PHASES**2)]
    )
    seen, place = grid.expect(stars, np.zeros_like(stars), PHASES**2)
    shape = (count, PHASES, PHASES)
    bias = np.column_stack([seen.x, seen.y]) - place
    variance_x, variance_y = seen.covariance[:, 0, 0], seen.covariance[:, 1, 1]
    good = np.isfinite(bias).all(axis=1) & (variance_x > 0) & (variance_y > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        xx = np.sqrt(variance_x)
        yx = seen.covariance[:, 0, 1] / xx
        root = np.stack([xx, yx, np.sqrt(np.maximum(variance_y - yx**2, 0))], axis=-1)
    root *= stars[:, 2:]
    return Response(
        math.log(faintest),
        np.where(good[:, None], bias, 0.0).reshape(*shape, 2),
        np.where(good[:, None], root, 0.0).reshape(*shape, 3),
        np.where(good, seen.above / seen.spread, -np.inf).reshape(shape),
    )


def _pull(grid: Grid, flux: float) -> Floats:
    """How far a companion pulls a centroid, pixel: (r, d, d, 2) by its flux and place.

    NaN where only the companion is found.
    """
    offset = np.arange(-REACH, REACH + 1.0)
    y, x = np.meshgrid(offset, offset, indexing="ij")
    many = x.size
    stars = np.tile([0.0, 0.0, flux], (len(RATIOS) * many, 1))
    companions = np.column_stack([
        np.tile(x.ravel(), len(RATIOS)), np.tile(y.ravel(), len(RATIOS)),
        np.repeat(flux * np.exp(RATIOS), many),
    ])  # fmt: skip
    seen, place = grid.expect(stars, companions, many)
    alone, _ = grid.expect(stars[:many], np.zeros((many, 3)), many)
    centroid = np.column_stack([seen.x, seen.y])
    pull = centroid - np.tile(np.column_stack([alone.x, alone.y]), (len(RATIOS), 1))
    pull[:, 1] -= np.repeat(np.arange(len(RATIOS)), many) * (place[many, 1] - place[0, 1])
    away = np.hypot(*(centroid - place).T)
    lost = away > np.hypot(*(centroid - place - companions[:, :2]).T)
    pull[lost & (companions[:, 2] >= flux)] = np.nan
    side = len(offset)
    return pull.reshape(len(RATIOS), side, side, 2)


def _companions(directions: Floats, flux: Floats, found: Ints, radius: float) -> Companions:
    """The stars within an angle of each of the found ones, none of them much fainter."""
    pairs = cKDTree(directions[found]).query_ball_tree(cKDTree(directions), radius)
    lists = [
        [k for k in near if k != i and flux[k] > flux[i] * math.exp(RATIOS[0])]
        for i, near in zip(found, pairs, strict=True)
    ]
    start = np.concatenate([[0], np.cumsum([len(each) for each in lists])])
    other = np.array([k for each in lists for k in each], np.int64)
    return Companions(start, directions[other].reshape(-1, 3), np.log(flux[other]))


def _smear(case: Case) -> Floats:
    """Weight, x and y (pixel) of the path of a star in the middle of the field, (m, 3)."""
    camera = case.instrument.camera
    path = path_of(case.instrument, Streams(0, 0))
    place = camera.project(Rotation.from_rotvec(path.rotation).apply([0.0, 0.0, 1.0]))
    return np.column_stack([path.weight, place - camera.centre])


def _tried(
    case: Case, plan: Plan, seed: int, numbers: Sequence[int], attitude: Rotation
) -> NDArray[np.void]:
    """Draw, solve and judge a block of trials."""
    many, most = len(numbers), case.tracker.detection.max_spots
    matrix = attitude.as_matrix()
    keys = _keys(key(Streams(seed, 0), "covariance"), np.array(numbers, np.uint64))
    place = np.empty((many, most, 2))
    star, variance = np.empty((many, most), np.int64), np.empty((many, most))
    matched, spots = np.empty((2, many), np.int64)
    _draw(matrix, keys, *plan, place, star, variance, matched, spots)
    truth = attitude
    if case.lateness or case.instrument.mounting != case.believed_mounting:
        truth = Rotation.concatenate(
            [asked_for(case, attitude[n], Streams(seed, numbers[n])) for n in range(many)]
        )
    judged = np.empty(many, JUDGED)
    # Trials of about as many stars go together, so that few places of the arrays stay empty.
    for part in np.array_split(np.argsort(matched, kind="stable"), -(-many // TOGETHER)):
        used = max(int(matched[part[-1]]), 1)
        there = np.arange(used) < matched[part, None]
        stars = np.where(there, star[part, :used], 0)
        reference = plan.field.believed[stars]
        noise = np.where(there, variance[part, :used], 1.0) + plan.field.own[stars]
        seen = np.where(there[..., None], place[part, :used], 0.0)
        found, covariance = _solved(case, matrix[part], seen, reference, noise, there)
        solved = (matched[part] >= case.tracker.identification.min_matches) & (
            found.observability == Observability.OBSERVED
        )
        judged[part] = judge_all(
            found.source_to_target, covariance, truth[part], matched[part], spots[part], solved
        )
    return judged


def _solved(
    case: Case,
    matrix: Floats,
    seen: Floats,
    reference: Floats,
    noise: Floats,
    there: NDArray[np.bool_],
) -> tuple[Alignment, Floats]:
    """Attitudes of m trials with up to n stars each, and their covariances as the tracker has them.

    matrix     (m, 3, 3) true icrs_to_camera, by which the identification knows its stars
    seen       (m, n, 2) pixel;  reference  (m, n, 3) directions;  noise  (m, n) pixel^2
    there      (m, n) which of them are there
    """
    camera, tolerance = case.believed_camera, case.tracker.identification.focal_tolerance
    if tolerance:
        towards = _turned(matrix, reference)
        predicted = camera.project(towards.reshape(-1, 3)).reshape(seen.shape)
        scale = 1 + np.clip(
            _scales(seen, predicted, noise, there, tolerance), -tolerance, tolerance
        )
        seen = camera.centre + (seen - camera.centre) / scale[:, None, None]
    observed = camera.unproject(seen.reshape(-1, 2)).reshape(reference.shape)
    weight = np.where(there, camera.focal_length_px**2 / noise, 0.0)
    found = align(observed, reference, weight)
    # As the tracker's solver does with residuals that the noise does not explain.
    freedom = np.maximum(2 * there.sum(axis=1) - (4 if tolerance else 3), 1)
    chance = special.chdtrc(freedom, 2 * found.loss)
    excess = np.where(chance < SURPRISE, 2 * found.loss / freedom, 1.0)
    covariance = found.covariance
    if tolerance:
        covariance = scale_unknown(covariance, observed, weight, tolerance)
    return found, covariance * excess[:, None, None]


@njit(cache=True, error_model="numpy")
def _turned(matrix, direction):  # type: ignore[no-untyped-def]
    """Directions (m, n, 3) in the axes of m cameras, the same digits for any n."""
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


@njit(cache=True, error_model="numpy")
def _scales(seen, predicted, noise, there, tolerance):  # type: ignore[no-untyped-def]
    """By how much the identification takes the focal length for longer, (m,) 1.

    It fits the scale together with the attitude, to stars weighted by their noise and with the
    tolerance as its standard deviation beforehand.
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


@njit(cache=True, error_model="numpy")
def _keys(start, numbers):  # type: ignore[no-untyped-def]
    keys = np.empty(len(numbers), np.uint64)
    for n in range(len(numbers)):
        keys[n] = bits(start, numbers[n])
    return keys


@njit(cache=True, error_model="numpy")
def _draw(  # type: ignore[no-untyped-def]
    attitude, keys, response, pull, field, companions, view, gate, false,
    place, star, variance, matched, spots,
):  # fmt: skip
    """Write the found stars of each trial: place, index, variance; how many matches and spots."""
    height = field.direction[:, 2].copy()
    radius = math.acos(view.cosine)
    most = place.shape[1]
    flux = np.empty(most)
    for n in range(len(attitude)):
        a = attitude[n]
        middle = math.asin(min(max(a[2, 2], -1.0), 1.0))
        low, high = max(middle - radius, -math.pi / 2), min(middle + radius, math.pi / 2)
        first = np.searchsorted(height, math.sin(low))
        last = np.searchsorted(height, math.sin(high), side="right")
        count = others = 0
        for i in range(first, last):
            d = field.direction[i]
            z = a[2, 0] * d[0] + a[2, 1] * d[1] + a[2, 2] * d[2]
            if z < view.cosine:
                continue
            x, y = _project(a, d, view)
            column, row = round(x), round(y)
            if not (
                view.border <= column < view.columns - view.border
                and view.border <= row < view.rows - view.border
            ):
                continue
            start = bits(keys[n], field.number[i])
            found, dx, dy, spread = _centroid(x, y, column, row, field.flux[i], start, response)
            if not found:
                continue
            for k in range(companions.start[i], companions.start[i + 1]):
                u, v = _project(a, companions.direction[k], view)
                more_x, more_y = _pulled(u - x, v - y, companions.flux[k] - field.flux[i], pull)
                dx, dy = dx + more_x, dy + more_y
            if np.isnan(dx):
                continue
            reach = gate * gate * 2 * (spread + field.own[i])
            if not field.known[i] or dx * dx + dy * dy > reach:
                others += 1
                continue
            x, y = x + dx, y + dy
            at = count
            if count == most:  # the brightest are kept
                at = int(np.argmin(flux))
                if flux[at] >= field.flux[i]:
                    continue
            else:
                count += 1
            place[n, at, 0], place[n, at, 1] = x, y
            star[n, at], variance[n, at], flux[at] = i, spread, field.flux[i]
        matched[n] = count
        noise = drawn(false, uniform(bits(keys[n], np.uint64(2**63))))
        spots[n] = min(count + others + int(noise), most)


@njit(cache=True, error_model="numpy", inline="always")
def _project(a, d, view):  # type: ignore[no-untyped-def]
    """`Camera.project` of one direction in front of the camera."""
    z = a[2, 0] * d[0] + a[2, 1] * d[1] + a[2, 2] * d[2]
    u = (a[0, 0] * d[0] + a[0, 1] * d[1] + a[0, 2] * d[2]) / z
    v = (a[1, 0] * d[0] + a[1, 1] * d[1] + a[1, 2] * d[2]) / z
    r = u * u + v * v
    radial = 1 + r * (view.k1 + r * (view.k2 + r * view.k3))
    x = u * radial + 2 * view.p1 * u * v + view.p2 * (r + 2 * u * u)
    y = v * radial + view.p1 * (r + 2 * v * v) + 2 * view.p2 * u * v
    return view.centre_x + view.focal * x, view.centre_y + view.focal * y


@njit(cache=True, error_model="numpy")
def _centroid(x, y, column, row, flux, start, response):  # type: ignore[no-untyped-def]
    """Whether a star is found; how far off its centroid is, and the variance of a coordinate."""
    i = min(int((x - column + 0.5) * PHASES), PHASES - 1)
    j = min(int((y - row + 0.5) * PHASES), PHASES - 1)
    at = (flux - response.first) / STEP
    k = min(max(int(at), 0), len(response.above) - 2)
    t = min(max(at - k, 0.0), 1.0)
    above = (1 - t) * response.above[k, j, i] + t * response.above[k + 1, j, i]
    if not above + inverse_normal(uniform(bits(start, np.uint64(0)))) > 0:
        return False, 0.0, 0.0, 0.0
    normal_x = inverse_normal(uniform(bits(start, np.uint64(1))))
    normal_y = inverse_normal(uniform(bits(start, np.uint64(2))))
    bias = (1 - t) * response.bias[k, j, i] + t * response.bias[k + 1, j, i]
    root = (1 - t) * response.root[k, j, i] + t * response.root[k + 1, j, i]
    xx, yx, yy = root / math.exp(flux)
    spread = (xx * xx + yx * yx + yy * yy) / 2
    return True, bias[0] + xx * normal_x, bias[1] + yx * normal_x + yy * normal_y, spread


@njit(cache=True, error_model="numpy")
def _pulled(dx, dy, ratio, pull):  # type: ignore[no-untyped-def]
    """How far a companion pulls a centroid; NaN where it swallows the star."""
    r, q = (ratio - RATIOS[0]) / (RATIOS[1] - RATIOS[0]), len(RATIOS) - 1
    if not (abs(dx) < REACH and abs(dy) < REACH) or r < 0:
        return 0.0, 0.0
    if np.isnan(pull[min(int(r + 0.5), q), round(dy) + REACH, round(dx) + REACH, 0]):
        return np.nan, np.nan
    k, i, j = min(int(r), q - 1), int(dx + REACH), int(dy + REACH)
    t, u, v = min(r - k, 1.0), dx + REACH - i, dy + REACH - j
    x = y = total = 0.0
    for n in range(8):
        c, b, a = n // 4, (n // 2) % 2, n % 2
        weight = (t if c else 1 - t) * (v if b else 1 - v) * (u if a else 1 - u)
        one = pull[k + c, j + b, i + a]
        if not np.isnan(one[0]):
            x, y, total = x + weight * one[0], y + weight * one[1], total + weight
    return x / total, y / total
