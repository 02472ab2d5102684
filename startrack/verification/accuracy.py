"""Budget, outcomes of trials, case -> the statistic that a requirement limits, and its margin."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
import scipy
from scipy import special

from startrack.budget import Budget, ErrorLaw, UnitBudgets, attitudes
from startrack.catalog import FAINTEST_G, LIMITS, Selection, Sky, open_sky
from startrack.core import Camera, Floats, Rows, Stars, arcsec
from startrack.design import AXES, Accuracy, Case, Objective, Requirements
from startrack.detector import electron_rate
from startrack.metrics import Interpretation, Interval, fraction_interval
from startrack.montecarlo import Regions
from startrack.motion import blur
from startrack.observation import detection_plan, psf_of, throughput
from startrack.scene import illuminate

# Regions for requirements on the worst part of the sky. Chosen by hand: with more regions, each is
# smaller, and more trials are needed, because each region needs its own.
REGIONS = Regions(3, 4)


def expected_error(objective: Objective, budget: Budget[ErrorLaw]) -> float:
    """The objective's statistic of the errors that a budget expects (radian).

    By length:  sum_i weight_i P(k / 2, L^2 / (2 square_i)) = fraction,   P the regularised
        incomplete gamma function, k = 2, 1, 3 axes, square_i the mean square per axis in field i
    Per axis:   `ErrorLaw.level`
    A sum:      weighted sum of the rms errors

    Accuracy  model: normal errors in each field; for the length of errors, also equal variances
              about the axes.
    """
    return expected_of(objective, budget.whole.spread)


def expected_of(objective: Objective, law: ErrorLaw) -> float:
    """`expected_error` of the errors of a law."""
    if objective.terms:
        parts = ((weight, expected_of(Objective(axes), law)) for axes, weight in objective.terms)
        return math.fsum(weight * error for weight, error in parts)
    axes = AXES[objective.axes]
    if objective.per_axis_level and objective.fraction:
        return law.level(axes, objective.fraction, Interpretation.MIXED)
    squares = (law.mean**2 + law.sigma**2)[:, axes].mean(axis=1)
    if objective.fraction is None:
        return math.sqrt((len(axes) if objective.radial else 1) * float(law.weight @ squares))
    fraction, half = objective.fraction, len(axes) / 2

    def excess(log_square: float) -> float:
        reached = special.gammainc(half, math.exp(log_square) / (2 * squares))
        return float(law.weight @ reached) - fraction

    lowest, highest = math.log(squares.min()) - 40, math.log(squares.max()) + 10
    return math.exp(scipy.optimize.brentq(excess, lowest, highest) / 2)


def units_expected(objective: Objective, budgets: UnitBudgets) -> Floats:
    """`expected_error` (n,) of each of n units, radian, its bias included."""
    return np.array([expected_of(objective, budgets.whole(k)) for k in range(len(budgets))])


def yield_of(accuracy: Accuracy, errors: Floats, part: float = 1.0) -> Interval:
    """Fraction of the units whose errors (n,) meet a limit, with its interval.

    part  effective number of units over n; 1: each error is known by many trials
    """
    return fraction_interval(part * int((errors <= accuracy.most).sum()), part * len(errors))


def expected_over(objective: Objective, law: ErrorLaw, sky: str) -> float:
    """`expected_of` over the whole sky, or in the worst of its regions.

    law      error by all causes, from `analytic`
    sky      "whole" or "worst"
    Returns  radian; infinite in the worst region if no attitude is expected in it
    """
    if sky == "whole":
        return expected_of(objective, law)
    return max(expected_of(objective, part) if part else math.inf for part in _parts(law))


def _parts(law: ErrorLaw) -> Iterator[ErrorLaw | None]:
    boresight = attitudes(len(law.weight)).inv().apply([0.0, 0.0, 1.0])
    region = REGIONS.of(boresight)
    for number in range(len(REGIONS)):
        inside = (region == number) & (law.weight > 0)
        total = float(law.weight[inside].sum())
        if total > 0:
            yield ErrorLaw(law.mean[inside], law.sigma[inside], law.weight[inside] / total)
        else:
            yield None


def expected_availability(needs: Requirements, budget: Budget[ErrorLaw]) -> float:
    """The fraction of attitudes that are solved and within the limits of a correct attitude.

        sum_i weight_i P(1, A^2 / (2 across_i)) P(1/2, B^2 / (2 about_i)) * solved

    with the limits A and B of `Requirements.limits`, and the mean squares per axis in field i.
    Without limits, an attitude must be within its stated errors.

    Accuracy  model: normal errors in each field, independent across and about the boresight.
    """
    law = budget.whole.spread
    squares = law.mean**2 + law.sigma**2
    within = np.ones((len(squares), 2)) if budget.covered is None else budget.covered.copy()
    for k, (limit, axes) in enumerate(((needs.limits.across, (0, 1)), (needs.limits.about, (2,)))):
        if limit is not None:
            mean = np.maximum(squares[:, list(axes)].mean(axis=1), 1e-30)
            within[:, k] = special.gammainc(len(axes) / 2, limit**2 / (2 * mean))
    solved = budget.availability if budget.solved is None else budget.solved
    return solved * float(law.weight @ within.prod(axis=1))


def measured_over(objective: Objective, outcomes: Rows, boresight: Floats, sky: str) -> float:
    """The statistic of the errors of trials, over the whole sky or in the worst of its regions.

    boresight  (n, 3) unit vectors of the outcomes, ICRS axes
    Returns    radian; NaN where no trial has an attitude
    """
    squares = objective.squares(outcomes)
    if sky == "whole":
        return float(objective.of(squares))
    region = REGIONS.of(boresight)
    errors = [float(objective.of(squares[region == number])) for number in np.unique(region)]
    finite = [error for error in errors if not math.isnan(error)]
    return max(finite, default=math.nan)


def margin(limit: float, value: float) -> float:
    """Margin of an error to its limit, as a fraction of the limit; minus infinity if unknown."""
    return 1 - value / limit if math.isfinite(value) else -math.inf


def expected_margins(needs: Requirements, budget: Budget[ErrorLaw]) -> dict[str, float]:
    """The margins of accuracy and availability by a budget."""
    law = budget.whole.spread
    by_name = {
        accuracy.name: margin(accuracy.most, expected_over(accuracy.objective, law, needs.sky))
        for accuracy in needs.accuracy
    }
    available = expected_availability(needs, budget)
    return by_name | {"availability": available - needs.min_availability}


# Chosen by hand: finer steps need a count of the stars in all fields for each focal length.
FIELDS = 1024  # attitudes at which stars are counted
FOCAL_STEP = 1.05  # ratio of the focal lengths at which they are counted
FIRST_STARS = 4  # bright stars that are counted first, over the mean number that fields need
MAGNITUDES = np.linspace(-2, 12, 57)  # magnitudes for the interpolation of the limit


def margins(requirements: Requirements, case: Case) -> dict[str, float]:
    """Margin to each limit, as a fraction of the limit (stars: magnitude); negative: not met.

    Accuracy and availability, which need trials, are not included.
    """
    stars = min(limiting_magnitude(case), case.believed_catalog.limit_g)
    stars -= needed_magnitude(case, requirements.min_stars, requirements.sky_fraction)
    sky = {"stars in the sky": stars}
    return cost_margins(requirements, case) | sky | requirements.own_margins(case)


def cost_margins(requirements: Requirements, case: Case) -> dict[str, float]:
    """The `margins` of costs and update rate of a design; takes a millisecond."""
    rate = case.instrument.detector.update_rate
    limits = {
        "volume": (requirements.volume, requirements.max_volume),
        "data rate": (requirements.data_rate, requirements.max_data_rate),
        "cost": (requirements.cost, requirements.max_cost),
    }
    least = requirements.min_update_rate
    return {name: 1 - model(case) / limit for name, (model, limit) in limits.items() if limit} | {
        "mass": 1 - requirements.mass(case) / requirements.max_mass,
        "power": 1 - requirements.power(case) / requirements.max_power,
        "update rate": rate / least - 1 if least else 1.0,
    }


def limiting_magnitude(case: Case) -> float:
    """The faintest G of a sunlike star that the matched filter detects at the threshold.

        signal / noise = N sqrt(sum p^2) / sqrt(sky + dark + read noise^2 + gain^2 / 12)
                       = threshold,   p the fractions of the smeared star's light in its pixels

    Accuracy  model: background-limited, which holds at the threshold; the pixel phase is averaged;
              the tests that reject hot pixels cost up to half a magnitude more.
    """
    detector = case.instrument.detector
    pixel = case.instrument.camera.focal_length_px**-2
    many = len(MAGNITUDES)
    unknown = np.full(many, np.nan)
    stars = Stars(np.zeros(many, np.int64), np.zeros((many, 3)), MAGNITUDES, unknown)
    light = illuminate(case.scene, stars)
    star, sky = electron_rate(light, detector, throughput(case.instrument))
    noise = (sky * pixel + detector.dark_rate) * detector.integration * detector.excess_noise
    noise += detector.noise**2 + detector.electrons_per_dn**2 / 12
    # Sum of the squared fractions of the light in the pixels, averaged over the smear.
    psf = psf_of(case.instrument)
    sharpness = float((psf.table**2).sum()) / psf.oversampling**2
    smear = blur(case.instrument.motion, detector.exposure)
    # A straight streak of this length has the same blur.
    length = np.sqrt(12) * float(np.hypot(smear[0], smear[1])) / np.sqrt(pixel)
    sharpness /= np.sqrt(1 + length**2 * sharpness)
    signal = star * detector.integration * np.sqrt(sharpness)
    ratio = signal / np.sqrt(noise)
    threshold = detection_plan(case).threshold(detector.columns * detector.rows)
    return float(np.interp(-np.log(threshold), -np.log(ratio), MAGNITUDES))


def needed_magnitude(case: Case, stars: int, fraction: float) -> float:
    """The limiting G at which `fraction` of the attitudes have `stars` stars in the field.

    All stars of the source of the tracker's catalogue count, also beyond its magnitude limit.

    Accuracy  numerical: 0.02 mag by interpolation between focal lengths.
    """
    camera, source = case.instrument.camera, case.believed_catalog
    every = replace(source, limit_g=LIMITS.get(source.source, FAINTEST_G))
    at, below = math.modf(math.log(camera.focal_length_px) / math.log(FOCAL_STEP))
    nearer, farther = (
        _needed(every, camera.columns, camera.rows, step, stars, fraction)
        for step in (int(below), int(below) + 1)
    )
    return nearer + at * (farther - nearer)


@lru_cache(maxsize=1024)
def _needed(
    catalog: Selection, columns: int, rows: int, step: int, stars: int, fraction: float
) -> float:
    """Required limiting magnitude at a focal length of FOCAL_STEP**step pixels."""
    camera = Camera(columns, rows, FOCAL_STEP**step)
    sky, axes = open_sky(catalog), attitudes(FIELDS).as_matrix()
    # If the whole source has too few stars, the result is a magnitude beyond its limit.
    faintest, left = np.full(FIELDS, catalog.limit_g + 1), np.arange(FIELDS)
    # The stars are in order of brightness. These contain several times the stars that a field
    # needs.
    sphere = 4 * math.pi * camera.focal_length_px**2
    count = math.ceil(FIRST_STARS * stars * sphere / columns / rows)
    while True:
        bright = Sky(sky.stars[:count])
        near = bright.cones(axes[left, 2], camera.half_diagonal)
        star, field = np.concatenate(near), np.repeat(np.arange(len(left)), [*map(len, near)])
        seen = np.einsum("nij,nj->ni", axes[left[field]], bright.stars.direction[star])
        inside = camera.holds(camera.project(seen))
        star, stars_in = star[inside], np.bincount(field[inside], minlength=len(left))
        last = (np.cumsum(stars_in) - stars_in + stars - 1)[stars_in >= stars]
        faintest[left[stars_in >= stars]] = bright.stars.magnitude_g[star[last]]
        left = left[stars_in < stars]
        if count >= len(sky) or not len(left):
            return float(np.quantile(faintest, fraction))
        count *= 4


def limited(
    needs: Requirements, name: str, margin: float, needed: float = math.nan
) -> tuple[str, str]:
    """Value and limit of a margin, with their unit; empty if the margin has no limit.

    needed  G, of `needed_magnitude`
    """
    most = {
        "mass": (needs.max_mass, "kg"),
        "power": (needs.max_power, "W"),
        "volume": (needs.max_volume and needs.max_volume * 1e6, "cm3"),
        "data rate": (needs.max_data_rate and needs.max_data_rate / 1e6, "Mbit/s"),
        "cost": (needs.max_cost, ""),
        **{accuracy.name: (accuracy.most / arcsec, "arcsec") for accuracy in needs.accuracy},
    }
    least = {
        "update rate": (needs.min_update_rate, "Hz", needs.min_update_rate),
        "availability": (needs.min_availability, "", 1.0),
    }
    asked = name.partition(" (")[0]
    if asked == "stars in the sky":
        return f"G {needed + margin:.2f}", f"G {needed:.2f}"
    if asked in least:
        limit, unit, scale = least[asked]
        value = limit + margin * scale
    else:
        bound, unit = most.get(asked, (None, ""))
        limit = bound or 0.0
        value = limit * (1 - margin)
    return (f"{value:.4g} {unit}".strip(), f"{limit:.4g} {unit}".strip()) if limit else ("", "")
