"""`wrenchbed export`: the numbers of a calibration, a twin or a recording for other programs."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Flag, Json
from wrenchbed.data.outputs import Kind, keeping
from wrenchbed.errors import ParameterError
from wrenchbed.exports.base import output_files
from wrenchbed.exports.load_numbers import calibrated_twin
from wrenchbed.exports.urdf import read_urdf


@dataclass(frozen=True)
class Numbers:
    """With --to: what the format asks for.

    Args:
        urdf: Your own URDF, for --to urdf. It is read; OUT is a copy with the numbers.
        frame: Link or frame of the sensor in your system (ft_frame).
        mount: Place of the sensor in the flange, x y z [m] qw qx qy qz, where the robot's model
            knows no flange.
    """

    urdf: Path | None = None
    frame: str | None = None
    mount: tuple[float, float, float, float, float, float, float] | None = None


def export(
    file: tyro.conf.Positional[Path],
    /,
    to: str | None = None,
    out: Path | None = None,
    numbers: Numbers = Numbers(),
    mjcf: Path | None = None,
    mcap: Path | None = None,
    force: Flag = False,
    as_json: Json = False,
) -> None:
    """Write a calibration for controllers, ROS 2 or URDF; a twin as MJCF; a recording as MCAP.

    Args:
        file: fit.json or twin.json; with --mcap a recording.
        to: Format: ur, ros2, urdf, franka, kuka, xarm, json-schema or mjcf, see `wrenchbed list
            exports`.
        out: File to write; with --to mjcf a folder.
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
        _export_log(file, mcap, force, as_json)
    elif mjcf is not None:
        _export_model(file, mjcf, as_json)
    else:
        if out is None:
            raise ParameterError(f"export --to {to} needs --out, a file")
        _export_numbers(str(to), file, out, numbers, as_json)


def _export_log(file: Path, mcap: Path, force: bool, as_json: bool) -> None:
    from wrenchbed.data.logs import write_mcap

    console.check_out(mcap, Kind.LOG, file, force=force)
    recording = wb.Recording.read(file)
    keeping(mcap, partial(write_mcap, recording))
    text = f"exported {len(recording):,} rows → {mcap}"
    console.answer({"mcap": str(mcap), "rows": len(recording)}, as_json, text)


def _export_model(file: Path, mjcf: Path, as_json: bool) -> None:
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
