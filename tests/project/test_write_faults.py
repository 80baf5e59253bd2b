"""Every verb on a disk that fails at each operation in turn, under signals, and without a reader:
nothing is lost, nothing is half.

A verb without a case fails a test. On disks the writing counts: what is costly is computed once.
"""

import errno
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import warnings
from concurrent.futures import Future
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import wrenchbed as wb
from rest_noise import Rest
from wrenchbed import cli, files
from wrenchbed.benchmark.referee import scenario
from wrenchbed.benchmark.sealed import baselines, make
from wrenchbed.cli import blind, main
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.prepare.prepare_recording import prepare
from wrenchbed.jobs.finished_parts import Parts, write_table
from wrenchbed.pages.chart import Axis, Chart, Panel
from wrenchbed.pages.document import Document, Figure, Section, Table
from wrenchbed.pages.draw import Drawn

NTNU = Path(__file__).resolve().parents[1] / "data" / "ntnu_kuka_ati_gamma"
ARM = """<mujoco><compiler autolimits="true"/><worldbody><body>
<joint name="j" range="-1 1"/><geom size="0.1" mass="1"/><body pos="0 0 0.3"><site name="flange"/>
</body></body></worldbody></mujoco>
"""
"""A robot of one joint."""
CASES = {
    "plan": "plan ur5 --n 2 --out p2.parquet",
    "record": "record --robot ur5 --plan p.parquet --samples 6 --out a.parquet --force",
    "import": "import 0-calibration_fts-accel.csv --map static.toml --out i.parquet --force",
    "import --guess": "import 0-calibration_fts-accel.csv --guess --out g.parquet --force",
    "calibrate": "calibrate r.parquet --out fit.json",
    "diagnose": "diagnose r.parquet --out found",
    "view": "view r.parquet --rrd r.rrd",
    "report": "report r.parquet --out r.html",
    "simulate": "simulate twin.json --like r.parquet --out s.parquet --force",
    "export": "export twin.json --mjcf model",
    "export --to": "export twin.json --to franka --out load.json",
    "export --mcap": "export r.parquet --mcap r.mcap --force",
    "check": "check ur5 --history cell --samples 6 --time 2026-04-01T00:00:00Z",
    "campaign": "campaign ur5 --robots 2 --poses 12 --samples 6 --workers 1 --out fleet",
    "robot": "robot arm.xml --frame flange --tool-mass 1 --tool-cog 0 0 0.1 --out arm.toml",
    "sensor": "sensor rest.parquet --out mine.toml",
    "study": "study ur5 --quick --out study",
    "blind make": "blind make --out cases --answers answers --cases 2 --seed 3",
    "blind run": "blind run made --out claims --method bic --processes 1",
    "blind score": "blind score made claimed made-answers --out scored",
}
"""A line for each verb; further lines stand behind what is special in them."""
NOTHING = {
    "list": "list robots", "compare": "compare twin.json twin.json",
    "live": "live twin.json --host 127.0.1.90", "doctor": "doctor --host 127.0.1.90",
    "twin": "twin netft --host 127.0.1.91 --set http_port=0",
}  # fmt: skip
"""Verbs that write no file."""
TOGETHER = {"diagnose": "found", "export": "model"}
"""Folders whose files appear together."""
ANEW = {"blind make", "blind run", "campaign", "check"}
"""What refuses, or finds finished, an earlier result."""


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
BROKEN = OSError(errno.EIO, os.strerror(errno.EIO))


class Disk:
    """Counts what the process does to a folder: open, write, fsync, rename, link and mkdir.

    Attributes:
        done: names of the operations so far.
        fails: number of the operation that fails; none if it is negative.
    """

    def __init__(self, folder: Path, fails: int = -1) -> None:
        self.folder, self.fails, self.done = folder.resolve(), fails, []

    def step(self, what: str) -> bool:
        """Note an operation; whether it must fail. A disk that was full stays full."""
        self.done.append(what)
        here = len(self.done) - 1
        broken = 0 <= self.fails < len(self.done) and self.done[self.fails] == "write"
        return here == self.fails or (broken and what == "write")

    def holds(self, path: object) -> bool:
        """Whether a path or an open file lies in the folder."""
        if isinstance(path, int):
            path = f"/proc/self/fd/{path}"
            return Path(path).resolve().is_relative_to(self.folder)
        return Path(os.fsdecode(path)).absolute().is_relative_to(self.folder)


