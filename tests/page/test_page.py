"""The server of a page without a browser: permitted requests; numbers equal to those of
commands."""

import http.client
import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, suppress
from pathlib import Path

import pytest

from startrack.budget import analytic, answer
from startrack.cli.main import main
from startrack.core import arcsec
from startrack.design import load_design
from startrack.io import shipped
from startrack.montecarlo import Serial
from startrack.page import EARTH, MOVING, PageServer, ProblemPage, Routes, TrackerPage

DESIGN = Path(str(shipped("designs/noise_only.toml")))
# So few that a search takes seconds.
TINY = (
    "campaign.fidelity=covariance",
    "campaign.analytic_evaluations=6",
    "campaign.evaluations=2",
    "campaign.trials=4",
    "campaign.most_trials=4",
    "campaign.fresh_trials=8",
)


class Client:
    """Requests to a page."""

    def __init__(self, server, folder):
        self.server, self.folder = server, folder
        self.cookie = f"{server.cookie}={server.token}"

    def send(self, method, path, body=b"", **headers):
        own = {"Cookie": self.cookie, "Content-Type": "application/json"}
        own |= {name.replace("_", "-"): value for name, value in headers.items()}
        port = self.server.server_port
        with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=600)) as connection:
            connection.request(method, path, body, own)
            with connection.getresponse() as reply:
                return reply, reply.read()

    def ask(self, path, **body):
        reply, content = self.send("POST", f"/api/{path}", json.dumps(body).encode())
        assert reply.status == 200, content
        return json.loads(content)


def served(front, factory):
    folder = factory.mktemp("page")
    routes = Routes(front, folder, Serial(), Serial(), 1, [])
    with PageServer(routes, 0) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield Client(server, folder)
        routes.close()
        server.shutdown()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    yield from served(TrackerPage(DESIGN, 1), tmp_path_factory)


def output_of(capsys, *words):
    main([*words, "--json"])
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()][-1]


def test_the_token_is_taken_once_and_becomes_a_cookie(page):
    reply, _ = page.send("GET", f"/?token={page.server.token}", Cookie="")
    assert (reply.status, reply.headers["Location"]) == (303, "/")
    assert "HttpOnly; SameSite=Strict" in reply.headers["Set-Cookie"]
    reply, content = page.send("GET", "/")
    assert reply.status == 200
    assert b"page.js" in content
    policy = reply.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


@pytest.mark.parametrize("cookie", ["", "startrack-1=x", "other=1; startrack", "=;=", "\xe4=\xe4"])
def test_a_stale_or_missing_token_ends_in_a_sentence(page, cookie):
    for method, path in (("GET", "/"), ("POST", "/api/about"), ("GET", "/?token=stale")):
        reply, content = page.send(method, path, b"{}", Cookie=cookie)
        assert reply.status == 403
        assert b"open the address that the running command printed" in content


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
    ],
)
def test_another_host_or_origin_is_refused(page, headers):
    for method, path in (("GET", "/"), ("POST", "/api/paint")):
        assert page.send(method, path, b"{}", **headers)[0].status == 403


def test_requests_that_are_none_are_refused(page):
    many = str(2**20 + 1)
    assert page.send("POST", "/api/paint", b"{}", Content_Length=many)[0].status == 413
    assert page.send("POST", "/api/paint", b"{}", Content_Length="x")[0].status == 411
    assert page.send("POST", "/api/paint", b"{}", Content_Type="text/plain")[0].status == 415
    assert page.send("POST", "/api/paint", b"[" * 5000)[0].status == 400
    assert page.send("POST", "/api/paint", b"[1]")[0].status == 400
    assert page.send("POST", "/api/delete", b"{}")[0].status == 404
    assert page.send("GET", "/../server.py")[0].status == 404
    assert page.send("GET", "/%2e%2e/server.py")[0].status == 404


def test_a_bad_value_ends_in_the_sentence_of_the_command(page, capsys):
    change = "instrument.optics.f_number=-1"
    assert main(["budget", str(DESIGN), "--set", change]) == 2
    assert page.ask("paint", changes=[change])["refused"] in capsys.readouterr().err
    assert "KEY=VALUE" in page.ask("paint", changes=[7])["refused"]
    assert "list" in page.ask("paint", changes="all")["refused"]
    assert "whole number" in page.ask("images", trial=-1)["refused"]
    assert "rate must be" in page.ask("later", rate="fast")["refused"]


CHANGES = ["instrument.optics.f_number=2.1", "instrument.detector.exposure=91.7 ms"]


