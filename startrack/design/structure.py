"""Structure and lens of a head, temperatures -> changes of its boresight and focal length."""

import cmath
import math
from collections.abc import Iterator
from dataclasses import field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack import core
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
)
from startrack.design.variation import ABSOLUTE, RELATIVE, Scope, Variation
from startrack.io import csv_table, regular_file
from startrack.optics import Optics
from startrack.space import Heat, orbit_temperatures

RADIATED = 4 * 5.670374e-8 * 293.15**3  # W / (m2 K), black surface at 20 degC: CODATA 2018
ORBIT, LAUNCH = "orbit", "temperature since calibration"  # names of groups of variations
EXPANSION, LENGTH, KELVIN = Unit("1 / K", "um / (m K)"), Unit("m", "mm"), Unit("K")
GRADIENT = Unit("K / m")
FOCAL = "instrument.optics.focal_length"
RESIDUAL = "instrument.residual.temperature"
TURNS = tuple(f"instrument.mounting.{axis}" for axis in "xyz")
UNITS = {"instrument.mounting": "rad", "instrument.residual": "K"}  # by the table of the key


class Material(NamedTuple):
    """Material of a structure.

    expansion     1 / kelvin, linear, near 20 degC
    conductivity  W / (m K)
    density       kg / m3
    price         1, price of a machined kilogram over the price for aluminium
    """

    expansion: float
    conductivity: float
    density: float
    price: float


# Sources: aluminium 6061-T6 and AlBeMet 162, SNAP material properties database (Jelinsky,
# 00064-ME02, 2007); Ti-6Al-4V, Invar 36 (Carpenter), sintered SiC (Boostec): data sheets. Carbon
# fibre is a quasi-isotropic laminate of high modulus, assumed. Prices of material and machining are
# assumed.
MATERIALS = {
    "aluminium": Material(23.6e-6, 167.0, 2700.0, 1.0),
    "titanium": Material(8.6e-6, 6.7, 4430.0, 6.0),
    "invar": Material(1.3e-6, 10.5, 8055.0, 5.0),
    "carbon": Material(0.5e-6, 35.0, 1650.0, 15.0),
    "albemet": Material(13.9e-6, 210.0, 2100.0, 40.0),
    "silicon-carbide": Material(2.2e-6, 180.0, 3150.0, 25.0),
}
# Outer diameter of a tube over the clear aperture: median of the nine lenses in
# docs/figures/lens-costs.md.
WIDE = 1.96
NONE = (0.0, 0.0, 0.0, 0.0)
LOADS = ("mean", "gradient_x", "gradient_y", "flux_x", "flux_y")  # in the order of responses
PARTS = ("feet", "detector", "lens")
COLUMNS = ("part", "load", "x", "y", "z", "dx", "dy", "dz")
TIMES = 48  # intervals of an orbit, in a profile by heat
# Additional length of a cantilever on an elastic half-plane, over its thickness: 16.67 / (12 pi),
# from O'Donnell.
ROOT = 0.44
SHEAR = 3.2  # shear factor of a rectangle: 2 (1 + 0.33) 6 / 5
SPREAD = 1.5  # span of the feet over the diameter of the tube; assumed


