"""Numbers into spots: a Frame becomes Spots (OpenCV).

parameters   Detection: how spots are distinguished from noise, and how they are measured.
pixels       A Frame enters, with its dark frame and flat field; calibrated pixels as float32 leave.
robust       Pixels -> their background, its slopes and its noise, robust against stars among them.
background   Filtered image -> Sky: its background and noise, tile by tile.
star_model   StarModel: image of a star that the tracker assumes, and values that centroids compute
             from it.
matched      The matched filter of a star, the law of its noise, and the threshold for false spots.
plan         Settings and PSF -> DetectionPlan: values that are computed once for many frames.
connect      A filtered image and its threshold enter; local maxima leave, several where stars
             touch.
examine      Peaks -> peaks that are significant like stars, and peaks that are hot pixels.
find         Pixels -> Peaks of the filtered image that look like stars.
gravity      Sample, the input of all centroids -> centre of gravity, in a window that follows the
             star or under a Gaussian weight.
fit          Windows and a model of a star enter; the most likely positions and fluxes of stars
             leave.
methods      Sample and Psf -> a row per star, by each of the centroid methods that a design can
             name.
measure      Candidates of a frame -> Spots: each is measured once, by the centroid method of the
             plan.
within       Frame that is known only in regions, and the Sky of such frames -> Spots of these
             regions.
quick        Frame -> Spots, only near pixels where a filter of 3 x 3 pixels shows light.
detect       A Frame enters; Spots leave, brightest first: of the whole frame, or near given places.
streaks      Pixels -> the smear that all stars of a frame share, from the streaks themselves.
box          An image, and expected places of stars -> the brightest image in a box around each
             place.
expectation  Image of expected numbers, and its stars -> their expected detection and measurement.
"""

from startrack.detection.box import (
    Box,
    Taken,
    box_reach,
    corner_level,
    follow,
    image_mask,
    level_of_image,
    take,
)
from startrack.detection.connect import Peaks
from startrack.detection.detect import detect, detect_near
from startrack.detection.expectation import (
    NEAR,
    Response,
    SpotExpectation,
    chance_kept,
    expect,
    half_of,
    joined,
    response,
)
from startrack.detection.find import DetectionInput, FrameBackground, levels_at
from startrack.detection.matched import LOOKED, filtered, highest_between
from startrack.detection.measure import centroid, places
from startrack.detection.methods import CENTROIDS, CentroidInput
from startrack.detection.parameters import LONGEST_STREAK, QUICK, STREAK, Detection
from startrack.detection.pixels import (
    DarkFrames,
    DarkMap,
    corrected,
    correction_image,
    divide_flat,
    pixels,
    subtract_dark,
)
from startrack.detection.plan import DetectionPlan, calibrated, false_alarms, plan_detection
from startrack.detection.star_model import gaussian_psf
from startrack.detection.streaks import refined, streak_of
from startrack.detection.within import (
    detect_within,
    grown_mask,
    margin,
    measure_ground,
    peak_border,
    reach,
    star_profile,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Box",
    "CentroidInput",
    "DarkFrames",
    "DarkMap",
    "Detection",
    "DetectionInput",
    "detect",
    "divide_flat",
    "plan_detection",
    "subtract_dark",
]
