"""Units as SI floats, constants with their source, and quantities and dates at the border.

`"50 mm"` is read and written without a rounding. A date is text, converted to astropy's Time. Earth
orientation, leap seconds and ephemerides are those installed with astropy and its package
astropy-iers-data, also at dates beyond their end. Nothing is downloaded, and no result depends on
the day on which it is computed.
"""

import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal, DecimalException
from functools import lru_cache
from typing import Any, NamedTuple

from startrack.core.checks import Refused

PLANCK = 6.62607015e-34  # J s, exact in the SI of 2019
LIGHT_SPEED = 299792458.0  # m / s, exact in the SI of 2019
BOLTZMANN = 1.380649e-23  # J / K, exact in the SI of 2019

nm = 1e-9  # metre
um = 1e-6  # metre
mm = 1e-3  # metre
deg = math.pi / 180  # radian
arcsec = deg / 3600  # radian

DAY = 86400.0  # second
YEAR = 365.25 * DAY  # second, Julian
TROPICAL_YEAR = 365.2422 * DAY  # second, from equinox to equinox
SIDEREAL_YEAR = 365.256 * DAY  # second, of the Earth's way round the Sun

ZERO_CELSIUS = 273.15  # kelvin
CELSIUS = ("degC", "deg_C", "°C", "Celsius", "celsius")

# Unit vector to the galactic pole, ICRS axes: right ascension and declination of J2000 (IAU 1958).
GALACTIC_POLE = (
    math.cos(27.12825 * deg) * math.cos(192.85948 * deg),
    math.cos(27.12825 * deg) * math.sin(192.85948 * deg),
    math.sin(27.12825 * deg),
)
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))  # radian; turns by it fill a disc evenly

# Prefixes that differ by 10^9 or more from another prefix with the same letter, before units of
# small quantities; and thousandths of counted things, which do not exist.
SLIPS = re.compile(
    r"\b([MPZY])(?=(?:m|s|rad|arcsec|arcmin|deg|K|g|W|V|A|J|N|mag)\b)"
    r"|\b(m)(?=(?:b|bit|B|byte|pix|pixel)\b)"
)
LONGEST = 100  # characters of a quantity, so that no text takes long to read
# Units as datasheets write them -> as astropy does.
SPELLINGS = (
    (re.compile(r"\s+rms$"), ""),
    (re.compile(r"\bke-"), "1000 electron"),
    (re.compile(r"\be-|\belectrons\b"), "electron"),
    (re.compile(r"\b(px|pixels)\b"), "pixel"),
    (re.compile(r"\b(inch|inches|in)\b"), "2.54 cm"),
    (re.compile(r"\b(foot|feet|ft)\b"), "30.48 cm"),
    (re.compile(r"\bmicrons\b"), "micron"),
    (re.compile(r"\b([mu]?)sec\b"), r"\1s"),
    (re.compile(r"\brpm\b"), "cycle / min"),
)
A_PIXEL = re.compile(r"\s*/\s*(px|pix|pixel)\b")  # of charge: "e-/px/s"
DOSE = re.compile(r"\b([kM]?)rad(\(Si\))?")  # of radiation, where the unit is no angle
# Factors between the units of most designs, equal to astropy's, whose import takes 0.2 s.
SCALES = {
    **{
        (unit, unit): 1.0
        for unit in (
            *("m", "s", "rad", "K", "kg", "W", "Hz", "electron", "pixel"),
            *("electron / s", "K / m", "W / m2"),
        )
    },
    ("nm", "m"): 1e-9,
    ("um", "m"): 1e-6,
    ("mm", "m"): 1e-3,
    ("km", "m"): 1000.0,
    ("ms", "s"): 1e-3,
    ("yr", "s"): 31557600.0,
    ("arcsec", "rad"): 4.84813681109536e-06,
    ("arcmin", "rad"): 0.0002908882086657216,
    ("deg", "rad"): 0.017453292519943295,
    ("deg / s", "rad/s"): 0.017453292519943295,
    ("arcsec2 / Hz", "rad2 / Hz"): 2.3504430539097885e-11,
    ("um / (m K)", "1 / K"): 1e-6,
    ("Mpix / s", "pix / s"): 1e6,
    ("nJ / bit", "J / bit"): 1e-9,
}
PERCENT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*%\s*")
CLOCK = re.compile(r"\s*(\d{1,2}):([0-5]\d)(?::([0-5]\d(?:\.\d+)?))?\s*")  # hours, minutes, seconds
NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*((?:[^\W\d]|°).*?)?\s*")


