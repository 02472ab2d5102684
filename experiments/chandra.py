"""Predictions for Chandra's aspect camera beside its flight data, and for the cameras of TESS.

Of Chandra: positions of stars, dark current, flicker, images, acquisition in flight and on a bench,
centroids, pixels of guide stars, boresight. Of TESS: quaternions.

    python experiments/chandra.py [--page FOLDER] [--json FILE] [--quick]

The flight's figures are read from references/chandra and references/chandra-raw of the folder that
STARTRACK_DATA names; parts without data are left out. `--page` writes flight.json, flight.png and
the tables of flight.md into FOLDER. It takes five minutes of CPU.
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import csv
import json
import math
import os
import re
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import command
import numpy as np
from flight_page import draw, write_page
from scipy import optimize, stats

from startrack import Case, Frame, Streams, arcsec, load_design, shipped
from startrack.budget import analytic, single_stars
from startrack.calibration import (
    Order,
    assumed_array,
    cross_validate_all,
    orders_of,
    read_star_table,
    supported_order,
)
from startrack.core import ZERO_CELSIUS, Floats, Ints
from startrack.detection import (
    Box,
    Detection,
    follow,
    image_mask,
    level_of_image,
    plan_detection,
    take,
)
from startrack.detector import (
    CHANDRA_ACA,
    Detector,
    Flicker,
    Flickering,
    dark,
    flickering,
    frame_of,
    pixels_above,
    response,
    stamp,
)
from startrack.io import save_json
from startrack.observation import psf_at, psf_of, sky_electrons
from startrack.prediction import drawn_cases
from startrack.verification import (
    FlightComparison,
    Windows,
    centroids,
    compare_flown,
    correlation,
    image_of_other,
    read_windows,
)

LAUNCH = 1999.56
# The team counts 5 electrons a number; photon transfer of pixels in flight says 5.9.
SCALE = 5.9 / 5
# Published: 5263 electron / s of a star of 10.32 mag (sot/chandra_aca, transform.py).
RATE, ZERO = 5263.0 * SCALE, 10.32
# The faintest star that a box accepts (sot/proseco, catalog.py and acq.py): 1.5 mag fainter than
# its star; since June 2019 11.2 mag; since the middle of 2022 also the limit at which the bench
# counts 50 hits.
FAINTER, FAINTEST, CLIPPED, COUNTED = 1.5, 11.2, 2019.45, 2022.5
HITS = Path(__file__).parents[1] / "tests/oracle/chandra_hits.json"
HITS_YEAR = 2021.2  # of these limits
PUBLISHED_HIT = 0.25  # of the light of the faintest star, from which on a block is a hit
# Pixels above 100 electron / s at -10 degC in the calibrations before those of the law (cxc.cfa
# .harvard.edu/mta/ASPECT/dark_cal/2002_dec): date and number.
EARLY = ((2000.89, 34346), (2001.16, 37381), (2002.15, 56671), (2002.65, 64023), (2002.92, 66850))
EARLY_CELSIUS, WARM = -10.0, 100.0
WITHIN = 7.0  # arcsec from its place, at which a star counts as acquired; assumed
BENCH_WITHIN = 2.0  # the same on the bench, whose criterion is not published; chosen on its cells
# Published zodiacal light of 19 calibrations, 1.28 to 2.62 electron / s in a pixel (cxc.cfa.harvard
# .edu/mta/ASPECT/dark_cal/2011_dec).
SKY = 1.72 * SCALE
OTHER_YEARS, OTHER_MAGNITUDES = (2017.5, 2019.5, 2021.5, 2022.5), (9.0, 9.75, 10.5)
MAGNITUDES = (9.0, 9.25, 9.5, 9.75, 10.0, 10.25, 10.5)
WARMEST, COLDEST = 0, -13
GUIDE = (7.0, 7.5, 8.0, 8.5, 9.0, 9.5)  # mag, of guide stars; as in validation.py
# After the first comparison, see docs/figures/flight.md.
EASY = (8.0, -8)  # mag and degC: up to there, what is not acquired is lost to other causes
# Published residuals of guide stars (cxc.cfa.harvard.edu/mta/ASPECT/img_recon): the year, the CCD
# (degC, of ASPECT/aca_cool_1), the year of the dark calibration before (ASPECT/dark_cal/2002_dec),
# mean rms of all stars and of the best star of each observation (arcsec).
RESIDUALS = ((2000.5, -10.0, 1999.61, 0.060, 0.046), (2003.16, -10.0, 2002.92, 0.070, 0.050))
# Half of the dither of the flight's pixels of 2005 (arcsec), its periods and the time between
# images (s).
DITHER, PERIODS, CADENCE = 8.0, (1000.0, 707.0), 2.05
STRIP = 144  # rows of the part of the detector that is drawn for them
GUIDE_SIZE = 6  # pixel, of the images of guide stars then
DEVICES = 16  # detectors drawn for each observation
YEAR, TEMPERATURE = "instrument.detector.age.year", "instrument.detector.thermal.temperature"
NEAR_MIDDLE = 0.25  # pixel, of a star from the middle of the images of which the mean is fitted
FID_SCALE = 32  # numbers of the files of 8 x 8 images, over those of the camera


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parts = {
        one.__name__: one
        for one in (
            camera,
            dark_current,
            flicker,
            image,
            hits,
            acquisition,
            bench,
            foreseen,
            centroid,
            raw,
            growth,
            drift,
            tess,
        )
    }
    parser.add_argument(
        "parts",
        nargs="*",
        metavar="PART",
        help=f"parts to run: {', '.join(parts)} (default: all); the page keeps the "
        "figures of the others",
    )
    parser.add_argument("--page", type=Path, metavar="FOLDER", help="folder for the page")
    options = command.read(parser)
    data = flown()
    found: dict[str, Any] = {}
    if options.parts and options.page and (options.page / "flight.json").is_file():
        found = json.loads((options.page / "flight.json").read_text(encoding="utf-8"))
    for part in [parts[name] for name in options.parts or parts]:
        before = time.process_time()
        result = part(data, options.quick)
        if result is None:
            print(f"{part.__name__} left out: its data are missing", flush=True)
            continue
        found |= result
        print(f"{part.__name__}: {time.process_time() - before:.0f} s of CPU", flush=True)
    figures = {name: value for name, value in found.items() if isinstance(value, float | dict)}
    for name, value in figures.items():
        each = value if isinstance(value, dict) else {"": value}
        print(f"{name:24} {', '.join(f'{key} {one:.4g}'.strip() for key, one in each.items())}")
    command.save(options, {**figures, "parts": found})
    if options.page:
        found["source"] = command.source("chandra.py --page FOLDER")
        save_json(options.page / "flight.json", found)
        write_page(options.page, found)
        draw(options.page / "flight.png", found)


def flown() -> dict[str, Any]:
    """Flight data by the names of the files; the files of the oracle are always included."""
    oracle = Path(__file__).parents[1] / "tests/oracle/chandra_dark.json"
    known = json.loads(oracle.read_text(encoding="utf-8"))
    data = {"dark_histograms": known["histograms"], "flicker": known["flicker"]}
    folder = Path(os.environ.get("STARTRACK_DATA", "")) / "references/chandra"
    if os.environ.get("STARTRACK_DATA") and folder.is_dir():
        data["stars"] = folder / "stars_2020.csv"
        data["psf"] = folder / "psf.csv"
        for name in ("acquisition_2025", "drift"):
            data[name] = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    pixels = folder.with_name("chandra-raw")
    if os.environ.get("STARTRACK_DATA") and pixels.is_dir():
        data["raw"] = sorted(pixels.glob("obs*.npz"))
        data["bench"] = sorted(pixels.glob("pea_*.json"))
    return data


# Places of stars.


def camera(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Residuals on stars that were not used in the fit, for each order."""
    if "stars" not in data:
        return None
    table = read_star_table(data["stars"])
    array = assumed_array(table)
    orders = orders_of(table) if not quick else (Order("3"), Order("3", True))
    found = cross_validate_all(table, orders, *array, folds=3 if quick else 10)
    best = supported_order(found)
    y, z = (best.rms / arcsec).tolist()
    cold = min((one for one in found if not one.order.warm), key=lambda one: one.mean_square)
    rows = [[str(one.order), one.order.unknowns, *(one.rms / arcsec).tolist()] for one in found]
    # 95 % by chi-square, as of independent residuals.
    spread = math.sqrt(1 / (2 * len(table))) * 1.96
    return {
        "camera_y_arcsec": y,
        "camera_z_arcsec": z,
        "camera_interval": spread,
        "camera_cold_y_arcsec": float(cold.rms[0] / arcsec),
        "camera_cold_z_arcsec": float(cold.rms[1] / arcsec),
        "camera_orders": rows,
        "camera_chosen": str(best.order),
        "camera_stars": len(table),
    }


