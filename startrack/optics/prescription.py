"""File of Zemax, CODE V or optiland -> the lens of the program optiland, in millimetre.

The parts of a file that can be misread are read here: its letters, its unit of length, its glasses.
The tracer sees a plain copy in which each glass is named by its maker and name, or by index and
Abbe number.
"""

import difflib
import re
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from startrack.core import Refused, shown
from startrack.io import decoded, first_line, read_bytes, with_points

MOST_BYTES = 20_000_000
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "in": 25.4, "m": 1000.0}
ZEMAX_UNITS = {"MM": "mm", "CM": "cm", "IN": "in", "METER": "m", "METERS": "m", "M": "m"}
CODE_V_UNITS = {"M": "mm", "MM": "mm", "C": "cm", "CM": "cm", "I": "in", "IN": "in"}
# Makers by the names of their catalogues; LZOS makes the glasses of the Russian standard GOST 3514.
MAKERS = {
    "schott": "schott",
    "ohara": "ohara",
    "hoya": "hoya",
    "cdgm": "cdgm",
    "hikari": "hikari",
    "nikon": "hikari",
    "nikon-hikari": "hikari",
    "sumita": "sumita",
    "lzos": "lzos",
    "gost": "lzos",
    "rpo": "lightpath",
    "lightpath": "lightpath",
    "ami": "ami",
    "amtir": "ami",
    "vitron": "vitron",
    "corning": "corning",
    "nsg": "nsg",
    "barberini": "barberini",
}
# Materials without a maker, by name: entry and page of refractiveindex.info in the tracer, and the
# publication of the dispersion.
SYNONYMS = {
    **dict.fromkeys(
        ("F_SILICA", "SILICA", "FUSED_SILICA", "FUSEDSILICA", "SIO2"),
        ("SiO2", "Malitson"),  # Malitson (1965), J. Opt. Soc. Am. 55, 1205
    ),
    "CAF2": ("CaF2", "Malitson"),  # Malitson (1963), Appl. Opt. 2, 1103
    "BAF2": ("BaF2", "Malitson"),  # Malitson (1964), J. Opt. Soc. Am. 54, 628
    "LIF": ("LiF", "Li"),  # Li (1976), J. Phys. Chem. Ref. Data 5, 329
}
NUMBER_OF_GLASS = re.compile(r"(\d{3})(\d{3})")
PRECISE_NUMBER = re.compile(r"(\d{3,7})\.(\d{3,7})")
MODEL = "1"  # kind of glass of a GLAS line
# Zemax: obstructions of shapes that the tracer leaves out.
SHAPES = {"SQAP", "SQOB", "ELAP", "ELOB", "SPID", "UDAD", "UDAO", "UDOB", "COBS", "CLOB"}
# Letters of CODE V, of the terms in r^4, r^6, ... r^20 of an asphere.
ASPHERE = "ABCDEFGHJ"
SHORTEST, LONGEST = 0.1, 30.0  # micrometre, of wavelengths that a prescription may have
WARM = 20.0  # degC, temperature for which the tracer assumes that lengths are given
THIN = 0.01  # atmosphere, pressure below which a lens counts as in vacuum
TORR = 760.0  # of an atmosphere
VIGNETTING = "its vignetting factors do not count: apertures of surfaces do"
# Commands of CODE V, for the lens and for a surface, that have no effect on light or that the
# tracer reads.
LENS_WORDS = {
    "RDM",
    "LEN",
    "TITLE",
    "TIT",
    "INI",
    "DIM",
    "EPD",
    "FNO",
    "NA",
    "NAO",
    "WL",
    "WTW",
    "REF",
    "CWL",
    "XAN",
    "YAN",
    "XOB",
    "YOB",
    "XIM",
    "YIM",
    "WTF",
    "VUX",
    "VLX",
    "VUY",
    "VLY",
    "TEM",
    "PRE",
    "GO",
    "NEW",
}
SURFACE_WORDS = {
    "STO",
    "SLB",
    "K",
    "XDE",
    "YDE",
    "ZDE",
    "ADE",
    "BDE",
    "CDE",
    "CIR",
    "THC",
    "CCY",
    "PIM",
    "SPH",
    "CON",
    "ASP",
    "A",
    "B",
    "C",
    "D",
    "E",
    "F",
    "G",
    "H",
    "J",
    "KC",
    "AC",
    "BC",
    "CC",
    "DC",
}
ZERO_ONLY = {"XDE", "YDE", "ZDE", "ADE", "BDE", "CDE"}  # zero for a lens of revolution


