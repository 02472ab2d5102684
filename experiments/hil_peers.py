"""Frames as files, and their table of attitudes -> frames that other solvers solve.

Both solvers use spots of tetra3rs's detection, so that no part of startrack is between the files
and the attitude.

openstartracker (https://github.com/UBNanosatLab/openstartracker) is a C++ library, whose
`tests/test.c` prints the catalogue star of each spot: the environment variable
`OPENSTARTRACKER=/path/to/test` names that compiled program. Its catalogue is a file in the format
of Hipparcos with the directions and magnitudes of the design's sky, because its own catalogue is
outside its repository. Its calibration constants are fitted on the first frame, as by its
`calibrate.py`; the other constants are from its example camera. Its attitude follows from its stars
by least squares of directions.
"""

from __future__ import annotations

import csv
import os
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import command
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from startrack import Case, arcsec, deg
from startrack.catalog import open_sky

NEAR = 60 * arcsec  # largest distance from the true boresight
FEWEST = 4  # least number of stars of an attitude
PROGRAM = "OPENSTARTRACKER"
# The example camera of openstartracker (tests/science_cam_may8_0.05sec_gain40/calibration.txt).
EXAMPLE = {
    "DB_REDUNDANCY": 1, "DOUBLE_STAR_PX": 3.5, "REQUIRED_STARS": 5, "MAX_FALSE_STARS": 2,
    "THRESH_FACTOR": 5, "POS_ERR_SIGMA": 2, "POS_VARIANCE": 0.666903299486, "EXPOSURE_TIME": 0.05,
}  # fmt: skip


class Shot(NamedTuple):
    """A frame of a file, with stars detected by tetra3rs.

    centroids  result of tetra3rs
    shape      rows, columns
    spots      (n, 3) x, y in pixel, brightness
    noise      digital number rms of an empty pixel
    attitude   icrs_to_camera, from the table
    """

    centroids: Any
    shape: tuple[int, int]
    spots: NDArray[np.float64]
    noise: float
    attitude: Rotation


def solved_by_peers(folder: Path, case: Case) -> dict[str, float]:
    """Fraction of the frames of a folder that each peer solves within NEAR, by name of the peer."""
    if command.missing("frames solved by peers", "tetra3rs"):
        return {}
    shots = list(_shots(folder))
    solved = {"tetra3rs": _by_tetra3rs(shots, case)}
    if program := os.environ.get(PROGRAM):
        solved["openstartracker"] = _by_openstartracker(shots, case, Path(program), folder)
    else:
        print(f"openstartracker left out: {PROGRAM} names no program", flush=True)
    return {name: sum(found) / len(shots) for name, found in solved.items()}


def _shots(folder: Path) -> list[Shot]:
    """The frames of a folder, in order."""
    import tetra3rs

    shots = []
    with (folder / "sequence-0001.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            image = np.asarray(cv2.imread(str(folder / row["file"]), cv2.IMREAD_UNCHANGED))
            found = tetra3rs.extract_centroids(image, threads=1).centroids
            spots = np.array([(one.x, one.y, one.brightness) for one in found]).reshape(-1, 3)
            # Stars cover few pixels.
            noise = 1.4826 * float(np.median(np.abs(image - np.median(image))))
            attitude = Rotation.from_quat([float(row[f"icrs_to_camera_{name}"]) for name in "xyzw"])
            shots.append(Shot(found, image.shape, spots, noise, attitude))
    return shots


def _near(icrs_to_camera: NDArray[np.float64], true: Rotation) -> bool:
    """Whether the boresight agrees with the table."""
    return bool(np.linalg.norm(icrs_to_camera[2] - true.as_matrix()[2]) < NEAR)


def _by_tetra3rs(shots: list[Shot], case: Case) -> list[bool]:
    import tetra3rs

    field = case.instrument.camera.fov_x / deg
    database = tetra3rs.SolverDatabase.generate_from_gaia(max_fov_deg=field, star_max_magnitude=7.0)

    def solved(shot: Shot) -> bool:
        answer = database.solve_from_centroids(
            shot.centroids,
            fov_estimate_deg=field,
            fov_max_error_deg=0.05 * field,
            image_shape=shot.shape,
        )
        if isinstance(answer, tetra3rs.SolveFailure):
            return False
        return _near(np.array(answer.rotation_matrix_icrs_to_camera), shot.attitude)

    return [solved(shot) for shot in shots]


def _by_openstartracker(shots: list[Shot], case: Case, program: Path, folder: Path) -> list[bool]:
    stars = open_sky(case.catalog).stars
    ra, dec = (
        np.degrees(np.arctan2(stars.direction[:, 1], stars.direction[:, 0])) % 360,
        np.degrees(np.arcsin(stars.direction[:, 2])),
    )
    # The columns of Hipparcos that the program reads; proper motion is zero, directions are of the
    # date.
    lines = []
    for star, place in enumerate(zip(stars.magnitude_g, ra, dec, strict=True), 1):
        field = ["0"] * 78
        field[1], field[5], field[8], field[9] = str(star), *(f"{one:.9f}" for one in place)
        lines.append("|".join(field))
    (folder / "hip_main.dat").write_text("\n".join(lines) + "\n")
    bright = _zero_point(shots[0], case)
    rows, columns = shots[0].shape
    constants = EXAMPLE | {
        "IMG_X": columns,
        "IMG_Y": rows,
        "PIXSCALE": case.instrument.camera.fov_x / arcsec / columns,
        "BASE_FLUX": bright,
        "IMAGE_VARIANCE": shots[0].noise ** 2,
    }
    (folder / "calibration.txt").write_text("".join(f"{k}={v}\n" for k, v in constants.items()))
    # Its z axis points to smaller rows; with rows counted upwards its axes are right-handed.
    given = [
        np.column_stack(
            [
                shot.spots[:, 0] + columns / 2,
                rows / 2 - shot.spots[:, 1],
                -2.5 * np.log10(shot.spots[:, 2] / bright),
            ]
        )
        for shot in shots
    ]
    (folder / "spots.csv").write_text(
        "".join(",".join(f"{value:.6f}" for value in one.ravel()) + "\n" for one in given)
    )
    called = [str(program.resolve()), "spots.csv", "calibration.txt", "1991.25"]
    answer = subprocess.run(called, cwd=folder, capture_output=True, text=True, check=True)
    named = [np.array(line.split(","), int) for line in answer.stdout.splitlines()]

    def solved(shot: Shot, star: NDArray[np.int64]) -> bool:
        there = star > 0
        if there.sum() < FEWEST:
            return False
        focal = case.instrument.camera.focal_length_px
        seen = np.column_stack([shot.spots[there, :2] / focal, np.ones(there.sum())])
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        found, _ = Rotation.align_vectors(seen, stars.direction[star[there] - 1])
        return _near(found.as_matrix(), shot.attitude)

    return [solved(*one) for one in zip(shots, named, strict=True)]


def _zero_point(shot: Shot, case: Case) -> float:
    """Brightness of a star of magnitude 0, the median of the stars of a frame."""
    stars, focal = open_sky(case.catalog).stars, case.instrument.camera.focal_length_px
    seen = shot.attitude.apply(stars.direction)
    seen, magnitude = seen[seen[:, 2] > 0.5], stars.magnitude_g[seen[:, 2] > 0.5]
    off, nearest = KDTree(seen[:, :2] / seen[:, 2:] * focal).query(shot.spots[:, :2])
    scale = shot.spots[:, 2] * 10 ** (magnitude[nearest] / 2.5)
    return float(np.median(scale[off < 2]))  # pixel
