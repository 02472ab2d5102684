"""Are a campaign's results reproducible, how much time do workers lose, and are trials lost?

python experiments/campaign.py [--json FILE] [--kills 50] [--parts store bytes ...] [--quick]

FILE is written after each part, and keeps the parts of earlier runs. The commands that are killed
run trials of fidelity `window`.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import command
import numpy as np
from numpy.typing import NDArray

from startrack import Case, Design, Fidelity, load_design, save_design, shipped
from startrack.benchmark import studies
from startrack.metrics import summarise
from startrack.montecarlo import Precision, Sampling, Serial, Store, dask_pool, pool, resume, run
from startrack.trial import OUTCOMES

SEED = 7
TRIAL = 0.01  # second, of a trial that only waits
# Parts without separate processes, which --quick runs by default.
ALONE = ("store", "coverage", "speed", "variance")
PARTS = ("store", "bytes", "coverage", "efficiency", "speed", "variance", "kills")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    options = command.read(parser, kills=1, parts=ALONE)
    case = load_design(shipped("designs/noise_only.toml")).case
    figures = {}
    if options.json and options.json.is_file():
        figures = json.loads(options.json.read_text())
    for part in options.parts:
        with tempfile.TemporaryDirectory() as name:
            figures |= measure(part, case, Path(name), options.kills, options.quick)
        command.save(options, figures, partial=set(options.parts) != set(PARTS))
        print(part, "done", flush=True)
    print(json.dumps(figures, indent=1))


def measure(part: str, case: Case, folder: Path, kills: int, quick: bool) -> dict[str, Any]:
    """The figures of one part."""
    match part:
        case "bytes":
            return same_bytes(case, 4) if quick else same_bytes(case)
        case "store":
            return store_speed(folder, case, 640, repeats=1) if quick else store_speed(folder, case)
        case "coverage":
            return coverage(2, 100) if quick else coverage()
        case "efficiency":
            if quick:
                return efficiency(4, 1) | overhead(case, 32, 8)
            return efficiency() | overhead(case)
        case "kills":
            if quick:
                return kill_and_resume(folder, kills, SEED, trials=50, longest=2.0)
            return kill_and_resume(folder, kills, SEED)
        case "speed":
            import speed

            return speed.speeds(studies.sized(case, 256 if quick else 1024), quick)
    import variance

    told = variance.measure(case, 32, 2, quick) if quick else variance.measure(case, 896)
    worth = {
        name: one.get("variance_reduction")
        for name, one in told["across"].items()
        if isinstance(one, dict)
    }
    return {
        "variance_reduction": told["variance_reduction"],
        "variance_reductions": worth,
        "coverage_95_helped": told["coverage_95"],
    }


def same_bytes(case: Case, trials: int = 200) -> dict[str, Any]:
    """One process, two processes, and a Dask cluster of two."""
    alone = run(case, trials, SEED, Serial()).tobytes()
    with pool(2) as executor:
        same = {"two": run(case, trials, SEED, executor, workers=2).tobytes() == alone}
    if not command.missing("the same bytes by Dask are", "distributed"):
        from distributed import LocalCluster

        with (
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local,
            dask_pool(local.scheduler_address) as executor,
        ):
            same["dask"] = run(case, trials, SEED, executor, workers=2).tobytes() == alone
    return {"same_bytes": all(same.values()), "same_bytes_with": list(same)}


def efficiency(trials: int = 640, repeats: int = 5) -> dict[str, Any]:
    """Two workers through the engine and the store, against two single runs in parallel.

    Frames of 1024 x 1024 pixels, some 10 ms each; wall-clock time, both ways alternately. Other
    programs disturb both: the median of the ratios, and the best.
    """
    code = (
        "import sys\nsys.path.insert(0, 'experiments')\n"
        "from campaign import SEED, Serial, large, run\ncase = large()\n"
        "run(case, 8, SEED, Serial())\nprint('ready', flush=True)\nsys.stdin.readline()\n"
        f"run(case, {trials // 2}, SEED, Serial(), first=int(sys.argv[1]))\nprint('done')"
    )
    ratios, rate = [], 0.0
    for _ in range(repeats):
        apart = side_by_side(code, (0, trials // 2))
        with pool(2) as executor, Store(None, large(), SEED) as store:
            run(store.case, 16, SEED, executor, workers=2)  # the workers start and load
            began = time.perf_counter()
            resume(store, executor, 2, trials, block=16)
            together = time.perf_counter() - began
        ratios.append(apart / together)
        rate = max(rate, trials / together)
    return {
        "parallel_efficiency_2": float(np.median(ratios)),
        "parallel_efficiency_2_all": ratios,
        "frame_trials_per_s_2_workers": rate,
    }


def large() -> Case:
    """The example with four times as many pixels of half the width."""
    case = load_design(shipped("designs/noise_only.toml")).case
    truth = case.instrument
    pitch = truth.detector.pixel_pitch / 2
    detector = dataclasses.replace(truth.detector, columns=1024, rows=1024, pixel_pitch=pitch)
    return dataclasses.replace(case, instrument=dataclasses.replace(truth, detector=detector))


def side_by_side(code: str, firsts: tuple[int, ...]) -> float:
    """Wall-clock seconds of single runs in separate processes, from the time when all are ready."""
    singles = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(first)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[1],
        )
        for first in firsts
    ]
    for one in singles:
        assert one.stdout
        one.stdout.readline()
    began = time.perf_counter()
    for one in singles:
        assert one.stdin
        one.stdin.write("go\n")
        one.stdin.flush()
    for one in singles:
        assert one.stdout
        one.stdout.readline()
    spent = time.perf_counter() - began
    for one in singles:
        one.communicate()
    return spent


class Waiting(Sampling):
    """Trials that take 10 ms without a processor, so that only the engine works."""

    def trials(self, case: Case, seed: int, numbers: Sequence[int]) -> NDArray[np.void]:
        time.sleep(TRIAL * len(numbers))
        table = np.zeros(len(numbers), OUTCOMES)
        table["trial"], table["solved"] = numbers, True
        return table


def overhead(case: Case, trials: int = 2560, block: int = 64) -> dict[str, float]:
    """Time that engine and store add to two workers whose trials take 10 ms.

    engine_efficiency  time of the trials over wall-clock time times two workers
    engine_cpu_share   CPU time of the main process over that of the trials
    """
    best, cpu = 0.0, math.inf
    with tempfile.TemporaryDirectory() as name, pool(2) as executor:
        for repeat in range(3):
            with Store(Path(name) / f"{repeat}.sqlite", case, SEED) as store:
                store.sampling = Waiting()
                resume(store, executor, 2, 2 * block, block=block)
                began, used = time.perf_counter(), time.process_time()
                resume(store, executor, 2, 2 * block + trials, block=block)
                best = max(best, TRIAL * trials / 2 / (time.perf_counter() - began))
                cpu = min(cpu, (time.process_time() - used) / (TRIAL * trials))
    return {"engine_efficiency": best, "engine_cpu_share": cpu}


def store_speed(
    folder: Path, case: Case, trials: int = 10**6, block: int = 64, repeats: int = 3
) -> dict[str, Any]:
    """A million trials, each block committed separately; then their summary from disk.

    Wall-clock time, best of the repeats, and CPU time, which other programs affect less.
    """
    table = np.zeros(trials, OUTCOMES)
    table["trial"] = np.arange(trials)
    table["error_x"] = np.random.default_rng(SEED).standard_normal(trials)
    table["solved"] = True
    writing = reading = busy = math.inf
    for repeat in range(repeats):
        path = folder / f"speed{repeat}.sqlite"
        with Store(path, case, SEED) as store:
            began, used = time.perf_counter(), time.process_time()
            for first in range(0, trials, block):
                store.keep(first, table[first : first + block])
            writing = min(writing, time.perf_counter() - began)
            busy = min(busy, time.process_time() - used)
        began = time.perf_counter()
        with Store(path) as store:
            summarise(store.outcomes())
        reading = min(reading, time.perf_counter() - began)
    return {
        "store_trials_per_s": trials / writing,
        "store_trials_per_cpu_s": trials / busy,
        "commit_ms": 1e3 * writing / (trials / block),
        "bytes_per_trial": path.stat().st_size / trials,
        "summary_1e6_s": reading,
    }


def coverage(repetitions: int = 200, trials: int = 1000) -> dict[str, Any]:
    """Coverage of 95 % intervals, on errors with a known distribution."""
    hits = dict.fromkeys(("across", "across-99.73", "availability"), 0)
    truth = {
        "across": 1.0,
        "across-99.73": float(np.sqrt(-2 * np.log(1 - 0.9973))),
        "availability": 0.9,
    }
    rng = np.random.default_rng(SEED)
    for _ in range(repetitions):
        table = np.zeros(trials, OUTCOMES)
        for name in ("error_x", "error_y"):
            table[name] = rng.standard_normal(trials)
        for name in ("sigma_x", "sigma_y", "sigma_z"):
            table[name] = 1.0  # as true: an error of ten stated sigma would not count as available
        table["solved"] = rng.random(trials) < 0.9
        for name in hits:
            interval = Precision(0.5, name).interval(table)
            hits[name] += bool(interval.low <= truth[name] <= interval.high)
    return {"coverage_95": {name: count / repetitions for name, count in hits.items()}}


def kill_and_resume(
    folder: Path, kills: int, seed: int, trials: int = 1500, longest: float = 7.0
) -> dict[str, int]:
    """Kill the driver or a worker with -9 at random moments until the campaigns are done.

    Returns  numbers of lost or doubled trials, of campaigns whose bytes differ from an undisturbed
             run, and of processes that outlived their driver
    """
    case = small()
    save_design(folder / "small.toml", Design(case))
    whole = run(case, trials, seed, Serial(), fidelity=Fidelity.WINDOW)
    rng = np.random.default_rng(seed)
    figures = dict.fromkeys(
        ("kills", "kills_of_workers", "campaigns", "lost", "doubled", "different", "orphans"), 0
    )
    held, finished = 0, False
    while figures["kills"] < kills or not finished:
        path = folder / f"campaign{figures['campaigns']}.sqlite"
        driver = _drive(folder / "small.toml", path, trials, seed)
        killed = False
        if figures["kills"] < kills:
            try:
                driver.wait(rng.uniform(0.3, longest))
            except subprocess.TimeoutExpired:
                killed = True
                figures["kills"] += 1
                workers = [pid for pid in _session(driver.pid) if pid != driver.pid]
                if workers and rng.random() < 0.5:
                    figures["kills_of_workers"] += 1
                    _kill(int(rng.choice(workers)))
                else:
                    _kill(driver.pid)
        status = driver.wait()
        figures["orphans"] += _orphans(driver.pid)
        before, held, finished = held, 0, False
        with contextlib.suppress(ValueError), Store(path) as store:  # where it had not yet begun
            numbers = store.outcomes()["trial"]
            held = len(numbers)
            figures["doubled"] += held - len(np.unique(numbers))
            finished = held == trials
            if finished:
                figures["campaigns"] += 1
                figures["different"] += store.outcomes().tobytes() != whole.tobytes()
        figures["lost"] += max(0, before - held)
        held = 0 if finished else held
        if not finished and not killed:
            raise RuntimeError(f"the driver ended by itself with status {status}")
    return figures


def small() -> Case:
    """The example with a quarter of the pixels, twice as wide: trials of milliseconds."""
    case = load_design(shipped("designs/noise_only.toml")).case
    truth = case.instrument
    pitch = 2 * truth.detector.pixel_pitch
    detector = dataclasses.replace(truth.detector, columns=256, rows=256, pixel_pitch=pitch)
    optics = dataclasses.replace(truth.optics, blur=2 * truth.optics.blur)
    return dataclasses.replace(
        case, instrument=dataclasses.replace(truth, detector=detector, optics=optics)
    )


def _drive(design: Path, path: Path, trials: int, seed: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "startrack.cli", "montecarlo", str(design)]
    command += ["--store", str(path), "--trials", str(trials), "--seed", str(seed)]
    command += ["--fidelity", "window", "--workers", "2"]
    # A separate session, by which remaining processes are found.
    return subprocess.Popen(
        command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def _session(leader: int) -> list[int]:
    """The living processes of a session, from Linux's /proc."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == leader and fields[0] != "Z":
            found.append(int(entry.parent.name))
    return found


def _orphans(leader: int, patience: float = 10.0) -> int:
    """End the processes of a session that remain after some seconds; returns their number."""
    end = time.monotonic() + patience
    while (left := _session(leader)) and time.monotonic() < end:
        time.sleep(0.05)
    for pid in left:
        _kill(pid)
    return len(left)


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):  # where it had just ended
        os.kill(pid, signal.SIGKILL)


if __name__ == "__main__":
    command.run(main)
