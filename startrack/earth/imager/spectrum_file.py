"""Text file of a spectral library, a filter or a detector -> the table of a Curve."""

import math
import re
from pathlib import Path
from typing import Any

from startrack.core import FINITE, Parameters, Range, Refused, parameter, parse, um
from startrack.io import content, regular_file, with_points

# Lines of spectral libraries that name the unit of wavelengths, or of values.
OF_WAVELENGTHS = re.compile(r"\W*x\s*units\W", re.IGNORECASE)
OF_VALUES = re.compile(r"\W*y\s*units\W", re.IGNORECASE)
# Units, but not those behind a number, as in the name of a filter.
WAVELENGTHS = {
    "nm": re.compile(r"(?<![a-z\d])(?<!\d\s)(nm|nano-?met\w+)(?![a-z])", re.IGNORECASE),
    "um": re.compile(
        r"(?<![a-z\d])(?<!\d\s)([u\u00b5\u03bc]m|microns?|micro-?met\w+)(?![a-z])", re.IGNORECASE
    ),
    "angstrom": re.compile(r"(?<!\w)\u00c5(?!\w)|(?<![a-z])[Aa]ngstroms?(?![a-z])"),
    "1 / cm": re.compile(r"(?<!\d\s)\bcm\s*\^?-1|1\s*/\s*cm|wave-?\s?number", re.IGNORECASE),
}
PER_CENT = re.compile(r"(?<![\d\s.])\s*(?:%|per\s?cent\w*)", re.IGNORECASE)
IN_BRACKETS = re.compile(r"[(\[]\s*(?:%|per\s?cent\w*)\s*[)\]]", re.IGNORECASE)
UNCERTAIN = re.compile(
    r"uncert|error|sigma|deviation", re.IGNORECASE
)  # of values, in other columns
SHORTEST, LONGEST = 0.1 * um, 300 * um  # metre, wavelengths of libraries of spectra
BRIGHTEST = 1.3  # largest value of a library: noise, and reflectance factors of snow and panels


class SpectrumFile(Parameters):
    """A curve in a text file: each line begins with a wavelength and a value.

    Lines that do not begin with two numbers are skipped, and so are values below -1, which mark
    missing values. Separators are commas, semicolons, tabs or spaces. Units that the lines before
    the numbers name must be those of `unit` and `factor`.
    """

    file: str = parameter("path, relative to the scene file")
    unit: str = parameter(
        "unit of the wavelengths: nm or um", limit=Range(choices=("nm", "um")), default="um"
    )
    factor: float = parameter(
        "1, factor of the values: 0.01 for per cent", limit=FINITE, default=1.0
    )

    def read(self, folder: Path) -> dict[str, Any]:
        """The table of a Curve, with values clipped to [0, 1].

        Raises  ValueError if the file has no curve, fewer than two different wavelengths, two
                values of one wavelength, other units, or values that are no fractions.
        """
        path = folder / self.file
        regular_file(path, "a table of a spectrum")
        curve, above = dict[float, float](), list[str]()
        for line in content(path, "a table of a spectrum").splitlines():
            # A comma is a decimal comma if another character separates the columns.
            between = r"[;\s]+" if re.search(r"[;\t]|\d\s+[-+\d]", line.strip()) else r"[,\s]+"
            words = [with_points(word.strip(",")) for word in re.split(between, line.strip())[:2]]
            try:
                wavelength, value = (float(re.sub("[dD]", "e", word)) for word in words)
            except ValueError:
                if not curve and line.strip():
                    above.append(line)
                continue
            if not (math.isfinite(value) and value >= -1):
                continue
            if curve.setdefault(wavelength, value) != value:
                raise Refused(
                    f"{path} must hold one value of a wavelength, got {curve[wavelength]:g} and "
                    f"{value:g} at {wavelength:g} {self.unit}"
                )
        if len(curve) < 2:
            raise Refused(
                f"{path} must hold a wavelength and a value in each of two lines or more, got "
                f"{len(curve)}"
            )
        self._refuse_units(path, curve, above)
        return {
            "wavelength": [f"{node!r} {self.unit}" for node in sorted(curve)],
            "value": [min(max(curve[node] * self.factor, 0.0), 1.0) for node in sorted(curve)],
        }

    def _refuse_units(self, path: Path, curve: dict[float, float], above: list[str]) -> None:
        """Refuse a curve in other units, by the lines above it or by its numbers."""
        wavelengths, values = _named(above)
        named = [unit for unit, names in WAVELENGTHS.items() if names.search(wavelengths)]
        if named and self.unit not in named:
            raise Refused(
                f"{path} must have wavelengths in {self.unit}, the key unit, but it names "
                f"{named[0]}"
            )
        if self.factor == 1 and PER_CENT.search(values) and not UNCERTAIN.search(values):
            raise Refused(f"{path} has values in per cent, so that the key factor must be 0.01")
        for node in (min(curve), max(curve)):
            if not SHORTEST <= parse(f"{node!r} {self.unit}", "m") <= LONGEST:
                raise Refused(
                    f"{path} must have wavelengths from {SHORTEST / um:g} to {LONGEST / um:g} um, "
                    f"got {node:g} in {self.unit}, the key unit"
                )
        highest = max(curve.values()) * self.factor
        if highest > BRIGHTEST:
            raise Refused(
                f"{path} must have fractions from 0 to 1 after the key factor, got {highest:g}: "
                "factor = 0.01 is for per cent"
            )


def _named(above: list[str]) -> tuple[str, str]:
    """What the lines before the numbers call the wavelengths, and the values; empty for nothing."""
    wavelengths = [line for line in above if OF_WAVELENGTHS.match(line)]
    values = [line for line in above if OF_VALUES.match(line)]
    names = re.split(r"[,;\t]|\s{2,}", above[-1].strip()) if above else []
    if len(names) > 1:
        wavelengths, values = [*wavelengths, names[0]], [*values, names[1]]
    elif names and IN_BRACKETS.search(names[0]):
        values.append(names[0])
    return " ".join(wavelengths), " ".join(values)