class Glass(NamedTuple):
    """Medium behind a surface: a glass of a catalogue, or a model by two numbers.

    name, maker    as in the tracer's catalogue; maker is "" for a model
    n_d, abbe      1, index and Abbe number at 587.6 nm of a model
    """

    name: str
    maker: str = ""
    n_d: float = 0.0
    abbe: float = 0.0


class Prescription(NamedTuple):
    """The contents of a file after it was read.

    text      text for the tracer, with numbers in `unit` and a placeholder for each glass
    suffix    suffix of the kind of file
    unit      unit of length: "mm", "cm", "in" or "m"
    glasses   glasses by the number of the surface before them
    aspheres  terms in r^4, r^6, ..., in `unit`, by the number of the surface
    focused   whether the image is at the paraxial focus, independent of the last distance
    defocus   `unit`, distance from the paraxial focus to the image
    notes     contents of the file that the trace ignores
    """

    text: str
    suffix: str
    unit: str
    glasses: dict[int, Glass]
    aspheres: Mapping[int, Sequence[float]] = MappingProxyType({})
    focused: bool = False
    defocus: float = 0.0
    notes: tuple[str, ...] = ()


def parse_prescription(path: Path) -> Prescription:
    """Read a Zemax .zmx or CODE V .seq file: its text, unit and glasses.

    A glass is found by its name among the makers that the file names (GCAT, or the end of CODE V's
    N-BK7_SCHOTT), ignoring capitals; and ignoring hyphens for CODE V, which writes none. If the
    file names no makers, only one catalogue may have the glass.

    Raises  Refused if a glass is in none of these catalogues, with the nearest names, or in
            several; if the unit of length is not mm, cm, in or m; if the file has contents that
            the tracer would leave out (apertures that are not round, private glasses); and if it is
            cut. ImportError without the extra `lens`.
    """
    path = Path(path)
    text = decoded(read_bytes(path, "a prescription", MOST_BYTES), path)
    parse = {".zmx": _parse_zemax, ".seq": _parse_code_v}[path.suffix.lower()]
    return parse(path, text)


def _parse_zemax(path: Path, text: str) -> Prescription:
    lines = [[with_points(word) for word in line.split()] for line in text.splitlines()]
    unit, makers, glasses, surface, made = "mm", list[str](), dict[int, Glass](), -1, list[str]()
    for words in lines:
        if words[:1] == ["GCAT"]:
            makers = words[1:]
    _require_surfaces(path, lines)
    floats = ["FLOA"] in (words[:1] for words in lines)
    stop = False
    for words in lines:
        word = words[0] if words else ""
        if word == "UNIT" and len(words) > 1:
            unit = _unit(path, words[1], ZEMAX_UNITS)
        elif word == "SURF":
            surface, stop = surface + 1, False
        elif word == "STOP":
            stop = True
        elif word == "TYPE" and words[1:2] == ["COORDBRK"]:
            surface -= 1  # the tracer makes no surface of it
        elif word in SHAPES:
            raise Refused(f"{path} must have circular apertures alone, got {word}")
        elif word == "IGNR" and words[1:2] == ["1"]:
            raise Refused(f"{path} must have no ignored surfaces (IGNR)")
        elif word == "FTYP" and words[7:8] == ["1"]:
            raise Refused(f"{path} must image stars, got a lens that is afocal (FTYP)")
        elif word == "OBDC" and any(float(number) for number in words[1:3]):
            raise Refused(f"{path} must have apertures about its axis, got {' '.join(words)}")
        elif word == "OBSC":
            words = ["CLAP", _obstruction(path, words), "inf"]
        elif word == "DIAM" and floats and stop and len(words) > 1:
            words = ["DIAM", repr(2 * float(words[1]))]  # the tracer takes half of it
        elif word == "GLAS" and len(words) > 1 and words[1].upper() != "MIRROR":
            glasses[surface] = _zemax_glass(path, words, makers)
            words = ["GLAS", "___BLANK", "1", "0", "1.5", "60", "0", "0", "0", "0", "0", "0"]
        made.append(" ".join(words))
    notes = dict.fromkeys(filter(None, map(_zemax_note, lines)))
    return Prescription("\n".join(made) + "\n", ".zmx", unit, glasses, notes=tuple(notes))


