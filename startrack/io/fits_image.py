"""Bytes of a FITS file of any program -> its image, and the detector values of its header."""

import io
import math
import re
import warnings
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import DAY, Refused
from startrack.io.reading import require_fits, unpacked
from startrack.io.recordings import YEAR_2000
from startrack.io.text import first_line

DATES = "DATE-OBS", "DATE-BEG", "DATE-AVG"
# Days of 2000-01-01T00:00 by each keyword.
JULIAN = {"MJD-OBS": 51544.0, "MJD-BEG": 51544.0, "MJD-AVG": 51544.0, "JD": 2451544.5}
EXPOSURES = "EXPTIME", "EXPOSURE"
SECOND = re.compile(r"\[s(?:ecs?)?\]|\(s(?:ecs?)?\)|(?<![a-z-])seconds?\b", re.IGNORECASE)
MILLISECOND = re.compile(r"(?<!\d )\bm(?:s|secs?)\b|milli-?sec", re.IGNORECASE)
MICROSECOND = re.compile(r"(?<!\d )\b[u\u00b5\u03bc](?:s|secs?)\b|micro-?sec", re.IGNORECASE)
MINUTE = re.compile(r"\[min\]|(?<!\d )\bminutes?\b", re.IGNORECASE)
HOUR = re.compile(r"\[(?:h|hr)\]|(?<!\d )\bhours?\b", re.IGNORECASE)
# Comment of a gain that is in electrons per digital number, and not a setting of the camera.
ELECTRONS = re.compile(
    r"(e-?|elec\w*|photo-?e\w*)\s*(/|per)\s*(adu|dn|count|unit|lsb)", re.IGNORECASE
)
# Comment of a gain in digital numbers per electron.
NUMBERS = re.compile(r"(adu|dn|counts?|units?|lsb)\s*(/|per)\s*(e\b|elec|photo-?e)", re.IGNORECASE)
DIGITAL = re.compile(r"\b(?:adu|dn|counts?|lsb|digital numbers?)\b", re.IGNORECASE)
CHARGE = re.compile(r"elec|photo-?e|\be\b|\bel\b", re.IGNORECASE)
DECIBEL = re.compile(r"[\[(]dB[\])]|\b(?:in|unit:?) (?:dB\b|decibel)", re.IGNORECASE)
# BUNIT of pixels that are electrons already.
IN_ELECTRONS = re.compile(r"(?:photo-?)?electrons?|e-?|photo-?e-?", re.IGNORECASE)
SCIENCE = "SCI"  # name of the image itself beside maps of its errors
EXCESS = "EXCESSN"  # variance of the light over its mean, of a register that multiplies electrons
# Programs and cameras that write their setting as GAIN, and electrons for a number as EGAIN.
SETTINGS = re.compile(
    r"zwo|\basi|sharpcap|n\.?i\.?n\.?a|firecapture|qhy|player ?one|toup|altair|svbony|ogma|"
    r"moravian|indi\b|ekos|kstars|astroberry|ascom|voyager|maxim",
    re.IGNORECASE,
)
PROGRAMS = "INSTRUME", "SWCREATE", "CREATOR", "PROGRAM", "SOFTWARE", "CAMERA", "ORIGIN"
READ_NOISE, UNEVEN = 20.0, 0.005  # electron and 1: of many cameras
CONTRADICTS = 2.0  # times the noise: no gain is known worse
COLOURS = 3, 4  # columns of a cube whose first axis is that of its colours
LEAST_SIDE = 16  # pixels, of an image in which noise can be measured


class FitsImage(NamedTuple):
    """An image (rows, columns) or cube (planes, rows, columns), and values of its header.

    exposure, gain, offset, read_noise  as a `Frame` has them; NaN where they are not known
    excess_noise                        1, as a `Frame` has it
    pattern                             of a mosaic; None where the header has none
    time                                second since 2000; NaN where the header has none
    """

    image: NDArray[Any]
    exposure: float
    gain: float
    offset: float
    read_noise: float
    pattern: str | None
    time: float
    excess_noise: float


