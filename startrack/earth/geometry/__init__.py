"""A camera in flight: orbit or aircraft, sensor and pointing; lines of sight of pixels.

orbit  Position and velocity of a satellite or an aircraft over the rotating Earth.
sight  Elements of a detector, the times of its lines, and the line of sight of each pixel.
aim    Orbit, pointing, place -> the orbit on which the camera looks at the place at the epoch.
scene  EarthScene: a camera in flight over terrain, from a scene file; the ground that it sees, line
       by line.
"""

from startrack.earth.geometry.aim import aimed, axis_place
from startrack.earth.geometry.orbit import (
    Aircraft,
    Carrier,
    Orbit,
    TwoLines,
    choose_carrier,
    fly,
    sun_zenith_below,
)
from startrack.earth.geometry.scene import (
    EarthScene,
    Fractal,
    MapFile,
    Sensor,
    Strip,
    Terrain,
    find,
    ground_finder,
    observe_earth,
)
from startrack.earth.geometry.sight import (
    Elements,
    Jitter,
    Pointing,
    flight_height,
    ground_rate,
    inside_pixel,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Aircraft",
    "Carrier",
    "EarthScene",
    "Fractal",
    "MapFile",
    "Orbit",
    "Pointing",
    "Sensor",
    "Terrain",
    "TwoLines",
    "fly",
    "ground_rate",
    "observe_earth",
]
