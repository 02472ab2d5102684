"""Size of a guide catalogue: stars, triangles, bytes, and skies that the C reader identifies.

    python experiments/onboard.py --json onboard.json --markdown docs/onboard.md

For fields of 10, 15 and 20 degrees and three limits of magnitude, writes the guide catalogue of the
nanosatellite's camera with another lens, and lets the C reader identify the stars in the camera at
random attitudes: all stars of the sky to the limit, not the guide stars alone, with noise of
position and of brightness and with false spots. On other random skies the reader must find the same
stars and triangles as Python, which compares all of them one by one.
"""

from __future__ import annotations

import argparse
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np
from scipy.spatial.transform import Rotation

from startrack import arcsec, deg, load_design, shipped
from startrack.catalog import open_sky
from startrack.core import Floats, Ints
from startrack.design import Case
from startrack.identification import merged
from startrack.metrics import fraction_interval
from startrack.observation import colour_correction
from startrack.onboard import (
    CompiledGuide,
    Guide,
    GuideSettings,
    c_compiler,
    guide_stars,
    read_variables,
)

FIELDS = (10, 15, 20)  # degree
LIMITS = (5.5, 6.0, 6.5)  # magnitude
NOISE = 0.1  # pixel per axis, of a centroid
BLUR = 0.2  # magnitude, of a star's measured brightness: which stars pass the limit
FALSE = 2  # spots in each image, of random brightness
CHANCE = 1e-5  # accepted bound of the probability of a false match
AIM: tuple[float, float] = (15, 6.0)  # field and limit of `onboard_kb`


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--skies", type=int, default=1000, metavar="N")
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="file for the page with the table"
    )
    options = command.read(parser, skies=10)
    fields, limits = (FIELDS, LIMITS) if not options.quick else (AIM[:1], AIM[1:])
    rows = [figures(field, limit, options.skies) for field in fields for limit in limits]
    aim = next(row for row in rows if (row["field_deg"], row["limit_mag"]) == AIM)
    found: dict[str, Any] = {"rows": rows, "skies": options.skies, "onboard_kb": aim["kb"]}
    found["onboard_same"] = aim["same"]
    text = table(found)
    print(text)
    if options.markdown:
        write(options.markdown, text)
    command.save(options, found)


def figures(field: float, limit: float, skies: int) -> dict[str, Any]:
    """Figures of a row of the table."""
    case = with_field(load_design(shipped("designs/noise_only.toml")).case, field * deg)
    guide = guide_stars(case, GuideSettings(limit=limit), read_variables())
    data = bytes(guide)
    row: dict[str, Any] = {
        "field_deg": field,
        "limit_mag": limit,
        "stars": len(guide),
        "triangles": len(guide.triangle),
        "kb": len(data) / 1000,
        "solved": None,
        "wrong": None,
        "same": None,
    }
    if c_compiler() is None:
        print("no C compiler: identification and comparison left out", flush=True)
        return row
    reader = CompiledGuide(data)
    row |= identified(case, guide, reader, skies)
    if (field, limit) == AIM:
        row["same"] = same(guide, reader, skies)
    print(row, flush=True)
    return row


def with_field(case: Case, field: float) -> Case:
    """The case with the focal length for which the smaller side of the image has the given
    field."""
    detector = case.instrument.detector
    side = min(detector.columns, detector.rows) * detector.pitch
    optics = replace(case.instrument.optics, focal_length=side / 2 / math.tan(field / 2))
    return replace(case, instrument=replace(case.instrument, optics=optics))


def identified(case: Case, guide: Guide, reader: CompiledGuide, skies: int) -> dict[str, Any]:
    """Fractions of random skies that are solved, and that are solved with a wrong star."""
    camera = case.believed_camera
    believed = replace(case.believed_catalog, limit_g=8.0, epoch=guide.epoch, aberration=False)
    stars, _ = merged(open_sky(believed).stars, guide.resolution)
    magnitude = stars.magnitude_g + colour_correction(case, stars.colour)
    generator = np.random.default_rng(11)
    sigma = NOISE / camera.focal_length_px
    solved = wrong = 0
    for attitude in Rotation.random(skies, random_state=generator):
        pixel = camera.project(attitude.apply(stars.direction))
        measured = magnitude + generator.normal(0, BLUR, len(stars))
        names = np.flatnonzero(camera.holds(pixel) & (measured <= guide.limit))
        names = names[np.argsort(measured[names])]
        spots = pixel[names] + generator.normal(0, NOISE, (len(names), 2))
        at = generator.integers(0, len(names) + 1, FALSE)
        shape = camera.columns - 1, camera.rows - 1
        spots = np.insert(spots, at, generator.uniform((0, 0), shape, (FALSE, 2)), axis=0)
        names = np.insert(names, at, -1)
        found, _ = reader.identify(camera.unproject(spots), sigma, CHANCE)
        matched = found >= 0
        solved += bool(matched.any())
        wrong += bool((_apart(guide, found, stars.direction, names)[matched] > 5 * arcsec).any())
    return {"solved": solved / skies, "wrong": wrong / skies}


def _apart(guide: Guide, found: Ints, direction: Floats, names: Ints) -> Floats:
    """Angle between the guide star and the true star of each spot, radian; infinite for a false
    spot."""
    apart = np.linalg.norm(guide.direction[found] - direction[names], axis=1)
    return np.where(names >= 0, apart, np.inf)


def same(guide: Guide, reader: CompiledGuide, skies: int) -> float:
    """Fraction of skies with the same nearest star, cone and triangles by C and Python."""
    generator = np.random.default_rng(12)
    agree = 0
    for attitude in Rotation.random(skies, random_state=generator):
        axis = attitude.as_matrix()[2]
        inside = guide.cone(axis, guide.field_of_view / 2)
        good = guide.nearest(axis) == reader.nearest(axis)
        good &= inside.tolist() == reader.cone(axis, guide.field_of_view / 2).tolist()
        if len(inside) >= 3:
            three = guide.direction[generator.choice(inside, 3, replace=False)]
            seen = attitude.apply(three + generator.normal(0, 5 * arcsec, (3, 3)))
            seen /= np.linalg.norm(seen, axis=1, keepdims=True)
            good &= guide.patterns(seen, 0.005) == reader.patterns(seen, 0.005)
        agree += bool(good)
    return agree / skies


def table(found: dict[str, Any]) -> str:
    """The rows as a Markdown table."""
    lines = [
        "| field, deg | limit, mag | stars | triangles | kB | identified | with a wrong star |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in found["rows"]:
        shares = []
        for name in ("solved", "wrong"):
            if row[name] is None:
                shares.append("no C compiler")
                continue
            one = fraction_interval(round(row[name] * found["skies"]), found["skies"])
            shares.append(f"{100 * one.value:.1f} % [{100 * one.low:.1f}, {100 * one.high:.1f}]")
        lines.append(
            f"| {row['field_deg']} | {row['limit_mag']} | {row['stars']} | {row['triangles']} | "
            f"{row['kb']:.0f} | {' | '.join(shares)} |"
        )
    return "\n".join(lines)


def write(page: Path, text: str) -> None:
    """Replace the table of the page, or write the table alone."""
    old = page.read_text(encoding="utf-8") if page.is_file() else ""
    place = re.compile(r"^\| field, deg \|.*?(?=\n\n|\Z)", re.DOTALL | re.MULTILINE)
    new = place.sub(lambda _: text, old) if place.search(old) else f"{old}\n{text}\n"
    page.write_text(new.rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    command.run(main)
