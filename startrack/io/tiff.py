"""Bytes of a TIFF -> its pixels, by tifffile."""

import io
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from startrack.core import Refused, require_memory
from startrack.io.pictures import PicturePixels
from startrack.io.text import first_line

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
ORIENTATION, CFA_SIZE, CFA_PATTERN = 274, 33421, 33422  # numbers of tags
ALPHA = (1, 2)  # kinds of extra samples, beside those that are not said (0)
CODECS = "imagecodecs"
MOST_PAGES = 65_535
# Without imagecodecs: what tifffile decodes by Python's own libraries, which unpack without a
# limit, and the most bytes that a byte of theirs becomes; source: zlib, zlib_tech.html.
DEFLATE, BY_TIFFFILE = 1032, ("ADOBE_DEFLATE", "DEFLATE")


def read_tiff(
    path: Path, data: bytes, plane: int | None, require: Callable[[Path, int, int, int], None]
) -> PicturePixels:
    """One image of a TIFF, of any layout that tifffile reads; bright is large.

    Smaller copies and masks of an image are no images. White that is zero becomes black; a palette
    its colours of 8 bits.

    plane    number of the image from 0; None: the first, and a warning where there are more
    require  refuses an image of (path, columns, rows, bytes of a pixel) that is too large
    Raises   Refused if the file is cut, damaged, has no such image, or has samples that are no
             light of a camera (CMYK, complex, more than three bands).
    """
    import tifffile

    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            page = _page(path, file, plane)
            columns = max(page.imagewidth, page.tilewidth)
            rows = max(page.imagelength, page.tilelength)
            pixel = page.samplesperpixel * -(-int(page.bitspersample) // 8)
            require(path, columns, rows, pixel)
            _refuse_layout(path, page, len(data))
            image = _decoded(path, page, data)
            return PicturePixels(
                _light(path, page, image), _orientation(page), _pattern(path, page)
            )
    except (MemoryError, Refused):
        raise
    except Exception as error:  # tifffile, its decoders and numpy each raise their own
        raise Refused(
            f"{path} must be a whole TIFF image, but it is cut or damaged: {first_line(error)}"
        ) from None


def _page(path: Path, file: Any, plane: int | None) -> Any:
    pages, places = list[Any](), set[int]()
    for page in file.pages:  # one by one: a list of all would have no end where they form a circle
        if page.offset in places or len(places) >= MOST_PAGES:
            raise Refused(f"{path} must hold at most {MOST_PAGES} pages, none of them twice")
        places.add(page.offset)
        if not (page.is_reduced or page.is_mask):
            pages.append(page)
    if not pages:
        raise Refused(f"{path} must hold an image, but it has none of full size")
    said = (file.imagej_metadata or {}).get("images", 1)
    count = max(len(pages), said if isinstance(said, int) else 1)
    if (plane or 0) >= len(pages):
        raise Refused(f"{path}: plane must lie in [0, {len(pages) - 1}], got {plane}")
    if plane is None and count > 1:
        warnings.warn(
            f"{path} holds {count} images; the first is read, others by the number of their plane",
            stacklevel=2,
        )
    return pages[plane or 0]


def _refuse_layout(path: Path, page: Any, size: int) -> None:
    import tifffile

    PHOTOMETRIC = tifffile.PHOTOMETRIC
    kinds = {
        PHOTOMETRIC.MINISWHITE,
        PHOTOMETRIC.MINISBLACK,
        PHOTOMETRIC.RGB,
        PHOTOMETRIC.PALETTE,
        PHOTOMETRIC.CFA,
        PHOTOMETRIC.LINEAR_RAW,
    }
    jpeg = page.compression in (tifffile.COMPRESSION.JPEG, tifffile.COMPRESSION.OJPEG)
    if page.photometric not in kinds and not (page.photometric == PHOTOMETRIC.YCBCR and jpeg):
        raise Refused(
            f"{path} must be an image of light: grey, RGB or a palette, got "
            f"{getattr(page.photometric, 'name', page.photometric)}"
        )
    if page.imagedepth != 1:
        raise Refused(f"{path} must be an image, got a volume of depth {page.imagedepth}")
    ends = zip(page.dataoffsets, page.databytecounts, strict=True)
    if not page.dataoffsets or any(
        not count or start + count > size for start, count in ends
    ):  # a part without bytes, which tifffile would fill with zeros, too
        raise Refused(f"{path} must be a whole TIFF image, but it is cut")


def _decoded(path: Path, page: Any, data: bytes) -> NDArray[Any]:
    """The samples (rows, columns, samples)."""
    import tifffile

    packed = page.compression != tifffile.COMPRESSION.NONE
    if not packed or find_spec(CODECS):
        image = np.asarray(page.asarray(maxworkers=1))
    elif page.compression.name in BY_TIFFFILE:
        require_memory(DEFLATE * max(page.databytecounts), f"{path}, unpacked,")
        image = np.asarray(page.asarray(maxworkers=1))
    else:
        image = _by_opencv(path, page, data)
    if page.samplesperpixel == 1:
        return image.reshape(page.imagelength, page.imagewidth, 1)
    if page.planarconfig == tifffile.PLANARCONFIG.SEPARATE:
        image = np.moveaxis(image, 0, -1)
    return image


def _by_opencv(path: Path, page: Any, data: bytes) -> NDArray[Any]:
    """An image of the compressions that tifffile has no decoder for by itself, such as LZW.

    Only of layouts that OpenCV keeps as they are.
    """
    import tifffile

    plain = (
        page.photometric in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB)
        and (page.samplesperpixel == 1 or page.planarconfig == tifffile.PLANARCONFIG.CONTIG)
        and page.samplesperpixel in (1, 3)
        and page.dtype in (np.uint8, np.uint16)
        and page.index == 0
    )
    image = None
    if plain:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != page.dtype:
        raise Refused(
            f"{path} is a TIFF of the compression {page.compression.name}, for which {CODECS} must "
            f"be installed: python -m pip install 'startrack[tiff]'"
        )
    return image if image.ndim == 2 else image[:, :, ::-1]


