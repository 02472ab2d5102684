"""Requirements: what a design must meet, the cost of its lens included, before accuracy counts."""

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

BARREL = 3.7  # kilogram of a whole lens for one of its glass
WALL = 1.96  # outer diameter over that of the largest clear aperture
HOUSING = 1.26  # length of the housing, to the detector, over that of the rays
PRICE, PRICED, STEEP = (
    270.0,
    0.24,
    1.6,
)  # dollar of 2010, of a lens by its mass in kilogram; exponent


class LensCost(NamedTuple):
    """Mass, volume and price of a lens.

    elements  pieces of glass and mirrors; a family's law need not give whole numbers
    mass      kilogram, with its barrel
    volume    cubic metre, of the cylinder that it needs, to the detector
    price     dollar of 2010, of lenses made in series for cameras
    """

    elements: float
    mass: float
    volume: float
    price: float


def lens_cost(optics: Optics) -> LensCost | None:
    """The cost of a lens of a family or of a lens table; None where its surfaces are not known.

        mass   = 3.7 glass * elements / elements of the published lens
        volume = pi / 4 (1.96 largest clear diameter)^2 * 1.26 length to the detector
        price  = 270 (mass / 0.24 kg)^1.6

    The glass is that of the prescription in the design's size; a family's has the clear apertures
    that its beams need at the design's f-number. The three factors of mass and volume are medians
    over nine camera lenses, and the price is a fit to five of them, which
    docs/figures/lens-costs.md lists.

    Accuracy  model: measured over predicted, mass is 0.5 to 1.8, by barrels of plastic or brass;
              volume 0.5 to 1.4; price 0.5 to 3.1, of series. A lens for space costs some hundred
              times as much, so that only ratios mean something. All nine are double Gauss lenses.
    """
    surfaces = full_surfaces(optics)  # stopped down, it is as large as before
    if surfaces is None:
        return None
    elements: float = len(surfaces.elements)
    if optics.lens_family:
        elements = element_count(optics.lens_family, optics.f_number, optics.family_field)
    return cost_of(surfaces, elements)


def cost_of(surfaces: Surfaces, elements: float) -> LensCost:
    """The cost of a lens of some surfaces; the number of elements need not be theirs."""
    more = elements / max(len(surfaces.elements), 1)
    mass = BARREL * surfaces.glass_mass() * more
    width = WALL * 2 * float(surfaces.radius.max())
    volume = math.pi / 4 * width**2 * HOUSING * surfaces.length()
    return LensCost(elements, mass, volume, PRICE * (mass / PRICED) ** STEEP)


# What a design costs, and the unit of it.
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
SURE = 0.9973  # of the normal errors that just meet a requirement are those of correct attitudes


HALF_TURN = Range(0, math.pi)
CENTRE = "to the centre; None: not required"


class KeepOut(Parameters):
    """Angles from the boresight from which on accuracy and availability must hold, radian."""

    sun: float | None = parameter(CENTRE, unit=Unit("rad", "deg"), limit=HALF_TURN, default=None)
    moon: float | None = parameter(CENTRE, unit=Unit("rad", "deg"), limit=HALF_TURN, default=None)
    earth: float | None = parameter(
        "to the limb", unit=Unit("rad", "deg"), limit=HALF_TURN, default=None
    )
    altitude: float = parameter(
        "from which the Earth is seen", unit=Unit("m", "km"), limit=POSITIVE, default=600e3
    )

    @property
    def angles(self) -> dict[str, float]:
        """Those that are required."""
        named = {"sun": self.sun, "moon": self.moon, "earth": self.earth}
        return {name: angle for name, angle in named.items() if angle is not None}


