"""Verbs on a twin: replay a recording with it, and export it."""

from pathlib import Path
from typing import Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.errors import ParameterError


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
        from wrenchbed.logs.writing import write_mcap

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
