"""Detector: pixels, exposure, noise, converter, and optional effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from startrack.core import (
    ALL,
    ZERO_CELSIUS,
    Curve,
    Refused,
    Unit,
    code_field,
    finite,
    full_name,
    non_negative,
    one_of_or_code,
    positive,
    whole,
    within,
)
from startrack.detector.ageing import TAILS, Age, typical
from startrack.detector.hits import Hits
from startrack.detector.lines import Scan
from startrack.detector.nonuniformity import Defects, Pattern
from startrack.detector.thermal import Thermal

EFFECTS_BY_CODE = ("charge_effects", "signal_effects", "image_effects")
ROOM = ZERO_CELSIUS + 20  # kelvin, of a detector without a temperature


@dataclass(frozen=True)
class RegionOfInterest:
    """The part of an array that is read.

    left, top                  pixel of the array, where the image begins
    array_columns, array_rows  pixel, of the array
    """

    left: int
    top: int
    array_columns: int
    array_rows: int

    def __post_init__(self) -> None:
        whole(0, 2**16, left=self.left, top=self.top)
        whole(1, 2**16, array_columns=self.array_columns, array_rows=self.array_rows)


@dataclass(frozen=True)
class Detector:
    """A matrix of pixels, or lines of them, in the terms of EMVA 1288 (release 4.0).

    An effect that is absent (zero, one or None) costs no time and draws no random number.

    columns, rows       pixel, of the image
    pixel_pitch         metre, of a pixel of the array
    exposure            second, in which a frame collects light
    quantum_efficiency  electron / photon over wavelength
    fill_factor         1, fraction of a pixel that detects
    dark_current        electron / second
    read_noise          electron rms, temporal dark noise of the signal chain
    prnu                1, rms of the photo response over the pixels
    full_well           electron
    bits                of the converter; its largest number is the full well over `gain`
    offset              digital number of an empty pixel
    pixel_rate          pixel / second of the read-out, which sets the update rate
    device_seed         seed of the maps of one device

    binning             pixels of the array on a side of a pixel of the image, added as charge;
                        dark_current, prnu and defects are those of a pixel of the array
    region              part of the array that is the image, None for all
    row_delay           second by which each row's exposure starts after the one before: 0 for a
                        global shutter
    thermal             temperature; None: dark_current is that of the operating temperature
    defects             hot and dead pixels
    diffusion           metre, sigma per axis of the Gaussian by which charge spreads before it is
                        collected
    crosstalk           1, fraction of a pixel's electrons that diffuses to each of its four sides
    lag                 1, fraction of the charge that remains for the next frame
    hits                cosmic rays and protons
    blooming            whether charge above the full well flows along the column, or is lost
    em_gain             1, gain of the multiplication register of an EMCCD
    nonlinearity        1, fraction by which the signal of a full pixel is too small
    pattern             noise of rows and columns
    settling            1, fraction of the signal of a pixel that remains for the next one read
    read_noise_spread   1, rms of the logarithm of the read noise over the pixels of a CMOS array,
                        whose median is `read_noise`
    gain                1, of the amplifier before the converter
    adc_inl             digital number, integral non-linearity of the converter at half scale
    scan                lines that sweep over the sky; None for a matrix
    charge_effects      code of one's own, one after the other, that changes the charge of all
                        pixels at the end of the exposure, see docs/extensions.md
    signal_effects      the same of the signal at the input of the converter
    image_effects       the same of the digital numbers
    age                 damage by radiation in orbit; None: as at launch
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "bend": "nonlinearity",
        "bow": "adc_inl",
        "multiplication": "em_gain",
    }

    columns: int
    rows: int
    pixel_pitch: Annotated[float, Unit("m", "um")]
    exposure: Annotated[float, Unit("s", "ms")]
    quantum_efficiency: Curve = ALL
    fill_factor: float = 1.0
    dark_current: Annotated[float, Unit("electron / s")] = 0.0
    read_noise: Annotated[float, Unit("electron")] = 0.0
    prnu: float = 0.0
    full_well: Annotated[float, Unit("electron")] = 50e3
    bits: int = 12
    offset: int = 0
    pixel_rate: Annotated[float, Unit("pix / s", "Mpix / s")] = 40e6
    device_seed: int = 0
    binning: int = 1
    region: RegionOfInterest | None = None
    row_delay: Annotated[float, Unit("s", "us")] = 0.0
    thermal: Thermal | None = None
    defects: Defects | None = None
    diffusion: Annotated[float, Unit("m", "um")] = 0.0
    crosstalk: float = 0.0
    lag: float = 0.0
    hits: Hits | None = None
    blooming: bool = False
    em_gain: float = 1.0
    nonlinearity: float = 0.0
    pattern: Pattern | None = None
    settling: float = 0.0
    read_noise_spread: float = 0.0
    gain: float = 1.0
    adc_inl: float = 0.0
    scan: Scan | None = None
    age: Age | None = None
    charge_effects: tuple[str, ...] = code_field("charge_effects", ())
    signal_effects: tuple[str, ...] = code_field("signal_effects", ())
    image_effects: tuple[str, ...] = code_field("image_effects", ())

    def __post_init__(self) -> None:
        whole(1, 2**16, columns=self.columns, rows=self.rows)
        positive(pixel_pitch=self.pixel_pitch, exposure=self.exposure, full_well=self.full_well)
        within(0.01, 1, fill_factor=self.fill_factor)
        non_negative(dark_current=self.dark_current, read_noise=self.read_noise)
        within(0, 0.5, prnu=self.prnu)
        whole(1, 24, bits=self.bits)
        whole(0, 2**self.bits - 1, offset=self.offset)
        positive(pixel_rate=self.pixel_rate, gain=self.gain)
        whole(0, 2**63 - 1, device_seed=self.device_seed)
        whole(1, 64, binning=self.binning)
        non_negative(row_delay=self.row_delay, diffusion=self.diffusion)
        within(0, 0.25, crosstalk=self.crosstalk)
        within(0, 0.99, lag=self.lag, settling=self.settling)
        within(1, 1e5, em_gain=self.em_gain)
        within(
            -0.49, 0.49, nonlinearity=self.nonlinearity
        )  # beyond, more light would give less signal
        within(0, 2, read_noise_spread=self.read_noise_spread)
        finite(adc_inl=self.adc_inl)
        for group in EFFECTS_BY_CODE:
            names = tuple(full_name(group, (), one) for one in getattr(self, group))
            object.__setattr__(self, group, names)
            for one in names:
                one_of_or_code((), **{group: one})
        if 4 * abs(self.adc_inl) >= 2**self.bits - 1:
            raise Refused(
                f"adc_inl must stay under a quarter of the converter's range, got {self.adc_inl}"
            )
        if self.region:
            self._check(self.region)
        if self.scan:
            self._check_scan(self.scan)

    def _check(self, region: RegionOfInterest) -> None:
        for name, start, length, array in (
            ("columns", region.left, self.columns, region.array_columns),
            ("rows", region.top, self.rows, region.array_rows),
        ):
            if start + length * self.binning > array:
                raise Refused(
                    f"region must lie on the array's {array} {name}, got {start} to "
                    f"{start + length * self.binning}"
                )

    def _check_scan(self, scan: Scan) -> None:
        matrix_only = {
            "row_delay": self.row_delay,
            "region": self.region,
            "lag": self.lag,
            "read_noise_spread": self.read_noise_spread,
            "age": self.age,
        }
        for name in (name for name, there in matrix_only.items() if there):
            raise Refused(f"{name} must be left out where lines scan")
        if self.columns * scan.phases > self.pixel_rate * self.exposure * (1 + 1e-9):
            raise Refused(
                f"pixel_rate must read {self.columns * scan.phases} pixel within an exposure of "
                f"{self.exposure:g} s where lines scan, got {self.pixel_rate:g} pixel / s"
            )

    @property
    def pitch(self) -> float:
        """Metre, of a pixel of the image."""
        return self.pixel_pitch * self.binning

    @property
    def shift(self) -> tuple[float, float]:
        """Pixel (x, y) from the centre of the image to that of the array."""
        if not self.region:
            return 0.0, 0.0
        region, size = self.region, self.binning
        return (
            (region.array_columns / size - self.columns) / 2 - region.left / size,
            (region.array_rows / size - self.rows) / 2 - region.top / size,
        )

    @property
    def typical_current(self) -> float:
        """Electron / second of a typical pixel at the reference, at its age, without defects."""
        if not self.age:
            return self.dark_current
        return typical(self.dark_current, self.age, self.pixel_pitch**2, *self.of_age)

    @property
    def dark_rate(self) -> float:
        """Electron / second of a typical pixel of the image at its temperature."""
        growth = self.thermal.growth if self.thermal else 1.0
        return self.typical_current * growth * self.binning**2

    @property
    def of_age(self) -> tuple[float, float]:
        """Kelvin that dark currents are given at, and their ratio to those of the age's law."""
        assert self.age
        law, thermal = TAILS.get(self.age.family), self.thermal
        if not thermal:
            return ROOM, 1.0
        to = 1 / replace(thermal, temperature=law.kelvin).growth if law else 1.0
        return thermal.reference, to

    @property
    def sensitivity(self) -> float:
        """1, of the light that is detected, over that at launch."""
        return self.age.sensitivity if self.age else 1.0

    @property
    def effects_by_code(self) -> tuple[str, ...]:
        """Keys, and names of the code that they name."""
        return tuple(
            f"{group} {name}" for group in EFFECTS_BY_CODE for name in getattr(self, group)
        )

    @property
    def flickers(self) -> bool:
        """Whether pixels have a random telegraph signal."""
        return bool(self.age and self.age.flicker)

    @property
    def noise(self) -> float:
        """Electron rms of a pixel without light and dark current, without quantisation.

        Referred to the charge before a multiplication register.
        """
        after = self.read_noise * math.exp(self.read_noise_spread**2)
        if self.pattern:
            after = math.hypot(after, self.pattern.row, self.pattern.column)
        return math.hypot(after, self.reset_noise) / self.em_gain

    @property
    def reset_noise(self) -> float:
        """Electron rms."""
        return self.thermal.reset_noise if self.thermal else 0.0

    @property
    def electrons_per_dn(self) -> float:
        """Electron per digital number, the inverse of EMVA 1288's system gain K.

        Referred to the charge before a multiplication register.

        Source: Krutz et al. (2011), eq. (5).
        """
        return self.full_well / self.gain / (2**self.bits - 1) / self.em_gain

    @property
    def integration(self) -> float:
        """Second of exposure of a pixel of the image: with lines, the sum of theirs."""
        if not self.scan:
            return self.exposure
        return self.exposure * sum(line.gain for line in self.scan.all_lines) / self.scan.phases

    @property
    def update_rate(self) -> float:
        """Frames per second: exposure, then read-out; a detector of lines does both at once."""
        if self.scan:
            return 1 / (self.exposure * self.rows)
        return 1 / (self.exposure + self.rows * self.columns / self.pixel_rate)

    @property
    def data_rate(self) -> float:
        """Bit per second."""
        return self.rows * self.columns * self.bits * self.update_rate
