"""Magnitudes of planets by Skyfield's functions, on positions of astropy's built-in ephemeris.

python tests/oracle/planets.py > tests/oracle/planets.json, with skyfield 1.55.
"""

import json
from types import SimpleNamespace

import numpy as np
from astropy import units
from astropy.coordinates import get_body_barycentric
from astropy.time import Time
from skyfield.magnitudelib import planetary_magnitude

NUMBERS = {
    "mercury": 199, "venus": 299, "mars": 499, "jupiter": 599, "saturn": 699, "uranus": 799,
    "neptune": 899,
}  # fmt: skip
DATES = ("2003-08-28", "2009-09-04", "2017-10-16", "2020-07-31", "2024-03-20", "2026-12-01")


def at(name: str, time: Time) -> np.ndarray:
    return get_body_barycentric(name, time, ephemeris="builtin").xyz.to_value(units.au)


answers = []
for date in DATES:
    time = Time(date, scale="utc").tdb
    observer = at("earth", time)
    for name, number in NUMBERS.items():
        line = at(name, time) - observer
        for _ in range(3):
            late = np.linalg.norm(line) * 499.004784 * units.s
            line = at(name, time - late) - observer
        position = SimpleNamespace(
            target=number,
            # Skyfield takes the Sun to be at the barycentre; seen from the Sun, it is right.
            center_barycentric=SimpleNamespace(
                xyz=SimpleNamespace(au=observer - at("sun", time - late))
            ),
            xyz=SimpleNamespace(au=line),
            t=SimpleNamespace(J=float(time.jyear)),
        )
        answers.append([date, name, round(float(planetary_magnitude(position)), 4)])
print(json.dumps(answers, indent=0))
