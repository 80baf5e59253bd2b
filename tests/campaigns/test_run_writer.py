"""A slow disk never keeps a motion waiting, and a full one is named."""

import errno
import threading
import time

import numpy as np
import pytest
from test_run_live import Arm
from test_run_repeated import moving

from wrenchbed.data import parquet, writer
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.data.writer import RecordingWriter

METADATA = parse({"format": 1, "robot": "oriented", "mode": "dynamic"}, "x")
NAMES = ("fx", "fy", "fz", "tx", "ty", "tz")


def block(t: float) -> dict[str, np.ndarray]:
    return {"t": np.array([t]), "q1": np.array([t])} | {name: np.array([t]) for name in NAMES}


@pytest.fixture
def slow(monkeypatch):
    """Every rewriting of the whole file takes half a second; how many ran."""
    runs, write, one = [], parquet.write, threading.Lock()

    def late(path, table):
        assert one.acquire(blocking=False), "two at once"
        try:
            time.sleep(0.5)
            write(path, table)
            runs.append(table.num_rows)
        finally:
            one.release()

    monkeypatch.setattr(parquet, "write", late)
    monkeypatch.setattr(writer, "FLUSH_S", 0.05)
    return runs


class Steady(Arm):
    """An arm that notes how long each of its rows was waited for."""

    def _track(self, targets, rate):
        self.waits = []
        begun = time.monotonic()
        for k in range(len(targets)):
            time.sleep(max(0.0, begun + k / rate - time.monotonic()))
            row = self._row(begun + k / rate, self.read(), self.read_wrench())
            handed = time.monotonic()
            yield {name: np.array([value]) for name, value in row.items()}
            self.waits.append(time.monotonic() - handed)


def test_rows_are_taken_while_the_file_is_rewritten(tmp_path, slow):
    arm, path = Steady(), tmp_path / "r.parquet"
    moving(arm, path, 250)
    assert max(arm.waits) < 0.4  # a rewriting takes 0.5 s
    assert len(slow) > 2  # twice or more on the way, and at the end
    rec = Recording.read(path)
    assert len(rec) == 250
    assert (np.diff(rec.t) > 0).all()
    assert [p.name for p in tmp_path.iterdir()] == ["r.parquet"]


def test_what_is_being_rewritten_is_in_the_journal(tmp_path, slow):
    path = tmp_path / "r.parquet"
    with RecordingWriter(path, METADATA) as out:
        for k in range(30):
            out.append(block(float(k)))
            time.sleep(0.01)
        assert slow == []
        with pytest.warns(UserWarning, match="did not finish"):
            told = Recording.read(path)
        assert np.array_equal(told.t, np.arange(len(told)))
        assert len(told) > 15
    assert np.array_equal(Recording.read(path).t, np.arange(30.0))


def test_flush_waits_for_a_rewriting_under_way(tmp_path, slow, monkeypatch):
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    with RecordingWriter(tmp_path / "r.parquet", METADATA) as out:
        out.append(block(0.0))
        out.append(block(1.0))
        out.flush()  # two at once would fail
        assert slow[0] == 1


def full(path, table):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_is_named_by_the_next_rows_and_the_journal_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet, "write", full)
    monkeypatch.setattr(writer, "FLUSH_S", 0.02)
    path = tmp_path / "r.parquet"
    given = 0
    with pytest.raises(OSError) as told, RecordingWriter(path, METADATA) as out:
        for k in range(100):
            out.append(block(float(k)))
            given = k + 1
            time.sleep(0.01)
    assert told.value.errno == errno.ENOSPC
    assert given < 20
    with pytest.warns(UserWarning, match="did not finish"):
        assert len(Recording.read(path)) == given


def test_a_disk_that_has_space_again_at_the_end_loses_nothing(tmp_path, monkeypatch):
    write, calls = parquet.write, []

    def once_full(path, table):
        calls.append(table.num_rows)
        if len(calls) == 1:
            full(path, table)
        write(path, table)

    monkeypatch.setattr(parquet, "write", once_full)
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    with RecordingWriter(tmp_path / "r.parquet", METADATA) as out:
        out.append(block(0.0))
    assert len(calls) == 2
    assert len(Recording.read(tmp_path / "r.parquet")) == 1
