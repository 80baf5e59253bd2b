"""Real cases, sealed: recordings of a robot on which somebody made the truth."""

import re
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from wrenchbed.benchmark.frame import KINDS
from wrenchbed.benchmark.referee.catalogue import EFFECTS
from wrenchbed.benchmark.sealed import commitments, make
from wrenchbed.benchmark.sealed.commitments import Answer, Fact
from wrenchbed.data.checked import Fields, is_number, load
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording
from wrenchbed.errors import BenchmarkError
from wrenchbed.files import write_bytes

CAUSES = {"none": 0, "single": 1, "pair": 2, "outside": 1}
_KEPT = re.compile(
    r"t|segment|status|temperature|f[xyz]|t[xyz]|a[xyz]|q[wxyz]|q\d+|qd\d+|q_target\d+|tau\d+"
)
"""Columns of the contract; others may tell more than they should."""
_UNSAID = ("source",)
"""Fields of the metadata that tell where a recording is from."""


def seal_real(truth: Path, out: Path, answers: Path) -> str:
    """Seal real recordings in random order under numbers; SHA-256 of ``commitments.json``.

    Args:
        truth: TOML file, see docs/how-to/sealed.md; recordings are looked for beside it.
        out: empty folder for cases.
        answers: empty folder for answers.

    Raises:
        BenchmarkError: names the file, case and field that is wrong.
        RecordingError: a recording cannot be trusted.
    """
    cases = list(_cases(truth))
    commitments.check_separate(out, answers)
    for folder in (out, answers):
        folder.mkdir(parents=True, exist_ok=True)
        other = next(folder.iterdir(), None)
        if other is not None:
            raise BenchmarkError(f"{other}: give empty folders")
    seed = make.drawn_seed()
    names = {}
    for place, k in enumerate(np.random.default_rng(seed).permutation(len(cases)), start=1):
        kind, causes, recording = cases[k]
        name, meta = f"{place:04d}", recording.metadata
        names[name] = meta
        answer = Answer(
            name, meta.robot, meta.mode, kind, causes, None, len(recording), None,
            commitments.salt(seed, name),
        )  # fmt: skip
        commitments.write_recording(recording, commitments.recording_of(out, name))
        write_bytes(commitments.answer_of(answers, name), answer.to_bytes())
    robots, modes = ("|".join(sorted({getattr(m, k) for m in names.values()}))
                     for k in ("robot", "mode"))  # fmt: skip
    about = {"source": truth.name, "cases": len(cases), "salt": secrets.token_hex(16)}
    return commitments.commit(out, answers, robots, modes, names, about)


def _cases(truth: Path) -> Iterator[tuple[str, tuple[Fact, ...], Recording]]:
    raw = load(truth, BenchmarkError, "TOML")
    listed = raw.get("case")
    if not isinstance(listed, list) or not listed:
        raise BenchmarkError(f"{truth}: has no [[case]]")
    for number, entry in enumerate(listed, start=1):
        where = f"{truth}: case {number}: "
        case = Fields(entry, where, BenchmarkError)
        kind = case.choice("kind", KINDS, f"is none of {', '.join(KINDS)}")
        if not isinstance(case.raw.get("cause", []), list):
            raise BenchmarkError(f"{where}write causes as [[case.cause]], in double brackets")
        causes = tuple(_fact(cause, kind) for cause in case.parts("cause"))
        if len(causes) != CAUSES[kind]:
            raise BenchmarkError(
                f"{where}kind {kind!r} has {CAUSES[kind]} [[case.cause]], found {len(causes)}"
            )
        name = str(case.text("recording", required=True, rule="is no file name"))
        yield kind, causes, plain(Recording.read(truth.parent / name))


def _fact(cause: Fields, kind: str) -> Fact:
    effect = str(cause.text("effect", required=True))
    if kind != "outside" and effect not in EFFECTS:
        raise cause.error("effect", f"is unknown; known are {', '.join(EFFECTS)}")
    tables = cause.part("true").raw  # cog.x = 1 is a table in a table
    inner = {k: v if isinstance(v, Mapping) else {"": v} for k, v in tables.items()}
    true = {f"{k}.{n}" if n else k: v for k, t in inner.items() for n, v in t.items()}
    if not all(map(is_number, true.values())):
        raise cause.error("true", "must be a table of numbers, SI")
    rows = 1.0 if kind != "outside" and EFFECTS[effect].between else 0.0
    return Fact(effect, None, None, rows, {k: float(v) for k, v in true.items()}, ())


def plain(recording: Recording) -> Recording:
    """A recording with what the contract names, and nothing else that might tell."""
    meta = {k: v for k, v in recording.metadata.to_json().items() if k not in _UNSAID}
    columns = {k: v for k, v in recording.columns.items() if _KEPT.fullmatch(k)}
    known = {k: meta[k] for k in meta if k not in recording.metadata.extra}
    return Recording(parse(known, recording.name), columns, recording.name)
