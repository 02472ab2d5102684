"""Question: how well are real night skies solved, knowing only a rough field of view?

Answer: a table in Markdown, one line an image and a guess of the field: the error across and
about the boresight against attitudes that independent solvers agree on (their own spread beside
it), matches, residual and time. The images hold stellar aberration, up to 21 arcsec.

    STARTRACK_DATA=folder python experiments/real_images.py [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import time
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import command
import cv2
from scipy.spatial.transform import Rotation

from startrack.cli.main import main as startrack

GUESSES = (0.91, 1.0, 1.09)  # of the true field
LIMIT = 30.0  # arcsec across
EPOCH = 2016.0  # of the catalogue that the known attitudes come from


def solve(path: Path, field: float, dark: Path | None) -> tuple[dict, float]:
    """What `startrack solve` says of one image, and the processor's seconds."""
    arguments = ["solve", str(path), "--fov", str(field), "--epoch", str(EPOCH), "--json"]
    if dark:
        arguments += ["--dark", str(dark)]
    text = io.StringIO()
    began = time.process_time()
    with contextlib.redirect_stdout(text):
        startrack(arguments)
    return json.loads(text.getvalue()), time.process_time() - began


def known(folder: Path) -> Iterator[tuple[Path, dict, Path | None]]:
    """Each image that is there, what is known of it, and its dark frame."""
    for name, truth in json.loads((folder / "truth.json").read_text())["images"].items():
        if (folder / name).exists():
            yield folder / name, truth, folder / "ost_dark.png" if name.startswith("ost") else None


def off(found: dict, truth: dict) -> tuple[float, float]:
    """Error across and about the boresight, arcsec."""
    true = Rotation.from_matrix(truth["R_icrs_to_cam"])
    error = (Rotation.from_quat(found["icrs_to_camera_xyzw"]) * true.inv()).as_rotvec()
    x, y, z = (3600 * math.degrees(angle) for angle in error)
    return math.hypot(x, y), z


def right(folder: Path, images: int | None = None) -> Iterator[bool]:
    """Whether each of the first images is solved within 30 arcsec from every guess of the field."""
    for path, truth, dark in islice(known(folder), images):
        answers = [solve(path, truth["fov_x_deg"] * guess, dark)[0] for guess in GUESSES]
        yield all(
            a["icrs_to_camera_xyzw"] is not None and off(a, truth)[0] < LIMIT for a in answers
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options = command.read(parser)
    cv2.setNumThreads(1)
    rows: list[dict[str, Any]] = []
    if folder := command.images("everything is"):
        rows = table(folder, *((GUESSES[1:2], 1) if options.quick else (GUESSES, None)))
    command.save(options, rows)


def table(folder: Path, guesses: Sequence[float], images: int | None) -> list[dict[str, Any]]:
    """Print a line for each of the first images and each guess of its field."""
    rows = []
    print("| image | guess | across (arcsec) | about (arcsec) | solvers' spread (arcsec) "
          "| matches / spots | residual rms (px) | time (ms) |")  # fmt: skip
    print("|---" * 8 + "|")
    for guess in guesses:
        for path, truth, dark in islice(known(folder), images):
            field = truth["fov_x_deg"] * guess
            solve(path, field, dark)  # the catalogue's index and the compiler's work do not count
            found, seconds = solve(path, field, dark)
            rows.append({"image": path.name, "guess": guess, "seconds": seconds, **found})
            line = f"| {path.name} | {guess} "
            if found["icrs_to_camera_xyzw"] is None:
                print(line + f"| {found['status']} | | | | | {1e3 * seconds:.0f} |")
                continue
            across, about = off(found, truth)
            print(
                line + f"| {across:.1f} | {about:.1f} | {truth['spread_arcsec']:.1f} "
                f"| {found['matches']} / {found['spots']} | {found['residual_rms_px']:.2f} "
                f"| {1e3 * seconds:.0f} |"
            )
    return rows


if __name__ == "__main__":
    command.run(main)
