"""Frames of a field with stars and an object, registered on guide stars and added to images."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Ints, Streams, deg
from startrack.detector import read_out, response
from startrack.moving.camera import (
    COG,
    HALF,
    PLACES,
    ImageMotion,
    MovingCamera,
    camera_of,
    frame_nodes,
    frame_times,
    points,
    sight_of,
)
from startrack.moving.study import MovingDesign

SHIFT = 2  # pixel, largest shift of a frame
ROOM = 3  # pixel beyond the image of the object at both ends of its motion
FAINTEST_STAR, BRIGHTEST_STAR, GROWTH = 18.0, 8.0, 0.33  # G; ln10 N over G, of faint stars


class SearchedField(NamedTuple):
    """A field and its frames without the object.

    size     pixel, a side of the part of the field around the object
    place    (2,) pixel of the object at the middle time, from the middle of that part
    angle    radian, of its motion from the columns
    speed    (2,) pixel / second
    sight    (images, frames, nodes, 2) pixel, shift of the field in each frame
    shifts   (images, frames, 2) pixel, integers, shifts back of frames
    rest     (images, frames, 2) pixel, measured remaining shift of the field in each frame
    light    (images frames, size, size) electron, expected
    charge   likewise, as read out
    streams  of the noise of pixels that the object lights
    """

    size: int
    place: Floats
    angle: float
    speed: Floats
    sight: Floats
    shifts: Ints
    rest: Floats
    light: Floats
    charge: Floats
    streams: Streams


def field_of(design: MovingDesign, seed: int, number: int) -> SearchedField:
    """The field of a trial: random place, direction, stars and motion of the camera.

    Each frame's place is measured by the centres of gravity of its guide stars.
    """
    camera, own = camera_of(design), design.moving_object
    streams, guided, lit = (Streams(seed, 3 * number + part) for part in range(3))
    random = streams("moving object")
    angle = float(random.uniform(0, 2 * math.pi))
    speed = own.rate / design.pixel * np.array([math.cos(angle), math.sin(angle)])
    half = math.ceil(max(own.times) * float(np.abs(speed).max())) + HALF + ROOM + SHIFT
    size = 2 * half + 1
    place = random.uniform(-0.5, 0.5, 2)
    side = size * design.pixel / deg
    count = int(random.poisson(own.stars * side**2))
    where = random.uniform(-half, half, (count, 2))
    bright = FAINTEST_STAR + np.log10(random.uniform(1e-9, 1.0, count)) / GROWTH
    bright = np.maximum(bright, BRIGHTEST_STAR)
    rate = camera.rate * 10 ** (-0.4 * bright)
    sight = sight_of(ImageMotion.of(design), streams)
    seen = _guide_places(design, camera, sight, guided)
    shifts = np.clip(np.rint(seen), -SHIFT, SHIFT).astype(int)
    _, weights = frame_nodes(ImageMotion.of(design))
    flat = sight.reshape(-1, *sight.shape[2:])
    light = np.full((len(flat), size, size), camera.sky)
    for star, electrons in zip(where, rate * design.instrument.detector.exposure, strict=True):
        light += (
            points(camera.psf.table, camera.psf.oversampling, flat + star, weights, size)
            * electrons
        )
    if (gain := _gain(design, size)) is not None:
        light *= gain
    charge = _read(design, light, streams)
    return SearchedField(
        size=size,
        place=place,
        angle=angle,
        speed=speed,
        sight=sight,
        shifts=shifts,
        rest=seen - shifts,
        light=light,
        charge=charge,
        streams=lit,
    )


def _guide_places(
    design: MovingDesign, camera: MovingCamera, sight: Floats, streams: Streams
) -> Floats:
    """Measured shift (images, frames, 2) of each frame, by guide stars of known places.

    A star's place is its centre of gravity, corrected for the effect of pixels.
    Source: Stone (1989), Astronomical Journal 97, 1227, on centroids of undersampled stars.
    """
    own = design.moving_object
    random, (_, weights) = streams("guide stars"), frame_nodes(ImageMotion.of(design))
    inside = random.uniform(-0.5, 0.5, (own.guides, 2))
    side = 2 * (COG + SHIFT) + 1
    flat = sight.reshape(-1, *sight.shape[2:])
    shown = np.stack(
        [
            points(camera.psf.table, camera.psf.oversampling, flat + star, weights, side)
            * camera.guide
            for star in inside
        ],
        1,
    )
    light = shown.reshape(-1, side, side) + camera.sky
    if (gain := _gain(design, side)) is not None:
        light *= gain
    clear = _read(design, light, streams).reshape(shown.shape) - camera.sky
    # Windows follow the field by whole pixels.
    place = np.arange(side) - side // 2
    middle = np.rint(np.einsum("fnx,n->fx", flat, weights)).astype(int)
    around, below = (np.abs(place - middle[:, axis : axis + 1]) <= COG for axis in (0, 1))
    window = below[:, None, :, None] * around[:, None, None, :]
    total = (clear * window).sum((2, 3))
    shift = np.empty(flat[:, 0].shape)
    for axis, along in enumerate((place, place[:, None])):
        own_window = middle[:, axis, None]
        seen = (clear * window * along).sum((2, 3)) / total - own_window
        true = np.interp(seen, camera.gravity[axis], PLACES) + own_window
        shift[:, axis] = (true - inside[:, axis]).mean(1)
    return shift.reshape(*sight.shape[:2], 2)


def _gain(design: MovingDesign, size: int) -> Floats | None:
    """Relative response (size, size) of the pixels; None where all are alike."""
    return response(replace(design.instrument.detector, rows=size, columns=size))


def _read(design: MovingDesign, light: Floats, streams: Streams) -> Floats:
    """Electrons (f, h, w) that frames (f, h, w) of expected light show."""
    camera, detector = camera_of(design), design.instrument.detector
    flat = light.reshape(-1, light.shape[-1])
    device = replace(detector, rows=flat.shape[0], columns=flat.shape[1])
    numbers = read_out(flat + camera.dark, device, streams)
    charge = (numbers - float(detector.offset)) * detector.electrons_per_dn - camera.dark
    return np.asarray(charge.reshape(light.shape))


def added_images(design: MovingDesign, field: SearchedField, flux: float) -> Floats:
    """Images (images, h, w) in electrons of a field with an object of a flux in microjansky.

    Pixels that the object lights are read out again. The noise is the same for any flux: one random
    number a pixel.

    Returns  images with the middle of `SearchedField`, without the edge lost by shifts
    """
    camera, own, detector = camera_of(design), design.moving_object, design.instrument.detector
    size, half = field.size, field.size // 2
    path = field.place + frame_times(ImageMotion.of(design))[..., None] * field.speed + field.sight
    path = path.reshape(-1, *path.shape[2:])
    middle = (path.max(1) + path.min(1)) / 2
    spread = float(np.ptp(path, axis=1).max()) + len(camera.psf.table) / camera.psf.oversampling
    reach = min(math.ceil((spread + 1) / 2) + 1, half)
    middle = np.clip(np.rint(middle), reach - half, half - reach).astype(int)
    _, weights = frame_nodes(ImageMotion.of(design))
    light = points(
        camera.psf.table, camera.psf.oversampling, path - middle[:, None], weights, 2 * reach + 1
    )
    light *= camera.electrons(flux, detector.exposure)
    side = np.arange(-reach, reach + 1) + half
    rows, columns = (middle[:, axis : axis + 1] + side for axis in (1, 0))
    near = np.arange(len(path))[:, None, None], rows[:, :, None], columns[:, None, :]
    if (gain := _gain(design, size)) is not None:
        light *= gain[near[1:]]
    charge = field.charge.copy()
    charge[near] = _read(design, field.light[near] + light, field.streams)
    images = np.zeros((own.images, size - 2 * SHIFT, size - 2 * SHIFT))
    inner = size - SHIFT
    for frame, (x, y), image in zip(
        charge,
        field.shifts.reshape(-1, 2),
        np.repeat(np.arange(own.images), own.frames),
        strict=True,
    ):
        images[image] += frame[SHIFT + y : inner + y, SHIFT + x : inner + x]
    return images
