"""One function a verb; its signature is the command's usage.

The verb that runs a paper again.

Verbs on a twin: replay a recording with it, and export it.
"""

import tempfile
from pathlib import Path
from typing import Annotated, Literal

import tyro

import wrenchbed as wb
from wrenchbed import studies
from wrenchbed.cli import console, tables
from wrenchbed.cli.console import Json
from wrenchbed.errors import ParameterError


def list_(
    kind: tyro.conf.Positional[
        Literal["robots", "sensors", "drivers", "transducers", "emulators", "twins", "effects"]
    ],
    /,
    as_json: Json = False,
) -> None:
    """List what exists, one line each.

    Args:
        kind: of plug-in.
        as_json: Print the result as JSON.
    """
    kind = "emulators" if kind == "twins" else kind
    rows = {name: tables.describe(wb.load(kind, name)) for name in wb.names(kind)}
    console.answer(rows, as_json, tables.plugins(kind, rows))


def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    /,
    map: Path,
    out: Path,
    as_json: Json = False,
) -> None:
    """Bring CSV files, rosbags and MCAP files in through a column map that states units.

    Args:
        files: CSV files, rosbags (1 or 2), MCAP files; several are merged on time.
        map: TOML or JSON column map (docs/how-to/import.md), or the name of a ready one: ros-ur5,
            ros-oriented, ur-rtde, ur-client.
        out: Recording to write.
        as_json: Print the result as JSON.
    """
    console.check_out(out, map, *files)
    imported = wb.import_files(files, wb.read_map(map))
    imported.recording.write(out)
    rows = len(imported.recording)
    result = {"recording": str(out), "rows": rows, "rows_left_out": imported.left_out}
    left = f", {imported.left_out} outside the other files' times left out" * (
        imported.left_out > 0
    )
    console.answer(result, as_json, f"imported {rows} rows{left} → {out}")


def calibrate(
    recording: tyro.conf.Positional[Path],
    /,
    out: Path | None = None,
    free: tuple[str, ...] = (),
    hold: tuple[str, ...] = (),
    prior: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    loss: Literal["linear", "huber", "student"] = "linear",
    touches: Path | None = None,
    touch_std: float | None = None,
    truth: Path | None = None,
    rrd: Path | None = None,
    as_json: Json = False,
) -> None:
    """Identify a robot's parameters: value ± standard uncertainty, and what the data cannot tell.

    Args:
        recording: Parquet file.
        out: Fit to write, JSON.
        free: Parameters, groups (tool.cog) or patterns (L1?) to identify; the robot's own if none.
        hold: Of these, to hold at their stated or nominal value.
        prior: Take each tolerance as a prior standard deviation.
        touches: Recording of touches (columns px py pz) of the same robot, fitted together.
        touch_std: With --touches: how far the tip sits from its point, per axis [m]; 5e-5.
        loss: Huber and Student's t resist outliers.
        truth: JSON {name: value} of a simulated robot, shown beside the estimates.
        rrd: Picture to write: the target workspace coloured by position error before and after
            where the robot has one and the fit bounds it, else the recording with the fit.
        as_json: Print the result as JSON.
    """
    options = wb.Options(free or None, hold, prior, loss)
    console.check_out(out, recording, touches, truth)
    console.check_out(rrd, recording, touches, truth, out)
    known = None if truth is None else console.parameters(truth)
    data = wb.Recording.read(recording)
    if touches is None and touch_std is not None:
        raise ParameterError("--touch-std goes with --touches")
    spread = {} if touch_std is None else {"std": touch_std}
    seats = None if touches is None else wb.Touches.of(wb.Recording.read(touches), **spread)
    fit = wb.calibrate(data, options, seats)
    for name, value in (known or {}).items():
        if name not in fit.theta or isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f"{truth}: {name!r} = {value!r} is no parameter with a number")
    if out is not None:
        fit.write(out)
    if rrd is not None:
        _picture(fit, data, rrd)
    console.answer(fit.to_json(), as_json, tables.fit(fit, known))
    if out is not None and not as_json:
        console.OUT.print(f"fit → {out}", soft_wrap=True, markup=False, highlight=False)


