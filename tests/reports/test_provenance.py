"""Pages of studies and campaigns say where they come from, as those of recordings do."""

import hashlib
import re
import shlex
from html import unescape
from importlib.metadata import version
from types import SimpleNamespace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchbed import studies
from wrenchbed.cli import main
from wrenchbed.pages.document import Document, Section
from wrenchbed.pages.draw import Drawn


def told(html: str) -> dict[str, str]:
    """Facts of a page by their label, and its command."""
    rows = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", html)
    command = re.search(r"<pre>(.*?)</pre>", html)
    return {k: unescape(v) for k, v in [*rows, ("command", command[1] if command else "")]}


def sha256(path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def made_then(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    monkeypatch.setattr("wrenchbed.pages.document.draw", lambda c: Drawn(c, "<svg></svg>"))
    monkeypatch.setattr("wrenchbed.pages.document.svg", lambda *_, **__: "<svg></svg>")
    return f"2023-11-14 22:13 UTC by wrenchbed {version('wrenchbed')}"


def test_a_campaign_says_what_its_numbers_are_of_and_how_to_make_them_again(
    tmp_path, made_then, capsys
):
    out = tmp_path / "a campaign"
    options = ["--robots", "2", "--poses", "12", "--samples", "6", "--seed", "5"]
    assert main(["campaign", "ur5", "--out", str(out), "--workers", "1", *options]) == 0
    facts = told((out / "summary.html").read_text())
    assert facts["made"] == made_then and facts["seed"] == "5"
    for name in ("robots.parquet", "campaign.json"):
        assert facts[f"SHA-256 of {name}"] == sha256(out / name)
        assert sha256(out / name) in (out / "summary.md").read_text()
    capsys.readouterr()
    before = pq.read_table(out / "robots.parquet")["fit.tool.mass"].to_pylist()
    words = shlex.split(facts["command"])
    (out / "robots.parquet").unlink()
    assert words[0] == "wrenchbed" and main(words[1:]) == 0
    assert pq.read_table(out / "robots.parquet")["fit.tool.mass"].to_pylist() == before


def test_a_study_names_the_results_behind_it(tmp_path, made_then, monkeypatch):
    def run(folder, quick, robots, seed, report):
        pq.write_table(pa.table({"x": [1.0]}), folder / "trials.parquet")
        return Document("T", "Lead.", (Section("S", "text"),), "three trials")

    module = SimpleNamespace(run=run, steps=lambda quick, robots: 1)
    monkeypatch.setattr(studies, "_module", lambda paper: module)
    out = tmp_path / "s"
    assert main(["study", "ur5", "--out", str(out), "--quick", "--seed", "4"]) == 0
    html = (out / "ur5.html").read_text()
    assert told(html) == {
        "SHA-256 of trials.parquet": sha256(out / "trials.parquet"),
        "made": made_then,
        "seed": "4",
        "command": shlex.join(["wrenchbed", "study", "ur5", "--out", str(out), "--quick", "--seed",
                               "4"]),
    }  # fmt: skip
    assert "<p>three trials</p>" in html
    assert f"- made: {made_then}" in (out / "ur5.md").read_text()
