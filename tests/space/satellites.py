"""Published satellites, and the temperatures that this package computes for them."""

import json
from pathlib import Path

import numpy as np

from startrack.space import Heat, orbit_temperatures

PUBLISHED = json.loads(
    (Path(__file__).parents[1] / "oracle" / "cubesat_temperatures.json").read_text()
)
CASES = PUBLISHED["cases"]


def extremes_of(name: str) -> tuple[float, float]:
    """Lowest and highest temperature (K); power that charges a battery is not heat."""
    case = CASES[name]
    heat = Heat(
        epoch="2026-03-20T12:00:00",
        altitude=1e3 * PUBLISHED["altitude_km"],
        local_time=3600.0 * case["local_time_h"],
        size=tuple(case["box"]),
        absorptance=(case["absorptance"] * (1 - PUBLISHED["charged"]),),
        emittance=(case["emittance"],),
        capacity=case["capacity"],
        power=case["power"],
        albedo=case["albedo"],
        infrared=case["infrared"],
        solar=case["solar"],
        aperture=0.0,
        head_power=0.0,
        conductance=1e-9,
    )
    kelvin = orbit_temperatures(heat).platform
    return float(kelvin.min()), float(kelvin.max())


def largest_error(name: str) -> float:
    """Largest difference of both extremes, kelvin."""
    return float(np.abs(np.subtract(extremes_of(name), CASES[name]["kelvin"])).max())
