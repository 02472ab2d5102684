"""A dimensionless curve over wavelength, such as a transmission or a quantum efficiency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from startrack.core.checks import positive, within
from startrack.core.refused import Refused
from startrack.core.units import Unit


@dataclass(frozen=True)
class Curve:
    """Values in [0, 1] at wavelengths, straight lines between them and zero outside.

    A curve with one value and no wavelength is the same everywhere.
    """

    wavelength: Annotated[tuple[float, ...], Unit("m", "nm"), "rising, one for each value"] = ()
    value: Annotated[tuple[float, ...], "at each wavelength, or one for all"] = (1.0,)

    def __post_init__(self) -> None:
        if len(self.wavelength) != (len(self.value) if len(self.value) > 1 else 0):
            raise Refused(
                "wavelength and value must have the same length (or one value and no wavelength), "
                f"got {len(self.wavelength)} and {len(self.value)}"
            )
        for each in self.wavelength:
            positive(wavelength=each)
        for each in self.value:
            within(0, 1, value=each)
        if any(b <= a for a, b in zip(self.wavelength, self.wavelength[1:], strict=False)):
            raise Refused(f"wavelength must rise, got {self.wavelength}")

    def __call__(self, wavelength: NDArray[np.float64]) -> NDArray[np.float64]:
        """The curve at wavelengths in metre."""
        if not self.wavelength:
            return np.full(np.shape(wavelength), self.value[0])
        return np.interp(wavelength, self.wavelength, self.value, left=0.0, right=0.0)

    def scaled(self, factor: float) -> Curve:
        """The curve times a factor, within [0, 1]."""
        return Curve(self.wavelength, tuple(min(max(one * factor, 0.0), 1.0) for one in self.value))


ALL = Curve()  # nothing is lost at any wavelength