def _require_surfaces(path: Path, lines: Sequence[Sequence[str]]) -> None:
    """Refuse a file of Zemax without surfaces or a stop, and one that is cut.

    Each surface has a distance, and the image, which is the last, has zero.
    """
    surfaces = list[dict[str, Sequence[str]]]()
    for words in lines:
        if words[:1] == ["SURF"]:
            surfaces.append({})
        elif words and surfaces:
            surfaces[-1].setdefault(" ".join(words[:2]) if words[0] == "PARM" else words[0], words)
    if not surfaces:
        raise Refused(f"{path} must be a Zemax prescription with surfaces (SURF), got none")
    for number, surface in enumerate(surfaces):
        if "DISZ" not in surface:
            raise Refused(f"{path} must have a distance (DISZ) after each surface, not so {number}")
        linear = surface.get("PARM 1", ["", "", "0"])
        if surface.get("TYPE", [""])[1:] == ["EVENASPH"] and float(linear[2]):
            raise Refused(
                f"{path} must have aspheres without a term in r^2, whose curvature the tracer does "
                f"not count, got {' '.join(linear)} of surface {number}"
            )
    end = surfaces[-1]
    if "GLAS" in end or end["DISZ"][1] == "INFINITY" or float(end["DISZ"][1]):
        raise Refused(
            f"{path} must end with the surface of the image, after which there is nothing, got "
            f"surface {len(surfaces) - 1} with {' '.join(end.get('GLAS', end['DISZ']))}; is it cut?"
        )
    if (stops := sum("STOP" in surface for surface in surfaces)) != 1:
        raise Refused(f"{path} must mark one surface as the stop (STOP), got {stops}")


def _obstruction(path: Path, words: Sequence[str]) -> str:
    """Radius of the disc that OBSC 0 RADIUS covers."""
    if len(words) < 3 or float(words[1]):
        raise Refused(f"{path} must have obstructions that are discs, got {' '.join(words)}")
    return words[2]


def _zemax_note(words: Sequence[str]) -> str:
    """A note on a line that the trace ignores; "" for others."""
    word, numbers = (words[0], words[1:]) if words else ("", [])
    if word == "MNUM" and numbers and int(numbers[0]) > 1:
        return f"of its {numbers[0]} configurations (MNUM) that in which it was saved counts alone"
    if word in ("VDXN", "VDYN", "VCXN", "VCYN") and any(float(number) for number in numbers):
        return VIGNETTING
    if word == "ENVD" and numbers[2:3] == ["1"]:
        return _state_note("ENVD", float(numbers[0]), float(numbers[1]))
    return ""


def _state_note(word: str, celsius: float, atmospheres: float) -> str:
    notes = []
    if celsius != WARM:
        notes.append(f"its lengths are those at {celsius:g} degC and count as those at {WARM:g}")
    if atmospheres < THIN:
        notes.append("it is a lens in vacuum, as --vacuum traces it")
    return f"{'; '.join(notes)} ({word})" if notes else ""


def _zemax_glass(path: Path, words: Sequence[str], makers: Sequence[str]) -> Glass:
    """The glass of a line GLAS name kind pickup index abbe ..., whose numbers count in a model."""
    kind = words[2] if len(words) > 2 else "0"
    if kind == MODEL or words[1] == "___BLANK":
        try:
            return _model(path, float(words[4]), float(words[5]))
        except (IndexError, ValueError):
            raise Refused(
                f"{path} must have an index and an Abbe number in a model glass, got "
                f"{shown(' '.join(words))}"
            ) from None
    return find_glass(path, words[1], makers)


