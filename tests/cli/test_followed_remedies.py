"""What a verb's refusal advises, followed to the letter: exit code 0 and the right numbers."""

import json
import re
import shlex
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import rtde_moves
import wrenchbed as wb
from commanded import names, said
from emulator_process import shared
from wrenchbed.cli import main
from wrenchbed.data import parquet
from wrenchbed.twin.twin import nominal

FILES = ("copy", "part", "rm", "scale", "state", "write")
"""Verbs of the table beside those of wrenchbed."""
TABLE = (Path(__file__).parents[1] / "data" / "remedies.txt").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for text in re.findall("^= (.*)$", TABLE, re.MULTILINE):
            line = text.split(" ", 2) if text.startswith("write") else shlex.split(text)
            assert (changed if line[0] in FILES else main)(line) in (0, None), text
        wb.Plan.of("medrue", np.zeros((3, 6)), points=np.zeros((3, 3))).write("touches")
        nominal(wb.load("robots", "ur5"), []).write("twin.json")
    return folder


def changed(line):
    """Do what one of `FILES` asks for."""
    verb, name, *more = line
    path = Path(name)
    if verb == "write":
        path.parent.mkdir(exist_ok=True)
        path.write_text(more[0])
    elif verb == "copy":
        shutil.copy(name, more[0])
    elif verb == "rm":
        path.unlink()
    elif verb == "part":
        plan = wb.Plan.read(name)
        wb.Plan.of(plan.robot, plan.q[: int(more[1])]).write(more[0])
    else:
        data, raw = parquet.read(path, OSError)
        if verb == "state":
            raw, more = raw | {more[0]: more[1]}, ["1"]
        data |= {c: data[c] * float(more[0]) for c in more[1:]}
        parquet.write(path, parquet.table_of(data, raw))


def words(text):
    """Words of a line; @ stands for the drive constants, HOST for an emulator's address."""
    fit = json.loads(Path("drives.json").read_text())["parameters"]
    constants = " ".join(str(fit[f"drive.constant.{j}"]["value"]) for j in range(1, 7))
    return shlex.split(text.replace("@", constants).replace("HOST", rtde_moves.HOST))


def done(line, capfd):
    """What the line prints, as JSON where it can; it succeeds."""
    capfd.readouterr()
    if line[0] in FILES:
        return changed(line)
    speaks = line[0] in ("calibrate", "compare", "check")
    code = main([*line, *(["--json"] if speaks else [])])
    told = capfd.readouterr()
    assert code == (4 if line[0] == "check" else 0), (line, told.err)
    return json.loads(told.out) if speaks else told.out


def right(line, told):
    """Whether what the line made has the numbers of the simulated robot."""
    of = dict(pairwise(line))
    if line[0] == "plan":
        plan = wb.Plan.read(of["--out"])
        assert plan.robot == line[1] and len(plan) == int(of.get("--n", len(plan)))
    elif line[0] == "record":
        plan, made = wb.Plan.read(of["--plan"]), wb.Recording.read(of["--out"])
        assert made.metadata.robot == plan.robot and len(made) >= len(plan)
        assert made.q[0] == pytest.approx(plan.q[0], abs=0.02)
    elif line[0] == "calibrate":
        name, most = ("a2", 5e-4) if "a2" in told["parameters"] else ("tool.mass", 0.3)
        truth = json.loads(Path("truth.json").read_text())
        value, std = (told["parameters"][name][key] for key in ("value", "std"))
        assert value == pytest.approx(truth[name], abs=5 * std) and std < most
    elif line[0] == "campaign":
        rows = pq.read_table(Path(of["--out"]) / "robots.parquet").to_pydict()
        assert set(rows["error"]) == {""}
    elif line[0] == "compare":
        assert told["changed"] is False
    elif line[0] == "check":
        assert told["verdict"] == "cannot tell"
    elif line[0] == "live":
        assert np.abs(json.loads(told.splitlines()[-1])["summary"]["rms"]).max() < 0.5


def case(text):
    line, *more = text.splitlines()
    line, _, mark = line.partition("    ")
    marks = [getattr(pytest.mark, name) for name in mark.split()]
    return pytest.param(line, "\n".join(more), marks=marks, id=line)


@pytest.mark.parametrize("line, advised", [case(text) for text in TABLE.split("\n$ ")[1:]])
def test_a_remedy_followed_to_the_letter_works(room, tmp_path, monkeypatch, capfd, line, advised):
    monkeypatch.chdir(shutil.copytree(room, tmp_path / "room"))
    if "HOST" in line:
        shared("ur5", rtde_moves.HOST)
    before = names(Path())
    assert main(words(line)) == 1
    pattern, *alternatives = re.split(r"\n> ", advised)
    match = re.search(pattern.removeprefix("! "), said(capfd))
    assert match is not None and names(Path()) == before
    for lines in alternatives:
        for text in lines.strip().split("\n+ "):
            told = done(each := words(match.expand(text)), capfd)
        right(each, told)
        for path in (Path("new"), Path("other")):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
