"""The one file that imports sasktran2: Mie scattering by mixtures of particles."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from startrack.core import Floats, nm


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
    found = sasktran2("mie.distribution").integrate_mie_cpp(
        list(modes), lambda one: at[float(one)], wavelength / nm, num_coeffs=moments
    )
    weights = np.asarray(fractions)
    extinction = found["xs_total"].to_numpy() @ weights
    by_mode = found["xs_scattering"].to_numpy() * weights
    scattering = by_mode.sum(-1)
    phase = (found["lm_a1"].to_numpy() * by_mode[:, :, None]).sum(1) / scattering[:, None]
    return extinction, scattering, phase