def _parse_code_v(path: Path, text: str) -> Prescription:
    unit, glasses, surface, made = "mm", dict[int, Glass](), -1, list[str]()
    aspheres, notes = dict[int, list[float]](), list[str]()
    radii, focused, defocus = False, False, 0.0
    for words in _code_v_lines(text):
        word = words[0].upper()
        if word in ("SO", "S", "SI"):
            surface += 1
            if (word == "SO") != (surface == 0):
                raise Refused(f"{path} must begin with one object surface (SO), got {word}")
            if not radii:
                raise Refused(
                    f"{path} must say by RDM whether surfaces have radii or curvatures, before "
                    "the first of them"
                )
            if len(words) > 3 and words[3].upper() not in ("AIR", "REFL"):
                glasses[surface] = _code_v_glass(path, words[3].strip("'\""))
                words = [*words[:3], "1.5:60"]
            if word == "SI" and len(words) > 2:
                defocus = _number(path, words, 2)
        elif word == "DIM" and len(words) > 1:
            unit = _unit(path, words[1].upper(), CODE_V_UNITS)
        elif word == "RDM":
            radii = True
            words = ["RDM", *(["N"] if words[1:2] and words[1].upper() in ("N", "NO") else [])]
        elif word == "PRV":
            raise Refused(f"{path} must have glasses of makers alone, got private ones (PRV)")
        elif word == "CIR" and {"OBS", "HOL"} & {other.upper() for other in words}:
            raise Refused(f"{path} must have clear circular apertures alone, got {' '.join(words)}")
        elif word in ZERO_ONLY and any(float(number) for number in words[1:2]):
            raise Refused(f"{path} must be a lens of revolution, got {' '.join(words)}")
        elif word == "CIR" and "EDG" in (other.upper() for other in words):
            continue  # the edge of the glass, which stops no light
        elif word in (*ASPHERE,) and surface >= 0:
            terms = aspheres.setdefault(surface, [0.0] * len(ASPHERE))
            terms[ASPHERE.index(word)] = _number(path, words, 1)
            words = [word, "0"]  # the tracer assumes terms in r^2, r^4, ...
        elif word == "PIM":
            focused = True
        elif word in ("VUX", "VLX", "VUY", "VLY") and any(map(float, words[1:])):
            notes.append(VIGNETTING)
        elif word == "TEM":
            notes.append(_state_note(word, _number(path, words, 1), 1.0))
        elif word == "PRE":
            notes.append(_state_note(word, WARM, _number(path, words, 1) / TORR))
        elif word not in (SURFACE_WORDS if surface >= 0 else LENS_WORDS) and word not in LENS_WORDS:
            raise Refused(
                f"{path} must have commands that are understood, got {shown(' '.join(words))}"
            )
        made.append(" ".join(words))
    if surface < 1:
        raise Refused(f"{path} must be a CODE V prescription with surfaces (SO, S, SI), got none")
    text = "\n".join(made) + "\n"
    said = tuple(dict.fromkeys(filter(None, notes)))
    return Prescription(
        text=text,
        suffix=".seq",
        unit=unit,
        glasses=glasses,
        aspheres=aspheres,
        focused=focused,
        defocus=defocus,
        notes=said,
    )


def _number(path: Path, words: Sequence[str], place: int) -> float:
    try:
        return float(words[place])
    except (IndexError, ValueError):
        raise Refused(
            f"{path} must have numbers after its commands, got {shown(' '.join(words))}"
        ) from None


def _code_v_lines(text: str) -> Iterator[list[str]]:
    """The commands of a file: lines that end with & go on, ; separates, ! begins a comment.

    Not within quotes, which the commands of titles and labels have.
    """
    for line in re.sub(r"&[ \t]*\n", " ", text.replace("\r\n", "\n")).splitlines():
        pieces = re.findall(r"'[^']*'|\"[^\"]*\"|[;!]|[^;!'\"]+|['\"]", line)
        command = ""
        for piece in (*pieces, ";"):
            if piece not in (";", "!"):
                command += piece
                continue
            if words := command.split():
                yield words
            command = ""
            if piece == "!":
                break


