"""`startrack compare-flight`: a design compared with flight images of its tracker."""

from __future__ import annotations

import argparse
import math
from itertools import chain
from pathlib import Path

from startrack.cli import options as shared
from startrack.cli.options import SEED, SET, Exit, Option, Options, images, out, wanted, whole

if wanted(__name__):
    from startrack import plots, verification
    from startrack.cli import terminal
    from startrack.cli.files import design_file
    from startrack.core import Refused
    from startrack.design import FRAME_FIGURES, Case, Told
    from startrack.io import finite, save_arrays, save_json, to_table
    from startrack.metrics import Column, Table
    from startrack.prediction import drawn_cases, save_told

TABLES = (".npz", ".fits", ".fit", ".fts")  # endings of one file with images of stars


declare = Options(
    "Measures images of stars over time, and predicted images of the same stars on the same "
    "paths, by the same code. Prints both with 95 % intervals; an interval of the prediction "
    "holds for a further detector. Quantities: background, light, gain and read noise by photon "
    "transfer, the image by the phase of the pixel, the scatter of centroids from exposure to "
    "exposure and in all, steps of the image, and the centroid over the pixel. A difference is "
    "marked, with the keys of the design that it points to; the design is not changed. Writes "
    "flight.json and flight.png. For images of 8 x 8 pixels, as from whole frames, it also "
    "writes told.toml: the design with the measured figures as [[told]]; startrack predict "
    "derives its unknown values from them.\n\nThe images are whole frames: files in the order of "
    "time, or a SER, raw or video file. The tracker's search finds the brightest stars and its "
    "box follows them. Times are from SER or from DATE-OBS (MJD-OBS, JD) in FITS; without them, "
    "frames follow at the update rate of the detector. Or the images are a file of numpy arrays "
    "(npz) or FITS tables, with the time (second), the numbers of each image less the offset, "
    "and col0, row0, the place of its first pixel; background, magnitude, magnitude_g and "
    "acquired may be missing. The predicted images have the measured light. Brightness tests "
    "transmission and quantum efficiency only for stars with magnitude_g, Gaia's G; whole frames "
    "have it for stars that the tracker matches in the first frame. In an npz each name begins "
    "with the name of its star and '_': s4_time, s4_number, s4_col0, s4_row0, s4_background.\n\n "
    "startrack compare-flight trackers/chandra-aca.toml flight.npz --stars s4,s5",
    Option("design DESIGN.toml", "design file", Path),
    *images("; or one npz or FITS file of the images of several stars over time"),
    Option(
        "--dark-frame IMAGE",
        "with frames: dark frame of the detector, best a mean of many; a tracker with "
        "tracker.detection.dark_map makes its map from it; the predicted images have dark frames "
        "of the drawn detectors",
        Path,
    ),
    Option(
        "--stars NAMES", "stars of the file, such as s4,s5 (default: all with 32 images or more)"
    ),
    Option(
        "--devices N",
        "number of drawn detectors, each with different values of the design's unknowns",
        whole(2, 1000),
        8,
    ),
    Option("--keep", "write the predicted images of the first detector to predicted.npz"),
    *SET,
    SEED,
    out("startrack-compare-flight"),
)


