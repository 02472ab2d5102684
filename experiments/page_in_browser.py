"""`startrack page` in a headless Chromium: speed, and agreement of its numbers with the commands.

    python experiments/page_in_browser.py [--json FILE] [--designs NAME ...] [--moves N]

move_ms_95        for each design, 95 % quantile of the time of a slider's move, from the event to
                  the painted bars and sky, ms; each move is to a random place of a random slider
images_ms_95      likewise, to the painted frame, which another process computes meanwhile
move_cpu_ms       mean CPU time of the server for a move, without the frame, ms; move_ms_95 is
                  larger on shared cores
units_first       1: the first sentence is the objective over units and conditions as soon as it is
                  computed; until then it says that it is being computed
search_visible_s  longest time from a line of search.jsonl to its point on the page, s
saved_same        1: the saved file gives the numbers shown by `startrack budget`, digit by digit
offline           1: no request goes to another host, and no other address can be reached
sentences         1: a second tab, a stale token, a broken file and a killed server each give a
                  message that the user sees
page_lines        non-blank lines of Python and of JavaScript, HTML and CSS, without uPlot
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import command
import numpy as np
from browser import Browser, browser, installed

import startrack
from startrack import shipped

READY = (
    "typeof begun !== 'undefined' && sides.A && sides.A.shown && !sides.A.painting"
    " && sides.A.images && !sides.A.imaging"
)
IMAGES = "return performance.getEntriesByName('images').map((entry) => entry.duration)"
MOVE = """
const [n, part] = arguments;
const range = document.querySelectorAll('#sliders input[type=range]')[n];
const count = performance.getEntriesByName('move').length;
range.value = Math.round(1000 * part);
range.dispatchEvent(new Event('input'));
for (;;) {
  const moves = performance.getEntriesByName('move');
  if (moves.length > count && !sides[active].painting) {
    range.dispatchEvent(new Event('change'));
    return done(moves[moves.length - 1].duration);
  }
  await new Promise((next) => setTimeout(next, 2));
}
"""
# Few evaluations, so that a search takes a minute.
SEARCH = (
    "campaign.analytic_evaluations=16",
    "campaign.evaluations=3",
    "campaign.trials=20",
    "campaign.most_trials=40",
    "campaign.fresh_trials=100",
    "campaign.fidelity=covariance",
)


@contextmanager
def served(design: str | Path, folder: Path, *words: str) -> Iterator[tuple[Any, str]]:
    """The process and the address of a page."""
    line = [sys.executable, "-m", "startrack.cli", "page", str(design), "--json", "--workers", "1"]
    line += ["--out", str(folder), *words]
    with subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout
        try:
            yield process, json.loads(process.stdout.readline())["address"]
        finally:
            process.terminate()


def moves_of(page: Browser, count: int, seed: int = 1) -> list[float]:
    """Times of moves, from event to painted page, millisecond."""
    random = np.random.default_rng(seed)
    sliders = page.run("return sides.A.shown.sliders.length")
    return [
        page.promised(MOVE, int(random.integers(sliders)), float(random.random()))
        for _ in range(count)
    ]


def cpu_ms(process: int) -> float:
    """CPU time of a process without its children, millisecond."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return 1e3 * (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def saved_same(page: Browser, folder: Path) -> bool:
    """Whether the saved design gives the shown numbers."""
    page.run("document.getElementById('save').requestSubmit()")
    page.until("!document.getElementById('note').hidden")
    shown = page.run("return [sides.A.shown.across, sides.A.shown.about]")
    line = [sys.executable, "-m", "startrack.cli", "budget", str(folder / "mine.toml"), "--json"]
    printed = subprocess.run(line, capture_output=True, text=True).stdout
    whole = json.loads(printed)["analytic"]["end to end"]
    return bool(shown == [whole["across"], whole["about"]])


def units_first(page: Browser) -> bool:
    """Whether the first sentence is that of units and conditions, if the design has any."""
    answer = "sides.A.box.querySelector('.answer').textContent"
    waiting = "sides.A.shown.later && !sides.A.later"
    early = page.run(f"return !({waiting}) || {answer}.endsWith('being computed')")
    page.until(f"!({waiting}) && !sides.A.painting")
    late = page.run(f"return !sides.A.later || {answer}.startsWith(sides.A.later.objective)")
    return bool(early and late)


def compared(page: Browser) -> bool:
    """Whether two designs are shown side by side on the same sky and noise."""
    page.run("document.getElementById('compare').click()")
    page.until("sides.B && sides.B.shown && !sides.B.painting")
    page.promised(MOVE, 1, 0.2)
    page.until(READY.replace("sides.A", "sides.B"))
    same = page.run(
        "const [a, b] = [sides.A, sides.B];"
        "const sky = (side) => side.images.text.split(';')[0];"
        "return sky(a).startsWith('RA') && sky(a) === sky(b) && a.shown.across !== b.shown.across"
    )
    page.run("document.getElementById('compare').click()")
    return bool(same)


