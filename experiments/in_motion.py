"""A turning tracker: with a rolling shutter, with an unknown rate, and in a filter.

    python experiments/in_motion.py [--json FILE] [--quick]

told_ratio        error across of a tracker with an unknown rate over the error with a known rate,
                  by rate (deg/s)
sigma_ratio       error across over the stated error
availability      [known rate, unknown rate], by rate; false_attitudes in all trials with an unknown
                  rate
stars_ratio       stars of an attitude with an unknown rate, over stars with a known rate, by rate
nanosatellite     [availability, error over the error with a known rate] of this design at 3 deg/s
shutter_arcsec    error across added by a rolling shutter of 20 us a row at 1 deg/s, with a known
                  rate; shutter_unknown_rate_arcsec: with the rate from the images
filter_nees       normalised squared error of the filter, with 3 degrees of freedom, by rate of the
                  slew (deg/s), with a gyroscope: [value, standard error]; and of two heads with an
                  alignment error of 60 arcsec; frame_nees: the same for single frames
calibration_bound_ratio  error of a camera calibrated frame by frame over the Cramer-Rao bound of
                  the same frames, by their number: root mean square, over cameras and unknowns
                  (focal length, principal point, k1), of error over bound
swarm             [before, after], arcsec rms: angle between two heads of Swarm, before and after a
                  model of their temperatures; swarm_as_expected: whether each is in the range
                  expected before the simulation
streaked_real     for a real frame of streaks (in the folder STARTRACK_DATA): results, and whether
                  they are in the ranges expected before the solution; streaked_real_solved: number
                  of such frames with an attitude and a rate
sequence_1000_s   CPU time, second, of 1,000 frames of 1024 x 1024 pixels at 10 Hz in windows, with
                  one-time computations; sequence_frames_s: in whole frames

The design is noise_only, with the filter of the nanosatellite. Differences of errors use the same
skies and noise.
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import json
import math
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack import (
    Camera,
    Case,
    Matches,
    Spots,
    Status,
    arcsec,
    deg,
    load_design,
    read_image,
    run_trials,
    shipped,
)
from startrack.attitude import (
    CameraFilter,
    MatchedFrame,
    after_frame,
    camera_vector,
    first_camera,
    moved_camera,
)
from startrack.calibration import Calibration
from startrack.catalog import Selection, open_sky
from startrack.design import Fidelity
from startrack.identification import Identification, PatternIndexes
from startrack.mission import Between, between, frames_of, load_mission, plan_of
from startrack.photograph import solve_photograph
from startrack.sequence import Gyro, Leg, Sequence, SequenceHead, run

RATES = (0.0, 0.3, 1.0, 3.0)  # deg/s
ROW_DELAY = 20e-6  # second
SLEWS = (0.0, 0.005, 0.1)  # deg/s, rates of the slews for the filter
PERIOD = 0.213  # second; a multiple of the tones' periods would make their jitter last
GYRO = Gyro(0.15 * deg / 60, 1e-7, 1e-5)
CALIBRATED = {100: 64, 1000: 16, 10_000: 4}  # frames: cameras
STARS, NOISE = 12, 0.05  # number of stars in a frame of a calibration; noise, pixel
SECOND = SequenceHead(x=90 * deg, alignment_sigma=60 * arcsec)
BEGIN = 10  # first frames of a sequence, which are left out while the filter settles
# A real frame in which stars are streaks: the test image "random" of PiFinder (31 January 2024,
# 512 x 512 pixels, 25 mm; 0.75 s was its exposure by default). Expected before it was solved, from
# a look at the picture and the published field of that camera: lowest, expected, highest.
# Two heads of Swarm, whose angle varied by 6.41 arcsec rms, and by 2.58 after a model of its
# temperatures (Herceg, Joergensen and Joergensen 2017, Acta Astronautica 137, 205). Expected here,
# arcsec, before it was flown: lowest, expected, highest. By hand from what docs/units.md has of
# that tracker (0.31 across) and of that structure on its bracket (0.8 across), of two heads: it is
# known that bench and mounts of such a spacecraft move by five times what the structure here does.
SWARM = {"before": (0.6, 1.2, 2.0), "after": (0.3, 0.45, 0.7)}
SWARM_PARTS = """
[instrument.structure]
bracket = "0.1 m"
plate_expansion = "2.2 um / (m K)"
"""
SWARM_MISSION = """
[time]
begin = "2014-06-01T00:00:00"
duration = "10 d"
step = "10 s"
[orbit]
altitude = "460 km"
inclination = "87.35 deg"
"""
SWARM_HEAD = """
[[heads]]
name = "{0}"
design = "head.toml"
azimuth = "{0} deg"
elevation = "-45 deg"
unit = {1}
exclusion = {{ sun = "30 deg", moon = "12 deg", earth = "20 deg" }}
"""
EXPOSURE = 0.75  # second
STREAKED = {
    "fov_x_deg": (9.5, 10.2, 11.0),
    "streak_px": (7.0, 10.0, 14.0),
    "streak_deg": (45.0, 60.0, 75.0),  # up to the right in the image
    "rate_deg_s": (0.18, 0.27, 0.4),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    options = command.read(parser)
    trials = 6 if options.quick else 300
    case = load_design(shipped("designs/noise_only.toml")).case
    names = "told_ratio", "sigma_ratio", "availability", "stars_ratio"
    values: dict[str, Any] = {name: {} for name in names}
    false = 0
    for rate in RATES[:: 3 if options.quick else 1]:
        told, alone = (tried(turning(case, rate, how), trials) for how in ("known", "images"))
        values["told_ratio"][f"{rate:g}"] = across(alone) / across(told)
        values["sigma_ratio"][f"{rate:g}"] = across(alone) / stated(alone)
        values["availability"][f"{rate:g}"] = [float(right(one).mean()) for one in (told, alone)]
        stars = [float(one["stars"][right(one)].mean()) for one in (alone, told)]
        values["stars_ratio"][f"{rate:g}"] = stars[0] / stars[1]
        false += int(alone["false"].sum())
    values["false_attitudes"] = false / (len(values["told_ratio"]) * trials)
    small = load_design(shipped("designs/nanosatellite.toml")).case
    told, alone = (
        tried(turning(small, RATES[-1], how), trials // 3) for how in ("known", "images")
    )
    values["nanosatellite"] = [float(right(alone).mean()), across(alone) / across(told)]
    still = across(tried(turning(case, 1.0, "known"), trials))
    for name, how in (("shutter_arcsec", "known"), ("shutter_unknown_rate_arcsec", "images")):
        rolled = across(tried(turning(case, 1.0, how, ROW_DELAY), trials))
        values[name] = math.sqrt(max(rolled**2 - still**2, 0.0)) / arcsec
    values["filter_nees"], values["frame_nees"] = {}, {}
    counts = (2, 16) if options.quick else (40, 40)
    for rate in SLEWS[:: 2 if options.quick else 1]:
        found = nees(rate, *counts)
        values["filter_nees"][f"{rate:g}"], values["frame_nees"][f"{rate:g}"] = found
    values["filter_nees"]["two heads"], _ = nees(SLEWS[-1], *counts, (SECOND,))
    values["calibration_bound_ratio"] = {
        str(frames): over_bound(frames, cameras)
        for frames, cameras in ({10: 2} if options.quick else CALIBRATED).items()
    }
    if options.quick:
        command.shorten("startrack.mission.surrogate", PLACES=48, RATES=2, MAGNITUDE=8.0)
    angle = swarm(20 if options.quick else 300)
    values["swarm"] = [angle.before / arcsec, angle.after / arcsec]
    values["swarm_as_expected"] = [
        low < value < high
        for value, (low, _, high) in zip(values["swarm"], SWARM.values(), strict=True)
    ]
    values["streaked_real"] = streaked()
    values["streaked_real_solved"] = int("rate_deg_s" in values["streaked_real"])
    for name, fidelity in (
        ("sequence_1000_s", Fidelity.WINDOW),
        ("sequence_frames_s", Fidelity.FRAME),
    ):
        values[name] = spent(case, fidelity, 5 if options.quick else 1000)
    print(json.dumps(values, indent=1))
    command.save(options, values)


def over_bound(frames: int, cameras: int) -> float:
    """Error of a calibration over its bound; 12 stars with 0.05 pixel of noise in each frame."""
    design, free = Camera(1024, 1024, 1500.0), np.arange(4)
    settings, squares = CameraFilter(Calibration(0.003, 6.0, 0.1, floor=0.0)), []
    sigma = settings.prior.sigma(design)[free]
    for number in range(cameras):
        rng = np.random.default_rng([frames, number])
        truth = moved_camera(design, free, sigma * rng.standard_normal(4))
        known, bound = first_camera(design, settings), np.diag(sigma**-2.0)
        for _ in range(frames):
            pixel = rng.uniform(20, 1004, (STARS, 2))
            direction, seen = truth.unproject(pixel), pixel + rng.normal(0, NOISE, pixel.shape)
            covariance = np.tile(NOISE**2 * np.eye(2), (STARS, 1, 1))
            order, ones = np.arange(STARS), np.ones(STARS)
            spots = Spots(seen[:, 0], seen[:, 1], ones, covariance, ones, order)
            attitude = Rotation.from_rotvec(rng.normal(0, 1e-4, 3))
            true = Matches(
                Status.SOLVED, "", order, order, direction, truth, Rotation.identity(), 0.0
            )
            known = after_frame(known, settings, spots, replace(true, icrs_to_camera=attitude))
            exact = replace(spots, x=pixel[:, 0], y=pixel[:, 1])
            bound += MatchedFrame(exact, true).normal(truth, free, 0.0).schur
        error = (camera_vector(known.camera) - camera_vector(truth))[free]
        squares.append(float(error @ bound @ error) / 4)
    return math.sqrt(np.mean(squares))


def swarm(frames: int) -> Between:
    """Two heads at a right angle, of the type of Oersted's compass, in the structure of
    docs/units.md."""
    text = shipped("trackers/oersted-asc.toml").read_text(encoding="utf-8")
    text = text.replace("structure-aluminium", "structure-titanium").replace(
        '"variations/', f'"{shipped("variations").as_posix()}/'
    )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "head.toml").write_text(text + SWARM_PARTS)
        heads = SWARM_HEAD.format(90, 0) + SWARM_HEAD.format(-90, 1)
        (Path(folder) / "mission.toml").write_text(SWARM_MISSION + heads)
        plan = plan_of(load_mission(Path(folder) / "mission.toml"))
        return between(plan, frames_of(plan, frames, 1, Fidelity.WINDOW), 0, 1)


def streaked() -> dict[str, Any]:
    """Value, and whether it is in the expected range, by name in STREAKED; empty without the
    frame."""
    path = Path(os.environ.get("STARTRACK_DATA", ".")) / "images-streaked" / "pifinder_random.png"
    if not path.exists():
        return {}
    stars = open_sky(Selection.whole("bright", 2024.0)).stars
    field = STREAKED["fov_x_deg"][1] * deg
    solved = solve_photograph(
        read_image(path), PatternIndexes(stars), Identification(focal_tolerance=0.1), field
    )
    if solved.axis is None or solved.streak is None:
        return {}
    (x, y), camera = solved.streak, solved.matches.camera
    found = {
        "fov_x_deg": camera.fov_x / deg,
        "streak_px": math.hypot(x, y),
        "streak_deg": math.degrees(math.atan2(-y, x)) % 180,
        "rate_deg_s": math.hypot(x, y) / camera.focal_length_px / EXPOSURE / deg,
    }
    return {
        name: [value, STREAKED[name][0] < value < STREAKED[name][2]]
        for name, value in found.items()
    }


def spent(case: Case, fidelity: Fidelity, frames: int) -> float:
    """CPU time, second, of a megapixel sequence that turns by 0.05 deg/s."""
    detector = replace(case.instrument.detector, columns=1024, rows=1024, pixel_rate=5e7)
    case = replace(case, instrument=replace(case.instrument, detector=detector))
    sequence = Sequence((Leg(0.1 * (frames + 0.5), rate_x=0.05 * deg),), period=0.1)
    run(case, replace(sequence, legs=(Leg(0.25),)), 2, 0, fidelity=fidelity)  # compiled
    begun = time.process_time()
    run(case, sequence, 1, 0, fidelity=fidelity)
    return time.process_time() - begun


def turning(case: Case, rate: float, how: str, row_delay: float = 0.0) -> Case:
    """The design at a rate (deg/s) that is known to the tracker or estimated from the images."""
    instrument = case.instrument
    motion = replace(instrument.motion, rate_x=0.8 * rate * deg, rate_y=0.6 * rate * deg)
    detector = replace(instrument.detector, row_delay=row_delay)
    return replace(
        case,
        instrument=replace(instrument, motion=motion, detector=detector),
        tracker=replace(case.tracker, rate=how),
    )


def tried(case: Case, trials: int) -> NDArray[np.void]:
    return run_trials(case, 5, range(trials))


def right(outcomes: NDArray[np.void]) -> NDArray[np.bool_]:
    return np.asarray(outcomes["solved"] & ~outcomes["false"])


def across(outcomes: NDArray[np.void]) -> float:
    """Error across, radian, rms per axis."""
    good = outcomes[right(outcomes)]
    return math.sqrt(float((good["error_x"] ** 2 + good["error_y"] ** 2).mean() / 2))


def stated(outcomes: NDArray[np.void]) -> float:
    good = outcomes[right(outcomes)]
    return math.sqrt(float((good["sigma_x"] ** 2 + good["sigma_y"] ** 2).mean() / 2))


def nees(
    rate: float, sequences: int, frames: int, heads: tuple[SequenceHead, ...] = ()
) -> tuple[list[float], list[float]]:
    """Mean of the normalised squared error over three axes, and its standard error.

    For the filter and for single frames. Frames of a sequence share lasting errors, so only
    sequences are independent.
    """
    case = load_design(shipped("designs/nanosatellite.toml")).case
    leg = Leg(frames * PERIOD, rate_x=rate * deg)
    sequence = Sequence((leg,), period=PERIOD, gyro=GYRO, heads=heads)
    squares: list[list[float]] = [[], []]
    for number in range(sequences):
        table = run(case, sequence, 1, number, fidelity=Fidelity.WINDOW)
        table = table[table["head"] == 0][BEGIN:]
        for of, (error, sigma) in zip(
            squares, (("filtered", "filtered_sigma"), ("error", "sigma")), strict=True
        ):
            parts = [table[f"{error}_{axis}"] / table[f"{sigma}_{axis}"] for axis in "xyz"]
            of.append(float(np.nanmean((np.array(parts) ** 2).sum(axis=0))))
    found = [[float(np.mean(of)), float(np.std(of) / math.sqrt(sequences))] for of in squares]
    return found[0], found[1]


if __name__ == "__main__":
    command.run(main)
