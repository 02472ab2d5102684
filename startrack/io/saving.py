"""Files that are written whole or not at all."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from matplotlib.text import Text


DRAFT = ".startrack-draft-"  # in the names of files that are not whole yet


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A path to write to, which takes the place of `path` when all went well.

    The folder is made where it is missing. An error leaves what was there before.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays last, because writers of pictures tell the format by it.
    draft = path.with_name(f".{path.stem}{DRAFT}{os.getpid()}{path.suffix}")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def save_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8")


def save_json(path: Path, value: Any) -> None:
    """Write a JSON file whole."""
    save_text(path, json.dumps(value, indent=1) + "\n")


def save_figure(path: Path, figure: Figure) -> None:
    """Write a picture whole, at the figure's own resolution.

    Titles hold names of files, which may have bytes that are no text, or a $, as of formulas.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    for text in _titles(figure):
        words = text.get_text()
        text.set_text("".join(c if c.isprintable() or c == "\n" else "?" for c in words))
        text.set_parse_math(False)
    with whole(path) as draft:
        if draft.suffix == ".png":
            FigureCanvasAgg(figure).print_png(draft)  # the same, drawn once instead of twice
        else:
            figure.savefig(draft)


def _titles(artist: Artist) -> Iterator[Text]:
    """The texts of a figure, but for those of its axes."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    if isinstance(artist, Text):
        yield artist
    for part in artist.get_children():
        if not isinstance(part, Axis):
            yield from _titles(part)


def save_netcdf(
    path: Path,
    maps: Mapping[str, NDArray[np.float64]],
    about: Mapping[str, tuple[str, str]],
    axes: tuple[str, ...],
) -> None:
    """Write arrays of one shape as a NetCDF file (classic format) whole.

    maps   the arrays by their names
    about  unit and meaning of a name, where it has them
    axes   names of the arrays' axes
    """
    from scipy.io import netcdf_file

    with whole(path) as draft, netcdf_file(draft, "w") as file:
        for name, length in zip(axes, next(iter(maps.values())).shape, strict=True):
            file.createDimension(name, length)
        for name, values in maps.items():
            variable = file.createVariable(name, "f8", axes)
            variable[:] = values
            if name in about:
                variable.units, variable.long_name = about[name]


def save_csv(path: Path, head: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a heading and rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    save_text(path, text.getvalue())
