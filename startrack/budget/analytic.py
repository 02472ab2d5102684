"""Case -> its error budget by formulas, in milliseconds and without a trial."""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special
from scipy.special import ndtr

from startrack import response, trial
from startrack.budget.blind import blind
from startrack.budget.budget import (
    NEIGHBOURS,
    Budget,
    BudgetLine,
    Cause,
    ErrorLaw,
    causes,
    refuse_scans,
)
from startrack.budget.fields import (
    FIELDS,
    Attitudes,
    FieldResponse,
    Fields,
    FieldStars,
    Solver,
    attitudes,
    listed_fields,
    propagate,
)
from startrack.budget.fixed import OF_STARS, displaced, moved, of_the_camera, through_lens, visible
from startrack.budget.hot_pixels import hot_stars
from startrack.budget.left_out import of_false_spots, of_the_case, of_the_catalog, of_the_sky
from startrack.budget.tracked import tracked, within_stated
from startrack.core import Floats, Ints, Refused
from startrack.design import Case

FINE = 0.05  # magnitude between two entries of `Measured.table`
HOT = "hot pixels"


class Measured(NamedTuple):
    """Detection and errors of single stars.

    star     errors by cause; if there are hot pixels, of the case `with_uniform_dark`
    above    (m,) 1, probability that a star passes the threshold
    table    errors and detection in small steps of magnitude, with the effect of hot pixels
    random   names of the random causes in `table`
    lost     of `Solver`
    """

    star: response.Errors
    above: Floats
    table: FieldResponse
    random: list[str]
    lost: Floats


@lru_cache(maxsize=2)
def measured_response(case: Case) -> Measured:
    """Detection and errors of single stars. Cached for the last 2 cases: units share a case."""
    if trial.boxed(case):
        return in_boxes(case)
    pattern = response.dark_pattern(case) if has_hot_pixels(case) else None
    even = response.with_uniform_dark(case) if pattern else case
    star = response.errors(even)
    # If dark signal saturates the converter, no star is measured, so hot pixels shift none.
    hot = hot_stars(case, even, star) if pattern and _variance(star.stated).all() else None
    search = hot and hot.search
    grid = np.arange(star.magnitude[0], star.magnitude[-1] + FINE / 2, FINE)
    if case.instrument.optics.tabulated:
        zone = response.zone_errors(even)
        kept, stated, random = zone.kept, zone.stated, zone.random
        fraction = response.zone_detection(even, grid, search)
    else:
        kept, stated = star.kept[None], star.stated[None]
        random = {name: covariance[None] for name, covariance in star.random.items()}
        fraction = response.detection_probability(even, grid, search=search)[None]
    false, lost = np.zeros(len(grid)), np.ones(case.tracker.identification.min_matches)
    if pattern and hot:
        lost = hot.lost
        size = response.scale(even)
        # The noise of a pixel contains the spread of the dark signal, which is constant in time.
        constant = (pattern.spread / size.noise) ** 2
        read = random[response.READ]
        random = random | {response.READ: (1 - constant) * read, "DSNU": constant * read}
        random |= {HOT: np.broadcast_to(hot.moment, stated.shape)}
        kept = kept * hot.kept
        light = size.star * 10 ** (-0.4 * grid)
        false = (hot.false > light[:, None]).sum(axis=1).astype(float)
    above = response.detection_probability(even, star.magnitude, search=search)
    fraction = fraction * _between(star.magnitude, kept, grid)
    return _measured(star, above, grid, fraction, stated, random, false=false, lost=lost)


def _measured(
    star: response.Errors,
    above: Floats,
    grid: Floats,
    fraction: Floats,
    stated: Floats,
    random: dict[str, Floats],
    false: Floats,
    lost: Floats,
) -> Measured:
    """`Measured`, with covariances interpolated between magnitudes.

    grid            (k,) magnitudes of the table
    fraction        (z, k) 1, fraction of the stars that is detected
    stated, random  (z, m, 2, 2) pixel^2, at the magnitudes of `star`
    false           (k,) number of false spots that are brighter than a star of this magnitude
    """
    causes = [_fine(star.magnitude, covariance, grid) for covariance in random.values()]
    fine = _fine(star.magnitude, stated, grid)
    table = FieldResponse(float(grid[0]), FINE, fraction, fine, np.stack(causes, axis=1), false)
    return Measured(star, above, table, list(random), lost)


