"""Path of a file -> its bytes, if it is regular, not too large and of the claimed kind.

Files are untrusted: a FIFO would wait for ever, a few bytes may unpack to more than the memory, and
a header may announce a picture larger than the memory.
"""

import errno
import io
import os
import re
import stat
import warnings
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import SHIPPED, Floats, Refused, require_memory


def shipped(name: str) -> Path:
    """Path of a shipped data file or folder.

    >>> shipped("stars/bright.fits").name
    'bright.fits'

    name     path inside `catalogs`, with forward slashes
    Returns  its path on this computer
    Raises   FileNotFoundError if this installation does not have it.
    """
    for folder in SHIPPED:
        if (folder / name).exists():
            return folder / name
    looked = " or ".join(str(folder) for folder in SHIPPED)
    raise FileNotFoundError(f"shipped data must be in {looked}, and {name!r} is in neither")


def path_from(folder: Path, file: str | Path) -> str:
    """The path of a file from a folder; as it is where they are on different drives."""
    try:
        return Path(os.path.relpath(os.path.realpath(file), os.path.realpath(folder))).as_posix()
    except ValueError:
        return os.path.realpath(file)


def name_from(folder: Path, file: str | Path) -> str:
    """The name of a shipped file, if no file of the folder has this name; else its path from
    there."""
    full = Path(os.path.realpath(file))
    for root in (place.resolve() for place in SHIPPED):
        if full.is_relative_to(root) and not (folder / full.relative_to(root)).exists():
            return full.relative_to(root).as_posix()
    return path_from(folder, file)


MIB = 2**20  # byte
MADE = ("/proc/", "/sys/")  # folders of files that Linux generates when they are read
PIECE = 4 * MIB  # bytes that are unpacked at a time


def regular_file(path: Path, what: str = "a file") -> Path:
    """The path, where it names a regular file; it is not opened, since a FIFO would wait.

    what    it must be, for the message
    Raises  ValueError for a folder, a device, a FIFO, a socket, a circle of links, or a file that
            the system generates when it is read; FileNotFoundError without one.
    """
    try:
        kind = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"{path} must be {what}, but there is none") from None
    except ValueError as error:  # a zero byte in the name
        raise Refused(f"{str(path)!r} must be the name of a file: {error}") from None
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise Refused(f"{path} must be {what}, but its links lead in a circle") from None
        raise
    if not stat.S_ISREG(kind):
        raise Refused(f"{path} must be {what}, but is {kind_of(kind)}")
    if os.path.realpath(path).startswith(MADE):  # reading some of them waits, or takes words away
        raise Refused(f"{path} must be {what}, but is made by the system")
    return path


def kind_of(mode: int) -> str:
    """Kind of a file by its mode, in words."""
    names = {
        stat.S_ISDIR: "a folder",
        stat.S_ISFIFO: "a FIFO",
        stat.S_ISCHR: "a device",
        stat.S_ISBLK: "a device",
        stat.S_ISSOCK: "a socket",
    }
    return next((name for holds, name in names.items() if holds(mode)), "none")


def read_bytes(path: Path, what: str = "a file", most: int | None = None) -> bytes:
    """The bytes of a regular file.

    what    it must be, for the message
    most    bytes; None: what fits into memory
    Raises  ValueError if it is larger, or as `regular_file`; OSError if it cannot be read.
    """
    size = os.stat(regular_file(path, what)).st_size
    if most is not None and size > most:
        raise Refused(f"{path} must be {what} of at most {most} bytes, got {size}")
    require_memory(size, f"{path}, {what},")
    with open(path, "rb") as file:
        data = file.read(size + 1)
    if len(data) > size:  # it grows, or the system does not tell its size, as in /proc
        raise Refused(f"{path} must be {what} of {size} bytes, but has more")
    return data


def unpacked(path: Path, data: bytes, times: int = 1) -> bytes:
    """The content of gzipped bytes; other bytes as they are.

    path    they are from, for the message
    times   memory, in bytes, per byte of content, for larger data made from it
    Raises  ValueError if they are cut or damaged, or their content does not fit into memory.
    """
    pieces, size = list[bytes](), 0
    if data[:2] != b"\x1f\x8b":
        return data
    try:
        while data:
            stream = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)
            while not stream.eof:
                piece = stream.decompress(data, PIECE)
                data = stream.unconsumed_tail
                if not piece and not data and not stream.eof:
                    raise Refused(f"{path} must be a whole gzip file, got one that is cut")
                pieces.append(piece)
                size += len(piece)
                require_memory(size * times, f"{path}, unpacked,")
            data = stream.unused_data.lstrip(b"\0")  # a file may have several parts, and padding
    except zlib.error as error:
        raise Refused(f"{path} must be a whole gzip file, got: {error}") from None
    return b"".join(pieces)


CARD, MOST = 80, 999  # byte of a card; axes and columns, FITS 4.0
COUNTED = b"NAXIS", b"TFIELDS"
COUNT = re.compile(rb"(%b)\s*=\s*(\d+)" % b"|".join(COUNTED))


def require_fits(path: Path, data: bytes) -> None:
    """Refuse files that astropy would read for hours: more axes or columns than the standard's 999.

    Raises  ValueError, also if the bytes are not a FITS file.
    """
    if not data.startswith(b"SIMPLE"):  # nor a file that astropy would unpack without a limit
        raise Refused(f"{path} must be a whole FITS file, which begins with SIMPLE")
    for start in _counts(data):
        count = COUNT.match(data, start)
        if count and start % CARD == 0 and int(count[2][:9]) > MOST:
            raise Refused(
                f"{path} must be a whole FITS file, with {count[1].decode()} at most {MOST}, got "
                f"{count[2][:9].decode()}"
            )


def _counts(data: bytes) -> Iterator[int]:
    """Positions of keywords that state a count, or of equal text."""
    for keyword in COUNTED:
        at = data.find(keyword)
        while at >= 0:
            yield at
            at = data.find(keyword, at + 1)


def checked_arrays(
    path: Path, keyword: str, form: int, what: str, names: Iterable[str]
) -> tuple[Floats, ...]:
    """Arrays of a file, by the names of its parts; arguments and errors as `open_checked`."""
    with open_checked(path, keyword, form, what) as parts:
        return tuple(parts[name].data.astype(np.float64) for name in names)


@contextmanager
def open_checked(path: Path, keyword: str, form: int, what: str) -> Iterator[Any]:
    """The parts of a file, while it is open.

    keyword  of the first header, that names the format
    form     its value
    what     the expected kind of file, for the message
    Raises   FileNotFoundError; ValueError if it is something else, another format, or damaged.
    """
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyUserWarning

    try:
        data = read_bytes(path, what)
        require_fits(path, data)
        with warnings.catch_warnings():
            warnings.simplefilter("error", AstropyUserWarning)
            with fits.open(io.BytesIO(data), checksum=True, memmap=False) as parts:
                version = parts[0].header.get(keyword, "none")
                if version != form:
                    raise Refused(f"{path} must be {what} of format {form}, got {version}")
                yield parts
    except FileNotFoundError:
        raise
    except (OSError, AstropyUserWarning, KeyError, AttributeError, TypeError) as error:
        raise Refused(f"{path} must be {what}, whole, got: {error}") from error
