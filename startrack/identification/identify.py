"""Spots, the believed camera and the catalogue enter; Matches leave."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Floats, Ints, Matches, Spots, Stars, Status
from startrack.identification.agree import FOCAL_ROUNDS, Gathered, gather
from startrack.identification.index import CodeTable, PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.search import breadth_first, search
from startrack.identification.seen import Seen, keep_brightest, see, usable
from startrack.identification.sky import SkyGrid, VerificationStars
from startrack.identification.verify import Verdict

PROBABLE = 1e-2  # chance of a hypothesis below which a sky is ambiguous rather than none


def identify(
    spots: Spots, camera: Camera, stars: Stars, index: PatternIndex, settings: Identification
) -> Matches:
    """Which spot is which star, with nothing known of the attitude.

    Triangles of bright spots are looked up by their code; each that is found makes a
    hypothesis, on which the other spots vote. The first one that chance does not make more
    often than `settings.max_false_probability` per image is refined and matched to all spots.

    spots     brightest first; those at no finite place are left out
    camera    the tracker's own; only its focal length is in doubt
    stars     the tracker's catalogue, apparent directions
    index     built from these stars, for about this field of view
    Returns   Matches: solved with the spots in rising order and at the least-squares attitude,
              or too few stars, a blank image, ambiguous (a hypothesis that is likely true, but
              not beyond doubt), or no match
    Raises    ValueError where the index was built from another number of stars.
    Accuracy  model: the bound on false matches holds for spots strewn at random; those of trees or
              clouds are clumped, and so are stars.
    """
    if index.stars != len(stars):
        raise ValueError(
            f"index must be built from the same stars, got {index.stars} stars in the index "
            f"and {len(stars)} in the catalogue"
        )
    finite = usable(spots)
    if len(finite) < settings.min_matches:
        return _too_few(len(finite), camera, settings)
    log_accepted = math.log(settings.max_false_probability)
    best, tried, found = _identify(
        see(spots, finite, camera, settings),
        breadth_first(min(len(finite), settings.verify_spots), settings.pattern_spots),
        settings.verify_spots,
        settings.code_tolerance,
        index.table,
        index.bright,
        settings.min_matches,
        log_accepted,
        settings.max_hypotheses,
        index.faint,
        stars.magnitude_g,
    )
    if best.log_p >= log_accepted:
        return _doubtful(best.log_p, best.matches, len(finite), tried, camera)
    if camera.distorted:
        return refined(
            spots, finite, camera, stars, index, settings, best.rotation, best.scale, best.log_p
        )
    return _solved(found, finite, camera.scaled(found.scale), best.log_p)


@njit(cache=True, error_model="numpy")
def _identify(
    seen: Seen,
    choices: NDArray[np.int64],
    voting: int,
    code_tolerance: float,
    table: CodeTable,
    voters: VerificationStars,
    fewest: int,
    log_accepted: float,
    most_hypotheses: int,
    faint: SkyGrid,
    magnitude: Floats,
) -> tuple[Verdict, int, Gathered]:  # pragma: no cover
    """`search` and `gather` in one call, for each costs as much as it works."""
    best, tried = search(
        keep_brightest(seen, voting),
        choices,
        code_tolerance,
        table,
        voters,
        fewest,
        log_accepted,
        most_hypotheses,
    )
    return best, tried, gather(seen, faint, magnitude, best.rotation, best.scale)


def refined(
    spots: Spots,
    finite: Ints,
    camera: Camera,
    stars: Stars,
    index: PatternIndex,
    settings: Identification,
    rotation: Floats,
    scale: float,
    log_p: float,
) -> Matches:
    """The matches of all spots at an attitude beyond doubt.

    Distortion is not a similarity: it is taken off anew with each focal length that is found.

    finite  the usable spots
    log_p   ln of the bound on chance
    """
    rounds = FOCAL_ROUNDS if camera.distorted and settings.focal_tolerance else 1
    for _ in range(rounds):
        seen = see(spots, finite, camera.scaled(scale), settings)
        found = gather(seen, index.faint, stars.magnitude_g, rotation, 1.0)
        scale *= found.scale
        rotation = found.rotation
    return _solved(found, finite, camera.scaled(scale), log_p)


def _solved(found: Gathered, finite: Ints, camera: Camera, log_p: float) -> Matches:
    return Matches(
        Status.SOLVED,
        f"{len(found.spot)} of {len(finite)} spots are stars of the catalogue",
        finite[found.spot],
        found.star,
        found.direction,
        camera,
        Rotation.from_quat(found.quaternion),
        math.exp(log_p),
    )


def _too_few(spots: int, camera: Camera, settings: Identification) -> Matches:
    status = Status.TOO_FEW if spots else Status.BLANK
    reason = f"{spots} usable spots, of which {settings.min_matches} are needed"
    return _unsolved(status, reason, camera)


def _doubtful(log_p: float, matches: int, spots: int, tried: int, camera: Camera) -> Matches:
    if log_p < math.log(PROBABLE):
        reason = (
            f"{matches} of {spots} spots agree with stars, but chance makes such a match "
            f"with a probability of up to {math.exp(log_p):.0e}"
        )
        return _unsolved(Status.AMBIGUOUS, reason, camera, math.exp(log_p))
    reason = f"none of {tried} hypotheses explains the {spots} spots better than chance"
    return _unsolved(Status.NO_MATCH, reason, camera)


def _unsolved(status: Status, reason: str, camera: Camera, chance: float = 1.0) -> Matches:
    none: NDArray[np.int64] = np.empty(0, np.int64)
    return Matches(status, reason, none, none, np.empty((0, 3)), camera, None, chance)


def identify_all(
    frames: Iterable[Spots],
    camera: Camera,
    stars: Stars,
    index: PatternIndex,
    settings: Identification,
) -> Iterator[Matches]:
    """Identify frame after frame, each with nothing known of its attitude.

    A generator: thousands of frames need the memory of one. The frames are independent, so that
    an executor may share them out among processes; see `identify` for the arguments.
    """
    for spots in frames:
        yield identify(spots, camera, stars, index, settings)
