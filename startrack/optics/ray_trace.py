"""Prescription of a lens -> its LensTable, by rays of the program optiland (extra `lens`)."""

import copy
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from startrack.core import ZERO_CELSIUS, Advance, Floats, Refused, nm
from startrack.optics.lens_table import LensTable, rim_harmonics
from startrack.optics.pupil import even_terms, zernike
from startrack.optics.surfaces import Surfaces

MILLIMETRE = 1e-3  # metre; the tracer's lengths are in millimetre
MICROMETRE = 1e6  # per metre; its wavelengths are in micrometre
AZIMUTHS = 96  # directions from the chief ray to the rim of a pupil
HARMONICS = 24  # of the rim beyond its ellipse
UNEVEN = 15  # largest Noll index of the amplitude
RINGS = 16  # rings of rays of a wavefront
COVERED = 400  # rays on each azimuth, to count rays that an obstruction stops
ROUNDS, CLOSE = 30, 1e-7  # most steps to the rim, and the relative error that ends them
DEGREE = 9  # of the polynomials from the pupil to the beam before the lens
BEYOND, OUTSIDE = 1.1, 0.02  # distance and weight of rays outside an aperture, for a smooth fit
SMALLEST = 1e-6  # relative singular value, below which rays do not determine a term
AROUND = ((0.1, 0.0), (0.0, 0.1), (-0.1, 0.0), (0.0, -0.1))  # millimetre, at a surface's vertex
ROUND = 1e-6  # relative difference of the sags there, above which it is no surface of revolution
ROUNDED = 0.01  # relative accuracy of the catalogue's wavelength limits
BARREL = 23.6e-6  # 1 / kelvin, expansion of aluminium
EXPANSION = re.compile(r"thermal_expansion:.*?coefficient:\s*([-+0-9.eE]+)", re.DOTALL)


@dataclass(frozen=True)
class Tracing:
    """Fields, wavelengths and points of the pupil at which a lens is traced.

    temperature  kelvin
    wavelength   metre
    field        radian, from zero
    terms        largest Noll index of the wavefront
    vacuum       whether the lens is in vacuum, or in air of one atmosphere
    barrel       1 / kelvin, expansion of the spacers
    """

    temperature: tuple[float, ...]
    wavelength: tuple[float, ...]
    field: tuple[float, ...]
    terms: int = 37
    vacuum: bool = False
    barrel: float = BARREL


def trace_lens(
    lens: Any, name: str, source: str, tracing: Tracing, progress: Advance = lambda count: None
) -> tuple[LensTable, Floats]:
    """Trace a lens of revolution at all nodes.

    With temperature, radii and thicknesses of glass grow by its expansion, spaces by the expansion
    of the barrel, and indices change by Schott's formula, if the tracer's catalogue has these data.
    Other glasses keep their shape and index.

    lens      as `read_prescription` gives it
    progress  called with 1 for each node that is done
    Raises    ValueError if the chief ray does not pass, or if the lens is not a lens of revolution
              that images stars.
    Returns   the table, and the residual rms (metre) of the wavefront after its terms, (t, w, f)
    Accuracy  the open pupil is an ellipse of the true area and the true width along p; its outline
              has an error of 0.3 % of its radius at corners of apertures. Transmission is one: no
              absorption, no reflection.
    """
    refuse_lens(lens)
    _refuse_wavelengths(lens, tracing.wavelength)
    names = even_terms(tracing.terms)  # terms odd in y cancel by symmetry
    shape = len(tracing.temperature), len(tracing.wavelength), len(tracing.field)
    wavefront, pupil = np.empty((*shape, len(names))), np.empty((*shape, 6))
    outline = np.empty((*shape, HARMONICS))
    amplitude = np.empty((*shape, sum(j <= UNEVEN for j in names)))
    place, area, left, curvature = (np.empty(shape) for _ in range(4))
    paraxial = lens.paraxial
    aim = _aim(lens, _stop_radius(lens))
    for t, kelvin in enumerate(tracing.temperature):
        for w, wavelength in enumerate(tracing.wavelength):
            here = _at_state(lens, kelvin, wavelength, tracing)
            for f, angle in enumerate(tracing.field):
                at = (t, w, f)
                node = _Node(here, aim, angle, wavelength)
                (
                    wavefront[at],
                    place[at],
                    pupil[at],
                    outline[at],
                    area[at],
                    amplitude[at],
                    curvature[at],
                    left[at],
                ) = node.measure(names)
                progress(1)
    focal_length = float(np.squeeze(paraxial.f2())) * MILLIMETRE
    f_number = float(np.squeeze(paraxial.FNO()))
    nodes = [np.array(axis) for axis in (tracing.temperature, tracing.wavelength, tracing.field)]
    table = LensTable(
        name=name,
        source=source,
        focal_length=abs(focal_length),
        f_number=abs(f_number),
        temperature=nodes[0],
        wavelength=nodes[1],
        field=nodes[2],
        noll=np.array(names),
        wavefront=wavefront,
        place=place,
        pupil=pupil,
        outline=outline,
        area=area,
        amplitude=amplitude,
        curvature=curvature,
    )
    return table, left


