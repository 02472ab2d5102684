"""How close to the Sun can a tracker point, and how much does diffuse light of the sky increase the
error?

The nanosatellite's tracker has random attitudes on rings about the Sun. The transmittance of its
baffle falls from 1e-3 at 10 degrees by a decade every 6 degrees to 1e-13. Each row is a ring: the
brightness of the zodiacal light, the electrons per pixel by sky and stray light, the number of
matched stars, and the error across. The last row is a sky with stars alone.

    python experiments/backgrounds.py [--trials N] [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import dataclasses
import math

import command
import numpy as np
from scipy.spatial.transform import Rotation

from startrack import Case, Streams, deg, load_design, observe, shipped
from startrack.catalog import open_sky
from startrack.detector import diffuse_electrons
from startrack.observation import light_of, stars_in_field, throughput
from startrack.optics import Baffle
from startrack.scene import Scene, observer_of, zodiacal

DATE = "2026-03-20T12:00:00"
ANGLES = (30, 35, 40, 45, 50, 60, 90, 135, 180)  # degree from the Sun
FALL = np.arange(10, 71, 6)
BAFFLE = Baffle(tuple(float(a) * deg for a in FALL), tuple(10.0 ** -(3.0 + np.arange(len(FALL)))))
SCENE = Scene(lights=("zodiacal", "starlight", "sun"), date=DATE)


def around(sun: np.ndarray, angle: float, streams: Streams) -> Rotation:
    """A random attitude with its boresight at this angle from the Sun."""
    turn, roll = 2 * math.pi * streams("place").random(2)
    first = np.cross(sun, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    side = math.cos(turn) * first + math.sin(turn) * np.cross(sun, first)
    boresight = math.cos(angle) * sun + math.sin(angle) * side
    to_axis, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [boresight])
    return Rotation.from_rotvec([0.0, 0.0, roll]) * to_axis


def ring(case: Case, angle: float | None, trials: int) -> dict[str, float]:
    """Results at an angle from the Sun; None: in any direction, without sunlight."""
    body = observer_of(SCENE, None).see("sun")
    rows = []
    for number in range(trials):
        streams = Streams(7, number)
        attitude = around(body.direction, 2.0 if angle is None else angle, streams)
        record = observe(case, attitude, streams)
        boresight = attitude.inv().apply([[0.0, 0.0, 1.0]])
        instrument = case.instrument
        stars = stars_in_field(open_sky(case.catalog), attitude, instrument.camera)
        light = light_of(case, stars, attitude, streams)
        glow = diffuse_electrons(
            light, instrument.camera, instrument.detector, throughput(instrument)
        )
        level = 0.0 if glow is None else float(glow.mean())
        s10 = float(zodiacal(boresight, body.direction)[0]) if angle is not None else 0.0
        error = math.hypot(record.outcome.error_x, record.outcome.error_y) / math.sqrt(2)
        rows.append((s10, level, record.outcome.stars, record.outcome.solved, error))
    s10, level, matched, solved, error = np.array(rows, float).T
    right = solved > 0
    return {
        "sun_deg": math.nan if angle is None else round(angle / deg),
        "zodiacal_s10": float(s10.mean()),
        "electrons": float(level.mean()),
        "stars": float(matched[right].mean()) if right.any() else 0.0,
        "solved": float(right.mean()),
        "error_arcsec": 3600 / deg * math.sqrt((error[right] ** 2).mean())
        if right.any()
        else math.nan,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=20, help="trials in each ring (default: 20)")
    options = command.read(parser, trials=1)
    plain = load_design(shipped("designs/noise_only.toml")).case
    case = dataclasses.replace(
        plain, scene=SCENE, instrument=dataclasses.replace(plain.instrument, baffle=BAFFLE)
    )
    dark = dataclasses.replace(plain, scene=Scene())
    print("Sun / deg  zodiacal / S10  sky and veil / e-  matched  solved  error / arcsec")
    figures = []
    for angle in (*(ANGLES[-1:] if options.quick else ANGLES), None):
        row = ring(
            dark if angle is None else case, None if angle is None else angle * deg, options.trials
        )
        figures.append(row)
        print(
            f"{row['sun_deg']:9.0f}  {row['zodiacal_s10']:14.0f}  {row['electrons']:17.2f}  "
            f"{row['stars']:7.1f}  {row['solved']:6.2f}  {row['error_arcsec']:14.2f}",
            flush=True,
        )
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
