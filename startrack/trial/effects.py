"""Table of the effects of designs: which parts of startrack count, refuse or omit each.

`require_fidelity` refuses cases by this table. `startrack.budget` takes from it the causes of error
and the effects that it leaves out. Effects that make pixels depend on each other are rows of
`PIXEL_EFFECTS`.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from enum import StrEnum
from typing import Any, NamedTuple

from startrack.core import Refused, arcsec, is_code
from startrack.design import Case, replaced, replaced_all
from startrack.detector import PIXEL_EFFECTS, require_independent_pixels
from startrack.response import LENS_FIELD, dark_currents
from startrack.scene import LIGHTS

MOST_ROLL = 0.5  # pixel of smear in the corner, by rotation about the boresight; chosen by hand
SHARED = 0.3  # limit of the noise that a row or a column shares, over the noise of a pixel
HITS = "hits"
JITTER, JITTER_OF_HEAD = "jitter", "jitter of the head"
DSNU = "DSNU"
SHUTTER = "rolling shutter"
LENS_COLOUR = "lateral colour"
# Parameters that change the signal of a pixel, with the values that have no effect.
NONLINEAR = {
    "settling": 0.0,
    "impulse_response": (),
    "impulse_step": None,
    "lag": 0.0,
    "nonlinearity": 0.0,
    "adc_inl": 0.0,
}


class Term(StrEnum):
    """The classes of a star tracker's error by their names in ECSS-E-ST-60-20C, and other errors.

    The motion of the platform within an exposure is an error of the attitude that is reported for
    mid-exposure. But all heads share it, and it is not an error of the sensor.
    """

    BIAS = "bias"
    THERMO_ELASTIC = "thermo-elastic"
    FIELD = "FOV spatial"
    PIXEL = "pixel spatial"
    NOISE = "temporal noise"
    ABERRATION = "aberration"
    MEASUREMENT_DATE = "measurement date"
    PLATFORM = "platform motion"


# A text with fields such as "{case.instrument. ...}", or a function that makes it from the case.
Phrase = str | Callable[[Case], Iterable[str]]


class Effect(NamedTuple):
    """An effect that some designs have.

    key         key of the design
    present     function: whether a case has the effect
    cause       name of the effect as a cause of error; "": it is not a cause
    term        class of error to which the cause belongs
    without     function that returns the case without the effect; the sky and all other draws stay
                the same
    drawn       name of the effect in refusals by drawn spots and their covariance; "": they include
                it
    window      phrase: what the design must have instead for windows; "": they include it
    covariance  the same for the fidelity covariance alone
    left_out    phrases: effects that the error budget leaves out; none: it counts the effect
    """

    key: str
    present: Callable[[Case], Any]
    cause: str = ""
    term: Term = Term.NOISE
    without: Callable[[Case], Case] | None = None
    drawn: Phrase = ""
    window: Phrase = ""
    covariance: Phrase = ""
    left_out: Phrase = ""

    def says(self, column: str, case: Case) -> list[str]:
        """Phrases in a column of this row, for a case that has the effect."""
        phrase: Phrase = getattr(self, column)
        return list(phrase(case)) if callable(phrase) else [phrase.format(case=case)]


def _with_equal_pixels(case: Case) -> Case:
    """The case with equal pixels; losses of light and of charge transfer by ageing stay."""
    detector = case.instrument.detector
    mean, _ = dark_currents(detector)
    age = detector.age and detector.age.undamaged
    even = replace(detector, defects=None, dark_current=mean, age=age)
    mapless = case.tracker.detection.without_map
    return replaced_all(case, {"instrument.detector": even, "tracker.detection": mapless})


def _differing_dark(case: Case) -> bool:
    """Whether pixels have different dark signals, or a map of them is subtracted."""
    detector = case.instrument.detector
    damaged = detector.age and detector.age != detector.age.undamaged
    return bool(detector.defects or damaged or case.tracker.detection.dark_map)


def _calibrated(case: Case) -> Case:
    as_built = None if case.design is None else case.instrument.camera
    tracker = replace(case.tracker, camera=as_built, camera_model="radial", calibrated_at=None)
    return replace(case, tracker=tracker)


def _misbelieved(*names: str) -> Callable[[Case], bool]:
    """Function: whether the tracker's catalogue and the sky differ in these values."""
    return lambda case: any(
        getattr(case.catalog, name) != getattr(case.believed_catalog, name) for name in names
    )


def _believed_right(*names: str) -> Callable[[Case], Case]:
    """Function: the case whose tracker's catalogue has the values of the sky."""
    return lambda case: replaced(
        case,
        "tracker.catalog",
        replace(case.believed_catalog, **{name: getattr(case.catalog, name) for name in names}),
    )


