"""Atomic writes: complete files or none, and errors that name the file."""

import ast
import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import wrenchbed
from commanded import names
from wrenchbed.files import (
    TEMPORARY,
    atomic_folder,
    atomic_write,
    locked,
    set_aside,
    write_bytes,
    write_json,
    write_text,
)

SOURCE = Path(wrenchbed.__file__).parent


def test_a_file_and_its_folder_appear(tmp_path):
    path = tmp_path / "new" / "a.json"
    write_json(path, {"ä": 1.0})
    assert path.read_text(encoding="utf-8") == '{\n "ä": 1.0\n}\n'
    assert names(path.parent) == ["a.json"]


def test_a_number_that_is_not_finite_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", [float("nan")])
    assert names(tmp_path) == []


def test_a_link_is_replaced_and_not_what_it_points_to(tmp_path):
    victim, link, shared = tmp_path / "victim", tmp_path / "link", tmp_path / "shared"
    victim.write_text("precious")
    link.symlink_to(victim)
    shared.hardlink_to(victim)
    for path in (link, shared):
        write_text(path, "new")
        assert (path.read_text(), path.is_symlink()) == ("new", False)
    assert victim.read_text() == "precious"


def test_permissions_are_those_of_any_new_file_or_of_the_file_before(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_bytes(tmp_path / "new", b"")
    modes = {stat.S_IMODE((tmp_path / n).stat().st_mode) for n in ("plain", "new")}
    assert len(modes) == 1
    (tmp_path / "plain").chmod(0o640)
    write_bytes(tmp_path / "plain", b"new")
    assert stat.S_IMODE((tmp_path / "plain").stat().st_mode) == 0o640


@pytest.mark.parametrize("kind", ["device", "folder", "write-protected"])
def test_what_must_not_be_replaced_is_refused(kind, tmp_path):
    path = tmp_path / "a"
    if kind == "device":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.touch(0o444)
    before = path.stat()
    with pytest.raises(OSError, match=f"is (a )?{kind}") as error:
        write_bytes(path, b"new")
    assert error.value.filename == str(path)
    assert (path.stat().st_ino, path.stat().st_size) == (before.st_ino, before.st_size)
    assert not list(tmp_path.glob(TEMPORARY))


def test_what_a_killed_writer_left_goes_and_what_one_holds_stays(tmp_path):
    old = 0.0, 0.0
    left, folder, fresh = (tmp_path / TEMPORARY.replace("*", x) for x in "abc")
    left.touch()
    folder.mkdir()
    fresh.touch()
    with atomic_write(tmp_path / "held") as file:
        held = next(p for p in tmp_path.glob(TEMPORARY) if p not in (left, folder, fresh))
        for path in (left, folder, held):
            os.utime(path, old)
        code = f"from wrenchbed.files import *; write_bytes({str(tmp_path / 'new')!r}, b'')"
        subprocess.run([sys.executable, "-c", code], check=True)
        file.write(b"x")
    assert set(names(tmp_path)) == {"held", "new", fresh.name}


def test_a_full_disk_names_the_file(tmp_path, monkeypatch):
    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space .*/a"):
        write_bytes(tmp_path / "a", bytes(12_345))
    for named in (False, True):  # the file, not its temporary name
        with pytest.raises(OSError) as error, atomic_write(tmp_path / "a") as temporary:
            raise OSError(errno.ENOSPC, "No space left on device", *[temporary.name] * named)
        assert (error.value.errno, error.value.filename) == (errno.ENOSPC, str(tmp_path / "a"))
    assert names(tmp_path) == []


def test_a_long_name_is_written(tmp_path):
    name = 250 * "n"
    with locked(tmp_path / name):
        write_bytes(tmp_path / name, b"x")
    assert names(tmp_path) == [name]


def test_files_of_a_folder_appear_together(tmp_path):
    write_text(tmp_path / "b", "old")
    write_text(tmp_path / "notes", "mine")
    (tmp_path / "c").mkdir()  # where a file should go
    with pytest.raises(OSError) as error, atomic_folder(tmp_path) as folder:
        for name in "abc":
            write_text(folder / name, "new")
    assert error.value.filename == str(tmp_path / "c")
    assert sorted(names(tmp_path)) == ["b", "c", "notes"]
    assert (tmp_path / "b").read_text() == "old"
    (tmp_path / "c").rmdir()
    with atomic_folder(tmp_path) as folder:
        for name in "abc":
            write_text(folder / name, "new")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {
        "a": "new", "b": "new", "c": "new", "notes": "mine",
    }  # fmt: skip


def test_names_for_what_is_kept_are_never_taken_twice(tmp_path):
    for number in range(3):
        (tmp_path / "a").write_text(str(number))
        set_aside(tmp_path / "a")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {
        "a~": "0",
        "a~2": "1",
        "a~3": "2",
    }
    assert set_aside(tmp_path / "a") is None


HOLD = """
import sys, time
from wrenchbed.files import locked
with locked(sys.argv[1], folder=sys.argv[2] == "folder"):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_two_processes_do_not_write_to_one_output(kind, tmp_path):
    path = tmp_path / "out"
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path), kind], stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None and other.stdout.readline() == b"held\n"
        with (
            pytest.raises(BlockingIOError, match="another process is writing to it") as error,
            locked(path, folder=kind == "folder"),
        ):
            pass
        assert error.value.filename == str(path)
        other.kill()
    with locked(path, folder=kind == "folder"), locked(path, folder=kind == "folder"):
        pass
    assert names(tmp_path) == (["out"] if kind == "folder" else [])


ALLOWED = {
    "files/__init__.py": {"open"},
    "benchmark/sealed/run.py": {"open"},  # another program's output, in a folder of its own
}
WRITES = {"write_text", "write_bytes", "savefig", "save", "to_parquet", "to_csv", "tofile"}


@pytest.mark.slow
def test_nothing_else_writes_files():
    """Other ways to write a file than those of `files` are listed above."""
    ways = {str(path.relative_to(SOURCE)): ways_to_write(path) for path in SOURCE.rglob("*.py")}
    assert {path: found for path, found in ways.items() if found} == ALLOWED


def ways_to_write(path):
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        name = node.func.id if isinstance(node.func, ast.Name) and node.func.id == "open" else name
        modes = [a.value for a in node.args if isinstance(a, ast.Constant)]
        if name in WRITES or (
            name == "open" and any(set(str(m)) & set("wxa+") and len(str(m)) < 4 for m in modes)
        ):
            found.add(name)
    return found
