"""Optics: focal length, aperture, aberrations, blur, transmission, choice of the PSF."""

import math
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, ClassVar

from startrack import core
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Parameters,
    Range,
    Refused,
    Unit,
    deg,
    parameter,
)
from startrack.io import from_table
from startrack.optics.lens_table import WIDEST
from startrack.optics.psf_file import open_psf_file
from startrack.optics.pupil import Aberration, Pupil

# From the cheapest to the most exact.
MODELS = ("gaussian", "airy", "fraunhofer", "fresnel", "kirchhoff")
STEEPEST_F = 0.6  # the limit of an aplanatic lens is f/0.5, a whole hemisphere
MEAN_SLOPE = 30.0  # mean squared slope per axis of three equal aberrations with a total rms of 1

LENSES = ("aplanatic", "perfect", "parabolic")
COEFFICIENT = "OpenCV's distortion coefficients"
PRINCIPAL_POINT = "pixel from the centre of the detector to the principal point"
DIAMETER = Unit("m", "mm")
GROWTH = Range(-0.9, 10)


class Optics(Parameters):
    """A lens."""

    # Numbers that are not fields but may be replaced: their unit, and the fields that they set.
    DERIVED: ClassVar[Mapping[str, tuple[Unit, Callable[[Any, float], Mapping[str, float]]]]] = {
        "aperture": (DIAMETER, lambda optics, size: {"f_number": optics.focal_length / size})
    }

    focal_length: float = parameter(
        "effective focal length, for an object at infinity", unit=Unit("m", "mm"), limit=POSITIVE
    )
    f_number: float = parameter(
        "focal length over the diameter of the clear aperture", limit=Range(0.3, 200)
    )
    blur: float = parameter(
        "sigma of the Gaussian that manufacture adds to diffraction, on the detector. Pixels and "
        "angles are converted to a length by the pitch and the image distance of the file; the "
        "length stays if a campaign changes these. Its bounds and variations are lengths",
        unit=Unit("m", "um", others=("pixel", "arcsec")),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    psf: str = parameter(
        '"gaussian": one Gaussian, the core of the Airy pattern; "airy": diffraction of a clear '
        'circular pupil in closed form; "fraunhofer": of any pupil with aberrations; "fresnel": '
        'with the scale of a plane out of focus; "kirchhoff": with inclined rays and the phase '
        'of the lens; "auto": the cheapest of these within psf_tolerance; or user code, '
        "see docs/extensions.md",
        limit=Range(choices=(*MODELS, "auto"), code="psfs"),
        default="auto",
    )
    psf_tolerance: float = parameter(
        "largest error of the chosen model, as a fraction of the PSF's peak; from 0.05 on "
        "images of a lens table have fewer wavelengths, in half of the time",
        limit=Range(1e-6, 1),
        default=0.01,
    )
    lens: str = parameter(
        '"aplanatic": corrected for spherical aberration and coma, as real lenses are; '
        '"perfect": one thin plane that makes a spherical wave; "parabolic": one thin plane '
        "with the phase of a parabola, as in Krutz et al. The last two differ from the first in "
        'the model "kirchhoff" only',
        limit=Range(choices=LENSES),
        default="aplanatic",
    )
    object_distance: float | None = parameter(
        "from the lens; None: at infinity. The detector is at the image",
        unit=Unit("m"),
        limit=POSITIVE,
        default=None,
    )
    defocus: float = parameter(
        "distance of the detector behind the image", unit=Unit("m", "um"), limit=FINITE, default=0.0
    )
    pupil: Pupil = parameter("the shape of the aperture", default_factory=Pupil)
    aberrations: tuple[Aberration, ...] = parameter("wavefront errors", default=())
    field_edge: float = parameter(
        "field angle at which growing aberrations have their rms",
        unit=Unit("rad", "deg"),
        limit=POSITIVE,
        default=10 * deg,
    )
    seeing: float = parameter(
        "sigma of the Gaussian blur of an atmosphere per axis; 0: none",
        unit=Unit("rad", "arcsec"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    transmission: core.Curve = parameter(
        "fraction of the light that the lens passes, over wavelength", default=core.ALL
    )
    lens_file: str = parameter(
        'a lens table: a shipped one by its name, or the path of a FITS file; "": none. The '
        "table is scaled to `focal_length` and stopped down to `f_number`; it gives the "
        "distortion, and `aberrations` and `blur` add to it",
        limit=core.FILE,
        default="",
    )
    lens_family: str = parameter(
        '"double-gauss", "petzval", "cooke-triplet" or "catadioptric": the lens table of that '
        'family\'s lens with `focal_length` and `f_number`; "": none',
        default="",
    )
    family_field: float | None = parameter(
        "half field for which a lens of a family is made; None: field of the published lens",
        unit=Unit("rad", "deg"),
        limit=Range(0.001, WIDEST),
        default=None,
    )
    psf_file: str = parameter(
        "images of a point, measured or exported: the path of a FITS file (`startrack lens "
        'measure` and `import` write them), or a shipped one by its name; "": none. `blur`, '
        "`seeing` and `as_built` add to it; f-number and pupil determine the amount of light",
        limit=core.FILE,
        default="",
    )
    growth_along: float = parameter(
        "relative growth along the field of the single image of a `psf_file`, from the axis to "
        "`field_edge`. It is proportional to the square of the field angle, as for images out of "
        "focus by field curvature and astigmatism. Only `compare-flight` uses it, at the place of "
        "each star; elsewhere all stars have the image on the axis",
        limit=GROWTH,
        default=0.0,
    )
    growth_across: float = parameter(
        "relative growth across the field, likewise", limit=GROWTH, default=0.0
    )
    as_built: float = parameter(
        "rms wavefront error of manufacture and alignment, which blurs by its mean slope: see "
        "`total_blur`",
        unit=Unit("m", "nm"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    lens_field: bool = parameter(
        "whether the image varies over the field; false: all stars have the mean image of the "
        "lens table, and the distortion for sunlike stars",
        default=True,
    )
    lens_colour: bool = parameter(
        "whether the image varies with the star's colour; false: all stars are sunlike",
        default=True,
    )
    principal_x: float = parameter(PRINCIPAL_POINT, default=0.0)
    principal_y: float = parameter(PRINCIPAL_POINT, default=0.0)
    k1: float = parameter(COEFFICIENT, default=0.0)
    k2: float = parameter(COEFFICIENT, default=0.0)
    p1: float = parameter(COEFFICIENT, default=0.0)
    p2: float = parameter(COEFFICIENT, default=0.0)
    k3: float = parameter(COEFFICIENT, default=0.0)
    polynomial: core.FieldPolynomial | None = parameter(
        "additional distortion over the field, as `calibrate` fits it to a table of stars",
        default=None,
    )

    _files: tuple[core.FileState, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        self._refuse_places()
        self._refuse_models()
        if self.psf_file:
            self._refuse_beside_file()
        if self.grows and not (self.psf_file and not open_psf_file(self.psf_file).varies):
            raise Refused(
                "growth_along and growth_across must be left out without a psf_file of one image"
            )
        if self.traced:
            self._refuse_beside_table()
        elif not (self.lens_field and self.lens_colour) and not self.tabulated:
            raise Refused("lens_field and lens_colour must be left out without a lens table")

    def _refuse_beside_file(self) -> None:
        psf_file = open_psf_file(self.psf_file)
        beside = {
            "lens_file": bool(self.lens_file),
            "lens_family": bool(self.lens_family),
            "psf": self.psf != "auto",
            "lens": self.lens != "aplanatic",
            "defocus": self.defocus != 0,
            "aberrations": bool(self.aberrations),
            "k1, k2, p1, p2 and k3": psf_file.place is not None
            and any((self.k1, self.k2, self.p1, self.p2, self.k3)),
        }
        _refuse_first(beside, "psf_file, whose images say it")

    def _refuse_beside_table(self) -> None:
        beside = {
            "psf": self.psf not in ("auto", "fraunhofer"),
            "lens": self.lens != "aplanatic",
            "pupil": not self.pupil.clear,
            "object_distance": self.object_distance is not None,
            "k1, k2, p1, p2 and k3": any((self.k1, self.k2, self.p1, self.p2, self.k3)),
            "polynomial": self.polynomial is not None,
        }
        if self.lens_file and self.lens_family:
            raise Refused("lens_family must be left out if lens_file, a single lens, is given")
        key = "lens_file" if self.lens_file else "lens_family"
        _refuse_first(beside, f"{key}, whose table says it")

    def _refuse_places(self) -> None:
        distance = self.object_distance
        if distance is not None and distance <= self.focal_length * (1 + 1e-9):
            raise Refused(
                "object_distance must be beyond the focal length, where a real image forms, "
                f"got {distance:g} m at a focal length of {self.focal_length:g} m"
            )
        if abs(self.defocus) > self.image_distance / 10:
            raise Refused(
                f"defocus must be at most a tenth of the image distance {self.image_distance:g} m, "
                f"got {self.defocus:g} m"
            )

    def _refuse_models(self) -> None:
        if self.psf in ("gaussian", "airy") and not self.plain:
            raise Refused(
                f"psf must be auto, fraunhofer, fresnel or kirchhoff if the pupil is not clear "
                f"or the wavefront not plane, got {self.psf!r}"
            )
        exact = self.psf in ("auto", "kirchhoff")
        if exact and self.lens == "aplanatic" and self.working_f_number < STEEPEST_F:
            raise Refused(
                f"f_number must be at least {STEEPEST_F:g} at the image for an aplanatic lens in "
                "the models kirchhoff and auto, whose outer rays would miss the detector, got "
                f"{self.working_f_number:g}"
            )
        if exact and self.lens != "aplanatic" and not self.pupil.clear:
            raise Refused(
                f"lens must be aplanatic if the pupil is not a clear circle, got {self.lens!r}"
            )

    @property
    def traced(self) -> bool:
        """Whether a lens table gives the images: of `lens_file` or of `lens_family`."""
        return bool(self.lens_file or self.lens_family)

    @property
    def tabulated(self) -> bool:
        """Whether images vary over the field or with colour."""
        return self.traced or bool(self.psf_file and open_psf_file(self.psf_file).varies)

    @property
    def grows(self) -> bool:
        """Whether the one image of a `psf_file` changes its size over the field."""
        return bool(self.growth_along or self.growth_across)

    @property
    def plain(self) -> bool:
        """Whether the pupil is a clear circle, in focus and without aberrations."""
        return self.pupil.clear and not self.aberrations and self.defocus == 0

    @property
    def aperture(self) -> float:
        """Diameter of the clear aperture, metre."""
        return self.focal_length / self.f_number

    @property
    def area(self) -> float:
        """Open area of the aperture, square metre."""
        return math.pi / 4 * self.aperture**2 * self.pupil.fraction

    @property
    def image_distance(self) -> float:
        """Metre from the lens to the image: 1 / b = 1 / f - 1 / g."""
        if self.object_distance is None:
            return self.focal_length
        return 1 / (1 / self.focal_length - 1 / self.object_distance)

    @property
    def working_f_number(self) -> float:
        """Image distance over the diameter of the aperture."""
        return self.image_distance / self.aperture

    @property
    def total_blur(self) -> float:
        """Metre, sigma of the blur of lens and atmosphere together.

        A wavefront error of rms W over the pupil moves rays by 2 N times its slope over the radius.
        Equal parts of astigmatism, coma and spherical aberration have a variance of the slope of
        (12 + 48 + 120) / 3 W^2 in both directions together: a blur of 2 N sqrt(30) W.
        """
        blur = math.hypot(self.blur, self.seeing * self.image_distance)
        if not self.as_built:
            return blur
        return math.hypot(blur, 2 * self.working_f_number * math.sqrt(MEAN_SLOPE) * self.as_built)


def _refuse_first(there: dict[str, bool], beside: str) -> None:
    for name in (key for key, given in there.items() if given):
        raise Refused(f"{name} must be left out if {beside} is given")


def with_plain_optics(table: Mapping[str, Any], kind: type, place: str) -> Mapping[str, Any]:
    """A table with `optics` and `detector` whose optics have an f-number and a blur in metre.

    kind    class of the table, with `optics` and `detector`
    Raises  Refused, with its place, for both an aperture and an f-number, for an aperture that
            is not a length, and for a blur that is neither a length, pixels nor an angle.
    """
    return _with_blur_as_length(_with_f_number(table, f"{place}.optics"), kind, place)


def _with_f_number(table: Mapping[str, Any], place: str) -> Mapping[str, Any]:
    """Replace the aperture of a table by the f-number: the focal length over it."""
    match table:
        case {"optics": {"aperture": aperture} as optics}:
            pass
        case _:
            return table
    if "f_number" in optics:
        raise Refused(
            f"{place}.aperture must be left out if f_number is given, got "
            f"{core.shown(aperture)} and {core.shown(optics['f_number'])}"
        )
    if "focal_length" not in optics:
        raise Refused(f"{place}.focal_length is missing")
    size = _length(aperture, f"{place}.aperture")
    f_number = _length(optics["focal_length"], f"{place}.focal_length") / size
    rest = {key: value for key, value in optics.items() if key != "aperture"}
    return {**table, "optics": {**rest, "f_number": f_number}}


def _length(value: object, name: str) -> float:
    """A length, metre. Raises Refused if it is not a length above zero."""
    example = f"{name} must be a length, such as '25 mm'"
    if not isinstance(value, str):
        raise Refused(f"{example}, got {core.shown(value)}")
    try:
        length = core.parse(value, DIAMETER.si)
    except Refused as error:
        raise Refused(f"{example}: {error}") from None
    core.positive(**{name: length})
    return length


def _with_blur_as_length(table: Mapping[str, Any], kind: type, place: str) -> Mapping[str, Any]:
    """Replace a blur in pixel or as an angle in a table with `optics` and `detector`.

        blur = pixels pitch,  blur = angle image_distance

    pitch and image distance are those of this table. A campaign that changes them does not change
    the length.
    """
    match table:
        case {"optics": {"blur": str(blur)} as optics}:
            sharp = {**table, "optics": {key: optics[key] for key in optics if key != "blur"}}
        case _:
            return table
    for unit in ("m", "pixel", "rad"):
        try:
            number = core.parse(blur, unit)
            break
        except Refused:
            continue
    else:
        raise Refused(
            f"{place}.optics.blur must be a length, a number of pixels or an angle, such as "
            f"'5 um', '1.2 pixel' or '20 arcsec', got {core.shown(blur)}"
        )
    if unit == "m":
        return table
    try:
        camera: Any = from_table(kind, sharp, place)
    except Refused:
        return sharp  # errors are reported when all is read
    size = camera.detector.pitch if unit == "pixel" else camera.optics.image_distance
    return {**table, "optics": {**optics, "blur": f"{number * size!r} m"}}
