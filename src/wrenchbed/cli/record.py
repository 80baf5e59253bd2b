"""`wrenchbed record`: run a plan on a simulated or real robot, with pictures live or afterwards."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

import wrenchbed as wb
from wrenchbed.campaigns.moves import LiveLimits, itinerary, live_limits
from wrenchbed.campaigns.run import RunProgress
from wrenchbed.cli import console
from wrenchbed.cli.console import Json, Repeated
from wrenchbed.data.overwrite_rules import Kind
from wrenchbed.errors import DriverError, ParameterError, PlanError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.hardware.drivers.live_base import LIVE, LiveDriver
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.checked_moves import Limits

CHANNELS_OF = {
    "wrench": CHANNELS, "effort": (), "pose": (), "command": ("q_target",), "imu": (),
}  # fmt: skip
"""Channel → columns (or starts of their names) in a recording unless ``--channels`` omits it."""
_OPTION_OF = {"effort": "effort", "pose": "tracker", "imu": "imu"}
_USUAL: dict[str, str | float] = {"effort": "torque", "pose": 5e-5, "imu": 0.02}
"""Channel → value of its option of the simulated driver if none is stated: a laser tracker's noise
[m], a MEMS accelerometer's in 50 Hz [m/s²]."""
_MOST_LEGS = 12
"""Most rows of a dry run's table."""


@dataclass(frozen=True)
class DeviceArguments:
    """Options of the driver and its sensor, simulated or real."""

    driver: str = "sim"  # Name, see `wrenchbed list drivers`.
    # Address of the robot's controller (rtde), or of the machine that shares its CAN bus.
    host: str | None = None
    channel: str | None = None  # CAN channel, for instance can0.
    # With rtde: netft://HOST for an ATI Net F/T at another address than the robot's, or rtde for
    # the robot's own wrench.
    sensor: str | None = None
    parameters: Path | None = None  # JSON {name: value} in SI: what the simulated robot truly is.
    noise: Literal["real", "white", "off"] | None = None  # Simulated sensor's noise; real.
    # ID[:name=value,…] of an effect on the simulated robot, see `wrenchbed list effects`; without
    # values of typical size. May be repeated.
    effect: Repeated = ()
    seed: int | None = None  # Seed of the noise.
    # What recordings keep of the joints: current as i1… [A] (rtde, its default; sim, can), torque
    # as tau1… [N·m] (sim, can), or off.
    effort: Literal["torque", "current", "off"] | None = None
    # With sim: which of wrench, effort, pose (of a tracker's target), command and imu are recorded,
    # with commas between; the wrench, and in motion the command, if none.
    channels: str | None = None
    # NAME=VALUE of a setting that this driver alone has, for instance base=0x68 with can or
    # frequency=none with rtde; a wrong NAME lists them. May be repeated.
    set: Repeated = ()

    @property
    def asked_channels(self) -> tuple[str, ...]:
        """Names in ``--channels``, in the order given; empty without the option. A `ParameterError`
        if the driver is not sim, or a name is not one of `CHANNELS_OF`."""
        names = tuple((self.channels or "").replace(" ", "").split(",")) if self.channels else ()
        if self.channels is not None and self.driver != "sim":
            raise ParameterError(f"--channels: driver {self.driver!r} does not take it")
        if wrong := [name for name in names if name not in CHANNELS_OF]:
            raise ParameterError(f"--channels {wrong[0]}: is none of {', '.join(CHANNELS_OF)}")
        return names

    def check(self, mode: str) -> None:
        """Raise an error for channels that a plan of ``mode`` (static or dynamic) cannot record."""
        other, when = ("command", "in motion") if mode == "static" else ("pose", "at rest")
        if wrong := [name for name in self.asked_channels if name in other.split()]:
            raise ParameterError(f"--channels {wrong[0]}: is simulated {when} only")

    def options(self, device: type[Driver], robot: str, limits: Limits) -> Any:
        """Make the options of driver class ``device`` for a robot; refuse an argument that it does
        not take."""
        console.check_seed(self.seed or 0)
        given = {
            "host": self.host, "channel": self.channel, "sensor": self.sensor,
            "parameters": console.parameters(self.parameters) or None, "noise": self.noise,
            "effects": self.effect or None, "seed": self.seed, "effort": self.effort,
        }  # fmt: skip
        known = [f.name for f in fields(device.options)]
        flagged = ("robot", "limits", *given)
        words = console.typed(device.options, console.pairs(self.set), flagged)
        chosen: dict[str, Any] = {k: v for k, v in given.items() if v is not None}
        usual = {_OPTION_OF[c]: _USUAL[c] for c in self.asked_channels if c in _OPTION_OF}
        chosen = {k: v for k, v in usual.items() if k not in words} | chosen
        for name in chosen:
            if name == "effects" and name not in known:
                raise ParameterError(f"--effect: driver {self.driver!r} does not simulate effects")
            if name not in known:
                raise ParameterError(f"--{name}: driver {self.driver!r} does not take it")
        return device.options(robot=robot, limits=limits, **chosen, **words)


