"""Bytes of a PNG, JPEG, BMP or HEIC -> its pixels, by Pillow; turned as their orientation says."""

import importlib
import io
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack.core import Refused
from startrack.io.saving import FIGURE
from startrack.io.text import first_line

PNG, JPEG, BMP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM"
# Where a PNG has its columns and rows, its bits a sample, and its kind of colour.
PNG_SIZE, PNG_BITS, PNG_COLOUR = 16, 24, 25
GREY_PNG = 0
ORIENTATION = 0x0112  # tag of EXIF
HEIF_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1"}


class PicturePixels(NamedTuple):
    """An image of a file.

    image        (rows, columns) or (rows, columns, channels) of light, without alpha
    orientation  number of EXIF, 1 to 8
    pattern      of a mosaic of colours, such as "RGGB"
    """

    image: NDArray[Any]
    orientation: int = 1
    pattern: str | None = None


def turned(image: NDArray[Any], orientation: int) -> NDArray[Any]:
    """An image (rows, columns, ...) as it is to be seen; source: CIPA DC-008 (Exif), tag 0x0112.

    orientation  1 to 8: where the first row and the first column of the file are seen
    """
    if orientation in (5, 6, 7, 8):
        image = image.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return np.ascontiguousarray(image)


def is_picture(data: bytes) -> bool:
    """Whether these are the bytes of a PNG, JPEG, BMP or HEIC."""
    return data.startswith((PNG, JPEG, BMP)) or is_heif(data)


def open_picture(path: Path, data: bytes) -> Any:
    """The file as Pillow opens it, not yet decoded.

    Not by `Image.open`, which warns of large images and looks at other formats.
    """
    from PIL.BmpImagePlugin import BmpImageFile
    from PIL.JpegImagePlugin import JpegImageFile
    from PIL.PngImagePlugin import PngImageFile

    files: dict[bytes, Any] = {PNG: PngImageFile, JPEG: JpegImageFile, BMP: BmpImageFile}
    opened = next(file for magic, file in files.items() if data.startswith(magic))
    try:
        return opened(io.BytesIO(data))
    except Exception as error:  # Pillow's parts raise their own
        raise Refused(
            f"{path} must be a whole PNG, JPEG or BMP image: {first_line(error)}"
        ) from None


def read_picture(
    path: Path, data: bytes, require: Callable[[Path, int, int, int], None]
) -> PicturePixels:
    """The pixels of a PNG, JPEG, BMP or HEIC, 16 bits as 16 bits.

    require  refuses an image of (path, columns, rows, bytes of a pixel) that is too large
    Raises   Refused if the file is incomplete, damaged, or has colours that no camera gives.
    """
    if is_heif(data):
        return _read_heif(path, data, require)
    wide = False
    if data.startswith(PNG) and len(data) > PNG_COLOUR:  # the size is known before the rest is
        wide = data[PNG_BITS] == 16 and data[PNG_COLOUR] != GREY_PNG
        columns, rows = struct.unpack_from(">II", data, PNG_SIZE)
        require(path, columns, rows, 8 if wide else 2)
    picture = open_picture(path, data)
    columns, rows = picture.size
    require(path, columns, rows, 8 if wide else 4)
    if picture.info.get("Software") == FIGURE:
        raise Refused(
            f"{path} must be an image of a camera, but it is a figure with axes and markers; the "
            "pixels are in frame.fits, and in pixels.png of `simulate --pixels png`"
        )
    if picture.mode not in ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "RGBX", "I;16", "I", "CMYK"):
        raise Refused(f"{path} must be an image of grey or RGB, got {picture.mode}")
    try:
        orientation = int(picture.getexif().get(ORIENTATION, 1))
    except Exception:  # damaged tags are no orientation
        orientation = 1
    try:
        if wide:  # which Pillow would make 8 bits of
            open_picture(path, data).verify()
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            if image is None:
                raise ValueError("its pixels cannot be decoded")
        else:
            paint = picture.mode in ("P", "PA", "CMYK")
            image = np.asarray(picture.convert("RGB") if paint else picture)
    except MemoryError:
        raise
    except Exception as error:  # Pillow, its decoders and OpenCV each raise their own
        raise Refused(
            f"{path} must be a whole PNG, JPEG or BMP image: {first_line(error)}"
        ) from None
    if image.dtype == bool:
        image = image.astype(np.uint8) * np.uint8(255)
    if image.ndim == 3:
        image = image[..., :3] if image.shape[-1] > 2 else image[..., 0]
    return PicturePixels(image, orientation if 1 <= orientation <= 8 else 1)


def is_heif(data: bytes) -> bool:
    """Whether this is a file of the High Efficiency Image Format, as phones write them.

    Source: ISO/IEC 23008-12, section 10.2, brands.
    """
    return data[4:8] == b"ftyp" and data[8:12] in HEIF_BRANDS


def open_heif(path: Path, data: bytes) -> Any:
    """The file as pillow-heif opens it, not yet decoded."""
    try:
        heif = importlib.import_module("pillow_heif")
    except ImportError:
        raise Refused(
            f"{path} is an image of HEIC, for which pillow-heif must be installed: python -m pip "
            "install pillow-heif"
        ) from None
    try:
        return heif.open_heif(io.BytesIO(data))
    except Exception as error:  # libheif raises its own
        raise Refused(f"{path} must be a whole HEIC image: {first_line(error)}") from None


def _read_heif(
    path: Path, data: bytes, require: Callable[[Path, int, int, int], None]
) -> PicturePixels:
    """Pixels of an HEIC image; its decoder has turned the image already."""
    heif = open_heif(path, data)
    columns, rows = heif.size
    require(path, columns, rows, 3)
    try:
        colours = np.asarray(heif)
    except Exception as error:
        raise Refused(f"{path} must be a whole HEIC image: {first_line(error)}") from None
    return PicturePixels(colours if colours.ndim == 2 else colours[..., :3])
