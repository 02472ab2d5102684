"""Case -> effect of hot pixels on the stars that its tracker detects, and on its search."""

import math
from typing import NamedTuple

import numpy as np

from startrack import observation, response
from startrack.attitude import FEWEST
from startrack.budget.fields import attitudes, design_row, listed_fields
from startrack.budget.fixed import visible
from startrack.core import Floats, Ints, Stars, Streams, is_code, kept, kernel, median
from startrack.design import Case
from startrack.identification import LEAST_SIGMA, LOG_ATTITUDES, NARROWEST, REACH, log_evidence

EVEN: Floats = (np.arange(32) + 0.5) / 32  # probabilities of the quantiles of a threshold
HOT_RANGE, HOT_STEP = 5.0, 1.0  # magnitude: range above the faintest star with shifts; a step of it
WINDOWS = 512  # windows with hot pixels, in which shifts are measured
FIELDS, DRAWS = 64, 32  # fields of the sky, and frames of each, to find the stars that are left out
MEDIAN_SQUARE = 2 * math.log(2)  # median of a squared error, in variances per axis
MOST = 12  # a frame with this number of matched stars is assumed to be identified


class NearHot(NamedTuple):
    """Effect of hot pixels on stars of m magnitudes, and on the search of a frame.

    search  quantities of the search in a frame with hot pixels
    false   (k,) electron, signal of the false spots that hot pixels make
    kept    (m,) probability that the tracker keeps a star that the search finds
    moment  (m, 2, 2) pixel^2, second moment of the star shifts by hot pixels
    lost    as `Solver.lost`, including fields rejected for lack of evidence among false spots
    """

    search: response.StarSearch
    false: Floats
    kept: Floats
    moment: Floats
    lost: Floats


def hot_stars(case: Case, even: Case, star: response.Errors) -> NearHot:
    """Effect of the hot pixels near stars on those stars that are detected.

        kept = P(used),   moment = <s s^T> of the used

    A fraction of the stars has hot pixels in its window. Some of these stars are rejected by the
    search; the others are shifted by s. Frames are drawn to decide which stars the tracker uses.
    The identification matches spots within a radius that grows with the median error of the frame,
    and needs evidence against the false spots. The solver then leaves out the worst stars. Shifted
    stars bias its fit and enlarge its median residual. Therefore a bright star with a shift of many
    sigmas is kept if other stars are shifted, too. Shifts are measured at a few magnitudes; they
    are inversely proportional to the star's light.

    even      the case `with_uniform_dark`
    star      errors of its stars
    Accuracy  model: as drawn spots, which use the same windows; evidence by brightness and false
              matches are left out. Ratio of the error across to the error in 1000 or more windows,
              for the design `noise_only`: 1.00 for 0.6 % hot pixels, 0.89 for 1.7 %, 1.03 for 4.4 %
              and 1.15 for 5.6 %. The number of attitudes is up to 5 % too small.
    """
    magnitude, fewest = star.magnitude, case.tracker.identification.min_matches
    hot = _hot_effect(*map(response.star_inputs, (case, even)))
    if not hot.windows.chance:
        none = np.zeros_like(star.stated)
        return NearHot(hot.search, hot.false, np.ones(len(magnitude)), none, np.ones(fewest))
    detected = response.detection_probability(even, magnitude, search=hot.search) * star.kept
    drawn = _frames(case, even, star, detected, hot)
    counts = _Counts(*np.zeros((4, len(hot.magnitude))), *np.zeros((2, max(MOST, fewest))))
    _count(drawn, _rules(case, len(hot.false)), counts)
    kept = np.where(counts.seen > 0, counts.used / np.maximum(counts.seen, 1), 1.0)
    square = counts.square / np.maximum(counts.solved, 1) / 2
    square = np.where(counts.solved > 0, square, 0.0)
    lost = np.where(counts.tried > 0, 1 - counts.accepted / np.maximum(counts.tried, 1), 0.0)
    lost[:fewest] = 1.0
    index = np.abs(magnitude[:, None] - hot.magnitude).argmin(axis=1)
    fainter = 10 ** (0.8 * (magnitude - hot.magnitude[index]))
    moment = (fainter * square[index])[:, None, None] * np.eye(2)
    return NearHot(hot.search, hot.false, kept[index], moment, lost)