def _aligned(case: Case) -> Case:
    as_built = None if case.design is None else case.instrument.mounting.still
    return replaced(case, "tracker.mounting", as_built)


def _without_thermal_swing(case: Case) -> Case:
    still = case.instrument.mounting.still
    believed = case.believed_mounting
    return replaced_all(case, {"instrument.mounting": still, "tracker.mounting": believed})


def _with_known_delay(case: Case) -> Case:
    as_built = None if case.design is None else case.instrument.delay
    return replace(case, tracker=replace(case.tracker, delay=as_built))


def _varying_lights(case: Case) -> list[str]:
    """The lights of a scene that vary over the field in some attitude."""
    kinds = {name: LIGHTS.get(name) for name in case.scene.lights}
    lights = [name for name, kind in kinds.items() if kind is None or kind.varies]
    if case.instrument.stray is None:
        return lights
    return lights + [name for name, kind in kinds.items() if kind and kind.stray > kind.varies]


def _unmodelled_air(case: Case) -> list[str]:
    """Effects of the air above a camera that no fidelity includes, with their size."""
    sky, half = case.scene.sky, case.instrument.camera.half_diagonal
    if sky is None:
        return []
    lift = sky.refraction()
    low, high = (sky.refraction(max(sky.elevation + side * half, 0.0)) for side in (-1, 1))
    return [
        f"refraction, {lift / arcsec:.2g} arcsec in the line of sight and {low / arcsec:.2g} to "
        f"{high / arcsec:.2g} over the field, the change of the sky over the field, clouds and "
        "scintillation (scene.sky)"
    ]


def _rolled(case: Case) -> bool:
    """Whether a rotation about the boresight smears stars in the corners."""
    instrument = case.instrument
    corner = math.tan(instrument.camera.half_diagonal) * instrument.camera.focal_length_px
    rolled = abs(instrument.motion.rate_z) * instrument.detector.exposure * corner
    return rolled > MOST_ROLL


def _shares_noise(case: Case) -> bool:
    """Whether rows or columns share much of the noise of a pixel."""
    detector = case.instrument.detector
    pattern = detector.pattern
    return pattern is not None and (
        math.hypot(pattern.row, pattern.column) > SHARED * detector.noise
    )


def _jitters(of: str) -> Callable[[Case], bool]:
    """Function: whether a case has jitter with a spectrum, of the platform or of the head."""

    def jitters(case: Case) -> bool:
        motion = case.instrument.motion
        return motion.jitter_of == of and motion.jitters and bool(motion.tones or motion.broadband)

    return jitters


def _sheared(case: Case) -> bool:
    """Whether rows have time differences that the tracker does not correct by known rates."""
    turn = case.instrument.detector.row_delay * case.instrument.motion.rates
    return bool((turn != case.believed_row_delay * case.believed_motion.rates).any())