def search(page: Browser, folder: Path) -> dict[str, Any]:
    """Start, watch, stop and continue a search. Returns the longest wait for a line."""
    log, written, ended = folder / "search" / "search.jsonl", list[float](), threading.Event()

    def watch() -> None:
        while not ended.is_set():
            text = log.read_text() if log.exists() else ""
            new = text.count('"values"') - len(written)
            written.extend([time.monotonic()] * new)
            time.sleep(0.01)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    seen = list[float]()
    page.run("document.querySelector('#search [data-do=start]').click()")
    while len(seen) < 12:
        count = page.run("return document.querySelectorAll('#search [data-n]').length")
        seen.extend([time.monotonic()] * (count - len(seen)))
        time.sleep(0.02)
    ended.set()
    watcher.join()
    waits = [shown - known for shown, known in zip(seen, written, strict=False)]
    page.run("document.querySelector('#search [data-do=stop]').click()")
    line = "document.querySelector('#search .line').textContent"
    page.until(f"{line}.startsWith('Stopped')")
    page.run("document.querySelector('#search [data-do=start]').click()")
    page.until(f"{line}.startsWith('Ended')", 600)
    best = page.run("return document.querySelector('#search .best').textContent")
    return {"search_visible_s": max(waits), "best": best}


def sentences(folder: Path) -> dict[str, str]:
    """Messages to the user by kind of fault."""
    said, message = {}, "document.getElementById('message')"
    design = folder / "mine.toml"
    design.write_text(f'base = "{shipped("designs/noise_only.toml")}"\n')
    with browser() as page:
        with served(design, folder / "first") as (process, address):
            page.open(address)
            page.until(READY, 600)
            first = page.run("return location.href")
            page.new_tab()
            page.open(first)
            page.until("!document.getElementById('note').hidden", 600)
            said["second tab"] = page.run("return document.getElementById('note').textContent")
            page.until(READY, 600)
            design.write_text("[instrument\n")
            page.promised(MOVE.replace("moves.length > count &&", "count >= 0 &&"), 1, 0.5)
            page.until(f"document.querySelector('.answer').textContent.includes('{design.name}')")
            said["broken file"] = page.run("return document.querySelector('.answer').textContent")
            design.write_text(f'base = "{shipped("designs/noise_only.toml")}"\n')
            process.kill()
            process.wait()
            page.run("sides.A.paint()")
            page.until(f"!{message}.hidden")
            said["killed server"] = page.run(f"return {message}.textContent")
        port = address.partition("/?")[0].rpartition(":")[2]
        with served(design, folder / "second", "--port", port):
            page.run("sides.A.paint()")
            page.until(f"{message}.textContent.includes('token')")
            said["stale token"] = page.run(f"return {message}.textContent")
    return said


def page_lines() -> dict[str, int]:
    """Lines of the page by language."""
    home = Path(startrack.__file__).parent
    python = [*(home / "page").glob("*.py"), home / "cli" / "page.py"]
    files = (home / "page" / "files").iterdir()
    shown = [file for file in files if "uPlot" not in file.name]
    return {
        kind: sum(bool(line.strip()) for path in paths for line in path.open(encoding="utf-8"))
        for kind, paths in (("python", python), ("browser", shown))
    }


def figures(designs: list[str], moves: int) -> dict[str, Any]:
    """All figures; without a browser, figures that need it are left out."""
    found: dict[str, Any] = {"page_lines": page_lines()}
    if not (installed() and moves):
        print("the page is not measured: it needs chromium, chromedriver and moves")
        return found
    found |= {"move_ms_95": {}, "move_ms_50": {}, "images_ms_95": {}, "move_cpu_ms": {}}
    with tempfile.TemporaryDirectory() as name, browser() as page:
        folder = Path(name)
        for design in designs:
            with served(design, folder / design) as (process, address):
                page.open(address)
                page.until(READY, 600)
                page.promised(MOVE, 0, 0.5)  # the first move reads data common to all
                before = cpu_ms(process.pid)
                times = moves_of(page, moves)
                found["move_cpu_ms"][design] = round((cpu_ms(process.pid) - before) / moves, 1)
                for part in (50, 95):
                    found[f"move_ms_{part}"][design] = round(float(np.percentile(times, part)), 1)
                found["units_first"] = int(units_first(page) and found.get("units_first", 1))
                page.until(READY)
                found["images_ms_95"][design] = round(
                    float(np.percentile(page.run(IMAGES)[-moves:], 95)), 1
                )
                print(design, {part: found[f"move_ms_{part}"][design] for part in (50, 95)})
                if design == designs[0]:
                    found["saved_same"] = int(saved_same(page, folder / design))
                    found["compared"] = int(compared(page))
                    found["offline"] = int(_offline(page))
        changes = [word for change in SEARCH for word in ("--set", change)]
        with served("noise_only", folder / "searched", *changes) as (_, address):
            page.open(address)
            page.until(READY, 600)
            found |= search(page, folder / "searched")
        said = sentences(folder)
        print("\n".join(f"{name}: {text}" for name, text in said.items()))
        found["sentences"] = int(all(said.values()) and len(said) == 4)
    return found


def _offline(page: Browser) -> bool:
    """Whether all loaded resources are from the page, and no others can be loaded."""
    own = page.run(
        "return performance.getEntriesByType('resource')"
        ".every((entry) => entry.name.startsWith(location.origin + '/'))"
    )
    reached = page.promised(
        "try { await fetch('http://example.org/'); done(true); } catch { done(false); }"
    )
    return bool(own and not reached)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", nargs="+", default=["noise_only", "nanosatellite"])
    parser.add_argument("--moves", type=int, default=200)
    options = command.read(parser, designs=["noise_only"], moves=5)
    found = figures(options.designs, options.moves)
    print(json.dumps(found, indent=1))
    command.save(options, found)


if __name__ == "__main__":
    command.run(main)