def in_boxes(case: Case) -> Measured:
    """Responses measured with stars that are drawn in the tracker's boxes, equal on both axes.

    Noise is split into shot noise of the star and other noise by the star's fraction of the
    electrons in its box. Errors caused by differences between pixels count as hot pixels.
    """
    stars, size, box = trial.boxed_stars(case), response.scale(case), case.tracker.box
    finite = np.isfinite(stars.total)
    magnitude, measured = stars.magnitude[finite], stars.measured[finite]
    if len(magnitude) < 2:
        raise blind(case)
    stated, temporal, method, total = (
        part[finite] ** 2 for part in (stars.stated, stars.temporal, stars.method, stars.total)
    )
    electrons = size.excess * size.star * 10 ** (-0.4 * magnitude)
    light = electrons / (electrons + size.pixel**2 * box.size**2)
    variance = {
        response.SHOT: light * temporal,
        response.READ: (1 - light) * temporal,
        response.METHOD: method,
        HOT: np.maximum(total - temporal - method, 0.0),
    }
    random = {name: square[:, None, None] * np.eye(2) for name, square in variance.items()}
    no_mean = np.zeros((len(magnitude), 2))
    kept, covariance = np.ones(len(measured)), stated[:, None, None] * np.eye(2)
    star = response.Errors(magnitude, kept, covariance, random, no_mean)
    grid = np.arange(magnitude[0], magnitude[-1] + FINE / 2, FINE)
    zones = len(response.zone_errors(case).kept) if case.instrument.optics.tabulated else 1
    fraction, stated = (
        np.repeat(part, zones, axis=0)  # all zones are equal
        for part in (_between(magnitude, measured[None], grid), star.stated[None])
    )
    by_zone = {name: np.repeat(table[None], zones, axis=0) for name, table in random.items()}
    no_spots = np.zeros(len(grid))
    return _measured(
        star, measured, grid, fraction, stated, by_zone, false=no_spots, lost=np.ones(2)
    )


def has_hot_pixels(case: Case) -> bool:
    """Whether some pixels have an outlying dark current."""
    detector = case.instrument.detector
    return bool(detector.age or (detector.defects and detector.defects.hot))


def _between(magnitude: Floats, table: Floats, grid: Floats) -> Floats:
    """Tables (z, m) over magnitudes (m,), interpolated linearly at a grid (k,): (z, k)."""
    before = np.clip(np.searchsorted(magnitude, grid, side="right") - 1, 0, len(magnitude) - 2)
    t = np.clip((grid - magnitude[before]) / np.diff(magnitude)[before], 0.0, 1.0)
    return np.asarray(table[:, before] + t * (table[:, before + 1] - table[:, before]))


def _fine(magnitude: Floats, table: Floats, grid: Floats) -> Floats:
    """Covariances (z, m, 2, 2) pixel^2 over magnitudes, interpolated at a grid: (z, k, 2, 2).

    The logarithms of standard deviations, and the correlation, are interpolated linearly.
    """
    xx, yy = (np.maximum(table[..., a, a], 1e-16) for a in (0, 1))
    ratio = np.clip(table[..., 0, 1] / np.sqrt(xx * yy), -1, 1)
    correlation = _between(magnitude, ratio, grid)
    x, y = (np.exp(_between(magnitude, np.log(values) / 2, grid)) for values in (xx, yy))
    cross = correlation * x * y
    covariance = np.stack([x * x, cross, cross, y * y], axis=-1).reshape(*x.shape, 2, 2)
    return np.ascontiguousarray(covariance)  # kernels are compiled again for another layout


# Above these limits, drawn spots decide which stars are matched. Chosen by hand, below 1 % of the
# availability.
BEYOND = 0.01  # fraction of the stars beyond the match radius
UNCOVERED = 0.01  # fraction of the attitudes whose errors exceed the stated ones
SIFTED = 4  # stars: least number from which the solver can leave out a wrong one
DISPLACED = 0.1  # mean square displacement over noise variance, below which noise hides it
LEAST_CHANCE = 1e-3  # probability that the gate keeps a star, below which the star is left out


