"""Settings of an explorer: number of forecasts, acceptance of designs, precision."""

from __future__ import annotations

from startrack.core import POSITIVE, Parameters, Range, parameter

COUNT = Range(1, 10**6)
FRACTION = Range(0.0, 1.0)


class ExplorerSettings(Parameters):
    """Settings for the choice of designs to forecast, and for the emulation of forecasts.

    The defaults are chosen by hand. Scores are differences of ln(error). Coordinates are those of
    the unit cube.
    """

    first_per_variable: int = parameter(
        "forecasts per variable before the first emulator", limit=COUNT, default=3
    )
    first_besides: int = parameter("further forecasts before it", limit=COUNT, default=5)
    batch: int = parameter(
        "forecasts between two fits of the emulators, the same for any number of workers",
        limit=COUNT,
        default=4,
    )
    worthwhile_gain: float = parameter(
        "fraction of the precision; a smaller expected gain does not justify a forecast",
        limit=FRACTION,
        default=0.2,
    )
    sigmas: float = parameter(
        "standard deviations by which a design may be better than predicted: 98 % of a normal law",
        limit=POSITIVE,
        default=2.0,
    )
    patience: int = parameter(
        "number of batches without sufficient gain after which emulators make no more proposals",
        limit=COUNT,
        default=4,
    )
    polish_per_variable: int = parameter(
        "largest number of forecasts per variable next to the best, when nothing else is proposed",
        limit=Range(0, 10**6),
        default=6,
    )
    polish_step: float = parameter(
        "distance of the first of these from the best, in each coordinate",
        limit=Range(1e-6, 0.5),
        default=0.02,
    )
    bad_score: float = parameter(
        "excess over the least score beyond which conditions without a weight are not forecast",
        limit=POSITIVE,
        default=0.5,
    )
    good_score: float = parameter(
        "excess over the least score up to which a design shows whether these conditions matter",
        limit=POSITIVE,
        default=0.2,
    )
    good_designs: int = parameter(
        "number of good designs that meet all limits of these conditions by far, after which "
        "they are no longer forecast",
        limit=COUNT,
        default=8,
    )
    close_part: float = parameter(
        "used fraction of a limit from which on trials are run in any condition",
        limit=FRACTION,
        default=0.5,
    )
    short_part: float = parameter(
        "fraction of a limit by which a design may miss the margin that fresh trials can confirm, "
        "and still be tried",
        limit=FRACTION,
        default=0.1,
    )
    pool: int = parameter(
        "random designs among which starts of a search are chosen", limit=COUNT, default=256
    )
    leaders: int = parameter(
        "best designs near which others are drawn, and starts that are kept", limit=COUNT, default=6
    )
    leader_spread: float = parameter(
        "standard deviation of the coordinates of designs drawn near these",
        limit=FRACTION,
        default=0.05,
    )
    same_design: float = parameter(
        "distance in each coordinate, below which two points are the same design",
        limit=FRACTION,
        default=1e-3,
    )
    clipped_objective: float = parameter(
        "excess of ln(error) over the least beyond which all designs count as equally bad",
        limit=POSITIVE,
        default=2.0,
    )
    inexact_objective: float = parameter(
        "excess of ln(error) over the least from which on an emulator need not fit a design "
        "exactly, the less so the worse it is: otherwise the worst designs would determine its "
        "lengths",
        limit=POSITIVE,
        default=0.7,
    )
    inexact_margin: float = parameter(
        "the same limit for a missed margin, on its scale", limit=POSITIVE, default=0.4
    )
    exact_per_variable: int = parameter(
        "least number of designs per variable that an emulator fits exactly", limit=COUNT, default=2
    )
    margin_width: float = parameter(
        "margin beyond which its scale grows slowly", limit=POSITIVE, default=0.2
    )
    least_chance: float = parameter(
        "fraction of the allowed unavailability below which all values are equally good",
        limit=FRACTION,
        default=1e-4,
    )
    safe_margin: float = parameter(
        "amount by which an emulated margin must be met: the emulator's error at a limit",
        limit=FRACTION,
        default=1e-3,
    )
    relaxed_limit: float = parameter(
        "fraction of a limit by which it is relaxed to compute its price",
        limit=FRACTION,
        default=0.01,
    )
    span_nodes: int = parameter(
        "number of values of each variable at which its span is searched",
        limit=Range(2, 10**4),
        default=25,
    )
    whole_span: float = parameter(
        "fraction of its range from which on a variable's span counts as the whole range",
        limit=FRACTION,
        default=0.9,
    )


DEFAULTS = ExplorerSettings()
