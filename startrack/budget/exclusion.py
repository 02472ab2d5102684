"""Case with a baffle -> error over the angle to Sun, Moon and Earth; exclusion angles."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import numpy as np

from startrack.budget.analytic import budget_if_solved
from startrack.core import Floats, Refused, Unit, arcsec, printed
from startrack.design import Case
from startrack.scene import DARK, EARTH_ALBEDO, SUN_G, SUN_G_MINUS_V, Disc, Earth, sunlight
from startrack.space import AU, EARTH_RADIUS

FULL_MOON_G = -12.73 + SUN_G_MINUS_V  # Krisciunas and Schaefer (1991), as `moon_of`
STEP = 1.0  # magnitude between computed backgrounds; interpolation between them is within 1 %
BRIGHTEST = 4.0  # magnitude per square arcsecond of the brightest background; chosen by hand


@printed
@dataclass(frozen=True, eq=False)
class Exclusion:
    """Effect of a bright body on a tracker, over the angle from the boresight to the body.

    angle          (n,) radian, rising, to the centre or limb of the body
    stray_light_g  (n,) magnitude per square arcsecond of the light that passes the baffle
    across         (n,) radian, error across the boresight; NaN where no star is detected or stray
                   light saturates the pixels
    availability   (n,) 1
    """

    angle: Annotated[Floats, Unit("rad", "deg")]
    stray_light_g: Annotated[Floats, Unit("mag / arcsec2")]
    across: Annotated[Floats, Unit("rad", "arcsec")]
    availability: Floats

    def least(self, rise: float = 0.1, availability: float = 0.99) -> float:
        """The exclusion angle, radian.

        rise     fraction by which the error may exceed the error at the largest angle
        Returns  the least angle above which both limits hold; infinity if they never hold
        """
        allowed = (1 + rise) * self.across[-1]
        bad = ~((self.across <= allowed) & (self.availability >= availability))
        if bad[-1]:
            return math.inf
        last = np.flatnonzero(bad)
        return float(self.angle[last[-1] + 1]) if len(last) else float(self.angle[0])


def exclusions(case: Case, angle: Floats, altitude: float = 600e3) -> dict[str, Exclusion]:
    """Exclusion by the Sun, the full Moon and the noon Earth, by the analytic budget.

        stray light = irradiance PST(angle) f^2 / A,  as a uniform background

    angle     (n,) radian, rising, to the Earth's limb and to the centres of Sun and Moon
    altitude  metre, of the tracker above the Earth
    Returns   an Exclusion for each of "sun", "moon" and "earth"
    Raises    ValueError if the case has no baffle, or if `analytic` refuses it.
    Accuracy  model: as `Baffle` and the budget; the stray light is uniform over the field, and the
              body is outside the field. numerical: 1 %, by interpolation between backgrounds of
              whole magnitudes.
    """
    levels = stray_light_levels(case, angle, altitude)
    faintest = max(float(level.max()) for level in levels.values())
    skies = np.arange(BRIGHTEST, min(faintest, case.scene.sky_g) + 2 * STEP, STEP)
    bare = replace(case, instrument=replace(case.instrument, baffle=None, tube=None))
    across, availability = _budgets(bare, (*skies.tolist(), DARK))
    of_body = {}
    for name, level in levels.items():
        at = np.interp(level, np.append(skies, DARK), np.arange(len(skies) + 1))
        of_body[name] = Exclusion(angle, level, _at_index(across, at), _at_index(availability, at))
    return of_body


def stray_light_levels(case: Case, angle: Floats, altitude: float = 600e3) -> dict[str, Floats]:
    """Magnitude per square arcsecond (n,) of the stray light of "sun", "moon" and "earth".

    Arguments, exceptions and accuracy as for `exclusions`.
    """
    if case.instrument.stray is None:
        raise Refused(
            "instrument.baffle or instrument.tube must be given for exclusion angles, got none"
        )
    return {
        "sun": _stray_light(case, SUN_G, angle),
        "moon": _stray_light(case, FULL_MOON_G, angle),
        "earth": _of_the_earth(case, angle, altitude),
    }


def _stray_light(case: Case, magnitude_g: float, angle: Floats) -> Floats:
    assert case.instrument.stray
    optics = case.instrument.optics
    spread = case.instrument.stray(angle) * optics.focal_length**2 / optics.area
    return magnitude_g - 2.5 * np.log10(spread * arcsec**2)


def _of_the_earth(case: Case, angle: Floats, altitude: float) -> Floats:
    """Stray light of a fully sunlit Earth, summed over its parts at their angles."""
    assert case.instrument.stray
    distance = EARTH_RADIUS + altitude
    horizon = math.asin(EARTH_RADIUS / distance)
    down, sun = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
    light = EARTH_ALBEDO / math.pi * sunlight(AU)
    source = Earth(Disc(down, horizon, light), light, distance * down, sun).stray_source
    lit = np.empty(len(angle))
    for i, tilt in enumerate(horizon + angle):
        boresight = np.array([math.sin(tilt), 0.0, -math.cos(tilt)])
        off_axis = np.arccos(np.clip(source.direction @ boresight, -1, 1))
        lit[i] = case.instrument.stray(off_axis) @ source.fraction * EARTH_ALBEDO / math.pi
    optics = case.instrument.optics
    return SUN_G - 2.5 * np.log10(lit * optics.focal_length**2 / optics.area * arcsec**2)


@lru_cache(maxsize=4)  # entries: the baffles of one design
def _budgets(case: Case, skies: tuple[float, ...]) -> tuple[Floats, Floats]:
    """(n,) errors across and (n,) availabilities at n brightnesses of the stray light."""
    across, availability = np.full(len(skies), math.nan), np.zeros(len(skies))
    for i, sky in enumerate(skies):
        lit = replace(case, scene=case.scene.with_stray_light(sky))
        budget = budget_if_solved(lit)
        if budget is not None:
            across[i], availability[i] = budget.across, budget.availability
    return across, availability


def _at_index(values: Floats, at: Floats) -> Floats:
    """Values at fractional indices, by linear interpolation; NaN if a neighbour is NaN."""
    low = np.minimum(at.astype(np.int64), len(values) - 2)
    part = at - low
    return np.where(part > 0, (1 - part) * values[low] + part * values[low + 1], values[low])
