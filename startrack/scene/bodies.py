"""Observer -> the Sun, the Moon and the Earth: discs in the field, stray light, eclipses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from startrack.core import Flags, Floats, Refused, StrayLightSource, deg
from startrack.scene.ephemeris import SkyObserver
from startrack.scene.photometry import SUN, SUN_G_MINUS_V, photon_irradiance
from startrack.space import AU, EARTH_RADIUS

SUN_G = -26.90  # at one astronomical unit: Casagrande & VandenBerg (2018), MNRAS 479, L102
SUN_RADIUS = 6.957e8  # metre, IAU 2015 nominal
MOON_RADIUS = 1_737_400.0  # metre, IAU mean
MOON_DISTANCE = 384_400e3  # metre, at which its magnitude is given
EARTH_ALBEDO = 0.30  # Stephens et al. (2015), Reviews of Geophysics 53, 141
RINGS, SPOKES = 16, 48  # of the quadrature over the Earth's disc: 1 % of its stray light
MOST_POINTS = 1000  # in the radius of a disc: three million in all, two gigabytes of spectra
# Points in the radius of a disc, above which a thin crescent is left out; by hand: the Moon has
# such a crescent only within 7 degrees of new moon.
FINEST = 128


@dataclass(frozen=True, eq=False)
class Disc:
    """A body with a size.

    direction          (3,) unit vector to its centre, ICRS axes
    radius             radian, of its disc
    photon_irradiance  (k,) photon / s / m^2 of the whole disc in each spectral bin
    sun                (3,) unit vector from the body to the Sun; None for the Sun itself
    """

    direction: Floats
    radius: float
    photon_irradiance: Floats
    sun: Floats | None = None

    def covers(self, direction: Floats) -> Flags:
        """Whether the disc hides each direction: (n, 3) -> (n,)."""
        return direction @ self.direction > math.cos(self.radius)

    def hides(self, other: Disc) -> float:
        """Fraction of another disc behind it that it covers.

        The common area of two circles of radii R and r at a distance d, over the area of the circle
        r: the sectors of both minus their triangles.

        Accuracy  model: circles in a plane, which is valid if one of them is small.
        """
        outer, inner = self.radius, other.radius
        chord = float(np.linalg.norm(self.direction - other.direction))
        d = 2 * math.asin(min(chord / 2, 1.0))
        if d >= outer + inner:
            return 0.0
        if d <= abs(outer - inner):
            return min(outer / inner, 1.0) ** 2
        along = (d**2 + inner**2 - outer**2) / (2 * d)  # of the common chord, from the centre of r
        half = math.sqrt(max(inner**2 - along**2, 0.0))  # rounding, where they touch
        lens = inner**2 * math.atan2(half, along) + outer**2 * math.atan2(half, d - along)
        return min(max((lens - d * half) / (math.pi * inner**2), 0.0), 1.0)

    def stray_source(self, fraction: float = 1.0) -> StrayLightSource:
        """A fraction of its light, as a source in the direction of its centre."""
        return StrayLightSource(self.direction[None], np.full(1, fraction), self.photon_irradiance)


def sun_of(observer: SkyObserver) -> Disc:
    """The Sun.

    Accuracy  model: no limb darkening.
    """
    body = observer.see("sun")
    return Disc(body.direction, math.asin(SUN_RADIUS / body.distance), sunlight(body.distance))


def sunlight(distance: float) -> Floats:
    """(k,) photon / s / m^2 at a distance from the Sun, metre."""
    return photon_irradiance(np.array([SUN_G]), np.array([SUN]))[0] * (AU / distance) ** 2


def moon_of(observer: SkyObserver) -> Disc:
    """The Moon, by its phase.

    Accuracy  as `moon_irradiance`
    """
    body = observer.see("moon")
    radius = math.asin(MOON_RADIUS / body.distance)
    light = moon_irradiance(body.phase_angle, body.distance, body.sun_distance)
    return Disc(body.direction, radius, light, body.sun / body.sun_distance)


def moon_irradiance(phase_angle: float, distance: float, sun_distance: float) -> Floats:
    """(k,) photon / s / m^2 of the Moon; angle in radian, its distances in metre.

        V = -12.73 + 0.026 a + 4e-9 a^4,   a the phase angle in degrees, at the mean distance

    Source: Krisciunas and Schaefer (1991), PASP 103, 1033, eq. (9).
    Accuracy  model: 0.1 mag; below 7 degrees of phase the Moon is brighter than the model. The
              colour is the Sun's; no earthlight.
    """
    phase = phase_angle / deg
    full = -12.73 + 0.026 * phase + 4e-9 * phase**4
    v = full + 5 * math.log10(distance / MOON_DISTANCE * sun_distance / AU)
    return photon_irradiance(np.array([v + SUN_G_MINUS_V]), np.array([SUN]))[0]


@dataclass(frozen=True, eq=False)
class Earth:
    """The Earth under an orbit, a Lambertian sphere.

        radiance = albedo / pi * sunlight * cos(angle of the Sun to the normal)

    disc    the part of the sky that the Earth hides
    light   (k,) photon / s / m^2 / sr of a place with the Sun in the zenith
    centre  (3,) metre from the observer to its centre
    sun     (3,) unit vector to the Sun
    """

    disc: Disc
    light: Floats
    centre: Floats
    sun: Floats

    def shine(self, direction: Floats) -> Floats:
        """Fraction of `light` from (n, 3) directions, (n,); zero at night and beside the disc."""
        along = direction @ self.centre
        inside = EARTH_RADIUS**2 - (self.centre @ self.centre - along**2)
        near = along - np.sqrt(np.maximum(inside, 0))
        normal = (near[:, None] * direction - self.centre) / EARTH_RADIUS
        return np.where((inside > 0) & (along > 0), np.maximum(normal @ self.sun, 0.0), 0.0)

    @property
    def stray_source(self) -> StrayLightSource:
        """Light of the body, as sources at many points of its disc."""
        point, solid_angle = _disc_quadrature(self.disc.direction, self.disc.radius)
        fraction = self.shine(point) * solid_angle
        lit = fraction > 0
        return StrayLightSource(point[lit], fraction[lit], self.light)


def earth_of(observer: SkyObserver) -> Earth:
    """The Earth, seen from an orbit.

    Accuracy  model: one mean albedo for clouds, seas and land; 50 % at one point, 10 % for the
              whole Earth. numerical: 1 % from a quadrature of 16 x 48 points.
    """
    distance = float(np.linalg.norm(observer.earth))
    body = observer.see("sun")
    to_sun = body.direction * body.distance - observer.earth
    from_sun = float(np.linalg.norm(to_sun))
    light = EARTH_ALBEDO / math.pi * sunlight(from_sun)
    disc = Disc(observer.earth / distance, math.asin(EARTH_RADIUS / distance), light)
    return Earth(disc, light, observer.earth, to_sun / from_sun)


def _disc_quadrature(centre: Floats, radius: float) -> tuple[Floats, Floats]:
    """(n, 3) directions over a disc and the solid angle of each, (n,)."""
    node, weight = np.polynomial.legendre.leggauss(RINGS)
    cosine = 1 + (math.cos(radius) - 1) * (node + 1) / 2
    solid = (1 - math.cos(radius)) / 2 * weight * 2 * math.pi / SPOKES
    turn = (np.arange(SPOKES) + 0.5) * 2 * math.pi / SPOKES
    first, second = _perpendicular(centre)
    ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    sine = np.sqrt(1 - cosine**2)
    point = cosine[:, None, None] * centre + sine[:, None, None] * ring
    return point.reshape(-1, 3), np.repeat(solid, SPOKES)


def disc_points(disc: Disc, spacing: float) -> tuple[Floats, Floats]:
    """A disc as points.

    A lit body has the brightness of Lommel and Seeliger, m0 / (m0 + m), of the cosines of the
    angles of the Sun (m0) and of the observer (m) to the normal; it is uniform at full phase, like
    the Moon's.

    spacing  radian between points; less for a thin crescent
    Returns  (n, 3) unit vectors and (n,) fractions of the light, of sum one; no points for a
             crescent thinner than about 1/128 of the radius, such as the Moon's within 7 degrees
             of new moon
    Raises   ValueError if the radius has more than 1000 points, whose spectra fill the memory.
    """
    count = max(math.ceil(disc.radius / spacing), 2)
    if count > MOST_POINTS:
        raise Refused(
            f"a body in the field must have at most {MOST_POINTS} points to its radius, got "
            f"{count}: leave it out of lights, or take larger pixels"
        )
    x, y, fraction = _lit_points(disc, count)
    while not len(fraction) and count < FINEST:
        count *= 2
        x, y, fraction = _lit_points(disc, count)
    first, second = _perpendicular(disc.direction)
    point = disc.direction + math.tan(disc.radius) * (np.outer(x, first) + np.outer(y, second))
    return point / np.linalg.norm(point, axis=1)[:, None], fraction


def _lit_points(disc: Disc, count: int) -> tuple[Floats, Floats, Floats]:
    """Lit points (x, y) of a grid, `count` to the radius, and their fractions."""
    step = (np.arange(-count, count) + 0.5) / count
    x, y = (grid.ravel() for grid in np.meshgrid(step, step))
    inside = x**2 + y**2 < 1
    x, y = x[inside], y[inside]
    if disc.sun is None:
        return x, y, np.full(len(x), 1 / len(x))
    seen = np.sqrt(1 - x**2 - y**2)
    first, second = _perpendicular(disc.direction)
    normal = np.outer(x, first) + np.outer(y, second) - np.outer(seen, disc.direction)
    bright = np.maximum(normal @ disc.sun, 0.0)
    fraction = bright / (bright + seen)
    kept = fraction > 0
    return x[kept], y[kept], fraction[kept] / fraction.sum() if kept.any() else fraction[kept]


def _perpendicular(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors at right angles to a direction and to each other."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