def saved(page):
    """The displayed values of a design, and the file that it was saved to."""
    shown = page.ask("paint", changes=CHANGES)
    assert page.ask("save", changes=CHANGES, name="mine")["done"].startswith(str(page.folder))
    file = page.folder / "mine.toml"
    assert "base" in file.read_text()
    return shown, file


def test_a_saved_design_has_the_numbers_that_were_shown(page, capsys):
    shown, file = saved(page)
    again = page.ask("save", changes=CHANGES, name=file.stem)
    assert "is written in place of an earlier file" in again["done"]
    budget = analytic(load_design(file).case)
    assert (shown["across"], shown["about"]) == (budget.across / arcsec, budget.about / arcsec)
    assert shown["answer"] == answer(budget, ())
    found = output_of(capsys, "requirements", str(file))
    later = page.ask("later", changes=CHANGES)
    margins = {row["name"]: row["margin"] for row in later["requirements"] if "margin" in row}
    assert margins == found["margins"]
    assert later["expected"] == found["expected_arcsec"]


@pytest.mark.slow
def test_the_command_budget_prints_the_numbers_that_were_shown(page, capsys):
    shown, file = saved(page)
    result = output_of(capsys, "budget", str(file))["analytic"]
    whole = result["end to end"]
    assert (shown["across"], shown["about"]) == (whole["across"], whole["about"])
    causes = {cause["name"]: cause["across"] for cause in shown["causes"]}
    assert causes == {name: line["across"] for name, line in result["causes"].items()}


@pytest.mark.parametrize("name", ["../mine", "a/b", "", ".hidden", "x.toml", "a" * 65])
def test_nothing_is_written_outside_the_folder(page, name):
    assert "name must" in page.ask("save", changes=[], name=name)["refused"]


def test_a_frame_is_that_of_the_trial(page):
    first, same, other = (page.ask("images", trial=trial) for trial in (3, 3, 4))
    assert first == same
    assert first["images"][0]["levels"] != other["images"][0]["levels"]


def test_a_form_has_units_limits_and_the_words_of_datasheets(page):
    rows = {row["key"]: row for row in page.ask("form", changes=[])}
    exposure = rows["instrument.detector.exposure"]
    assert (exposure["value"], exposure["unit"]) == ("80 ms", "ms")
    assert rows["tracker.detection.centroid"]["choices"]
    assert "campaign.variables.0.low" in rows
    assert "instrument.detector.pixel_pitch" in page.ask("keys", words="field of view")


def ended(page, name, seconds=300):
    for _ in range(int(seconds / 0.05)):
        state = page.ask(f"{name}/state")
        if not state["running"]:
            return state
        time.sleep(0.05)
    raise AssertionError(f"{name} does not end")


def test_trials_start_stop_and_continue_as_montecarlo_has_them(page, capsys):
    asked = {"changes": [], "trials": 24, "fidelity": "covariance"}
    page.ask("trials/start", **asked)
    page.ask("trials/stop")
    page.ask("trials/start", **asked)
    state = ended(page, "trials")
    assert state["count"] == 24
    words = "--trials", "24", "--fidelity", "covariance", "--workers", "1"
    result = output_of(capsys, "montecarlo", str(DESIGN), *words)
    assert f"{result['across_rms_arcsec']:.3f}" in state["lines"][0]
    assert "fidelity must be" in page.ask("trials/start", trials=1, fidelity="x")["refused"]


@pytest.mark.slow
def test_a_search_is_started_watched_stopped_and_continued(page):
    changes = list(TINY)
    page.ask("search/start", changes=changes)
    assert "a search runs already" in page.ask("search/start", changes=changes)["refused"]
    for _ in range(2400):
        if any("values" in line for line in page.ask("search/state")["lines"]):
            break
        time.sleep(0.05)
    page.ask("search/stop")
    stopped = page.ask("search/state")
    assert stopped["stopped"]
    page.ask("search/start", changes=changes)
    state = ended(page, "search", 200)
    designs = [line for line in state["lines"] if "values" in line]
    assert len(designs) >= len([line for line in stopped["lines"] if "values" in line]) > 0
    assert any(line["by"] != "formula" for line in designs)
    assert "ending" in state["result"]
    assert (page.folder / "search" / "best.toml").is_file()


