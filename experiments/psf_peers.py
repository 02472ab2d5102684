"""The packages compared in `psf_models.py`, each used as in its documentation.

Each makes the pattern of a circular pupil on the given field, in units of wavelength * f-number,
from 256 samples across the pupil, or draws a star on pixels. Missing packages are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

import numpy as np

from startrack.core import Floats
from startrack.optics import zernike

Stamp = Callable[[float, float], Floats]

ACROSS = 256
PATTERNS = ("hcipy", "prysm", "poppy")
ABSENT: list[str] = []


class Hcipy:
    def __init__(self, field: Floats, noll: Iterable[int]) -> None:
        hcipy = self.hcipy = import_module("hcipy")
        self.pupil_grid = hcipy.make_pupil_grid(ACROSS)
        step = field[1] - field[0]
        focal = hcipy.CartesianGrid(
            hcipy.RegularCoords([step, step], [len(field)] * 2, [field[0], field[0]])
        )
        self.aperture = hcipy.evaluate_supersampled(
            hcipy.make_circular_aperture(1), self.pupil_grid, 8
        )
        self.propagator = hcipy.FraunhoferPropagator(self.pupil_grid, focal)
        x, y = 2 * self.pupil_grid.x, 2 * self.pupil_grid.y
        self.modes = np.array([zernike(each, x, y) for each in noll]).T.copy()

    def _image(self, phase: Floats, wavelength: float) -> Floats:
        wave = self.hcipy.Wavefront(self.aperture * np.exp(1j * phase), wavelength)
        return np.asarray(self.propagator(wave).intensity.shaped)

    def clear(self) -> Floats:
        return np.asarray(self.propagator(self.hcipy.Wavefront(self.aperture)).intensity.shaped)

    def aberrated(self, coefficients: Floats) -> Floats:
        return self._image(self.modes @ coefficients, 1.0)

    def band(self, ratios: Floats) -> Floats:
        phase = self.modes[:, 3] * 0.3
        return sum((self._image(phase / ratio, ratio) for ratio in ratios), np.zeros(()))


class Prysm:
    def __init__(self, field: Floats, noll: Iterable[int]) -> None:
        coordinates = import_module("prysm.coordinates")
        geometry = import_module("prysm.geometry")
        self.propagation = import_module("prysm.propagation")
        self.field = field
        # A case for relative units: a pupil of 1 mm, f/1, 1 um, so that a field unit is 1 um.
        x, y = coordinates.make_xy_grid(ACROSS, diameter=1.0)
        self.dx = float(x[0, 1] - x[0, 0])
        r, _ = coordinates.cart_to_polar(x, y)
        self.aperture = geometry.circle(0.5, r).astype(float)
        self.modes = np.array([zernike(each, 2 * x, 2 * y) for each in noll])

    def _image(self, wave: Any, wavelength: float) -> Floats:
        front = self.propagation.Wavefront(wave, wavelength, self.dx)
        step = float(self.field[1] - self.field[0])
        return np.asarray(front.focus_fixed_sampling(1.0, step, len(self.field)).intensity.data)

    def clear(self) -> Floats:
        return self._image(self.aperture.astype(complex), 1.0)

    def aberrated(self, coefficients: Floats) -> Floats:
        phase = np.tensordot(coefficients, self.modes, axes=1)
        return self._image(self.aperture * np.exp(1j * phase), 1.0)

    def band(self, ratios: Floats) -> Floats:
        phase = self.modes[3] * 0.3
        return sum(
            (self._image(self.aperture * np.exp(1j * phase / r), r) for r in ratios), np.zeros(())
        )


class Poppy:
    """Poppy's optical system; the wavefront error is an array in metre."""

    def __init__(self, field: Floats, noll: Iterable[int]) -> None:
        units = self.units = import_module("astropy.units")
        self.poppy, self.field = import_module("poppy"), field
        place = (np.arange(float(ACROSS)) - (ACROSS - 1) / 2) / (ACROSS / 2)
        self.modes = np.array([zernike(each, place, place[:, None]) for each in noll])
        self.scale = (field[1] - field[0]) * 1e-6 * units.rad.to(units.arcsec)  # 1 um over 1 m
        self.empty = self._system(None)

    def _system(self, error: Floats | None) -> Any:
        poppy, units = self.poppy, self.units
        system = poppy.OpticalSystem(npix=ACROSS, pupil_diameter=1 * units.m, oversample=1)
        system.add_pupil(poppy.CircularAperture(radius=0.5, gray_pixel=True))
        if error is not None:
            system.add_pupil(
                poppy.ArrayOpticalElement(
                    opd=error,
                    transmission=np.ones_like(error),
                    pixelscale=1 / ACROSS * units.m / units.pixel,
                )
            )
        system.add_detector(pixelscale=self.scale, fov_pixels=len(self.field), oversample=1)
        return system

    def clear(self) -> Floats:
        return np.asarray(self.empty.calc_psf(1e-6, normalize="none")[0].data)

    def aberrated(self, coefficients: Floats) -> Floats:
        error = np.tensordot(coefficients, self.modes, axes=1) * (1e-6 / 2 / np.pi)
        image = self._system(error).calc_psf(1e-6, normalize="none")[0].data
        return np.asarray(image)[::-1, ::-1]  # the package's image axes have the opposite direction

    def band(self, ratios: Floats) -> Floats:
        error = self.modes[3] * 0.3 * (1e-6 / 2 / np.pi)
        system = self._system(error)
        return sum((np.asarray(system.calc_psf(1e-6 * r)[0].data) for r in ratios), np.zeros(()))


class Galsim:
    def __init__(self) -> None:
        self.galsim = import_module("galsim")

    def airy_stamp(self, disk: float, box: int) -> Stamp:
        profile = self.galsim.Airy(lam_over_diam=disk)
        return lambda x, y: self._draw(profile, box, x, y)

    def gauss_stamp(self, sigma: float, box: int) -> Stamp:
        profile = self.galsim.Gaussian(sigma=sigma)
        return lambda x, y: self._draw(profile, box, x, y)

    def _draw(self, profile: Any, box: int, x: float, y: float) -> Floats:
        image = self.galsim.ImageD(box, box)
        return np.asarray(profile.drawImage(image, scale=1.0, offset=(x, y)).array)


class Photutils:
    def __init__(self) -> None:
        self.model = import_module("photutils.psf").CircularGaussianSigmaPRF

    def gauss_stamp(self, sigma: float, box: int) -> Stamp:
        y_grid, x_grid = np.mgrid[:box, :box]

        def draw(x: float, y: float) -> Floats:
            model = self.model(flux=1.0, x_0=box // 2 + x, y_0=box // 2 + y, sigma=sigma)
            return np.asarray(model(x_grid, y_grid))

        return draw


def present() -> dict[str, Any]:
    """The available peers: functions for patterns, and functions for stamps."""
    found: dict[str, Any] = {}
    makers: dict[str, Any] = {"hcipy": Hcipy, "prysm": Prysm, "poppy": Poppy}
    stampers: dict[str, Any] = {"galsim": Galsim, "photutils": Photutils}
    for name in (*makers, *stampers):
        try:
            import_module(name)
        except ImportError:
            ABSENT.append(name)
            continue
        found[name] = makers[name] if name in makers else stampers[name]()
    return found
