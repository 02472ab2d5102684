"""The lights that a scene may have besides its stars: one table of rows."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from startrack.core import DiffuseLight


class LightKind(NamedTuple):
    """A light of the sky.

    varies   whether it varies over the field, wherever the camera points or in some attitudes
    stray    whether it does so through a baffle
    dated    whether it needs the date, as it moves in time
    diffuse  gives it, from a `LightInput`, in front of everything; None: where it stands in
             `illuminate` by itself, at its distance
    """

    varies: bool = False
    stray: bool = False
    dated: bool = True
    diffuse: Callable[[Any], Iterable[DiffuseLight]] | None = None


# By their names in the key scene.lights.
LIGHTS = {
    "zodiacal": LightKind(varies=True),
    "starlight": LightKind(varies=True, dated=False),
    "planets": LightKind(),
    "sun": LightKind(stray=True),
    "moon": LightKind(stray=True),
    "earth": LightKind(varies=True, stray=True),
    "airglow": LightKind(varies=True),
    "cities": LightKind(),
}