def surfaces_of(lens: Any) -> Surfaces:
    """The surfaces of a tracer's lens, without surfaces that have no effect.

    Raises  ValueError if they are not spheres.
    Accuracy  a surface without an aperture gets the paraxial aperture of the beams up to the
              largest field angle.
    """
    refuse_lens(lens)
    wavelength = float(lens.primary_wavelength)
    rows, stop = [], int(lens.surfaces.stop_index) - 1
    for number in range(1, len(lens.surfaces) - 1):
        surface = lens.surfaces[number]
        aspheric = getattr(surface.geometry, "k", 0.0), getattr(surface.geometry, "coefficients", 0)
        if np.any(np.asarray(aspheric[0])) or np.any(np.asarray(aspheric[1])):
            raise Refused(f"the prescription must have spheres alone, but {number} is none")
        radius = float(np.squeeze(surface.geometry.radius))
        index = abs(float(np.squeeze(surface.material_post.n(wavelength))))
        outer = float(getattr(surface.aperture, "r_max", math.inf))
        rows.append(
            [
                1 / radius / MILLIMETRE if math.isfinite(radius) else 0.0,
                float(np.squeeze(surface.thickness)) * MILLIMETRE,
                index,
                outer * MILLIMETRE,
                float(surface.interaction_model.is_reflective),
            ]
        )
    columns = np.array(rows).T
    is_clear = np.isfinite(columns[3])
    columns[3][~is_clear] = 1e-9
    columns[3][stop] = _stop_radius(lens) * MILLIMETRE
    curvature, thickness, index, clear, mirror = columns
    made = Surfaces(curvature, thickness, index, clear, mirror, stop)
    axis, field = made.heights()
    largest = max(float(angle.y) for angle in lens.fields.fields)
    beam = np.abs(axis) * columns[3][stop] / abs(axis[stop])
    beam = beam + np.abs(field) * math.tan(math.radians(largest))
    clear = np.where(is_clear | (np.arange(len(is_clear)) == stop), clear, beam)
    return replace(made, radius=clear)


def refuse_lens(lens: Any) -> None:
    """Refuse lenses that cannot be traced here.

    Raises  ValueError that names the reason.
    """
    surfaces = lens.surfaces
    if not surfaces[0].is_infinite:
        raise Refused("the prescription must have its object at infinity, as stars are")
    for number in range(1, len(surfaces)):
        frame = surfaces[number].geometry.cs
        placed = frame.x, frame.y, frame.rx, frame.ry
        if any(abs(float(np.squeeze(shift))) > 1e-9 for shift in placed):
            raise Refused(
                f"the prescription must be a lens of revolution, but surface {number} is tilted or "
                "decentred"
            )
        sag = np.array([float(np.squeeze(surfaces[number].geometry.sag(x, y))) for x, y in AROUND])
        if np.ptp(sag) > ROUND * np.abs(sag).max():
            raise Refused(
                f"the prescription must be a lens of revolution, but surface {number} has sags "
                f"from {sag.min():.3g} to {sag.max():.3g} mm at {AROUND[0][0]:g} mm from the axis"
            )