def _code_v_glass(path: Path, name: str) -> Glass:
    """The glass of N-BK7_SCHOTT, NBK7_SCHOTT, NBK7, 1.5168:64.17, 517642 or 516800.641700."""
    if ":" in name:
        first, _, second = name.partition(":")
        try:
            return _model(path, float(first), float(second))
        except ValueError:
            raise Refused(f"{path} must have a glass of two numbers, got {shown(name)}") from None
    if match := PRECISE_NUMBER.fullmatch(name):
        index, abbe = float(f"1.{match[1]}"), float(f"{match[2][:2]}.{match[2][2:]}")
        return _model(path, index, abbe)
    found, _, maker = name.rpartition("_")
    if found and maker.lower() in MAKERS:
        return find_glass(path, found, [maker], hyphens=False)
    return find_glass(path, name, [], hyphens=False)


def find_glass(path: Path, name: str, makers: Sequence[str], hyphens: bool = True) -> Glass:
    """The glass of that name, in the catalogues of these makers.

    path     of the file, for the message
    makers   as in the file; none: all
    hyphens  whether hyphens count
    Raises   Refused if no maker, or several, have the glass.
    """
    if match := NUMBER_OF_GLASS.fullmatch(name):
        return _model(path, 1 + int(match[1]) / 1000, int(match[2]) / 10)

    def same(text: str) -> str:
        return text.upper() if hyphens else text.upper().replace("-", "")

    catalogues = _catalogues()
    wanted = [MAKERS[maker.lower()] for maker in makers if maker.lower() in MAKERS]
    looked = list(dict.fromkeys(wanted)) if makers else list(catalogues)
    found = [
        Glass(glass, maker)
        for maker in looked
        for glass in catalogues.get(maker, ())
        if same(glass) == same(name)
    ]
    synonym = SYNONYMS.get(name.upper())
    if makers:  # Zemax also takes the first catalogue with the glass
        found = found[:1]
    elif found and synonym:
        found.append(Glass(synonym[1], synonym[0]))
    if not found and synonym:
        found = [Glass(synonym[1], synonym[0])]
    if len(found) == 1:
        return found[0]
    if found:
        raise Refused(
            f"{path} must say the maker of the glass {name}, which {', '.join(_of(found))} have"
        )
    raise Refused(
        f"{path} must have glasses that are known, got {shown(name)}"
        + (f" of the catalogues {', '.join(makers)}" if makers else "")
        + _nearest(name, catalogues)
        + "; a model glass of index and Abbe number may take its place"
    )


def _of(glasses: Sequence[Glass]) -> list[str]:
    return [f"{glass.maker} ({glass.name})" for glass in glasses]


def _nearest(name: str, catalogues: dict[str, list[str]]) -> str:
    """A sentence with the most similar names of all makers."""
    makers: dict[str, list[str]] = {}
    for maker, glasses in catalogues.items():
        for glass in glasses:
            makers.setdefault(glass.upper(), []).append(maker)
    for synonym in SYNONYMS:
        makers.setdefault(synonym, []).append("no maker")
    near = difflib.get_close_matches(name.upper(), makers, n=5, cutoff=0.5)
    if name.upper() in makers:
        near = [name.upper(), *(other for other in near if other != name.upper())]
    if not near:
        return ""
    return "; nearest are " + ", ".join(f"{other} ({', '.join(makers[other])})" for other in near)


def _catalogues() -> dict[str, list[str]]:
    """Names of glasses by maker, from the tracer."""
    _tracer()
    from optiland.materials import MaterialCatalog

    return {maker: MaterialCatalog(maker).list() for maker in sorted(set(MAKERS.values()))}


def _model(path: Path, index: float, abbe: float) -> Glass:
    if not (1 <= index < 5 and 5 < abbe < 200):
        raise Refused(
            f"{path} must have model glasses of an index in [1, 5) and an Abbe number in (5, 200), "
            f"got {index:g} and {abbe:g}"
        )
    return Glass(f"{index:g}:{abbe:g}", "", index, abbe)


