"""Mass and power of trackers, and limits of detectors: cost laws compared with built hardware.

    python experiments/tracker_costs.py [--json FILE] [--markdown docs/figures/tracker-costs.md]

Mass over the volume of trackers, their power compared with the default law of a design's
requirements, and full well, dark current and read noise of the catalogue's detectors over pitch and
pixel rate.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np

from startrack.design import Requirements, products, with_product
from startrack.detector import Detector
from startrack.io import from_table, save_text

TRACKERS = Path(__file__).parents[1] / "tests/oracle/tracker_costs.json"
# A megapixel of 12 bits, four times a second: few publications give frame and rate.
DATA_RATE = 1024**2 * 12 * 4  # bit / s
ROOM = 293.15  # kelvin
CCDS = ("ccd", "kaf", "kai")  # beginnings of the names of CCDs in the catalogue
LAWS = {
    "full_well": "full well over the area of a pixel, electron / um2",
    "dark": "dark current at 20 degC over the area of a pixel, electron / s / um2",
    "noise": "read noise of CCDs over the square root of the pixel rate, electron / sqrt(Mpix / s)",
}


def trackers() -> list[dict[str, Any]]:
    """Density and power of each tracker, and the ratio of its power to the law."""
    needs, found = Requirements(), []
    law = needs.power_fixed + needs.energy_per_bit * DATA_RATE
    for one in json.loads(TRACKERS.read_text(encoding="utf-8"))["trackers"]:
        row = dict(one) | {"density": None, "power_ratio": None}
        if one["size_mm"] and one["mass_kg"]:
            row["density"] = one["mass_kg"] / (math.prod(one["size_mm"]) * 1e-9)
        if one["power_w"]:
            row["power_ratio"] = one["power_w"] / law
        found.append(row)
    return found


def detectors() -> list[dict[str, Any]]:
    """The quantities that are constant by LAWS, for each detector of the catalogue."""
    found = []
    for name in products():
        table = with_product({"instrument": {"detector": {"product": name, "exposure": "0.1 s"}}})
        detector = from_table(Detector, table["instrument"]["detector"])
        area, warm = (detector.pitch * 1e6) ** 2, detector.thermal
        growth = replace(warm, temperature=ROOM).growth if warm else 1.0
        row = {
            "name": name,
            "full_well": detector.full_well / area,
            "dark": detector.dark_current * growth / area,
            "noise": None,
        }
        if name.startswith(CCDS):
            row["noise"] = detector.read_noise / math.sqrt(detector.pixel_rate / 1e6)
        found.append(row)
    return found


def spread(values: list[float]) -> tuple[float, float, float]:
    """The median, and least and greatest value over the median."""
    middle = float(np.median(values))
    return middle, min(values) / middle, max(values) / middle


def figures() -> dict[str, Any]:
    """All rows, and the spread of each law."""
    built, chips = trackers(), detectors()
    rows = {
        "density": [one["density"] for one in built if one["density"]],
        "power_ratio": [one["power_ratio"] for one in built if one["power_ratio"]],
    } | {name: [one[name] for one in chips if one[name]] for name in LAWS}
    return {
        "trackers": built,
        "detectors": chips,
        "spread": {name: spread(values) for name, values in rows.items()},
        "counts": {name: len(values) for name, values in rows.items()},
    }


def page(found: dict[str, Any], source: str) -> str:
    """The page in Markdown."""

    def cell(value: float | None, form: str = ".2f") -> str:
        return "-" if value is None else format(value, form)

    def size(one: dict[str, Any]) -> str:
        return " x ".join(f"{side:g}" for side in one["size_mm"]) if one["size_mm"] else "-"

    (density, low, high), (power, least, most) = (
        found["spread"][name] for name in ("density", "power_ratio")
    )
    counts = found["counts"]
    lines = [
        "# Mass and power of trackers, and scaling laws of pixels",
        "Cost laws of a design (`[campaign.requirements]`) compared with built hardware, by "
        f"{source}. [Mass and cost of lenses](lens-costs.md) is a separate page.",
        "",
        "## Mass and power of trackers",
        "The default power, 0.4 W and 20 nJ for each bit, is 1.41 W at 50 Mbit/s: a megapixel "
        f"of 12 bits, four times a second. Published power is {power:.2f} times this in the median "
        f"of {counts['power_ratio']} trackers, from {least * power:.2f} to {most * power:.2f} "
        "times. At lower rates the constant 0.4 W dominates. The smallest trackers need this "
        "power, most others four to ten times as much, because processor and cooler need more "
        "than the pixels; a design sets its value in `power_fixed`. No available source gives "
        "aperture, frame, rate, mass and power together, so that the slopes of power and of mass "
        "with aperture are not tested.",
        "",
        f"Mass follows volume: {density:.0f} kg/m3 in the median of {counts['density']} trackers "
        f"with a published size, from {low:.2f} to {high:.2f} times this; without Clementine's "
        "camera, whose size includes empty space, 0.65 times or more. With `density` in the "
        "requirements, the mass is computed from the volume, which grows with focal length, "
        "aperture, and the baffle of `baffle_angle`; `shielding` adds a layer of aluminium. "
        "Without `density`, the mass follows from the aperture alone.",
        "",
        "| tracker | size mm | mass kg | kg/m3 | power W | | over the law |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in found["trackers"]:
        lines.append(
            f"| {one['name']} | {size(one)} | {cell(one['mass_kg'], '.3g')} | "
            f"{cell(one['density'], '.0f')} | {cell(one['power_w'], '.2g')} | {one['kind']} | "
            f"{cell(one['power_ratio'])} |"
        )
    lines += ["", "Sources:"]
    lines += [f"- {one['name']}: {one['source']}." for one in found["trackers"]]
    lines += [
        "",
        "## Pixels",
        "Charge and dark current of a pixel grow with its area, and the noise of an amplifier "
        "with the root of its bandwidth (Janesick, Scientific charge-coupled devices, 2001). An "
        "optimiser that varies pitch or rate takes this into account by links of the design:",
        "",
        "```toml",
        "[[campaign.links]]",
        'name = "instrument.detector.full_well"',
        'to = "instrument.detector.pixel_pitch"',
        "power = 2.0",
        "```",
        "",
        "and likewise for `dark_current` with a power of 2 and, for a CCD, `read_noise` linked "
        "to `pixel_rate` with a power of 0.5. A link keeps the design's value at the start, so "
        "that only the slope comes from the law. For the detectors of the catalogue, median, and "
        "least and greatest value relative to it:",
        "",
        "| law | detectors | median | least | greatest |",
        "|---|---|---|---|---|",
    ]
    for name, text in LAWS.items():
        middle, small, large = found["spread"][name]
        lines.append(f"| {text} | {counts[name]} | {middle:.2g} | {small:.2g} | {large:.2g} |")
    lines += [
        "",
        "Full wells of one area differ by factors of three to four, so that the slope within a "
        "family matters, not the median of all. Dark current differs by four decades between "
        "processes (pinned photodiodes or not, inverted or not), and ccd270's is for 203 K, far "
        "from 20 degC: the pixel's area is a minor factor. The noise of CCDs follows the root "
        "within a factor of two over more than three decades of rate. The noise of CMOS "
        "detectors, which convert in each column, does not follow their pixel rate; they are "
        "left out of the last line.",
        "",
        "| detector | electron / um2 | electron / s / um2 | electron / sqrt(Mpix / s) |",
        "|---|---|---|---|",
    ]
    for one in found["detectors"]:
        lines.append(
            f"| {one['name']} | {one['full_well']:.0f} | {one['dark']:.2g} | "
            f"{cell(one['noise'], '.1f')} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the spreads, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="file for the page")
    options = command.read(parser)
    found = figures()
    for name, (middle, low, high) in found["spread"].items():
        print(f"{name}: median {middle:.3g}, {low:.2g} to {high:.2g} of it")
    if options.markdown:
        save_text(options.markdown, page(found, command.source("tracker_costs.py --markdown FILE")))
    command.save(options, found)


if __name__ == "__main__":
    command.run(main)
