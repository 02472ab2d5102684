"""Body -> V magnitude of a planet."""

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial.polynomial import polyval

from startrack.core import deg
from startrack.space import AU, Body

PLANETS = ("mercury", "venus", "mars", "jupiter", "saturn", "uranus", "neptune")

# Right ascension and declination of the poles: Archinal et al. (2018), Celestial Mechanics and
# Dynamical Astronomy 130, 22, at J2000.
POLE = {"saturn": (40.589 * deg, 83.537 * deg), "uranus": (257.311 * deg, -15.175 * deg)}


def magnitude_v(name: str, body: Body, year: float) -> float:
    """The V magnitude of a planet, averaged over its rotation.

        V = 5 log10(r d) + f(phase angle),   r, d in astronomical units

    Source: Mallama and Hilton (2018), Astronomy and Computing 25, 10.

    name    one of PLANETS, or "earth"
    body    its position
    year    Julian year; Neptune has become brighter
    Accuracy  model: 0.05 mag, Mars 0.1 mag by its rotation; Saturn's rings are left out at phase
              angles beyond 6.5 degrees, which the Earth never sees.
    """
    distances = 5 * math.log10(body.sun_distance * body.distance / AU**2)
    return distances + _PHASE[name](body.phase_angle / deg, body, year)


def _mercury(phase: float, body: Body, year: float) -> float:
    return float(
        polyval(
            phase, [-0.613, 6.3280e-2, -1.6336e-3, 3.3644e-5, -3.4265e-7, 1.6893e-9, -3.0334e-12]
        )
    )


def _venus(phase: float, body: Body, year: float) -> float:
    if phase < 163.7:
        return float(polyval(phase, [-4.384, -1.044e-3, 3.687e-4, -2.814e-6, 8.938e-9]))
    return float(polyval(phase, [236.05828, -2.81914, 8.39034e-3]))


def _earth(phase: float, body: Body, year: float) -> float:
    return float(polyval(phase, [-3.99, -1.060e-3, 2.054e-4]))


def _mars(phase: float, body: Body, year: float) -> float:
    if phase <= 50:
        return float(polyval(phase, [-1.601, 2.267e-2, -1.302e-4]))
    return float(polyval(phase, [-0.367, -0.02573, 3.445e-4]))


def _jupiter(phase: float, body: Body, year: float) -> float:
    if phase <= 12:
        return float(polyval(phase, [-9.395, -3.7e-4, 6.16e-4]))
    fraction = polyval(phase / 180, [1.0, -1.507, -0.363, -0.062, 2.809, -1.876])
    return -9.428 - 2.5 * math.log10(fraction)


def _saturn(phase: float, body: Body, year: float) -> float:
    """Globe and rings; the tilt is the mean of those towards the Sun and the observer."""
    if phase > 6.5:
        return float(polyval(phase, [-8.94, 2.446e-4, 2.672e-4, -1.506e-6, 4.767e-9]))
    lit, seen = _latitudes("saturn", body)
    tilt = math.sin(math.sqrt(max(lit * seen, 0.0)))
    return -8.914 - 1.825 * tilt + 0.026 * phase - 0.378 * tilt * math.exp(-2.25 * phase)


def _uranus(phase: float, body: Body, year: float) -> float:
    lit, seen = _latitudes("uranus", body)
    flat = -7.110 - 8.4e-4 * (abs(lit) + abs(seen)) / 2 / deg
    return flat + (float(polyval(phase, [0.0, 6.587e-3, 1.045e-4])) if phase > 3.1 else 0.0)


def _latitudes(name: str, body: Body) -> tuple[float, float]:
    """Radian, latitudes of the Sun and of the observer."""
    right_ascension, declination = POLE[name]
    pole = np.array(
        [
            math.cos(declination) * math.cos(right_ascension),
            math.cos(declination) * math.sin(right_ascension),
            math.sin(declination),
        ]
    )
    return math.asin(pole @ body.sun / body.sun_distance), math.asin(-pole @ body.direction)


def _neptune(phase: float, body: Body, year: float) -> float:
    brightest = float(np.interp(year, [1980.0, 2000.0], [-6.89, -7.00]))
    return brightest + (float(polyval(phase, [0.0, 7.944e-3, 9.617e-5])) if phase > 1.9 else 0.0)


_PHASE: dict[str, Callable[[float, Body, float], float]] = {
    "mercury": _mercury,
    "venus": _venus,
    "earth": _earth,
    "mars": _mars,
    "jupiter": _jupiter,
    "saturn": _saturn,
    "uranus": _uranus,
    "neptune": _neptune,
}
