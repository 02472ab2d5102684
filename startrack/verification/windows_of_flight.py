"""Star images downlinked by a tracker: files of windows, and windows cut from whole frames."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from startrack import core, detection
from startrack.core import Advance, Flags, Floats, Ints, Refused
from startrack.design import Case
from startrack.detector import Detector, dark_frames
from startrack.io import read_bytes, require_fits
from startrack.observation import colour_correction, psf_of
from startrack.trial import lost_in_space, pattern_indexes

BLOCKS = 8  # blocks of time of the jackknife
FEWEST_IMAGES = 4 * BLOCKS  # least number of images of a star
BORDER = 8  # pixel around a path, margin of the drawn detector
FOLLOWED = 8  # number of the brightest stars of whole frames that are followed
APART = 2.0 * BORDER  # pixel, least distance between two stars that are followed
NEAR = 2.0  # pixel, distance within which a spot belongs to a star
IMAGES = "a file of images of stars (npz or FITS)"


class Windows(core.Parameters, eq=False):
    """Images of one star over time.

    time        (n,) second, rising
    number      (n, s, s) digital number minus the offset, rows upwards in y
    corner      (n, 2) pixel (x, y) of the first pixel of each image
    background  (n,) digital number of a pixel that the tracker subtracts; None: unknown
    magnitude   magnitude that the tracker states; NaN: unknown
    magnitude_g  G of a sunlike star of equal light, from a catalogue and not from these images;
                 NaN: unknown
    acquired    (n,) whether a search of the frame finds the star; None: unknown
    from_middle  whether `corner` counts from the middle of the detector, and not from its first
                 pixel
    """

    name: str
    time: Floats
    number: Floats
    corner: Ints
    background: Floats | None = None
    magnitude: float = math.nan
    acquired: Flags | None = None
    magnitude_g: float = math.nan
    from_middle: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        shape = np.shape(self.number)
        if len(shape) != 3 or shape[1] != shape[2] or shape[1] % 2 or shape[1] < 4:
            raise Refused(f"number of {self.name} must be (n, s, s) with s even, got {shape}")
        if np.shape(self.time) != shape[:1] or np.shape(self.corner) != (shape[0], 2):
            raise Refused(
                f"time and corner of {self.name} must have {shape[0]} entries, one per image, got "
                f"{np.shape(self.time)} and {np.shape(self.corner)}"
            )
        if shape[0] < FEWEST_IMAGES:
            raise Refused(f"{self.name} must have {FEWEST_IMAGES} images or more, got {shape[0]}")
        _require_rising(self.name, self.time)

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of an npz file that `read_windows` reads."""
        left, top = self.corner.T
        columns = {"time": self.time, "number": self.number, "col0": left, "row0": top}
        return columns if self.acquired is None else columns | {"acquired": self.acquired}

    def place_on(self, detector: Detector) -> tuple[float, float]:
        """Mean place (x, y) of the middles of the images, pixel of the detector."""
        middle = self.corner.mean(axis=0) + (self.number.shape[1] - 1) / 2
        if self.from_middle:
            middle += np.array([detector.columns, detector.rows]) / 2
        return float(middle[0]), float(middle[1])

    def of(self, chosen: Any) -> Windows:
        """Some of the exposures."""
        background = None if self.background is None else self.background[chosen]
        acquired = None if self.acquired is None else self.acquired[chosen]
        return replace(
            self,
            time=self.time[chosen],
            number=self.number[chosen],
            corner=self.corner[chosen],
            background=background,
            acquired=acquired,
        )


def read_windows(path: Path, names: Sequence[str] = ()) -> list[Windows]:
    """The stars of a file of numpy arrays (npz) or of FITS tables.

    names  names of the stars to read; none: all stars with enough images

    If a star of the file has a negative col0 or row0, the numbers of all stars in the file count
    from the middle of the detector.

    npz   `time`, `number` (or `raw_adu`), `col0`, `row0` and optionally `background` (or
          `bkg_adu`), `magnitude` (or `obc_mag`), `magnitude_g` and `acquired`, each prefixed by the
          name of its star and "_" if there are several
    FITS  one table for each star, with columns of these names
    Raises  ValueError, in one sentence with the path, if there is no star or a column is missing.
    """
    tables = _fits_tables(path) if path.suffix.lower() != ".npz" else _arrays(path)
    tables = {name: table for name, table in tables.items() if "time" in table}
    if not tables:
        raise Refused(
            f"{path} must hold arrays or tables of a star each, with time and number; whole frames "
            "must be two or more files"
        )
    if unknown := set(names) - set(tables):
        raise Refused(f"stars must be of {', '.join(tables)}, got {', '.join(sorted(unknown))}")
    long = [name for name in tables if len(np.atleast_1d(tables[name]["time"])) >= FEWEST_IMAGES]
    places = [
        table[name] for table in tables.values() for name in ("col0", "row0") if name in table
    ]
    middle = any((np.asarray(place) < 0).any() for place in places)
    return [_windows(path, name, tables[name], middle) for name in names or long or tables]


