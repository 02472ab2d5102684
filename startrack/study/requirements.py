"""Requirements: what a design must meet before its accuracy counts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np

from startrack.budget.fields import attitudes
from startrack.camera import Camera
from startrack.case import Case
from startrack.catalog import Selection, open_sky
from startrack.chain import look, psf_of, throughput
from startrack.checks import non_negative, positive, whole, within
from startrack.detection import threshold_of
from startrack.detector import electron_rate
from startrack.motion import blur
from startrack.scene import illuminate
from startrack.units import Unit
from startrack.values import Stars

FIELDS = 1024  # attitudes over which the sky is counted
FOCAL_STEP = 1.05  # ratio of the focal lengths at which they are counted
MAGNITUDES = np.linspace(-2, 12, 57)


@dataclass(frozen=True)
class Requirements:
    """Limits, and the coefficients of the cost models behind them.

        mass   = mass_fixed + mass_per_volume * aperture^3
        volume = volume_fixed + pi / 4 aperture^2 * length_ratio * focal length
        power  = power_fixed + energy_per_bit * data rate
        cost   = cost_fixed + cost_of_metre * aperture^cost_power

    The models are proxies: a lens of one shape grows in all directions with its aperture, a tube
    is as long as its focal length asks, and the electronics pay for each bit. Their coefficients
    are inputs, not results, and those of mass, volume and power are assumptions of the usual size.
    Source of the cost: NASA Marshall's model of 47 telescopes, whose cost grows as aperture^1.7
    and is 20 million dollars for one metre on the ground (NTRS 20205010427); a star tracker's lens
    is far below the telescopes that it rests on, so that only ratios mean something.

    max_volume, max_data_rate, max_cost  None where there is no such limit
    min_stars         stars above the detection threshold that `sky_share` of the sky must show
    min_availability  share of trials with a right attitude; `optimize` shows it by a lower bound
    """

    max_mass: Annotated[float, Unit("kg")] = 1.0
    mass_fixed: Annotated[float, Unit("kg")] = 0.15
    mass_per_volume: Annotated[float, Unit("kg / m3")] = 6000.0
    max_power: Annotated[float, Unit("W")] = 2.0
    power_fixed: Annotated[float, Unit("W")] = 0.4
    energy_per_bit: Annotated[float, Unit("J / bit", "nJ / bit")] = 20e-9
    max_volume: Annotated[float | None, Unit("m3", "cm3")] = None
    volume_fixed: Annotated[float, Unit("m3", "cm3")] = 100e-6
    length_ratio: float = 2.0
    max_data_rate: Annotated[float | None, Unit("bit / s", "Mbit / s")] = None
    max_cost: float | None = None
    cost_fixed: float = 0.0
    cost_of_metre: float = 20e6
    cost_power: float = 1.7
    min_update_rate: Annotated[float, Unit("Hz")] = 1.0
    min_stars: int = 5
    sky_share: float = 0.99
    min_availability: float = 0.99

    def __post_init__(self) -> None:
        positive(max_mass=self.max_mass, max_power=self.max_power)
        for name in ("max_volume", "max_data_rate", "max_cost"):
            if getattr(self, name) is not None:
                positive(**{name: getattr(self, name)})
        positive(length_ratio=self.length_ratio, cost_power=self.cost_power)
        non_negative(
            volume_fixed=self.volume_fixed,
            cost_fixed=self.cost_fixed,
            cost_of_metre=self.cost_of_metre,
            mass_fixed=self.mass_fixed,
            mass_per_volume=self.mass_per_volume,
            power_fixed=self.power_fixed,
            energy_per_bit=self.energy_per_bit,
            min_update_rate=self.min_update_rate,
        )
        whole(1, 100, min_stars=self.min_stars)
        within(0, 1, sky_share=self.sky_share, min_availability=self.min_availability)

    def mass(self, case: Case) -> float:
        """Kilogram."""
        return self.mass_fixed + self.mass_per_volume * case.instrument.optics.aperture**3

    def power(self, case: Case) -> float:
        """Watt."""
        return self.power_fixed + self.energy_per_bit * case.instrument.detector.data_rate

    def volume(self, case: Case) -> float:
        """Cubic metre."""
        optics = case.instrument.optics
        tube = math.pi / 4 * optics.aperture**2 * self.length_ratio * optics.focal_length
        return self.volume_fixed + tube

    def data_rate(self, case: Case) -> float:
        """Bit per second."""
        return case.instrument.detector.data_rate

    def cost(self, case: Case) -> float:
        """In the unit of `cost_of_metre`."""
        return (
            self.cost_fixed + self.cost_of_metre * case.instrument.optics.aperture**self.cost_power
        )

    def margins(self, case: Case) -> dict[str, float]:
        """How far each limit is kept, as a share of it (stars: in magnitudes); below 0, it is not.

        The accuracy and the availability are not here: they need trials.
        """
        rate = case.instrument.detector.update_rate
        asked = {
            "volume": (self.volume, self.max_volume),
            "data rate": (self.data_rate, self.max_data_rate),
            "cost": (self.cost, self.max_cost),
        }
        return {
            name: 1 - model(case) / limit for name, (model, limit) in asked.items() if limit
        } | {
            "mass": 1 - self.mass(case) / self.max_mass,
            "power": 1 - self.power(case) / self.max_power,
            "update rate": rate / self.min_update_rate - 1 if self.min_update_rate else 1.0,
            "stars in the sky": limiting_magnitude(case)
            - needed_magnitude(case, self.min_stars, self.sky_share),
        }


def limiting_magnitude(case: Case) -> float:
    """The faintest G of a sunlike star that the matched filter sees at the threshold.

        signal / noise = N sqrt(sum p^2) / sqrt(sky + dark + read noise^2 + gain^2 / 12)
                       = threshold,   p the shares of the smeared star's light in its pixels

    Errors  model: background-limited, which holds at the threshold; the pixel phase is averaged,
            and the tests that tell a star from a hot pixel cost up to half a magnitude more.
    """
    detector = case.instrument.detector
    pixel = case.instrument.camera.focal_length_px**-2
    unknown = np.full(len(MAGNITUDES), np.nan)
    stars = Stars(
        np.zeros(len(MAGNITUDES), np.int64), np.zeros((len(MAGNITUDES), 3)), MAGNITUDES, unknown
    )
    light = illuminate(case.scene, stars)
    star, sky = electron_rate(light, detector, throughput(case.instrument))
    noise = (sky * pixel + detector.dark_rate) * detector.integration
    noise += detector.noise**2 + detector.electrons_per_dn**2 / 12
    # The sum of squares of the pixel shares, with the mean of the smear: a convolution of each
    # place with each other place along the path.
    psf = psf_of(case.instrument)
    sharpness = float((psf.table**2).sum()) / psf.oversampling**2
    smear = blur(case.instrument.motion, detector.exposure)
    # A straight line of this length has the same blur.
    length = np.sqrt(12) * float(np.hypot(smear[0], smear[1])) / np.sqrt(pixel)
    sharpness /= np.sqrt(1 + length**2 * sharpness)
    signal = star * detector.integration * np.sqrt(sharpness)
    ratio = signal / np.sqrt(noise)
    threshold = threshold_of(case.tracker.detection, detector.columns, detector.rows, psf)
    return float(np.interp(-np.log(threshold), -np.log(ratio), MAGNITUDES))


def needed_magnitude(case: Case, stars: int, share: float) -> float:
    """The G that must be seen so that `share` of the sky shows `stars` stars in the field.

    Errors  numerical: 0.02 magnitudes between the focal lengths at which the sky is counted.
    """
    camera = case.instrument.camera
    at, below = math.modf(math.log(camera.focal_length_px) / math.log(FOCAL_STEP))
    nearer, farther = (
        _needed(case.believed_catalog, camera.columns, camera.rows, step, stars, share)
        for step in (int(below), int(below) + 1)
    )
    return nearer + at * (farther - nearer)


@lru_cache(maxsize=1024)
def _needed(
    catalog: Selection, columns: int, rows: int, step: int, stars: int, share: float
) -> float:
    """At a focal length of FOCAL_STEP**step pixels."""
    camera = Camera(columns, rows, FOCAL_STEP**step)
    sky = open_sky(catalog)
    faintest = np.empty(FIELDS)
    for i, attitude in enumerate(attitudes(FIELDS)):
        seen = look(sky, attitude, camera)
        inside = camera.holds(camera.project(attitude.apply(seen.direction)))
        magnitude = seen.magnitude_g[inside]
        # A field with too few stars in the whole catalogue asks for more than the catalogue has.
        faintest[i] = magnitude[stars - 1] if len(magnitude) >= stars else catalog.limit_g + 1
    return float(np.quantile(faintest, share))