class _Raw(io.FileIO):
    disk: Disk

    def write(self, data):
        if self.disk.step("write"):
            super().write(bytes(data)[: len(data) // 2])
            raise OSError(*FULL.args)
        return super().write(data)


@contextmanager
def failing(folder: Path, fails: int = -1):
    """Everything in the block works on such a disk."""
    disk = Disk(folder, fails)

    def watched(name, error):
        true = getattr(os, name)

        def operation(path, *more, **options):
            writes = name != "open" or (more and more[0] & os.O_CREAT)
            if writes and disk.holds(path) and disk.step(name):
                raise OSError(*error.args, *([] if name == "fsync" else [os.fspath(path)]))
            return true(path, *more, **options)

        return operation

    def opened(path, mode="r", buffering=-1, opener=None):
        raw = _Raw(path, mode.replace("b", ""), opener=opener)
        raw.disk = disk
        return io.BufferedWriter(raw, buffering)

    with pytest.MonkeyPatch.context() as patch:
        for name, error in (
            ("open", FULL), ("fsync", BROKEN), ("replace", BROKEN), ("rename", BROKEN),
            ("link", BROKEN), ("mkdir", FULL),
        ):  # fmt: skip
            patch.setattr(os, name, watched(name, error))
        patch.setattr(files, "open", opened, raising=False)
        yield disk


def test_every_verb_has_a_case():
    verbs = set(cli._VERBS) - set(cli._GROUPS) | {f"blind {v}" for v in blind.VERBS}
    assert verbs == {case.split(" --")[0] for case in CASES} | set(NOTHING)


class Inline:
    def submit(self, work, *more):
        future = Future()
        try:
            future.set_result(work(*more))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def inline(count, setup=None, *shared):
    if setup is not None:
        setup(*shared)
    yield Inline()


def undrawn(chart):
    return Drawn(chart, "<svg></svg>")


def small_study(folder, *_):
    """A study of one number, with all kinds of files."""
    parts = Parts(folder / "parts")
    parts.write(0, [{"x": 1.0}])
    write_table(folder / "trials.parquet", parts.table())
    figure = Figure("figure", "A figure", Chart("", "", (Panel(Axis("x"), Axis("y")),)))
    section = Section("Results", "A number.", (Table.of("A table", ["x"], [[1.0]]), figure))
    return Document("A study", "It has a number.", (section,), summary={"rank": 1})


@pytest.fixture(scope="module")
def quick():
    """Costly results are computed once."""
    found = cache(lambda path, diagnosed=diagnose: diagnosed(wb.Recording.read(path)))
    prepared = cache(lambda path: prepare(wb.Recording.read(path)))
    answered = cache(lambda path: baselines.bic(wb.Recording.read(path)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wrenchbed.data.writer.FLUSH_S", 1e9)  # no rewriting in another thread
        patch.setattr(scenario, "POSES", (12, 13))
        patch.setattr(scenario, "SAMPLES", 6)
        patch.setattr("wrenchbed.jobs.workers.workers", inline)
        patch.setattr(make.Family, "case", cache(make.Family.case))
        patch.setattr("wrenchbed.diagnosis.diagnose.diagnose", lambda data, **_: found(data.name))
        patch.setattr("wrenchbed.reports.diagnosis_page.draw", undrawn)
        patch.setattr(baselines, "prepare", lambda data: prepared(data.name))
        patch.setitem(baselines.BASELINES, "bic", lambda data: answered(data.name))
        patch.setattr("wrenchbed.studies.ur5.run", small_study)
        yield


SETUP = {
    " p.parquet": "plan ur5 --n 12 --out p.parquet",
    " r.parquet": "record --robot ur5 --plan p.parquet --samples 6 --out r.parquet",
    " cell": "check ur5 --history cell --samples 6 --time 2026-0{}-01T00:00:00Z",
    " made": "blind make --out made --answers made-answers --cases 2 --seed 5",
    " claimed": "blind run made --out claimed --method bic --processes 1",
}
"""Lines that make an input, by a word of the lines that need it."""


class Start:
    """A folder with the inputs of lines, made where a line needs them first."""

    def __init__(self, folder):
        self.folder, self.left = folder, dict(SETUP)
        Rest(seconds=70.0).recording(3).write(folder / "rest.parquet")
        (folder / "twin.json").write_text(json.dumps({"format": 1, "robot": "ur5"}))
        (folder / "arm.xml").write_text(ARM)
        for name in ("0-calibration_fts-accel.csv", "static.toml"):
            shutil.copy(NTNU / name, folder / name)

    def of(self, line):
        """The folder, with what a line needs."""
        for word in [w for w in self.left if w in line]:
            setup = self.left.pop(word)
            self.of(setup)
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(self.folder)
                for month in (1, 2, 3) if "{}" in setup else (1,):
                    assert run(setup.format(month)) == (4 if "{}" in setup else 0)
        return self.folder


@pytest.fixture(scope="module")
def start(tmp_path_factory, quick):
    return Start(tmp_path_factory.mktemp("start"))


def run(line):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return main(line.split())


def files_in(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def whole(name, data):
    """Whether a file can be read to its end."""
    end = name.rstrip("~0123456789").rpartition(".")[2]
    match end:
        case "parquet":
            return pq.read_table(io.BytesIO(data)).num_rows > 0
        case "json":
            return json.loads(data) is not None
        case "toml":
            return bool(tomllib.loads(data.decode()))
        case "rrd":
            return b"RRF2FOOT" in data[-64:]
        case "mcap":
            return data.endswith(b"\x89MCAP0\r\n")
        case "html":
            return data.rstrip().endswith(b"</html>")
        case "xml" | "svg":
            return ElementTree.fromstring(data) is not None
        case "journal":
            return pa.ipc.open_stream(data).read_all().num_rows > 0
    return data.endswith(b"\n")


class Case:
    """A line in a copy of its inputs; with its outputs there already, unless it wants them new."""

    def __init__(self, name, start, folder, again, patch):
        self.line, self.folder, self.patch = CASES[name], folder / "state", patch
        self.inputs = start.of(self.line)
        shutil.copytree(self.inputs, self.folder)
        patch.chdir(self.folder)
        if again:
            assert run(self.line) == 0
        made = set(files_in(self.folder)) - set(files_in(self.inputs))
        for old in made:  # names under which somebody may keep files
            self.folder.joinpath(f"{old}~").write_bytes(b"precious")
        self.before = files_in(self.folder)

    def on(self, folder, fails=-1):
        """Exit code, operations and files of the line on a disk that fails."""
        shutil.copytree(self.folder, folder)
        self.patch.chdir(folder)
        with failing(folder, fails) as disk:
            code = run(self.line)
        after = files_in(folder)
        shutil.rmtree(folder)
        return code, disk.done, after


def together(name, before, good, after):
    """Whether the files of a folder are all old or all new."""
    inside = f"{TOGETHER[name]}/"
    new = [f for f in good if f.startswith(inside) and "~" not in f]
    there = [f in after for f in new]
    if any(f in before for f in new):
        return all(there)
    return all(there) or not any(there)


def spared(name, steps, k):
    """Whether an operation may fail without harm: the folder is there already, a copy does as
    well as a link, and the journal ends after the recording is whole.
    """
    return steps[k] in ("mkdir", "link") or (name == "record" and k == len(steps) - 1)


STRIDES = {"diagnose": 4, "report": 4, "campaign": 3, "blind score": 3}
"""Of these slow lines only every so many operations fail."""
LINES = [(name, again) for name in CASES for again in ((False,) if name in ANEW else (False, True))]


@pytest.mark.sampled
@pytest.mark.parametrize(("name", "again"), LINES)
def test_a_failing_disk_loses_nothing(name, again, start, tmp_path, monkeypatch, capfd):
    case = Case(name, start, tmp_path, again, monkeypatch)
    code, steps, good = case.on(tmp_path / "good")
    assert code == 0
    assert {"open", "write", "fsync", "replace"} <= set(steps)
    words = {part for f in good.keys() - files_in(case.inputs).keys() for part in Path(f).parts}
    capfd.readouterr()
    for k, step in list(enumerate(steps))[again :: STRIDES.get(name, 1)]:
        code, _, after = case.on(tmp_path / "bad", k)
        told = capfd.readouterr().err.splitlines()
        where = f"{step} {k} of {len(steps)}: {told}"
        if code == 0 and spared(name, steps, k):
            assert set(after) == set(good), where
        else:
            assert code == 1, where
            assert len(told) == 1 and told[0].startswith("wrenchbed: error: "), where
            assert any(word in told[0] for word in words), where
        assert not [f for f in after if ".part" in f or f.endswith(".lock")], where
        for file, data in case.before.items():
            kept = [after.get(f"{file}{end}") for end in ("", "~", "~2")]
            assert data in kept or whole(file, after[file]), f"{where}: {file} is lost"
            assert data != b"precious" or after[file] == data, f"{where}: {file} is lost"
        for file, data in after.items():
            assert case.before.get(file) == data or whole(file, data), f"{where}: {file} is half"
        assert name not in TOGETHER or together(name, case.before, good, after), where


PROCESSES = CASES | NOTHING
MOMENTS = (0.2, 0.6, 1.0, 1.3, 1.7, 2.5, 4.0)  # processor time before a signal [s]
ENDS_S, HANGS_S = 1.0, 600.0
"""Processor time that a process may use after a signal [s], and when it counts as hung."""
STOPPED = 130  # exit code; outside of the verb CPython ends by the signal itself


def used(process):
    """Processor time of a process [s], also of one that ended and was not waited for."""
    return sum(psutil.Process(process.pid).cpu_times()[:2])


def process(line, folder, number=signal.SIGTERM, after=HANGS_S, unread=False):
    """Exit code as a shell shows it, processor time since a signal [s], and what was printed."""
    words = [sys.executable, "-m", "wrenchbed", *line.split()]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    out = subprocess.PIPE if unread else subprocess.DEVNULL
    with (
        tempfile.TemporaryFile("w+") as err,
        subprocess.Popen(words, cwd=folder, env=environment, stdout=out, stderr=err) as one,
    ):
        if unread:
            one.stdout.close()
        until, since = time.monotonic() + HANGS_S, 0.0
        while not os.waitid(os.P_PID, one.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG):
            if not since and used(one) >= after:
                since = used(one)
                one.send_signal(number)
            elif time.monotonic() > until:
                one.kill()
            time.sleep(0.002)
        took = used(one) - since if since else 0.0
        code = one.wait()
        err.seek(0)
        return code if code >= 0 else 128 - code, took, err.read()


def check_files(before, folder, killed=False):
    assert before.keys() <= files_in(folder).keys()
    for file, data in files_in(folder).items():
        left = ".part" in file or file.endswith((".lock", ".journal"))
        kept = file.endswith("~.journal")  # rows of a killed run, which --force sets aside
        good = kept or before.get(file) == data or (not left and whole(file, data))
        assert good or (killed and left), f"{file} is half, or left"


@pytest.mark.slow
@pytest.mark.parametrize("name", PROCESSES)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL, signal.SIGPIPE])
def test_a_signal_ends_a_verb_at_once_and_the_next_run_is_clean(number, name, start, tmp_path):
    line, unread = PROCESSES[name], number == signal.SIGPIPE  # nobody reads what it prints
    for moment in MOMENTS[-1:] if unread else MOMENTS:
        folder = Path(shutil.copytree(start.of(line), tmp_path / f"{moment}"))
        before, how = files_in(folder), signal.SIGTERM if unread else number
        code, took, err = process(line, folder, how, moment, unread)
        assert code in (STOPPED, 128 + how, 0, 4) or name in NOTHING or unread, err
        assert took <= ENDS_S and "Traceback" not in err and "ignored" not in err, (moment, err)
        check_files(before, folder, number == signal.SIGKILL)
        if name not in NOTHING and code:
            for left in folder.rglob(files.TEMPORARY):  # the next run clears what is a minute old
                os.utime(left, (0.0, 0.0))
            code, _, err = process(line, folder)
            assert code in (0, 4) or "the new check is of" in err, (moment, err)  # it had ended
            check_files(before, folder)