class Unit(NamedTuple):
    """Unit of a parameter: `Annotated[float, Unit("m", "mm")]` is in metre, in files in millimetre.

    absolute  whether it is a temperature, which files may give in degC, not a temperature
              difference
    clock     whether it is a time of day, which files may give as "10:30"
    others    further units allowed in files; the reader of a file converts them
    """

    si: str
    in_files: str = ""
    absolute: bool = False
    clock: bool = False
    others: tuple[str, ...] = ()

    @property
    def shown(self) -> str:
        """The unit to write."""
        return self.in_files or self.si

    def of(self, value: float) -> float:
        """A value in SI units as a number of the unit to write."""
        if not self.in_files:
            return float(value)
        return float(write(value, self.si, self.shown).partition(" ")[0])


def parse(text: str, unit: str, absolute: bool = False, clock: bool = False) -> float:
    """Turn a number with a unit into a float in another unit.

    The product is computed in decimal, so that "50 mm" is exactly the float 0.05.

    >>> parse("50 mm", "m")
    0.05
    >>> parse("20 degC", "K", absolute=True)
    293.15
    >>> parse("10:30", "s", clock=True)
    37800.0

    text      a number and a unit as astropy writes them: "50 mm", "5 deg", "10 electron / s"; also
              "10 e-/s", "10 e-/px/s", "20 ke-", "5 e- rms", "2 px", "2 in", "6 ft", "3 sec",
              "1 rpm", and "3 krad(Si)" or "3 krad" of a dose
    unit      unit of the result
    absolute  whether degC is a unit too, for the temperature itself and no difference
    clock     whether hours:minutes and hours:minutes:seconds are a time of day, in second
    Returns   the value in that unit, correctly rounded
    Raises    ValueError if the text is not a number with a unit, its unit does not convert, or the
              number is beyond all floats.
    """
    if len(text) > LONGEST:
        raise Refused(
            f"must be a number with a unit of at most {LONGEST} characters, got {len(text)}"
        )
    if clock and (day := CLOCK.fullmatch(text)):
        return 3600.0 * int(day[1]) + 60.0 * int(day[2]) + float(day[3] or 0)
    match = NUMBER.fullmatch(text)
    if not match or not match[2]:
        raise Refused(f"must be a number with a unit, such as '1 {unit}', got {text!r}")
    if absolute and match[2] in CELSIUS:
        return float(Decimal(match[1]) + Decimal(str(ZERO_CELSIUS)))
    scale = _scale(match[2], unit)
    if scale is None:
        raise Refused(f"must have a unit that converts to {unit}, got {text!r}")
    try:
        value = float(Decimal(match[1]) * scale)
    except DecimalException:
        value = math.inf
    if not math.isfinite(value):
        raise Refused(f"must be a finite number in {unit}, got {text!r}")
    dose = "Gy" in unit and "rad" in match[2]
    if value and not dose and (slip := SLIPS.search(match[2])):
        other = match[2][: slip.start()] + slip[0].swapcase() + match[2][slip.end() :]
        raise Refused(
            f"must not look like a slip of capitals: {text!r} is {value:g} {unit}; did you mean "
            f"'{match[1]} {other}'? If not, write '{value!r} {unit}'"
        )
    return value


def fraction(text: str) -> float | None:
    """A percentage as a fraction, correctly rounded; None where the text is none.

    >>> fraction("35 %")
    0.35
    """
    match = PERCENT.fullmatch(text) if len(text) <= LONGEST else None
    try:
        value = float(Decimal(match[1]).scaleb(-2)) if match else math.inf
    except DecimalException:  # an exponent of many digits
        return None
    return value if math.isfinite(value) else None


