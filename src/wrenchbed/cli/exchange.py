"""`wrenchbed import` and `wrenchbed export`: files of other programs in, numbers for them out."""

import warnings
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.column_map import ColumnMap
from wrenchbed.data.lerobot import MAP
from wrenchbed.data.overwrite_rules import Kind, keeping
from wrenchbed.data.recording import Recording
from wrenchbed.errors import ParameterError, WrenchbedError, WrenchbedWarning
from wrenchbed.exports.base import output_files
from wrenchbed.exports.load_numbers import calibrated_twin
from wrenchbed.exports.urdf import read_urdf
from wrenchbed.files import write_text


@dataclass(frozen=True)
class RowOptions:
    """Options of `import`: static or dynamic rows, and what to do with incomplete ones."""

    # static, dynamic, or auto: a log of holds and moves is split into poses by itself. As the map
    # says if none.
    mode: Literal["static", "dynamic", "auto"] | None = None
    # Leave out rows that lack a value in a column that is used.
    skip_incomplete: bool = False


def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    /,
    out: Path,
    stated: wb.Stated,
    guess: bool = False,
    map: Path | None = None,
    rows_read: RowOptions = RowOptions(),
    force: bool = False,
    as_json: Json = False,
) -> None:
    """Bring text files (CSV, …), rosbags, MCAP files and LeRobot data sets in, by a map of columns
    or by a guess.

    Args:
        files: CSV files, rosbags (1 or 2), MCAP files; several are merged on time. Or the folder of
            a LeRobot data set, whose map says in [lerobot] what its values are (`export` writes it
            into the folder).
        out: Recording to write; of a log of holds and moves, OUT.motion.parquet gets all of it.
        guess: Find the map: each convention is tried on one rigid load. Writes OUT.map.toml.
        map: TOML or JSON column map (docs/how-to/import.md), or the name of a ready one.
        force: Replace recordings at OUT; they are kept as OUT~, or OUT~2 and so on.
    """
    if any(wb.is_lerobot(file) for file in files):
        map = _map_of_lerobot(files, map, rows_read)
    if guess == (map is not None) or not files:
        raise ParameterError("give files, and either --map MAP or --guess")
    guessed: dict[str, list[str]] = {}
    inputs = (*files, map, stated.fit, stated.rest)
    console.check_out(out, Kind.RECORDING, *inputs, force=force)
    whole, map_file = out.with_suffix(".motion.parquet"), out.with_suffix(".map.toml")
    if map is None:
        console.check_out(map_file, Kind.MAP, *files)
        guesses = wb.guess_map(files, stated, rows_read.mode, rows_read.skip_incomplete)
        write_text(map_file, guesses.text(map_file.parent))
        guessed = {"guess": [*guesses.lines, f"map → {map_file}"]}
        some = [file for file in files if file not in guesses.unused]
        imported = wb.import_files(some, _changed(guesses.column_map(0, str(map_file)), rows_read))
    elif flags := [n.replace("_", "-") for n, value in vars(stated).items() if value is not None]:
        raise ParameterError(f"--{flags[0]} belongs to --guess; a map states it itself")
    elif wb.is_lerobot(files[0]):
        imported = wb.import_lerobot(files[0], map)
    else:
        imported = wb.import_files(files, _changed(wb.read_map(map), rows_read))
    if imported.motion is not None:
        console.check_out(whole, Kind.RECORDING, *inputs, out, force=force)
    keeping(out, imported.recording.write)
    rows, excluded = len(imported.recording), imported.left_out
    result = {"recording": str(out), "rows": rows, "rows_left_out": excluded} | guessed
    lines = [*guessed.get("guess", []), *imported.notes]
    if imported.motion is not None and imported.split is not None:
        keeping(whole, imported.motion.write)
        holds, moves = len(imported.split.seconds), imported.split.moves
        result |= {"motion": str(whole), "holds": holds, "moves": moves}
        lines.append(f"all {len(imported.motion)} rows, moves too → {whole}")
    result["notes"] = list(imported.notes)
    if (doubt := _doubt(imported.recording)) is not None:
        result["doubt"] = doubt
        warnings.warn(f"{doubt}: calibrate will refuse {out}", WrenchbedWarning, stacklevel=1)
    rest = f", {excluded} outside the other files' times left out" if excluded else ""
    lines.append(f"imported {rows} rows{rest} → {out}")
    console.answer(result, as_json, "\n".join(lines))


def _map_of_lerobot(files: tuple[Path, ...], map: Path | None, options: RowOptions) -> Path:
    """Map by which to read the one LeRobot data set in ``files``: ``map``, else its own."""
    if map is None and (files[0] / MAP).is_file():
        map = files[0] / MAP
    if len(files) > 1 or map is None or options != RowOptions():
        raise ParameterError(
            "import of a LeRobot data set takes one folder, with --map MAP and no --guess, --mode "
            "or --skip-incomplete: [lerobot] unit of the map says what its values are"
        )
    return map


def _doubt(recording: Recording) -> str | None:
    """Reason why `calibrate` would refuse a recording; None if no reason is known."""
    from wrenchbed.calibration.checks_before_fit import check

    try:
        finding = check(recording)
    except WrenchbedError:
        return None
    return None if finding is None else finding.sentence


