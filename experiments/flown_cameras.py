"""Inputs of `flown.py`: designs with laws, and the light of stars and sky in each draw."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.special import ndtr, ndtri

from startrack import Streams
from startrack.catalog import Selection, open_sky
from startrack.core import Floats, deg
from startrack.design import Case, load_design
from startrack.detector import electron_rate
from startrack.observation import light_by_colour, sky_electrons, throughput
from startrack.scene import DaySky

DESIGNS = Path(__file__).parent / "flown"
LIMIT_G = 8.0  # of the shipped catalogue
# Factor of the number of fainter stars per magnitude; from the counts of the catalogue between G 6
# and 8.
GROWTH = 2.9
COLOURS: Floats = np.linspace(-0.5, 3.0, 15)  # BP - RP
EIGHT_LN_2 = 8 * math.log(2)
# UTC, frames, the Sun's elevation, right ascension, declination, elevation of the line of sight,
# distance from the Sun (degree), focus (steps).
BLOCKS = (
    ("18:08", 104, 51.0, 214.8, 3.7, 44.7, 27.7, -421),
    ("18:38", 99, 52.0, 245.4, 46.8, 44.6, 71.0, -411),
    ("19:10", 100, 51.6, 252.8, 44.8, 44.6, 74.9, -365),
    ("19:40", 99, 49.9, 260.0, 42.5, 44.7, 79.2, -451),
    ("20:10", 100, 47.1, 266.9, 41.5, 44.7, 84.0, -441),
    ("20:40", 99, 43.4, 274.2, 39.4, 44.7, 89.2, -431),
    ("21:10", 99, 39.0, 281.1, 38.2, 44.7, 94.5, -421),
    ("21:40", 100, 34.1, 288.8, 37.8, 44.8, 100.5, -411),
    ("22:10", 100, 28.8, 296.1, 37.1, 44.8, 106.3, -401),
    ("22:40", 99, 23.1, 291.1, 12.5, 44.6, 103.3, -391),
    ("23:12", 99, 16.9, 296.0, 9.0, 44.6, 108.1, -400),
    ("23:43", 100, 10.9, 316.7, 66.2, 45.4, 107.9, -400),
    ("00:13", 99, 4.8, 325.9, 63.2, 45.4, 112.9, -390),
    ("00:43", 100, -1.4, 334.2, 62.3, 45.5, 116.0, -380),
)
BRITE = {
    # G and BP - RP, radius of the aperture (pixel), side of the raster, median degC of the CCD
    "unibrite": (2.72, -0.30, 9.0, 32.0, 28.1),
    "heweliusz": (1.72, -0.24, 10.0, 28.0, 16.9),
}


@dataclass(frozen=True, eq=False)
class Draw:
    """One value of each unknown of a camera.

    case     its design
    streams  random streams of quantities outside designs, by name
    """

    case: Case
    streams: Streams

    def uniform(self, name: str, low: float, high: float) -> float:
        """A number with a uniform distribution between two bounds."""
        return low + (high - low) * float(self.streams(f"unknown {name}").random())

    def about(self, name: str, median: float, factor: float) -> float:
        """A number that is within a factor of its median with a probability of 68 %."""
        score = float(ndtri(self.streams(f"unknown {name}").random()))
        return median * factor**score

    @property
    def fwhm(self) -> float:
        """Pixel, width of the image at half of its peak: blur, diffraction and pixel."""
        optics, detector = self.case.instrument.optics, self.case.instrument.detector
        diffraction = 1.029 * 700e-9 * optics.f_number / math.sqrt(EIGHT_LN_2)
        sigma = math.hypot(optics.total_blur, diffraction) / detector.pitch
        return math.sqrt(EIGHT_LN_2 * (sigma**2 + 1 / 12))

    def electrons(self, colour: Floats) -> Floats:
        """Electrons (n,) in an exposure of stars of G = 0 and the given BP - RP."""
        case = self.case
        light = light_by_colour(case, COLOURS)
        detector = case.instrument.detector
        rate = electron_rate(light, detector, throughput(case.instrument))[0] * detector.exposure
        known = np.where(np.isnan(colour), 0.82, colour)
        return np.exp(np.interp(known, COLOURS, np.log(rate)))

    def sky(self, **geometry: float) -> float:
        """Electrons of the sky in a pixel and exposure, for another Sun and line of sight."""
        scene = self.case.scene
        assert scene.sky is not None
        here = replace(scene, sky=replace(scene.sky, **geometry))
        return sky_electrons(replace(self.case, scene=here))


def draws(name: str, count: int, seed: int) -> list[Draw]:
    """Draws of a design of `experiments/flown`, by its name."""
    made = []
    for number in range(count):
        streams = Streams(seed, number)

        def quantile(unknown: str, streams: Streams = streams) -> float:
            return float(streams(f"unknown {unknown}").random())

        design = load_design(DESIGNS / f"{name}.toml", quantile=quantile)
        made.append(Draw(design.case, streams))
    return made


@lru_cache(maxsize=1)
def _stars() -> tuple[Floats, Floats, Floats]:
    """Directions, RP and BP - RP of the shipped catalogue."""
    stars = open_sky(Selection(source="bright", limit_g=LIMIT_G)).stars
    colour = np.where(np.isnan(stars.colour), 0.82, stars.colour)
    return stars.direction, red(stars.magnitude_g, colour), colour


def red(magnitude_g: Floats, colour: Floats) -> Floats:
    """Gaia's RP from G and BP - RP, within some 0.03 mag from -0.3 to 2.5."""
    return magnitude_g - 0.62 * colour + 0.03 * colour**2


