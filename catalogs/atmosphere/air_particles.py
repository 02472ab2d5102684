"""Scattering by particles, from type of aerosol, for new tables of the air."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    nm,
    parameter,
    um,
)

REFERENCE = 550 * nm  # of visibility and extinction
MOMENTS = 200  # of the phase function, which also sets the quadrature over its angle
# Dry particles, dust-like and water-soluble in the fractions 0.3 and 0.7; and soot in towns. Over
# the sea the small ones, and sea salt in place of the large ones, both grown at a relative humidity
# of 80 %.
# Source: Shettle and Fenn (1979), AFGL-TR-79-0214, tables 1 and 2; indices of the components as
# in WMO (1983), WCP-55; of water, Hale and Querry (1973), Appl. Opt. 12, 555.
SIZES = {  # median radii
    "rural": (0.027 * um, 0.43 * um),
    "urban": (0.025 * um, 0.40 * um),
    "maritime": (0.03274 * um, 0.3180 * um),
}
DRY = {"maritime": (0.027 * um, 0.16 * um)}  # before they grew
SPREADS = (0.35, 0.40)  # standard deviation of log10(radius)
FRACTIONS = {  # of the number of particles
    "rural": (0.999875, 0.000125),
    "urban": (0.999875, 0.000125),
    "maritime": (0.99, 0.01),
}
SOOT = {"rural": 0.0, "urban": 0.2, "maritime": 0.0}  # of the volume
INDEX_AT: Floats = np.array([400, 488, 550, 633, 694, 860, 1060, 1300, 1536, 1800, 2000]) * nm
REAL: Floats = np.array([1.53, 1.53, 1.53, 1.53, 1.53, 1.52, 1.52, 1.4785, 1.4445, 1.4048, 1.34])
DUST: Floats = np.full(11, 8e-3)
SOLUBLE: Floats = (
    np.array([5.0, 5.0, 6.0, 6.0, 7.0, 12.0, 17.0, 20.0, 23.0, 17.0, 10.0], np.float64) * 1e-3
)
SOOT_INDEX = 1.75 - 0.44j
SALT: Floats = np.array([1.50, 1.50, 1.50, 1.49, 1.49, 1.48, 1.47, 1.47, 1.46, 1.45, 1.45])
SALT_ABSORBS: Floats = np.array([3e-8, 2e-8, 1e-8, 2e-8, 1e-7, 3e-6, 2e-4, 4e-4, 6e-4, 8e-4, 1e-3])
WATER: Floats = np.array([
    *(1.339, 1.335, 1.333, 1.332, 1.331, 1.329, 1.326, 1.321, 1.316, 1.312, 1.306),
])  # fmt: skip


def sasktran2(part: str = "") -> Any:
    """The package, or a module of it.

    part    of its name, such as "mie.distribution"
    Raises  ModuleNotFoundError where it is missing.
    """
    try:
        package = importlib.import_module("sasktran2")
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            "new tables of the air need sasktran2: python -m pip install 'startrack[earth]'"
        ) from missing
    return importlib.import_module(f"sasktran2.{part}") if part else package


def mie(
    modes: Sequence[Any], fractions: Sequence[float], wavelength: Floats, index: Any, moments: int
) -> tuple[Floats, Floats, Floats]:
    """Extinction, scattering and Legendre moments of a mixture of particles.

    modes       frozen distributions of scipy over the radius in nanometre
    shares      of their numbers
    wavelength  (k,) metre
    index       (k,) refractive index
    Returns     (k,) square metre, (k,) square metre, (k, moments) 1
    Raises      ModuleNotFoundError where sasktran2 is missing.
    """
    at = dict(zip(wavelength / nm, index, strict=True))
    by_mode_and_wavelength = sasktran2("mie.distribution").integrate_mie_cpp(
        list(modes), lambda nanometres: at[float(nanometres)], wavelength / nm, num_coeffs=moments
    )
    weights = np.asarray(fractions)
    extinction = by_mode_and_wavelength["xs_total"].to_numpy() @ weights
    by_mode = by_mode_and_wavelength["xs_scattering"].to_numpy() * weights
    scattering = by_mode.sum(-1)
    phase = (by_mode_and_wavelength["lm_a1"].to_numpy() * by_mode[:, :, None]).sum(1) / scattering[
        :, None
    ]
    return extinction, scattering, phase


@dataclass(frozen=True, eq=False)
class Particles:
    """Scattering by the mixture of particles."""

    extinction: Floats  # (k,) 1, over that at 550 nm
    albedo: Floats  # (k,) 1, of single scattering
    moments: Floats  # (k, MOMENTS) 1, Legendre moments of the phase function, (2 l + 1) g_l


class Haze(Parameters):
    """Aerosol that thins out exponentially with height, and as a power of the wavelength.

        extinction = optical_depth / scale_height exp(-height / scale_height)
                     (wavelength / 550 nm)^-angstrom

    The optical depth is that of all heights above the sea.
    """

    optical_depth: float = parameter("1, vertical, at 550 nm above the sea", limit=NON_NEGATIVE)
    scale_height: float = parameter("metre", limit=POSITIVE, default=2e3)
    angstrom: float = parameter("1, exponent", limit=FINITE, default=1.3)
    albedo: float = parameter("1, of single scattering", limit=Range(0, 1), default=0.95)
    asymmetry: float = parameter(
        "1, mean cosine of the scattering angle", limit=Range(-0.95, 0.95), default=0.65
    )
    phase: tuple[float, ...] = parameter(
        "1, of a measured phase function at `angles` instead of Henyey and Greenstein's; its "
        "scale is free",
        default=(),
    )
    angles: tuple[float, ...] = parameter("radian from 0 to pi, rising", default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.phase) != len(self.angles):
            raise ValueError(
                f"phase and angles must be as many, got {len(self.phase)} and {len(self.angles)}"
            )
        if self.phase:
            rising = all(b > a for a, b in pairwise(self.angles))
            if not rising or self.angles[0] != 0 or abs(self.angles[-1] - math.pi) > 1e-6:
                raise ValueError(f"angles must rise from 0 to pi, got {self.angles}")
            if min(self.phase) < 0 or not max(self.phase) > 0:
                raise ValueError(f"phase must be at least 0, and somewhere more: {self.phase}")

    def profile(self, height: Floats) -> Floats:
        """Extinction (n,) 1 / metre at 550 nm, at (n,) metre above the sea."""
        return self.optical_depth / self.scale_height * np.exp(-height / self.scale_height)

    def particles(self, wavelength: Floats, moments: int) -> Particles:
        """At (k,) metre, with a number of moments of the phase function."""
        ones = np.ones(len(wavelength))
        extinction = (wavelength / REFERENCE) ** -self.angstrom
        order = np.arange(moments)
        legendre_moments = (2 * order + 1) * self.asymmetry**order
        if self.phase:
            nodes, weights = np.polynomial.legendre.leggauss(2 * moments)
            weighted = np.interp(np.arccos(nodes), self.angles, self.phase) * weights
            legendre = np.polynomial.legendre.legvander(nodes, moments - 1)
            legendre_moments = (2 * order + 1) * (weighted @ legendre) / weighted.sum()
        return Particles(extinction, self.albedo * ones, ones[:, None] * legendre_moments)


def index(aerosol: str, wavelength: Floats, mode: int = 0) -> NDArray[np.complex128]:
    """Refractive index of a mode's particles, mixed by volume; held beyond 0.4 and 2 micrometre.

    wavelength  (k,) metre
    mode        0 of the small particles, 1 of the large ones
    Returns     (k,) 1, negative imaginary part absorbs
    """
    at = [np.interp(wavelength, INDEX_AT, part) for part in (REAL, DUST, SOLUBLE)]
    natural = at[0] - 1j * (0.3 * at[1] + 0.7 * at[2])
    mixed = (1 - SOOT[aerosol]) * natural + SOOT[aerosol] * SOOT_INDEX
    if aerosol in DRY:
        if mode:
            salt, absorbs = (np.interp(wavelength, INDEX_AT, part) for part in (SALT, SALT_ABSORBS))
            mixed = salt - 1j * absorbs
        dry = (DRY[aerosol][mode] / SIZES[aerosol][mode]) ** 3  # fraction of the volume
        mixed = dry * mixed + (1 - dry) * np.interp(wavelength, INDEX_AT, WATER)
    return mixed.astype(np.complex128)


@lru_cache(maxsize=8)
def particles(aerosol: str, wavelength: tuple[float, ...]) -> Particles:
    """Mie scattering of two log-normal modes.

    wavelength  metre
    Raises      ModuleNotFoundError where sasktran2 is missing.
    Accuracy    model: spheres, dry but over the sea. At 550 nm albedo and asymmetry of the rural
                type come out as 0.941 and 0.648, where Shettle and Fenn print 0.941 and 0.648.
    """
    from scipy.stats import lognorm

    at = np.array([REFERENCE, *wavelength])
    modes = []
    for mode, (radius, spread) in enumerate(zip(SIZES[aerosol], SPREADS, strict=True)):
        sizes = lognorm(s=math.log(10) * spread, scale=radius / nm)
        modes.append(mie([sizes], (1.0,), at, index(aerosol, at, mode), MOMENTS))
    extinction, scattering = (np.array(FRACTIONS[aerosol]) @ [m[n] for m in modes] for n in (0, 1))
    parts = [part * m[1] for part, m in zip(FRACTIONS[aerosol], modes, strict=True)]
    moments = sum(part[:, None] * m[2] for part, m in zip(parts, modes, strict=True))
    moments = moments / scattering[:, None]
    return Particles(extinction[1:] / extinction[0], scattering[1:] / extinction[1:], moments[1:])
