"""Case: true values and values that the tracker assumes, kept apart; Fidelity of a trial."""

from __future__ import annotations

from dataclasses import field, fields, replace
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from startrack import core
from startrack.attitude import Mounting, SolverSettings
from startrack.catalog import Selection
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    YEAR,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
)
from startrack.design.epoch import believed_from, seen_from
from startrack.design.parameter import unchecked
from startrack.design.structure import Structure
from startrack.design.variation import Law, Variation, check_variations, law_of
from startrack.detection import Box, Detection
from startrack.detector import Detector
from startrack.identification import Identification
from startrack.motion import Motion
from startrack.optics import (
    ROOM,
    Baffle,
    BaffleTube,
    Ghosts,
    Optics,
    Residual,
    camera_of_cube,
    fit_camera,
    lens_surfaces,
    open_optics,
    open_psf_file,
    transmittance_of,
)
from startrack.scene import SUN, WAVELENGTH, Scene, blackbody_photons, in_bins, outside_bins

PLACES = ("ground", "orbit", "recursive")
ORDERS = (1, 3, 5, 7)


class CameraCalibration(Parameters):
    """A calibration of the camera of one unit: a least-squares fit to stars at known directions.

    On the ground, a collimator or a star simulator shows stars at `positions` evenly over the
    frame, in one attitude of the camera, which is also fitted. In orbit, each of `frames` of random
    sky has `stars` at random places, and its own attitude. A recursive calibration is a filter from
    frame to frame (`CameraFilter`, which reaches the bound of such a fit). Its memory is the last
    `frames`, which last shorter than an environment.
    """

    place: str = parameter(
        '"ground": before launch, so that steps at launch are not calibrated; "orbit": once after '
        'launch; "recursive": as "orbit", then focal length, distortion and map again and again, '
        "so that they follow age and temperature. Principal point and mounting stay, because stars "
        "hardly distinguish them from a rotation",
        limit=Range(choices=PLACES),
        default="ground",
    )
    positions: int = parameter("on the ground", limit=Range(10, 10**5), default=100)
    frames: int = parameter("in orbit", limit=Range(1, 10**5), default=50)
    stars: int = parameter(
        "number of stars in each of these frames", limit=Range(3, 1000), default=10
    )
    noise: float = parameter(
        "pixel rms per axis, noise of the mean centroid of a star at a position, or in a frame",
        limit=NON_NEGATIVE,
        default=0.02,
    )
    direction: float = parameter(
        "radian rms per axis, error of the direction of a position of the collimator",
        unit=Unit("rad", "arcsec"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    temperature: float = parameter(
        "temperature of the instrument above its reference during the calibration",
        unit=Unit("K"),
        limit=FINITE,
        default=0.0,
    )
    order: int = parameter(
        "order of the distortion polynomial in the fit. 1: focal length and principal point alone; "
        "3: also k1; 5: also k2; 7: also k3",
        default=3,
    )
    tangential: bool = parameter("whether p1 and p2 are also fitted", default=False)
    map: int = parameter(
        "nodes along each side of a map of displacements, which is fitted to the residuals of the "
        "polynomial, with linear interpolation between nodes. 0: no map; 1: no map either, because "
        "one common shift is the principal point",
        limit=Range(0, 9),
        default=0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.order not in ORDERS:
            raise Refused(f"order must be 1, 3, 5 or 7, got {self.order}")

    @property
    def nodes(self) -> int:
        """Number of nodes along each side of the map; 0 without a map."""
        return self.map if self.map > 1 else 0

    @property
    def once(self) -> CameraCalibration:
        """Calibration of a whole camera, with which a recursive calibration begins."""
        return replace(self, place="orbit") if self.place == "recursive" else self


class Fidelity(StrEnum):
    """Fidelity of a trial; each is a cheaper approximation of the previous one.

    frame       the whole image is rendered and searched
    window      only the pixels that the detection may use are rendered: around stars, and where
                noise alone exceeds the threshold
    spots       spots are drawn from the centroids' bias and covariance, without an image; they are
                identified and solved like the spots of a frame
    covariance  spots are drawn as in `spots`; identification is assumed to be perfect
    """

    FRAME = "frame"
    WINDOW = "window"
    SPOTS = "spots"
    COVARIANCE = "covariance"


class Temperatures(Parameters):
    """Temperatures of an instrument; that of its detector is in the detector."""

    lens: float = parameter(
        "temperature of the lens, at which its table gives focal length, focus and distortion",
        unit=Unit("K", "degC", absolute=True),
        limit=Range(1, 1000),
        default=ROOM,
    )


MOST_OUTSIDE = 0.02  # limit of the fraction of a sunlike star's light outside all spectral bins


@lru_cache(maxsize=16)
def _traced_camera(
    optics: Optics,
    kelvin: float,
    columns: int,
    rows: int,
    pitch: float,
    principal: tuple[float, float],
    photons: bytes,
) -> core.Camera:
    """`fit_camera`; cached for the last 16 lenses, because units in their environments share one.

    photons  of `Instrument.detected_spectra`
    """
    lens, spectrum = open_optics(optics, kelvin), np.frombuffer(photons)
    return fit_camera(lens, columns, rows, pitch, principal, WAVELENGTH, spectrum)


class Instrument(Parameters):
    """The truth: it makes the frame and judges the attitude.

    imaged    the instrument from which images and distortion behind a lens table are taken, scaled
              by the focal length; None: this instrument. No file contains it
    """

    optics: Optics = parameter("A lens.")
    detector: Detector = parameter(
        "A matrix of pixels, or lines of pixels, in the terms of EMVA 1288 (release 4.0)."
    )
    motion: Motion = parameter(
        "How the camera rotates in an exposure, about its own axes.", default_factory=Motion
    )
    mounting: Mounting = parameter(
        "mounting of the camera on the spacecraft", default_factory=Mounting
    )
    delay: float = parameter(
        "time stamp of a frame minus the middle of its exposure",
        unit=Unit("s", "ms"),
        limit=FINITE,
        default=0.0,
    )
    baffle: Baffle | None = parameter(
        "transmission of the baffle for Sun, Moon and Earth; None: no stray light", default=None
    )
    tube: BaffleTube | None = parameter(
        "geometry of the baffle, in place of its curve; None: `baffle` holds", default=None
    )
    thermal: Temperatures | None = parameter(
        "temperatures; None: the lens is at 20 degC", default=None
    )
    ghosts: Ghosts | None = parameter(
        "reflections in the lens that make ghosts of bright sources; None: no ghosts", default=None
    )
    residual: Residual | None = parameter(
        "displacements that remain after a calibration, because no camera model contains them; "
        "None: none",
        default=None,
    )
    structure: Structure | None = parameter(
        "structure that carries lens and detector, and its temperatures; their effects vary like a "
        "[[variation]]; None: no structure",
        default=None,
    )
    imaged: Instrument | None = field(default=None, metadata={"computed": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.baffle and self.tube:
            raise Refused("baffle must be left out where tube gives its geometry, or tube left out")
        if self.thermal and not self.optics.traced:
            raise Refused("thermal.lens must be left out without a lens_file that says its effect")
        if self.ghosts:
            lens_surfaces(self.optics)
            if self.detector.scan:
                raise Refused("ghosts must be left out for a detector that scans")
        if self.optics.tabulated and self.detector.scan:
            key = "lens_file" if self.optics.traced else "psf_file of several images"
            raise Refused(f"optics.{key} must be left out for a detector that scans")

    def __hash__(self) -> int:
        """Computed once, as the hash of a Case."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(tuple(getattr(self, part.name) for part in fields(self)))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_hash"}

    @cached_property
    def stray(self) -> Baffle | None:
        """Transmission of the baffle, by its curve or its geometry; None: no stray light.

        Lens and field are rounded to three digits, so that the units of a design share one curve.

        Raises  Refused if the tube is narrower than its entrance.
        """
        if self.tube is None:
            return self.baffle
        return transmittance_of(self.tube, *self._tube_sizes)

    def require_tube(self) -> None:
        """Refuse a tube that is narrower than its entrance, without tracing its light."""
        if self.tube is not None:
            lens, field, _ = self._tube_sizes
            self.tube.shape(lens, field)

    @property
    def _tube_sizes(self) -> tuple[float, float, float]:
        """Aperture, field and f-number to three digits."""
        sizes = self.optics.aperture, self.camera.half_diagonal, self.optics.f_number
        lens, field, f_number = (float(f"{size:.3g}") for size in sizes)
        return lens, field, f_number

    @property
    def lens_temperature(self) -> float:
        """Temperature of the lens, kelvin."""
        return self.thermal.lens if self.thermal else ROOM

    @cached_property
    def camera(self) -> core.Camera:
        """True camera; with a lens table, the camera that fits it best.

        Raises  ValueError if the table does not cover the frame, the band or the temperature.
        """
        model = self._camera_model
        if self.residual is None:
            return model
        optics = self.imaged.optics if self.imaged else self.optics
        field = self.residual.field(model, optics, self.detector.pitch)
        return model if field is None else replace(model, residual=field)

    @property
    def _camera_model(self) -> core.Camera:
        optics, columns, rows = self.optics, self.detector.columns, self.detector.rows
        shift_x, shift_y = self.detector.shift
        principal = optics.principal_x + shift_x, optics.principal_y + shift_y
        if self.imaged:
            model, traced = self.imaged.camera.ideal, self.imaged.optics
            focal = model.focal_length_px * optics.focal_length / traced.focal_length
            x, y = principal
            return replace(model, focal_length_px=focal, principal_x=x, principal_y=y)
        places = bool(optics.psf_file) and open_psf_file(optics.psf_file).place is not None
        if optics.traced or places:
            where = columns, rows, self.detector.pitch, principal
            spectrum = self.detected_spectra(np.array([SUN]))[0]
            if places:
                return camera_of_cube(optics, *where, WAVELENGTH, spectrum)
            return _traced_camera(optics, self.lens_temperature, *where, spectrum.tobytes())
        return core.Camera(
            columns,
            rows,
            optics.focal_length / self.detector.pitch,
            *principal,
            optics.k1,
            optics.k2,
            optics.p1,
            optics.p2,
            optics.k3,
            optics.polynomial,
        )

    def detected_spectra(self, temperature: Floats) -> Floats:
        """Photons per second of blackbodies that are detected in each spectral bin, on any scale.

        temperature  (n,) kelvin
        Returns      (n, k) in the bins of WAVELENGTH
        Raises       ValueError if no photon is detected.
        """
        spectra = blackbody_photons(WAVELENGTH, temperature) * self.optics.area * self.response
        if not spectra.any():
            raise Refused(
                "transmission and quantum_efficiency must overlap between 320 and 1100 nm"
            )
        return spectra

    @property
    def response(self) -> Floats:
        """Transmission times quantum efficiency, electron / photon, mean over each bin.

        For a mosaic of colour filters it is the mean over the pixels.

        Returns  (k,) in the bins of WAVELENGTH
        Raises   Refused if a part of the light that matters has no bin.
        """
        mosaic = self.detector.mosaic
        return self._passed() if mosaic is None else mosaic.mean(self.response_of_colours)

    @property
    def response_of_colours(self) -> Floats:
        """`response` (3, k) of the red, green and blue pixels of a mosaic."""
        assert self.detector.mosaic
        return np.array([self._passed(one) for one in self.detector.mosaic.filters])

    def _passed(self, *filters: core.Curve) -> Floats:
        curves = self.optics.transmission, self.detector.quantum_efficiency
        outside = outside_bins(*curves)
        if outside > MOST_OUTSIDE:
            raise Refused(
                "transmission and quantum_efficiency must lie between 320 and 1100 nm, where the "
                f"spectra of stars are modelled, got {100 * outside:.0f} % of a sunlike star's "
                "light outside"
            )
        return in_bins(*curves, *filters)


class Tracker(Parameters):
    """Settings and knowledge of the flight software."""

    detection: Detection = parameter(
        "How spots are found and measured. The defaults serve real images of many cameras.",
        default_factory=Detection,
    )
    identification: Identification = parameter(
        "Settings of the identification of spots, for calibrated cameras by default.",
        default_factory=Identification,
    )
    attitude: SolverSettings = parameter(
        "How matched stars are weighted, and when one is left out.", default_factory=SolverSettings
    )
    camera: core.Camera | None = parameter(
        "camera that the tracker assumes; None: a perfect calibration, by the instrument's design",
        default=None,
    )
    camera_model: str = parameter(
        'model of that perfect calibration: "radial", focal length and three radial '
        'coefficients; "polynomial", to the third order in x and y',
        limit=Range(choices=("radial", "polynomial")),
        default="radial",
    )
    catalog: Selection | None = parameter(
        "star catalogue of the tracker; None: the catalogue of the sky", default=None
    )
    mounting: Mounting | None = parameter(
        "mounting that it assumes, None for the true one without its swing", default=None
    )
    delay: float | None = parameter(
        "second, delay that the tracker subtracts from its time stamps; None: the true delay",
        unit=Unit("s", "ms"),
        limit=FINITE,
        default=None,
    )
    motion: Motion | None = parameter(
        "motion that the tracker assumes; None: the true motion without jitter. For a detector "
        "that scans, each spot has its own time",
        default=None,
    )
    rate: str = parameter(
        'source of the smear of stars without a prediction: "known", the motion that the tracker '
        'assumes; "images", the streaks in the frame itself, whose sign is unknown',
        limit=Range(choices=("known", "images")),
        default="known",
    )
    reference: str = parameter(
        'reference attitude of the errors: "instant", the attitude at mid-exposure, which control '
        'needs and to which errors of ECSS-E-ST-60-20C refer; "mean", the mean over the exposure. '
        "Jitter within the exposure is then an error of the spacecraft, as in makers' noise data",
        limit=Range(choices=("instant", "mean")),
        default="instant",
    )
    row_delay: float | None = parameter(
        "second between the exposures of two rows, by which the tracker moves each spot to the "
        "middle of the frame's exposure at the rates that it knows; None: the row delay of the "
        "detector as designed, 0: no correction",
        unit=Unit("s", "us"),
        limit=NON_NEGATIVE,
        default=None,
    )
    calibrated_at: float | None = parameter(
        "temperature of the lens when the camera was calibrated; None: its true temperature. The "
        "lens table gives the difference",
        unit=Unit("K", "degC", absolute=True),
        limit=Range(1, 1000),
        default=None,
    )
    focal_length_by_colour: bool = parameter(
        "whether the tracker uses a calibrated focal length for the catalogue colour of each star. "
        "This removes most of the lateral colour of a lens table",
        default=False,
    )
    acquisition: str = parameter(
        'how stars are found with a predicted attitude: "whole" searches the frame; "box" searches '
        "a box around the place of each star, and assigns its light to the star. In a sequence the "
        "first attitude comes from the whole frame; a single trial has a prediction",
        limit=Range(choices=("whole", "box")),
        default="whole",
    )
    box: Box = parameter("these boxes", default_factory=Box)
    calibration: CameraCalibration | None = parameter(
        "how the camera of each unit is calibrated, if units vary; None: not calibrated, the "
        "tracker assumes the camera as designed",
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.camera is not None and self.camera_model != "radial":
            raise Refused("camera_model must be left out if tracker.camera is given")
        if self.catalog and self.catalog.faintest_g > self.catalog.limit_g:
            raise Refused("catalog of a tracker must have no random_g: no list has these stars")
        if self.mounting and self.mounting.swings:
            raise Refused("mounting of a tracker must not swing: it assumes one rotation")
        least, most = self.identification.min_matches, self.detection.max_spots
        if least > most:
            raise Refused(
                f"identification.min_matches must be at most detection.max_spots ({most}), "
                f"got {least}"
            )


@core.printed
class Case(core.CarriesCode):
    """One design in one scene: everything that a trial needs except its attitude and its noise.

    If the catalogue leaves out epoch or orbital velocity (None), `seen_from` sets them from the
    date and the orbit of the scene. The tracker's catalogue then has the same values.

    The assumptions of the tracker come from the design, from its settings or from a calibration,
    never from random values of a unit: see `as_designed`.

    design     the design of which this case is a unit with random differences; None: this case is
               as designed. No file contains it

    Raises  ValueError if the catalogue contradicts the scene.
    """

    instrument: Instrument = parameter("The truth: it makes the frame and judges the attitude.")
    tracker: Tracker = parameter(
        "What the flight software believes and how it works.", default_factory=Tracker
    )
    scene: Scene = parameter(
        "Background and bodies in addition to the stars, date and observer.", default_factory=Scene
    )
    catalog: Selection = parameter("The stars that a sky holds.", default_factory=Selection)
    variation: tuple[Variation, ...] = parameter(
        "differences between units, launches, environments and in time; a trial without units "
        "leaves them out",
        default=(),
    )
    lifetime: float = parameter(
        "age at the end of life; 0: the age of the detector, if it has one",
        unit=Unit("s", "yr"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    design: Case | None = field(default=None, metadata={"computed": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tracker.focal_length_by_colour and not self.instrument.optics.tabulated:
            raise Refused(
                "tracker.focal_length_by_colour must be left out without a lens_file that says how "
                "the focal length changes with colour"
            )
        saturation, detector = self.tracker.detection.saturation, self.instrument.detector
        if saturation is not None and saturation <= detector.offset:
            raise Refused(
                "tracker.detection.saturation must be above instrument.detector.offset "
                f"({detector.offset:g}), the number of an empty pixel, got {saturation:g}"
            )
        if self.tracker.acquisition == "box" and self.instrument.detector.scan:
            raise Refused("tracker.acquisition must be whole for a detector that scans")
        if self.tracker.detection.dark_map_age is not None and not self.instrument.detector.age:
            raise Refused(
                "tracker.detection.dark_map_age must be left out if the detector has no age"
            )
        catalog = seen_from(self.scene, self.catalog)
        object.__setattr__(self, "catalog", catalog)
        if self.tracker.catalog:
            believed = believed_from(self.scene, catalog, self.tracker.catalog)
            object.__setattr__(self, "tracker", replace(self.tracker, catalog=believed))
        own = {(variation.name, variation.per) for variation in self.variation}
        for variation in self._of_structure:
            if (variation.name, variation.per) in own:
                raise Refused(
                    f"variation of {variation.name} per {variation.per} must be left out: "
                    "instrument.structure gives it"
                )
        check_variations(self, self.varying)

    @property
    def _rows(self) -> list[tuple[str, str]]:
        optics, detector = self.instrument.optics, self.instrument.detector
        camera, size = self.instrument.camera, f"{detector.columns} x {detector.rows}"
        return [
            ("field", f"{camera.fov_x / core.deg:.3g} x {camera.fov_y / core.deg:.3g} deg"),
            ("lens", f"{optics.focal_length / core.mm:.4g} mm f/{optics.f_number:.3g}"),
            ("detector", f"{size} pixels of {detector.pitch / core.um:g} um"),
            ("exposure", f"{1e3 * detector.exposure:g} ms"),
            ("stars", self.catalog.extent),
        ]

    @property
    def saturation_note(self) -> str:
        """Sentence where the tracker's number of a saturated pixel is not that of the converter."""
        saturation, bits = self.tracker.detection.saturation, self.instrument.detector.bits
        largest = 2**bits - 1
        if saturation is None or largest / 2 < saturation <= largest:
            return ""
        side, effect = "less than half of", "brighter pixels count as saturated"
        if saturation > largest:
            side, effect = "above", "no pixel counts as saturated"
        return (
            f"tracker.detection.saturation, {saturation:g}, is {side} the largest number of {bits} "
            f"bits, {largest}: {effect}"
        )

    def __hash__(self) -> int:
        """Computed once: each trial uses the hash to look up values that are cached for its
        case."""
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash(tuple(getattr(self, part.name) for part in fields(self)))

    def __getstate__(self) -> dict[str, Any]:
        state = super().__getstate__()
        state.pop("_hash", None)  # texts have another hash in another process
        return state

    @cached_property
    def as_designed(self) -> Case:
        """This tracker in the instrument and scene that it was designed for, before a calibration.

        All beliefs that the tracker's settings leave out are derived from it.
        """
        if self.design is None:
            return self
        own = self.design.tracker
        names = ("camera", "camera_model", "mounting", "delay")
        tracker = unchecked(self.tracker, {name: getattr(own, name) for name in names})
        return self.design if tracker == own else replace(self.design, tracker=tracker)

    @cached_property
    def _of_structure(self) -> tuple[Variation, ...]:
        instrument = self.instrument
        if instrument.structure is None:
            return ()
        pitch, residual = instrument.detector.pitch, instrument.residual is not None
        return tuple(instrument.structure.variations(instrument.optics, pitch, residual))

    @cached_property
    def varying(self) -> tuple[Variation, ...]:
        """All varying numbers: declared in the design, or derived from its structure."""
        return (*self.variation, *self._of_structure)

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Laws of the numbers that vary, in SI units, in the order of `varying`."""
        return tuple(law_of(self, variation) for variation in self.varying)

    @property
    def differs(self) -> bool:
        """Whether its units differ, from each other or with age."""
        instrument = self.instrument
        return bool(self.varying or instrument.residual or instrument.detector.age)

    @property
    def end_of_life(self) -> float:
        """Second, the lifetime of the design; if it is left out, the age of its detector."""
        age = self.instrument.detector.age
        return self.lifetime or (age.years * YEAR if age else 0.0)

    @cached_property
    def without_units(self) -> Case:
        """The case without the variations and the structure that make units differ."""
        if not (self.variation or self.instrument.structure):
            return self
        return replace(self, variation=(), instrument=replace(self.instrument, structure=None))

    def unit_of(self, design: Case) -> Case:
        """The case as the truth of a unit of a design."""
        return unchecked(self, {"design": design})

    @property
    def believed_camera(self) -> core.Camera:
        """The camera that the tracker assumes."""
        return self.tracker.camera or self._perfect_camera

    @cached_property
    def _perfect_camera(self) -> core.Camera:
        camera = self.calibrated.camera.ideal
        return camera.as_polynomial if self.tracker.camera_model == "polynomial" else camera

    @cached_property
    def calibrated(self) -> Instrument:
        """The instrument as designed, at the temperature where its camera was calibrated."""
        instrument, kelvin = self.as_designed.instrument, self.tracker.calibrated_at
        if kelvin is None or not instrument.optics.traced:
            return instrument
        return replace(instrument, thermal=Temperatures(kelvin))

    @property
    def believed_catalog(self) -> Selection:
        """The catalogue that the tracker carries."""
        return self.tracker.catalog or self.as_designed.catalog.listed

    @property
    def believed_mounting(self) -> Mounting:
        """Mounting of the camera that the tracker assumes."""
        return self.tracker.mounting or self.as_designed.instrument.mounting.still

    @property
    def believed_motion(self) -> Motion:
        """Motion of the camera that the tracker assumes; only its rates count."""
        return self.tracker.motion or self.as_designed.instrument.motion

    @property
    def believed_row_delay(self) -> float:
        """Second between two rows that the tracker assumes."""
        believed = self.tracker.row_delay
        return self.as_designed.instrument.detector.row_delay if believed is None else believed

    @property
    def time_tag_error(self) -> float:
        """Second, from the middle of the exposure to the time that the tracker states."""
        believed = self.tracker.delay
        if believed is None:
            believed = self.as_designed.instrument.delay
        return self.instrument.delay - believed