def _refuse_wavelengths(lens: Any, wavelengths: Sequence[float]) -> None:
    """Refuse wavelengths at which the index of a glass would be extrapolated."""
    for surface in lens.surfaces:
        material = surface.material_post
        known: dict[str, float] = getattr(material, "material_data", None) or {}
        low, high = (known.get(f"{end}_wavelength", math.nan) for end in ("min", "max"))
        for wavelength in wavelengths:
            micrometre = wavelength * MICROMETRE
            if micrometre < low * (1 - ROUNDED) or micrometre > high * (1 + ROUNDED):
                raise Refused(
                    f"wavelengths must be those of the glass {material.name}, "
                    f"[{low * 1e3:.4g}, {high * 1e3:.4g}] nm, got {wavelength / nm:.4g} nm"
                )


class Aim(NamedTuple):
    """Start of rays: distance of the entrance pupil from the first surface, and its radius.

    pupil, radius  millimetre
    stop           millimetre, radius of the stop
    """

    pupil: float
    radius: float
    stop: float


def _aim(lens: Any, stop: float) -> Aim:
    """The start of rays of a lens, whose stop has this radius."""
    paraxial = lens.paraxial
    pupil, width = (float(np.squeeze(value)) for value in (paraxial.EPL(), paraxial.EPD()))
    return Aim(pupil, width / 2, stop)


def _launch(lens: Any, aim: Aim, angle: float, wavelength: float, across: Floats, y: Floats) -> Any:
    """Rays of one star after the lens; they start in phase, in a plane across the beam.

    across, y  (n,) millimetre, in that plane from the middle of the entrance pupil
    """
    from optiland.rays import RealRays

    sine, cosine = math.sin(angle), math.cos(angle)
    length = abs(float(np.squeeze(lens.surfaces[-1].geometry.cs.z))) + abs(aim.pupil)
    back = 2 * (length + 6 * aim.radius)
    ones = np.ones_like(across)
    rays = RealRays(
        across * cosine - back * sine,
        y * ones,
        aim.pupil - across * sine - back * cosine,
        sine * ones,
        0 * ones,
        cosine * ones,
        ones,
        wavelength * MICROMETRE * ones,
    )
    lens.surfaces.trace(rays, skip=1)
    return rays


def _stop_radius(lens: Any) -> float:
    """Millimetre, height in the stop of the outermost ray of a star on the axis."""
    aim = _aim(lens, 1.0)
    primary = float(lens.primary_wavelength) / MICROMETRE
    plain, _ = _without_apertures(lens)
    _launch(plain, aim, 0.0, primary, np.array([aim.radius]), np.zeros(1))
    height = float(np.squeeze(plain.surfaces.x[plain.surfaces.stop_index - 1]))
    if not height > 0:
        raise Refused("the prescription must let the outermost ray of a star on the axis pass")
    return height


def _without_apertures(lens: Any) -> tuple[Any, list[tuple[float, float]]]:
    """A copy without apertures; and the radii of the aperture of each surface.

    There are two radii (millimetre): of the obstruction in the middle, and of the rim.
    """
    plain, radii = copy.deepcopy(lens), []
    for surface in plain.surfaces:
        aperture = surface.aperture
        if aperture is not None and not hasattr(aperture, "r_max"):
            raise Refused("the prescription must have circular apertures alone")
        limits = (aperture.r_min, aperture.r_max) if aperture is not None else (0.0, math.inf)
        radii.append((float(limits[0]), float(limits[1])))
        surface.aperture = None
    return plain, radii


