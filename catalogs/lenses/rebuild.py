"""Trace the shipped prescriptions again: python catalogs/lenses/rebuild.py (extra `lens`)."""

from __future__ import annotations

from pathlib import Path

from startrack.cli.main import main

HERE = Path(__file__).parent
# Prescription, largest field angle (degree), number of field angles (more where apertures begin to
# cut off light at one of them), temperatures (degC), number of wavelengths and source.
LENSES = {
    "double_gauss": ("12", "17", ("20",), "7", "US patent 2,673,491 (Tronnier 1954)"),
    "triplet": (
        "12",
        "17",
        ("20",),
        "7",
        "Smith, Modern Optical Engineering, 4th ed. (2008), pp. 119 ff.",
    ),
    "catadioptric": ("1.5", "17", ("20",), "7", "Maksutov, J. Opt. Soc. Am. 34, 270 (1944)"),
    "petzval": ("5", "9", ("-20", "20", "60"), "9", "Laikin, Lens Design (2007), p. 75, at f/1.6"),
}


def rebuild() -> int:
    status = 0
    for name, (field, fields, temperatures, waves, source) in LENSES.items():
        status |= main(
            [
                "lens",
                "import",
                str(HERE / f"{name}.zmx"),
                "--field",
                field,
                "--fields",
                fields,
                "--source",
                source,
                "--temperatures",
                *temperatures,
                "--wavelengths",
                waves,
                "--check",
                "--out",
                str(HERE / f"{name}.fits"),
            ]
        )
    return status


if __name__ == "__main__":
    raise SystemExit(rebuild())