# Dark current.


def device(year: float, celsius: float, **changes: Any) -> Detector:
    """The detector of the catalogue's design at a year and temperature."""
    detector = load_design(shipped("trackers/chandra-aca.toml")).case.instrument.detector
    assert detector.age is not None
    assert detector.thermal is not None
    return replace(
        detector,
        age=replace(detector.age, year=year),
        thermal=replace(detector.thermal, temperature=celsius + ZERO_CELSIUS),
        **changes,
    )


def dark_current(data: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Bins of the histogram by the law and in a drawn map, compared with flight."""
    rows, worst, warm, curves = [], 0.0, 0.0, []
    for one in data["dark_histograms"][:: 5 if quick else 1]:
        detector = device(one["year"], one["temperature_c"])
        edges, pixels = np.array(one["edges_e_per_s"]), np.array(one["pixels"])
        scale = dark_growth(detector)
        above = pixels_above(CHANDRA_ACA, edges / scale, one["year"] - LAUNCH) * 2**20
        law = above[:-1] - above[1:]
        drawn, _ = np.histogram(dark(detector) / SCALE, edges)
        inside = (edges[:-1] > 19.9) & (edges[1:] < 2010)
        off = float(np.abs(law / pixels - 1)[inside].max())
        hot = edges[:-1] > 99
        share = float(above[:-1][hot][0] / pixels[hot].sum() - 1)
        pull = (drawn - law)[inside] / np.sqrt(law[inside])
        chance = float(stats.chi2.sf((pull**2).sum(), inside.sum()))
        worst, warm = max(worst, off), max(warm, abs(share))
        rows.append([one["year"], one["temperature_c"], off, share, chance])
        curves.append([edges[:-1][inside].tolist(), pixels[inside].tolist(), law[inside].tolist()])
    early = []
    for year, count in EARLY:
        scale = dark_growth(device(year, EARLY_CELSIUS))
        above = pixels_above(CHANDRA_ACA, np.array([WARM]) / scale, year - LAUNCH) * 2**20
        early.append([year, count, float(above[0])])
    return {
        "dark_early": early,
        "dark_bins_worst": worst,
        "warm_share_worst": warm,
        "dark_rows": rows,
        "dark_curves": curves,
    }


def dark_growth(detector: Detector) -> float:
    """Dark current at the detector's temperature over that at the temperature of the law."""
    assert detector.thermal is not None
    reference = replace(detector.thermal, temperature=CHANDRA_ACA.kelvin)
    return float(detector.thermal.growth / reference.growth)


def flicker(data: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Cumulative laws of jumps of drawn pixels, compared with flight."""
    known, law = data["flicker"], Flicker()
    step, rng = np.array(known["log10_step"]), np.random.default_rng(0)
    count, rows, curves = 2000 if quick else 200_000, [], []
    for low, high, flown_law in zip(
        known["dark_from_e_per_s"], known["dark_to_e_per_s"], known["cumulative"], strict=True
    ):
        current = np.exp(rng.uniform(math.log(low * (1 + 1e-9)), math.log(min(high, 3000)), count))
        state = Flickering(law, current[None], Streams(1, 0))
        drawn = np.searchsorted(np.sort(state.step), step, side="right") / count
        rows.append([low, high, float(np.abs(drawn - flown_law).max())])
        curves.append([step.tolist(), list(flown_law), drawn.tolist()])
    return {
        "flicker_worst": max(row[2] for row in rows),
        "flicker_rows": rows,
        "flicker_curves": curves,
    }


# Images.


def image(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Stamps of the shipped PSF minus the 144 tables, as fractions of the peak of each."""
    if "psf" not in data:
        return None
    psf, worst = star_psf(), []
    with data["psf"].open(newline="") as file:
        for row in list(csv.reader(file))[1 : 9 if quick else None]:
            values = np.array(row, float)
            y, x = values[0:2].mean(), values[2:4].mean()
            wanted, made = values[4:].reshape(8, 8), np.zeros((8, 8))
            stamp(made, psf, np.array([x + 3.5]), np.array([y + 3.5]), np.ones(1))
            inside = wanted > 0  # the source has no value at the rim of some tables
            worst.append(float(np.abs(made - wanted)[inside].max() / wanted.max()))
    return {
        "psf_worst": max(worst),
        "psf_median": float(np.median(worst)),
        "psf_tables": len(worst),
    }


# Acquisition and centroids.


@lru_cache(maxsize=1)
def star_psf() -> Any:
    """The measured image, as it is in the file, at all places of the field."""
    instrument = load_design(shipped("trackers/chandra-aca.toml")).case.instrument
    alike = replace(instrument.optics, growth_along=0.0, growth_across=0.0)
    return psf_of(replace(instrument, optics=alike))


def star_field(
    detector: Detector, magnitude: float, apart: int, seed: int
) -> tuple[Frame, Floats, float]:
    """A frame of stars of one magnitude on a lattice: frame, places, and flux in digital
    numbers."""
    streams, side = Streams(seed, 0), detector.columns
    line = np.arange(apart / 2 + 8, side - apart / 2 - 8, apart)
    place = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    place = place + streams("places of stars").uniform(-0.5, 0.5, place.shape)
    electrons = RATE * 10 ** (-0.4 * (magnitude - ZERO)) * detector.exposure
    expected = np.asarray((dark(detector) + SKY) * detector.exposure)
    stamp(expected, star_psf(), place[:, 0], place[:, 1], np.full(len(place), electrons))
    return frame_of(expected, detector, streams), place, electrons / detector.electrons_per_dn


def faintest(year: float, celsius: float, magnitude: float, half_width: float) -> float:
    """Magnitude of the faintest star that a box accepted in a year.

    It is at least the star's magnitude if the limit of hits is brighter.
    """
    limits = [magnitude + FAINTER]
    if year >= CLIPPED:
        limits.append(FAINTEST)
    if year >= COUNTED:
        limits.append(limit_of_hits(celsius, half_width))
    return max(min(limits), magnitude + 0.01)


def limit_of_hits(celsius: float, half_width: float) -> float:
    """Magnitude limit at which the bench counts 50 hits, as the flight takes it."""
    table = json.loads(HITS.read_text(encoding="utf-8"))["limits"]
    of_widths = [
        float(np.interp(celsius, table["celsius"], column))
        for column in np.transpose(table["magnitude"])
    ]
    return float(np.interp(half_width, table["half_width"], of_widths))


def hits(data: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Blocks above the limit of a hit in drawn dark maps where the bench counts 50 hits."""
    case = load_design(shipped("trackers/chandra-aca.toml")).case
    focal, hit = case.instrument.camera.focal_length_px, case.tracker.box.hit
    points = json.loads(HITS.read_text(encoding="utf-8"))["points"]
    shares, counted = (hit, PUBLISHED_HIT), []
    for celsius, half_width, limit in points[:: 12 if quick else 1]:
        detector = device(HITS_YEAR, celsius)
        number = np.asarray(dark(detector)) + SKY
        blocks = number.reshape(512, 2, 512, 2).sum(axis=(1, 3))
        light = RATE * 10 ** (-0.4 * (limit - ZERO))
        size = (math.tan(half_width * arcsec) * focal) ** 2  # of a box, in blocks
        counted.append([size * float((blocks > share * light).mean()) for share in shares])
    counts = np.log(counted)
    return {
        "hits_counted": np.exp(counts.mean(axis=0)).tolist(),
        "hits_spread": counts.std(axis=0).tolist(),
        "hits_points": len(counts),
    }


def acquired(
    year: float,
    celsius: float,
    magnitude: float,
    half_width: float,
    stars: int,
    columns: int | None = None,
) -> Floats:
    """Distances (n,) between each star and the spot matched with it, arcsec; NaN without a spot.

    stars  at least the number of columns of the detector, if not all
    """
    design = load_design(shipped("trackers/chandra-aca.toml")).case
    focal = design.instrument.camera.focal_length_px
    reach = math.tan(half_width * arcsec) * focal
    fainter = faintest(year, celsius, magnitude, half_width) - magnitude
    box = replace(design.tracker.box, half_width=half_width * arcsec, fainter=fainter)
    plan, far, seed = plan_detection(Detection(), star_psf()), np.empty(0), 0
    while len(far) < stars:
        detector = device(year, celsius, device_seed=seed)
        if columns:
            detector = replace(detector, columns=columns, rows=columns)
        frame, place, flux = star_field(detector, magnitude, math.ceil(2 * reach) + 14, seed)
        error = Streams(seed, 1)("expected attitude").normal(0, box.prior * focal, place.shape)
        taken = take(frame, place + error, np.full(len(place), flux), reach, box, plan)
        off = np.hypot(taken.x - place[:, 0], taken.y - place[:, 1])
        far, seed = np.append(far, off / focal / arcsec), seed + 1
    return far


def acquisition(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Probability of acquisition over magnitude, temperature and half width, of 2025."""
    if "acquisition_2025" not in data:
        return None
    rows, stars, columns = [], 20 if quick else 500, 256 if quick else None
    easy = [
        one["probability"]
        for one in data["acquisition_2025"]
        if one["magnitude_aca"] <= EASY[0] and one["ccd_temperature_c"] <= EASY[1]
    ]
    other = float(np.mean(easy))
    for one in data["acquisition_2025"]:
        magnitude, celsius = one["magnitude_aca"], one["ccd_temperature_c"]
        if magnitude not in MAGNITUDES or not COLDEST <= celsius <= WARMEST:
            continue
        if quick and (magnitude != MAGNITUDES[-1] or celsius != WARMEST):
            continue
        half = one["half_width_arcsec"]
        far = acquired(2025.0, celsius, magnitude, half, stars, columns)
        good, false = float((far < WITHIN).mean()), float((far >= WITHIN).mean())
        seen = one["probability"]
        rows.append([magnitude, celsius, half, seen, other * good, false, len(far)])
    off = np.array([row[4] - row[3] for row in rows])
    return {
        "acquisition_worst": float(np.abs(off).max()),
        "acquisition_rms": float(np.sqrt(np.mean(off**2))),
        "acquisition_mean": float(off.mean()),
        "acquisition_within": float(np.mean(np.abs(off) <= 0.05)),
        "acquisition_other": other,
        "acquisition_rows": rows,
    }


def bench(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Probability of acquisition on a bench with the camera's electronics, year by the file.

    Predicted with the tolerance assumed in flight, and with one chosen on these cells.
    """
    rows, stars, columns = [], 9 if quick else 100, 256 if quick else None
    for path in data.get("bench", ()):
        year = float(re.findall(r"\d{4}", path.name)[0]) + 0.5
        cells = json.loads(path.read_text(encoding="utf-8"))["rows"]
        for magnitude, celsius, half, good, tried in cells[:: 100 if quick else 1]:
            far = acquired(year, celsius, magnitude, half, stars, columns)
            chosen, flight = (float((far < within).mean()) for within in (BENCH_WITHIN, WITHIN))
            rows.append([magnitude, celsius, half, good / tried, chosen, flight, tried])
    if not rows:
        return None
    seen, chosen, as_flown, tries = np.array(rows).T[3:]
    figures: dict[str, Any] = {"bench_rows": rows}
    for name, predicted in (("bench", chosen), ("bench_as_flown", as_flown)):
        off = predicted - seen
        figures |= {
            f"{name}_within_0_1": float(np.mean(np.abs(off) <= 0.1)),
            f"{name}_within_0_05": float(np.mean(np.abs(off) <= 0.05)),
            f"{name}_mean": float(off.mean()),
            f"{name}_rms": float(np.sqrt(np.mean(off**2))),
        }
    return figures | {
        "bench_counting_0_1": by_counting(chosen, tries, 0.1),
        "bench_counting_0_05": by_counting(chosen, tries, 0.05),
    }


def foreseen(data: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Predicted probability of acquisition on benches of years without data here: year, degC,
    magnitudes."""
    rows: list[list[float]] = []
    stars, columns = (9, 256) if quick else (200, None)
    for year in OTHER_YEARS[:: 3 if quick else 1]:
        for celsius in (-11.0, -5.0, -1.0):
            found = [acquired(year, celsius, m, 120.0, stars, columns) for m in OTHER_MAGNITUDES]
            rows.append([year, celsius, *(float((far < BENCH_WITHIN).mean()) for far in found)])
    return {"foreseen_rows": rows}


def by_counting(probability: Floats, tries: Floats, within: float) -> float:
    """Fraction of cells within a distance of their own probability, by the chance of the tries
    alone."""
    low = stats.binom.cdf(np.ceil(tries * (probability - within)) - 1, tries, probability)
    high = stats.binom.cdf(np.floor(tries * (probability + within)), tries, probability)
    return float(np.mean(high - low))


def raw(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Figures of guide stars' pixels, predicted over measured, of each observation."""
    rows, curves, files, budgets = [], {}, data.get("raw", ()), []
    levels, parts = [], []
    for path in files:
        with np.load(path) as file:
            celsius = float(file["ccd_celsius"])
        stars = [star for star in read_windows(path) if star.number.shape[1] == GUIDE_SIZE]
        if quick:
            stars = [star.of(slice(0, 400)) for star in stars]
        year = 1998.0 + stars[0].time[0] / (365.25 * 86400)  # of the observatory's clock
        case = load_design(shipped("trackers/chandra-aca.toml")).case
        case = replace(case, instrument=replace(case.instrument, detector=device(year, celsius)))
        sets = [f"{YEAR}={year}", f'{TEMPERATURE}="{celsius} degC"']
        count = 2 if quick else DEVICES
        unknown = drawn_cases(shipped("trackers/chandra-aca.toml"), 0, count, sets)
        flown = compare_flown(case, stars, count, unknown=unknown)
        budgets.append(by_budget(case, stars, flown))
        levels += fid_levels(path, case.tracker.box)
        prefix = f"{path.stem} " if len(files) > 1 else ""
        parts += [[prefix + star.name, *background_parts(case, star)] for star in stars]
        for row in flown.differences:
            bounds = [*vars(row.seen).values(), *vars(row.predicted).values()]
            rows.append([prefix + row.star, row.name, *bounds])
        for star, pair in flown.curves.items():
            curves[prefix + star] = [one.tolist() for one in pair]
    if not rows:
        return None

    def ratios(name: str) -> dict[str, float]:
        return {row[0]: row[5] / row[2] for row in rows if row[1] == name}

    def scatter(star: str) -> list[list[float]]:
        """Total scatter, from exposure to exposure, by the place in the pixel, and the rest,
        pixel rms: measured and predicted."""
        sizes = {row[1]: (row[2], row[5]) for row in rows if row[0] == star}
        found = []
        for k, curve in enumerate(curves[star]):
            phase = float(np.sqrt(np.nanmean(np.square(curve))))
            total, temporal = sizes["total"][k], sizes["temporal"][k]
            rest = math.sqrt(max(total**2 - temporal**2 - phase**2, 0.0))
            found.append([total, temporal, phase, rest])
        return found

    background = np.array([*ratios("background").values()])
    together = [correlation(*map(np.array, pair)) for pair in curves.values()]
    return {
        "raw_budget_ratio": {
            name: float(np.mean([one[name] for one in budgets])) for name in budgets[0]
        },
        "raw_temporal_ratio": ratios("temporal"),
        "raw_total_ratio": ratios("total"),
        "raw_background": ratios("background"),
        "raw_curves": dict(zip(curves, together, strict=True)),
        "raw_psf_worst": max(row[2] for row in rows if row[1] == "image"),
        "raw_background_ratio": float(background[np.argmax(np.abs(np.log(background)))]),
        "raw_curve_correlation": float(min(together)),
        "read_noise_ratio": float(np.mean([*ratios("read_noise").values()])),
        "gain_ratio": float(np.mean([*ratios("gain").values()])),
        "raw_rows": rows,
        "raw_background_parts": parts,
        "raw_scatter": [[star, *scatter(star)] for star in curves],
        "raw_fid_levels": levels,
        "raw_shapes": [[star, *pair] for star, pair in curves.items()],
    }


def growth(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Sizes of guide stars' images along and across the field, and those of the design.

    For each star: degrees from the axis; sizes along and across, over the measured image; rms
    misfit of the pixels of its mean image, of the peak: with these sizes, with one image, and with
    the sizes exchanged.
    """
    case, rows = load_design(shipped("trackers/chandra-aca.toml")).case, []
    for path in data.get("raw", ()):
        for star in read_windows(path):
            if star.number.shape[1] == GUIDE_SIZE:
                rows.append([star.name, *sizes(case, star, quick)])
    if not rows:
        return None
    corner = psf_at(case.instrument, 0.0, 0.0)
    other = image_of_other(corner, star_psf(), case.tracker.box)
    return {"growth_rows": rows, "growth_corner": other}


def sizes(case: Case, star: Windows, quick: bool) -> list[float]:
    """The numbers of `growth` of one star, by least squares."""
    instrument, box = case.instrument, case.tracker.box
    camera, optics = instrument.camera, instrument.optics
    at = star.place_on(instrument.detector)
    angle = math.hypot(*(np.array(at) - camera.centre)) / camera.focal_length_px
    square = (math.atan(angle) / optics.field_edge) ** 2
    seen = centroids(star, box)
    moment = seen.place - seen.windows.corner - (GUIDE_SIZE - 1) / 2
    near = (np.abs(moment) < NEAR_MIDDLE).all(axis=1)
    sent = seen.windows.background
    background = 0.0 if sent is None else float(sent[near].mean())
    image = (seen.windows.number[near].mean(axis=0) - background) * image_mask(GUIDE_SIZE)
    spread = moment[near][:: max(int(near.sum()) // 20, 1)]

    def misfit(values: Floats) -> Floats:
        x, y, along, across = values
        grown = replace(
            optics, growth_along=(along - 1) / square, growth_across=(across - 1) / square
        )
        psf = psf_at(replace(instrument, optics=grown), *at)
        made, middle = np.zeros((22, 22)), 10.5 + np.array([x, y]) + spread
        stamp(made, psf, middle[:, 0].copy(), middle[:, 1].copy(), np.ones(len(spread)))
        inner = made[8:14, 8:14] * image_mask(GUIDE_SIZE)
        flux = float((inner * image).sum() / (inner**2).sum())
        return np.asarray((flux * inner - image) / image.max()).ravel()

    def rms(along: float, across: float) -> float:
        start, size = np.zeros(2), np.array([along, across])
        best = optimize.least_squares(
            lambda place: misfit(np.append(place, size)), start, diff_step=0.01, max_nfev=8
        )
        return float(np.sqrt(2 * best.cost / image_mask(GUIDE_SIZE).sum()))

    fit = optimize.least_squares(
        misfit, [0.01, 0.01, 1.01, 0.99], diff_step=0.01, max_nfev=2 if quick else 12
    )
    along, across = (float(size) for size in fit.x[2:])
    best = float(np.sqrt(2 * fit.cost / image_mask(GUIDE_SIZE).sum()))
    one = 1 + 1e-9  # of a growing image, as the others
    return [math.degrees(math.atan(angle)), along, across, best, rms(one, one), rms(across, along)]


def background_parts(case: Case, star: Windows) -> list[float]:
    """Predicted background of a pixel by the sky, the dark current of undamaged pixels, and the
    star's own light in the eight pixels of the average; digital numbers.
    """
    detector, box = case.instrument.detector, case.tracker.box
    electrons = detector.electrons_per_dn
    fresh = replace(detector, age=None, columns=64, rows=64)
    undamaged = float(np.median(np.asarray(dark(fresh)))) * detector.exposure / electrons
    psf, images = psf_at(case.instrument, *star.place_on(detector)), np.zeros((16, 24, 24))
    for n, image in enumerate(images):
        x, y = 11.5 + (np.array(divmod(n, 4)) - 1.5) / 4
        stamp(image, psf, np.array([x]), np.array([y]), np.ones(1))
    seen = centroids(star, box)
    inner = images[:, 9:15, 9:15] * image_mask(GUIDE_SIZE)
    light = float(np.median(seen.total)) / float(inner.sum(axis=(1, 2)).mean())
    own = float(np.mean(level_of_image(light * images[:, 8:16, 8:16], box, 0.0)))
    return [float(sky_electrons(case)) / electrons, undamaged, own]


def fid_levels(path: Path, box: Box) -> list[list[Any]]:
    """Backgrounds of fid lights by the rule of the design, and by the middle half, less those that
    the camera sent down: name, median difference of each and rms of the first; numbers.
    """
    rows = []
    for light in read_windows(path):
        if light.number.shape[1] == 8 and light.background is not None:
            images = light.number / FID_SCALE
            off = [
                level_of_image(images, one, 0.0) - light.background
                for one in (box, replace(box, background="dynamic"))
            ]
            rows.append([light.name, *(float(np.median(one)) for one in off), float(off[0].std())])
    return rows


def by_budget(case: Case, stars: Sequence[Windows], flown: FlightComparison) -> dict[str, float]:
    """Errors of single stars of these magnitudes by the budget, over the errors in flight."""
    found = single_stars(case)
    seen = {(row.star, row.name): row.seen.value for row in flown.differences}

    def mean(name: str, of: str) -> float:
        expected = np.interp(
            [star.magnitude for star in stars], found.magnitude, getattr(found, name)
        )
        return float(expected.mean() / np.mean([seen[star.name, of] for star in stars]))

    return {
        "temporal": mean("temporal", "temporal"),
        "usual": mean("usual", "total"),
        "total": mean("total", "total"),
    }


def centroid(data: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Residuals of guide stars that are followed over a dither, with the ground's dark maps.

    The rms is over time, of the first moment about its place, and the mean is over stars, as in the
    publication.
    """
    found: dict[str, Any] = {"centroid_rows": [], "centroid_years": []}
    for year, celsius, calibrated, published, least in RESIDUALS:
        detector = strip(year, celsius, quick)
        guided = guide(detector, 64 if quick else 512)
        of_map = np.asarray(dark(strip(calibrated, celsius, quick)))
        maps = [of_map, np.zeros_like(of_map), np.asarray(dark(detector))]
        rms = np.array([residuals(guided, detector, one) for one in maps])
        rows = [
            [year, magnitude, *rms[:, guided.magnitude == magnitude].mean(axis=1).tolist()]
            for magnitude in GUIDE
        ]
        rng = np.random.default_rng(0)
        fives = [rng.choice(rms.shape[1], 5, replace=False) for _ in range(400)]
        best = float(np.mean([rms[0, five].min() for five in fives]))
        means = rms.mean(axis=1).tolist()
        spread = float(rms[0].std() / math.sqrt(rms.shape[1]))
        found["centroid_rows"] += rows
        found["centroid_years"].append(
            [year, calibrated, published, *means, least, best, rms.shape[1], spread]
        )
    first = found["centroid_years"][0]
    return found | {
        "centroid_mean_arcsec": first[3],
        "centroid_ratio": first[3] / first[2],
        "centroid_ratios": {
            f"{row[0]:.0f}, {name}": row[k] / row[2]
            for row in found["centroid_years"]
            for k, name in ((3, "last map"), (4, "no map"), (5, "perfect map"))
        },
    }


class Guided(NamedTuple):
    """Images of n exposures of m stars that are followed.

    number     (n, m, 8, 8) digital number less the offset
    corner     (n, m, 2) pixel (x, y) of the first pixel of each
    place      (n, m, 2) pixel, true
    magnitude  (m,)
    """

    number: Floats
    corner: Ints
    place: Floats
    magnitude: Floats


def strip(year: float, celsius: float, quick: bool) -> Detector:
    """Part of the detector, the same pixels at all years."""
    return replace(device(year, celsius), columns=256 if quick else 1024, rows=STRIP)


def guide(detector: Detector, exposures: int) -> Guided:
    """Stars on the published dither, whose images move as on board.

    Raw numbers decide: an image moves by a pixel in the exposure after its moment has passed the
    limit.
    """
    case, streams = load_design(shipped("trackers/chandra-aca.toml")).case, Streams(0, 0)
    line = [np.arange(20.0, side - 14, 26) for side in (detector.columns, detector.rows)]
    middle = np.stack(np.meshgrid(*line), axis=-1).reshape(-1, 2)
    middle += streams("places of stars").uniform(-0.5, 0.5, middle.shape)
    magnitude = np.resize(GUIDE, len(middle))
    light = RATE * 10 ** (-0.4 * (magnitude - ZERO)) * detector.exposure
    time = CADENCE * np.arange(exposures)
    sway = DITHER * arcsec * case.instrument.camera.focal_length_px
    dither = sway * np.column_stack([np.sin(2 * math.pi * time / period) for period in PERIODS])
    place = middle + dither[:, None]
    gain, state = response(detector), flickering(detector, streams)
    empty = (np.asarray(dark(detector)) + SKY) * detector.exposure
    plan = plan_detection(Detection(), star_psf())
    near = np.arange(-4, 4)
    corner, corners, numbers = np.rint(place[0] + 0.5).astype(np.int64), [], []
    for k, at in enumerate(place):
        expected = np.zeros_like(empty)
        stamp(expected, star_psf(), at[:, 0].copy(), at[:, 1].copy(), light)
        expected = expected * (1.0 if gain is None else gain) + empty
        if state and k:
            state.later(CADENCE)
        frame = frame_of(expected, detector, Streams(0, 1 + k), state=state)
        column, row = corner.T[:, :, None, None]
        numbers.append(frame.image[row + near[:, None], column + near] - detector.offset)
        corners.append(corner - 4)
        after = follow(frame, corner, case.tracker.box, plan)
        corner = np.where(after < 0, corner, after)
    return Guided(np.array(numbers, float), np.array(corners), place, magnitude)


def residuals(guided: Guided, detector: Detector, of_map: Floats) -> Floats:
    """Rms over time (m,) of each star's first moments about its places, arcsec.

    of_map  (rows, columns) electron / second, which is subtracted
    """
    case = load_design(shipped("trackers/chandra-aca.toml")).case
    near, found = np.arange(8), []
    numbers = of_map * detector.exposure / detector.electrons_per_dn
    for star in range(len(guided.magnitude)):
        corner = guided.corner[:, star]
        column, row = corner.T[:, :, None, None]
        number = guided.number[:, star] - numbers[row + near[:, None], column + near]
        seen = centroids(
            Windows("star", np.arange(len(corner), dtype=float), number, corner), case.tracker.box
        )
        off = seen.place - guided.place[seen.windows.time.astype(int), star]
        found.append(math.sqrt(float(off.var(axis=0).mean())))
    return np.array(found) / case.instrument.camera.focal_length_px / arcsec


# Boresight.


def drift(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Drift of the boresight by the flight's law: rate, growth with temperature, jumps."""
    if "drift" not in data:
        return None
    rows = []
    for axis, law in data["drift"].items():
        sizes = np.array([size for _, size in law["jumps"]])
        rows.append(
            [axis, law["trend"], law["scale"], len(sizes), float(np.sqrt(np.mean(sizes**2)))]
        )
    return {"drift_rows": rows}


# Another flown tracker.


def tess(_: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Error about the boresight of a camera of TESS, by formula and by the scatter of its
    quaternions.

    All cameras have the spacecraft's rotation. The additional scatter of the outer ones along y,
    and the missing scatter along z, is their own error about their boresights.
    """
    oracle = Path(__file__).parents[1] / "tests/oracle/tess_quaternions.json"
    known = json.loads(oracle.read_text(encoding="utf-8"))
    square = np.array(known["deviation_arcsec"]) ** 2
    outer, inner = square[[0, 3]].mean(axis=0), square[[1, 2]].mean(axis=0)
    share = np.sin(np.radians(known["tilt_deg"][:2])) ** 2
    y, z = np.sqrt(np.array([outer[1] - inner[1], inner[2] - outer[2]]) / (share[0] - share[1]))
    case = load_design(Path(__file__).with_name("tess_camera.toml")).case
    found = analytic(case, 32 if quick else 512)
    return {
        "tess_ratio": {"about": found.about / arcsec / float((y + z) / 2)},
        "tess_seen_arcsec": {"by y": float(y), "by z": float(z)},
        "tess_predicted_arcsec": {"across": found.across / arcsec, "about": found.about / arcsec},
    }


if __name__ == "__main__":
    command.run(main)
