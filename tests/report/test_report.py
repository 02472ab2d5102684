"""The page of a campaign: its statements, and its rendering by a real browser."""

import dataclasses
import html.parser
import json
import re

import numpy as np
import pytest

from startrack.budget import curves
from startrack.cli.main import main
from startrack.core.streams import Streams
from startrack.core.units import arcsec
from startrack.design import Campaign, Fidelity, Requirements, Variation
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.metrics import summarise
from startrack.montecarlo.run import run
from startrack.montecarlo.sampling import Sampling
from startrack.montecarlo.store import Store
from startrack.montecarlo.workers import Serial
from startrack.population import Units, per_unit
from startrack.report import write, write_report
from startrack.report.page import Section, code, page, paragraph, table
from startrack.report.pictures import sky_map
from startrack.report.sections import budget, design, lost, units, verdict
from startrack.report.write import Depth
from startrack.trial.chain import OUTCOMES, observe
from startrack.verification import boresights
from tests.report.browser import browser

TITLE = "<script>alert('x')</script> & \"quotes\""
TRIALS, SEED = 80, 11


@pytest.fixture(scope="module", autouse=True)
def _few_rates():
    """Few rates, because each takes a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curves, "BETWEEN", 0)
        for module in (curves, write.budget):
            patch.setattr(module, "SMEARS", (0.0, 1.0))
        yield


@pytest.fixture(scope="module")
def case():
    """A small tracker: its trials take milliseconds."""
    case = load_design(shipped("designs/noise_only.toml")).case
    instrument = case.instrument
    pitch = 2 * instrument.detector.pixel_pitch
    detector = dataclasses.replace(instrument.detector, columns=256, rows=256, pixel_pitch=pitch)
    optics = dataclasses.replace(instrument.optics, blur=2 * instrument.optics.blur)
    instrument = dataclasses.replace(instrument, detector=detector, optics=optics)
    return dataclasses.replace(case, instrument=instrument)


@pytest.fixture(scope="module")
def campaign(case, tmp_path_factory):
    """A small tracker's campaign, with one trial made to look wrong and one made to fail."""
    outcomes = run(case, TRIALS, SEED, Serial())
    path = tmp_path_factory.mktemp("campaign") / "of <b>.sqlite"
    with Store(path, case, SEED) as store:
        store.keep(0, outcomes)
        store.keep_failure(range(100, 110), "Traceback: <img src=x onerror=alert(1)>")
    return path, outcomes


@pytest.fixture(scope="module")
def written(campaign):
    path, _ = campaign
    out = path.with_name("page.html")
    arguments = ["report", str(path), "--out", str(out), "--title", TITLE, "--stars", "10"]
    assert main([*arguments, "--slews", "5", "--worst", "2", "--budget", "4", "--rungs", "6"]) == 0
    return out


class Reader(html.parser.HTMLParser):
    """Tags, identifiers, addresses and text of a page."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.ids, self.addresses, self.words = [], [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.ids += [value for name, value in attributes if name == "id"]
        self.addresses += [
            value for name, value in attributes if name in ("src", "href", "xlink:href")
        ]

    def handle_data(self, text):
        self.words.append(text)


def test_the_summary_is_that_of_the_trials(written, campaign):
    told = summarise(campaign[1])
    text = written.read_text()
    assert "noise only: a perfect unit on its first day" in text
    for interval in (told.across, told.about):
        for value in (interval.value, interval.low, interval.high):
            assert f">{value / arcsec:.4g}<" in text


def test_the_page_opens_with_the_design_and_its_verdicts(campaign):
    """The campaign's own trials judge one condition; others are run for the rest."""
    path, outcomes = campaign
    needs = Requirements(max_across=1e-3, min_availability=0.5)
    with Store(path) as store:
        case = store.case
    with Store(None, case, SEED) as store:
        store.keep(0, outcomes)
        store.keep_campaign(Campaign(requirements=needs))
        opening = design(case), verdict(store, outcomes, 20, lambda _: None), lost(store, outcomes)
    assert opening[0].body.count("<tr>") == 11
    assert "All requirements together: pass." in opening[1].body
    for word in (">nominal<", ">rest<", ">across<", ">availability<", ">mass<"):
        assert word in opening[1].body, word
    assert f">{TRIALS}<" in opening[2].body  # all are correct
    # The design's own condition has the campaign's trials, the others have their own.
    cells = re.findall(r'data-of="n">([0-9]+)<', opening[1].body)
    assert set(cells) == {str(TRIALS), "20"}


