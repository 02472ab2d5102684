"""Case -> HeadModel: its error as data, as C code, and in the forms of simulators.

An FMU (Functional Mock-up Interface 2.0, co-simulation), the parameters of Basilisk's module
starTracker, and the star tracker's block of a spacecraft file of 42.
"""

import hashlib
import math
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from dataclasses import field as data_field
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from startrack.budget import Term, analytic, caveats, refusal, unit_budgets
from startrack.core import YEAR, Advance, Floats, Refused, arcsec, deg, whole
from startrack.design import Case, Moment, turning
from startrack.io import save_json, save_text
from startrack.io import whole as whole_file
from startrack.mission.heads import limits_of
from startrack.mission.parameters import Head
from startrack.mission.summary import timing_of
from startrack.population import unit_of

# Pixels that a star moves in an exposure at the rates of the table, besides 0; chosen by hand.
SMEARS: tuple[float, ...] = (0.1, 0.3, 0.7, 1.5, 3.0, 6.0, 12.0)
LEAST = 0.5  # availability below which the table of rates ends
# Errors of stars repeat from pixel to pixel, and decorrelate over a fraction of it; chosen by hand.
PIXEL_LENGTH = 0.5  # pixel
ENVIRONMENTS = 24  # of a unit
AT_REST = 400  # environments of the model's unit, for its swing; by hand: some seconds
SWING_KNOWN = (2 * AT_REST) ** -0.5  # relative sigma of the rms of this number of normal draws
RANKS = {"middle": 0.5, "95": 0.95, "worst": 1.0, "designed": math.nan}
CLASSES = {  # of the model, by those of ECSS-E-ST-60-20C
    "noise": (Term.NOISE,),
    "pixel": (Term.PIXEL,),
    "field": (Term.FIELD,),
    "bias": (Term.BIAS, Term.ABERRATION, Term.MEASUREMENT_DATE),
    "swing": (Term.THERMO_ELASTIC,),
    "platform": (Term.PLATFORM,),
}
CHANGING = ("noise", "pixel", "field")  # with the rate
SOURCES = ("startrack_head.c", "startrack_head.h")
CONVENTION = (
    "quaternion x, y, z, w (scalar last) of icrs_to_camera, which takes directions from ICRS axes "
    "into camera axes as u + 2 w (q x u) + 2 q x (q x u), q = (x, y, z): the conjugate of that of "
    "CCSDS 504.0, Basilisk (EP) and 42 for the same matrix; z boresight, x to larger columns, y to "
    "larger rows; measured = exp(error) true, with the error about the camera's axes; pairs are "
    "across (per axis) and about the boresight; SI units"
)
FMU_SOURCE = "startrack_fmu.c"
IDENTIFIER = "startrack_head"
EARLIEST = (1980, 1, 1, 0, 0, 0)  # of a file in a zip: the same bytes each day


@dataclass(frozen=True)
class HeadModel:
    """The error of a star tracker over rate and time; see startrack_head.h.

    name           of the design
    period         second, between two frames
    latency        second, from the middle of the exposure to the end of the read-out
    rate           (r,) radian / second across the boresight, from 0
    noise, pixel, field   ((r,), (r,)) radian rms across and about: temporal noise, pixel spatial
                   error, FOV spatial error
    available      (r,) 1, fraction of the sky and time with an attitude
    bias, swing    radian rms, across and about: constant, and thermo-elastic over an orbit
    platform       radian rms, across and about: the motion of the platform in an exposure, which
                   all heads share; the other errors do not include it
    unit           phrase: the unit of the design, and its age
    begin          radian rms at rest on its first day: class -> (across, about)
    left_out       sentences: effects of the design that the model lacks
    pixel_length, field_length   radian, turn of the boresight over which these errors change
    sun, moon, limb  radian, exclusion angles
    """

    name: str
    period: float
    latency: float
    rate: tuple[float, ...]
    noise: tuple[tuple[float, ...], tuple[float, ...]]
    pixel: tuple[tuple[float, ...], tuple[float, ...]]
    field: tuple[tuple[float, ...], tuple[float, ...]]
    available: tuple[float, ...]
    bias: tuple[float, float]
    swing: tuple[float, float]
    pixel_length: float
    field_length: float
    sun: float
    moon: float
    limb: float
    unit: str = "the unit as designed"
    begin: dict[str, tuple[float, float]] = data_field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    platform: tuple[float, float] = (0.0, 0.0)

    @property
    def at_rest(self) -> dict[str, tuple[float, float]]:
        """Radian rms at rest, across and about, of each class of error."""
        table = {name: getattr(self, name) for name in CHANGING}
        return {
            **{name: (across[0], about[0]) for name, (across, about) in table.items()},
            "bias": self.bias,
            "swing": self.swing,
            "platform": self.platform,
        }

    @property
    def table(self) -> dict[str, Any]:
        """For JSON, with the convention in words."""
        return {"convention": CONVENTION, **asdict(self)}


