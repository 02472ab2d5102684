"""Frame of an unknown camera -> its attitude and lens, and its spots.

Each try takes spots of the frame, in a view, to the cameras of `identify_blind`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import identification
from startrack.core import Camera, Estimate, Frame, Matches, Spots, within
from startrack.photograph.spots import (
    DRAWN_OUT,
    ScaledSpots,
    chosen,
    evenly_spread,
    seen_text,
    star_shape,
)
from startrack.photograph.tries import (
    FIRST,
    FISHEYES,
    SAME_SHAPE,
    Try,
    squeezes,
    tried_text,
    tries_of,
)
from startrack.photograph.view import PhotographView

# Hypotheses of a try over those of the settings: of one field, and of all round by round. Most
# images need fewer than the first number, so all tries are made with few hypotheses before any with
# many.
FULL, ROUNDS = 1.0, (0.0125, 0.1)
# Of the longer side, match radius: an unknown lens moves stars by this much. A smaller radius takes
# ten times the hypotheses for a distorted lens; a larger one takes more time for each.
BENT = 0.004
MOST_SPOTS = 100  # brightest first: the middle needs more
MANY = 0.5  # of the spots: with more stars, an image is not tried in other shapes
SQUARED = 3  # corrections of a view by the lens that was found
SLACK = 0.01  # of a field, additional tolerance of the given one, for distortion


@dataclass(frozen=True, eq=False)
class Photograph:
    """Result of a photograph.

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
        """Field of view across the columns of the file, by the found lens, radian."""
        camera = self.matches.camera
        ends = [[-0.5, (camera.rows - 1) / 2], [camera.columns - 0.5, (camera.rows - 1) / 2]]
        left, right = camera.unproject(np.array(ends))
        return math.acos(min(max(float(left @ right), -1.0), 1.0))

    @property
    def aspect(self) -> float:
        """Width of a pixel over its height: of the view, corrected by the stars."""
        polynomial = self.matches.camera.polynomial
        along, down = (polynomial.x[1], polynomial.y[2]) if polynomial else (0.0, 0.0)
        return self.view.aspect * (1 + down) / (1 + along)

    @property
    def note(self) -> str:
        """Remark after the numbers of the text: empty, or words after a semicolon."""
        text = "; the field is not the given one" if self.as_hinted is False else ""
        if self.streak:
            text += f"; stars are streaks of {math.hypot(*self.streak):.1f} px"
        if polynomial := self.matches.camera.polynomial:
            text += (
                f"; pixels {self.aspect:.4f} times as wide as high, shear {polynomial.x[2]:+.4f}, "
                "to which refraction of the air may contribute"
            )
        return text


def solve_photograph(
    frame: Frame,
    indexes: identification.PatternIndexes,
    settings: identification.Identification,
    hint: float | None = None,
    aspect: float | None = None,
    mirrored: bool = False,
) -> Photograph:
    """Try one view and one camera after the other until the attitude is found.

    First the spots of `LOOKS` are tried with cameras of the hint. Then, with few hypotheses each
    and again with more, they are tried with all fields from 1.5 to 90 degrees, mirrored, squeezed
    from other common shapes, and in the middle of fisheyes of up to 180 degrees and of other wide
    lenses. `settings.max_false_probability` bounds all tries together: the first try, or the tries
    by the hint, have half of it; the others share the rest.

    settings  its `focal_tolerance` is that of the hint
    hint      radian, field of view across the columns; None: unknown
    aspect    width of a pixel over its height; None: 1, then those of common shapes
    mirrored  whether the mirrored image is tried first, for example for a file with upward rows
    Raises    ValueError if hint or aspect are out of range.
    Accuracy  model: as for `fit_lens`; the bound on false matches as for `identify`. None of 300
              images without a sky is solved with a bound of 1 %, a thousand times the default.
    """
    if hint is not None:
        within(1e-3, FISHEYES[-1], hint=hint)
    if aspect is not None:
        within(0.1, 10, aspect=aspect)
    rows, columns = frame.image.shape
    search = _PhotographSearch(ScaledSpots(frame), indexes, settings)
    shape = star_shape(frame.image, search.spots(*FIRST[:2]))
    squeezed = [] if aspect else squeezes(columns, rows, shape.elongation)
    near, rest = tries_of(columns, rows, hint, settings.focal_tolerance, aspect, squeezed, mirrored)
    unsolved, smear = [], None
    if shape.length > DRAWN_OUT:  # oblong pixels are likely, or that the camera turned
        rest.sort(key=lambda guess: guess.view.aspect == 1.0)
        smear = search.spots.turned
    if smear:
        first = (near or [guess for guess in rest if guess.view.aspect == (aspect or 1.0)])[0]
        # These tries have half of the probability of a false match; all others share the other
        # half.
        near = [guess._replace(share=guess.share / 2) for guess in near]
        rest = [guess._replace(share=guess.share / 2) for guess in rest]
        turned = search._replace(spots=ScaledSpots(frame, smear))
        photo = turned.attempt(first._replace(share=0.5), FULL)
        if photo.axis is not None:
            return _as_hinted(replace(photo, streak=smear), hint, settings)
        unsolved.append(photo)
    for effort, tries in _rounds(near, rest):
        for guess in tries:
            photo = search.attempt(guess, effort)
            if photo.axis is not None:
                return _as_hinted(search.squared(photo, guess, squeezed), hint, settings)
            unsolved.append(photo)
    best = min(unsolved, key=lambda photo: photo.estimate.false_probability)
    tried, seen = tried_text(near + rest), seen_text(frame, search.spots)
    reason = f"{best.estimate.reason}; {tried}. {seen}"
    return replace(best, estimate=replace(best.estimate, reason=reason))


