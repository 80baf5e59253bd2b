"""The arena: public recordings whose cause or truth is known, each answered once per version.

``python -m wrenchbed.benchmark.arena CATALOGUE DATA OUT`` runs every set of a catalogue
(docs/arena) on files that its user brings, as lines of the command line in a folder of its own,
judges the answers, and writes them as one page, wrong ones first.
"""

import argparse
import hashlib
import json
import os
import shlex
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from wrenchbed.diagnosis.result import named_by
from wrenchbed.errors import BenchmarkError, WrenchbedError, did_you_mean, one_line
from wrenchbed.files import remove, write_json, write_text
from wrenchbed.files.checked import load, parsed, text_of
from wrenchbed.pages.document import Card, Document, Section, Table, provenance

SURE = 0.9
"""Probability above which a claim counts as sure, as in scores of sealed cases."""
MARKS = ("wrong", "crashed", "refused", "open", "right", "missing")
"""What an answer can be, the worst first. ``open``: no wrong claim, but not the cause either;
``refused``: no answer, or not by the true reason; ``missing``: nobody brought the files."""
_NEEDED = ("id", "repository", "commit", "files", "run", "right")


@dataclass(frozen=True)
class ArenaSet:
    """One data set of a catalogue with its true answer (docs/how-to/arena.md): ``files``: start of
    the SHA-256 by path; ``run``: command lines; ``right``: what `judge` takes; ``facts``: texts for
    the page; ``write``: texts of files by name; ``prepare``: Python code that runs first."""

    id: str
    repository: str
    commit: str
    files: Mapping[str, str]
    run: Sequence[str]
    right: Mapping[str, Any]
    facts: Mapping[str, str]
    write: Mapping[str, str] = field(default_factory=dict)
    prepare: str = ""

    def source(self, name: str, data: Path) -> Path:
        """Path below ``data`` of the file ``PATH`` of this repository or ``OWNER/NAME:PATH``."""
        other, _, path = name.rpartition(":")
        return data / (other or self.repository) / path

    def missing(self, data: Path) -> str:
        """Sentence on the first file that ``data`` lacks or has in another version, else ""."""
        for name, digest in self.files.items():
            path = self.source(name, data)
            if not path.is_file():
                return f"{path} is missing: bring {self.repository} at {self.commit}"
            if not hashlib.sha256(path.read_bytes()).hexdigest().startswith(digest):
                return f"{path} is another version than that of {self.commit}"
        return ""


class Judged(NamedTuple):
    """Mark of an answer (of `MARKS`), its text, and claims above `SURE` as (name, p, right)."""

    mark: str
    said: str
    claims: tuple[tuple[str, float, bool], ...] = ()


def read(catalogue: Path) -> list[ArenaSet]:
    """Read the sets of a TOML file or of a folder; `BenchmarkError` on a bad key or double name."""
    sets: dict[str, ArenaSet] = {}
    for path in sorted(catalogue.glob("*.toml")) if catalogue.is_dir() else [catalogue]:
        content = parsed(text_of(path, BenchmarkError).encode(), str(path), BenchmarkError, "TOML")
        shared = content.get("shared", {})
        for entry in content.get("set", []):
            keys = shared | entry
            texts = shared.get("write", {}) | entry.get("write", {})
            keys["write"] = {
                n: x if isinstance(x, str) else text_of(path.parent / x["file"], BenchmarkError)
                for n, x in texts.items()
            }
            words = [k for k in keys if k not in ArenaSet.__dataclass_fields__]
            facts = {k: str(keys.pop(k)) for k in words}
            if lacks := [k for k in _NEEDED if k not in keys]:
                raise BenchmarkError(f"{path}, set {keys.get('id')!r}: lacks {', '.join(lacks)}")
            made = ArenaSet(**keys, facts=facts)
            if made.id in sets:
                raise BenchmarkError(f"{path}: two sets are called {made.id!r}")
            sets[made.id] = made
    return list(sets.values())


