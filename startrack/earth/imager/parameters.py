"""Imager, its channels, and Survey (camera, land and air of an Earth image), and their files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np

from startrack import core, space
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    nm,
    parameter,
    printed,
)
from startrack.detector import Detector
from startrack.earth import geometry
from startrack.earth.atmosphere import Air
from startrack.earth.geometry import Orbit
from startrack.earth.imager.clouds import CloudLayer
from startrack.earth.imager.land import Land
from startrack.earth.imager.spectrum_file import SpectrumFile
from startrack.io import LayerRules, Layers, Renewed, from_table, read_layers, read_table, shipped
from startrack.motion import Motion
from startrack.optics import Optics, with_plain_optics

UNKNOWN = {
    "optics": (
        *("principal_x", "principal_y", "k1", "k2", "p1", "p2", "k3"),
        *("growth_along", "growth_across"),
    ),
    "detector": ("region", "row_delay", "crosstalk", "lag"),
}


class Reference(Parameters):
    """The light at the lens for the required SNR of a channel: radiance or temperature."""

    radiance: float | None = parameter(
        "watt / m^2 / sr / m",
        unit=Unit("W / (m2 sr m)", "W / (m2 sr um)"),
        limit=POSITIVE,
        default=None,
    )
    temperature: float | None = parameter(
        "of a blackbody", unit=Unit("K"), limit=Range(100, 2000), default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [value for value in (self.radiance, self.temperature) if value is not None]
        if len(given) != 1:
            raise ValueError(f"either radiance or temperature must be given, got {len(given)}")


class Performance(Parameters):
    """Performance of a channel, required or measured in orbit; None: not given."""

    snr: float | None = parameter(
        "1, signal-to-noise ratio at the light of `reference`", limit=POSITIVE, default=None
    )
    nedt: float | None = parameter(
        "noise-equivalent temperature difference, likewise",
        unit=Unit("K", "mK"),
        limit=POSITIVE,
        default=None,
    )
    mtf: float | None = parameter(
        "1, MTF at Nyquist, the lower of both axes", limit=POSITIVE, default=None
    )
    saturation: float | None = parameter(
        "watt / m^2 / sr / m, largest measurable radiance",
        unit=Unit("W / (m2 sr m)", "W / (m2 sr um)"),
        limit=POSITIVE,
        default=None,
    )
    gsd: float | None = parameter(
        "metre between columns; the distance between lines has no limit",
        unit=Unit("m"),
        limit=POSITIVE,
        default=None,
    )


PACE = 0.5  # pixel; chosen by hand
COMPARED = (
    "light, required and measured performance; `startrack requirements` prints them beside the "
    "prediction"
)


class Passband(Parameters):
    """A filter with two edges, a trapezium over wavelength; a search may move the edges."""

    low: float = parameter("wavelength at half transmission", unit=Unit("m", "um"), limit=POSITIVE)
    high: float = parameter("likewise, above it", unit=Unit("m", "um"), limit=POSITIVE)
    flank: float = parameter(
        "width of each edge, from no to full transmission",
        unit=Unit("m", "um"),
        limit=POSITIVE,
        default=10 * nm,
    )
    transmittance: float = parameter("1, between the edges", limit=Range(0.001, 1), default=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.high - self.low < self.flank:
            raise core.Refused(
                f"high must be above low by the flank, {self.flank / nm:g} nm, or more, got "
                f"{self.low / nm:g} and {self.high / nm:g} nm"
            )

    @property
    def curve(self) -> core.Curve:
        """Transmittance over wavelength."""
        half, full = self.flank / 2, self.transmittance
        edges = self.low - half, self.low + half, self.high - half, self.high + half
        return core.Curve(edges, (0.0, full, full, 0.0))


@printed
class Channel(Parameters):
    """One image of a camera: a lens, a filter, a detector.

    Effects that its images do not simulate are refused: coefficients of distortion, an offset
    principal point, row delay, residual charge and crosstalk. `lens_file`, `lens_family` or
    `psf_file` give distortion, lateral colour, vignetting and images over the field.
    """

    name: str
    optics: Optics
    detector: Detector
    band: core.Curve = parameter("transmittance of the filter, 1 over wavelength", default=core.ALL)
    passband: Passband | None = parameter("edges of the filter, in place of `band`", default=None)
    forwards: float = parameter(
        "angle ahead of the camera's axis; different for stereo lines. With a lens table, the "
        "line lies at this angle in the focal plane of a common lens; otherwise each line has a "
        "lens",
        unit=Unit("rad", "deg"),
        limit=FINITE,
        default=0.0,
    )
    period: Annotated[float, Unit("s", "ms")] | None = parameter(
        "time from line to line; None: square pixels below, exposed all the time",
        limit=POSITIVE,
        default=None,
    )
    response: core.Curve | None = parameter(
        "measured spectral response of the channel to radiance, over its peak; None: product of "
        "band, transmission and quantum efficiency. A response replaces `band`; transmission and "
        "quantum efficiency then hold at its mean wavelength",
        default=None,
    )
    average: int = parameter(
        "number of columns that the ground segment averages; affects the figures of the channel, "
        "not its images",
        limit=Range(1, 64),
        default=1,
    )
    restore: float | None = parameter(
        "design signal-to-noise ratio of the ground segment's Wiener filter, which raises the "
        "modulation of images; affects products and figures: MTF after the filter, SNR with "
        "amplified noise; None: no filter",
        limit=POSITIVE,
        default=None,
    )
    reference: Reference | None = parameter(COMPARED, default=None)
    required: Performance = parameter(COMPARED, default_factory=Performance)
    measured: Performance = parameter(COMPARED, default_factory=Performance)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.response is not None:
            if self.band != core.ALL or self.passband:
                raise ValueError("band and passband must be left out if response is given")
            if not (self.response.wavelength and any(self.response.value)):
                raise ValueError("response must have wavelengths, and values above 0")
        if self.passband and self.band != core.ALL:
            raise core.Refused("band must be left out if passband is given")
        if self.detector.mosaic:
            raise core.Refused("detector.mosaic must be left out: a channel has one band")
        if self.detector.scan and self.detector.scan.kind == "lines":
            raise ValueError("detector.scan.kind must be line, staggered or tdi, got lines")
        if self.restore is not None:
            self._refuse_what_is_not_restored()
        if not self.name or "/" in self.name:
            raise ValueError(f"name must be a name for a file, got {self.name!r}")
        if not self.optics.lens_colour:
            raise ValueError(
                "optics.lens_colour must be left out: the band of a channel gives its colour"
            )
        for part, names in UNKNOWN.items():
            for name in names:
                if value := getattr(getattr(self, part), name):
                    raise ValueError(
                        f"{part}.{name} must be left out: images of a channel do not simulate "
                        f"it, got {value}"
                    )

    def _refuse_what_is_not_restored(self) -> None:
        if self.optics.tabulated:
            raise Refused(
                f"channel {self.name}: lens_file, lens_family and psf_file must be left out where "
                "an image is restored"
            )
        if self.average > 1:
            raise Refused(
                f"channel {self.name}: average must be 1 where an image is restored, got "
                f"{self.average}"
            )

    def photoelectrons(self, wavelength: Floats) -> Floats:
        """Electrons per joule at the lens, (f,): the brackets of equation (4), tau and QE."""
        if self.response is not None:
            ends = np.array(self.response.wavelength)[[0, -1]]
            place, weight, _ = core.quadrature(ends, self.curves)
            relative = weight * self.response(place)
            mean = np.array([relative @ place / relative.sum()])
            return float(self._flat(mean)[0]) * self.response(wavelength)
        return self.filter(wavelength) * self._flat(wavelength)

    @property
    def filter(self) -> core.Curve:
        """Transmittance of the filter, from `band` or `passband`."""
        return self.passband.curve if self.passband else self.band

    @property
    def curves(self) -> tuple[core.Curve, ...]:
        """Curves over wavelength whose product is `photoelectrons`."""
        if self.response is not None:
            return (self.response,)
        return self.filter, self.optics.transmission, self.detector.quantum_efficiency

    def _flat(self, wavelength: Floats) -> Floats:
        """The curves without the filter."""
        passed = self.optics.transmission(wavelength)
        efficiency = self.detector.quantum_efficiency(wavelength) * self.detector.fill_factor
        return wavelength / (core.PLANCK * core.LIGHT_SPEED) * passed * efficiency

    def etendue(self) -> float:
        """Etendue of a pixel, square metre steradian: (pi / 4) A_d / f#^2, with the pupil's
        shape."""
        return self.optics.area * (self.detector.pitch / self.optics.image_distance) ** 2

    @property
    def kind(self) -> str:
        """matrix, line, staggered or tdi."""
        return self.detector.scan.kind if self.detector.scan else "matrix"

    @property
    def stages(self) -> int:
        """Number of exposures that a pixel of the image sums."""
        scan = self.detector.scan
        return scan.stages if scan and scan.kind == "tdi" else 1

    def exposure_of_line(self, period: float) -> float:
        """Exposure of one line or stage in second, from the time between lines, which is 0 for a
        matrix."""
        exposure = self.detector.exposure
        return min(exposure, period) if period else exposure

    @property
    def columns(self) -> int:
        """Columns of the image."""
        return self.detector.columns * (2 if self.kind == "staggered" else 1)

    def sensor(self, rays: int, rate: float, pitch: float = 0.0) -> geometry.Sensor:
        """The channel for the geometry. A channel that looks ahead is taken earlier, to see the
        same ground.

        rate   radian / second of the ground below
        pitch  radian, pitch of the camera's axis, forwards positive
        """
        detector, stages = self.detector, self.stages
        late = (math.tan(pitch) - math.tan(pitch + self.forwards)) / rate
        if detector.scan and self.kind != "tdi":
            stages = max(round(detector.scan.distance), 1)
        return geometry.Sensor(
            self.kind,
            self.columns,
            detector.rows,
            self.optics.image_distance,
            detector.pitch,
            self.period,
            stages,
            rays,
            late,
        )

    def shifted(self, by: float) -> Channel:
        """The channel with filter or response shifted to longer wavelengths; the shift is in
        metre."""
        if edges := self.passband:
            moved = replace(edges, low=edges.low + by, high=edges.high + by)
            return replace(self, passband=moved)
        key = "band" if self.response is None else "response"
        curve = getattr(self, key)
        nodes = tuple(node + by for node in curve.wavelength)
        return replace(self, **{key: replace(curve, wavelength=nodes)})

    def cropped(self, columns: int | None, lines: int | None) -> Channel:
        """The channel with only the middle columns and lines of its image."""
        detector = self.detector
        wide = detector.columns
        if columns is not None:
            wide = min(wide, max(columns // (2 if self.kind == "staggered" else 1), 2))
        kept = replace(detector, columns=wide, rows=lines or detector.rows)
        return replace(self, detector=kept)


class Spectrometer(Parameters):
    """Smile and keystone of an imaging spectrometer, whose channels are bands of one spectrum.

        lambda(x) = lambda + smile (x / X)^2
        x' = x + keystone (x / X) (lambda - lambda_m) / Lambda

    X is half the line of the detector; lambda_m and Lambda are the middle and half the range of the
    channels' mean wavelengths.
    """

    smile: float = parameter(
        "smile: wavelength of a channel at the ends of its line minus wavelength in the middle; "
        "the image of a spectral line bends",
        unit=Unit("m", "nm"),
        limit=Range(-1e-7, 1e-7),
        default=0.0,
    )
    keystone: float = parameter(
        "keystone on the detector: outward displacement, at the ends of the line, of the longest "
        "wavelength's image relative to the middle of the spectrum; the spectrum of a point is "
        "oblique",
        unit=Unit("m", "um"),
        limit=Range(-1e-3, 1e-3),
        default=0.0,
    )


@printed
class Imager(Parameters):
    """A camera with one or more channels that images extended scenes."""

    channels: tuple[Channel, ...]
    spectrometer: Spectrometer | None = parameter(
        "smile and keystone, for channels that are lines of one spectrum", default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [channel.name for channel in self.channels]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"channels must be one or more with different names, got {names}")
        if self.spectrometer:
            self._refuse_other_than_spectra(self.spectrometer)

    def _refuse_other_than_spectra(self, spectrometer: Spectrometer) -> None:
        if spectrometer.keystone and len(self.channels) < 2:
            raise ValueError("spectrometer.keystone must be left out of a camera with one channel")
        for channel in self.channels:
            if channel.kind == "matrix":
                raise ValueError(
                    f"spectrometer must be left out: channel {channel.name} is not a line"
                )
            if spectrometer.smile and channel.response is None and not channel.filter.wavelength:
                raise ValueError(
                    f"channel {channel.name} must have band or response where spectrometer.smile "
                    "moves it"
                )


class Knowledge(Parameters):
    """Standard deviations of the inputs that a product assumes to be known; the defaults are
    assumed."""

    lamp: float = parameter(
        "1, relative, radiance of the calibration", limit=NON_NEGATIVE, default=0.02
    )
    straylight: float = parameter(
        "1, stray light over the mean radiance of the image", limit=NON_NEGATIVE, default=0.003
    )
    wavelength: float = parameter(
        "wavelength of the channel's response",
        unit=Unit("m", "nm"),
        limit=NON_NEGATIVE,
        default=0.5 * nm,
    )
    visibility: float = parameter(
        "1, relative, visibility of the air", limit=NON_NEGATIVE, default=0.1
    )
    slope: float = parameter(
        "slope of the terrain, along each axis",
        unit=Unit("rad", "deg"),
        limit=NON_NEGATIVE,
        default=0.01,
    )
    height: float = parameter(
        "height of the terrain", unit=Unit("m"), limit=NON_NEGATIVE, default=5.0
    )
    registration: float = parameter(
        "pixel, registration along each axis", limit=NON_NEGATIVE, default=0.3
    )
    beyond: float = parameter(
        "1, mean reflectance around the image, which is assumed to equal the image's",
        limit=NON_NEGATIVE,
        default=0.03,
    )


OF_IMAGE = "columns of the image; None: all columns of the detector"


@printed
class Survey(Parameters):
    """An image to be rendered: camera, carrier, terrain, air and land."""

    camera: Imager = parameter("its channels")
    terrain: geometry.Terrain
    orbit: Orbit | None = None
    tle: tuple[str, ...] = ()
    aircraft: geometry.Aircraft | None = None
    pointing: geometry.Pointing = field(default_factory=geometry.Pointing)
    lines: int | None = parameter(OF_IMAGE, limit=Range(2, 2**16), default=None)
    columns: int | None = parameter(OF_IMAGE, limit=Range(2, 2**16), default=None)
    rays: int = parameter("rays along each side of a pixel", limit=Range(1, 16), default=2)
    sky_rays: int = parameter(
        "rays from each point that sample the sky; 0: none", limit=Range(0, 2**12), default=0
    )
    air: Air | None = parameter(
        "state of the air, for a shipped table, or a user's table; None: no air", default=None
    )
    land: Land = parameter("reflectance and temperature of the ground", default_factory=Land)
    clouds: tuple[CloudLayer, ...] = parameter("cloud layers; they cast shadows", default=())
    surroundings: float | None = parameter(
        "1, reflectance of the surrounding ground, which illuminates air and slopes; None: mean "
        "of the image",
        limit=Range(0, 1),
        default=None,
    )
    sun_distance: float | None = parameter(
        "astronomical unit; None: 1, or the distance on `orbit.day` if given",
        limit=POSITIVE,
        default=None,
    )
    knowledge: Knowledge = parameter(
        "uncertainties of the inputs that a product assumes", default_factory=Knowledge
    )
    motion: Motion = parameter(
        "drift and jitter of the camera, common to all channels; channels that see the ground at "
        "different times are misregistered. Time is zero at the epoch",
        default_factory=Motion,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.carrier

    @property
    def carrier(self) -> geometry.Carrier:
        """Orbit, two-line elements or aircraft."""
        return geometry.choose_carrier(self.orbit, self.tle, self.aircraft)

    @property
    def distance_to_sun(self) -> float:
        """Distance to the Sun, astronomical unit: `sun_distance`, or the distance on the day."""
        if self.sun_distance is not None:
            return self.sun_distance
        if self.orbit is None or self.orbit.day is None:
            return 1.0
        return space.distance_to_sun(self.orbit.resolved().epoch)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of the camera, cropped to the size of the image."""
        return tuple(channel.cropped(self.columns, self.lines) for channel in self.camera.channels)

    def whole(self, channel: Channel) -> Channel:
        """A channel of `channels` with all columns of its detector."""
        return next(own for own in self.camera.channels if own.name == channel.name)

    def scene(self, channel: Channel) -> geometry.EarthScene:
        """The geometry of one channel's image; its camera is `nominal` or `field_lens`."""
        ahead = 0.0 if channel.optics.tabulated else channel.forwards
        turned = replace(self.pointing, pitch=self.pointing.pitch + ahead)
        rate = geometry.ground_rate(self.carrier)
        return geometry.EarthScene(
            self.terrain,
            channel.sensor(self.rays, rate, self.pointing.pitch),
            self.orbit,
            self.tle,
            self.aircraft,
            turned,
            self.sky_rays,
        )


