"""Writes lens_family.json: wavefronts of the shipped lenses at two apertures, by optiland.

    python tests/oracle/lens_family.py

The rms over the rays that all apertures let through, in waves, without the best piston, tilt and
defocus, of optiland's optical path differences. The stop is as large as the beam of a star on the
axis makes it at the f-number of the prescription, and smaller in proportion. None of it is made by
startrack.
"""

import json
import warnings
from pathlib import Path

import numpy as np

LENSES = Path(__file__).parents[2] / "catalogs/lenses"
CASES = {  # degree
    "double_gauss": (0.0, 4.0, 8.0),
    "petzval": (0.0, 2.0, 4.0),
    "triplet": (0.0, 4.0, 8.0),
    "catadioptric": (0.0, 0.5, 1.0),
}
WAVELENGTH = 0.5875618  # micrometre
SLOWER = (1.0, 1.2, 1.4)  # f-number over that of the prescription


def rms(lens, at):
    from optiland.wavefront import Wavefront

    found = Wavefront(lens, [(0.0, at)], [WAVELENGTH], num_rays=128, distribution="uniform")
    data = found.get_data((0.0, at), WAVELENGTH)
    path, x, y = (np.asarray(each) for each in (data.opd, data.pupil_x, data.pupil_y))
    open_ = (np.asarray(data.intensity) > 0) & np.isfinite(path)
    path, x, y = path[open_], x[open_], y[open_]
    terms = np.column_stack([np.ones_like(x), x, y, x * x + y * y])
    rest = path - terms @ np.linalg.lstsq(terms, path, rcond=None)[0]
    return float(rest.std()), float(open_.mean())


def main() -> None:
    import optiland
    from optiland.fileio import load_zemax_file

    result = {"optiland": getattr(optiland, "__version__", "0.6.3"), "wavelength_um": WAVELENGTH}
    for name, angles in CASES.items():
        rows = []
        for slower in SLOWER:
            lens = load_zemax_file(str(LENSES / f"{name}.zmx"))
            lens.trace_generic(0.0, 0.0, 0.0, 1.0, lens.primary_wavelength)
            rim = abs(float(np.squeeze(lens.surfaces.y[lens.surfaces.stop_index]))) / slower
            if lens.surfaces.stop_index == 1:
                lens.set_aperture("EPD", float(lens.paraxial.EPD()) / slower)
            else:
                lens.set_aperture("float_by_stop_size", 2 * rim)
                lens.surfaces[lens.surfaces.stop_index].semi_aperture = rim
            lens.ray_tracer.set_aiming("robust")
            largest = max(field.y for field in lens.fields.fields)
            for angle in angles:
                waves, open_ = rms(lens, angle / largest)
                rows.append(
                    {"slower": slower, "angle_deg": angle, "rms_waves": waves, "open": open_}
                )
        result[name] = rows
    path = Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(result) + "\n", encoding="utf-8")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
