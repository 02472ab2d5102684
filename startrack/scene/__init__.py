"""What light arrives: stars, sky and bodies become photons per wavelength at the entrance pupil.

parameters    Scene: what there is to see, when and from where
photometry    magnitude and colour into a photon spectrum
ephemeris     Scene -> where the bodies of the solar system are
planets       their magnitudes
bodies        Sun, Moon and Earth: discs and glare
limb          the sunlit air above the Earth's horizon
airglow       shells of air that glow by themselves
cities        lamps by night
zodiacal      sunlight on the dust between the planets
starlight     stars below the catalogue's limit, and the dust between the stars
illuminate    Stars -> Light
air           radiance at a sensor from tables of the air; imported by those who need it
earth         rays at the Earth -> Ground, where it fills the field; imported by those who need it
land          Ground -> what it reflects and how warm it is; likewise
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