@dataclass(frozen=True)
class UnitChoice:
    """The unit of a design that a model describes.

    rank   of `RANKS`: by rms across the boresight with bias, of `count` units of `seed`, at `age`
    age    second; None: at the end of life
    """

    rank: str = "95"
    count: int = 20
    seed: int = 1
    age: float | None = None


def head_model(
    case: Case, name: str, choice: UnitChoice | None = None, progress: Advance | None = None
) -> HeadModel:
    """The error model of one unit of a design, by its analytic budget at each rate.

    choice    None: the 95 % unit of 20, by rms error, at the end of life. A design whose units do
              not differ has only the unit as designed.
    progress  called with 1 for each unit, and for each rate of at most `len(SMEARS)`
    Raises    ValueError if the budget refuses the case, or if no field has an attitude at rest.
    Accuracy  model: variances as in `budget.unit_budgets`. Assumed: errors over pixel and field are
              Gauss-Markov, with lengths of half a pixel and of a field. A roll counts as no rate.
              Above the rates of the table, which ends at a smear of 12 pixels, there is no
              attitude. A bias is drawn with the rms of the unit's bias.
    """
    choice = choice or UnitChoice()
    step = progress or (lambda done: None)
    unit = _unit_of(turning(case, 0.0), choice, step)
    rates, classes = _over_rates(case, unit, step)
    limits = limits_of(Head(name or "head", ""), case)
    camera, detector = case.instrument.camera, case.instrument.detector

    def over_rates(name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return tuple(rms[name][0] for rms in classes), tuple(rms[name][1] for rms in classes)

    expected = analytic(unit.case)
    left_out = [*refusal(case, expected.refused), *caveats(case, expected.left_out)]
    if unit.begin:
        left_out.append(
            "the phase of the swing in the orbit is drawn, and its rms is that of "
            f"{AT_REST} drawn environments, known to {100 * SWING_KNOWN:.0f} % (1 sigma)"
        )
    across, about = classes[0]["platform"]
    if across or about:
        left_out.append(
            f"the motion of the platform in an exposure, {across / arcsec:.3g} arcsec rms across "
            f"and {about / arcsec:.3g} about (platform): one motion for all heads, which a "
            "simulator that moves the platform has; others add it once, the same to all heads"
        )
    if case.instrument.stray is None:
        left_out.append(
            "stray light: without instrument.baffle or tube, Sun, Moon and lit limb blind only "
            "where they are in the field"
        )
    return HeadModel(
        name,
        *timing_of(case),
        tuple(rates),
        over_rates("noise"),
        over_rates("pixel"),
        over_rates("field"),
        tuple(rms["available"][0] for rms in classes),
        classes[0]["bias"],
        classes[0]["swing"],
        PIXEL_LENGTH / camera.focal_length_px,
        2 * math.atan(min(detector.columns, detector.rows) / 2 / camera.focal_length_px),
        limits.sun,
        limits.moon,
        limits.earth,
        unit.name,
        unit.begin,
        tuple(left_out),
        classes[0]["platform"],
    )


Classes = dict[str, tuple[float, float]]  # radian rms, across and about; "available": 1, twice


class _Unit(NamedTuple):
    """A unit of a design, and its classes of error.

    name     in words
    case     of the unit
    classes  of a case of this unit at some rate, background or angle
    rest     at rest
    begin    at rest on its first day
    """

    name: str
    case: Case
    classes: Callable[[Case], Classes]
    rest: Classes
    begin: Classes


def _unit_of(rest: Case, choice: UnitChoice, step: Advance) -> _Unit:
    if choice.rank not in RANKS:
        raise Refused(f"unit must be one of {', '.join(RANKS)}, got {choice.rank!r}")
    if not rest.differs or choice.rank == "designed":
        return _Unit("the unit as designed", rest, _designed, _designed(rest), {})
    whole(1, 10**4, units=choice.count)
    seed, age = choice.seed, rest.end_of_life if choice.age is None else choice.age
    budgets = unit_budgets(rest, seed, choice.count, age, ENVIRONMENTS, progress=step)
    rms = np.array([budgets.whole(unit).rms() for unit in range(choice.count)])
    order = np.argsort((rms[:, :2] ** 2).sum(axis=1), kind="stable")
    number = int(order[max(math.ceil(RANKS[choice.rank] * choice.count), 1) - 1])

    def at(case: Case, age: float, environments: int = ENVIRONMENTS) -> Classes:
        unit = unit_budgets(case, seed, 1, age, environments, first=number)
        terms = {term: values[0] for term, values in unit.terms.items()} | {Term.BIAS: unit.bias[0]}
        return _classes(terms, float(unit.availability[0]))

    still = at(rest, age, AT_REST)
    begin = at(rest, 0.0, AT_REST) if age else dict(still)
    del begin["available"]
    of = {"middle": "the middle one", "95": "95 % err less or as much", "worst": "the worst"}
    name = (
        f"unit {number} of {choice.count} of seed {seed} at {age / YEAR:g} yr: "
        f"{of[choice.rank]}, by rms across with bias at rest"
    )
    drawn = unit_of(rest, seed, Moment(number, 0, 0, age))
    return _Unit(name, drawn, lambda case: at(case, age), still, begin)


def _designed(case: Case) -> Classes:
    budget = analytic(case)
    terms = {term: np.asarray(budget.term(term)) for term in Term}
    # A term of the whole design has one value across and one value about.
    errors = {term: np.array([rms[0], rms[0], rms[1]]) for term, rms in terms.items()}
    return _classes(errors, float(budget.availability))


def _classes(terms: Mapping[Term, Floats], available: float) -> Classes:
    """Classes of the rms (3,) of each term about the axes of the camera."""
    classes: Classes = {"available": (available, available)}
    for name, parts in CLASSES.items():
        square = sum((terms[term] ** 2 for term in parts if term in terms), np.zeros(3))
        classes[name] = math.sqrt((square[0] + square[1]) / 2), math.sqrt(square[2])
    return classes


def _over_rates(case: Case, unit: _Unit, step: Advance) -> tuple[list[float], list[Classes]]:
    """The rates of the table, up to the last rate with an attitude in half of the sky."""
    pixel = 1 / case.instrument.camera.focal_length_px / case.instrument.detector.exposure
    rates, classes = [0.0], [unit.rest]
    for smear in SMEARS:
        rate = smear * pixel
        try:
            at_rate = unit.classes(turning(case, rate))
        except Refused:  # no field has an attitude
            break
        if at_rate["available"][0] < LEAST:
            break
        rates.append(rate)
        classes.append(at_rate)
        step(1)
    if len(rates) < 2:  # two rows at least, as tables have
        rates, classes = [0.0, SMEARS[0] * pixel / 100], [classes[0], classes[0]]
    return rates, classes


def write_model(folder: Path, model: HeadModel) -> list[Path]:
    """Write the model as JSON and as C; two of the C files are equal for all designs.

    Returns  the files
    """
    files = model_sources(model)
    for name, text in files.items():
        save_text(folder / name, text)
    save_json(folder / "startrack_head.json", model.table)
    return [folder / name for name in (*files, "startrack_head.json")]


def model_sources(model: HeadModel) -> dict[str, str]:
    """The C of the model, file by file."""
    files = {name: (Path(__file__).parent / name).read_text(encoding="utf-8") for name in SOURCES}
    return {**files, "startrack_head_data.h": _data(model)}


def _data(model: HeadModel) -> str:
    count = len(model.rate)
    single = {
        "PERIOD": model.period,
        "LATENCY": model.latency,
        "PIXEL": model.pixel_length,
        "FIELD": model.field_length,
        "SUN": model.sun,
        "MOON": model.moon,
        "LIMB": model.limb,
    }
    lines = [
        "/* Numbers of one design for startrack_head.c; radian and second.",
        *(f"   {line}" for line in fill(said_of(model), 96).splitlines()),
        "*/",
        "#ifndef STARTRACK_HEAD_DATA_H",
        "#define STARTRACK_HEAD_DATA_H",
        "",
        f"#define STARTRACK_RATES {count}",
        *(f"#define STARTRACK_{name} {value!r}" for name, value in single.items()),
        "",
        f"static const double startrack_rate[{count}] = {_row(model.rate)};",
        f"static const double startrack_available[{count}] = {_row(model.available)};",
        "/* across the boresight, about it */",
    ]
    for name in CHANGING:
        across, about = (_row(axis) for axis in getattr(model, name))
        lines.append(
            f"static const double startrack_{name}[2][{count}] = {{\n    {across},\n    {about}}};"
        )
    for name in ("bias", "swing"):
        lines.append(f"static const double startrack_{name}[2] = {_row(getattr(model, name))};")
    return "\n".join([*lines, "", "#endif", ""])


def said_of(model: HeadModel) -> str:
    """Sentences on the unit of a model, and on the effects that the model lacks."""
    return " ".join(f"{text[:1].upper()}{text[1:]}." for text in (model.unit, *model.left_out))


def _row(values: tuple[float, ...]) -> str:
    parts = [repr(float(value)) for value in values]
    rows = [", ".join(parts[k : k + 4]) for k in range(0, len(parts), 4)]
    return "{" + ",\n     ".join(rows) + "}"


class ModelVariable(NamedTuple):
    """A real variable of the FMU, in the order of its numbers."""

    name: str
    causality: str
    unit: str
    start: float
    about: str


VARIABLES = (
    ModelVariable("rate", "input", "rad/s", 0.0, "across the boresight"),
    ModelVariable(
        "sun", "input", "rad", 4.0, "from the boresight to the Sun; 4 where it is hidden"
    ),
    ModelVariable(
        "moon", "input", "rad", 4.0, "from the boresight to the Moon; 4 where it is hidden"
    ),
    ModelVariable(
        "limb", "input", "rad", 4.0, "from the boresight to the Earth's lit limb; 4: none"
    ),
    ModelVariable("orbit", "input", "rad", 0.0, "phase of the orbit"),
    *(
        ModelVariable(f"true_{axis}", "input", "1", float(axis == "w"), "true quaternion, w scalar")
        for axis in "xyzw"
    ),
    *(
        ModelVariable(f"error_{axis}", "output", "rad", 0.0, "rotation vector, camera axes")
        for axis in "xyz"
    ),
    *(
        ModelVariable(f"measured_{axis}", "output", "1", float(axis == "w"), "measured quaternion")
        for axis in "xyzw"
    ),
)


def write_fmu(path: Path, model: HeadModel) -> bool:
    """Write the model as an FMU: description, sources, and the library for this platform.

    Frames are taken at multiples of the model's period. Outputs are those of the last frame; the
    latency is not applied. If an FMU has no library for a platform, some tools can compile its
    sources.

    Returns  whether a C compiler was found; the FMU then contains a library for this platform
    Raises   ValueError if the compiler refuses the sources.
    """
    files = model_sources(model)
    files[FMU_SOURCE] = (Path(__file__).parent / FMU_SOURCE).read_text(encoding="utf-8")
    content = "".join(files.values()).encode()
    guid = hashlib.blake2b(content, digest_size=16).hexdigest()
    data = "startrack_head_data.h"
    define = f'#define STARTRACK_GUID "{guid}"\n\n#endif'
    files[data] = define.join(files[data].rsplit("#endif", 1))
    members = {f"sources/{name}": text.encode() for name, text in files.items()}
    members["modelDescription.xml"] = _description(model, guid, [*files]).encode()
    library = _library(files)
    if library is not None:
        members[library[0]] = library[1]
    with whole_file(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as file:
        for name in sorted(members):
            file.writestr(zipfile.ZipInfo(name, EARLIEST), members[name], zipfile.ZIP_DEFLATED)
    return library is not None


def _library(files: dict[str, str]) -> tuple[str, bytes] | None:
    """Name in the FMU and bytes of the library for this platform; None without a compiler."""
    compiler = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
    if compiler is None:
        return None
    system = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("win", "dll")}
    name, end = system.get(platform.system(), ("linux", "so"))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        sources = [file for file in files if file.endswith(".c")]
        build = [compiler, "-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden", *sources]
        made = subprocess.run(
            [*build, "-lm", "-o", "library"], cwd=folder, capture_output=True, text=True
        )
        if made.returncode:
            reason = (made.stderr.strip().splitlines() or ["it said nothing"])[0]
            raise Refused(f"{compiler} must compile the FMU's sources, but: {reason}")
        return f"binaries/{name}64/{IDENTIFIER}.{end}", (folder / "library").read_bytes()


def _description(model: HeadModel, guid: str, files: Sequence[str]) -> str:
    """The modelDescription.xml of FMI 2.0."""
    rows, outputs = [], []
    for number, variable in enumerate(VARIABLES):
        start = f' start="{variable.start!r}"' if variable.causality == "input" else ""
        if variable.causality == "output":
            outputs.append(number + 1)
        rows.append(
            f'    <ScalarVariable name="{variable.name}" valueReference="{number}" '
            f'causality="{variable.causality}" variability="continuous" '
            f"description={quoteattr(variable.about)}>"
            f'<Real unit="{variable.unit}"{start}/></ScalarVariable>'
        )
    rows.append(
        '    <ScalarVariable name="valid" valueReference="0" causality="output" '
        'variability="discrete" description="whether there is an attitude"><Boolean/>'
        "</ScalarVariable>"
    )
    outputs.append(len(rows))
    rows.append(
        '    <ScalarVariable name="seed" valueReference="0" causality="parameter" '
        'variability="fixed" description="of the errors"><Integer start="1"/></ScalarVariable>'
    )
    units = "\n".join(f'    <Unit name="{unit}"/>' for unit in ("1", "rad", "rad/s"))
    listed = "".join(f'<File name="{name}"/>' for name in files if name.endswith(".c"))
    ends = "\n".join(f'      <Unknown index="{number}"/>' for number in outputs)
    variables = "\n".join(rows)
    about = quoteattr(f"{said_of(model)} {CONVENTION}")
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(model.name or IDENTIFIER)}
    guid="{guid}" description={about} generationTool="startrack">
  <CoSimulation modelIdentifier="{IDENTIFIER}" canHandleVariableCommunicationStepSize="true"
      canNotUseMemoryManagementFunctions="true"><SourceFiles>{listed}</SourceFiles></CoSimulation>
  <UnitDefinitions>
{units}
  </UnitDefinitions>
  <DefaultExperiment startTime="0.0" stopTime="60.0" stepSize="{model.period!r}"/>
  <ModelVariables>
{variables}
  </ModelVariables>
  <ModelStructure>
    <Outputs>
{ends}
    </Outputs>
    <InitialUnknowns>
{ends}
    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def one_process(model: HeadModel, rate: float) -> list[tuple[float, float]]:
    """Noise, pixel and field error together as one first-order process, across and about.

    Returns   radian rms, and the correlation from frame to frame
    Accuracy  model: beyond one frame the correlation falls faster than the true one, which has a
              slow part; bias and thermo-elastic swing are left out.
    """
    process = []
    for k in (0, 1):
        noise, pixel, field = (
            float(np.interp(rate, model.rate, getattr(model, name)[k])) ** 2 for name in CHANGING
        )
        slow = pixel * math.exp(-model.period * rate / model.pixel_length)
        slow += field * math.exp(-model.period * rate / model.field_length)
        total = noise + pixel + field
        process.append((math.sqrt(total), slow / total if total else 0.0))
    return process