def smear(channel: Channel, period: float, rate: float) -> float:
    """Motion of the ground along the track in an exposure of one line or frame, pixel.

    period  second from line to line, 0 for a matrix
    rate    radian / second of the ground below
    """
    time = channel.exposure_of_line(period)
    return rate * time * channel.optics.image_distance / channel.detector.pitch


def stage_drift(channel: Channel, period: float, rate: float) -> float:
    """Lead of the ground over the charge of a TDI detector per stage, pixel.

    It is 0 for other detectors. Arguments as for `smear`.
    """
    if channel.kind != "tdi" or channel.period is None:
        return 0.0
    return rate * period * channel.optics.image_distance / channel.detector.pitch - 1


def require_pace(channel: Channel, period: float, rate: float) -> None:
    """Refuse a TDI detector whose charge deviates from the ground by more than half a pixel."""
    if abs(ahead := stage_drift(channel, period, rate)) * (channel.stages - 1) > PACE:
        raise Refused(
            f"channel {channel.name}: period must keep {channel.stages} stages within {PACE:g} "
            f"pixel of the ground where a retrieval is studied, {period / (1 + ahead):.4g} s for "
            f"all, got {period:.4g} s"
        )


def exposure_of(channel: Channel, period: float) -> float:
    """Exposure of a pixel of the image, second: the sum over stages."""
    return channel.exposure_of_line(period if channel.detector.scan else 0.0) * channel.stages