def read_fits(
    path: Path,
    data: bytes,
    require: Callable[[Path, int, int, int], None],
    extension: str | None = None,
) -> FitsImage:
    """An image of a FITS file, compressed or not, with BSCALE, BZERO and BLANK applied.

    Of several images, the first of the largest is read, or the largest named SCI: a thumbnail may
    stand before it, and maps of its errors beside it. Colours of three or four columns are planes.

    If all pixels are present, a file is read in spite of astropy's warnings on letters beyond
    ASCII, missing padding of header or data, and cards that violate the standard.

    require    refuses an image of (path, columns, rows, bytes of a pixel) that is too large
    extension  name of the image, or its number, 0 for the primary
    Raises     Refused if the file is not a FITS file, cut, damaged, or has no image of two axes, or
               none of that name or number.
    """
    data = unpacked(path, data, 2)
    require_fits(path, data)
    image, header = _one_image(path, data, require, extension)
    image = np.squeeze(image) if image.ndim > 2 else image
    if image.ndim == 3 and image.shape[2] in COLOURS and min(image.shape[:2]) > max(COLOURS):
        image = np.moveaxis(image, 2, 0)
    offset = _number(header, "PEDESTAL", 0.0)
    # MaxIm DL writes the value to be added, which is negative.
    offset = -offset if offset < 0 else offset
    noise, said = _number(header, "RDNOISE"), _comment(header, "RDNOISE")
    in_numbers = DIGITAL.search(said) and not CHARGE.search(said)
    excess = max(_number(header, EXCESS, 1.0), 1.0)
    gain = _gain(path, header, image, offset, math.nan if in_numbers else noise, excess)
    noise = noise * gain if in_numbers else noise
    return FitsImage(
        image=image.astype(image.dtype.newbyteorder("=")),
        exposure=_exposure(path, header),
        gain=gain,
        offset=offset,
        read_noise=noise,
        pattern=_pattern(header),
        time=_time(header),
        excess_noise=excess,
    )


def _one_image(
    path: Path, data: bytes, require: Callable[[Path, int, int, int], None], extension: str | None
) -> tuple[NDArray[Any], Any]:
    """An image of a file and its header: the asked one, or the first of the largest of several,
    with a warning.
    """
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyUserWarning

    try:
        with warnings.catch_warnings():
            # Warnings without effect on the image; that all pixels are there is checked below.
            warnings.simplefilter("ignore", AstropyUserWarning)
            # From memory: astropy leaves a cut file open when it gives up.
            with fits.open(io.BytesIO(data)) as units:
                images = [
                    unit for unit in units if unit.is_image and unit.header.get("NAXIS", 0) >= 2
                ]
                if not images:
                    raise Refused(f"{path} must hold an image of two axes, but it has none")
                numbers = [str(units.index(part)) for part in images]
                names = [part.name or f"HDU {n}" for part, n in zip(images, numbers, strict=True)]
                if extension is None:
                    chosen = _largest(images)
                else:
                    asked = extension.strip().upper()
                    same = [n for n, name in enumerate(names) if name.upper() == asked]
                    same = same or [n for n, number in enumerate(numbers) if number == asked]
                    if len(same) != 1:
                        raise Refused(
                            f"{path}: extension must be the number or name of one of its images, "
                            f"{_listed(names, numbers)}, got {extension!r}"
                        )
                    chosen = same[0]
                unit, read = images[chosen], names[chosen]
                header = unit.header.copy()
                _require_memory(path, header, require)
                if not isinstance(unit, fits.CompImageHDU):
                    _require_whole(path, unit, len(data))
                image = _with_blanks(np.asarray(unit.data), header)
    except (MemoryError, Refused):
        raise
    except Exception as error:  # astropy, zlib and CFITSIO each raise their own
        missing = f"it has no {error}" if isinstance(error, KeyError) else first_line(error)
        raise Refused(f"{path} must be a whole FITS file: {missing}") from None
    if len(images) > 1 and extension is None:
        warnings.warn(
            f"{path} holds {len(images)} images, {_listed(names, numbers)}; {read} is read, "
            f"{SCIENCE} or the first of the largest; --extension reads another",
            stacklevel=4,
        )
    return image, header


