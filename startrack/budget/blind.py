"""Case without a solved field -> the reason: stars, light, dark current or tracker."""

import math

import numpy as np

from startrack import observation, response
from startrack.budget.fields import Fields, attitudes, believed_index, fields
from startrack.core import Floats, Ints, Refused
from startrack.design import Case

BRIGHTEST, FAINTEST, STEP = -30.0, 20.0, 0.05  # G, steps to find the faintest star
LIKELY = 0.1  # probability of passing the threshold above which a star counts; by hand
RULE = "must see enough stars somewhere in the sky, it does not"


def blind(case: Case, what: str = "the case") -> Refused:
    """The reason why no field can be solved: the first stage that leaves too few stars.

    The stages are: stars in the frame; their signal compared with dark current, sky and read noise;
    the tracker's catalogue; its test for hot pixels; hot pixels among its brightest spots.

    what     name of the case in the message
    Accuracy  model: a star is bright enough if it passes the threshold in one of ten frames; the
              budget also counts fainter stars. It is assumed that without dark current or the light
              of the sky only the noise is smaller.
    """
    view = fields(case.catalog, case.instrument.camera, attitudes)
    return Refused(f"{what} {RULE}: {_cause(case, view)}", rule=RULE)


def _cause(case: Case, view: Fields) -> str:
    """The first cause that leaves too few stars, with its numbers and keys."""
    camera, detection, tracker = case.instrument.camera, case.tracker.detection, case.tracker
    pixel = camera.project(np.column_stack([view.x, view.y, np.ones(len(view.x))]))
    inside = np.flatnonzero(camera.holds(pixel, -(detection.window // 2 + detection.edge)))
    star, field = view.star[inside], view.field[inside]
    magnitude = view.sky.stars.magnitude_g[star]
    magnitude = magnitude + observation.colour_correction(case, view.sky.stars.colour[star])
    fewest = tracker.identification.min_matches
    needed = f"{fewest} are needed (tracker.identification.min_matches)"
    if _most(field) < fewest:
        return (
            f"too few stars are in a field, at most {_most(field)} of the {len(view.sky.stars)} "
            f"to G = {case.catalog.limit_g:g} (catalog.limit_g); {needed}"
        )
    even = response.with_uniform_dark(case) if response.dark_pattern(case) else case
    if hidden := _faintness(even, magnitude, field, needed):
        return hidden
    passing = magnitude < _faintest(even)
    listed = passing & (believed_index(case.catalog, case.believed_catalog)[view.name[star]] >= 0)
    if _most(field[listed]) < fewest:
        return (
            "the tracker's catalogue lacks stars that the camera sees: of at most "
            f"{_most(field[passing])} in a field it has {_most(field[listed])} (tracker.catalog, "
            f"to G = {case.believed_catalog.limit_g:g}); {needed}"
        )
    errors = response.errors(even)
    kept = listed & (np.interp(magnitude, errors.magnitude, errors.kept) > LIKELY)
    if _most(field[kept]) < fewest:
        return (
            f"the tracker rejects the stars that it sees as hot pixels: of at most "
            f"{_most(field[listed])} in a field it keeps {_most(field[kept])} "
            f"(tracker.detection.sharpest_sigma = {detection.sharpest_sigma:g} pixel); {needed}"
        )
    enough = f"at most {_most(field[kept])} stars of a field are bright enough, but "
    if pattern := response.dark_pattern(case):
        return enough + (
            f"{len(pattern.outlying)} pixels of outlying dark current raise the threshold or take "
            f"their places among the {detection.max_spots} brightest spots "
            "(instrument.detector.defects, age; tracker.detection.dark_map, max_spots)"
        )
    return enough + (
        "too few of them lie where the tracker expects them (tracker.identification.match_radius, "
        "tracker.attitude.gate): its camera or catalogue differs from the true one, or stars crowd"
    )


def _most(field: Ints) -> int:
    """The largest number of stars in one field."""
    return int(np.bincount(field, minlength=1).max())


def _faintest(case: Case) -> float:
    """G of the faintest star that passes the threshold with a probability of LIKELY."""
    grid = np.arange(BRIGHTEST, FAINTEST, STEP)
    passing = grid[response.detection_probability(case, grid) > LIKELY]
    return float(passing.max(initial=-math.inf))


def _faintness(case: Case, magnitude: Floats, field: Ints, needed: str) -> str:
    """Why stars are too faint, and which noise hides them; "" if enough pass the threshold."""
    size, fewest = response.scale(case), case.tracker.identification.min_matches
    dark = response.dark_electrons(case.instrument.detector)[0]
    sky = max(size.background - dark, 0.0)
    of_sky = "scene.sky" if case.scene.sky else "scene.background_g"
    sources = (
        ("dark current", dark, sky, "instrument.detector.dark_current"),
        ("the light of the sky", sky, dark, of_sky),
    )
    if size.background >= size.largest:
        filled, *_, keys = sources[0 if dark > sky else 1]
        detector, above = case.instrument.detector, ""
        if 2 * detector.offset > 2**detector.bits - 1:  # most of the converter's range
            keys = f"instrument.detector.offset, {keys}"
            above = f" above an offset of {detector.offset:g} of {2**detector.bits - 1}"
        return (
            f"{filled} saturates the pixels, which hold {size.largest:.5g} electrons{above}: dark "
            f"current makes {dark:.5g} in an exposure, the sky {sky:.5g} ({keys}, "
            "instrument.detector.exposure)"
        )
    limit = _faintest(case)
    found = _most(field[magnitude < limit])
    if found >= fewest:
        return ""
    seen = (
        f"stars fainter than G = {limit:.1f} do not pass tracker.detection.threshold, at most "
        f"{found} of a field do; {needed}"
    )
    for name, _, rest, keys in sources:
        noise = math.sqrt(size.noise**2 + size.excess * rest)
        deeper = limit + 2.5 * math.log10(size.pixel / noise)
        if _most(field[magnitude < deeper]) >= fewest:
            return (
                f"{name} hides them: it makes {size.background - rest:.4g} electrons in a pixel "
                f"and raises the noise to {size.pixel:.3g} from {noise:.3g} ({keys}); {seen}; "
                f"without it, stars to G = {deeper:.1f} would"
            )
    return (
        f"they have too little light: a star of G = 0 gives {size.star:.3g} electrons in an "
        f"exposure, and a pixel has a noise of {size.pixel:.3g} electrons (instrument.optics, "
        "instrument.detector.exposure); "
        f"{seen}; the best field has {fewest} stars to "
        f"G = {_magnitude_of_last(fewest, magnitude, field):.1f}"
    )


def _magnitude_of_last(count: int, magnitude: Floats, field: Ints) -> float:
    """Magnitude to which the best field has `count` stars."""
    order = np.lexsort((magnitude, field))
    first = np.searchsorted(field[order], np.unique(field))
    last = first + count - 1
    last = last[last < len(order)]
    last = last[field[order][last] == field[order][last - count + 1]]
    return float(magnitude[order][last].min())
