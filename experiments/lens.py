"""Lens tables: error against a ray tracer, and time of frames and windows with a PSF for each star.

    python experiments/lens.py [--json FILE] [--quick]

A double Gauss of 35 mm at f/2.4 before a megapixel. The tracer's chief rays are those of
tests/oracle/lens.json. Times are CPU seconds of one thread, the least
of some runs, in turns. Ghosts are compared with those of ghost_rays.py.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import command
import ghost_rays
import numpy as np
from scipy.spatial.transform import Rotation

from startrack import Camera, Case, FieldPsf, Psf, Streams, load_design, shipped
from startrack.catalog import open_sky
from startrack.detector import Exposure, expose
from startrack.optics import Ghosts, lens_surfaces, open_lens, open_optics
from startrack.optics.ghosts import ghost_map, pairs, reflectances
from startrack.optics.lens_psf import _Plan, band_of
from startrack.scene import WAVELENGTH, illuminate
from startrack.trial import images_of, line_of_sight, psf_of, stars_in_field, throughput
from startrack.trial.view import TEMPERATURES, colours_of, field_psf_of
from startrack.trial.window import plan_of, spots_in_windows

ORACLE = Path(__file__).parents[1] / "tests/oracle/lens.json"
PIXEL = 5.5e-6  # metre, for errors of places
STARS = 100


def the_case(pixels: int) -> Case:
    """The nanosatellite's tracker behind a double Gauss, at rest."""
    case = load_design(shipped("designs/nanosatellite.toml")).case
    optics = replace(
        case.instrument.optics, psf="auto", lens_file="double_gauss", defocus=30e-6, blur=5e-6
    )
    pitch = 11e-6 * 512 / pixels
    detector = replace(case.instrument.detector, columns=pixels, rows=pixels, pixel_pitch=pitch)
    motion = replace(case.instrument.motion, rate_x=0.0, rate_y=0.0)
    instrument = replace(case.instrument, optics=optics, detector=detector, motion=motion)
    return replace(case, instrument=instrument)


def places() -> float:
    """Largest error of a chief ray between the nodes, pixel."""
    worst = 0.0
    for name in ("double_gauss", "petzval"):
        table = open_lens(name)
        for row in json.loads(ORACLE.read_text())[name]:
            at = np.array([row["wavelength_um"] * 1e-6]), np.radians([row["angle_deg"]])
            found = table.at(293.15, *at).place[0, 0]
            worst = max(worst, abs(found - row["chief_mm"] * 1e-3) / PIXEL)
    return worst