def _largest(images: list[Any]) -> int:
    """Number of the image named SCI among the largest, or of the first of the largest."""
    sizes = [_pixels(part.header) for part in images]
    largest = [n for n, size in enumerate(sizes) if size == max(sizes)]
    return next((n for n in largest if images[n].name == SCIENCE), largest[0])


def _listed(names: list[str], numbers: list[str]) -> str:
    """Numbers and names of images, the first nine."""
    every = [
        number if name.startswith("HDU ") else f"{number} {name}"
        for name, number in zip(names, numbers, strict=True)
    ]
    return ", ".join(every[:9]) + ", ..." * (len(every) > 9)


def _pixels(header: Any) -> int:
    """Columns times rows by a header, which may be damaged."""
    sides = [header.get(key, 0) for key in ("NAXIS1", "NAXIS2")]
    return math.prod(side if isinstance(side, int) else 0 for side in sides)


def _require_memory(path: Path, header: Any, require: Callable[..., None]) -> None:
    axes = [header.get(f"NAXIS{n}", 0) for n in range(1, header["NAXIS"] + 1)]
    sizes = [size if isinstance(size, int) and size >= 0 else 0 for size in axes]
    bits = header.get("BITPIX", 8)
    pixel = abs(bits) // 8 if isinstance(bits, int) else 8
    require(path, sizes[0], math.prod(sizes[1:]), pixel)


def _require_whole(path: Path, unit: Any, size: int) -> None:
    """All pixels must be there; the padding after them need not."""
    place = unit.fileinfo()["datLoc"]
    if place + unit.size > size:
        raise Refused(
            f"{path} must be a whole FITS file: {unit.size} bytes of pixels, but it is cut after "
            f"{max(size - place, 0)}"
        )


def _with_blanks(image: NDArray[Any], header: Any) -> NDArray[Any]:
    """NaN where unsigned integers are BLANK, which astropy leaves as they are."""
    blank = header.get("BLANK", header.get("ZBLANK"))
    if image.dtype.kind != "u" or not isinstance(blank, int) or header.get("BITPIX", 8) <= 8:
        return image
    is_blank = image == np.uint64(max(blank + int(header.get("BZERO", 0)), 0))
    if not is_blank.any():
        return image
    floats = image.astype(np.float32 if image.dtype.itemsize <= 2 else np.float64)
    floats[is_blank] = np.nan
    return floats


def _number(header: Any, key: str, otherwise: float = math.nan) -> float:
    value = header.get(key, otherwise)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if number else otherwise


def _comment(header: Any, key: str) -> str:
    return str(header.comments[key]) if key in header else ""


def _unit_of_time(comment: str) -> float:
    """Second: the unit that a comment names; seconds win over other units, then the first one."""
    if SECOND.search(comment):
        return 1.0
    units = {MILLISECOND: 1e-3, MICROSECOND: 1e-6, MINUTE: 60.0, HOUR: 3600.0}
    named = {match.start(): unit for word, unit in units.items() if (match := word.search(comment))}
    return named[min(named)] if named else 1.0


def _exposure(path: Path, header: Any) -> float:
    """Second, by EXPTIME or EXPOSURE, whose comment may say another unit; NaN without them."""
    values = []
    for key in EXPOSURES:
        comment = _comment(header, key)
        values.append(_number(header, key) * _unit_of_time(comment))
    given = [value for value in values if value >= 0]
    if len(given) == 2 and abs(given[0] - given[1]) > 0.01 * max(given):
        warnings.warn(
            f"{path}: EXPTIME is {given[0]:g} s and EXPOSURE is {given[1]:g} s, so that neither is "
            "taken",
            stacklevel=4,
        )
        return math.nan
    return given[0] if given else math.nan


