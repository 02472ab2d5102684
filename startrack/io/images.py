"""Image files to frames, and frames to FITS with their WCS and their truth."""

import importlib
import io
import math
import warnings
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Frame, Refused, Stars, require_memory
from startrack.io import recordings
from startrack.io.reading import picture_size, read_bytes, require_fits, unpacked
from startrack.io.recordings import Layout
from startrack.io.saving import whole
from startrack.io.wcs import wcs_header

FITS = {".fits", ".fit", ".fts"}
# Tags of EXIF, and the diagonal (mm) of the film that its 35 mm equivalent is for.
EXIF_IFD, FOCAL_LENGTH, FOCAL_35MM, EXIF_WIDTH, EXIF_HEIGHT = 0x8769, 0x920A, 0xA405, 0xA002, 0xA003
PLANE_RESOLUTION, PLANE_UNIT, FULL_FRAME = 0xA20E, 0xA210, math.hypot(36, 24)
HEIF_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1"}
DATES = "DATE-OBS", "DATE-BEG", "DATE-AVG"
# Days of 2000-01-01T00:00 by each keyword.
JULIAN = {"MJD-OBS": 51544.0, "MJD-BEG": 51544.0, "MJD-AVG": 51544.0, "JD": 2451544.5}
DAY = 86400.0  # second
SEARCHED = 24  # bytes that the detection takes for each pixel of an image; measured: 20 at most


def read_image(path: Path, layout: Layout | None = None) -> Frame:
    """Read a FITS, TIFF, PNG, JPEG, HEIC, SER, raw or video file as one frame.

    Of a colour image the largest of the three channels is taken, because a star is bright in
    at least one. A mosaic of colours, which the layout or the header (BAYERPAT of FITS, ColorID of
    SER) names, becomes an image of half the size. What the file does not say of its detector stays
    NaN.

    layout  what the file may not say of itself
    Raises  ValueError, in one sentence with the path, where the file is missing, empty, cut, no
            image, or holds no finite number.
    """
    path, layout = Path(path), layout or Layout()
    try:
        if layout.raw or path.suffix.lower() == ".ser":
            image, said, time = recordings.read_recording(path, layout)
            return Frame(layout.one_image(path, image, said), time=time)
        if path.suffix.lower() in recordings.VIDEOS:
            return Frame(layout.one_image(path, recordings.read_video(path, layout.plane), None))
        data = read_bytes(path, "a file")
    except FileNotFoundError as error:
        raise ValueError(str(error)) from None
    if not data:
        raise ValueError(f"{path} must hold an image, but it is empty")
    if FITS & {suffix.lower() for suffix in path.suffixes}:
        frame = _read_fits(path, data, layout)
    else:
        if layout.plane:
            raise ValueError(
                f"{path} must be a FITS cube, a SER or a video to have the plane {layout.plane}"
            )
        mosaic = layout.bayer not in (None, "none")
        frame = Frame(layout.one_image(path, _read_picture(path, data, mosaic), None))
    if frame.image.size == 0 or not np.isfinite(frame.image).any():
        raise ValueError(f"{path} must hold finite pixel values, but it has none")
    return frame


def read_frames(path: Path, layout: Layout) -> Iterator[Frame]:
    """The frames of a file, one after the other: all of a SER, raw or video file, one of others.

    layout  where it names a plane, that one alone
    Raises  as `read_image`.
    """
    kind = path.suffix.lower()
    if layout.plane is None and (layout.raw or kind == ".ser"):
        for plane in range(recordings.frames_in(path, layout)):
            yield read_image(path, replace(layout, plane=plane))
    elif layout.plane is None and kind in recordings.VIDEOS:
        for image in recordings.video_frames(path):
            yield Frame(layout.one_image(path, image, None))
    else:
        yield read_image(path, layout)


def field_hint(path: Path, shape: tuple[int, ...]) -> float | None:
    """Field of view across the columns, radian, by the file's EXIF; None where it says none.

        tan(field / 2) = columns / 2 / f,   f = FocalLengthIn35mmFilm / 43.27 mm * diagonal

    or the focal length in pixels, by FocalLength and FocalPlaneXResolution. A crop of an image
    keeps the focal length of all of it, and zoom by the software may be in it or not.

    Source: CIPA DC-008 (Exif 3.0), tags 0xA405, 0x920A, 0xA20E, 0xA210 and 0xA002; the diagonal is
    that of 36 x 24 mm.

    shape  rows and columns as read
    """
    from PIL import Image

    try:
        data = path.read_bytes()
        if _is_heif(data):
            exif = Image.Exif()
            exif.load(_open_heif(path, data).info.get("exif") or b"")
        else:
            with Image.open(io.BytesIO(data)) as image:
                exif = image.getexif()
        tags = exif.get_ifd(EXIF_IFD)
    except Exception:  # no picture that Pillow knows, or damaged tags: no hint
        return None

    def number(tag: int) -> float:
        try:
            return float(tags.get(tag, 0))
        except (TypeError, ValueError, ZeroDivisionError):
            return 0.0

    rows, columns = shape
    focal = number(FOCAL_35MM) / FULL_FRAME * math.hypot(rows, columns)
    unit = {2: 25.4, 3: 10.0, 4: 1.0}.get(int(number(PLANE_UNIT)), 25.4)
    if not focal > 0 and number(EXIF_WIDTH) > 0:
        scale = max(rows, columns) / max(number(EXIF_WIDTH), number(EXIF_HEIGHT))
        focal = number(FOCAL_LENGTH) * number(PLANE_RESOLUTION) / unit * scale
    if not 0.1 * columns < focal < 100 * columns:
        return None
    return 2 * math.atan(columns / 2 / focal)


