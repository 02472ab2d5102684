"""Mission: orbit, attitude law, heads, time and requirements, as a mission file gives them."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core, space
from startrack.attitude import Mounting
from startrack.core import FINITE, Floats, Parameters, Range, Refused, Unit, deg, within
from startrack.design import Design, Fidelity, KeepOut, load_design, replaced_all
from startrack.io import from_table, read_layers, save_text, shipped, to_table

LAWS = ("nadir", "inertial", "sun", "target", "aem")
YAWS = ("velocity", "ground", "sun")
MOST_STEPS = 10**8
JULIAN_YEAR = 365.25 * 86400.0  # second
LEAST_TRIALS = 20  # of which half fit a correction and half check it
OLDEST = 100 * JULIAN_YEAR  # second, of a head
UNIT_NORM = 1e-3  # by which the norm of a quaternion in a file may differ from one


@dataclass(frozen=True)
class Orbit(Parameters):
    """An orbit around the Earth: exactly one of mean elements, `tle` and `oem`."""

    altitude: Annotated[
        float | None,
        Unit("m", "km"),
        core.POSITIVE,
        "semi-major axis minus the Earth's equatorial radius",
    ] = None
    inclination: Annotated[
        float | None, Unit("rad", "deg"), Range(0, math.pi), "mean, to the true equator of date"
    ] = None
    node: Annotated[
        float,
        Unit("rad", "deg"),
        FINITE,
        "right ascension of the ascending node, from the mean equinox of date",
    ] = 0.0
    local_time: Annotated[
        float | None,
        Unit("s", "h", clock=True),
        Range(0, 86400),
        'mean solar time at the ascending node (LTAN), as "10.5 h" or "10:30"; it replaces '
        "`inclination` and `node` by those of a Sun-synchronous orbit",
    ] = None
    anomaly: Annotated[float, Unit("rad", "deg"), FINITE, "mean, from the perigee"] = 0.0
    perigee: Annotated[float, Unit("rad", "deg"), FINITE, "its argument"] = 0.0
    eccentricity: Annotated[float, Range(0, 0.9), "mean"] = 0.0
    epoch: Annotated[str | None, "UTC, of the elements; None: the begin of the mission"] = None
    tle: Annotated[tuple[str, ...], "two-line element set, moved by SGP4 (extra `earth`)"] = ()
    oem: Annotated[
        str | None,
        core.FILE,
        "file with a CCSDS orbit ephemeris message; or a SPICE kernel of one body (.bsp; extra "
        "`spice`)",
    ] = None
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


@dataclass(frozen=True)
class Scan(Parameters):
    """A rotation about a body axis on top of the law: a swing, a steady rate, or both.

        angle = amplitude * sin(2 pi t / period) + rate * t,   t from the begin of the mission

    Both are about one axis.
    """

    axis: Annotated[tuple[float, ...], "body axis; its length does not matter"] = (1.0, 0.0, 0.0)
    amplitude: Annotated[float, Unit("rad", "deg"), core.NON_NEGATIVE, "of the swing"] = 0.0
    period: Annotated[float, Unit("s"), core.POSITIVE, "of the swing"] = 60.0
    rate: Annotated[float, Unit("rad/s", "deg/s"), FINITE, "steady"] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _vector("axis", self.axis, 3)


@dataclass(frozen=True)
class Attitude(Parameters):
    """The attitude law of the spacecraft: its axes x, y, z at every time."""

    law: Annotated[
        str,
        Range(choices=LAWS),
        '"nadir": z to the Earth\'s centre; "inertial": fixed to the stars; "sun": `axis` to the '
        'Sun; "target": z to a place on the ground where it is above the horizon, else nadir; '
        '"aem": a file',
    ] = "nadir"
    yaw: Annotated[
        str,
        Range(choices=YAWS),
        'with nadir and target, x: "velocity": in the plane of the orbit, forward; "ground": '
        'along the velocity over the rotating Earth; "sun": so that the Sun is in the plane of '
        "x and z, on the side of +x",
    ] = "velocity"
    quaternion: Annotated[tuple[float, ...], "x, y, z, w of icrs_to_body, of the inertial law"] = (
        0.0,
        0.0,
        0.0,
        1.0,
    )
    axis: Annotated[
        tuple[float, ...],
        'body axis that the law "sun" turns to the Sun; the x axis, or where that is `axis` the '
        "z axis, is as near as possible to the celestial north",
    ] = (0.0, 0.0, 1.0)
    latitude: Annotated[
        float,
        Unit("rad", "deg"),
        Range(-math.pi / 2, math.pi / 2),
        "of the target, geodetic on WGS 84",
    ] = 0.0
    longitude: Annotated[float, Unit("rad", "deg"), FINITE, "of the target, geodetic on WGS 84"] = (
        0.0
    )
    height: Annotated[
        float, Unit("m"), Range(-500.0, 9000.0), "of the target, geodetic on WGS 84"
    ] = 0.0
    aem: Annotated[
        str | None,
        core.FILE,
        "file with a CCSDS attitude ephemeris message, of quaternions between ICRF or EME2000 and "
        "SC_BODY; or a SPICE kernel of one instrument (.bc, its clock beside it as .tsc; extra "
        "`spice`)",
    ] = None
    scan: Annotated[Scan | None, "a rotation on top of the law; None: none"] = None
    _files: tuple[core.FileState, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        _unit_quaternion("quaternion", self.quaternion)
        _vector("axis", self.axis, 3)
        if (self.law == "aem") != (self.aem is not None):
            raise Refused("aem must be given with law = 'aem', and with no other")


@dataclass(frozen=True)
class HeadTemperature(Parameters):
    """Temperature of a head over the orbit, above that of its design.

        offset + swing sin(phase of the orbit from the ascending node + ahead)

    It moves the temperatures of the detector (`instrument.detector.thermal`), of the lens
    (`instrument.thermal`) and of the displacements of the field (`instrument.residual`), where the
    design has them.
    """

    offset: Annotated[float, Unit("K"), FINITE, "at all times"] = 0.0
    swing: Annotated[float, Unit("K"), core.NON_NEGATIVE, "amplitude"] = 0.0
    ahead: Annotated[float, Unit("rad", "deg"), FINITE, "angle of the orbit"] = 0.0


@dataclass(frozen=True)
class Head(Parameters):
    """A star tracker on the spacecraft."""

    name: Annotated[str, "for tables"]
    design: Annotated[
        str,
        "design file, its path from the folder of the mission file, or a shipped one such as "
        '"designs/nanosatellite.toml"',
    ]
    azimuth: Annotated[
        float, Unit("rad", "deg"), FINITE, "of the boresight, from body +x to +y"
    ] = 0.0
    elevation: Annotated[
        float,
        Unit("rad", "deg"),
        Range(-math.pi / 2, math.pi / 2),
        "of the boresight, from the plane of body x and y to +z",
    ] = 0.0
    roll: Annotated[
        float,
        Unit("rad", "deg"),
        FINITE,
        "of the camera about its boresight; at 0 its x axis is body z cross boresight",
    ] = 0.0
    camera_to_body: Annotated[
        tuple[float, ...] | None,
        "quaternion x, y, z, w instead of these three angles; None: the angles",
    ] = None
    exclusion: Annotated[
        KeepOut,
        "angles from the boresight below which Sun, Moon and the lit limb of the Earth blind "
        "it; each that is not given follows from the design's baffle, or is the half diagonal "
        "of its field",
    ] = field(default_factory=KeepOut)
    alignment: Annotated[
        Mounting,
        "error of the known mounting: bias, and a thermo-elastic swing that goes with the orbit",
    ] = field(default_factory=Mounting)
    age: Annotated[
        float | None,
        Unit("s", "yr"),
        Range(0, OLDEST),
        "in orbit at the begin of the mission; it grows with the mission by the laws of the "
        "design (`instrument.detector.age`, [[variation]] per life of a unit). None: the design "
        "as it is, at all times",
    ] = None
    temperature: Annotated[HeadTemperature, "over the orbit, above that of the design"] = field(
        default_factory=HeadTemperature
    )
    unit: Annotated[
        int | None,
        Range(0, 10**6),
        "number of a unit that is drawn from the [[variation]] tables of the design; None: the "
        "unit as designed",
    ] = None
    position: Annotated[
        tuple[float, ...],
        Unit("m"),
        "of its aperture in body axes; it matters beside `structure` alone",
    ] = (0.0, 0.0, 0.0)
    clear: Annotated[
        float | None,
        Unit("rad", "deg"),
        Range(0, math.pi),
        "angle from the boresight that structure in sunlight must keep; None: the exclusion "
        "angle of the lit limb",
    ] = None

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


@dataclass(frozen=True)
class TimeSpan(Parameters):
    """The time of a mission: SI seconds after its begin."""

    begin: Annotated[str, 'UTC, as "2026-03-20T12:00:00"']
    duration: Annotated[float, Unit("s", "d"), core.POSITIVE, "of the mission"] = 86400.0
    step: Annotated[
        float, Unit("s"), core.POSITIVE, "between two instants at which all is computed"
    ] = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        year = float(core.utc(self.begin).jyear)
        years = {"year of begin": year, "year of the end": year + self.duration / JULIAN_YEAR}
        within(space.FIRST_YEAR, space.LAST_YEAR, **years)
        core.whole(1, MOST_STEPS, **{"number of steps (duration / step)": self.steps})

    @property
    def steps(self) -> int:
        """Number of instants: at 0, step, 2 step ... before the end."""
        return max(math.ceil(self.duration / self.step - 1e-9), 1)


@dataclass(frozen=True)
class Radiation(Parameters):
    """What the South Atlantic anomaly does, as a box; the orbit by which detectors age."""

    saa: Annotated[
        str,
        Range(choices=("ignored", "blind")),
        '"ignored", or "blind": no head is valid inside the box',
    ] = "ignored"
    latitude: Annotated[tuple[float, ...], Unit("rad", "deg"), "geodetic south and north"] = (
        -50 * deg,
        0.0,
    )
    longitude: Annotated[tuple[float, ...], Unit("rad", "deg"), "west and east"] = (
        -90 * deg,
        40 * deg,
    )
    hits: Annotated[
        float | None,
        Unit("m", "mm"),
        core.POSITIVE,
        "aluminium through which trapped protons and electrons hit the detectors in rendered "
        "frames, at the rate of each place of the orbit, beside those of their designs; None: none "
        "do (extra `radiation`)",
    ] = None
    ageing: Annotated[
        str,
        Range(choices=("design", "orbit")),
        '"design": detectors age in the orbit that their designs name; "orbit": in that of the '
        "mission, of a given altitude (extra `radiation`)",
    ] = "design"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("latitude", "longitude"):
            pair = getattr(self, name)
            if len(pair) != 2 or not pair[0] < pair[1]:
                raise Refused(f"{name} must be two rising angles, got {pair}")
            for angle in pair:
                core.finite(**{name: angle})


@dataclass(frozen=True)
class MissionRequirements(Parameters):
    """What the mission asks of its heads together; None: not asked."""

    max_blind: Annotated[
        float | None, Unit("s"), core.NON_NEGATIVE, "longest time without any valid head"
    ] = None
    availability_one: Annotated[
        float | None, Range(0, 1), "fraction of the time with at least one valid head"
    ] = None
    availability_two: Annotated[
        float | None, Range(0, 1), "fraction of the time with at least two"
    ] = None
    max_error: Annotated[
        float | None,
        Unit("rad", "arcsec"),
        core.POSITIVE,
        "rms error of the fused attitude about its worst axis, over the times with a valid head",
    ] = None


@dataclass(frozen=True)
class SharedAlignmentError(Parameters):
    """Errors about the body's axes that all heads share, as of the structure that carries them."""

    x: Annotated[float, Unit("rad", "arcsec"), core.NON_NEGATIVE, "rms"] = 0.0
    y: Annotated[float, Unit("rad", "arcsec"), core.NON_NEGATIVE, "rms"] = 0.0
    z: Annotated[float, Unit("rad", "arcsec"), core.NON_NEGATIVE, "rms"] = 0.0

    @property
    def variance(self) -> Floats:
        """(3,) radian^2."""
        return np.array([self.x, self.y, self.z]) ** 2