@dataclass(frozen=True)
class LimitArguments:
    """Options that limit every motion of the robot: speed, workspace, force and torque."""

    # Share of top speed that moves between poses use; 0.25 on real robots.
    speed: float | None = None
    # Share of top speed that a trajectory may use; 0.7 on real robots.
    tracking: float | None = None
    # Where the sensor may be, x y z lower then x y z upper bounds in the world [m]. Live robots
    # without it: the way through the plan from where they are, and 0.05 m more.
    workspace: tuple[float, float, float, float, float, float] | None = None
    # Stop the robot above this measured force [N]. Live robots without it: half way from what the
    # tool and the sensor's zero may add up to, to the end of the range.
    max_force: float | None = None
    max_torque: float | None = None  # Stop the robot above this measured torque [N·m]; likewise.

    def limits(self, live: bool) -> Limits:
        """Limits as given; missing ones are the defaults of ``live`` (real) or simulated robots."""
        usual, box = LIVE if live else Limits(), self.workspace
        if not live and (self.max_force, self.max_torque) != (None, None):
            raise ParameterError("--max-force, --max-torque: they stop real robots alone")
        return Limits(
            usual.speed if self.speed is None else self.speed,
            usual.tracking if self.tracking is None else self.tracking,
            None if box is None else (box[:3], box[3:]),
            self.max_force,
            self.max_torque,
        )


@dataclass(frozen=True)
class RunArguments:
    """Options of `record`: samples and rate, dry run, resuming, second visit, what is confirmed."""

    samples: int = 100  # Rows a pose.
    rate: float | None = None  # Sampling rate [Hz]; the plan's, else 100 at rest and 125 in motion.
    # Check every move, show the campaign, and record it in simulation instead.
    dry_run: bool = False
    resume: bool = False  # Go on with the stopped campaign in OUT, at the pose where it stopped.
    # Somebody has looked: first clear a protective stop, a drive's fault, or a program that was
    # left on the robot.
    recover: bool = False
    # Somebody has looked that the robot may move: ask no more. Real robots alone are asked for.
    yes: bool = False
    # Visit the first pose again at the end, which shows drift; auto: on real robots and in dry
    # runs.
    revisit: Literal["auto", "yes", "no"] = "auto"
    force: bool = False  # Replace a recording at OUT; it is kept as OUT~, or OUT~2 and so on.


