"""Light -> Light: what Sun, Moon and Earth send past the baffle becomes a veil over the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import (
    Camera,
    DiffuseLight,
    Floats,
    Light,
    StrayLightSource,
    Unit,
    positive,
    within,
)
from startrack.optics.parameters import Optics

NODES = 17  # of the veil's map along a side of the frame


@dataclass(frozen=True)
class Baffle:
    """How well a baffle, and the black paint behind it, keep out light from beside the field.

    The point-source transmittance is the irradiance that a distant source leaves on the
    detector, over the one that it has at the entrance, across its rays. It is given without the
    transmission of the glass, which the light shares with the stars' on its way.

    angle          radian between the source and the line of sight, rising
    transmittance  1, positive; straight lines between the logarithms, constant outside
    """

    angle: Annotated[tuple[float, ...], Unit("rad", "deg")]
    transmittance: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.angle) != len(self.transmittance) or not self.angle:
            raise ValueError(
                "angle and transmittance must have the same length of one or more, got "
                f"{len(self.angle)} and {len(self.transmittance)}"
            )
        for angle, value in zip(self.angle, self.transmittance, strict=True):
            within(0, math.pi, angle=angle)
            positive(transmittance=value)
        if any(low >= high for low, high in pairwise(self.angle)):
            raise ValueError(f"angle must rise, got {self.angle}")

    def __call__(self, angle: Floats) -> Floats:
        """The transmittance at angles in radian."""
        return np.exp(np.interp(angle, self.angle, np.log(self.transmittance)))


def stray_light(
    light: Light, baffle: Baffle, optics: Optics, icrs_to_camera: Rotation, camera: Camera
) -> Light:
    """The light with the veil of its glare, as a glow that would have the same irradiance.

        radiance = irradiance PST(angle) focal_length^2 / area

    since a sky of radiance L leaves L area / focal_length^2 on the detector.

    Accuracy  model: the veil at a place of the frame depends on the angle of the source to that
              place's line of sight alone; no ghosts. A source in the field veils it by the curve's
              first value. numerical: 1 % between the 17 x 17 places of its map, where the curve is
              no steeper than a decade in half a frame.
    """
    line = icrs_to_camera.inv().apply(camera.lattice(NODES))
    spread = optics.focal_length**2 / optics.area
    veils = tuple(_glow(one, line, baffle, spread) for one in light.glare)
    return replace(light, diffuse=light.diffuse + veils)


def _glow(glare: StrayLightSource, line: Floats, baffle: Baffle, spread: float) -> DiffuseLight:
    angle = np.arccos(np.clip(line @ glare.direction.T, -1, 1))
    fraction = baffle(angle) @ glare.fraction * spread
    return DiffuseLight(glare.photon_irradiance, fraction.reshape(NODES, NODES))
