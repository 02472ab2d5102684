"""`startrack solve`: the attitude of images."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from startrack.cli.options import (
    FIELD_AND_SKY,
    KNOWN,
    Exit,
    Option,
    Options,
    as_wrong_use,
    images,
    wanted,
)

if wanted(__name__):
    from startrack.cli import terminal
    from startrack.core import Camera, Estimate, Frame, Matches, Spots, Stars, positive, within
    from startrack.design import Tracker
    from startrack.detection import Detection, detect
    from startrack.identification import Identification, PatternIndexes, fit_lens, identify_blind
    from startrack.io import celestial, tetra3_values, to_table, write_solution
    from startrack.plots import draw_solution
    from startrack.trial import lost_in_space, solve_matches

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

# Sigma of the detection: an image of few faint stars is searched twice. The bound of the false
# match probability holds for each search.
THRESHOLDS = (5.0, 4.0)


declare = Options(
    "Prints the boresight of each image, its roll, its field of view and the probability of a "
    "false match. Without --camera the lens is unknown: its distortion is estimated where the "
    "stars show it, and the boresight is the direction of the centre of the image. The status is "
    "3 if an image has no attitude, with the reason, and 1 if one cannot be read.",
    *images(),
    Option("--fov DEG", "field of view across the columns, degree (default: search from 2 to 90)",
           float),
    *FIELD_AND_SKY,
    Option("--camera FILE", "calibrated camera, from `calibrate --camera`, or a design with "
           "[tracker.camera]", Path),
    Option("--tables DIR", "folder for FITS files as astrometry.net writes them: spots (.axy), "
           "matches (.corr) and WCS (.wcs) of each image", Path),
    Option("--keys", "names of the values of --json: its own (default), or those of tetra3, "
           "described in docs/json.md", ("startrack", "tetra3"), "startrack"),
    Option("--overlay DIR", "folder for pictures of the images with their stars", Path),
)  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Solve each image; one that cannot be read does not stop the others."""
    with as_wrong_use(ValueError, OSError):
        if options.fov is not None:
            positive(fov=options.fov)
            within(0, 179, fov=options.fov)
        calibrated = terminal.read_camera(options.camera) if options.camera else None
        if calibrated and options.fov is not None:
            raise ValueError("--fov and --camera must not both be given: the camera has its field")
        tolerance = options.fov_tolerance
        identification = Identification(
            focal_tolerance=min(tolerance, KNOWN) if calibrated else tolerance
        )
    read = terminal.image_reader(options)
    stars = terminal.read_stars(options.catalog, options.epoch)
    indexes = PatternIndexes(stars)
    if options.fov is None and calibrated is None:
        terminal.print_message(
            "startrack solve: no --fov, searching from 2 to 90 deg; slow the first time"
        )
    statuses = set()
    for path in options.images:
        try:
            frame = read(path)
            solved = _solve(frame, calibrated, options.fov, indexes, identification)
        except Exception as error:  # whatever is wrong with it, the others are solved
            terminal.print_failed_image(options, path, error)
            statuses.add(Exit.FAILED)
            continue
        tetra3 = options.keys == "tetra3"
        values = tetra3_values(*solved, stars) if tetra3 else _values(solved)
        result = {"image": str(path), **values}
        text = f"{path}: {_text(solved)}"
        if options.overlay:
            result["overlay"] = str(_overlay(options.overlay, path, frame, solved, stars))
        if options.tables:
            name = options.tables / path.stem
            files = write_solution(name, solved.spots, frame.image.shape, solved.matches, stars)
            result["tables"] = [str(file) for file in files]
        terminal.print_result(options, result, text)
        statuses.add(Exit.DONE if solved.axis is not None else Exit.UNSOLVED)
    return Exit.FAILED if Exit.FAILED in statuses else max(statuses)


class Solved(NamedTuple):
    """An image and what was found.

    axis  the attitude whose axis is printed: of the camera where that is known, else through the
          centre of the image; None where there is none
    """

    spots: Spots
    matches: Matches
    estimate: Estimate
    axis: Rotation | None


