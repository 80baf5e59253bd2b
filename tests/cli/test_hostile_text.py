"""Control characters and endless names of foreign files never reach a terminal or a page."""

import json
import os
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from wrenchbed.cli import console, main
from wrenchbed.data import parquet
from wrenchbed.errors import RecordingError, one_line, printable
from wrenchbed.pages.document import Document, Section
from wrenchbed.pages.document import Table as Cells
from wrenchbed.physics.wrench import CHANNELS

EVIL = "\x1b]0;owned\x07\x1b[2J\u202egnp.exe\x9b31m\x7f"
"""Sets a terminal's title, clears it, turns the direction of writing, and more."""
SAID = r"\x1b]0;owned\x07\x1b[2J\u202egnp.exe\x9b31m\x7f"


def clean(text):
    return not any(c in text for c in "\x1b\x07\u202e\x9b\x7f")


def recording(path, **more):
    rng = np.random.default_rng(3)
    joints = {name: more.pop(name) for name in list(more) if name[0] == "q"}
    columns = {"t": np.arange(40.0), "segment": np.arange(40)}
    columns |= {c: rng.normal(size=40) for c in CHANNELS}
    turn = rng.normal(size=(40, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    columns |= joints or dict(zip(("qw", "qx", "qy", "qz"), turn.T, strict=True))
    told = {"format": 1, "robot": "mine", "mode": "static"} | more
    parquet.write(path, parquet.table_of(columns, told))
    return path


def test_a_message_is_one_clean_line():
    error = RecordingError(f"{EVIL}\nwrenchbed: all is well\tx")
    assert str(error) == SAID + r"\nwrenchbed: all is well\tx"
    assert one_line("a \udcff.csv") == r"a \udcff.csv"  # a file's name that is not UTF-8
    assert printable("α·µ – ² 日本 é\n\t") == "α·µ – ² 日本 é\n\t"


def test_what_is_endless_is_cut_and_its_length_said():
    text = one_line(f"robot {'r' * 2_000_000} is unknown")
    assert len(text) < 1000 and "(2,000,000 characters)" in text and text.endswith("is unknown")
    text = one_line("ab " * 100_000 + "remedy")
    assert len(text) < 4000 and "(300,006 characters)" in text and text.endswith("remedy")


@pytest.mark.sampled
@pytest.mark.parametrize("verb", ["calibrate", "diagnose", "report", "import", "record", "view"])
def test_an_evil_file_name_in_an_error(verb, tmp_path):
    words = [verb, f"no {EVIL}\nfile.parquet"]
    done = subprocess.run(
        [sys.executable, "-m", "wrenchbed", *words], cwd=tmp_path, capture_output=True, text=True,
        timeout=60, env=os.environ | {"PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    assert done.returncode in (1, 2)
    assert clean(done.stdout + done.stderr)


def test_evil_metadata_in_the_answers_of_calibrate(tmp_path, capsys):
    path = recording(tmp_path / f"r{EVIL.replace('/', '')}.parquet", robot=EVIL, source=EVIL)
    main(["calibrate", str(path), "--out", str(tmp_path / f"f{EVIL}.json")])
    main(["calibrate", str(path), "--json"])
    said = capsys.readouterr()
    assert clean(said.out + said.err) and "owned" in said.out + said.err


def test_evil_columns_in_an_error(tmp_path, capsys):
    table = pq.read_table(recording(tmp_path / "r.parquet"))
    pq.write_table(table.drop(["fx"]).append_column(EVIL, table["fy"]), tmp_path / "r.parquet")
    assert main(["calibrate", str(tmp_path / "r.parquet")]) == 1
    said = capsys.readouterr().err
    assert clean(said) and said.count("\n") == 1 and SAID in said


def test_tables_texts_and_json_for_people_and_programs_are_clean(capsys):
    from rich.table import Table

    table = Table("name", EVIL)
    table.add_row(EVIL, "1")
    console.answer({}, False, table)
    console.answer({}, False, f"first {EVIL}\nsecond")
    console.say(f"written → {EVIL}\nout")
    console.answer({"robot": f"{EVIL}\udcff"}, True, None)
    said = capsys.readouterr().out
    assert clean(said) and "second" in said
    assert r"gnp.exe\x9b31m\x7f\nout" in said
    assert json.loads(said[said.rindex("{") :])["robot"] == f"{EVIL}\udcff"


def test_pages_are_escaped_and_clean():
    cells = Cells.of(f"<script>{EVIL}", ["a"], [[f"<img src=x onerror=alert(1)>{EVIL}"]])
    html = Document(f"t{EVIL}", "<b>", (Section("s", "text", (cells,)),)).html()
    assert clean(html) and "&lt;img src=x" in html and "<img src=x" not in html
    assert "&lt;script&gt;" + SAID in html
