"""`startrack detect`: the stars of images."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from startrack.cli.options import SET, Exit, Option, Options, WrongUse, as_wrong_use, images, wanted

if wanted(__name__):
    import numpy as np
    from numpy.typing import NDArray

    from startrack import detection, plots
    from startrack.cli.terminal import image_reader, print_failed_image, print_result, read_design
    from startrack.core import Psf, Refused, Spots
    from startrack.metrics import Column, Table
    from startrack.observation import psf_of

MANY = 0.01  # fraction of the pixels; saturated stars cover far less
LEAST_RANGE = 255  # digital number, largest number of 8 bits
NAMES = {
    "false_per_frame": "--false",
    "kernel_sigma": "--sigma",
}  # options of other names than keys

declare = Options(
    "Prints a row per spot, brightest first: position (the centre of the first pixel is 0, 0) and "
    "its sigma, flux, signal-to-noise ratio, area. The status is 1 if an image cannot be read; "
    "the others are searched.",
    *images(),
    Option(
        "--design DESIGN.toml",
        "design file that gives the settings of the detection and the PSF",
        Path,
    ),
    *SET,
    Option("--threshold SIGMA", "detection threshold (default: 5.5)", float),
    Option(
        "--false N",
        "mean number of false spots per image, such as 0.05, which sets the threshold",
        float,
    ),
    Option("--sigma PIXEL", "sigma of the image of a star, pixel (default: 1)", float),
    Option(
        "--centroid NAME", "centroid method: gravity (default), weighted, gaussian or likelihood"
    ),
    Option("--dark IMAGE", "dark frame to subtract", Path),
    Option("--flat IMAGE", "flat field to divide by", Path),
    Option("--overlay DIR", "folder for pictures of the images with their spots", Path),
)


def command(options: argparse.Namespace) -> int:
    """Search each image; an unreadable image does not stop the others."""
    with as_wrong_use(ValueError, TypeError, OSError):
        plan = detection.plan_detection(*_settings(options))
    read = image_reader(options)
    status = Exit.DONE
    for path in options.images:
        try:
            frame = read(path)
            spots = detection.detect(frame, plan)
        except Exception as error:  # the other images are searched in any case
            print_failed_image(options, path, error)
            status = Exit.FAILED
            continue
        rows, columns = frame.image.shape
        chance = detection.false_alarms(plan, columns, rows)
        result: dict[str, Any] = {"image": str(path), "status": "done", "expected_false": chance}
        result["spots"] = (table := _table(spots)).json()
        largest, part = at_largest(frame.image)
        result["at_the_largest_number"] = part
        counted = f"{len(spots)} spot" + "s" * (len(spots) != 1)
        text = f"{path}: {counted}; noise alone makes {chance:.1g} per frame"
        text += saturation_text(largest, part)
        if options.overlay:
            picture = options.overlay / f"{path.stem}.spots.png"
            plots.draw_spots(picture, frame, spots, f"{path.name}: {counted}")
            result["overlay"] = str(picture)
        print_result(options, result, text, *(table.text(()) if len(spots) else []))
    return status


def at_largest(image: NDArray[Any]) -> tuple[float, float]:
    """Largest number of an image, and the fraction of pixels with this number.

    Pixels without a number, NaN, do not count.
    """
    largest = np.fmax.reduce(image, axis=None)
    at, below = int(np.sum(image == largest)), int(np.sum(image < largest))
    return float(largest), at / max(at + below, 1)


def saturation_text(largest: float, part: float) -> str:
    """Warning where more pixels have the largest number of an image than saturated stars
    explain."""
    if part == 1:
        return f"; all pixels have the number {largest:g}: saturated or without light"
    if part > MANY and largest >= LEAST_RANGE:
        return f"; {part:.0%} of the pixels have the largest number, {largest:g}: saturated"
    return ""


def _settings(options: argparse.Namespace) -> tuple[detection.Detection, Psf | None]:
    settings, psf = detection.Detection(), None
    if options.set and not options.design:
        raise WrongUse("--set must be given with --design")
    if options.threshold is not None and options.false is not None:
        raise WrongUse("--threshold must come without --false, which sets the threshold")
    if options.design:
        case = read_design(options.design, options.set).case
        settings, psf = case.tracker.detection, psf_of(case.instrument)
    if options.threshold is not None:  # replaces a threshold that the design gives either way
        settings = replace(settings, false_per_frame=None)
    given = {
        "threshold": options.threshold,
        "false_per_frame": options.false,
        "kernel_sigma": options.sigma,
        "centroid": options.centroid,
    }
    try:
        return replace(settings, **{k: v for k, v in given.items() if v is not None}), psf
    except Refused as error:
        key = NAMES.get(error.key, f"--{error.key}")
        raise WrongUse(str(error).replace(error.key, key, 1) if error.key else str(error)) from None


def _table(spots: Spots) -> Table:
    """A record for each spot, by number."""
    xx, xy, yy = (spots.covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    columns = [
        Column("", "#", lambda n: n + 1, form="d"),
        Column("x", "x (pixel)", spots.x.item),
        Column("y", "y (pixel)", spots.y.item),
        Column("flux", "flux (DN)", spots.flux.item, form=".1f"),
        Column("snr", "SNR", spots.snr.item, form=".1f"),
        Column("sigma_x", "sigma x", lambda n: xx[n] ** 0.5),
        Column("sigma_y", "sigma y", lambda n: yy[n] ** 0.5),
        Column("correlation", "", lambda n: xy[n] / (xx[n] * yy[n]) ** 0.5),
        Column("area", "area", spots.area.item, form="d"),
    ]
    return Table(columns, range(len(spots)))
