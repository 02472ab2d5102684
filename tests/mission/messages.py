"""Writers of the CCSDS messages that the package reads (OEM, AEM), by the text of the standards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


def standard_matrix(numbers: Sequence[float]) -> NDArray[np.float64]:
    """The matrix from frame A to frame B of Q1, Q2, Q3, QC.

    Source: CCSDS 504.0-B-1, annex on conventions; the same as that of Orekit's
    `new Rotation(QC, Q1, Q2, Q3, false)`.
    """
    q1, q2, q3, qc = numbers
    squares = np.square(numbers)
    q12, q13, q23 = q1 * q2, q1 * q3, q2 * q3
    return np.array(
        [
            [squares @ [1, -1, -1, 1], 2 * (q12 + q3 * qc), 2 * (q13 - q2 * qc)],
            [2 * (q12 - q3 * qc), squares @ [-1, 1, -1, 1], 2 * (q23 + q1 * qc)],
            [2 * (q13 + q2 * qc), 2 * (q23 - q1 * qc), squares @ [-1, -1, 1, 1]],
        ]
    )


def standard_quaternions(icrs_to_body: Rotation) -> NDArray[np.float64]:
    """(n, 4) Q1, Q2, Q3, QC of ICRF to SC_BODY_1; `standard_matrix` gives the matrices back."""
    return icrs_to_body.inv().as_quat()


def write_aem(path: Path, epochs: Sequence[str], icrs_to_body: Rotation) -> None:
    """Write an AEM. Source: CCSDS 504.0-B-2."""
    frames = {"REF_FRAME_A": "ICRF", "REF_FRAME_B": "SC_BODY_1"}
    method = {"ATTITUDE_TYPE": "QUATERNION"}
    method |= {"INTERPOLATION_METHOD": "LINEAR", "INTERPOLATION_DEGREE": "1"}
    numbers = standard_quaternions(icrs_to_body)
    lines = message("AEM", "2.0", epochs, frames | method, numbers)
    path.write_text("\n".join([*lines, ""]))


def write_oem(path: Path, epochs: Sequence[str], place: NDArray, speed: NDArray) -> None:
    """Write an OEM of metre and metre / second. Source: CCSDS 502.0-B-3."""
    frames = {"CENTER_NAME": "EARTH", "REF_FRAME": "ICRF"}
    method = {"INTERPOLATION": "LAGRANGE", "INTERPOLATION_DEGREE": "7"}
    states = np.concatenate([place, speed], axis=1) / 1e3
    lines = message("OEM", "2.0", epochs, frames | method, states)
    path.write_text("\n".join([*lines, ""]))


def message(
    kind: str,
    version: str,
    epochs: Sequence[str],
    keywords: dict[str, str],
    values: NDArray,
    header: bool = True,
    scale: str = "UTC",
) -> list[str]:
    """Lines of a message of one segment: keywords, and a row for each date."""
    head = {f"CCSDS_{kind}_VERS": version, "CREATION_DATE": epochs[0], "ORIGINATOR": "TEST"}
    meta = {"OBJECT_NAME": "SPACECRAFT", "OBJECT_ID": "2026-001A", "TIME_SYSTEM": scale}
    meta |= {"START_TIME": epochs[0], "STOP_TIME": epochs[-1], **keywords}
    rows = [
        " ".join([epoch, *(f"{value:.17g}" for value in row)])
        for epoch, row in zip(epochs, values, strict=True)
    ]
    if kind == "AEM":
        rows = ["DATA_START", *rows, "DATA_STOP"]
    lines = [f"{key} = {value}" for key, value in head.items()] if header else []
    meta_lines = [f"{key} = {value}" for key, value in meta.items()]
    return [*lines, "META_START", *meta_lines, "META_STOP", *rows]
