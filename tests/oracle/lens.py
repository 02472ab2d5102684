"""Writes lens.json: rays and point spread functions of the shipped lenses by optiland.

    python tests/oracle/lens.py

Chief rays are aimed by optiland; spots are means over a hexapolar bundle, and the point spread
functions are its Huygens-Fresnel integrals over the rays that all apertures let through, evenly
spread over the beam before the lens, as a star's light is; aimed rays would be even over the stop,
which the aberrations of the pupil make denser at the rim by 18 % in the Petzval. None of it is made
by startrack.
"""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

LENSES = Path(__file__).parents[2] / "catalogs/lenses"
CASES = {"double_gauss": (0.0, 4.2, 8.3), "petzval": (0.0, 1.9, 3.4)}  # degree
WAVELENGTHS = (0.47, 0.63, 0.83)  # micrometre
POINTS, PITCH = 48, 1.0  # of an image, micrometre
RAYS, WIDER = 256, 1.3  # across a beam that is wider than the pupil


def unaimed(path: Path, rim: float) -> Any:
    """A lens whose stop cuts a beam that is wider and evenly filled."""
    from optiland.fileio import load_zemax_file
    from optiland.physical_apertures import RadialAperture

    lens = load_zemax_file(str(path))
    lens.set_aperture("EPD", WIDER * float(lens.paraxial.EPD()))
    lens.surfaces[lens.surfaces.stop_index].aperture = RadialAperture(r_max=rim)
    return lens


def main() -> None:
    import optiland
    from optiland.fileio import load_zemax_file
    from optiland.psf import HuygensPSF

    result = {"optiland": optiland.__version__ if hasattr(optiland, "__version__") else "0.6.3"}
    for name, angles in CASES.items():
        lens = load_zemax_file(str(LENSES / f"{name}.zmx"))
        # The stop is as large as the beam of a star on the axis makes it; all beams fill it.
        lens.trace_generic(0.0, 0.0, 0.0, 1.0, lens.primary_wavelength)
        rim = float(np.squeeze(lens.surfaces.y[lens.surfaces.stop_index]))
        lens.set_aperture("float_by_stop_size", 2 * rim)
        lens.surfaces[lens.surfaces.stop_index].semi_aperture = rim
        lens.ray_tracer.set_aiming("robust")
        even = unaimed(LENSES / f"{name}.zmx", rim)
        largest = max(field.y for field in lens.fields.fields)
        rows = []
        for angle in angles:
            for wavelength in WAVELENGTHS:
                at = angle / largest
                chief = lens.trace_generic(0.0, at, 0.0, 0.0, wavelength)
                rays = lens.trace(0.0, at, wavelength, 40, "hexapolar")
                through = np.asarray(rays.i) > 0
                row = {
                    "angle_deg": angle,
                    "wavelength_um": wavelength,
                    "chief_mm": float(np.squeeze(chief.y)),
                    "centroid_mm": float(np.asarray(rays.y)[through].mean()),
                    "rms_mm": float(np.asarray(rays.y)[through].std()),
                }
                if wavelength == WAVELENGTHS[1]:
                    psf = HuygensPSF(
                        even, (0.0, at), wavelength, num_rays=RAYS, image_size=POINTS,
                        pixel_pitch=PITCH * 1e-3,
                    )  # fmt: skip
                    image = np.asarray(psf.psf)
                    row["image"] = np.round(image / image.max(), 5).tolist()
                rows.append(row)
        result[name] = rows
    path = Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(result) + "\n", encoding="utf-8")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
