"""Matches enter; the camera with the focal length that their spots give leaves."""

from __future__ import annotations

import numpy as np

from startrack.camera import Camera
from startrack.identification.agree import settle
from startrack.identification.parameters import Identification
from startrack.identification.seen import see
from startrack.values import Matches, Spots

ROUNDS = 3  # of taking the distortion off, which is no similarity, with the focal length found


def refit(spots: Spots, matches: Matches, camera: Camera, settings: Identification) -> Camera:
    """What `identify` makes of the focal length, once the matches are known.

    camera    as the tracker believes it
    Errors    ValueError where the matches are not solved.
    """
    if matches.icrs_to_camera is None:
        raise ValueError(f"matches must be solved, got {matches.status}: {matches.reason}")
    if settings.focal_tolerance == 0:
        return camera
    every = np.arange(len(matches))
    rotation = matches.icrs_to_camera.as_matrix()
    for _ in range(ROUNDS if camera.distorted else 1):
        seen = see(spots, matches.spot, camera, settings)
        rotation, change = settle(seen, matches.direction, every, every, rotation, 1.0)
        camera = camera.scaled(change)
    return camera