def _arrays(path: Path) -> dict[str, dict[str, Any]]:
    tables, data = dict[str, dict[str, Any]](), read_bytes(path, IMAGES)
    try:
        with zipfile.ZipFile(BytesIO(data)):  # other files numpy would take for pickled objects
            pass
        with np.load(BytesIO(data), allow_pickle=False) as file:
            for name in (key.removesuffix("time") for key in file if key.endswith("time")):
                tables[name.removesuffix("_") or path.stem] = {
                    key.removeprefix(name): file[key] for key in file if key.startswith(name)
                }
    except zipfile.BadZipFile as error:
        raise Refused(f"{path} must be {IMAGES}, whole, got: {error}") from None
    except ValueError:
        raise Refused(f"{path} must be {IMAGES} of numbers, without Python objects") from None
    return tables


def _fits_tables(path: Path) -> dict[str, dict[str, Any]]:
    from astropy.io import fits

    data = read_bytes(path, IMAGES)
    require_fits(path, data)
    with fits.open(BytesIO(data), memmap=False) as file:
        return {
            hdu.name.lower() or f"star {number}": {
                name.lower(): np.asarray(hdu.data[name]) for name in hdu.data.names
            }
            for number, hdu in enumerate(file)
            if isinstance(hdu, fits.BinTableHDU)
        }


def _windows(path: Path, name: str, table: dict[str, Any], from_middle: bool) -> Windows:
    def column(*names: str) -> Any:
        return next((table[name] for name in names if name in table), None)

    number, corner = column("number", "raw_adu"), (column("col0"), column("row0"))
    if number is None or any(place is None for place in corner):
        raise Refused(f"{path} must have number, col0 and row0 of {name}, got {', '.join(table)}")
    background, magnitude = column("background", "bkg_adu"), column("magnitude", "obc_mag")
    magnitude_g = column("magnitude_g")
    return Windows(
        name,
        np.asarray(table["time"], float),
        np.asarray(number, float),
        np.column_stack(corner).astype(np.int64),
        None if background is None else np.asarray(background, float),
        math.nan if magnitude is None else float(np.median(magnitude)),
        np.asarray(table["acquired"], bool) if "acquired" in table else None,
        math.nan if magnitude_g is None else float(np.median(magnitude_g)),
        from_middle,
    )


def windows_of_frames(
    frames: Iterable[core.Frame],
    case: Case,
    progress: Advance | None = None,
    dark_frame: core.Frame | None = None,
) -> list[Windows]:
    """Windows of 8 x 8 pixels of the brightest stars of whole frames, in the order of time.

    The tracker's search finds the stars in the first frame. In the later frames a box follows each
    star, and the search shows whether it would have acquired the star. Stars that come near the
    border are left out. Frames without time stamps are assumed to be at the detector's update rate.

    progress    called with 1 after each frame
    dark_frame  dark frame of the detector, from which a tracker with a dark map makes its map; the
                windows contain uncorrected numbers
    Raises      Refused if the frames are not of the design's detector, are too few, or have no star
                away from the border; if only some have time stamps, or these do not rise; and if a
                dark frame is missing for a dark map, or given without one.
    """
    detector, box, settings = case.instrument.detector, case.tracker.box, case.tracker.detection
    if (dark_frame is None) != (settings.dark_map is None):
        raise Refused(
            "a dark frame must be given if, and only if, the tracker has a dark map "
            "(tracker.detection.dark_map)"
        )
    taken = None
    if dark_frame is not None:
        mean = np.asarray(dark_frame.image, float)
        taken = partial(detection.DarkFrames, mean, dark_frames(detector, 1)[1])
    plan = detection.plan_detection(settings, psf_of(case.instrument), taken)
    size = detector.rows, detector.columns
    corner, corners, numbers, acquired = np.empty((0, 2), np.int64), [], [], []
    stamps = list[float]()
    for k, frame in enumerate(frames):
        if frame.image.shape != size:
            raise Refused(
                f"frames must have the {size[1]} x {size[0]} pixels of the detector, got "
                f"{frame.image.shape[1]} x {frame.image.shape[0]} of frame {k + 1}"
            )
        if not k:
            corner = _first_corners(detection.detect(frame, plan), size)
            if not len(corner):
                raise Refused("frames must have a star away from the border, got none in the first")
        stamps.append(frame.time)
        inside = np.clip(corner, 4, np.array(size[::-1]) - 4)
        corners.append(corner - 4)
        numbers.append(cut_out(frame.image, inside, detector.offset))
        acquired.append(acquired_in(frame, inside, plan))
        corner = followed_stars(frame, corner, box, plan)
        if progress:
            progress(1)
    time = _times(np.array(stamps), detector)
    path, number = np.array(corners), np.array(numbers)
    kept = ((path >= 0) & (path <= np.array(size[::-1]) - 8)).all(axis=(0, 2))
    return [
        Windows(
            f"star {star + 1}",
            time,
            number[:, star],
            path[:, star],
            acquired=np.array(acquired)[:, star],
        )
        for star in np.flatnonzero(kept)
    ]