def _light(path: Path, page: Any, samples: NDArray[Any]) -> NDArray[Any]:
    """The image without alpha; bright is large."""
    import tifffile

    kind = page.photometric
    if samples.dtype.kind not in "uifb":
        raise Refused(f"{path} must have real pixels, got {samples.dtype}")
    if samples.dtype == bool:
        samples = samples.astype(np.uint8)
    if kind == tifffile.PHOTOMETRIC.PALETTE:
        if samples.shape[-1] != 1 or page.colormap is None:
            raise Refused(f"{path} must have one sample and a palette, got {samples.shape[-1]}")
        colours = np.asarray(page.colormap) >> 8
        return np.moveaxis(colours.astype(np.uint8)[:, samples[..., 0]], 0, -1)
    extra = tuple(int(sample) for sample in page.extrasamples)
    channels = samples.shape[-1] - len(extra)
    unsaid = [sample for sample in extra if sample not in ALPHA]
    if channels == 1 and unsaid:
        if len(extra) == 2 and len(unsaid) == 2:
            channels = 3  # planes of colours that a program did not name
        else:
            raise Refused(
                f"{path} must say what its samples are, got {samples.shape[-1]} samples of which "
                f"{len(unsaid)} are neither light nor alpha"
            )
    if channels not in (1, 3):
        raise Refused(f"{path} must have one channel of light or three, got {channels}")
    image = samples[..., :channels]
    if kind == tifffile.PHOTOMETRIC.MINISWHITE:
        if image.dtype.kind != "u":
            raise Refused(f"{path} must have unsigned pixels where zero is white")
        image = np.asarray((1 << int(page.bitspersample)) - 1, image.dtype) - image
    return image[..., 0] if channels == 1 else image


def _orientation(page: Any) -> int:
    tag = page.tags.get(ORIENTATION)
    return int(tag.value) if tag is not None and 1 <= int(tag.value) <= 8 else 1


def _pattern(path: Path, page: Any) -> str | None:
    """The Bayer pattern of a mosaic; source: TIFF/EP, ISO 12234-2, 5.2."""
    import tifffile

    if page.photometric != tifffile.PHOTOMETRIC.CFA:
        return None
    size, letters = page.tags.get(CFA_SIZE), page.tags.get(CFA_PATTERN)
    colours = bytes(letters.value) if letters is not None else b""
    if size is None or tuple(size.value) != (2, 2) or len(colours) != 4 or max(colours) > 2:
        raise Refused(f"{path} must be a mosaic of two by two red, green and blue pixels")
    return "".join("RGB"[colour] for colour in colours)
