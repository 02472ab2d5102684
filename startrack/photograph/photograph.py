"""Frame of an unknown camera -> its attitude and lens: what is tried, in turn, and what was seen.

A photograph may hold stars larger than the detection's windows, be mirrored, squeezed or of a lens
of any field. Each try takes spots of the frame, in a view, to the cameras of `identify_blind`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack import identification
from startrack.core import Camera, Estimate, Flags, Frame, Matches, Spots, deg, within
from startrack.detection import Detection, detect, plan_detection, refined, streak_of
from startrack.identification import cameras
from startrack.observation import with_smear

# Sigma of the detection: an image of few faint stars is searched twice.
THRESHOLDS = (5.0, 4.0)
SCALES = (1, 2, 4, 8)  # by which the image is reduced, so that stars of any size fit a window
# Sigma and scales of spots, and whether each part of the image gives as many: all scales, the same
# without the parts that are full of what is no star, the file's own scale, and without the finest.
_Look = tuple[float, tuple[int, ...], bool]
FIRST: _Look = THRESHOLDS[0], SCALES, False
COARSER: _Look = THRESHOLDS[0], SCALES[1:], False
LOOKS: tuple[_Look, ...] = (
    FIRST,
    (*FIRST[:2], True),
    (THRESHOLDS[0], SCALES[:1], False),
    COARSER,
    *((THRESHOLDS[0], SCALES[k:], False) for k in (2, 3)),
    (THRESHOLDS[1], SCALES, False),
    (THRESHOLDS[1], SCALES[:1], False),
)
PARTS = 4  # of an image, along each side
# Hypotheses of a try over those of the settings: of one field, and of all round by round. Most
# images take less than the first, so all is tried with few before anything is with many.
FULL, ROUNDS = 1.0, (0.0125, 0.1)
# Of the longer side, match radius: an unknown lens moves stars by this much. A smaller one takes
# ten times the hypotheses where the lens is distorted, a larger one more time for each.
BENT = 0.004
LARGEST = 1500  # pixel of the longer side of an image in whose streaks a motion is looked for
LEAST_STREAK = 4.0  # pixel of that image; shorter ones are stars that a lens draws out
LEAST_SIDE = 100  # pixel of a reduced image; a smaller one shows too few stars
MOST_OF_A_SCALE, MOST_SPOTS = 400, 100  # spots, brightest first: the middle needs more
# Of a coarse spot's flux over that of the finer ones that it covers, from which on they have lost
# light. Chosen by hand: below, a star of the width that the windows are made for would be replaced.
GROWTH, SURE = 1.4, 2.0  # 1, and sigma of the coarse flux
COVERED = 2.5  # pixel of the reduced image: half the side of the window that measures a spot
FLOOR = 0.05  # pixel of the reduced image, error of a centroid beyond its noise
# Shapes of images, columns over rows; one may have been squeezed into another.
SHAPES = (4 / 3, 3 / 2, 16 / 9, 1.0, 3 / 4, 2 / 3, 9 / 16)
SAME_SHAPE, MOST_SQUEEZED = 1.03, 2.5  # ratio of shapes that triangles bear; that is tried
ROUND, HIDDEN = 1.15, 1.5  # elongation of round stars; squeeze that such stars may hide
# Radian across the columns, of fisheyes whose middle alone is tried.
FISHEYES = tuple((np.geomspace(90, 240, 12) * deg).tolist())
MANY = 0.5  # of the spots, stars from which on an image is not tried in other shapes
SQUARED = 3  # times that a view is corrected by what the lens that was found shows
SLACK = 0.01  # of a field beyond the tolerance of the given one: what distortion changes
MIDDLE_TOLERANCE = 0.05  # of their focal length
MIDDLE = 75 * deg  # of a fisheye, which is tried
# Pixels of the highest value from which on it is that of saturation, and from what fraction of it.
FEW_CLIPPED, CLIPPED = 4, 0.98
# What a refusal names, chosen by hand: area that is saturated, range of the background over its
# level, number of spots, length over width of stars, and degrees from rows or columns.
MOST_SHAPES, LEAST_SHAPES, THINNEST = 60, 4, 0.99  # stars whose shape is measured
MUCH_CLIPPED, UNEVEN, FEW, DRAWN_OUT, ALONG = 0.001, 0.5, 10, 1.4, 10.0


class PhotographView(NamedTuple):
    """How the pixels of a file become those of a camera with square pixels.

    mirrored  whether left and right are exchanged
    aspect    width of a pixel over its height; the longer side of the pixel keeps its number
    middle    pixel, side of a square in the middle that alone is taken; None: all
    """

    mirrored: bool = False
    aspect: float = 1.0
    middle: int | None = None

    def size(self, columns: int, rows: int) -> tuple[int, int]:
        """Columns and rows of the view of a file of that size."""
        if self.middle is not None:
            return self.middle, self.middle
        x, y = columns * min(self.aspect, 1.0), rows * min(1 / self.aspect, 1.0)
        return max(round(x), 1), max(round(y), 1)

    def frame(self, frame: Frame) -> Frame:
        """The image as the camera of the solution sees it."""
        rows, columns = frame.image.shape
        image = frame.image[:, ::-1] if self.mirrored else frame.image
        size = self.size(columns, rows)
        if self.middle is not None:
            left, top = (columns - self.middle) // 2, (rows - self.middle) // 2
            image = image[max(top, 0) :, max(left, 0) :][: self.middle, : self.middle]
        elif self.aspect != 1.0:
            image = cv2.resize(np.asarray(image, np.float32), size, interpolation=cv2.INTER_AREA)
        return replace(frame, image=image)

    def spots(self, spots: Spots, columns: int, rows: int) -> Spots:
        """The spots of a file where the camera of the solution sees them."""
        width, height = self.size(columns, rows)
        x = columns - 1 - spots.x if self.mirrored else spots.x
        covariance = spots.covariance.copy()
        if self.mirrored:
            covariance[:, [0, 1], [1, 0]] *= -1
        if self.middle is not None:
            x, y = x - (columns - width) // 2, spots.y - (rows - height) // 2
            inside = (np.minimum(x, y) > -0.5) & (np.maximum(x, y) < width - 0.5)
            return _chosen(replace(spots, x=x, y=y, covariance=covariance), inside)
        by = np.array([width / columns, height / rows])
        x, y = (x + 0.5) * by[0] - 0.5, (spots.y + 0.5) * by[1] - 0.5
        return replace(spots, x=x, y=y, covariance=covariance * by * by[:, None])

    def __str__(self) -> str:
        parts = ["mirrored"] if self.mirrored else []
        if self.aspect != 1.0:
            parts.append(f"pixels {self.aspect:.3g} times as wide as high")
        if self.middle is not None:
            parts.append(f"the middle {self.middle} x {self.middle} pixels")
        return ", ".join(parts)


@dataclass(frozen=True, eq=False)
class Photograph:
    """What was found of a photograph.

    spots      of the view, brightest first
    matches    of these, with the camera that was found
    estimate   attitude of that camera, the covariance that of `axis`
    axis       attitude of the axis through the centre of the view; None where there is none
    view       in which the camera sees the file
    as_hinted  whether the field is the given one within its tolerance; None: none was given
    streak     pixel (x, y) of the file that each star moved in the exposure, its sign open; None:
               stars are points
    """

    spots: Spots
    matches: Matches
    estimate: Estimate
    axis: Rotation | None
    view: PhotographView
    as_hinted: bool | None = None
    streak: tuple[float, float] | None = None

    @property
    def field(self) -> float:
        """Radian that the columns of the file span by the lens that was found."""
        camera = self.matches.camera
        ends = [[-0.5, (camera.rows - 1) / 2], [camera.columns - 0.5, (camera.rows - 1) / 2]]
        left, right = camera.unproject(np.array(ends))
        return math.acos(min(max(float(left @ right), -1.0), 1.0))

    @property
    def aspect(self) -> float:
        """Width of a pixel over its height, with what the stars show beside that of the view."""
        polynomial = self.matches.camera.polynomial
        along, down = (polynomial.x[1], polynomial.y[2]) if polynomial else (0.0, 0.0)
        return self.view.aspect * (1 + down) / (1 + along)

    @property
    def note(self) -> str:
        """What the text says beside the numbers: empty, or words after a semicolon."""
        text = "; the field is not the given one" if self.as_hinted is False else ""
        if self.streak:
            text += f"; stars are streaks of {math.hypot(*self.streak):.1f} px"
        if polynomial := self.matches.camera.polynomial:
            text += (
                f"; pixels {self.aspect:.4f} times as wide as high, shear {polynomial.x[2]:+.4f}"
            )
        return text


class _Try(NamedTuple):
    """Spots, view and cameras of a try.

    share  of the probability of a false match; more hypotheses of the same need no other
    """

    threshold: float
    scales: tuple[int, ...]
    spread: bool
    view: PhotographView
    cameras: list[tuple[Camera, float]]
    share: float = 0.0


def solve_photograph(
    frame: Frame,
    indexes: identification.PatternIndexes,
    settings: identification.Identification,
    hint: float | None = None,
    aspect: float | None = None,
) -> Photograph:
    """Try one view and one camera after the other until the attitude is found.

    First the spots of `LOOKS` with cameras of the hint; then, with few hypotheses each and again
    with more, these with all fields from 1.5 to 90 degrees, mirrored, squeezed from other common
    shapes, and the middle of fisheyes of up to 180 degrees.
    `settings.max_false_probability` bounds all tries together: the first, or those by the hint,
    have half of it, the others share the rest.

    settings  its `focal_tolerance` is that of the hint
    hint      radian, field of view across the columns; None: unknown
    aspect    width of a pixel over its height; None: 1, then those of common shapes
    Raises    ValueError where hint or aspect are out of range.
    Accuracy  model: as for `fit_lens`; the bound on false matches as for `identify`. None of 300
              images without a sky is solved with a bound of 1 %, a thousand times the default.
    """
    if hint is not None:
        within(1e-3, FISHEYES[-1], hint=hint)
    if aspect is not None:
        within(0.1, 10, aspect=aspect)
    rows, columns = frame.image.shape
    sought = _Sought(_Looks(frame), indexes, settings)
    shape = _shape(frame.image, sought.looks(*FIRST[:2]))
    squeezed = [] if aspect else squeezes(columns, rows, shape.elongation)
    near, rest = _tries(columns, rows, hint, settings.focal_tolerance, aspect, squeezed)
    unsolved, smear = [], None
    if shape.length > DRAWN_OUT:  # oblong pixels are likely, or that the camera turned
        rest.sort(key=lambda guess: guess.view.aspect == 1.0)
        smear = sought.looks.turned
    if smear:
        first = (near or [guess for guess in rest if guess.view.aspect == (aspect or 1.0)])[0]
        # Half of the probability of a false match is theirs, and that of all others half of it.
        near = [guess._replace(share=guess.share / 2) for guess in near]
        rest = [guess._replace(share=guess.share / 2) for guess in rest]
        photo = sought._replace(looks=_Looks(frame, smear)).attempt(first._replace(share=0.5), FULL)
        if photo.axis is not None:
            return _as_hinted(replace(photo, streak=smear), hint, settings)
        unsolved.append(photo)
    middles = [guess for guess in rest if guess.view.middle]  # of one camera each
    rounds = (FULL, near), *((effort, rest) for effort in ROUNDS), (FULL, middles)
    for effort, tries in rounds:
        for guess in tries:
            photo = sought.attempt(guess, effort)
            if photo.axis is not None:
                return _as_hinted(sought.squared(photo, guess, squeezed), hint, settings)
            unsolved.append(photo)
    best = min(unsolved, key=lambda photo: photo.estimate.false_probability)
    tried, seen = _tried(near + rest), seen_text(frame, sought.looks)
    reason = f"{best.estimate.reason}; {tried}. {seen}"
    return replace(best, estimate=replace(best.estimate, reason=reason))


class _Sought(NamedTuple):
    """A frame's spots, and what stars they are compared with."""

    looks: _Looks
    indexes: identification.PatternIndexes
    settings: identification.Identification

    def attempt(self, guess: _Try, effort: float) -> Photograph:
        """The first camera of a try that finds an attitude, with what the stars show of its lens.

        effort  of the hypotheses of the settings
        """
        settings, stars, index_of = self.settings, self.indexes.stars, self._index
        rows, columns = self.looks.frame.image.shape
        size = guess.view.size(columns, rows)
        spots = guess.view.spots(self.looks(guess.threshold, guess.scales), columns, rows)
        spots = _chosen(_spread(spots, *size) if guess.spread else spots, slice(MOST_SPOTS))
        tight = replace(
            settings,
            max_false_probability=settings.max_false_probability * guess.share,
            max_hypotheses=max(round(effort * settings.max_hypotheses), 1),
            match_radius=max(settings.match_radius, BENT * max(size)),
        )
        matches = identification.identify_blind(spots, *size, stars, index_of, tight, guess.cameras)
        reason, attitude, axis, rms = matches.reason, matches.icrs_to_camera, None, math.nan
        covariance, count = np.full((3, 3), np.nan), 0
        if attitude is not None:
            matches, axis, covariance, rms = identification.fit_lens(
                spots, matches, stars, index_of(matches.camera), settings
            )
            attitude, count = matches.icrs_to_camera, len(matches)
            reason = f"{count} of {len(spots)} spots are stars of the catalogue"
        estimate = Estimate(
            matches.status, reason, attitude, covariance, rms, count, matches.false_probability
        )
        return Photograph(spots, matches, estimate, axis, guess.view)

    def squared(self, photo: Photograph, guess: _Try, squeezed: list[float]) -> Photograph:
        """The solution in a view of square pixels, where the stars show that those are oblong.

        The lens is fitted by what is small; the view takes what is large. Where few spots are
        stars, they may be those of the middle of an image that was squeezed, by a common ratio.
        The same hypothesis is found again, which is no further chance of a false match.
        """
        rows, columns = self.looks.frame.image.shape
        few = len(photo.matches) < MANY * len(photo.spots)
        tried = squeezed if few and photo.view.middle is None else []
        for _ in range(SQUARED):
            best = photo
            if abs(math.log(photo.aspect / photo.view.aspect)) > math.log(SAME_SHAPE):
                tried = [photo.aspect, *tried]
            for aspect in tried:
                view = photo.view._replace(aspect=aspect)
                field, tolerance = photo.matches.camera.fov_x, self.settings.focal_tolerance
                near = identification.cameras_of(*view.size(columns, rows), field, tolerance)
                again = self.attempt(guess._replace(view=view, cameras=near, share=1.0), FULL)
                best = max(best, again, key=lambda photo: photo.estimate.stars)
            if best is photo:
                break
            photo, tried = best, []
        return photo

    def _index(self, camera: Camera) -> identification.PatternIndex:
        """Of every other field: half as many to read, each as good for its neighbours."""
        field, step = min(camera.fov_x, camera.fov_y), 2 * math.log(1.1)
        coarse = math.exp(math.floor(math.log(field) / step) * step) * (1 + 1e-9)
        return self.indexes(Camera.from_field_of_view(1, 1, coarse))