def analytic(case: Case, count: int = FIELDS) -> Budget[ErrorLaw]:
    """Error budget from design parameters, the real sky, and the tracker's response to single
    stars.

        error of a field = sum of gains * errors of its stars (`propagate`), rms over fields

    The errors of a star follow from its noise-free images at several places within a pixel. The
    error of the centroid method is the offset of the centroid in these images. The noise error is
    the one that the tracker states. PRNU and DSNU are fixed patterns that shift the centroid. Fixed
    errors (camera, catalogue) shift each star of each field.

    Behind a lens table, noise and detection depend on the zone of the frame and on the star's
    colour (`zone_errors`). The star is displaced by the difference between its image and the image
    that the tracker assumes. This gives two causes: PSF over the field, for sunlike stars, and
    lateral colour, for the difference of other stars from them.

    Pixels with outlying dark current shift, hide and imitate stars (`hot_stars`). They also raise
    the detection threshold. All other pixels are assumed to be equal, and the spread of their dark
    current counts as noise.

    count   fields over the sky, a power of two
    Raises    ValueError if the case contradicts itself, or if no field can be solved.
    Accuracy  model: to first order. It leaves out cosmic rays, dead pixels, the smear of a roll,
              lag, aberrations that grow over the field without a lens table, and light that varies
              over the sky (`scene.lights`). A star counts by its probability if it is near the
              threshold, or so sharp that the tracker may reject it as a hot pixel. numerical: 1 %
              across and 3 % about for 512 fields.
    """
    budget = budget_if_solved(case, count)
    if budget is None:
        raise blind(case)
    return budget


def budget_if_solved(case: Case, count: int = FIELDS) -> Budget[ErrorLaw] | None:
    """`analytic`, but None if no field can be solved."""
    solved = of_fields(case, listed_fields(case, attitudes, count))
    return solved and solved.budget


class FieldBudget(NamedTuple):
    """A budget over some fields, with the errors and the stars of each field."""

    budget: Budget[ErrorLaw]
    attitudes: Attitudes
    stars: FieldStars


def of_fields(case: Case, view: Fields, like: Case | None = None) -> FieldBudget | None:
    """The budget over some fields, and the errors in each of them; None if no field is solved.

    In two cases drawn spots decide which stars of a field are matched (`tracked`): if stars lie so
    far from their predicted places that the tracker may not match them, and if the errors may
    exceed the ones that the tracker states.

    like  a case that differs only in the places of its stars, whose response to single stars is
          used; None: the response of this case is measured
    """
    refuse_scans(case)
    _refuse_few_boxes(case)
    same = like or case
    measured = measured_response(same)
    if not measured.table.fraction.any():
        return None
    counting = _counting_stars(case, view, same, measured)
    stars, solver = counting.stars, _solver(case, measured.lost)
    errors = propagate(stars, measured.table, solver)
    if not errors.solved.sum() > 0:
        return None
    lines = tuple(_lines(case, errors, measured.random, counting.fixed))
    law, covered = _sum_of(lines), None
    if HOT not in measured.random:  # it states hot pixels, too
        covered = _covered(case, law, errors, stars)
    unsure = covered is not None and law.weight @ covered.prod(axis=1) < 1 - UNCOVERED
    if not trial.boxed(case) and _needs_drawn_spots(case, counting, bool(unsure)):
        decided = tracked(case, view, counting.inside)
        stars = stars._replace(kept=np.where(decided.dropped, 0.0, stars.kept))
        errors = propagate(stars, measured.table, solver)
        errors = errors._replace(solved=errors.solved * decided.solved)
        if not errors.solved.sum() > 0:
            return None
        lines = tuple(_lines(case, errors, measured.random, counting.fixed))
        law, covered = _sum_of(lines), decided.covered.astype(float)
    solved = float(errors.solved.sum()) / len(law.weight)
    available = solved
    if covered is not None:
        available *= float(law.weight @ covered.prod(axis=1))
    budget = Budget(
        lines=lines,
        whole=BudgetLine("end to end", None, law),
        availability=available,
        stars=float(law.weight @ errors.stars),
        left_out=_left_out(case, measured, counting, errors.stars, solved),
        refused=_refused(measured, stars.magnitude),
        covered=covered,
        solved=solved,
    )
    return FieldBudget(budget, errors, stars)


def _refuse_few_boxes(case: Case) -> None:
    if trial.boxed(case) and case.tracker.box.stars < SIFTED:
        raise Refused(
            f"tracker.box.stars must be at least {SIFTED} for a budget by formula, got "
            f"{case.tracker.box.stars}: with fewer, the tracker cannot detect a wrong star, or one "
            "shifted by a hot pixel, so that errors are not normal; trials show them (montecarlo)"
        )


