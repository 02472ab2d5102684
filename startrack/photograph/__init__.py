"""Images of unknown cameras: their attitude and lens.

spots  Frame -> its spots at several scales, how each star moved, and the shape of its stars.
view   How the pixels of a file become those of a camera with square pixels.
tries  Size of an image -> what is tried in turn: spots, view and cameras.
solve  Frame of an unknown camera -> its attitude and lens, and what was seen.
place  Place and time of a photograph -> where its camera points, without refraction and aberration.
"""

from startrack.photograph.place import PlacedPhotograph, Site, place_photograph
from startrack.photograph.solve import Photograph, solve_photograph
from startrack.photograph.spots import THRESHOLDS
from startrack.photograph.view import PhotographView

# Public; the other imports serve other rooms.
__all__: list[str] = []
