"""Case with a baffle -> what Sun, Moon and Earth cost over their angle; exclusion angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from startrack.budget.analytic import analytic
from startrack.core import Floats, arcsec
from startrack.design import Case
from startrack.scene import (
    AU,
    EARTH_ALBEDO,
    EARTH_RADIUS,
    SUN_G,
    SUN_G_MINUS_V,
    Disc,
    Earth,
    sunlight,
)

FULL_MOON_G = -12.73 + SUN_G_MINUS_V  # Krisciunas and Schaefer (1991), as `moon_of`
DARK = 40.0  # magnitude per square arcsecond that stands for a black sky
STEP = 1.0  # magnitude between the skies that the budget is asked about
BRIGHTEST = 4.0  # magnitude per square arcsecond, beyond which no tracker sees stars


@dataclass(frozen=True, eq=False)
class Exclusion:
    """What a body does to a tracker, over the angle from the boresight to its centre or limb.

    angle         (n,) radian, rising
    veil_g        (n,) magnitude per square arcsecond of what passes the baffle
    across        (n,) radian, error across the boresight; NaN where no star is left, or the veil
                  fills the wells
    availability  (n,) 1
    """

    angle: Floats
    veil_g: Floats
    across: Floats
    availability: Floats

    def least(self, rise: float = 0.1, availability: float = 0.99) -> float:
        """The exclusion angle, radian.

        rise     share by which the error may exceed that of the farthest angle
        Returns  beyond it all is well; infinity where it is not even at the farthest angle
        """
        allowed = (1 + rise) * self.across[-1]
        bad = ~((self.across <= allowed) & (self.availability >= availability))
        if bad[-1]:
            return math.inf
        last = np.flatnonzero(bad)
        return float(self.angle[last[-1] + 1]) if len(last) else float(self.angle[0])


def exclusions(case: Case, angle: Floats, altitude: float = 600e3) -> dict[str, Exclusion]:
    """The Sun's, the full Moon's and the noon Earth's, by the analytic budget.

        veil = irradiance PST(angle) f^2 / A,  as a sky of one brightness

    angle     (n,) radian, rising; to the Earth's limb, to the centres of the others
    altitude  metre, from which the Earth is seen
    Returns   an Exclusion for each of "sun", "moon" and "earth"
    Raises    ValueError where the case has no baffle, or `analytic` refuses it.
    Accuracy  model: that of `Baffle` and of the budget; the veil is even over the field, and the
              body beside it. numerical: 1 % between skies of whole magnitudes.
    """
    if case.instrument.baffle is None:
        raise ValueError("instrument.baffle must be given for exclusion angles, got none")
    veils = {
        "sun": _veil(case, SUN_G, angle),
        "moon": _veil(case, FULL_MOON_G, angle),
        "earth": _earth_veil(case, angle, altitude),
    }
    faintest = max(float(veil.max()) for veil in veils.values())
    own = DARK if case.scene.background_g is None else case.scene.background_g
    skies = np.arange(BRIGHTEST, min(faintest, own) + 2 * STEP, STEP)
    across, fraction = _budgets(case, np.append(skies, DARK), own)
    found = {}
    for name, veil in veils.items():
        at = np.interp(veil, np.append(skies, DARK), np.arange(len(skies) + 1))
        found[name] = Exclusion(angle, veil, _straight(across, at), _straight(fraction, at))
    return found


def added(magnitudes: Sequence[float]) -> float:
    """Magnitude of several lights together."""
    return -2.5 * math.log10(sum(10 ** (-0.4 * one) for one in magnitudes))


def _veil(case: Case, magnitude_g: float, angle: Floats) -> Floats:
    assert case.instrument.baffle
    optics = case.instrument.optics
    spread = case.instrument.baffle(angle) * optics.focal_length**2 / optics.area
    return magnitude_g - 2.5 * np.log10(spread * arcsec**2)


def _earth_veil(case: Case, angle: Floats, altitude: float) -> Floats:
    """Of an Earth that is all in sunlight, its parts each at its own angle."""
    assert case.instrument.baffle
    distance = EARTH_RADIUS + altitude
    horizon = math.asin(EARTH_RADIUS / distance)
    down, sun = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
    light = EARTH_ALBEDO / math.pi * sunlight(AU)
    glare = Earth(Disc(down, horizon, light), light, distance * down, sun).glare
    lit = np.empty(len(angle))
    for i, one in enumerate(horizon + angle):
        boresight = np.array([math.sin(one), 0.0, -math.cos(one)])
        apart = np.arccos(np.clip(glare.direction @ boresight, -1, 1))
        lit[i] = case.instrument.baffle(apart) @ glare.fraction * EARTH_ALBEDO / math.pi
    optics = case.instrument.optics
    return SUN_G - 2.5 * np.log10(lit * optics.focal_length**2 / optics.area * arcsec**2)


def _budgets(case: Case, skies: Floats, own: float) -> tuple[Floats, Floats]:
    """(n,) errors across and availabilities under skies with a veil of some brightness."""
    across, fraction = np.full(len(skies), math.nan), np.zeros(len(skies))
    for i, sky in enumerate(skies):
        veiled = replace(case, scene=replace(case.scene, background_g=added((sky, own))))
        try:
            budget = analytic(veiled)
        except ValueError:  # not a single star, or the sky fills the wells: as bright as that
            continue
        across[i], fraction[i] = budget.across, budget.availability
    return across, fraction


def _straight(values: Floats, at: Floats) -> Floats:
    low = np.minimum(at.astype(np.int64), len(values) - 2)
    part = at - low
    return np.where(part > 0, (1 - part) * values[low] + part * values[low + 1], values[low])
