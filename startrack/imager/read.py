"""A file of a scene -> Survey: the camera may be named, from the catalogue or another file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from startrack.imager.parameters import Imager, Survey
from startrack.shipped import shipped
from startrack.tables import from_table, read_table


def load_survey(path: Path) -> Survey:
    """Read a scene file; `camera = "hsrs"` stands for the one of the catalogue.

    Errors  ValueError, one sentence with the file, the place in it, the rule and the value.
    """
    path = Path(path)
    table = read_table(path, "a scene file")
    camera = table.get("camera")
    try:
        if isinstance(camera, str):
            table = {**table, "camera": _camera(camera, path.parent)}
        return from_table(Survey, table)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def load_imager(name: str, folder: Path = Path()) -> Imager:
    """A camera of the catalogue by its name, or of a file in a folder.

    Errors  ValueError as `load_survey`.
    """
    return from_table(Imager, _camera(name, folder))


def cameras() -> list[str]:
    """The cameras of the catalogue that look at surfaces."""
    return sorted(path.stem for path in shipped("cameras").glob("*.toml") if _is_imager(path))


def _camera(name: str, folder: Path) -> dict[str, Any]:
    if name in cameras():
        return read_table(shipped(f"cameras/{name}.toml"), "a camera file")
    if name.endswith(".toml"):
        return read_table(folder / name, "a camera file")
    raise ValueError(f"camera must be one of {', '.join(cameras())} or a TOML file, got {name!r}")


def _is_imager(path: Path) -> bool:
    return "channels" in read_table(path, "a camera file")
