"""Frame -> Spots, brightest first."""

from __future__ import annotations

from startrack.detection.centroid import centroid
from startrack.detection.find import find
from startrack.detection.parameters import Detection
from startrack.detection.pixels import pixels
from startrack.values import Frame, Spots


def detect(frame: Frame, settings: Detection) -> Spots:
    """Find the stars of an image.

    The image is filtered with a Gaussian, compared with its local background and noise, and cut
    into connected components; peaks that look like stars are measured in small windows.

    frame     image of any real type; what is not finite is a dead pixel
    settings  thresholds and windows
    Returns   Spots, brightest first; none where there is none
    Errors    TypeError or ValueError where the image is not a two-dimensional array of real
              numbers with at least one finite value. Those of `centroid` for the accuracy.
    """
    image = pixels(frame)
    return centroid(frame, image, find(image, settings), settings)
