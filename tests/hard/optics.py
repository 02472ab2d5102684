"""Lenses at the ends of their ranges, against closed forms."""

from __future__ import annotations

import numpy as np

from startrack.optics import Optics, pixel_psf
from startrack.optics.pixel_psf import irradiance
from tests.hard.case import hard, refused

ONE, GREEN = np.ones(1), np.array([550e-9])


for _waves in (0.5, 1.0, 5.5, 20.5):

    @hard("optics", f"{_waves:g} waves of defocus on the axis, error of sinc squared", (0, 1e-5))
    def _defocus(waves=_waves) -> float:
        out = Optics(0.5, 4.0, psf="fraunhofer", defocus=8 * 4.0**2 * waves * 550e-9)
        inn = Optics(0.5, 4.0, psf="fraunhofer")
        here, there = (
            irradiance(each, "fraunhofer", GREEN, ONE, 1e-6, 41)[20, 20] for each in (out, inn)
        )
        return float(abs(here / there - np.sinc(waves) ** 2))


for _model in ("fraunhofer", "fresnel", "kirchhoff"):

    @hard("optics", f"f/100 by {_model}, largest difference from Airy over the peak", (0, 2e-5))
    def _slow(model=_model) -> float:
        one, airy = (
            pixel_psf(Optics(1.0, 100.0, psf=name), 20e-6, GREEN, ONE).table
            for name in (model, "airy")
        )
        return float(np.abs(one - airy).max() / airy.max())


@hard(
    "optics",
    "a pixel of 122 wavelengths * f-number holds the star, fraction of the energy",
    (0.99668, 0.99765),  # of the circles in and around the pixel (Rayleigh 1881)
)
def _huge_pixel() -> float:
    psf = pixel_psf(Optics(0.05, 2.0, psf="airy"), 134e-6, GREEN, ONE)
    return float(psf.table.max())


@hard("optics", "f/0.5 of an aplanatic lens", "f_number must be at least 0.6")
def _fast() -> str:
    return refused(lambda: Optics(0.02, 0.5))


@hard("optics", "hundreds of waves of defocus", "use `blur` instead")
def _blurred() -> str:
    return refused(lambda: pixel_psf(Optics(0.5, 4.0, defocus=0.02), 10e-6, GREEN, ONE))
