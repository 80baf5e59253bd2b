"""What an output may replace: results of its own kind; recordings and logs only with --force."""

import json
import os
import re
import tomllib
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from wrenchbed.data import parquet
from wrenchbed.data.recording import JOURNAL, holds_readings
from wrenchbed.errors import ParameterError
from wrenchbed.files import put_back, set_aside

Made = TypeVar("Made")
_LARGEST = 1 << 26
"""Largest text file that is parsed to find its kind [B]; results are far smaller."""
_FIRST = 512
"""Number of first bytes that are examined [B]."""
_REMEDY = "give another name, or --force, which keeps it with ~ at the end of its name"


class Kind(StrEnum):
    """Kinds of output files; the value is the word for it in messages."""

    RECORDING = "a recording"
    LOG = "an MCAP log"
    PLAN = "a plan"
    FIT = "a fit"
    TWIN = "a twin"
    DIAGNOSIS = "a diagnosis"
    OUTSIDE = "a list of effects"
    MODEL = "a MuJoCo model"
    NOTES = "the notes of an exported model"
    PICTURE = "a picture for rerun"
    PAGE = "a page of wrenchbed"
    MAP = "a column map"
    ROBOT = "a robot's description"
    SENSOR = "a sensor's description"
    EXPORT = "an export of a calibration"
    DRIVES = "values of drives"


MEASURED = (Kind.RECORDING, Kind.LOG)
"""Kinds of files that may hold measurements, which nobody can repeat."""
_FIELDS = (
    (Kind.DIAGNOSIS, {"verdict", "gap"}),
    (Kind.FIT, {"parameters", "status"}),
    (Kind.TWIN, {"effects", "theta"}),
    (Kind.OUTSIDE, {"inside", "outside"}),
    (Kind.DRIVES, {"configured", "effects"}),
    (Kind.EXPORT, {"mass", "centerOfMass", "inertia"}),
    (Kind.ROBOT, {"format", "model"}),
    (Kind.SENSOR, {"format", "calibration"}),
    (Kind.MAP, {"file"}),
)
"""Fields by which a JSON or TOML file's kind is recognized; who writes such files keeps them."""
_MARKS = (
    (rb"\ARRF", Kind.PICTURE), (rb"\A\x89MCAP", Kind.LOG), (rb"\A<mujoco", Kind.MODEL),
    (rb"style-src 'unsafe-inline'", Kind.PAGE), (rb": twin as plain MJCF", Kind.NOTES),
    (rb"exported by wrenchbed", Kind.EXPORT),
)  # fmt: skip
"""Pattern in the first bytes of a file, and the kind of such files."""


def kind_of(path: Path) -> Kind | None:
    """Kind of a file by its content, None if not one of wrenchbed's; `OSError` if unreadable."""
    with path.open("rb") as file:
        first = file.read(_FIRST)
    if first.startswith(b"PAR1"):  # a damaged one may be a recording
        names = parquet.column_names(path)
        if names is None or holds_readings(names):
            return Kind.RECORDING
        return Kind.PLAN if "q1" in names else None
    for mark, kind in _MARKS:
        if re.search(mark, first):
            return kind
    try:
        text = path.read_text(encoding="utf-8") if path.stat().st_size <= _LARGEST else ""
        is_json = text.lstrip().startswith("{")
        fields = json.loads(text) if is_json else tomllib.loads(text)
    except (ValueError, RecursionError):
        return None
    return next((kind for kind, known in _FIELDS if known <= fields.keys()), None)


def check(out: Path, kind: Kind, *inputs: Path | None, force: bool = False) -> None:
    """Refuse an output that would replace what it must not; a `ParameterError` names the remedy.

    A name may be free, an empty file, or a result of the same kind. A recording is replaced only
    with ``force``. Devices, folders, files of other kinds and the inputs are never replaced.
    """
    for source in filter(None, inputs):
        both = out.exists() and source.exists()
        if out.samefile(source) if both else os.path.realpath(out) == os.path.realpath(source):
            raise ParameterError(f"{out}: is an input too; give another name")
    if out.is_dir() or not out.name:
        raise ParameterError(f"{str(out)!r} is a folder; give the name of a file")
    if kind == Kind.RECORDING and not force and out.with_name(out.name + JOURNAL).exists():
        raise ParameterError(f"{out}: an unfinished recording is there already; {_REMEDY}")
    if out.exists() and not out.is_file():
        raise ParameterError(f"{out}: is a device or a pipe; give the name of a file")
    if not out.exists() or out.stat().st_size == 0:
        return
    if (there := kind_of(out)) != kind:
        what = there or "a file that wrenchbed did not write"
        raise ParameterError(f"{out}: is {what}, not {kind}; give another name")
    if kind in MEASURED and not force:
        raise ParameterError(f"{out}: is {kind} already; {_REMEDY}")


def keeping(path: Path, write: Callable[[Path], Made]) -> Made:
    """Call ``write(path)`` and return its result; an existing file is first renamed to the first
    free name of NAME~, NAME~2, … ."""
    kept = set_aside(path, beside=JOURNAL)
    try:
        return write(path)
    except BaseException:
        if kept is not None:
            put_back(kept, path, JOURNAL)
        raise
