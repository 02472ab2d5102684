"""Build the tables of the air that are shipped, and their checksums.

    python catalogs/atmosphere/build_tables.py

needs the extra `earth`; six minutes a table on one core.
"""

from __future__ import annotations

import hashlib
from functools import partial
from pathlib import Path

from air_files import save_limb, save_sky, save_table
from air_solver import build, build_limb, build_sky

from startrack.earth.atmosphere import Air
from startrack.io.saving import save_text, whole

HERE = Path(__file__).parent
TABLES = {
    "molecules.fits": Air("none"),
    "rural-23km.fits": Air("rural", 23e3),
    "rural-5km.fits": Air("rural", 5e3),
}
SKY = "sky.fits"
LIMBS = {"limb.fits": None, "limb-rural.fits": Air("rural", 23e3)}


def main() -> None:
    for name, air in TABLES.items():
        with whole(HERE / name) as draft:
            save_table(draft, build(air, progress=partial(show, name)))
    for name, aerosol in LIMBS.items():
        with whole(HERE / name) as draft:
            save_limb(draft, build_limb(aerosol=aerosol, progress=partial(show, name)))
    with whole(HERE / SKY) as draft:
        save_sky(draft, build_sky(partial(show, SKY)))
    sign()


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
