"""Path of a file from anybody -> its bytes, where it is a regular file of no more than a size."""

from __future__ import annotations

import os
import stat
import zlib
from pathlib import Path

from startrack.core import require_memory

MIB = 2**20  # byte
PIECE = 4 * MIB  # bytes that are unpacked at a time


def regular_file(path: Path, what: str = "a file") -> Path:
    """The path, where it names a regular file; it is not opened, since a FIFO would wait.

    what    it must be, for the message
    Raises  ValueError for a folder, a device, a FIFO or a socket; FileNotFoundError without one.
    """
    try:
        kind = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"{path} must be {what}, but there is none") from None
    except ValueError as error:  # a zero byte in the name
        raise ValueError(f"{str(path)!r} must be the name of a file: {error}") from None
    if not stat.S_ISREG(kind):
        raise ValueError(f"{path} must be {what}, but is {_kind(kind)}")
    return path


def _kind(mode: int) -> str:
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
    Raises  ValueError where it is larger, or as `regular_file`; OSError where it cannot be read.
    """
    size = os.stat(regular_file(path, what)).st_size
    if most is not None and size > most:
        raise ValueError(f"{path} must be {what} of at most {most} bytes, got {size}")
    require_memory(size, f"{path}, {what},")
    with open(path, "rb") as file:
        data = file.read(size + 1)
    if len(data) > size:  # it grows, or the system does not tell its size, as in /proc
        raise ValueError(f"{path} must be {what} of {size} bytes, but has more")
    return data


def unpacked(path: Path, data: bytes, times: int = 1) -> bytes:
    """The content of gzipped bytes; other bytes as they are.

    path    they are from, for the message
    times   the bytes that are needed for a byte of content: what is made of it is larger
    Raises  ValueError where they are cut or damaged, or their content does not fit into memory.
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
                    raise ValueError(f"{path} must be a whole gzip file, got one that is cut")
                pieces.append(piece)
                size += len(piece)
                require_memory(size * times, f"{path}, unpacked,")
            data = stream.unused_data.lstrip(b"\0")  # a file may have several parts, and padding
    except zlib.error as error:
        raise ValueError(f"{path} must be a whole gzip file, got: {error}") from None
    return b"".join(pieces)
