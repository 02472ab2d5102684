"""Scene, Streams, boresights -> angles to the Sun, to the Moon and to the Earth's limb."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from startrack.core import Floats, Streams
from startrack.scene.ephemeris import observer_of
from startrack.scene.parameters import Scene
from startrack.space import EARTH_RADIUS

BODIES = ("sun", "moon", "earth")


def body_angles(scene: Scene, seed: int, trials: Sequence[int], boresight: Floats) -> Floats:
    """Radian from the boresight to the centres of Sun and Moon, and to the Earth's limb.

    Whether or not the scene has the light of these bodies; negative in front of the Earth.

    seed, trials  (n,) that date and orbit are drawn by, where each trial draws them
    boresight     (n, 3) unit vectors, ICRS axes
    Returns       (n, 3) in the order of BODIES; NaN without a date, or without an orbit
    Accuracy      model: that of `Observer.see`; a spherical Earth.
    """
    angles = np.full((len(trials), len(BODIES)), math.nan)
    if scene.date is None:
        return angles
    drawn = scene.days > 0 or (scene.orbit is not None and scene.orbit.phase is None)
    parts = [slice(n, n + 1) for n in range(len(trials))] if drawn else [slice(None)]
    for part in parts if len(trials) else []:
        observer = observer_of(scene, Streams(seed, trials[part.start or 0]))
        for k, name in enumerate(("sun", "moon")):
            angles[part, k] = _between(boresight[part], observer.see(name).direction)
        if scene.orbit is not None:
            distance = float(np.linalg.norm(observer.earth))
            limb = math.asin(min(EARTH_RADIUS / distance, 1.0))
            angles[part, 2] = _between(boresight[part], observer.earth / distance) - limb
    return angles


def _between(lines: Floats, one: Floats) -> Floats:
    return 2 * np.arcsin(np.minimum(np.linalg.norm(lines - one, axis=1) / 2, 1.0))