# Rows with a cause are in the order of the causes, from the pixels to the spacecraft.
EFFECTS = [
    Effect(
        "instrument.detector.charge_effects, signal_effects, image_effects",
        lambda case: case.instrument.detector.effects_by_code,
        left_out=lambda case: [
            f"{effect} (not part of startrack)"
            for effect in case.instrument.detector.effects_by_code
        ],
    ),
    Effect(
        "instrument.motion.jitter",
        lambda case: case.instrument.motion.jitters and case.instrument.motion.jitter,
        left_out=lambda case: [
            f"jitter by {name} (motion.jitter)" for name in case.instrument.motion.jitter
        ],
    ),
    Effect(
        "tracker.attitude.method",
        lambda case: is_code(case.tracker.attitude.method),
        covariance="the attitude by least squares, so that tracker.attitude.method must not be "
        "{case.tracker.attitude.method}",
        left_out="the estimator {case.tracker.attitude.method}: least squares are assumed "
        "(tracker.attitude.method)",
    ),
    Effect(
        "tracker.detection.search",
        lambda case: case.tracker.detection.search != "filter",
        drawn="the search by {case.tracker.detection.search}",
        window="the search by a matched filter, so that tracker.detection.search must not be "
        "{case.tracker.detection.search}",
        left_out=lambda case: [
            f"the search by {name}: a matched filter is assumed (tracker.detection.search)"
            for name in [case.tracker.detection.search]
            if is_code(name)
        ],
    ),
    Effect(
        "tracker.rate",
        lambda case: case.tracker.rate == "images",
        drawn="a rate from the images",
        window="a rate that is known, so that tracker.rate must not be images",
        left_out="errors of a rate that is taken from the images (tracker.rate)",
    ),
    Effect(
        "instrument.motion.tones, broadband",
        _jitters("platform"),
        cause=JITTER,
        term=Term.PLATFORM,
        without=lambda case: replaced(case, "instrument.motion", case.instrument.motion.steady),
    ),
    Effect(
        "instrument.motion.tones, broadband",
        _jitters("head"),
        cause=JITTER_OF_HEAD,
        term=Term.NOISE,
        without=lambda case: replaced(case, "instrument.motion", case.instrument.motion.steady),
    ),
    Effect(
        "instrument.detector.hits",
        lambda case: case.instrument.detector.hits,
        cause=HITS,
        term=Term.NOISE,
        without=lambda case: replaced(case, "instrument.detector.hits", None),
        drawn="hits",
        left_out="cosmic rays (detector.hits)",
    ),
    Effect(
        "instrument.detector.prnu",
        lambda case: case.instrument.detector.prnu,
        cause="PRNU",
        term=Term.PIXEL,
        without=lambda case: replaced(case, "instrument.detector.prnu", 0.0),
    ),
    Effect(
        "instrument.detector.defects, age, tracker.detection.dark_map",
        _differing_dark,
        cause=DSNU,
        term=Term.PIXEL,
        without=_with_equal_pixels,
    ),
    Effect(
        f"instrument.detector.{', '.join(NONLINEAR)}",
        lambda case: any(getattr(case.instrument.detector, key) for key in NONLINEAR),
        cause="read-out",
        term=Term.PIXEL,
        without=lambda case: replaced_all(
            case, {f"instrument.detector.{key}": value for key, value in NONLINEAR.items()}
        ),
    ),
    Effect(
        "instrument.optics.lens_field",
        lambda case: case.instrument.optics.tabulated and case.instrument.optics.lens_field,
        cause=LENS_FIELD,
        term=Term.FIELD,
        without=lambda case: replaced(case, "instrument.optics.lens_field", False),
    ),
    Effect(
        "instrument.optics.lens_colour",
        lambda case: case.instrument.optics.tabulated and case.instrument.optics.lens_colour,
        cause=LENS_COLOUR,
        term=Term.FIELD,
        without=lambda case: replaced(case, "instrument.optics.lens_colour", False),
    ),
    Effect(
        "tracker.camera",
        lambda case: case.believed_camera != case.instrument.camera,
        cause="camera model",
        term=Term.FIELD,
        without=_calibrated,
    ),
    Effect(
        "tracker.catalog.proper_motion, epoch",
        _misbelieved("proper_motion", "epoch"),
        cause="proper motion",
        term=Term.FIELD,
        without=_believed_right("proper_motion", "epoch"),
    ),
    Effect(
        "tracker.catalog.parallax",
        _misbelieved("parallax"),
        cause="parallax",
        term=Term.FIELD,
        without=_believed_right("parallax"),
    ),
    Effect(
        "tracker.catalog.aberration, orbital_velocity",
        _misbelieved("aberration", "orbital_velocity"),
        cause="aberration",
        term=Term.ABERRATION,
        without=_believed_right("aberration", "orbital_velocity"),
    ),
    Effect(
        "instrument.mounting",
        lambda case: case.instrument.mounting.still != case.believed_mounting,
        cause="mounting",
        term=Term.BIAS,
        without=_aligned,
    ),
    Effect(
        "instrument.mounting.swing_x, swing_y, swing_z",
        lambda case: case.instrument.mounting.swings,
        cause="mounting swing",
        term=Term.THERMO_ELASTIC,
        without=_without_thermal_swing,
    ),
    Effect(
        "instrument.detector.row_delay",
        _sheared,
        cause=SHUTTER,
        term=Term.FIELD,
        without=lambda case: replaced_all(
            case, {"instrument.detector.row_delay": 0.0, "tracker.row_delay": 0.0}
        ),
    ),
    Effect(
        "instrument.detector.row_delay",
        lambda case: case.instrument.detector.row_delay and case.instrument.motion.jitters,
        drawn="jitter behind a rolling shutter (row_delay)",
    ),
    Effect(
        "instrument.detector.row_delay",
        lambda case: case.instrument.detector.row_delay and case.instrument.motion.rate,
        covariance="a detector without row_delay on a platform that turns",
    ),
    Effect(
        "tracker.delay",
        lambda case: case.time_tag_error and case.instrument.motion.rate,
        cause="time stamp",
        term=Term.MEASUREMENT_DATE,
        without=_with_known_delay,
    ),
    Effect(
        "instrument.detector.lag",
        lambda case: case.instrument.detector.lag and case.instrument.motion.rate,
        left_out="residual charge of the previous frame (detector.lag)",
    ),
    Effect(
        "instrument.detector.blooming",
        lambda case: case.instrument.detector.blooming,
        left_out="blooming (detector.blooming)",
    ),
    Effect(
        "instrument.detector.defects.dead, dead_columns",
        lambda case: (
            (defects := case.instrument.detector.defects) and (defects.dead or defects.dead_columns)
        ),
        drawn="dead pixels",
        left_out="dead pixels (detector.defects.dead, dead_columns)",
    ),
    Effect(
        "variation",
        lambda case: case.varying,
        left_out=lambda case: [
            f"what differs between units: {len(case.varying)} numbers of the design (variation)"
        ],
    ),
    Effect(
        "instrument.structure.focus",
        lambda case: (
            (structure := case.instrument.structure) and not structure.focus and case.varying
        ),
        left_out="change of the focus with temperature (instrument.structure.focus)",
    ),
    Effect(
        "instrument.residual",
        lambda case: case.instrument.residual and not case.instrument.residual.seed,
        left_out="displacements of {case.instrument.residual.rms:g} pixel in a unit "
        "(instrument.residual)",
    ),
    Effect(
        "tracker.acquisition",
        lambda case: case.tracker.acquisition == "box",
        drawn="acquisition in boxes",
        left_out="false spots in boxes when few boxes hold stars (tracker.box)",
    ),
    Effect(
        "instrument.detector.pattern",
        _shares_noise,
        left_out="noise that pixels of a row or column share (detector.pattern)",
    ),
    Effect(
        "instrument.ghosts",
        lambda case: case.instrument.ghosts,
        drawn="ghosts",
        window="an instrument without ghosts",
        left_out="ghosts of bright sources (instrument.ghosts)",
    ),
    Effect(
        "scene.lights",
        lambda case: case.scene.lights,
        drawn="lights of the scene",
        left_out=lambda case: [
            f"brighter and blinded sky by {', '.join(case.scene.lights)} (scene.lights)"
        ],
    ),
    Effect("scene.sky", lambda case: case.scene.sky, left_out=_unmodelled_air),
    Effect(
        "scene.lights",
        _varying_lights,
        window=lambda case: [
            "a sky whose light is uniform over the field, so that lights must be without "
            f"{', '.join(_varying_lights(case))}"
        ],
    ),
    Effect(
        "instrument.optics.aberrations",
        lambda case: (
            any(aberration.growth for aberration in case.instrument.optics.aberrations)
            and not case.instrument.optics.tabulated
        ),
        left_out="aberrations that grow over the field (optics.aberrations)",
    ),
    Effect(
        "instrument.optics.growth_along",
        lambda case: case.instrument.optics.grows,
        left_out="the size of images over the field (optics.growth_along, growth_across)",
    ),
    Effect(
        "instrument.optics.polynomial",
        lambda case: case.instrument.optics.polynomial,
        drawn="a polynomial of the optics",
    ),
    Effect("instrument.motion.rate_z", _rolled, drawn="a rate_z that smears stars in the corners"),
]


