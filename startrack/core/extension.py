"""Name of a function in a design -> that function, if its code may run, and its origin.

A design may name code that is not part of startrack, as `module:function` or by an entry point of
an installed package. Nothing of it is imported before it is allowed to run: by `allow_code`, by
`load_design(..., allow_code=True)`, by the option --allow-code of a command, or by its module in
the environment variable STARTRACK_ALLOW_CODE.
"""

import hashlib
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib import import_module, metadata
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from startrack.core.arrays import Floats
from startrack.core.checks import Refused, refusal, shown

WITHOUT_RESULTS = {"benchmark", "cli", "plots", "report"}  # rooms that do not affect trials
ENVIRONMENT = "STARTRACK_ALLOW_CODE"
FORM = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")
SOURCES = (".py", ".so", ".pyd")
HOME = Path(__file__).resolve().parents[1]
# Of shipped data, in an installed wheel and in a checkout; the files that trials read.
SHIPPED, TABLES = (HOME / "_catalogs", HOME.parent / "catalogs"), (".fits", ".csv")
# Group of entry points (without "startrack.") -> key of a design that names one.
POINTS: Mapping[str, str] = {
    "centroids": "tracker.detection.centroid",
    "identifications": "tracker.identification.method",
    "charge_effects": "instrument.detector.charge_effects",
    "signal_effects": "instrument.detector.signal_effects",
    "image_effects": "instrument.detector.image_effects",
    "detections": "tracker.detection.search",
    "attitudes": "tracker.attitude.method",
    "psfs": "instrument.optics.psf",
    "lights": "scene.lights",
    "jitters": "instrument.motion.jitter",
    "requirements": "campaign.requirements.checks",
    "costs": "campaign.requirements.cost_model",
    "searches": "campaign.search",
}


class Code(NamedTuple):
    """Code that a design names.

    key      of the design: "tracker.detection.centroid"
    name     module:function
    package  distribution that the module is installed from, with its version; "" for none
    digest   of the files of its package, or of its single file
    """

    key: str
    name: str
    package: str
    digest: str

    def __str__(self) -> str:
        version = self.package.rpartition(" ")[2] or f"(source {self.digest[:8]})"
        label = self.key.rpartition(".")[2]
        return f"{label}: {self.name} {version}, not part of startrack"


class _Known(NamedTuple):
    function: Callable[..., Any]
    package: str
    digest: str


_allowed = set[str]()  # modules; "*" for all
_expected = dict[str, str]()  # digest of each module in the process that sent the design
_known = dict[str, _Known]()
_used = dict[str, None]()  # names, in the order of their first use


def is_code(name: str) -> bool:
    """Whether a value of a design names code: module:function."""
    return ":" in name


def full_name(group: str, built_in: Collection[str], name: Any) -> Any:
    """The module:function of an entry point of an installed package; other values are unchanged."""
    if not isinstance(name, str) or name in built_in or is_code(name):
        return name
    return _of_entry_point(group, name, tuple(sys.path))


@lru_cache(maxsize=64)
def _of_entry_point(group: str, name: str, folders: tuple[str, ...]) -> str:
    """Read from the packages in the folders of sys.path, which takes milliseconds."""
    for point in metadata.entry_points(group=f"startrack.{group}", name=name):
        return point.value.replace(" ", "")
    return name


def one_of_or_code(choices: Collection[str], /, **values: str) -> None:
    """Refuse values that are neither among the choices nor the name of a function."""
    for name, value in values.items():
        if value not in choices and not (isinstance(value, str) and FORM.fullmatch(value)):
            named = f"one of {', '.join(choices)}, or " if choices else ""
            rule = f"{named}code as module:function or by the entry point of an installed package"
            raise refusal(name, f"must be {rule}", value)


def allow_code(*modules: str) -> None:
    """Let designs run the code of modules, and of the modules in them, in this process.

    Its workers may then run it, too.
    """
    _allowed.update(modules)


@contextmanager
def code_of_command(allow: bool) -> Iterator[None]:
    """Context in which all code that designs name may run (if `allow`), and the code that ran is
    listed."""
    before, used = set(_allowed), dict(_used)
    _used.clear()
    if allow:
        _allowed.add("*")
    try:
        yield
    finally:
        _allowed.clear()
        _allowed.update(before)
        _used.update(used)


def used_code() -> list[Code]:
    """User code that was called, or refused, in this process or since `code_of_command` began."""
    return [origin_of(*text.split(" ", 1)) for text in _used]


def is_allowed(module: str) -> bool:
    """Whether the code of a module may run in this process."""
    named = [module_named.strip() for module_named in os.environ.get(ENVIRONMENT, "").split(",")]
    return any(
        allowed == "*" or allowed == module or module.startswith(f"{allowed}.")
        for allowed in (*_allowed, *named)
        if allowed
    )


def require_code(named: Iterable[tuple[str, str, str]]) -> None:
    """Import code that a design names, if it is allowed to run.

    named   as `code_in` gives it
    Raises  ValueError with the key, the module and the options if the code is not allowed, or
            cannot be imported.
    """
    for key, _, name in named:
        _import(key, name)


def function_of(group: str, name: str) -> Callable[..., Any]:
    """The function that a design names. Raises as `require_code`."""
    code = _known.get(name)
    module, _, attribute = name.partition(":")
    # A reloaded module has another function of that name, and a process that has run a design with
    # its own code may receive a design that was begun with other code.
    if (
        code is None
        or _expected.get(module, code.digest) != code.digest
        or getattr(sys.modules.get(module), attribute, None) is not code.function
    ):
        code = _import(POINTS[group], name)
    return code.function