def _as_hinted(
    photo: Photograph, hint: float | None, settings: identification.Identification
) -> Photograph:
    """The solution, and whether its field is the given one."""
    if hint is None:
        return photo
    own, given = (
        math.tan(min(field, identification.WIDEST_PINHOLE) / 4) for field in (photo.field, hint)
    )
    off = abs(math.log(own / given))
    return replace(photo, as_hinted=off <= settings.focal_tolerance + SLACK)


def _tried(tries: list[_Try]) -> str:
    """What was tried, in words."""
    focal = [lens.fov_x for guess in tries for lens, _ in guess.cameras if not guess.view.middle]
    text = f"tried were fields from {min(focal) / deg:.2g} to {max(focal) / deg:.2g} deg"
    text += f", stars of 1 to {SCALES[-1]} times the usual size, mirrored"
    if squeezed := sorted({guess.view.aspect for guess in tries} - {1.0}):
        text += f", pixels {', '.join(f'{a:.2f}' for a in squeezed)} as wide as high"
    return text + (", fisheyes to 180 deg" if any(guess.view.middle for guess in tries) else "")


def _tries(
    columns: int,
    rows: int,
    hint: float | None,
    tolerance: float,
    aspect: float | None,
    squeezed: list[float],
) -> tuple[list[_Try], list[_Try]]:
    """What is tried by the hint, and what is tried without it, each in turn."""
    as_it_is = PhotographView(aspect=aspect or 1.0)
    size = as_it_is.size(columns, rows)
    every = cameras(*size, hint)
    looks = [look for look in LOOKS if min(columns, rows) >= LEAST_SIDE * look[1][0]]
    rest = [_Try(*look, as_it_is, every) for look in looks or [FIRST]]
    for view in [
        as_it_is._replace(mirrored=True),
        *(PhotographView(aspect=ratio) for ratio in squeezed),
    ]:
        made = cameras(*view.size(columns, rows), hint, fisheyes=False)
        rest += [_Try(*look, view, made) for look in (FIRST, COARSER) if look in (FIRST, *looks)]
    for field in FISHEYES:
        rest += _middle(columns, rows, field, MIDDLE_TOLERANCE)
    if hint is None:
        return [], _shared(rest[:1]) + _shared(rest[1:])
    made = identification.cameras_of(*size, hint, tolerance)
    near = [guess._replace(cameras=made) for guess in rest if made and guess.view == as_it_is]
    return _shared(near or _middle(columns, rows, hint, tolerance)), _shared(rest)


