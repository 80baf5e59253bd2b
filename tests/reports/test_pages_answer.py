"""Pages in Chromium: they answer, can be read in light, dark, narrow and on paper, ask nobody."""

import itertools
import json
import re
from functools import cached_property
from unittest.mock import patch

import axe
import numpy as np
import pyarrow as pa
import pytest
from test_report import found, recorded

import wrenchbed as wb
from chromium import BINARY, tab
from pictures import unless
from wrenchbed.benchmark.efforts import case
from wrenchbed.benchmark.referee.case import make
from wrenchbed.campaigns import summary
from wrenchbed.campaigns.monte_carlo import Fleet, schema
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.pages.document import Document, Figure, Section, Table, provenance
from wrenchbed.pages.draw import Drawn
from wrenchbed.pages.study_charts import components, histograms
from wrenchbed.reports.diagnosis_page import diagnosis_page, effort_page
from wrenchbed.reports.fit_page import fit_page
from wrenchbed.reports.recording_page import recording_page

pytestmark = unless(BINARY is not None, "chromium is not installed")

KINDS = ("diagnosis", "efforts", "unknown", "recording", "fit", "campaign", "study")


class Pages:
    """Paths of pages by kind, each made when it is first asked for."""

    def __init__(self, folder):
        self.folder = folder

    @cached_property
    def diagnosis(self):
        findings = found(self.folder, "joint.compliance:joint=2,stiffness=9000")
        return self._written("diagnosis", diagnosis_page(findings))

    @cached_property
    def clean(self):
        (folder := self.folder / "healthy").mkdir()
        return self._written("clean", diagnosis_page(found(folder)))

    @cached_property
    def efforts(self):
        arm = wb.load("robots", "ur5")
        findings = diagnose_efforts(case.make([arm], 90, 0, False, 0).recording)
        return self._written("efforts", effort_page(findings))

    @cached_property
    def unknown(self):
        odd = make("ur5", "static", "outside", (41, 3))  # a fault that is no effect of the library
        findings = diagnose(odd.recording)
        assert findings.diagnosis.verdict == "unknown"
        return self._written("unknown", diagnosis_page(findings))

    @cached_property
    def fitted(self):
        (folder := self.folder / "fitted").mkdir()
        recording = recorded(folder)
        fit = wb.calibrate(recording)
        fit.write(self.folder / "fit.json")
        return fit, recording

    @cached_property
    def fit(self):
        return self._written("fit", fit_page(*self.fitted, "wrenchbed calibrate rec.parquet"))

    @cached_property
    def recording(self):
        files = [self.folder / "fit.json"]
        still = "<svg><title>not drawn</title></svg>"
        with patch("wrenchbed.reports.recording_page.draw", lambda c: Drawn(c, still)):
            page = recording_page(self.fitted[1], files, "wrenchbed report rec.parquet")
        return self._written("recording", page)

    @cached_property
    def campaign(self):
        _campaign(self.folder / "rows").write(self.folder / "campaign", "campaign")
        return self.folder / "campaign" / "campaign.html"

    @cached_property
    def study(self):
        _study().write(self.folder / "study", "study")
        return self.folder / "study" / "study.html"

    def _written(self, kind, page):
        path = self.folder / f"{kind}.html"
        page.write(path)
        return path

    def __getitem__(self, kind):
        return getattr(self, kind)


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    return Pages(tmp_path_factory.mktemp("pages"))


def _campaign(folder) -> Document:
    fleet = Fleet("ur5", 30, ("noise", "parameters"), 24, 8)
    rows = [
        {"robot": k, "error": "", "force.before": 1.0 + k, "force.after": 0.1 + 0.01 * k,
         "inside95": 0.9}
        for k in range(30)
    ]  # fmt: skip
    return summary.page(fleet, pa.Table.from_pylist(rows, schema=schema(fleet)), folder)


