"""Bytes of a PNG, JPEG or TIFF file -> columns, rows and bytes of a pixel, without decoding it."""

from __future__ import annotations

import struct
from typing import NamedTuple

TIFF_WIDTH, TIFF_LENGTH, TIFF_BITS, TIFF_SAMPLES = 256, 257, 258, 277
TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}
PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
# Start of frame, in all of its variants; 0xC4, 0xC8 and 0xCC are others.
JPEG_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


class PictureSize(NamedTuple):
    """Size of a picture as its header has it; bytes of one pixel, with all its channels."""

    columns: int
    rows: int
    pixel: int


def picture_size(data: bytes) -> PictureSize | None:
    """What the header says; None where it is cut or of another format.

    Source: PNG, ISO/IEC 15948, 11.2.2; JPEG, ITU-T T.81, B.2.2; TIFF 6.0, section 2, and BigTIFF.
    """
    try:
        if data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR":
            columns, rows, bits, colour = struct.unpack_from(">IIBB", data, 16)
            return PictureSize(columns, rows, PNG_CHANNELS.get(colour, 4) * max(bits // 8, 1))
        if data[:2] == b"\xff\xd8":
            return _jpeg(data)
        if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return _tiff(data)
    except (struct.error, IndexError):
        pass
    return None


def _jpeg(data: bytes) -> PictureSize | None:
    at = 2
    while at < len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:  # filling
            at += 1
            continue
        if marker in JPEG_FRAMES:
            rows, columns, channels = struct.unpack_from(">HHB", data, at + 5)
            return PictureSize(columns, rows, channels)
        alone = marker == 0x01 or 0xD0 <= marker <= 0xD8
        at += 2 if alone else 2 + struct.unpack_from(">H", data, at + 2)[0]
    return None


def _tiff(data: bytes) -> PictureSize | None:
    order = "<" if data[:1] == b"I" else ">"
    big = data[2:4] in (b"+\0", b"\0+")
    (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
    (count,) = struct.unpack_from(order + ("Q" if big else "H"), data, at)
    at += 8 if big else 2
    tags: dict[int, tuple[int, ...]] = {}
    for _ in range(min(count, 4096)):
        tag, kind, number = struct.unpack_from(order + ("HHQ" if big else "HHI"), data, at)
        code = TIFF_TYPES.get(kind)
        if code and tag in (TIFF_WIDTH, TIFF_LENGTH, TIFF_BITS, TIFF_SAMPLES) and 0 < number < 256:
            form, place = f"{order}{number}{code}", at + (12 if big else 8)
            if struct.calcsize(form) > (8 if big else 4):
                (place,) = struct.unpack_from(order + ("Q" if big else "I"), data, place)
            tags[tag] = struct.unpack_from(form, data, place)
        at += 20 if big else 12
    if TIFF_WIDTH not in tags or TIFF_LENGTH not in tags:
        return None
    bits, samples = tags.get(TIFF_BITS, (1,)), tags.get(TIFF_SAMPLES, (1,))[0]
    return PictureSize(tags[TIFF_WIDTH][0], tags[TIFF_LENGTH][0], samples * -(-max(bits) // 8))
