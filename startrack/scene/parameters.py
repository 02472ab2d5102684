"""Scene: what there is to see besides the stars."""

from __future__ import annotations

from dataclasses import dataclass

from startrack.checks import within


@dataclass(frozen=True)
class Scene:
    """The sky between the stars.

    background_g  magnitude per square arcsecond in Gaia's G, None for a black sky. Zodiacal light
                  at high ecliptic latitude is near V 23.3, on the ecliptic at 90 degrees from the
                  Sun near 22.1 (Leinert et al. 1998, A&AS 127, 1, table 17, from 10^-8 W units).
    """

    background_g: float | None = 22.0

    def __post_init__(self) -> None:
        if self.background_g is not None:
            within(-30, 40, background_g=self.background_g)
