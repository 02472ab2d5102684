"""How close may Sun, Moon and Earth be to a tracker's field, and how much do they increase the
error farther away?

The nanosatellite's tracker behind a baffle whose point-source transmittance falls by a decade every
nine degrees: stray light, error across the boresight and availability over the angle, by the
analytic budget, and the angles beyond which the error is at most a tenth larger than for a dark
sky.

    python experiments/exclusion.py [--json FILE] [--figure FILE] [--quick]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import command
import numpy as np
import one_thread  # noqa: F401
from numpy.typing import NDArray

from startrack import arcsec, deg, load_design, shipped
from startrack.budget import Exclusion, exclusions
from startrack.optics import Baffle
from startrack.plots import CYCLE, LINES, picture, save_picture, styled

# Usual shape for a two-stage baffle; assumed, not of a product.
BAFFLE = Baffle(
    tuple(np.array([0.0, 5, 10, 20, 30, 40, 60, 90]) * deg),
    (1e-1, 1e-2, 1e-3, 1e-5, 1e-6, 1e-7, 1e-9, 1e-10),
)
ANGLES: NDArray[np.float64] = np.arange(2.0, 90.5, 1.0, dtype=np.float64) * deg


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--figure", type=Path, help="file for the picture of the curves")
    chosen = command.read(parser)
    case = load_design(shipped("designs/noise_only.toml")).case
    case = replace(case, instrument=replace(case.instrument, baffle=BAFFLE))
    angles = ANGLES[::22] if chosen.quick else ANGLES
    found = exclusions(case, angles)
    figures = {f"{name}_exclusion_deg": one.least() / deg for name, one in found.items()}
    figures["error_arcsec"] = float(found["sun"].across[-1]) / arcsec
    at = int(np.argmin(abs(angles - 20 * deg)))
    figures["earth_cost_at_20_deg"] = float(found["earth"].across[at] / found["earth"].across[-1])
    for name, value in figures.items():
        print(f"{name:24} {value:.4g}")
    command.save(
        chosen, {name: one if math.isfinite(one) else None for name, one in figures.items()}
    )
    if chosen.figure:
        draw(chosen.figure, found)


@styled
def draw(path: Path, found: dict[str, Exclusion]) -> None:
    title = "The nanosatellite's tracker behind an assumed baffle, analytic budget; dotted: "
    figure = picture(8.5, f"{title}exclusion angle, error +10 %")
    axes = figure.subplots(3, 1, sharex=True)
    names = {"sun": "Sun", "moon": "full Moon", "earth": "noon Earth, 600 km (to its limb)"}
    for (name, one), colour, line in zip(found.items(), CYCLE, LINES, strict=False):
        place = one.angle / deg
        axes[0].plot(place, one.stray_light_g, ls=line, color=colour, label=names[name])
        axes[1].semilogy(place, one.across / arcsec, ls=line, color=colour)
        axes[2].plot(place, one.availability, ls=line, color=colour)
        for each in axes[1:]:
            each.axvline(one.least() / deg, color=colour, ls=":", lw=1)
    axes[0].invert_yaxis()
    axes[0].set_ylabel("stray light (G per square arcsec)")
    axes[1].set_ylabel("error across (arcsec rms)")
    axes[2].set_ylabel("availability (fraction)")
    axes[2].set_xlabel("angle from the boresight (deg)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=2)
    save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
