"""Images of unknown cameras: their attitude and lens.

spots  Frame -> its spots at several scales, the motion of the stars, and their shape.
view   Mapping of the pixels of a file to those of a camera with square pixels.
tries  Size of an image -> tries in order: spots, view and cameras.
solve  Frame of an unknown camera -> its attitude and lens, and its spots.
place  Place and time of a photograph -> direction of its camera, without refraction and aberration.
"""

from startrack.photograph.place import PlacedPhotograph, Site, place_photograph
from startrack.photograph.solve import Photograph, solve_photograph
from startrack.photograph.spots import THRESHOLDS
from startrack.photograph.view import PhotographView

# Public; the other imports serve other rooms.
__all__: list[str] = []