@dataclass(frozen=True)
class Check(Parameters):
    """Trials at instants of the mission, which check and correct the errors of the error budget."""

    trials: Annotated[
        int, Range(0, 10**4), "of each design of heads; 0: none, the errors are those of the budget"
    ] = 0
    fidelity: Annotated[Fidelity, "of the trials"] = Fidelity.FRAME
    seed: Annotated[int, Range(0, 2**63 - 1), "of their noise, and of units"] = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.trials < LEAST_TRIALS:
            raise Refused(f"trials must be 0, or {LEAST_TRIALS} or more, got {self.trials}")


@dataclass(frozen=True)
class KeepClear(Parameters):
    """A cone in body axes in which no boresight may be placed, such as of a panel."""

    axis: Annotated[tuple[float, ...], "of the cone; its length does not matter"]
    angle: Annotated[
        float, Unit("rad", "deg"), Range(0, math.pi), "between the axis and the cone's surface"
    ]

    def __post_init__(self) -> None:
        super().__post_init__()
        _vector("axis", self.axis, 3)

    def depth(self, line: Floats) -> float:
        """Radian by which a unit vector (3,) is inside the cone; 0 outside."""
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        return max(self.angle - math.acos(min(max(float(axis @ line), -1.0), 1.0)), 0.0)