def _unit(path: Path, word: str, units: dict[str, str]) -> str:
    if word.upper() not in units:
        raise Refused(
            f"{path} must have a unit of length of {', '.join(MILLIMETRES)}, got {shown(word)}"
        )
    return units[word.upper()]


def read_prescription(path: Path) -> Any:
    """The tracer's lens of a Zemax .zmx, CODE V .seq or optiland .json file, in millimetre.

    Raises  Refused if the file cannot be read, or as `parse_prescription`; ImportError without
            the extra `lens`.
    """
    tracer = _tracer()
    from optiland.materials import OptilandMaterialWarning

    path = Path(path)
    readers: dict[str, Callable[[str], Any]] = {
        ".zmx": tracer.load_zemax_file,
        ".seq": tracer.load_codev_file,
        ".json": tracer.load_optiland_file,
    }
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise Refused(
            f"{path} must be a prescription that ends with {', '.join(readers)}, got "
            f"{path.suffix or 'no suffix'}"
        )
    if not path.is_file():
        raise Refused(f"{path} must be a prescription, but there is no such file")
    prescription = None if suffix == ".json" else parse_prescription(path)
    try:
        with warnings.catch_warnings():
            # A glass of another name or maker in the tracer is an error, not only a warning.
            warnings.simplefilter("error", OptilandMaterialWarning)
            # For files that name no catalogue; the warning above then names the glass.
            warnings.filterwarnings("ignore", "Material .* has no 'catalog'", DeprecationWarning)
            if prescription is None:
                return readers[suffix](str(path))
            with tempfile.TemporaryDirectory() as folder:
                plain = Path(folder) / f"lens{suffix}"
                plain.write_text(prescription.text, encoding="utf-8")
                lens = readers[suffix](str(plain))
            _complete(path, lens, prescription)
            return lens
    except Refused:
        raise
    # The reader may raise any error in a file that it does not understand.
    except Exception as error:
        raise Refused(
            f"{path} must be a prescription, and the tracer says: {first_line(error)}"
        ) from None


def _complete(path: Path, lens: Any, prescription: Prescription) -> None:
    """Complete the tracer's lens with values that its text lacks; scale it to millimetre."""
    for surface, glass in prescription.glasses.items():
        lens.updater.set_material(_material(glass), surface)
    for surface, terms in prescription.aspheres.items():
        lens.surfaces[surface].geometry.coefficients = [0.0, *terms]
    for wave in lens.wavelengths.wavelengths:
        if not SHORTEST <= float(wave.value) <= LONGEST:
            raise Refused(
                f"{path} must have wavelengths from {SHORTEST:g} to {LONGEST:g} um, got "
                f"{float(wave.value):g} um (CODE V has them in nm, Zemax in um)"
            )
    if prescription.focused:
        lens.updater.image_solve()
    if prescription.defocus:
        last = len(lens.surfaces) - 2
        before = float(lens.surfaces.get_thickness(last)[0])
        lens.updater.set_thickness(before + prescription.defocus, last)
    if prescription.unit != "mm":
        scale = MILLIMETRES[prescription.unit]
        lens.updater.scale_system(scale)
        for surface in lens.surfaces:  # whose focal lengths, of PARAXIAL, it leaves as they are
            if hasattr(surface.interaction_model, "f"):
                surface.interaction_model.f *= scale


def _material(glass: Glass) -> Any:
    from optiland.materials import AbbeMaterial, MatchPolicy, Material

    if not glass.maker:
        return AbbeMaterial(glass.n_d, glass.abbe, model="buchdahl")
    return Material(glass.name, catalog=glass.maker, match_policy=MatchPolicy.STRICT)


def _tracer() -> Any:
    try:
        from optiland import fileio
    except ImportError as error:
        raise ImportError(
            "a prescription is traced by optiland; install it with: pip install 'startrack[lens]' "
            f"({error})"
        ) from None
    return fileio