class _HotEffect(NamedTuple):
    """Effect of hot pixels on the search, and on stars of k magnitudes.

    search     quantities of the search in a frame with hot pixels
    magnitude  (k,) G of these stars
    windows    shifts of these stars
    false      (f,) electron, signal of the spots that hot pixels make in an empty frame
    """

    search: response.StarSearch
    magnitude: Floats
    windows: response.HotPixels
    false: Floats


@kept(4)
def _hot_effect(case: Case, even: Case) -> _HotEffect:
    """The effect measured in windows with hot pixels; cached for the last 4 cases."""
    magnitude, sky = response.errors(even).magnitude, observation.sky_electrons(case)
    empty = response.empty_frame(case, sky)
    assert empty is not None
    search = response.StarSearch(empty.noise, np.quantile(empty.of_places, EVEN))
    above = response.detection_probability(even, magnitude, search=search)
    faintest = magnitude[above > 0.5].max(initial=magnitude[0])
    place = np.arange(max(faintest - HOT_RANGE, magnitude[0]), faintest + 1e-9, HOT_STEP)
    light = response.scale(even).star * 10 ** (-0.4 * place)
    middle = empty.noise, empty.threshold_sigma
    hot, higher = response.hot_windows(
        response.ResponseGrid(even, sky, search=middle), case, light, WINDOWS
    )
    near = (search.threshold[:, None] - higher[-1]).ravel()
    weight = np.repeat([1 - hot.chance, hot.chance], [len(EVEN), len(near)])
    weight[: len(EVEN)] /= len(EVEN)
    weight[len(EVEN) :] /= len(near)
    search = response.StarSearch(empty.noise, _quantiles(np.append(search.threshold, near), weight))
    return _HotEffect(search, place, hot, empty.flux)


def _quantiles(values: Floats, weight: Floats) -> Floats:
    """Quantiles of weighted values (n,) at the probabilities EVEN."""
    order = np.argsort(values)
    middle = np.cumsum(weight[order]) - weight[order] / 2
    return np.interp(EVEN, middle / weight.sum(), values[order])


class _Rules(NamedTuple):
    """Rules by which the tracker uses a star and accepts an attitude.

    focal_length_px  pixel
    tolerance        1, tracker.identification.focal_tolerance
    radius           pixel, tracker.identification.match_radius
    gate             sigma, tracker.attitude.gate
    area             1, area of the image over the square of the focal length
    evidence         logarithm of the required evidence
    fewest           least number of stars for an attitude
    most             largest number of spots that are kept
    false            number of spots that hot pixels make
    verified         number of spots from which the evidence is computed
    """

    focal_length_px: float
    tolerance: float
    radius: float
    gate: float
    area: float
    evidence: float
    fewest: int
    most: int
    false: int
    verified: int


class _Drawn(NamedTuple):
    """The n stars of some fields, and their draws in d frames.

    first     (m + 1,) index of the first star of each field, and n
    x, y      (n,) 1, x / z and y / z in camera axes
    detected  (n,) 1, probability that the search finds the star
    false     (n,) number of brighter spots that hot pixels make
    sigma     (3, n) pixel per axis: the true value without hot pixels; the value that the
              identification assumes; and the value by which the solver weights
    place     (n,) index of the magnitude whose measured shifts are used
    chance    (d, n) uniform;  noise  (d, n, 2) standard normal
    shift     (d, n, 2) pixel, by hot pixels; NaN where these make the search reject the star
    """

    first: Ints
    x: Floats
    y: Floats
    detected: Floats
    false: Ints
    sigma: Floats
    place: Ints
    chance: Floats
    noise: Floats
    shift: Floats


def _rules(case: Case, false: int) -> _Rules:
    """Conditions of a case's tracker, given the number of spots that hot pixels make."""
    settings, detector = case.tracker.identification, case.instrument.detector
    focal = case.believed_camera.focal_length_px
    evidence = -math.log(settings.max_false_probability)
    return _Rules(
        focal_length_px=focal,
        tolerance=settings.focal_tolerance,
        radius=settings.match_radius,
        gate=case.tracker.attitude.gate,
        area=detector.columns * detector.rows / focal**2,
        evidence=-math.inf if is_code(settings.method) else evidence,
        fewest=settings.min_matches,
        most=case.tracker.detection.max_spots,
        false=false,
        verified=settings.verify_spots,
    )


