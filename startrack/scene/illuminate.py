"""Stars -> Light: photons at the entrance pupil; diffuse light by a user's code."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import Floats, Light, Stars
from startrack.scene import photometry
from startrack.scene.background import starlight, starlight_spectrum, zodiacal, zodiacal_spectrum
from startrack.scene.bodies import Disc, Earth, disc_points, earth_of, moon_of, sun_of
from startrack.scene.cities import cities
from startrack.scene.ephemeris import SkyObserver, observer_of
from startrack.scene.limb import HIGHEST, airglow, limb_light
from startrack.scene.parameters import LIGHTS, Scene
from startrack.scene.photometry import SUN, SUN_G_MINUS_V, WAVELENGTH, photon_irradiance
from startrack.scene.planets import PLANETS, magnitude_v
from startrack.scene.sky_light import sky_light
from startrack.space import AU, EARTH_RADIUS

GROUP = "lights"
LEAST = 1e-6  # of the largest term (a spectrum times a map) of a light; smaller ones drop
OWN_NODES = 129  # along a side of the frame, first grid for a user's light
LEAST_NODES, MOST_NODES = 17, 513  # of its map
TOLERANCE = 0.01  # of its brightest light, error between the nodes
NODES = 17  # of the map of diffuse light along a side: 1 % error between them
LIMB_NODES = 129  # the same with the Earth's limb in the frame: an edge within 1/128
POINTS_PER_PIXEL = 2.0  # of a disc; chosen by hand: fewer leave gaps, more cost time


@dataclass(frozen=True, eq=False)
class LightInput:
    """Directions and wavelengths for which the light is computed.

    direction   (m, 3) unit vectors, ICRS axes, of points evenly spaced over the frame, row by row;
                129 x 129 at first, more where the light needs them
    wavelength  (k,) metre, middle of each spectral bin
    width       metre, of each bin
    scene       date, orbit and background of the design
    generator   random numbers of this trial for this light alone, the same in each call; the use of
                them must not depend on the number of points

    The function returns (m, k) photon / s / m^2 / sr at the entrance pupil, in each direction and
    spectral bin
    """

    direction: Floats
    wavelength: Floats
    width: float
    scene: Scene
    generator: np.random.Generator


def light_by_code(name: str, given: Callable[[int], LightInput]) -> Iterator[core.DiffuseLight]:
    """The light of a function that a design names, as a sum of spectra times maps.

    The function is called with OWN_NODES points along each side of the frame. The number is doubled
    until the error of linear interpolation between every second point is at most twice TOLERANCE of
    the brightest light, in each bin. Interpolation between all points is then within TOLERANCE. The
    coarsest map within TOLERANCE is kept.

    given     number of points along a side -> input, with the same random numbers
    Raises    ValueError if the function raises an error, or returns an invalid result. Refused if
              the light varies too fast for MOST_NODES, except for edges.
    Accuracy  numerical: TOLERANCE of the brightest light between the points; the place of an edge
              within 1/512 of the frame; details between two of OWN_NODES points are missed. 1e-6 of
              the largest term, by singular values.
    """
    nodes = OWN_NODES
    light = _asked(name, given(nodes), nodes)
    while _too_coarse(light, 2 * TOLERANCE) and nodes < MOST_NODES:
        nodes = 2 * nodes - 1
        light = _asked(name, given(nodes), nodes)
    if _too_coarse(light, 2 * TOLERANCE) and _mean_error(light) > 2 * TOLERANCE:
        raise core.Refused(
            f"{core.POINTS[GROUP]} {name} must vary linearly between points 1/{MOST_NODES - 1} of "
            f"the frame apart, within {100 * TOLERANCE:g} % in the mean, got "
            f"{100 * _mean_error(light) / 2:.0f} %"
        )
    while len(light) > LEAST_NODES and not _too_coarse(light, TOLERANCE):
        light = light[::2, ::2]
    side = len(light)
    places, sizes, spectra = np.linalg.svd(light.reshape(side * side, -1), full_matrices=False)
    for place, size, spectrum in zip(places.T, sizes, spectra, strict=True):
        if size > LEAST * sizes[0]:
            yield core.DiffuseLight(spectrum * size, place.reshape(side, side))


def _asked(name: str, given: LightInput, nodes: int) -> Floats:
    """The light (nodes, nodes, k) of a function."""
    shape = len(given.direction), len(given.wavelength)
    light = core.returned(GROUP, name, core.call_code(GROUP, name, given), shape)
    if (light < 0).any():
        raise ValueError(
            f"{core.POINTS[GROUP]} {name} must return no negative light, got {light.min()}"
        )
    return light.reshape(nodes, nodes, -1)


def _interpolation_error(light: Floats) -> Floats:
    """Absolute error, at all points, of linear interpolation between every second point."""
    lines = light.copy()
    lines[1::2] = (light[:-1:2] + light[2::2]) / 2
    lines[:, 1::2] = (lines[:, :-1:2] + lines[:, 2::2]) / 2
    return np.abs(lines - light)


def _too_coarse(light: Floats, limit: float) -> bool:
    """Whether that error exceeds a fraction of the brightest light, in any bin."""
    error = _interpolation_error(light).max(axis=(0, 1))
    return bool((error > limit * light.max(axis=(0, 1))).any())


def _mean_error(light: Floats) -> float:
    """Mean error over the frame, relative to the mean light; the largest of all bins."""
    error, mean = _interpolation_error(light).mean(axis=(0, 1)), light.mean(axis=(0, 1))
    return float((error[mean > 0] / mean[mean > 0]).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Sight:
    """Camera and attitude of a trial, for the light that depends on them.

    icrs_to_camera  true attitude
    camera          the true one
    limit_g         G of the faintest star that is rendered from the catalogue
    streams         of the trial
    """

    icrs_to_camera: Rotation
    camera: core.Camera
    limit_g: float
    streams: core.Streams

    def sees(self, disc: Disc) -> bool:
        """Whether the frame may contain a part of a disc."""
        boresight = self.icrs_to_camera.inv().apply([0.0, 0.0, 1.0])
        angle = math.acos(min(max(float(boresight @ disc.direction), -1.0), 1.0))
        return angle < disc.radius + 1.1 * self.camera.half_diagonal

    def nodes(self, count: int) -> Floats:
        """(count^2, 3) ICRS directions of the nodes of a map of diffuse light."""
        return self.icrs_to_camera.inv().apply(self.camera.lattice(count))


def illuminate(scene: Scene, stars: Stars, sight: Sight | None = None) -> Light:
    """The light of stars, background and bodies.

    sight     None: only stars and the uniform background, which do not depend on it
    Raises    ValueError if a disc in the field has too many pixels. TypeError if the scene draws a
              date or an orbit and `sight` has no streams.
    Accuracy  model: as `photon_irradiance`, `zodiacal`, `starlight`, `magnitude_v`, `sky_light` and
              `bodies`; within the air the whole field has the sky of the line of sight; a body
              hides a star completely or not at all; discs do not move during the exposure.
              numerical: 1 % between the nodes of the maps of diffuse light; the Earth's limb within
              1/128 of the frame.
    """
    rate = photon_irradiance(stars.magnitude_g, photometry.colour_temperature(stars.colour))
    background = _uniform_background(scene.background_g)
    if scene.sky is not None:
        above = sky_light(scene.sky, scene.date)
        rate = rate * above.through
        background = above.background + _uniform_background(scene.sky.stray_g)
    light = Light(stars.direction, WAVELENGTH, rate, background)
    if sight is None or not scene.lights:
        return light
    observer = observer_of(scene, sight.streams) if scene.dated else None
    earth = earth_of(observer) if observer and "earth" in scene.lights else None
    light = replace(light, diffuse=tuple(_diffuse_light(scene, sight, observer, earth)))
    return _with_bodies(light, scene, sight, observer, earth) if observer else light


@lru_cache(maxsize=64)
def _uniform_background(background_g: float | None) -> Floats:
    """Photon / s / m^2 / sr in each bin, with the spectrum of the Sun."""
    if background_g is None:
        return np.zeros_like(WAVELENGTH)
    return photon_irradiance(np.array([background_g]), np.array([SUN]))[0] / core.arcsec**2


def _diffuse_light(
    scene: Scene, sight: Sight, observer: SkyObserver | None, earth: Earth | None
) -> Iterator[core.DiffuseLight]:
    """All light that varies over the field, in front of the Earth and beside it."""
    limb = earth is not None and sight.sees(earth.disc)
    shells = earth is not None and "airglow" in scene.lights and sight.sees(_with_air(earth))
    count = LIMB_NODES if limb or shells else NODES
    line = sight.nodes(count)
    open_sky = ~earth.disc.covers(line) if earth and limb else np.ones(len(line), bool)

    def diffuse(spectrum: Floats, fraction: Floats) -> core.DiffuseLight:
        return core.DiffuseLight(spectrum, fraction.reshape(count, count))

    if "starlight" in scene.lights:
        yield diffuse(starlight_spectrum(), starlight(line, sight.limit_g) * open_sky)
    if observer and "zodiacal" in scene.lights:
        sun = observer.see("sun")
        brightness = zodiacal(line, sun.direction, sun.distance / AU)
        yield diffuse(zodiacal_spectrum(), brightness * open_sky)
    if earth and limb:
        yield diffuse(earth.light, earth.shine(line))
        for spectrum, fraction in limb_light(earth, line, scene.limb):
            yield diffuse(spectrum, fraction)
    if earth and shells:
        for spectrum, fraction in airglow(earth, line):
            yield diffuse(spectrum, fraction)
    for name in scene.lights:
        if core.is_code(name):
            yield from light_by_code(name, partial(_input, name, scene, sight))
        elif made := LIGHTS[name].diffuse:
            yield from made(_input(name, scene, sight, count))


def _input(name: str, scene: Scene, sight: Sight, count: int) -> LightInput:
    """Input of a light at the nodes of a map; the random numbers are always the same."""
    random = sight.streams(f"light {name}")
    return LightInput(sight.nodes(count), WAVELENGTH, photometry.BIN, scene, random)


def _with_air(earth: Earth) -> Disc:
    """The disc of the Earth with its shells of airglow."""
    distance = float(np.linalg.norm(earth.centre))
    radius = math.asin(min((EARTH_RADIUS + HIGHEST) / distance, 1.0))
    return replace(earth.disc, radius=radius)


def _with_bodies(
    light: Light, scene: Scene, sight: Sight, observer: SkyObserver, earth: Earth | None
) -> Light:
    """Add the bodies from the farthest to the nearest, each of which hides what is behind it."""
    if "planets" in scene.lights:
        light = _with_points(light, *_planets(observer, scene))
    bodies = ("sun", sun_of), ("moon", moon_of)
    discs = [body_of(observer) for name, body_of in bodies if name in scene.lights]
    for disc in discs:
        light = _with_disc(light, disc, sight)
    light = replace(light, stray_sources=tuple(_stray_sources(discs, earth)))
    if earth is None:
        return light
    light = _without_hidden(light, earth.disc)
    if "cities" in scene.lights and sight.sees(earth.disc):
        light = _with_points(light, *cities(earth, observer))
    return light


def _stray_sources(discs: list[Disc], earth: Earth | None) -> Iterator[core.StrayLightSource]:
    """Discs, the farthest first, and the Earth, without the parts that nearer bodies hide."""
    bodies = [*discs, earth.disc] if earth else discs
    for n, disc in enumerate(discs):
        fraction = math.prod(1 - nearer.hides(disc) for nearer in bodies[n + 1 :])
        if fraction > 0:
            yield disc.stray_source(fraction)
    if earth and len((source := earth.stray_source).fraction):
        yield source


def _planets(observer: SkyObserver, scene: Scene) -> tuple[Floats, Floats]:
    """Directions and photon irradiances; with the Earth for an observer far from it."""
    names = PLANETS if scene.place is None else (*PLANETS, "earth")
    bodies = {name: observer.see(name) for name in names}
    magnitude_g = [
        magnitude_v(name, body, observer.year) + SUN_G_MINUS_V for name, body in bodies.items()
    ]
    rate = photon_irradiance(np.array(magnitude_g), np.full(len(names), SUN))
    return np.array([body.direction for body in bodies.values()]), rate


def _with_disc(light: Light, disc: Disc, sight: Sight) -> Light:
    """The light with a body in front of it."""
    light = _without_hidden(light, disc)
    if not sight.sees(disc):
        return light
    point, fraction = disc_points(disc, 1 / sight.camera.focal_length_px / POINTS_PER_PIXEL)
    return _with_points(light, point, np.outer(fraction, disc.photon_irradiance))


def _with_points(light: Light, direction: Floats, irradiance: Floats) -> Light:
    return replace(
        light,
        direction=np.concatenate([light.direction, direction]),
        photon_irradiance=np.concatenate([light.photon_irradiance, irradiance]),
    )


def _without_hidden(light: Light, disc: Disc) -> Light:
    """The light without the points that a disc hides."""
    seen = ~disc.covers(light.direction)
    return replace(
        light, direction=light.direction[seen], photon_irradiance=light.photon_irradiance[seen]
    )
