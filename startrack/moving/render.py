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
    MovingCamera,
    camera_of,
    frame_nodes,
    frame_times,
    sight_of,
)
from startrack.moving.study import MovingDesign

SHIFT = 2  # pixel, by which frames are shifted at most
ROOM = 3  # pixel beyond the image of the object at both ends of its motion
FAINTEST_STAR, BRIGHTEST_STAR, GROWTH = 18.0, 8.0, 0.33  # G; ln10 N over G, of faint stars


class SearchedField(NamedTuple):
    """A field and its frames, but for the object.

    size     pixel, a side of the part of the field around the object
    place    (2,) pixel of the object at the middle time, from the middle of that part
    angle    radian, of its motion from the columns
    speed    (2,) pixel / second
    stars    (n, 3) pixel along columns and rows from the middle, and electron / second
    sight    (images, frames, nodes, 2) pixel, by which the field is shifted in each frame
    shifts   (images, frames, 2) pixel, whole, by which frames are shifted back
    rest     (images, 2) pixel, by which the field is still shifted in each image, as measured
    streams  of the noise
    """

    size: int
    place: Floats
    angle: float
    speed: Floats
    stars: Floats
    sight: Floats
    shifts: Ints
    rest: Floats
    streams: Streams


def field_of(design: MovingDesign, seed: int, number: int) -> SearchedField:
    """The field of a trial: random place, direction, stars and motion of the camera.

    Each frame's place is measured by the centres of gravity of its guide stars.
    """
    camera, own, streams = camera_of(design), design.moving_object, Streams(seed, 2 * number)
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
    stars = np.column_stack([where, camera.rate * 10 ** (-0.4 * bright)])
    sight = sight_of(design, streams)
    seen = _guide_places(design, camera, sight, Streams(seed, 2 * number + 1))
    shifts = np.clip(np.rint(seen), -SHIFT, SHIFT).astype(int)
    rest = (seen - shifts).mean(1)
    return SearchedField(size, place, angle, speed, stars, sight, shifts, rest, streams)


def _guide_places(
    design: MovingDesign, camera: MovingCamera, sight: Floats, streams: Streams
) -> Floats:
    """Measured shift (images, frames, 2) of each frame, by guide stars of known places."""
    own, detector = design.moving_object, design.instrument.detector
    random, (_, weights) = streams("guide stars"), frame_nodes(design)
    inside = random.uniform(-0.5, 0.5, (own.guides, 2))
    rate = camera.rate * 10 ** (-0.4 * own.guide_g)
    side = 2 * (COG + SHIFT) + 1
    flat = sight.reshape(-1, *sight.shape[2:])
    shown = np.stack(
        [
            points(camera, flat + star, weights, side) * (rate * detector.exposure)
            for star in inside
        ],
        1,
    )
    charge = _read(design, shown.reshape(-1, side, side), streams).reshape(shown.shape)
    level = camera.sky
    clear = charge - level
    # Windows follow the field by whole pixels.
    place = np.arange(side) - side // 2
    middle = np.rint(np.einsum("fnx,n->fx", flat, weights)).astype(int)
    around, below = (np.abs(place - middle[:, axis : axis + 1]) <= COG for axis in (0, 1))
    window = below[:, None, :, None] * around[:, None, None, :]
    total = (clear * window).sum((2, 3))
    x = (clear * window * place).sum((2, 3)) / total
    y = (clear * window * place[:, None]).sum((2, 3)) / total
    shift = np.stack([(x - inside[:, 0]).mean(1), (y - inside[:, 1]).mean(1)], -1)
    return shift.reshape(*sight.shape[:2], 2)


def points(camera: MovingCamera, place: Floats, weights: Floats, size: int) -> Floats:
    """Images (f, size, size) of a point at places (f, nodes, 2) from the middle, over nodes.

    Accuracy  numerical: the nearest sample of the PSF, half a sample of 1 / 26 pixel away at most.
    """
    table, step = camera.psf.table, camera.psf.oversampling
    padded = np.pad(table, 1)
    middle, last = len(padded) // 2, len(padded) - 1
    side = np.arange(size) - size // 2
    total = np.zeros((len(place), size, size))
    for node, weight in enumerate(weights):
        index = np.rint((side - place[:, node, :, None]) * step).astype(int) + middle
        index = np.clip(index, 0, last)
        total += weight * padded[index[:, 1, :, None], index[:, 0, None, :]]
    return total


def _read(design: MovingDesign, light: Floats, streams: Streams) -> Floats:
    """Electrons (f, h, w) that frames (f, h, w) of expected light show."""
    camera, detector = camera_of(design), design.instrument.detector
    flat = light.reshape(-1, light.shape[-1]) + camera.sky
    device = replace(detector, rows=flat.shape[0], columns=flat.shape[1])
    if (
        gain := response(replace(detector, rows=light.shape[1], columns=light.shape[2]))
    ) is not None:
        flat = (flat.reshape(light.shape) * gain).reshape(flat.shape)
    numbers = read_out(flat + camera.dark, device, streams)
    charge = (numbers - float(detector.offset)) * detector.electrons_per_dn - camera.dark
    return np.asarray(charge.reshape(light.shape))


def added_images(design: MovingDesign, field: SearchedField, flux: float) -> Floats:
    """Images (images, h, w) in electrons of a field with an object of a flux in microjansky.

    The noise of a field is the same for any flux: one random number a pixel.

    Returns  images whose middle is that of `SearchedField`, without the edge that shifts take
    """
    camera, own, detector = camera_of(design), design.moving_object, design.instrument.detector
    exposure, size = detector.exposure, field.size
    time = frame_times(design)
    path = field.place + time[..., None] * field.speed + field.sight
    _, weights = frame_nodes(design)
    flat = (own.images * own.frames, len(weights), 2)
    light = points(camera, path.reshape(flat), weights, size) * camera.electrons(flux, exposure)
    for x, y, rate in field.stars:
        at = field.sight.reshape(flat) + np.array([x, y])
        light += points(camera, at, weights, size) * (rate * exposure)
    charge = _read(design, light, field.streams)
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