def load_survey(path: Path) -> Survey:
    """Read a scene file; `camera = "hsrs"` is the camera of the catalogue.

    A reflectance or weight of a cover may be in a file of a spectral library:
    `reflectance = { file = "grass.csv", unit = "um", factor = 0.01 }`.

    Raises  ValueError with the file, the key, the rule and the value.
    """
    return scene_of(Survey, Path(path), without=OF_STUDY)


S = TypeVar("S", bound=Survey)
OF_STUDY = "retrieval", "campaign"  # tables of a scene file for its study alone
CHANNELS = "camera.channels"
# keys whose values are names of files relative to the scene file
RASTERS = "terrain.files", "terrain.geoid", "terrain.maps.file", "clouds.file"


def scene_of(kind: type[S], path: Path, without: Sequence[str] = ()) -> S:
    """A survey, or a class with further tables, from a scene file.

    without  tables of the file to skip
    Raises   ValueError as `load_survey`.
    """
    layers = read_layers(path, "a scene file", (), scene_rules(path.parent))
    table = {key: value for key, value in layers.table.items() if key not in without}
    if "camera" not in table and "sensor" in table:
        raise Refused(f"{path} must name a camera; with a sensor it is for `earth geometry` alone")
    try:
        return from_table(kind, table)
    except ValueError as error:
        raise Refused(layers.blamed(str(error), path)) from None