def blocks_of(stars: Sequence[Windows]) -> Iterable[list[Windows]]:
    """The stars without one of eight blocks of time, for each block."""
    for parts in without_blocks([star.time for star in stars]):
        yield [star.of(part) for star, part in zip(stars, parts, strict=True)]


def without_blocks(times: Sequence[Floats]) -> Iterable[list[Flags]]:
    """For each of eight blocks of time: which times (n,) of each star lie outside the block."""
    begin, end = min(time[0] for time in times), max(time[-1] for time in times)
    edges = np.linspace(begin, end, BLOCKS + 1)
    for low, high in pairwise(edges):
        yield [(time < low) | (time >= high) for time in times]


def jackknife_sigma(parts: Sequence[float] | Floats) -> float:
    """Standard deviation of a figure by a jackknife, from its values without each block of time."""
    spread = np.array(parts) - np.mean(parts)
    return math.sqrt((BLOCKS - 1) / BLOCKS * float((spread**2).sum()))


def with_magnitudes(stars: Sequence[Windows], frame: core.Frame, case: Case) -> list[Windows]:
    """Windows of whole frames with the magnitudes of the catalogue, for identified stars.

    The tracker finds its attitude from the first frame, lost in space. A star of the windows that
    it matched gets the G of the catalogue, corrected for its colour in the band of the camera. The
    magnitudes of other stars do not change; without an attitude, no magnitude changes.

    Accuracy  model: single stars, without the light of their neighbours.
    """
    indexes = pattern_indexes(case.believed_catalog)
    plan_psf = psf_of(case.instrument)
    spots, matches, _ = lost_in_space(frame, case.believed_camera, indexes, case.tracker, plan_psf)
    if not len(matches):
        return list(stars)
    place = np.column_stack([spots.x, spots.y])[matches.spot]
    known = indexes.stars[matches.star]
    magnitude = known.magnitude_g + colour_correction(case, known.colour)
    named = []
    for star in stars:
        far = np.hypot(*(place - star.corner[0] - (star.number.shape[1] - 1) / 2).T)
        near = int(far.argmin())
        given = float(magnitude[near]) if far[near] < NEAR else star.magnitude_g
        named.append(replace(star, magnitude_g=given))
    return named


def _times(stamps: Floats, detector: Detector) -> Floats:
    """Times of frames, by their stamps or by the update rate."""
    finite = np.isfinite(stamps)
    if not finite.any():
        return np.arange(len(stamps)) / detector.update_rate
    if not finite.all():
        raise Refused(
            "time stamps must be in all frames or in none, got none in frame "
            f"{int(np.argmin(finite)) + 1}"
        )
    _require_rising("frames", stamps, _date)
    return stamps - stamps[0]


def _date(second: float) -> str:
    """Date of a time stamp, second since 2000."""
    return str(np.datetime64("2000-01-01", "us") + np.timedelta64(round(1e6 * second), "us"))


def _require_rising(
    name: str, time: Floats, text: Callable[[float], str] = "{:.6f} s".format
) -> None:
    """Refuse times that do not rise from image to image."""
    back = np.flatnonzero(~(np.diff(time) > 0))
    if len(back):
        at = int(back[0])
        raise Refused(
            f"time of {name} must rise, got {text(time[at + 1])} of number {at + 2} after "
            f"{text(time[at])}"
        )


def _first_corners(spots: core.Spots, size: tuple[int, int]) -> Ints:
    """Middles (m, 2) of the images of the brightest spots that have no close neighbours."""
    place = np.column_stack([spots.x, spots.y])
    inside = ((place > APART) & (place < np.array(size[::-1]) - APART)).all(axis=1)
    chosen = list[int]()
    for n in np.flatnonzero(inside):
        far = np.hypot(*(np.delete(place, n, axis=0) - place[n]).T)
        if len(chosen) < FOLLOWED and not (far < APART).any():
            chosen.append(int(n))
    return np.rint(place[chosen] + 0.5).astype(np.int64).reshape(-1, 2)


def acquired_in(frame: core.Frame, corner: Ints, plan: detection.DetectionPlan) -> Flags:
    """Whether the search finds a spot in the middle half of each image (m, 2) about a corner."""
    place = np.asarray(corner - 0.5, float)
    spots = detection.detect_near(frame, place, NEAR + 1, plan)
    away = np.abs(np.column_stack([spots.x, spots.y]) - place[:, None])
    return np.asarray(np.any(np.all(away < NEAR, axis=2), axis=1))


def followed_stars(
    frame: core.Frame, corner: Ints, box: detection.Box, plan: detection.DetectionPlan
) -> Ints:
    """Places of the tracker's boxes after a frame; a box that loses its star does not move."""
    after = detection.follow(frame, corner, box, plan)
    return np.where(after < 0, corner, after)


def cut_out(image: Any, corner: Ints, offset: float) -> Floats:
    """Windows (m, 8, 8) of a frame about corners (m, 2), minus an offset, digital number."""
    parts = [image[y - 4 : y + 4, x - 4 : x + 4] for x, y in corner]
    return np.asarray(parts, float) - offset