def stamps(case: Case, count: int) -> tuple[float, float]:
    """Error of interpolated images against those computed at their very places.

    Returns  pixel, rms over places of the centroid of the table; 1, largest error of the flux
    """
    instrument = case.instrument
    spectra = instrument.detected_spectra(TEMPERATURES)
    order = np.argsort(spectra @ WAVELENGTH / spectra.sum(axis=1))
    camera, images = instrument.camera, field_psf_of(instrument)
    plan = _Plan(
        open_optics(instrument.optics), camera, instrument.detector.pitch,
        band_of(WAVELENGTH, spectra[order]), 1.0, 0.0,
    )  # fmt: skip
    off, flux = [], []
    random = np.random.default_rng(1)
    for x, y in random.uniform(0, camera.columns - 1, (count, 2)):
        table, centre = plan.image(x - camera.centre[0], y - camera.centre[1])
        many = len(images.colour)
        found = images.at(np.full(many, x), np.full(many, y), images.colour)
        made = np.tensordot(found[:, 3:], images.table, 1)
        axis = (np.arange(plan.side) - plan.side // 2) / plan.oversampling
        for c in range(many):
            one = [
                np.array([t.sum(0) @ axis, t.sum(1) @ axis]) / t.sum() for t in (made[c], table[c])
            ]
            off.append(one[0] + found[c, :2] - one[1] - centre[c, :2])
            here = found[c, 2] * made[c].sum(), centre[c, 2] * table[c].sum()
            flux.append(abs(here[0] / here[1] - 1))
    return float(np.sqrt(np.mean(np.square(off)))), float(max(flux))


def least(ways: dict[str, Callable[[], object]], runs: int) -> dict[str, float]:
    """Least CPU time of each way, second, in turns."""
    best = dict.fromkeys(ways, np.inf)
    for way in ways.values():
        way()
    for _ in range(runs):
        for name, way in ways.items():
            start = time.process_time()
            way()
            best[name] = min(best[name], time.process_time() - start)
    return best


def frames(case: Case, runs: int) -> dict[str, float]:
    """Frames of 100 stars, with images of the table and with their mean."""
    instrument = case.instrument
    attitude = Rotation.random(random_state=3)
    stars = stars_in_field(open_sky(case.catalog), attitude, instrument.camera)[:STARS]
    light = illuminate(case.scene, stars)
    path = line_of_sight(instrument, Streams(1, 1))

    def frame(psf: Psf | FieldPsf) -> object:
        exposure = Exposure(
            light, psf, path, attitude, instrument.camera, instrument.detector,
            throughput(instrument),
        )  # fmt: skip
        return expose(exposure, Streams(1, 1))

    images, mean = images_of(instrument), psf_of(instrument)
    return least({"table": lambda: frame(images), "one": lambda: frame(mean)}, runs)


def windows(case: Case, runs: int) -> dict[str, float]:
    """Trials in windows, with images of the table and with their mean."""
    import startrack.trial.window as window

    attitudes = Rotation.random(4, random_state=5)
    plan = plan_of(case)
    mean = replace(plan, psf=psf_of(case.instrument))
    colours_of(case)

    def trials(which: object) -> None:
        window.plan_of = lambda case: which  # type: ignore[assignment]
        for n in range(len(attitudes)):
            spots_in_windows(case, attitudes[n], Streams(1, n))

    found = least({"table": lambda: trials(plan), "one": lambda: trials(mean)}, runs)
    window.plan_of = plan_of
    return found


def ghost_errors() -> dict[str, float]:
    """Largest distance of ghosts from those of a non-sequential trace, and ratio of their flux.

    Of the ratios over places and ghosts that which is farthest from one.
    """
    optics = replace(
        the_case(1024).instrument.optics, lens_file="", lens_family="double-gauss", f_number=2.8
    )
    surfaces, ghosts = lens_surfaces(optics), Ghosts()
    lens, pitch = ghost_rays.lens_of(surfaces), 2 * PIXEL
    camera = Camera(1200, 1200, optics.focal_length / pitch)
    away, ratios = [0.0], [1.0]
    for pair, angle in (((9, 1), 3.0), ((8, 4), 3.0), ((6, 0), 4.0), ((9, 1), 5.0)):
        only = np.zeros(len(surfaces) + 1)
        only[list(pair)] = reflectances(surfaces, ghosts)[list(pair)]
        towards = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
        at, ray, cell = ghost_rays.source(lens, towards, 90)
        x, y, weight = ghost_rays.ghosts(lens, at, ray, only)[pair]
        which = next(one for one in pairs(surfaces, ghosts) if one[:2] == pair)
        made = ghost_map(surfaces, which, towards, camera, pitch, optics)
        assert made is not None  # they lie in the frame
        step = (camera.columns - 1) / (made.shape[1] - 1)
        down, across = np.indices(made.shape) * step
        place = np.array([(made * across).sum(), (made * down).sum()]) / made.sum()
        wanted = np.array([x.mean(), y.mean()]) / pitch + camera.centre
        away.append(float(np.abs(place - wanted).max()))
        flux = made.sum() * optics.area * (step / camera.focal_length_px) ** 2
        ratios.append(float(flux / (weight.sum() * cell)))
    return {
        "ghost_place_px": max(away),
        "ghost_irradiance_ratio": max(ratios, key=lambda one: abs(one - 1)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    options = command.read(parser)
    runs = 3 if options.quick else 15
    case = the_case(1024)
    start = time.process_time()
    images = field_psf_of(case.instrument)
    result = {
        "plan_s": time.process_time() - start,
        "terms": len(images.table),
        "psf_error_between_nodes": images.error,
        "lateral_px": places(),
    }
    result["stamp_centroid_rms_px"], result["stamp_flux_error"] = stamps(
        case, 2 if options.quick else 12
    )
    time_of = frames(case, runs)
    result["frame_100_ms"] = 1e3 * time_of["table"]
    result["frame_ratio"] = time_of["table"] / time_of["one"]
    time_of = windows(case, runs)
    result["window_ms"] = 1e3 * time_of["table"] / 4
    result["window_ratio"] = time_of["table"] / time_of["one"]
    result |= ghost_errors()
    for name, value in result.items():
        print(f"{name:26} {value:.4g}")
    command.save(options, result)


if __name__ == "__main__":
    main()
