"""`startrack solve`: the attitude of images."""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import (
    Exit,
    Option,
    Options,
    as_wrong_use,
    degrees,
    images,
    wanted,
    whole,
)

if wanted(__name__):
    from startrack import plots
    from startrack.cli import terminal
    from startrack.core import Camera, Frame, Refused, arcsec, positive, utc, within
    from startrack.design import Tracker
    from startrack.detection import Detection
    from startrack.identification import Identification, PatternIndexes, fit_frame
    from startrack.io import (
        YEAR_2000,
        field_hint,
        rows_upwards,
        tetra3_values,
        to_table,
        write_solution,
    )
    from startrack.montecarlo import pool
    from startrack.photograph import (
        THRESHOLDS,
        Photograph,
        PhotographView,
        Site,
        place_photograph,
        solve_photograph,
    )
    from startrack.trial import lost_in_space


declare = Options(
    "Prints the boresight of each image, its roll, its field of view and the probability of a "
    "false match. The boresight is the apparent direction of the image's centre among catalogue "
    "stars, with refraction of the air and aberration. With --place the direction without both "
    "is also printed, with azimuth and elevation. Without --camera the lens is unknown, and its "
    "distortion is estimated if the stars show it; with --camera the optical axis is also "
    "printed. Scale and squeeze of the image by refraction are estimated if the stars show them. "
    "Mirrored and squeezed images are tried last; the result is then for the image as a camera "
    "with square pixels would see it, with a note. The status is 3 if an image has no attitude, "
    "with the reason, and 1 if an image cannot be read.",
    *images(),
    Option(
        "--fov DEG",
        "field of view across the columns, degree, which is tried first (default: from the "
        "file's EXIF, then a search from 1.5 to 90, and fisheyes to 180)",
        degrees,
    ),
    Option(
        "--aspect RATIO",
        "width of a pixel over its height (default: 1, then ratios for images squeezed between "
        "usual shapes)",
        shared.decimal(0.1, 10),
    ),
    Option(
        "--exposure S",
        "exposure time, second, for files without it; needed for the rate of a turning camera "
        "with streaks",
        shared.decimal(1e-9, 1e9),
    ),
    *shared.FIELD_AND_SKY,
    Option(
        "--camera FILE",
        "calibrated camera, from `calibrate --camera`, or a design with [tracker.camera]",
        Path,
    ),
    Option("--place LAT LON", "latitude and longitude of the camera, degree", float),
    Option("--height METRE", "height of the place above the sea (default: 0)", float, 0.0),
    Option(
        "--time UTC",
        "time of the exposure, such as 2026-08-21T22:10:05 (default: time stamp of the file, "
        "taken as UTC)",
    ),
    Option(
        "--tables DIR",
        "folder for FITS files in the format of astrometry.net: spots (.axy), matches (.corr) "
        "and WCS (.wcs) of each image",
        Path,
    ),
    Option(
        "--keys",
        "names of the values of --json: startrack's (default) or tetra3's, described in "
        "docs/json.md",
        ("startrack", "tetra3"),
        "startrack",
    ),
    Option("--overlay DIR", "folder for pictures of the images with their stars", Path),
    Option(
        "--workers N",
        "number of processes, each of which reads the catalogue; results do not depend on it",
        whole(1, 1024),
        1,
    ),
)


BRIGHT = "bright"
DEEPER = "; a field of a few degrees may need the fainter stars of --catalog deep"
ANY_TIME = "2000-01-01T00:00:00"  # for the check of a place without an image
WIDEST = 240.0  # degree across the columns, largest fisheye

# Options common to all images of a process, by name; and the resulting reader of images, camera,
# settings and indexes.
SHARED = (
    *("fov_tolerance", "plane", "extension", "bayer", "colour", "raw", "dark", "catalog"),
    *("epoch", "camera"),
)
SAID = "said"  # attribute of an error with the warnings before it
# JSON values that are missing without an attitude.
ATTITUDE = "icrs_to_camera_xyzw", "ra_deg", "dec_deg", "roll_deg", "fov_x_deg"
IMAGE = (
    "mirrored",
    "aspect",
    "middle_px",
    "streak_px",
    "rate_deg_s",
    "as_hinted",
    "lens",
    "residual_rms_px",
    "sigma_arcsec",
)


