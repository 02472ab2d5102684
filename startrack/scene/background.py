"""Directions -> zodiacal light, and the light of stars below the catalogue's limit."""

from functools import lru_cache

import numpy as np

from startrack.core import GALACTIC_POLE, Floats, deg
from startrack.scene.photometry import SUN, SUN_G_MINUS_V, WAVELENGTH, photon_irradiance

# Leinert et al. (1998), A&A Supplement Series 127, 1, table 17: seen from the Earth at 500 nm, in
# 1e-8 W / m^2 / sr / um; the pole is that of section 8.3. Zero where the table is empty.
S10 = 1.28  # of these units: one star of V = 10 and the Sun's colour per square degree
LONGITUDE = (0, 5, 10, 15, 20, 25, 30, 35, 40, 45, 60, 75, 90, 105, 120, 135, 150, 165, 180)
LATITUDE = (0, 5, 10, 15, 20, 25, 30, 45, 60, 75, 90)
TABLE = (
    (0, 0, 0, 3140, 1610, 985, 640, 275, 150, 100, 77),
    (0, 0, 0, 2940, 1540, 945, 625, 271, 150, 100, 77),
    (0, 0, 4740, 2470, 1370, 865, 590, 264, 148, 100, 77),
    (11500, 6780, 3440, 1860, 1110, 755, 525, 251, 146, 100, 77),
    (6400, 4480, 2410, 1410, 910, 635, 454, 237, 141, 99, 77),
    (3840, 2830, 1730, 1100, 749, 545, 410, 223, 136, 97, 77),
    (2480, 1870, 1220, 845, 615, 467, 365, 207, 131, 95, 77),
    (1650, 1270, 910, 680, 510, 397, 320, 193, 125, 93, 77),
    (1180, 940, 700, 530, 416, 338, 282, 179, 120, 92, 77),
    (910, 730, 555, 442, 356, 292, 250, 166, 116, 90, 77),
    (505, 442, 352, 292, 243, 209, 183, 134, 104, 86, 77),
    (338, 317, 269, 227, 196, 172, 151, 116, 93, 82, 77),
    (259, 251, 225, 193, 166, 147, 132, 104, 86, 79, 77),
    (212, 210, 197, 170, 150, 133, 119, 96, 82, 77, 77),
    (188, 186, 177, 154, 138, 125, 113, 90, 77, 74, 77),
    (179, 178, 166, 147, 134, 122, 110, 90, 77, 73, 77),
    (179, 178, 165, 148, 137, 127, 116, 96, 79, 72, 77),
    (196, 192, 179, 165, 151, 141, 131, 104, 82, 72, 77),
    (230, 212, 195, 178, 163, 148, 134, 105, 83, 72, 77),
)
REFERENCE = 500e-9  # metre
# The same, section 8.5: colour at an elongation of 90 degrees, per decade of wavelength.
BLUE, RED = 0.9, 0.6
# The same, section 8.2: brightness falls with the distance from the Sun, and towards it rises with
# elongation^-2.3, which here is continued inside the innermost ring of the table.
FALL = 2.3
INNER, INNERMOST = 15 * deg, 2.5 * deg
OBLIQUITY = 23.43928 * deg  # of the ecliptic, J2000
POLE = np.array([0.0, -np.sin(OBLIQUITY), np.cos(OBLIQUITY)])
# Light of the stars towards the galactic poles in each whole magnitude G, in stars of G = 10 per
# square degree. G 4 to 10: counted in Gaia DR3 and Hipparcos beyond 70 degrees of latitude.
# Brighter: from the counts within 5 degrees of the plane, where such stars are many. Fainter: its
# fall from magnitude to magnitude by the disk of Bahcall and Soneira (1980), Astrophysical
# Journal Supplement 44, 73, eq. (B1).
FIRST, LAST = 0.0, 24.0
COUNTED = (1.5, 2.0, 2.6, 3.0, 3.56, 4.55, 5.44, 4.90, 4.84, 4.32)
# Sine of the latitude below which dust limits the brightness of the plane; fitted to the counts of
# all belts of latitude.
DUST = 0.2
# Starlight that dust scatters, over the starlight: Leinert et al. (1998), A&A Supplement Series
# 127, 1, section 11.2.
SCATTERED = 0.25
TEMPERATURE = 4800.0  # kelvin, of a blackbody with the mean star's colour


def zodiacal(direction: Floats, sun: Floats, sun_distance: float = 1.0) -> Floats:
    """Brightness of the zodiacal light.

    direction     (n, 3) unit vectors, ICRS axes
    sun           (3,) unit vector to the Sun
    sun_distance  astronomical unit from the observer to the Sun
    Returns       (n,) stars of V = 10 and the Sun's colour per square degree (S10)
    Accuracy      model: 10 % beyond 30 degrees from the Sun; the ecliptic replaces the plane of
                  symmetry, which is inclined by 2 degrees; a factor of two inside 15 degrees;
                  constant inside 2.5. numerical: linear interpolation of the table's logarithm.
    """
    elongation = np.arccos(np.clip(direction @ sun, -1, 1))
    latitude = np.arcsin(np.clip(np.abs(direction @ POLE), 0, 1))
    longitude = np.abs(_longitude(direction, sun))
    outside = _beyond(longitude / deg, latitude / deg)
    turn = np.arctan2(latitude, longitude)
    inside = _ring(turn) * (INNER / np.maximum(elongation, INNERMOST)) ** FALL
    return np.where(elongation < INNER, inside, outside) / S10 * sun_distance**-FALL