def _gain(
    path: Path, header: Any, image: NDArray[Any], offset: float, read_noise: float, excess: float
) -> float:
    """Electron per number, if the header states it and the noise of the image allows it.

    EGAIN is that of most cameras' programs, of which GAIN is a setting, in tenths of a decibel or
    in units of its maker. GAIN of other files is taken where its comment says electrons, or where
    the noise of the image agrees with it; it is inverted where its comment says numbers for an
    electron.

    Source: SBIG, FITS extensions (SBFITSEXT) 1.0, EGAIN; ZWO, ASI cameras' manual, section on gain
    (0.1 dB a step).
    """
    key = "EGAIN" if _number(header, "EGAIN") > 0 else "GAIN"
    gain = _number(header, key)
    if not (gain > 0 and math.isfinite(gain)):
        return math.nan
    comment = _comment(header, key)
    said = key == "EGAIN" or bool(ELECTRONS.search(comment))
    if IN_ELECTRONS.fullmatch(str(header.get("BUNIT", "")).strip()):
        key, gain, said, comment = "BUNIT", 1.0, True, ""
    if NUMBERS.search(comment) and not ELECTRONS.search(comment):
        gain, said = 1 / gain, True
    if not said and DECIBEL.search(comment):
        return math.nan
    if not said and any(SETTINGS.search(str(header.get(name, ""))) for name in PROGRAMS):
        return math.nan
    level, noise = _background(image)
    if not noise > 0:  # no noise to compare with
        return gain
    signal = max(level - offset, 0.0)
    least = excess * signal / gain
    most = least + (max(read_noise, READ_NOISE) if read_noise >= 0 else READ_NOISE) ** 2 / gain**2
    # a value that may be a setting must fit
    most += 1 / 12 + ((UNEVEN * signal) ** 2 if said else 0.0)
    low, high = math.sqrt(least) / CONTRADICTS, math.sqrt(most) * CONTRADICTS
    if low <= noise <= high:
        return gain
    warnings.warn(
        f"{path}: {key}, {gain:g} electrons for a number, would give the background, "
        f"{signal:.4g} above an offset of {offset:g}, a noise from {math.sqrt(least):.3g} to "
        f"{math.sqrt(most):.3g}, but it has {noise:.3g}: the gain is treated as unknown (GAIN may "
        "be a setting of the camera, PEDESTAL may be missing, or the image may be a mean)",
        stacklevel=4,
    )
    return math.nan


def _background(image: NDArray[Any]) -> tuple[float, float]:
    """Level and noise of most of an image, by second differences of pixels two columns apart.

    Two columns apart, because pixels of a mosaic then have the same colour; second differences,
    because they remove a slope. NaN for an image that is too small, or a cube.
    """
    if image.ndim != 2 or min(image.shape) < LEAST_SIDE:
        return math.nan, math.nan
    step = max(1, image.shape[0] // 1000)
    rows = image[::step].astype(np.float64)
    change = rows[:, 4:] - 2 * rows[:, 2:-2] + rows[:, :-4]
    noise = 1.4826 * float(np.nanmedian(np.abs(change))) / math.sqrt(6)
    return float(np.nanmedian(rows)), noise


def _time(header: Any) -> float:
    """Second since 2000 by the first of the date's keywords; NaN without one, or without an hour.

    Source: FITS standard 4.0, section 9.5; TIME-OBS is of before 2000.
    """
    for key in DATES:
        date = str(header.get(key, "")).strip().removesuffix("Z")
        if "T" not in date:
            date = f"{date}T{str(header.get('TIME-OBS', '')).strip()}"
        try:
            since = datetime.fromisoformat(date) - YEAR_2000
        except (ValueError, TypeError):  # no such date; one with a zone
            continue
        return since.total_seconds()
    days = [_number(header, key) - zero for key, zero in JULIAN.items()]
    return DAY * next((day for day in days if math.isfinite(day)), math.nan)


def _pattern(header: Any) -> str | None:
    """The Bayer pattern of a header, shifted by the offsets of the image in the detector."""
    said = header.get("BAYERPAT") or header.get("COLORTYP")
    if not isinstance(said, str) or len(said.strip()) != 4:
        return None
    pattern = said.strip().upper()
    shift_x, shift_y = (_number(header, key, 0.0) % 2 >= 1 for key in ("XBAYROFF", "YBAYROFF"))
    rows = [pattern[:2], pattern[2:]][:: -1 if shift_y else 1]
    return "".join(row[:: -1 if shift_x else 1] for row in rows)
