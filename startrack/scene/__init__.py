"""The arriving light: stars, sky and bodies become photons per wavelength at the entrance pupil.

parameters  Scene: everything visible besides the stars, date and observer; the table of possible
            lights.
photometry  Magnitude and colour into a photon spectrum: blackbodies through Gaia's passbands.
ephemeris   Scene, Streams -> the observer, and angles from boresights to Sun, Moon and limb.
planets     Body -> V magnitude of a planet.
bodies      Observer -> the Sun, the Moon and the Earth: discs in the field, stray light,
            eclipses.
limb        Light of the Earth's air: the bright limb as a table over tangent height and Sun, the
            airglow as thin shells.
cities      The Earth at a date -> the lights of its large cities by night, as points.
day_sky     DaySky: line of sight of a camera within or below the air, and place of the Sun.
air_above   DaySky -> light that the air scatters by day, and transmittance of the air for stars.
dusk        DaySky with the Sun below the horizontal -> sunlight that the air scatters.
night       DaySky at night -> airglow, zodiacal light and light of faint stars.
moonlight   DaySky and date -> the place of the Moon, and its irradiance.
sky_light   DaySky -> photons of the sky above a camera at any hour, and loss of starlight in the
            air.
background  Directions -> zodiacal light, and the light of stars below the catalogue's limit.
illuminate  Stars -> Light: photons at the entrance pupil; diffuse light by user code.
"""

from startrack.scene.air_above import OZONE_FROM, OZONE_TO, SkyTable, load_sky, scattered_light
from startrack.scene.background import zodiacal
from startrack.scene.bodies import EARTH_ALBEDO, SUN_G, SUN_RADIUS, Disc, Earth, sunlight
from startrack.scene.day_sky import DaySky
from startrack.scene.dusk import DuskTable
from startrack.scene.ephemeris import (
    BODIES,
    SkyObserver,
    body_angles,
    date_of,
    observer_of,
    orbital_velocity,
)
from startrack.scene.illuminate import LightInput, Sight, illuminate
from startrack.scene.limb import Limb, load_limb
from startrack.scene.parameters import DARK, LIGHTS, ObserverOrbit, Scene, added
from startrack.scene.photometry import (
    SUN,
    SUN_G_MINUS_V,
    WAVELENGTH,
    blackbody_photons,
    in_bins,
    outside_bins,
)
from startrack.scene.sky_light import sky_light

# Public; the other imports serve other rooms.
__all__ = ["DaySky", "LightInput", "ObserverOrbit", "Scene", "Sight", "illuminate"]