def write_basilisk(path: Path, model: HeadModel, rate: float) -> None:
    """Write a Python file whose `configure` sets Basilisk's starTracker module.

    The module's error state is x <- A x + P w, about the body's axes, with white w; see its
    starTracker.cpp. It has no availability, which a scenario must switch by itself.

    rate  radian / second across the boresight, at which the error is taken
    """
    across, about = one_process(model, rate)
    axes = (across, across, about)
    save_text(
        path,
        _BASILISK.format(
            name=model.name,
            rate=rate,
            period=model.period,
            latency=model.latency,
            keep=[keep for _, keep in axes],
            bound=[10 * sigma for sigma, _ in axes],
            step=[sigma * math.sqrt(1 - keep * keep) for sigma, keep in axes],
            sun=model.sun,
            moon=model.moon,
            limb=model.limb,
            bias=model.bias,
            swing=model.swing,
            platform=model.platform,
            said=fill(said_of(model), 99),
            available=float(np.interp(rate, model.rate, model.available)),
        ),
    )


_BASILISK = '''"""Error of the star tracker {name!r} for Basilisk's starTracker, by startrack.

At {rate!r} rad/s across the boresight; run the module once a frame, each {period!r} s. The sum of
noise, pixel and field errors is one first-order process; the module has no place for the bias, the
swing and the availability, which stand below for the scenario.

{said}
"""

PERIOD = {period!r}  # second, between frames
LATENCY = {latency!r}  # second, from the middle of the exposure
KEEP = {keep!r}  # A in camera axes x, y, z (boresight): correlation from frame to frame
STEP = {step!r}  # P in camera axes, radian
BOUND = {bound!r}  # radian, ten times the rms
SUN, MOON, LIMB = {sun!r}, {moon!r}, {limb!r}  # radian, exclusion angles
BIAS, SWING = {bias!r}, {swing!r}  # radian rms, across and about; not set by configure
PLATFORM = {platform!r}  # radian rms, across and about, its motion in an exposure; not set either
AVAILABLE = {available!r}  # 1, fraction of the sky with an attitude; not set by configure


def configure(sensor, dcm_cb):
    """Set a StarTracker; dcm_cb is the 3 x 3 matrix from body to camera axes, rows of lists."""
    def in_body(values):
        return [
            [sum(dcm_cb[k][i] * values[k] * dcm_cb[k][j] for k in range(3)) for j in range(3)]
            for i in range(3)
        ]

    sensor.dcm_CB = [list(row) for row in dcm_cb]
    sensor.PMatrix = in_body(STEP)
    bound = [max(BOUND)] * 3
    if hasattr(sensor, "setAMatrix"):
        sensor.setAMatrix(in_body(KEEP))
        sensor.setWalkBounds(bound)
    else:
        sensor.AMatrix = in_body(KEEP)
        sensor.walkBounds = bound
'''


