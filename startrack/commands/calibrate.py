"""`startrack calibrate`: the camera behind images of stars."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import Any

import numpy as np

from startrack.camera import Camera
from startrack.case import Tracker
from startrack.catalog import Selection, open_sky
from startrack.chain import track
from startrack.checks import within
from startrack.commands.terminal import finite, say, tell
from startrack.detection import Detection, subtract_dark
from startrack.exits import Exit, WrongUse
from startrack.identification import Calibrated, Calibration, Identification, calibrate
from startrack.identification.calibrate import UNKNOWNS
from startrack.images import read_image
from startrack.saving import save_json
from startrack.values import Frame, Stars

ROUNDS = 3  # a better camera matches more stars, which make a better camera
KNOWN = 0.003  # of the focal length, after the first round


def command(options: argparse.Namespace) -> int:
    """Solve the images, fit one camera to all, and again with that camera."""
    try:
        within(0.01, 179, fov=options.fov)
        identification = Identification(focal_tolerance=options.fov_tolerance)
        stars = open_sky(Selection.whole(options.catalog, options.epoch)).stars
        dark = read_image(options.dark) if options.dark else None
        frames = [read_image(path) for path in options.images]
        if dark is not None:
            frames = [subtract_dark(frame, dark) for frame in frames]
    except (ValueError, OSError, ImportError) as error:
        raise WrongUse(str(error)) from None
    shapes = {frame.image.shape for frame in frames}
    if len(shapes) > 1:
        raise WrongUse(f"images must be of one camera, got sizes {sorted(shapes)}")
    rows, columns = shapes.pop()
    camera = Camera.from_field_of_view(columns, rows, math.radians(options.fov))
    settings = Calibration(
        focal_length=options.fov_tolerance,
        principal=options.principal,
        k2=1.0 if options.distortion == "full" else 0.0,
        k1=0.0 if options.distortion == "none" else 1.0,
        tangential=0.01 if options.distortion == "full" else 0.0,
    )
    found = None
    for _ in range(ROUNDS):
        found = _round(frames, camera, stars, identification, settings) or found
        if found is None:
            say("startrack calibrate: none of the images could be solved")
            tell(options, {"status": "unsolved", "images": len(frames)}, "unsolved")
            return Exit.UNSOLVED
        camera = found.camera
        identification = replace(identification, focal_tolerance=KNOWN)
    assert found is not None
    result = _values(found, len(frames))
    if options.out:
        save_json(options.out, finite(result))
    tell(options, result, _text(found, len(frames)))
    return Exit.DONE if found.frames == len(frames) else Exit.UNSOLVED


def _round(
    frames: list[Frame],
    camera: Camera,
    stars: Stars,
    identification: Identification,
    settings: Calibration,
) -> Calibrated | None:
    tracker = Tracker(Detection(), identification)
    answers = [track(frame, camera, stars, tracker) for frame in frames]
    matches = [matches for _, matches, _ in answers]
    if not any(len(match) for match in matches):
        return None
    return calibrate([spots for spots, _, _ in answers], matches, camera, settings)


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
        lines.append(f"{name:16} {value:12.5g} " + (f"+- {error:.2g}" if error else "as it was"))
    return "\n".join(lines)
