"""Numbers into spots: a Frame becomes Spots (OpenCV).

dark_map     DarkMap: what a tracker knows of the dark signal; dark frames -> pixels without that
             signal.
parameters   Detection: how spots are distinguished from noise, and how they are measured.
pixels       A Frame enters, with its dark frame and flat field; calibrated pixels as float32
             leave.
psf_table    Psf -> the fraction of a star's light in each pixel of a window, and how it moves with
             the star.
robust       Pixels -> their background, its slopes and its noise, whatever stars are among them.
background   Filtered image -> Sky: its background and noise, tile by tile.
star_model   StarModel: image of a star that the tracker assumes, and what centroids compute from
             it once.
matched      Image -> filtered image: the matched filter of a star, Gaussian or from the design's
             own PSF.
threshold    Background and gain -> law of the filtered noise; threshold -> expected noise peaks,
             and back.
plan         Settings and PSF -> DetectionPlan: what the detection computes once for many frames.
connect      A filtered image and its threshold enter; local maxima leave, several where stars
             touch.
examine      Peaks -> which of them stand alone as stars do, and which are hot pixels.
find         Pixels -> Candidates: peaks of the filtered image that look like stars.
sample       Sample: what every centroid works on, the image, the peaks and the noise of a pixel.
gravity      Sample -> centre of gravity of a window that follows the star.
weighted     Sample -> centre of gravity under a Gaussian weight that is moved until it sits on
             the star.
fit          Windows and a model of a star enter; the most likely positions and fluxes of stars
             leave.
s_curve      Psf -> how far the centre of gravity in a window is wrong, and its measurements set
             right.
extension_search  Pixels -> Candidates, by code that is not part of startrack.
extension_centroid  Sample -> a row per star, by a centroid that is not part of startrack.
methods      Sample and Psf -> a row per star, by each of the centroid methods that a design can
             name.
centroid     Pixels and Candidates -> Spots, by the centroid method of the settings.
detect       A Frame enters; Spots leave, brightest first: of the whole frame, or near predicted
             places.
within       Frame that is known in regions alone, and the Sky of such frames -> Spots of these
             regions.
box          An image, and where stars are expected -> the brightest thing in a box about each
             place.
expectation  An image of expected numbers and the stars in it -> how the detection will see these
             stars.
response     Frame without noise, places of stars -> what a centroid is there, and how each pixel
             moves it.
"""

from startrack.detection.box import (
    Box,
    StarImage,
    Taken,
    box_reach,
    star_image,
    take,
)
from startrack.detection.centroid import centroid, places
from startrack.detection.dark_map import DarkFrames, DarkMap, correction_image
from startrack.detection.detect import detect, detect_near
from startrack.detection.expectation import Expectation, chance_kept, expect
from startrack.detection.extension_centroid import Centroid, CentroidInput
from startrack.detection.extension_search import DetectionInput, DetectionMethod
from startrack.detection.find import Candidates
from startrack.detection.matched import filtered
from startrack.detection.parameters import LONGEST_STREAK, Detection
from startrack.detection.pixels import divide_flat, pixels, subtract_dark, without_pixels
from startrack.detection.plan import (
    STREAK,
    DetectionPlan,
    calibrated,
    false_alarms,
    plan_detection,
    threshold_of,
)
from startrack.detection.psf_table import gaussian_psf
from startrack.detection.response import Response, half_of, joined, response
from startrack.detection.star_model import StarModel, smeared
from startrack.detection.within import (
    Ground,
    detect_within,
    grown_mask,
    margin,
    measure_ground,
    peak_border,
    star_profile,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Box",
    "Centroid",
    "CentroidInput",
    "DarkFrames",
    "DarkMap",
    "Detection",
    "DetectionInput",
    "DetectionMethod",
    "DetectionPlan",
    "StarImage",
    "StarModel",
    "Taken",
    "box_reach",
    "detect",
    "detect_near",
    "divide_flat",
    "false_alarms",
    "gaussian_psf",
    "plan_detection",
    "smeared",
    "star_image",
    "subtract_dark",
    "take",
    "threshold_of",
    "without_pixels",
]