def _rounds(near: Sequence[Try], rest: Sequence[Try]) -> list[tuple[float, Sequence[Try]]]:
    """Effort and tries of each round: those by the hint, then all others with growing effort.

    The middles of fisheyes, of one camera each, have all hypotheses. Squares of any wide lens are
    last, because the whole image shows more.
    """
    middles = [guess for guess in rest if guess.view.middle]
    of_one = [guess for guess in middles if len(guess.cameras) == 1]
    squares = [guess for guess in middles if len(guess.cameras) > 1]
    others = [guess for guess in rest if guess not in squares]
    return [
        (FULL, near),
        *((effort, others) for effort in ROUNDS),
        (FULL, others[:1]),
        (FULL, of_one),
        (ROUNDS[-1], squares),
    ]


class _PhotographSearch(NamedTuple):
    """A frame's spots, and the stars that they are compared with."""

    spots: ScaledSpots
    indexes: identification.PatternIndexes
    settings: identification.Identification

    def attempt(self, guess: Try, effort: float) -> Photograph:
        """The first camera of a try that finds an attitude, with its lens estimated from the stars.

        effort  of the hypotheses of the settings
        """
        settings, stars, index_of = self.settings, self.indexes.stars, self._index
        rows, columns = self.spots.frame.image.shape
        size = guess.view.size(columns, rows)
        spots = guess.view.spots(self.spots(guess.threshold, guess.scales), columns, rows)
        spots = chosen(evenly_spread(spots, *size) if guess.spread else spots, slice(MOST_SPOTS))
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
            status=matches.status,
            reason=reason,
            icrs_to_camera=attitude,
            covariance=covariance,
            residual_rms=rms,
            stars=count,
            false_probability=matches.false_probability,
        )
        return Photograph(spots, matches, estimate, axis, guess.view)

    def squared(self, photo: Photograph, guess: Try, squeezed: list[float]) -> Photograph:
        """The solution in a view of square pixels, if the stars show oblong pixels.

        The fit of the lens describes small deviations; the view takes large ones. If few spots are
        stars, they may lie in the middle of an image that was squeezed by a common ratio. The same
        hypothesis is found again, so the probability of a false match does not grow.
        """
        rows, columns = self.spots.frame.image.shape
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
        """Index of every other field: half as many to read; each is good enough for its
        neighbours."""
        field, step = min(camera.fov_x, camera.fov_y), 2 * math.log(1.1)
        coarse = math.exp(math.floor(math.log(field) / step) * step) * (1 + 1e-9)
        return self.indexes(Camera.from_field_of_view(1, 1, coarse))


def _as_hinted(
    photo: Photograph, hint: float | None, settings: identification.Identification
) -> Photograph:
    """The solution, and whether its field is the given one; unknown for the middle of an image
    alone."""
    if hint is None or photo.view.middle is not None:
        return photo
    own, given = (
        math.tan(min(field, identification.WIDEST_PINHOLE) / 4) for field in (photo.field, hint)
    )
    off = abs(math.log(own / given))
    return replace(photo, as_hinted=off <= settings.focal_tolerance + SLACK)
