"""Build the tables of the air that are shipped, and their checksums.

    python catalogs/atmosphere/build_tables.py

needs the extra `earth`; six minutes a table on one core.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from air_files import save_dusk, save_limb, save_sky, save_table
from air_solver import build, build_dusk, build_limb, build_sky

from startrack.earth.atmosphere import Air, AirTable, load_table
from startrack.io.saving import save_text, whole

HERE = Path(__file__).parent
TABLES = {
    "molecules.fits": Air("none"),
    "rural-23km.fits": Air("rural", 23e3),
    "rural-5km.fits": Air("rural", 5e3),
}
OTHERS = {"urban-23km.fits": "urban", "maritime-23km.fits": "maritime"}
SCATTERED = "path", "beam", "skylight", "seen", "around", "backscatter"
SKY, DUSK = "sky.fits", "dusk.fits"
LIMBS = {"limb.fits": None, "limb-rural.fits": Air("rural", 23e3)}


def main() -> None:
    for name, air in TABLES.items():
        with whole(HERE / name) as draft:
            save_table(draft, build(air, progress=partial(show, name)))
    rural = load_table(HERE / "rural-23km.fits")
    scalar = build(rural.air, polarised=False, progress=partial(show, "rural, scalar"))
    for name, kind in OTHERS.items():
        with whole(HERE / name) as draft:
            other = build(Air(kind), polarised=False, progress=partial(show, name))
            save_table(draft, polarised(other, rural, scalar))
    for name, aerosol in LIMBS.items():
        with whole(HERE / name) as draft:
            save_limb(draft, build_limb(aerosol=aerosol, progress=partial(show, name)))
    with whole(HERE / SKY) as draft:
        save_sky(draft, build_sky(partial(show, SKY)))
    with whole(HERE / DUSK) as draft:
        save_dusk(draft, build_dusk(partial(show, DUSK)))
    sign()


def polarised(other: AirTable, rural: AirTable, scalar: AirTable) -> AirTable:
    """A table of another aerosol, of intensity alone, with what polarisation changes in rural air.

    It is of molecules, and the same within 0.5 % of the light of the air; a table takes a quarter
    of the time.

    rural, scalar  of the same visibility, with and without polarisation
    """
    changes = {
        name: np.maximum(getattr(other, name) + getattr(rural, name) - getattr(scalar, name), 0)
        for name in SCATTERED
    }
    return replace(other, **changes)


def sign() -> None:
    """Write the checksums of all tables."""
    sums = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}"
        for path in sorted(HERE.glob("*.fits"))
    ]
    save_text(HERE / "SHA256SUMS", "\n".join(sums) + "\n")


def show(name: str, done: float) -> None:
    print(f"\r{name} {done:4.0%}", end="\n" if done == 1 else "", flush=True)


if __name__ == "__main__":
    main()