def _picture(fit: wb.Fit, data: wb.Recording, rrd: Path) -> None:
    from wrenchbed.viewer import calibration_view, recording_view

    if fit.target_rms is not None:
        calibration_view(fit, rrd)
        return
    with tempfile.TemporaryDirectory(prefix="wrenchbed-") as folder:
        fit.write(Path(folder) / "fit.json")
        recording_view(data, rrd, [Path(folder) / "fit.json"])


def study(
    paper: tyro.conf.Positional[Literal["medrue", "ur5"]],
    /,
    out: Path | None = None,
    quick: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    robots: int | None = None,
    seed: int = 0,
    as_json: Json = False,
) -> None:
    """A paper's tables and figures on MuJoCo data, beside what it prints and what physics allows.

    A stopped study goes on where it stopped.

    Args:
        paper: medrue (Sensors 2016, 16, 798) or ur5 (installation error of a force sensor).
        out: Folder for tables (Markdown, HTML), figures (SVG) and results (Parquet).
        quick: A small version, a minute or two.
        robots: Random MedRUE robots (200, quick 8), or repetitions on the UR5 (20, quick 3).
        seed: Of everything random.
        as_json: Print the key results as JSON.
    """
    console.check_seed(seed)
    folder = Path("out") / f"study-{paper}" if out is None else out
    with console.progress(f"study {paper}", studies.steps(paper, quick, robots)) as report:
        done = studies.run(paper, folder, quick=quick, robots=robots, seed=seed, report=report)
    console.answer(done.summary, as_json, "\n".join(done.lines))


def simulate(
    twin: tyro.conf.Positional[Path],
    /,
    like: Path,
    out: Path,
    noise: Literal["off", "white", "real"] = "off",
    seed: int = 0,
    rrd: Path | None = None,
    as_json: Json = False,
) -> None:
    """Run MuJoCo with a twin's effects on a recording's motion.

    Args:
        twin: JSON file, see `wrenchbed diagnose`.
        like: Recording whose times and joint values it follows.
        out: Recording to write.
        noise: Of the simulated sensor.
        seed: Of the noise and of what effects draw.
        rrd: Picture to write: the recording with the twin held against it.
        as_json: Print the result as JSON.
    """
    console.check_seed(seed)
    console.check_out(out, twin, like)
    console.check_out(rrd, twin, like, out)
    followed = wb.Recording.read(like)
    simulated = wb.simulate(wb.Twin.read(twin), followed, noise=noise, seed=seed)
    simulated.write(out)
    if rrd is not None:
        from wrenchbed.viewer import recording_view

        recording_view(followed, rrd, [twin])
    rows = len(simulated)
    result = {"recording": str(out), "like": str(like), "rows": rows}
    console.answer(result, as_json, f"simulated {rows} rows of {like} → {out}")


def export(
    file: tyro.conf.Positional[Path],
    /,
    mjcf: Path | None = None,
    mcap: Path | None = None,
    as_json: Json = False,
) -> None:
    """Write a twin as plain MJCF, what MuJoCo cannot carry as JSON beside it; a recording as MCAP.

    Args:
        file: A twin's JSON file, see `wrenchbed diagnose`; with --mcap a recording.
        mjcf: Folder to write to.
        mcap: File of ROS 2 messages to write: WrenchStamped, JointState, Temperature.
        as_json: Print the result as JSON.
    """
    if (mjcf is None) == (mcap is None):
        raise ParameterError("export needs --mjcf for a twin or --mcap for a recording")
    if mcap is not None:
        from wrenchbed.data.logs import write_mcap

        console.check_out(mcap, file)
        recording = wb.Recording.read(file)
        write_mcap(recording, mcap)
        text = f"exported {len(recording):,} rows → {mcap}"
        console.answer({"mcap": str(mcap), "rows": len(recording)}, as_json, text)
        return
    assert mjcf is not None
    if mjcf.exists() and not mjcf.is_dir():
        raise ParameterError(f"{mjcf}: is a file; give a folder")
    model, rest = wb.export(wb.Twin.read(file), mjcf)
    result = {"mjcf": str(model), "effects": str(rest)}
    console.answer(result, as_json, f"exported → {model}, {rest}")