def _frames(
    case: Case, even: Case, star: response.Errors, detected: Floats, hot: _HotEffect
) -> _Drawn:
    """Frames of the case.

    detected  (m,) 1, probability that the search finds a star of each magnitude of `star`
    """
    view = listed_fields(case, attitudes, FIELDS)
    inside, magnitude = visible(case, view, float(star.magnitude[-1]), case)
    likely = np.interp(magnitude, star.magnitude, detected)
    counts = likely > 1e-3
    inside, magnitude, likely = inside[counts], magnitude[counts], likely[counts]
    closest = np.abs(magnitude[:, None] - hot.magnitude).argmin(axis=1)
    shifts, chance = hot.windows.shift, hot.windows.chance
    random, shape = Streams(0, 0)("stars near hot pixels in frames"), (DRAWS, len(magnitude))
    shift = shifts[closest, random.integers(shifts.shape[1], size=shape)]
    shift *= 10 ** (0.4 * (magnitude - hot.magnitude[closest]))[:, None]
    shift[random.random(shape) >= chance] = 0.0
    light = response.scale(even).star * 10 ** (-0.4 * magnitude)
    brighter = len(hot.false) - np.searchsorted(np.sort(hot.false), light, side="right")
    return _Drawn(
        first=np.searchsorted(view.field[inside], np.arange(FIELDS + 1)),
        x=view.x[inside],
        y=view.y[inside],
        detected=likely,
        false=brighter,
        sigma=_sigmas(case, star, view.sky.stars[view.star[inside]], magnitude),
        place=closest,
        chance=random.random(shape),
        noise=random.standard_normal((*shape, 2)),
        shift=shift,
    )


def _sigmas(case: Case, star: response.Errors, stars: Stars, magnitude: Floats) -> Floats:
    """`_Drawn.sigma` of stars, by magnitudes (n,) of sunlike stars of equal brightness."""
    stated = np.trace(star.stated, axis1=1, axis2=2) / 2
    noise = np.interp(magnitude, star.magnitude, stated)
    knowledge = response.knowledge_of(case)
    known = knowledge.places(stars)
    lasting = assumed = knowledge.systematic[known]
    if (of_pixels := knowledge.of_pixels[known]).any():  # with hot pixels
        lasting = assumed - of_pixels + response.lasting(star, magnitude) ** 2
    return np.sqrt([noise + lasting, np.maximum(noise, LEAST_SIGMA**2), noise + assumed])


class _Counts(NamedTuple):
    """Numbers of stars at the k magnitudes of the shifts, and of frames, added up by `_count`.

    seen, used       (k,) stars that the search finds, and those of them that the tracker uses
    solved, square   (k,) in frames with an attitude: number of used stars, sum of their squared
                     shifts
    tried, accepted  (j,) frames with 0, 1, ... matches, and such frames with an attitude
    """

    seen: Floats
    used: Floats
    solved: Floats
    square: Floats
    tried: Floats
    accepted: Floats


@kernel
def _count(drawn: _Drawn, rules: _Rules, counts: _Counts) -> None:
    """Count the stars that the search finds, and the stars that the tracker uses, in all frames."""
    for d in range(len(drawn.chance)):
        for f in range(len(drawn.first) - 1):
            first, end = drawn.first[f], drawn.first[f + 1]
            star, count = np.empty(end - first, np.int64), 0
            for i in range(first, end):
                room = count + drawn.false[i] < rules.most
                if room and drawn.chance[d, i] < drawn.detected[i]:
                    counts.seen[drawn.place[i]] += 1
                    if not np.isnan(drawn.shift[d, i, 0]):
                        star[count] = i
                        count += 1
            matched, excess = _matched(d, star[:count], drawn, rules)
            good = len(matched) >= rules.fewest
            if good and len(matched) < len(counts.tried):
                spots = min(count + rules.false, rules.verified, rules.most)
                good = _evidence(d, matched, drawn, rules, first, end, spots, excess)
                counts.tried[len(matched)] += 1
                counts.accepted[len(matched)] += good
            if good:
                matched = _solved(d, matched, drawn, rules)
            for i in matched:
                counts.used[drawn.place[i]] += 1
                if good:
                    counts.solved[drawn.place[i]] += 1
                    moved = drawn.shift[d, i, 0] ** 2 + drawn.shift[d, i, 1] ** 2
                    counts.square[drawn.place[i]] += moved


