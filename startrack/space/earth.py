"""The Earth as a body: size, gravity and spin; place and line of sight -> angle to its limb.

Products of vectors of many places, which lie component by component, (3, n), and of matrices,
(3, 3, n), are here, too.
"""

import math

import numpy as np

from startrack.core import Floats, Ints, deg

# WGS 84 (NIMA TR8350.2, 2000), table 3.1, and the gravity model EGM96.
EARTH_RADIUS = 6_378_137.0  # metre, at the equator
FLATTENING = 1 / 298.257223563
POLAR_RADIUS = EARTH_RADIUS * (1 - FLATTENING)  # metre
SQUARED_ECCENTRICITY = FLATTENING * (2 - FLATTENING)
GM = 3.986004418e14  # m^3 / s^2
J2 = 1.08262668e-3  # 1
SPIN = 7.292115146706979e-5  # radian / second, IERS conventions 2010
OBLATE = 1 / POLAR_RADIUS**2 - 1 / EARTH_RADIUS**2  # 1 / m^2
TWILIGHT = 6 * deg  # depression of the Sun to which the limb counts as lit; chosen by hand


def dot(a: Floats, b: Floats) -> Floats:
    """(n,) scalar products of (3, n); also (3, n) of (3, 3, n) body axes and a direction (3,)."""
    total = a[0] * b[0]
    total += a[1] * b[1]
    total += a[2] * b[2]
    return total


def cross(a: Floats, b: Floats) -> Floats:
    """(3, n) vector products of (3, n)."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def unit(a: Floats) -> Floats:
    """(3, n) of length one."""
    return a / np.sqrt(dot(a, a))


def times(matrix: Floats, a: Floats) -> Floats:
    """(3, n) products of (3, 3, n) matrices and (3, n) vectors."""
    return np.stack([dot(row, a) for row in matrix])


def geodetic_latitude(place: Floats) -> Floats:
    """Geodetic latitude of places, on the ellipsoid WGS 84.

        tan(latitude) = (z + e^2 / (1 - f) a sin^3 b) / (p - e^2 a cos^3 b),
        tan b = z / ((1 - f) p)

    p is the distance from the axis, a the equatorial radius, e^2 = f (2 - f).
    Source: Bowring (1976), Survey Review 23, 323.

    place     (3, ...) metre from the Earth's centre, the third along its axis
    Returns   (...) radian
    Accuracy  numerical: 4e-7 degrees from the ground to 36,000 km.
    """
    flat, (x, y, z) = 1 - FLATTENING, place
    axis = np.hypot(x, y)
    reduced = np.arctan2(z, flat * axis)
    north = z + SQUARED_ECCENTRICITY / flat * EARTH_RADIUS * np.sin(reduced) ** 3
    out = axis - SQUARED_ECCENTRICITY * EARTH_RADIUS * np.cos(reduced) ** 3
    return np.asarray(np.arctan2(north, out))


def angle(cosine: Floats) -> Floats:
    """Angles (n,) radian from cosines, clipped to [-1, 1] against rounding errors."""
    return np.arccos(np.clip(cosine, -1.0, 1.0))


class EarthSeen:
    """The Earth as it is seen from n places.

    down    (3, n) unit vectors to its centre
    sun     (3, n) unit vectors to the Sun
    """

    def __init__(self, place: Floats, pole: Floats, sun: Floats) -> None:
        square = dot(place, place)
        distance = np.sqrt(square)
        self.down, self.sun, self._pole = place / -distance, sun, pole
        self._square = square
        self._sine = -dot(self.down, pole)  # of the geocentric latitude
        self._to_sun = dot(self.down, sun)
        # (r / radius)^2 in the metric in which the ellipsoid is the unit sphere
        self._metric = square * (1 / EARTH_RADIUS**2 + OBLATE * self._sine**2)

    def limb(self, line: Floats) -> tuple[Floats, Floats, Floats]:
        """Angle from the Earth's centre to lines of sight (3, n), and to the limb below each.

        The limb is where the plane of the line and of the Earth's centre touches the ellipsoid. A
        ray down + t e, with e the unit vector in that plane away from the centre, touches it for

            Q t^2 + 2 g t = A,   A = r D^2 r,   g = c r^2 (r.k)(e.k),
            Q = (A - 1) r^2 (e D^2 e) - g^2

        with r the place in units of its length, D^2 = I / a^2 + c k k^T, c = 1 / b^2 - 1 / a^2 and
        k the pole.

        Returns   (n,) radian, angle to the centre; (n,) radius of the disc there; (n,) cosine of
                  the Sun's angle to the ground's vertical at that point of the limb
        Accuracy  model: WGS 84 without atmosphere and terrain. numerical: the nearest point of the
                  limb is beside this plane, which makes the angle too large by 1 arcsec at most.
        """
        cosine = dot(line, self.down)
        theta = angle(cosine)
        sine = np.maximum(np.sin(theta), 1e-9)
        away = (dot(line, self._pole) + cosine * self._sine) / sine  # e . k
        mixed = OBLATE * self._square * self._sine * away
        metric = self._metric
        quadratic = (metric - 1) * self._square * (1 / EARTH_RADIUS**2 + OBLATE * away * away)
        quadratic -= mixed * mixed
        slope = (np.sqrt(mixed * mixed + quadratic * metric) - mixed) / quadratic
        radius = np.arctan(slope)
        long = np.sqrt(1 + slope * slope)
        to_sun = (dot(line, self.sun) - cosine * self._to_sun) / sine  # e . sun
        return theta, radius, (to_sun - slope * self._to_sun) / long

    def lit(self, theta: Floats, radius: Floats, height: Floats) -> Floats:
        """Angle from the line of sight to the nearest lit point of the limb, negative in front.

        theta, radius, height   (n,) as for `limb`
        Returns   (n,) radian; infinite where the whole limb is dark
        Accuracy  model: lit is where the Sun is less than 6 degrees below the horizon, at one
                  height all around; the terminator inside the disc is left out. Where the limb
                  below the line of sight is dark, the Earth is a sphere of its radius there.
        """
        angle_to_lit = theta - radius
        dark = np.flatnonzero(height < -math.sin(TWILIGHT))
        if len(dark):
            angle_to_lit[dark] = self._beside(theta[dark], radius[dark], height[dark], dark)
        return angle_to_lit

    def _beside(self, theta: Floats, radius: Floats, height: Floats, at: Ints) -> Floats:
        """Angle from lines above dark limb to the nearer end of the lit arc of the limb."""
        down = self._to_sun[at]
        flat = np.sqrt(np.maximum(1 - down * down, 1e-18))
        sr, cr = np.sin(radius), np.cos(radius)
        end = (sr * down - math.sin(TWILIGHT)) / (cr * flat)
        here = (height + sr * down) / (cr * flat)
        between = angle(here) - angle(end)
        apart = angle(np.cos(theta) * cr + np.sin(theta) * sr * np.cos(between))
        return np.where(end < 1, apart, math.inf)