def present(column: str, case: Case) -> list[Effect]:
    """The effects of a case that have an entry in a column of the table."""
    return [effect for effect in EFFECTS if getattr(effect, column) and effect.present(case)]


def said(column: str, case: Case) -> list[str]:
    """Phrases in one column of the table, for all effects of a case."""
    return [phrase for effect in present(column, case) for phrase in effect.says(column, case)]


def left_out(case: Case) -> list[str]:
    """Effects of a design that the error budget leaves out, by this table; a phrase each."""
    of_pixels = [
        f"{effect.left_out} (detector.{effect.key})"
        for effect in PIXEL_EFFECTS
        if effect.left_out and effect.present(case.instrument.detector)
    ]
    return said("left_out", case) + of_pixels


def require_window(case: Case, *keys: str) -> None:
    """Refuse effects that need the whole frame, except pixels that depend on each other.

    keys    the effects that are refused; none: all
    Raises  Refused, with the necessary change of the design.
    """
    for effect in present("window", case):
        if not keys or effect.key in keys:
            phrase = effect.says("window", case)[0]
            raise Refused(f"window needs {phrase}; choose the fidelity frame")


def require_no_image(case: Case) -> None:
    """Refuse effects that need an image.

    Raises  Refused that names it.
    """
    require_independent_pixels(case.instrument.detector)
    if named := said("drawn", case):
        raise Refused(
            f"covariance needs a case without {' and '.join(named)}; choose the fidelity window "
            "or frame"
        )


def require_least_squares(case: Case) -> None:
    """Refuse effects that the covariance of drawn spots cannot include.

    Raises  Refused, with the necessary change of the design.
    """
    for phrase in said("covariance", case):
        raise Refused(f"covariance needs {phrase}; choose the fidelity spots, window or frame")