def record(
    robot: str,
    plan: Path,
    out: Path,
    device: DeviceArguments,
    run: RunArguments,
    motion: LimitArguments,
    as_json: Json = False,
) -> None:
    """Run a plan on a simulated or real robot and record what its sensor reads.

    Args:
        robot: Name, see `wrenchbed list robots`.
        plan: Parquet file with q1…qN, see `wrenchbed plan`.
        out: Recording to write; what a resumed campaign or another try of a motion replaces is
            kept as OUT.cut~.
    """
    inputs = (plan, device.parameters)
    console.check_out(out, Kind.RECORDING, *inputs, force=run.force or run.resume)
    todo = wb.Plan.read(plan)
    device.check(todo.mode)
    # of a user's description without its version: limits are checked anyway
    stated, given = (n.partition("@")[0] for n in (todo.robot, wb.load("robots", robot).name))
    if stated != given:
        raise PlanError(f"{plan}: the plan is for robot {todo.robot!r}, not {robot!r}")
    kind = wb.load("drivers", device.driver)
    limits = motion.limits(kind.live)
    if run.dry_run:
        kind = wb.SimDriver
        device = replace(device, driver="sim", host=None, channel=None, sensor=None, set=())
        _rehearse(todo, limits, run)
    link: Driver = kind(device.options(kind, robot, limits))
    revisit = {"yes": True, "no": False, "auto": True if run.dry_run else None}[run.revisit]
    before = _version(out)
    try:
        with (
            ready(link, todo, recover=run.recover, yes=run.yes) as complete,
            console.progress(f"recording {robot}", len(todo)) as report,
        ):
            done = wb.record(
                link, todo, out, samples=run.samples, rate=run.rate, progress=report,
                revisit=revisit, resume=run.resume, clear=run.dry_run or None, limits=complete,
            )  # fmt: skip
    except KeyboardInterrupt as stop:
        static = kind.live and todo.mode == "static"
        stop.add_note(_left_behind(_version(out) != before, static, run.resume))
        raise
    _leave_out(out, device.asked_channels)
    _answer(done, todo, device.driver, as_json)


def _version(path: Path) -> tuple[int, int] | None:
    """Modification time and size of a file, to notice when it is rewritten; None without a file."""
    return (path.stat().st_mtime_ns, path.stat().st_size) if path.is_file() else None


def _left_behind(new: bool, static: bool, resumed: bool) -> str:
    """Text on what a stopped recording leaves on disk (``new``: this run wrote its file) and, for a
    plan of poses (``static``), how to go on; ``resumed``: this run itself continued another."""
    what = "; what was recorded is on disk" if new else "; nothing was recorded"
    return f"{what}, and `record … --resume` goes on" if static and (new or resumed) else what


def _leave_out(path: Path, asked: tuple[str, ...]) -> None:
    """Delete a recording's columns of channels that are not in ``asked``; if it is empty, none."""
    stems = {s for name, columns in CHANNELS_OF.items() if name not in asked for s in columns}
    if not asked or not stems:
        return
    recording = wb.Recording.read(path)
    kept = {n: x for n, x in recording.columns.items() if n.rstrip("0123456789") not in stems}
    if len(kept) < len(recording.columns):
        wb.Recording(recording.metadata, kept, recording.name).write(path)


def _rehearse(plan: wb.Plan, limits: Limits, run: RunArguments) -> None:
    """Check the moves of a plan within ``limits``, without a robot, and print them as a table."""
    if run.resume:
        raise ParameterError("--dry-run records from the start: leave --resume out")
    arm = wb.load("robots", plan.robot)
    rows = [0] if plan.mode == "dynamic" else list(range(len(plan)))
    legs = itinerary(arm, plan, arm.home, limits, rows, clear=True)
    title = f"{plan.name}: {len(plan)} rows, moves from home"
    table = console.table(">pose", "joints [rad, m]", ">through", ">move [s]", title=title)
    for leg in legs[:_MOST_LEGS]:
        joints = " ".join(f"{v:+.2f}" for v in plan.q[leg.row])
        table.add_row(str(leg.row), joints, str(len(leg.via) - 1), f"{leg.seconds:.1f}")
    more = f"… and {len(legs) - _MOST_LEGS} more. " if len(legs) > _MOST_LEGS else ""
    around = sum(len(leg.via) > 1 for leg in legs)
    seconds = sum(leg.seconds for leg in legs)
    total = (
        f"{more}Every move is within reach and touches nothing; {around or 'none'} of them lead "
        f"around something. Moves take {seconds:.0f} s at {limits.speed:.0%} of top speed."
    )
    console.answer(None, False, table, total)