def scene_rules(folder: Path) -> LayerRules:
    """Rules for combining a scene file with its base files.

    A camera replaces that of lower files; `[camera.channels.mir]` changes one of its channels.

    folder  of the outermost file
    """

    def resolved(table: dict[str, Any], path: Path) -> dict[str, Any]:
        try:
            return _resolved(table, path, folder)
        except ValueError as error:
            raise Refused(f"{path}: {error}") from None

    whole = {"camera": Renewed("channels", ())}
    return LayerRules(renewed=whole, named=(CHANNELS,), resolved=resolved)


def _resolved(table: dict[str, Any], path: Path, folder: Path) -> dict[str, Any]:
    """The table of a scene file with the contents of the files that it names.

    Names of rasters become relative to the folder of the outermost file.
    """
    camera, air = table.get("camera"), table.get("air")
    if isinstance(camera, str):
        table["camera"] = _camera(camera, path.parent, "camera.")
    elif isinstance(camera, dict):
        table["camera"] = _unshared(camera, "camera.")
    _read_spectra(table.get("land"), path.parent, "land")
    if isinstance(air, dict) and isinstance(air.get("table"), str) and air["table"]:
        table["air"] = {**air, "table": str(path.parent / air["table"])}
    if path.parent != folder:
        for place in RASTERS:
            _move(table, place.split("."), path.parent)
    return table


