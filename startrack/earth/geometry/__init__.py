"""A camera in flight: orbit or aircraft, sensor and pointing; what each pixel sees.

orbit       Position and velocity of a satellite or an aircraft over the rotating Earth.
sensor      Elements of a detector, and the times of its lines.
sight       The line of sight of each pixel of a camera in flight, at its own time.
parameters  EarthScene: a camera in flight over terrain, as a scene file gives it.
image       Ground line by line from an EarthScene: what each ray of an image meets.
"""

from startrack.earth.geometry.image import Strip, observe_earth
from startrack.earth.geometry.orbit import (
    Aircraft,
    Carrier,
    Flight,
    Orbit,
    TwoLines,
    choose_carrier,
    fly,
)
from startrack.earth.geometry.parameters import EarthScene, Fractal, MapFile, Sensor, Terrain, find
from startrack.earth.geometry.sensor import (
    Dating,
    Elements,
    inside_pixel,
    line_elements,
    matrix_elements,
    staggered_elements,
    tdi_elements,
)
from startrack.earth.geometry.sight import Fixed, Jitter, Pointing, ground_rate, scan_lines, sight

# Public; the other imports serve other rooms.
__all__ = [
    "Aircraft",
    "Carrier",
    "Dating",
    "EarthScene",
    "Elements",
    "Fixed",
    "Flight",
    "Fractal",
    "MapFile",
    "Orbit",
    "Pointing",
    "Sensor",
    "Strip",
    "Terrain",
    "TwoLines",
    "fly",
    "ground_rate",
    "line_elements",
    "matrix_elements",
    "observe_earth",
    "scan_lines",
    "sight",
    "staggered_elements",
    "tdi_elements",
]