def green(magnitude_rp: Floats, colour: Floats) -> Floats:
    """G from RP and BP - RP."""
    return magnitude_rp + 0.62 * colour - 0.03 * colour**2


def field(ra: float, dec: float, roll: float, width: float, height: float) -> tuple[Floats, Floats]:
    """RP and BP - RP of the stars in a rectangle of the sky; all in degree."""
    direction, magnitude, colour = _stars()
    a, d, r = ra * deg, dec * deg, roll * deg
    z = np.array([math.cos(d) * math.cos(a), math.cos(d) * math.sin(a), math.sin(d)])
    x = np.array([-math.sin(a), math.cos(a), 0.0])
    y = np.cross(z, x)
    ahead = direction @ z
    plane = np.stack([direction @ x, direction @ y]) / np.where(ahead > 0.1, ahead, np.nan)
    turned = np.array([[math.cos(r), math.sin(r)], [-math.sin(r), math.cos(r)]]) @ plane
    half = np.tan(np.array([width, height]) * deg / 2)
    inside = (np.abs(turned) < half[:, None]).all(0)
    return magnitude[inside], colour[inside]


def counted(magnitude: Floats, chance: Callable[[Floats], Floats]) -> float:
    """Number of detected stars, by a probability over RP; includes stars below the catalogue's
    limit.

    Beyond the last magnitude of the catalogue the number of stars grows by GROWTH.
    """
    end = LIMIT_G - 0.9  # RP; the catalogue is complete to it for usual colours
    inside = magnitude < end
    edges = np.arange(end, end + 5, 0.25)
    last = max(float(((magnitude > end - 1.5) & inside).sum()), 0.5)
    first = last / (1 - GROWTH**-1.5) * (GROWTH**0.25 - 1)
    fainter = first * GROWTH ** (edges - end)
    return float(chance(magnitude[inside]).sum() + (fainter * chance(edges + 0.125)).sum())


def passes(magnitude: Floats, limit: float, width: float = 0.3) -> Floats:
    """Probability of detection near a limiting magnitude."""
    return np.asarray(ndtr((limit - magnitude) / width))


def line_of_sight(latitude: float, sidereal: float, elevation: float, azimuth: float) -> Floats:
    """Right ascension and declination, degree, of a line of sight; all in degree."""
    la, el, az = latitude * deg, elevation * deg, azimuth * deg
    sine = math.sin(la) * math.sin(el) + math.cos(la) * math.cos(el) * math.cos(az)
    hour = math.atan2(
        -math.sin(az) * math.cos(el),
        math.cos(la) * math.sin(el) - math.sin(la) * math.cos(el) * math.cos(az),
    )
    return np.array([(sidereal - hour / deg) % 360, math.asin(sine) / deg])


def apart(elevation: float, sun: float, azimuth: float) -> float:
    """Degree between a line of sight and the Sun, from elevations and the azimuth between them."""
    e, s, a = elevation * deg, sun * deg, azimuth * deg
    cosine = math.sin(e) * math.sin(s) + math.cos(e) * math.cos(s) * math.cos(a)
    return math.acos(min(max(cosine, -1.0), 1.0)) / deg


def lit_from(draw: Draw, elevation: float, sun: float, distance: float) -> float:
    """Electrons of the sky in a pixel; angles in degree."""
    assert isinstance(draw.case.scene.sky, DaySky)
    return draw.sky(elevation=elevation * deg, sun_elevation=sun * deg, sun_distance=distance * deg)
