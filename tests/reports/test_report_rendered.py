"""The report as a person sees it: in Chromium, light, dark, narrow and on paper."""

import itertools
import re

import pytest
from test_report import found

from chromium import BINARY, tab
from pictures import unless
from wrenchbed.pages.document import Document as Study
from wrenchbed.pages.document import Figure, Section, Table
from wrenchbed.reports.diagnosis_page import diagnosis_page

pytestmark = unless(BINARY is not None, "chromium is not installed")

SCREEN = (1280, 800)
LEAST_CONTRAST, LEAST_LARGE = 4.5, 3.0
"""WCAG 2.2, 1.4.3, level AA: of text, and of text from 24 px, or 18.66 px if bold."""
CONTRAST = """(() => {
  const canvas = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const rgba = text => { canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = text;
    canvas.fillRect(0, 0, 1, 1); return [...canvas.getImageData(0, 0, 1, 1).data]; };
  const light = c => { const [r, g, b] = c.slice(0, 3).map(v => { v /= 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const under = node => { for (let at = node; at; at = at.parentElement) {
    const c = rgba(getComputedStyle(at).backgroundColor); if (c[3] > 250) return c; }
    return [255, 255, 255, 255]; };
  const inside = (r, x, y) => r.left <= x && x <= r.right && r.top <= y && y <= r.bottom;
  const beneath = text => { const b = text.getBoundingClientRect();
    const [x, y] = [(b.left + b.right) / 2, (b.top + b.bottom) / 2];
    const shapes = [...text.closest('svg').querySelectorAll('path, rect')].filter(s =>
      s.compareDocumentPosition(text) & Node.DOCUMENT_POSITION_FOLLOWING
      && !s.closest('defs, clipPath') && inside(s.getBoundingClientRect(), x, y)
      && s.getBoundingClientRect().height > b.height / 2);
    const colours = shapes.map(s => [getComputedStyle(s).fill, getComputedStyle(s).fillOpacity])
      .filter(([f, o]) => f !== 'none' && !f.startsWith('url') && o > .9).map(([f]) => rgba(f))
      .filter(c => c[3] > 250);
    return colours.pop() ?? under(text.closest('svg').parentElement); };
  const bad = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let n = walk.nextNode(); n; n = walk.nextNode()) {
    const own = n.parentElement;
    if (!n.textContent.trim() || own.closest('title') || !own.getClientRects().length) continue;
    const drawn = own.closest('svg');
    const style = getComputedStyle(own), size = parseFloat(style.fontSize);
    const [a, b] = [light(rgba(drawn ? style.fill : style.color)),
      light(drawn ? beneath(own) : under(own))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
    if (ratio < (large ? LARGE : LEAST)) bad.push([n.textContent.trim().slice(0, 40), ratio]);
  }
  return bad; })()""".replace("LARGE", str(LEAST_LARGE), 1).replace("LEAST", str(LEAST_CONTRAST), 1)


@pytest.fixture(scope="module", params=["cause", "none"])
def shown(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    effects = ("base.tilt:x=0.006,y=-0.004",) if request.param == "cause" else ()
    diagnosis_page(found(folder, *effects)).write(folder / "report.html")
    with tab() as page:
        yield page, folder / "report.html", request.param


def words(page) -> str:
    return page.run("document.body.innerText")


@pytest.mark.sampled
def test_the_first_screen_answers_where_which_and_how_far(shown):
    page, path, kind = shown
    page.open(path, *SCREEN, prefers_color_scheme="light")
    bottoms = page.run(
        "[...document.querySelectorAll('#where, #which, #far')]"
        ".map(c => c.getBoundingClientRect().bottom)"
    )
    assert len(bottoms) == 3 and max(bottoms) < SCREEN[1]
    first = page.run("document.querySelector('header').innerText + '\\n' +"
                     "document.querySelector('.cards').innerText")  # fmt: skip
    if kind == "cause":
        assert "base.tilt" in first
        assert re.search(r"(9\d(\.\d+)?|100(\.\d+)?)\s%\sclosed", first)
    else:
        assert "No cause" in first


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_text_can_be_read_and_nothing_overflows(shown, scheme, width):
    page, path, _ = shown
    page.open(path, width, 800, prefers_color_scheme=scheme)
    assert page.run(CONTRAST) == []
    assert page.run("document.documentElement.scrollWidth") <= width
    ground = page.run("getComputedStyle(document.body).backgroundColor")
    assert (max(map(int, re.findall(r"\d+", ground)[:3])) < 80) == (scheme == "dark")


@pytest.mark.sampled
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_of_studies_can_be_read_too(tmp_path, scheme):
    cells = [(f"method {k}", *([0.123456 * 10**k] * 9)) for k in range(3)]
    table = Table.of("Table 1", ("method", *(f"force {k} [N]" for k in range(9))), cells, "note")
    drawn = Figure("f", "Figure 1", '<svg width="900" height="300"></svg>', "what it shows")
    study = Study("A study", "Lead.", (Section("S", "text", (table, drawn)),), "made by")
    study.write(tmp_path, "study")
    with tab() as page:
        page.open(tmp_path / "study.html", 390, 800, prefers_color_scheme=scheme)
        assert page.run(CONTRAST) == []
        assert page.run("document.documentElement.scrollWidth") <= 390
        assert "Figure 1. what it shows" in words(page)
        assert set(page.requests.values()) == {(tmp_path / "study.html").as_uri()}
        assert page.console == []


def test_the_contrast_check_notices_pale_text(shown):
    page, path, _ = shown
    page.open(path, *SCREEN)
    page.run("document.querySelector('.card p').style.color = '#aaaaaa'")
    assert len(page.run(CONTRAST)) >= 1


def test_it_needs_no_network_and_complains_of_nothing(shown):
    page, path, _ = shown
    page.open(path, *SCREEN)
    words(page)
    assert set(page.requests.values()) == {path.as_uri()}
    assert page.console == []
    assert path.stat().st_size < 2_000_000


def test_figures_have_words_for_who_cannot_see_them(shown):
    page, path, _ = shown
    page.open(path, *SCREEN)
    mute = page.run(
        "[...document.querySelectorAll('figure svg')].filter(s => !s.getAttribute('aria-label')"
        " && !s.closest('figure').querySelector('figcaption, .title')).length"
    )
    assert mute == 0
    assert page.run("document.documentElement.lang") == "en"
    headings = page.run("[...document.querySelectorAll('h1,h2,h3')].map(h => +h.tagName[1])")
    assert headings[0] == 1 and all(b - a <= 1 for a, b in itertools.pairwise(headings))


def test_all_that_scrolls_can_be_reached_by_keyboard(shown):
    page, path, _ = shown
    page.open(path, 390, 800)
    cut = page.run(
        "[...document.querySelectorAll('.scroll, pre')].filter(s => s.scrollWidth >"
        " s.clientWidth + 1 && s.tabIndex < 0).length"
    )
    assert cut == 0


def test_it_prints_on_a4(shown):
    page, path, _ = shown
    page.open(path, *SCREEN)
    pdf = page.printed()
    boxes = set(re.findall(rb"/MediaBox \[([\d. ]+)\]", pdf))
    sizes = {tuple(round(float(x)) for x in box.split()[2:]) for box in boxes}
    assert sizes <= {(595, 842), (594, 841), (596, 842), (594, 842), (595, 841)} and sizes
    assert pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") <= 8
