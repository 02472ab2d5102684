"""Images of unknown cameras: their attitude and lens.

photograph  Frame of an unknown camera -> its attitude and lens, whatever must be tried.
"""

from startrack.photograph.photograph import THRESHOLDS, Photograph, PhotographView, solve_photograph

# Public; the other imports serve other rooms.
__all__: list[str] = []