def test_few_trials_make_no_empty_map(campaign):
    """80 trials are drawn as points; 960 also as regions."""
    _, outcomes = campaign
    boresight = boresights(SEED, outcomes)
    assert len(sky_map(boresight, outcomes)) == 1
    assert len(sky_map(np.tile(boresight, (12, 1)), np.tile(outcomes, 12))) == 2


def test_budget_and_fidelities_are_told(written, campaign):
    read = Reader(written.read_text())
    for word in ("end to end", "root sum square", "frame", "window", "Error budget", "Fidelities"):
        assert word in read.words, word


def test_the_page_needs_nothing_else_and_runs_nothing(written):
    read = Reader(written.read_text())
    assert not {"script", "iframe", "object", "form"} & set(read.tags)
    assert "text" in read.tags  # of pictures, which a reader can search
    for address in read.addresses:
        assert address.startswith(("#", "data:")), address
    assert len(read.ids) == len(set(read.ids))
    for address in read.addresses:
        if address.startswith("#"):
            assert address[1:] in read.ids, address


def test_a_campaign_that_solved_nothing_has_a_page_all_the_same(case):
    """With an exposure of a microsecond there is no attitude, and no budget."""
    detector = dataclasses.replace(case.instrument.detector, exposure=1e-6)
    instrument = dataclasses.replace(case.instrument, detector=detector)
    dark = dataclasses.replace(case, instrument=instrument)
    with Store(None, dark, SEED) as store:
        store.keep(0, run(dark, 3, SEED, Serial()))
        text = write_report(store, TITLE, Depth(2, 2, 2, 2, 1))
    assert "This design has no budget: the case must see enough stars somewhere" in text
    assert "no attitude: " in text


def test_units_have_a_section_with_yield_spread_and_the_worst_explained(case):
    """Four units, misaligned by 30 arcsec (1 sigma), some of which keep 20 arcsec."""
    turned = Variation("instrument.mounting.x", sigma="30 arcsec")
    varied = dataclasses.replace(case, variation=(turned,))
    sampling = Sampling(Fidelity.COVARIANCE, units=Units(5, 1))
    with Store(None, varied, SEED, sampling) as store:
        outcomes = sampling.trials(varied, SEED, range(20))
        store.keep(0, outcomes)
        store.keep_campaign(Campaign(requirements=Requirements(max_across=20 * arcsec)))
        [section] = units(store, outcomes)
    kept = sum(error <= 20 * arcsec for error in per_unit(outcomes).across)
    assert 0 < kept < 4
    assert f">{25 * kept:.1f}<" in section.body
    assert "Histogram of the rms across the boresight of 4 units" in section.body
    assert "instrument.mounting.x per unit" in section.body


def test_a_detector_that_scans_has_no_budget_and_the_page_says_why():
    lines = load_design(shipped("designs/scanner.toml")).case
    section = budget(lines, SEED, 2, summarise(np.empty(0, OUTCOMES)), lambda _: None)
    assert "This design has no budget: detector.scan must be absent" in section.body


def test_stars_are_looked_at_where_the_campaign_looked(case):
    """Sobol's attitudes differ from those of random trials with the same numbers."""
    sampling, numbers = Sampling(attitudes="sobol"), range(3)
    with Store(None, case, SEED, sampling) as store:
        store.keep(0, sampling.trials(case, SEED, numbers))
        text = write_report(store, TITLE, Depth(3, 1, 2, 2, 0))
    matched = [
        len(observe(case, look, Streams(SEED, number)).matches)
        for number, look in zip(numbers, sampling.attitudes_of(SEED, numbers), strict=True)
    ]
    assert f"{sum(matched)} matched stars of 3 trials" in text