def require_image_memory(path: Path, columns: int, rows: int, pixel: int) -> None:
    """Refuse an image that cannot be read and searched within the memory that there may be.

    pixel   bytes of a pixel in the file
    Raises  ValueError with the size and the limit.
    """
    require_memory(
        columns * rows * (2 * pixel + SEARCHED), f"{path}, an image of {columns} x {rows} pixels,"
    )


def write_fits(
    path: Path, frame: Frame, camera: Camera | None, icrs_to_camera: Rotation,
    stars: Stars | None = None, history: str = "", begun: datetime | None = None,
) -> None:  # fmt: skip
    """Save a frame with the WCS of its true attitude, and its stars as the table TRUTH.

    begun   start of the exposure, as DATE-OBS; None: not known, and not written

    An image without a camera, such as that of lines that scan, gets neither.

    Pixel columns of the table count from (0, 0); the WCS, as FITS asks, from (1, 1).
    """
    from astropy.io import fits

    header = wcs_header(camera, icrs_to_camera) if camera else None
    primary = fits.PrimaryHDU(frame.image, header)
    cards = primary.header
    quaternion = icrs_to_camera.as_quat(canonical=True)
    for axis, value in zip("XYZW", quaternion, strict=True):
        cards[f"QUAT_{axis}"] = (float(value), "ICRS to camera, scalar last")
    numbers = {
        "EXPTIME": (frame.exposure, "[s] exposure"),
        "GAIN": (frame.electrons_per_dn, "[electron/DN]"),
        "RDNOISE": (frame.read_noise, "[electron] rms"),
        "PEDESTAL": (frame.offset, "[DN] of an empty pixel"),
    }
    if begun is not None:
        cards["TIMESYS"] = ("UTC", "of DATE-OBS")
        cards["DATE-OBS"] = (date_text(begun), "start of the exposure")
    for name, (number, comment) in numbers.items():
        if np.isfinite(number):
            cards[name] = (number, comment)
    for line in history.splitlines():
        cards["HISTORY"] = line
    tables = [_truth(camera, icrs_to_camera, stars)] if camera and stars else []
    with whole(path) as draft:
        parts = fits.HDUList([primary, *tables])
        for part in parts:
            # astropy's own comment is the time of writing: equal frames would be unequal files.
            part.add_checksum(when="of this header and its data")
        parts.writeto(draft)


def date_text(date: datetime) -> str:
    """A date as FITS has it, UTC, to the microsecond."""
    return date.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")


def _truth(camera: Camera, icrs_to_camera: Rotation, stars: Stars):  # type: ignore[no-untyped-def]
    from astropy.io import fits

    pixel = camera.project(icrs_to_camera.apply(stars.direction))
    inside = camera.holds(pixel)
    stars, (x, y) = stars[inside], pixel[inside].T
    ra = np.degrees(np.arctan2(stars.direction[:, 1], stars.direction[:, 0])) % 360
    dec = np.degrees(np.arcsin(np.clip(stars.direction[:, 2], -1, 1)))
    columns = {
        "X": ("pixel", x), "Y": ("pixel", y), "RA": ("deg", ra), "DEC": ("deg", dec),
        "G": ("mag", stars.magnitude_g), "BP_RP": ("mag", stars.colour),
    }  # fmt: skip
    return fits.BinTableHDU.from_columns(
        [
            fits.Column("IDENTIFIER", "K", array=stars.identifier),
            *(fits.Column(name, "D", unit=unit, array=a) for name, (unit, a) in columns.items()),
        ],
        name="TRUTH",
    )


