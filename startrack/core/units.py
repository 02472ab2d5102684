"""Units as SI floats, constants with their source, and `"50 mm"` read and written at the border."""

from __future__ import annotations

import math
import re
from decimal import Decimal, DecimalException
from functools import lru_cache
from typing import NamedTuple

from startrack.core.checks import Refused

PLANCK = 6.62607015e-34  # J s, exact in the SI of 2019
LIGHT_SPEED = 299792458.0  # m / s, exact in the SI of 2019
BOLTZMANN = 1.380649e-23  # J / K, exact in the SI of 2019

nm = 1e-9  # metre
um = 1e-6  # metre
mm = 1e-3  # metre
deg = math.pi / 180  # radian
arcsec = deg / 3600  # radian

ZERO_CELSIUS = 273.15  # kelvin
CELSIUS = ("degC", "deg_C", "°C", "Celsius", "celsius")

# Unit vector to the galactic pole, ICRS axes: right ascension and declination of J2000 (IAU 1958).
GALACTIC_POLE = (
    math.cos(27.12825 * deg) * math.cos(192.85948 * deg),
    math.cos(27.12825 * deg) * math.sin(192.85948 * deg),
    math.sin(27.12825 * deg),
)
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))  # radian; turns by it fill a disc evenly

LONGEST = 100  # characters of a quantity, so that no text takes long to read
# Units as datasheets write them -> as astropy does.
SPELLINGS = (
    (re.compile(r"\s+rms$"), ""),
    (re.compile(r"\bke-"), "1000 electron"),
    (re.compile(r"\be-|\belectrons\b"), "electron"),
)
A_PIXEL = re.compile(r"\s*/\s*(px|pix|pixel)\b")  # of charge: "e-/px/s"
DOSE = re.compile(r"\b([kM]?)rad(\(Si\))?")  # of radiation, where the unit is no angle
PERCENT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*%\s*")
CLOCK = re.compile(r"\s*(\d{1,2}):([0-5]\d)(?::([0-5]\d(?:\.\d+)?))?\s*")  # hours, minutes, seconds
NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*((?:[^\W\d]|°).*?)?\s*")


class Unit(NamedTuple):
    """Of a parameter: `Annotated[float, Unit("m", "mm")]` is in metre, in files in millimetre.

    absolute  whether it is a temperature, which files may give in degC, and no difference of two
    clock     whether it is a time of day, which files may give as "10:30"
    """

    si: str
    in_files: str = ""
    absolute: bool = False
    clock: bool = False

    @property
    def shown(self) -> str:
        """The unit to write."""
        return self.in_files or self.si


def parse(text: str, unit: str, absolute: bool = False, clock: bool = False) -> float:
    """Turn a number with a unit into a float in another unit.

    The product is taken in decimal, so that "50 mm" is 0.05 m and not a neighbour of it.

    >>> parse("50 mm", "m")
    0.05
    >>> parse("20 degC", "K", absolute=True)
    293.15
    >>> parse("10:30", "s", clock=True)
    37800.0

    text      a number and a unit as astropy writes them: "50 mm", "5 deg", "10 electron / s"; also
              "10 e-/s", "10 e-/px/s", "20 ke-", "5 e- rms", and "3 krad(Si)" or "3 krad" of a dose
    unit      unit of the result
    absolute  whether degC is a unit too, for the temperature itself and no difference
    clock     whether hours:minutes and hours:minutes:seconds are a time of day, in second
    Returns   the value in that unit, correctly rounded
    Raises    ValueError where the text is no number with a unit, its unit does not convert, or the
              number is beyond all floats.
    """
    if len(text) > LONGEST:
        raise Refused(
            f"must be a number with a unit of at most {LONGEST} characters, got {len(text)}"
        )
    if clock and (day := CLOCK.fullmatch(text)):
        return 3600.0 * int(day[1]) + 60.0 * int(day[2]) + float(day[3] or 0)
    found = NUMBER.fullmatch(text)
    if not found or not found[2]:
        raise Refused(f"must be a number with a unit, such as '1 {unit}', got {text!r}")
    if absolute and found[2] in CELSIUS:
        return float(Decimal(found[1]) + Decimal(str(ZERO_CELSIUS)))
    scale = _scale(found[2], unit)
    if scale is None:
        raise Refused(f"must have a unit that converts to {unit}, got {text!r}")
    try:
        value = float(Decimal(found[1]) * scale)
    except DecimalException:
        value = math.inf
    if not math.isfinite(value):
        raise Refused(f"must be a finite number in {unit}, got {text!r}")
    return value


def fraction(text: str) -> float | None:
    """A percentage as a fraction, correctly rounded; None where the text is none.

    >>> fraction("35 %")
    0.35
    """
    found = PERCENT.fullmatch(text) if len(text) <= LONGEST else None
    value = float(Decimal(found[1]).scaleb(-2)) if found else math.inf
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
    from astropy import units  # costs 0.3 s, and only files with units need it

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
