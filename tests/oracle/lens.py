"""Writes lens.json, or lens_grid.fits: rays and images of the shipped lenses by optiland.

    python tests/oracle/lens.py [--grid]

The grid has nine field angles and four wavelengths, of which none is a node of the tables: chief
rays (CHIEF, metre) and images (IMAGE, 1 / 10000 of the peak), for each lens.

Chief rays are aimed by optiland; spots are means over a hexapolar bundle, and the point spread
functions are its Huygens-Fresnel integrals over the rays that all apertures let through, evenly
spread over the beam before the lens, as a star's light is; aimed rays would be even over the stop,
which the aberrations of the pupil make denser at the rim by 18 % in the Petzval. The rays are those
of a quadrature up to the rim: optiland's square grid of rays has a rim of steps, by which 256 rays
across are 2 % of the peak off out of focus. None of it is made by startrack.
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
RADII, TURNS = 60, 240  # rays of an image: 40 and 160 differ from 80 and 320 by 4e-4 of the peak
WIDER = 1.3  # of a beam over the pupil


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


def through(even: Any, at: float, wavelength: float, x: Any, y: Any) -> Any:
    """Which rays of the wide beam, by their places in it, all apertures let through."""
    found = np.zeros(x.shape, bool)
    inside = np.hypot(x, y) < 0.999
    if inside.any():
        rays = even.trace_generic(0.0, at, x[inside], y[inside], wavelength)
        found[inside] = (np.asarray(rays.i) > 0) & np.isfinite(np.asarray(rays.y))
    return found


def quadrature(even: Any, at: float, wavelength: float) -> tuple[Any, Any, Any]:
    """Places in the wide beam of rays that go through, and the areas that they stand for.

    Gauss-Legendre along radii from the middle of the open part to its rim, which is found by
    bisection.
    """
    x, y = np.meshgrid(*2 * [np.linspace(-0.99, 0.99, 61)])
    bright = through(even, at, wavelength, x, y)
    middle_x, middle_y = x[bright].mean(), y[bright].mean()
    turn = 2 * np.pi * (np.arange(TURNS) + 0.5) / TURNS
    dark, rim = np.full(TURNS, 2.0), np.zeros(TURNS)
    for _ in range(34):
        tried = (rim + dark) / 2
        x, y = middle_x + tried * np.cos(turn), middle_y + tried * np.sin(turn)
        good = through(even, at, wavelength, x, y)
        rim, dark = np.where(good, tried, rim), np.where(good, dark, tried)
    node, weight = np.polynomial.legendre.leggauss(RADII)
    node = (node[:, None] + 1) / 2
    radius, area = node * rim, weight[:, None] * node * rim**2
    x, y = middle_x + radius * np.cos(turn), middle_y + radius * np.sin(turn)
    return x.ravel(), y.ravel(), area.ravel()


def image_of(
    even: Any, at: float, wavelength: float, points: int = POINTS, pitch: float = PITCH
) -> Any:
    """(points, points) 1, of the peak, on the points of optiland's own image."""
    from optiland.distribution import BaseDistribution
    from optiland.psf import HuygensPSF
    from optiland.wavefront import Wavefront

    class Rays(BaseDistribution):
        def generate_points(self, *_: Any) -> None:
            pass

    rays = Rays()
    rays.x, rays.y, area = quadrature(even, at, wavelength)
    field, micrometre = (0.0, at), 1e-3
    psf = HuygensPSF(
        even, field, wavelength, num_rays=16, image_size=points, pixel_pitch=pitch * micrometre
    )
    wave = Wavefront(even, [field], [wavelength], 0, rays).get_data(field, wavelength)
    amplitude = area * np.sqrt(np.asarray(wave.intensity))
    image = psf._summation_strategy.compute(
        *psf._get_image_coordinates(),
        wave.pupil_x,
        wave.pupil_y,
        wave.pupil_z,
        amplitude,
        np.asarray(wave.opd) * wavelength * micrometre,
        wavelength * micrometre,
        wave.radius,
        wave.reference_center,
    )
    image = np.asarray(image)
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
