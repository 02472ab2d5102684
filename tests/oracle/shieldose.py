"""Doses of AE-8 and AP-8 by SHIELDOSE-2, in six circular orbits and of single energies.

    python shieldose.py LIBRARY > shieldose.json

LIBRARY is a shared library that holds `shieldose2_`, the program of S. M. Seltzer (NIST, 1994) with
its tables, as IRBEM has it (commit b9f60df1). Neither is kept here.

The spectra are those of radbelt 0.1.8 in the field of 1964 at solar minimum, in the middles of
96 parts of the orbit and 72 of the Earth's longitudes, at all energies of AE-8 and AP-8.
"""

import ctypes
import json
import sys

import numpy as np
import radbelt
from scipy.interpolate import PchipInterpolator

ORBITS = [(400, 51.6), (550, 97.6), (800, 98.6), (1400, 52), (20200, 55), (35786, 0)]
THICK = [1.0, 3.0, 5.0, 10.0]  # mm
ELECTRONS = [0.04, 0.1, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6, 6.5, 7]
PROTONS = [0.5, 1, 2, 4, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 400]
LINES = [0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0]  # MeV
SILICON, LOCAL, MILLIMETRE = 3, 2, 3  # IDET, INUC, IUNT


def doses(library, electrons, protons):
    """Rad in silicon a second at the centre of spheres: electrons, bremsstrahlung, protons; and of
    bremsstrahlung in a half-space of aluminium.

    electrons, protons  energies (n,) MeV and differential flux 1 / (MeV cm2 s), or None
    """
    depth = np.unique(np.concatenate([np.geomspace(0.05, 30, 60), THICK]))
    flux = []
    for spectrum in (electrons, protons):
        flux.append(np.zeros((2, 301)))
        if spectrum is not None:
            flux[-1][:, : len(spectrum[0])] = spectrum
    (electron, proton), nothing = flux, np.zeros((2, 301))
    ends = (electrons[0][0], electrons[0][-1]) if electrons is not None else (0.05, 7.0)
    counts = [0, *(0 if one is None else len(one[0]) for one in (protons, electrons))]
    inward = np.zeros(71)
    inward[: len(depth)] = depth
    out = [np.zeros((3, 71)) for _ in range(5)]

    def whole(value):
        return ctypes.byref(ctypes.c_int32(value))

    def real(value):
        return ctypes.byref(ctypes.c_double(value))

    def array(values):
        return values.ctypes.data_as(ctypes.c_void_p)

    library.shieldose2_(
        whole(SILICON),
        whole(LOCAL),
        whole(len(depth)),
        whole(MILLIMETRE),
        array(inward),
        real(0.5),
        real(400.0),
        real(0.5),
        real(400.0),
        whole(1001),
        real(ends[0]),
        real(ends[1]),
        whole(1001),
        *(whole(count) for count in counts),
        real(1.0),
        real(1.0),
        array(nothing[0]),
        array(nothing[1]),
        array(proton[0]),
        array(proton[1]),
        array(electron[0]),
        array(electron[1]),
        *(array(one) for one in out),
    )
    # What SHIELDOSE calls half the dose at the centre is that of one half of the directions.
    at = [int(np.flatnonzero(depth == thick)[0]) for thick in THICK]
    return [2 * out[k][2][at] for k in (2, 3, 1)] + [out[3][0][at]]


def above(altitude, inclination, kind, energies):
    """Mean of more than each energy (MeV) over the orbit, 1 / (cm2 s)."""
    turn = 2 * np.pi * (np.arange(96) + 0.5) / 96
    turn, east = (side.ravel() for side in np.meshgrid(turn, 5 * np.arange(72) - 177.5))
    if inclination == 0:  # all parts of the orbit are alike
        turn, east = np.zeros(720), 0.5 * np.arange(720) - 179.75
    latitude = np.degrees(np.arcsin(np.sin(np.radians(inclination)) * np.sin(turn)))
    line, ratio = radbelt.igrf(east, latitude, altitude, 1964.0)
    inside = np.flatnonzero((line > 0) & (line < 12))
    found = np.zeros(len(energies))
    for k, energy in enumerate(energies):
        flux = radbelt.aep8(energy, line[inside], ratio[inside], kind, "min")
        found[k] = flux.sum() / len(turn)
        inside = inside[flux > 0]
        if not len(inside):
            break
    return found


def differential(energies, integral, law):
    """Of a smooth line through the logarithms, over the energy or its logarithm."""
    some = integral > 0
    energies, integral = np.array(energies, float)[some], integral[some]
    if len(energies) < 4:
        return None
    x = np.log(energies) if law == "power" else energies
    line = PchipInterpolator(x, np.log(integral))
    fine = np.linspace(x[0], x[-1], 300)
    slope = -line(fine, 1) * np.exp(line(fine))
    energy = np.exp(fine) if law == "power" else fine
    return energy, np.maximum(slope / (energy if law == "power" else 1.0), 1e-30)


def main():
    library = ctypes.CDLL(sys.argv[1])
    year, orbits, lines = 365.25 * 86400, [], []
    for altitude, inclination in ORBITS:
        electron = above(altitude, inclination, "e", ELECTRONS)
        proton = above(altitude, inclination, "p", PROTONS)
        found = doses(
            library,
            differential(ELECTRONS, electron, "exponential"),
            differential(PROTONS, proton, "power"),
        )
        names = ("electrons", "bremsstrahlung", "protons")
        rad = {
            name: [float(f"{year * x:.4g}") for x in row]
            for name, row in zip(names, found[:3], strict=True)
        }
        orbits.append(
            {
                "altitude_km": altitude,
                "inclination_deg": inclination,
                "rad_per_year": rad,
                "electrons_above": [
                    [e, float(f"{electron[k]:.4g}")] for k, e in enumerate(ELECTRONS)
                ],
                "protons_above": [[e, float(f"{proton[k]:.4g}")] for k, e in enumerate(PROTONS)],
            }
        )
        print(altitude, "done", file=sys.stderr)
    for energy in LINES:
        narrow = np.linspace(0.97, 1.03, 101) * energy
        electron, photon, _, plane = doses(
            library, (narrow, np.full(101, 1 / (0.06 * energy))), None
        )
        lines.append(
            {
                "mev": energy,
                "electrons": [float(f"{x:.4g}") for x in electron],
                "bremsstrahlung": [float(f"{x:.4g}") for x in photon],
                "bremsstrahlung_plane": [float(f"{x:.4g}") for x in plane],
            }
        )
    print(
        json.dumps(
            {
                "source": __doc__.split("\n\n")[0]
                + " Silicon at the centre of solid spheres of aluminium,"
                " from all sides (twice the half of SHIELDOSE-2), nuclear attenuation with local "
                "energy"
                " (INUC = 2); commit b9f60df1 of github.com/PRBEM/IRBEM, spectra of radbelt 0.1.8 "
                "at solar minimum in the field of 1964. By shieldose.py.",
                "aluminium_mm": THICK,
                "orbits": orbits,
                "rad_cm2_per_electron_of_one_energy": lines,
            },
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