def _shared(tries: list[_Try]) -> list[_Try]:
    """The tries with half of the probability of a false match among them."""
    return [guess._replace(share=0.5 / len(tries)) for guess in tries]


def _middle(columns: int, rows: int, field: float, tolerance: float) -> list[_Try]:
    """The middle of a fisheye whose columns span a field, where it is in the image."""
    side = round(MIDDLE * columns / field)
    if not LEAST_SIDE <= side <= min(columns, rows):
        return []
    made = [(identification.fisheye(side, side, MIDDLE), tolerance)]
    return [_Try(*FIRST, PhotographView(middle=side), made)]


def squeezes(columns: int, rows: int, elongation: float) -> list[float]:
    """Widths of a pixel over its height, if the image has been squeezed from another shape.

    A star that was round is as long along the rows as pixels are narrow. Its pixels may hide
    that, but not turn it round.

    elongation  1, of stars along the rows over that along the columns
    """
    ratios = [shape * rows / columns for shape in SHAPES]
    tried = [r for r in ratios if math.log(SAME_SHAPE) < abs(math.log(r)) < math.log(MOST_SQUEEZED)]
    if max(elongation, 1 / elongation) < ROUND:
        return [r for r in tried if abs(math.log(r)) < math.log(HIDDEN)]
    return [r for r in tried if (r < 1) == (elongation > 1)]


