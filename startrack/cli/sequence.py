"""`startrack sequence`: a tracker in time."""

from __future__ import annotations

import argparse
from pathlib import Path

from startrack.cli.options import DESIGN, SEED, WORKERS, Exit, Option, Options, out, wanted, whole

if wanted(__name__):
    from startrack import plots
    from startrack.cli import terminal
    from startrack.core import arcsec
    from startrack.design import Fidelity
    from startrack.io import finite, save_json, shipped
    from startrack.metrics import ARCSEC, PERCENT, SECOND, Row, bracketed, to_json, to_lines
    from startrack.montecarlo import export, pool
    from startrack.sequence import Recording, Tracking, fly_sequences, summarise_sequences


declare = Options(
    "Simulates a profile frame by frame, from random attitudes, and prints the errors of the "
    "filter and of single frames. Writes frames.csv, sequence.png and summary.json. The status "
    "is 3 if the attitude was not known after each frame.",
    *DESIGN,
    Option(
        "--profile PROFILE.toml",
        "file with the legs of the attitude profile, frame rate and gyroscope, and further "
        "heads, or the name of a shipped profile: slew, with a slew too fast for an attitude "
        "(the default), or two_heads",
        Path,
    ),
    Option("--sequences N", "number of sequences, from random attitudes", whole(1), 8),
    Option(
        "--frames",
        "keep the frames of all sequences in the folder frames: FITS with WCS, "
        "16-bit PNG, SER, raw, or lossless video (mkv), and a table of their times and true "
        "attitudes for each sequence",
        ("fits", "png", "ser", "raw", "mkv"),
    ),
    Option(
        "--stars",
        "keep the images and places of each matched star over time in the folder frames, for "
        "compare-flight",
    ),
    Option(
        "--fidelity",
        "frame, or window: only windows of each frame are rendered, which is faster without "
        "flicker of pixels",
        ("frame", "window"),
        "frame",
    ),
    SEED,
    WORKERS,
    out("startrack-sequence"),
)


def command(options: argparse.Namespace) -> int:
    """Print accuracy, losses and reacquisitions; write frames.csv, sequence.png, summary.json."""
    design = options.design or terminal.example()
    profile = options.profile or shipped("sequences/slew.toml")
    case, sequence = terminal.read_design(design, options.set).case, terminal.read_sequence(profile)
    kept = options.frames or options.stars
    recording = Recording(options.out / "frames", options.frames, options.stars) if kept else None
    with (
        pool(min(options.workers, options.sequences)) as executor,
        terminal.progress("sequences", options.sequences) as advance,
    ):
        table = fly_sequences(
            case,
            sequence,
            options.sequences,
            options.seed,
            executor,
            advance,
            recording,
            Fidelity(options.fidelity),
        )
    tracking = summarise_sequences(table)
    result = {"design": str(design), "profile": str(profile), "seed": options.seed}
    rows = _rows(tracking, len(sequence.heads))
    result |= to_json(rows) | {"frames": len(table), "out": str(options.out)}
    export(options.out / "frames.csv", table)
    first = table[table["sequence"] == 0]
    title = f"{Path(design).stem}, {Path(profile).stem}: sequence 1 of {options.sequences}"
    plots.draw_sequence(options.out / "sequence.png", first, title)
    save_json(options.out / "summary.json", finite(result))
    counted = (
        f"{len(table)} frames in {tracking.sequences} sequences; intervals: 95 % confidence, "
        "open for a single sequence"
    )
    terminal.print_result(options, result, _answer(tracking), "", *to_lines(rows), counted)
    return Exit.DONE if tracking.known.value == 1 else Exit.UNSOLVED


def _answer(tracking: Tracking) -> str:
    """Fraction of the frames with an attitude, errors of the filter, and losses of track."""
    if not tracking.known.value > 0:
        return "no attitude in any frame, and no error of the filter"
    across, about = (bracketed(error, ".3f", arcsec) for error in (tracking.across, tracking.about))
    return (
        f"attitude known in {100 * tracking.known.value:.2f} % of the frames; error of the filter "
        f"{across} arcsec across and {about} about the boresight, rms per axis; "
        f"{tracking.losses_per_hour.value:.3g} losses of track per hour"
    )


def _rows(tracking: Tracking, heads: int) -> list[Row]:
    return [
        Row(
            "across_rms_arcsec",
            tracking.across,
            "filter across the boresight",
            ARCSEC,
            note="rms per axis, after frames that measured it",
        ),
        Row("about_rms_arcsec", tracking.about, "filter about the boresight", ARCSEC, note="rms"),
        Row(
            "single_rms_arcsec",
            tracking.single,
            "frames alone, across",
            ARCSEC,
            note="rms per axis",
        ),
        Row(
            "coasted_rms_arcsec",
            tracking.coasted,
            "while it coasts, across",
            ARCSEC,
            note="rms per axis, of all frames",
        ),
        Row("worst_arcsec", tracking.worst, "worst, all axes", ARCSEC, note="of all frames"),
        Row(
            "beyond",
            tracking.beyond,
            "wrong by half a degree or more",
            PERCENT,
            note="of the frames",
        ),
        Row("known", tracking.known, "attitude known", PERCENT, note="of the frames"),
        Row("losses_per_hour", tracking.losses_per_hour, "losses of track, per hour"),
        Row("reacquisition", tracking.reacquisition, "from loss to attitude", SECOND),
        *[
            Row(
                "alignment_rms_arcsec",
                tracking.alignment,
                "alignment of further heads",
                ARCSEC,
                note="rms per axis, at the end",
            )
        ]
        * bool(heads),
        Row("sequences", tracking.sequences),
    ]
