"""Light -> Light: stray light of Sun, Moon and Earth past the baffle, as diffuse light."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import POSITIVE, Floats, Light, Parameters, Range, Refused, Unit
from startrack.optics.parameters import Optics

NODES = 17  # of the map of stray light along a side of the frame: 1 % between them


@dataclass(frozen=True)
class Baffle(Parameters):
    """Point-source transmittance (PST) of a baffle and the lens behind it.

    The PST is the irradiance on the detector over the irradiance of a distant source at the
    entrance, normal to its rays. It is given without the transmission of the glass, which applies
    to stray light and stars alike.
    """

    angle: Annotated[tuple[float, ...], Unit("rad", "deg"), Range(0, math.pi),
        "radian between the source and the line of sight, increasing"]  # fmt: skip
    transmittance: Annotated[tuple[float, ...], POSITIVE,
        "positive; its logarithm is linear between the angles, constant outside"]  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.angle) != len(self.transmittance) or not self.angle:
            raise Refused(
                "angle and transmittance must have the same length of one or more, got "
                f"{len(self.angle)} and {len(self.transmittance)}"
            )
        if any(low >= high for low, high in pairwise(self.angle)):
            raise Refused(f"angle must increase, got {self.angle}")

    def __call__(self, angle: Floats) -> Floats:
        """Transmittance (...) at angles (...) in radian."""
        return np.exp(np.interp(angle, self.angle, np.log(self.transmittance)))


def stray_light(
    light: Light, baffle: Baffle, optics: Optics, icrs_to_camera: Rotation, camera: core.Camera
) -> Light:
    """The light with stray light, as diffuse light of the same irradiance on the detector.

        radiance = irradiance PST(angle) focal_length^2 / area

    since a background of radiance L has the irradiance L area / focal_length^2 on the detector.

    Accuracy  model: stray light at a point of the frame depends on the angle between the source and
              the line of sight of that point alone; no ghosts. For a source in the field it is the
              first value of the curve. numerical: 1 % between the 17 x 17 nodes of its map, where
              the curve is no steeper than a decade in half a frame.
    """
    line = icrs_to_camera.inv().apply(camera.lattice(NODES))
    spread = optics.focal_length**2 / optics.area
    stray = tuple(_stray_light_of(source, line, baffle, spread) for source in light.stray_sources)
    return replace(light, diffuse=light.diffuse + stray)


def _stray_light_of(
    source: core.StrayLightSource, line: Floats, baffle: Baffle, spread: float
) -> core.DiffuseLight:
    angle = np.arccos(np.clip(line @ source.direction.T, -1, 1))
    fraction = baffle(angle) @ source.fraction * spread
    return core.DiffuseLight(source.photon_irradiance, fraction.reshape(NODES, NODES))
