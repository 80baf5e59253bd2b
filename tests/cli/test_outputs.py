"""What an output may replace: results of its kind, recordings only with --force, nothing else."""

import fcntl
import json
import os
import shutil

import pytest

from recorded import METADATA, columns
from wrenchbed.cli import main
from wrenchbed.data.outputs import Kind, check, kind_of
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError, RecordingError


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    """A folder with a plan, a recording and files of somebody else."""
    monkeypatch.chdir(tmp_path)
    for name, short in (("plan", "p"), ("rec", "r")):
        shutil.copy(made / f"{name}.parquet", f"{short}.parquet")
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "mine.json").write_text('{"mine": 1}')
    (tmp_path / "mine.html").write_text("<!doctype html><p>mine")
    os.link("r.parquet", "shared.parquet")
    (tmp_path / "link.parquet").symlink_to("r.parquet")
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
]


@pytest.mark.sampled
@pytest.mark.parametrize(("line", "told"), REFUSED, ids=lambda x: str(x[-1]) if x else "")
def test_what_must_stay_is_refused_by_name(line, told, folder, capsys):
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    capsys.readouterr()
    assert main(line) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"wrenchbed: error: {told}")
    assert error.count("\n") == 1
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_an_output_that_another_process_writes_is_named(folder, capsys):
    capsys.readouterr()
    with (folder / ".fit.json.lock").open("wb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert main([*CALIBRATE, "fit.json"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("wrenchbed: error: ") and error.count("\n") == 1
    assert "fit.json: another process is writing to it" in error and "memory" not in error


def test_force_keeps_recordings_under_names_that_are_free(folder):
    first = (folder / "r.parquet").read_bytes()
    (folder / "r.parquet~").write_text("precious")
    assert main([*RECORD, "--out", "r.parquet", "--force", "--seed", "4"]) == 0
    assert (folder / "r.parquet~").read_text() == "precious"
    assert (folder / "r.parquet~2").read_bytes() == first
    assert (folder / "r.parquet").read_bytes() != first


def test_a_journal_is_not_recorded_over(folder, capsys):
    (folder / "n.parquet.journal").write_bytes(b"of a writer that was killed")
    assert main([*RECORD, "--out", "n.parquet"]) == 1
    assert "n.parquet: an unfinished recording is there already" in capsys.readouterr().err
    assert main([*RECORD, "--out", "n.parquet", "--force"]) == 0
    assert (folder / "n.parquet~.journal").read_bytes() == b"of a writer that was killed"
    assert len(Recording.read("n.parquet")) == 120


def test_a_garbage_journal_beside_a_recording_says_what_to_do(tmp_path):
    path = tmp_path / "r.parquet"
    Recording(METADATA, columns()).write(path)
    (tmp_path / "r.parquet.journal").write_bytes(b"garbage")
    with pytest.raises(RecordingError, match=r"delete or rename it to read .*r\.parquet"):
        Recording.read(path)


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


def test_an_empty_file_may_be_replaced(tmp_path):
    (tmp_path / "x").touch()
    check(tmp_path / "x", Kind.RECORDING)
    with pytest.raises(ParameterError, match="is a folder"):
        check(tmp_path, Kind.RECORDING)
