"""`startrack detect`: the stars of images."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, WrongUse, add_images, add_set, as_wrong_use, describe

if wanted(__name__):
    from startrack.cli.terminal import layout_of, print_failed_image, print_result, read_design
    from startrack.core import Frame, Psf, Spots
    from startrack.detection import (
        Detection,
        detect,
        divide_flat,
        false_alarms,
        plan_detection,
        subtract_dark,
    )
    from startrack.io import read_image
    from startrack.plots import draw_spots
    from startrack.trial import psf_of


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack detect`."""
    describe(
        parser,
        "Prints a row per spot, brightest first: position (the centre of the first pixel is 0, 0) "
        "and its sigma, flux, signal-to-noise ratio, area. The status is 1 if an image cannot be "
        "read; the others are searched.",
    )
    add_images(parser)
    parser.add_argument(
        "--design", type=Path, metavar="DESIGN.toml",
        help="design file that gives the settings of the detection and the PSF",
    )  # fmt: skip
    add_set(parser)
    parser.add_argument(
        "--threshold", type=float, metavar="SIGMA", help="detection threshold (default: 5.5)"
    )
    parser.add_argument(
        "--false", type=float, metavar="N",
        help="set the threshold by the mean number of false spots per image, such as 0.05",
    )  # fmt: skip
    parser.add_argument(
        "--sigma",
        type=float,
        metavar="PIXEL",
        help="sigma of the image of a star, pixel (default: 1)",
    )
    parser.add_argument(
        "--centroid",
        metavar="NAME",
        help="centroid method: gravity (default), weighted, gaussian or likelihood",
    )
    parser.add_argument("--dark", type=Path, metavar="IMAGE", help="dark frame to subtract")
    parser.add_argument("--flat", type=Path, metavar="IMAGE", help="flat field to divide by")
    parser.add_argument(
        "--overlay",
        type=Path,
        metavar="DIR",
        help="folder for pictures of the images with their spots",
    )


def command(options: argparse.Namespace) -> int:
    """Search each image; one that cannot be read does not stop the others."""
    with as_wrong_use(ValueError, TypeError, OSError):
        plan = plan_detection(*_settings(options))
        layout = layout_of(options)
        dark = read_image(options.dark, layout) if options.dark else None
        flat = read_image(options.flat, layout) if options.flat else None
    status = Exit.DONE
    for path in options.images:
        try:
            frame = read_image(path, layout)
            if dark is not None:
                frame = subtract_dark(frame, dark)
            if flat is not None:
                frame = divide_flat(frame, flat)
            spots = detect(frame, plan)
        except Exception as error:  # whatever is wrong with it, the others are searched
            print_failed_image(options, path, error)
            status = Exit.FAILED
            continue
        rows, columns = frame.image.shape
        chance = false_alarms(plan, columns, rows)
        result = {"image": str(path), "status": "done", **_values(spots, chance)}
        text = f"{path}: {len(spots)} spots; noise alone makes {chance:.1g} per frame"
        if options.overlay:
            result["overlay"] = str(_overlay(options.overlay, path, frame, spots))
        print_result(options, result, "\n".join([text, *_table(spots)]))
    return status


def _settings(options: argparse.Namespace) -> tuple[Detection, Psf | None]:
    settings, psf = Detection(), None
    if options.set and not options.design:
        raise WrongUse("--set must be given with --design")
    if options.design:
        case = read_design(options.design, options.set).case
        settings, psf = case.tracker.detection, psf_of(case.instrument)
    given = {
        "threshold": options.threshold,
        "false_per_frame": options.false,
        "kernel_sigma": options.sigma,
        "centroid": options.centroid,
    }
    return replace(settings, **{k: v for k, v in given.items() if v is not None}), psf


def _values(spots: Spots, chance: float) -> dict[str, Any]:
    variance = spots.covariance
    return {
        "expected_false": chance,
        "spots": [
            {
                "x": float(spots.x[i]),
                "y": float(spots.y[i]),
                "flux": float(spots.flux[i]),
                "snr": float(spots.snr[i]),
                "sigma_x": float(variance[i, 0, 0] ** 0.5),
                "sigma_y": float(variance[i, 1, 1] ** 0.5),
                "correlation": float(
                    variance[i, 0, 1] / (variance[i, 0, 0] * variance[i, 1, 1]) ** 0.5
                ),
                "area": int(spots.area[i]),
            }
            for i in range(len(spots))
        ],
    }


def _table(spots: Spots) -> list[str]:
    if not len(spots):
        return []
    lines = ["    #  x (pixel)  y (pixel)  sigma x  sigma y   flux (DN)     SNR  area"]
    for i in range(len(spots)):
        across, down = spots.covariance[i, 0, 0] ** 0.5, spots.covariance[i, 1, 1] ** 0.5
        lines.append(
            f"{i + 1:5} {spots.x[i]:10.3f} {spots.y[i]:10.3f} {across:8.3f} {down:8.3f} "
            f"{spots.flux[i]:11.1f} {spots.snr[i]:7.1f} {spots.area[i]:5}"
        )
    return lines


def _overlay(folder: Path, image: Path, frame: Frame, spots: Spots) -> Path:
    path = folder / f"{image.stem}.spots.png"
    draw_spots(path, frame, spots, f"{image.name}: {len(spots)} spots")
    return path
