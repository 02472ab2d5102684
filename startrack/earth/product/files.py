"""FITS of raw images and calibration frames; GeoTIFF of products."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.earth.imager import ABOUT, RADIANCE, Channel, Performance, Survey, write_bands
from startrack.earth.product.ortho import QUALITY, Bytes, MapGrid
from startrack.earth.product.retrieval import RadiometricCalibration
from startrack.earth.terrain import require_rasterio
from startrack.io import open_checked, regular_file, to_table, whole

FORMAT = 1  # format of the file of calibration frames
# Keys of a scene that a product uses beside its camera, by the card of a raw image that has their
# hash.
USED = {
    "FLIGHT": ("orbit", "tle", "aircraft", "pointing"),
    "TERRAIN": ("terrain",),
    "AIR": ("air", "clouds", "sun_distance"),
}


class RawImage(NamedTuple):
    """The image of a channel as written by `startrack earth render`.

    numbers  (lines, columns) digital number
    truth    (lines, columns) watt / m^2 / sr / um, sum of the five terms; None if the file has no
             terms
    differs  parts of the scene, of flight, terrain and air, that the image was not rendered with
    """

    numbers: NDArray[np.integer]
    truth: Floats | None
    differs: tuple[str, ...]


def camera_id(channel: Channel) -> str:
    """A hash of a channel and of all parameters of its numbers, except the number of lines of a
    scanner."""
    channel = replace(
        channel, restore=None, reference=None, required=Performance(), measured=Performance()
    )
    if channel.detector.scan:
        channel = replace(channel, detector=replace(channel.detector, rows=1))
    return _hash(to_table(channel))


def scene_ids(survey: Survey) -> dict[str, str]:
    """Hashes of a scene's flight, terrain and air, by the names of cards."""
    table = to_table(survey)
    return {card: _hash({key: table.get(key) for key in keys}) for card, keys in USED.items()}


def _hash(table: Mapping[str, Any]) -> str:
    text = json.dumps(table, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def read_raw(path: Path, channel: Channel, survey: Survey) -> RawImage:
    """The raw image of a channel of a scene.

    Raises  FileNotFoundError; ValueError if the file is not a raw image, is damaged, or has
            another camera or size.
    """
    with _opened(path, "a raw image of startrack earth render") as parts:
        first = parts[0]
        _require_camera(path, first.header, channel)
        shape = channel.detector.rows, channel.columns
        if first.data is None or first.data.shape != shape:
            sides = None if first.data is None else first.data.shape
            raise ValueError(
                f"{path} must have {shape[1]} x {shape[0]} pixel, as the scene says, got "
                f"{'none' if sides is None else ' x '.join(map(str, sides[::-1]))}"
            )
        names = {part.name.lower() for part in parts}
        truth = None
        if set(ABOUT) <= names:
            truth = reduce(np.add, (parts[name].data.astype(np.float64) for name in ABOUT))
        differs = tuple(
            card.lower()
            for card, wanted in scene_ids(survey).items()
            if first.header.get(card, wanted) != wanted
        )
        return RawImage(first.data.astype(np.int32), truth, differs)


def save_calibration(path: Path, calibration: RadiometricCalibration, channel: Channel) -> None:
    """Write calibration frames as FITS with checksums."""
    from astropy.io import fits

    first = fits.PrimaryHDU()
    cards: dict[str, Any] = {
        "EARTHCAL": (FORMAT, "format of these calibration frames"),
        "CHANNEL": channel.name,
        "CAMERA": (camera_id(channel), "parameters of the channel"),
        "EPERDN": (calibration.electrons, "electron / digital number, photon transfer"),
        "FRAMES": (calibration.exposures, "number of exposures in each mean"),
    }
    for key, value in cards.items():
        first.header[key] = value
    parts = [first]
    for name, values, unit in (
        ("DARK", calibration.dark, "adu"),
        ("FLAT", calibration.flat, "adu"),
        ("SATURATION", calibration.saturation, "adu"),
        ("RADIANCE", calibration.radiance, RADIANCE),
        ("GAIN", calibration.gain, ""),
    ):
        parts.append(fits.ImageHDU(values, name=name))
        if unit:
            parts[-1].header["BUNIT"] = unit
    parts[-1].header.add_comment(f"digital number for 1 {RADIANCE}")
    for part in parts:
        part.add_checksum(when="of this part")  # without a date
    with whole(path) as draft:
        fits.HDUList(parts).writeto(draft)


def read_calibration(path: Path, channel: Channel) -> RadiometricCalibration:
    """Calibration frames of a channel.

    Raises  as `read_raw`.
    """
    with open_checked(path, "EARTHCAL", FORMAT, "calibration frames") as parts:
        head = parts[0].header
        _require_camera(path, head, channel)
        dark, flat, light, gain, saturation = (
            parts[name].data.astype(np.float64)
            for name in ("DARK", "FLAT", "RADIANCE", "GAIN", "SATURATION")
        )
        return RadiometricCalibration(
            dark=dark,
            flat=flat,
            radiance=light,
            gain=gain,
            electrons=float(head["EPERDN"]),
            saturation=saturation,
            exposures=int(head["FRAMES"]),
        )


def _require_camera(path: Path, header: Any, channel: Channel) -> None:
    wanted, camera = camera_id(channel), header.get("CAMERA")
    name = header.get("CHANNEL", "no channel")
    if name != channel.name or camera != wanted:
        raise ValueError(
            f"{path} must be of channel {channel.name} with the parameters in the scene "
            f"({wanted}), got {name} ({camera or 'no parameters: rendered by an earlier version'})"
        )


@contextmanager
def _opened(path: Path, what: str) -> Iterator[Any]:
    from astropy.io import fits

    regular_file(path, what)
    try:
        with fits.open(path, memmap=False) as parts:
            yield parts
    except FileNotFoundError:
        raise
    except (OSError, KeyError, AttributeError, TypeError) as error:
        raise ValueError(f"{path} must be {what}, whole, got: {error}") from None


def write_product(
    path: Path,
    layers: Mapping[str, Floats],
    units: Mapping[str, str],
    grid: MapGrid,
    tags: Mapping[str, Any],
) -> None:
    """Layers of a product as bands of a GeoTIFF, 32-bit floats; NaN without data."""
    write_bands(path, layers, "float32", _place(grid) | {"nodata": np.nan}, units, tags)


def write_quality(path: Path, quality: Bytes, grid: MapGrid) -> None:
    """Quality of each cell as a GeoTIFF of bits; tags name the bits."""
    tags = {f"BIT_{bit}": name for name, bit in QUALITY.items()}
    write_bands(path, {"quality": quality}, "uint8", _place(grid), {"quality": "bits"}, tags)


def _place(grid: MapGrid) -> dict[str, Any]:
    affine = require_rasterio("to write GeoTIFF").Affine
    transform = affine(grid.step_x, 0, grid.west, 0, -grid.step_y, grid.north)
    return {"crs": grid.system, "tiled": True, "transform": transform}
