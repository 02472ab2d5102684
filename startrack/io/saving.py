"""Files that are written completely or not at all; folders that one process at a time writes to."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import secrets
import shutil
import socket
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from startrack.core import Floats
from startrack.io.reading import kind_of, regular_file

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from matplotlib.text import Text


OPEN = "/proc/"  # where Linux has the open files of processes
FIGURE = "startrack, a figure"  # Software of PNG figures, which are no images of a camera
DRAFT = ".startrack-draft-"  # in the names of files that are not whole yet


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A path to write to, which replaces `path` after success.

    A missing folder is made. After an error the old file stays. A link stays, and its target is
    replaced. A FIFO, a terminal or another stream gets the bytes at the end.

    Raises  OSError for a folder, a disk or a socket, which no file may replace, and for a file that
            is not written completely.
    """
    path = Path(path)
    if _is_stream(path):
        with tempfile.TemporaryDirectory() as folder:
            draft = Path(folder) / f"draft{path.suffix}"
            yield draft
            with draft.open("rb") as content, _opened(path) as stream:
                shutil.copyfileobj(content, stream)
        return
    path = Path(os.path.realpath(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = _new_draft(path)
    try:
        yield draft
        draft.replace(path)
    except OSError as error:
        if error.filename is not None:
            raise
        # A full disk: the system, or numpy, says how, but not where.
        raise OSError(f"{path} must be written completely, but: {error}") from error
    finally:
        draft.unlink(missing_ok=True)


def _new_draft(path: Path) -> Path:
    """An empty file beside a path, with an unpredictable name, made without following links.

    In a folder that others can write to, a link with a known name could redirect the draft.
    """
    # The suffix stays last, because writers of pictures tell the format by it.
    draft = path.with_name(f".{path.stem}{DRAFT}{secrets.token_hex(8)}{path.suffix}")
    # O_EXCL also refuses a link, wherever it leads.
    os.close(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    return draft


def _is_stream(path: Path) -> bool:
    """Whether a path names a stream, not a file that may be replaced or made.

    Raises  OSError if it is neither.
    """
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return False
    if stat.S_ISFIFO(mode) or stat.S_ISCHR(mode):
        return True
    if not stat.S_ISREG(mode):
        raise OSError(f"{path} must be a file, a new name or a stream, but is {kind_of(mode)}")
    # An open file of this process is also a stream, wherever it leads.
    return os.path.realpath(path.parent).startswith(OPEN) or (
        path.is_symlink() and os.readlink(path).startswith(OPEN)
    )


def _opened(path: Path) -> BinaryIO:
    """A stream to write to; a stream that this process has open continues at its position."""
    for link in (path, Path(os.readlink(path))) if path.is_symlink() else ():
        if os.path.realpath(link.parent) == os.path.realpath(f"{OPEN}self/fd"):
            sys.stdout.flush()
            return os.fdopen(os.dup(int(link.name)), "wb")
    return path.open("wb")


def save_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")


def save_json(path: Path, value: Any) -> None:
    """Write a JSON file whole."""
    save_text(path, json.dumps(value, indent=1) + "\n")


def save_toml(path: Path, table: Mapping[str, Any], comment: str = "") -> None:
    """Write a TOML file whole.

    comment  lines at its top
    """
    import tomli_w

    head = "".join(f"# {line}\n" for line in comment.splitlines())
    save_text(path, head + tomli_w.dumps(table))


def save_arrays(path: Path, tables: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the arrays of several tables whole, as an npz file without pickles.

    Each array has the name of its table, "_", and its own.
    """
    arrays = {
        f"{table}_{name}": np.asarray(values)
        for table, columns in tables.items()
        for name, values in columns.items()
    }
    with whole(path) as draft, draft.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def save_figure(path: Path, figure: Figure) -> None:
    """Write a picture whole, at the figure's own resolution.

    Titles hold names of files, which may have bytes that are no text, or a $ (of a formula).
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    for text in _titles(figure):
        words = text.get_text()
        text.set_text("".join(c if c.isprintable() or c == "\n" else "?" for c in words))
        text.set_parse_math(False)
    with whole(path) as draft:
        if draft.suffix == ".png":
            # The same as savefig, drawn once instead of twice.
            FigureCanvasAgg(figure).print_png(draft, metadata={"Software": FIGURE})
        else:
            figure.savefig(draft)


def _titles(artist: Artist) -> Iterator[Text]:
    """The texts of a figure, except those of its axes."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    if isinstance(artist, Text):
        yield artist
    for part in artist.get_children():
        if not isinstance(part, Axis):
            yield from _titles(part)


def save_netcdf(
    path: Path,
    maps: Mapping[str, Floats],
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


fcntl: Any
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

NAME = ".startrack-process"  # in a folder that is written to
LONGEST = 1000  # byte of a note


def note_owner(path: Path) -> None:
    """Write a note next to a file, if possible, that this process owns the file."""
    with suppress(OSError), open(_note(path), "wb", opener=_here) as file:
        file.write(_words())


def forget_owner(path: Path) -> None:
    """Remove that note."""
    with suppress(OSError):
        _note(path).unlink()


def owner(path: Path) -> str:
    """Owner of a file, from its note: ", 1234 since 2026-..."; empty without a note."""
    return _read(_note(path))


def _note(path: Path) -> Path:
    return path.with_name(f"{path.name}-process")


def _here(name: str, flags: int) -> int:
    """Open a file in a folder of all users: it follows no link and does not wait for a FIFO."""
    return os.open(name, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)


def _words() -> bytes:
    since = datetime.now(UTC).isoformat(timespec="seconds")
    words = {"process": os.getpid(), "host": socket.gethostname(), "since": since}
    return json.dumps(words).encode()


def _read(path: Path) -> str:
    try:
        with open(path, "rb", opener=_here) as file:
            note = json.loads(file.read(LONGEST))
        return f", {int(note['process'])} on {note['host']!s:.60} since {note['since']!s:.40}"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


@contextmanager
def claimed_folder(folder: Path) -> Iterator[None]:
    """Let no other process of startrack write to a folder at the same time.

    The lock belongs to the system, so that it ends with the process in any case. Drafts of files
    that an ended process left in the folder are removed.

    Raises  OSError with the other process and since when it has the folder.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NAME
    if fcntl is None:
        yield
        return
    while True:
        if path.exists():
            regular_file(path, "the note of whoever writes to its folder")
        with open(path, "a+b", opener=_here) as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise OSError(f"{folder} is in use by another process{_read(path)}") from None
            if not _named(path, file.fileno()):
                continue  # the process before removed it between the two calls
            file.truncate(0)
            file.write(_words())
            file.flush()
            for draft in folder.glob(f".*{DRAFT}*"):
                draft.unlink()
            try:
                yield
            finally:
                with suppress(OSError):
                    path.unlink()
                    if made:
                        folder.rmdir()  # where nothing was written
            return


def _named(path: Path, number: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(number))
    except FileNotFoundError:
        return False


def finite(value: Any) -> Any:
    """The same value with None for each number that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