def command(options: argparse.Namespace) -> int:
    """Solve each image; an unreadable image does not stop the others."""
    with as_wrong_use(ValueError, OSError):
        if options.fov is not None:
            positive(fov=options.fov)
            within(0, WIDEST, fov=options.fov)
        if options.camera and options.fov is not None:
            raise ValueError(
                "--fov and --camera must not both be given: the camera determines the field"
            )
        if options.place is None and (options.time or options.height):
            raise ValueError("--time and --height need --place LAT LON")
        if options.place is not None:
            _site(options, options.time or ANY_TIME)  # refused before the first image
    _opened.cache_clear()  # files may have changed
    _opened(*(getattr(options, name) for name in SHARED))
    statuses = set()
    with pool(min(options.workers, len(options.images))) as executor:
        jobs = (executor.submit(_solved_with_warnings, options, path) for path in options.images)
        # One process solves an image when its job is made, and prints it before the next.
        every = jobs if options.workers == 1 else iter(list(jobs))
        for path, job in zip(options.images, every, strict=True):
            try:
                try:
                    solved = job.result()
                except BrokenExecutor:  # a process died, possibly at another image
                    solved = executor.submit(_solved_with_warnings, options, path).result()
                (result, text, status), said = solved
            except Exception as error:  # the other images are solved in any case
                _warn(getattr(error, SAID, ()))
                terminal.print_failed_image(options, path, error)
                statuses.add(Exit.FAILED)
                continue
            _warn(said)
            terminal.print_result(options, result, text)
            statuses.add(status)
    return Exit.FAILED if Exit.FAILED in statuses else max(statuses)


@lru_cache(maxsize=1)
def _opened(
    *values: Any,
) -> tuple[Callable[[Path], Frame], Camera | None, Identification, PatternIndexes]:
    options = argparse.Namespace(**dict(zip(SHARED, values, strict=True)))
    with as_wrong_use(ValueError, OSError):
        camera = terminal.read_camera(options.camera) if options.camera else None
        tolerance = min(options.fov_tolerance, shared.KNOWN if camera else math.inf)
        identification = Identification(focal_tolerance=tolerance)
    read = terminal.image_reader(options)
    stars = terminal.read_stars(options.catalog, options.epoch)
    return read, camera, identification, PatternIndexes(stars)


def _solved_with_warnings(
    how: argparse.Namespace, path: Path
) -> tuple[tuple[dict[str, Any], str, Exit], list[str]]:
    """The result of `_solved` and its warnings; an error has the warnings in its attribute SAID."""
    with warnings.catch_warnings(record=True) as caught:
        try:
            solved = _solved(how, path)
        except Exception as error:
            setattr(error, SAID, [str(warning.message) for warning in caught])
            raise
    return solved, [str(warning.message) for warning in caught]


def _warn(said: Iterable[str]) -> None:
    """Warn in this process; a worker would also print the line of code."""
    for warning in said:
        warnings.warn(warning, stacklevel=1)


def _solved(how: argparse.Namespace, path: Path) -> tuple[dict[str, Any], str, Exit]:
    """Solve one image and write its files. Returns values, line and status."""
    read, camera, identification, indexes = _opened(*(getattr(how, name) for name in SHARED))
    frame, stars, place = read(path), indexes.stars, ""
    time = _time_of(how, frame)  # refused before the search
    if camera:
        solved = _with_camera(frame, camera, indexes, identification)
        if solved.estimate.icrs_to_camera is not None:
            axis = terminal.pointing_text(solved.estimate.icrs_to_camera, 4, 3)
            place = f"; the optical axis at {axis}"
    else:
        given = None if how.fov is None else math.radians(how.fov)
        hint = given or field_hint(path, frame.image.shape)
        upwards = rows_upwards(path)
        solved = solve_photograph(frame, indexes, identification, hint, how.aspect, upwards)
        if upwards and solved.axis is not None:
            place = "; rows of the file go upwards, by its ROWORDER"
    placed, where = _placed(how, time, solved, camera)
    place += where
    seen = solved.spots, solved.matches, solved.estimate
    values = (
        tetra3_values(*seen, solved.axis, stars)
        if how.keys == "tetra3"
        else _values(solved, frame.exposure if frame.exposure > 0 else how.exposure or 0.0)
    )
    result = {"image": str(path), **values, **placed}
    if how.overlay:
        name = how.overlay / f"{path.stem}.solved.png"
        plots.draw_solution(
            name,
            solved.view.frame(frame),
            solved.spots,
            solved.matches,
            solved.estimate.icrs_to_camera,
            stars,
            f"{path.name}\n{_text(solved)}",
        )
        result["overlay"] = str(name)
    if how.tables:
        name = how.tables / path.stem
        columns, rows = solved.view.size(*frame.image.shape[::-1])
        files = write_solution(name, solved.spots, (rows, columns), solved.matches, stars)
        result["tables"] = [str(file) for file in files]
    status = Exit.UNSOLVED if solved.axis is None else Exit.DONE
    text = f"{path}: {_text(solved)}{place}"
    if solved.axis is None and how.catalog == BRIGHT:
        text += DEEPER
    return result, text, status


def _with_camera(
    frame: Frame, camera: Camera, indexes: PatternIndexes, identification: Identification
) -> Photograph:
    """The first search with a calibrated camera that finds an attitude, or the last search."""
    rows, columns = frame.image.shape
    if (camera.rows, camera.columns) != (rows, columns):
        raise ValueError(
            f"image must have the {camera.columns} x {camera.rows} pixels of the camera, "
            f"got {columns} x {rows}"
        )
    for threshold in THRESHOLDS:
        tracker = Tracker(Detection(threshold=threshold), identification)
        spots, matches, estimate = lost_in_space(frame, camera, indexes, tracker)
        if estimate.icrs_to_camera is not None:
            break
    if estimate.icrs_to_camera is None:
        return Photograph(spots, matches, estimate, None, PhotographView())
    matches, axis, covariance, rms = fit_frame(spots, matches)
    attitude = matches.icrs_to_camera
    estimate = replace(estimate, icrs_to_camera=attitude, covariance=covariance, residual_rms=rms)
    return Photograph(spots, matches, estimate, axis, PhotographView())