def _study() -> Document:
    rng = np.random.default_rng(0)
    spread = {"error": {"all": rng.lognormal(size=99)}}
    figures = (
        Figure("counts", "Counts", histograms(spread, "mm", log=True)),
        Figure("parts", "Parts", components({"m": rng.normal(size=(9, 6))})),
    )
    rows = [(f"method {k}", (7 * k) % 11, float(k)) for k in range(12)]
    table = Table.of("Methods", ("method", "rank", "error [mm]"), rows, "of `wrenchbed`")
    sections = (Section("S", "text", (table, *figures)),)
    told = provenance([], "wrenchbed study mine", 3)
    return Document("A study", "Lead with `code`.", sections, "by `it`", data=told)


@pytest.fixture(scope="module")
def page():
    with tab("--use-angle=swiftshader", "--enable-unsafe-swiftshader") as opened:
        yield opened


def shown(page, path, width=1280, **media):
    page.open(path, width, 800, **media)
    page.run("window.wrenchbed.begin()")


def key(page, name: str) -> None:
    for kind in ("keyDown", "keyUp"):
        page.call("Input.dispatchKeyEvent", type=kind, key=name, code=name)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
def test_every_figure_answers_and_nothing_complains(page, pages, kind):
    page.console.clear()
    page.requests.clear()
    shown(page, pages[kind])
    count = page.run("document.querySelectorAll('figure[data-chart]').length")
    assert count >= 1
    alive = "document.querySelectorAll('figure.alive :is(.live svg, canvas.live)').length"
    assert page.run(alive) == count
    assert page.console == []
    assert set(page.requests.values()) == {pages[kind].as_uri()}
    assert pages[kind].stat().st_size < 4_000_000
    assert ("#differ" in pages[kind].read_text()) == (kind == "recording")
    mute = page.run(
        "[...document.querySelectorAll('figure svg')].filter(s => !s.getAttribute('aria-label')"
        " && !s.closest('figure').querySelector('figcaption, .title')).length"
    )
    assert mute == 0
    headings = page.run("[...document.querySelectorAll('h1,h2,h3')].map(h => +h.tagName[1])")
    assert headings[0] == 1 and all(b - a <= 1 for a, b in itertools.pairwise(headings))
    cut = page.run(
        "[...document.querySelectorAll('.live svg text')].filter(t => { const a ="
        " t.getBoundingClientRect(), b = t.closest('.live').getBoundingClientRect();"
        " return a.width && (a.left < b.left - 1 || a.right > b.right + 1); })"
        ".map(t => t.textContent)"
    )
    assert cut == []


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (390, "light")])
def test_no_rule_of_wcag_is_broken(page, pages, kind, width, scheme):
    shown(page, pages[kind], width, prefers_color_scheme=scheme)
    assert page.run("document.documentElement.scrollWidth") <= width
    ground = page.run("getComputedStyle(document.body).backgroundColor")
    assert (max(map(int, re.findall(r"\d+", ground)[:3])) < 80) == (scheme == "dark")
    cut = page.run(
        "[...document.querySelectorAll('.scroll, pre')].filter(s => s.scrollWidth >"
        " s.clientWidth + 1 && s.tabIndex < 0).length"
    )
    assert cut == 0  # all that scrolls can be reached by keyboard
    if axe.script() is None:
        pytest.skip("axe-core is not there, and npm cannot fetch it")
    assert axe.violations(page) == []


def test_keys_alone_move_a_cursor_that_all_figures_share(page, pages):
    shown(page, pages["diagnosis"])
    page.run("document.querySelector('#cause-0 .live').focus()")
    for name in ("Home", "ArrowRight", "ArrowRight"):
        key(page, name)
    said = page.run("document.querySelector('#cause-0 .said').textContent")
    assert re.search(r"torque of weight on joint 2 −?[\d.]+ N·m", said)
    assert re.search(r"measured: −?[\d.]+ ± [\d.]+ °", said)
    observation = page.run("wrenchbed.cursor()")
    assert isinstance(observation, int)
    others = page.run(
        "wrenchbed.live.filter(f => f.node.id.startsWith('effect-0')).map(f => f.last)"
    )
    assert len(others) >= 1 and all(told for told in others)


