"""`startrack combine`: one error from campaigns of different fidelity."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from startrack.cli.exits import Exit, WrongUse
from startrack.cli.options import describe
from startrack.cli.terminal import in_arcsec, tell
from startrack.design import Fidelity
from startrack.montecarlo import Store, combined

COST = tuple(Fidelity)  # dearest first


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack combine`."""
    describe(
        parser,
        "Few dear trials know the truth, many cheap ones the sky: together they have the error of "
        "the dear ones, within a narrower interval. For example\n\n"
        "  startrack montecarlo --trials 200 --control --store frames.sqlite\n"
        "  startrack montecarlo --trials 20000 --fidelity covariance --store cheap.sqlite\n"
        "  startrack combine frames.sqlite cheap.sqlite",
    )
    parser.add_argument(
        "campaigns", type=Path, nargs="+", metavar="CAMPAIGN.sqlite",
        help="stores of `montecarlo`, of one design and one seed, without --sobol: few frames, "
        "best with --control, many windows, or very many trials of covariance. The error is that "
        "of the frames, however much the others leave out",
    )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Print the error of the finest campaign, with the help of the cheaper ones."""
    _must_be_several(options.campaigns)
    with ExitStack() as opened:
        stores = [opened.enter_context(_open(path)) for path in options.campaigns]
        stores.sort(key=lambda store: COST.index(store.sampling.fidelity))
        _must_belong_together(stores)
        levels = [(store.outcomes(), store.sampling.fidelity) for store in stores]
    result: dict[str, Any] = {"trials": {kind.value: len(table) for table, kind in levels}}
    counted = ", ".join(f"{len(table)} of {kind}" for table, kind in levels)
    lines = [f"{counted}; intervals hold with 95 % confidence"]
    for name, about in (("across", False), ("about", True)):
        try:
            told = in_arcsec(combined(levels, about).root())
        except ValueError as error:
            raise WrongUse(str(error)) from None
        alone = in_arcsec(combined(levels[:1], about).root())
        result[f"{name}_rms_arcsec"] = told["value"]
        result[f"{name}_rms_arcsec_95"] = [told["low"], told["high"]]
        result[f"{name}_alone_rms_arcsec_95"] = [alone["low"], alone["high"]]
        lines.append(
            f"{name:6s} {told['value']:9.3f} arcsec rms [{told['low']:.3f}, {told['high']:.3f}], "
            f"alone [{alone['low']:.3f}, {alone['high']:.3f}]"
        )
    tell(options, result, "\n".join(lines))
    return Exit.DONE


def _open(path: Path) -> Store:
    try:
        return Store(path)
    except ValueError as error:
        raise WrongUse(str(error)) from None


def _must_be_several(paths: list[Path]) -> None:
    if len(paths) < 2:
        raise WrongUse(f"campaigns must be two or more, each of another fidelity, got {paths[0]}")
    found = [path.resolve() for path in paths]
    for path, place in zip(paths, found, strict=True):
        if found.count(place) > 1:
            raise WrongUse(f"campaigns must be files of their own, got {path} more than once")


def _must_belong_together(stores: list[Store]) -> None:
    kinds = [store.sampling.fidelity for store in stores]
    if len(set(kinds)) < len(kinds):
        raise WrongUse(f"campaigns must be of different fidelity, got {', '.join(kinds)}")
    first = stores[0]
    for store in stores:
        if store.sampling.attitudes != "random":
            raise WrongUse(
                f"{store.path} must look at random attitudes, whose trials are independent, but "
                "lies at Sobol's points; make it again without --sobol, which saves little where "
                "a cheaper campaign helps"
            )
        if store.seed != first.seed or store.case != first.case:
            raise WrongUse(
                f"{store.path} must hold the design and the seed of {first.path}: trials of one "
                "number must have the same sky and noise"
            )