def _at_state(
    lens: Any, kelvin: float, wavelength: float, tracing: Tracing
) -> tuple[Any, list[tuple[float, float]]]:
    """The lens at a temperature and with the indices of one wavelength, without its apertures."""
    here, radii = _without_apertures(lens)
    celsius, pressure = kelvin - ZERO_CELSIUS, 0.0 if tracing.vacuum else 1.0
    warmer = celsius - 20.0
    surfaces, update = here.surfaces, here.updater
    before = 0.0
    for number in range(1, len(surfaces) - 1):
        surface = surfaces[number]
        material = surface.material_post
        # Relative to the medium around the lens.
        index = material.n(wavelength * MICROMETRE, temperature=celsius, pressure=pressure)
        index = float(np.squeeze(index))
        glass = index > 1.05
        after = _expansion(material) if glass else 0.0
        if warmer:
            both = [state for state in (before, after) if state]
            radius = float(np.squeeze(surface.geometry.radius))
            if both and math.isfinite(radius):
                update.set_radius(radius * (1 + warmer * sum(both) / len(both)), number)
            thickness = float(np.squeeze(surface.thickness))
            growth = after if glass else tracing.barrel
            update.set_thickness(thickness * (1 + warmer * growth), number)
        if not surface.interaction_model.is_reflective:
            update.set_index(index, number)
        before = after
    return here, radii


def _expansion(material: Any) -> float:
    """Expansion, 1 / kelvin, of a glass of the tracer's catalogue from -30 to 70 degC; 0:
    unknown."""
    path = getattr(material, "filename", None)
    if not path or not Path(path).is_file():
        return 0.0
    match = EXPANSION.search(Path(path).read_text(encoding="utf-8"))
    return float(match[1]) if match else 0.0


class _Sphere(NamedTuple):
    """Sphere on which light is measured, about the place where the chief ray meets the detector.

    place, path  millimetre, of the chief ray there
    curvature    1 / millimetre
    """

    place: float
    path: float
    curvature: float

    def crossed_by(self, rays: Any) -> tuple[Floats, Floats, Floats]:
        """Where rays cross the sphere: direction cosines to its centre, and paths (millimetre).

        The paths end at the sphere, and the path of the chief ray is subtracted.
        """
        p, q, x, y, path = (
            np.asarray(array) for array in (rays.L, rays.M, rays.x, rays.y, rays.opd)
        )
        x = x - self.place
        # To the detector from the foot of the perpendicular from the centre; its length squared.
        along = p * x + q * y
        missed = x * x + y * y - along * along
        root = np.sqrt(1 - self.curvature**2 * missed)
        back = root + self.curvature * along  # over the radius, from the detector to the sphere
        return (
            p * back - self.curvature * x,
            q * back - self.curvature * y,
            path - self.path - along + self.curvature * missed / (1 + root),
        )


