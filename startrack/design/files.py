"""Design files: a case, and optionally a campaign on it, as TOML with units in strings."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from startrack.core import Refused, code_in, printed, require_code, shown, um
from startrack.core import allow_code as allow_code_of
from startrack.design.campaign import Campaign
from startrack.design.case import Case, Instrument
from startrack.design.conditions import Change, Condition
from startrack.design.measured_tables import with_measured_tables
from startrack.design.products import (
    DETECTOR,
    KEPT,
    OPERATED,
    of_product,
    product_file,
    with_product,
    with_product_files,
)
from startrack.design.products import PLACE as PRODUCT
from startrack.design.spectrum import PLACE as SPECTRA
from startrack.design.spectrum import with_spectra
from startrack.design.told import FRAME_FIGURES, Told
from startrack.design.unknown import (
    APERTURE,
    F_NUMBER,
    INSTEAD,
    OPTICS,
    Quantile,
    Unknown,
    UnknownReader,
    is_law,
    stratified,
    with_laws,
)
from startrack.design.variables import Link
from startrack.design.variation import Scope
from startrack.detector import Age
from startrack.io import (
    LayerRules,
    Layers,
    Renewed,
    from_table,
    read_layers,
    refuse_unknown,
    save_toml,
    to_table,
)
from startrack.optics import with_plain_optics

# Lists of tables that included files extend, and the keys that identify equal entries.
JOINED = {"variation": {"name": None, "per": str(Scope.UNIT)}}
# A product of the catalogue replaces a detector; the keys by which a mission operates it are kept.
RENEWED = {DETECTOR: Renewed("product", (*KEPT, *OPERATED))}


@printed
@dataclass(frozen=True)
class Design:
    """Contents of a design file.

    case      the instrument, the tracker, the scene and the sky
    campaign  the campaign on the design; None if the file has none
    unknowns  unknown values of the file, each with its law; the case has one value of each
    told      figures of the design that were measured or published
    """

    case: Case
    campaign: Campaign | None = None
    unknowns: tuple[Unknown, ...] = ()
    told: tuple[Told, ...] = ()

    @property
    def open_unknowns(self) -> tuple[Unknown, ...]:
        """Unknown values that no variable, link or choice of the campaign replaces."""
        if self.campaign is None:
            return self.unknowns
        replaced = {variable.name for variable in self.campaign.variables}
        replaced |= {link.name for link in self.campaign.links}
        replaced |= {choice.name for choice in self.campaign.choices}
        for table, keys in INSTEAD.items():
            pair = {f"{table}.{key}" for key in keys}
            replaced |= pair if replaced & pair else set()

        def is_replaced(name: str) -> bool:
            # A choice of the detector replaces all but a few of its keys.
            table, _, key = name.rpartition(".")
            return name in replaced or (table in replaced and key not in (*KEPT, *OPERATED))

        return tuple(unknown for unknown in self.unknowns if not is_replaced(unknown.name))

    @property
    def undrawn(self) -> tuple[Unknown, ...]:
        """Unknown values that stay at their middle in all conditions of `asked`."""
        draws = self.campaign is not None and self.campaign.unknown_draws > 0
        return tuple(
            unknown for unknown in self.open_unknowns if not (draws and unknown.of_one_key)
        )

    @property
    def asked(self) -> Campaign | None:
        """The campaign, with draws of the unknown values among the conditions.

        The draws are a Latin hypercube: the range of each unknown is divided into equally probable
        intervals, and each draw has a value from another interval. They are the same for all seeds,
        so that designs are compared on the same draws.

        Raises  Refused if draws are required, but no unknown can be drawn.
        """
        campaign = self.campaign
        if campaign is None or not campaign.unknown_draws:
            return campaign
        unknowns = [unknown for unknown in self.open_unknowns if unknown.of_one_key]
        if not unknowns:
            raise Refused(
                "campaign.unknown_draws must be 0 if no value of the design is unknown, or if the "
                "campaign varies all of them or they are choices of files, got "
                f"{campaign.unknown_draws}"
            )
        count = campaign.unknown_draws
        quantiles = {unknown.name: stratified(1, unknown.name, count) for unknown in unknowns}
        draws = tuple(
            Condition(
                name=f"draw {number + 1}",
                change=tuple(
                    Change(unknown.name, unknown.at(float(quantiles[unknown.name][number])))
                    for unknown in unknowns
                ),
            )
            for number in range(count)
        )
        return replace(campaign, conditions=(*campaign.conditions, *draws))

    @property
    def _rows(self) -> list[tuple[str, str]]:
        rows = self.case._rows
        if self.campaign is not None:
            rows.append(("variables", str(len(self.campaign.variables))))
        return rows


def load_design(
    path: Path,
    changes: Sequence[str] = (),
    allow_code: bool = False,
    quantile: Quantile | None = None,
) -> Design:
    """Read a design file.

    `product = "cmv4000"` under `[instrument.detector]` takes the values of that detector from the
    catalogue. Other keys of the table override them, in this file and in files that refer to it.
    From the files to which this file refers, only exposure, frame rate, binning, row delay and age
    are kept. `product = "mine.toml"` takes the values from a file next to the design file. `file =
    "psd.csv"` under `[[instrument.motion.broadband]]` takes a power spectrum of jitter from a file
    next to the design file. `aperture = "25 mm"` under `[instrument.optics]` replaces `f_number`,
    also the f-number of files to which this file refers. A campaign that varies the focal length
    keeps the aperture. `file = "levels.csv"` under `[[told]]` is a table of a photon transfer or of
    stars, next to the design file, which gives several figures: `reduced_transfer`,
    `reduced_stars`. `base = "other.toml"` and `include = ["a.toml"]` at the top of the file take
    the values of other files, see `read_layers`. The `[[variation]]` tables of all files count; a
    table replaces an earlier one with the same `name` and `per`.

    Instead of an unknown value, the file may give a law: `{ low = 1.2, high = 2.0 }`, `{ median =
    "1 um", factor = 2.8 }` or `{ among = ["has2", "star1000"], weight = [2, 1] }`. In `include`, it
    may be one of several files: `{ among = ["variations/lens-made.toml", ...] }`.

    changes     values that replace the file's: "instrument.optics.f_number=2.0"
    allow_code  whether the code that the file names may run, in this process and its workers; it is
                imported at once. False: only code that is allowed in another way, see
                docs/extensions.md
    quantile    function: name of an unknown value -> its quantile in (0, 1), or None for its
                middle; None: all are at their middle
    Raises      ValueError, one sentence with the file of the value, the position in it, the rule
                and the value.
    """
    path = Path(path)
    reader = UnknownReader(quantile)
    rules = LayerRules(JOINED, RENEWED, INSTEAD, is_law, reader.file)
    layers = read_layers(path, "a design file", changes, rules)
    table = layers.table
    try:
        campaign, told = table.pop("campaign", None), table.pop("told", [])
        if isinstance(campaign, dict):
            with_product_files(campaign.get("choices"), layers.folder_of("campaign.choices", path))
        with_spectra(table, layers.folder_of(SPECTRA, path))
        table = _with_product(reader.table(table), layers, path)
        keeps_aperture = _has_aperture(table)
        if isinstance(instrument := table.get("instrument"), dict):
            table["instrument"] = with_plain_optics(instrument, Instrument, "instrument")
        refuse_unknown((Case, table, ""), (Campaign, campaign, "campaign"))
        if not isinstance(told, list):
            raise Refused(f"told must be a list of tables, got {shown(told)}")
        told = with_measured_tables(told, layers.folder_of("told", path))
        study = None if campaign is None else from_table(Campaign, campaign, "campaign")
        design = Design(
            from_table(Case, table),
            with_aperture(study) if study and keeps_aperture else study,
            tuple(reader.found),
            tuple(_told(entry, f"told[{n}]") for n, entry in enumerate(told)),
        )
        _require_code(design, allow_code)
        return design
    except ValueError as error:
        raise Refused(layers.blamed(str(error), path)) from None


def _with_product(table: dict[str, Any], layers: Layers, path: Path) -> dict[str, Any]:
    """A design with the values of its detector's product, whose file the layers note."""
    folder = layers.folder_of(PRODUCT, path)
    match table:
        case {"instrument": {"detector": {"product": product}}}:
            if file := product_file(product, folder):
                layers.note_below(of_product(product, folder), str(file), DETECTOR)
                whole = with_product(table, folder)
                _warn_of_depth(whole["instrument"]["detector"].get("age"), file.name)
                return whole
    return with_product(table, folder)


