"""Mission: orbit, attitude law, heads, time and requirements, as a mission file gives them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core, space
from startrack.attitude import Mounting
from startrack.core import (
    DAY,
    FINITE,
    YEAR,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    deg,
    parameter,
    printed,
    within,
)
from startrack.design import Design, Fidelity, KeepOut, load_design, replaced_all
from startrack.io import from_table, name_from, path_from, read_layers, save_toml, shipped, to_table

LAWS = ("nadir", "inertial", "sun", "target", "aem")
YAWS = ("velocity", "ground", "sun")
MOST_STEPS = 10**8

LEAST_TRIALS = 20  # half of them fit a correction, half check it
OLDEST = 100 * YEAR  # second, of a head
UNIT_NORM = 1e-3  # by which the norm of a quaternion in a file may differ from one


class MissionOrbit(Parameters):
    """An orbit around the Earth: exactly one of mean elements, `tle` and `oem`."""

    altitude: float | None = parameter(
        "semi-major axis minus the Earth's equatorial radius",
        unit=Unit("m", "km"),
        limit=core.POSITIVE,
        default=None,
    )
    inclination: float | None = parameter(
        "mean, to the true equator of date",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi),
        default=None,
    )
    node: float = parameter(
        "right ascension of the ascending node, from the mean equinox of date",
        unit=Unit("rad", "deg"),
        limit=FINITE,
        default=0.0,
    )
    local_time: float | None = parameter(
        'mean solar time at the ascending node (LTAN), as "10.5 h" or "10:30"; it replaces '
        "`inclination` and `node` by those of a Sun-synchronous orbit",
        unit=Unit("s", "h", clock=True),
        limit=Range(0, DAY),
        default=None,
    )
    anomaly: float = parameter(
        "mean, from the perigee", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    perigee: float = parameter("its argument", unit=Unit("rad", "deg"), limit=FINITE, default=0.0)
    eccentricity: float = parameter("mean", limit=Range(0, 0.9), default=0.0)
    epoch: str | None = parameter(
        "UTC, of the elements; None: the begin of the mission", default=None
    )
    tle: tuple[str, ...] = parameter(
        "two-line element set, moved by SGP4 (extra `earth`)", default=()
    )
    oem: str | None = parameter(
        "file with a CCSDS orbit ephemeris message; or a SPICE kernel of one body (.bsp; extra "
        "`spice`)",
        limit=core.FILE,
        default=None,
    )
    _files: tuple[core.FileState, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.altitude is not None) + bool(self.tle) + (self.oem is not None) != 1:
            raise Refused("altitude, tle or oem must be given, and one of them alone")
        if self.tle:
            space.require_two_lines(self.tle)
        if self.altitude is None:
            return
        space.require_perigee(self.altitude, self.eccentricity)
        if (self.inclination is None) == (self.local_time is None):
            raise Refused("inclination or local_time must be given, and one of them alone")
        if self.epoch is not None:
            core.utc(self.epoch)


class ScanLaw(Parameters):
    """A rotation about a body axis on top of the law: a swing, a steady rate, or both.

        angle = amplitude * sin(2 pi t / period) + rate * t,   t from the begin of the mission

    Both are about one axis.
    """

    axis: tuple[float, ...] = parameter(
        "body axis; its length does not matter", default=(1.0, 0.0, 0.0)
    )
    amplitude: float = parameter(
        "of the swing", unit=Unit("rad", "deg"), limit=core.NON_NEGATIVE, default=0.0
    )
    period: float = parameter("of the swing", unit=Unit("s"), limit=core.POSITIVE, default=60.0)
    rate: float = parameter("steady", unit=Unit("rad/s", "deg/s"), limit=FINITE, default=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        _vector("axis", self.axis, 3)


class Attitude(Parameters):
    """The attitude law of the spacecraft: its axes x, y, z at every time."""

    law: str = parameter(
        '"nadir": z to the Earth\'s centre; "inertial": fixed to the stars; "sun": `axis` to the '
        'Sun; "target": z to a place on the ground where it is above the horizon, else nadir; '
        '"aem": a file',
        limit=Range(choices=LAWS),
        default="nadir",
    )
    yaw: str = parameter(
        'with nadir and target, x: "velocity": in the plane of the orbit, forward; "ground": '
        'along the velocity over the rotating Earth; "sun": so that the Sun is in the plane of '
        "x and z, on the side of +x",
        limit=Range(choices=YAWS),
        default="velocity",
    )
    quaternion: tuple[float, ...] = parameter(
        "x, y, z, w of icrs_to_body, of the inertial law", default=(0.0, 0.0, 0.0, 1.0)
    )
    axis: tuple[float, ...] = parameter(
        'body axis that the law "sun" turns to the Sun; the x axis, or where that is `axis` the '
        "z axis, is as near as possible to the celestial north",
        default=(0.0, 0.0, 1.0),
    )
    latitude: float = parameter(
        "of the target, geodetic on WGS 84",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi / 2, math.pi / 2),
        default=0.0,
    )
    longitude: float = parameter(
        "of the target, geodetic on WGS 84", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    height: float = parameter(
        "of the target, geodetic on WGS 84",
        unit=Unit("m"),
        limit=Range(-500.0, 9000.0),
        default=0.0,
    )
    aem: str | None = parameter(
        "file with a CCSDS attitude ephemeris message, of quaternions between ICRF or EME2000 and "
        "SC_BODY; or a SPICE kernel of one instrument (.bc, its clock beside it as .tsc; extra "
        "`spice`)",
        limit=core.FILE,
        default=None,
    )
    scan: ScanLaw | None = parameter("a rotation on top of the law; None: none", default=None)
    _files: tuple[core.FileState, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        _unit_quaternion("quaternion", self.quaternion)
        _vector("axis", self.axis, 3)
        if (self.law == "aem") != (self.aem is not None):
            raise Refused("aem must be given with law = 'aem', and with no other")


class HeadTemperature(Parameters):
    """Temperature of a head over the orbit, above that of its design.

        offset + swing sin(phase of the orbit from the ascending node + ahead)

    It changes the temperatures of the detector (`instrument.detector.thermal`), of the lens
    (`instrument.thermal`) and of the displacements of the field (`instrument.residual`), if the
    design has them.
    """

    offset: float = parameter("at all times", unit=Unit("K"), limit=FINITE, default=0.0)
    swing: float = parameter("amplitude", unit=Unit("K"), limit=core.NON_NEGATIVE, default=0.0)
    ahead: float = parameter(
        "angle of the orbit", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )


class Head(Parameters):
    """A star tracker on the spacecraft."""

    name: str = parameter("for tables")
    design: str = parameter(
        "design file, its path from the folder of the mission file, or a shipped one such as "
        '"designs/nanosatellite.toml"'
    )
    azimuth: float = parameter(
        "of the boresight, from body +x to +y", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    elevation: float = parameter(
        "of the boresight, from the plane of body x and y to +z",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi / 2, math.pi / 2),
        default=0.0,
    )
    roll: float = parameter(
        "of the camera about its boresight; at 0 its x axis is body z cross boresight",
        unit=Unit("rad", "deg"),
        limit=FINITE,
        default=0.0,
    )
    camera_to_body: tuple[float, ...] | None = parameter(
        "quaternion x, y, z, w instead of these three angles; None: the angles", default=None
    )
    exclusion: KeepOut = parameter(
        "angles from the boresight below which Sun, Moon and the lit limb of the Earth blind "
        "it; each that is not given follows from the design's baffle, or is the half diagonal "
        "of its field",
        default_factory=KeepOut,
    )
    alignment: Mounting = parameter(
        "error of the known mounting: bias, and a thermo-elastic swing that goes with the orbit",
        default_factory=Mounting,
    )
    age: float | None = parameter(
        "in orbit at the begin of the mission; it grows with the mission by the laws of the "
        "design (`instrument.detector.age`, [[variation]] per life of a unit). None: the design "
        "as it is, at all times",
        unit=Unit("s", "yr"),
        limit=Range(0, OLDEST),
        default=None,
    )
    temperature: HeadTemperature = parameter(
        "over the orbit, above that of the design", default_factory=HeadTemperature
    )
    unit: int | None = parameter(
        "number of a unit that is drawn from the [[variation]] tables of the design; None: the "
        "unit as designed",
        limit=Range(0, 10**6),
        default=None,
    )
    position: tuple[float, ...] = parameter(
        "of its aperture in body axes; it matters beside `structure` alone",
        unit=Unit("m"),
        default=(0.0, 0.0, 0.0),
    )
    clear: float | None = parameter(
        "angle from the boresight that structure in sunlight must keep; None: the exclusion "
        "angle of the lit limb",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi),
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.position) != 3:
            raise Refused(f"position must be three lengths, got {len(self.position)}")
        if not self.name:
            raise Refused("name of a head must be given, got ''")
        if self.camera_to_body is not None:
            _unit_quaternion("camera_to_body", self.camera_to_body)
            if self.azimuth or self.elevation or self.roll:
                raise Refused(
                    "azimuth, elevation and roll must be left out where camera_to_body is given"
                )

    @property
    def mounting(self) -> Rotation:
        """camera_to_body; its third column is the boresight in body axes."""
        if self.camera_to_body is not None:
            return Rotation.from_quat(self.camera_to_body)
        return mounted(self.azimuth, self.elevation, self.roll)


def mounted(azimuth: float, elevation: float, roll: float = 0.0) -> Rotation:
    """camera_to_body of a boresight by its angles in body axes; see `Head`."""
    return Rotation.from_euler("ZYZ", [azimuth, math.pi / 2 - elevation, math.pi / 2 + roll])


class TimeSpan(Parameters):
    """The time of a mission: SI seconds after its begin."""

    begin: str = parameter('UTC, as "2026-03-20T12:00:00"')
    duration: float = parameter(
        "of the mission", unit=Unit("s", "d"), limit=core.POSITIVE, default=DAY
    )
    step: float = parameter(
        "between two instants at which all is computed",
        unit=Unit("s"),
        limit=core.POSITIVE,
        default=10.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        year = float(core.utc(self.begin).jyear)
        years = {"year of begin": year, "year of the end": year + self.duration / YEAR}
        within(space.FIRST_YEAR, space.LAST_YEAR, **years)
        core.whole(1, MOST_STEPS, **{"number of steps (duration / step)": self.steps})

    @property
    def steps(self) -> int:
        """Number of instants: at 0, step, 2 step ... before the end."""
        return max(math.ceil(self.duration / self.step - 1e-9), 1)


class MissionRadiation(Parameters):
    """Effects of the South Atlantic anomaly, as a box; the orbit that determines the ageing of
    detectors."""

    saa: str = parameter(
        '"ignored", or "blind": no head is valid inside the box',
        limit=Range(choices=("ignored", "blind")),
        default="ignored",
    )
    latitude: tuple[float, ...] = parameter(
        "geodetic south and north", unit=Unit("rad", "deg"), default=(-50 * deg, 0.0)
    )
    longitude: tuple[float, ...] = parameter(
        "west and east", unit=Unit("rad", "deg"), default=(-90 * deg, 40 * deg)
    )
    hits: float | None = parameter(
        "aluminium through which trapped protons and electrons hit the detectors in rendered "
        "frames, at the rate of each place of the orbit, beside those of their designs; None: none "
        "do (extra `radiation`)",
        unit=Unit("m", "mm"),
        limit=core.POSITIVE,
        default=None,
    )
    ageing: str = parameter(
        '"design": detectors age in the orbit that their designs name; "orbit": in that of the '
        "mission, of a given altitude (extra `radiation`)",
        limit=Range(choices=("design", "orbit")),
        default="design",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("latitude", "longitude"):
            pair = getattr(self, name)
            if len(pair) != 2 or not pair[0] < pair[1]:
                raise Refused(f"{name} must be two rising angles, got {pair}")
            for angle in pair:
                core.finite(**{name: angle})


class MissionRequirements(Parameters):
    """Requirements on all heads together; None: no requirement."""

    max_blind: float | None = parameter(
        "longest time without any valid head", unit=Unit("s"), limit=core.NON_NEGATIVE, default=None
    )
    availability_one: float | None = parameter(
        "fraction of the time with at least one valid head", limit=Range(0, 1), default=None
    )
    availability_two: float | None = parameter(
        "fraction of the time with at least two", limit=Range(0, 1), default=None
    )
    max_error: float | None = parameter(
        "rms error of the fused attitude about its worst axis, over the times with a valid head",
        unit=Unit("rad", "arcsec"),
        limit=core.POSITIVE,
        default=None,
    )


class SharedAlignmentError(Parameters):
    """Errors about the body's axes that all heads share, such as those of the structure."""

    x: float = parameter("rms", unit=Unit("rad", "arcsec"), limit=core.NON_NEGATIVE, default=0.0)
    y: float = parameter("rms", unit=Unit("rad", "arcsec"), limit=core.NON_NEGATIVE, default=0.0)
    z: float = parameter("rms", unit=Unit("rad", "arcsec"), limit=core.NON_NEGATIVE, default=0.0)

    @property
    def variance(self) -> Floats:
        """(3,) radian^2."""
        return np.array([self.x, self.y, self.z]) ** 2


