"""What a tracker makes of single stars: their noise, their pixels, and the light beside them.

chart       noise-free stars of all places and magnitudes, measured by the tracker's centroid
errors      errors of single stars over their magnitude, cause by cause
neighbours  how far the light of other stars moves each star of a sky
trust       what the tracker reckons each star of its catalogue to err by, beside its noise

What these are made of:

quiet       frames without noise, and noise without frames
separate    the stars that a camera sees as separate
dark        mean and spread of the dark electrons of the pixels
dimming     how much fainter stars of a colour are than sunlike ones
"""

from startrack.single.errors import Errors, errors, lasting
from startrack.single.trust import trust, trust_in

__all__ = ["Errors", "errors", "lasting", "trust", "trust_in"]
