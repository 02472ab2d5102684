"""Orbit, shielding, years and a family of detectors -> radiation damage of their pixels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from startrack import core
from startrack.core import (
    NON_NEGATIVE,
    POSITIVE,
    YEAR,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    within,
)
from startrack.space import solar_protons, trapped_electrons, trapped_protons

# Trapped protons in a circular orbit at 550 km for five years: AP-8 at solar minimum, SHIELDOSE-2,
# silicon at the centre of spheres of aluminium. Computed with SPENVIS 4.6 by T. Pfandzelter
# (github.com/pfandzelter/leo-edge-failure-models, compute-failure/results; MIT licence).
ALTITUDE = 550e3  # metre
INCLINATION = np.radians([0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0])
THICKNESS = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0]) * 1e-3  # metre
PROTON_RAD = np.array([  # rad / yr in silicon, of each inclination
    [1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3],
    [105.0, 80.3, 66.9, 52.8, 45.8, 39.3, 32.9, 26.7],
    [411.4, 357.0, 323.8, 285.8, 263.8, 238.6, 212.5, 181.6],
    [537.5, 383.7, 323.8, 269.6, 241.4, 212.9, 186.3, 155.3],
    [345.4, 243.8, 205.7, 171.4, 153.4, 135.3, 118.3, 98.7],
    [289.0, 207.9, 176.5, 147.9, 132.7, 117.1, 102.4, 85.6],
    [264.8, 191.0, 162.5, 136.3, 122.4, 108.1, 94.6, 79.1],
])  # fmt: skip
RAD_MEV = 6.2415e7  # MeV / g
# Ratio of non-ionising to ionising energy loss in silicon, for the protons of about 50 MeV that
# remain behind a few millimetres: 3.9e-3 over 10 MeV cm2 / g. From 30 to 100 MeV it is 3.1e-4 to
# 4.5e-4. Assumed: quoted from memory of the tables of PSTAR and of Jun et al. (2003).
NON_IONISING = 3.9e-4


def proton_dose(inclination: float, shielding: float) -> float:
    """Dose of trapped protons in silicon, rad in a year at 550 km.

    Interpolated linearly in inclination and in the logarithms of thickness and dose. A retrograde
    orbit has the dose of the inclination 180 degrees minus its own.

    inclination  radian
    shielding    metre of aluminium all around
    Raises    ValueError outside 0 to 180 degrees, or 1 to 20 mm.
    Accuracy  between the nodes 8 %; AP-8 itself within a factor of two.
    """
    within(0.0, math.pi, inclination=inclination)
    within(float(THICKNESS[0]), float(THICKNESS[-1]), shielding=shielding)
    at = min(inclination, math.pi - inclination)
    columns = [np.interp(at, INCLINATION, column) for column in PROTON_RAD.T]
    return float(np.exp(np.interp(math.log(shielding), np.log(THICKNESS), np.log(columns))))


def orbit_dose(altitude: float, inclination: float, shielding: float, events: float) -> float:
    """Ionising dose of the belts and of solar events, rad in a year in a circular orbit.

    Protons by `protons_dose`, electrons and their bremsstrahlung by `trapped_electrons`.

    Arguments and exceptions are those of `protons_dose`; also ImportError without radbelt at 550
    km.

    Accuracy  AE-8 and AP-8 within a factor of two; the dose of their spectra within 10 % of
              SHIELDOSE-2 if electrons or protons dominate. SHIELDOSE-2 has 1.6 times as much
              bremsstrahlung, which dominates in high orbits behind 7 mm or more (docs/mission.md).
    """
    dose = protons_dose(altitude, inclination, shielding, events)
    electrons = trapped_electrons(altitude, inclination).behind(shielding)
    return dose + YEAR * (electrons.loss + electrons.photons) / RAD_MEV


def orbit_damage(altitude: float, inclination: float, shielding: float, events: float) -> float:
    """Equivalent fluence: protons of 10 MeV / cm^2 / year that displace the same number of atoms.

    It is the `damage_fluence` of the proton dose plus, except at 550 km, the damage by trapped
    electrons. At 550 km in a polar orbit, electrons would add 3 % behind 5 mm and 11 % behind 3 mm.

    Arguments and exceptions are those of `protons_dose`.

    Accuracy  30 % by the energy losses; behind 1 mm at 550 km it is 25 % less than with electrons.
    """
    fluence = damage_fluence(protons_dose(altitude, inclination, shielding, events), NIEL)
    if altitude == ALTITUDE:
        return fluence
    electrons = trapped_electrons(altitude, inclination).behind(shielding)
    return fluence + YEAR * electrons.displaced / NIEL


def protons_dose(altitude: float, inclination: float, shielding: float, events: float) -> float:
    """Dose of protons of the belts and of solar events, rad in a year in a circular orbit.

    At 550 km without events it follows from the table of `proton_dose`, otherwise from
    `trapped_protons` and `solar_protons`.

    altitude, shielding  metre
    inclination  radian
    events    number of anomalously large solar events in a year
    Raises    ImportError without radbelt; ValueError as for `proton_dose`.
    Accuracy  as for these functions. At 550 km and inclinations above 15 degrees, `trapped_protons`
              is 5 to 26 % below the table.
    """
    if altitude == ALTITUDE:
        dose = proton_dose(inclination, shielding)
    else:
        within(float(THICKNESS[0]), float(THICKNESS[-1]), shielding=shielding)
        dose = YEAR * trapped_protons(altitude, inclination).behind(shielding)[1]
    if events:
        dose += events * solar_protons(altitude, inclination).behind(shielding)[1]
    return dose


def damage_fluence(dose: float, niel: float) -> float:
    """Equivalent fluence: protons of 10 MeV / cm^2 / year that displace the same number of atoms.

    dose      rad in a year, ionising dose of protons in silicon behind the shield
    niel      MeV cm^2 / g, non-ionising energy loss of protons of 10 MeV
    Accuracy  30 % by the ratio of energy losses, for protons of 30 to 100 MeV.
    """
    return dose * RAD_MEV * NON_IONISING / niel


ELECTRON_VOLT = 1.602176634e-19  # joule
SQUARE_CM, CUBIC_CM = 1e-4, 1e-6
RAD = 0.01  # gray

# Damage factor of the family "interactions": 1.9e5 (+- 0.6e5) electron / s / cm^3 for 1 MeV / g, at
# 300 K a week after the irradiation. Srour and Lo (2000), Universal damage factor for
# radiation-induced dark current in silicon devices, IEEE Transactions on Nuclear Science 47, 2451.
DAMAGE_FACTOR = 1.9e5
DAMAGE_KELVIN = 300.0
DAMAGE_ACTIVATION = 0.63 * ELECTRON_VOLT  # the same authors: 0.63 eV for most devices
NIEL = 7.9e-3  # MeV cm^2 / g, non-ionising energy loss of protons of 10 MeV in silicon


class TailLaw(NamedTuple):
    """Histogram of the dark current of a detector in flight, and its growth with the years.

        n(I) = a (I / I_r)^-g_k between breaks I_k,   number of pixels per unit of ln I

    n is convolved over ln I with a truncated normal distribution. a, g_1, g_2, g_3 and I_1 are each
    given by a value at `middle`, and slopes per year before and after it.

    density         1, a over the number of all pixels
    slopes          g_1, g_2, g_3
    knee            electron / s, I_1
    second          electron / s, I_2
    at              electron / s, I_r
    offsets, weights  steps of ln I and fractions of the convolution
    middle          years since launch
    lowest          electron / s, below which n is zero before the convolution
    kelvin          temperature of the law
    electrons       1, electrons of a detector for one electron of the law
    """

    density: tuple[float, float, float]
    slopes: tuple[tuple[float, float, float], ...]
    knee: tuple[float, float, float]
    second: float
    at: float
    offsets: tuple[float, ...]
    weights: tuple[float, ...]
    middle: float
    lowest: float
    kelvin: float
    electrons: float = 1.0


BIN = math.log(10) / 20  # bin of the fit: 20 bins per decade
SMOOTHING = [math.exp(-0.5 * ((-0.75 + 0.1 * n) / 0.3) ** 2) for n in range(15)]
# Fit by the aspect camera's team to its dark maps of January 2007 to August 2017, scaled to
# -14 degC: chandra_aca, dark_model.py (BSD 3-clause, Smithsonian Astrophysical Observatory).
# Pixels of 1024 x 1024 in a bin; the launch was in 1999.56, the middle year is 2012.0. It uses 5
# electrons per number; photon transfer of pixels in flight gives 5.9 (docs/figures/flight.md).
CHANDRA_ACA = TailLaw(
    density=(18400 / BIN / 2**20, 1450 / BIN / 2**20, 742 / BIN / 2**20),
    slopes=((0.075, -0.00692, -0.0207), (3.32, 0.0203, 0.0), (2.40, 0.061, 0.061)),
    knee=(192.0, 0.1, 0.1),
    second=1000.0,
    at=50.0,
    offsets=tuple(BIN * (n - 7) for n in range(15)),
    weights=tuple(one / sum(SMOOTHING) for one in SMOOTHING),
    middle=12.44,
    lowest=2.0,
    kelvin=core.ZERO_CELSIUS - 14,
    electrons=5.9 / 5,
)
TAILS = {"chandra-aca": CHANDRA_ACA}
FAMILIES = ("interactions", *TAILS)
HIGHEST = 1e6  # electron / s, end of the tables of tails
TABLE = 4000  # number of entries of these tables
MANY = 1e4  # mean number of events, above which no table of probabilities is made


class Flicker(Parameters):
    """Pixels whose dark current jumps at random (random telegraph signal).

    The current of a pixel above `least` jumps at the times of a Poisson process. It becomes the
    pixel's mean times 10^s:

        P(s < x) = down exp(x / w)          x < 0
                   1 - (1 - down) exp(-x / w)   x >= 0,    w = step / (1 + (I / current)^power)

    Source: our own formula; its four numbers are fitted to the published laws of Chandra's aspect
    camera in five of nine bins of dark current (50 to 100, 200 to 300, 400 to 500, 600 to 800 and
    above 1000 electron / s). The dwell time is published (chandra_aca, aca_image.py).
    """

    down: float = parameter(
        "fraction of the jumps below the mean", limit=Range(0, 1), default=0.448
    )
    step: float = parameter(
        "scale of the jumps of the coldest pixels, in decades", limit=POSITIVE, default=0.117
    )
    current: float = parameter(
        "electron / second, dark current at which the scale is half of `step`",
        unit=Unit("electron / s"),
        limit=POSITIVE,
        default=344.0,
    )
    power: float = parameter(
        "exponent of the decrease of the scale with current", limit=POSITIVE, default=0.695
    )
    largest: float = parameter("decades, limit of a jump", limit=POSITIVE, default=0.35)
    least: float = parameter(
        "electron / second, least dark current of a pixel that flickers",
        unit=Unit("electron / s"),
        limit=NON_NEGATIVE,
        default=50.0,
    )
    dwell: float = parameter(
        "mean time between jumps", unit=Unit("s"), limit=POSITIVE, default=10e3
    )

    def scale(self, current: Floats) -> Floats:
        """Scale of the jumps, decades, of pixels with dark currents (electron / s)."""
        return np.asarray(self.step / (1 + (np.asarray(current) / self.current) ** self.power))

    def steps(self, current: Floats, uniform: Floats) -> Floats:
        """Decades (n,) of the jumps at quantiles (n,) of the law."""
        scale, u = self.scale(current), uniform
        with np.errstate(divide="ignore"):
            below = scale * np.log(u / self.down) if self.down else -np.inf * u
            above = -scale * np.log((1 - u) / (1 - self.down)) if self.down < 1 else np.inf * u
        step = np.where(u < self.down, below, above)
        return np.asarray(np.clip(step, -self.largest, self.largest))


class Age(Parameters):
    """Years in orbit, and the damage of the detector in these years.

    family "chandra-aca": the histogram of the dark current of Chandra's aspect camera (a
    front-illuminated CCD of 24 um in a high orbit behind its shield), as fitted in flight. The same
    pixels are hot at all ages; those below some thousand electron / s become hotter. Before 2007
    and after 2017 the histogram is extrapolated. It counts only damaged pixels, half of all in
    2007. The other pixels have the dark current at launch, `dark_current`, which is the lowest.

    family "interactions": protons displace atoms in the depleted silicon of a pixel. The number of
    interactions has a Poisson distribution. Each interaction adds a dark current from an
    exponential distribution. The mean increase is

        K NIEL fluence depleted volume,   K = 1.9e5 electron / s / cm^3 / (MeV / g) at 300 K

    Source: Srour and Lo (2000), IEEE Transactions on Nuclear Science 47, 2451, for the mean;
    Robbins (2000), ibid. 47, 2473, and Virmontois et al. (2012), ibid. 59, 927, for the exponential
    distribution, whose mean is published between some 3000 and 6000 electron / s at 296 K.
    """

    time: float | None = parameter(
        "second in orbit; None: from `year` and `launch`",
        unit=Unit("s", "yr"),
        limit=Range(0, 100 * YEAR),
        default=None,
    )
    year: float | None = parameter(
        "calendar year of the age, such as 2017.0", limit=Range(1950, 2150), default=None
    )
    launch: float | None = parameter(
        "calendar year of the launch, such as 1999.56", limit=Range(1950, 2150), default=None
    )
    family: str = parameter(
        '"interactions" or "chandra-aca"', limit=Range(choices=FAMILIES), default="interactions"
    )
    fluence: float = parameter(
        "equivalent protons of 10 MeV per square metre and second, behind the shield; for the "
        'family "interactions"',
        unit=Unit("m-2 / s", "cm-2 / yr"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    inclination: float | None = parameter(
        "inclination of a circular orbit, from which the fluence of trapped particles follows",
        unit=Unit("rad", "deg"),
        default=None,
    )
    altitude: float = parameter(
        "altitude of this orbit; at 550 km a table of protons alone is used, other altitudes need "
        "the extra `radiation`",
        unit=Unit("m", "km"),
        limit=Range(150e3, 4e7),
        default=ALTITUDE,
    )
    solar_events: float = parameter(
        "number per year of anomalously large solar events, such as August 1972, whose protons are "
        "added (extra `radiation`); from 1964 to 1972 there was one in an active period of seven "
        "years",
        unit=Unit("s-1", "yr-1"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    shielding: float | None = parameter(
        "thickness of aluminium around the detector in this orbit",
        unit=Unit("m", "mm"),
        limit=Range(float(THICKNESS[0]), float(THICKNESS[-1])),
        default=None,
    )
    dose: float | None = parameter(
        "gray / second, ionising dose of protons in silicon behind the shield, from which the "
        "fluence follows; for any orbit, solar protons included, as SPENVIS computes it by the "
        "models of ECSS-E-ST-10-04C",
        unit=Unit("Gy / s", "krad / yr"),
        limit=NON_NEGATIVE,
        default=None,
    )
    depleted: float = parameter(
        "depth of the silicon whose damage causes dark current; for the same family",
        unit=Unit("m", "um"),
        limit=POSITIVE,
        default=10e-6,
    )
    interaction: float = parameter(
        "electron / second, mean dark current of an interaction at 296 K; for the same family",
        unit=Unit("electron / s"),
        limit=POSITIVE,
        default=4000.0,
    )
    annealed: float = parameter(
        "fraction of the damage's dark current that annealing has removed",
        limit=Range(0, 1),
        default=0.0,
    )
    flicker: Flicker | None = parameter(
        "pixels with random telegraph signal; None: none flicker", default=None
    )
    sensitivity_loss: float = parameter(
        "fraction of the light lost per year: glass darkens, quantum efficiency decreases",
        unit=Unit("s-1", "yr-1"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    transfer_loss: float = parameter(
        "growth per year of the fraction of charge that a CCD leaves behind in a transfer from row "
        "to row. This charge is read with the next row. The first row is read first",
        unit=Unit("s-1", "yr-1"),
        limit=Range(0, 1e-3 / YEAR),
        default=0.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.time is None) == (self.year is None) or (self.year is None) != (
            self.launch is None
        ):
            raise Refused("time must be given, or year and launch; not both")
        if self.year is not None and self.launch is not None and self.year < self.launch:
            raise Refused(f"year must not be before launch = {self.launch}, got {self.year}")
        if (self.inclination is None) != (self.shielding is None):
            raise Refused("inclination and shielding must be given together, or neither")
        if self.inclination is None and (self.altitude != ALTITUDE or self.solar_events):
            raise Refused("altitude and solar_events must be left out without inclination")
        if self.inclination is not None and self.fluence:
            raise Refused("fluence must be left out if inclination and shielding give it")
        if self.dose is not None and (self.inclination is not None or self.fluence):
            raise Refused("dose must be left out if fluence, inclination or shielding is given")
        given = self.fluence or self.dose or self.inclination is not None
        if given and self.family != "interactions":
            raise Refused("fluence must be left out for a family with its own law")

    @property
    def protons(self) -> float:
        """Equivalent protons of 10 MeV per square metre and second; see `orbit_damage`."""
        if self.dose is not None:
            fluence = damage_fluence(self.dose * YEAR / RAD, NIEL)
        elif self.inclination is None or self.shielding is None:
            return self.fluence
        else:
            events = self.solar_events * YEAR
            fluence = orbit_damage(self.altitude, self.inclination, self.shielding, events)
        return fluence / SQUARE_CM / YEAR

    @property
    def ionising(self) -> float:
        """Ionising dose in silicon in the given orbit, gray / second; see `orbit_dose`.

        Raises  Refused if no orbit is given.
        """
        if self.inclination is None or self.shielding is None:
            raise Refused("age must have inclination and shielding, from which its dose follows")
        orbit = self.altitude, self.inclination, self.shielding, self.solar_events * YEAR
        return orbit_dose(*orbit) * RAD / YEAR

    @property
    def years(self) -> float:
        """Years in orbit."""
        if self.year is not None and self.launch is not None:
            return self.year - self.launch
        return float(self.time or 0.0) / YEAR

    @property
    def undamaged(self) -> Age:
        """The same years without displaced atoms; the losses of light and in transfers stay."""
        return Age(
            time=self.years * YEAR if self.time is None else self.time,
            sensitivity_loss=self.sensitivity_loss,
            transfer_loss=self.transfer_loss,
        )

    @property
    def sensitivity(self) -> float:
        """1, detected light over the detected light at launch."""
        return math.exp(-self.sensitivity_loss * self.years * YEAR)

    @property
    def deferred(self) -> float:
        """1, fraction of the charge that a transfer leaves for the next row."""
        return self.transfer_loss * self.years * YEAR

    def of_map(self, years: float) -> Age:
        """The detector as it was after some years in orbit, when its dark map was made."""
        return replace(self, time=years * YEAR, year=None, launch=None, flicker=None)


def pixels_above(law: TailLaw, current: Floats, years: float) -> Floats:
    """Fraction of the pixels with a larger dark current, of any number of currents.

    current  electron / second of the law, at its temperature
    years    since launch
    """
    after = years - law.middle
    a, (g1, g2, g3), knee = (
        _at(law.density, after),
        [_at(slope, after) for slope in law.slopes],
        _at(law.knee, after),
    )
    a, second, r = max(a, 0.0), law.second, law.at
    a2 = a * (knee / r) ** (g2 - g1)
    a3 = a2 * (second / r) ** (g3 - g2)
    total = np.zeros(np.shape(current))
    for offset, weight in zip(law.offsets, law.weights, strict=True):
        x = np.maximum(np.asarray(current, float) * math.exp(-offset), law.lowest)
        part = a3 * (np.maximum(x, second) / r) ** -g3 / g3
        part = part + a2 * _power_integral(np.clip(x, knee, second) / r, second / r, g2)
        total += weight * (part + a * _power_integral(np.minimum(x, knee) / r, knee / r, g1))
    return np.minimum(total, 1.0)


def _at(line: tuple[float, float, float], after: float) -> float:
    return line[0] + line[1 if after < 0 else 2] * after


def _power_integral(low: Floats, high: float, slope: float) -> Floats:
    """Integral of x^-slope over ln x."""
    if abs(slope) < 1e-9:
        return np.log(high / low)
    return np.asarray((low**-slope - high**-slope) / slope)


def tail_currents(law: TailLaw, quantile: Floats, years: float) -> Floats:
    """Dark current of each pixel, electron / second of a detector at the law's temperature.

    quantile  1, fraction of the pixels with a larger current
    Returns   0 for pixels that the law does not count
    Accuracy  numerical: 1e-4 of the current.
    """
    grid = np.geomspace(law.lowest, HIGHEST, TABLE)
    above = pixels_above(law, grid, years)
    with np.errstate(divide="ignore"):
        rank = np.log(above)[::-1]
    current = np.exp(np.interp(np.log(quantile), rank, np.log(grid)[::-1]))
    return np.where(quantile < above[0], law.electrons * current, 0.0)


def growth_of(activation: float, kelvin: float, reference: float) -> float:
    """Dark current over that at a reference, with an activation energy (joule)."""
    return math.exp(-activation / core.BOLTZMANN * (1 / kelvin - 1 / reference))


def damage(
    shape: tuple[int, int], age: Age, area: float, kelvin: float, device: core.Streams
) -> Floats:
    """Dark current that interactions add to each pixel, electron / second at a temperature.

    area      square metre, of a pixel
    Accuracy  model: independent interactions, each at the level of one week after it happened.
    """
    mean_rate = mean_damage(age, area, kelvin)
    single = age.interaction * growth_of(DAMAGE_ACTIVATION, kelvin, 296.0)
    if not single:  # an interaction is below the smallest float: all pixels are equal
        return np.full(shape, mean_rate)
    number, size = device("displaced atoms").random((2, *shape))
    expected = mean_rate / single
    current = np.zeros(shape)
    hit = number > math.exp(-expected)  # above the probability of no event; most pixels have none
    events, chance = np.maximum(_poisson_quantile(number[hit], expected), 1.0), size[hit]
    amount = -np.log1p(-chance)  # of one event
    several = events > 1
    amount[several] = special.gammaincinv(events[several], chance[several])
    current[hit] = single * amount
    return current


def _poisson_quantile(chance: Floats, mean: float) -> Floats:
    """The least number of events (n,) whose cumulative probability is not below a chance (n,)."""
    if not (mean and len(chance)):
        return np.zeros(len(chance))
    if mean > MANY:  # too many numbers for a table
        return np.ceil(special.pdtrik(chance, mean))
    most = math.ceil(special.pdtrik(chance.max(), mean))
    return np.searchsorted(special.pdtr(np.arange(most), mean), chance).astype(float)


def mean_damage(age: Age, area: float, kelvin: float) -> float:
    """Mean of `damage` over the pixels."""
    mean = (
        DAMAGE_FACTOR
        * NIEL
        * (age.protons * age.years * YEAR * SQUARE_CM)
        * (area * age.depleted / CUBIC_CM)
        * (1 - age.annealed)
    )
    return mean * growth_of(DAMAGE_ACTIVATION, kelvin, DAMAGE_KELVIN)


def typical(base: float, age: Age, area: float, kelvin: float, to: float) -> float:
    """Dark current of a typical pixel: the median for a tail law, the mean for interactions.

    Arguments as for `aged`.
    """
    law = TAILS.get(age.family)
    if law is None:
        return base + mean_damage(age, area, kelvin)
    median = float(tail_currents(law, np.array([0.5]), age.years)[0])
    return max(base, median * to * (1 - age.annealed))


def aged(
    base: Floats, age: Age, area: float, kelvin: float, to: float, device: core.Streams
) -> Floats:
    """Dark current of each pixel at an age, electron / second at the reference of the detector.

    base    (rows, columns) electron / second, at launch
    area    square metre, of a pixel
    kelvin  reference temperature of the detector
    to      1, dark current at this reference over dark current at a tail law's temperature
    """
    shape = (base.shape[0], base.shape[1])
    law = TAILS.get(age.family)
    if law is None:
        return base + damage(shape, age, area, kelvin, device)
    rank = device("dark current in flight").random(shape)
    return np.maximum(base, tail_currents(law, rank, age.years) * to * (1 - age.annealed))


class Flickering:
    """The pixels of a device that flicker, and their state in time.

    A state begins at random; `later` lets time pass.
    """

    def __init__(self, law: Flicker, current: Floats, streams: core.Streams) -> None:
        """Begin with random states.

        current  (rows, columns) electron / second, mean of each pixel
        """
        self.law, self._draw = law, streams("flickering pixels")
        self.pixel = np.flatnonzero(current > law.least)
        self.mean = current.ravel()[self.pixel]
        self.step = law.steps(self.mean, self._draw.random(len(self.mean)))

    def later(self, time: float) -> None:
        """Let some seconds pass; the state after a jump does not depend on the state before it."""
        jumps = self._draw.random(len(self.mean)) < -math.expm1(-time / self.law.dwell)
        chosen = np.flatnonzero(jumps)
        self.step[chosen] = self.law.steps(self.mean[chosen], self._draw.random(len(chosen)))

    def add_to(self, electrons: Floats, exposure: float) -> Floats:
        """Expected electrons (rows, columns), changed from mean to present dark currents."""
        changed = electrons.copy()
        changed.ravel()[self.pixel] += self.mean * (10**self.step - 1) * exposure
        return changed


def trailed(electrons: Floats, deferred: float, first_row: int = 0) -> Floats:
    """Charge after its transfers to row -1; each transfer leaves a fraction for the next row.

    first_row  number of transfers of the charge of the first row before the read-out
    Accuracy  model: charge that was left behind is not left behind again. Valid for fractions below
              0.1.
    """
    transfers = first_row + 1 + np.arange(len(electrons))[:, None]
    left = -np.expm1(transfers * math.log1p(-deferred)) * electrons
    moved = electrons - left
    moved[1:] += left[:-1]
    return moved
