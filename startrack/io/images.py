"""Image files to frames, and frames to FITS with their WCS and their truth."""

import io
import math
import warnings
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Frame, Refused, Stars, require_memory
from startrack.io import recordings, tiff
from startrack.io.fits_image import EXCESS, read_fits
from startrack.io.pictures import is_heif, is_picture, open_heif, open_picture, read_picture, turned
from startrack.io.reading import CARD, read_bytes, unpacked
from startrack.io.recordings import Layout
from startrack.io.saving import whole
from startrack.io.wcs import wcs_header

FITS = {".fits", ".fit", ".fts"}
# Tags of EXIF, and the diagonal (mm) of the film that its 35 mm equivalent is for.
EXIF_IFD, FOCAL_LENGTH, FOCAL_35MM, EXIF_WIDTH, EXIF_HEIGHT = 0x8769, 0x920A, 0xA405, 0xA002, 0xA003
PLANE_RESOLUTION, PLANE_UNIT, FULL_FRAME = 0xA20E, 0xA210, math.hypot(36, 24)
# Pixels of a mosaic that are averaged to a pixel, by conversion of the mosaic.
AVERAGED = {"superpixel": 4, "red": 1, "green": 2, "blue": 1}
SEARCHED = 24  # bytes that the detection takes for each pixel of an image; measured: 20 at most


def read_image(path: Path, layout: Layout | None = None) -> Frame:
    """Read a FITS, TIFF, PNG, JPEG, BMP, HEIC, SER, raw or video file as one frame.

    For a colour image the largest of the three channels is used, because a star is bright in at
    least one. A mosaic of colours, named by the layout or the header (BAYERPAT of FITS, ColorID of
    SER), becomes an image of half the size. A photograph is rotated by its orientation tag.
    Detector values that the file lacks, or that its noise contradicts, are NaN, and so are infinite
    pixels.

    layout  properties that the file may lack
    Raises  Refused, with the path, where the file is missing, empty, incomplete, not an image, or
            has no finite number.
    """
    path, layout = Path(path), layout or Layout()
    is_fits = bool(FITS & {suffix.lower() for suffix in path.suffixes})
    if layout.extension is not None and not is_fits:
        raise Refused(f"{path} must be a FITS file to have the extension {layout.extension}")
    try:
        if layout.raw or path.suffix.lower() == ".ser":
            image, said, time = recordings.read_recording(path, layout)
            return Frame(layout.one_image(path, image, said), time=time)
        if path.suffix.lower() in recordings.VIDEOS:
            return Frame(layout.one_image(path, recordings.read_video(path, layout.plane), None))
        data = read_bytes(path, "a file")
    except FileNotFoundError as error:
        raise Refused(str(error)) from None
    if not data:
        raise Refused(f"{path} must hold an image, but it is empty")
    frame = _read_cube(path, data, layout) if is_fits else _read_picture(path, data, layout)
    if frame.image.size == 0 or not np.isfinite(frame.image).any():
        raise Refused(f"{path} must hold finite pixel values, but it has none")
    if np.isinf(frame.image).any():  # as a division by an empty flat field makes
        frame = replace(frame, image=np.where(np.isinf(frame.image), np.nan, frame.image))
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


def rows_upwards(path: Path) -> bool:
    """Whether a FITS file says that its first row is the lowest of the picture.

    Source: the keyword ROWORDER of Siril and others (free-astro.org, Siril:FITS_orientation).
    """
    if not FITS & {suffix.lower() for suffix in path.suffixes}:
        return False
    at = unpacked(path, read_bytes(path)).find(b"ROWORDER= 'BOTTOM-UP'")
    return at >= 0 and at % CARD == 0


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
        if is_heif(data):
            exif = Image.Exif()
            exif.load(open_heif(path, data).info.get("exif") or b"")
        elif is_picture(data):
            exif = open_picture(path, data).getexif()
        else:
            with Image.open(io.BytesIO(data), formats=["TIFF"]) as image:
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
    """Refuse an image that cannot be read and searched within the memory limit.

    pixel   bytes of a pixel in the file
    Raises  ValueError with the size and the limit.
    """
    require_memory(
        columns * rows * (2 * pixel + SEARCHED), f"{path}, an image of {columns} x {rows} pixels,"
    )


