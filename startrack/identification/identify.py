"""Matches from spots, the believed camera and the catalogue."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import Camera, Floats, Ints, Matches, Refused, Status, kernel
from startrack.identification.agree import FOCAL_ROUNDS, Gathered, gather
from startrack.identification.grids import SkyGrid, VerificationStars
from startrack.identification.index import CodeTable, PatternIndex
from startrack.identification.parameters import Identification, matches_by_code
from startrack.identification.regrow import FREE, UNCHECKED, is_doubtful, is_held_by_one, regrown
from startrack.identification.search import TripleLimits, breadth_first, search
from startrack.identification.seen import Seen, keep_brightest, see, usable, with_focal
from startrack.identification.verify import MatchVerdict, scale_tolerance, verify

# Bound on the probability by chance below which a refused hypothesis is reported as ambiguous
# instead of no match. Chosen by hand: it changes only the status.
PROBABLE = 1e-2


def identify(
    spots: core.Spots,
    camera: Camera,
    stars: core.Stars,
    index: PatternIndex,
    settings: Identification,
) -> Matches:
    """Match spots with stars at an unknown attitude (lost in space).

    Triangles of bright spots are looked up by their code. Each triangle found is a hypothesis,
    which the other spots verify. The first hypothesis whose probability by chance is at most
    `settings.max_false_probability` per image is refined and matched to all spots.

    spots     brightest first; those without a finite position are left out
    camera    the camera that the tracker assumes; only its focal length may be wrong
    stars     the tracker's catalogue, apparent directions
    index     built from these stars, for about this field of view
    Returns   Matches: solved, with the spots in rising order and the least-squares attitude; or not
              solved: too few stars, a blank image, ambiguous, or no match. It is ambiguous if the
              best hypothesis is likely, but its bound on chance is too large, or if one match alone
              determines the roll about the others or the focal length. There is no match, also, if
              more spots fit with a focal length outside the tolerance
    Raises    ValueError if the index was built from another number of stars.
    Accuracy  model: the bound on false matches holds for randomly distributed spots. Spots of trees
              or clouds are clustered, and so are stars.
    """
    if index.stars != len(stars):
        raise Refused(
            f"index must be built from the same stars, got {index.stars} stars in the index "
            f"and {len(stars)} in the catalogue"
        )
    finite = usable(spots)
    if core.is_code(settings.method):
        return matches_by_code(spots, finite, camera, stars, settings)
    if len(finite) < settings.min_matches:
        return too_few(len(finite), camera, settings)
    log_accepted = math.log(settings.max_false_probability)
    limits = TripleLimits(
        settings.verify_spots,
        settings.code_tolerance,
        settings.min_matches,
        log_accepted,
        settings.max_hypotheses,
    )
    choices = breadth_first(min(len(finite), settings.verify_spots), settings.pattern_spots)
    patterns = index.table, index.bright, index.faint, stars.magnitude_g
    best, tried, gathered, off, alone = _identify(
        see(spots, finite, camera, settings), choices, *patterns, limits
    )
    if best.log_p >= log_accepted:
        return _not_accepted(best.log_p, best.matches, len(finite), tried, camera)
    if off:
        return _other_focal_length(gathered, len(finite), camera, settings)
    if alone:
        return _held_by_one(best.log_p, len(gathered.spot), len(finite), camera)
    if camera.distorted:
        return refined(
            spots, finite, camera, stars, index, settings, best.rotation, best.scale, best.log_p
        )
    return _solved(gathered, finite, camera.scaled(gathered.scale), best.log_p)


@kernel
def _identify(
    seen: Seen,
    choices: Ints,
    table: CodeTable,
    voters: VerificationStars,
    faint: SkyGrid,
    magnitude: Floats,
    limits: TripleLimits,
) -> tuple[MatchVerdict, int, Gathered, bool, bool]:
    """`search` and `gather` in one compiled call, because a call takes as long as its work.

    Returns  verdict, number of hypotheses, the matches; whether an accepted hypothesis needs a
             focal length outside the tolerance, and whether one match alone determines it
    """
    voting = keep_brightest(seen, limits.voting)
    best, tried = search(voting, choices, table, voters, limits)
    gathered, alone = gather(seen, faint, magnitude, best.rotation, best.scale), False
    if best.log_p < limits.log_accepted and is_doubtful(seen, gathered):
        rotation, scale = regrown(voting, voters, gathered, limits.fewest)
        verdict = verify(voting, voters, rotation, scale, limits.fewest)
        if verdict.log_p < best.log_p:
            best = verdict
        within = abs(scale - 1) <= scale_tolerance(seen)
        believed = seen if within else with_focal(seen, FREE * seen.focal)
        gathered = gather(believed, faint, magnitude, rotation, scale)
        alone = is_held_by_one(seen, gathered, UNCHECKED)
    return best, tried, gathered, abs(gathered.scale - 1) > scale_tolerance(seen), alone


def refined(
    spots: core.Spots,
    finite: Ints,
    camera: Camera,
    stars: core.Stars,
    index: PatternIndex,
    settings: Identification,
    rotation: Floats,
    scale: float,
    log_p: float,
) -> Matches:
    """The matches of all spots at an accepted attitude.

    Distortion is not a similarity, so it is corrected again for each new focal length.

    finite    the usable spots
    rotation  (3, 3) icrs_to_camera to start from
    scale     1, true over believed focal length, to start from
    log_p     ln of the bound on chance
    """
    rounds = FOCAL_ROUNDS if camera.distorted and settings.focal_tolerance else 1
    for _ in range(rounds):
        seen = see(spots, finite, camera.scaled(scale), settings)
        gathered = gather(seen, index.faint, stars.magnitude_g, rotation, 1.0)
        scale *= gathered.scale
        rotation = gathered.rotation
    return _solved(gathered, finite, camera.scaled(scale), log_p)


def _solved(gathered: Gathered, finite: Ints, camera: Camera, log_p: float) -> Matches:
    return Matches(
        status=Status.SOLVED,
        reason=f"{len(gathered.spot)} of {len(finite)} spots are stars of the catalogue",
        spot=finite[gathered.spot],
        star=gathered.star,
        direction=gathered.direction,
        camera=camera,
        icrs_to_camera=Rotation.from_quat(gathered.quaternion),
        false_probability=math.exp(log_p),
    )


def too_few(spots: int, camera: Camera, settings: Identification) -> Matches:
    """The unsolved result for too few usable spots."""
    status = Status.TOO_FEW if spots else Status.BLANK
    reason = f"{spots} usable spots, of which {settings.min_matches} are needed"
    return _unsolved(status, reason, camera)


def _not_accepted(log_p: float, matches: int, spots: int, tried: int, camera: Camera) -> Matches:
    if log_p < math.log(PROBABLE):
        reason = (
            f"{matches} of {spots} spots agree with stars, but chance makes such a match "
            f"with a probability of up to {math.exp(log_p):.0e}"
        )
        return _unsolved(Status.AMBIGUOUS, reason, camera, math.exp(log_p))
    reason = f"none of {tried} hypotheses explains the {spots} spots better than chance"
    return _unsolved(Status.NO_MATCH, reason, camera)


def _other_focal_length(
    gathered: Gathered, spots: int, camera: Camera, settings: Identification
) -> Matches:
    reason = (
        f"{len(gathered.spot)} of {spots} spots are stars for a focal length "
        f"{100 * (gathered.scale - 1):+.1f} % off, of which focal_tolerance allows "
        f"{100 * settings.focal_tolerance:g} %"
    )
    return _unsolved(Status.NO_MATCH, reason, camera)


def _held_by_one(log_p: float, matches: int, spots: int, camera: Camera) -> Matches:
    reason = (
        f"{matches} of {spots} spots are stars, but one alone determines the roll about the "
        "others or the focal length"
    )
    return _unsolved(Status.AMBIGUOUS, reason, camera, math.exp(log_p))


def _unsolved(status: Status, reason: str, camera: Camera, chance: float = 1.0) -> Matches:
    none: Ints = np.empty(0, np.int64)
    return Matches(
        status=status,
        reason=reason,
        spot=none,
        star=none,
        direction=np.empty((0, 3)),
        camera=camera,
        icrs_to_camera=None,
        false_probability=chance,
    )
