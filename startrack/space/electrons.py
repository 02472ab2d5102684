"""Electrons around a sphere of aluminium -> electrons and photons at its centre."""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Floats
from startrack.io import checked_arrays, shipped

FORMAT = 1  # of the file
DENSITY = 2.70  # g / cm3, of aluminium


@dataclass(frozen=True, eq=False)
class ElectronTable:
    """Electrons of flux 1 / cm2 from all sides of a sphere of aluminium, followed to their rest.

    Built by catalogs/radiation/build_electrons.py, which has the physics and its sources.

    energy        (n,) MeV, of electrons between those that were followed
    mean_path     (n,) g / cm2, of these until they rest
    loss          (10, n) 1, energy lost over the mean: quantiles of equal probability
    start         (k,) MeV, of electrons that were followed
    path          (k,) g / cm2, mean one until they rest
    left          (k, 3, bins) at the centre, for radii in parts of the path: electrons / cm2, and
                  MeV / g that silicon takes by their collisions and by displaced atoms
    photons       (k, photons, bins) MeV / cm2 of bremsstrahlung to the centre, made at these depths
    in_aluminium  (photons,) cm2 / g, absorption of their energy
    in_silicon    (photons,) the same of silicon
    """

    energy: Floats
    mean_path: Floats
    loss: Floats
    start: Floats
    path: Floats
    left: Floats
    photons: Floats
    in_aluminium: Floats
    in_silicon: Floats


ARRAYS = tuple(field.name for field in fields(ElectronTable))


@lru_cache(maxsize=1)
def electron_table() -> ElectronTable:
    """The shipped table. Raises as `startrack.io.checked_arrays`."""
    path = shipped("radiation/electrons.fits")
    what = "a table of electrons in aluminium"
    return ElectronTable(*checked_arrays(path, "ELECTRON", FORMAT, what, ARRAYS))


@lru_cache(maxsize=32)
def _answers(shielding: float) -> tuple[Floats, Floats]:
    """Energies (n,) MeV and (4, n): `ElectronTable.left` at a depth (g / cm2), MeV / g of photons.

    Photons are attenuated by the absorption of their energy.
    """
    table = electron_table()
    energy, start, bins = table.energy, table.start, table.left.shape[2]
    parts = shielding / table.mean_path * table.loss * bins - 0.5
    answers = np.zeros((4, len(start), len(energy)))
    for k, path in enumerate(table.path):
        for row, values in enumerate(table.left[k]):
            answers[row, k] = np.interp(parts, np.arange(bins), values, right=0.0).mean(axis=0)
        above = np.clip(shielding - (np.arange(bins) + 0.5) * path / bins, 0, None)
        kept = table.photons[k] * np.exp(-table.in_aluminium[:, None] * above) * (above > 0)
        answers[3, k] = (kept.sum(axis=1) * table.in_silicon).sum()
    place = np.interp(np.log(energy), np.log(start), np.arange(len(start)))
    low = np.minimum(place.astype(int), len(start) - 2)
    along, u = np.arange(len(energy)), place - low
    return energy, (1 - u) * answers[:, low, along] + u * answers[:, low + 1, along]


class Behind(NamedTuple):
    """Particles and dose that pass a shield to its centre, of a flux; of a fluence without the
    seconds.

    number     1 / (cm2 s), electrons
    loss       MeV / (g s), of these to silicon by collisions
    displaced  MeV / (g s), to atoms of silicon that they displace
    photons    MeV / (g s), of bremsstrahlung
    """

    number: float
    loss: float
    displaced: float
    photons: float


class Electrons(NamedTuple):
    """Electrons from all sides, in the mean over an orbit or at one place.

    energy  (n,) MeV, rising
    above   (n,) 1 / (cm2 s), flux of electrons above each energy
    """

    energy: Floats
    above: Floats

    def behind(self, shielding: float) -> Behind:
        """Particles and dose at the centre of a sphere of aluminium (metre), by `electron_table`.

        The flux is interpolated exponentially between two energies of the spectrum. Electrons below
        0.1 MeV and above 8 MeV are left out.

        Accuracy  model: beside SHIELDOSE-2 (Seltzer 1994) for spectra of the belts, the dose of
                  electrons is 0.95 to 1.06 behind 1 to 5 mm and 0.5 to 0.8 behind 10 mm, that of
                  photons 0.2, 0.4, 0.5 and 0.6 behind 1, 3, 5 and 10 mm. SHIELDOSE-2 takes
                  D - z dD / dz for these, too, which holds for rays that enter as a flux does and
                  is too much for photons of electrons that have turned. Those of less than
                  0.02 MeV are left out.
        """
        energy, answers = _answers(100 * shielding * DENSITY)
        sides = np.concatenate([energy[:1], np.sqrt(energy[1:] * energy[:-1]), energy[-1:]])
        count = np.log(np.maximum(self.above, 1e-30))
        number = -np.diff(np.exp(np.interp(sides, self.energy, count)))
        return Behind(*(float(total) for total in (answers * number).sum(axis=1)))