class _CountingStars(NamedTuple):
    """The n stars of the fields that may count, and their displacements.

    stars   of `propagate`
    inside  (n,) indices into the stars of the fields
    sigma   (n,) pixel per axis, of noise and of the other errors that the tracker assumes
    fixed   causes that displace single stars
    apart   (n, 2) pixel, displacements by these causes minus their mean in each field
    """

    stars: FieldStars
    inside: Ints
    sigma: Floats
    fixed: list[Cause]
    apart: Floats


def _counting_stars(case: Case, view: Fields, same: Case, measured: Measured) -> _CountingStars:
    """The stars that the gate may keep: stars with larger displacements are left out.

    same  a case that differs only in the places of its stars, with the response `measured`
    """
    star = measured.star
    inside, magnitude = visible(case, view, float(star.magnitude[-1]), same)
    knowledge = response.knowledge_of(same)
    systematic = knowledge.systematic[knowledge.places(view.sky.stars[view.star[inside]])]
    near = displaced(same, view, inside)
    lens = through_lens(same, case.instrument.camera, view, inside)
    magnitude = magnitude + lens.fainter
    sigma = np.sqrt(np.interp(magnitude, star.magnitude, _variance(star.stated)) + systematic)
    offset = np.hypot(*(near + sum(lens.shift.values())).T)
    chance = ndtr(case.tracker.attitude.gate - offset / sigma)
    kept = chance > LEAST_CHANCE
    inside, magnitude, near = inside[kept], magnitude[kept], near[kept]
    fixed = [cause for cause in causes(case) if cause.name in OF_STARS]
    mean = np.stack([np.interp(magnitude, star.magnitude, axis) for axis in star.mean.T], axis=-1)
    displacement = [mean, near]
    for cause in fixed:
        of_lens = lens.shift.get(cause.name)
        displacement.append(moved(case, cause, view, inside) if of_lens is None else of_lens[kept])
    first = np.searchsorted(view.field[inside], np.arange(len(view.attitude) + 1))
    apart = np.zeros_like(near)
    if fixed:
        apart = _apart(np.stack(displacement[2:]).sum(axis=0), first)
    stars = FieldStars(
        first=first,
        x=view.x[inside],
        y=view.y[inside],
        magnitude=magnitude,
        zone=lens.zone[kept],
        kept=chance[kept],
        systematic=systematic[kept],
        displacement=np.stack(displacement),
    )
    return _CountingStars(stars, inside, sigma[kept], fixed, apart)


def _solver(case: Case, lost: Floats) -> Solver:
    """Settings of the solver of a case; `lost` as in `Measured`."""
    most = case.tracker.box.stars if trial.boxed(case) else case.tracker.detection.max_spots
    tolerance = case.tracker.identification.focal_tolerance
    return Solver(case.believed_camera.focal_length_px, tolerance, lost, most)


def _sum_of(lines: tuple[BudgetLine[ErrorLaw], ...]) -> ErrorLaw:
    """The error by all causes together; the causes are independent."""
    mean = np.sum([line.spread.mean for line in lines], axis=0)
    sigma = np.sqrt(np.sum([line.spread.sigma**2 for line in lines], axis=0))
    return ErrorLaw(mean, sigma, lines[0].spread.weight)


def _left_out(
    case: Case, measured: Measured, counting: _CountingStars, stars: Floats, solved: float
) -> tuple[str, ...]:
    """Phrases for the effects that the budget leaves out.

    stars   (m,) expected number in each field
    solved  1, fraction of the fields with an attitude
    """
    moved_rms = float(np.sqrt((counting.apart**2).mean())) if counting.fixed else 0.0
    return (
        *of_the_case(case),
        *of_the_sky(case, stars, _refused(measured, counting.stars.magnitude), moved_rms),
        *of_the_catalog(case, _likely_at_the_limit(case, measured), solved),
        *of_false_spots(case, _false_among(measured)),
    )


def _needs_drawn_spots(case: Case, counting: _CountingStars, unsure: bool) -> bool:
    """Whether displaced stars are lost, or cause errors larger than the stated ones.

    unsure  whether errors may exceed the stated ones
    """
    counts, variance = counting.stars.kept, np.maximum(counting.sigma, 1e-9) ** 2
    square, total = (counting.apart**2).sum(axis=1), max(float(counts.sum()), 1e-9)
    # Probabilities that a star with noise lies within a circle, with and without displacement.
    radius = case.tracker.identification.match_radius**2 / variance
    displaced_within = special.chndtr(radius, 2.0, np.minimum(square / variance, 1e5))
    lost = -np.expm1(-radius / 2) - displaced_within
    if counts @ lost > BEYOND * total:
        return True
    return unsure and float(counts @ (square / variance)) > 2 * DISPLACED * total


