"""SER, raw and video files -> images; Bayer mosaics -> images of one colour or of all.

SER is a format of amateur astronomy cameras: a header of 178 bytes, frames, and a time for each.
Source: Heiko Wilkens and Grischa Hahn, SER format description, version 3 (2014).
"""

import math
import os
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    Parameters,
    Range,
    Refused,
    Singles,
    one_of,
    parameter,
    require_memory,
    whole,
)
from startrack.io.reading import regular_file

PATTERNS = ("RGGB", "GRBG", "GBRG", "BGGR")
COLOURS = ("superpixel", "red", "green", "blue")
RAW_TYPES = ("uint8", "uint16", "uint16be", "float32")
VIDEOS = (".mkv", ".avi", ".mp4", ".mov")
# Begin of the files of each format, so that no playlist opens other files.
VIDEO_MAGIC = ((0, b"\x1a\x45\xdf\xa3"), (8, b"AVI "), (4, b"ftyp"))
FFMPEG_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
VIDEO_GREY = (b"Y800", b"Y1\x00\x10")  # FFmpeg's names of 8 and 16 bits
SER_HEADER = struct.Struct("<14s7i40s40s40s2q")
SER_MAGIC = b"LUCAM-RECORDER"
SER_PATTERNS = dict(zip((8, 9, 10, 11), PATTERNS, strict=True))
SER_RGB = (100, 101)
SER_TICKS = 10**7  # in a second
YEAR_1, YEAR_2000 = datetime(1, 1, 1), datetime(2000, 1, 1)


class Layout(Parameters):
    """Layout of an image file, for files that do not state it.

    plane   number from 0 of the plane of a cube or a SER; None: the largest value of all planes of
            a cube, the first frame of a SER
    bayer   pattern of the colours of the first two pixels of the first two rows, such as "RGGB";
            None: that of the file's header, if it has one; "none": no pattern, in spite of the
            header
    colour  conversion of a mosaic: "superpixel", the mean of each two by two pixels; "red", "green"
            or "blue", these pixels alone; an image of half as many columns and rows
    raw     "COLUMNSxROWS:TYPE" of a file without a header, with a type of RAW_TYPES
    extension  name of an image of a FITS file, or its number, 0 for the primary; None: SCI or the
               first of the largest
    """

    plane: int | None = parameter(limit=Range(0, 2**31), default=None)
    bayer: str | None = parameter(limit=Range(choices=(*PATTERNS, "none")), default=None)
    colour: str = parameter(limit=Range(choices=COLOURS), default="superpixel")
    raw: str | None = None
    extension: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.raw is not None:
            _raw_shape(self.raw)

    def one_image(self, path: Path, image: NDArray[Any], said: str | None) -> NDArray[Any]:
        """The converted image of a mosaic; other images are unchanged.

        Warns where the header alone says that it is a mosaic: places then count pixels of twice
        the size.

        said  pattern that the header of the file names, None without a pattern
        """
        pattern = said if self.bayer is None else self.bayer
        if pattern in (None, "none"):
            return image
        if pattern not in PATTERNS:
            raise Refused(
                f"{path}: Bayer pattern must be one of {', '.join(PATTERNS)}, got {pattern!r}"
            )
        if self.bayer is None and self.colour == "superpixel":
            # Without the path: once for all files of a series.
            warnings.warn(
                f"mosaic of colours ({pattern}): each two by two pixels become one, which places "
                f"and sizes count; --bayer none reads all pixels",
                stacklevel=3,
            )
        return debayer(image, pattern, self.colour)