@dataclass(frozen=True)
class Obstacle:
    """A box or a panel of the spacecraft, in body axes.

    It blinds a head where it reaches into the half diagonal of its field, and where the Sun shines
    on the spacecraft within the head's `clear` angle, dark sides too. It does not hide stars, Sun,
    Moon or Earth from a head.
    """

    name: Annotated[str, "for messages"]
    centre: Annotated[tuple[float, ...], Unit("m"), "of the box"]
    size: Annotated[
        tuple[float, ...], Unit("m"), "along x, y and z; one of them may be 0, of a panel"
    ]
    hinge: Annotated[
        tuple[float, ...] | None,
        "axis through the centre about which the thinnest side follows the Sun; None: it stands",
    ] = None

    def __post_init__(self) -> None:
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


@dataclass(frozen=True)
class Mission:
    """What a mission file holds; see the tables."""

    time: Annotated[TimeSpan, "begin, duration and step"]
    orbit: Annotated[Orbit, "of the spacecraft"]
    heads: Annotated[tuple[Head, ...], "its star trackers"]
    attitude: Annotated[Attitude, "its attitude law"] = field(default_factory=Attitude)
    radiation: Annotated[Radiation, "the South Atlantic anomaly"] = field(default_factory=Radiation)
    common: Annotated[SharedAlignmentError, "errors that all heads share; they count once"] = field(
        default_factory=SharedAlignmentError
    )
    requirements: Annotated[MissionRequirements, "on the heads together"] = field(
        default_factory=MissionRequirements
    )
    keep_out: Annotated[tuple[KeepClear, ...], "cones in which no boresight may be placed"] = ()
    check: Annotated[Check, "trials that check and correct the errors of the heads"] = field(
        default_factory=Check
    )
    structure: Annotated[
        tuple[Obstacle, ...],
        "boxes and panels of the spacecraft that may stand in the way of heads",
    ] = ()
    heat: Annotated[
        space.Heat | None,
        "surfaces and heat capacities of platform and heads, from which the temperatures of drawn "
        "units follow (`--units`); orbit, attitude and direction of the heads are those of the "
        "mission. None: those of the designs' structures",
    ] = None

    def __post_init__(self) -> None:
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