def _changed(column_map: ColumnMap, options: RowOptions) -> ColumnMap:
    """Return the column map with mode and handling of incomplete rows taken from the options."""
    mode = options.mode
    if options.skip_incomplete:
        files = tuple(replace(f, skip_incomplete=True) for f in column_map.files)
        column_map = replace(column_map, files=files)
    if mode is None:
        return column_map
    metadata = replace(column_map.metadata, mode="dynamic" if mode == "auto" else mode)
    return replace(column_map, mode=mode, metadata=metadata)


@dataclass(frozen=True)
class Numbers:
    """Options of `export --to`: inputs that some formats need besides FILE."""

    # Your own URDF, for --to urdf. It is read; OUT is a copy with the numbers.
    urdf: Path | None = None
    frame: str | None = None  # Link or frame of the sensor in your system (ft_frame).
    # Place of the sensor in the flange, x y z [m] qw qx qy qz, where the robot's model knows no
    # flange.
    mount: tuple[float, float, float, float, float, float, float] | None = None
    fps: int | None = None  # For --to lerobot: frames a second, where the clock is not even.
    task: str = "move"  # For --to lerobot: what the robot does, in words.


def export(
    file: tyro.conf.Positional[Path],
    /,
    to: str | None = None,
    out: Path | None = None,
    numbers: Numbers = Numbers(),
    mjcf: Path | None = None,
    mcap: Path | None = None,
    force: bool = False,
    as_json: Json = False,
) -> None:
    """Write a calibration for controllers, ROS 2 or URDF; a twin as MJCF; a recording as MCAP or as
    a LeRobot data set.

    Args:
        file: fit.json or twin.json; with --mcap and --to lerobot a recording. Of a fit of commands
            --to mjcf writes the robot with the fitted position servos.
        to: Format: ur, ros2, urdf, franka, kuka, xarm (see `wrenchbed list exports`), mjcf or
            lerobot.
        out: File to write; with --to mjcf and --to lerobot a folder.
        mjcf: The same as --to mjcf --out MJCF.
        mcap: File of ROS 2 messages to write: WrenchStamped, JointState, Temperature.
        force: With --mcap: replace a log; it is kept as MCAP~, or MCAP~2 and so on.
    """
    if to == "mjcf":
        to, mjcf = None, out or mjcf
        if mjcf is None:
            raise ParameterError("export --to mjcf needs --out, a folder")
    if [to, mjcf, mcap].count(None) != 2:
        raise ParameterError("give --to FORMAT, --mjcf for a twin or --mcap for a recording")
    if mcap is not None:
        from wrenchbed.data.rosbag_and_mcap import write_mcap

        console.check_out(mcap, Kind.LOG, file, force=force)
        recording = wb.Recording.read(file)
        keeping(mcap, partial(write_mcap, recording))
        text = f"exported {len(recording):,} rows → {mcap}"
        console.answer({"mcap": str(mcap), "rows": len(recording)}, as_json, text)
    elif mjcf is not None:
        _export_model(file, mjcf, as_json)
    elif to == "lerobot" and out is not None:
        fps = None if numbers.fps is None else console.check_positive("--fps", numbers.fps)
        console.check_folder(out)
        notes = wb.write_lerobot(wb.Recording.read(file), out, fps, numbers.task)
        text = "\n".join([*notes, f"exported → {out}"])
        console.answer({"lerobot": str(out), "notes": list(notes)}, as_json, text)
    else:
        if out is None:
            raise ParameterError(f"export --to {to} needs --out, a file")
        _export_numbers(str(to), file, out, numbers, as_json)


def _export_model(file: Path, mjcf: Path, as_json: bool) -> None:
    if wb.is_of_servos(file):
        console.check_folder(mjcf, {"README.md": Kind.NOTES})
        servos, notes = wb.export_servos(file, mjcf)
        result = {"mjcf": str(servos), "notes": str(notes)}
        console.answer(result, as_json, f"exported → {servos}, {notes}")
        return
    twin = calibrated_twin(file)
    model = {f"{twin.model.robot.name}.xml": Kind.MODEL, "effects.json": Kind.OUTSIDE}
    console.check_folder(mjcf, model | {"README.md": Kind.NOTES})
    path, effects = wb.export(twin, mjcf)
    result = {"mjcf": str(path), "effects": str(effects)}
    console.answer(result, as_json, f"exported → {path}, {effects}")


def _export_numbers(to: str, file: Path, out: Path, stated: Numbers, as_json: bool) -> None:
    for name in output_files(to, out):
        console.check_out(name, Kind.EXPORT, file, stated.urdf)
    text = None if stated.urdf is None else read_urdf(stated.urdf)
    numbers = wb.load_numbers(file, stated.mount)
    written, notes = wb.export_to(to, numbers, out, wb.ExportOptions(text, stated.frame))
    result = {"format": to, "files": [str(f) for f in written], "notes": notes}
    files = ", ".join(map(str, written))
    console.answer(result, as_json, "\n".join([f"exported → {files}", *notes[1:]]))
