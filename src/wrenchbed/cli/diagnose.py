"""`wrenchbed diagnose`: where a gap lies, which effect causes it, how far it shrinks."""

import shlex
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

import wrenchbed as wb
from wrenchbed.cli import console, diagnosis_tables
from wrenchbed.errors import MissingExtraError, ParameterError, WrenchbedWarning

if TYPE_CHECKING:
    from wrenchbed.diagnosis.diagnose import Findings
    from wrenchbed.diagnosis.reliability import Reliability
    from wrenchbed.report.artist import Artist


def diagnose(
    recording: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    dry_run: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    samples: int = 60,
    rate: float = 100.0,
    look_alikes: int = 0,
    seed: int = 0,
    as_json: console.Json = False,
) -> None:
    """Say where the sim-to-real gap lies, which effect causes it and how far it shrinks.

    Args:
        recording: Parquet file; with --dry-run a plan that has not been recorded yet.
        out: Folder for diagnosis.json, twin.json, report.html, diagnosis.rrd and plans of what to
            do next.
        dry_run: Only say which effects such a recording could show, and which look the same.
        samples: With --dry-run: rows a pose.
        rate: With --dry-run: rows a second [Hz].
        look_alikes: Learn how often such claims are right from so many simulated robots that do
            what this one did (some 5 s each, kept for the next time); 0: use what is known.
        seed: Of the split into fitted and sealed blocks.
        as_json: Print the result as JSON.
    """
    console.check_seed(seed)
    if dry_run:
        _rehearsed(recording, samples, rate, as_json)
        return
    if out is None:
        raise ParameterError("diagnose needs --out, the folder for its files (or --dry-run)")
    if out.exists() and not out.is_dir():
        raise ParameterError(f"{out}: is a file; give a folder")
    from wrenchbed.diagnosis.diagnose import diagnose as run
    from wrenchbed.report.artist import Artist

    data = wb.Recording.read(recording)
    learnt = _learnt(data, look_alikes, seed) if look_alikes else None
    with Artist() as artist:
        with console.progress("diagnosing", 7) as tell:
            found = run(data, seed=seed, reliability=learnt, progress=lambda step: tell(1, step))
        found.diagnosis.write(out)
        for name, plan in found.plans.items():
            plan.write(out / name)
        written = ["diagnosis.json", "twin.json"]
        if _reported(found, recording, out, seed, artist):
            written.append("report.html")
        if _pictured(found, out):
            written.append("diagnosis.rrd")
    told = found.diagnosis.to_json()
    console.answer(told, as_json, diagnosis_tables.diagnosis(found.diagnosis))
    if not as_json:
        text = f"{', '.join(written)} → {out}"
        console.OUT.print(text, soft_wrap=True, markup=False, highlight=False)


def _learnt(data: wb.Recording, count: int, seed: int) -> "Reliability":
    from wrenchbed.diagnosis.own_design import at_design_of

    before = 0
    with console.progress("look-alikes", count) as tell:

        def told(done: int, total: int) -> None:
            nonlocal before
            tell(done - before, f"{done} of {total}")
            before = done

        return at_design_of(data, count, seed=seed, told=told)


def _reported(found: "Findings", recording: Path, out: Path, seed: int, artist: "Artist") -> bool:
    """Write report.html; without the libraries that draw it a warning names the extra."""
    from wrenchbed.report import diagnosis_page

    command = ["wrenchbed", "diagnose", str(recording), "--out", str(out)]
    if seed:
        command += ["--seed", str(seed)]
    try:
        diagnosis_page(found, shlex.join(command), artist).write(out / "report.html")
    except MissingExtraError as error:
        warnings.warn(f"no report.html: {error}", WrenchbedWarning, stacklevel=2)
        return False
    return True


def _pictured(found: "Findings", out: Path) -> bool:
    """Write diagnosis.rrd; without rerun a warning names the extra."""
    try:
        from wrenchbed.viewer import diagnosis_view

        diagnosis_view(found, out / "diagnosis.rrd")
    except MissingExtraError as error:
        warnings.warn(f"no diagnosis.rrd: {error}", WrenchbedWarning, stacklevel=2)
        return False
    return True


def _rehearsed(path: Path, samples: int, rate: float, as_json: bool) -> None:
    from wrenchbed.diagnosis.dryrun import dry_run as run

    found = run(wb.Plan.read(path), samples, rate)
    told = {
        "plan": str(path),
        "effects": [
            {
                "effect": s.effect,
                "variant": s.variant,
                "smallest": s.smallest,
                "size": {k: {"value": v, "unit": u} for k, (v, u) in s.size.items()},
                "detectable": s.detectable,
                "rivals": list(s.rivals),
            }
            for s in found.showings
        ],
        "cannot_tell": list(found.cannot_tell),
    }
    console.answer(told, as_json, diagnosis_tables.isolability(path.name, found))
