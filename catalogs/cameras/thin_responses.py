"""Print the spectral responses of a table of many wavelengths as `response` of few.

    python catalogs/cameras/thin_responses.py FILE

FILE has rows of wavelength (nm) and relative response, one band after another, with lines such as
";; BAND 8A" between them. Straight lines between the printed nodes stay within 0.005 of the table;
values below 0 are noise of the measurement and become 0.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

from startrack.core import Floats

WITHIN = 0.005  # of the peak; chosen by hand
BAND = re.compile(r"^[;#]+.*\bBAND\s+(\w+)", re.IGNORECASE)


def main() -> None:
    for band, rows in read(Path(sys.argv[1])).items():
        wavelength, value = thinned(rows).T
        unit, scale = ("um", 1e-3) if wavelength[0] > 5000 else ("nm", 1.0)
        nodes = ", ".join(f'"{each * scale:g} {unit}"' for each in wavelength)
        print(f"# {band}\nwavelength = [{nodes}]")
        print(f"value = [{', '.join(f'{each:.4g}' for each in value)}]")


def read(path: Path) -> dict[str, Floats]:
    """Rows (n, 2) of nanometre and response over the peak of each band."""
    bands: dict[str, list[list[float]]] = {}
    rows: list[list[float]] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if found := BAND.match(line):
            rows = bands.setdefault(found[1], [])
        elif line.strip() and line[0] not in ";#":
            rows.append([float(each) for each in line.split()[:2]])
    tables = {band: np.array(rows) for band, rows in bands.items() if rows}
    return {
        band: np.stack([rows[:, 0], np.maximum(rows[:, 1], 0) / rows[:, 1].max()], 1)
        for band, rows in tables.items()
    }


def thinned(rows: Floats) -> Floats:
    """The rows that suffice (Douglas and Peucker 1973), by distances along the response."""
    line = np.interp(rows[:, 0], rows[[0, -1], 0], rows[[0, -1], 1])
    off = np.abs(rows[:, 1] - line)
    worst = int(off.argmax())
    if off[worst] <= WITHIN:
        return rows[[0, -1]]
    return np.concatenate([thinned(rows[: worst + 1])[:-1], thinned(rows[worst:])])


if __name__ == "__main__":
    main()
