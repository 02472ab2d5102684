"""LensTable: wavefront, place, pupil and area of a lens over temperature, wavelength and field."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from startrack.core import Floats, Ints, Refused, Unit, kept, positive, printed, um
from startrack.io import open_checked, shipped, whole
from startrack.optics.pupil import MOST, noll_to_nm, zernike

T = TypeVar("T")
Reals = NDArray[np.floating[Any]]
FORMAT = 1
WIDEST = 1.4  # radian, field angle
MOST_NUMBERS = 10_000_000  # most numbers in a table
DEGREE = 5  # degree of the splines between nodes
PUPIL_PARITY = (-1, 1, 1, -1, 1, 1)  # of the columns of `pupil`, where the field angle changes sign


@printed
class LensPoints(NamedTuple):
    """A lens at n wavelengths and m field angles, of one temperature; the arrays of a LensTable.

    wavefront  (n, m, k) metre
    place      (n, m) metre
    pupil      (n, m, 6) 1
    outline    (n, m, h) 1
    area       (n, m) square metre
    amplitude  (n, m, g) 1
    curvature  (n, m) 1 / metre
    """

    wavefront: Annotated[Floats, Unit("m", "nm")]
    place: Annotated[Floats, Unit("m", "mm")]
    pupil: Floats
    outline: Floats
    area: Annotated[Floats, Unit("m2", "mm2")]
    amplitude: Floats
    curvature: Annotated[Floats, Unit("1 / m")]


@printed
@dataclass(frozen=True, eq=False)
class LensTable:
    """A lens of revolution for stars, at nodes of temperature, wavelength and field angle.

    The star's image lies on the positive x axis. The table describes its light on a sphere through
    the exit pupil, whose centre is the place where the chief ray meets the detector. For a point of
    this sphere, (p, q) are the direction cosines towards its centre, and W is the optical path up
    to the point:

        U(X, Y) = Int A(p, q) exp(2 pi i / lambda [W(p, q) + p (X - place) + q Y]) dp dq

    |A|^2 dp dq is the light of the point, so that |U|^2 is the irradiance, and no light is lost. To
    first order in the sphere's curvature c, a ray with direction cosines (l, m) that meets the
    detector at (x, y) has, with e = (x - place, y),

        (p, q) = (l, m) - c e,   W = path - l e_x - m e_y + c |e|^2 / 2,   grad W = -e

    (tables have exact values). If c is zero, waves are plane, as if the pupil were at infinity (the
    Debye integral). The rays are then the same, but light that the rim of the pupil diffracts is
    not: from the place e of a ray to (X, Y), it lacks the path c |(X - place, Y) - e|^2 / 2, which
    is a tenth of a wave for 100 um and a pupil 50 mm away.

    W and A are sums of Noll's Zernike polynomials of u = -(p - centre) / half_p and v = -q / half_q
    (for A, plus one). u and v are coordinates in the lens: a ray from the upper part of the lens
    runs downwards.

    name, source  the lens, and the source of its numbers
    focal_length  metre, nominal
    f_number      1, nominal
    temperature   (t,) kelvin, rising
    wavelength    (w,) metre, rising
    field         (f,) radian, rising from zero
    noll          (k,) Noll indices of the terms, 1 to 231, all even in y
    wavefront     (t, w, f, k) metre, rms of each term over the image of the stop
    place         (t, w, f) metre from the axis, of the chief ray (through the middle of the stop)
    pupil         (t, w, f, 6) 1, of the image of the stop: its centre along p, half axes along p
                  and q; the same of the ellipse of the rays that all apertures let through
    outline       (t, w, f, h) 1, difference of the rim of these rays from that ellipse: at the
                  point (cos a, sin a) of the ellipse, the rim is farther from its centre by the
                  factor 1 + sum_k outline_k cos(k a), k from 0 to h - 1; no harmonics: the ellipse
    area          (t, w, f) square metre, cross-section of the beam of these rays before the lens,
                  times the transmission
    amplitude     (t, w, f, g) 1, rms of the first g terms of `noll` in A; none: A is even
    curvature     (t, w, f) 1 / metre, inverse distance of the exit pupil before the detector
    Source        Wolf, Li (1981), Opt. Commun. 39, 205: where the Debye integral holds.
    Accuracy      model: scalar. The integral leaves out two parts of the path to a point: a phase
                  of that point alone, and c (p X + q Y)^2 / 2. The second is 0.05 % of the peak for
                  the shipped lenses in focus, and 0.3 % several waves out of focus. The whole rim
                  is assumed in the exit pupil, also where another aperture than the stop limits it.
    Raises        ValueError with the name, the rule and the value.
    """

    name: str
    source: str
    focal_length: Annotated[float, Unit("m", "mm")]
    f_number: float
    temperature: Annotated[Floats, Unit("K", "degC")]
    wavelength: Annotated[Floats, Unit("m", "nm")]
    field: Annotated[Floats, Unit("rad", "deg")]
    noll: Ints
    wavefront: Annotated[Floats, Unit("m", "nm")]
    place: Annotated[Floats, Unit("m", "mm")]
    pupil: Floats
    outline: Floats
    area: Annotated[Floats, Unit("m2", "mm2")]
    amplitude: Floats
    curvature: Annotated[Floats, Unit("1 / m")]

    def __post_init__(self) -> None:
        positive(focal_length=self.focal_length, f_number=self.f_number)
        for name, (low, high, unit) in AXES.items():
            _check_axis(name, getattr(self, name), low, high, unit)
        if self.field[0] != 0 or len(self.field) < 2:
            raise Refused(
                f"field must hold zero first and another angle, got {self.field[:2].tolist()}"
            )
        self._check_terms()
        shape = len(self.temperature), len(self.wavelength), len(self.field)
        harmonics, terms = (np.shape(array)[-1:] for array in (self.outline, self.amplitude))
        sizes = {
            "wavefront": (len(self.noll),),
            "place": (),
            "pupil": (6,),
            "outline": harmonics,
            "area": (),
            "amplitude": terms,
            "curvature": (),
        }
        for name, more in sizes.items():
            _check_values(name, getattr(self, name), (*shape, *more))
        if not (self.pupil[..., (1, 2, 4, 5)] > 0).all() or not (np.abs(self.pupil) < 1).all():
            raise Refused(
                "pupil must hold positive half axes and direction cosines below 1, got "
                f"{self.pupil.min():g} to {self.pupil.max():g}"
            )
        if not (np.abs(self.outline).sum(axis=-1) < 1).all():
            raise Refused(
                "outline must hold harmonics whose sizes add up to less than 1, got "
                f"{np.abs(self.outline).sum(axis=-1).max():g}"
            )
        if self.amplitude.shape[-1] > len(self.noll):
            raise Refused(
                f"amplitude must hold at most the {len(self.noll)} terms of noll, got "
                f"{self.amplitude.shape[-1]}"
            )
        if not (self.area > 0).all():
            raise Refused(f"area must be positive, got {self.area.min():g} m^2")

    def _check_terms(self) -> None:
        noll = self.noll
        if noll.ndim != 1 or noll.dtype.kind not in "iu" or not 1 <= len(noll) <= MOST:
            raise Refused("noll must be a list of Noll indices")
        if len(set(noll.tolist())) != len(noll):
            raise Refused("noll must hold each index once")
        wrong = [j for j in noll.tolist() if not 1 <= j <= MOST or noll_to_nm(j)[1] < 0]
        if wrong:
            raise Refused(
                f"noll must lie in [1, {MOST}] and belong to terms even in y, got {wrong[0]}"
            )

    @cached_property
    def _packed(self) -> tuple[Floats, Floats]:
        """All arrays side by side, (t, w, f, columns), and the parity of each column."""
        parts = [
            self.wavefront,
            self.outline,
            self.amplitude,
            self.place[..., None],
            self.pupil,
            self.area[..., None],
            self.curvature[..., None],
        ]
        odd = [(-1) ** noll_to_nm(j)[1] for j in self.noll.tolist()]
        turned = [(-1) ** k for k in range(self.outline.shape[-1])]
        terms = odd[: self.amplitude.shape[-1]]
        parity = np.array([*odd, *turned, *terms, -1, *PUPIL_PARITY, 1, 1], float)
        return np.concatenate(parts, axis=-1), parity

    def at(self, temperature: float, wavelength: Floats, field: Floats) -> LensPoints:
        """The lens at values between its nodes.

        Splines of the fifth degree, or of the highest that the nodes allow: over the temperature;
        over the inverse of the wavelength; and over the field, including mirror images of the
        nodes, because values of a lens of revolution are even or odd in the angle.

        temperature  kelvin; a table of one temperature has only this one
        wavelength   (n,) metre
        field        (m,) radian, not negative
        Raises       ValueError outside the table.
        Accuracy     numerical: of sixth order in the distance of the nodes; `startrack lens import
                     --check` measures it.
        """
        self._refuse_outside("temperature", np.array([temperature]), self.temperature, "K")
        self._refuse_outside("wavelength", wavelength, self.wavelength, "m")
        self._refuse_outside("field", field, self.field, "radian")
        values, parity = self._packed
        values = spline(self.temperature, values, np.array([temperature]), 0)[0]
        values = spline(-1 / self.wavelength, values, -1 / wavelength, 0)
        mirrored = values[:, :0:-1] * parity
        nodes = np.concatenate([-self.field[:0:-1], self.field])
        values = spline(nodes, np.concatenate([mirrored, values], axis=1), field, 1)
        ends = np.cumsum([len(self.noll), self.outline.shape[-1], self.amplitude.shape[-1]])
        wavefront, outline, amplitude, rest = np.split(values, ends, axis=-1)
        return LensPoints(
            wavefront=wavefront,
            place=rest[..., 0],
            pupil=rest[..., 1:7],
            outline=outline,
            area=rest[..., 7],
            amplitude=amplitude,
            curvature=rest[..., 8],
        )

    def _refuse_outside(self, name: str, asked: Floats, nodes: Floats, unit: str) -> None:
        low, high = float(nodes[0]), float(nodes[-1])
        slack = 1e-9 * max(abs(low), abs(high))
        for value in (float(np.min(asked)), float(np.max(asked))):
            if not low - slack <= value <= high + slack:
                raise Refused(
                    f"{name} must lie in the lens table of {self.name}, [{low:.4g}, {high:.4g}] "
                    f"{unit}, got {value:.4g} {unit}"
                )


# Least and largest value of each axis, and its unit.
AXES = {
    "temperature": (1, 1000, "K"),
    "wavelength": (1e-8, 1e-4, "m"),
    "field": (0, WIDEST, "radian"),
}
LARGEST = 1e12  # in SI units. Chosen by hand: no length or share of a lens is near it
ARRAYS = ("noll", "wavefront", "place", "pupil", "outline", "area", "amplitude", "curvature")
ABSENT = {"outline": (0,), "amplitude": (0,), "curvature": ()}  # beyond (t, w, f), of old files
UNITS = {
    "temperature": "K",
    "wavelength": "m",
    "field": "rad",
    "wavefront": "m",
    "place": "m",
    "area": "m2",
    "curvature": "1/m",
}


def _check_axis(name: str, nodes: Floats, low: float, high: float, unit: str) -> None:
    if not isinstance(nodes, np.ndarray) or nodes.ndim != 1 or not 1 <= len(nodes) <= 10_000:
        raise Refused(f"{name} must be a list of 1 to 10000 numbers")
    if not np.isfinite(nodes).all() or not (np.diff(nodes) > 0).all():
        raise Refused(f"{name} must hold finite numbers that rise")
    if nodes[0] < low or nodes[-1] > high:
        raise Refused(
            f"{name} must lie in [{low:g}, {high:g}] {unit}, got {nodes[0]:g} to {nodes[-1]:g}"
        )


def _check_values(name: str, values: Floats, shape: tuple[int, ...]) -> None:
    if np.shape(values) != shape:
        raise Refused(f"{name} must have the shape {shape}, got {np.shape(values)}")
    if values.size > MOST_NUMBERS:
        raise Refused(f"{name} must hold at most {MOST_NUMBERS} numbers, got {values.size}")
    if not (np.abs(values) <= LARGEST).all():
        raise Refused(f"{name} must hold finite numbers of at most {LARGEST:g}")


def rim_harmonics(u: Floats, v: Floats, count: int) -> Floats:
    """The outline of a rim: coefficients of cos(k a) of its distance from the unit circle.

    u, v   (..., n) 1, points of the rim, which is even in v; n at least `count`
    count  number of harmonics, k from 0
    Accuracy  least squares, with equal weights of all points
    """
    azimuth = np.arctan2(v, u)[..., None] * np.arange(count)
    shapes, beyond = np.cos(azimuth), np.hypot(u, v) - 1
    return np.asarray((np.linalg.pinv(shapes) @ beyond[..., None])[..., 0])


def rim_distance(outline: Floats, u: Reals, v: Reals) -> Reals:
    """Distance of a point from the ellipse's centre over that of the rim in the same direction.

    outline  (..., h) 1
    u, v     (..., n) 1, in half axes of the ellipse; the result has their type
    """
    distance = np.hypot(u, v)
    if not outline.shape[-1]:
        return distance
    cosine = u / np.maximum(distance, np.finfo(u.dtype).tiny)
    harmonics = np.moveaxis(outline, -1, 0)[..., None].astype(u.dtype)
    return distance / (1 + np.polynomial.chebyshev.chebval(cosine, harmonics, tensor=False))


def spline(nodes: Floats, values: Floats, at: Floats, axis: int, degree: int = DEGREE) -> Floats:
    """Values at other places along an axis, by a spline of at most `degree`."""
    if len(nodes) == 1:
        return np.repeat(values, len(at), axis=axis)
    degree = min(degree, len(nodes) - 1)
    inside = np.clip(at, nodes[0], nodes[-1])
    through = _unit_splines(tuple(nodes.tolist()), degree)(inside)
    return np.moveaxis(np.tensordot(through, values, (1, axis)), 0, axis)


@lru_cache(maxsize=16)
def _unit_splines(nodes: tuple[float, ...], degree: int) -> Any:
    """For each node, the spline that is one at this node and zero at the others."""
    ones = np.eye(len(nodes))
    if degree % 2:
        return scipy.interpolate.make_interp_spline(nodes, ones, degree)
    return scipy.interpolate.BarycentricInterpolator(nodes, ones)


def save_lens(path: Path, table: LensTable) -> None:
    """Write a table as FITS with checksums: one image for each array, under its name.

    The first header holds LENS (the format), NAME, SOURCE, FOCAL (metre) and FNUMBER.
    """
    from astropy.io import fits

    first = fits.PrimaryHDU()
    first.header["LENS"] = (FORMAT, "format of this table of a lens")
    first.header["NAME"] = table.name
    first.header["SOURCE"] = table.source
    first.header["FOCAL"] = (table.focal_length, "[m] focal length")
    first.header["FNUMBER"] = (table.f_number, "f-number")
    arrays = {name: getattr(table, name) for name in (*AXES, *ARRAYS)}
    parts = [fits.ImageHDU(array, name=name) for name, array in arrays.items() if array.size]
    for part in parts:
        part.header["BUNIT"] = UNITS.get(part.name.lower(), "")
    with whole(Path(path)) as draft:
        fits.HDUList([first, *parts]).writeto(draft, checksum=True)


def load_lens(path: Path) -> LensTable:
    """Read a table.

    Raises  FileNotFoundError; ValueError if the file is not a lens table, is damaged, or has
            values that a LensTable refuses.
    """
    with open_checked(path, "LENS", FORMAT, "a lens table") as parts:
        head = parts[0].header
        name, source = str(head["NAME"]), str(head["SOURCE"])
        focal_length, f_number = (_number(path, key, head[key]) for key in ("FOCAL", "FNUMBER"))
        names = [name for name in (*AXES, *ARRAYS) if name not in ABSENT or name in parts]
        arrays: dict[str, Any] = {name: np.array(parts[name].data) for name in names}
        for key, more in ABSENT.items():
            arrays.setdefault(key, np.zeros((*arrays["area"].shape, *more)))
    try:
        kinds = {"noll": np.int64}
        columns = {key: array.astype(kinds.get(key, np.float64)) for key, array in arrays.items()}
        return LensTable(name, source, focal_length, f_number, **columns)
    except (ValueError, TypeError) as error:
        raise Refused(f"{path}: {error}") from None


def _number(path: Path, key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"{path}: {key} must be a number, got {value!r}")
    return float(value)


def lens_path(name: str) -> Path:
    """Path of a lens file: a shipped one by its name alone, any other by its path.

    Raises  ValueError if there is none.
    """
    return catalogued(name, "lens_file", "lenses", "a lens table")


def catalogued(name: str, key: str, folder: str, what: str) -> Path:
    """Path of a FITS file that a key names, by its path or its name in a folder of shipped data.

    Raises  ValueError if there is none.
    """
    if Path(name).suffix:
        if not Path(name).is_file():
            raise Refused(f"{key} must be {what}, but there is no file {name!r}")
        return Path(name)
    names = sorted(path.stem for path in shipped(folder).glob("*.fits"))
    if name not in names:
        raise Refused(
            f"{key} must be a path that ends with .fits or one of {', '.join(names)}, got {name!r}"
        )
    return shipped(f"{folder}/{name}.fits")


def kept_files(load: Callable[[Path], T]) -> Callable[[Path], T]:
    """`load`, cached for the last 8 files with their times."""

    @kept(8)
    def loaded(path: Path, time: int) -> T:
        return load(path)

    return lambda path: loaded(path, path.stat().st_mtime_ns)


_open = kept_files(load_lens)


def open_lens(name: str) -> LensTable:
    """The table of a `lens_file`; cached for the last 8 files with their times."""
    return _open(lens_path(name))


def interpolation_error(table: LensTable, dense: LensTable) -> dict[str, float]:
    """Largest error of a table at the nodes of another one.

    For the wavefront it is the rms over the open pupil, in waves, without mean and tilt; for the
    chief ray's place, metre; for the area, the relative error.
    """
    radius, turn = np.meshgrid(np.sqrt((np.arange(8) + 0.5) / 8), np.arange(24) * (np.pi / 12))
    disc_x, disc_y = (radius * np.cos(turn)).ravel(), (radius * np.sin(turn)).ravel()
    plane = np.stack([np.ones_like(disc_x), disc_x, disc_y], axis=-1)
    waves, place, area = [0.0], [0.0], [0.0]
    for t, temperature in enumerate(dense.temperature):
        between = table.at(float(temperature), dense.wavelength, dense.field)
        place.append(float(np.abs(between.place - dense.place[t]).max()))
        area.append(float(np.abs(between.area / dense.area[t] - 1).max()))
        for at in np.ndindex(between.place.shape):
            stop, half_p, half_q, *rest = dense.pupil[t][at]
            p, q = rest[0] + rest[1] * disc_x, rest[2] * disc_y
            other = between.pupil[at]
            off = sum(
                size * zernike(j, (stop - p) / half_p, -q / half_q)
                - near * zernike(j, (other[0] - p) / other[1], -q / other[2])
                for j, size, near in zip(
                    table.noll.tolist(), dense.wavefront[t][at], between.wavefront[at], strict=True
                )
            )
            # The tilt is left out, because the chief ray's place contains it.
            off = off - plane @ np.linalg.lstsq(plane, off, rcond=None)[0]
            waves.append(float(np.sqrt(np.mean(off**2))) / float(dense.wavelength[at[0]]))
    return {
        "interpolation_rms_waves": max(waves),
        "interpolation_place_um": max(place) / um,
        "interpolation_area": max(area),
    }
