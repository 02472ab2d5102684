"""`startrack init`: a new design file, from a detector or as a copy of a shipped file."""

from __future__ import annotations

import argparse
from pathlib import Path

from startrack.cli.options import Exit, Option, Options, WrongUse, as_wrong_use, wanted

if wanted(__name__):
    from startrack.cli.files import DESIGNS, FOLDERS, kind_of, shipped_by_name
    from startrack.cli.terminal import print_result
    from startrack.design import changed_limits, products, template
    from startrack.io import save_text, shipped

    COPIED = (*DESIGNS, *FOLDERS)  # folders of shipped files


declare = Options(
    "Writes a design file for editing, with the meaning of each value, or a copy of a shipped "
    "design, scene or search. For example\n\n"
    "  startrack init mine.toml --from imx250\n"
    "  startrack init fires.toml --from hsrs",
    Option(
        "design DESIGN",
        "file to write; it must not exist yet (default: design.toml)",
        Path,
        Path("design.toml"),
        many="?",
    ),
    Option(
        "--from NAME",
        "detector of the catalogue, such as imx250, or a file to copy, such as nanosatellite or "
        "hsrs; another name lists all (default: a generic CMOS array of 512 x 512 pixels)",
        default="",
        dest="origin",
    ),
    Option("--all", "add optional keys as comments"),
)


def command(options: argparse.Namespace) -> int:
    """Write the file."""
    path = options.design
    if path.exists():
        raise WrongUse(f"{path} must not exist yet, so that no design is lost")
    origin = options.origin
    if origin and origin not in products():
        return _copy(options, shipped_by_name(Path(origin), COPIED))
    text = template(origin, options.all)
    with as_wrong_use():
        save_text(path, text)
    lines = [f"{path} written; next: startrack budget {path}", changed_limits(origin)]
    print_result(options, {"design": str(path)}, *filter(None, lines))
    return Exit.DONE


def _copy(options: argparse.Namespace, file: Path) -> int:
    """Write a copy of a shipped file; the files that it names are found from anywhere."""
    path = options.design
    if not file.is_file():
        names = [one.stem for folder in COPIED for one in sorted(shipped(folder).glob("*.toml"))]
        raise WrongUse(
            f"--from must be a detector ({', '.join(products())}) or a shipped file "
            f"({', '.join(names)}), got {options.origin!r}"
        )
    if options.all:
        raise WrongUse(f"--all must be left out for a copy, got --from {options.origin}")
    kind = kind_of(file)
    following = kind.first if kind else "budget"
    with as_wrong_use():
        save_text(path, file.read_text(encoding="utf-8"))
    text = f"{path} is a copy of {file.parent.name}/{file.name}; next: startrack {following} {path}"
    print_result(options, {"design": str(path)}, text)
    return Exit.DONE
