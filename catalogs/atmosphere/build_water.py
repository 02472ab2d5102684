"""Build the table of water vapour that new tables of the air are built from, and its checksum.

    python catalogs/atmosphere/build_water.py FILE

FILE is `Gases/Abs_H2O.dat` of SMARTS 2.9.5 (Gueymard 2001, Solar Energy 71, 325): the coefficients
of its bands, of which the table holds the absorption that they give.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from air_files import save_checked
from air_gases import WATER_TO
from air_solver import MASS, SPECTRUM
from build_tables import sign

from startrack.core import Floats
from startrack.core.units import nm
from startrack.earth.atmosphere.gases import FORMAT
from startrack.io.saving import whole

HERE = Path(__file__).parent
COLUMNS: Floats = np.array([2.0, 5, 10, 20, 29.2, 40, 60])  # kg / m^2
REFERENCE = {2: 2.92232, 3: 1.41642, 4: 0.41612, 5: 0.05663}  # cm, of each kind of band
OTHER = 4.11467
LOW, HIGH = 0.05, 7.0  # limits of the corrections


def main() -> None:
    lines = Path(sys.argv[1]).read_text(encoding="latin-1").splitlines()[1:]
    rows = np.array([line.split()[:17] for line in lines if len(line.split()) >= 17], float)
    spectrum = SPECTRUM[(rows[0, 0] * nm <= SPECTRUM) & (WATER_TO >= SPECTRUM)]
    table = np.empty((len(COLUMNS), len(spectrum), len(MASS)))
    for c, column in enumerate(COLUMNS):
        for m, mass in enumerate(MASS):
            depth = _coefficient(rows, column / 10, max(mass, float(MASS[1])))
            table[c, :, m] = np.interp(spectrum, rows[:, 0] * nm, depth)
    with whole(HERE / "water.fits") as draft:
        cards = {"WATER": (FORMAT, "format of this table of water vapour")}
        named = {"WAVELENGTH": spectrum, "MASS": MASS, "COLUMN": COLUMNS, "DEPTH": table}
        save_checked(draft, cards, named)
    sign()


def _coefficient(rows: Floats, column: float, mass: float) -> Floats:
    """Optical depth over (column mass)^POWER, column in centimetre, with its corrections."""
    absorption, kind = rows[:, 1], rows[:, 2]
    typical = np.array([REFERENCE.get(int(one), OTHER) for one in kind])
    of_column = _fit(rows[:, 3:7], column - typical, {1: 1.0, 2: 2.0})
    of_column = np.where(rows[:, 3] == 6, rows[:, 4] + rows[:, 5] * (column - typical), of_column)
    of_column = np.where(absorption > 0, np.clip(of_column, LOW, HIGH), 1.0)
    of_mass = _fit(rows[:, 7:11], np.full(len(rows), mass - 1), {1: 1.0, 2: 2.0, 3: 0.5})
    step = abs(mass - 1)
    fifth = (1 + rows[:, 8] * step**0.25) / (1 + rows[:, 10] * step**0.1)
    of_mass = np.where(rows[:, 7] == 5, fifth, of_mass)
    of_mass = np.where(rows[:, 7] == 0, rows[:, 9] * mass ** rows[:, 10], of_mass)
    of_mass = np.where(absorption > 0, np.clip(of_mass, LOW, HIGH), 1.0)
    both = of_column * of_mass
    scaled = mass * column / typical
    of_both = _fit(rows[:, 11:15], scaled - 1, {1: 1.0, 2: 2.0})
    of_both = np.where(rows[:, 11] == 0, rows[:, 13] * scaled ** rows[:, 14], of_both)
    power = rows[:, 7] == 0
    plain = np.abs(of_column - 1) < 1e-6
    plain |= ~power & (np.abs(of_mass - 1) < 1e-6)
    plain |= power & (of_mass > 0.968) & (of_mass < 1.0441)
    plain |= (rows[:, 11] == -1) | (absorption <= 0)
    return np.clip(np.where(plain, both, of_both), LOW, HIGH) * absorption


def _fit(fit: Floats, x: Floats, powers: dict[int, float]) -> Floats:
    """(1 + a0 x + a1 x^2) / (1 + a2 x^power), the power by the kind of the fit."""
    kind, a0, a1, a2 = fit.T
    top = 1 + a0 * x + a1 * x**2
    found = top
    for one, power in powers.items():
        below = np.abs(x) ** power if power % 1 else x**power
        found = np.where(kind == one, top / (1 + a2 * below), found)
    return found


if __name__ == "__main__":
    main()
