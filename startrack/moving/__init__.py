"""Moving objects: several images of one field, registered on stars -> objects that move.

study     MovingDesign: a camera, its images, the objects to search for, and their file.
camera    Design -> values that are constant over its images: electrons, noise, image of an object.
render    Frames of a field with stars and an object, registered on guide stars and added.
detect    Images of a field -> the score of every place and motion, and the place of an object.
forecast  Design -> the faintest detectable object and the error of its place, by formula.
problem   MovingProblem: the interface for searches, samples and tests.
"""

from startrack.moving.camera import MovingCamera, camera_of
from startrack.moving.detect import Scores, find, refined, score_maps
from startrack.moving.forecast import MovingForecast, forecast_moving
from startrack.moving.problem import MovingProblem
from startrack.moving.render import SearchedField, added_images, field_of
from startrack.moving.study import (
    MovingDesign,
    MovingObject,
    SearchCampaign,
    SearchLimits,
    load_moving_design,
    moving_keys,
    save_moving_overlay,
)

__all__ = [
    "MovingCamera",
    "MovingDesign",
    "MovingForecast",
    "MovingObject",
    "MovingProblem",
    "Scores",
    "SearchCampaign",
    "SearchLimits",
    "SearchedField",
    "added_images",
    "camera_of",
    "field_of",
    "find",
    "forecast_moving",
    "load_moving_design",
    "moving_keys",
    "refined",
    "save_moving_overlay",
    "score_maps",
]
