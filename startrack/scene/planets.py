"""Body -> V magnitude of a planet."""

import math

import numpy as np
from numpy.polynomial.polynomial import polyval

from startrack.core import deg
from startrack.space import AU, Body

PLANETS = ("mercury", "venus", "mars", "jupiter", "saturn", "uranus", "neptune")

# Right ascension and declination of the poles: Archinal et al. (2018), Celestial Mechanics and
# Dynamical Astronomy 130, 22, at J2000.
POLE = {"saturn": (40.589 * deg, 83.537 * deg), "uranus": (257.311 * deg, -15.175 * deg)}
# Polynomials in the phase angle, each up to a limit (degree); those of Uranus and Neptune are
# added.
CURVES: dict[str, tuple[tuple[float, tuple[float, ...]], ...]] = {
    "mercury": (
        (180, (-0.613, 6.3280e-2, -1.6336e-3, 3.3644e-5, -3.4265e-7, 1.6893e-9, -3.0334e-12)),
    ),
    "venus": ((163.7, (-4.384, -1.044e-3, 3.687e-4, -2.814e-6, 8.938e-9)),
              (180, (236.05828, -2.81914, 8.39034e-3))),
    "earth": ((180, (-3.99, -1.060e-3, 2.054e-4)),),
    "mars": ((50, (-1.601, 2.267e-2, -1.302e-4)), (180, (-0.367, -0.02573, 3.445e-4))),
    "jupiter": ((12, (-9.395, -3.7e-4, 6.16e-4)),),
    "saturn": ((180, (-8.94, 2.446e-4, 2.672e-4, -1.506e-6, 4.767e-9)),),
    "uranus": ((3.1, (0.0,)), (180, (0.0, 6.587e-3, 1.045e-4))),
    "neptune": ((1.9, (0.0,)), (180, (0.0, 7.944e-3, 9.617e-5))),
}  # fmt: skip


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
    return distances + _at_one_unit(name, body.phase_angle / deg, body, year)


def _at_one_unit(name: str, phase: float, body: Body, year: float) -> float:
    """V at one astronomical unit from the Sun and from the observer; phase in degree."""
    if name == "jupiter" and phase > 12:
        fraction = polyval(phase / 180, [1.0, -1.507, -0.363, -0.062, 2.809, -1.876])
        return -9.428 - 2.5 * math.log10(fraction)
    if name == "saturn" and phase <= 6.5:
        # Globe and rings; the tilt is the mean of those towards the Sun and the observer.
        lit, seen = _latitudes(name, body)
        tilt = math.sin(math.sqrt(max(lit * seen, 0.0)))
        return -8.914 - 1.825 * tilt + 0.026 * phase - 0.378 * tilt * math.exp(-2.25 * phase)
    curve = float(polyval(phase, next(terms for most, terms in CURVES[name] if phase <= most)))
    if name == "uranus":
        lit, seen = _latitudes(name, body)
        return -7.110 - 8.4e-4 * (abs(lit) + abs(seen)) / 2 / deg + curve
    if name == "neptune":
        return float(np.interp(year, [1980.0, 2000.0], [-6.89, -7.00])) + curve
    return curve


def _latitudes(name: str, body: Body) -> tuple[float, float]:
    """Radian, latitudes of the Sun and of the observer."""
    ra, dec = POLE[name]
    flat = math.cos(dec)
    pole = np.array([flat * math.cos(ra), flat * math.sin(ra), math.sin(dec)])
    return math.asin(pole @ body.sun / body.sun_distance), math.asin(-pole @ body.direction)
