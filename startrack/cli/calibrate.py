"""`startrack calibrate`: the camera model of images of stars, or of a table of them."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from startrack.cli.imports import wanted
from startrack.cli.options import (
    KNOWN,
    Exit,
    WrongUse,
    add_field_and_sky,
    add_images,
    as_wrong_use,
    describe,
    whole,
)

if wanted(__name__):
    import numpy as np

    from startrack.calibration import (
        UNKNOWNS,
        Calibrated,
        Calibration,
        Prior,
        calibrate,
        is_star_table,
        sample_camera,
    )
    from startrack.cli.calibrate_table import calibrate_table
    from startrack.cli.terminal import (
        finite,
        layout_of,
        print_message,
        print_result,
        read_stars,
        save_camera,
    )
    from startrack.core import Camera, Frame, Matches, Spots, within
    from startrack.design import Tracker
    from startrack.detection import Detection, subtract_dark
    from startrack.identification import Identification, PatternIndexes
    from startrack.io import read_image, save_json
    from startrack.optimise import Ledger, chain_text, chain_values, thinned
    from startrack.plots import draw_corner
    from startrack.trial import lost_in_space

ROUNDS = 3  # a better camera model matches more stars


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack calibrate`."""
    describe(
        parser,
        "Solves images, fits one camera model to all of them, and prints focal length, principal "
        "point and distortion with their sigma. The status is 3 if an image has no attitude.\n\n"
        "A table of stars (CSV with a line of names, ECSV, FITS or VOTable) takes the place of the "
        "images: a row for each star, of one camera at one attitude. Its columns are found "
        "by their names, with the unit at the end of a name (_arcsec, _arcmin, _deg, _rad, _px, "
        "_c, _k) or in the table:\n\n"
        "  directions   y_angle and z_angle about a boresight +x, tan(y_angle) = y / x;\n"
        "               x_angle and y_angle about a boresight +z; ra and dec; or the unit\n"
        "               vector ux, uy, uz (also direction_x, ...)\n"
        "  pixels       column and row, or x and y\n"
        "  temperature  temperature or camera_temperature; may be missing\n"
        "  weights      weight (an inverse variance) or sigma; may be missing\n\n"
        "Pixels below -0.5 are taken to be counted from the middle of the array. The fit is "
        "robust: beyond 2 sigma of the typical residual a star counts less, beyond 6 not at all. "
        "Cross-validation (the residual of each star to a fit without its tenth of the table) says "
        "which order the stars bear: the one of fewest unknowns within a standard error of the "
        "best, which is the result.\n\n"
        "  startrack calibrate stars.csv --camera camera.toml\n"
        "  startrack calibrate stars.fits --directions yag:arcsec,zag:arcsec --pixels col,row",
    )
    add_images(parser, " of one camera; or one table of stars")
    parser.add_argument(
        "--fov",
        type=float,
        metavar="DEG",
        help="approximate field of view across the columns, degree; needed by images",
    )
    add_field_and_sky(parser)
    parser.add_argument(
        "--principal", type=float, default=20.0, metavar="PX",
        help="images: prior sigma of the principal point, pixel; 0 fixes it at the centre "
        "(default: 20)",
    )  # fmt: skip
    parser.add_argument(
        "--distortion", choices=("none", "radial", "full", "1", "2", "3", "auto"),
        help="distortion to fit: none, k1 (radial; default of images) or k1, k2, p1, p2 (full); of "
        "a table also a polynomial over the field of order 1, 2 or 3, or auto: the best of all "
        "(default)",
    )  # fmt: skip
    table = parser.add_argument_group("tables of stars")
    table.add_argument(
        "--temperature-terms", choices=("auto", "none", "linear"), default="auto",
        help="whether boresight and scale move with temperature (default: auto, both are tried)",
    )  # fmt: skip
    table.add_argument(
        "--directions", metavar="NAMES", help="columns of directions, such as yag:arcsec,zag:arcsec"
    )
    table.add_argument(
        "--directions-are", choices=("vectors", "radec", "yz", "xy"),
        help="what these columns are (default: by their names)",
    )  # fmt: skip
    table.add_argument("--pixels", metavar="NAMES", help="columns of pixels, such as col,row")
    table.add_argument(
        "--temperature", metavar="NAME", help="column of temperature, such as t:K; '' for none"
    )
    table.add_argument("--weight", metavar="NAME", help="column of weights; '' for none")
    table.add_argument(
        "--size", metavar="COLUMNS,ROWS", help="pixels of the array (default: as the table needs)"
    )
    table.add_argument(
        "--first-pixel", metavar="X,Y",
        help="place of the first pixel's centre as the table counts (default: 0,0)",
    )  # fmt: skip
    table.add_argument(
        "--folds", type=whole(2), default=10, metavar="N",
        help="parts of the table in the cross-validation (default: 10)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON file for the result")
    parser.add_argument(
        "--camera", type=Path, metavar="FILE",
        help="TOML file for the camera: `solve --camera` reads it, and its table [tracker.camera] "
        "is what a tracker of a design believes",
    )  # fmt: skip
    parser.add_argument(
        "--posterior", type=Path, metavar="DIR",
        help="folder for posterior.json and corner.png: sample the posterior of focal length, "
        "principal point, k1 and PSF width",
    )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Solve the images, fit one camera model to all, and repeat with that model."""
    with as_wrong_use(ValueError, OSError):
        tables = any(is_star_table(path) for path in options.images)
    if tables:
        return calibrate_table(options)
    if options.fov is None:
        raise WrongUse("--fov must be given with images, the field of view in degrees")
    if options.distortion not in (None, "none", "radial", "full"):
        raise WrongUse(
            f"--distortion of images must be none, radial or full, got {options.distortion}"
        )
    with as_wrong_use(ValueError, OSError):
        within(0.01, 179, fov=options.fov)
        identification = Identification(focal_tolerance=options.fov_tolerance)
        settings = Calibration(
            focal_length=options.fov_tolerance,
            principal=options.principal,
            k2=1.0 if options.distortion == "full" else 0.0,
            k1=0.0 if options.distortion == "none" else 1.0,
            tangential=0.01 if options.distortion == "full" else 0.0,
        )
        layout = layout_of(options)
        dark = read_image(options.dark, layout) if options.dark else None
        frames = [read_image(path, layout) for path in options.images]
        if dark is not None:
            frames = [subtract_dark(frame, dark) for frame in frames]
    indexes = PatternIndexes(read_stars(options.catalog, options.epoch))
    shapes = {frame.image.shape for frame in frames}
    if len(shapes) > 1:
        raise WrongUse(f"images must be of one camera, got sizes {sorted(shapes)}")
    rows, columns = shapes.pop()
    camera = Camera.from_field_of_view(columns, rows, math.radians(options.fov))
    found, answers = None, list[tuple[Spots, Matches]]()
    for _ in range(ROUNDS):
        answers = _solved(frames, camera, indexes, identification)
        if any(len(matches) for _, matches in answers):
            spots, matches = [one for one, _ in answers], [one for _, one in answers]
            found = calibrate(spots, matches, camera, settings)
        if found is None:
            print_message("startrack calibrate: none of the images could be solved")
            print_result(options, {"status": "unsolved", "images": len(frames)}, "unsolved")
            return Exit.UNSOLVED
        camera = found.camera
        identification = replace(identification, focal_tolerance=KNOWN)
    assert found is not None
    result = _values(found, len(frames))
    text = _text(found, len(frames))
    if options.posterior:
        result["posterior"], more = _posterior(options, answers, frames, found.camera)
        text += f"\n{more}"
    if options.out:
        save_json(options.out, finite(result))
    if options.camera:
        save_camera(options.camera, found.camera)
    print_result(options, result, text)
    if options.posterior and not result["posterior"]["converged"]:
        return Exit.UNSOLVED
    return Exit.DONE if found.frames == len(frames) else Exit.UNSOLVED


def _solved(
    frames: list[Frame], camera: Camera, indexes: PatternIndexes, identification: Identification
) -> list[tuple[Spots, Matches]]:
    tracker = Tracker(Detection(), identification)
    return [lost_in_space(frame, camera, indexes, tracker)[:2] for frame in frames]


def _posterior(
    options: argparse.Namespace,
    answers: list[tuple[Spots, Matches]],
    frames: list[Frame],
    camera: Camera,
) -> tuple[dict[str, Any], str]:
    """Sample the camera; write posterior.json and corner.png unless chains did not converge."""
    prior = Prior(options.fov_tolerance, options.principal, 1.0, 1e-3, 3.0)
    print_message("startrack calibrate: sampling, some tens of seconds per image")
    with Ledger(options.posterior / "ledger.sqlite") as ledger:
        spots, matches = [one for one, _ in answers], [one for _, one in answers]
        found = sample_camera(spots, matches, camera, prior, 0, ledger=ledger, images=frames)
    values = chain_values(found.chains)
    if not found.chains.converged:
        return values, f"posterior: {chain_text(found.chains)}"
    values |= {
        "median_and_95": {name: found.interval(name) for name in found.names},
        "open": list(found.unconstrained),
        "correlation": found.correlation.tolist(),
    }
    save_json(options.posterior / "posterior.json", finite(values))
    labels = [name if name == "k1" else f"{name.removesuffix('_px')} (px)" for name in found.names]
    draw_corner(
        options.posterior / "corner.png",
        thinned(found.samples, 2000),
        labels,
        f"camera of {len(frames)} images: {chain_text(found.chains)}",
    )
    lines = ["", "posterior: median and 95 % interval"]
    for name in found.names:
        middle, low, high = found.interval(name)
        note = ", hardly constrained by these images" if name in found.unconstrained else ""
        lines.append(f"{name:16} {middle:12.6g} [{low:.6g}, {high:.6g}]{note}")
    return values, "\n".join([*lines, chain_text(found.chains)])


def _values(found: Calibrated, images: int) -> dict[str, Any]:
    sigma = np.sqrt(found.covariance.diagonal())
    return {
        "status": "calibrated",
        "images": images,
        "solved": found.frames,
        "stars": found.stars,
        "residual_rms_px": found.residual_rms,
        "fov_x_deg": math.degrees(found.camera.fov_x),
        "camera": {
            "columns": found.camera.columns,
            "rows": found.camera.rows,
            **{name: getattr(found.camera, name) for name in UNKNOWNS},
        },
        "sigma": dict(zip(UNKNOWNS, sigma.tolist(), strict=True)),
        "covariance": found.covariance.tolist(),
    }


def _text(found: Calibrated, images: int) -> str:
    sigma = np.sqrt(found.covariance.diagonal())
    lines = [
        f"{found.frames} of {images} images, {found.stars} stars, residual "
        f"{found.residual_rms:.3f} px; field {math.degrees(found.camera.fov_x):.4f} deg"
    ]
    for name, error in zip(UNKNOWNS, sigma, strict=True):
        value = getattr(found.camera, name)
        lines.append(f"{name:16} {value:12.5g} " + (f"+- {error:.2g}" if error else "not fitted"))
    return "\n".join(lines)