def _warn_of_depth(age: Any, file: str) -> None:
    """Warn of a detector that ages and does not say how deep its silicon is depleted."""
    if isinstance(age, dict) and "depleted" not in age:
        warnings.warn(
            f"{file} gives no age.depleted, so that its default of {Age.depleted / um:g} um holds "
            "for the dark current by radiation",
            stacklevel=3,
        )


def _told(entry: object, place: str) -> Told:
    """A figure of `[[told]]`; figures of frames have no unit, so their key is not that of errors.

    place  place of the entry, for messages
    """
    match entry:
        case {"figure": str(figure), "value": _} if figure in FRAME_FIGURES:
            raise Refused(
                f"{place}.value must be left out for the told figure {figure!r}: its key is "
                f"number, in {FRAME_FIGURES[figure]}"
            )
    return from_table(Told, entry, place)


def _has_aperture(table: Mapping[str, Any]) -> bool:
    """Whether the table of a design gives an aperture instead of an f-number."""
    match table:
        case {"instrument": {"optics": dict() as optics}}:
            return APERTURE in optics
    return False


def _require_code(design: Design, allow: bool) -> None:
    """Refuse a design that names code which may not run; `allow` allows it first."""
    named = list(code_in(design.case))
    named += code_in(design.campaign, "campaign") if design.campaign else ()
    if allow:
        allow_code_of(*(name.partition(":")[0] for _, _, name in named))
    require_code(named)


def with_aperture(campaign: Campaign) -> Campaign:
    """The campaign; if it varies the focal length alone, it keeps the aperture of the design."""
    names = {variable.name for variable in campaign.variables}
    names |= {link.name for link in campaign.links}
    length, others = f"{OPTICS}.focal_length", {f"{OPTICS}.{key}" for key in INSTEAD[OPTICS]}
    if length not in names or names & others:
        return campaign
    return replace(campaign, links=(*campaign.links, Link(f"{OPTICS}.{F_NUMBER}", length)))


def save_design(path: Path, design: Design, comment: str = "") -> None:
    """Write a design file that `load_design` reads back to an equal design.

    All values of the detector are written, not the name of a product, whose values may change.
    Unknown values keep their laws, except the choice among included files: the values of the chosen
    file are written.
    """
    table = table_of(design)
    if design.told:
        table["told"] = [to_table(told) for told in design.told]
    save_toml(path, table, comment)


def table_of(design: Design) -> dict[str, Any]:
    """The case and the campaign as a table, with the laws of unknown values."""
    table = with_laws(to_table(design.case), design.unknowns)
    return table if design.campaign is None else table | {"campaign": to_table(design.campaign)}