def write_fits(
    path: Path,
    frame: Frame,
    camera: Camera | None,
    icrs_to_camera: Rotation,
    stars: Stars | None = None,
    history: str = "",
    begun: datetime | None = None,
) -> None:
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
    if frame.excess_noise != 1:
        numbers[EXCESS] = (frame.excess_noise, "variance of the light over its mean")
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
    """A date in the format of FITS, UTC, to the microsecond."""
    return date.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")


def _truth(camera: Camera, icrs_to_camera: Rotation, stars: Stars):  # type: ignore[no-untyped-def]
    from astropy.io import fits

    pixel = camera.project(icrs_to_camera.apply(stars.direction))
    inside = camera.holds(pixel)
    stars, (x, y) = stars[inside], pixel[inside].T
    ra = np.degrees(np.arctan2(stars.direction[:, 1], stars.direction[:, 0])) % 360
    dec = np.degrees(np.arcsin(np.clip(stars.direction[:, 2], -1, 1)))
    columns = {
        "X": ("pixel", x),
        "Y": ("pixel", y),
        "RA": ("deg", ra),
        "DEC": ("deg", dec),
        "G": ("mag", stars.magnitude_g),
        "BP_RP": ("mag", stars.colour),
    }
    return fits.BinTableHDU.from_columns(
        [
            fits.Column("IDENTIFIER", "K", array=stars.identifier),
            *(fits.Column(name, "D", unit=unit, array=a) for name, (unit, a) in columns.items()),
        ],
        name="TRUTH",
    )


def _read_cube(path: Path, data: bytes, layout: Layout) -> Frame:
    """The image of a FITS file; of a cube one plane, or the largest value of all."""
    found = read_fits(path, data, require_image_memory, layout.extension)
    image, pattern = found.image, found.pattern
    if image.ndim == 3:
        planes = len(image)
        if (layout.plane or 0) >= planes:
            raise Refused(f"{path}: plane must lie in [0, {planes - 1}], got {layout.plane}")
        if layout.plane is None:
            warnings.warn(  # without the path: once for all files of a series
                f"cube of {planes} planes: each pixel has the largest value of all; --plane N "
                "reads one",
                stacklevel=4,
            )
            image, pattern = image.max(axis=0), None  # planes of colours are no mosaic
        else:
            image = image[layout.plane]
    elif layout.plane:
        raise Refused(f"{path} must be a cube to have the plane {layout.plane}")
    if image.ndim != 2:
        raise Refused(f"{path} must hold an image of two axes, got shape {image.shape}")
    made = layout.one_image(path, image, pattern)
    # A mean of n pixels has an n-th of the variance, as if n times as many electrons were counted.
    averaged = AVERAGED[layout.colour] if made is not image else 1
    gain, noise = averaged * found.gain, math.sqrt(averaged) * found.read_noise
    return Frame(
        image=made,
        exposure=found.exposure,
        electrons_per_dn=gain,
        offset=found.offset,
        read_noise=noise,
        time=found.time,
        excess_noise=found.excess_noise,
    )


def _read_picture(path: Path, data: bytes, layout: Layout) -> Frame:
    """The image of a TIFF, PNG, JPEG, BMP or HEIC; of colours the largest of the three."""
    if data[:4] in tiff.MAGIC:
        found = tiff.read_tiff(path, data, layout.plane, require_image_memory)
    elif is_picture(data):
        if layout.plane:
            raise Refused(
                f"{path} must be a FITS cube, a TIFF, a SER or a video to have the plane "
                f"{layout.plane}"
            )
        found = read_picture(path, data, require_image_memory)
    else:
        raise Refused(f"{path} must be a whole FITS, TIFF, PNG, JPEG or BMP image")
    image, pattern = found.image, layout.bayer or found.pattern
    if pattern not in (None, "none"):
        if found.orientation != 1:
            raise Refused(f"{path} must not be turned to be a mosaic, got {found.orientation}")
        if image.ndim == 3 and (image != image[:, :, :1]).any():
            raise Refused(f"{path} must have one channel to be a mosaic of colours, got three")
    image = image.max(axis=2) if image.ndim == 3 else image
    image = turned(image, found.orientation)
    return Frame(layout.one_image(path, image, found.pattern))
