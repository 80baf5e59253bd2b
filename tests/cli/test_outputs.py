"""What an output may replace, and what names and texts of others may do to it: nothing."""

import fcntl
import json
import os
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from recorded import METADATA, columns
from wrenchbed.cli import console, main
from wrenchbed.data import parquet
from wrenchbed.data.overwrite_rules import Kind, check, kind_of
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError, RecordingError, one_line, printable
from wrenchbed.pages.document import Document, Section
from wrenchbed.pages.document import Table as Cells
from wrenchbed.physics.wrench import CHANNELS


@pytest.fixture
def folder(folder, tmp_path):
    """With files of somebody else."""
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "mine.json").write_text('{"mine": 1}')
    (tmp_path / "mine.html").write_text("<!doctype html><p>mine")
    os.link("r.parquet", "shared.parquet")
    (tmp_path / "link.parquet").symlink_to("r.parquet")
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    return tmp_path


RECORD = ["record", "--robot", "ur5", "--plan", "p.parquet", "--samples", "6"]
CALIBRATE = ["calibrate", "r.parquet", "--out"]
REFUSED = [
    ([*RECORD, "--out", "r.parquet"], "r.parquet: is a recording already; give another name, or"),
    ([*RECORD, "--out", "p.parquet"], "p.parquet: is an input too"),
    ([*RECORD, "--out", "mine.txt", "--force"], "mine.txt: is a file that wrenchbed did not write"),
    ([*CALIBRATE, "p.parquet"], "p.parquet: is a plan, not a fit; give another name"),
    ([*CALIBRATE, "shared.parquet"], "shared.parquet: is an input too"),
    ([*CALIBRATE, "link.parquet"], "link.parquet: is an input too"),
    ([*CALIBRATE, "mine.json"], "mine.json: is a file that wrenchbed did not write, not a fit"),
    ([*CALIBRATE, ""], "'.' is a folder; give the name of a file"),
    (["plan", "ur5", "--n", "2", "--out", ""], "'.' is a folder; give the name of a file"),
    (["plan", "ur5", "--n", "2", "--out", "/dev/null"], "/dev/null: is a device or a pipe"),
    (["plan", "ur5", "--n", "2", "--out", "r.parquet"], "r.parquet: is a recording, not a plan"),
    (["report", "r.parquet", "--out", "mine.html"], "mine.html: is a file that wrenchbed did not"),
    (["view", "r.parquet", "--rrd", "p.parquet"], "p.parquet: is a plan, not a picture for rerun"),
    (["view", "r.parquet", "--rrd", "r.parquet"], "r.parquet: is an input too"),
    (["report", "r.parquet", "--out", "r.parquet"], "r.parquet: is an input too"),
    (["calibrate", "r.parquet", "--report", "r.parquet"], "r.parquet: is an input too"),
    (["report", "loop", "--out", "p.html"], "loop: there is no such file"),
    (["report", "r.parquet", "--out", "loop"], "loop: Too many levels"),
    (["blind", "score", "r.parquet", "loop", "answers"], "r.parquet/commitments.json: there is"),
    (["import", "mine.txt", "--guess", "--out="], "'.' is a folder; give the name of a file"),
    (["import", "pipe", "--guess", "--out", "i.parquet"], "pipe: is no regular file"),
    (["simulate", "pipe", "--like", "r.parquet", "--out", "s"], "pipe: is no regular file"),
    (["view", "pipe", "--rrd", "v.rrd"], "pipe: there is no such file"),
    (["twin", "netft", "--faults", "pipe"], "pipe: not valid TOML: it is no regular file"),
]


@pytest.mark.sampled
@pytest.mark.parametrize(("line", "told"), REFUSED, ids=lambda x: str(x[-1]) if x else "")
def test_what_must_stay_is_refused_by_name(line, told, folder, capsys):
    before = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    capsys.readouterr()
    assert main(line) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"wrenchbed: error: {told}")
    assert error.count("\n") == 1
    assert {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()} == before


