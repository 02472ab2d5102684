"""What light arrives: stars, sky and bodies become photons per wavelength at the entrance pupil.

lights      The lights that a scene may have besides its stars: one table of rows.
parameters  Scene: what there is to see besides the stars, when and from where.
extension_light  Directions in the field -> diffuse light, by code that is not part of startrack.
photometry  Magnitude and colour into a photon spectrum: blackbodies through Gaia's passbands.
ephemeris   Scene, Streams -> where the bodies of the solar system are, seen by the observer.
planets     Body -> V magnitude of a planet.
bodies      Observer -> the Sun, the Moon and the Earth: discs in the field, stray light,
            eclipses.
angles      Scene, Streams, boresights -> angles to the Sun, to the Moon and to the Earth's limb.
limb        The Earth's bright limb: a table of radiance over tangent height and Sun, and its
            light.
airglow     Lines of sight -> the airglow of the Earth's upper atmosphere, as thin shells.
cities      The Earth at a date -> the lights of its large cities by night, as points.
zodiacal    Directions, Sun -> brightness of the zodiacal light, and its spectrum.
starlight   Directions, faintest magnitude of the catalogue -> light of the stars below it.
illuminate  Stars -> Light: photons at the entrance pupil.
"""

from startrack.scene.angles import BODIES, body_angles
from startrack.scene.bodies import EARTH_ALBEDO, SUN_G, SUN_RADIUS, Disc, Earth, sunlight
from startrack.scene.ephemeris import date_of, orbital_velocity
from startrack.scene.extension_light import DiffuseSource, LightInput
from startrack.scene.illuminate import Sight, illuminate
from startrack.scene.lights import LIGHTS, LightKind
from startrack.scene.limb import Limb, load_limb, save_limb
from startrack.scene.parameters import DARK, Orbit, Scene
from startrack.scene.photometry import (
    SUN,
    SUN_G_MINUS_V,
    WAVELENGTH,
    blackbody_photons,
    colour_temperature,
)

# Public; the other imports serve other rooms.
__all__ = [
    "WAVELENGTH",
    "DiffuseSource",
    "LightInput",
    "Limb",
    "Orbit",
    "Scene",
    "Sight",
    "blackbody_photons",
    "colour_temperature",
    "illuminate",
    "load_limb",
    "save_limb",
]
