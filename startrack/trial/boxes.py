"""Frame and expected attitude -> the stars that a tracker takes in its search boxes."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, open_sky
from startrack.core import Camera, Floats, Frame, Ints, Matches, Spots, Status, Streams, kept
from startrack.design import Case, Tracker
from startrack.detection import DetectionPlan, Taken, box_reach, take
from startrack.trial.belief import as_believed, detection_plan
from startrack.trial.stars import electrons_of, nearby
from startrack.trial.window import frame_in_windows

BOX = "box"
# Of a star, by its number in the catalogue: pixel (column, row) right below the image's middle.
Images = dict[int, tuple[int, int]]
MARGIN = 4  # pixel, of the images about the border of a box


def boxed(case: Case) -> bool:
    """Whether the tracker searches boxes once it has an attitude."""
    return case.tracker.acquisition == BOX


def expected_attitude(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Rotation:
    """The attitude that a single trial expects: the true one with the error of the prior."""
    error = case.tracker.box.prior * streams("expected attitude").standard_normal(3)
    return Rotation.from_rotvec(error) * icrs_to_camera


def targets(case: Case, camera: Camera, expected: Rotation) -> tuple[Ints, Floats]:
    """Stars (m,) of the tracker's catalogue whose boxes are whole, brightest first, and places."""
    sky, box = open_sky(case.believed_catalog), case.tracker.box
    near = nearby(sky, expected, camera)
    place = camera.project(expected.apply(sky.stars.direction[near]))
    border = box_reach(box, camera.focal_length_px) + MARGIN + 1
    complete = (place >= border).all(axis=1)
    complete &= (place <= np.array([camera.columns, camera.rows]) - 1 - border).all(axis=1)
    chosen = np.flatnonzero(complete)[: box.stars]
    return near[chosen], place[chosen]


def take_boxes(
    case: Case, frame: Frame, camera: Camera, expected: Rotation,
    plan: DetectionPlan | None = None,
) -> tuple[Spots, Matches]:  # fmt: skip
    """What the tracker takes about the places where it expects stars.

    plan     of the detection; None for that of the tracker
    Returns  the spots, and each as the star of its box
    """
    return follow_boxes(case, frame, camera, expected, {}, plan)[:2]


def follow_boxes(
    case: Case, frame: Frame, camera: Camera, expected: Rotation, images: Images,
    plan: DetectionPlan | None = None,
) -> tuple[Spots, Matches, Images]:  # fmt: skip
    """`take_boxes` of a tracker whose images stay from one exposure to the next.

    images   of stars, where the exposure before left them; other stars, and those whose image is no
             more in their box, are searched for
    Returns  the same after this exposure too
    """
    star, place = targets(case, camera, expected)
    flux = believed_electrons(case)[star]
    reach = box_reach(case.tracker.box, camera.focal_length_px)
    frame = as_believed(case, frame)
    plan = plan or detection_plan(case)
    held = np.array([images.get(int(n), (-1, -1)) for n in star], np.int64).reshape(-1, 2)
    flux = flux / frame.electrons_per_dn
    taken = take(frame, place, flux, reach, case.tracker.box, plan, held)
    after = {
        int(n): (int(x), int(y))
        for n, (x, y), found in zip(star, taken.corner, taken.found, strict=True)
        if found
    }
    return taken.spots(), matched(case, taken, star, camera, expected), after


def boxes_in_windows(
    case: Case, icrs_to_camera: Rotation, streams: Streams
) -> tuple[Spots, Matches]:
    """`take_boxes` of a single trial, of whose frame only the boxes are rendered."""
    camera, expected = case.believed_camera, expected_attitude(case, icrs_to_camera, streams)
    _, place = targets(case, camera, expected)
    far = box_reach(case.tracker.box, camera.focal_length_px) + MARGIN + 2
    corner = np.clip(np.floor(place - far), 0, None).astype(np.int64)
    end = np.minimum(np.ceil(place + far).astype(np.int64), [camera.columns, camera.rows])
    frame = frame_in_windows(case, icrs_to_camera, streams, np.hstack([corner, end]))
    return take_boxes(case, frame, camera, expected)


def matched(case: Case, taken: Taken, star: Ints, camera: Camera, expected: Rotation) -> Matches:
    """Each spot as the star of its box; which are false is left to the solver."""
    star = star[taken.found]
    direction = open_sky(case.believed_catalog).stars.direction[star]
    spot = np.arange(len(star))
    if len(star) < 2:
        reason = f"{len(star)} of the search boxes had a star, 2 are needed"
        return Matches(Status.TOO_FEW, reason, spot[:0], star[:0], direction[:0], camera, None, 1.0)
    reason = f"{len(star)} of {len(taken.x)} search boxes had a star"
    return Matches(Status.SOLVED, reason, spot, star, direction, camera, expected, float("nan"))


def agreeing(tracker: Tracker) -> Tracker:
    """The tracker whose solver takes the most stars that agree: nothing else tells a false one."""
    return replace(tracker, attitude=replace(tracker.attitude, sift=True))


def believed_electrons(case: Case) -> Floats:
    """Electrons (n,) of each star of the tracker's catalogue in an exposure, as it believes."""
    return _electrons(case.as_designed, case.believed_catalog)


@kept(4)
def _electrons(case: Case, catalog: Selection) -> Floats:
    tracker = replace(case.tracker, catalog=None)
    return electrons_of(replace(case, catalog=catalog, tracker=tracker))