def _solve(
    frame: Frame,
    calibrated: Camera | None,
    fov_deg: float | None,
    indexes: PatternIndexes,
    identification: Identification,
) -> Solved:
    """The first search that finds an attitude, or the last.

    calibrated, fov_deg  camera, or its field; None: unknown
    """
    rows, columns = frame.image.shape
    if calibrated and (calibrated.rows, calibrated.columns) != (rows, columns):
        raise ValueError(
            f"image must have the {calibrated.columns} x {calibrated.rows} pixels of the camera, "
            f"got {columns} x {rows}"
        )
    for threshold in THRESHOLDS:
        tracker = Tracker(Detection(threshold=threshold), identification)
        if calibrated is None and fov_deg is None:
            spots = detect(frame, tracker.detection)
            matches = identify_blind(spots, columns, rows, indexes.stars, indexes, identification)
            estimate = solve_matches(spots, matches, tracker)
        else:
            camera = calibrated or Camera.from_field_of_view(
                columns, rows, math.radians(fov_deg or 0.0)
            )
            spots, matches, estimate = lost_in_space(frame, camera, indexes, tracker)
        if estimate.icrs_to_camera is not None:
            break
    solved = Solved(spots, matches, estimate, estimate.icrs_to_camera)
    return (
        solved if calibrated or solved.axis is None else _with_lens(solved, indexes, identification)
    )


def _with_lens(solved: Solved, indexes: PatternIndexes, settings: Identification) -> Solved:
    """The same with the distortion of the lens, where the stars show one."""
    spots, matches, estimate, _ = solved
    lens = fit_lens(spots, matches, indexes.stars, indexes(matches.camera), settings)
    if not lens.matches.camera.distorted:
        return solved
    better = replace(
        estimate,
        icrs_to_camera=lens.matches.icrs_to_camera,
        covariance=lens.covariance,
        residual_rms=lens.residual_rms,
        stars=len(lens.matches),
    )
    return Solved(spots, lens.matches, better, lens.icrs_to_image)


def _values(solved: Solved) -> dict[str, Any]:
    spots, matches, estimate, axis = solved
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
        "lens": None,
        "residual_rms_px": None,
        "sigma_arcsec": None,
        "false_probability": estimate.false_probability,
    }
    if estimate.icrs_to_camera is not None and axis is not None:
        ra, dec, roll = celestial(axis)
        result |= {
            "icrs_to_camera_xyzw": terminal.quaternion(axis),
            "ra_deg": ra,
            "dec_deg": dec,
            "roll_deg": roll,
            "fov_x_deg": math.degrees(matches.camera.fov_x),
            "lens": {
                "icrs_to_lens_xyzw": terminal.quaternion(estimate.icrs_to_camera),
                "camera": to_table(matches.camera),
            },
            "residual_rms_px": estimate.residual_rms,
            "sigma_arcsec": [3600 * math.degrees(v**0.5) for v in estimate.covariance.diagonal()],
        }
    return result


def _text(solved: Solved) -> str:
    spots, matches, estimate, axis = solved
    if axis is None:
        return f"{estimate.status}: {estimate.reason}"
    camera = matches.camera
    lens = f", k1 {camera.k1:+.3f}, k2 {camera.k2:+.3f}" if camera.distorted else ""
    return (
        f"{terminal.pointing_text(axis, 4, 3)}; "
        f"field {math.degrees(camera.fov_x):.3f} deg{lens}; {estimate.stars} of {len(spots)} "
        f"spots matched, residual {estimate.residual_rms:.2f} px; "
        f"probability of a false match {estimate.false_probability:.0e}"
    )


def _overlay(folder: Path, image: Path, frame: Frame, solved: Solved, stars: Stars) -> Path:
    path = folder / f"{image.stem}.solved.png"
    spots, matches, estimate, _ = solved
    title = f"{image.name}\n{_text(solved)}"
    draw_solution(path, frame, spots, matches, estimate.icrs_to_camera, stars, title)
    return path
