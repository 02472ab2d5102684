"""Writers of the CCSDS messages that the package reads (OEM, AEM)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from startrack.core import Floats
from startrack.mission.files import Attitudes, Ephemeris


def write_aem(path: Path, attitudes: Attitudes, name: str = "SPACECRAFT") -> None:
    """Write an AEM that `read_aem` reads back to the same quaternions.

    Source: CCSDS 504.0-B-2; frames EME2000, from which ICRS differs by 0.02 arcsec, to SC_BODY_1.
    """
    frames = {"REF_FRAME_A": "ICRF", "REF_FRAME_B": "SC_BODY_1"}
    method = {"ATTITUDE_TYPE": "QUATERNION", "INTERPOLATION_METHOD": "LINEAR"}
    lines = _message("AEM", name, attitudes, frames, method, attitudes.quaternion)
    data = lines.index("META_STOP") + 1
    path.write_text("\n".join([*lines[:data], "DATA_START", *lines[data:], "DATA_STOP", ""]))


def write_oem(path: Path, ephemeris: Ephemeris, name: str = "SPACECRAFT") -> None:
    """Write an OEM that `read_oem` reads back to the same states. Source: CCSDS 502.0-B-3."""
    frames = {"CENTER_NAME": "EARTH", "REF_FRAME": "ICRF"}
    states = np.concatenate([ephemeris.place, ephemeris.speed], axis=1) / 1e3
    lines = _message("OEM", name, ephemeris, frames, {"INTERPOLATION": "LAGRANGE"}, states)
    path.write_text("\n".join([*lines, ""]))


def _message(
    kind: str, name: str, table: Ephemeris | Attitudes, frames: dict[str, str],
    method: dict[str, str], values: Floats,
) -> list[str]:  # fmt: skip
    """Lines of a message: keywords, and a row for each date."""
    begin, end = table.epoch[0], table.epoch[-1]
    # The creation date is that of the data, so that the file is the same on every day.
    head = {f"CCSDS_{kind}_VERS": "2.0", "CREATION_DATE": begin, "ORIGINATOR": "STARTRACK"}
    meta = {"OBJECT_NAME": name, "OBJECT_ID": name, **frames}
    meta |= {"TIME_SYSTEM": table.scale.upper(), "START_TIME": begin, "STOP_TIME": end, **method}
    meta["INTERPOLATION_DEGREE"] = str(table.degree)
    rows = [
        " ".join([epoch, *(f"{value:.17g}" for value in row)])
        for epoch, row in zip(table.epoch, values, strict=True)
    ]
    head_lines, meta_lines = ([f"{k} = {v}" for k, v in part.items()] for part in (head, meta))
    return [*head_lines, "META_START", *meta_lines, "META_STOP", *rows]