def _read_fits(path: Path, data: bytes, layout: Layout) -> Frame:
    from astropy.io import fits

    data = unpacked(path, data, 2)
    require_fits(path, data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a cut file is only a warning to astropy
            # From memory: astropy leaves a cut file open when it gives up.
            with fits.open(io.BytesIO(data)) as units:
                unit = next(
                    unit for unit in units if unit.is_image and unit.header.get("NAXIS", 0) >= 2
                )
                _require_fits_memory(path, unit.header)
                image, header = np.asarray(unit.data), unit.header
                numbers = [_number(header, key) for key in ("EXPTIME", "GAIN", "RDNOISE")]
                offset = _number(header, "PEDESTAL", 0.0)
                said, time = _pattern(header), _time(header)
    except StopIteration:
        raise ValueError(f"{path} must hold an image of two axes, but it has none") from None
    except (MemoryError, Refused):
        raise
    except Exception as error:  # astropy, zlib and CFITSIO each raise their own
        reason = " ".join(str(error).split()) or type(error).__name__
        missing = f"it has no {reason}" if isinstance(error, KeyError) else reason
        raise ValueError(f"{path} must be a whole FITS file: {missing}") from None
    image = np.squeeze(image)
    if image.ndim == 3:
        planes = len(image)
        if (layout.plane or 0) >= planes:
            raise ValueError(f"{path}: plane must lie in [0, {planes - 1}], got {layout.plane}")
        if layout.plane is None:
            image, said = image.max(axis=0), None  # planes of colours are no mosaic
        else:
            image = image[layout.plane]
    elif layout.plane:
        raise ValueError(f"{path} must be a cube to have the plane {layout.plane}")
    if image.ndim != 2:
        raise ValueError(f"{path} must hold an image of two axes, got shape {image.shape}")
    image = layout.one_image(path, image.astype(image.dtype.newbyteorder("=")), said)
    return Frame(image, numbers[0], numbers[1], offset, numbers[2], time)


def _time(header) -> float:  # type: ignore[no-untyped-def]
    """Second since 2000 by the first of the date's keywords; NaN without one, or without an hour.

    Source: FITS standard 4.0, section 9.5; TIME-OBS is of before 2000.
    """
    for key in DATES:
        date = str(header.get(key, "")).strip().removesuffix("Z")
        if "T" not in date:
            date = f"{date}T{str(header.get('TIME-OBS', '')).strip()}"
        try:
            since = datetime.fromisoformat(date) - recordings.YEAR_2000
        except (ValueError, TypeError):  # no such date; one with a zone
            continue
        return since.total_seconds()
    days = [_number(header, key) - zero for key, zero in JULIAN.items()]
    return DAY * next((day for day in days if math.isfinite(day)), math.nan)


def _pattern(header) -> str | None:  # type: ignore[no-untyped-def]
    """The Bayer pattern of a header, shifted by the offsets of the image in the detector."""
    said = header.get("BAYERPAT") or header.get("COLORTYP")
    if not isinstance(said, str) or len(said.strip()) != 4:
        return None
    pattern = said.strip().upper()
    shift_x, shift_y = (_number(header, key, 0.0) % 2 >= 1 for key in ("XBAYROFF", "YBAYROFF"))
    rows = [pattern[:2], pattern[2:]][:: -1 if shift_y else 1]
    return "".join(row[:: -1 if shift_x else 1] for row in rows)


def _require_fits_memory(path: Path, header) -> None:  # type: ignore[no-untyped-def]
    axes = [header.get(f"NAXIS{n}", 0) for n in range(1, header["NAXIS"] + 1)]
    sizes = [size if isinstance(size, int) and size >= 0 else 0 for size in axes]
    bits = header.get("BITPIX", 8)
    pixel = abs(bits) // 8 if isinstance(bits, int) else 8
    require_image_memory(path, sizes[0], math.prod(sizes[1:]), pixel)


def _number(header, key: str, otherwise: float = float("nan")) -> float:  # type: ignore[no-untyped-def]
    value = header.get(key, otherwise)
    return float(value) if isinstance(value, int | float) else otherwise


def _is_heif(data: bytes) -> bool:
    """Whether this is a file of the High Efficiency Image Format, as phones write them.

    Source: ISO/IEC 23008-12, section 10.2, brands.
    """
    return data[4:8] == b"ftyp" and data[8:12] in HEIF_BRANDS


def _open_heif(path: Path, data: bytes) -> Any:
    """The file as pillow-heif opens it, not yet decoded."""
    try:
        heif = importlib.import_module("pillow_heif")
    except ImportError:
        raise ValueError(
            f"{path} is an image of HEIC, for which pillow-heif must be installed: python -m pip "
            "install pillow-heif"
        ) from None
    try:
        return heif.open_heif(io.BytesIO(data))
    except Exception as error:  # libheif raises its own
        raise ValueError(f"{path} must be a whole HEIC image: {error}") from None


def _read_picture(path: Path, data: bytes, mosaic: bool = False) -> np.ndarray:
    """The pixels; a mosaic that was saved in three equal channels is one of these."""
    if _is_heif(data):
        heif = _open_heif(path, data)
        columns, rows = heif.size
        require_image_memory(path, columns, rows, 3)
        try:
            colours = np.asarray(heif)
        except Exception as error:
            raise ValueError(f"{path} must be a whole HEIC image: {error}") from None
        return colours if colours.ndim == 2 else colours[:, :, :3].max(axis=2)
    size = picture_size(data)
    if size is None:
        raise ValueError(f"{path} must be a whole FITS, TIFF, PNG or JPEG image")
    require_image_memory(path, *size)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{path} must be readable as an image: {reason}") from None
    if image is None:
        raise ValueError(f"{path} must be a whole FITS, TIFF, PNG or JPEG image")
    if mosaic and image.ndim == 3 and (image[:, :, :3] != image[:, :, :1]).any():
        raise ValueError(f"{path} must have one channel to be a mosaic of colours, got three")
    return image if image.ndim == 2 else image[:, :, :3].max(axis=2)
