"""Case -> the stars that may be in a frame, their brightness and colour."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, Sky, open_sky
from startrack.core import Camera, Floats, Ints, Light, Refused, Stars, Streams, deg, kept
from startrack.design import Case, Instrument
from startrack.detector import arriving, electron_rate, mean_wavelength
from startrack.identification import POINTS, indexed_field, merged
from startrack.optics import add_ghosts, stray_light
from startrack.scene import Sight, illuminate

PART = 2**14  # stars whose spectra (hundreds of bytes each) are in memory at a time
EDGE = 0.5  # degree beyond the corners from which a slewing or blurred star can reach the frame
COLOURS = np.linspace(-0.6, 4.0, 24)  # BP - RP, from the hottest stars to the reddest


def stars_in_field(sky: Sky, icrs_to_camera: Rotation, camera: Camera) -> Stars:
    """The stars that can reach the frame, brightest first."""
    return sky.stars[nearby(sky, icrs_to_camera, camera)]


def nearby(sky: Sky, icrs_to_camera: Rotation, camera: Camera) -> Ints:
    """Indices in the sky of the stars that can reach the frame, brightest first."""
    boresight = icrs_to_camera.as_matrix()[2]
    return sky.cone(boresight, camera.half_diagonal + math.radians(EDGE))


@kept(4)
def electrons_of(case: Case) -> Floats:
    """Electrons (n,) of each star of the sky in an exposure; kept for the 4 last cases."""
    camera, detector = case.instrument.camera, case.instrument.detector
    through = throughput(case.instrument)
    return _of_all_stars(case, lambda light: arriving(light, camera, detector, through)[0])


@kept(4)
def colours_of(case: Case) -> Floats:
    """Mean detected wavelength (n,) of each star of the sky, metre; kept for the 4 last cases."""
    detector, through = case.instrument.detector, throughput(case.instrument)
    return _of_all_stars(case, lambda light: mean_wavelength(light, detector, through))


def _of_all_stars(case: Case, figure: Callable[[Light], Floats]) -> Floats:
    """A value (n,) for the light of each star of the sky, computed in parts."""
    stars = open_sky(case.catalog).stars
    starts = range(0, max(len(stars), 1), PART)
    parts = (illuminate(case.scene, stars[start : start + PART]) for start in starts)
    return np.concatenate([figure(light) for light in parts])


def light_of(case: Case, stars: Stars, icrs_to_camera: Rotation, streams: Streams) -> Light:
    """Light at the entrance pupil, with the stray light that passes the baffle."""
    instrument = case.instrument
    optics, camera = instrument.optics, instrument.camera
    sight = Sight(icrs_to_camera, camera, case.catalog.faintest_g, streams)
    light = illuminate(case.scene, stars, sight)
    if instrument.ghosts is not None:
        pitch = instrument.detector.pitch
        light = add_ghosts(light, instrument.ghosts, optics, icrs_to_camera, camera, pitch)
    if light.stray_sources and instrument.stray is not None:
        return stray_light(light, instrument.stray, optics, icrs_to_camera, camera)
    instrument.require_tube()
    return light


def throughput(instrument: Instrument) -> Floats:
    """Area of the aperture times transmission times quantum efficiency.

    Returns   (k,) electron m^2 / photon in each spectral bin
    Accuracy  numerical: exact between the nodes of both curves.
    """
    return instrument.optics.area * instrument.response


def throughput_of_colours(instrument: Instrument) -> Floats | None:
    """`throughput` (3, k) of red, green and blue pixels; None without a mosaic."""
    if instrument.detector.mosaic is None:
        return None
    return instrument.optics.area * instrument.response_of_colours


def sky_electrons(case: Case) -> float:
    """Electron in a pixel of mean response, of the sky's uniform light in an exposure."""
    instrument = case.instrument
    light = illuminate(case.scene, open_sky(case.catalog).stars[:0])
    return arriving(light, instrument.camera, instrument.detector, throughput(instrument))[1]


def light_by_colour(case: Case, colour: Floats) -> Light:
    """The light of stars of G = 0 by their BP - RP (n,); NaN means sunlike."""
    count = len(colour)
    stars = Stars(np.zeros(count, np.int64), np.zeros((count, 3)), np.zeros(count), colour)
    return illuminate(case.scene, stars)


def colour_correction(case: Case, bp_rp: Floats) -> Floats:
    """Magnitude (n,) of stars in this camera minus the magnitude of sunlike stars of the same G.

    bp_rp  (n,) BP - RP; NaN if unknown
    """
    light, instrument = light_by_colour(case, np.append(COLOURS, np.nan)), case.instrument
    rate, _ = electron_rate(light, instrument.detector, throughput(instrument))
    fainter = -2.5 * np.log10(rate[:-1] / rate[-1])
    return np.where(np.isnan(bp_rp), 0.0, np.interp(bp_rp, COLOURS, fainter))


def mean_colour(case: Case, bp_rp: Floats) -> Floats:
    """Mean detected wavelength (n,) of stars, metre.

    bp_rp  (n,) BP - RP; NaN means sunlike
    """
    return _wavelengths(bp_rp, mean_by_colour(case))


