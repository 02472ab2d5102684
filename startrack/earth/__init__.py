"""Earth cameras: digital numbers from terrain, flight, atmosphere and detector.

terrain     intersections of rays and terrain on the WGS84 ellipsoid
geometry    a camera in flight: orbit or aircraft, sensor and pointing; lines of sight of pixels
atmosphere  radiance at a sensor from tables of radiative transfer
imager      images of Earth cameras: radiance, PSF, detector, digital numbers
product     products of raw numbers: radiance, reflectance, maps on the terrain
retrieval   quantities retrieved from images, with their errors by formula and by trials: fires
"""

import lazy_loader

# A star tracker needs none of these: each is loaded when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=["terrain", "geometry", "atmosphere", "imager", "product", "retrieval"]
)