@kernel
def _error(d: int, i: int, drawn: _Drawn) -> tuple[float, float]:
    """Error of star i in frame d by noise and hot pixels, pixel in x and y."""
    x = drawn.sigma[0, i] * drawn.noise[d, i, 0] + drawn.shift[d, i, 0]
    return x, drawn.sigma[0, i] * drawn.noise[d, i, 1] + drawn.shift[d, i, 1]


@kernel
def _matched(d: int, star: Ints, drawn: _Drawn, rules: _Rules) -> tuple[Ints, float]:
    """The stars that the identification matches in its last round.

    Also returned: the variance per axis (pixel^2) that it assumes in addition to their noise.
    """
    square, variance = np.empty(len(star)), np.empty(len(star))
    for k in range(len(star)):
        x, y = _error(d, star[k], drawn)
        square[k], variance[k] = x * x + y * y, drawn.sigma[1, star[k]] ** 2
    if len(star) == 0:
        return star, 0.0
    excess = max(median(square) / MEDIAN_SQUARE - median(variance), 0.0)
    kept = np.empty(len(star), np.bool_)
    for k in range(len(star)):
        widest = max(rules.radius, REACH * np.sqrt(variance[k]))
        radius = max(REACH * np.sqrt(variance[k] + excess), NARROWEST * rules.radius)
        kept[k] = square[k] <= min(radius, widest) ** 2
    return star[kept], excess


@kernel
def _residuals(
    d: int, star: Ints, drawn: _Drawn, rules: _Rules, variance: Floats, rows: Floats
) -> Floats:
    """Squared residuals (k,) pixel^2 of stars from the fitted attitude and scale.

    variance  (k,) pixel^2 per axis, by which the stars are weighted
    rows      (k, 2, 4) pixel / radian, derivatives; written in place
    """
    info, moved, square = np.zeros((4, 4)), np.zeros(4), np.zeros(len(star))
    # The scale is fixed if no focal length is fitted.
    info[3, 3] = max(rules.tolerance, 1e-9) ** -2
    for k in range(len(star)):
        design_row(drawn.x[star[k]], drawn.y[star[k]], rules.focal_length_px, rows[k])
        error = _error(d, star[k], drawn)
        for axis in range(2):
            for a in range(4):
                weighted = rows[k, axis, a] / variance[k]
                moved[a] += weighted * error[axis]
                for b in range(4):
                    info[a, b] += weighted * rows[k, axis, b]
    turn = np.linalg.inv(info) @ moved
    for k in range(len(star)):
        error = _error(d, star[k], drawn)
        for axis in range(2):
            rest = error[axis]
            for a in range(4):
                rest -= rows[k, axis, a] * turn[a]
            square[k] += rest * rest
    return square


@kernel
def _evidence(
    d: int,
    star: Ints,
    drawn: _Drawn,
    rules: _Rules,
    first: int,
    end: int,
    spots: int,
    excess: float,
) -> bool:
    """Whether the positions of the matched stars are enough evidence of an attitude."""
    focal, unknowns = rules.focal_length_px, 4 if rules.tolerance > 0 else 3
    rows, prior = np.empty((len(star), 2, 4)), np.zeros((unknowns, unknowns))
    log_prior = -LOG_ATTITUDES
    if rules.tolerance > 0:
        prior[3, 3] = rules.tolerance**-2
        log_prior -= math.log(rules.tolerance * math.sqrt(2 * math.pi))
    variance = drawn.sigma[1][star] ** 2
    square = _residuals(d, star, drawn, rules, variance + excess, rows)
    places = np.ascontiguousarray(rows[:, :, :unknowns]) / focal
    evidence = log_evidence(
        square / focal**2,
        variance / focal**2,
        star - first,
        places,
        prior,
        log_prior,
        spots,
        end - first,
        rules.area,
        rules.radius / focal,
    )
    return evidence >= rules.evidence


@kernel
def _solved(d: int, star: Ints, drawn: _Drawn, rules: _Rules) -> Ints:
    """The stars that the solver keeps; it leaves stars out one by one, as `attitude.solve` does."""
    allowed, rows = len(star), np.empty((len(star), 2, 4))
    while len(star) > FEWEST:
        variance = drawn.sigma[2][star] ** 2
        square = _residuals(d, star, drawn, rules, variance, rows) / variance
        worst = int(np.argmax(square))
        limit = rules.gate**2 * max(1.0, median(square) / MEDIAN_SQUARE)
        if square[worst] <= limit or len(star) <= allowed / 2:
            break
        star = np.append(star[:worst], star[worst + 1 :])
    return star
