"""Times of the package's main jobs over that of a fixed reference in one run, and their history.

`scripts/bench --record` appends the ratios to `HISTORY` and writes `PAGE`; `scripts/bench --check`
compares with what was recorded on the same kind of processor. Times are processor time, the least
of interleaved repeats: other processes slow them little.
"""

import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import wrenchbed as wb
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.files import write_json, write_text
from wrenchbed.physics.noise import NoiseStream, noise_model
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.planning.criteria import INDICES
from wrenchbed.planning.exchange import Pool, exchange

ROOT = Path(__file__).parents[1]
HISTORY = ROOT / "docs" / "reference" / "bench_history.json"
PAGE = ROOT / "docs" / "explanation" / "bench-history.md"
WORSE = 4.0 / 3.0
"""A ratio that has grown by more than a third fails."""
LAST = 3
"""Recorded runs whose median is compared with."""
ROUNDS = 3
"""Interleaved repeats; as many again of what seems worse."""
SHOWN = 8
"""Runs in the table of the page."""
SHORT, SHORT_S = 3, 0.05
"""Times that a job below so long [s] is repeated in each round."""
Job = Callable[[], object]
Entry = dict[str, Any]


def reference() -> float:
    """Fixed work of the kinds that the jobs are made of: vectors, small matrices, Python."""
    rows, matrix = np.linspace(0.1, 3.0, 20_000).reshape(20, 1000), np.eye(60) + 0.01
    total = 0.0
    for row in rows:
        for _ in range(10):
            row = np.sin(row) + 0.5 * row * row - 0.1 * row
        total += float(row.sum()) + float(np.linalg.svd(matrix[:40, :20])[1].sum())
        total += float((matrix @ matrix).sum())
        total += sum({k: 0.5 * k for k in range(2000)}.values())
    return total


def clock() -> float:
    """Processor time [s] of this process and of those that it waited for."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def times(count: int, work: Job) -> Job:
    """Many in a row, where one is too short for the clock."""

    def several() -> None:
        for _ in range(count):
            work()

    return several


def jobs(folder: Path) -> dict[str, Job]:
    """What is measured, some 5 to 300 ms each; inputs are made here, files in a folder."""
    result: dict[str, Job] = {}
    rng = np.random.default_rng(0)
    for name, title in (("ur5", "UR5"), ("medrue", "MedRUE")):
        robot = wb.load("robots", name)
        model = wb.Model.of(robot)
        theta, q = model.parameters.nominal, robot.sample(2000, rng)
        free = list(model.parameters.select(robot.free))
        few, slopes = q[:1].copy(), partial(model.jacobian, q[:500].copy(), theta, free)
        result |= {
            f"{title}: static wrench, 2,000 poses": times(
                200, partial(model.true_wrench, q, theta)
            ),
            f"{title}: static wrench, one pose": times(
                2000, partial(model.true_wrench, few, theta)
            ),
            f"{title}: Jacobian at rest, 500 poses": times(4, slopes),
        }
        with wb.SimDriver(wb.SimOptions(name, seed=1)) as driver:
            wb.record(driver, wb.poses(robot, 25, seed=1), folder / f"{name}.parquet", samples=20)
        recording = wb.Recording.read(folder / f"{name}.parquet")
        result[f"{title}: calibrated from 25 poses"] = lambda r=recording: wb.calibrate(r)
        if name == "ur5":
            result["UR5: diagnosed at rest, 25 poses"] = lambda r=recording: diagnose(r)
            waves = [rng.standard_normal((2000, 6)) for _ in range(2)]
            moving = partial(model.true_wrench, Jet(q, *waves), theta)
            result["UR5: wrench in motion, 2,000 rows"] = times(5, moving)
    result["a recording read"] = times(5, lambda: wb.Recording.read(folder / "ur5.parquet"))
    blocks = rng.standard_normal((2000, 6, 12))
    start = np.arange(30)
    result["30 of 2,000 poses chosen"] = lambda: exchange(
        Pool(blocks), INDICES["O1"], 30, start=start
    )
    sensor = wb.load("sensors", wb.load("robots", "ur5").sensor)
    stamps = np.arange(20_000) / 100.0
    result["noise of 20,000 rows"] = lambda: NoiseStream(
        noise_model("real", sensor.noise), 1
    ).corrupt(stamps, np.zeros((len(stamps), 6)))
    help_ = [sys.executable, "-m", "wrenchbed", "--help"]
    result["wrenchbed --help"] = lambda: subprocess.run(help_, check=True, capture_output=True)
    return result


def ratios(measured: Mapping[str, Job], rounds: int = ROUNDS) -> dict[str, float]:
    """Least time of each job over the least of the reference, all interleaved."""
    best, unit = {name: _time(job) for name, job in measured.items()}, _time(reference)
    for _ in range(rounds):
        for name, job in measured.items():
            unit = min(unit, _time(reference))
            again = SHORT if best[name] < SHORT_S else 1
            best[name] = min(best[name], *(_time(job) for _ in range(again)))
    return {name: seconds / unit for name, seconds in best.items()}


def _time(job: Job) -> float:
    begun = clock()
    job()
    return clock() - begun


def machine() -> dict[str, Any]:
    """Model of the processor and its number of cores."""
    processor = Path("/proc/cpuinfo")
    lines = processor.read_text().splitlines() if processor.is_file() else []
    facts = dict(reversed([[part.strip() for part in x.split(":", 1)] for x in lines if ":" in x]))
    family = " ".join(facts[k] for k in ("cpu family", "model") if k in facts)
    name = f"{facts.get('model name', platform.machine())} {family}".strip()
    return {"cpu": name, "cores": os.cpu_count()}


def history() -> list[Entry]:
    """Recorded runs, the oldest first."""
    return json.loads(HISTORY.read_text(encoding="utf-8")) if HISTORY.is_file() else []


def recorded(entries: Sequence[Entry], cpu: str) -> dict[str, float]:
    """Median of each ratio in its last recorded runs on such a processor.

    Only those within a third of the very last count: what came before a gain is no measure.
    """
    found: dict[str, list[float]] = {}
    for entry in entries:
        if entry["machine"]["cpu"] == cpu:
            for name, ratio in entry["ratios"].items():
                found.setdefault(name, []).append(ratio)
    last = {name: ratios[-LAST:] for name, ratios in found.items()}
    return {
        name: median(r for r in ratios if ratios[-1] / WORSE < r < ratios[-1] * WORSE)
        for name, ratios in last.items()
    }


def worsened(measured: Mapping[str, Job], before: Mapping[str, float]) -> dict[str, float]:
    """By what factor jobs are slower than before, of those slower by a third, measured twice."""
    known = {name: job for name, job in measured.items() if name in before}
    slower: dict[str, float] = {}
    for _ in range(2):
        found = ratios(known)
        slower = {n: min(found[n] / before[n], slower.get(n, np.inf)) for n in found}
        slower = {n: factor for n, factor in slower.items() if factor > WORSE}
        known = {n: known[n] for n in slower}
        if not known:
            break
    return slower


def record() -> None:
    """Measure, append to the history and write the page."""
    with tempfile.TemporaryDirectory() as folder:
        found = ratios(jobs(Path(folder)), 3 * ROUNDS)
    source = Path(wb.__file__).parent
    git = ("git", "-C", str(source), "log", "-1", "--format=%h %s")
    commit, _, subject = subprocess.run(
        git, check=True, capture_output=True, text=True
    ).stdout.strip().partition(" ")  # fmt: skip
    entry = {
        "commit": commit,
        "subject": subject,
        "date": datetime.now(UTC).date().isoformat(),
        "machine": machine(),
        "ratios": {name: float(f"{ratio:.4g}") for name, ratio in found.items()},
    }
    entries = [*history(), entry]
    write_json(HISTORY, entries)
    write_text(PAGE, page(entries))


HEAD = """# Speed from commit to commit

