"""Told: a figure of a design that somebody measured or published."""

from scipy.special import ndtri

from startrack.core import POSITIVE, Parameters, Range, Unit, parameter

FIGURES = ("NEA", "pixel", "FOV", "accuracy", "with bias")


class Told(Parameters):
    """A published or measured error, under which what is not known of a design is estimated.

    ln(value) is normal about that of the design, with the logarithm of `factor` as its sigma.
    """

    figure: str = parameter(
        'errors that it holds: "NEA", temporal noise; "pixel", with pixel spatial errors; "FOV", '
        'with field-of-view errors, too; "accuracy", with thermo-elastic errors; "with bias"',
        limit=Range(choices=FIGURES),
    )
    axis: str = parameter(
        "across the boresight, per axis, or about it", limit=Range(choices=("across", "about"))
    )
    value: float = parameter("of the error", unit=Unit("rad", "arcsec"), limit=POSITIVE)
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

    @property
    def rms(self) -> float:
        """Radian, one sigma per axis."""
        return self.value / float(ndtri((1 + self.level) / 2))
