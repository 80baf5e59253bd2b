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


def export(twin: tyro.conf.Positional[Path], /, mjcf: Path, as_json: Json = False) -> None:
    """Write a twin as plain MJCF, and what MuJoCo cannot carry as JSON beside it.

    Args:
        twin: JSON file, see `wrenchbed diagnose`.
        mjcf: Folder to write to.
        as_json: Print the result as JSON.
    """
    if mjcf.exists() and not mjcf.is_dir():
        raise ParameterError(f"{mjcf}: is a file; give a folder")
    model, rest = wb.export(wb.Twin.read(twin), mjcf)
    result = {"mjcf": str(model), "effects": str(rest)}
    console.answer(result, as_json, f"exported → {model}, {rest}")
