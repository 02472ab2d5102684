"""Images of stars that a tracker sent down, and its design -> each figure as predicted and as seen.

Both are measured by the same code: what the design predicts are images that it would have made of
the same stars on the same paths, on detectors of other pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from startrack import core, detection
from startrack.core import Advance, Flags, Floats, Ints, Refused, printed
from startrack.design import Case
from startrack.detector import Detector, dark, dark_frames, flickering, frame_of, response, stamp
from startrack.metrics import Interval
from startrack.observation import frames_of_map, psf_of, sky_electrons
from startrack.response import scale

PHASES = 10  # of a pixel, of the curve of the centroid
CELLS = 4  # of a pixel along each side, of the mean images
FEWEST = 20  # exposures of a cell
MEMBERS = 60  # exposures of a cell whose images are averaged in the model
BLOCKS = 8  # of time, of the jackknife
FEWEST_IMAGES = 4 * BLOCKS  # of a star
CLEAR = 0.2  # of the median light, by which an exposure may be off
ROUNDING = 1 / 12  # of numbers, their variance
THIRD = np.array([1.0, -3.0, 3.0, -1.0]) / math.sqrt(20)  # keeps white noise, takes off a parabola
GROUP = 150  # differences of one pixel at one level, of the photon transfer
CLIP = 5.0  # sigma, of a difference that is left out
PULL = 4.0  # sigma, of a group that is left out: its pixel flickered
SEEN_TOGETHER = 0.5  # of a star's exposures, in which another shows the common motion
LONGEST_GAP = 3.0  # of the usual time between exposures, over which a place is interpolated
OFF = 1.5  # of half of its interval, beyond which an offset is not zero: 3 sigma
SMOOTH = 15  # exposures, over which a path is smoothed
BORDER = 8  # pixel about a path, of the detector that is drawn
FOLLOWED = 8  # stars of whole frames, the brightest
APART = 2.0 * BORDER  # pixel, between two stars that are followed
NEAR = 2.0  # pixel, within which a spot is that of a star
# What each figure depends on in a design; those first that are usually known worst.
KEYS = {
    "background": "instrument.detector.dark_current, .thermal, .age; scene.background_g",
    "brightness": "instrument.optics.transmission, instrument.detector.quantum_efficiency",
    "gain": "instrument.detector.full_well, .bits",
    "read_noise": "instrument.detector.read_noise",
    "offset": "instrument.detector.offset, .read_noise",
    "image": "instrument.optics.psf_file (or the optics that make the image), .focus",
    "temporal": "instrument.detector.read_noise, .full_well; instrument.motion",
    "total": "instrument.detector.age, .dark_current, .prnu; tracker.box.background, .size",
    "moves": "tracker.box.moves",
    "curve": "tracker.box.background, .size, .moves; instrument.optics.psf_file",
    "acquired": "tracker.detection.threshold, .kernel_sigma; instrument.optics.transmission",
}


class Windows(core.Parameters, eq=False):
    """Images of one star over time.

    time        (n,) second, rising
    number      (n, s, s) digital number less the offset, rows upwards in y
    corner      (n, 2) pixel (x, y) of the first pixel of each image
    background  (n,) digital number of a pixel, that the tracker takes off; None: not known
    magnitude   that the tracker states; NaN: not known
    magnitude_g Gaia's G, by a catalogue and not by this light; NaN: not known
    acquired    (n,) whether a search of the frame finds the star; None: not known
    """

    name: str
    time: Floats
    number: Floats
    corner: Ints
    background: Floats | None = None
    magnitude: float = math.nan
    acquired: Flags | None = None
    magnitude_g: float = math.nan

    def __post_init__(self) -> None:
        super().__post_init__()
        shape = np.shape(self.number)
        if len(shape) != 3 or shape[1] != shape[2] or shape[1] % 2 or shape[1] < 4:
            raise Refused(f"number of {self.name} must be (n, s, s) with s even, got {shape}")
        if np.shape(self.time) != shape[:1] or np.shape(self.corner) != (shape[0], 2):
            raise Refused(
                f"time and corner of {self.name} must be as many as its {shape[0]} images, got "
                f"{np.shape(self.time)} and {np.shape(self.corner)}"
            )
        if shape[0] < FEWEST_IMAGES:
            raise Refused(f"{self.name} must have {FEWEST_IMAGES} images or more, got {shape[0]}")
        _require_rising(self.name, self.time)

    @property
    def columns(self) -> dict[str, Any]:
        """What `read_windows` makes them of, as an npz file has it."""
        left, top = self.corner.T
        columns = {"time": self.time, "number": self.number, "col0": left, "row0": top}
        return columns if self.acquired is None else columns | {"acquired": self.acquired}

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

    names  of the stars to read; none: all that have images enough

    npz   `time`, `number` (or `raw_adu`), `col0`, `row0` and maybe `background` (or `bkg_adu`),
          `magnitude` (or `obc_mag`), `magnitude_g` and `acquired`, each behind the name of its star
          and "_" where there are several
    FITS  a table of a star each, whose columns have these names
    Raises  ValueError, in one sentence with the path, where it has no star or a column is missing.
    """
    tables = _fits_tables(path) if path.suffix.lower() != ".npz" else _arrays(path)
    if not tables:
        raise Refused(f"{path} must hold arrays or tables of a star each, with time and number")
    if unknown := set(names) - set(tables):
        raise Refused(f"stars must be of {', '.join(tables)}, got {', '.join(sorted(unknown))}")
    long = [name for name in tables if len(np.atleast_1d(tables[name]["time"])) >= FEWEST_IMAGES]
    return [_windows(path, name, tables[name]) for name in names or long or tables]