def origin_of(key: str, name: str) -> Code:
    """Origin of code after its import. Raises as `require_code`."""
    code = _import(key, name)
    return Code(key, name, code.package, code.digest)


def _import(key: str, name: str) -> _Known:
    module, _, attribute = name.partition(":")
    if not is_allowed(module):
        raise ValueError(
            f"{key} names code that is not part of startrack, {shown(name)}: the module {module} "
            f"is imported only with --allow-code, with load_design(..., allow_code=True), or with "
            f"{ENVIRONMENT}={module}"
        )
    try:
        loaded = import_module(module)
        function = getattr(loaded, attribute)
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"{key} names {name}, which cannot be imported: {reason}") from error
    if not callable(function):
        raise ValueError(f"{key} must name a function, got {name}, {shown(function)}")
    _used.setdefault(f"{key} {name}")
    code = _known.get(name)
    if code is None or code.function is not function:
        top = sys.modules[loaded.__name__.partition(".")[0]]
        code = _known[name] = _Known(function, _package(module), _digest(top))
    expected = _expected.get(module, code.digest)
    if code.digest != expected:
        raise ValueError(
            f"{key} names {name}, whose files differ from those where the trials were started "
            f"(digest {code.digest[:8]} here, {expected[:8]} there): install the same on all "
            "machines"
        )
    return code


def _package(module: str) -> str:
    """The distribution of a module and its version; else the version that its package states."""
    top = module.partition(".")[0]
    for distribution in _distributions(tuple(sys.path)).get(top, ()):
        return f"{distribution} {metadata.version(distribution)}"
    version = getattr(sys.modules[top], "__version__", "")
    return f"{top} {version}" if version else ""


@cache
def _distributions(path: tuple[str, ...]) -> Mapping[str, list[str]]:
    """The distributions of each package on a path, for which the files of all of them are read."""
    return metadata.packages_distributions()


def _digest(package: ModuleType) -> str:
    """Digest of all Python files and compiled modules of a package; not of its data or of the
    packages that it needs.

    Raises  ValueError if it has no file.
    """
    folders = [Path(folder) for folder in getattr(package, "__path__", ())]
    files = [
        (str(path.relative_to(folder)), path)
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.suffix in SOURCES and path.is_file()
    ]
    if not folders and (file := getattr(package, "__file__", None)):
        files = [(Path(file).name, Path(file))]
    if not files:
        raise ValueError(f"{package.__name__} must be in a file that other processes can import")
    total = hashlib.blake2b(digest_size=16)
    for name, path in files:
        content = path.read_bytes()
        total.update(f"{name}\0{len(content)}\0".encode() + content)
    return total.hexdigest()


@cache
def software() -> str:
    """Version of startrack, with a digest of its sources and of its tables of data.

    Tables of values, such as shipped designs, are not included: a result keeps the values that it
    read.

    >>> software().startswith("0.1.0+")
    True
    """
    import startrack

    state = hashlib.blake2b(digest_size=4)
    for home, endings in ((HOME, SOURCES), *((folder, TABLES) for folder in SHIPPED)):
        for path in sorted(home.rglob("*")):
            place = path.relative_to(home)
            if path.suffix in endings and place.parts[0] not in WITHOUT_RESULTS:
                state.update(f"\n{place.as_posix()}\n".encode() + path.read_bytes())
    return f"{startrack.__version__}+{state.hexdigest()}"


def file_digest(path: Path) -> str:
    """Digest of a file; read again if the system reports that it may have changed."""
    status = path.stat()
    return _file_digest(path, status.st_ino, status.st_ctime_ns, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=64)
def _file_digest(path: Path, *_: int) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def sent_with(named: Iterable[tuple[str, str, str]]) -> dict[str, str]:
    """Digests of the modules that a design names and that may run here, for other processes."""
    modules = {name.partition(":")[0]: (key, name) for key, _, name in named}
    # A process that only forwards a design, such as a scheduler of Dask, need not have the code.
    return {
        module: _expected.get(module) or _import(*use).digest
        for module, use in modules.items()
        if is_allowed(module)
    }


def received(modules: Mapping[str, str]) -> None:
    """Allow the user code that the sending process allows; its files must be the same here."""
    _allowed.update(modules)
    _expected.update(modules)


def call_code(group: str, name: str, given: Any) -> Any:
    """Result of the user function of this name for its input.

    Raises  Refused if the code raises it, to refuse the design; ValueError with the key, the
            name and the error, where the code raises any other error.
    """
    function = function_of(group, name)
    try:
        return function(given)
    except Refused as error:
        raise error.within(f"{POINTS[group]} {name}") from None
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"{POINTS[group]} {name} raised {reason}") from error


def returned(
    group: str, name: str, value: Any, shape: tuple[int | tuple[int, ...], ...], finite: bool = True
) -> Floats:
    """Result of user code, as an array of floats.

    shape   lengths; several where one of them is asked for, -1 for any
    Raises  ValueError with the key, the name and the rule where it is not an array of numbers of
            that shape, or not finite.
    """
    asked = f"{POINTS[group]} {name} must return"
    lengths = [length if isinstance(length, tuple) else (length,) for length in shape]
    text = ", ".join(" or ".join("n" if k == -1 else str(k) for k in length) for length in lengths)
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ValueError(f"{asked} an array ({text}) of numbers, got {shown(value)}") from None
    right = array.ndim == len(lengths) and all(
        -1 in asked or length in asked for asked, length in zip(lengths, array.shape, strict=True)
    )
    if not right:
        raise ValueError(f"{asked} an array of shape ({text}), got {array.shape}")
    if finite and not np.isfinite(array).all():
        bad = int((~np.isfinite(array)).sum())
        raise ValueError(f"{asked} finite numbers, got {bad} of {array.size} that are not")
    return array
