"""Detector: pixels, exposure, noise, converter, lines, and optional effects."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from startrack import core
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    um,
)
from startrack.detector.ageing import TAILS, Age, typical
from startrack.detector.imperfections import Defects, Hits, Pattern, Thermal
from startrack.detector.mosaic import ColourMosaic

LONGEST = 1024  # most values, and most pixels, of an impulse response
KINDS = ("line", "staggered", "tdi", "lines")


class Line(Parameters):
    """A line of pixels: its position, delay and gain."""

    row: float = parameter("row of the line, pixel of the camera", limit=FINITE)
    shift: float = parameter(
        "position of its first column, pixel of the camera", limit=FINITE, default=0.0
    )
    delay: float = parameter(
        "delay of its exposure after a line without delay, in exposures", limit=FINITE, default=0.0
    )
    gain: float = parameter(
        "factor on the electrons that the pixels of the line collect", limit=FINITE, default=1.0
    )
    phase: int = parameter(
        "number of the interleaved line of the image to which it contributes",
        limit=Range(0, 15),
        default=0,
    )


def tdi(stages: int, row: float = 0.0, downward: bool = True) -> tuple[Line, ...]:
    """Time delay and integration (TDI): charge moves from stage to stage with the image.

    row       pixel, row of the first stage
    downward  whether the charge moves to larger rows
    """
    core.whole(1, 2**16, stages=stages)
    step = 1 if downward else -1
    return tuple(Line(row + step * n, delay=float(n)) for n in range(stages))


def staggered(distance: float, row: float = 0.0) -> tuple[Line, ...]:
    """Two lines, half a pixel apart along and `distance` pixel across.

    The delay of the second line fits an image that moves by one pixel per exposure to larger rows.
    """
    return Line(row), Line(row + distance, 0.5, distance, phase=1)


class Scan(Parameters):
    """A detector of lines, whose image grows while the camera rotates.

    In its design, `columns` is the number of pixels of a line, `rows` the number of lines of the
    image, and `exposure` the exposure of one line. Rows count from the middle of the camera; time
    zero is the middle of the image.
    """

    kind: str = parameter(
        '"line", "staggered", "tdi", or "lines" for any other lines, given in `lines`',
        limit=Range(choices=KINDS),
        default="line",
    )
    stages: int = parameter("of a TDI", limit=Range(1, 2**12), default=1)
    distance: float = parameter("pixel between staggered lines", limit=NON_NEGATIVE, default=4.0)
    upward: bool = parameter("whether the charge of a TDI moves to smaller rows", default=False)
    lines: tuple[Line, ...] = parameter('lines of the kind "lines"', default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.lines) != (self.kind == "lines"):
            raise Refused(f"lines must be given only for the kind 'lines', got {self.kind!r}")
        if self.stages > 1 and self.kind != "tdi":
            raise Refused(f"stages must be 1 for the kind {self.kind!r}, got {self.stages}")

    @property
    def all_lines(self) -> tuple[Line, ...]:
        """The lines; their rows are pixel from the middle of the field."""
        if self.kind == "line":
            return (Line(0.0),)
        if self.kind == "staggered":
            return staggered(self.distance, -self.distance / 2)
        if self.kind == "tdi":
            half = (self.stages - 1) / 2
            return tdi(self.stages, half if self.upward else -half, not self.upward)
        return self.lines

    @property
    def phases(self) -> int:
        """Columns of the image for each pixel of a line."""
        return 1 + max(line.phase for line in self.all_lines)

    @property
    def middle(self) -> tuple[float, float]:
        """Mean row and mean delay of all lines, weighted with their gain."""
        lines = self.all_lines
        gain = sum(line.gain for line in lines)
        row = sum(line.gain * line.row for line in lines)
        return row / gain, sum(line.gain * line.delay for line in lines) / gain


EFFECTS_BY_CODE = ("charge_effects", "signal_effects", "image_effects")
ROOM = core.ZERO_CELSIUS + 20  # kelvin, for a detector without a temperature


class RegionOfInterest(Parameters):
    """The part of an array that is read."""

    left: int = parameter("first column of the image, pixel of the array", limit=Range(0, 2**16))
    top: int = parameter("first row of the image, pixel of the array", limit=Range(0, 2**16))
    array_columns: int = parameter("number of columns of the array", limit=Range(1, 2**16))
    array_rows: int = parameter("number of rows of the array", limit=Range(1, 2**16))


class Detector(Parameters):
    """A matrix of pixels, or lines of pixels, in the terms of EMVA 1288 (release 4.0).

    An effect that is absent (zero, one or None) costs no time and draws no random number.
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {
        "bend": "nonlinearity",
        "bow": "adc_inl",
        "multiplication": "em_gain",
    }

    columns: int = parameter("number of columns of the image", limit=Range(1, 2**16))
    rows: int = parameter("number of rows of the image", limit=Range(1, 2**16))
    pixel_pitch: float = parameter(
        "side of a pixel of the array, which is square", unit=Unit("m", "um"), limit=POSITIVE
    )
    exposure: float = parameter(
        "time in which a frame collects light", unit=Unit("s", "ms"), limit=POSITIVE
    )
    quantum_efficiency: core.Curve = parameter(
        "electron / photon over wavelength", default=core.ALL
    )
    fill_factor: float = parameter(
        "fraction of the area of a pixel that detects light", limit=Range(0.01, 1), default=1.0
    )
    dark_current: float = parameter(
        "electron / second", unit=Unit("electron / s"), limit=NON_NEGATIVE, default=0.0
    )
    read_noise: float = parameter(
        "electron rms, temporal dark noise of the signal chain",
        unit=Unit("electron"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    read_noise_rate: float | None = parameter(
        "pixel / second, rate for which a datasheet gives read_noise. It does not change budgets "
        "and trials, but they report a faster pixel_rate",
        unit=Unit("pix / s", "Mpix / s"),
        limit=POSITIVE,
        default=None,
    )
    prnu: float = parameter(
        "rms over the pixels of the relative photo response", limit=Range(0, 0.5), default=0.0
    )
    full_well: float = parameter("electron", unit=Unit("electron"), limit=POSITIVE, default=50e3)
    bits: int = parameter(
        "number of bits of the converter; its largest number is the full well over `gain`",
        limit=Range(1, 24),
        default=12,
    )
    offset: float = parameter("mean digital number of an empty pixel", limit=Range(0), default=0.0)
    pixel_rate: float = parameter(
        "pixel / second, speed of the read-out, which determines the update rate",
        unit=Unit("pix / s", "Mpix / s"),
        limit=POSITIVE,
        default=40e6,
    )
    frame_rate: float | None = parameter(
        "frames per second; None: an exposure begins when the previous frame has been read. The "
        "longer of exposure and read-out must fit into a period",
        unit=Unit("Hz"),
        limit=POSITIVE,
        default=None,
    )
    device_seed: int = parameter(
        "seed of the maps of one device", limit=Range(0, 2**63 - 1), default=0
    )
    binning: int = parameter(
        "pixels of the array along each side of a pixel of the image; their charge is added. "
        "dark_current, prnu and defects are for a pixel of the array",
        limit=Range(1, 64),
        default=1,
    )
    region: RegionOfInterest | None = parameter(
        "part of the array that is read as the image; None: all of it", default=None
    )
    row_delay: float = parameter(
        "time from the start of a row's exposure to the start of the next row's; 0: global shutter",
        unit=Unit("s", "us"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    thermal: Thermal | None = parameter(
        "temperature; None: dark_current is for the operating temperature", default=None
    )
    defects: Defects | None = parameter("hot and dead pixels", default=None)
    diffusion: float = parameter(
        "sigma per axis of the Gaussian spread of charge before it is collected",
        unit=Unit("m", "um"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    crosstalk: float = parameter(
        "fraction of a pixel's electrons that diffuses to each of its four sides",
        limit=Range(0, 0.25),
        default=0.0,
    )
    lag: float = parameter(
        "fraction of the charge that remains for the next frame", limit=Range(0, 0.99), default=0.0
    )
    mosaic: ColourMosaic | None = parameter(
        "colour filters before the pixels; in formulas each pixel has the mean of a cell of four",
        default=None,
    )
    hits: Hits | None = parameter("cosmic rays and protons", default=None)
    blooming: bool = parameter(
        "whether charge above the full well flows along the column; false: it is lost",
        default=False,
    )
    em_gain: float = parameter(
        "gain of the multiplication register of an EMCCD", limit=Range(1, 1e5), default=1.0
    )
    em_stages: int = parameter(
        "number of stages of the multiplication register, each with a small gain",
        limit=Range(100, 10000),
        default=536,
    )
    # Above these limits, more light would give less signal.
    nonlinearity: float = parameter(
        "fraction by which the signal of a full pixel is too small",
        limit=Range(-0.49, 0.49),
        default=0.0,
    )
    pattern: Pattern | None = parameter("noise of rows and columns", default=None)
    settling: float = parameter(
        "fraction of the signal of a pixel that is added to the next pixel in the read-out",
        limit=Range(0, 0.99),
        default=0.0,
    )
    impulse_response: tuple[float, ...] = parameter(
        "response of the read-out channel to the charge of one pixel, in place of settling. The "
        "values begin when the charge enters, and may have any scale: their sum counts as 1. "
        "Undershoot is negative. Before the first pixel of a row the channel has its signal",
        limit=FINITE,
        default=(),
    )
    impulse_step: float | None = parameter(
        "time between the values of `impulse_response`, with linear interpolation; None: one value "
        "per pixel, the contribution to itself and to the pixels read after it",
        unit=Unit("s", "ns"),
        limit=POSITIVE,
        default=None,
    )
    read_noise_spread: float = parameter(
        "rms of the logarithm of the read noise over the pixels of a CMOS array; `read_noise` is "
        "the median",
        limit=Range(0, 2),
        default=0.0,
    )
    gain: float = parameter(
        "gain of the amplifier before the converter", limit=POSITIVE, default=1.0
    )
    adc_inl: float = parameter(
        "digital number, integral non-linearity of the converter at half scale",
        limit=FINITE,
        default=0.0,
    )
    scan: Scan | None = parameter("lines that scan the sky; None: a matrix", default=None)
    age: Age | None = parameter("damage by radiation in orbit; None: as at launch", default=None)
    charge_effects: tuple[str, ...] = parameter(
        "user code that changes the charge of all pixels at the end of the exposure, in the order "
        "of the list; see docs/extensions.md",
        limit=Range(code="charge_effects"),
        default=(),
    )
    signal_effects: tuple[str, ...] = parameter(
        "user code that changes the signal at the input of the converter",
        limit=Range(code="signal_effects"),
        default=(),
    )
    image_effects: tuple[str, ...] = parameter(
        "user code that changes the digital numbers", limit=Range(code="image_effects"), default=()
    )
    pixel_pitch_y: float | None = parameter(
        "distance of rows, if a datasheet states two pitches. A value other than pixel_pitch is "
        "refused, and the message names the nearest square pixels",
        unit=Unit("m", "um"),
        limit=POSITIVE,
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pixel_pitch_y not in (None, self.pixel_pitch):
            self._refuse_oblong(self.pixel_pitch, self.pixel_pitch_y)
        largest = 2**self.bits - 1
        if not self.offset < largest:
            raise Refused(
                f"offset must be below {largest}, the largest number of {self.bits} bits, got "
                f"{self.offset:g}"
            )
        if 4 * abs(self.adc_inl) >= 2**self.bits - 1:
            raise Refused(
                f"adc_inl must stay under a quarter of the converter's range, got {self.adc_inl}"
            )
        if self.impulse_response:
            self._check_impulse()
        elif self.impulse_step is not None:
            raise Refused("impulse_step must be left out without impulse_response")
        if self.region:
            self._check(self.region)
        if self.frame_rate:
            self._check_rate(self.frame_rate)
        if self.scan:
            self._check_scan(self.scan)
        if self.mosaic:
            self._check_mosaic()

    def _check_mosaic(self) -> None:
        beside = {
            "scan": (self.scan, None),
            "crosstalk": (self.crosstalk, 0.0),
            "binning": (self.binning, 1),
        }
        for name, (value, absent) in beside.items():
            if value != absent:
                raise Refused(f"{name} must be {absent} if mosaic is given, got {value}")

    def _refuse_oblong(self, x: float, y: float) -> None:
        square = math.sqrt(x * y)
        columns, rows = (
            round(n * pitch / square) for n, pitch in ((self.columns, x), (self.rows, y))
        )
        raise Refused(
            f"pixel_pitch_y must be pixel_pitch, {x / um:.4g} um, because pixels are square, "
            f"got {y / um:.4g} um; {columns} columns and {rows} rows of {square / um:.4g} um "
            "have the same field, light and dark current of a pixel, and equal errors of both "
            "axes"
        )

    def _check_impulse(self) -> None:
        """Refuse a response of the read-out channel that is too long or has no positive sum."""
        if self.settling:
            raise Refused("settling must be left out if impulse_response is given")
        if len(self.impulse_response) > LONGEST:
            raise Refused(
                f"impulse_response must have {LONGEST} values or fewer, got "
                f"{len(self.impulse_response)}"
            )
        total = sum(self.impulse_response)
        if not total > 1e-3 * sum(abs(value) for value in self.impulse_response):
            raise Refused(f"impulse_response must have a sum above 0, got {total:g}")
        if self.impulse_step is None:
            return
        pixels = len(self.impulse_response) * self.impulse_step * self.pixel_rate
        if len(self.impulse_response) < 2 or pixels > LONGEST:
            raise Refused(
                f"impulse_response must have two values or more, over {LONGEST} pixels or fewer, "
                f"got {len(self.impulse_response)} over {pixels:.3g}"
            )

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

    def _check_rate(self, rate: float) -> None:
        if self.scan:
            raise Refused("frame_rate must be left out for a detector that scans")
        read = self.rows * self.columns / self.pixel_rate
        most = 1 / max(self.exposure, read)
        if rate > most * (1 + 1e-9):
            raise Refused(
                f"frame_rate must be at most {most:.4g} Hz, by an exposure of "
                f"{1e3 * self.exposure:.4g} ms and a read-out of {1e3 * read:.4g} ms (pixel_rate), "
                f"got {rate:g} Hz"
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
            raise Refused(f"{name} must be left out for a detector that scans")
        if self.columns * scan.phases > self.pixel_rate * self.exposure * (1 + 1e-9):
            raise Refused(
                f"pixel_rate must read {self.columns * scan.phases} pixel within an exposure of "
                f"{self.exposure:g} s where lines scan, got {self.pixel_rate:g} pixel / s"
            )

    @property
    def pitch(self) -> float:
        """Metre, side of a pixel of the image."""
        return self.pixel_pitch * self.binning

    @property
    def shift(self) -> tuple[float, float]:
        """Pixel (x, y) from the centre of the image to the centre of the array."""
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
        """Reference temperature, kelvin, of dark currents; their ratio to the age's law's
        currents."""
        assert self.age
        law, thermal = TAILS.get(self.age.family), self.thermal
        if not thermal:
            return ROOM, 1.0
        to = 1 / replace(thermal, temperature=law.kelvin).growth if law else 1.0
        return thermal.reference, to

    @property
    def sensitivity(self) -> float:
        """1, detected light over the detected light at launch."""
        return self.age.sensitivity if self.age else 1.0

    @property
    def effects_by_code(self) -> tuple[str, ...]:
        """The names of user code in all keys."""
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
    def excess_noise(self) -> float:
        """Variance of the detected electrons over their mean, at the register's input: F^2.

            F^2 = 1 / g + 2 (g - 1) g^(-1 / N) / g,   gain g of N stages

        Source: Robbins and Hadwen (2003), IEEE Trans. Electron Devices 50, 1227, eq. (9).
        """
        gain = self.em_gain
        return 1 / gain + 2 * (gain - 1) / gain * gain ** (-1 / self.em_stages)

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
        """Second: exposure of a pixel of the image; for lines, the sum over the lines."""
        if not self.scan:
            return self.exposure
        return self.exposure * sum(line.gain for line in self.scan.all_lines) / self.scan.phases

    @property
    def update_rate(self) -> float:
        """Frames per second: `frame_rate`, or by exposure and read-out, which lines do together."""
        if self.frame_rate:
            return self.frame_rate
        if self.scan:
            return 1 / (self.exposure * self.rows)
        return 1 / (self.exposure + self.rows * self.columns / self.pixel_rate)

    @property
    def data_rate(self) -> float:
        """Bit per second."""
        return self.rows * self.columns * self.bits * self.update_rate
