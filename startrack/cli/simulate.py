"""`startrack simulate`: render one frame of a design."""

from __future__ import annotations

import argparse
import math
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from startrack.cli import options as shared
from startrack.cli.options import DESIGN, Exit, Option, Options, decimal, out, wanted, whole

if wanted(__name__):
    from startrack import plots
    from startrack.cli import detect, terminal
    from startrack.core import Streams, arcsec
    from startrack.io import FrameFiles, pointing, write_fits
    from startrack.observation import out_of_step, random_attitude
    from startrack.scene import date_of
    from startrack.trial import observe, searched

if TYPE_CHECKING:
    from startrack.design import Case
    from startrack.trial import Record


declare = Options(
    "Writes frame.fits, with WCS and a table of true stars; frame.png, with spots and true "
    "stars; and raw.png, if the tracker has a dark map. Without --ra, --dec and --roll it uses "
    "the random attitude of this seed and trial; if one of them is given, the others are 0.",
    *DESIGN,
    Option("--ra DEG", "right ascension of the boresight, ICRS, degree", decimal()),
    Option("--dec DEG", "declination of the boresight, ICRS, degree", decimal(-90, 90)),
    Option(
        "--roll DEG", "angle of celestial north, counter-clockwise from image up, degree", decimal()
    ),
    shared.SEED,
    Option("--trial N", "number of the trial within the seed", whole(0, shared.LARGEST_SEED), 0),
    Option(
        "--pixels",
        "also write the image as pixels.png of 16 bits, pixels.ser or pixels-*.raw, with time "
        "and true attitude in pixels.csv",
        ("png", "ser", "raw"),
    ),
    out("startrack-simulate"),
)


def command(options: argparse.Namespace) -> int:
    """Write frame.fits and frame.png; for a matrix with its WCS and a table of its true stars."""
    case = terminal.read_design(options.design or terminal.example(), options.set).case
    streams = Streams(options.seed, options.trial)
    angles = (options.ra, options.dec, options.roll)
    given = any(angle is not None for angle in angles)
    attitude = pointing(*(angle or 0.0 for angle in angles)) if given else random_attitude(streams)
    with terminal.stage("rendering"):
        record = observe(case, attitude, streams)
    camera = case.instrument.camera
    fits, png = options.out / "frame.fits", options.out / "frame.png"
    history = f"startrack simulate, seed {options.seed}, trial {options.trial}"
    matrix = None if case.instrument.detector.scan else camera
    middle = date_of(case.scene, case.catalog.year, streams)
    begun = middle - timedelta(seconds=record.frame.exposure / 2)
    write_fits(fits, record.frame, matrix, attitude, record.stars, history, begun)
    pixels: list[Path] = []
    if options.pixels:
        with shared.as_wrong_use():
            files = FrameFiles(options.out, "pixels", options.pixels, middle)
            files.add(record.frame, 0.0, attitude)
            pixels = files.close()
    title = (
        f"{terminal.pointing_text(attitude, 3, 1)}; field {math.degrees(camera.fov_x):.2f} "
        f"deg; exposure {1e3 * record.frame.exposure:g} ms"
    )
    summary = (
        f"the tracker finds {record.outcome.spots} spots, matches {record.outcome.stars}: "
        f"{record.estimate.status}"
    )
    errors = {axis: getattr(record.outcome, f"error_{axis}") / arcsec for axis in "xyz"}
    if record.outcome.solved:
        shown = ", ".join(f"{error:.3g}" for error in errors.values())
        summary += f"; error {shown} arcsec about x, y, z"
    largest, part = detect.at_largest(record.frame.image)
    summary += detect.saturation_text(largest, part)
    raw = draw_record(png, case, record, f"{title}\n{summary}")
    result = {
        "fits": str(fits),
        "png": str(png),
        "raw_png": str(raw) if raw else None,
        "pixels": [str(file) for file in pixels],
        **terminal.attitude_values(attitude),
        "fov_x_deg": math.degrees(camera.fov_x),
        "spots": record.outcome.spots,
        "matches": record.outcome.stars,
        "at_the_largest_number": part,
        "status": str(record.estimate.status),
        **{f"error_{axis}_arcsec": error for axis, error in errors.items()},
    }
    step = out_of_step(case.instrument)
    written = ", ".join(str(file) for file in (fits, *pixels, raw) if file)
    terminal.print_result(
        options, result, summary, title, *filter(None, [step]), f"wrote {written} and {png}"
    )
    return Exit.DONE


def draw_record(path: Path, case: Case, record: Record, title: str) -> Path | None:
    """Draw a frame as searched by the tracker, with spots and true stars; also raw.png.

    Returns  the picture of raw pixels; None without a dark map, when both pictures are equal
    """
    saturation = case.tracker.detection.saturation
    if case.instrument.detector.scan:
        plots.draw_frame(path, record.frame, title, saturation=saturation)
        return None
    seen, raw = searched(case, record.frame), None
    sky = case.instrument.camera, record.icrs_to_camera, record.stars
    if seen is not record.frame:
        raw = path.with_name("raw.png" if path.stem == "frame" else f"{path.stem}-raw.png")
        plots.draw_frame(raw, record.frame, title, *sky, saturation)
        title += "; dark map subtracted"
    plots.draw_solution(path, seen, record.spots, record.matches, *sky[1:], title, saturation)
    return raw
