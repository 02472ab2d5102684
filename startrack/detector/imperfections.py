"""Thermal, Hits, Defects, Pattern: imperfections of a real detector."""

import math

import numpy as np

from startrack import core
from startrack.core import NON_NEGATIVE, POSITIVE, Floats, Ints, Parameters, Range, Unit, parameter

ELEMENTARY_CHARGE = 1.602176634e-19  # coulomb, exact in the SI of 2019


class Thermal(Parameters):
    """Temperature of the detector, growth of its dark current, reset noise.

    If `activation` is zero, the dark current doubles for each step of temperature:

        I(T) = I(reference) 2^((T - reference) / doubling)

    Otherwise it has an activation energy (diffusion: the band gap, 1.12 eV; generation: half of
    it):

        I(T) = I(reference) (T / reference)^(3/2) exp(-E / k (1 / T - 1 / reference))

    The reset noise is sqrt(k T C) / q, unless correlated double sampling removes it.

    Source: EMVA 1288 release 4.0, on the dark current, for the doubling; Widenhorn et al. (2002),
    Proc. SPIE 4669, 193, for the activation energy.
    """

    temperature: float = parameter(
        "of the pixels", unit=Unit("K", absolute=True), limit=Range(0, 500)
    )
    reference: float = parameter(
        "temperature for which the dark_current of the detector is given",
        unit=Unit("K", absolute=True),
        limit=POSITIVE,
        default=293.15,
    )
    doubling: float = parameter(
        "rise of temperature that doubles the dark current",
        unit=Unit("K"),
        limit=POSITIVE,
        default=8.0,
    )
    activation: float = parameter(
        "joule, activation energy of the dark current; 0: `doubling` is used",
        unit=Unit("J", "eV"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    capacitance: float = parameter(
        "farad, capacitance of the sense node; 0 with correlated double sampling",
        unit=Unit("F", "fF"),
        limit=NON_NEGATIVE,
        default=0.0,
    )

    @property
    def growth(self) -> float:
        """Dark current over the dark current at the reference; zero at 0 K."""
        if self.temperature == 0:
            return 0.0
        if self.activation:
            cold = 1 / self.temperature - 1 / self.reference
            power = (self.temperature / self.reference) ** 1.5
            return power * math.exp(-self.activation / core.BOLTZMANN * cold)
        return float(2 ** ((self.temperature - self.reference) / self.doubling))

    @property
    def reset_noise(self) -> float:
        """Reset noise, electron rms."""
        return math.sqrt(core.BOLTZMANN * self.temperature * self.capacitance) / ELEMENTARY_CHARGE


SAMPLES = 16  # points per pixel along a track; chosen by hand: lengths in 1/16 pixel
LEAST_COSINE = 0.01  # least cosine to the normal; one track in 10 000 has a smaller one


class Hits(Parameters):
    """Particles through the sensitive layer.

    Their number is Poisson distributed. Their flux is isotropic: for particles that cross the
    layer, the cosine of the angle to the normal is the square root of a uniform number.

    Source: the most probable charge of a minimum-ionising particle in silicon is 80 electrons per
    micrometre (Particle Data Group, Passage of particles through matter).
    """

    rate: float = parameter(
        "flux, particle / m^2 / s through the surface, from both sides",
        unit=Unit("m-2 s-1", "cm-2 s-1"),
        limit=NON_NEGATIVE,
    )
    charge: float = parameter(
        "charge, electron / m along the track",
        unit=Unit("electron / m", "electron / um"),
        limit=POSITIVE,
        default=80e6,
    )
    depth: float = parameter(
        "thickness of the sensitive layer", unit=Unit("m", "um"), limit=POSITIVE, default=10e-6
    )


def tracks(
    hits: Hits, shape: tuple[int, int], pitch: float, exposure: float, streams: core.Streams
) -> tuple[Ints, Floats]:
    """The pixels that particles hit in one exposure, and their charge.

        electrons = charge * length of the track in the pixel

    pitch     metre
    Returns   (k,) row * columns + column, increasing, and (k,) electron
    Accuracy  model: no straggling, no delta rays, no diffusion. numerical: lengths in units of 1/16
              pixel; their sum along a track is exact.
    """
    random = streams("hits")
    rows, columns = shape
    count = random.poisson(hits.rate * exposure * rows * columns * pitch**2)
    pixels, charges = [np.zeros(0, np.int64)], [np.zeros(0)]
    for x, y, square, turn in random.random((count, 4)):
        cosine = max(math.sqrt(square), LEAST_COSINE)
        length = hits.depth / cosine
        across = length * math.sqrt(1 - cosine**2) / pitch
        points = math.ceil(SAMPLES * across) + 1
        along = (np.arange(points) + 0.5) / points * across
        column = np.floor(x * columns + along * math.cos(2 * math.pi * turn)).astype(np.int64)
        row = np.floor(y * rows + along * math.sin(2 * math.pi * turn)).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        pixels.append((row * columns + column)[inside])
        charges.append(np.full(inside.sum(), hits.charge * length / points))
    pixel, index = np.unique(np.concatenate(pixels), return_inverse=True)
    electrons = np.bincount(index, np.concatenate(charges), len(pixel))
    return pixel, electrons.astype(float)


class Defects(Parameters):
    """Pixels with a deviating dark current or response, fixed for each device.

        dark current = max(mean + dsnu N(0, 1), 0) + (hot: exponential of mean hot_current)
        response     = 0 where dead

    Source: EMVA 1288 release 4.0, section 2.3, for the DSNU. The exponential tail of hot pixels is
    an assumption; proton damage has such tails (Hopkinson, Dale and Marshall 1996, IEEE
    Transactions on Nuclear Science 43, 614).
    """

    dsnu: float = parameter(
        "electron / second rms over the pixels, at the reference temperature",
        unit=Unit("electron / s"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    hot: float = parameter("fraction of the pixels that is hot", limit=Range(0, 1), default=0.0)
    hot_current: float = parameter(
        "electron / second, mean over the hot pixels, at the reference temperature",
        unit=Unit("electron / s"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    dead: float = parameter("fraction of the pixels that is dead", limit=Range(0, 1), default=0.0)
    dead_columns: int = parameter(
        "number of columns without response", limit=Range(0, 2**16), default=0
    )


LINE_NOISE = "electron rms, random in each frame"


class Pattern(Parameters):
    """Normal offsets of the signal that the pixels of a row or column share.

    Source: EMVA 1288 release 4.0, section 2.3 (row and column variances).
    """

    row: float = parameter(LINE_NOISE, unit=Unit("electron"), limit=NON_NEGATIVE, default=0.0)
    column: float = parameter(LINE_NOISE, unit=Unit("electron"), limit=NON_NEGATIVE, default=0.0)
    column_offset: float = parameter(
        "electron rms over the columns, fixed for each device",
        unit=Unit("electron"),
        limit=NON_NEGATIVE,
        default=0.0,
    )


def offsets(
    pattern: Pattern, shape: tuple[int, int], device: core.Streams, streams: core.Streams
) -> tuple[Floats, Floats]:
    """Offsets of rows (rows, 1) and of columns (columns,), electron."""
    rows, columns = shape
    down, across = np.zeros((rows, 1)), np.zeros(columns)
    if pattern.row:
        down += pattern.row * streams("row noise").standard_normal((rows, 1))
    if pattern.column:
        across += pattern.column * streams("column noise").standard_normal(columns)
    if pattern.column_offset:
        across += pattern.column_offset * device("column offset").standard_normal(columns)
    return down, across
