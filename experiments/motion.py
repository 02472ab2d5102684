"""How long does the path of an exposure take, and how accurate is its smear?

For motions of each kind: number of points of the path, number of equal time steps for the same
accuracy, computing time, error, and MTF of the motion at the Nyquist frequency. The error is the
difference of a smeared Gaussian of sigma 0.5 pixel from 200 000 equal steps, as a fraction of the
flux in a pixel.

    python experiments/motion.py [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import math
import time

import command
import numpy as np
from krutz_2011 import nyquist_mtf

from startrack import Camera, Streams
from startrack.core import Floats, LineOfSight
from startrack.motion import (
    Broadband,
    Motion,
    Tone,
    image_path,
    realise_motion,
    sample_jitter,
    slew,
)

PIXEL = 3e-4  # radian, 62 arcsec
EXPOSURE = 0.1
CAMERA = Camera(512, 512, 1 / PIXEL)
STREAMS = Streams(1, 1)
SIGMA = 0.5
STEPS = 200_000


def moved(length: float, **more: float) -> Motion:
    return Motion(rate_y=length * PIXEL / EXPOSURE, **more)  # type: ignore[arg-type]


def spectrum(rms: float) -> tuple[Broadband, ...]:
    """A flat spectrum to 1 Hz, then falling with the square of the frequency, to 300 Hz."""
    density = (rms * PIXEL) ** 2 / 2
    return tuple(
        Broadband(axis, (0.01, 1.0, 300.0), (density, density, density / 9e4)) for axis in "xy"
    )


MOTIONS = {
    "rest": Motion(),
    "slew_1px": moved(1),
    "slew_10px": moved(10),
    "slew_1000px": moved(1000),
    "roll_10deg_s": Motion(rate_z=math.radians(10)),
    "tone_80hz_0.2px": Motion(tones=(Tone(80.0, rms_x=0.2 * PIXEL, rms_y=0.2 * PIXEL),)),
    "broadband_0.1px": Motion(broadband=spectrum(0.1)),
    "broadband_1px": Motion(broadband=spectrum(1.0)),
    "all": Motion(0, 0.01, 0.02, (Tone(80.0, rms_x=0.1 * PIXEL),), spectrum(0.3)),
}


def image(motion: Motion, rotation: Floats, weight: Floats) -> Floats:
    """A smeared Gaussian on the boresight, at places around its middle and its end."""
    x, y = rotation[:, 1] / PIXEL, -rotation[:, 0] / PIXEL
    end = realise_motion(motion, EXPOSURE, STREAMS).at(np.array([EXPOSURE / 2]))[0] / PIXEL
    near = np.linspace(-3, 3, 7)
    columns, rows = (np.concatenate([near, near + at]) for at in (end[1], -end[0]))
    across = np.exp(-0.5 * ((columns[:, None] - x) / SIGMA) ** 2)
    down = np.exp(-0.5 * ((rows[:, None] - y) / SIGMA) ** 2)
    return (down * weight) @ across.T / (2 * np.pi * SIGMA**2)


def even(motion: Motion, steps: int) -> Floats:
    at = (np.arange(steps) + 0.5) / steps - 0.5
    rotation = realise_motion(motion, EXPOSURE, STREAMS).at(EXPOSURE * at)
    return image(motion, rotation, np.full(steps, 1 / steps))


def milliseconds(motion: Motion) -> float:
    """Shortest of five runs, millisecond."""
    times = []
    for _ in range(5):
        slew.cache_clear()
        start = time.process_time()
        sample_jitter(motion, EXPOSURE, PIXEL, STREAMS, CAMERA.half_diagonal)
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def study(most: int, tolerance: float, calls: int) -> dict[str, float]:
    print(f"{'':16} {'points':>6} {'equal steps':>11} {'ms':>7} {'error':>8}   MTF x    MTF y")
    figures: dict[str, float] = {}
    for name, motion in MOTIONS.items():
        path: LineOfSight = sample_jitter(motion, EXPOSURE, PIXEL, STREAMS, CAMERA.half_diagonal)
        right = even(motion, most)
        error = float(abs(image(motion, path.rotation, path.weight) - right).max())
        steps = 1
        while abs(even(motion, steps) - right).max() > tolerance:
            steps *= 2
        mtf = nyquist_mtf(image_path(path, CAMERA, np.array([0.0, 0.0, 1.0])), path.weight)
        cost = milliseconds(motion)
        print(
            f"{name:16} {len(path.time):6} {steps:11} {cost:7.2f} {error:8.0e} "
            f"{mtf[0]:8.5f} {mtf[1]:8.5f}"
        )
        figures |= {f"{name}_points": len(path.time), f"{name}_equal_steps": steps}
        figures |= {f"{name}_ms": cost, f"{name}_error": error}
    start = time.process_time()
    for _ in range(calls):
        sample_jitter(MOTIONS["slew_10px"], EXPOSURE, PIXEL, STREAMS, 0.1)
    figures["cached_us"] = (time.process_time() - start) / calls * 1e6
    print(f"a cached path takes {figures['cached_us']:.1f} us")
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options = command.read(parser)
    command.save(options, study(*((2**14, 1e-3, 100) if options.quick else (STEPS, 1e-6, 10_000))))


if __name__ == "__main__":
    command.run(main)
