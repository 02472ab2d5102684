"""FieldPolynomial: a place in the image plane and a temperature -> how far it is moved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from startrack.core.arrays import Floats
from startrack.core.checks import finite
from startrack.core.declared import Parameters, Range
from startrack.core.refused import Refused
from startrack.core.units import ZERO_CELSIUS, Unit

ORDER = 3
TERMS = 10  # monomials of two variables up to the third order
ROOM = ZERO_CELSIUS + 20.0  # kelvin


COEFFICIENTS = "coefficients of m; those that are left out at the end are 0"


@dataclass(frozen=True)
class FieldPolynomial(Parameters):
    """A polynomial over the field, to the third order, that grows linearly with temperature.

        u' = u + sum_j (x_j + (T - T0) x_per_kelvin_j) m_j(u, v)
        v' = v + sum_j (y_j + (T - T0) y_per_kelvin_j) m_j(u, v)
        m  = 1, u, v, u^2, uv, v^2, u^3, u^2 v, u v^2, v^3

    with u = x / z and v = y / z of a direction in camera axes. OpenCV's distortion is added to it.

    Source: the form is that of the calibration of Chandra's aspect camera, which goes from pixels
    to angles (chandra_aca, transform.py); this one goes from directions to pixels.
    """

    x: Annotated[tuple[float, ...], COEFFICIENTS] = ()
    y: Annotated[tuple[float, ...], COEFFICIENTS] = ()
    x_per_kelvin: Annotated[tuple[float, ...], "growth of these coefficients"] = ()
    y_per_kelvin: Annotated[tuple[float, ...], "growth of these coefficients"] = ()
    temperature: Annotated[float, Unit("K", "degC", absolute=True), Range(1, 1000),
        "T, that the camera has"] = ROOM  # fmt: skip
    reference: Annotated[float, Unit("K", "degC", absolute=True), Range(1, 1000),
        "T0, to which x and y belong"] = ROOM  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("x", "y", "x_per_kelvin", "y_per_kelvin"):
            values = getattr(self, name)
            if len(values) > TERMS:
                raise Refused(
                    f"{name} must have at most {TERMS} coefficients, those of the third order, "
                    f"got {len(values)}"
                )
            finite(**{f"{name}[{n}]": value for n, value in enumerate(values)})

    def at(self, temperature: float) -> FieldPolynomial:
        """The same polynomial at another temperature, kelvin."""
        return replace(self, temperature=temperature)

    def shift(self, plane: Floats, temperature: Floats | None = None) -> Floats:
        """By how much places are moved.

        plane        (n, 2) u and v
        temperature  (n,) kelvin of each; None: that of the camera
        Returns      (n, 2)
        """
        terms = monomials(plane)
        warmer = (self.temperature if temperature is None else temperature) - self.reference
        parts = ((self.x, self.x_per_kelvin), (self.y, self.y_per_kelvin))
        return np.column_stack(
            [_sum(terms, fixed) + warmer * _sum(terms, growing) for fixed, growing in parts]
        )


def monomials(plane: Floats, terms: int = TERMS) -> Floats:
    """The first monomials (n, terms) of places (n, 2)."""
    u, v = np.asarray(plane, float).T
    powers = [u ** (d - k) * v**k for d in range(ORDER + 1) for k in range(d + 1)]
    return np.column_stack(powers[:terms]) if len(u) else np.empty((0, terms))


def _sum(terms: Floats, coefficients: tuple[float, ...]) -> Floats:
    return np.asarray(terms[:, : len(coefficients)] @ np.asarray(coefficients, float))