def _site(how: argparse.Namespace, time: str) -> Site:
    within(-90, 90, latitude=how.place[0])
    within(-360, 360, longitude=how.place[1])
    latitude, longitude = (math.radians(angle) for angle in how.place)
    return Site(latitude, longitude, utc(time).isot, how.height)


def _time_of(how: argparse.Namespace, frame: Frame) -> str:
    """Time of the exposure, UTC; "" without a place."""
    if how.place is None:
        return ""
    if how.time is None and not math.isfinite(frame.time):
        raise ValueError("--time must be given with --place: the file has no time stamp")
    return how.time or (YEAR_2000 + timedelta(seconds=frame.time)).isoformat()


def _placed(
    how: argparse.Namespace, time: str, solved: Photograph, camera: Camera | None
) -> tuple[dict[str, Any], str]:
    """Direction of the camera by place and time: values for JSON, and words; empty without a
    place."""
    if how.place is None or solved.axis is None:
        return {}, ""
    try:
        placed = place_photograph(solved, _site(how, time), camera)
    except Refused as reason:  # the attitude remains
        return {"place": {"reason": str(reason)}}, f"; no direction without refraction: {reason}"
    fit = placed.fit
    angles = {
        "azimuth_deg": math.degrees(placed.azimuth),
        "elevation_deg": math.degrees(placed.elevation),
    }
    moved = {
        "refraction_arcsec": placed.refraction / arcsec,
        "aberration_arcsec": placed.aberration / arcsec,
    }
    values = {"time": time, **terminal.attitude_values(fit.icrs_to_image), **angles, **moved}
    values |= {
        "residual_rms_px": fit.residual_rms,
        "sigma_arcsec": [v**0.5 / arcsec for v in fit.covariance.diagonal()],
    }
    return {"place": values}, (
        f"; azimuth {angles['azimuth_deg']:.3f}, elevation {angles['elevation_deg']:.3f} deg; "
        f"without refraction ({moved['refraction_arcsec']:.1f} arcsec) and aberration "
        f"({moved['aberration_arcsec']:.1f}): {terminal.pointing_text(fit.icrs_to_image, 4, 3)}"
    )


def _values(solved: Photograph, exposure: float) -> dict[str, Any]:
    spots, matches, estimate, axis = solved.spots, solved.matches, solved.estimate, solved.axis
    result: dict[str, Any] = {
        "status": "solved" if estimate.icrs_to_camera is not None else str(estimate.status),
        "reason": estimate.reason,
        **dict.fromkeys(ATTITUDE),
        "spots": len(spots),
        "matches": estimate.stars,
        **dict.fromkeys(IMAGE),
        "false_probability": estimate.false_probability,
    }
    if estimate.icrs_to_camera is not None and axis is not None:
        lens = terminal.attitude_values(estimate.icrs_to_camera)  # of the optical axis
        lens["icrs_to_lens_xyzw"] = lens.pop("icrs_to_camera_xyzw")
        result |= terminal.attitude_values(axis) | {
            "fov_x_deg": math.degrees(matches.camera.fov_x),
            "mirrored": solved.view.mirrored,
            "aspect": solved.aspect,
            "middle_px": solved.view.middle,
            "streak_px": solved.streak and list(solved.streak),
            "rate_deg_s": _rate(solved, exposure),
            "as_hinted": solved.as_hinted,
            "lens": lens | {"camera": to_table(matches.camera)},
            "residual_rms_px": estimate.residual_rms,
            "sigma_arcsec": [3600 * math.degrees(v**0.5) for v in estimate.covariance.diagonal()],
        }
    return result


def _rate(solved: Photograph, exposure: float) -> float | None:
    """Rate of the camera, degree / second; None if stars are points or the exposure is unknown."""
    if solved.streak is None or not exposure > 0:
        return None
    turn = math.hypot(*solved.streak) / solved.matches.camera.focal_length_px
    return math.degrees(turn / exposure)


def _text(solved: Photograph) -> str:
    estimate, camera = solved.estimate, solved.matches.camera
    if solved.axis is None:
        return f"{estimate.status}: {estimate.reason}"
    lens = f", k1 {camera.k1:+.3f}, k2 {camera.k2:+.3f}" if camera.distorted else ""
    how = f"{solved.view}; " if str(solved.view) else ""
    return (
        f"{terminal.pointing_text(solved.axis, 4, 3)}; {how}"
        f"field {math.degrees(camera.fov_x):.3f} deg{lens}; {estimate.stars} of "
        f"{len(solved.spots)} spots matched, residual {estimate.residual_rms:.2f} px; "
        f"probability of a false match {estimate.false_probability:.0e}{solved.note}"
    )