def command(options: argparse.Namespace) -> int:
    """Print predicted and measured figures; write flight.json and flight.png."""
    path = design_file(options.design)
    design = terminal.read_design(path, options.set, "each drawn detector has different values")
    case, count = design.case, options.devices
    with shared.as_wrong_use(ValueError, OSError):
        stars = _stars(options, case)
        unknown = drawn_cases(path, options.seed, count, options.set) if design.unknowns else []
        with terminal.progress("stars", len(stars)) as advance:
            flown = verification.compare_flown(case, stars, count, options.seed, advance, unknown)
        if flown.left:
            terminal.print_message(
                f"startrack: {', '.join(flown.left)} left out: no steady light, measured or "
                "predicted"
            )
        told = _told(case, stars, options.images[0].name)
        if options.keep:
            made = verification.simulate(case, stars, 1, options.seed, unknown=unknown[:1])[0]
            save_arrays(options.out / "predicted.npz", {star.name: star.columns for star in made})
    if told:
        save_told(options.out / "told.toml", path, told)
    table, first = _table(flown), options.images[0]
    result = {
        "design": str(options.design),
        "images": str(first),
        "frames": len(options.images),
        "seed": options.seed,
        "devices": options.devices,
        "differences": table.json(),
        "untested": _untested(flown),
        "told": [to_table(one) for one in told],
        "curve_correlation": {
            star: verification.correlation(*pair) for star, pair in flown.curves.items()
        },
        "curves_px": {
            star: [curve.tolist() for curve in pair] for star, pair in flown.curves.items()
        },
    }
    save_json(options.out / "flight.json", finite(result))
    title = f"{options.design.stem}, {first.name}: predicted over measured"
    plots.draw_flown(options.out / "flight.png", flown, title)
    lines = [*_text(flown, table), *_told_text(told, options)]
    terminal.print_result(options, result | {"out": str(options.out)}, *lines)
    return Exit.DONE


def _stars(options: argparse.Namespace, case: Case) -> list[verification.Windows]:
    """The images of the stars: read from one file, or cut out of frames."""
    names, first = options.stars.split(",") if options.stars else (), options.images[0]
    if len(options.images) == 1 and first.suffix.lower() in TABLES:
        if options.dark_frame:
            raise shared.WrongUse("--dark-frame must be given with whole frames alone")
        return verification.read_windows(first, names)
    count, frames = terminal.read_series(options)
    dark = terminal.image_reader(options)(options.dark_frame) if options.dark_frame else None
    first_frame = next(frames)
    with terminal.progress("frames", count) as advance:
        series = chain([first_frame], frames)
        stars = verification.windows_of_frames(series, case, advance, dark)
    stars = verification.with_magnitudes(stars, first_frame, case)
    return [star for star in stars if not names or star.name in names]


def _told(case: Case, stars: list[verification.Windows], source: str) -> list[Told]:
    """Told figures from the images; none if the images are too small."""
    try:
        return verification.told_by_frames(case, stars, source)
    except Refused as error:
        terminal.print_message(f"startrack: no told figures: {error}")
        return []


def _told_text(told: list[Told], options: argparse.Namespace) -> list[str]:
    if not told:
        return []
    lines = [
        f"  {one.name}: {one.number:.4g} {FRAME_FIGURES[one.figure]}, 68 % within {one.factor:.3f}"
        for one in told
    ]
    without = ", without the changes of --set" if options.set else ""
    return [
        "",
        f"told figures, in {options.out / 'told.toml'} over the design{without}; startrack "
        "predict derives its unknown values from them:",
        *lines,
    ]


def _table(flown: verification.FlightComparison) -> Table:
    return Table(
        [
            Column("star", "star", lambda row: row.star),
            Column("figure", "figure", lambda row: row.name),
            Column("seen", "seen", lambda row: row.seen, form=".4g"),
            Column("predicted", "predicted", lambda row: row.predicted, form=".4g"),
            Column("ratio", "predicted / seen", lambda row: row.ratio, form=".3f"),
            Column("differs", "", lambda row: row.differs),
            Column(
                "keys", "differs: keys of the design", lambda row: row.key if row.differs else ""
            ),
        ],
        flown.differences,
    )


def _untested(flown: verification.FlightComparison) -> list[str]:
    """Quantities that the comparison does not test, with the reason."""
    rows = [row for row in flown.differences if row.untested]
    return list(dict.fromkeys(f"{row.name} is not tested: {row.untested}" for row in rows))


def _text(flown: verification.FlightComparison, table: Table) -> list[str]:
    lines = table.text((0, 1, 6))
    for star, pair in flown.curves.items():
        value = verification.correlation(*pair)
        if math.isfinite(value):
            lines.append(f"{star}: centroid over the pixel, correlation {value:.2f}")
    return [
        *lines,
        *_untested(flown),
        "",
        "pixel; digital numbers (read_noise, brightness, background); electron per number (gain); "
        "image: worst pixel of the peak; acquired: share of exposures; brackets: 95 %",
    ]
