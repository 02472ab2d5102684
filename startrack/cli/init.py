"""`startrack init`: a new design file."""

from __future__ import annotations

import argparse
from pathlib import Path

from startrack.cli.options import Exit, Option, Options, WrongUse, as_wrong_use, wanted

if wanted(__name__):
    from startrack.cli.terminal import print_result
    from startrack.design import changed_limits, products, template
    from startrack.io import save_text


declare = Options(
    "Writes a design file for editing, with the meaning of each value. For example\n\n"
    "  startrack init mine.toml --from imx250",
    Option(
        "design DESIGN",
        "file to write; it must not exist yet (default: design.toml)",
        Path,
        Path("design.toml"),
        many="?",
    ),
    Option(
        "--from DETECTOR",
        "detector of the catalogue, such as imx250; another name lists all "
        "(default: a generic CMOS array of 512 x 512 pixels)",
        default="",
        dest="product",
    ),
    Option("--all", "add optional keys as comments"),
)


def command(options: argparse.Namespace) -> int:
    """Write the file."""
    path = options.design
    if path.exists():
        raise WrongUse(f"{path} must not exist yet, so that no design is lost")
    if options.product and options.product not in products():
        raise WrongUse(f"--from must be one of {', '.join(products())}, got {options.product!r}")
    text = template(options.product, options.all)
    with as_wrong_use():
        save_text(path, text)
    lines = [f"{path} written; next: startrack budget {path}", changed_limits(options.product)]
    print_result(options, {"design": str(path)}, *filter(None, lines))
    return Exit.DONE
