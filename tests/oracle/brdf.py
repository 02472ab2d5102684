"""Reflectance factors of sasktran2 2026.10.1 over MODIS kernels and snow -> brdf.json.

python tests/oracle/brdf.py; an atmosphere without scattering lets the surface be seen as it is.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import sasktran2 as sk

GEOMETRIES = [(30, 0, 0), (30, 40, 0), (30, 40, 180), (50, 40, 90), (60, 20, 45), (20, 65, 150)]
CHI, LENGTH, SOOT, WAVELENGTH = 1e-7, 1e6, 5.5e-8, 550.0  # absorption, nm, absorption, nm


class Ice:
    """Refractive index of ice, with an absorption of round numbers."""

    def refractive_index(self, wavelength: Any) -> Any:
        """The same at all wavelengths."""
        return np.full(np.shape(wavelength), 1.3 - 1j * CHI)


def factor(surface: Any, sun: float, camera: float, azimuth: float) -> float:
    """Reflectance factor at zenith angles and azimuth in degree; azimuth 0 is away from the Sun."""
    config = sk.Config()
    config.multiple_scatter_source = sk.MultipleScatterSource.NoSource
    config.num_streams = 2
    cosine = np.cos(np.radians(sun))
    geometry = sk.Geometry1D(
        cosine,
        0,
        6372000,
        np.arange(0.0, 65001, 5000.0),
        sk.InterpolationMethod.LinearInterpolation,
        sk.GeometryType.PlaneParallel,
    )
    view = sk.ViewingGeometry()
    view.add_ray(
        sk.GroundViewingSolar(cosine, np.radians(azimuth), np.cos(np.radians(camera)), 200000)
    )
    air = sk.Atmosphere(
        geometry, config, wavelengths_nm=np.array([WAVELENGTH]), calculate_derivatives=False
    )
    air["surface"] = surface
    sk.climatology.us76.add_us76_standard_atmosphere(air)
    out = sk.Engine(config, geometry, view).calculate_radiance(air)
    return float(out["radiance"].values.ravel()[0] * np.pi / cosine)


def main() -> None:
    """Write the file beside this script."""
    rows = []
    for sun, camera, azimuth in GEOMETRIES:
        white, volume, shape, snow = (
            factor(surface, sun, camera, azimuth)
            for surface in (
                sk.constituent.MODIS(1.0, 0.0, 0.0),
                sk.constituent.MODIS(1.0, 1.0, 0.0),
                sk.constituent.MODIS(1.0, 0.0, 0.5),
                sk.constituent.SnowKokhanovsky(LENGTH, SOOT, Ice()),
            )
        )
        rows.append(
            {
                "sun": sun,
                "camera": camera,
                "azimuth": 180 - azimuth,
                "volumetric": volume - white,
                "geometric": 2 * (shape - white),
                "snow": snow,
            }
        )
    albedo = float(np.exp(-np.sqrt(4 * np.pi * (CHI + SOOT) * LENGTH / WAVELENGTH)))
    path = Path(__file__).with_suffix(".json")
    path.write_text(json.dumps({"snow_albedo": albedo, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