ROBOT = "wrenchbed.live.find(f => f.node.id === 'robot')"
PIXELS = (
    f"(() => {{ const robot = {ROBOT}, copy = document.createElement('canvas'); robot.render();"
    " copy.width = copy.height = 64; const pen = copy.getContext('2d');"
    " pen.drawImage(robot.ground, 0, 0, 64, 64);"
    " return [...pen.getImageData(0, 0, 64, 64).data]; })()"
)
"""What the canvas shows, as RGBA of 64 × 64 points."""


def pixels(page) -> np.ndarray:
    return np.array(page.run(PIXELS)).reshape(64, 64, 4)


def blamed(picture) -> int:
    """Points that are dark red."""
    red, green, blue = (picture[..., k].astype(int) for k in range(3))
    return int(((red > 60) & (red > 3 * green) & (red > 2 * blue) & (picture[..., 3] > 200)).sum())


@pytest.mark.sampled
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (390, "light")])
def test_the_robot_is_a_body_with_its_blamed_part_that_keys_turn(page, pages, width, scheme):
    page.console.clear()
    shown(page, pages["diagnosis"], width, prefers_color_scheme=scheme)
    first = pixels(page)
    assert (first[..., 3] > 200).sum() > 100  # a body, not sticks
    assert blamed(first) > 15
    page.run("document.querySelector('#robot canvas').focus()")
    key(page, "ArrowRight")
    turned = pixels(page)
    assert (turned != first).any(axis=-1).sum() > 50
    key(page, "+")
    assert (pixels(page)[..., 3] > 200).sum() > (turned[..., 3] > 200).sum()
    key(page, "Home")
    assert (pixels(page) == first).all()
    assert page.console == []


def test_the_pose_of_the_robot_and_the_cursors_of_all_figures_are_one(page, pages):
    shown(page, pages["diagnosis"])
    slider = "document.querySelector('#robot input[type=range]')"
    link = f"{ROBOT}.bodies[5].matrix.elements.join()"
    page.run(f"{slider}.focus()")
    key(page, "Home")
    start, before = page.run(link), pixels(page)
    key(page, "ArrowRight")
    assert page.run(link) != start and (pixels(page) != before).any()
    data = json.loads(page.run("document.getElementById('charts').textContent"))["robot"]
    assert page.run("wrenchbed.cursor()") == data["ids"][1]
    assert page.run(f"{slider}.getAttribute('aria-valuetext')") == data["labels"][1]
    assert re.fullmatch(r"pose 1, residual [\d.]+ × noise", data["labels"][1])
    page.run("document.querySelector('#cause-0 .live').focus()")
    key(page, "Home")
    assert data["ids"][page.run(f"{ROBOT}.at")] == page.run("wrenchbed.cursor()")
    page.run("document.querySelector('#heat .live').focus()")
    key(page, "End")  # the last cell: its worst pose
    cells = json.loads(page.run("document.getElementById('charts').textContent"))["heat"]
    assert page.run("wrenchbed.cursor()") == cells["panels"][0]["matrix"]["ids"][-1][-1]
    assert data["ids"][page.run(f"{ROBOT}.at")] == page.run("wrenchbed.cursor()")


def test_without_webgl_the_still_robot_is_shown(pages):
    with tab("--disable-gpu", "--disable-3d-apis") as bare:
        shown(bare, pages["diagnosis"])
        still = "document.querySelector('#robot .still svg')"
        assert bare.run(f"{still}.getClientRects().length") == 1
        assert bare.run(f"{still}.querySelectorAll('polygon').length") > 500
        assert bare.console == []