def debayer(image: NDArray[Any], pattern: str, colour: str) -> Singles:
    """A mosaic (rows, columns) as an image of half the size.

    Accuracy  a star's flux is the sum over its pixels of the chosen colours; of "red" or "blue" a
              quarter of the area is sampled, so that sharp stars' centroids are worse.
    """
    one_of(PATTERNS, pattern=pattern)
    one_of(COLOURS, colour=colour)
    rows, columns = (size // 2 * 2 for size in image.shape)
    if min(rows, columns) < 2:
        raise Refused(f"a mosaic must have two rows and columns, got shape {image.shape}")
    cells = [image[k // 2 : rows : 2, k % 2 : columns : 2] for k in range(4)]
    letters = "RGB" if colour == "superpixel" else colour[0].upper()
    chosen = [cell for cell, letter in zip(cells, pattern, strict=True) if letter in letters]
    total = np.zeros(cells[0].shape, np.float32)
    for cell in chosen:
        total += cell
    return total / np.float32(len(chosen))


def _raw_shape(text: str) -> tuple[int, int, str]:
    """Rows, columns and type of "COLUMNSxROWS:TYPE"."""
    size, _, kind = text.partition(":")
    columns, _, rows = size.partition("x")
    kind = kind or "uint16"
    if kind not in RAW_TYPES or not (columns.isdecimal() and rows.isdecimal()):
        raise Refused(
            f"raw must be COLUMNSxROWS:TYPE with a type of {', '.join(RAW_TYPES)}, such as "
            f"1024x768:uint16, got {text!r}"
        )
    whole(1, 2**16, **{"columns of raw": int(columns), "rows of raw": int(rows)})
    return int(rows), int(columns), kind


class _Recording(NamedTuple):
    """Frames of one size in a file; the byte where the first begins, and bytes of one."""

    pattern: str | None
    form: np.dtype[Any]
    shape: tuple[int, ...]
    frames: int
    start: int

    @property
    def size(self) -> int:
        return math.prod(self.shape) * self.form.itemsize


def _recording(path: Path, layout: Layout) -> _Recording:
    """Layout that the header of a SER states, or the given one for a file without a header."""
    if not layout.raw:
        return _ser_header(regular_file(path))
    rows, columns, kind = _raw_shape(layout.raw)
    form = np.dtype(kind.removesuffix("be")).newbyteorder(">" if kind.endswith("be") else "<")
    size, total = rows * columns * form.itemsize, os.stat(regular_file(path, "an image")).st_size
    if total == 0 or total % size:
        raise Refused(
            f"{path} must hold whole frames of {size} bytes for {layout.raw}, got {total} bytes"
        )
    return _Recording(None, form, (rows, columns), total // size, 0)


def _ser_header(path: Path) -> _Recording:
    """Pixels of 16 bits are little-endian where LittleEndian is 0, as programs have it; the
    description says the opposite.
    """
    total = os.stat(path).st_size
    with path.open("rb") as file:
        head = file.read(SER_HEADER.size)
    if len(head) < SER_HEADER.size or not head.startswith(SER_MAGIC):
        raise Refused(f"{path} must be a whole SER file")
    _, _, kind, big, columns, rows, depth, count, *_ = SER_HEADER.unpack(head)
    if not (0 < columns <= 2**16 and 0 < rows <= 2**16 and 1 <= depth <= 16 and count > 0):
        raise Refused(
            f"{path} must hold frames of 1 to 16 bits, got {count} of {columns} x {rows} "
            f"pixels of {depth} bits"
        )
    if kind != 0 and kind not in SER_PATTERNS and kind not in SER_RGB:
        raise Refused(f"{path}: colour must be mono, Bayer or RGB, got number {kind}")
    form = np.dtype("u1" if depth <= 8 else ">u2" if big else "<u2")
    shape = (rows, columns, 3) if kind in SER_RGB else (rows, columns)
    header = _Recording(SER_PATTERNS.get(kind), form, shape, count, SER_HEADER.size)
    if total < SER_HEADER.size + count * header.size:
        raise Refused(f"{path} must hold {count} frames of {header.size} bytes, but it is cut")
    return header


def read_recording(path: Path, layout: Layout) -> tuple[NDArray[Any], str | None, float]:
    """One frame of a SER or raw file, its Bayer pattern, and its time as a `Frame` has it.

    Raises  ValueError if the file is cut, no SER or not of whole frames, or has no such frame.
    """
    header, at = _recording(path, layout), layout.plane or 0
    if at >= header.frames:
        raise Refused(f"{path}: plane must lie in [0, {header.frames - 1}], got {layout.plane}")
    require_memory(header.size, f"{path}, an image of shape {header.shape},")
    with path.open("rb") as file:
        file.seek(header.start + at * header.size)
        data = file.read(header.size)
        file.seek(header.start + header.frames * header.size + 8 * at)
        stamp = file.read(8)
    if len(data) < header.size:
        raise Refused(f"{path} must hold all of its frames, but it is cut")
    ticks = struct.unpack("<q", stamp)[0] if len(stamp) == 8 else 0
    since = ticks - int((YEAR_2000 - YEAR_1).total_seconds()) * SER_TICKS
    image = np.frombuffer(data, header.form).reshape(header.shape)
    image = image.astype(header.form.newbyteorder("="))
    image = image.max(axis=2) if image.ndim == 3 else image
    return image, header.pattern, since / SER_TICKS if ticks > 0 else math.nan


def frames_in(path: Path, layout: Layout) -> int:
    """Number of frames of a SER or raw file; for a video about the number in its header, for others
    1."""
    if layout.raw or path.suffix.lower() == ".ser":
        return _recording(path, layout).frames
    if path.suffix.lower() not in VIDEOS:
        return 1
    with _open_video(path) as video:
        return max(int(video.get(cv2.CAP_PROP_FRAME_COUNT)), 1)


def read_video(path: Path, plane: int | None) -> NDArray[Any]:
    """One frame of a video, by the decoders of FFmpeg in OpenCV.

    Grey pixels stay as they are, 16 bits too (FFV1 in Matroska, as `sequence --frames mkv` writes
    it); of colours of 8 bits the largest channel is taken.

    Raises  ValueError if the file is not Matroska, AVI, MP4 or MOV, cannot be decoded, or has no
            such frame.
    """
    with _open_video(path) as video:
        grabbed = all(video.grab() for _ in range((plane or 0) + 1))
        image = _retrieved(video) if grabbed else None
    if image is None:
        raise Refused(f"{path} must hold a frame {plane or 0} that can be decoded")
    return image


def video_frames(path: Path) -> Iterator[NDArray[Any]]:
    """All frames of a video, each as `read_video`; raises as `read_video` without a frame."""
    yield read_video(path, 0)
    with _open_video(path) as video:
        video.grab()
        while video.grab() and (image := _retrieved(video)) is not None:
            yield image


@contextmanager
def _open_video(path: Path) -> Iterator[cv2.VideoCapture]:
    with regular_file(path).open("rb") as file:
        head = file.read(12)
    if not any(head[at:].startswith(magic) for at, magic in VIDEO_MAGIC):
        raise Refused(f"{path} must be a Matroska, AVI, MP4 or MOV video")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # the errors of the callers say it
    # FFmpeg tells formats by their content: those that name other files or addresses, such as
    # playlists and session descriptions, are none that it may take, and no protocol but of files.
    before = os.environ.get(FFMPEG_OPTIONS)
    os.environ[FFMPEG_OPTIONS] = "protocol_whitelist;file|format_whitelist;matroska,avi,mov"
    try:
        video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    finally:
        os.environ.pop(FFMPEG_OPTIONS)
        if before is not None:
            os.environ[FFMPEG_OPTIONS] = before
    try:
        if not video.isOpened():
            raise Refused(f"{path} must hold a frame 0 that can be decoded")
        sides = cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH
        rows, columns = (int(video.get(side)) for side in sides)
        require_memory(12.0 * rows * columns, f"{path}, a video of {columns} x {rows} pixels,")
        form = int(video.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)).to_bytes(8, "little", signed=True)
        video.set(cv2.CAP_PROP_CONVERT_RGB, 0 if form[:4] in VIDEO_GREY else 1)
        yield video
    except cv2.error:
        raise Refused(f"{path} must hold frames that can be decoded") from None
    finally:
        video.release()


def _retrieved(video: cv2.VideoCapture) -> NDArray[Any] | None:
    """The frame that was grabbed, of one channel; None where it cannot be decoded."""
    decoded, image = video.retrieve()
    if not decoded or image is None or image.size == 0:
        return None
    return np.asarray(image.max(axis=2) if image.ndim == 3 else image)
