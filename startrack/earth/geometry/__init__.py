"""A camera in flight: orbit or aircraft, sensor and pointing; what each pixel sees.

aircraft    An aircraft in level flight and times -> where it is over the turning Earth.
orbit       An orbit or a flight, and times -> where it is over the turning Earth, and where the
            Sun.
sensor      A detector's elements and the times of its lines -> which pixel looks when.
sight       A camera in flight -> Rays: the line of sight of each pixel at its own time.
parameters  EarthScene: a camera in flight over terrain, as a scene file has it.
image       EarthScene -> Ground line by line: what each ray of an image sees of the Earth.
"""

from startrack.earth.geometry.aircraft import Aircraft
from startrack.earth.geometry.image import Strip, observe_earth
from startrack.earth.geometry.orbit import (
    Carrier,
    Flight,
    Orbit,
    TwoLines,
    fly,
    sun_direction,
    the_carrier,
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
from startrack.earth.geometry.sight import Fixed, Pointing, ground_rate, scan_lines, sight

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
    "sun_direction",
    "tdi_elements",
]
