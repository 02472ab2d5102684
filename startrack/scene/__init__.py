"""What light arrives: stars and sky become photons per wavelength at the entrance pupil.

parameters    Scene: what there is to see
photometry    magnitude and colour into a photon spectrum
illuminate    Stars -> Light
"""

from startrack.scene.illuminate import illuminate
from startrack.scene.parameters import Scene
from startrack.scene.photometry import WAVELENGTH, blackbody_photons, colour_temperature

__all__ = ["WAVELENGTH", "Scene", "blackbody_photons", "colour_temperature", "illuminate"]