@lru_cache(maxsize=1)
def zodiacal_spectrum() -> Floats:
    """Photon / s / m^2 / sr in each bin of WAVELENGTH, for a brightness of one S10.

    Sunlight, a little redder. Source: Leinert et al. (1998), eq. (22).
    """
    decade = np.log10(WAVELENGTH / REFERENCE)
    redder = 1 + np.where(decade < 0, BLUE, RED) * decade
    return photon_irradiance(np.array([10 + SUN_G_MINUS_V]), np.array([SUN]))[0] / deg**2 * redder


def _longitude(direction: Floats, sun: Floats) -> Floats:
    """Ecliptic longitude from the Sun, radian."""
    along = sun - (sun @ POLE) * POLE
    side = np.cross(POLE, along)
    return np.arctan2(direction @ side, direction @ along)


def _beyond(longitude: Floats, latitude: Floats) -> Floats:
    """The table, interpolated; arguments in degrees."""
    column = np.clip(np.searchsorted(LATITUDE, latitude, "right") - 1, 0, len(LATITUDE) - 2)
    row = np.clip(np.searchsorted(LONGITUDE, longitude, "right") - 1, 0, len(LONGITUDE) - 2)
    high, low = np.array(LATITUDE), np.array(LONGITUDE)
    x = (latitude - high[column]) / (high[column + 1] - high[column])
    y = (longitude - low[row]) / (low[row + 1] - low[row])
    table = _logarithms()
    upper = (1 - x) * table[row, column] + x * table[row, column + 1]
    lower = (1 - x) * table[row + 1, column] + x * table[row + 1, column + 1]
    return np.exp((1 - y) * upper + y * lower)


@lru_cache(maxsize=1)
def _logarithms() -> Floats:
    """Logarithms of the table, its empty corner filled by the power law towards the Sun."""
    table = np.array(TABLE, float)
    for row, column in np.argwhere(table == 0):
        turn = np.arctan2(LATITUDE[column], LONGITUDE[row])
        away = max(np.hypot(LATITUDE[column], LONGITUDE[row]) * deg, INNERMOST)
        table[row, column] = _ring(turn) * (INNER / away) ** FALL
    return np.log(table)


def _ring(turn: Floats) -> Floats:
    """Brightness at 15 degrees from the Sun, over the angle from the ecliptic.

    From the seven values of the table near this distance.
    """
    near = [(15, 0), (15, 5), (15, 10), (10, 10), (10, 15), (5, 15), (0, 15)]
    angle = [np.arctan2(b, a) for a, b in near]
    value = [
        TABLE[LONGITUDE.index(a)][LATITUDE.index(b)] * (np.hypot(a, b) * deg / INNER) ** FALL
        for a, b in near
    ]
    return np.exp(np.interp(turn, angle, np.log(value)))


def starlight(direction: Floats, limit_g: float) -> Floats:
    """Brightness of stars below a catalogue's limit, and of dust lit by all stars.

        light(G, b) = light(G + 5 log10 s, pole) / s,   s^2 = sin(b)^2 + 0.2^2

    This is exact for a plane layer of stars without dust: at a low latitude b, more and farther
    stars are visible.

    direction  (n, 3) unit vectors, ICRS axes
    limit_g    G of the faintest star of the catalogue
    Returns    (n,) stars of G = 10 per square degree
    Accuracy   model: mean over galactic longitude; 15 % of the counts of the belts of latitude down
               to G 10, 30 % beyond; clouds and rifts of the Milky Way a factor of two.
    """
    step = np.hypot(direction @ GALACTIC_POLE, DUST)
    edge, light = _fainter()
    faint = np.interp(limit_g + 5 * np.log10(step), edge, light)
    return (faint + SCATTERED * light[0]) / step


@lru_cache(maxsize=1)
def starlight_spectrum() -> Floats:
    """Photon / s / m^2 / sr in each bin, for one star of G = 10 per square degree."""
    return photon_irradiance(np.array([10.0]), np.array([TEMPERATURE]))[0] / deg**2


@lru_cache(maxsize=1)
def _fainter() -> tuple[Floats, Floats]:
    """Magnitudes, and the light of all fainter stars towards the pole."""
    light = list(COUNTED)
    while FIRST + len(light) < LAST:
        light.append(light[-1] * 10 ** (_growth(FIRST + len(light)) - 0.4))
    below = np.append(np.cumsum(light[::-1])[::-1], 0.0)
    return FIRST + np.arange(len(below), dtype=np.float64), below


def _growth(magnitude: float) -> float:
    """Decimal logarithm of the growth of the number of disk stars from a magnitude to the next."""
    x = 10 ** (-0.132 * (magnitude - 15.75))
    return 0.035 + 0.132 * 3.0 * x / (1 + x)