def _move(value: Any, keys: Sequence[str], folder: Path) -> None:
    """Turn names of files into paths from a folder."""
    for entry in value if isinstance(value, list) else [value]:
        if not isinstance(entry, dict) or keys[0] not in entry:
            continue
        inner = entry[keys[0]]
        if len(keys) > 1:
            _move(inner, keys[1:], folder)
        elif isinstance(inner, str) and inner:
            entry[keys[0]] = str(folder / inner)
        elif isinstance(inner, list):
            entry[keys[0]] = [str(folder / str(name)) for name in inner]


def _read_spectra(table: Any, folder: Path, place: str) -> None:
    """Replace curves that name a file by the values in it."""
    for n, entry in enumerate(table if isinstance(table, list) else ()):
        _read_spectra(entry, folder, f"{place}[{n}]")
    for key, value in (table if isinstance(table, dict) else {}).items():
        if isinstance(value, dict) and "file" in value:
            table[key] = from_table(SpectrumFile, value, f"{place}.{key}").read(folder)
        else:
            _read_spectra(value, folder, f"{place}.{key}")


def load_imager(name: str, folder: Path = Path()) -> Imager:
    """A camera of the catalogue by name, or from a file in a folder.

    Raises  ValueError as `load_survey`.
    """
    return from_table(Imager, _camera(name, folder))


