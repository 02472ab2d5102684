"""Case -> its Budget in milliseconds, without a trial."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

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
from startrack.budget.left_out import of_the_case, of_the_sky
from startrack.core import Floats, Refused
from startrack.design import Case
from startrack.trial import (
    LENS_FIELD,
    METHOD,
    READ,
    SHOT,
    Errors,
    Term,
    detection_probability,
    errors,
    systematic_variance_of,
    zone_detection,
    zone_errors,
)

FINE = 0.05  # magnitude between two entries


@lru_cache(maxsize=2)
def response(case: Case) -> tuple[Response, list[str]]:
    """Detection and errors of single stars, as a table of small steps of magnitude.

    Returns  it, and the names of its random causes; kept for the 2 last cases, as units share one
    """
    star = errors(case)
    grid = np.arange(star.magnitude[0], star.magnitude[-1] + FINE / 2, FINE)
    if case.instrument.optics.tabulated:
        zone = zone_errors(case)
        kept, stated, random = zone.kept, zone.stated, zone.random
        fraction = zone_detection(case, grid)
    else:
        kept, stated = star.kept[None], star.stated[None]
        random = {name: one[None] for name, one in star.random.items()}
        fraction = detection_probability(case, grid)[None]
    found = Response(
        float(grid[0]),
        FINE,
        fraction * _between(star.magnitude, kept, grid),
        _fine(star.magnitude, stated, grid),
        np.stack([_fine(star.magnitude, one, grid) for one in random.values()], axis=1),
    )
    return found, list(random)


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
    Accuracy  model: to first order; cosmic rays, the smear of a roll, lag and
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
    star, gate = errors(same), case.tracker.attitude.gate
    table, random = response(same)
    if not table.fraction.any():
        return None
    inside, magnitude = visible(case, view, float(star.magnitude[-1]), same)
    systematic = systematic_variance_of(same, view.sky.stars[view.star[inside]])
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
        identification.min_matches,
        case.tracker.detection.max_spots,
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
    refused = _refused(same, star, magnitude)
    wrong = np.stack(displacement[2:]).sum(axis=0) if fixed else near
    moved_rms = float(np.sqrt((wrong**2).mean())) if fixed else 0.0
    left_out = (*of_the_case(case), *of_the_sky(case, found.stars, refused, moved_rms))
    stars = float(weight @ found.stars)
    budget = Budget(lines, whole_line, fraction, stars, left_out, refused)
    return FieldBudget(budget, found, counted)


def _refused(case: Case, star: Errors, magnitude: Floats) -> float:
    """Fraction of the stars above the threshold (n,) that are taken for hot pixels."""
    grid = star.magnitude
    above = np.interp(magnitude, grid, detection_probability(case, grid))
    lost = above * (1 - np.interp(magnitude, grid, star.kept))
    return float(lost.sum() / max(above.sum(), 1e-9))


def _lines(
    case: Case, found: Attitudes, weight: Floats, random: list[str], fixed: list[Cause]
) -> Iterator[Line[Law]]:
    """A line a cause: those of single stars, those that move all stars, those of the camera."""
    none = np.zeros_like(found.shift[:, 0])
    for k, name in enumerate(random):
        if name == LENS_FIELD:
            continue
        term = Term.NOISE if name in (SHOT, READ) else Term.PIXEL
        mean = found.shift[:, 0] if name == METHOD else none
        yield Line(name, term, Law(mean, np.sqrt(found.variance[:, k]), weight))
    yield Line(NEIGHBOURS, Term.FIELD, Law(found.shift[:, 1], none, weight))
    for k, cause in enumerate(fixed):
        sigma = none
        if cause.name == LENS_FIELD:
            sigma = np.sqrt(found.variance[:, random.index(LENS_FIELD)])
        yield Line(cause.name, cause.term, Law(found.shift[:, k + 2], sigma, weight))
    for cause in causes(case):
        mean_sigma = of_the_camera(case, cause)
        if mean_sigma is not None:
            mean, sigma = (none + one for one in mean_sigma)
            yield Line(cause.name, cause.term, Law(mean, sigma, weight))


def _variance(covariance: Floats) -> Floats:
    """Per axis, of covariances (m, 2, 2)."""
    return np.asarray(np.trace(covariance, axis1=1, axis2=2) / 2)
