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
from typing import Any

import command
import numpy as np
from flight_page import draw, write_page
from scipy import stats

from startrack import Case, Frame, Streams, arcsec, load_design, shipped
from startrack.budget import analytic, single_stars
from startrack.calibration import (
    Order,
    assumed_array,
    borne,
    cross_validate_all,
    orders_of,
    read_star_table,
)
from startrack.core import ZERO_CELSIUS, Floats
from startrack.detection import (
    Box,
    DarkFrames,
    DarkMap,
    Detection,
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
    dark_frames,
    frame_of,
    pixels_above,
    stamp,
)
from startrack.io import save_json
from startrack.observation import psf_of
from startrack.prediction import drawn_cases
from startrack.verification import (
    FlightComparison,
    Windows,
    compare_flown,
    correlation,
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
WITHIN = 7.0  # arcsec from its place, at which a star counts as acquired; assumed
BENCH_WITHIN = 2.0  # the same on the bench, whose criterion is not published; chosen on its cells
# Published zodiacal light of 19 calibrations, 1.28 to 2.62 electron / s in a pixel (cxc.cfa.harvard
# .edu/mta/ASPECT/dark_cal/2011_dec).
SKY = 1.72 * SCALE
OTHER_YEARS, OTHER_MAGNITUDES = (2017.5, 2019.5, 2021.5, 2022.5), (9.0, 9.75, 10.5)
MAGNITUDES = (9.0, 9.25, 9.5, 9.75, 10.0, 10.25, 10.5)
WARMEST, COLDEST = 0, -13
PUBLISHED_CENTROID = 0.06  # arcsec, of the flight's page on image reconstruction
GUIDE = (7.0, 7.5, 8.0, 8.5, 9.0, 9.5)  # mag, of guide stars; as in validation.py
# After the first comparison, see docs/figures/flight.md.
EASY = (8.0, -8)  # mag and degC: up to there, what is not acquired is lost to other causes
# The centroids were published early in the mission.
GUIDE_YEAR, GUIDE_CELSIUS = 2005.0, -19.0
GUIDE_SIZE = 6  # pixel, of the images of guide stars then
DEVICES = 16  # detectors drawn for each observation
YEAR, TEMPERATURE = "instrument.detector.age.year", "instrument.detector.thermal.temperature"
FID_SCALE = 32  # numbers of the files of 8 x 8 images, over those of the camera
UNREPLACED = 1e9  # sigma: the dark map is subtracted, and no pixel takes its neighbours' mean


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
    """Residuals on stars that the fit has not seen, of each order."""
    if "stars" not in data:
        return None
    table = read_star_table(data["stars"])
    array = assumed_array(table)
    orders = orders_of(table) if not quick else (Order("3"), Order("3", True))
    found = cross_validate_all(table, orders, *array, folds=3 if quick else 10)
    best = borne(found)
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
    """Bins of the histogram by the law and in a drawn map, beside those in flight."""
    rows, worst, warm, curves = [], 0.0, 0.0, []
    for one in data["dark_histograms"][:: 5 if quick else 1]:
        detector = device(one["year"], one["temperature_c"])
        edges, pixels = np.array(one["edges_e_per_s"]), np.array(one["pixels"])
        assert detector.thermal is not None
        scale = (
            detector.thermal.growth
            / replace(detector.thermal, temperature=CHANDRA_ACA.kelvin).growth
        )
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
    return {
        "dark_bins_worst": worst,
        "warm_share_worst": warm,
        "dark_rows": rows,
        "dark_curves": curves,
    }


def flicker(data: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Cumulative laws of jumps of drawn pixels beside those in flight."""
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
    """Stamps of the shipped PSF beside the 144 tables, as fractions of the peak of each."""
    if "psf" not in data:
        return None
    psf = psf_of(load_design(shipped("trackers/chandra-aca.toml")).case.instrument)
    worst = []
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
    return psf_of(load_design(shipped("trackers/chandra-aca.toml")).case.instrument)


def star_field(
    detector: Detector, magnitude: float, apart: int, seed: int
) -> tuple[Frame, Floats, float]:
    """A frame of stars of one magnitude on a lattice: frame, places and flux in numbers."""
    streams, side = Streams(seed, 0), detector.columns
    line = np.arange(apart / 2 + 8, side - apart / 2 - 8, apart)
    place = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    place = place + streams("places of stars").uniform(-0.5, 0.5, place.shape)
    electrons = RATE * 10 ** (-0.4 * (magnitude - ZERO)) * detector.exposure
    expected = np.asarray((dark(detector) + SKY) * detector.exposure)
    stamp(expected, star_psf(), place[:, 0], place[:, 1], np.full(len(place), electrons))
    return frame_of(expected, detector, streams), place, electrons / detector.electrons_per_dn


def faintest(year: float, celsius: float, magnitude: float, half_width: float) -> float:
    """Magnitude of the faintest star that a box about a star accepted in a year.

    That of the star where the limit of hits is brighter.
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
    """Distances (n,) between each star and the spot that was taken for it, arcsec; NaN: none was.

    stars    at least
    columns  of the detector, if not all
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

    Predicted with the tolerance assumed in flight, and with one that was chosen on these cells.
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
    figures = {"bench_rows": rows}
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
    """Probability of acquisition on benches of years that were not looked at: year, degC, and of
    each magnitude.
    """
    rows: list[list[float]] = []
    stars, columns = (9, 256) if quick else (200, None)
    for year in OTHER_YEARS[:: 3 if quick else 1]:
        for celsius in (-11.0, -5.0, -1.0):
            found = [acquired(year, celsius, m, 120.0, stars, columns) for m in OTHER_MAGNITUDES]
            rows.append([year, celsius, *(float((far < BENCH_WITHIN).mean()) for far in found)])
    return {"foreseen_rows": rows}


def by_counting(probability: Floats, tries: Floats, within: float) -> float:
    """Share of cells within a distance of their own probability, by chance of the tries alone."""
    low = stats.binom.cdf(np.ceil(tries * (probability - within)) - 1, tries, probability)
    high = stats.binom.cdf(np.floor(tries * (probability + within)), tries, probability)
    return float(np.mean(high - low))


def raw(data: dict[str, Any], quick: bool) -> dict[str, Any] | None:
    """Figures of guide stars' pixels, predicted over seen, of each observation."""
    rows, curves, files, budgets = [], {}, data.get("raw", ()), []
    levels = []
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
        for row in flown.differences:
            bounds = [*vars(row.seen).values(), *vars(row.predicted).values()]
            rows.append([prefix + row.star, row.name, *bounds])
        for star, pair in flown.curves.items():
            curves[prefix + star] = [one.tolist() for one in pair]
    if not rows:
        return None

    def ratios(name: str) -> dict[str, float]:
        return {row[0]: row[5] / row[2] for row in rows if row[1] == name}

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
        "raw_fid_levels": levels,
        "raw_shapes": [[star, *pair] for star, pair in curves.items()],
    }


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
    """Rms error of the first moment of 8 x 8 pixels, over the magnitude of guide stars."""
    detector = device(GUIDE_YEAR, GUIDE_CELSIUS)
    if quick:
        detector = replace(detector, columns=256, rows=256)
    camera = load_design(shipped("trackers/chandra-aca.toml")).case.instrument.camera
    focal = camera.focal_length_px

    def maps() -> DarkFrames:
        return DarkFrames(*dark_frames(detector, 4 if quick else 32))

    plan = plan_detection(Detection(dark_map=DarkMap(hot=UNREPLACED)), star_psf(), maps)
    box = Box(25 * arcsec, size=GUIDE_SIZE)
    rows = []
    for magnitude in GUIDE[:: 3 if quick else 1]:
        frame, place, flux = star_field(detector, magnitude, 25, 7)
        taken = take(frame, place, np.full(len(place), flux), 5.0, box, plan)
        off = np.column_stack([taken.x, taken.y]) - place
        near = np.hypot(*off.T) < 1.0  # guide stars are watched: a wrong one is dropped
        off = (off - np.median(off[near], axis=0))[near] / focal / arcsec
        rms = np.sqrt(np.mean(off**2))
        rows.append([magnitude, float(rms), float(near.mean()), len(place)])
    mean = float(np.mean([row[1] for row in rows]))
    return {
        "centroid_mean_arcsec": mean,
        "centroid_ratio": mean / PUBLISHED_CENTROID,
        "centroid_rows": rows,
    }


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

    All cameras see the spacecraft turn. What the outer ones scatter more along y, and less along z,
    than the inner ones is their own error about their boresights.
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