def test_all_inputs_are_there_and_read_back(written, campaign):
    """The design on the page is a design file of the same case."""
    read = Reader(written.read_text())
    design = next(text for text in read.words if "[instrument.optics]" in text)
    copy = written.with_name("copy.toml")
    copy.write_text(design)
    with Store(campaign[0]) as store:
        assert load_design(copy).case == store.case
    assert any("Traceback: <img src=x" in text for text in read.words)
    assert any(f"Seed {SEED}" in text for text in read.words)


def test_the_worst_trials_are_shown(written, campaign):
    outcomes = campaign[1]
    size = np.hypot(outcomes["error_x"], outcomes["error_y"])
    worst = outcomes["trial"][np.argsort(size)[::-1][:2]]
    shown = re.findall(r"<figcaption>Trial (\d+),", written.read_text())
    assert [int(number) for number in shown] == worst.tolist()


@pytest.mark.parametrize(("width", "height"), [(1280, 900), (360, 740)])
def test_a_real_browser_shows_it(written, tmp_path, width, height):
    """No error on the console, no network request, no horizontal scrolling of the page."""
    with browser(tmp_path / "profile", width, height) as session:
        session.post("url", url=written.as_uri())
        assert session.run("innerWidth") == width
        assert session.run("document.title") == TITLE
        assert session.run("document.documentElement.scrollWidth") <= width
        assert session.run("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
        # The letters of pictures stay legible: each is drawn for the width of a phone.
        widths = session.run("[...document.querySelectorAll('svg')].map(s => s.clientWidth)")
        assert len(widths) == 7
        assert min(widths) >= 300
        shown = session.run("getComputedStyle(document.querySelector('.wide thead')).display")
        assert (shown == "none") == (width < 640)  # a narrow screen shows a table row by row
        assert session.post("se/log", type="browser") == []
        asked = [
            json.loads(one["message"])["message"]
            for one in session.post("se/log", type="performance")
        ]
        addresses = {
            one["params"]["request"]["url"]
            for one in asked
            if one["method"] == "Network.requestWillBeSent"
            and one["params"]["documentURL"] == written.as_uri()
        }
        assert {a for a in addresses if not a.startswith("data:")} == {written.as_uri()}


def test_it_is_used_by_keys_alone(written, tmp_path):
    """Tab reaches the skip link, the contents, every table and every collapsed part; Enter opens
    one."""
    tab, enter = "\ue004", "\ue007"
    focused = "document.activeElement"
    with browser(tmp_path / "profile", 1280, 900) as session:
        session.post("url", url=written.as_uri())
        session.press(tab)
        assert session.run(f"{focused}.className") == "skip"
        wanted = session.run("document.querySelectorAll('a, summary, .scroll').length")
        hidden = session.run("document.querySelectorAll('details:not([open]) .scroll').length")
        reached, kinds = 1, set()
        for _ in range(200):
            session.press(tab)
            if session.run(f"{focused} === document.body"):
                break
            reached += 1
            kinds.add(session.run(f"{focused}.tagName"))
            if session.run(f"{focused}.matches('details:not([open]) > summary')"):
                session.press(enter)
                assert session.run(f"{focused}.parentElement.open")
                wanted, hidden = wanted, hidden - 1
        assert hidden == 0
        assert reached == wanted
        assert kinds == {"A", "DIV", "SUMMARY", "PRE"}


def test_texts_are_escaped():
    bad = "</pre><script>x</script>"
    made = page(
        bad, bad, [Section(bad, paragraph(bad) + code(bad, bad) + table(bad, [bad], [[bad]]))]
    )
    assert "<script>" not in made
    assert made.count("&lt;script&gt;") == 13  # each place that takes text


def test_what_cannot_be_reported_is_refused(campaign, tmp_path, capsys):
    with Store(campaign[0]) as store:
        case = store.case
    empty = tmp_path / "empty.sqlite"
    Store(empty, case, 1).close()
    assert main(["report", str(empty)]) == 1
    assert "must hold trials, but holds none" in capsys.readouterr().err
    assert main(["report", str(tmp_path / "none.sqlite")]) == 2
    assert "but there is none" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.html"))