class Check(Parameters):
    """Trials at instants of the mission, which check and correct the errors of the error budget."""

    trials: int = parameter(
        "of each design of heads; 0: none, the errors are those of the budget",
        limit=Range(0, 10**4),
        default=0,
    )
    fidelity: Fidelity = parameter("of the trials", default=Fidelity.FRAME)
    seed: int = parameter("of their noise, and of units", limit=Range(0, 2**63 - 1), default=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.trials < LEAST_TRIALS:
            raise Refused(f"trials must be 0, or {LEAST_TRIALS} or more, got {self.trials}")


class KeepClear(Parameters):
    """A cone in body axes in which no boresight may be placed, such as the normal of a panel."""

    axis: tuple[float, ...] = parameter("of the cone; its length does not matter")
    angle: float = parameter(
        "between the axis and the cone's surface", unit=Unit("rad", "deg"), limit=Range(0, math.pi)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _vector("axis", self.axis, 3)

    def depth(self, line: Floats) -> float:
        """Radian by which a unit vector (3,) is inside the cone; 0 outside."""
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        return max(self.angle - math.acos(min(max(float(axis @ line), -1.0), 1.0)), 0.0)


class Obstacle(Parameters):
    """A box or a panel of the spacecraft, in body axes.

    It blinds a head in two cases: if it reaches into the half diagonal of the head's field; and if
    it is within the head's `clear` angle while the Sun shines on the spacecraft, on dark sides too.
    It does not hide stars, Sun, Moon or Earth from a head.
    """

    name: str = parameter("for messages")
    centre: tuple[float, ...] = parameter("of the box", unit=Unit("m"))
    size: tuple[float, ...] = parameter(
        "along x, y and z; one of them may be 0, of a panel", unit=Unit("m")
    )
    hinge: tuple[float, ...] | None = parameter(
        "axis through the centre about which the thinnest side follows the Sun; None: it stands",
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("centre", "size"):
            value = getattr(self, name)
            if len(value) != 3:
                raise Refused(f"{name} must be three lengths, got {len(value)}")
            for length in value:
                core.finite(**{name: length})
        core.non_negative(size=min(self.size))
        if sum(length > 0 for length in self.size) < 2:
            raise Refused(f"size must be above 0 along two axes or three, got {self.size}")
        if self.hinge is not None:
            axis = _vector("hinge", self.hinge, 3) / np.linalg.norm(self.hinge)
            if abs(axis[int(np.argmin(self.size))]) > 1 - 1e-6:
                raise Refused("hinge must not be the normal of the thinnest side")


@printed
class Mission(Parameters):
    """Contents of a mission file; see the tables."""

    time: TimeSpan = parameter("begin, duration and step")
    orbit: MissionOrbit = parameter("of the spacecraft")
    heads: tuple[Head, ...] = parameter("its star trackers")
    attitude: Attitude = parameter("its attitude law", default_factory=Attitude)
    radiation: MissionRadiation = parameter(
        "the South Atlantic anomaly", default_factory=MissionRadiation
    )
    common: SharedAlignmentError = parameter(
        "errors that all heads share; they count once", default_factory=SharedAlignmentError
    )
    requirements: MissionRequirements = parameter(
        "on the heads together", default_factory=MissionRequirements
    )
    keep_out: tuple[KeepClear, ...] = parameter(
        "cones in which no boresight may be placed", default=()
    )
    check: Check = parameter(
        "trials that check and correct the errors of the heads", default_factory=Check
    )
    structure: tuple[Obstacle, ...] = parameter(
        "boxes and panels of the spacecraft that may stand in the way of heads", default=()
    )
    heat: space.Heat | None = parameter(
        "surfaces and heat capacities of platform and heads, from which the temperatures of drawn "
        "units follow (`--units`); orbit, attitude and direction of the heads are those of the "
        "mission. None: those of the designs' structures",
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.heads) <= 8:
            raise Refused(f"heads must be one to eight, got {len(self.heads)}")
        if self.radiation.ageing == "orbit" and self.orbit.altitude is None:
            raise Refused("radiation.ageing = 'orbit' must have an orbit of mean elements")
        if self.radiation.hits is not None and self.orbit.altitude is None:
            raise Refused("radiation.hits must have an orbit of mean elements")
        names = [head.name for head in self.heads]
        if len(set(names)) < len(names):
            raise Refused(f"heads must have different names, got {', '.join(names)}")
        needs = self.requirements.availability_two
        if needs is not None and len(self.heads) < 2:
            raise Refused("availability_two must be left out of a mission with one head")


@printed
@dataclass(frozen=True)
class Loaded:
    """A mission and the designs of its heads.

    mission  contents of its file, with resolved paths of files
    designs  of the heads, in their order
    """

    mission: Mission
    designs: tuple[Design, ...]


def load_mission(path: Path, changes: Sequence[str] = ()) -> Loaded:
    """Read a mission file and the design files that it names.

    changes  values that replace the file's: "time.step=60 s"
    Raises   ValueError, one sentence with the file, the position in it, the rule and the value.
    """
    path = Path(path)
    layers = read_layers(path, "a mission file", changes)
    try:
        mission = with_files(
            from_table(Mission, layers.table),
            lambda name: str(path.parent / name),
            lambda name: _found(name, path.parent),
        )
    except ValueError as error:
        raise Refused(layers.blamed(str(error), path)) from None
    designs = (load_design(Path(head.design)) for head in mission.heads)
    return Loaded(mission, tuple(_in_orbit(design, mission) for design in designs))


def _in_orbit(design: Design, mission: Mission) -> Design:
    """The design whose detector ages in the mission's orbit, where that is asked for."""
    orbit, age = mission.orbit, design.case.instrument.detector.age
    if mission.radiation.ageing != "orbit" or age is None or age.inclination is None:
        return design
    assert orbit.altitude is not None
    axis = space.EARTH_RADIUS + orbit.altitude
    tilt = orbit.inclination
    if tilt is None:
        tilt = space.sun_synchronous(axis, orbit.eccentricity)
    there = replace(age, altitude=orbit.altitude, inclination=tilt)
    return replace(design, case=replaced_all(design.case, {"instrument.detector.age": there}))


def save_mission(path: Path, mission: Mission, comment: str = "") -> None:
    """Write a mission file that `load_mission` reads back to an equal mission.

    Paths of the mission's files are written relative to the folder of `path`, and shipped designs
    by their names, so that the folder can be moved with the files in it.

    comment  lines at the top of the file
    """
    folder = Path(path).parent
    named = with_files(mission, partial(path_from, folder), partial(name_from, folder))
    save_toml(path, to_table(named), comment)


def with_files(
    mission: Mission, file: Callable[[str], str], design: Callable[[str], str]
) -> Mission:
    """The mission with other names of the files of its orbit and attitude, and of its designs."""
    orbit, law = mission.orbit, mission.attitude
    return replace(
        mission,
        orbit=replace(orbit, oem=file(orbit.oem)) if orbit.oem else orbit,
        attitude=replace(law, aem=file(law.aem)) if law.aem else law,
        heads=tuple(replace(head, design=design(head.design)) for head in mission.heads),
    )


def _found(name: str, folder: Path) -> str:
    """The path of a design from a folder, or of a shipped one."""
    if not (folder / name).exists():
        try:
            return str(shipped(name))
        except (FileNotFoundError, ValueError):
            pass
    return str(folder / name)


def _vector(name: str, value: tuple[float, ...], length: int) -> Floats:
    vector = np.array(value, float)
    if len(value) != length or not 1e-9 < np.linalg.norm(vector) < 1e9:
        raise Refused(f"{name} must be {length} numbers that are not all zero, got {value}")
    return vector


def _unit_quaternion(name: str, value: tuple[float, ...]) -> None:
    norm = float(np.linalg.norm(_vector(name, value, 4)))
    if abs(norm - 1) > UNIT_NORM:
        raise Refused(f"{name} must have the norm 1 within {UNIT_NORM}, got {norm:g}")