@dataclass(frozen=True)
class Loaded:
    """A mission and the designs of its heads.

    mission  as its file has it, with the paths of files resolved
    designs  of the heads, in their order
    """

    mission: Mission
    designs: tuple[Design, ...]


def load_mission(path: Path, changes: Sequence[str] = ()) -> Loaded:
    """Read a mission file and the design files that it names.

    changes  values over those of the file: "time.step=60 s"
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

    Files of the mission are named from the folder of `path`, shipped designs by their names, so
    that the folder may move with them.

    comment  lines at the top of the file
    """
    import tomli_w

    head = "".join(f"# {line}\n" for line in comment.splitlines())
    folder = Path(path).parent
    named = with_files(mission, partial(_from, folder), partial(_shipped_as, folder))
    save_text(path, head + tomli_w.dumps(to_table(named)))


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


def _from(folder: Path, file: str) -> str:
    """The path of a file from a folder; as it is where they are on different drives."""
    try:
        return Path(os.path.relpath(os.path.realpath(file), os.path.realpath(folder))).as_posix()
    except ValueError:
        return os.path.realpath(file)


def _shipped_as(folder: Path, file: str) -> str:
    """The name of a shipped file, where no file of the folder has it; else its path from there."""
    root, full = shipped("missions").resolve().parent, Path(os.path.realpath(file))
    if full.is_relative_to(root) and not (folder / full.relative_to(root)).exists():
        return full.relative_to(root).as_posix()
    return _from(folder, file)


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