class _Node:
    """One star at one wavelength: its pupil and its wavefront."""

    def __init__(
        self,
        state: tuple[Any, list[tuple[float, float]]],
        aim: Aim,
        angle: float,
        wavelength: float,
    ) -> None:
        self.lens, self.radii = state
        self.aim, self.angle, self.wavelength = aim, angle, wavelength
        self.stop = int(self.lens.surfaces.stop_index) - 1  # of the surfaces after the object
        self.middle = self._chief()

    def trace(self, across: Floats, y: Floats) -> Any:
        """Rays of this star, kept in `rays`."""
        self.rays = _launch(self.lens, self.aim, self.angle, self.wavelength, across, y)
        return self.rays

    def heights(self, across: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Height of rays in the stop over its radius, and the largest such ratio of all apertures.

        It is 2 for a ray that misses a surface.
        """
        self.trace(across, y)
        radius = np.hypot(np.asarray(self.lens.surfaces.x), np.asarray(self.lens.surfaces.y))
        stop = radius[self.stop] / self.aim.stop
        limits = np.array(self.radii)[1:, 1, None]
        open_ = np.maximum(stop, (radius / limits).max(axis=0))
        lost = ~np.isfinite(radius).all(axis=0)
        return np.where(lost, 2.0, stop), np.where(lost, 2.0, open_)

    def _chief(self) -> float:
        """Millimetre across the beam, of the ray through the middle of the stop."""
        middle, half = 0.0, 0.1 * self.aim.radius
        for _ in range(8):
            at = middle + np.array([-half, half])
            self.trace(at, np.zeros(2))
            height = np.asarray(self.lens.surfaces.x)[self.stop]
            if not np.isfinite(height).all() or height[0] == height[1]:
                break
            step = -height.mean() / (height[1] - height[0]) * 2 * half
            middle += step
            half = max(min(half, 0.1 * abs(step)), 1e-4 * self.aim.radius)
            if abs(step) < 1e-9 * self.aim.radius:
                break
        stop, open_ = self.heights(np.array([middle]), np.zeros(1))
        if not open_[0] < 1 or not stop[0] < 0.01:
            raise Refused(
                f"the chief ray at {math.degrees(self.angle):.4g} deg and "
                f"{self.wavelength / nm:.4g} nm must pass the lens, but an aperture stops it"
            )
        return middle

    def boundary(self, which: int, azimuth: Floats) -> Floats:
        """Distance (millimetre) from the chief ray to the rim of the stop (0) or all apertures (1).

        Proportional steps, because the ratio is nearly proportional; bisection if they leave the
        bracket.
        """
        low, high = np.zeros(len(azimuth)), np.full(len(azimuth), 3 * self.aim.radius)
        below, above = np.zeros(len(azimuth)), np.full(len(azimuth), np.inf)
        cosine, sine = np.cos(azimuth), np.sin(azimuth)
        distance = np.full(len(azimuth), self.aim.radius)
        for _ in range(ROUNDS):
            tried = distance
            ratio = self.heights(self.middle + tried * cosine, tried * sine)[which]
            if np.abs(ratio - 1).max() < CLOSE:
                break
            inside = ratio <= 1
            low, below = np.where(inside, distance, low), np.where(inside, ratio, below)
            high, above = np.where(inside, high, distance), np.where(inside, above, ratio)
            chord = low + (high - low) * (1 - below) / (above - below)
            ahead = distance / np.maximum(ratio, 1e-3)
            step = np.where(np.isfinite(above) & (above < 2) & (below > 0), chord, ahead)
            good = (step > low) & (step < high)
            distance = np.where(good, step, (low + high) / 2)
        # If rays miss a surface before a ratio of one, the last passing ray represents the rim.
        return np.where(np.abs(ratio - 1) < 1e-4, tried, low)

    def measure(
        self, noll: Sequence[int]
    ) -> tuple[Floats, float, list[float], Floats, float, Floats, float, float]:
        """Wavefront (k,), place, pupil, outline, area, amplitude, curvature; residual rms,
        metre."""
        azimuth = (np.arange(float(AZIMUTHS)) + 0.5) * (2 * math.pi / AZIMUTHS)
        sphere = self._sphere()
        rims, pupil = [self.boundary(which, azimuth) for which in (0, 1)], []
        for distance in rims:
            rim = self.trace(self.middle + distance * np.cos(azimuth), distance * np.sin(azimuth))
            p, q, _ = sphere.crossed_by(rim)
            low, high = -_largest(-p), _largest(p)
            half = (high - low) / 2
            pupil += [(high + low) / 2, half, _enclosed(p, q) / (math.pi * half)]
        outline = rim_harmonics((p - pupil[3]) / pupil[4], q / pupil[5], HARMONICS)
        area = float((rims[1] ** 2).mean() * math.pi) * self._uncovered(azimuth, rims[1])
        terms, amplitude, left = self._fit(noll, pupil, azimuth, rims[0], sphere)
        return (
            terms,
            sphere.place * MILLIMETRE,
            pupil,
            outline,
            area * MILLIMETRE**2,
            amplitude,
            sphere.curvature / MILLIMETRE,
            left,
        )

    def _sphere(self) -> _Sphere:
        """About the place of the chief ray, through the paraxial exit pupil."""
        chief = self.trace(np.array([self.middle]), np.zeros(1))
        place, path, forward = (float(np.squeeze(array)) for array in (chief.x, chief.opd, chief.N))
        exit_pupil = float(np.squeeze(self.lens.paraxial.exit_pupil_point_gcs()[2]))
        before = float(np.squeeze(self.lens.surfaces[-1].geometry.cs.z)) - exit_pupil
        if not before:
            raise Refused(
                "the prescription must have its image away from its exit pupil, got both at one "
                "place: is the distance after the last surface missing?"
            )
        return _Sphere(place, path, math.copysign(1 / math.hypot(place, before), before * forward))

    def _uncovered(self, azimuth: Floats, rim: Floats) -> float:
        """Fraction of the open beam that no obstruction in the middle of an aperture covers."""
        inner = np.array(self.radii)[1:, 0, None]
        if not inner.any():
            return 1.0
        distance = np.multiply.outer(np.sqrt((np.arange(COVERED) + 0.5) / COVERED), rim)
        self.trace(self.middle + distance * np.cos(azimuth), distance * np.sin(azimuth))
        radius = np.hypot(np.asarray(self.lens.surfaces.x), np.asarray(self.lens.surfaces.y))
        passes = (radius.reshape(len(inner), -1) >= inner).all(axis=0).reshape(distance.shape)
        return float((passes * rim**2).sum() / (np.ones_like(distance) * rim**2).sum())

    def _fit(
        self, noll: Sequence[int], pupil: list[float], azimuth: Floats, rim: Floats, sphere: _Sphere
    ) -> tuple[Floats, Floats, float]:
        """Wavefront, metre; amplitude; residual rms of the wavefront after its terms, metre."""
        node, weight = np.polynomial.legendre.leggauss(RINGS)
        distance = np.multiply.outer((node + 1) / 2, rim)
        across, y = (distance * np.cos(azimuth)).ravel(), (distance * np.sin(azimuth)).ravel()
        open_ = self.heights(self.middle + across, y)[1]
        p, q, error = sphere.crossed_by(self.rays)
        good = np.isfinite(error) & (open_ <= BEYOND)
        share = (weight[:, None] * (node[:, None] + 1) * rim**2).ravel()
        share = share * np.where(open_ <= 1, 1.0, OUTSIDE)
        u, v = -(p - pupil[0]) / pupil[1], -q / pupil[2]
        shapes = np.stack([np.ones_like(u), *(zernike(j, u, v) for j in noll)], axis=-1)
        root = np.sqrt(share[good])
        terms = np.linalg.lstsq(shapes[good] * root[:, None], error[good] * root, SMALLEST)[0]
        rest = (error - shapes @ terms)[good & (open_ <= 1)]
        part = share[good & (open_ <= 1)]
        left = math.sqrt(float(part @ (rest * rest) / part.sum()))
        few = [j for j in noll if j <= UNEVEN]
        amplitude = _amplitude(few, u[good], v[good], across[good], y[good], root)
        return terms[1:] * MILLIMETRE, amplitude, left * MILLIMETRE


def _amplitude(
    noll: Sequence[int], u: Floats, v: Floats, across: Floats, y: Floats, weight: Floats
) -> Floats:
    """Terms of the amplitude of a uniform beam: root of the beam's area over the pupil's area.

    Its rays pass (across, y) before the lens and (u, v) of the pupil.
    """
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    shapes = np.stack([u**i * v**j for i, j in powers], axis=-1)
    before = np.stack([across, y], axis=-1)
    terms = np.linalg.lstsq(shapes * weight[:, None], before * weight[:, None], SMALLEST)[0]
    slope_u = np.stack([i * u ** max(i - 1, 0) * v**j for i, j in powers], axis=-1) @ terms
    slope_v = np.stack([j * u**i * v ** max(j - 1, 0) for i, j in powers], axis=-1) @ terms
    area = slope_u[:, 0] * slope_v[:, 1] - slope_u[:, 1] * slope_v[:, 0]
    root = np.sqrt(np.abs(area))
    few = np.stack([np.ones_like(u), *(zernike(j, u, v) for j in noll)], axis=-1)
    coefficients = np.linalg.lstsq(few * weight[:, None], root * weight, SMALLEST)[0]
    return np.asarray(coefficients[1:] / coefficients[0])


def _largest(values: Floats) -> float:
    """The maximum of a closed curve between its samples, by a parabola."""
    k = int(values.argmax())
    a, b, c = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = a - 2 * b + c
    return float(b - (a - c) ** 2 / (8 * bend) if bend else b)


def _enclosed(p: Floats, q: Floats) -> float:
    """Area inside a closed curve of evenly spaced parameters, by derivatives of its harmonics."""
    order = np.fft.fftfreq(len(p), 1 / len(p)) * 1j
    slope_p, slope_q = (np.fft.ifft(order * np.fft.fft(rim)).real for rim in (p, q))
    return abs(float((p * slope_q - q * slope_p).mean())) * math.pi
