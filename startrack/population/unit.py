"""Case, seed, moment -> the case of one unit, with its tracker's calibration."""

from dataclasses import replace
from functools import lru_cache

from numpy.random import Generator

from startrack.attitude import Mounting
from startrack.core import Camera, Streams
from startrack.design import Case, Moment, found_at, middle_case, unchecked, unit_case, unit_values
from startrack.population.calibrate import alignment, calibrated, drawn
from startrack.population.nodes import NOISE, of_places, share_images

RESIDUAL_SEED = "instrument.residual.seed"


def unit_of(case: Case, seed: int, moment: Moment, run: bool = False) -> Case:
    """The case of a unit at a moment of its life: truth as drawn, beliefs as calibrated.

    moment  of a unit; unit -1 is the unit as designed, without variations
    run     whether its calibration is run; false: drawn from its covariance
    Raises  ValueError with unit and name, if a parameter refuses a drawn value.
    """
    unit = _built(case, seed, moment)
    return unit if unit.design is None else _believing(unit, case, seed, moment, run)


@lru_cache(maxsize=8)
def _as_imaged(case: Case) -> Case:
    """A unit as designed, behind a lens table; kept for the 8 last cases."""
    return _imaged_as(case.without_units.unit_of(case), case)


@lru_cache(maxsize=8)
def _of_places(case: Case) -> frozenset[str]:
    """Numbers that vary and move only the places of stars; the last 8 cases are cached."""
    names = {variation.name for variation in case.varying}
    return frozenset(name for name in names if of_places(case, name)) | {RESIDUAL_SEED}


def placed(case: Case, like: Case, seed: int, moment: Moment) -> Case:
    """A unit with the star places of `unit_of`, and all other values of another unit.

    It is much faster than `unit_of`, because no part of the case is checked again.

    case  the design, for which `share_images` is true
    like  the other unit
    """
    return _believing(_with_places(case, like, seed, moment), case, seed, moment, run=False)


def _believing(unit: Case, case: Case, seed: int, moment: Moment, run: bool) -> Case:
    """A unit whose tracker believes the result of its calibration; unchanged without
    calibration."""
    if case.tracker.calibration is None:
        return unit
    camera, mounting = _calibrated_once(case, seed, moment.unit, run)
    if case.tracker.calibration.place == "recursive":
        camera = _followed(case, seed, replace(moment, frame=-1), run)
    beliefs = {"camera": camera, "camera_model": "radial", "mounting": mounting}
    return unchecked(unit, {f"tracker.{name}": value for name, value in beliefs.items()})


def _with_places(case: Case, like: Case, seed: int, moment: Moment) -> Case:
    return unchecked(like, unit_values(case, seed, moment, _of_places(case)))


def _built(case: Case, seed: int, moment: Moment) -> Case:
    unit: Case = unit_case(case, seed, moment)
    return _imaged_as(unit, case) if unit.design and share_images(case) else unit


def _imaged_as(unit: Case, case: Case) -> Case:
    return unchecked(unit, {"instrument.imaged": case.instrument})


def middle_of(case: Case, age: float) -> Case | None:
    """The unit whose noise and detection represent all units; None: there is no such unit.

    It is used with a lens table, because measuring each unit would take as long as measuring the
    design. Units may then differ only in places of stars and in noise; all have the noise of the
    middle unit.

    age  second
    Accuracy  3 % of a unit's rms, for three units of the nanosatellite at an age of five years
    """
    if not share_images(case):
        return None
    names = {variation.name for variation in case.varying if variation.name.startswith(NOISE)}
    for variation in case.varying:
        changes = found_at(case, variation.name) != 0 or variation.vary != "relative"
        if changes and variation.name not in names and not of_places(case, variation.name):
            return None
    return _imaged_as(middle_case(case, age, names), case)


@lru_cache(maxsize=64)
def _calibrated_once(case: Case, seed: int, number: int, run: bool) -> tuple[Camera, Mounting]:
    """Camera and mounting by the calibration of a unit; cached for the last 64 units."""
    settings = case.tracker.calibration
    assert settings
    launched = settings.place != "ground"
    built = _as_calibrated(case, seed, Moment(number, launched=launched), settings.temperature)
    find = calibrated if run else drawn
    truth, design = built.instrument.camera, built.as_designed.believed_camera
    camera = find(truth, design, settings.once, Streams(seed, number))
    # The alignment to the spacecraft is measured with the same stars.
    turn = built.instrument.mounting.still.camera_to_body() * alignment(truth, camera).inv()
    x, y, z = turn.as_rotvec().tolist()
    return camera, Mounting(x, y, z)


@lru_cache(maxsize=64)
def _followed(case: Case, seed: int, moment: Moment, run: bool) -> Camera:
    """Camera by a recursive calibration at a moment; cached for the last 64 moments."""
    settings = case.tracker.calibration
    assert settings
    believed, _ = _calibrated_once(case, seed, moment.unit, run)
    built = _as_calibrated(case, seed, moment, 0.0)

    def streams(cause: str) -> Generator:
        return Streams(seed, moment.unit)(f"{cause} {moment.environment} {moment.age!r}")

    find = calibrated if run else drawn
    return find(built.instrument.camera, believed, settings, streams)


def _as_calibrated(case: Case, seed: int, moment: Moment, warmer: float) -> Case:
    """A unit as its calibration sees it, with its residual at the temperature of the
    calibration."""
    if share_images(case):
        built = _with_places(case, _as_imaged(case), seed, moment)
    else:
        built = _built(case, seed, moment)
    if built.instrument.residual is not None and warmer:
        warm = built.instrument.residual.temperature + warmer
        built = unchecked(built, {"instrument.residual.temperature": warm})
    return built
