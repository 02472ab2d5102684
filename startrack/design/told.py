"""Told: a measured or published figure of a design."""

import math

import numpy as np
from scipy.special import ndtri

from startrack.core import POSITIVE, Floats, Parameters, Range, Refused, Unit, parameter

AXES = ("across", "about")
ERROR_FIGURES = ("NEA", "pixel", "FOV", "accuracy", "with bias")
# Figures of frames, and their units.
FRAME_FIGURES = {
    "gain": "electron / digital number",
    "read noise": "digital number",
    "PRNU": "1",
    "full well": "electron",
    "star signal": "digital number",
    "star electrons": "electron",
    "SNR": "1",
    "centroid noise": "pixel",
    "image width": "pixel",
    "common motion": "pixel",
    "limiting magnitude": "G",
    "residual": "pixel",
}
OF_STARS = "SNR", "centroid noise"  # figures of a star of a given magnitude


class Told(Parameters):
    """A published or measured figure of a design, from which its unknown values are estimated.

    It is an error, with an axis and an angle as its value, or a figure of frames of the tracker,
    with a number.

    ln(value) is normally distributed about the design's ln(value); sigma is the logarithm of
    `factor`.
    """

    figure: str = parameter(
        'name of the figure. Errors, each with all earlier ones: "NEA", temporal noise; "pixel", '
        'pixel spatial errors; "FOV", field-of-view errors; "accuracy", thermo-elastic errors; '
        '"with bias". Figures of frames: "gain", electron / digital number; "read noise", digital '
        'number; "star signal", digital number, light of a sunlike star of G = 0 in the tracker\'s '
        'box in an exposure; "star electrons", electron, the same light; "SNR", this light over '
        'its standard deviation, for a star of `magnitude`; "centroid noise", pixel rms per axis, '
        'for a star of `magnitude`; "PRNU", 1; "full well", electron; "image width", pixel, root '
        'of the second moment in the box; "common motion", pixel rms per axis, of third '
        'differences from frame to frame; "limiting magnitude", Gaia\'s G of a sunlike star at the '
        'detection threshold; "residual", pixel rms per axis over the frame, displacements of '
        "stars at the begin of life, as in a table of stars (`calibrate`)",
        limit=Range(choices=(*ERROR_FIGURES, *FRAME_FIGURES)),
    )
    axis: str | None = parameter(
        "axis of an error: across the boresight (per axis), or about it; for several heads, about "
        "the mean of their boresights",
        limit=Range(choices=AXES),
        default=None,
    )
    value: float | None = parameter(
        "of an error", unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    number: float | None = parameter(
        "value of a figure of frames, in its unit", limit=POSITIVE, default=None
    )
    magnitude: float | None = parameter(
        "Gaia's G of a sunlike star, for an SNR or a centroid noise",
        limit=Range(-30, 30),
        default=None,
    )
    level: float = parameter(
        'fraction of normal errors about one axis that do not exceed the value, such as "99.73 %"; '
        '"68.27 %" for an rms',
        limit=Range(0.5, 1 - 1e-9),
        default=0.6827,
    )
    factor: float = parameter(
        "error of the figure, as a factor: in 68 % of the cases the true value lies within this "
        "factor of it, above or below",
        limit=Range(1, 100, above=True),
        default=1.2,
    )
    heads: int = parameter(
        "number of equal and independent heads whose fused attitude has this error, each axis "
        "weighted by the inverse of its variance",
        limit=Range(1, 12),
        default=1,
    )
    angle: float | None = parameter(
        "angle between the boresights of two heads, or of neighbours among more heads, evenly on a "
        "cone; required for two or more heads",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi),
        default=None,
    )
    source: str = parameter("source of the value; it has no effect", default="")

    def __post_init__(self) -> None:
        super().__post_init__()
        of_frames = self.figure in FRAME_FIGURES
        given = {"axis": self.axis, "value": self.value, "number": self.number}
        for name, value in given.items():
            needed = (name == "number") == of_frames
            if needed != (value is not None):
                must = "must be given" if needed else "must be left out"
                unit = f", in {FRAME_FIGURES[self.figure]}" if needed and of_frames else ""
                raise Refused(f"{name} {must} for the told figure {self.figure!r}{unit}")
        if (self.magnitude is not None) != (self.figure in OF_STARS):
            must = "given" if self.figure in OF_STARS else "left out"
            raise Refused(f"magnitude must be {must} for the told figure {self.figure!r}")
        if of_frames and self.heads > 1:
            raise Refused(f"heads must be 1 for the told figure {self.figure!r}, got {self.heads}")
        if (self.angle is None) != (self.heads == 1):
            must = "must be left out for one head" if self.heads == 1 else "must be given"
            raise Refused(f"angle {must}, got heads = {self.heads}")
        widest = 2 * math.pi / self.heads
        if self.angle is not None and self.angle > widest * (1 + 1e-9):
            raise Refused(
                f"angle must be at most {math.degrees(widest):g} deg between neighbours of "
                f"{self.heads} heads, got {math.degrees(self.angle):g} deg"
            )

    @property
    def of_frames(self) -> bool:
        """Whether it is a figure of frames."""
        return self.figure in FRAME_FIGURES

    @property
    def name(self) -> str:
        """Name of the figure, with its axis or the magnitude of its star."""
        if self.magnitude is not None:
            return f"{self.figure} at G {self.magnitude:g}"
        return self.figure if self.axis is None else f"{self.figure} {self.axis}"

    @property
    def rms(self) -> float:
        """Radian, one sigma per axis, of an error."""
        assert self.value is not None
        return self.value / float(ndtri((1 + self.level) / 2))

    def of_heads(self, errors: Floats) -> tuple[Floats, Floats]:
        """The error of all heads fused, and its derivatives by the errors of one head.

            I = sum_h (1 - n n^T) / across^2 + n n^T / about^2,   error_k^2 = 1 / I_kk

        n are the boresights. The axes are along and across their mean; k is the axis of this
        figure.

        errors   (n, 2) radian rms per axis of one head, across and about
        Returns  (n,) radian rms per axis; (n, 2) 1, derivatives of the logarithm of this error by
                 the logarithms of `errors`
        """
        axis = AXES.index(str(self.axis))
        if self.angle is None:
            return errors[:, axis], np.broadcast_to(np.eye(2)[axis], errors.shape)
        slope = min(math.sin(self.angle / 2) / math.sin(math.pi / self.heads), 1.0) ** 2
        # Mean squares of the boresights' components across their mean, and along it.
        across = (slope, 0.0) if self.heads == 2 else (slope / 2, slope / 2)
        along = np.array(across if axis == 0 else (1 - slope,))[:, None]
        information = self.heads * np.stack(
            [(1 - along) / errors[:, 0] ** 2, along / errors[:, 1] ** 2]
        )
        variance = 1 / information.sum(axis=0)
        weight = (information * variance**2).sum(axis=1) / variance.sum(axis=0)
        return np.sqrt(variance.mean(axis=0)), weight.T
