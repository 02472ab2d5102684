"""The trials with the largest errors, with their frames."""

from __future__ import annotations

import base64
import math
import tempfile
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.catalog import open_sky
from startrack.core import Streams, arcsec
from startrack.design import Case
from startrack.io import celestial
from startrack.plots import draw_solution
from startrack.report.page import figure
from startrack.trial import observe


def worst(outcomes: NDArray[np.void], count: int) -> NDArray[np.int64]:
    """Numbers of the worst trials: false attitudes, then none, then the largest errors."""
    size = np.hypot(outcomes["error_x"], outcomes["error_y"])
    badness = np.where(outcomes["solved"], size, math.pi)
    badness = np.where(outcomes["false"], 2 * math.pi, badness)
    return np.asarray(outcomes["trial"][np.argsort(-badness, kind="stable")[:count]], np.int64)


def show(case: Case, seed: int, number: int, icrs_to_camera: Rotation) -> str:
    """A trial, repeated, as a picture with its result as the caption (HTML)."""
    record = observe(case, icrs_to_camera, Streams(seed, number))
    outcome = record.outcome
    ra, dec, _ = celestial(record.icrs_to_camera)
    where = f"Trial {number}, boresight at RA {ra:.1f} deg, dec {dec:+.1f} deg"
    if not outcome.solved:
        result = f"no attitude: {record.estimate.reason}"
    else:
        error = math.hypot(outcome.error_x, outcome.error_y) / arcsec
        result = (
            f"{'FALSE, ' if outcome.false else ''}{error:.2f} arcsec across, "
            f"{abs(outcome.error_z) / arcsec:.1f} about the boresight, {outcome.stars} stars"
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.jpg"
        draw_solution(
            path,
            record.frame,
            record.spots,
            record.matches,
            record.estimate.icrs_to_camera,
            open_sky(case.believed_catalog).stars,
            f"trial {number}",
        )
        jpeg = base64.b64encode(path.read_bytes()).decode()
    picture = f'<img alt="{escape(where)}" src="data:image/jpeg;base64,{jpeg}">'
    return figure(picture, f"{where}: {result}.")
