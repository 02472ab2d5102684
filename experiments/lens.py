"""Lens tables: error against a ray tracer, and time of frames and windows with a PSF for each star.

    python experiments/lens.py [--json FILE] [--quick]

Errors are the largest over both shipped lenses, the 9 fields and 4 wavelengths of
tests/oracle/lens_grid.fits: `wavefront_rms_waves` against optiland (extra `lens`; a quick run has
two fields and one wavelength); `psf_error_of_peak` against its Huygens-Fresnel integrals, and
`lateral_px` for chief rays, with pixels of 5.5 um. Ghosts are compared with ghost_rays.py.

All other figures are for a double Gauss of 35 mm at f/2.4 with a megapixel detector. `stamp_*`
compares interpolated images with images computed at the exact place and colour.
`colour_residual_ratio` is the rms displacement of stars over the frame with a focal length for each
colour, over the displacement with one focal length; `colour_error_ratio` is the same for attitudes.
Times are CPU times of one thread, the shortest of alternating runs, and ratios to the time with the
mean PSF. GalSim draws the same stars with an OpticalPSF of Zernike terms to Noll 37, a Gaussian and
a pixel for each star, at one wavelength, with a circular pupil, without sky and noise.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import command
import ghost_rays
import numpy as np
from astropy.io import fits
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from startrack import Camera, Case, Fidelity, Psf, Streams, load_design, run_trials, shipped
from startrack.catalog import open_sky
from startrack.core import FieldPsf, Floats
from startrack.detector import Exposure, arriving, expose, mean_wavelength
from startrack.metrics import summarise
from startrack.observation import (
    TEMPERATURES,
    colours_of,
    field_psf_of,
    images_of,
    line_of_sight,
    psf_of,
    stars_in_field,
    throughput,
)
from startrack.optics import (
    ColourBand,
    Ghosts,
    LensImages,
    LensTable,
    Optics,
    Tracing,
    band_of,
    ghost_map,
    interpolation_error,
    lens_stars,
    lens_surfaces,
    open_lens,
    open_optics,
    pairs,
    read_prescription,
    reflectances,
    trace_lens,
)
from startrack.optimise import TrialRunner, optimize
from startrack.response import residual_shift
from startrack.scene import WAVELENGTH, illuminate
from startrack.trial import plan_windows, spots_in_windows

ORACLE = Path(__file__).parents[1] / "tests/oracle/lens_grid.fits"
PIXEL = 5.5e-6  # metre, for errors of places
STARS = 100
LENSES = ("double_gauss", "petzval")
WIDTH = 48e-6  # metre, width of an image of optiland, with both end points


def the_case(pixels: int) -> Case:
    """The nanosatellite's tracker behind a double Gauss, at rest."""
    case = load_design(shipped("designs/noise_only.toml")).case
    optics = replace(
        case.instrument.optics, psf="auto", lens_file="double_gauss", defocus=30e-6, blur=5e-6
    )
    pitch = 11e-6 * 512 / pixels
    detector = replace(case.instrument.detector, columns=pixels, rows=pixels, pixel_pitch=pitch)
    instrument = replace(case.instrument, optics=optics, detector=detector)
    return at_rest(replace(case, instrument=instrument))


def at_rest(case: Case) -> Case:
    motion = replace(case.instrument.motion, rate_x=0.0, rate_y=0.0)
    return replace(case, instrument=replace(case.instrument, motion=motion))


def of_the_tracer(name: str) -> tuple[Floats, Floats, Floats, Floats]:
    """Wavelengths (w,), field angles (f,), chief rays (f, w), images (f, w, n, n) with peak one."""
    with fits.open(ORACLE) as parts:
        wave, angle, chief, image = (
            np.array(parts[one].data, float)
            for one in ("wavelength", f"{name}_field", f"{name}_chief", f"{name}_image")
        )
    return wave, angle, chief, image.reshape(*chief.shape, *image.shape[1:]) / 1e4


def places() -> float:
    """Largest error of a chief ray between the nodes, pixel."""
    worst = 0.0
    for name in LENSES:
        wave, angle, chief, _ = of_the_tracer(name)
        found = open_lens(name).at(293.15, wave, angle).place.T
        worst = max(worst, float(np.abs(found - chief).max()) / PIXEL)
    return worst


