"""The verbs `robot`, `sensor` and `twin`: what a robot, a sensor and an emulator are made of."""

import math
import os
import sys
import threading
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from rich.table import Table

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json, Repeated
from wrenchbed.data.overwrite_rules import Kind
from wrenchbed.errors import DriverError, WrenchbedWarning
from wrenchbed.physics.wrench import CHANNELS

_PER_MINUTE = 60.0
_LOOK_S = 0.2
"""Interval of checks whether an emulator has broken down [s]."""


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
        file: MJCF, or URDF (expanded xacro); it is only read. Or the name of a robot of MuJoCo
            Menagerie, as universal_robots_ur5e (extra menagerie).
        frame: Site, body, link or fixed frame where the sensor sits.
        out: TOML file to write.
        sensor: Name, see `wrenchbed list sensors`, or a sensor's TOML file.
        tool_mass: In kg, instead of what the file hangs behind the frame.
        tool_cog: In m, sensor axes, instead of what the file hangs behind the frame.
        hold_others: Keep another arm of the file where it stands.
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
    heads = ("column", "joint", "moves", "limits", ">top speed")
    table = console.table(*heads, title=f"{arm.title} → {out}")
    for joint, link in zip(arm.joints, driven, strict=True):
        limits = f"{joint.lower:.3f} … {joint.upper:.3f} {joint.unit}"
        table.add_row(
            joint.name, link.joint, link.body, limits, f"{joint.speed:.3g} {joint.unit}/s"
        )
    lines = []
    if model.closures:
        loops = ", ".join(c.name for c in model.closures)
        lines.append(f"Solved from the closed loops {loops}: {', '.join(passive)}")
    cog = ", ".join(f"{1e3 * x:.1f}" for x in load.cog)
    bodies = ", ".join(made.loading)
    lines.append(f"The sensor carries {load.mass:.4g} kg at ({cog}) mm: {bodies}")
    console.answer(result, as_json, table, *lines)


def sensor(
    rest: tyro.conf.Positional[Path], /, out: Path, like: str | None = None, as_json: Json = False
) -> None:
    """Learn a sensor's noise from a minute at rest; OUT then stands wherever a sensor's name does.

    White and 1/f part, correlation, mains line, drift and step of each channel, and what the
    recording cannot tell. OUT is a small TOML; it may be edited.

    Args:
        rest: Recording of one pose, a minute or more, nothing touches the tool.
        out: TOML file to write.
        like: Sensor (name or TOML file) that gives range, resolution and mass; default is what
            the recording states, else generic.
    """
    given = Path(like) if like is not None and like.lower().endswith(".toml") else None
    console.check_out(out, Kind.SENSOR, rest, given)
    learned = wb.learn_sensor(wb.Recording.read(rest), name=out.stem, like=like)
    learned.write(out)
    unknown = ["It cannot tell:", *(f"  {sentence}" for sentence in learned.cannot_tell)]
    console.answer(_result(learned, out), as_json, _table(learned, out), *unknown)


def _result(learned: "wb.LearnedSensor", out: Path) -> dict[str, object]:
    noise, rest = learned.sensor.noise, learned.rest
    return {
        "sensor": str(out), "like": learned.like, "rows": rest.rows, "rate_hz": rest.rate,
        "channels": {
            channel: {
                "white": float(noise.white[k]), "white_std": s.white_std,
                "flicker": s.flicker, "flicker_std": s.flicker_std if s.flicker else None,
                "flicker_most": s.flicker_most, "mains": float(noise.mains_amplitude[k]),
                "drift_per_s": float(rest.drift[k]),
                "drift_per_s_std": float(rest.drift_std[k]), "step": float(noise.resolution[k]),
            }
            for k, (channel, s) in enumerate(zip(CHANNELS, rest.spectra, strict=True))
        },
        "mains_hz": noise.mains_frequency if noise.mains_amplitude.any() else None,
        "correlation": noise.correlation.tolist(), "correlation_std": rest.correlation_std,
        "lines_hz": list(rest.lines), "cannot_tell": list(learned.cannot_tell),
    }  # fmt: skip