def _answer(done: RunProgress, plan: wb.Plan, driver: str, as_json: bool) -> None:
    result: dict[str, Any] = {
        "recording": str(done.path), "robot": plan.robot, "mode": plan.mode, "rows": done.rows,
        "visited": done.visited, "seconds": done.seconds,
    }  # fmt: skip
    kind = "poses" if plan.points is None else "touches"
    what = f"{done.visited} {kind}" if plan.mode == "static" else f"{done.rows} samples of motion"
    time = f"{done.seconds:.0f} s of {driver} time"
    lines = [f"recorded {what}, {done.rows} rows, {time} → {done.path}"]
    if done.tried_again:
        result["tried_again"] = done.tried_again
        lines.append(f"{done.tried_again} tries failed and were made again")
    if done.drift is not None:
        change, std = done.drift.change, done.drift.std
        both = zip(CHANNELS, change, std, strict=True)
        result["drift"] = {c: {"value": float(v), "std": float(s)} for c, v, s in both}
        worst = int(np.argmax(np.abs(change) / np.maximum(std, 1e-12)))
        lines.append(
            f"first pose again after {done.drift.seconds:.0f} s: {CHANNELS[worst]} changed most, "
            f"{change[worst]:+.2g} ± {std[worst]:.1g} {UNITS[worst]}"
        )
    console.answer(result, as_json, *lines)


# before a live robot moves: its limits are shown, and a person agrees


@contextmanager
def ready(link: Driver, plan: wb.Plan, *, recover: bool, yes: bool) -> Iterator[LiveLimits | None]:
    """Connect and activate a driver for the block; yield the limits of a live driver.

    The limits were printed, and a person agreed, else a `ParameterError`. Errors name the flag to
    give, not the method.

    Args:
        link: driver that is not connected yet.
        plan: plan that it will run.
        recover: whether somebody has looked at a robot that had stopped.
        yes: a person agreed already that a real robot moves; else the terminal asks.
    """
    address = link.address if isinstance(link, LiveDriver) else ""
    ask = bool(address) and not yes
    if ask and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise ParameterError(
            f"the robot at {address} would move, and there is no terminal to ask at: look that "
            "its surroundings are free, then give --yes"
        )
    try:
        link.connect()
        try:
            limits = _shown(link, plan) if isinstance(link, LiveDriver) else None
            if ask:
                _agree(address)
            if recover:
                link.recover(unlock=True)
            yield limits
        finally:
            link.close()
    except DriverError as error:
        text = str(error).replace("call recover(unlock=True)", "give --recover")
        raise type(error)(text.replace("call recover()", "give --recover")) from error


def _shown(link: LiveDriver, plan: wb.Plan) -> LiveLimits:
    """Print the limits that a live driver will keep during a plan, and return them."""
    complete = live_limits(link, plan)
    limits, origin = complete.limits, complete.origin
    assert limits.workspace is not None
    lower, upper = limits.workspace
    model = link.answers.get("model")
    title = f"{model or link.robot.name} at {link.address or 'this machine (emulator)'}: limits"
    table = console.table("limit", "value", "from", title=title)
    for k, axis in enumerate("xyz"):
        where = origin["workspace"] if k == 0 else ""
        table.add_row(f"sensor's {axis}", f"{lower[k]:+.2f} … {upper[k]:+.2f} m", where)
    table.add_row("force", f"{limits.force:.3g} N", origin["force"])
    table.add_row("torque", f"{limits.torque:.3g} N·m", origin["torque"])
    table.add_row("speed of moves", f"{limits.speed:.0%} of top speed", "")
    console.note(table)
    return complete


def _agree(address: str) -> None:
    """Ask at the terminal whether the robot at ``address`` may move; raise an error unless the
    answer is yes."""
    console.note(f"The robot at {address} will move. Is nobody in its reach? [y/N]")
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise ParameterError("not agreed: nothing was moved")