@dataclass(frozen=True)
class Accuracy:
    """A limit on the error.

    objective  the statistic
    most       radian, its limit
    """

    objective: Objective
    most: float

    @property
    def name(self) -> str:
        """Its direction: "across" or "about"."""
        return self.objective.axes

    @property
    def single(self) -> float:
        """Radian, the limit of a single error.

        That which 99.73 % of the normal errors do not exceed that just meet the requirement, by
        their length; at least `most` where that is a length.
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
    """Level that a fraction of normal errors of sigma 1 about a number of axes does not exceed."""
    return math.sqrt(2 * float(special.gammaincinv(axes / 2, fraction)))


MAX_ERROR = "error across and about the boresight; None where there is no such limit"


class Requirements(core.CarriesCode):
    """Limits, and the coefficients of the cost models behind them.

        mass   = mass_fixed + mass_per_volume * aperture^3 + shield,   or with a density
        mass   = density * volume + shield,   where the volume is without a tube
        volume = volume_fixed + pi / 4 aperture^2 * length_ratio * focal length + baffle
        baffle = pi / 12 L (aperture^2 + aperture D + D^2),   L = aperture / (tan a - tan w),
                 D = aperture + 2 L tan w
        shield = 2700 kg/m3 * shielding * 6 volume^(2/3)
        power  = power_fixed + energy_per_bit * data rate
        cost   = cost_fixed + cost_of_metre * aperture^cost_power + tolerances + calibration

    A lens of a family, or of a table that has its surfaces, has its own mass, volume and price
    instead of the terms of the aperture: see `lens_cost`. Tolerances cost sum price log2(1 / scale)
    over the [[variation]] tables that have a price, a calibration on the ground
    calibration_price * positions * position_time in hours. A structure (`[instrument.structure]`)
    adds its mass, the power of its heater, and the price of its material times that mass and
    `cost_of_part`. A baffle given by its geometry (`[instrument.tube]`) has its own
    volume, and its mass is added.

    The models are proxies: a lens of one shape grows in all directions with its aperture, a tube
    is as long as its focal length asks, and the electronics pay for each bit. Their coefficients
    are inputs, not results, and those of mass, volume and power are assumptions of the usual size.
    Source of the cost: NASA Marshall's model of 47 telescopes, whose cost grows as aperture^1.7
    and is 20 million dollars for one metre on the ground (NTRS 20205010427); a star tracker's lens
    is far below the telescopes that it rests on, so that only ratios mean something.
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"sky_share": "sky_fraction"}

    max_mass: float = parameter(
        "of lens, baffle and electronics, by these models",
        unit=Unit("kg"),
        limit=POSITIVE,
        default=1.0,
    )
    mass_fixed: float = parameter(
        "mass of what does not grow with the aperture",
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
        "of the whole tracker, which then has the mass of its volume; None: the mass is that of "
        "the aperture. Of seven that were built 950 kg/m3 in the median",
        unit=Unit("kg / m3"),
        limit=POSITIVE,
        default=None,
    )
    baffle_angle: float | None = parameter(
        "from the boresight, from which on the baffle keeps the Sun from the lens; None: no "
        "baffle, or one within the other terms",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi / 2),
        default=None,
    )
    shielding: float = parameter(
        "thickness of a layer of aluminium around the tracker; 0: none but its housing",
        unit=Unit("m", "mm"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    max_power: float = parameter(
        "of lens, baffle and electronics, by these models",
        unit=Unit("W"),
        limit=POSITIVE,
        default=2.0,
    )
    power_fixed: float = parameter(
        "power of what does not grow with the data rate",
        unit=Unit("W"),
        limit=NON_NEGATIVE,
        default=0.4,
    )
    energy_per_bit: float = parameter(
        "of reading out and processing",
        unit=Unit("J / bit", "nJ / bit"),
        limit=NON_NEGATIVE,
        default=20e-9,
    )
    max_volume: float | None = parameter(
        "None where there is no such limit", unit=Unit("m3", "cm3"), limit=POSITIVE, default=None
    )
    volume_fixed: float = parameter(
        "volume of all but the lens", unit=Unit("m3", "cm3"), limit=NON_NEGATIVE, default=100e-6
    )
    length_ratio: float = parameter(
        "length of the tube over the focal length", limit=POSITIVE, default=2.0
    )
    max_data_rate: float | None = parameter(
        "None where there is no such limit",
        unit=Unit("bit / s", "Mbit / s"),
        limit=POSITIVE,
        default=None,
    )
    max_cost: float | None = parameter(
        "None where there is no such limit", limit=POSITIVE, default=None
    )
    cost_fixed: float = parameter(
        "cost of all but the lens, in any currency", limit=NON_NEGATIVE, default=0.0
    )
    cost_of_metre: float = parameter(
        "cost of a lens with an aperture of one metre", limit=NON_NEGATIVE, default=20e6
    )
    cost_power: float = parameter(
        "with which the cost grows with the aperture", limit=POSITIVE, default=1.7
    )
    position_time: float = parameter(
        "of a position of a calibration on the ground; assumed",
        unit=Unit("s"),
        limit=NON_NEGATIVE,
        default=30.0,
    )
    calibration_price: float = parameter(
        "of an hour of a calibration on the ground, in the unit of the cost",
        limit=NON_NEGATIVE,
        default=0.0,
    )
    cost_of_part: float = parameter(
        "cost of a kilogram of a structure in aluminium, machined; assumed",
        limit=NON_NEGATIVE,
        default=500.0,
    )
    min_update_rate: float = parameter(
        "attitudes in a second", unit=Unit("Hz"), limit=NON_NEGATIVE, default=1.0
    )
    min_stars: int = parameter(
        "stars above the detection threshold that `sky_fraction` of the sky must show",
        limit=Range(1, 100),
        default=5,
    )
    sky_fraction: float = parameter(
        "fraction of the sky that must show `min_stars`", limit=Range(0, 1), default=0.99
    )
    min_availability: float = parameter(
        "fraction of trials with a correct attitude, see `limits`", limit=Range(0, 1), default=0.99
    )
    max_across: float | None = parameter(
        MAX_ERROR, unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    max_about: float | None = parameter(
        MAX_ERROR, unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    level: str = parameter(
        'of these errors: "rms", or a percentage such as "99.73 %" that they must not exceed in '
        "a number of cases",
        default="rms",
    )
    kind: str = parameter(
        '"per axis": of the errors about single axes; "radial": of their length. About the '
        "boresight, both are the same",
        limit=Range(choices=KINDS),
        default="per axis",
    )
    sky: str = parameter(
        '"whole": over the whole sky; "worst": in the worst of 12 regions of equal area',
        limit=Range(choices=SKIES),
        default="whole",
    )
    confidence: float = parameter(
        "with which trials must show what they show", limit=Range(0.5, 0.9999), default=0.95
    )
    max_rate: float | None = parameter(
        "slew rate at which accuracy and availability must hold, too",
        unit=Unit("rad/s", "deg/s"),
        limit=POSITIVE,
        default=None,
    )
    min_keep_out: KeepOut = parameter(
        "angles to Sun, Moon and Earth at which they must hold, too", default_factory=KeepOut
    )
    blinded: str = parameter(
        "whether trials in which Sun, Moon or Earth are nearer than min_keep_out count in the "
        'availability and the errors: "counted" or "left out"',
        limit=Range(choices=BLINDED),
        default="counted",
    )
    cost_model: str = parameter(
        '"aperture": as above; or user code, see docs/extensions.md',
        limit=Range(choices=COST_MODELS, code="costs"),
        default="aperture",
    )
    checks: tuple[str, ...] = parameter(
        "user code, each of whose margins must not be negative",
        limit=Range(code="requirements"),
        default=(),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self._fraction()

    def _fraction(self) -> float | None:
        """The level as a fraction, None for the rms."""
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
        """The limits on the error that are required."""
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
        """Kilogram."""
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
        """Watt."""
        structure = case.instrument.structure
        heater = structure.heater if structure else 0.0
        return self.power_fixed + self.energy_per_bit * case.instrument.detector.data_rate + heater

    def volume(self, case: Case) -> float:
        """Cubic metre."""
        optics = case.instrument.optics
        lens = lens_cost(optics)
        tube = math.pi / 4 * optics.aperture**2 * self.length_ratio * optics.focal_length
        return self.volume_fixed + (lens.volume if lens else tube) + self._baffle(case)

    def _baffle(self, case: Case) -> float:
        """Cubic metre of a cone before the lens that leaves the field free.

        Where its angle lies in the field, it is a thousand apertures long, which no limit allows.
        """
        if tube := case.instrument.tube:
            if self.baffle_angle is not None:
                raise Refused("requirements.baffle_angle must be left out where a tube is given")
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
        """Bit per second."""
        return case.instrument.detector.data_rate

    def calibration_time(self, case: Case) -> float:
        """Second, of the calibration of a unit on the ground; 0 where there is none."""
        calibration = case.tracker.calibration
        if calibration is None or calibration.place != "ground":
            return 0.0
        return calibration.positions * self.position_time

    def cost(self, case: Case) -> float:
        """Price in the unit of `cost_of_metre`; with a lens of known surfaces in dollars of 2010.

        Raises  ValueError where the code of `cost_model` raises one, or returns no number.
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
        """Metre."""
        return case.instrument.optics.aperture

    def cost_named(self, name: str, case: Case) -> float:
        """One of COSTS, in its unit."""
        return float(getattr(self, name.replace(" ", "_"))(case))

    def own_margins(self, case: Case) -> dict[str, float]:
        """The margin of each of `checks`, by its name.

        Raises  ValueError where the code of one raises an error, or returns no number.
        """
        return {name: _number("requirements", name, case) for name in self.checks}


def _number(group: str, name: str, case: Case) -> float:
    """A cost, in the unit of max_cost, or a margin on any scale, below zero where it is not met."""
    return float(core.returned(group, name, core.call_code(group, name, case), ()))
