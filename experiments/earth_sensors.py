"""Do models of Earth cameras agree with instruments in orbit, with MODTRAN and with integrals?

The Sun in the bands of Sentinel-2; SNR and NEdT of three instruments beside required and measured
ones; the atmosphere beside MODTRAN; surfaces beside integrals; products beside the truth of their
scenes; rays on terrain beside Embree.

    python experiments/earth_sensors.py [PART ...] [--json FILE] [--page FOLDER] [--quick]

The page docs/figures/earth-cameras.md is made with `--page docs/figures`. sasktran2 and pybsm, and
embreex, are needed for `air` and `rays`; without them these parts are left out.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import command
import earth_loop
import earth_page
import earth_surfaces
import numpy as np
import one_thread  # noqa: F401
import radiometry
import terrain

from startrack import shipped, um
from startrack.earth.atmosphere import sun_spectrum
from startrack.earth.geometry import fly, ground_rate
from startrack.earth.imager import band_of, figures, load_imager, load_survey, margins_of
from startrack.earth.terrain import geodetic
from startrack.io import save_json

ROOT = Path(__file__).parents[1]
SIX = ("B2", "B3", "B4", "B8", "B11", "B12")  # of Sentinel-2, that see the land through windows
SMALLER = 16  # times, of the terrain under --quick


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parts = {one.__name__: one for one in (sun, sensors, air, surfaces, loop, rays)}
    parser.add_argument(
        "parts",
        nargs="*",
        metavar="PART",
        help=f"parts to run: {', '.join(parts)} (default: all); the page needs sun and sensors",
    )
    parser.add_argument("--page", type=Path, metavar="FOLDER", help="folder for the page")
    options = command.read(parser)
    told = json.loads((ROOT / "tests/oracle/earth_cameras.json").read_text(encoding="utf-8"))
    found: dict[str, Any] = {}
    # The tests of the experiments that the others are taken from run those small.
    for name in options.parts or (("sun", "sensors") if options.quick else parts):
        found |= parts[name](told, options.quick)
    for name, value in found.items():
        if not isinstance(value, dict):
            print(f"{name:28} {value}")
    command.save(options, found)
    if options.page:
        page = {name: found[name] for name in earth_page.NEEDED}
        save_json(options.page / "earth-cameras.json", page)
        earth_page.write_page(options.page, page, told)


def sun(told: dict[str, Any], quick: bool) -> dict[str, Any]:
    """The shipped Sun in the shipped responses of Sentinel-2A, compared with the products'
    irradiance."""
    error = {}
    for channel in load_imager("sentinel2-msi").channels:
        assert channel.response
        nodes = np.array(channel.response.wavelength)
        fine = np.linspace(nodes[0], nodes[-1], 2001)
        weight = channel.response(fine)
        mine = float(weight @ sun_spectrum(fine) / weight.sum()) * um
        published = told["sentinel2-msi"]["bands"][channel.name]["irradiance"]
        error[channel.name] = abs(mine / published - 1)
    return {
        "sun_band_error": max(error[name] for name in SIX),
        "sun_band_error_of_all": max(error.values()),
    }


def sensors(told: dict[str, Any], quick: bool) -> dict[str, Any]:
    """SNR, NEdT (kelvin), MTF, saturation and GSD of each band, predicted with the command's code.

    For each: [required, predicted, measured], None if there is none.
    """
    kinds = ("snr", "nedt", "mtf", "saturation", "gsd")
    found: dict[str, Any] = {kind: {} for kind in kinds}
    between, missed = [], []
    for camera in list(told)[-1:] if quick else told:
        seen = load_survey(shipped(f"scenes/{camera}.toml"))
        height = float(geodetic(fly(seen.carrier, np.zeros(1)).position)[2][0])
        for channel in seen.camera.channels:
            band = band_of(channel, None, height, seen.distance_to_sun)
            one = figures(channel, band, height, ground_rate(seen.carrier))
            values: dict[str, Any] = {
                "snr": one.snr,
                "nedt": one.nedt,
                "mtf": min(one.mtf_across, one.mtf_along),
                "saturation": one.saturation,
                "gsd": one.sampling_across,
            }
            for kind in kinds:
                row = [
                    getattr(channel.required, kind),
                    values[kind],
                    getattr(channel.measured, kind),
                ]
                if row[0] is not None or row[2] is not None:
                    scaled = [each and each * (um if kind == "saturation" else 1) for each in row]
                    found[kind].setdefault(camera, {})[channel.name] = scaled
            kind = "snr" if channel.required.snr else "nedt"
            ends = [getattr(each, kind) for each in (channel.required, channel.measured)]
            between.append(min(ends) <= values[kind] <= max(ends))
            margins = margins_of(channel, one)
            missed += [f"{camera} {channel.name} {name}" for name in margins if margins[name] < 0]
    return {**found, "bands": len(between), "bands_between": sum(between), "not_met": missed}


def air(told: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Radiance at nadir from 24.5 km against MODTRAN 5.2.1, as in `radiometry.py`."""
    if command.missing("the air is", "sasktran2"):
        return {"modtran_total_vis_max": None}
    return radiometry.modtran()


def surfaces(told: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Ross-Li kernels and glint against integrals, as in `earth_surfaces.py`."""
    return {
        "rossli_error": earth_surfaces.rossli_error(),
        "glint_error": earth_surfaces.glint_error(),
    }


def loop(told: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Radiance and place of a product against the truth of its scene, as in `earth_loop.py`."""
    if command.missing("loop", "rasterio"):
        return {"loop_radiance_error": None, "loop_place_px": None}
    size, fires = (40, 2) if quick else (earth_loop.SIZE, earth_loop.FIRES)
    return {
        "loop_radiance_error": earth_loop.loop_radiance_error(size)[0],
        "loop_place_px": earth_loop.loop_place_px(size, fires),
    }


def rays(told: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Speed on a million cells compared with embree, one thread, as in `terrain.py`."""
    if command.missing("embree is", "embreex"):
        return {"nadir_over_embree_1k": None, "shadow_over_embree_10deg": None}
    small = SMALLER if quick else 1
    found = terrain.speed(1024 // small, "1k", True, 1000 // small)
    return {
        "nadir_over_embree_1k": found["nadir_over_embree_1k"],
        "shadow_over_embree_10deg": found["shadow_over_embree_1k_of_elevation"][10],
    }


if __name__ == "__main__":
    command.run(main)