def wavefronts(quick: bool) -> float | None:
    """Largest rms error of a wavefront between the nodes, waves; None without the ray tracer."""
    if command.missing("wavefront_rms_waves", "optiland"):
        return None
    worst = 0.0
    for name in LENSES:
        table = open_lens(name)
        kelvin = float(table.temperature[np.abs(table.temperature - 293.15).argmin()])
        wave, field, _, _ = of_the_tracer(name)
        if quick:
            wave, field = wave[1:2], field[::8]
        tracing = Tracing(
            (kelvin,), tuple(wave.tolist()), tuple(field.tolist()), int(table.noll.max())
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings of the tracer
            lens = read_prescription(shipped(f"lenses/{name}.zmx"))
            traced, rest = trace_lens(lens, name, "", tracing)
        alone = table if len(table.temperature) == 1 else _at(table, kelvin)
        found = interpolation_error(alone, traced)["interpolation_rms_waves"]
        left = float((rest / traced.wavelength[:, None]).max())
        print(f"{name}: {found:.4f} waves between the nodes, and {left:.4f} that the terms leave")
        worst = max(worst, found)
    return worst


def _at(table: LensTable, kelvin: float) -> LensTable:
    """The table at one of its temperatures."""
    one = [int(np.abs(table.temperature - kelvin).argmin())]
    whole = ("name", "source", "focal_length", "f_number", "wavelength", "field", "noll")
    arrays = {
        each.name: getattr(table, each.name)[one]
        for each in fields(table)
        if each.name not in whole
    }
    return replace(table, **arrays)


def images(quick: bool) -> float:
    """Largest error of an image of a shipped lens over the peak; one lens in a quick run."""
    worst = 0.0
    for name in LENSES[:1] if quick else LENSES:
        table = open_lens(name)
        lens = open_optics(Optics(table.focal_length, table.f_number, lens_file=name))
        camera = Camera(8, 8, table.focal_length / 10e-6)
        waves, angles, _, wanted = of_the_tracer(name)
        errors = np.zeros(wanted.shape[:2])
        for f, w in [(0, 0)] if quick else np.ndindex(errors.shape):
            wave = waves[[w]]
            plan = LensImages(lens, camera, 10e-6, ColourBand(wave, np.ones((1, 1))), 1.0, 0.0)
            star = lens_stars(lens, wave, float(angles[f]), np.pi / 2)[0]
            errors[f, w] = apart(plan, star, wanted[f, w], 8 if quick else None)
        f, w = np.unravel_index(errors.argmax(), errors.shape)
        print(
            f"{name}: at most {errors.max():.4f} of the peak, at {np.degrees(angles[f]):.2f} deg "
            f"and {waves[w] * 1e9:.0f} nm"
        )
        worst = max(worst, float(errors.max()))
    return worst


def apart(plan: LensImages, star: Any, wanted: Floats, tries: int | None = None) -> float:
    """Largest difference of two images over the peak, after the best shift."""
    n = len(wanted)
    plan.count, plan.spacing = n + 1, WIDTH / (n - 1)
    middle, step = star.centroid, plan.spacing * 1e6

    def image_at(shift: Floats) -> Floats:
        u, v = middle[0] + shift[0] * 1e-6, middle[1] + shift[1] * 1e-6
        mine = plan._irradiance(star, u, v)[:-1, :-1]
        return np.asarray(mine * (mine.ravel() @ wanted.ravel()) / (mine**2).sum())

    def error(shift: Floats) -> float:
        return float(((image_at(shift) - wanted) ** 2).sum())

    # The tracer centres its image on a ray through the middle of the beam, some pixels away.
    plan.count = 2 * n + 1
    wide = plan._irradiance(star, *middle)[:-1, :-1]
    cuts = np.lib.stride_tricks.sliding_window_view(wide, (n, n)).reshape(-1, n, n)
    alike = [np.vdot(cut, wanted) / np.linalg.norm(cut) for cut in cuts]
    plan.count = n + 1
    # The image's middle is between two points.
    beside = np.arange(-2, 2.1, 2.0 if tries else 0.25)
    along = (int(np.argmax(alike)) // (n + 1) - n / 2 + beside) * step
    start = min((np.array([u, v]) for u in along for v in (-step / 2, step / 2)), key=error)
    corners = start + np.array([[0, 0], [step, 0], [0, step]]) / 8
    options = {"xatol": 1e-3, "fatol": 1e-7, "initial_simplex": corners, "maxfev": tries}
    best = minimize(error, start, method="Nelder-Mead", options=options)
    return float(np.abs(image_at(best.x) - wanted).max() / wanted.max())


def colours(case: Case) -> float:
    """Rms displacement of stars with a focal length for each colour, over the displacement with one
    focal length."""
    size = []
    colour, camera = colours_of(case), case.instrument.camera
    x, y = np.random.default_rng(1).uniform(0, 1, (2, len(colour)))
    for knows in (False, True):
        one = replace(case, tracker=replace(case.tracker, focal_length_by_colour=knows))
        sunlike, other = (
            each.at(x * camera.columns, y * camera.rows, colour)[:, :2]
            for each in residual_shift(one)
        )
        size.append(float(np.sqrt(np.mean((sunlike + other) ** 2))))
    print(f"displacement of stars {size[0]:.4f} pixel rms, {size[1]:.4f} corrected by colour")
    return size[1] / size[0]


def attitudes(case: Case, trials: int) -> float:
    """Error across the boresight with a focal length for each colour, over the error with one focal
    length."""
    rms = []
    for knows in (False, True):
        one = replace(case, tracker=replace(case.tracker, focal_length_by_colour=knows))
        rms.append(summarise(run_trials(one, 1, range(trials), Fidelity.COVARIANCE)).across.value)
    return rms[1] / rms[0]


def galsim_frame(case: Case, runs: int) -> float | None:
    """CPU time of GalSim for the stars of `frames`, millisecond; None without GalSim."""
    if command.missing("galsim_frame_ms", "galsim"):
        return None
    galsim = import_module("galsim")
    instrument = case.instrument
    camera, optics, pitch = instrument.camera, instrument.optics, instrument.detector.pitch
    light, attitude = light_of_stars(case)
    electrons, _ = arriving(light, camera, instrument.detector, throughput(instrument))
    wave = mean_wavelength(light, instrument.detector, throughput(instrument))
    direction = attitude.apply(light.direction)
    place = camera.project(direction)
    angle = np.arctan2(np.hypot(*direction[:, :2].T), direction[:, 2])
    lens, scale = open_optics(optics), np.degrees(pitch / optics.focal_length) * 3600
    noll = np.array(lens.table.noll)
    kept = (noll >= 4) & (noll < 38)

    def frame() -> object:
        image = galsim.ImageD(camera.columns, camera.rows, scale=scale)
        for n in np.flatnonzero(camera.holds(place)):
            terms = np.zeros(38)
            terms[noll[kept]] = lens.at(wave[[n]], angle[[n]]).wavefront[0, 0, kept] / wave[n]
            optical = galsim.OpticalPSF(
                lam=wave[n] * 1e9, diam=optics.aperture, aberrations=terms.tolist()
            )
            blur = galsim.Gaussian(sigma=optics.total_blur / pitch * scale)
            star = galsim.Convolve([optical, blur]) * float(electrons[n])
            x, y = (place[n] + 1).tolist()
            box = galsim.BoundsI(int(x) - 16, int(x) + 17, int(y) - 16, int(y) + 17)
            star.drawImage(
                image[box & image.bounds], center=galsim.PositionD(x, y), add_to_image=True
            )
        return image

    return 1e3 * least({"galsim": frame}, runs)["galsim"]


def light_of_stars(case: Case) -> tuple[Any, Rotation]:
    """The light of the brightest stars of one field, and its attitude."""
    attitude = Rotation.random(random_state=3)
    stars = stars_in_field(open_sky(case.catalog), attitude, case.instrument.camera)[:STARS]
    return illuminate(case.scene, stars), attitude


def stamps(case: Case, count: int) -> tuple[float, float]:
    """Error of interpolated images against images computed at the exact places.

    Returns  pixel, rms over places of the centroid of the table; 1, largest error of the flux
    """
    instrument = case.instrument
    spectra = instrument.detected_spectra(TEMPERATURES)
    order = np.argsort(spectra @ WAVELENGTH / spectra.sum(axis=1))
    camera, images = instrument.camera, field_psf_of(instrument)
    plan = LensImages(
        open_optics(instrument.optics),
        camera,
        instrument.detector.pitch,
        band_of(WAVELENGTH, spectra[order]),
        1.0,
        0.0,
    )
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
    """Shortest CPU time of each way in alternating runs, second."""
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
    light, attitude = light_of_stars(case)
    path = line_of_sight(instrument, Streams(1, 1))

    def frame(psf: Psf | FieldPsf) -> object:
        exposure = Exposure(
            light,
            psf,
            path,
            attitude,
            instrument.camera,
            instrument.detector,
            throughput(instrument),
        )
        return expose(exposure, Streams(1, 1))

    table, mean = images_of(instrument), psf_of(instrument)
    return least({"table": lambda: frame(table), "one": lambda: frame(mean)}, runs)


def windows(case: Case, runs: int) -> dict[str, float]:
    """Trials in windows, with images of the table and with their mean."""
    attitudes = Rotation.random(4, random_state=5)
    plan = plan_windows(case)
    mean = replace(plan, psf=psf_of(case.instrument))
    colours_of(case)

    def trials(which: Any) -> None:
        for n in range(len(attitudes)):
            spots_in_windows(case, attitudes[n], Streams(1, n), plan=which)

    return least({"table": lambda: trials(plan), "one": lambda: trials(mean)}, runs)


def ghost_errors(quick: bool) -> dict[str, float]:
    """Largest distance of ghosts from a non-sequential trace, and ratio of their fluxes.

    The ratio is the one farthest from 1 over places and ghosts.
    """
    optics = replace(
        the_case(1024).instrument.optics, lens_file="", lens_family="double-gauss", f_number=2.8
    )
    surfaces, ghosts = lens_surfaces(optics), Ghosts()
    lens, pitch = ghost_rays.lens_of(surfaces), 2 * PIXEL
    camera = Camera(1200, 1200, optics.focal_length / pitch)
    away, ratios = [0.0], [1.0]
    every = (((9, 1), 3.0), ((8, 4), 3.0), ((6, 0), 4.0), ((9, 1), 5.0))
    for pair, angle in every[: 1 if quick else None]:
        only = np.zeros(len(surfaces) + 1)
        only[list(pair)] = reflectances(surfaces, ghosts)[list(pair)]
        towards = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
        at, ray, cell = ghost_rays.source(lens, towards, 30 if quick else 90)
        x, y, weight = ghost_rays.ghosts(lens, at, ray, only)[pair]
        which = next(one for one in pairs(surfaces, ghosts) if one[:2] == pair)
        made = ghost_map(surfaces, which, towards, camera, pitch, optics)
        assert made is not None  # the ghosts are in the frame
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


def optimum_on_bounds(quick: bool) -> list[str]:
    """Variables of the best nanosatellite over its units that are at a bound.

    With --quick, two designs with noise only at rest, whose result has no meaning.
    """
    name = "noise_only" if quick else "nanosatellite"
    design = load_design(shipped(f"designs/{name}.toml"))
    assert design.campaign
    case = at_rest(design.case) if quick else design.case
    # Fewer than in the design file: each design with a lens takes some seconds.
    campaign = replace(
        design.campaign,
        trials=20,
        most_trials=40,
        evaluations=16,
        analytic_evaluations=12,
        fresh_trials=50,
        fresh_units=10,
    )
    if quick:
        campaign = replace(
            campaign, trials=2, most_trials=2, evaluations=1, analytic_evaluations=1, fresh_trials=2
        )
    best = optimize(case, campaign, TrialRunner(1))
    return list(best.space.on_bounds(best.best))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    options = command.read(parser)
    runs = 1 if options.quick else 15
    case = the_case(256 if options.quick else 1024)
    start = time.process_time()
    table = field_psf_of(case.instrument)
    result: dict[str, float | None] = {
        "plan_s": time.process_time() - start,
        "terms": len(table.table),
        "psf_error_between_nodes": table.error,
        "wavefront_rms_waves": wavefronts(options.quick),
        "psf_error_of_peak": images(options.quick),
        "lateral_px": places(),
        "colour_residual_ratio": colours(case),
        "colour_error_ratio": attitudes(case, 8 if options.quick else 4000),
    }
    result["stamp_centroid_rms_px"], result["stamp_flux_error"] = stamps(
        case, 1 if options.quick else 12
    )
    time_of = frames(case, runs)
    result["frame_100_ms"] = 1e3 * time_of["table"]
    result["frame_ratio"] = time_of["table"] / time_of["one"]
    time_of = windows(case, runs)
    result["window_ms"] = 1e3 * time_of["table"] / 4
    result["window_ratio"] = time_of["table"] / time_of["one"]
    result["galsim_frame_ms"] = galsim_frame(case, min(runs, 3))
    result |= ghost_errors(options.quick)
    for name, value in result.items():
        print(f"{name:26} {'not measured' if value is None else f'{value:.4g}'}")
    ends = optimum_on_bounds(options.quick)
    print("optimum_on_bounds         ", ", ".join(ends) or "none")
    command.save(options, result | {"optimum_on_bounds": ends})


if __name__ == "__main__":
    command.run(main)
