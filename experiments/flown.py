"""Question: do predictions for flown cameras hold? They were frozen before the data were opened.

    python experiments/flown.py [--predict FILE] [--measure FOLDER] [--page FILE] [--json FILE]
                                 [--quick]

Designs with laws for unpublished values (experiments/flown/*.toml) are drawn DRAWS times. Each draw
gives the figures of docs/figures/flown.md from the light of sky and stars in the design, and from
laws for quantities outside designs, which are given here with each figure. `--predict` writes
medians and intervals. experiments/flown/predictions.json has the frozen predictions, results.json
the measurements (by `flown_results.py`), and second.json predictions made after the data were
opened.

figures               with a result
held_68, _90, _95     fraction of the figures within the intervals
same                  1 if this code gives the frozen medians within 2 %
sky_error             largest difference of the sky from sasktran2, 60 places, molecules alone
tim_background_ratio  measurement over median; `_second`: with the team's gain, known after the data
                      were opened
tim_solved_points     fraction of frames with an attitude, measurement minus median, per cent
ebex_peaks_held       number of peaks within the 90 % intervals, of three
brite_flux_ratio, tess_ratio  measurement over median: B1 of each satellite, G4
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import importlib
import json
import math
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import command
import flown_page
import flown_results
import numpy as np
from flown_cameras import (
    BLOCKS,
    BRITE,
    DESIGNS,
    Draw,
    apart,
    counted,
    draws,
    field,
    green,
    line_of_sight,
    lit_from,
    passes,
)

from startrack import Streams, load_design, shipped
from startrack.core import Floats, arcsec, deg
from startrack.scene import DaySky, scattered_light

SEED, DRAWS, QUICK_DRAWS = 1, 400, 12
COMMITTED, RESULTS = DESIGNS / "predictions.json", DESIGNS / "results.json"
SECOND, SKIES = DESIGNS / "second.json", 60
QUANTILES = {"median": 0.5, "low_68": 0.16, "high_68": 0.84, "low_90": 0.05, "high_90": 0.95}
QUANTILES |= {"low_95": 0.025, "high_95": 0.975}
Figures = dict[str, float]

FRAMES: Floats = np.array([block[1] for block in BLOCKS], float)
ANALYSED = 0.165  # number / electron, gain used by the team
MEAN_COLOUR = 0.9  # BP - RP of the detected stars


def tim(draw: Draw) -> Figures:
    """Figures T1 to T13."""
    detector, optics = draw.case.instrument.detector, draw.case.instrument.optics
    of_team = draw.uniform("tim team", 0, 1) < 0.45  # the team's photon transfer, or the data sheet
    gain = ANALYSED if of_team else draw.uniform("tim gain", 0.40, 0.44)
    gain *= draw.about("tim own gain", 1.0, 1.05)
    offset = draw.uniform("tim offset", 0, 20)
    # Sunlight past the baffle over the sky, 90 degrees from the Sun; it decreases with the angle
    # and with the cosine of the Sun's zenith angle.
    stray = draw.about("tim stray light", 0.06, 3.5)
    # The fourth power of the cosine of the field angle, and vignetting.
    shaded = draw.uniform("tim vignetting", 0.8, 1.0)
    noon = lit_from(draw, 44.7, 47.1, 84.0)
    electrons = []
    for name, _, sun, _, _, elevation, distance, _ in BLOCKS:
        sky = lit_from(draw, elevation, sun, distance)
        past = stray * noon * (84.0 / distance) ** 2.5 * min(1.0, max(sun + 7, 0.0) / 15)
        # Reflections of the gondola and variations of the ground; dusk below a low Sun; the first
        # block may be before float.
        scatter = draw.about(f"tim block {name}", 1.0, 1.04 if sun > 10 else 1.15)
        rising = 1 + 0.6 * draw.uniform("tim rising", 0, 1) ** 3 if name == "18:08" else 1.0
        electrons.append((sky + past) * shaded * scatter * rising)
    sky_electron = np.array(electrons) + 4.0  # dark current
    level = np.minimum(sky_electron * gain + offset, 4095.0)
    background = _weighted(level)
    # The focus was stepped: width of the image in each block.
    best = draw.uniform("tim focus", -450, -380)
    step = draw.about("tim defocus", 0.035, 1.8)  # pixel per step
    width = np.array([math.hypot(draw.fwhm, step * (block[7] - best)) for block in BLOCKS])
    # Unequal response of pixels and slopes of the sky, over photon noise.
    uneven = draw.about("tim flat field", 1.25, 1.4)
    noise = np.sqrt(sky_electron + detector.read_noise**2 + 1 / 12 / gain**2)
    noise = np.hypot(noise, detector.prnu * sky_electron * 0.5) * uneven
    star = float(draw.electrons(np.array([MEAN_COLOUR]))[0]) * shaded  # of G = 0
    inside = 1 - np.exp(-(3.0**2) * 4 * math.log(2) / width**2)
    pixels = math.pi * 9
    rp = np.array([3.0, 5.0, 7.0])

    def snr(magnitude: Floats) -> Floats:
        """Median over the frames, as by the team."""
        light = star * 10 ** (-0.4 * green(magnitude, np.full(len(magnitude), MEAN_COLOUR)))
        counted_light = light * inside[:, None] * gain / ANALYSED
        sigma = noise[:, None] * gain / ANALYSED
        ratio = counted_light / np.sqrt(counted_light + pixels * sigma**2)
        return np.array([_weighted(column) for column in ratio.T])

    snrs = snr(rp)
    # Chance matches raise the fit at the faint end.
    floor = draw.uniform("tim chance matches", 0.0, 1.5)
    grid = np.arange(3.0, 11.0, 0.02)
    below = np.flatnonzero(snr(grid) + floor < 3)
    faintest = float(grid[below[0]]) if len(below) else 11.0
    # Stars above some threshold of a matched filter, and an attitude from them.
    threshold = draw.about("tim threshold", 4.5, 1.25)
    fewest = draw.about("tim stars for an attitude", 10.0, 1.6)
    false = draw.about("tim false spots", 100.0, 4.0)
    # Detected stars that are in the solver's index and agree.
    indexed = min(draw.about("tim index", 0.4, 1.8), 0.95)
    solved, matched, spots = [], [], []
    signal = star * gain  # of G = 0, number
    for k, (_, _, _, ra, dec, _, _, _) in enumerate(BLOCKS):
        area = 2.27 * width[k] ** 2 + 4  # pixel, area of effective noise
        least = threshold * noise[k] * gain * math.sqrt(area)
        limit = -2.5 * math.log10(least / signal)
        limit = float(limit - 0.62 * MEAN_COLOUR + 0.03 * MEAN_COLOUR**2)
        magnitude, _ = field(ra, dec, draw.uniform("tim roll", 0, 180), 10.03, 5.72)
        seen = counted(magnitude, lambda m, limit=limit: passes(m, limit))
        crowded = max(false / 200, 1.0)
        solved.append(1 / (1 + math.exp(-4 * math.log(max(seen, 0.1) / (fewest * crowded**0.3)))))
        matched.append(min(seen, 200.0) * indexed + 4)
        spots.append(min(seen + false, 200.0))
    other = min(draw.about("tim other losses", 0.05, 3.5), 0.9)  # time limits, sunlight, motion
    share = np.array(solved)
    typical = _weighted(np.array(matched), share)
    found = _weighted(np.array(spots), share)
    at = _weighted(width, share)
    usual = threshold * 1.8
    centroid = 0.6 * at / usual * 6.79
    lens = draw.about("tim distortion", 1.5, 2.2)  # arcsec, residual of a fit
    rms = math.sqrt(2) * math.hypot(centroid, lens)
    colours = np.linspace(0.0, 2.0, 21)
    instrumental = -2.5 * np.log10(draw.electrons(colours)) + green(np.zeros(21), colours)
    slope = np.polyfit(colours, instrumental, 2)[1]
    per_square = background / ANALYSED / detector.exposure / 6.79**2
    ratio = {f"T7 {block[0]}": level[k] / level[4] for k, block in enumerate(BLOCKS) if k != 4}
    diffraction = 1.029 * 746e-9 / optics.aperture / (detector.pitch / optics.focal_length)
    return {
        "T1": float(share @ FRAMES / FRAMES.sum()) * (1 - other),
        "T2": found,
        "T3": typical,
        "T4": typical * draw.uniform("tim verify", 0.8, 2.2),
        "T5": rms,
        "T6": background,
        "T6 16 %": _weighted(level, at=0.16),
        "T6 84 %": _weighted(level, at=0.84),
        **ratio,
        "T8 RP 3": snrs[0] + floor,
        "T8 RP 5": snrs[1] + floor,
        "T8 RP 7": snrs[2] + floor,
        "T9": faintest,
        "T10": min(faintest + draw.uniform("tim faintest", 0.0, 2.0), 11.0),
        "T11": float(slope) + draw.uniform("tim colour", -0.06, 0.06),
        "T12 least": float(width.min()) / diffraction,
        "T12 largest": float(width.max()) / diffraction,
        "T13": per_square,
    }


def _weighted(values: Floats, share: Floats | float = 1.0, at: float = 0.5) -> float:
    """Quantile over frames of values of the blocks."""
    order, weight = np.argsort(values), FRAMES * share
    below = (np.cumsum(weight[order]) - weight[order] / 2) / max(weight.sum(), 1e-9)
    return float(np.interp(at, below, values[order]))


# Latitude, sidereal time (h), elevation and azimuth of the Sun.
EBEX = (
    ("1", -76.873, 11.132, 17.7, 117.0),
    ("2", -76.939, 12.245, 21.3, 101.0),
    ("3", -77.429, 8.014, 11.1, 162.0),
)


def ebex(draw: Draw) -> Figures:
    """Figures E1 to E8."""
    case = draw.case
    detector, sky = case.instrument.detector, case.scene.sky
    assert sky
    gain = draw.about("ebex gain", 6.5, 1.6)  # electron / number
    offset = draw.uniform("ebex offset", 0, 500)
    stray = draw.about("ebex stray light", 0.15, 3.0)
    star = float(draw.electrons(np.array([MEAN_COLOUR]))[0])
    hot = draw.about("ebex hot pixels", 25.0, 4.0)
    width = draw.fwhm
    figures, levels, noises, solved, matches = dict[str, float](), [], [], 0.0, []
    for name, latitude, sidereal, sun, azimuth in EBEX:
        elevation = sky.elevation / deg + draw.uniform(f"ebex elevation {name}", -4, 4)
        away = draw.uniform(f"ebex azimuth {name}", 90, 180)
        side = 1 if draw.uniform(f"ebex side {name}", 0, 1) > 0.5 else -1
        electrons = lit_from(draw, elevation, sun, apart(elevation, sun, away))
        electrons *= 1 + stray
        dark = detector.dark_current * detector.exposure
        full = min(detector.full_well, (16383 - offset) * gain)
        level = min((electrons + dark), full)
        variance = level + detector.read_noise**2 + gain**2 / 12
        variance += (detector.prnu * level) ** 2
        noise = math.sqrt(variance) / gain if level < full else 0.2
        blind = level >= full
        levels.append(level / gain + offset)
        noises.append(noise)
        ra, dec = line_of_sight(latitude, sidereal * 15, elevation, azimuth + side * away)
        magnitude, _ = field(ra, dec, draw.uniform(f"ebex roll {name}", 0, 180), 4.05, 2.70)
        inside = math.erf(1.5 / (width / 2.355) / math.sqrt(2)) ** 2  # in 3 x 3 pixels
        least = 8 * 3 * noise * gain / inside  # electron
        limit = -2.5 * math.log10(least / star) - 0.62 * MEAN_COLOUR + 0.03 * MEAN_COLOUR**2
        stars = 0.0 if blind else counted(magnitude, lambda m, limit=limit: passes(m, limit, 0.25))
        others = hot * 0.3  # hot pixels and particles bright enough in a mean of 3 x 3
        figures[f"E4 {name}"] = 0.0 if blind else stars + others
        bright = float(magnitude.min()) if len(magnitude) else 9.0
        largest = star * 10 ** (-0.4 * float(green(np.array([bright]), np.array([MEAN_COLOUR]))[0]))
        figures[f"E5 {name}"] = min(largest, full) * inside / (3 * noise * gain)
        figures[f"E8 {name}"] = 0.0 if blind else hot
        chance = 1 / (1 + math.exp(-4 * math.log(max(stars, 0.1) / 6.0)))
        solved += chance
        matches.append(stars * 0.85)
    for k, (name, *_) in enumerate(EBEX):
        figures[f"E1 {name}"], figures[f"E2 {name}"] = levels[k], noises[k]
    slope = np.polyfit(levels, np.square(noises), 1)[0] if np.ptp(levels) > 1 else 0.0
    figures["E3 slope"] = float(slope)
    figures["E6"] = solved
    for k, (name, *_) in enumerate(EBEX):
        figures[f"E6 matched {name}"] = matches[k]
    centroid = 0.6 * width / 16 * 9.5
    figures["E7"] = math.sqrt(2) * math.hypot(centroid, draw.about("ebex distortion", 1.5, 1.8))
    return figures


BANDS = {"below 15": 12.0, "15 to 25": 20.0, "25 to 35": 30.0, "above 35": 37.0}


def brite(name: str, draw: Draw) -> Figures:
    """Figures B1 to B8 of a satellite."""
    magnitude, colour, radius, side, temperature = BRITE[name]
    detector = draw.case.instrument.detector
    gain = draw.about("brite gain", 3.2, 1.05)
    inside = draw.uniform("brite aperture", 0.88, 0.99)
    band = draw.about("brite response", 1.0, 1.2)
    star = float(draw.electrons(np.array([colour]))[0]) * 10 ** (-0.4 * magnitude) * inside * band
    pixels = math.pi * radius**2
    doubling = draw.uniform("brite doubling", 6.0, 8.0)
    # Ageing rows and columns and switching pixels, in addition to shot noise of the dark current.
    dose = draw.about("brite hot pixels", 1.0, 2.0)
    # Noise of the flux from exposure to exposure: stars move over pixels of unequal response.
    moved = draw.about("brite jitter", 0.5, 2.0)  # pixel, motion from exposure to exposure
    drift = math.hypot(moved, draw.about("brite drift", 0.6, 2.0))
    unequal = detector.prnu * draw.about("brite unequal", 1.0, 2.2) * moved / 4.0

    def noise(celsius: float) -> float:
        dark = detector.dark_current * 2 ** ((celsius - 20) / doubling)
        spread = (0.25 * dose * dark) * math.sqrt(pixels) * min(moved, 1.0)
        variance = star + pixels * (dark + detector.read_noise**2 + gain**2 / 12) + spread**2
        return math.hypot(math.sqrt(variance) / star, unequal)

    typical = noise(temperature)
    flux = star / gain
    mean = 1 / math.sqrt(flux * 3.2)
    figures = {
        "B1": flux,
        "B2": typical,
        "B3": typical / mean,
        "B4 x": drift * draw.about("brite x", 1.0, 1.3),
        "B4 y": drift * draw.about("brite y", 1.0, 1.3),
        "B5 x": moved * draw.about("brite x", 1.0, 1.3),
        "B5 y": moved * draw.about("brite y", 1.0, 1.3),
    }
    for label, celsius in BANDS.items():
        if name == "unibrite" or celsius < 28:  # the other satellite is never warmer
            figures[f"B6 {label}"] = noise(celsius)
    figures["B7"] = draw.about("brite ageing", 1.05, 1.2)
    room = side / 2 - radius - draw.uniform("brite centre", 0.0, 2.5)
    lost = 2 * math.erfc(max(room, 0.1) / (1.6 * drift) / math.sqrt(2))
    figures["B8"] = min(lost + draw.about("brite lost", 0.01, 3.0), 1.0)
    return {f"{name} {key}": value for key, value in figures.items()}


def tess(draw: Draw) -> Figures:
    """Figures G1 to G5, for a camera with 8 and with 200 stars."""
    detector = draw.case.instrument.detector
    width = draw.fwhm / 2.355  # pixel, sigma
    star = float(draw.electrons(np.array([1.0]))[0])  # of G = 0; T = G - 0.43 - 0.5 (c - 0.8)
    zero = star * 10 ** (-0.4 * (0.43 + 0.1))  # of T = 0
    method = draw.about("tess centroid", 1.3, 1.25)  # factor over the bound for a Gaussian
    # pixel, rms from frame to frame, from jitter over pixels
    fixed = draw.about("tess pixels", 0.005, 2.5)

    def place(magnitude: float) -> float:
        light = min(zero * 10 ** (-0.4 * magnitude), 2e5 * 6)
        beside = 4 * math.pi * width**2 * (detector.read_noise**2 + 200)
        return math.hypot(width * method * math.sqrt(1 / light + beside / light**2), fixed)

    figures = {f"G3 T {m}": place(m) for m in (6, 8, 10)}
    scale = detector.pitch / draw.case.instrument.optics.focal_length / arcsec
    radius = 4096 / math.sqrt(6)
    for count, magnitude in ((8, 7.0), (200, 8.5)):
        error = place(magnitude) / math.sqrt(count)
        figures[f"G1 across {count}"] = error * scale
        figures[f"G1 about {count}"] = error / radius / arcsec
        # Four cameras 24 degrees apart along a great circle: each measures the roll of the others.
        figures[f"G2 across {count}"] = error * scale / 2
        figures[f"G2 about {count}"] = error * scale / math.sqrt(4 * math.sin(30 * deg) ** 2)
    figures["G4"] = draw.about("tess distortion", 1.2, 2.0)
    figures["G5 2 min"] = draw.about("tess stability", 0.1, 3.0)
    figures["G5 1 h"] = draw.about("tess drift", 0.15, 3.0)
    return figures


WIDE = {
    "T1": "the noise that images in and out of focus leave to the solver's spots, and false spots",
    "T2": "whether noise fills the list to its limit of 200",
    "T3": "limiting magnitude: focus, gain, and what the solver calls a match",
    "T4": "as T3",
    "T5": "distortion that the solver's fit leaves, and the place of faint stars",
    "T6": "gain (0.165 or 0.42 to 0.433), aerosol, sunlight past the baffle",
    "T7": "sunlight past the baffle and albedo; the first block may be lower than float",
    "T8": "focus and gain; the fit counts matches by chance",
    "T9": "focus, gain, and matches by chance",
    "T10": "matches by chance",
    "T11": "blackbodies for stars, and the curve of the filter",
    "T12": "how far from its best the focus was stepped",
    "T13": "gain, aerosol, sunlight past the baffle",
    "E1": "exposure, stop, filter, gain, azimuth from the Sun: none is published",
    "E2": "gain and exposure",
    "E3": "gain",
    "E4": "limiting magnitude, hot pixels, where the camera looked",
    "E5": "where the camera looked",
    "E6": "limiting magnitude",
    "E7": "distortion that the fit leaves",
    "E8": "hot pixels are not published",
    "B1": "quantum efficiency and lens",
    "B2": "jitter over unequal pixels, dark current",
    "B3": "as B2",
    "B4": "the satellite's pointing, not the camera's",
    "B5": "the satellite's pointing, not the camera's",
    "B6": "dark current and its doubling",
    "B7": "dose",
    "B8": "the satellite's pointing",
    "G1": "number of guide stars, centroid method, motion within a pixel",
    "G2": "as G1",
    "G3": "centroid method, response of pixels",
    "G4": "the model of distortion that is fitted",
    "G5": "the spacecraft's control, not the camera's",
}
# Dark current of a pixel of BRITE's CCD at each degC, electron / s: median and factor of the 68 %
# interval.
DARK = {"10": [3.0, 2.6], "20": [8.0, 2.5], "30": [21.5, 2.6], "40": [58.0, 2.7]}
CANNOT = {
    "T14": "share with an attitude of other exposures and gains: the solver's limits where pixels "
    "are full, and in little light, are unknown",
    "T15": "matched stars over focus: the best position is unknown",
    "T8 a, k, b": "the form of the fit depends on matches by chance",
}


def figures(count: int, seed: int = SEED) -> dict[str, Floats]:
    """All figures, (draws,) each."""
    rows = dict[str, list[float]]()
    for made in _all(count, seed):
        for name, value in made.items():
            rows.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in rows.items()}


def _all(count: int, seed: int) -> Iterator[Figures]:
    yield from (tim(draw) for draw in draws("tim", count, seed))
    yield from (ebex(draw) for draw in draws("ebex", count, seed))
    for name in BRITE:
        yield from (brite(name, draw) for draw in draws(name, count, seed))
    yield from (tess(draw) for draw in draws("tess", count, seed))


def predicted(count: int, seed: int = SEED) -> dict[str, dict[str, Any]]:
    """Median, intervals and causes of their width for each figure."""
    table = dict[str, dict[str, Any]]()
    for name, values in figures(count, seed).items():
        row: dict[str, Any] = {
            key: float(f"{np.quantile(values, at):.4g}") for key, at in QUANTILES.items()
        }
        key = name.removeprefix("unibrite ").removeprefix("heweliusz ").split()[0]
        table[name] = row | {"wide": WIDE[key]}
    return table


def page() -> str:
    """The text of docs/figures/flown.md, from the committed predictions and results."""
    frozen = json.loads(COMMITTED.read_text(encoding="utf-8"))
    results = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else None
    second = dict[str, float]()
    if SECOND.exists():
        second = json.loads(SECOND.read_text(encoding="utf-8"))
    return flown_page.text_of(frozen, results, second, "python experiments/flown.py")


def after_the_look() -> Figures:
    """TIM's background by the median of each law, the team's gain and no sunlight past the baffle.

    This choice was made with known results: a second prediction, not a test.
    """
    draw = Draw(load_design(DESIGNS / "tim.toml").case, Streams(SEED, 0))
    level = np.array([lit_from(draw, block[5], block[2], block[6]) for block in BLOCKS])
    level = (level + 4.0) * ANALYSED
    ratio = {f"T7 {block[0]}": level[k] / level[4] for k, block in enumerate(BLOCKS) if k != 4}
    ends = {f"T6 {at} %": _weighted(level, at=at / 100) for at in (16, 84)}
    background = _weighted(level)
    per_square = background / ANALYSED / draw.case.instrument.detector.exposure / 6.79**2
    return {"T6": background} | ends | ratio | {"T13": per_square}


def sky_error(count: int) -> float:
    """Largest difference of the sky's light from sasktran2, for molecules at random places.

    Raises  ModuleNotFoundError without the extra `earth`.
    """
    sys.path.append(str(shipped("atmosphere")))
    solver = importlib.import_module("air_solver")
    random, worst = Streams(SEED, 0)("places of a sky"), 0.0
    for _ in range(count):
        height, up, down = random.uniform(0, 40e3), random.uniform(15, 85), random.uniform(2, 85)
        turned, albedo = random.uniform(0, 180), random.uniform(0, 0.8)
        distance = apart(up, down, turned) * deg
        above = DaySky(height, up * deg, down * deg, distance, aerosol=0.0, albedo=albedo)
        wavelength, light = scattered_light(above)
        ray = (math.pi / 2 - up * deg, turned * deg, height)
        solved = solver.sky_radiance(
            None, wavelength, math.sin(down * deg), [ray], albedo, streams=16
        )
        worst = max(worst, float(np.abs(light / solved[:, 0] - 1).max()))
    return worst


def scores() -> dict[str, Any]:
    """The figures of the experiment, from the committed predictions and results."""
    table = json.loads(COMMITTED.read_text(encoding="utf-8"))["figures"]
    results = json.loads(RESULTS.read_text(encoding="utf-8"))["figures"]
    second = json.loads(SECOND.read_text(encoding="utf-8"))
    seen = {name: row["value"] for name, row in results.items()}
    ratio = {name: seen[name] / table[name]["median"] for name in seen}
    peaks = [flown_page.held(table[name], seen[name], 90) for name in ("E4 1", "E4 2", "E4 3")]
    held = {f"held_{level}": part for level, part in flown_page.shares(table, results).items()}
    return {
        "figures": len(seen),
        **held,
        "tim_background_ratio": ratio["T6"],
        "tim_background_ratio_second": seen["T6"] / second["T6"],
        "tim_solved_points": 100 * (seen["T1"] - table["T1"]["median"]),
        "ebex_peaks_held": sum(peaks),
        "brite_flux_ratio": {name: ratio[f"{name} B1"] for name in BRITE},
        "tess_ratio": ratio["G4"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--predict", type=Path, help="file for the predictions")
    parser.add_argument("--page", type=Path, help="file for the page of the committed figures")
    parser.add_argument("--measure", type=Path, help="folder with the files that others published")
    options = command.read(parser)
    if options.measure:
        seen = {"figures": flown_results.measured(options.measure)}
        RESULTS.write_text(json.dumps(seen, indent=1) + "\n", encoding="utf-8")
    count = QUICK_DRAWS if options.quick else DRAWS
    table = predicted(count)
    for name, row in table.items():
        print(f"{name:24} {row['median']:10.4g} [{row['low_90']:.4g}, {row['high_90']:.4g}]")
    if options.page:
        options.page.write_text(page(), encoding="utf-8")
    if options.predict:
        head = {"version": version("startrack"), "commit": command.commit(), "seed": SEED}
        text = head | {"draws": count, "figures": table, "cannot": CANNOT, "dark": DARK}
        options.predict.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")
    frozen = json.loads(COMMITTED.read_text(encoding="utf-8"))["figures"]
    same = not options.quick and all(
        math.isclose(table[name]["median"], row["median"], rel_tol=0.02, abs_tol=1e-3)
        for name, row in frozen.items()
    )
    result = scores() | {"same": float(same)}
    try:
        result["sky_error"] = sky_error(1 if options.quick else SKIES)
    except ModuleNotFoundError as missing:
        print(missing)
    for name, value in result.items():
        print(f"{name}: {value}")
    command.save(options, result)


if __name__ == "__main__":
    command.run(main)
