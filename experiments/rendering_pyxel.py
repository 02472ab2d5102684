"""How fast and how accurate are Pyxel's models from photons to numbers, compared with startrack's?

Both get the same map of expected electrons, 1024 x 1024 with 100 stars, and convert it to 12-bit
numbers: shot noise, dark current, full well, read noise, converter. Pyxel's models are called one
after the other, without its pipeline and files, which take additional time; Pyxel draws no stars
here. The noise of a uniform map of 20 electrons is compared with the exact distribution; 113 pixels
of 24 million are beyond 4.5 sigma, so that the ratio of the tails has an uncertainty of 10 %. Needs
pyxel-sim; it may require a separate environment, with this project in PYTHONPATH.

    python experiments/rendering_pyxel.py [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

import command
import numpy as np
from numpy.typing import NDArray
from scipy import special

from startrack import Streams
from startrack.benchmark import frame as cases
from startrack.core import Floats
from startrack.detector import Detector, read_out

SIZE, FRAMES, REPEATS = 1024, 24, 7
SKY, DARK = 20.0, 30.0  # electron in a pixel; electron / second
VOLT = 1e-5  # volt / electron
SIGMAS = 4.5
# A digital number is one electron, so that the histogram has many cells.
OURS = Detector(SIZE, SIZE, 5e-6, 0.1, full_well=4_095.0, read_noise=8.0, dark_current=DARK)


def mean_map(stars: int) -> Floats:
    """Expected photoelectrons of a uniform sky and Gaussian stars."""
    rng = np.random.default_rng(1)
    image = np.full((SIZE, SIZE), SKY)
    half = np.arange(-8, 9)
    for (x, y), flux in zip(
        rng.uniform(8, SIZE - 10, (stars, 2)), 10 ** rng.uniform(3, 5, stars), strict=True
    ):
        column, row = round(x), round(y)
        across, down = (
            special.ndtr((at + half + 0.5 - to) / 0.7) - special.ndtr((at + half - 0.5 - to) / 0.7)
            for at, to in ((column, x), (row, y))
        )
        image[row - 8 : row + 9, column - 8 : column + 9] += flux * np.outer(down, across)
    return image


def camera() -> Any:
    """Pyxel's CCD with the same parameters; its converter has the same range of electrons."""
    detectors = import_module("pyxel.detectors")
    settings = import_module("pyxel.detectors.characteristics")
    conversion = getattr(settings, "ChargeToVoltSettings", None)
    return detectors.CCD(
        geometry=detectors.CCDGeometry(row=SIZE, col=SIZE),
        environment=detectors.Environment(temperature=293.0),
        characteristics=detectors.Characteristics(
            quantum_efficiency=1.0,
            charge_to_volt=conversion(value=VOLT) if conversion else VOLT,
            pre_amplification=1.0,
            full_well_capacity=OURS.full_well,
            adc_bit_resolution=OURS.bits,
            adc_voltage_range=(0.0, OURS.full_well * VOLT),
        ),
    )


def chain(ccd: Any, photons: Floats, dark_rate: float, seed: int) -> NDArray[np.int64]:
    """Pyxel's models from photons to numbers."""
    photon = import_module("pyxel.models.photon_collection")
    charge = import_module("pyxel.models.charge_generation")
    collection = import_module("pyxel.models.charge_collection")
    measurement = import_module("pyxel.models.charge_measurement")
    electronics = import_module("pyxel.models.readout_electronics")
    ccd.empty()
    ccd.set_readout(times=[OURS.exposure], non_destructive=False)
    ccd.time = ccd.time_step = OURS.exposure
    ccd.photon.array = photons
    photon.shot_noise(ccd, seed=seed)
    charge.simple_conversion(ccd, quantum_efficiency=1.0, binomial_sampling=False)
    if dark_rate:
        charge.simple_dark_current(ccd, dark_rate=dark_rate)
    collection.simple_collection(ccd)
    collection.simple_full_well(ccd)
    measurement.simple_measurement(ccd)
    measurement.output_node_noise(ccd, std_deviation=OURS.read_noise * VOLT)
    electronics.simple_amplifier(ccd)
    electronics.simple_adc(ccd)
    return ccd.image.array.astype(np.int64)


def least(call: Callable[[], object], repeats: int) -> float:
    """Shortest CPU time, millisecond."""
    best = math.inf
    for _ in range(repeats):
        start = time.process_time()
        call()
        best = min(best, 1e3 * (time.process_time() - start))
    return best


def errors(frames: list[NDArray[Any]], wanted: Floats, mean: float) -> tuple[float, float]:
    """Chi-square over degrees of freedom; number of pixels above 4.5 sigma over the expected
    number."""
    counts = np.bincount(np.concatenate([f.ravel() for f in frames]), minlength=len(wanted))
    expect = wanted * counts.sum()
    used = expect > 25
    chi2 = float(((counts[used] - expect[used]) ** 2 / expect[used]).sum() / (used.sum() - 1))
    sigma = math.hypot(OURS.read_noise, math.sqrt(mean))
    high = np.arange(len(wanted)) > (mean + SIGMAS * sigma) / OURS.electrons_per_dn
    return chi2, float(counts[high].sum() / expect[high].sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options = command.read(parser)
    repeats, frames = (1, 1) if options.quick else (REPEATS, FRAMES)
    stars, even = mean_map(100), mean_map(0)
    dark = DARK * OURS.exposure
    figures = {
        "startrack_numbers_ms": least(lambda: read_out(stars + dark, OURS, Streams(1, 0)), repeats)
    }
    drawn: dict[str, list[NDArray[Any]]] = {
        "startrack": [read_out(even, OURS, Streams(1, n)) for n in range(frames)]
    }
    if not command.missing("Pyxel is", "pyxel"):
        ccd = camera()
        figures["pyxel_numbers_ms"] = least(lambda: chain(ccd, stars, DARK, 1), repeats)
        drawn["pyxel"] = [chain(ccd, even, 0.0, 1 + n) for n in range(frames)]
    step = OURS.electrons_per_dn
    for name, images in drawn.items():
        # Pyxel's converter may round or truncate; the distribution that fits better is used.
        found = min(errors(images, cases.law(SKY, step, half), SKY) for half in (0.5, 0.0))
        figures[f"{name}_chi2_per_dof"], figures[f"{name}_tail_ratio"] = found
    print("\n".join(f"{name:24} {value:9.3f}" for name, value in figures.items()))
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