def _table(learned: "wb.LearnedSensor", out: Path) -> Table:
    noise, rest = learned.sensor.noise, learned.rest
    title = f"{rest.rows / rest.rate:.3g} s at {rest.rate:.4g} Hz → {out}  [mN, mN·m]"
    heads = ("white", "1/f at 1 Hz", f"{noise.mains_frequency:.4g} Hz", "drift a minute", "step")
    table = console.table("", *(f">{head}" for head in heads), title=title)
    for k, (channel, s) in enumerate(zip(CHANNELS, rest.spectra, strict=True)):
        line, step = noise.mains_amplitude[k], noise.resolution[k]
        drift = _PER_MINUTE * rest.drift[k], _PER_MINUTE * rest.drift_std[k]
        table.add_row(
            channel, _sure(noise.white[k], s.white_std),
            _sure(s.flicker, s.flicker_std) if s.flicker else f"< {_milli(s.flicker_most)}",
            _sure(line, rest.mains_std[k]) if line else "none",
            _sure(*drift), _milli(step) if step else "none",
        )  # fmt: skip
    return table


def _milli(value: float) -> str:
    return f"{1e3 * value:.3g}"


def _sure(value: float, std: float) -> str:
    """Text of value ± standard uncertainty, in thousandths, with two digits of uncertainty."""
    places = max(0, 1 - math.floor(math.log10(1e3 * std))) if std > 0.0 else 3
    return f"{1e3 * value:.{places}f} ± {1e3 * std:.{places}f}"


@dataclass(frozen=True)
class EmulatorArguments:
    """Options of `twin`: address, plant, noise, effects and settings of the emulated device."""

    # Address of this machine, 127.0.0.1 … 127.255.255.254; several twins need several.
    host: str = "127.0.0.1"
    parameters: Path | None = None  # JSON {name: value} in SI: what the robot truly is.
    noise: Literal["real", "white", "off"] = "real"  # Noise of the sensor.
    # ID[:name=value,…] of an effect on the robot, see `wrenchbed list effects`. May be repeated.
    effect: Repeated = ()
    table: float | None = None  # Height of a plate that the tool may press on [m].
    set: Repeated = ()  # NAME=VALUE of a setting that this twin alone has; a wrong NAME lists them.
    seed: int = 0  # Seed of the noise.

    def options(self) -> "wb.EmulatorOptions":
        """Make the emulator's options from these arguments."""
        console.check_seed(self.seed)
        parameters, words = console.parameters(self.parameters), console.pairs(self.set)
        return wb.EmulatorOptions(
            self.host, self.seed, words, parameters, self.noise, self.effect, self.table
        )


def twin(
    name: tyro.conf.Positional[str], /, device: EmulatorArguments, faults: str | None = None
) -> None:
    """Serve a robot's or sensor's protocols on this machine, backed by MuJoCo.

    Prints one line `ready …` with its addresses when clients may connect; Ctrl-C ends it.

    Args:
        name: Name of the device, see `wrenchbed list twins`.
        faults: TOML script of timed faults (docs/how-to/hardware.md); `-` takes them as JSON lines
            on standard input.
    """
    script, parent = None if faults in (None, "-") else faults, os.getppid()
    with console.until_signal() as stopped, wb.serve(name, device.options(), script) as server:
        print("ready " + " ".join(f"{k}={v}" for k, v in server.addresses.items()), flush=True)
        if faults == "-":
            lock = threading.Lock()

            def answer(text: str) -> None:
                with lock:
                    print(text, flush=True)

            server.faults.listen(sys.stdin, answer)
        while not stopped.wait(_LOOK_S) and not server.failed.is_set():
            if faults == "-" and os.getppid() != parent:  # whoever gives it faults was killed
                break
        if server.failure is not None:
            raise DriverError(f"this twin has broken down: {server.failure!r}")