def write(value: float, unit: str, shown: str) -> str:
    """Turn a float in `unit` into the shortest text in the unit `shown` that reads back the same.

    >>> write(0.05, "m", "mm")
    '50 mm'
    """
    celsius = shown in CELSIUS and unit == "K"
    scale = Decimal(1) if celsius else _scale(shown, unit)
    assert scale is not None, f"{shown} does not convert to {unit}"
    zero = Decimal(str(ZERO_CELSIUS)) if celsius else Decimal(0)
    for digits in range(1, 19):
        text = f"{(Decimal(value) - zero) / scale:.{digits}g}"
        if float(Decimal(text) * scale + zero) == value:
            break
    number = float(text)
    return f"{int(number) if number.is_integer() and abs(number) < 1e15 else text} {shown}"


@lru_cache(maxsize=256)
def _scale(source: str, target: str) -> Decimal | None:
    """Factor between two units, None where they do not convert."""
    if (source, target) in SCALES:
        return Decimal(repr(SCALES[source, target]))
    from astropy import units  # costs 0.3 s, and only files with other units need it

    for pattern, spelling in SPELLINGS:
        source = pattern.sub(spelling, source)
    if "electron" in source and "pix" not in target:
        source = A_PIXEL.sub("", source)
    if "Gy" in target:
        source = DOSE.sub(r"0.01 \1Gy", source)
    try:
        scale = float(units.Unit(source).to(units.Unit(target)))
    except Exception:  # a text from anybody: its parser raises errors of many kinds
        return None
    return Decimal(repr(scale)) if 0 < scale < math.inf else None


@contextmanager
def installed_tables() -> Iterator[None]:
    """Context in which astropy converts times and axes with its installed tables, however old.

    Every use of astropy's Time and coordinates belongs in it: the first conversion of a time in a
    process looks for newer leap seconds, and each conversion to the Earth's axes for a newer Earth
    orientation. It may be nested.

    Accuracy    model: beyond the installed Earth orientation, which ends about a year after its
                release, UT1 - UTC keeps its last value u, and before its beginning in 1973 its
                first. While leap seconds are kept, |UT1 - UTC| < 0.9 s, and the angle of the
                Earth's rotation errs by less than 0.9 s + |u|; a second is 465 m of ground at the
                equator. So the error is below 0.84 km, and below 0.52 km for u = -0.21 s, with
                which the table of November 2026 ends. Measured with tables cut off in 2000 to
                2024, at observed dates until 2026: 1.17 s (0.54 km) at most, five leap seconds
                after a table that ended in 2005; 0.08 s (35 m) 19 months after one that ended in
                2024. Without leap seconds the bound would not hold: UT1 has drifted from atomic
                time by 0 to 1 s a year since 1973.
                The pole is then its mean of 1962 to 2014: 0.31 arcsec (10 m) off at most since
                1973.
                Leap seconds decided after the release are unknown. Each puts the time of
                ephemerides 1 s off: the Earth is 30 km away, the direction of the Sun is 0.04
                arcsec off, that of a planet less than 0.1 arcsec, that of the Moon 0.55 arcsec;
                aberration changes by 4e-6 arcsec, parallax by 2e-7 of itself. An orbit over ground
                does not change.
    """
    from astropy.utils import iers  # costs 0.3 s, and only dates need it

    with (
        iers.conf.set_temp("auto_download", value=False),
        iers.conf.set_temp("auto_max_age", None),
        iers.conf.set_temp("iers_degraded_accuracy", "ignore"),
        warnings.catch_warnings(),
    ):
        warnings.filterwarnings("ignore", message=".*dubious year.*")  # leap seconds to come
        # Nothing is fetched: installed tables are used beyond their end, with an error below a
        # second.
        warnings.filterwarnings("ignore", message=".*(polar motions|IERS).*")
        warnings.filterwarnings("ignore", category=iers.IERSStaleWarning)
        yield


def utc(text: str) -> Any:
    """A time from ISO 8601, UTC.

    Raises  ValueError if the text is not a time.
    """
    from astropy.time import Time

    try:
        with installed_tables():
            return Time(text.removesuffix("Z"), scale="utc")
    except ValueError:
        raise Refused(f"epoch must be a time such as 2026-06-21T10:00:00, got {text!r}") from None


def utc_text(begin: str, second: float, whole: bool = True) -> str:
    """The time, UTC, that is SI seconds after another.

    whole  whether a fraction of a second is left out
    """
    from astropy.time import TimeDelta

    with installed_tables():
        text = str((utc(begin) + TimeDelta(second, format="sec")).isot)
    return text[:19] if whole else text.removesuffix(".000")