def _arrays(path: Path) -> dict[str, dict[str, Any]]:
    tables = dict[str, dict[str, Any]]()
    with np.load(path, allow_pickle=False) as file:
        for name in (key.removesuffix("time") for key in file if key.endswith("time")):
            tables[name.removesuffix("_") or path.stem] = {
                key.removeprefix(name): file[key] for key in file if key.startswith(name)
            }
    return tables


def _fits_tables(path: Path) -> dict[str, dict[str, Any]]:
    from astropy.io import fits

    with fits.open(path, memmap=False) as file:
        return {
            hdu.name.lower() or f"star {number}": {
                name.lower(): np.asarray(hdu.data[name]) for name in hdu.data.names
            }
            for number, hdu in enumerate(file)
            if isinstance(hdu, fits.BinTableHDU)
        }


def _windows(path: Path, name: str, table: dict[str, Any]) -> Windows:
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
    )


def windows_of_frames(
    frames: Iterable[core.Frame],
    case: Case,
    progress: Advance | None = None,
    dark_frame: core.Frame | None = None,
) -> list[Windows]:
    """Windows of 8 x 8 pixels of the brightest stars of whole frames, in the order of time.

    The tracker's search finds the stars in the first frame; from there on its box follows each, and
    its search says in each frame whether it would have acquired the star. Stars that come near the
    border are left out. Frames without time stamps are taken at the update rate of the detector.

    progress    called with 1 after each frame
    dark_frame  of the detector, of which a tracker with a dark map makes it; the windows hold the
                numbers as they are
    Raises      Refused where the frames are not of the design's detector, are too few, or hold no
                star away from the border; where some have no time stamp, or these do not rise;
                where a tracker with a dark map has no dark frame, or one without has.
    """
    detector, box, settings = case.instrument.detector, case.tracker.box, case.tracker.detection
    if (dark_frame is None) != (settings.dark_map is None):
        raise Refused(
            "a dark frame must be given where the tracker has a dark map "
            "(tracker.detection.dark_map), and nowhere else"
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
        numbers.append(_cut(frame.image, inside, detector))
        acquired.append(_acquired(frame, inside, plan))
        corner = _followed(frame, corner, box, plan)
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
    _require_rising("frames", stamps)
    return stamps - stamps[0]


def _require_rising(name: str, time: Floats) -> None:
    """Refuse times that do not rise from image to image."""
    back = np.flatnonzero(~(np.diff(time) > 0))
    if len(back):
        at = int(back[0])
        raise Refused(
            f"time of {name} must rise, got {time[at + 1]:.6f} s of number {at + 2} after "
            f"{time[at]:.6f} s"
        )


def _first_corners(spots: core.Spots, size: tuple[int, int]) -> Ints:
    """Middles (m, 2) of the images of the brightest spots, which are no neighbours."""
    place = np.column_stack([spots.x, spots.y])
    inside = ((place > APART) & (place < np.array(size[::-1]) - APART)).all(axis=1)
    chosen = list[int]()
    for n in np.flatnonzero(inside):
        far = np.hypot(*(np.delete(place, n, axis=0) - place[n]).T)
        if len(chosen) < FOLLOWED and not (far < APART).any():
            chosen.append(int(n))
    return np.rint(place[chosen] + 0.5).astype(np.int64).reshape(-1, 2)


def _acquired(frame: core.Frame, corner: Ints, plan: detection.DetectionPlan) -> Flags:
    """Whether the search finds a spot in the middle half of each image (m, 2) about a corner."""
    place = np.asarray(corner - 0.5, float)
    spots = detection.detect_near(frame, place, NEAR + 1, plan)
    away = np.abs(np.column_stack([spots.x, spots.y]) - place[:, None])
    return np.asarray(np.any(np.all(away < NEAR, axis=2), axis=1))


def _followed(
    frame: core.Frame, corner: Ints, box: detection.Box, plan: detection.DetectionPlan
) -> Ints:
    """Where the tracker's boxes are after a frame; those that lose their star stay."""
    after = detection.follow(frame, corner, box, plan).corner
    return np.where(after < 0, corner, after)


class Centroids(NamedTuple):
    """First moments of the images of one star, of exposures in which it was seen.

    place   (n, 2) pixel (x, y)
    total   (n,) digital number of the image above its background
    """

    windows: Windows
    place: Floats
    total: Floats


def centroids(windows: Windows, box: detection.Box) -> Centroids:
    """First moments as the tracker takes them, of its images of `box.size` pixels.

    Exposures without the star, whose light is off by a fifth of the median, are left out.
    """
    light, corner = _light(windows, box)
    total = light.sum(axis=(1, 2))
    step = np.arange(light.shape[1]) - (light.shape[1] - 1) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        moment = np.stack([light.sum(axis=1) @ step, light.sum(axis=2) @ step], 1) / total[:, None]
    seen = np.abs(total / np.median(total) - 1) < CLEAR
    if seen.sum() < FEWEST_IMAGES:
        raise Refused(f"{windows.name} must have a star of steady light in most of its images")
    place = corner + (light.shape[1] - 1) / 2 + moment
    return Centroids(windows.of(seen), place[seen], total[seen])


def _light(windows: Windows, box: detection.Box) -> tuple[Floats, Ints]:
    """Light above the background (n, k, k) in the pixels that count, and the images' corners."""
    side = windows.number.shape[1]
    size = min(box.size, side)
    cut = (side - size) // 2
    inner = windows.number[:, cut : cut + size, cut : cut + size]
    level = level_of(windows, box)
    return (inner - level[:, None, None]) * detection.image_mask(size), windows.corner + cut


def level_of(windows: Windows, box: detection.Box) -> Floats:
    """The background (n,) of a pixel that the tracker takes off."""
    if windows.background is not None:
        return np.asarray(windows.background, float)
    if box.background == "none" or windows.number.shape[1] < 8:
        return np.zeros(len(windows.time))
    cut = windows.number.shape[1] // 2 - 4
    return np.array(
        [detection.corner_level(image[cut : cut + 8, cut : cut + 8]) for image in windows.number]
    )


class MeasuredWindows(NamedTuple):
    """What is measured of one star.

    scalar  name: value, of `KEYS` less the curve
    curve   (2, PHASES) pixel, of the place along x and y less its mean, over the phase of the
            pixel; NaN where the star was not
    """

    scalar: dict[str, float]
    curve: Floats


def measure(
    stars: Sequence[Windows], box: detection.Box, psf: core.Psf | None, read_noise: float = math.nan
) -> list[MeasuredWindows]:
    """Measure stars that were seen together.

    read_noise  digital number, of the design, for the offset

    temporal    pixel rms of an axis, of third differences in time between exposures whose image
                did not move, of the place less the motion that all stars share
    total       pixel rms of an axis, of that place over all the time, less a cubic in time and
                what is proportional to the common motion; both times sqrt(k / (k - 1)) of k stars,
                so that two stars share one figure
    curve       of the same, over the place in the pixel
    moves       steps of an image along an axis, in an exposure
    background  digital number; brightness in digital numbers a second and exposure
    gain, read_noise  electron a number, and number: see `photon_transfer`; NaN where it refuses
    offset      digital number, at which the variance is that of the design's read noise: of numbers
                less their offset, zero
    acquired    share of the exposures in which the search finds the star, of those with its light
    image       1, of the peak: worst pixel of the mean images of cells of phase less the design's
                image at fitted place and flux, of all stars alone; NaN without `psf`

    One star alone has its own motion in its temporal scatter, and no total and no curve; a star
    that no other is seen with has none of the three.
    """
    seen = [centroids(star, box) for star in stars]
    residual, still = _about_common([track.place for track in seen], seen)
    measured = []
    for track, off, calm in zip(seen, residual, still, strict=True):
        windows = track.windows
        gain = read = offset = math.nan
        with suppress(Refused):  # the image moves too often
            rest, slope = _transfer_line(windows)
            gain, read = 1 / slope, _read_noise(rest)
            offset = (read_noise**2 + ROUNDING - rest) / slope
        third = _third(off)[calm]
        known = np.isfinite(off[:, 0])
        together = len(seen) > 1 and known.any()
        scalar = {
            "background": float(level_of(windows, box).mean()),
            "brightness": float(np.median(track.total)),
            "gain": gain,
            "read_noise": read,
            "offset": offset,
            "image": image_difference(track, box, psf) if psf else math.nan,
            "temporal": math.sqrt(float((third**2).mean())) if len(third) else math.nan,
            "total": math.sqrt(float((off[known] ** 2).mean())) if together else math.nan,
            "moves": float(np.abs(np.diff(windows.corner, axis=0)).sum() / 2 / len(off)),
            "acquired": math.nan if windows.acquired is None else float(windows.acquired.mean()),
        }
        curve = np.full((2, PHASES), math.nan)
        if together:
            curve = _curve(track.place[known], off[known])
        measured.append(MeasuredWindows(scalar, curve))
    return measured


def _about_common(places: list[Floats], seen: list[Centroids]) -> tuple[list[Floats], list[Any]]:
    """Places (n, 2) of each star less the common motion, and third differences without a move.

    The motion is that of the star and of those others that are seen in half of its exposures, in
    the exposures of which all have one before and one after; NaN in the rest, and for a star that
    no other was seen with.
    """
    times = [track.windows.time for track in seen]
    moved = [_calm(track.windows) for track in seen]
    if len(seen) == 1:
        return [places[0] - places[0].mean(axis=0)], moved
    residual, calm = [], []
    for number, (time, place, mine) in enumerate(zip(times, places, moved, strict=True)):
        there = [_between(time, other) for other in times]
        members = [k for k, both in enumerate(there) if k == number or both.mean() > SEEN_TOGETHER]
        together = np.all([there[k] for k in members], axis=0)
        off = np.full(place.shape, math.nan)
        if len(members) < 2 or together.sum() < FEWEST_IMAGES:
            residual.append(off)
            calm.append(mine)
            continue
        others = [
            np.column_stack([np.interp(time, times[k], p) for p in places[k].T]) for k in members
        ]
        # Third differences in which another star's image moved have its step.
        quiet = [np.interp(time[:-3], times[k][:-3], moved[k]) > 0.999 for k in members]
        common = np.mean(others, axis=0)
        common = common - common[together].mean(axis=0)
        span = (time - time.mean()) / np.ptp(time)
        terms = np.column_stack([np.vander(span, 4), common])[together]
        left = (place - common)[together]
        left = left - left.mean(axis=0)
        left = left - terms @ np.linalg.lstsq(terms, left, rcond=None)[0]
        off[together] = left * math.sqrt(len(members) / (len(members) - 1))
        residual.append(off)
        four = together[:-3] & together[1:-2] & together[2:-1] & together[3:]
        calm.append(mine & four & np.all(quiet, axis=0))
    return residual, calm


def _between(time: Floats, other: Floats) -> Flags:
    """Whether a star has exposures at times (n,) of another, or near before and after them."""
    near = LONGEST_GAP * np.median(np.diff(other))
    after = np.searchsorted(other, time)
    last = len(other) - 1
    before = other[np.clip(after - 1, 0, last)], other[np.clip(after, 0, last)]
    exact = before[1] == time
    inside = (after > 0) & (after <= last) & (before[1] - before[0] <= near)
    return np.asarray(exact | inside)


def _calm(windows: Windows) -> Any:
    """Whether the image stayed, and none is missing, in each four exposures (n - 3,)."""
    step = np.diff(windows.time)
    near = step < 1.5 * np.median(step)
    same = near & (np.diff(windows.corner, axis=0) == 0).all(axis=1)
    return same[:-2] & same[1:-1] & same[2:]


def _third(values: Floats) -> Floats:
    """Third differences (n - 3, ...) in time, of the variance of white noise."""
    count = len(values) - 3
    return np.asarray(sum(w * values[k : k + count] for k, w in enumerate(THIRD)))


def _curve(place: Floats, off: Floats) -> Floats:
    curve = np.full((2, PHASES), math.nan)
    for axis in (0, 1):
        phase = (np.mod(place[:, axis] + 0.5, 1.0) * PHASES).astype(int)
        for n in np.unique(phase):
            curve[axis, n] = off[phase == n, axis].mean()
    return curve - _known_mean(curve, 1)[:, None]


def _known_mean(values: Floats, axis: int) -> Floats:
    """Mean of what is a number; NaN where nothing is."""
    finite = np.isfinite(values)
    many = finite.sum(axis=axis)
    total = np.where(finite, values, 0.0).sum(axis=axis)
    return np.where(many > 0, total / np.maximum(many, 1), np.nan)


def correlation(seen: Floats, predicted: Floats) -> float:
    """Of two curves (2, PHASES), both axes together."""
    both = np.isfinite(seen) & np.isfinite(predicted)
    if both.sum() < 4:
        return math.nan
    return float(np.corrcoef(seen[both], predicted[both])[0, 1])


def photon_transfer(windows: Windows) -> tuple[float, float]:
    """Gain (electron / digital number) and read noise (digital number) of pixels in flight.

        variance = read noise^2 + 1/12 + mean / gain

    Variances are those of third differences in time of one pixel, between exposures whose image did
    not move, in groups of equal level; a line is fitted with weights. Groups that scatter more than
    four standard deviations above it are left out: their pixels flicker, or a star moved by jumps.

    Raises    Refused where there are fewer than eight groups.
    Accuracy  model: the mean has no background of its own; nonlinearity left out.
    """
    rest, slope = _transfer_line(windows)
    return 1 / slope, _read_noise(rest)


def _read_noise(rest: float) -> float:
    """Digital number, of the variance without light."""
    return math.sqrt(max(rest - ROUNDING, 0.0))


def _transfer_line(windows: Windows) -> tuple[float, float]:
    """Variance where there is no light, and how much it grows with the mean; digital numbers."""
    calm = _calm(windows)
    number = windows.number.reshape(len(windows.number), -1)
    level = (number[:-3] + number[1:-2] + number[2:-1] + number[3:])[calm] / 4
    third = _third(number)[calm]
    groups = []
    for pixel in np.flatnonzero(np.ptp(number, axis=0) > 0):
        order = np.argsort(level[:, pixel])
        for part in np.array_split(order, max(len(order) // GROUP, 1)):
            values = third[part, pixel]
            inside = np.abs(values) <= CLIP * 1.4826 * np.median(np.abs(values)) + 1e-9
            if inside.sum() > 8:
                groups.append((level[part, pixel].mean(), values[inside].var(), inside.sum()))
    if len(groups) < 8:
        raise Refused(f"{windows.name} must have more exposures whose image does not move")
    mean, variance, count = np.array(groups).T
    model, kept = np.maximum(variance, 1.0), np.ones(len(mean), bool)
    terms, line = np.column_stack([np.ones(len(mean)), mean]), np.zeros(2)
    for _ in range(20):
        weight = np.sqrt(count / 2) / model * kept
        line = np.linalg.lstsq(terms * weight[:, None], variance * weight, rcond=None)[0]
        model = np.maximum(terms @ line, 0.1)
        kept = (variance - model) * np.sqrt(count / 2) / model < PULL
    return float(line[0]), float(line[1])


def image_difference(seen: Centroids, box: detection.Box, psf: core.Psf) -> float:
    """Worst pixel of the mean images of phase cells less the design's image, of the peak."""
    light, corner = _light(seen.windows, box)
    size = light.shape[1]
    middle = corner + (size - 1) / 2
    moment, worst = seen.place - middle, 0.0
    cell = np.floor((moment + 0.5) * CELLS).astype(int)
    counted = detection.image_mask(size).astype(bool)
    for x in range(CELLS):
        for y in range(CELLS):
            chosen = np.flatnonzero((cell == (x, y)).all(axis=1))
            if len(chosen) < FEWEST:
                continue
            image = light[chosen].mean(axis=0)
            mean = moment[chosen].mean(axis=0)
            some = moment[chosen[:: max(len(chosen) // MEMBERS, 1)]] - mean
            off = _fitted(image, mean, some, psf)[counted]
            worst = max(worst, float(np.abs(off).max() / image.max()))
    return worst


def _fitted(image: Floats, start: Floats, spread: Floats, psf: core.Psf) -> Floats:
    """An image less that of a star at the place and of the flux that fit best."""
    size = len(image)
    far = (size - 1) / 2 + BORDER
    inner = slice(BORDER, BORDER + size)

    def difference(place: Floats) -> Floats:
        model = np.zeros((size + 2 * BORDER, size + 2 * BORDER))
        at = place + spread + far
        stamp(model, psf, at[:, 0].copy(), at[:, 1].copy(), np.full(len(at), 1 / len(at)))
        part = model[inner, inner] * detection.image_mask(size)
        flux = float((part * image).sum() / (part**2).sum())
        return np.asarray(flux * part - image).ravel()

    scale = float(image.max())
    fit = optimize.least_squares(lambda at: difference(at) / scale, start, diff_step=1e-2)
    return difference(fit.x).reshape(image.shape)


def simulate(
    case: Case, stars: Sequence[Windows], devices: int, seed: int, progress: Advance | None = None
) -> list[list[Windows]]:
    """Images that the design makes of the same stars on the same paths.

    Light and path are those of the images that were seen: the median of their light, and their
    places over some exposures. Pixels, noise and, where the design has it, flicker are drawn.

    devices  draws of the pixels;  progress  called with 1 after each star
    Returns  [device][star], as `tracker.box` would take them, 8 x 8 pixels each
    Accuracy  model: the mean image of the field, where the design has several; a star does not move
              within an exposure; one path error of some hundredths of a pixel, by the centroids.
    """
    core.whole(1, 1000, devices=devices)
    box, psf, drawn = case.tracker.box, psf_of(case.instrument), []
    for number, star in enumerate(stars):
        seen = centroids(star, box)
        path = _smoothed(seen.place)
        share = _fraction(psf, box)
        flux = float(np.median(seen.total)) / share * case.instrument.detector.electrons_per_dn
        drawn.append(_drawn(case, seen.windows, path, flux, devices, core.Streams(seed, number)))
        if progress:
            progress(1)
    return [list(device) for device in zip(*drawn, strict=True)]


def _smoothed(place: Floats) -> Floats:
    kernel = np.ones(SMOOTH) / SMOOTH
    padded = np.pad(place, ((SMOOTH // 2, SMOOTH // 2), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(axis, kernel, "valid") for axis in padded.T])


def _fraction(psf: core.Psf, box: detection.Box) -> float:
    """Fraction of a star's light in its image, the star in the middle."""
    image = np.zeros((box.size + 2 * BORDER, box.size + 2 * BORDER))
    middle = np.array([(len(image) - 1) / 2])
    stamp(image, psf, middle, middle, np.ones(1))
    inner = image[BORDER:-BORDER, BORDER:-BORDER]
    return float((inner * detection.image_mask(box.size)).sum())


def _drawn(
    case: Case, seen: Windows, path: Floats, flux: float, devices: int, streams: core.Streams
) -> list[Windows]:
    """One star on detectors side by side, each a tile of one frame."""
    low = np.floor(path.min(axis=0)).astype(int) - 2 * BORDER
    side = np.ceil(path.max(axis=0)).astype(int) + 2 * BORDER - low
    device = replace(
        case.instrument.detector,
        columns=int(side[0]) * devices,
        rows=int(side[1]),
        device_seed=streams.seed * 1000 + streams.trial,
        region=None,
    )
    shift = np.arange(devices) * side[0]
    gain, empty = response(device), sky_electrons(case) + np.asarray(dark(device)) * device.exposure
    state, psf, box = flickering(device, streams), psf_of(case.instrument), case.tracker.box
    settings = case.tracker.detection
    plan = detection.plan_detection(settings, psf, partial(frames_of_map, device, settings))
    at = path - low
    corner = np.rint(np.column_stack([at[0, 0] + shift, np.full(devices, at[0, 1])]) + 0.5)
    corner, numbers, corners, acquired = corner.astype(np.int64), [], [], []
    for k, (x, y) in enumerate(at):
        light = np.zeros((device.rows, device.columns))
        stamp(light, psf, x + shift, np.full(devices, y), np.full(devices, flux))
        if gain is not None:
            light *= gain
        if state and k:
            state.later(float(seen.time[k] - seen.time[k - 1]))
        frame = frame_of(
            light + empty,
            device,
            core.Streams(streams.seed, 10**6 * (1 + streams.trial) + k),
            state=state,
        )
        corners.append(corner - 4)
        numbers.append(_cut(frame.image, corner, device))
        if seen.acquired is not None:
            acquired.append(_acquired(frame, corner, plan))
        corner = _followed(frame, corner, box, plan)
    origin = np.column_stack([low[0] - shift, np.full(devices, low[1])])
    return [
        replace(
            seen,
            number=np.array([n[k] for n in numbers]),
            background=None,
            corner=np.array([c[k] for c in corners]) + origin[k],
            acquired=np.array([a[k] for a in acquired]) if acquired else None,
        )
        for k in range(devices)
    ]


def _cut(image: Any, corner: Ints, device: Detector) -> Floats:
    """Windows (m, 8, 8) of a frame about corners, less the offset."""
    parts = [image[y - 4 : y + 4, x - 4 : x + 4] for x, y in corner]
    return np.asarray(parts, float) - device.offset


class FlightDifference(NamedTuple):
    """One figure of one star: as seen and as predicted, and what it points to in the design.

    seen       95 % by a jackknife over eight blocks of time
    predicted  median and 95 % of the devices drawn
    untested   why the two cannot differ by the design; empty: they can
    """

    star: str
    name: str
    seen: Interval
    predicted: Interval
    key: str
    untested: str = ""

    @property
    def ratio(self) -> float:
        """Predicted over seen; NaN where either is none."""
        either = self.predicted.value and self.seen.value
        return self.predicted.value / self.seen.value if either else math.nan

    @property
    def differs(self) -> bool:
        """Whether the intervals do not meet, of what the comparison tests."""
        if self.untested:
            return False
        return self.predicted.low > self.seen.high or self.predicted.high < self.seen.low


@printed
class FlightComparison(NamedTuple):
    """A comparison of all stars.

    curves  star: as seen and as predicted (2, PHASES), mean of the devices, pixel
    """

    differences: list[FlightDifference]
    curves: dict[str, tuple[Floats, Floats]]


def compare_flown(
    case: Case,
    stars: Sequence[Windows],
    devices: int = 16,
    seed: int = 0,
    progress: Advance | None = None,
) -> FlightComparison:
    """Measure images in flight and those that the design predicts, by the same code.

    The predicted images have the light that is seen. So the brightness of a star tests transmission
    and quantum efficiency only where its `magnitude_g` is known: what is predicted is then scaled
    to the light of that magnitude. The background is not tested where the offset of the numbers is
    not that of the design.

    Accuracy  model: of the light by a magnitude that of `photon_irradiance`, for a sunlike star.
    """
    box, psf = case.tracker.box, psf_of(case.instrument)
    drawn = [measure(unit, box, None) for unit in simulate(case, stars, devices, seed, progress)]
    electrons = case.instrument.detector.electrons_per_dn
    noise = case.instrument.detector.noise / electrons
    measured = measure(stars, box, psf, noise)
    parts = [measure(block, box, None, noise) for block in _blocks(stars)]
    differences, curves = [], {}
    stated = {"image": 0.0, "gain": electrons, "read_noise": noise, "offset": 0.0}
    for n, star in enumerate(stars):
        for name, value in measured[n].scalar.items():
            seen = _jackknifed(value, [part[n].scalar[name] for part in parts])
            predicted = _middle([unit[n].scalar[name] for unit in drawn])
            if name == "image":
                seen = Interval(value, value, value)
            if name in stated:
                predicted = Interval(*[stated[name]] * 3)
            untested = ""
            if name == "brightness":
                untested = "" if math.isfinite(star.magnitude_g) else SCALED
                if not untested:
                    bright = _light_by_magnitude(case, star)
                    predicted = Interval(
                        bright * predicted.value, bright * predicted.low, bright * predicted.high
                    )
            if math.isfinite(seen.value):
                row = FlightDifference(star.name, name, seen, predicted, KEYS[name], untested)
                differences.append(row)
        curves[star.name] = (
            measured[n].curve,
            _known_mean(np.array([unit[n].curve for unit in drawn]), 0),
        )
    return FlightComparison(_of_known_offset(differences), curves)


SCALED = (
    "the predicted images have the light that is seen, so that neither transmission nor quantum "
    "efficiency is tested; give magnitude_g, Gaia's G of the star"
)


def _light_by_magnitude(case: Case, star: Windows) -> float:
    """Light of a sunlike star of this G over that of the predicted images."""
    injected = float(np.median(centroids(star, case.tracker.box).total))
    injected *= case.instrument.detector.electrons_per_dn
    image = _fraction(psf_of(case.instrument), case.tracker.box)
    return scale(case).star * 10 ** (-0.4 * star.magnitude_g) * image / injected


def _of_known_offset(differences: list[FlightDifference]) -> list[FlightDifference]:
    """The differences; those of the background are not tested where the offset differs."""
    off = {
        row.star: row
        for row in differences
        if row.name == "offset" and abs(row.seen.value) > OFF * (row.seen.high - row.seen.value)
    }
    return [
        row._replace(
            untested="the numbers have another offset than instrument.detector.offset: by photon "
            f"transfer {off[row.star].seen.value:.4g} digital numbers are left where there is no "
            "light"
        )
        if row.name == "background" and row.star in off
        else row
        for row in differences
    ]


def _blocks(stars: Sequence[Windows]) -> Iterable[list[Windows]]:
    """The stars without each of eight blocks of time."""
    begin, end = min(s.time[0] for s in stars), max(s.time[-1] for s in stars)
    edges = np.linspace(begin, end, BLOCKS + 1)
    for low, high in pairwise(edges):
        yield [star.of((star.time < low) | (star.time >= high)) for star in stars]


def _jackknifed(value: float, parts: list[float]) -> Interval:
    """95 % by leaving out each block of time in turn."""
    spread = np.array(parts) - np.mean(parts)
    sigma = math.sqrt((BLOCKS - 1) / BLOCKS * float((spread**2).sum()))
    return Interval(value, value - 1.96 * sigma, value + 1.96 * sigma)


def _middle(values: list[float]) -> Interval:
    """Median and 95 % of the devices."""
    finite = [value for value in values if math.isfinite(value)] or [math.nan]
    low, middle, high = np.percentile(finite, [2.5, 50, 97.5])
    return Interval(float(middle), float(low), float(high))
