"""Case and windows of flight -> images by the design for the same stars and paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from startrack import core, detection
from startrack.core import Advance, Floats, Ints, Refused
from startrack.design import Case
from startrack.detector import Detector, dark, flickering, frame_of, response, stamp
from startrack.observation import frames_of_map, psf_at, psf_of, sky_electrons
from startrack.verification.figures import Centroids, about_common, centroids
from startrack.verification.windows_of_flight import (
    BORDER,
    Windows,
    acquired_in,
    cut_out,
    followed_stars,
)

SMOOTH = 15  # number of exposures over which a path is smoothed


def simulate(
    case: Case,
    stars: Sequence[Windows],
    devices: int,
    seed: int,
    progress: Advance | None = None,
    unknown: Sequence[Case] = (),
) -> list[list[Windows]]:
    """Images predicted by the design, of the same stars on the same paths.

    Brightness and path of each star are measured in its flown images: the median of its light, and
    the motion that it shares with the other stars, smoothed over SMOOTH exposures. Its motion
    relative to the other stars is an error of its centroids. It is predicted, and not taken from
    the flight. Pixels, noise and flicker of the design are drawn. The offset of `case` is
    subtracted from all images, as in the flown ones.

    devices   number of draws of the pixels
    progress  called with 1 after each star
    unknown   the design with other values of its unknowns, one for each device; none: all devices
              are of `case`
    Returns  [device][star], in windows that `tracker.box` places, 8 x 8 pixels each
    Raises   Refused if the numbers of `unknown` and of devices differ
    Accuracy  model: one image on the whole path of a star; a star does not move within an exposure;
              the common motion has the mean error of the centroids, some hundredths of a pixel. The
              path of a star that is seen alone has the errors of its flown centroids.
    """
    core.whole(1, 1000, devices=devices)
    if unknown and len(unknown) != devices:
        raise Refused(f"unknown must be one case for each device, got {len(unknown)}")
    box, offset, drawn = case.tracker.box, case.instrument.detector.offset, []
    tracks = [centroids(star, box) for star in stars]
    psfs = [images_of_stars(one, stars) for one in unknown or [case]]
    for number, (seen, path) in enumerate(zip(tracks, _paths(tracks), strict=True)):
        streams = core.Streams(seed, number)
        if unknown:
            parts = [
                _drawn(
                    one, seen, path, psfs[device][number], offset, 1, _of_device(streams, device)
                )
                for device, one in enumerate(unknown)
            ]
        else:
            parts = [_drawn(case, seen, path, psfs[0][number], offset, devices, streams)]
        drawn.append(list(chain.from_iterable(parts)))
        if progress:
            progress(1)
    return [list(device) for device in zip(*drawn, strict=True)]


def images_of_stars(case: Case, stars: Sequence[Windows]) -> list[core.Psf]:
    """The PSF of the design at the place of each star."""
    detector = case.instrument.detector
    return [psf_at(case.instrument, *star.place_on(detector)) for star in stars]


def _of_device(streams: core.Streams, device: int) -> core.Streams:
    """Streams of one of several detectors that see a star separately."""
    seed = int(streams(f"device {device}").integers(2**31))
    return core.Streams(seed, streams.trial)


def _paths(tracks: Sequence[Centroids]) -> list[Floats]:
    """Path (n, 2) of each star, pixel, without the motion of this star alone."""
    if len(tracks) == 1:
        return [_smoothed(tracks[0].place)]
    return [
        _smoothed(track.place - np.nan_to_num(own.off))
        for track, own in zip(tracks, about_common(tracks), strict=True)
    ]


def _smoothed(place: Floats) -> Floats:
    kernel = np.ones(SMOOTH) / SMOOTH
    padded = np.pad(place, ((SMOOTH // 2, SMOOTH // 2), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(axis, kernel, "valid") for axis in padded.T])


def fraction_in_box(psf: core.Psf, box: detection.Box) -> float:
    """Fraction of a star's light inside its box, with the star in the middle."""
    image = np.zeros((box.size + 2 * BORDER, box.size + 2 * BORDER))
    middle = np.array([(len(image) - 1) / 2])
    stamp(image, psf, middle, middle, np.ones(1))
    inner = image[BORDER:-BORDER, BORDER:-BORDER]
    return float((inner * detection.image_mask(box.size)).sum())


def _side_by_side(detector: Detector, side: Ints, devices: int, streams: core.Streams) -> Detector:
    """Several detectors of (2,) pixels, columns and rows, as the tiles of one."""
    return replace(
        detector,
        columns=int(side[0]) * devices,
        rows=int(side[1]),
        device_seed=streams.seed * 1000 + streams.trial,
        region=None,
    )


def _drawn(
    case: Case,
    star: Centroids,
    path: Floats,
    psf: core.Psf,
    offset: float,
    devices: int,
    streams: core.Streams,
) -> list[Windows]:
    """One star on detectors side by side, each a tile of one frame.

    path    (n, 2) pixel
    psf     PSF of the star
    offset  digital number that is subtracted from the images
    """
    seen, share = star.windows, fraction_in_box(psf, case.tracker.box)
    flux = float(np.median(star.total)) / share * case.instrument.detector.electrons_per_dn
    low = np.floor(path.min(axis=0)).astype(int) - 2 * BORDER
    side = np.ceil(path.max(axis=0)).astype(int) + 2 * BORDER - low
    device = _side_by_side(case.instrument.detector, side, devices, streams)
    shift = np.arange(devices) * side[0]
    gain, empty = response(device), sky_electrons(case) + np.asarray(dark(device)) * device.exposure
    state, box, settings = flickering(device, streams), case.tracker.box, case.tracker.detection
    believed, taken = psf_of(case.instrument), partial(frames_of_map, device, settings)
    plan = detection.plan_detection(settings, believed, taken)
    at = path - low
    corner = np.rint(np.column_stack([at[0, 0] + shift, np.full(devices, at[0, 1])]) + 0.5)
    corner, numbers, corners, acquired = corner.astype(np.int64), [], [], []
    for k, (x, y) in enumerate(at):
        light = np.zeros((device.rows, device.columns))
        stamp(light, psf, x + shift, np.full(devices, y), np.full(devices, flux))
        if gain is not None:
            light *= gain
        if state and k:
            state.later(float(seen.time[k] - seen.time[k - 1]))
        frame = frame_of(
            light + empty,
            device,
            core.Streams(streams.seed, 10**6 * (1 + streams.trial) + k),
            state=state,
        )
        corners.append(corner - 4)
        numbers.append(cut_out(frame.image, corner, offset))
        if seen.acquired is not None:
            acquired.append(acquired_in(frame, corner, plan))
        corner = followed_stars(frame, corner, box, plan)
    origin = np.column_stack([low[0] - shift, np.full(devices, low[1])])
    return [
        replace(
            seen,
            number=np.array([n[k] for n in numbers]),
            background=None,
            corner=np.array([c[k] for c in corners]) + origin[k],
            acquired=np.array([a[k] for a in acquired]) if acquired else None,
        )
        for k in range(devices)
    ]
