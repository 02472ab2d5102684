"""Requirements on a design: limits of errors, mass, power, volume and cost, with cost models."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from scipy import special

from startrack import core
from startrack.core import NON_NEGATIVE, POSITIVE, Parameters, Range, Refused, Unit, parameter
from startrack.design.case import Case
from startrack.design.objective import AXES, KINDS, Objective
from startrack.metrics import ErrorLimits
from startrack.optics import Optics, Surfaces, element_count, full_surfaces

BARREL = 3.7  # mass of a lens with its barrel over the mass of its glass
WALL = 1.96  # outer diameter over the largest clear diameter
HOUSING = 1.26  # length of the housing to the detector, over the path of the rays
# Price of a lens: PRICE (mass / PRICED)^STEEP, price in dollar of 2010, mass in kilogram.
PRICE, PRICED, STEEP = 270.0, 0.24, 1.6


class LensCost(NamedTuple):
    """Mass, volume and price of a lens.

    elements  number of lens elements and mirrors; not rounded for a lens family
    mass      kilogram, with the barrel
    volume    cubic metre, of the cylinder around lens and detector
    price     dollar of 2010, price of a camera lens made in series
    """

    elements: float
    mass: float
    volume: float
    price: float


def lens_cost(optics: Optics) -> LensCost | None:
    """Mass, volume and price of a lens of a family or of a lens table.

        mass   = 3.7 glass * elements / elements of the published lens
        volume = pi / 4 (1.96 largest clear diameter)^2 * 1.26 length to the detector
        price  = 270 (mass / 0.24 kg)^1.6

    The mass of the glass follows from the prescription, scaled to the design's focal length. In a
    lens family, the clear apertures are those that the beams need at the design's f-number. The
    three factors of mass and volume are medians over nine camera lenses. The price is a fit to five
    of them. docs/figures/lens-costs.md lists these lenses.

    Returns   None if the surfaces of the lens are unknown
    Accuracy  model: measured over predicted mass is 0.5 (barrel of plastic) to 1.8 (brass), volume
              0.5 to 1.4, price 0.5 to 3.1. All nine are double Gauss lenses made in series. A lens
              for space costs about a hundred times as much, so that only ratios of prices count.
    """
    surfaces = full_surfaces(optics)  # stopped down, it is as large as before
    if surfaces is None:
        return None
    elements: float = len(surfaces.elements)
    if optics.lens_family:
        elements = element_count(optics.lens_family, optics.f_number, optics.family_field)
    return cost_of(surfaces, elements)


def cost_of(surfaces: Surfaces, elements: float) -> LensCost:
    """Mass, volume and price of a lens, by its surfaces and a number of elements."""
    more = elements / max(len(surfaces.elements), 1)
    mass = BARREL * surfaces.glass_mass() * more
    width = WALL * 2 * float(surfaces.radius.max())
    volume = math.pi / 4 * width**2 * HOUSING * surfaces.length()
    return LensCost(elements, mass, volume, PRICE * (mass / PRICED) ** STEEP)


# Costs of a design, and the unit of each.
COSTS = {
    "mass": "kg",
    "power": "W",
    "data rate": "bit / s",
    "volume": "m3",
    "cost": "1",
    "aperture": "m",
}
COST_MODELS = ("aperture",)
SKIES = ("whole", "worst")
BLINDED = ("counted", "left out")
ALUMINIUM = 2700.0  # kg / m3
SURE = 0.9973  # fraction of attitudes that is correct if normal errors just meet a requirement


HALF_TURN = Range(0, math.pi)
CENTRE = "angle to the centre of the body; None: not required"


class KeepOut(Parameters):
    """Least angles from the boresight to bright bodies at which the limits must hold, radian."""

    sun: float | None = parameter(CENTRE, unit=Unit("rad", "deg"), limit=HALF_TURN, default=None)
    moon: float | None = parameter(CENTRE, unit=Unit("rad", "deg"), limit=HALF_TURN, default=None)
    earth: float | None = parameter(
        "angle to the limb; None: not required",
        unit=Unit("rad", "deg"),
        limit=HALF_TURN,
        default=None,
    )
    altitude: float = parameter(
        "altitude of the orbit, for the size of the Earth",
        unit=Unit("m", "km"),
        limit=POSITIVE,
        default=600e3,
    )

    @property
    def angles(self) -> dict[str, float]:
        """Required angles, by body."""
        named = {"sun": self.sun, "moon": self.moon, "earth": self.earth}
        return {name: angle for name, angle in named.items() if angle is not None}


@dataclass(frozen=True)
class Accuracy:
    """A limit on the error.

    objective  statistic of the error
    most       radian, limit of the statistic
    """

    objective: Objective
    most: float

    @property
    def name(self) -> str:
        """Direction of the error: "across" or "about"."""
        return self.objective.axes

    @property
    def single(self) -> float:
        """Limit of a single error, radian.

        Normal errors that just meet the requirement exceed it in 0.27 % of the cases. It limits the
        length of the error, and is at least `most` if `most` is a length.
        """
        objective, axes = self.objective, len(AXES[self.objective.axes])
        if objective.fraction is None:
            sigma = self.most / math.sqrt(axes if objective.radial else 1)
        elif objective.per_axis_level or axes == 1:
            sigma = self.most / float(special.ndtri((1 + objective.fraction) / 2))
        else:
            sigma = self.most / _length(axes, objective.fraction)
        limit = sigma * _length(axes, SURE)
        return max(limit, self.most) if objective.radial or axes == 1 else limit


def _length(axes: int, fraction: float) -> float:
    """Quantile of the length of an error vector with standard normal errors about `axes` axes."""
    return math.sqrt(2 * float(special.gammaincinv(axes / 2, fraction)))


MAX_ERROR = "limit of the error across, or about, the boresight; None: no limit"


class Requirements(core.CarriesCode):
    """Limits on a design, and the coefficients of its cost models.

        mass   = mass_fixed + mass_per_volume * aperture^3 + shield,   or, with a density,
        mass   = density * volume + shield,   with the volume without the tube
        volume = volume_fixed + pi / 4 aperture^2 * length_ratio * focal length + baffle
        baffle = pi / 12 L (aperture^2 + aperture D + D^2),   L = aperture / (tan a - tan w),
                 D = aperture + 2 L tan w
        shield = 2700 kg/m3 * shielding * 6 volume^(2/3)
        power  = power_fixed + energy_per_bit * data rate
        cost   = cost_fixed + cost_of_metre * aperture^cost_power + tolerances + calibration

    Five parts replace or extend these terms. A lens of a family, or of a table with its surfaces,
    has the mass, volume and price of `lens_cost` instead of the terms of the aperture. Tolerances
    cost the sum of price log2(1 / scale) over the [[variation]] tables that have a price. A
    calibration on the ground costs calibration_price * positions * position_time in hours. A
    structure (`[instrument.structure]`) adds its mass, the power of its heater, and the cost of its
    material: mass times price times `cost_of_part`. A baffle that is given by its geometry
    (`[instrument.tube]`) has the volume of this geometry, and its mass is added.

    The coefficients are inputs, not results. The coefficients of mass, volume and power are
    assumed. Source of the cost: NASA Marshall's model of 47 telescopes (NTRS 20205010427). Their
    cost grows as aperture^1.7, and is 20 million dollars for one metre on the ground.

    Accuracy  model: proxies. The mass of a lens grows as the cube of its aperture, the length of
              the tube is the focal length times a ratio, and power grows with the data rate. The
              lens of a star tracker is far smaller than these telescopes, so that only ratios of
              costs are meaningful.
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"sky_share": "sky_fraction"}

    max_mass: float = parameter(
        "limit of the mass of lens, baffle and electronics, by the cost models",
        unit=Unit("kg"),
        limit=POSITIVE,
        default=1.0,
    )
    mass_fixed: float = parameter(
        "mass of the parts that do not grow with the aperture",
        unit=Unit("kg"),
        limit=NON_NEGATIVE,
        default=0.15,
    )
    mass_per_volume: float = parameter(
        "mass of lens and baffle over the cube of the aperture",
        unit=Unit("kg / m3"),
        limit=NON_NEGATIVE,
        default=6000.0,
    )
    density: float | None = parameter(
        "density of the whole tracker, whose mass then follows from its volume; None: the mass "
        "follows from the aperture. The median of seven built trackers is 950 kg/m3",
        unit=Unit("kg / m3"),
        limit=POSITIVE,
        default=None,
    )
    baffle_angle: float | None = parameter(
        "least angle of the Sun from the boresight at which the baffle shades the lens; None: no "
        "baffle, or a baffle that the other terms contain",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi / 2),
        default=None,
    )
    shielding: float = parameter(
        "thickness of a layer of aluminium around the tracker, in addition to its housing",
        unit=Unit("m", "mm"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    max_power: float = parameter(
        "limit of the power, by the cost models", unit=Unit("W"), limit=POSITIVE, default=2.0
    )
    power_fixed: float = parameter(
        "power of the parts that do not grow with the data rate",
        unit=Unit("W"),
        limit=NON_NEGATIVE,
        default=0.4,
    )
    energy_per_bit: float = parameter(
        "energy to read out and process a bit",
        unit=Unit("J / bit", "nJ / bit"),
        limit=NON_NEGATIVE,
        default=20e-9,
    )
    max_volume: float | None = parameter(
        "limit of the volume; None: no limit", unit=Unit("m3", "cm3"), limit=POSITIVE, default=None
    )
    volume_fixed: float = parameter(
        "volume of all parts except lens and baffle",
        unit=Unit("m3", "cm3"),
        limit=NON_NEGATIVE,
        default=100e-6,
    )
    length_ratio: float = parameter(
        "length of the tube over the focal length", limit=POSITIVE, default=2.0
    )
    max_data_rate: float | None = parameter(
        "limit of the data rate; None: no limit",
        unit=Unit("bit / s", "Mbit / s"),
        limit=POSITIVE,
        default=None,
    )
    max_cost: float | None = parameter(
        "limit of the cost; None: no limit", limit=POSITIVE, default=None
    )
    cost_fixed: float = parameter(
        "cost of all parts except the lens, in any currency", limit=NON_NEGATIVE, default=0.0
    )
    cost_of_metre: float = parameter(
        "cost of a lens with an aperture of one metre", limit=NON_NEGATIVE, default=20e6
    )
    cost_power: float = parameter(
        "exponent of the cost as a power of the aperture", limit=POSITIVE, default=1.7
    )
    position_time: float = parameter(
        "duration of one position of a calibration on the ground; assumed",
        unit=Unit("s"),
        limit=NON_NEGATIVE,
        default=30.0,
    )
    calibration_price: float = parameter(
        "price of an hour of calibration on the ground, in the unit of the cost",
        limit=NON_NEGATIVE,
        default=0.0,
    )
    cost_of_part: float = parameter(
        "cost of a kilogram of machined aluminium structure; assumed",
        limit=NON_NEGATIVE,
        default=500.0,
    )
    min_update_rate: float = parameter(
        "least number of attitudes in a second", unit=Unit("Hz"), limit=NON_NEGATIVE, default=1.0
    )
    min_stars: int = parameter(
        "least number of stars above the detection threshold, in `sky_fraction` of the sky",
        limit=Range(1, 100),
        default=5,
    )
    sky_fraction: float = parameter(
        "fraction of the sky in which `min_stars` must be seen", limit=Range(0, 1), default=0.99
    )
    min_availability: float = parameter(
        "least fraction of trials with a correct attitude", limit=Range(0, 1), default=0.99
    )
    max_across: float | None = parameter(
        MAX_ERROR, unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    max_about: float | None = parameter(
        MAX_ERROR, unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    level: str = parameter(
        'statistic of these errors: "rms", or the percentage of cases, such as "99.73 %", in which '
        "errors must be within the limit",
        default="rms",
    )
    kind: str = parameter(
        '"per axis": limits hold for the errors about each axis; "radial": for their length. About '
        "the boresight, both are the same",
        limit=Range(choices=KINDS),
        default="per axis",
    )
    sky: str = parameter(
        'where limits must hold: "whole", over the whole sky; "worst", in the worst of 12 regions '
        "of equal area",
        limit=Range(choices=SKIES),
        default="whole",
    )
    confidence: float = parameter(
        "confidence level of the bounds by which trials show that limits are met",
        limit=Range(0.5, 0.9999),
        default=0.95,
    )
    max_rate: float | None = parameter(
        "slew rate at which the limits on errors and availability must also hold",
        unit=Unit("rad/s", "deg/s"),
        limit=POSITIVE,
        default=None,
    )
    min_keep_out: KeepOut = parameter(
        "angles to Sun, Moon and Earth at which these limits must also hold",
        default_factory=KeepOut,
    )
    blinded: str = parameter(
        "trials in which Sun, Moon or Earth is nearer than min_keep_out: "
        '"counted" in availability and errors, or "left out" of both',
        limit=Range(choices=BLINDED),
        default="counted",
    )
    cost_model: str = parameter(
        '"aperture": the cost grows as a power of the aperture; or user code, see '
        "docs/extensions.md",
        limit=Range(choices=COST_MODELS, code="costs"),
        default="aperture",
    )
    checks: tuple[str, ...] = parameter(
        "user code that computes margins; no margin may be negative",
        limit=Range(code="requirements"),
        default=(),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._fraction()

    def _fraction(self) -> float | None:
        """The level as a fraction; None for the rms."""
        if self.level == "rms":
            return None
        number, percent, rest = self.level.partition("%")
        try:
            fraction = float(number) / 100
        except ValueError:
            fraction = math.nan
        if not percent or rest or not 0 < fraction < 1:
            raise Refused(f"level must be rms or a percentage such as 99.73 %, got {self.level!r}")
        return fraction

    @property
    def accuracy(self) -> tuple[Accuracy, ...]:
        """The required limits on the error."""
        limits = {"across": self.max_across, "about": self.max_about}
        return tuple(
            Accuracy(Objective(axes, self._fraction(), self.kind), most)
            for axes, most in limits.items()
            if most is not None
        )

    @property
    def limits(self) -> ErrorLimits:
        """Largest errors of a correct attitude."""
        return ErrorLimits(**{accuracy.name: accuracy.single for accuracy in self.accuracy})

    def mass(self, case: Case) -> float:
        """Mass, kilogram."""
        optics, structure = case.instrument.optics, case.instrument.structure
        added = 0.0
        if self.shielding:
            added = ALUMINIUM * self.shielding * 6 * self.volume(case) ** (2 / 3)
        if tube := case.instrument.tube:
            added += tube.mass(optics.aperture, case.instrument.camera.half_diagonal)
        if self.density is not None:
            hollow = self._baffle(case) if tube else 0.0
            return self.density * (self.volume(case) - hollow) + added
        fixed = self.mass_fixed + added + (structure.mass(optics) if structure else 0.0)
        lens = lens_cost(optics)
        return fixed + (lens.mass if lens else self.mass_per_volume * optics.aperture**3)

    def power(self, case: Case) -> float:
        """Power, watt."""
        structure = case.instrument.structure
        heater = structure.heater if structure else 0.0
        return self.power_fixed + self.energy_per_bit * case.instrument.detector.data_rate + heater

    def volume(self, case: Case) -> float:
        """Volume, cubic metre."""
        optics = case.instrument.optics
        lens = lens_cost(optics)
        tube = math.pi / 4 * optics.aperture**2 * self.length_ratio * optics.focal_length
        return self.volume_fixed + (lens.volume if lens else tube) + self._baffle(case)

    def _baffle(self, case: Case) -> float:
        """Volume of the baffle, cubic metre: a cone in front of the lens, outside of the field.

        If its angle lies in the field, its length is a thousand apertures, beyond any limit.
        """
        if tube := case.instrument.tube:
            if self.baffle_angle is not None:
                raise Refused("requirements.baffle_angle must be left out if a tube is given")
            lens, field = case.instrument.optics.aperture, case.instrument.camera.half_diagonal
            return tube.volume(lens, field)
        if self.baffle_angle is None:
            return 0.0
        field = math.tan(case.instrument.camera.half_diagonal)
        lens = case.instrument.optics.aperture
        length = lens / max(math.tan(self.baffle_angle) - field, 1e-3)
        front = lens + 2 * length * field
        return math.pi / 12 * length * (lens**2 + lens * front + front**2)

    def data_rate(self, case: Case) -> float:
        """Data rate, bit / second."""
        return case.instrument.detector.data_rate

    def calibration_time(self, case: Case) -> float:
        """Duration of the calibration of a unit on the ground, second; 0 without one."""
        calibration = case.tracker.calibration
        if calibration is None or calibration.place != "ground":
            return 0.0
        return calibration.positions * self.position_time

    def cost(self, case: Case) -> float:
        """Cost in the unit of `cost_of_metre`; for a lens of known surfaces, in dollar of 2010.

        Raises  ValueError if the code of `cost_model` raises an error, or returns no number.
        """
        if core.is_code(self.cost_model):
            return _number("costs", self.cost_model, case)
        optics, structure = case.instrument.optics, case.instrument.structure
        fixed = self.cost_fixed + sum(variation.cost for variation in case.variation)
        fixed += self.calibration_price * self.calibration_time(case) / 3600
        if structure:
            fixed += self.cost_of_part * structure.made_of.price * structure.mass(optics)
        if lens := lens_cost(optics):
            return fixed + lens.price
        return fixed + self.cost_of_metre * optics.aperture**self.cost_power

    def aperture(self, case: Case) -> float:
        """Aperture, metre."""
        return case.instrument.optics.aperture

    def cost_named(self, name: str, case: Case) -> float:
        """A cost by its name, one of COSTS, in the unit that COSTS states."""
        return float(getattr(self, name.replace(" ", "_"))(case))

    def own_margins(self, case: Case) -> dict[str, float]:
        """Margins by the user code in `checks`, by the name of the code.

        Raises  ValueError if the code raises an error, or returns no number.
        """
        return {name: _number("requirements", name, case) for name in self.checks}


def _number(group: str, name: str, case: Case) -> float:
    """A number by user code: a cost in the unit of `max_cost`, or a margin (negative: not met)."""
    return float(core.returned(group, name, core.call_code(group, name, case), ()))
