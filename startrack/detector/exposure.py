"""Exposure: the inputs of a frame -> expected electrons, and a Frame."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import Floats, Light, Refused, kept
from startrack.detector import collect
from startrack.detector.ageing import Flickering, trailed
from startrack.detector.collect import carry, diffuse
from startrack.detector.law import Tables, expected_signal, law_of, unrounded_numbers
from startrack.detector.maps import device_streams, flickering, response
from startrack.detector.mosaic import ColourMosaic
from startrack.detector.parameters import Detector
from startrack.detector.readout import read_out
from startrack.detector.stamp import stamp, stamp_paths

Turn = Callable[[Floats], Floats]  # seconds (m,) -> rotation vectors (m, 3) as in LineOfSight
# Starts (p,), steps (j,) -> rotation vectors at all sums (p, j, 3).
MotionFunction = Callable[[Floats, Floats], Floats]
Places = tuple[Floats, Floats, Floats]

BATCH = 2**18  # number of positions that are projected at once; by hand: memory against calls
MIDDLE = np.zeros(1)
# Iterations for the time of a star's row; each multiplies the error by row_delay * rows per second.
ITERATIONS = 4


def at_once(
    direction: Floats, path: core.LineOfSight, icrs_to_camera: Rotation, camera: core.Camera
) -> Iterator[Places]:
    """Points of the path in batches: their weights (m,) and the stars' pixels x, y (m, n)."""
    # (m, 3, 3): rotations of the sky in camera axes.
    attitude = Rotation.from_rotvec(path.rotation).as_matrix() @ icrs_to_camera.as_matrix()
    together = max(BATCH // max(len(direction), 1), 1)
    for start in range(0, len(attitude), together):
        some = slice(start, start + together)
        towards = direction @ attitude[some].transpose(0, 2, 1)
        pixel = np.ascontiguousarray(camera.project(towards.reshape(-1, 3)).T)
        x, y = pixel.reshape(2, *towards.shape[:2])
        yield path.weight[some], x, y


def row_by_row(
    direction: Floats,
    path: core.LineOfSight,
    icrs_to_camera: Rotation,
    camera: core.Camera,
    row_delay: float,
    motion_function: MotionFunction,
) -> Iterator[Places]:
    """`at_once` for a rolling shutter: each row is exposed `row_delay` after the previous row.

    A star is exposed at the time of its row. The attitude is valid at the middle of the exposure of
    the middle row.

    motion_function  motion of the camera, also before and after the exposure
    Accuracy  model: all rows of a star's image share the time of its middle, so that the image is
              not sheared.
    """
    here = icrs_to_camera.apply(direction)

    def position(start: Floats, step: Floats) -> Floats:
        turned = Rotation.from_rotvec(motion_function(start, step).reshape(-1, 3))
        towards = turned.apply(np.repeat(here, len(step), axis=0))
        return camera.project(towards).reshape(len(start), len(step), 2)

    def delay(row: Floats) -> Floats:
        inside = np.clip(np.nan_to_num(row), 0, camera.rows - 1)
        return row_delay * (inside - (camera.rows - 1) / 2)

    delays = np.zeros(len(direction))
    for _ in range(ITERATIONS):
        delays = delay(position(delays, MIDDLE)[:, 0, 1])
    together = max(BATCH // max(len(direction), 1), 1)
    for start in range(0, len(path.time), together):
        some = slice(start, start + together)
        yield path.weight[some], *np.ascontiguousarray(position(delays, path.time[some]).T)


FRAME_BYTES = 56  # memory per pixel while a frame is made and searched; 42 to 52 were measured


@dataclass(frozen=True, eq=False)
class Exposure:
    """All inputs of a frame except its noise.

    light            light at the entrance pupil
    line_of_sight    motion of the line of sight in the exposure
    icrs_to_camera   attitude at the middle of the exposure (of the middle row)
    camera           true camera
    throughput       (k,) electron m^2 / photon in each spectral bin, area of the aperture times
                     transmission times quantum efficiency
    motion_function  motion of the camera at any time; needed by a rolling shutter
    residual_charge  (rows, columns) electron, the expected electrons of the previous frame; the
                     detector adds its fraction `lag` of them; None: none, as in a first frame
    of_colours       (3, k) throughput of red, green and blue pixels; needed by a mosaic
    """

    light: Light
    psf: core.Psf | core.FieldPsf
    line_of_sight: core.LineOfSight
    icrs_to_camera: Rotation
    camera: core.Camera
    detector: Detector
    throughput: Floats
    motion_function: MotionFunction | None = None
    residual_charge: Floats | None = None
    of_colours: Floats | None = None


def expose(exposure: Exposure, streams: core.Streams) -> core.Frame:
    """One frame with its noise. Exceptions and accuracy are those of `expected`."""
    electrons, detector = expected(exposure), exposure.detector
    _, sky = arriving(exposure.light, exposure.camera, detector, exposure.throughput)
    # For a uniform background, the residual charge of the previous frame equals the charge left
    # behind.
    evened = detector if exposure.residual_charge is None else replace(detector, lag=0.0)
    varied = exposure.light.diffuse or exposure.of_colours is not None
    tables = None if varied else collect.background_tables(evened, sky)
    return frame_of(electrons, detector, streams, tables)


def frame_of(
    electrons: Floats,
    detector: Detector,
    streams: core.Streams,
    tables: Tables | None = None,
    state: Flickering | None = None,
) -> core.Frame:
    """Read out expected electrons (rows, columns) as a Frame, with the meaning of its numbers.

    state  state of the pixels that flicker; None: a random state
    """
    if detector.age and detector.age.flicker:
        state = state or flickering(detector, streams)
        assert state
        electrons = state.add_to(electrons, detector.exposure)
    if detector.age and detector.age.deferred:
        top = detector.region.top if detector.region else 0
        electrons = trailed(electrons, detector.age.deferred, top)
    return to_frame(read_out(electrons, detector, streams, tables), detector)


def to_frame(image: NDArray[np.number], detector: Detector) -> core.Frame:
    """An image as a Frame, with the meaning of its numbers by the detector."""
    return core.Frame(
        image,
        detector.exposure,
        detector.electrons_per_dn,
        float(detector.offset),
        detector.noise,
        excess_noise=detector.excess_noise,
    )


def expected(exposure: Exposure) -> Floats:
    """The expected electrons of each pixel: stars along their paths, background, dark current.

    Returns   (rows, columns) electron
    Raises    ValueError if camera and detector differ in size, or for a line detector. TypeError if
              a rolling shutter has no `motion_function`, or a mosaic no `of_colours`.
    Accuracy  model: the solid angle of a pixel is that on the boresight.
    """
    light, camera, detector = exposure.light, exposure.camera, exposure.detector
    if detector.mosaic:
        return _behind_mosaic(exposure, detector.mosaic)
    if detector.scan:
        raise Refused("detector must be a matrix where a frame is exposed at once, got lines")
    if (camera.rows, camera.columns) != (detector.rows, detector.columns):
        raise Refused(
            f"camera and detector must have the same size, got {camera.columns} x {camera.rows} "
            f"and {detector.columns} x {detector.rows} pixel"
        )
    core.require_memory(
        FRAME_BYTES * detector.rows * detector.columns,
        f"a frame of {detector.columns} x {detector.rows} pixels",
    )
    # Photons.
    star, sky = arriving(light, camera, detector, exposure.throughput)
    view = exposure.line_of_sight, exposure.icrs_to_camera, camera, detector
    places = seen(light.direction, *view, exposure.motion_function)
    # Charge.
    electrons = collect.background(detector, sky).copy()
    glow = collect.diffuse_electrons(light, camera, detector, exposure.throughput)
    if glow is not None:
        electrons += collect.apply_response(glow, detector)
    colour = None
    if isinstance(exposure.psf, core.FieldPsf):
        colour = collect.mean_wavelength(light, detector, exposure.throughput)
    draw(electrons, exposure.psf, places, star, detector, colour)
    return carry(electrons, exposure.residual_charge, detector.lag) if detector.lag else electrons


def _behind_mosaic(exposure: Exposure, mosaic: ColourMosaic) -> Floats:
    """Expected electrons (rows, columns), each pixel by the throughput of its colour."""
    if exposure.of_colours is None:
        raise TypeError("of_colours must be given if the detector has a mosaic, got None")
    detector = replace(exposure.detector, mosaic=None)
    images = [
        expected(replace(exposure, detector=detector, throughput=throughput))
        for throughput in exposure.of_colours
    ]
    at = (detector.region.top, detector.region.left) if detector.region else (0, 0)
    return np.asarray(np.choose(mosaic.colours(detector.rows, detector.columns, *at), images))


def arriving(
    light: Light, camera: core.Camera, detector: Detector, throughput: Floats
) -> tuple[Floats, float]:
    """Electrons of each star (n,), and of the sky in a pixel of mean response, in the exposure."""
    star, sky = collect.electron_rate(light, detector, throughput)
    return star * detector.exposure, float(sky) * detector.exposure / camera.focal_length_px**2


def seen(
    direction: Floats,
    path: core.LineOfSight,
    icrs_to_camera: Rotation,
    camera: core.Camera,
    detector: Detector,
    motion_function: MotionFunction | None,
) -> Iterable[Places]:
    """Places of the stars during the exposure, with its shutter."""
    view = direction, path, icrs_to_camera, camera
    if not detector.row_delay:
        return at_once(*view)
    if motion_function is None:
        raise TypeError("motion_function must be given if row_delay is not zero, got None")
    return row_by_row(*view, detector.row_delay, motion_function)


def draw(
    electrons: Floats,
    psf: core.Psf | core.FieldPsf,
    places: Iterable[Places],
    star: Floats,
    detector: Detector,
    colour: Floats | None = None,
) -> None:
    """Add the electrons of stars to the pixels, in place.

    places  batches of points of the paths: weights (m,), x and y (m, n)
    star    (n,) electron of each star in the whole exposure
    colour  (n,) metre, mean wavelength of each star's light; needed by a FieldPsf
    """
    gain = response(detector)
    image = np.zeros_like(electrons) if detector.crosstalk else electrons
    for weight, x, y in places:
        if isinstance(psf, core.FieldPsf):
            x, y, part = psf.split(x, y, star, weight, colours(colour))
        else:
            part = star[:, None]
        stamp_paths(image, psf, weight, x, y, part, gain)
    if detector.crosstalk:
        electrons += diffuse(image, detector.crosstalk)


def colours(colour: Floats | None) -> Floats:
    """The colours of stars, which a FieldPsf needs. Raises TypeError if they are None."""
    if colour is None:
        raise TypeError("colour must be given if the image varies with it, got None")
    return colour


@kept(2)
def dark_frames(detector: Detector, frames: int) -> tuple[Floats, float]:
    """Mean of dark frames of a device, and the noise of a pixel in one of them.

    The noise of the mean belongs to the device: it is the same in all trials.

    detector  the detector at the time when the frames are taken
    Returns   (rows, columns) digital number, read-only; noise of a median pixel, digital number rms
    Raises    ValueError for a detector of lines.
    """
    if detector.scan:
        raise Refused("dark_map must be left out for a detector that scans")
    # On the ground there are no particle hits, and no residual charge of stars.
    detector = replace(detector, hits=None, lag=0.0)
    electrons, tables = collect.background(detector, 0.0), collect.background_tables(detector, 0.0)
    seed = int(device_streams(detector)("dark frames").integers(2**62))
    total = np.zeros((detector.rows, detector.columns))
    for number in range(frames):
        total += read_out(electrons, detector, core.Streams(seed, number), tables)
    total /= frames
    total.flags.writeable = False
    step = detector.electrons_per_dn
    shot_noise = math.sqrt(detector.excess_noise * float(np.median(electrons)))
    noise = math.hypot(shot_noise, detector.noise) / step
    return total, math.hypot(noise, 1 / math.sqrt(12))


def star_grid(
    place: Floats,
    flux: Floats,
    side: int,
    smear: Floats,
    psf: core.Psf,
    detector: Detector,
    sky: float,
    companions: tuple[Floats, Floats] | None = None,
    dark: Floats | None = None,
    reach: int | None = None,
) -> tuple[core.Frame, Floats]:
    """Expected digital numbers of stars, each in the middle of its cell.

    Cells in a row have different places of the star; rows have different fluxes. Cells in the same
    column have pixels with the same random response and dark signal.

    place       (c, 2) x and y (pixel) from the middle of the cell
    flux        (r,) electron
    side        pixel, odd, of a cell
    smear       (m, 3) weight, x and y (pixel) of the points of a star's path
    sky         electron of the uniform background in a pixel of mean response
    companions  another star in each cell: (c, 2) x and y (pixel) from the star, and (r,) electron;
                None: no such star
    dark        (k c, side, side) electron above the dark signal of all pixels: the c places are
                repeated k times in a row; None: zero
    reach       pixel, from the middle of a cell to its farthest pixel in the frame: the frame has
                the middles of the cells alone; None: whole cells
    Returns     Frame of numbers that are not rounded, and (r k c, 2) pixel, positions of the stars
    Accuracy    model: light that leaves the row of cells is lost.
    """
    count = len(place) if dark is None else len(dark)
    seen = side if reach is None else min(2 * reach + 1, side)
    size = FRAME_BYTES * len(flux) * count * seen**2
    core.require_memory(size, f"images of {len(flux) * count} stars of {seen} x {seen} pixels")
    middle = np.column_stack([np.arange(len(place)) * side, np.zeros(len(place), int)]) + side // 2
    stars, electrons = middle + place, np.full((len(flux), seen, count * seen), sky)
    every = [(stars, flux)]
    if companions:
        every.append((stars + companions[0], companions[1]))
    for at, light in every:
        image = np.zeros((side, len(place) * side))
        for weight, dx, dy in smear:
            stamp(image, psf, at[:, 0] + dx, at[:, 1] + dy, np.full(len(at), weight))
        image = _middles(image, side, seen)
        electrons += light[:, None, None] * np.tile(image, count // len(place))
    if detector.prnu:
        electrons *= _response_of_grid(detector, side, count, seen)
    if detector.crosstalk:
        electrons = diffuse(electrons.reshape(-1, count * seen), detector.crosstalk)
        electrons = electrons.reshape(len(flux), seen, -1)
    electrons += detector.dark_rate * detector.exposure
    if dark is not None:
        electrons += _middles(dark.transpose(1, 0, 2).reshape(side, count * side), side, seen)
    law = law_of(detector)
    numbers = unrounded_numbers(expected_signal(electrons.reshape(-1, count * seen), law), law)
    row, column = np.divmod(np.arange(len(flux) * count), count)
    position = np.column_stack([column, row]) * seen + seen // 2
    return to_frame(numbers, detector), position + np.resize(place, position.shape)


@kept(2)
def _response_of_grid(detector: Detector, side: int, count: int, seen: int) -> Floats:
    """Relative response of the pixels of a row of cells; kept for the last 2 grids."""
    draw = device_streams(detector)("response of a grid").standard_normal((side, count * side))
    return np.maximum(1 + detector.prnu * _middles(draw, side, seen), 0.0)


def _middles(strip: Floats, side: int, seen: int) -> Floats:
    """The middle pixels (seen, n seen) of each cell of a row of cells (side, n side)."""
    part = slice((side - seen) // 2, (side + seen) // 2)
    return strip.reshape(side, -1, side)[part, :, part].reshape(seen, -1)
