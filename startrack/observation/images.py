"""Instrument -> the images of stars: their PSF by place in the frame and by colour."""

from dataclasses import replace

import numpy as np

from startrack.core import Camera, FieldPsf, Floats, Psf, kept
from startrack.design import Case, Instrument
from startrack.optics import Optics, cube_psf, field_psf, grown_psf, open_optics, pixel_psf
from startrack.scene import SUN, WAVELENGTH

# Kelvin, temperatures of blackbodies; images of stars are interpolated between their images.
TEMPERATURES = np.array([50000.0, 8000.0, 4500.0, 2500.0])


@kept(8)
def psf_of(instrument: Instrument) -> Psf:
    """The PSF for sunlike stars; with a lens table, its mean over the frame.

    Cached for the last 8 instruments.
    """
    if instrument.optics.tabulated:
        return _whole_images(instrument).mean(sunlike_colour(instrument))
    detector, spectrum = instrument.detector, detected_spectrum(instrument)
    return _one_psf(
        instrument.optics,
        detector.pitch,
        spectrum.tobytes(),
        detector.fill_factor,
        detector.diffusion,
    )


def psf_at(instrument: Instrument, x: float, y: float) -> Psf:
    """The PSF for sunlike stars at a place (pixel) of the frame."""
    if instrument.optics.grows:
        return grown_psf(psf_of(instrument), instrument.optics, instrument.camera, x, y)
    if not instrument.optics.tabulated:
        return psf_of(instrument)
    return field_psf_of(instrument).image(x, y, sunlike_colour(instrument))[0]


@kept(8)
def _one_psf(
    optics: Optics, pitch: float, photons: bytes, fill_factor: float, diffusion: float
) -> Psf:
    """`pixel_psf`, cached for the last 8; it does not depend on the exposure time and on noise."""
    spectrum = np.frombuffer(photons)
    return pixel_psf(optics, pitch, WAVELENGTH, spectrum, fill_factor, diffusion)


def images_of(instrument: Instrument) -> Psf | FieldPsf:
    """Images with which stars are rendered; a lens table makes them depend on place and colour."""
    return field_psf_of(instrument) if instrument.optics.tabulated else psf_of(instrument)


@kept(8)
def field_psf_of(instrument: Instrument) -> FieldPsf:
    """The images of stars by place in the frame and by colour; cached for the last 8
    instruments."""
    images, optics = _whole_images(instrument), instrument.optics
    if not optics.lens_colour:
        images = images.of_one_colour(sunlike_colour(instrument))
    if not optics.lens_field:
        images = images.of_one_place(sunlike_colour(instrument))
    return images


def with_images_of(case: Case) -> Case:
    """The design whose images a unit uses; the case itself if it is not a unit.

    Displacements of centroids follow from the images. The unit's differences in light and noise
    also change these displacements, but this changes attitude errors by at most 1e-5 of them.
    """
    return case.as_designed if case.instrument.imaged else case


def _whole_images(instrument: Instrument) -> FieldPsf:
    """The images with all effects of the lens; shared by instruments of one lens and detector."""
    instrument = instrument.imaged or instrument
    detector = instrument.detector
    spectra = instrument.detected_spectra(TEMPERATURES)
    return _computed(
        replace(instrument.optics, lens_field=True, lens_colour=True),
        instrument.lens_temperature,
        instrument.camera.ideal,
        detector.pitch,
        (spectra / spectra.max()).tobytes(),
        detector.fill_factor,
        detector.diffusion,
    )


@kept(4)
def _computed(
    optics: Optics,
    kelvin: float,
    camera: Camera,
    pitch: float,
    photons: bytes,
    fill_factor: float,
    diffusion: float,
) -> FieldPsf:
    """`field_psf` for blackbodies of all TEMPERATURES; kept for the 4 last lenses.

    photons  of `Instrument.detected_spectra`
    """
    spectra = np.frombuffer(photons).reshape(len(TEMPERATURES), -1)
    colour = spectra @ WAVELENGTH / spectra.sum(axis=1)
    order = np.argsort(colour)
    light = WAVELENGTH, spectra[order], colour[order], fill_factor, diffusion
    if optics.psf_file:
        return cube_psf(optics, camera, pitch, *light)
    return field_psf(open_optics(optics, kelvin), camera, pitch, *light)


def colour_range(instrument: Instrument) -> tuple[float, float]:
    """Mean detected wavelengths of the hottest and the coolest of TEMPERATURES, metre."""
    spectra = instrument.detected_spectra(TEMPERATURES[[0, -1]])
    blue, red = spectra @ WAVELENGTH / spectra.sum(axis=1)
    return float(blue), float(red)


def sunlike_colour(instrument: Instrument) -> float:
    """Mean detected wavelength of a sunlike star, metre."""
    spectrum = detected_spectrum(instrument)
    return float(spectrum @ WAVELENGTH / spectrum.sum())


def detected_spectrum(instrument: Instrument) -> Floats:
    """Electrons per second of a sunlike star in each spectral bin, on an arbitrary scale."""
    return instrument.detected_spectra(np.array([SUN]))[0]