HOLDER = """
import sys, time
from pathlib import Path
from startrack.page.search import SearchRun

run = SearchRun(Path(sys.argv[1]), Path(sys.argv[2]), 1, 1)
run.start([])
while not (Path(sys.argv[2]) / "search.jsonl").exists():
    time.sleep(0.05)
print(run._process.pid, flush=True)
time.sleep(600)
"""


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="only Linux tells when another ends")
def test_a_search_ends_when_the_page_is_killed(tmp_path):
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, DESIGN, tmp_path],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),  # as `nohup ... &` does
    )
    with holder:
        number = int(holder.stdout.readline())
        search = os.pidfd_open(number)
        try:
            assert not select.select([search], [], [], 0)[0]
            holder.kill()
            assert select.select([search], [], [], 30)[0]
        finally:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(search, signal.SIGKILL)
            os.close(search)
    # It ended as by a signal, and can be continued.
    assert "stopped" in (tmp_path / "messages.txt").read_text().lower()
    assert (tmp_path / "ledger.sqlite").exists()


SPECTRA = ["retrieval.minerals.step=140 nm", "channels.*.optics.f_number=2.3"]


@pytest.fixture(scope="module")
def earth(tmp_path_factory):
    yield from served(
        ProblemPage(Path(str(shipped("scenes/mertis.toml"))), 1, EARTH), tmp_path_factory
    )


def test_an_earth_camera_has_forecast_margins_sliders_and_keys(earth):
    shown = earth.ask("paint", changes=[])
    assert shown["answer"].startswith("error of emissivity")
    assert shown["sliders"]
    assert all(row["limit"] for row in shown["requirements"])
    assert "retrieval.minerals.step" in {row["key"] for row in earth.ask("form", changes=[])}
    assert "no results that come later" in earth.ask("later", changes=[])["refused"]


def test_a_saved_scene_has_the_numbers_that_were_shown(earth, capsys):
    shown = earth.ask("paint", changes=SPECTRA)
    earth.ask("save", changes=SPECTRA, name="mine")
    file = earth.folder / "mine.toml"
    assert 'base = "scenes/mertis.toml"' in file.read_text()
    main(["requirements", str(file), "--json"])
    printed = json.loads(capsys.readouterr().out.splitlines()[0])
    assert printed["expected"] == shown["value"]
    assert printed["margins"] == {row["name"]: row["margin"] for row in shown["requirements"]}


def test_trials_of_a_scene_are_those_of_montecarlo(earth, capsys):
    asked = {"changes": [], "trials": 200, "fidelity": "image"}
    earth.ask("trials/start", **asked)
    state = ended(earth, "trials")
    assert state["count"] == 200
    assert next(iter(state["columns"])) == "error of emissivity"
    values, first, second = (
        state["columns"][name]
        for name in (
            "error of emissivity",
            "nominal: square of emissivity",
            "evening: square of emissivity",
        )
    )
    assert values[7] == pytest.approx((first[7] * second[7]) ** 0.25)
    words = "montecarlo", "mertis", "--trials", "200", "--workers", "1"
    result = output_of(capsys, *words)
    assert f"{result['value'][0]:.4g} [{result['value'][1]:.4g}" in "\n".join(state["lines"])
    assert (
        "fidelity must be one of image"
        in earth.ask("trials/start", trials=1, fidelity="x")["refused"]
    )


def test_images_of_a_scene_have_units_scales_and_the_truth_beside_the_result(earth):
    view = earth.ask("images", trial=130, condition="evening")
    names = [image["name"] for image in view["images"]]
    assert names[1:3] == ["emissivity, true", "emissivity, retrieved"]
    scales = {(image["low"], image["high"]) for image in view["images"][1:3]}
    assert len(scales) == 1
    assert view["images"][0]["unit"] == "W / m2 / sr / um"
    # Trial 130 is the third spectrum of the second image.
    assert view["images"][0]["marks"][0]["y"] == [2]
    assert "conditions must be" in earth.ask("images", condition="noon")["refused"]


@pytest.mark.slow
def test_a_search_for_moving_objects_has_a_page(tmp_path, capsys):
    page = ProblemPage(Path(str(shipped("searches/asteroidfinder.toml"))), 1, MOVING)
    few = ["moving_object.frames=4", "instrument.optics.f_number=3.7"]
    shown = page.paint(few)
    assert {row["name"] for row in shown["requirements"]} == {"aperture", "field", "time"}
    assert len(page.images(few, 0, "")["images"]) == 8
    assert "instrument.optics.f_number" in {row["key"] for row in page.form(few)}
    file = tmp_path / "mine.toml"
    page.write(few, file, "a note")
    assert output_of(capsys, "requirements", str(file))["expected"] == shown["value"]
