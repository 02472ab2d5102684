"""Maps of one device: response, dark current and read noise of each pixel."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from startrack.core import Floats, Streams, kept, require_memory
from startrack.detector.ageing import Flickering, aged
from startrack.detector.imperfections import Defects
from startrack.detector.parameters import Detector

BYTES = 40  # memory per pixel of a map while it is drawn; measured
# Parameters on which the maps depend, in addition to the size of the image and age.
MAPPED = (
    *("prnu", "dark_current", "defects", "read_noise_spread"),
    *("binning", "region", "device_seed"),
)


def response(detector: Detector) -> Floats | None:
    """Photo response of each pixel over the mean (rows, columns); None if all are equal.

    Binned pixels have the mean of their pixels.
    """
    defects = detector.defects
    if not (detector.prnu or (defects and (defects.dead or defects.dead_columns))):
        return None
    device = _device(detector)
    if device.age:  # the response is the same at any age
        device = replace(device, age=None, thermal=None, pixel_pitch=1.0)
    return _response(device)


def dark(detector: Detector) -> Floats | float:
    """Dark current of each pixel (rows, columns), or one value for all, electron / second.

    Binned pixels have the sum of their pixels.
    """
    defects = detector.defects
    if not ((defects and (defects.dsnu or defects.hot)) or detector.age):
        return detector.dark_rate
    growth = detector.thermal.growth if detector.thermal else 1.0
    return _dark(_device(detector)) * growth


def flickering(detector: Detector, streams: Streams) -> Flickering | None:
    """The pixels with a random telegraph signal, in a random state; None if there are none."""
    if not (detector.age and detector.age.flicker):
        return None
    return Flickering(detector.age.flicker, np.asarray(dark(detector)), streams)


def read_noise(detector: Detector) -> Floats | float:
    """Read noise of each pixel (rows, columns), or one value for all, electron rms.

    It is lognormal. The long tail represents pixels with random telegraph noise. The histograms of
    Fowler et al. (2013), Read noise distribution modeling for CMOS image sensors, International
    Image Sensor Workshop, have such a tail; its shape is an assumption.
    """
    if not detector.read_noise_spread:
        return detector.read_noise
    return detector.read_noise * _spread(_device(detector))


def device_streams(detector: Detector) -> Streams:
    """Random streams of a device, the same in all trials."""
    return Streams(detector.device_seed, 0)


@lru_cache(maxsize=16)
def _device(detector: Detector) -> Detector:
    """The detector with only the parameters of the maps: designs that agree in them share maps."""
    same = {name: getattr(detector, name) for name in MAPPED}
    pitch = 1.0
    if detector.age:
        pitch, thermal = detector.pixel_pitch, detector.thermal
        same["age"] = replace(detector.age, flicker=None, sensitivity_loss=0.0, transfer_loss=0.0)
        same["thermal"] = thermal and replace(
            thermal, temperature=thermal.reference, capacitance=0.0
        )
    return Detector(detector.columns, detector.rows, pitch, 1.0, **same)


@kept(2)
def _response(device: Detector) -> Floats:
    array = photo_response(_array(device), device.prnu, device.defects, device_streams(device))
    return _frozen(_binned(device, array) / device.binning**2)


@kept(4)
def _dark(device: Detector) -> Floats:
    streams, defects = device_streams(device), device.defects or Defects()
    array = dark_response(_array(device), device.dark_current, defects, streams)
    if device.age:
        array = aged(array, device.age, device.pixel_pitch**2, *device.of_age, streams)
    return _frozen(_binned(device, array))


@kept(2)
def _spread(device: Detector) -> Floats:
    draw = device_streams(device)("read noise").standard_normal((device.rows, device.columns))
    return _frozen(np.exp(device.read_noise_spread * draw))


def photo_response(
    shape: tuple[int, int], prnu: float, defects: Defects | None, device: Streams
) -> Floats:
    """Response of each pixel over the mean: normal of rms `prnu`, at least 0; 0 for dead pixels."""
    response = np.ones(shape)
    if prnu:
        response += prnu * device("photo response").standard_normal(shape)
        np.maximum(response, 0.0, out=response)
    if defects and defects.dead:
        response[device("dead pixels").random(shape) < defects.dead] = 0.0
    if defects and defects.dead_columns:
        order = device("dead columns").permutation(shape[1])
        response[:, order[: defects.dead_columns]] = 0.0
    return response


def dark_response(
    shape: tuple[int, int], current: float, defects: Defects, device: Streams
) -> Floats:
    """Dark current of each pixel, electron / second at the reference temperature."""
    dark = np.full(shape, current)
    if defects.dsnu:
        dark += defects.dsnu * device("dark current").standard_normal(shape)
        np.maximum(dark, 0.0, out=dark)
    if defects.hot:
        choice, size = device("hot pixels").random((2, *shape))
        dark -= np.where(choice < defects.hot, defects.hot_current * np.log1p(-size), 0.0)
    return dark


def _array(device: Detector) -> tuple[int, int]:
    """Rows and columns of the array from which the image is read."""
    rows, columns = device.rows * device.binning, device.columns * device.binning
    if device.region:
        rows, columns = device.region.array_rows, device.region.array_columns
    require_memory(
        BYTES * rows * columns, f"the map of an array of {columns} x {rows} pixels of a device"
    )
    return rows, columns


def _binned(device: Detector, array: Floats) -> Floats:
    """The sum over the array's pixels in each pixel of the image."""
    size, rows, columns = device.binning, device.rows, device.columns
    top, left = (device.region.top, device.region.left) if device.region else (0, 0)
    array = array[top : top + rows * size, left : left + columns * size]
    return array.reshape(rows, size, columns, size).sum(axis=(1, 3)) if size > 1 else array


def _frozen(array: Floats) -> Floats:
    array.flags.writeable = False
    return array