def write_42(path: Path, model: HeadModel, field: tuple[float, float], rate: float) -> None:
    """Write the star tracker's block of a spacecraft file (SC_*.txt) of the simulator 42.

    42 has white noise, so all varying errors count as white noise; bias and swing are left out.

    field  radian, along columns and rows
    rate   radian / second across the boresight
    """
    across, about = (f"{sigma / arcsec:.6g}" for sigma, _ in one_process(model, rate))
    sun, limb, moon = (f"{limit / deg:.6g}" for limit in (model.sun, model.limb, model.moon))
    rows = (
        (f"{model.period:.6g}", "sample time, s"),
        ("0  0  0  321", "mounting angles, deg, and their sequence in the body"),
        ("Z_AXIS", "boresight"),
        (f"{field[0] / deg:.6g}  {field[1] / deg:.6g}", "field, deg, horizontal and vertical"),
        (f"{sun}  {limb}  {moon}", "exclusion angles of Sun, Earth and Moon, deg"),
        (f"{across}  {across}  {about}", "noise equivalent angle, arcsec rms, x, y, z"),
        ("0", f"node; left out: {_arcsec_of('bias', model)}, {_arcsec_of('swing', model)}"),
    )
    head = "============================== ST 0 ====================================="
    save_text(path, "\n".join([head, *(f"{value:<28}! {about}" for value, about in rows), ""]))


def _arcsec_of(name: str, model: HeadModel) -> str:
    across, about = (error / arcsec for error in getattr(model, name))
    return f"{name} {across:.3g} and {about:.3g} arcsec rms across and about"
