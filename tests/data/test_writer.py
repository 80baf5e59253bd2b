"""The writer: one whole file or nothing, and at most a second lost to a kill."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from recorded import METADATA, columns
from wrenchbed.data.recording import Recording
from wrenchbed.data.writer import RecordingWriter
from wrenchbed.errors import RecordingError

WRITE_FOR_EVER = """
import sys, time
import numpy as np
from wrenchbed.data.metadata import parse
from wrenchbed.data.writer import RecordingWriter
meta = parse({"format": 1, "robot": "ur5", "mode": "dynamic"}, "x")
names = ["q1", "q2", "q3", "q4", "q5", "q6", "fx", "fy", "fz", "tx", "ty", "tz"]
start = time.monotonic()
with RecordingWriter(sys.argv[1], meta) as writer:
    while True:
        t = time.monotonic() - start
        writer.append({"t": np.array([t])} | {n: np.array([t]) for n in names})
        print(t, flush=True)
        time.sleep(0.002)
"""


def test_kill_9_loses_at_most_the_last_second(tmp_path):
    path = tmp_path / "rec.parquet"
    with subprocess.Popen(
        [sys.executable, "-c", WRITE_FOR_EVER, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        first = float(process.stdout.readline())
        last = first
        while last < first + 2.2:
            last = float(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
        last = max([last, *(float(x) for x in process.stdout.read().split())])
    plain = pq.read_table(path)  # opens for any reader of Parquet
    with pytest.warns(UserWarning, match="did not finish"):
        recording = Recording.read(path)
    assert last - recording.t[-1] < 1.0
    assert len(recording) >= plain.num_rows > 0
    assert last - plain.column("t")[-1].as_py() < 1.0
    assert recording.metadata.mode == "dynamic"
    assert np.array_equal(recording.columns["fx"], recording.t)


def test_a_journal_cut_in_the_middle_opens_up_to_the_cut(tmp_path):
    path = tmp_path / "rec.parquet"
    with RecordingWriter(path, METADATA) as writer:
        for start in range(0, 20, 5):
            writer.append({k: v[start : start + 5] for k, v in columns().items()})
            writer.flush()
        journal = path.with_name("rec.parquet.journal")
        whole = journal.read_bytes()
    for share in (0.5, 0.7, 0.9):
        journal.write_bytes(whole[: int(share * len(whole))])
        with pytest.warns(UserWarning, match="rows come from its journal"):
            rows = len(Recording.read(path))
        assert rows in (5, 10, 15)
    journal.write_bytes(whole[:50])
    with pytest.raises(RecordingError, match="journal"):
        Recording.read(path)


def killed(path: Path) -> None:
    """A file whose writer died: its journal holds 20 rows, the file itself 5."""
    writer = RecordingWriter(path, METADATA)
    writer.__enter__()
    writer.append({k: v[:5] for k, v in columns().items()})
    writer.flush()
    writer._rewrite_cost = 1e9
    writer.append({k: v[5:] for k, v in columns().items()})
    writer.flush()
    writer._sink.close()
    writer._lock.close()


def test_the_backup_of_a_killed_writer_keeps_its_journal(tmp_path):
    path = tmp_path / "rec.parquet"
    killed(path)
    with RecordingWriter(path, METADATA) as writer:
        writer.append({k: v[:3] for k, v in columns().items()})
    assert len(Recording.read(path)) == 3
    with pytest.warns(UserWarning, match="did not finish"):
        assert len(Recording.read(tmp_path / "rec.parquet~")) == 20


def test_a_stale_journal_does_not_outlive_a_newer_file(tmp_path):
    path = tmp_path / "rec.parquet"
    killed(path)
    Recording(METADATA, {k: v[:3] for k, v in columns().items()}).write(path)
    assert len(Recording.read(path)) == 3
    assert (tmp_path / "rec.parquet.journal~").exists()
