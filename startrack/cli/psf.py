"""`startrack psf`: the blur of a star by the optics of a design."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from startrack.cli.options import DESIGN, Exit, Options, WrongUse, out, wanted

if wanted(__name__):
    import numpy as np

    from startrack import optics, plots
    from startrack.cli.terminal import example, finite, print_result, read_design
    from startrack.core import Floats, Psf, Streams
    from startrack.design import Instrument
    from startrack.io import save_json
    from startrack.motion import image_path, transfer
    from startrack.observation import detected_spectrum, line_of_sight, psf_of
    from startrack.scene import WAVELENGTH

NYQUIST = 0.5  # cycle / pixel
SMALL = 0.01  # least fill factor of a detector: images through a lens then have no pixel blur


declare = Options(
    "Prints the diffraction model with its error bound, the width, the energy within circles and "
    "pixels, and each factor of the MTF at the Nyquist frequency. Writes psf.png and psf.json.",
    *DESIGN,
    out("startrack-psf"),
)


def command(options: argparse.Namespace) -> int:
    """Print the table; write psf.png and psf.json."""
    path = options.design or example()
    instrument = read_design(path, options.set).case.instrument
    if instrument.optics.psf_file:
        raise WrongUse(
            "psf_file must be left out for a comparison of diffraction models; `startrack lens "
            "show` prints its contents"
        )
    weight = detected_spectrum(instrument)
    response = psf_of(instrument)
    mean = float(weight @ WAVELENGTH / weight.sum())
    pitch = instrument.detector.pitch
    if instrument.optics.traced:
        point = replace(instrument.detector, fill_factor=SMALL, diffusion=0.0)
        image = psf_of(replace(instrument, detector=point))
        reason = "the lens has a table; the image is its mean over the frame"
        choice = optics.PsfChoice("lens table", instrument.optics.psf_tolerance, reason, {})
    else:
        image = optics.pixel_psf(instrument.optics, pitch, WAVELENGTH, weight, optics.POINT)
        choice = optics.choose(instrument.optics, pitch, mean)
    judged = optics.quality(response, image)
    frequency = np.linspace(0.0, NYQUIST, 51)
    curves = [
        _curves(instrument, response, image, angle, frequency) for angle in (0.0, math.pi / 2)
    ]
    result = _values(judged, choice, mean, curves) | {
        "design": str(path),
        "png": str(options.out / "psf.png"),
    }
    title = f"{path.stem}: {choice.model}, within {choice.error:.1g} of the peak, "
    plots.draw_psf(
        options.out / "psf.png", image, frequency, curves, f"{title}{mean * 1e9:.0f} nm mean"
    )
    save_json(options.out / "psf.json", finite(result))
    print_result(options, result, _text(judged, choice, mean, curves) + f"\nwrote {result['png']}")
    return Exit.DONE


def _curves(
    instrument: Instrument, response: Psf, image: Psf, angle: float, frequency: Floats
) -> plots.Curves:
    """Each factor of the modulation along one direction of the detector, up to Nyquist."""
    lens, detector, camera = instrument.optics, instrument.detector, instrument.camera
    pitch = detector.pitch
    factors = {
        "optics": optics.modulation(image, frequency, angle),
        "pixel": np.abs(optics.pixel_transfer(frequency, math.sqrt(detector.fill_factor))),
    }
    if lens.total_blur and not lens.traced:  # images of a traced lens contain the blur
        factors["blur in optics"] = optics.blur_transfer(frequency, lens.total_blur / pitch)
    if detector.diffusion:
        factors["diffusion"] = optics.blur_transfer(frequency, detector.diffusion / pitch)
    # The motion of one exposure, for a star in the middle of the field; trial 0 of seed 0.
    path = line_of_sight(instrument, Streams(0, 0))
    if len(path.time) > 1:
        axis = np.array([math.cos(angle), math.sin(angle)])
        offset = image_path(path, camera, camera.unproject(np.array(camera.centre))[0])
        factors["motion"] = np.abs(transfer(offset, path.weight, np.outer(frequency, axis)))
    total = optics.modulation(response, frequency, angle) * factors.get("motion", 1.0)
    return {**factors, "total": total}


def _values(
    judged: optics.Quality, choice: optics.PsfChoice, mean: float, curves: list[plots.Curves]
) -> dict[str, Any]:
    return {
        "model": choice.model,
        "model_error": choice.error,
        "model_reason": choice.reason,
        "model_errors": choice.errors,
        "mean_wavelength_nm": mean * 1e9,
        "fwhm_x_px": judged.fwhm_x,
        "fwhm_y_px": judged.fwhm_y,
        "encircled_energy": dict(zip(map(str, optics.RADII), judged.encircled, strict=True)),
        "ensquared_energy": dict(zip(map(str, optics.BLOCKS), judged.ensquared, strict=True)),
        "energy_in_table": judged.energy,
        "mtf_nyquist_x": {name: float(curve[-1]) for name, curve in curves[0].items()},
        "mtf_nyquist_y": {name: float(curve[-1]) for name, curve in curves[1].items()},
    }


def _energies(form: str, sizes: Sequence[float], fractions: Sequence[float]) -> str:
    return ", ".join(
        f"{form.format(size)} {100 * fraction:.1f} %"
        for size, fraction in zip(sizes, fractions, strict=True)
        if math.isfinite(fraction)
    )


def _text(
    judged: optics.Quality, choice: optics.PsfChoice, mean: float, curves: list[plots.Curves]
) -> str:
    lines = [
        f"model               {choice.model}, because {choice.reason}; error at most "
        f"{choice.error:.2g} of the peak",
        f"mean wavelength     {mean * 1e9:.0f} nm, for a sunlike star",
        f"FWHM                {judged.fwhm_x:.3f} x {judged.fwhm_y:.3f} pixel before the pixels",
        "energy within       " + _energies("{0:g} px", optics.RADII, judged.encircled),
        "energy in pixels    " + _energies("{0} x {0}", optics.BLOCKS, judged.ensquared),
        f"outside the table   {100 * (1 - judged.energy):.2g} %",
        "MTF at Nyquist         x      y",
    ]
    for name in curves[0]:
        lines.append(f"  {name:<17} {curves[0][name][-1]:6.3f} {curves[1][name][-1]:6.3f}")
    return "\n".join(lines)