`scripts/bench --record` writes this page. Each figure is a ratio: processor time of a job over that
of a fixed reference (numpy on vectors, small matrices, Python's loops) in the same run, the least
of interleaved repeats, in one thread. So a slower machine or a busy one changes it little.
`scripts/bench --check` fails where a ratio is worse by more than a third than the median of the
last three recorded on such a processor (of those within a third of the very last). It asks twice.
Of 30 checks beside eight to twelve other busy processes on two cores none failed, and none had to
ask twice: the worst ratio was 1.19 times the recorded one. Lower is faster.
"""


def page(entries: Sequence[Entry]) -> str:
    """Markdown: who measured where, and all ratios, the newest run first."""
    newest = list(reversed(entries))[:SHOWN]
    rows = ["| commit | date | processor | cores | what it did |", "|---|---|---|---|---|"]
    rows += [
        f"| {e['commit']} | {e['date']} | {e['machine']['cpu']} | {e['machine']['cores']} "
        f"| {e['subject']} |"
        for e in newest
    ]
    heads = " | ".join(e["commit"] for e in newest)
    rows += ["", f"| job | {heads} |", "|---" * (len(newest) + 1) + "|"]
    for name in newest[0]["ratios"]:
        cells = (f"{e['ratios'][name]:.3g}" if name in e["ratios"] else "–" for e in newest)
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join([HEAD, *rows, ""])


def check() -> int:
    """Print what is slower by more than a third than recorded; 1 if anything is."""
    before = recorded(history(), machine()["cpu"])
    if not before:
        print(f"nothing is recorded on {machine()['cpu']}: scripts/bench --record")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        slower = worsened(jobs(Path(folder)), before)
    for name, factor in slower.items():
        print(f"{name}: {factor:.2f} times the recorded ratio")
    return 1 if slower else 0
