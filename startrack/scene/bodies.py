"""Observer -> the Sun, the Moon and the Earth: discs in the field, glare beside it, eclipses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, StrayLightSource, deg
from startrack.scene.ephemeris import AU, EARTH_RADIUS, Body, Observer
from startrack.scene.photometry import SUN, SUN_G_MINUS_V, photon_irradiance

SUN_G = -26.90  # at one astronomical unit, Casagrande & VandenBerg (2018), MNRAS 479, L102
SUN_RADIUS = 6.957e8  # metre, IAU 2015 nominal
MOON_RADIUS = 1_737_400.0  # metre, IAU mean
MOON_DISTANCE = 384_400e3  # metre, at which its magnitude is given
EARTH_ALBEDO = 0.30  # Stephens et al. (2015), Reviews of Geophysics 53, 141
RINGS, SPOKES = 16, 48  # of the quadrature over the Earth's disc
MOST = 1000  # points to a disc's radius, three million in all, two gigabytes of spectra
FINEST = 128  # points to a disc's radius, at which a crescent is no longer sought


@dataclass(frozen=True, eq=False)
class Disc:
    """A body with a size.

    direction    (3,) unit vector to its centre, ICRS axes
    radius       radian, of its disc
    photon_rate  (k,) photon / s / m^2 of the whole disc
    sun          (3,) unit vector from the body to the Sun; None where it shines itself
    """

    direction: Floats
    radius: float
    photon_irradiance: Floats
    sun: Floats | None = None

    def covers(self, direction: Floats) -> NDArray[np.bool_]:
        """Which of (n, 3) directions it hides."""
        return direction @ self.direction > math.cos(self.radius)

    def hides(self, other: Disc) -> float:
        """Share of another disc, behind it, that it covers.

        The lens between two circles R and r at a distance d, over the circle r: the sectors of both
        less their triangles.

        Accuracy  model: circles in a plane, as they are where one of them is small.
        """
        outer, inner = self.radius, other.radius
        apart = 2 * math.asin(min(float(np.linalg.norm(self.direction - other.direction)) / 2, 1.0))
        if apart >= outer + inner:
            return 0.0
        if apart <= abs(outer - inner):
            return min(outer / inner, 1.0) ** 2
        along = (apart**2 + inner**2 - outer**2) / (2 * apart)  # of the common chord, from r
        half = math.sqrt(max(inner**2 - along**2, 0.0))  # rounding, where they touch
        lens = inner**2 * math.atan2(half, along) + outer**2 * math.atan2(half, apart - along)
        return min(max((lens - apart * half) / (math.pi * inner**2), 0.0), 1.0)

    def glare(self, fraction: float = 1.0) -> StrayLightSource:
        """A fraction of its light, from its centre."""
        return StrayLightSource(self.direction[None], np.full(1, fraction), self.photon_irradiance)


def sun_of(observer: Observer) -> Disc:
    """The Sun. Errors: no limb darkening."""
    body = observer.see("sun")
    return Disc(body.direction, math.asin(SUN_RADIUS / body.distance), sunlight(body.distance))


def sunlight(distance: float) -> Floats:
    """(k,) photon / s / m^2 at a distance from the Sun, metre."""
    return photon_irradiance(np.array([SUN_G]), np.array([SUN]))[0] * (AU / distance) ** 2


def moon_of(observer: Observer) -> Disc:
    """The Moon, by its phase.

        V = -12.73 + 0.026 a + 4e-9 a^4,   a the phase angle in degrees, at the mean distance

    Source: Krisciunas and Schaefer (1991), PASP 103, 1033, eq. (9).
    Accuracy  model: 0.1 mag below 7 degrees of phase, where it is brighter still; the colour is the
              Sun's; no earthlight.
    """
    body = observer.see("moon")
    return Disc(
        body.direction,
        math.asin(MOON_RADIUS / body.distance),
        _reflected(moon_magnitude(body)),
        body.sun / body.sun_distance,
    )


def moon_magnitude(body: Body) -> float:
    """V of the Moon; see `moon_of`."""
    phase = body.phase_angle / deg
    full = -12.73 + 0.026 * phase + 4e-9 * phase**4
    return full + 5 * math.log10(body.distance / MOON_DISTANCE * body.sun_distance / AU)


def _reflected(magnitude_v: float) -> Floats:
    return photon_irradiance(np.array([magnitude_v + SUN_G_MINUS_V]), np.array([SUN]))[0]


@dataclass(frozen=True, eq=False)
class Earth:
    """The Earth under an orbit, a sphere that scatters as Lambert's law says.

        radiance = albedo / pi * sunlight * cos(angle of the Sun to the normal)

    disc    what it hides
    light   (k,) photon / s / m^2 / sr where the Sun stands in the zenith
    centre  (3,) metre from the observer to its centre
    sun     (3,) unit vector to the Sun
    """

    disc: Disc
    light: Floats
    centre: Floats
    sun: Floats

    def shine(self, direction: Floats) -> Floats:
        """Share of `light` that comes from (n, 3) directions, (n,); zero at night and beside it."""
        along = direction @ self.centre
        inside = EARTH_RADIUS**2 - (self.centre @ self.centre - along**2)
        near = along - np.sqrt(np.maximum(inside, 0))
        normal = (near[:, None] * direction - self.centre) / EARTH_RADIUS
        return np.where((inside > 0) & (along > 0), np.maximum(normal @ self.sun, 0.0), 0.0)

    @property
    def glare(self) -> StrayLightSource:
        """Its light, from many places of its disc."""
        place, solid_angle = _disc_quadrature(self.disc.direction, self.disc.radius)
        fraction = self.shine(place) * solid_angle
        lit = fraction > 0
        return StrayLightSource(place[lit], fraction[lit], self.light)


def earth_of(observer: Observer) -> Earth:
    """The Earth, as an observer in an orbit sees it.

    Accuracy  model: clouds, seas and the limb's air are one mean grey; 50 % for a place, 10 % for
              the whole. numerical: 1 % from a quadrature of 16 x 48 places.
    """
    distance = float(np.linalg.norm(observer.earth))
    body = observer.see("sun")
    to_sun = body.direction * body.distance - observer.earth
    from_sun = float(np.linalg.norm(to_sun))
    light = EARTH_ALBEDO / math.pi * sunlight(from_sun)
    disc = Disc(observer.earth / distance, math.asin(EARTH_RADIUS / distance), light)
    return Earth(disc, light, observer.earth, to_sun / from_sun)


def _disc_quadrature(centre: Floats, radius: float) -> tuple[Floats, Floats]:
    """(n, 3) directions over a disc and the solid angle that each stands for, (n,)."""
    node, weight = np.polynomial.legendre.leggauss(RINGS)
    cosine = 1 + (math.cos(radius) - 1) * (node + 1) / 2
    solid = (1 - math.cos(radius)) / 2 * weight * 2 * math.pi / SPOKES
    turn = (np.arange(SPOKES) + 0.5) * 2 * math.pi / SPOKES
    first, second = _across(centre)
    ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    sine = np.sqrt(1 - cosine**2)
    place = cosine[:, None, None] * centre + sine[:, None, None] * ring
    return place.reshape(-1, 3), np.repeat(solid, SPOKES)


def disc_points(disc: Disc, spacing: float) -> tuple[Floats, Floats]:
    """A disc as points, close enough to look even, and to hit a crescent.

    A lit body's brightness is that of Lommel and Seeliger, m0 / (m0 + m), of the cosines of the
    Sun's and the observer's angle to the normal; it is even at full phase, as the Moon's is.

    spacing  radian between points
    Returns  (n, 3) unit vectors and (n,) fractions of the light, of sum one; none of a crescent
             thinner than some 1/128 of the radius, as the Moon's are no more, 7 degrees from new
    Raises   ValueError where there would be millions, more than memory holds with their spectra.
    """
    count = max(math.ceil(disc.radius / spacing), 2)
    if count > MOST:
        raise ValueError(
            f"a body in the field must have at most {MOST} points to its radius, got {count}: "
            "leave it out of lights, or take larger pixels"
        )
    x, y, fraction = _lit(disc, count)
    while not len(fraction) and count < FINEST:
        count *= 2
        x, y, fraction = _lit(disc, count)
    first, second = _across(disc.direction)
    place = disc.direction + math.tan(disc.radius) * (np.outer(x, first) + np.outer(y, second))
    return place / np.linalg.norm(place, axis=1)[:, None], fraction


def _lit(disc: Disc, count: int) -> tuple[Floats, Floats, Floats]:
    """Points (x, y) of a lattice of `count` to the radius that are lit, and their shares."""
    step = (np.arange(-count, count) + 0.5) / count
    x, y = (each.ravel() for each in np.meshgrid(step, step))
    inside = x**2 + y**2 < 1
    x, y = x[inside], y[inside]
    if disc.sun is None:
        return x, y, np.full(len(x), 1 / len(x))
    seen = np.sqrt(1 - x**2 - y**2)
    first, second = _across(disc.direction)
    normal = np.outer(x, first) + np.outer(y, second) - np.outer(seen, disc.direction)
    bright = np.maximum(normal @ disc.sun, 0.0)
    fraction = bright / (bright + seen)
    kept = fraction > 0
    return x[kept], y[kept], fraction[kept] / fraction.sum() if kept.any() else fraction[kept]


def _across(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors at right angles to a direction and to each other."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
