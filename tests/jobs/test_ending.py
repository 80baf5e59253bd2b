"""Workers end with the process that started them; parts of a job are finished once."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wrenchbed.errors import BenchmarkError, ShortageError, WorkerError
from wrenchbed.jobs import finished_parts
from wrenchbed.jobs.ending import bound
from wrenchbed.jobs.workers import in_workers, workers

HERE = Path(__file__).parent
ENDS_S = 1.0
"""The promise."""


def start(*command: object) -> subprocess.Popen:
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, *map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": path, "PYTHONUNBUFFERED": "1"},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # else as in our shell
    )  # fmt: skip


def runs(process: psutil.Process) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def alive_after(processes: Sequence[psutil.Process], seconds: float) -> list[str]:
    """Commands of those that still run after so long; they are killed then."""
    until = time.monotonic() + seconds
    while any(map(runs, processes)) and time.monotonic() < until:
        time.sleep(0.01)
    left = [p for p in processes if runs(p)]
    told = [" ".join(p.cmdline()) for p in left]
    for process in left:
        process.kill()
    return told


def descendants(process: subprocess.Popen, least: int) -> list[psutil.Process]:
    """All of them once there are enough."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        found = psutil.Process(process.pid).children(recursive=True)
        if len(found) >= least:
            return found
        time.sleep(0.05)
    raise AssertionError("they did not start")


def killed(process: subprocess.Popen, least: int, how: int = signal.SIGKILL) -> float:
    """Seconds from a signal until all descendants are gone and the pipe is at its end."""
    children = descendants(process, least)
    begun = time.monotonic()
    process.send_signal(how)
    assert not alive_after(children, 5.0)
    with process:
        process.stdout.read()  # ends when nobody holds the pipe
    return time.monotonic() - begun


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize("busy", [False, True])
def test_workers_end_with_a_killed_or_interrupted_parent(busy, how):
    process = start("-m", "worked", "pool", busy)
    assert process.stdout.readline().strip() == b"at work"
    assert killed(process, 2, how) < ENDS_S


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize("kind, least", [("program", 4), ("bound", 1)])
def test_a_program_of_a_process_or_its_worker_and_what_it_started_end_too(kind, least, how):
    process = start("-m", "worked", kind)
    assert process.stdout.readline().strip() == b"at work"
    assert killed(process, least, how) < ENDS_S


def test_a_bound_program_tells_its_own_exit_code():
    assert subprocess.run(bound(["/bin/sh", "-c", "exit 7"]), check=False).returncode == 7


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (-signal.SIGKILL, r"killed \(SIGKILL\), as the system does when memory runs out.*fewer"),
        (-signal.SIGSEGV, r"crashed \(SIGSEGV\)"),
        (3, "ended with code 3"),
    ],
)
def test_a_worker_that_dies_is_named_while_others_work(how, message):
    from worked import SLEEPS_S, die

    begun = time.monotonic()
    with pytest.raises(WorkerError, match=message):
        in_workers(die, [how, 0], lambda _, future: future.result(), 2)
    assert time.monotonic() - begun < 0.5 * SLEEPS_S


def test_the_first_of_very_many_items_are_done_at_once():
    with pytest.raises(ZeroDivisionError):
        in_workers(int, range(10**22), lambda _, future: 1 / future.result(), 2)


def squares(shared: int, number: int) -> list[finished_parts.Row]:
    return [{"number": number, "square": number**2 + shared}]


@pytest.mark.slow
def test_finished_parts_are_not_done_again(tmp_path):
    counts: list[int] = []
    store = finished_parts.Parts(tmp_path, "x-")
    table = finished_parts.run(squares, 1, range(4), store, counts.append, processes=2)
    assert table["square"].to_pylist() == [1, 2, 5, 10] and sum(counts) == 4
    store.path(2).unlink()
    (tmp_path / f".{store.path(1).name}.0.part").write_bytes(b"half")
    store.path(3).write_bytes(b"PAR1 cut short")
    pq.write_table(pa.table({"number": [0], "square": [99]}), store.path(0))
    again = finished_parts.run(squares, 1, range(4), store, processes=2)
    assert again["square"].to_pylist() == [99, 2, 5, 10]


def broken(shared: int, number: int) -> list[finished_parts.Row]:
    raise ValueError(f"part {number}")


def test_a_part_that_fails_says_so(tmp_path):
    with pytest.raises(ValueError, match="part"):
        finished_parts.run(broken, 0, range(2), finished_parts.Parts(tmp_path, "b-"), processes=1)
    assert not list(tmp_path.iterdir())


def test_keys_change_with_their_content():
    one, same, other = (finished_parts.key(1, [number]) for number in (2, 2, 3))
    assert one == same != other


def test_parts_are_tables_in_the_order_of_their_numbers(tmp_path):
    schema = pa.schema([("robot", pa.int64())])
    store = finished_parts.Parts(tmp_path, schema=schema)
    assert store.table().num_rows == 0 and store.table().schema == schema
    store.write(2, [{"robot": 5}])
    store.write(1, [{"robot": 7}, {"robot": 6}])
    (tmp_path / "notes.parquet").write_text("mine")
    assert store.numbers() == [1, 2]
    assert store.table()["robot"].to_pylist() == [7, 6, 5]
    store.remove()
    assert [p.name for p in tmp_path.iterdir()] == ["notes.parquet"]


def test_folders_of_another_run_are_refused(tmp_path):
    settings, folders = tmp_path / "a" / "run.json", (tmp_path / "a", tmp_path / "b")
    finished_parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)
    assert all(folder.is_dir() for folder in folders)
    (tmp_path / "b" / "thesis.tex").write_text("mine")
    with pytest.raises(BenchmarkError, match=r"b: holds other files, such as thesis\.tex"):
        finished_parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)
    settings.write_text(json.dumps({"seed": 1, "commitments": None}))
    finished_parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)
    with pytest.raises(BenchmarkError, match="seed = 1, not 2"):
        finished_parts.check_folders(settings, {"seed": 2}, folders, BenchmarkError)
    settings.write_text("[]")
    with pytest.raises(BenchmarkError, match="is broken"):
        finished_parts.check_folders(settings, {"seed": 1}, folders, BenchmarkError)


def test_a_machine_without_shared_memory_is_named(monkeypatch):
    def refused(*_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("wrenchbed.jobs.workers.ProcessPoolExecutor", refused)
    with pytest.raises(ShortageError, match="Read-only.*: make /dev/shm writable"), workers(1):
        pass
