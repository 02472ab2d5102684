"""Build the spectrum of the Sun that is shipped, and its checksum.

    python catalogs/atmosphere/build_sun.py THUILLIER GUEYMARD

Text files of wavelength (nm) and irradiance (mW / m^2 / nm) at one astronomical unit: Thuillier et
al. (2003), Solar Physics 214, 1, to 2400 nm; beyond, Gueymard (2018), Solar Energy 169, 434.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from air_files import save_checked
from build_tables import sign

from startrack.core import Floats
from startrack.core.units import nm
from startrack.earth.atmosphere.spectra import FORMAT
from startrack.io.saving import whole

HERE = Path(__file__).parent
JOIN, LAST = 2400.0, 50_000.0  # nm


def main() -> None:
    near, far = (read(Path(name)) for name in sys.argv[1:3])
    rows = np.concatenate(
        [near[near[:, 0] <= JOIN], far[(far[:, 0] > JOIN + 1) & (far[:, 0] <= LAST)]]
    )
    with whole(HERE / "sun.fits") as draft:
        cards = {"SUN": (FORMAT, "format of this spectrum of the Sun")}
        values = np.float32(rows[:, 1] * 1e-3 / nm)
        save_checked(draft, cards, {"WAVELENGTH": rows[:, 0] * nm, "VALUE": values})
    sign()


def read(path: Path) -> Floats:
    """Rows of wavelength and irradiance."""
    separator = "," if "," in path.read_text(encoding="ascii").splitlines()[2] else None
    return np.loadtxt(path, delimiter=separator, comments="#")


if __name__ == "__main__":
    main()