def version() -> str:
    """SHA-256 of all Python files of wrenchbed but the benchmark's: it identifies the program."""
    here, whole = Path(__file__).parent, hashlib.sha256()
    for path in sorted(here.parent.rglob("*.py")):
        if here not in path.parents:
            whole.update(path.read_bytes())
    return whole.hexdigest()


def answer(one: ArenaSet, data: Path, folder: Path, method: str, limit: float) -> dict[str, Any]:
    """Run a set's commands on files below ``data`` in ``folder``, emptied first, within ``limit``
    [s] each; ``method`` replaces ``diagnose`` if any. Return exit code, last words, JSON answer."""
    remove(folder)
    for name in one.files:
        link = folder / "files" / name.rpartition(":")[2]
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(one.source(name, data).resolve())
    for name, text in one.write.items():
        write_text(folder / name, text)
    calls = [[sys.executable, "-c", one.prepare]] if one.prepare else []
    for line in one.run:
        verb, *rest = shlex.split(line)
        ours = [sys.executable, "-m", "wrenchbed", verb]
        into = ["--out", "answer"] if verb == "diagnose" else []
        start = [*shlex.split(method), rest[0]] if into and method else [*ours, *rest]
        calls.append(start + into)
    calls[-1] += [] if method else ["--json"]
    for call in calls:
        try:
            done = subprocess.run(
                call, cwd=folder, capture_output=True, text=True, timeout=limit, check=False,
                stdin=subprocess.DEVNULL, env=os.environ | {"COLUMNS": "1000"},
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return {"exit": 1, "words": f"took longer than {limit:g} s", "answer": None}
        words, code = done.stderr.strip(), done.returncode
        if code and not done.stdout.startswith("{"):
            crashed = code < 0 or "Traceback" in words
            return {"exit": -1 if crashed else code, "words": words, "answer": None}
    path = folder / "answer" / "diagnosis.json"
    content = load(path, BenchmarkError) if method else json.loads(done.stdout)
    return {"exit": code, "words": words, "answer": content}


def judge(right: Mapping[str, Any], given: Mapping[str, Any]) -> Judged:
    """Compare ``given`` of `answer` with the true answer ``right``: ``causes`` (one must be
    claimed; if there are none, nothing may be), ``besides`` (may be claimed too), ``values``
    ({name: [value, tolerance]}, or ["<", bound]) or ``refusal`` (its expected words)."""
    said, content = str(given["words"]).removeprefix("wrenchbed: error: "), given["answer"]
    reason = right.get("refusal")
    if content is None:
        mark = "right" if reason and reason in said else "refused"
        return Judged("crashed" if given["exit"] < 0 else mark, said.rpartition("\n")[2])
    words = [content["verdict"]] if "verdict" in content else []
    causes, claims, named, fits = set(right.get("causes", ())), [], 0.0, True
    for entry in content.get("which", []):
        members, p = named_by(entry), entry["probability"]
        words.append(f"{' or '.join(members)} {p:.2f}")
        named = max(named, p if causes & set(members) else 0.0)
        if p > SURE:
            allowed = causes | set(right.get("besides", ()))
            claims.append((members[0], p, bool(allowed & set(members)) and reason is None))
    for name, (known, allowed) in right.get("values", {}).items():
        value = _value(content, name)
        words.append(f"{name} {value:.4g}")
        fits &= value < allowed if known == "<" else abs(value - known) <= allowed
    mark = "right" if fits and all(hit for *_, hit in claims) else "wrong"
    if mark == "right" and (reason or (causes and named <= SURE)):
        mark = "open"
    return Judged(mark, "; ".join(words), tuple(claims))


def _value(content: Mapping[str, Any], name: str) -> float:
    """Value, by name, of a parameter of a fit or claim, else of a field; else NaN."""
    for entry in (content, *content.get("which", [])):
        if name in entry.get("parameters", {}):
            return float(entry["parameters"][name]["value"])
    return float(content.get(name, float("nan")))


def run(
    sets: Iterable[ArenaSet], data: Path, out: Path, method: str = "", limit: float = 900.0
) -> dict[str, tuple[ArenaSet, Judged]]:
    """Judge the answer of each set, by its id, from files below ``data``; answers that the same
    program left in ``out`` are reused. ``method`` and ``limit`` are as in `answer`."""
    program, judged = version(), {}
    for one in sets:
        lacks = one.missing(data)
        if lacks:
            judged[one.id] = one, Judged("missing", lacks)
            continue
        asked = {k: v for k, v in asdict(one).items() if k not in ("right", "facts")}
        whole = json.dumps([program, method, asked], sort_keys=True)
        key, kept = hashlib.sha256(whole.encode()).hexdigest(), out / "answers" / f"{one.id}.json"
        given = load(kept, BenchmarkError) if kept.is_file() else {}
        if given.get("key") != key:
            given = answer(one, data, out / "runs" / one.id, method, limit) | {"key": key}
            write_json(kept, given)
        judged[one.id] = one, judge(one.right, given)
        sys.stderr.write(f"{one.id}: {judged[one.id][1].mark}\n")
    return judged


def page(judged: Mapping[str, tuple[ArenaSet, Judged]], command: str = "") -> Document:
    """Page that lists every judged answer, wrong ones first; ``command`` made them."""
    rows = sorted(judged.values(), key=lambda pair: MARKS.index(pair[1].mark))
    count = Counter(result.mark for _, result in rows)
    hits = [hit for _, result in rows for *_, hit in result.claims]
    told = [(s, j) for s, j in rows if j.mark != "missing"]
    still = [j.mark == "wrong" for s, j in told if s.right.get("causes") == []]
    robots, places = ({s.facts[k] for s, _ in told} for k in ("robot", "laboratory"))
    lead = f"{len(told)} sets of {len(robots)} robots and {len(places)} laboratories: "
    lead += ", ".join(f"{count[m]} {m}" for m in MARKS if count[m]) + "."
    keys = ("robot", "channels", "known")
    cells = [[s.id, *(s.facts[k] for k in keys), j.said, j.mark] for s, j in rows]
    table = Table.of("Answers", ["set", *keys, "answer", ""], cells)
    cards = (
        Card(f"Claims above {SURE}", f"{sum(hits)} of {len(hits)} right", "By what is known."),
        Card("No change", f"{sum(still)} of {len(still)} false", "Nothing is to be claimed."),
    )
    about, summary = Section("Every answer", "", (table,)), {s.id: j._asdict() for s, j in rows}
    return Document("Arena", lead, (about,), "", summary, provenance([], command), cards)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sets of a catalogue; return 0, or 1 where an answer is wrong, crashed or refused."""
    options = argparse.ArgumentParser(prog="wrenchbed.benchmark.arena", description=__doc__)
    options.add_argument("catalogue", type=Path, help="TOML file, or folder of them")
    options.add_argument("data", type=Path, help="folder of the repositories: DATA/OWNER/NAME")
    options.add_argument("out", type=Path, help="folder of answers and of the page")
    options.add_argument("--only", nargs="*", help="names of sets")
    options.add_argument("--method", default="", help="COMMAND RECORDING --out DIR, for diagnose")
    given = options.parse_args(arguments)
    try:
        sets = {s.id: s for s in read(given.catalogue)}
        if unknown := set(given.only or ()) - set(sets):
            raise BenchmarkError(
                f"--only {min(unknown)}: no such set{did_you_mean(min(unknown), sets)}"
            )
        chosen = [sets[n] for n in given.only or sets]
        chosen = [s for s in chosen if not given.method or s.run[-1].startswith("diagnose")]
        judged = run(chosen, given.data, given.out, given.method)
        written = page(judged, shlex.join(sys.argv))
        written.write(given.out / "page", "arena", written.summary)
    except (WrenchbedError, OSError) as error:
        sys.stderr.write(f"arena: error: {one_line(str(error))}\n")
        return 1
    sys.stdout.write(f"{written.lead} → {given.out / 'page' / 'arena.html'}\n")
    return int(any(j.mark in MARKS[:3] for _, j in judged.values()))


if __name__ == "__main__":
    sys.exit(main())
