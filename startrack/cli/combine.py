"""`startrack montecarlo combine`: one error from campaigns of different fidelity."""

from __future__ import annotations

import argparse
import math
import os
from contextlib import ExitStack
from pathlib import Path

from startrack.cli.options import Exit, Option, Options, WrongUse, as_wrong_use, wanted

if wanted(__name__):
    from startrack.cli.terminal import print_rows
    from startrack.core import arcsec
    from startrack.design import Fidelity
    from startrack.metrics import ARCSEC, Row
    from startrack.montecarlo import Store, combined


declare = Options(
    "A few rendered trials remove the bias; many statistical trials reduce the variance. The "
    "estimate is the error of the rendered trials, with a narrower interval. For example\n\n "
    "startrack montecarlo --trials 200 --control --store frames.sqlite\n startrack montecarlo "
    "--trials 20000 --fidelity covariance --store covariance.sqlite\n startrack montecarlo "
    "combine frames.sqlite covariance.sqlite",
    Option(
        "campaigns CAMPAIGN.sqlite",
        "stores of `montecarlo`, of one design and one seed, made without --sobol: a few trials "
        "of fidelity frame (best with --control), many of window, or very many of covariance. "
        "The approximations of the other fidelities do not bias the estimate",
        Path,
        many="+",
    ),
)


def command(options: argparse.Namespace) -> int:
    """Print the error of the campaign of highest fidelity, with the variance reduced by the
    others."""
    files = [os.path.realpath(path) for path in options.campaigns]
    if len(files) < 2:
        raise WrongUse(
            "campaigns must be two or more, each of a different fidelity, got "
            f"{options.campaigns[0]}"
        )
    for path, resolved in zip(options.campaigns, files, strict=True):
        if files.count(resolved) > 1:
            raise WrongUse(f"campaigns must be different files, got {path} more than once")
    with ExitStack() as opened:
        with as_wrong_use():
            stores = [opened.enter_context(Store(path)) for path in options.campaigns]
        cost = tuple(Fidelity)  # most expensive first
        stores.sort(key=lambda store: cost.index(store.sampling.fidelity))
        _must_belong_together(stores)
        levels = [(store.outcomes(), store.sampling.fidelity) for store in stores]
        for store, (table, _) in zip(stores, levels, strict=True):
            if not len(table):
                raise WrongUse(f"{store.path} must hold trials, but holds none")
    counted = ", ".join(f"{len(table)} of {kind}" for table, kind in levels)
    rows = [Row("trials", {kind.value: len(table) for table, kind in levels})]
    for name, about in (("across", False), ("about", True)):
        with as_wrong_use():
            together = combined(levels, about).root()
        alone = combined(levels[:1], about).root()
        low, high = alone.low / arcsec, alone.high / arcsec
        known = f"[{low:.3f}, {high:.3f}]"
        by_itself = known if math.isfinite(low) else "too few trials for an interval"
        rows += [
            Row(f"{name}_rms_arcsec", together, name, ARCSEC, note=f"rms, alone {by_itself}"),
            Row(f"{name}_alone_rms_arcsec_95", [low, high]),
        ]
    print_rows(options, rows, f"{counted} trials; intervals: 95 % confidence")
    return Exit.DONE


def _must_belong_together(stores: list[Store]) -> None:
    kinds = [store.sampling.fidelity for store in stores]
    if len(set(kinds)) < len(kinds):
        raise WrongUse(f"campaigns must be of different fidelity, got {', '.join(kinds)}")
    first = stores[0]
    for store in stores:
        if store.sampling.attitudes != "random":
            raise WrongUse(
                f"{store.path} must have random attitudes, for independent trials, but has Sobol "
                "points; make it again without --sobol"
            )
        if store.seed != first.seed or store.case != first.case:
            raise WrongUse(
                f"{store.path} must have the design and the seed of {first.path}: trials of one "
                "number must have the same sky and noise"
            )
