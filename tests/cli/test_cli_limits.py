"""Too little memory, too few files: told as such at once, and no file is blamed."""

import errno
import resource
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchbed.cli import main
from wrenchbed.data.plan import is_plan
from wrenchbed.data.recording import Recording
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import ShortageError, shortage

MB = 1_000_000
HUNG_S = 60.0


def limited(kind: int, value: int, *words: object) -> tuple[int, str]:
    """Exit code and what it says, of a verb in a process with a limit."""
    done = subprocess.run(
        [sys.executable, "-m", "wrenchbed", *map(str, words)], capture_output=True, text=True,
        timeout=HUNG_S, check=False,
        preexec_fn=lambda: resource.setrlimit(kind, (value, value)),
    )  # fmt: skip
    return done.returncode, done.stderr


@pytest.mark.sampled
@pytest.mark.parametrize(("megabytes", "verb"), [(150, "calibrate"), (500, "diagnose")])
def test_low_memory_is_told_at_once_and_never_hangs(made, tmp_path, megabytes, verb):
    rec = made / "rec.parquet"
    code, said = limited(resource.RLIMIT_AS, megabytes * MB, verb, rec, "--out", tmp_path / "o")
    assert code == 1 and said.count("\n") == 1, said
    assert "out of memory" in said and "ulimit -v" in said and rec.name not in said


@pytest.mark.sampled
@pytest.mark.parametrize("files", [16, 40])
def test_few_open_files_for_workers_are_told_at_once_and_never_hang(tmp_path, files):
    words = ("campaign", "ur5", "--robots", 2, "--poses", 12, "--out", tmp_path / "fleet")
    code, said = limited(resource.RLIMIT_NOFILE, files, *words)
    assert code == 1 and said.count("\n") == 1, said
    assert f"may open {files} and needs 72" in said and "ulimit -n 72" in said


SHORT = [
    (pa.ArrowMemoryError("malloc of size 64 failed"), "out of memory"),
    (MemoryError(), "out of memory"),
    (OSError(errno.ENOMEM, "Cannot allocate memory"), "out of memory"),
    (OSError(errno.EMFILE, "Too many open files"), "too many open files"),
]


@pytest.mark.parametrize(("cause", "told"), SHORT, ids=["arrow", "numpy", "memory", "files"])
def test_no_file_is_called_damaged_for_want_of_memory(made, monkeypatch, cause, told, capsys):
    def fail(*_, **__):
        raise cause

    path = made / "rec.parquet"
    monkeypatch.setattr(pq, "ParquetFile", fail)
    monkeypatch.setattr(pq, "read_schema", fail)
    for read in (Recording.read, is_plan):
        with pytest.raises((ShortageError, MemoryError)):
            read(path)
    assert main(["calibrate", str(path)]) == 1
    said = capsys.readouterr().err
    assert told in said and "raise the limit" in said and "Parquet" not in said


@pytest.mark.parametrize(("cause", "told"), SHORT[2:], ids=["memory", "files"])
def test_a_text_file_is_not_blamed_either(tmp_path, monkeypatch, cause, told):
    def fail(*_, **__):
        raise cause

    path = tmp_path / "log.csv"
    path.write_text("t,fx\n0,1\n1,2\n")
    monkeypatch.setattr(Path, "open", fail)
    monkeypatch.setattr(Path, "read_bytes", fail)
    with pytest.raises(ShortageError, match=f"log.csv: {told}"):
        read_text(path)


def test_what_is_no_shortage_is_none():
    for error in (OSError(errno.ENOENT, "none"), ImportError("no module"), ValueError("memory")):
        assert shortage(error) is None
    unloaded = ImportError("libarrow.so.2600: failed to map segment from shared object")
    assert "out of memory" in str(shortage(unloaded))