@pytest.mark.slow
def test_a_clean_robot_looks_clean(page, pages):
    """Arrows have one scale on all pages: what is noise has no length that one could see."""
    shown(page, pages["clean"])
    picture = pixels(page)
    assert blamed(picture) == 0
    arrows = page.run(f"{ROBOT}.data.arrows.filter(a => a.name !== 'load').map(a => a.vectors)")
    assert np.linalg.norm(np.array(arrows), axis=-1).max() < 0.025  # of a robot of 1 m


def test_channels_go_and_come_and_a_figure_zooms(page, pages):
    shown(page, pages["recording"])
    count = "wrenchbed.live.find(f => f.node.id === 'fx').chart.getOption().series.length"
    every = page.run(count)
    page.run("document.querySelector('#fx .key').click()")
    assert page.run("document.querySelector('#fx .key').getAttribute('aria-pressed')") == "false"
    assert page.run(count) == every - 2
    page.run("document.querySelector('#fx .key').click()")
    assert page.run(count) == every
    window = (
        "wrenchbed.live.find(f => f.node.id === 'fx').chart.getOption().dataZoom"
        ".map(z => [z.start, z.end])"
    )
    page.run("document.querySelector('#fx button[title=\"zoom in\"]').click()")
    assert page.run(window) == [[25, 75]]
    page.run("document.querySelector('#fx button[title=\"zoom to all\"]').click()")
    assert page.run(window) == [[0, 100]]


def test_the_data_of_a_figure_come_as_csv(page, pages):
    shown(page, pages["diagnosis"])
    page.run("URL.createObjectURL = file => { window.kept = file; return '#kept'; }; 0")
    page.run("document.querySelector('#heat button[title=\"download the data\"]').click()")
    told = page.call("Runtime.evaluate", expression="kept.text()", awaitPromise=True,
                     returnByValue=True)["result"]["value"]  # fmt: skip
    data = json.loads(page.run("document.getElementById('charts').textContent"))
    matrices = [panel["matrix"] for panel in data["heat"]["panels"]]
    lines = told.strip().split("\n")
    assert lines[0].startswith("panel,series,number of the pose,y,std,observation")
    assert len(lines) == 1 + sum(len(row) for m in matrices for row in m["values"])
    assert f",{matrices[0]['values'][0][0]},," in told


def test_tables_sort_by_numbers_and_filter(page, pages):
    shown(page, pages["study"])
    first = (
        "[...document.querySelectorAll('tbody tr')].filter(r => !r.hidden).map(r => r.innerText)"
    )
    page.run("document.querySelectorAll('th .sort')[1].click()")
    told = [int(row.split("\t")[1]) for row in page.run(first)]
    assert told == sorted(told) and told[-1] == 10
    page.run("document.querySelectorAll('th .sort')[1].click()")
    assert page.run("document.querySelectorAll('th')[1].getAttribute('aria-sort')") == "descending"
    page.run("{const f = document.querySelector('.filter'); f.value = 'method 11'; f.oninput();}")
    assert len(page.run(first)) == 1
    assert "`" not in page.run("document.body.innerText")


A4_PX = 688
"""Width of what is printed on A4 [px]: 210 mm less twice 14 mm, at 96 a inch."""


@pytest.mark.parametrize(("width", "medium"), [(1280, ""), (390, ""), (A4_PX, "print")])
@pytest.mark.parametrize(
    ("kind", "heading", "rows"), [("recording", "differ", 6), ("efforts", "parameters", 2)]
)
def test_residuals_of_channels_and_parameters_of_causes_are_in_view(
    page, pages, kind, heading, rows, width, medium
):
    shown(page, pages[kind], width)
    page.call("Emulation.setEmulatedMedia", media=medium)
    table = f"document.querySelector('#{heading} ~ .scroll')"
    assert page.run(f"{table}.scrollWidth <= {table}.clientWidth")
    assert page.run(f"{table}.querySelectorAll('tbody tr').length") == rows
    page.call("Emulation.setEmulatedMedia", media="")