class _Looks:
    """The spots of a frame, by threshold and scales, each found once.

    smear  pixel of the frame, that each star moved
    """

    def __init__(self, frame: Frame, smear: tuple[float, float] = (0.0, 0.0)) -> None:
        self.frame, self.smear = frame, smear
        self._reduced = {1: frame}
        self._spots: dict[tuple[float, int], Spots] = {}

    def __call__(self, threshold: float, scales: tuple[int, ...]) -> Spots:
        """The spots of these scales, in pixels of the frame, brightest first.

        A star is measured at the finest scale whose window holds its light: where a coarser one
        has far more of it than the finer spots that it covers, it takes their place.
        """
        least = min(self.frame.image.shape)
        used = [s for s in scales if least // s >= LEAST_SIDE] or [1]
        kept = self._at(threshold, used[0])
        for scale in used[1:]:
            kept = _grown(kept, self._at(threshold, scale), COVERED * scale)
        return _chosen(kept, np.argsort(-kept.flux, kind="stable"))

    @cached_property
    def turned(self) -> tuple[float, float] | None:
        """Pixel of the frame that each star moved, where its streaks show it."""
        scale = 1
        while max(self.frame.image.shape) > LARGEST * scale:
            scale *= 2
        settings = Detection(saturation=self.clipped)
        frame, plan = self._frame(scale), plan_detection(settings, None)
        streak = streak_of(frame, plan)
        if not streak.seen or math.hypot(streak.x, streak.y) < LEAST_STREAK:
            return None
        spots = detect(frame, replace(settings, smear_x=streak.x, smear_y=streak.y))
        streak = refined(frame, plan, spots, streak)
        return scale * streak.x, scale * streak.y

    @cached_property
    def clipped(self) -> float | None:
        """Digital number from which on pixels are saturated; None where none is."""
        image = self.frame.image
        highest = float(np.nanmax(image))
        at_top = np.count_nonzero(image == highest)
        return CLIPPED * highest if highest > 0 and at_top >= FEW_CLIPPED else None

    def _at(self, threshold: float, scale: int) -> Spots:
        if (threshold, scale) not in self._spots:
            settings = Detection(
                threshold=threshold, saturation=self.clipped, max_spots=MOST_OF_A_SCALE
            )
            settings = with_smear(settings, *(part / scale for part in self.smear))
            self._spots[threshold, scale] = _enlarged(detect(self._frame(scale), settings), scale)
        return self._spots[threshold, scale]

    def _frame(self, scale: int) -> Frame:
        """The frame with the mean of each square of N x N pixels."""
        if scale not in self._reduced:
            finer = self._frame(scale // 2)
            rows, columns = (side // 2 for side in finer.image.shape)
            image = np.asarray(finer.image[: 2 * rows, : 2 * columns], np.float32)
            self._reduced[scale] = Frame(
                cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA),
                finer.exposure,
                4 * finer.electrons_per_dn,
                finer.offset,
                2 * finer.read_noise,
            )
        return self._reduced[scale]


def _chosen(spots: Spots, which: slice | NDArray[np.integer] | Flags) -> Spots:
    return Spots(*(values[which] for values in vars(spots).values()))


def _spread(spots: Spots, columns: int, rows: int) -> Spots:
    """The spots so that the brightest of each part of the image come first, then the second ones.

    Parts full of leaves or lamps then have no more of the first spots than others.
    """
    across, down = (spots.x + 0.5) / columns, (spots.y + 0.5) / rows
    part = np.floor(PARTS * across) * PARTS + np.floor(PARTS * down)
    rank = np.array([np.count_nonzero(part[:k] == here) for k, here in enumerate(part)], np.int64)
    return _chosen(spots, np.argsort(rank, kind="stable"))


def _enlarged(spots: Spots, scale: int) -> Spots:
    """Spots of a reduced frame in pixels of the frame, with what pixels leave of a centroid."""
    if scale == 1:
        return spots
    floor = (FLOOR * scale) ** 2 * np.eye(2)
    return Spots(
        (spots.x + 0.5) * scale - 0.5,
        (spots.y + 0.5) * scale - 0.5,
        spots.flux * scale**2,
        spots.covariance * scale**2 + floor,
        spots.snr,
        spots.area * scale**2,
    )


def _grown(fine: Spots, coarse: Spots, half_side: float) -> Spots:
    """Fine spots, and coarse ones in the place of those that have lost their light.

    half_side  pixel, half the side of the square that a coarse spot is measured in
    """
    off_x, off_y = (
        np.abs(np.subtract.outer(values, others))
        for values, others in ((coarse.x, fine.x), (coarse.y, fine.y))
    )
    covered = np.maximum(off_x, off_y) <= half_side
    light = coarse.flux * (1 - SURE / np.maximum(coarse.snr, SURE))
    taken = np.asarray(light > GROWTH * (covered @ np.maximum(fine.flux, 0.0)))
    kept = np.asarray(~covered[taken].any(axis=0))
    fine, coarse = _chosen(fine, kept), _chosen(coarse, taken)
    pairs = zip(vars(fine).values(), vars(coarse).values(), strict=True)
    return Spots(*(np.concatenate(pair) for pair in pairs))


def seen_text(frame: Frame, looks: _Looks) -> str:
    """What may keep an image from being solved, in words, beginning with "The image ..."."""
    image, spots = frame.image, looks(THRESHOLDS[0], SCALES)
    seen = []
    if looks.clipped is not None:
        share = np.count_nonzero(image >= looks.clipped) / image.size
        if share > MUCH_CLIPPED:
            seen.append(f"is saturated over {100 * share:.2g} % of its area")
    grid = cv2.resize(np.asarray(image, np.float32), (16, 16), interpolation=cv2.INTER_AREA)
    low, high = np.nanpercentile(grid, (5, 95))
    if high - low > UNEVEN * max(float(np.nanmedian(grid)), 1.0):
        seen.append(f"has a background from {low:.3g} to {high:.3g}")
    if len(spots) < FEW:
        seen.append(f"has {len(spots)} spots, where a solution needs some ten stars")
    shape = _shape(image, spots)
    if shape.length > DRAWN_OUT:
        off = abs((shape.angle + 45) % 90 - 45)
        why = "oblong pixels, which --aspect takes, or motion" if off < ALONG else "motion"
        seen.append(
            f"has stars {shape.length:.1f} times as long as wide, at {shape.angle:.0f} deg ({why})"
        )
    return f"The image {'; it '.join(seen)}" if seen else "The image shows no reason"


class _Shape(NamedTuple):
    """Of the typical star.

    length      1, over its width
    angle       degree, of its length from the rows, clockwise
    elongation  1, its length along the rows over that along the columns
    """

    length: float = 1.0
    angle: float = 0.0
    elongation: float = 1.0


def _shape(image: NDArray[np.number], spots: Spots) -> _Shape:
    """The typical shape from the second moments of the light above a fifth of the peak."""
    rows, columns = image.shape
    tensors = []
    for x, y, area in zip(spots.x, spots.y, spots.area, strict=True):
        half = int(np.clip(1.5 * math.sqrt(area), 5, 40))
        left, top = round(x) - half, round(y) - half
        if min(left, top) < 0 or left + 2 * half >= columns or top + 2 * half >= rows:
            continue
        window = np.asarray(image[top : top + 2 * half + 1, left : left + 2 * half + 1], float)
        light = window - np.median(window)
        light[light < 0.2 * light.max()] = 0.0
        if light.sum() > 0:
            v, u = np.indices(light.shape)
            weight = light / light.sum()
            du, dv = u - (weight * u).sum(), v - (weight * v).sum()
            tensors.append([(weight * both).sum() for both in (du * du, du * dv, dv * dv)])
        if len(tensors) == MOST_SHAPES:
            break
    if len(tensors) < LEAST_SHAPES:
        return _Shape()
    # A pixel itself spreads light; so no star is thinner.
    xx, xy, yy = np.median(tensors, axis=0) + np.array([1, 0, 1]) / 12
    middle = (xx + yy) / 2
    # Medians one by one are of no star, which may be thinner than a line.
    apart = min(math.hypot((xx - yy) / 2, xy), THINNEST * middle)
    angle = math.degrees(0.5 * math.atan2(2 * xy, xx - yy)) % 180
    return _Shape(math.sqrt((middle + apart) / (middle - apart)), angle, math.sqrt(xx / yy))
