"""`startrack solve`: the attitude of images."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from textwrap import fill
from typing import Any

from startrack.cli.exits import Exit, WrongUse
from startrack.cli.options import add_field_and_sky, add_images, describe
from startrack.cli.terminal import quaternion, read_stars, say, tell
from startrack.core import Camera, Estimate, Frame, Matches, Spots, Stars, positive, within
from startrack.design import Tracker
from startrack.detection import Detection, detect, subtract_dark
from startrack.identification import Identification, identify_blind
from startrack.io import celestial, read_image
from startrack.plots import draw_solution
from startrack.trial import index_of, lost_in_space, solve_matches

# Sigma of the detection: an image of few faint stars gets a second look. Chance has two tries
# then, each with its own bound.
THRESHOLDS = (5.0, 4.0)


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack solve`."""
    describe(
        parser,
        "Prints where each image looks, its roll and field, and the chance that the match is "
        "false. An image without an attitude makes the status 3, with the reason; one that cannot "
        "be read makes it 1.",
    )
    add_images(parser)
    parser.add_argument(
        "--fov", type=float, metavar="DEG",
        help="that the columns span; without it all from 3 to 40 deg are tried",
    )  # fmt: skip
    add_field_and_sky(parser)
    parser.add_argument(
        "--overlay", type=Path, metavar="DIR", help="draw each image with its stars into DIR"
    )


def command(options: argparse.Namespace) -> int:
    """Solve image after image; one that cannot be read does not keep the others waiting."""
    try:
        if options.fov is not None:
            positive(fov=options.fov)
            within(0, 179, fov=options.fov)
        identification = Identification(focal_tolerance=options.fov_tolerance)
        dark = read_image(options.dark) if options.dark else None
    except (ValueError, OSError) as error:
        raise WrongUse(str(error)) from None
    stars = read_stars(options.catalog, options.epoch)
    if options.fov is None:
        say("startrack solve: no --fov, so all from 3 to 40 deg are tried; slow the first time")
    statuses = set()
    for path in options.images:
        try:
            frame = read_image(path)
            if dark is not None:
                frame = subtract_dark(frame, dark)
        except ValueError as error:
            say(f"startrack solve: {error}")
            if options.json:
                tell(options, {"image": str(path), "status": "failed", "reason": str(error)}, "")
            statuses.add(Exit.FAILED)
            continue
        spots, matches, estimate = _solve(frame, options.fov, stars, identification)
        result = {"image": str(path), **_result(spots, matches, estimate)}
        text = f"{path}: {_text(spots, matches, estimate)}"
        if options.overlay:
            result["overlay"] = str(
                _overlay(options.overlay, path, frame, spots, matches, estimate, stars)
            )
        tell(options, result, text)
        statuses.add(Exit.DONE if estimate.icrs_to_camera is not None else Exit.UNSOLVED)
    return Exit.FAILED if Exit.FAILED in statuses else max(statuses)


def _solve(
    frame: Frame, fov_deg: float | None, stars: Stars, identification: Identification
) -> tuple[Spots, Matches, Estimate]:
    """The first look that solves it, or the last; with no field of view known if it is None."""
    rows, columns = frame.image.shape
    for threshold in THRESHOLDS:
        tracker = Tracker(Detection(threshold=threshold), identification)
        if fov_deg is None:
            spots = detect(frame, tracker.detection)
            matches = identify_blind(spots, columns, rows, stars, index_of, identification)
            estimate = solve_matches(spots, matches, tracker)
        else:
            camera = Camera.from_field_of_view(columns, rows, math.radians(fov_deg))
            spots, matches, estimate = lost_in_space(frame, camera, stars, tracker)
        if estimate.icrs_to_camera is not None:
            break
    return spots, matches, estimate


def _result(spots: Spots, matches: Matches, estimate: Estimate) -> dict[str, Any]:
    result: dict[str, Any] = {
        "status": "solved" if estimate.icrs_to_camera is not None else str(estimate.status),
        "reason": estimate.reason,
        "icrs_to_camera_xyzw": None,
        "ra_deg": None,
        "dec_deg": None,
        "roll_deg": None,
        "fov_x_deg": None,
        "spots": len(spots),
        "matches": estimate.stars,
        "residual_rms_px": None,
        "sigma_arcsec": None,
        "false_probability": estimate.false_probability,
    }
    if estimate.icrs_to_camera is not None:
        ra, dec, roll = celestial(estimate.icrs_to_camera)
        result |= {
            "icrs_to_camera_xyzw": quaternion(estimate.icrs_to_camera),
            "ra_deg": ra,
            "dec_deg": dec,
            "roll_deg": roll,
            "fov_x_deg": math.degrees(matches.camera.fov_x),
            "residual_rms_px": estimate.residual_rms,
            "sigma_arcsec": [3600 * math.degrees(v**0.5) for v in estimate.covariance.diagonal()],
        }
    return result


def _text(spots: Spots, matches: Matches, estimate: Estimate) -> str:
    if estimate.icrs_to_camera is None:
        return f"{estimate.status}: {estimate.reason}"
    ra, dec, roll = celestial(estimate.icrs_to_camera)
    return (
        f"RA {ra:.4f}, Dec {dec:+.4f}, roll {roll:.3f} deg; "
        f"field {math.degrees(matches.camera.fov_x):.3f} deg; {estimate.stars} of {len(spots)} "
        f"spots matched, residual {estimate.residual_rms:.2f} px; "
        f"chance of a false match {estimate.false_probability:.0e}"
    )


def _overlay(
    folder: Path,
    image: Path,
    frame: Frame,
    spots: Spots,
    matches: Matches,
    estimate: Estimate,
    stars: Stars,
) -> Path:
    path = folder / f"{image.stem}.solved.png"
    title = f"{image.name}\n{fill(_text(spots, matches, estimate), 105)}"
    draw_solution(path, frame, spots, matches, estimate.icrs_to_camera, stars, title)
    return path
