"""Case -> its Budget in milliseconds, without a trial."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from startrack import trial
from startrack.budget.budget import NEIGHBOURS, Budget, Cause, Law, Line, causes, refuse_scans
from startrack.budget.fields import (
    FIELDS,
    Attitudes,
    Fields,
    FieldStars,
    Response,
    Solver,
    attitudes,
    fields,
    propagate,
)
from startrack.budget.fixed import OF_STARS, displaced, moved, of_the_camera, through_lens, visible
from startrack.budget.left_out import of_false_spots, of_the_case, of_the_sky
from startrack.core import Flags, Floats, Ints, Refused, Streams
from startrack.design import Case

FINE = 0.05  # magnitude between two entries
HOT = "hot pixels"
MEDIAN_SQUARE = 2 * math.log(2)  # of a squared error, in variances per axis
EVEN: Floats = (np.arange(32) + 0.5) / 32  # quantiles of a threshold
HOT_RANGE, HOT_STEP = 5.0, 1.0  # magnitude above the faintest, at which shifts are measured; a step


class Measured(NamedTuple):
    """Detection and errors of single stars.

    star     by cause; where pixels are hot, of the case `with_uniform_dark`
    above    (m,) 1, chance to pass the threshold
    table    the same in small steps of magnitude, with what hot pixels do
    random   names of its random causes
    """

    star: trial.Errors
    above: Floats
    table: Response
    random: list[str]


@lru_cache(maxsize=2)
def response(case: Case) -> Measured:
    """Detection and errors of single stars; kept for the 2 last cases, as units share one."""
    if trial.boxed(case):
        return in_boxes(case)
    pattern = trial.dark_pattern(case) if has_hot_pixels(case) else None
    even = trial.with_uniform_dark(case) if pattern else case
    star = trial.errors(even)
    # Where dark signal fills the converter no star is measured, and none is moved.
    hot = hot_stars(case, even, star) if pattern and _variance(star.stated).all() else None
    search = hot and hot.search
    grid = np.arange(star.magnitude[0], star.magnitude[-1] + FINE / 2, FINE)
    if case.instrument.optics.tabulated:
        zone = trial.zone_errors(even)
        kept, stated, random = zone.kept, zone.stated, zone.random
        fraction = trial.zone_detection(even, grid, search)
    else:
        kept, stated = star.kept[None], star.stated[None]
        random = {name: one[None] for name, one in star.random.items()}
        fraction = trial.detection_probability(even, grid, search=search)[None]
    false = np.zeros(len(grid))
    if pattern and hot:
        size = trial.scale(even)
        # Of what the read-out adds, the spread of the dark signal is constant in time.
        part = (pattern.spread / size.noise) ** 2
        random = random | {
            trial.READ: (1 - part) * random[trial.READ],
            "DSNU": part * random[trial.READ],
        }
        random |= {HOT: np.broadcast_to(hot.moment, stated.shape)}
        kept = kept * hot.kept
        light = size.star * 10 ** (-0.4 * grid)
        false = (hot.false > light[:, None]).sum(axis=1).astype(float)
    above = trial.detection_probability(even, star.magnitude, search=search)
    fraction = fraction * _between(star.magnitude, kept, grid)
    return _measured(star, above, grid, fraction, stated, random, false)


def _measured(
    star: trial.Errors, above: Floats, grid: Floats, fraction: Floats, stated: Floats,
    random: dict[str, Floats], false: Floats,
) -> Measured:  # fmt: skip
    """Covariances `stated` and `random`, (z, m, 2, 2) of stars, over the magnitudes of a grid."""
    causes = [_fine(star.magnitude, covariance, grid) for covariance in random.values()]
    table = Response(
        float(grid[0]), FINE, fraction, _fine(star.magnitude, stated, grid),
        np.stack(causes, axis=1), false,
    )  # fmt: skip
    return Measured(star, above, table, list(random))


def in_boxes(case: Case) -> Measured:
    """The same of stars that are drawn in the tracker's boxes, alike along both axes.

    Noise is of the light by the share of a star's electrons in those of its image; what different
    pixels add is that of hot pixels.
    """
    stars, size, box = trial.boxed_stars(case), trial.scale(case), case.tracker.box
    known = np.isfinite(stars.total)
    magnitude, measured = stars.magnitude[known], stars.measured[known]
    if len(magnitude) < 2:
        raise Refused(BLIND)
    stated, temporal, method, total = (
        part[known] ** 2 for part in (stars.stated, stars.temporal, stars.method, stars.total)
    )
    electrons = size.star * 10 ** (-0.4 * magnitude)
    light = electrons / (electrons + size.pixel**2 * box.size**2)
    variance = {
        trial.SHOT: light * temporal,
        trial.READ: (1 - light) * temporal,
        trial.METHOD: method,
        HOT: np.maximum(total - temporal - method, 0.0),
    }
    random = {name: one[:, None, None] * np.eye(2) for name, one in variance.items()}
    no_mean = np.zeros((len(magnitude), 2))
    star = trial.Errors(
        magnitude, np.ones(len(measured)), stated[:, None, None] * np.eye(2), random, no_mean
    )
    grid = np.arange(magnitude[0], magnitude[-1] + FINE / 2, FINE)
    zones = len(trial.zone_errors(case).kept) if case.instrument.optics.tabulated else 1
    fraction, stated = (
        np.repeat(part, zones, axis=0)  # zones are all alike
        for part in (_between(magnitude, measured[None], grid), star.stated[None])
    )
    by_zone = {name: np.repeat(one[None], zones, axis=0) for name, one in random.items()}
    return _measured(star, measured, grid, fraction, stated, by_zone, np.zeros(len(grid)))


def has_hot_pixels(case: Case) -> bool:
    """Whether some pixels have a dark current far from that of the others."""
    detector = case.instrument.detector
    return bool(detector.age or (detector.defects and detector.defects.hot))


class NearHot(NamedTuple):
    """What hot pixels do to stars of m magnitudes, and to the search of a frame.

    search  of a frame with them
    false   (k,) electron, of the false spots that they make
    kept    (m,) chance that they do not make the tracker lose a star that the search finds
    moment  (m, 2, 2) pixel^2, second moment over the stars of the shifts by them
    """

    search: trial.Search
    false: Floats
    kept: Floats
    moment: Floats


def hot_stars(case: Case, even: Case, star: trial.Errors) -> NearHot:
    """What hot pixels near stars do to those that are detected.

        kept = 1 - c (1 - <w>),   moment = c <w s s^T> / kept,   w = Phi(gate - |s| / sigma)

    over the windows with hot pixels, of which a part c of the stars has one: those that the search
    rejects or the solver's gate leaves out are lost, the others are shifted by s, and sigma is the
    error that the tracker states. The gate is wider where the median of all stars is. Shifts are
    measured at a few magnitudes; they go as one over the star's light.

    even      the case `with_uniform_dark`;  star  its errors
    Accuracy  model: that of drawn spots, whose windows these are. Beside 3000 windows each of
              `noise_only` with a damaged detector, the budget's error across is 0.98 of theirs near
              launch, 0.90 where 82 % of the stars have a hot pixel in their window, and 0.68 where
              95 % have: errors are long-tailed there, and the budget's are too small.
    """
    magnitude, sky = star.magnitude, trial.sky_electrons(case)
    empty = trial.empty_frame(case, sky)
    assert empty is not None
    search = trial.Search(empty.noise, np.quantile(empty.of_tiles, EVEN))
    above = trial.detection_probability(even, magnitude, search=search)
    faintest = magnitude[above > 0.5].max(initial=magnitude[0])
    place = np.arange(max(faintest - HOT_RANGE, magnitude[0]), faintest + 1e-9, HOT_STEP)
    light = trial.scale(even).star * 10 ** (-0.4 * place)
    middle = empty.noise, empty.threshold_sigma
    hot, higher = trial.hot_windows(trial.Grid(even, sky, search=middle), case, light)
    near = (search.threshold[:, None] - higher[-1]).ravel()
    weight = np.repeat([1 - hot.chance, hot.chance], [len(EVEN), len(near)])
    weight[: len(EVEN)] /= len(EVEN)
    weight[len(EVEN) :] /= len(near)
    search = trial.Search(empty.noise, _quantiles(np.append(search.threshold, near), weight))
    index = np.abs(magnitude[:, None] - place).argmin(axis=1)
    if not hot.chance:
        none = np.zeros_like(star.stated)
        return NearHot(search, empty.flux, np.ones(len(magnitude)), none)
    shift = hot.shift[index] * 10 ** (0.4 * (magnitude - place[index]))[:, None, None]
    good, shift = np.isfinite(shift[..., 0]), np.nan_to_num(shift)
    sigma = np.sqrt(_variance(star.stated))[:, None]
    gate = case.tracker.attitude.gate * _typical(shift / sigma[..., None], good, hot.chance)
    weight = good * ndtr(gate[:, None] - np.hypot(*shift.transpose(2, 0, 1)) / sigma)
    kept = 1 - hot.chance * (1 - weight.mean(axis=1))
    square = np.einsum("mk,mka,mkb->mab", weight, shift, shift) / weight.shape[1]
    return NearHot(search, empty.flux, kept, hot.chance * square / kept[:, None, None])


def _between(magnitude: Floats, table: Floats, grid: Floats) -> Floats:
    """Tables (z, m) between magnitudes, (z, k), by straight lines."""
    before = np.clip(np.searchsorted(magnitude, grid, side="right") - 1, 0, len(magnitude) - 2)
    t = np.clip((grid - magnitude[before]) / np.diff(magnitude)[before], 0.0, 1.0)
    return np.asarray(table[:, before] + t * (table[:, before + 1] - table[:, before]))


def _fine(magnitude: Floats, table: Floats, grid: Floats) -> Floats:
    """Covariances (z, m, 2, 2) between magnitudes, straight lines in the logarithm; pixel^2."""
    xx, yy = (np.maximum(table[..., a, a], 1e-16) for a in (0, 1))
    ratio = np.clip(table[..., 0, 1] / np.sqrt(xx * yy), -1, 1)
    correlation = _between(magnitude, ratio, grid)
    x, y = (np.exp(_between(magnitude, np.log(each) / 2, grid)) for each in (xx, yy))
    cross = correlation * x * y
    return np.stack([x * x, cross, cross, y * y], axis=-1).reshape(*x.shape, 2, 2)


LEAST = 1e-3  # probability from which on a star counts; chosen by hand, far below the 1 % of fields
BLIND = "the case must see enough stars somewhere in the sky, it does not"


def analytic(case: Case, count: int = FIELDS) -> Budget[Law]:
    """Error budget from design parameters, the real sky, and the tracker's answer to single stars.

        error of a field = sum of gains * errors of its stars (`propagate`), rms over fields

    The errors of a star follow from noise-free images of stars over sub-pixel places: the method's
    is their offset, the noise's what the tracker states of them, PRNU's and DSNU's what a fixed
    pattern moves them by. Fixed errors (camera, catalogue) move each star of each field.

    Behind a lens table, noise and detection are those of the star's zone of the frame and of colour
    (`zone_errors`), and the star is displaced by what its image's place and shape differ from those
    that the tracker assumes: of sunlike stars (PSF over the field), and by colour (lateral colour).

    count   fields over the sky, a power of two
    Raises    ValueError where the case contradicts itself, or no field can be solved.
    Pixels of outlying dark current move, hide and imitate stars (`hot_stars`); the search then has
    the threshold of a frame with them. All else is that of even pixels with the spread of the rest.

    Accuracy  model: to first order; cosmic rays, dead pixels, the smear of a roll, lag and
              aberrations that grow over the field without a lens table are left out; so is light
              that varies over the sky (`scene.lights`); a star near the threshold, or so sharp
              that the tracker may take it for a hot pixel, counts by its chance. numerical: 1 %
              across and 3 % about for 512 fields.
    """
    budget = budget_if_solved(case, count)
    if budget is None:
        raise Refused(BLIND)
    return budget


def budget_if_solved(case: Case, count: int = FIELDS) -> Budget[Law] | None:
    """`analytic`, but None where no field can be solved."""
    found = of_fields(case, fields(case.catalog, case.instrument.camera, attitudes, count))
    return found and found.budget


class FieldBudget(NamedTuple):
    """A budget over some fields, the errors in each of them, and the stars that make these."""

    budget: Budget[Law]
    attitudes: Attitudes
    stars: FieldStars


def of_fields(case: Case, view: Fields, like: Case | None = None) -> FieldBudget | None:
    """The budget over some fields, and the errors in each of them; None where none is solved.

    like  a case that differs in the places of its stars alone, whose response to single stars is
          that of this one; None: it is measured
    """
    refuse_scans(case)
    same = like or case
    star, above, table, random = response(same)
    gate = case.tracker.attitude.gate
    if not table.fraction.any():
        return None
    inside, magnitude = visible(case, view, float(star.magnitude[-1]), same)
    systematic = trial.systematic_variance_of(same, view.sky.stars[view.star[inside]])
    near = displaced(same, view, inside)
    lens = through_lens(same, case.instrument.camera, view, inside)
    magnitude = magnitude + lens.fainter
    # A star that its neighbours or the lens move by more than the gate is left out, with the
    # probability of that.
    spread = np.sqrt(np.interp(magnitude, star.magnitude, _variance(star.stated)) + systematic)
    chance = ndtr(gate - np.hypot(*(near + sum(lens.shift.values())).T) / spread)
    kept = chance > LEAST
    inside, magnitude, near = inside[kept], magnitude[kept], near[kept]
    systematic = systematic[kept]
    fixed = [cause for cause in causes(case) if cause.name in OF_STARS]
    mean = np.stack([np.interp(magnitude, star.magnitude, one) for one in star.mean.T], axis=-1)
    displacement = [
        mean,
        near,
        *(
            lens.shift[cause.name][kept]
            if cause.name in lens.shift
            else moved(case, cause, view, inside)
            for cause in fixed
        ),
    ]
    identification = case.tracker.identification
    solver = Solver(
        case.believed_camera.focal_length_px,
        identification.focal_tolerance,
        2 if trial.boxed(case) else identification.min_matches,
        case.tracker.box.stars if trial.boxed(case) else case.tracker.detection.max_spots,
    )
    counted = FieldStars(
        np.searchsorted(view.field[inside], np.arange(len(view.attitude) + 1)),
        view.x[inside],
        view.y[inside],
        magnitude,
        lens.zone[kept],
        chance[kept],
        systematic,
        np.stack(displacement),
    )
    found = propagate(counted, table, solver)
    total = float(found.solved.sum())
    if not total > 0:
        return None
    weight = found.solved / total
    lines = tuple(_lines(case, found, weight, random, fixed))
    sigma = np.sqrt(np.sum([line.spread.sigma**2 for line in lines], axis=0))
    whole = Law(np.sum([line.spread.mean for line in lines], axis=0), sigma, weight)
    whole_line = Line("end to end", None, whole)
    fraction = total / len(weight)
    refused = _refused(star, above, magnitude)
    wrong = np.stack(displacement[2:]).sum(axis=0) if fixed else near
    moved_rms = float(np.sqrt((_apart(wrong, counted.first) ** 2).mean())) if fixed else 0.0
    left_out = (
        *of_the_case(case),
        *of_the_sky(case, found.stars, refused, moved_rms),
        *of_false_spots(case, _false_among(star, above, table)),
    )
    stars = float(weight @ found.stars)
    budget = Budget(lines, whole_line, fraction, stars, left_out, refused)
    return FieldBudget(budget, found, counted)


def _apart(moved: Floats, first: Ints) -> Floats:
    """Displacements (n, 2) less their mean in each field, to which the attitude turns."""
    count = np.diff(first)
    field = np.repeat(np.arange(len(count)), count)
    mean = np.stack([np.bincount(field, axis, len(count)) for axis in moved.T], axis=-1)
    return np.asarray(moved - (mean / np.maximum(count, 1)[:, None])[field])


def _typical(shift: Floats, good: Flags, chance: float) -> Floats:
    """Median error (m,) of stars over that by noise, at least 1; shifts (m, k, 2) in sigmas."""
    noise = Streams(0, 0)("noise of stars near hot pixels").standard_normal(shift.shape)
    square = ((shift + noise) ** 2).sum(axis=-1)
    typical = np.ones(len(shift))
    for m, near in enumerate(good):
        if near.any():
            values = np.append(square[m, near], -2 * np.log1p(-EVEN))
            share = np.repeat(
                [chance / near.sum(), (1 - chance) / len(EVEN)], [near.sum(), len(EVEN)]
            )
            median = np.median(_quantiles(values, share))
            typical[m] = max(1.0, math.sqrt(median / MEDIAN_SQUARE))
    return typical


def _false_among(star: trial.Errors, above: Floats, table: Response) -> float:
    """Number of false spots that are brighter than the faintest star that is likely to count."""
    faintest = star.magnitude[above > 0.5].max(initial=star.magnitude[0])
    return float(table.false[int((faintest - table.start) / table.step)])


def _quantiles(values: Floats, weight: Floats) -> Floats:
    """Values that are as frequent as each other, of values (n,) that are not."""
    order = np.argsort(values)
    middle = np.cumsum(weight[order]) - weight[order] / 2
    return np.interp(EVEN, middle / weight.sum(), values[order])


def _refused(star: trial.Errors, above: Floats, magnitude: Floats) -> float:
    """Fraction of the stars above the threshold (n,) that are taken for hot pixels."""
    above = np.interp(magnitude, star.magnitude, above)
    lost = above * (1 - np.interp(magnitude, star.magnitude, star.kept))
    return float(lost.sum() / max(above.sum(), 1e-9))


def _lines(
    case: Case, found: Attitudes, weight: Floats, random: list[str], fixed: list[Cause]
) -> Iterator[Line[Law]]:
    """A line a cause: those of single stars, those that move all stars, those of the camera."""
    none = np.zeros_like(found.shift[:, 0])
    for k, name in enumerate(random):
        if name == trial.LENS_FIELD:
            continue
        term = trial.Term.NOISE if name in (trial.SHOT, trial.READ) else trial.Term.PIXEL
        mean = found.shift[:, 0] if name == trial.METHOD else none
        yield Line(name, term, Law(mean, np.sqrt(found.variance[:, k]), weight))
    yield Line(NEIGHBOURS, trial.Term.FIELD, Law(found.shift[:, 1], none, weight))
    for k, cause in enumerate(fixed):
        sigma = none
        if cause.name == trial.LENS_FIELD:
            sigma = np.sqrt(found.variance[:, random.index(trial.LENS_FIELD)])
        yield Line(cause.name, cause.term, Law(found.shift[:, k + 2], sigma, weight))
    for cause in causes(case):
        mean_sigma = of_the_camera(case, cause)
        if mean_sigma is not None:
            mean, sigma = (none + one for one in mean_sigma)
            yield Line(cause.name, cause.term, Law(mean, sigma, weight))


def _variance(covariance: Floats) -> Floats:
    """Per axis, of covariances (m, 2, 2)."""
    return np.asarray(np.trace(covariance, axis1=1, axis2=2) / 2)
