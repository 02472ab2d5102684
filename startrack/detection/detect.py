"""Frame -> Spots, brightest first."""

from __future__ import annotations

from startrack.detection.centroid import centroid
from startrack.detection.find import find
from startrack.detection.parameters import Detection
from startrack.detection.pixels import pixels
from startrack.detection.smear import star_image
from startrack.values import Frame, Psf, Spots


def detect(frame: Frame, settings: Detection, psf: Psf | None = None) -> Spots:
    """Find the stars of an image.

    The image is filtered for stars, compared with its local background and noise, and cut
    into connected components; peaks that look like stars are measured in small windows.

    frame     image of any real type; what is not finite is a dead pixel
    settings  thresholds and windows
    psf       of the design at rest, for what the settings want it; None: a Gaussian of their
              kernel_sigma
    Returns   Spots, brightest first; none where there is none
    Errors    TypeError or ValueError where the image is not a two-dimensional array of real
              numbers with at least one finite value. Those of `centroid` for the accuracy.
    """
    image, star = pixels(frame), star_image(settings, psf)
    return centroid(frame, image, find(image, settings, star), settings, star)