def test_an_output_that_another_process_writes_is_named(folder, capsys):
    capsys.readouterr()
    with (folder / ".fit.json.lock").open("wb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert main([*CALIBRATE, "fit.json"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("wrenchbed: error: ") and error.count("\n") == 1
    assert "fit.json: another process is writing to it" in error and "memory" not in error


def test_force_keeps_what_was_there_under_names_that_are_free(folder, capsys):
    first = (folder / "r.parquet").read_bytes()
    (folder / "r.parquet~").write_text("precious")
    assert main([*RECORD, "--out", "r.parquet", "--force", "--seed", "4"]) == 0
    assert (folder / "r.parquet~").read_text() == "precious"
    assert (folder / "r.parquet~2").read_bytes() == first
    assert (folder / "r.parquet").read_bytes() != first
    (folder / "n.parquet.journal").write_bytes(b"of a writer that was killed")
    assert main([*RECORD, "--out", "n.parquet"]) == 1
    assert "n.parquet: an unfinished recording is there already" in capsys.readouterr().err
    assert main([*RECORD, "--out", "n.parquet", "--force"]) == 0
    assert (folder / "n.parquet~.journal").read_bytes() == b"of a writer that was killed"
    assert len(Recording.read("n.parquet")) == 120


def test_kinds_are_known_by_content(tmp_path):
    """A name says nothing; a damaged Parquet file may be a recording."""
    path = tmp_path / "x"
    for content, kind in (
        (b"PAR1 cut off", Kind.RECORDING), (b"\x89MCAP0\r\n", Kind.LOG), (b"RRF2", Kind.PICTURE),
        (b"<mujoco>", Kind.MODEL), (b"{}", None), (b"[[[", None), (b"[" * 99_999, None),
        (json.dumps({"verdict": 1, "gap": 1}).encode(), Kind.DIAGNOSIS), (b"\xff\xfe", None),
        (b'[[file]]\nmatch = "x"', Kind.MAP), (b'robot = "x"', None),
    ):  # fmt: skip
        path.write_bytes(content)
        assert kind_of(path) == kind, content[:20]


def test_an_empty_file_may_be_replaced_and_a_garbage_journal_says_what_to_do(tmp_path):
    (tmp_path / "x").touch()
    check(tmp_path / "x", Kind.RECORDING)
    with pytest.raises(ParameterError, match="is a folder"):
        check(tmp_path, Kind.RECORDING)
    path = tmp_path / "r.parquet"
    Recording(METADATA, columns()).write(path)
    (tmp_path / "r.parquet.journal").write_bytes(b"garbage")
    with pytest.raises(RecordingError, match=r"delete or rename it to read .*r\.parquet"):
        Recording.read(path)


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


def test_a_message_is_one_clean_line_of_bounded_length():
    error = RecordingError(f"{EVIL}\nwrenchbed: all is well\tx")
    assert str(error) == SAID + r"\nwrenchbed: all is well\tx"
    assert one_line("a \udcff.csv") == r"a \udcff.csv"  # a file's name that is not UTF-8
    assert printable("α·µ – ² 日本 é\n\t") == "α·µ – ² 日本 é\n\t"
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


def test_evil_metadata_and_columns_in_the_answers_of_calibrate(tmp_path, capsys):
    path = recording(tmp_path / f"r{EVIL.replace('/', '')}.parquet", robot=EVIL, source=EVIL)
    main(["calibrate", str(path), "--out", str(tmp_path / f"f{EVIL}.json")])
    main(["calibrate", str(path), "--json"])
    said = capsys.readouterr()
    assert clean(said.out + said.err) and "owned" in said.out + said.err
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
    assert clean(said) and "second" in said and r"gnp.exe\x9b31m\x7f\nout" in said
    assert json.loads(said[said.rindex("{") :])["robot"] == f"{EVIL}\udcff"


def test_the_remaining_time_falls_from_step_to_step_and_between(monkeypatch):
    made, now, shown = [], [0.0], []
    monkeypatch.setattr("rich.console.monotonic", lambda: now[0])
    monkeypatch.setattr(console.bars.Progress, "start", lambda bar: made.append(bar))
    with console.progress("cases", 110) as report:
        report(10)  # of an earlier run
        for now[0] in (90.0, 120.0, 150.0, 180.0):  # the first step loads libraries
            shown.append(made[0].columns[-1](made[0].tasks[0]).plain)
            report(1)
            shown.append(made[0].columns[-1](made[0].tasks[0]).plain)
    assert shown == ["-:--:--"] * 5 + ["0:48:30", "0:48:00", "0:48:00"]


def test_pages_are_escaped_and_clean():
    cells = Cells.of(f"<script>{EVIL}", ["a"], [[f"<img src=x onerror=alert(1)>{EVIL}"]])
    html = Document(f"t{EVIL}", "<b>", (Section("s", "text", (cells,)),)).html()
    assert clean(html) and "&lt;img src=x" in html and "<img src=x" not in html
    assert "&lt;script&gt;" + SAID in html
