"""A path or a name on the command line -> its file, and the kind of the file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from startrack.cli.options import WrongUse, as_wrong_use
from startrack.io import keys_of_layers, read_table, shipped

DESIGNS = ("designs", "trackers")  # folders of shipped designs of star trackers
FEWEST_LETTERS = 3  # letters of a part of a name for the suggestion of a shipped design
# Commands on campaigns that take more than star trackers.
STUDIES = (
    *("optimize", "montecarlo", "verify", "sample", "what-matters", "sweep", "solve-for"),
    *("pareto", "compare", "report"),
)


class InputKind(NamedTuple):
    """A kind of file other than the design of a star tracker.

    words     what it is
    folder    of the shipped files
    keys      keys at top level, of which a file of this kind has at least one
    first     command to try first, with its arguments before the file
    commands  names of the commands that take it
    """

    words: str
    folder: str
    keys: frozenset[str]
    first: str
    commands: tuple[str, ...]


SEARCH = InputKind(
    "a search for moving objects",
    "searches",
    frozenset({"moving_object"}),
    "montecarlo",
    ("requirements", "page", *STUDIES),
)
SCENE = InputKind(
    "a scene of an Earth camera",
    "scenes",
    frozenset({"camera", "retrieval"}),
    "requirements",
    ("earth", "page", "requirements", *STUDIES),
)
GEOMETRY = InputKind(
    "a scene without a camera",
    "scenes",
    frozenset({"sensor"}),
    "earth geometry",
    ("earth geometry",),
)
GOALS = InputKind(
    "a file of goals", "scenes", frozenset({"goals"}), "requirements", ("requirements",)
)
MISSION = InputKind("a mission", "missions", frozenset({"heads"}), "mission", ("mission",))
SEQUENCE = InputKind(
    "a sequence", "sequences", frozenset({"legs"}), "sequence --profile", ("sequence",)
)
# A search also names a camera, and a sequence may have heads.
KINDS = (SEARCH, SCENE, GEOMETRY, GOALS, SEQUENCE, MISSION)
FOLDERS = tuple(dict.fromkeys(kind.folder for kind in KINDS))  # of their shipped files
# Keys at top level of the design of a star tracker.
OF_TRACKERS = frozenset({"instrument", "tracker", "base"})


def is_tracker(path: Path) -> bool:
    """Whether a file of no kind is the design of a star tracker."""
    if path.suffix != ".toml" or not path.is_file():
        return False
    with as_wrong_use(path=path):
        table: Any = read_table(path, "a design or a scene")
    return bool(OF_TRACKERS & table.keys())


def kind_of(path: Path) -> InputKind | None:
    """The kind of a file, or of a shipped file by its name; None for designs and missing files."""
    file = shipped_by_name(path, FOLDERS)
    if file.suffix != ".toml" or not file.is_file():
        return None
    with as_wrong_use(path=path):
        keys = keys_of_layers(file, "a design or a scene")
    return next((kind for kind in KINDS if kind.keys & keys), None)


def shipped_by_name(path: Path, folders: Iterable[str]) -> Path:
    """The shipped file of some folders that has this name, without its ending; else the path."""
    if path.suffix == ".toml" or len(path.parts) > 1:
        return path
    files = (shipped(folder) / f"{path}.toml" for folder in sorted(folders))
    return next((file for file in files if file.is_file()), path)


def design_file(path: Path) -> Path:
    """The path of a design, or of a shipped design. Raises WrongUse for other files."""
    if kind := kind_of(path):
        raise WrongUse(
            f"{path} is {kind.words}, for {_listed(kind.commands)}; this command needs the design "
            "of a star tracker"
        )
    with as_wrong_use():
        return found_file(path, similar=FOLDERS)


def _listed(names: tuple[str, ...]) -> str:
    if len(names) == 1:
        return f"the command {names[0]}"
    return f"the commands {', '.join(names[:-1])} and {names[-1]}"


def found_file(
    path: Path,
    folders: Sequence[str] = DESIGNS,
    kind: str = "a design file",
    similar: Sequence[str] = (),
) -> Path:
    """The path of a file, or of a shipped file; the message suggests similar names.

    folders  of the shipped files
    similar  further folders for the suggestions
    """
    if path.exists():
        return path
    asked = path.as_posix().removesuffix(".toml") + ".toml"
    for name, file in _named(folders).items():
        if asked in (name, file.name):
            return file
    stem, named = path.stem.lower(), _named((*folders, *similar))
    close = get_close_matches(stem, [file.stem for file in named.values()], 3, 0.75)
    names = [
        name
        for name, file in named.items()
        if file.stem in close or (len(stem) >= FEWEST_LETTERS and stem in file.stem)
    ]
    if names:
        close_names = ", ".join(names)
        raise ValueError(f"{path} must be {kind}, but there is none; shipped are {close_names}")
    if path.name == stem and shipped("detectors").joinpath(f"{stem}.toml").is_file():
        raise ValueError(
            f"{path} must be {kind}, but it is a detector: startrack init FILE --from {stem} makes "
            "a design with it"
        )
    return path


def _named(folders: Sequence[str]) -> dict[str, Path]:
    """The shipped files of some folders, by folder and name."""
    files = (file for name in folders for file in sorted(shipped(name).glob("*.toml")))
    return {f"{file.parent.name}/{file.name}": file for file in files}