def mean_by_colour(case: Case) -> tuple[float, ...]:
    """Mean detected wavelengths of stars of COLOURS, and of a sunlike star; metre.

    The values do not depend on the aperture, to the last bit.
    """
    light, instrument = light_by_colour(case, np.append(COLOURS, np.nan)), case.instrument
    return tuple(mean_wavelength(light, instrument.detector, instrument.response).tolist())


@kept(4)
def sorted_wavelengths(selection: Selection, mean: tuple[float, ...]) -> Floats:
    """Mean detected wavelengths (n,) of a catalogue's stars, sorted; cached for the last 4.

    mean  as `mean_by_colour` gives it
    """
    return np.sort(_wavelengths(open_sky(selection).stars.colour, mean))


def _wavelengths(bp_rp: Floats, mean: tuple[float, ...]) -> Floats:
    return np.where(np.isnan(bp_rp), mean[-1], np.interp(bp_rp, COLOURS, mean[:-1]))


@dataclass(frozen=True, eq=False)
class SeparableStars:
    """Stars of a catalogue; stars too close for the tracker's index count as one.

    sky   these stars, brightest first
    name  (n,) index of each star in the catalogue; for merged stars, of the brightest
    """

    sky: Sky
    name: Ints

    def places(self, count: int) -> Ints:
        """Index of each of `count` stars of the catalogue among these stars; -1 if it is merged."""
        place = np.full(count, -1)
        place[self.name] = np.arange(len(self.name))
        return place


def index_resolution(camera: Camera) -> float:
    """Radian, distance within which the index merges stars; equal for cameras of similar field."""
    return indexed_field(camera) / POINTS


@lru_cache(maxsize=32)
def separated(selection: Selection, resolution: float) -> SeparableStars:
    """The stars of a catalogue, merged as in an index of a resolution (radian).

    Cached for the last 32 pairs of arguments, because a search uses them again.
    """
    pair, chord = _close(selection, 2.0 ** math.ceil(math.log2(resolution)))
    near = pair[chord <= 2 * math.sin(resolution / 2)]
    stars, name = merged(open_sky(selection).stars, resolution, near)
    order = np.argsort(stars.magnitude_g, kind="stable")
    return SeparableStars(Sky(stars[order]), name[order])


@kept(4)
def _close(selection: Selection, radius: float) -> tuple[Ints, Floats]:
    """Pairs (k, 2) of stars of a catalogue within a radius, by rank; and their distances
    (chord)."""
    tree = _tree_of(selection)
    pair = tree.query_pairs(2 * math.sin(radius / 2), output_type="ndarray")
    apart = tree.data[pair[:, 0]] - tree.data[pair[:, 1]]
    return pair, np.linalg.norm(apart, axis=1)


# Most pairs whose images may disturb each other. By hand: several seconds, half a gigabyte.
MOST_PAIRS = 5_000_000
CROWDED = 8  # pairs over the number for evenly distributed stars, for which memory suffices


@kept(8)
def near_pairs(selection: Selection, radius: float, faintest: float) -> Ints:
    """Pairs (2, k) of close stars of a catalogue; the first is not fainter than a limit.

    radius   radian, largest distance of the two stars
    faintest  magnitude of the faintest first star
    Returns  indices into the catalogue
    Raises   Refused if there are more than MOST_PAIRS
    """
    tree, magnitude = _tree_of(selection), open_sky(selection).stars.magnitude_g
    rank = np.argsort(magnitude, kind="stable")
    bright = int((magnitude <= faintest).sum())
    chord, seen = 2 * math.sin(min(radius, math.pi) / 2), cKDTree(tree.data[:bright])
    pairs = bright * len(magnitude) * chord**2 / 4  # if they were evenly distributed
    if pairs > MOST_PAIRS / CROWDED:
        pairs = int(seen.count_neighbors(tree, chord))
    if pairs > MOST_PAIRS:
        raise Refused(
            "instrument.optics.focal_length must be so long that stars do not overlap: within "
            f"{radius / deg:.3g} deg, over which images of two stars disturb each other, each of "
            f"{bright} stars has {pairs / bright:.0f} others, more than {MOST_PAIRS / bright:.0f}; "
            "a brighter catalog.limit_g, or smaller pixels, reduce this number",
            key="instrument.optics.focal_length",
        )
    near = seen.sparse_distance_matrix(tree, chord, output_type="ndarray")
    near = np.array([near["i"], near["j"]])
    near = near[:, near[0] != near[1]]
    return np.asarray(rank[near[:, np.lexsort(near[::-1])]])


@lru_cache(maxsize=4)
def _tree_of(selection: Selection) -> cKDTree:
    """The directions of the stars of a catalogue, by rank in brightness."""
    stars = open_sky(selection).stars
    direction = stars.direction[np.argsort(stars.magnitude_g, kind="stable")]
    # Built in half the time of a balanced tree, and as fast in the search for pairs.
    return cKDTree(direction, balanced_tree=False, compact_nodes=False)