def test_the_residual_map_of_efforts_is_beside_the_robot(page, pages):
    shown(page, pages["efforts"])
    box = (
        "(n => (r => [r.left, r.top, r.right])(document.querySelector(n).getBoundingClientRect()))"
    )
    robot, heat = (page.run(f"{box}('#{name}')") for name in ("robot", "heat"))
    assert heat[1] == robot[1] and robot[2] < heat[0] < heat[2] < 1280
    data = json.loads(page.run("document.getElementById('charts').textContent"))["heat"]
    assert data["panels"][0]["matrix"]["rows"] == [f"i{k}" for k in range(1, 7)]


def test_a_script_that_is_not_the_pages_own_does_not_run(page, pages):
    shown(page, pages["study"])
    page.run(
        "{const s = document.createElement('script'); s.textContent = 'window.foreign = 1';"
        " document.head.append(s);}"
    )
    assert page.run("window.foreign === undefined")
    page.console.clear()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_paper_has_the_still_figures(page, pages, kind):
    shown(page, pages[kind])
    page.call("Emulation.setEmulatedMedia", media="print")
    still = "[...document.querySelectorAll('.still svg')].every(s => s.getClientRects().length)"
    assert page.run(still)
    assert page.run("[...document.querySelectorAll('.live, .tools, .copy')]"
                    ".every(n => !n.getClientRects().length)")  # fmt: skip
    assert page.run("[...document.querySelectorAll('.still svg')]"
                    ".every(s => s.querySelector('title').textContent)")  # fmt: skip
    page.call("Emulation.setEmulatedMedia", media="")
    pdf = page.printed()
    boxes = re.findall(rb"/MediaBox \[([\d. ]+)\]", pdf)
    sizes = {tuple(round(float(x)) for x in box.split()[2:]) for box in boxes}
    assert sizes and all(abs(w - 595) <= 1 and abs(h - 842) <= 1 for w, h in sizes)  # A4
    if kind in ("diagnosis", "efforts"):
        assert pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") <= 6
    if kind == "recording":  # figures begin on the first page
        assert (
            re.findall(rb"/(?:each|data) \[(\d+) 0 R", pdf)[0] == re.findall(rb"/Pg (\d+)", pdf)[0]
        )
    elements = re.findall(rb"\n(\d+) 0 obj\n<</Type /StructElem\n/S /(\w+)\n/P (\d+)(.*?)\nendobj",
                          pdf, flags=re.DOTALL)  # fmt: skip
    above = {name: (role, parent) for name, role, parent, _ in elements}
    sheets = {}
    for name, *_, rest in elements:
        while name in above and above[name][0] != b"L":
            name = above[name][1]
        if name in above:
            sheets.setdefault(name, set()).update(re.findall(rb"/Pg (\d+)", rest))
    assert all(len(own) == 1 for own in sheets.values())  # no list is divided


def test_the_first_screen_answers_where_which_and_how_far(page, pages):
    page.open(pages["diagnosis"], 1280, 800, prefers_color_scheme="light")
    bottoms = page.run(
        "[...document.querySelectorAll('#where, #which, #far')]"
        ".map(c => c.getBoundingClientRect().bottom)"
    )
    assert len(bottoms) == 3 and max(bottoms) < 800
    for width in (390, 1280):
        page.open(pages["diagnosis"], width, 800)
        step = page.run("document.querySelector('.step').getBoundingClientRect().bottom")
        assert step < 400 and page.run("document.querySelector('.step b').innerText") == "Next"
    assert page.run("document.querySelector('.verdict').offsetHeight") < 70  # two lines at most
    page.run("document.querySelector('#data').scrollIntoView()")
    top = page.run("document.querySelector('nav.contents').getBoundingClientRect().top")
    assert top == 0  # contents stay in view
    first = page.run("document.querySelector('.cards').innerText")
    assert "joint.compliance" in first and re.search(r"9\d(\.\d+)?\s%\sclosed", first)