class Structure(Parameters):
    """Structure that carries lens and detector on the spacecraft, and its temperature.

    A tube with lens and detector stands on a base with feet that are bolted to a panel. There are
    three loads. The mean temperature is M above the temperature of the calibration. The temperature
    grows by G_x per metre along x. A flux makes the side of the tube at +x warmer by F_x than the
    side at -x. G_y and F_y are the same along y. The camera rotates by

        x =  t G_y + s F_y,   y = -(t G_x + s F_x) + b o M,   z = -a o (G_y + F_y / D)
        s = a (L - f / 2) / D,   t = a (L - f / 2 + h + c / 2) + p H

    where a is the expansion of the structure, f is the focal length, and the meanings of the keys
    explain the other letters. G is the same in tube, base and feet. F acts in the tube alone. The
    curvature a F / D of the tube rotates the lens, and the detector at the distance f behind it. H
    is the height of a bracket.

    b is the curvature of the base (of thickness c) per kelvin, because the panel expands by p. The
    feet move by e = (a - p) S / 2 per kelvin. Three unknowns follow from the equations below: the
    rotation q at the tops of the feet, the deflection d of a foot, and the force P divided by
    modulus and width.

        P = k1 d - k2 q,   d = e - q c / 2 - P B / (2 c),   q (c^3 / (6 B) + k4) = k2 d + P c / 2
        k1, k2, k4 = I (12 / h^3, 6 / h^2, (4 + v) / h) / (1 + v),   I = w^3 / 12,
        v = 3.2 (w / h)^2,   B = S - w,   b = 2 q / B

    The h in these equations is longer by 0.44 w, because the base yields at the root of a foot.

    The scale and the focus change by

        df / f = [e T + a (1 - T)] M,   defocus = f (a - e) M

    where e is `lens_expansion`. T is 1 for a lens that is telecentric in image space, and 0 if the
    exit pupil is at the nodal point. A flux q, in the middle of a side of the tube with the
    conductivity k, gives

        F = 2 q / (k u / R^2 + 4 sigma T^3),   R = D / 2,   u the wall

    Source: beams with shear: Timoshenko and Young (1968), Elements of Strength of Materials; roots
    of beams: O'Donnell (1960), Journal of Applied Mechanics 27, 461. F is from conduction around
    the tube and radiation.

    Accuracy  model: small displacements, one material; no slip of bolts, no moisture, no bending of
              the panel itself, no mounts of single lenses. Finite elements of the same section
              (tests/oracle/structure.py, 25 shapes, 16 of them random) agree within 10 % for a
              gradient, 18 % for a flux, and 15 % if the panel bends the base.
    """

    material: str = parameter(
        "material of tube, base and feet",
        limit=Range(choices=tuple(MATERIALS)),
        default="aluminium",
    )
    expansion: float | None = parameter(
        "thermal expansion, in place of the material's", unit=EXPANSION, limit=FINITE, default=None
    )
    conductivity: float | None = parameter(
        "thermal conductivity, in place of the material's",
        unit=Unit("W / (m K)"),
        limit=POSITIVE,
        default=None,
    )
    length: float | None = parameter(
        "L, distance from the middle of the base to the lens; None: the focal length",
        unit=LENGTH,
        limit=NON_NEGATIVE,
        default=None,
    )
    diameter: float | None = parameter(
        "D, diameter of the tube; None: 1.96 apertures, the median of nine lenses",
        unit=LENGTH,
        limit=POSITIVE,
        default=None,
    )
    wall: float = parameter(
        "u, thickness of the tube; assumed", unit=LENGTH, limit=POSITIVE, default=2e-3
    )
    feet_span: float | None = parameter(
        "S, distance between the middles of opposite feet; None: 1.5 diameters, assumed",
        unit=LENGTH,
        limit=POSITIVE,
        default=None,
    )
    height: float = parameter(
        "h, height of the feet; assumed", unit=LENGTH, limit=POSITIVE, default=10e-3
    )
    feet_thickness: float = parameter(
        "w, thickness of a foot along the span: thin feet are flexible; assumed",
        unit=LENGTH,
        limit=POSITIVE,
        default=5e-3,
    )
    base: float = parameter(
        "c, thickness of the base; assumed", unit=LENGTH, limit=POSITIVE, default=5e-3
    )
    offset: float = parameter(
        "o, distance along x of the lens from the middle of the feet, weighted by their stiffness: "
        "0 if the feet are symmetric",
        unit=LENGTH,
        limit=FINITE,
        default=0.0,
    )
    plate_expansion: float = parameter(
        "p, thermal expansion of the panel of the platform; default: aluminium",
        unit=EXPANSION,
        limit=FINITE,
        default=23.6e-6,
    )
    bracket: float = parameter(
        "H, height of a bracket between panel and feet, of the panel's material; 0: errors at the "
        "flange of the head",
        unit=LENGTH,
        limit=NON_NEGATIVE,
        default=0.0,
    )
    lens_expansion: float = parameter(
        "e, relative change of the focal length of the lens alone, with its glasses",
        unit=EXPANSION,
        limit=FINITE,
        default=5e-6,
    )
    telecentric: float = parameter(
        "T, 0: the exit pupil is at the nodal point; 1: it is at infinity. With the default the "
        "scale changes as in the shipped Petzval lens, traced in aluminium: 20 um / (m K)",
        limit=Range(0, 1),
        default=0.2,
    )
    detector_offset: float = parameter(
        "distance along x from the fixed point of the board to the middle of the detector",
        unit=LENGTH,
        limit=FINITE,
        default=0.0,
    )
    board_expansion: float = parameter(
        "thermal expansion of the board; default: glass and epoxy",
        unit=EXPANSION,
        limit=FINITE,
        default=15e-6,
    )
    swing: float = parameter(
        "amplitude of the mean temperature over an orbit",
        unit=KELVIN,
        limit=NON_NEGATIVE,
        default=0.0,
    )
    gradient_x: float = parameter(
        "G, amplitude of the gradient along x over an orbit; the same in panel and head",
        unit=GRADIENT,
        limit=NON_NEGATIVE,
        default=0.0,
    )
    gradient_y: float = parameter(
        "likewise along y", unit=GRADIENT, limit=NON_NEGATIVE, default=0.0
    )
    phase_x: float = parameter(
        "phase of the gradient along x, in orbits before the mean temperature; the default is a "
        "quarter, by which the mean temperature lags behind the heat",
        limit=FINITE,
        default=0.25,
    )
    phase_y: float = parameter(
        "phase of the gradient along y; by default a quarter more, so that the warm side rotates",
        limit=FINITE,
        default=0.5,
    )
    flux: float = parameter(
        "q, amplitude over an orbit of the flux absorbed in the middle of one side of the tube, "
        "minus the flux on the opposite side; for both axes, in phase with the gradients",
        unit=Unit("W / m2"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    mean_profile: tuple[float, ...] = parameter(
        "mean temperature above the calibration's, at even steps over an orbit; in place of "
        "`swing`, and with the effect of heaters included",
        unit=KELVIN,
        default=(),
    )
    gradient_x_profile: tuple[float, ...] = parameter(
        "gradient at even steps over an orbit, in place of `gradient_x`", unit=GRADIENT, default=()
    )
    gradient_y_profile: tuple[float, ...] = parameter("likewise along y", unit=GRADIENT, default=())
    heat: Heat | None = parameter(
        "orbit, surfaces and heat capacities, from which mean temperature and flux over an orbit "
        "are computed, in place of `swing`, `flux` and their phases; gradients of the panel remain",
        default=None,
    )
    displacements: str = parameter(
        "CSV file of a thermo-elastic program: displacements of nodes per kelvin, for a gradient "
        "per kelvin / metre. Columns: part (feet, detector, lens), load (mean, gradient_x, "
        "gradient_y, flux_x, flux_y), x, y, z, dx, dy, dz (metre, in the camera's axes). It "
        'replaces the formulas for the loads that it contains; "": none',
        limit=core.FILE,
        default="",
    )
    calibration_offset: float = parameter(
        "sigma over units of the mean temperature in flight minus the temperature of calibration",
        unit=KELVIN,
        limit=NON_NEGATIVE,
        default=0.0,
    )
    gradient_offset: float = parameter(
        "sigma over units of the gradient per axis, in flight minus calibration",
        unit=GRADIENT,
        limit=NON_NEGATIVE,
        default=0.0,
    )
    rise: float = parameter(
        "rise of temperature after the head is switched on",
        unit=KELVIN,
        limit=NON_NEGATIVE,
        default=0.0,
    )
    rise_time: float = parameter(
        "time constant of this rise", unit=Unit("s", "min"), limit=POSITIVE, default=1800.0
    )
    since: float | None = parameter(
        "time since the head was switched on; None: long ago, as at the calibration",
        unit=Unit("s", "min"),
        limit=NON_NEGATIVE,
        default=None,
    )
    heater: float = parameter(
        "mean power of controlled heaters at the feet, or below the bracket. Swing and gradients "
        "decrease by the fraction power / (conductance A), where A is the amplitude of a foot's "
        "temperature, gradients included",
        unit=Unit("W"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    conductance: float = parameter(
        "thermal conductance G from head to platform, with the heat capacity C of the head: "
        "|G + i 2 pi C / orbit|; assumed",
        unit=Unit("W / K"),
        limit=POSITIVE,
        default=0.5,
    )
    focus: bool = parameter(
        "whether the defocus also changes; trials then take several times as long, because each "
        "environment has its own images",
        default=False,
    )

    _files: tuple[core.FileState, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.feet_span is not None and self.feet_span <= self.feet_thickness:
            raise Refused(
                "feet_span must be above feet_thickness, got "
                f"{self.feet_span:g} m and {self.feet_thickness:g} m"
            )
        if self.heat and (any(self._profiles) or self.swing or self.flux):
            raise Refused("heat must be left out if swing, flux or profiles are given")
        counts = {len(profile) for profile in self._profiles if profile}
        if len(counts) > 1 or 1 in counts:
            raise Refused(
                "mean_profile, gradient_x_profile and gradient_y_profile must have one common "
                f"length of two or more, got {', '.join(map(str, sorted(counts)))}"
            )

    @property
    def _profiles(self) -> tuple[tuple[float, ...], ...]:
        return self.mean_profile, self.gradient_x_profile, self.gradient_y_profile

    @property
    def made_of(self) -> Material:
        """Material of the structure; keys of the design replace values of the table."""
        given = {"expansion": self.expansion, "conductivity": self.conductivity}
        named = {name: value for name, value in given.items() if value is not None}
        return MATERIALS[self.material]._replace(**named)

    def size(self, optics: Optics) -> tuple[float, float, float]:
        """Length to the lens, diameter of the tube and span of the feet, metre."""
        length = optics.focal_length if self.length is None else self.length
        diameter = self.diameter or WIDE * optics.aperture
        return length, diameter, self.feet_span or SPREAD * diameter

    def mass(self, optics: Optics) -> float:
        """Mass of tube and base, kilogram; the base is a square as wide as the span of the feet."""
        length, diameter, span = self.size(optics)
        tube = math.pi * diameter * self.wall * max(length, optics.focal_length)
        return self.made_of.density * (tube + self.base * span**2)

    def uncontrolled(self, optics: Optics) -> float:
        """Fraction of swing and gradients that remains with the heaters."""
        swing = float(np.ptp(orbit_temperatures(self.heat).head)) / 2 if self.heat else self.swing
        lever = self.size(optics)[2] / 2
        at_foot = swing + lever * math.hypot(self.gradient_x, self.gradient_y)
        return max(1 - self.heater / (self.conductance * at_foot), 0.0) if at_foot else 1.0

    def flux_gradient(self, optics: Optics) -> float:
        """Difference of temperature between opposite sides of the tube by the flux, kelvin."""
        return self.flux * self._gradient_by_flux(optics)

    def _gradient_by_flux(self, optics: Optics) -> float:
        radius = self.size(optics)[1] / 2
        return 2 / (self.made_of.conductivity * self.wall / radius**2 + RADIATED)

    def _base_curvature(self, span: float) -> float:
        """Curvature b of the base, radian / metre / kelvin."""
        thick, foot = self.base, self.feet_thickness
        high = self.height + ROOT * foot
        between = span - foot
        shear = SHEAR * (foot / high) ** 2
        stiff = foot**3 / 12 / (1 + shear)
        k1, k2, k4 = stiff * np.array([12 / high**3, 6 / high**2, (4 + shear) / high])
        balance = np.array(
            [
                [k2, 1.0, -k1],
                [thick / 2, between / (2 * thick), 1.0],
                [thick**3 / (6 * between) + k4, -thick / 2, -k2],
            ]
        )
        moved = (self.made_of.expansion - self.plate_expansion) * span / 2
        return float(2 * np.linalg.solve(balance, [0.0, moved, 0.0])[0] / between)

    def responses(self, optics: Optics, pitch: float) -> dict[str, Floats]:
        """Change of each value of the instrument by each load: M, G_x, G_y, F_x, F_y.

        pitch    metre, pixel pitch of the detector
        Returns  (5,) by dotted name, per kelvin (M, F) or kelvin / metre (G): the relative change
                 of the focal length; for other values the change in SI units or pixel
        """
        length, diameter, span = self.size(optics)
        own = self.made_of.expansion
        arm = length - optics.focal_length / 2
        tube = own * arm / diameter
        turn = own * (arm + self.height + self.base / 2) + self.plate_expansion * self.bracket
        bent = self._base_curvature(span) * self.offset if self.offset else 0.0
        twist = -own * self.offset
        scale = np.array([own, *NONE])
        board = (self.board_expansion - own) * self.detector_offset / pitch
        turns = np.array(
            [
                [0.0, 0.0, turn, 0.0, tube],
                [bent, -turn, 0.0, -tube, 0.0],
                [0.0, 0.0, twist, 0.0, twist / diameter],
            ]
        )
        if self.displacements:
            content = core.file_digest(regular_file(Path(self.displacements)))
            for load, (by, stretch) in read_displacements(self.displacements, content).items():
                turns[:, LOADS.index(load)], scale[LOADS.index(load)] = by, stretch
        lens = np.array([self.lens_expansion, *NONE])
        responses = dict(zip(TURNS, turns, strict=True)) | {
            FOCAL: lens * self.telecentric + scale * (1 - self.telecentric),
            "instrument.optics.principal_x": np.array([board, *NONE]),
        }
        if self.focus and not optics.psf_file:
            responses["instrument.optics.defocus"] = optics.focal_length * (scale - lens)
        return {name: values for name, values in responses.items() if values.any()}

    def swings(self, optics: Optics) -> Floats:
        """Rms (3,) over an orbit of the rotations about x, y and z, radian."""
        responses, orbit = self.responses(optics, 1.0), self._over_orbit(optics)
        over = np.array([responses.get(name, np.zeros(len(LOADS))) for name in TURNS]) @ orbit
        return np.abs(over[:, 0]) / 2**0.5 if orbit.shape[1] == 1 else over[:, 1:].std(axis=1)

    def variations(self, optics: Optics, pitch: float, residual: bool) -> Iterator[Variation]:
        """Variations over an orbit, and between launches, that temperatures cause.

        residual  whether the design has `[instrument.residual]`, whose temperature is the head's
        """
        responses = self.responses(optics, pitch)
        if residual:
            responses[RESIDUAL] = np.array([1.0, *NONE])
        orbit = self._over_orbit(optics)
        tabulated = orbit.shape[1] > 1
        side = self.gradient_offset
        sigma = np.array([self.calibration_offset, side, side, 0.0, 0.0])
        cold = 0.0 if self.since is None else self.rise * math.exp(-self.since / self.rise_time)
        for name, response in responses.items():
            vary = RELATIVE if name == FOCAL else ABSOLUTE
            over = response @ orbit
            if tabulated and np.ptp(over):
                values = tuple(_text(name, float(value)) for value in over)
                scope = Scope.ENVIRONMENT
                yield Variation(name, "table", values=values, vary=vary, per=scope, group=ORBIT)
            elif not tabulated and over[0]:
                amplitude, phase = float(abs(over[0])), cmath.phase(over[0]) / math.tau
                yield Variation(
                    name,
                    "sinusoid",
                    amplitude=_text(name, amplitude),
                    phase=phase,
                    vary=vary,
                    per=Scope.ENVIRONMENT,
                    group=ORBIT,
                )
            parts, mean = response * sigma, -cold * float(response[0])
            total = float(np.sqrt(parts @ parts))
            if total or mean:
                yield Variation(
                    name,
                    sigma=_text(name, total),
                    mean=_text(name, mean),
                    vary=vary,
                    per=Scope.LAUNCH,
                    group=LAUNCH,
                    correlation=float(np.clip(parts[0] / total, -1, 1)) if total else 1.0,
                )

    def _over_orbit(self, optics: Optics) -> NDArray[np.complexfloating] | Floats:
        """Loads (5, n) of `responses`, kelvin and kelvin / metre, at even steps over an orbit.

        Both ends of the orbit are included. Without a profile, n is 1, and the loads are complex
        amplitudes of sinusoids: the phase of i is a quarter of an orbit earlier.
        """
        wave = self._waves(optics)
        if self.heat:
            return self._by_heat(self.heat, optics)
        if not any(self._profiles):
            return wave[:, None]
        count = max(map(len, self._profiles))
        turn = np.exp(2j * math.pi * np.linspace(0, 1, count))
        rows = zip((*self._profiles, (), ()), wave, strict=True)
        return np.array([profile or np.imag(phasor * turn) for profile, phasor in rows])

    def _waves(self, optics: Optics) -> NDArray[np.complexfloating]:
        """Complex amplitudes (5,) of the loads, from swing, gradients and flux."""
        left, side = self.uncontrolled(optics), self.flux_gradient(optics)
        size = [left * self.swing, left * self.gradient_x, left * self.gradient_y, side, side]
        phase = np.array([0.0, self.phase_x, self.phase_y, self.phase_x, self.phase_y])
        return np.array(size) * np.exp(2j * math.pi * phase)

    def loads(
        self, optics: Optics, place: Floats, mean: Floats | None = None, sides: Floats | None = None
    ) -> Floats:
        """Loads (5, n) of `responses`, kelvin and kelvin / metre, at positions in an orbit.

        place  (n,) 1, position in the orbit from the ascending node, 0 to 1
        mean   (n,) kelvin, mean temperature above calibration, without heaters; None: by `swing`
        sides  (2, n) W / m2, half of the difference of the fluxes that the tube absorbs at +x and
               at -x, and the same along y; None: by `flux`
        """
        loads = np.imag(self._waves(optics)[:, None] * np.exp(2j * math.pi * place))
        if mean is not None:
            loads[0] = self.uncontrolled(optics) * mean
        if sides is not None:
            loads[3:] = self._gradient_by_flux(optics) * sides
        return loads

    def _by_heat(self, heat: Heat, optics: Optics) -> Floats:
        """As `_over_orbit`, with temperatures by heat; the calibration is at their mean."""
        warm = orbit_temperatures(heat)
        rows = np.stack([warm.head - warm.head.mean(), warm.side_x, warm.side_y])
        place = np.linspace(0, 1, TIMES + 1)
        given = np.linspace(0, 1, rows.shape[1] + 1)
        rows = np.array([np.interp(place, given, np.append(row, row[0])) for row in rows])
        return self.loads(optics, place, rows[0], rows[1:])


@lru_cache(maxsize=8)
def read_displacements(path: str, content: str) -> dict[str, tuple[Floats, float]]:
    """Rotation (3,) of the camera in radian, and relative change of its focal length, by load.

    Each part moves as the rigid body that fits its nodes best, by least squares. The boresight is
    the line from the middle of the detector's nodes to the middle of the lens's nodes, relative to
    the feet. About the boresight the camera rotates with the detector.

    content  digest of the file, so that a changed file is read again
    Raises   Refused if the file has other columns, or if a part has fewer than three nodes or all
             of its nodes on a line.
    """
    table = csv_table(Path(path), ended=False, what="a table of displacements")
    if not set(COLUMNS) <= set(table.colnames):
        raise Refused(f"{path}: a table of displacements must have columns {', '.join(COLUMNS)}")
    rows = [dict(zip(table.colnames, map(str, row), strict=True)) for row in table]
    displacements = {}
    for load in dict.fromkeys(row["load"] for row in rows):
        if load not in LOADS:
            raise Refused(f"{path}: load must be one of {', '.join(LOADS)}, got {load!r}")
        parts = {}
        for part in PARTS:
            of = [row for row in rows if (row["part"], row["load"]) == (part, load)]
            try:
                nodes = np.array([[float(row[key]) for key in COLUMNS[2:]] for row in of])
            except (TypeError, ValueError):
                raise Refused(f"{path}: places and displacements must be numbers") from None
            parts[part] = _rigid(nodes, f"{path}: {part} under {load}")
        feet, detector, lens = (parts[part] for part in PARTS)
        line = lens.middle - detector.middle
        moved = lens.shift - detector.shift - np.cross(feet.turn, line)
        length = float(np.linalg.norm(line))
        turn = np.array([-moved[1], moved[0], 0.0]) / length
        turn[2] = detector.turn[2] - feet.turn[2]
        displacements[load] = turn, float(moved @ line) / length**2
    return displacements


class _Rigid(NamedTuple):
    """Middle (3,) of a part in metre, its shift (3,) in metre, and its rotation (3,) in radian."""

    middle: Floats
    shift: Floats
    turn: Floats


def _rigid(nodes: Floats, name: str) -> _Rigid:
    if len(nodes) < 3 or not np.isfinite(nodes).all():
        raise Refused(f"{name} must have three nodes or more, got {len(nodes)}")
    middle, shift = np.split(nodes.mean(axis=0), 2)
    place, moved = np.split(nodes - nodes.mean(axis=0), 2, axis=1)
    # moved = turn x place, for each node
    matrix = np.concatenate([np.cross(np.eye(3), node).T for node in place])
    turn, _, rank, _ = np.linalg.lstsq(matrix, moved.ravel(), rcond=1e-9)
    if rank < 3:
        raise Refused(f"{name} must not have all nodes on a line")
    return _Rigid(middle, shift, turn)


def _text(name: str, value: float) -> float | str:
    """A value of a variation in the form of a design file, with its unit."""
    unit = "m" if name.endswith(".defocus") else UNITS.get(name.rpartition(".")[0], "")
    return f"{value!r} {unit}" if unit and value else value