def _covered(case: Case, law: ErrorLaw, errors: Attitudes, stars: FieldStars) -> Floats | None:
    """`Budget.covered`, with the covariance from the stars plus the terms that the tracker adds."""
    solved = errors.solved > 0
    stated = np.zeros((len(solved), 3, 3))
    stated[solved] = np.linalg.inv(errors.stated[solved])
    answer = _within(law, stated)
    if law.weight @ answer.prod(axis=1) >= 1 - UNCOVERED:
        return None
    shared = response.knowledge_of(case).shared
    if shared is None:
        return answer
    camera = case.instrument.camera
    pixel = camera.project(np.column_stack([stars.x, stars.y, np.ones(len(stars.x))]))
    gain = errors.gain[:, :3] * errors.gain[:, 3:, :1]
    for f in np.flatnonzero(solved):
        part = slice(stars.first[f], stars.first[f + 1])
        stated[f] += shared.added(gain[part].swapaxes(0, 1), pixel[part])
    return _within(law, stated)


def _within(law: ErrorLaw, stated: Floats) -> Floats:
    sigma = np.sqrt(np.maximum(np.diagonal(stated, axis1=1, axis2=2), 0.0))
    return within_stated(law.mean, law.sigma, sigma)


def _apart(moved: Floats, first: Ints) -> Floats:
    """Displacements (n, 2) minus their mean in each field, which the attitude absorbs."""
    count = np.diff(first)
    field = np.repeat(np.arange(len(count)), count)
    mean = np.stack([np.bincount(field, axis, len(count)) for axis in moved.T], axis=-1)
    return np.asarray(moved - (mean / np.maximum(count, 1)[:, None])[field])


def _false_among(measured: Measured) -> float:
    """Number of false spots that are brighter than the faintest star that is likely to count."""
    star, table = measured.star, measured.table
    faintest = star.magnitude[measured.above > 0.5].max(initial=star.magnitude[0])
    return float(table.false[int((faintest - table.start) / table.step)])


def _likely_at_the_limit(case: Case, measured: Measured) -> float:
    """Probability that the tracker detects a star at the limit of its catalogue."""
    limit = case.believed_catalog.limit_g
    return float(np.interp(limit, measured.star.magnitude, measured.above))


def _refused(measured: Measured, magnitude: Floats) -> float:
    """Fraction of the stars (n,) above the threshold that the tracker rejects as hot pixels."""
    star = measured.star
    above = np.interp(magnitude, star.magnitude, measured.above)
    lost = above * (1 - np.interp(magnitude, star.magnitude, star.kept))
    return float(lost.sum() / max(above.sum(), 1e-9))


def _lines(
    case: Case, errors: Attitudes, random: list[str], fixed: list[Cause]
) -> Iterator[BudgetLine[ErrorLaw]]:
    """A line for each cause: random errors and fixed shifts of stars, errors of the camera."""
    weight = errors.solved / errors.solved.sum()
    none = np.zeros_like(errors.shift[:, 0])
    for k, name in enumerate(random):
        if name == response.LENS_FIELD:
            continue
        term = trial.Term.NOISE if name in (response.SHOT, response.READ) else trial.Term.PIXEL
        mean = errors.shift[:, 0] if name == response.METHOD else none
        yield BudgetLine(name, term, ErrorLaw(mean, np.sqrt(errors.variance[:, k]), weight))
    yield BudgetLine(NEIGHBOURS, trial.Term.FIELD, ErrorLaw(errors.shift[:, 1], none, weight))
    for k, cause in enumerate(fixed):
        sigma = none
        if cause.name == response.LENS_FIELD and response.LENS_FIELD in random:
            sigma = np.sqrt(errors.variance[:, random.index(response.LENS_FIELD)])
        yield BudgetLine(cause.name, cause.term, ErrorLaw(errors.shift[:, k + 2], sigma, weight))
    for cause in causes(case):
        mean_sigma = of_the_camera(case, cause)
        if mean_sigma is not None:
            mean, sigma = (none + value for value in mean_sigma)
            yield BudgetLine(cause.name, cause.term, ErrorLaw(mean, sigma, weight))


def _variance(covariance: Floats) -> Floats:
    """Variance per axis of covariances (m, 2, 2)."""
    return np.asarray(np.trace(covariance, axis1=1, axis2=2) / 2)
