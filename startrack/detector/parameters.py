"""Detector: pixels, exposure, noise, converter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from startrack.checks import non_negative, positive, whole, within
from startrack.curve import ALL, Curve
from startrack.units import Unit


@dataclass(frozen=True)
class Detector:
    """A matrix of pixels with a global shutter, in the terms of EMVA 1288 (release 4.0).

    columns, rows       pixel
    pixel_pitch         metre
    exposure            second
    quantum_efficiency  electron / photon over wavelength
    fill_factor         1, share of a pixel that detects
    dark_current        electron / second
    read_noise          electron rms, temporal dark noise of the signal chain
    prnu                1, rms of the photo response over the pixels
    full_well           electron
    bits                of the converter; its largest number is the full well
    offset              digital number of an empty pixel
    pixel_rate          pixel / second of the read-out, which sets the update rate
    device_seed         names the copy of the detector: its PRNU map
    """

    columns: int
    rows: int
    pixel_pitch: Annotated[float, Unit("m", "um")]
    exposure: Annotated[float, Unit("s", "ms")]
    quantum_efficiency: Curve = ALL
    fill_factor: float = 1.0
    dark_current: Annotated[float, Unit("electron / s")] = 0.0
    read_noise: Annotated[float, Unit("electron")] = 0.0
    prnu: float = 0.0
    full_well: Annotated[float, Unit("electron")] = 50e3
    bits: int = 12
    offset: int = 0
    pixel_rate: Annotated[float, Unit("pix / s", "Mpix / s")] = 40e6
    device_seed: int = 0

    def __post_init__(self) -> None:
        whole(1, 2**16, columns=self.columns, rows=self.rows)
        positive(pixel_pitch=self.pixel_pitch, exposure=self.exposure, full_well=self.full_well)
        within(0.01, 1, fill_factor=self.fill_factor)
        non_negative(dark_current=self.dark_current, read_noise=self.read_noise)
        within(0, 0.5, prnu=self.prnu)
        whole(1, 16, bits=self.bits)
        whole(0, 2**self.bits - 1, offset=self.offset)
        positive(pixel_rate=self.pixel_rate)
        whole(0, 2**63 - 1, device_seed=self.device_seed)

    @property
    def electrons_per_dn(self) -> float:
        """Electron per digital number, the inverse of EMVA 1288's system gain K.

        Source: Krutz et al. (2011), eq. (5).
        """
        return self.full_well / (2**self.bits - 1)

    @property
    def update_rate(self) -> float:
        """Frames per second, exposure and read-out one after the other."""
        return 1 / (self.exposure + self.rows * self.columns / self.pixel_rate)

    @property
    def data_rate(self) -> float:
        """Bit per second."""
        return self.rows * self.columns * self.bits * self.update_rate
