"""Told: a figure of a design that somebody measured or published."""

from scipy.special import ndtri

from startrack.core import POSITIVE, Parameters, Range, Refused, Unit, parameter

ERROR_FIGURES = ("NEA", "pixel", "FOV", "accuracy", "with bias")
# Of frames, and the unit of each.
FRAME_FIGURES = {
    "gain": "electron / digital number",
    "read noise": "digital number",
    "star signal": "digital number",
    "image width": "pixel",
    "common motion": "pixel",
    "limiting magnitude": "G",
    "residual": "pixel",
}


class Told(Parameters):
    """A published or measured figure, under which what is not known of a design is estimated.

    It is an error, with an axis and an angle as its value, or a figure of frames of the tracker,
    with a number.

    ln(value) is normal about that of the design, with the logarithm of `factor` as its sigma.
    """

    figure: str = parameter(
        'errors that it holds: "NEA", temporal noise; "pixel", with pixel spatial errors; "FOV", '
        'with field-of-view errors, too; "accuracy", with thermo-elastic errors; "with bias". Of '
        'frames: "gain", electron / digital number; "read noise", digital number; "star signal", '
        "digital number of an exposure, of a sunlike star of G = 0 in the tracker's box; "
        '"image width", pixel, root of the second moment in the box; "common motion", pixel rms of '
        'an axis, of third differences from frame to frame; "limiting magnitude", Gaia\'s G of a '
        'sunlike star at the detection threshold; "residual", pixel rms of an axis over the frame, '
        "of the places of stars at the begin of life, as a table of stars has it (`calibrate`)",
        limit=Range(choices=(*ERROR_FIGURES, *FRAME_FIGURES)),
    )
    axis: str | None = parameter(
        "of an error: across the boresight, per axis, or about it",
        limit=Range(choices=("across", "about")),
        default=None,
    )
    value: float | None = parameter(
        "of an error", unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    number: float | None = parameter(
        "of a figure of frames, in its unit", limit=POSITIVE, default=None
    )
    level: float = parameter(
        'fraction of errors about one axis that are no larger, such as "99.73 %", as of a normal '
        'law; "68.27 %" of an rms',
        limit=Range(0.5, 1 - 1e-9),
        default=0.6827,
    )
    factor: float = parameter(
        "by which the value may be wrong, either way, in 68 % of such figures",
        limit=Range(1, 100, above=True),
        default=1.2,
    )
    source: str = parameter("where the value is from; it has no effect", default="")

    def __post_init__(self) -> None:
        super().__post_init__()
        of_frames = self.figure in FRAME_FIGURES
        given = {"axis": self.axis, "value": self.value, "number": self.number}
        for name, one in given.items():
            needed = (name == "number") == of_frames
            if needed != (one is not None):
                must = "must be given" if needed else "must be left out"
                raise Refused(f"{name} {must} of the told figure {self.figure!r}")

    @property
    def of_frames(self) -> bool:
        """Whether it is a figure of frames."""
        return self.figure in FRAME_FIGURES

    @property
    def name(self) -> str:
        """Name of the figure, with its axis."""
        return self.figure if self.axis is None else f"{self.figure} {self.axis}"

    @property
    def rms(self) -> float:
        """Radian, one sigma per axis, of an error."""
        assert self.value is not None
        return self.value / float(ndtri((1 + self.level) / 2))
