"""``wrenchbed robot``: a robot from MJCF or URDF."""

import warnings
from pathlib import Path

import tyro
from rich.table import Table

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import WrenchbedWarning


def robot(
    file: tyro.conf.Positional[Path],
    /,
    frame: str,
    out: Path,
    sensor: str = "ati-gamma",
    tool_mass: float | None = None,
    tool_cog: tuple[float, float, float] | None = None,
    hold_others: bool = False,
    as_json: Json = False,
) -> None:
    """Make a robot of an MJCF or URDF file; OUT then stands wherever a robot's name does.

    Joints q1 … are those from the base to the frame. The sensor has the frame's axes and origin,
    and what the file hangs behind the frame is the tool. OUT is a small TOML with all that was read
    from the file; it may be edited.

    Args:
        file: MJCF, or URDF (expanded xacro). It is only read.
        frame: Site, body, link or fixed frame where the sensor sits.
        out: TOML file to write.
        sensor: Name, see `wrenchbed list sensors`, or a sensor's TOML file.
        tool_mass: In kg, instead of what the file hangs behind the frame.
        tool_cog: In m, sensor axes, instead of what the file hangs behind the frame.
        hold_others: Keep another arm of the file where it stands.
        as_json: Print the result as JSON.
    """
    console.check_out(out, Kind.ROBOT, file)
    wb.load("sensors", sensor)
    made = wb.describe_robot(
        file, frame, out, sensor=sensor, tool_mass=tool_mass, tool_cog=tool_cog,
        hold_others=hold_others,
    )  # fmt: skip
    for note in made.notes:
        warnings.warn(f"{file}: {note}", WrenchbedWarning, stacklevel=2)
    arm = made.robot
    load = arm.description.load
    model = arm.arm_model
    driven = [model.links[k] for k in model.driven]
    passive = [link.joint for k, link in enumerate(model.links) if k not in model.driven]
    result = {
        "robot": str(out), "name": arm.name, "sensor": arm.sensor, "frame": frame,
        "joints": [
            {"column": j.name, "name": link.joint, "kind": link.kind, "unit": j.unit,
             "lower": j.lower, "upper": j.upper, "speed": j.speed, "moves": link.body}
            for j, link in zip(arm.joints, driven, strict=True)
        ],
        "tool": {"mass": load.mass, "cog": list(load.cog), "bodies": list(made.loading)},
        "passive": passive, "notes": list(made.notes),
    }  # fmt: skip
    table = Table(box=None, padding=(0, 2, 0, 0), title_justify="left",
                  title=f"{arm.title} → {out}")  # fmt: skip
    for column in ("column", "joint", "moves", "limits", "top speed"):
        table.add_column(column, justify="right" if column == "top speed" else "left")
    for joint, link in zip(arm.joints, driven, strict=True):
        limits = f"{joint.lower:.3f} … {joint.upper:.3f} {joint.unit}"
        table.add_row(
            joint.name, link.joint, link.body, limits, f"{joint.speed:.3g} {joint.unit}/s"
        )
    console.answer(result, as_json, table)
    if not as_json:
        if model.loops is not None:
            loops = ", ".join(c.name for c in model.loops.closures)
            console.say(f"Solved from the closed loops {loops}: {', '.join(passive)}")
        cog = ", ".join(f"{1e3 * x:.1f}" for x in load.cog)
        console.say(
            f"The sensor carries {load.mass:.4g} kg at ({cog}) mm: {', '.join(made.loading)}"
        )
