"""Writes lens.json, or lens_grid.fits: rays and images of the shipped lenses by optiland.

    python tests/oracle/lens.py [--grid]

The grid has nine field angles and four wavelengths, of which none is a node of the tables: chief
rays (CHIEF, metre) and images (IMAGE, 1 / 10000 of the peak), for each lens.

Chief rays are aimed by optiland; spots are means over a hexapolar bundle, and the point spread
functions are its Huygens-Fresnel integrals over the rays that all apertures let through, evenly
spread over the beam before the lens, as a star's light is; aimed rays would be even over the stop,
which the aberrations of the pupil make denser at the rim by 18 % in the Petzval. None of it is made
by startrack.
"""

import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

LENSES = Path(__file__).parents[2] / "catalogs/lenses"
CASES = {"double_gauss": (0.0, 4.2, 8.3), "petzval": (0.0, 1.9, 3.4)}  # degree
WAVELENGTHS = (0.47, 0.63, 0.83)  # micrometre
GRID = {"double_gauss": 8.4, "petzval": 3.6}  # degree, last of nine angles
GRID_WAVELENGTHS = (0.45, 0.55, 0.68, 0.85)
GRID_POINTS, GRID_PITCH = 32, 1.5
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


def opened(name: str) -> tuple[Any, Any, float]:
    """A lens whose beams fill its stop, the same with an even beam, and its largest field."""
    from optiland.fileio import load_zemax_file

    lens = load_zemax_file(str(LENSES / f"{name}.zmx"))
    # The stop is as large as the beam of a star on the axis makes it; all beams fill it.
    lens.trace_generic(0.0, 0.0, 0.0, 1.0, lens.primary_wavelength)
    rim = float(np.squeeze(lens.surfaces.y[lens.surfaces.stop_index]))
    lens.set_aperture("float_by_stop_size", 2 * rim)
    lens.surfaces[lens.surfaces.stop_index].semi_aperture = rim
    lens.ray_tracer.set_aiming("robust")
    even = unaimed(LENSES / f"{name}.zmx", rim)
    return lens, even, max(field.y for field in lens.fields.fields)


def image_of(
    even: Any, at: float, wavelength: float, points: int = POINTS, pitch: float = PITCH
) -> Any:
    """(points, points) 1, of the peak."""
    from optiland.psf import HuygensPSF

    psf = HuygensPSF(
        even, (0.0, at), wavelength, num_rays=RAYS, image_size=points, pixel_pitch=pitch * 1e-3
    )
    image = np.asarray(psf.psf)
    return image / image.max()


def main() -> None:
    import optiland

    result = {"optiland": optiland.__version__ if hasattr(optiland, "__version__") else "0.6.3"}
    for name, angles in CASES.items():
        lens, even, largest = opened(name)
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
                    row["image"] = np.round(image_of(even, at, wavelength), 5).tolist()
                rows.append(row)
        result[name] = rows
    path = Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(result) + "\n", encoding="utf-8")


def grid() -> None:
    """Writes lens_grid.fits."""
    from astropy.io import fits

    parts = [fits.PrimaryHDU(), fits.ImageHDU(np.array(GRID_WAVELENGTHS) * 1e-6, name="WAVELENGTH")]
    for name, last in GRID.items():
        lens, even, largest = opened(name)
        angles = np.linspace(0, last, 9)
        chief, image = np.empty((9, 4)), np.empty((36, GRID_POINTS, GRID_POINTS), np.int16)
        for f, angle in enumerate(angles):
            for w, wavelength in enumerate(GRID_WAVELENGTHS):
                ray = lens.trace_generic(0.0, angle / largest, 0.0, 0.0, wavelength)
                chief[f, w] = float(np.squeeze(ray.y)) * 1e-3
                made = image_of(even, angle / largest, wavelength, GRID_POINTS, GRID_PITCH)
                image[4 * f + w] = np.rint(1e4 * made)
            print(name, angle, flush=True)
        parts.append(fits.ImageHDU(np.radians(angles), name=f"{name}_field"))
        parts.append(fits.ImageHDU(chief, name=f"{name}_chief"))
        parts.append(fits.CompImageHDU(image, name=f"{name}_image", compression_type="RICE_1"))
        print(name, "done", flush=True)
    path = Path(__file__).with_name("lens_grid.fits")
    fits.HDUList(parts).writeto(path, checksum=True, overwrite=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    grid() if "--grid" in sys.argv else main()