def cameras() -> tuple[str, ...]:
    """The Earth cameras of the catalogue."""
    files = shipped("cameras").glob("*.toml")
    return tuple(
        sorted(path.stem for path in files if "channels" in read_table(path, "a camera file"))
    )


def _camera(name: str, folder: Path, place: str = "") -> dict[str, Any]:
    if name in cameras():
        return _unshared(read_table(shipped(f"cameras/{name}.toml"), "a camera file"), place)
    if name.endswith(".toml"):
        return _unshared(read_table(folder / name, "a camera file"), place)
    raise ValueError(f"camera must be one of {', '.join(cameras())} or a TOML file, got {name!r}")


def _unshared(table: dict[str, Any], place: str) -> dict[str, Any]:
    """A camera's table, with the keys of `shared` added to all channels that do not set them.

    place  place of the table in its file, with a dot: "camera."
    """
    shared, channels = table.get("shared", {}), table.get("channels")
    if not isinstance(channels, list):
        return table
    if not isinstance(shared, dict):
        raise ValueError(f"shared must be a table, got {core.shown(shared)}")
    own = list[Any]()
    for n, channel in enumerate(channels):
        layers = Layers()
        layers.lay(shared, "")
        if isinstance(channel, dict):
            layers.lay(channel, "")
            channel = with_plain_optics(layers.table, Channel, f"{place}channels[{n}]")
        own.append(channel)
    return {**{key: value for key, value in table.items() if key != "shared"}, "channels": own}
