"""Record with a simulated or real robot.

Pictures of a campaign: drawn live on real robots and twins, afterwards in simulation.
"""

import contextlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from rich.markup import escape
from rich.table import Table

import wrenchbed as wb
from wrenchbed.campaigns.recording.itinerary import Leg, itinerary
from wrenchbed.campaigns.recording.run import RunProgress
from wrenchbed.cli import console
from wrenchbed.cli import console as settings
from wrenchbed.cli.console import Json
from wrenchbed.errors import DriverError, ParameterError, PlanError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.hardware.drivers.base.live import LIVE, LiveDriver
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.motion_limits import Limits


@contextmanager
def watched(link: Driver, out: Path, rrd: Path | None, view: str | None) -> Iterator[None]:
    """While the block runs a live driver's readings are drawn; else the recording, at its end.

    Args:
        out: recording that the block writes.
        rrd: picture to write, if any.
        view: ``window`` or ``browser`` to watch in, if any.
    """
    if not isinstance(link, LiveDriver):
        if view is not None:
            raise ParameterError(
                "--view is for live drivers; look at the recording: wrenchbed view"
            )
        yield
        if rrd is not None:
            from wrenchbed.viewer import recording_view

            recording_view(wb.Recording.read(out), rrd)
        return
    if rrd is None and view is None:
        yield
        return
    from wrenchbed.viewer.live import LiveView

    if not isinstance(link.robot, SimulatedRobot):
        raise ParameterError(f"robot {link.robot.name!r} has no model that could be shown")
    with _viewer(view) as url, LiveView(link.robot, rrd, url) as picture:
        link.onlooker = picture
        try:
            yield
        finally:
            link.onlooker = None
    if picture.dropped:
        text = f"the picture missed {picture.dropped} rows; the recording has them"
        console.OUT.print(text, soft_wrap=True, markup=False, highlight=False)


@contextmanager
def _viewer(view: str | None) -> Iterator[str | None]:
    """A viewer to draw in, open until it is closed by who looks."""
    if view is None:
        yield None
        return
    from wrenchbed.viewer import show

    with show.viewer(None, web=view == "browser") as viewer:
        if view == "browser":
            text = f"open {show.address(port=show.PORT)}"
            console.OUT.print(text, soft_wrap=True, markup=False, highlight=False)
        try:
            yield show.PROXY
        finally:
            if view == "window":
                console.OUT.print("close the window to go on")
                with contextlib.suppress(KeyboardInterrupt):
                    show.until_closed(viewer)


_SHOWN = 12
"""Most rows of a dry run's table."""
_FLAGS = {"effects": "effect"}
"""Names of options where the command line's differ."""
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


def record(
    robot: str,
    plan: Path,
    out: Path,
    driver: str = "sim",
    host: str | None = None,
    channel: str | None = None,
    sensor: str | None = None,
    recording: str | None = None,
    parameters: Path | None = None,
    noise: Literal["real", "white", "off"] | None = None,
    effect: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    samples: int = 100,
    rate: float | None = None,
    speed: float | None = None,
    tracking: float | None = None,
    workspace: tuple[float, float, float, float, float, float] | None = None,
    max_force: float | None = None,
    max_torque: float | None = None,
    dry_run: Flag = False,
    resume: Flag = False,
    recover: Flag = False,
    revisit: Literal["auto", "yes", "no"] = "auto",
    seed: int | None = None,
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    rrd: Path | None = None,
    view: Literal["window", "browser"] | None = None,
    as_json: Json = False,
) -> None:
    """Run a plan on a simulated or real robot and record what its sensor reads.

    Args:
        robot: Name, see `wrenchbed list robots`.
        plan: Parquet file with q1…qN, see `wrenchbed plan`.
        out: Recording to write; an existing one is kept as OUT~, what a resumed campaign or
            another try of a motion replaces as OUT.cut~.
        driver: Name, see `wrenchbed list drivers`.
        host: Address of the robot's controller (rtde), or of the machine that shares its CAN bus.
        channel: CAN channel, for instance can0.
        sensor: With rtde: netft://HOST for an ATI Net F/T at another address than the robot's, or
            rtde for the robot's own wrench.
        recording: With replay: what is replayed.
        parameters: JSON {name: value} in SI: what the simulated robot truly is.
        noise: Of the simulated sensor; real.
        effect: ID[:name=value,…] of an effect on the simulated robot, see `wrenchbed list effects`;
            without values of typical size. May be repeated.
        samples: Rows a pose.
        rate: Sampling rate [Hz]; the plan's, else 100 at rest and 125 in motion.
        speed: Share of top speed that moves between poses use; 0.25 on real robots.
        tracking: Share of top speed that a trajectory may use; 0.7 on real robots.
        workspace: Where the sensor may be, x y z lower then x y z upper bounds in the world [m].
        max_force: Stop the robot above this measured force [N].
        max_torque: Stop the robot above this measured torque [N·m].
        dry_run: Check every move, show the campaign, and record it in simulation instead.
        resume: Go on with the stopped campaign in OUT, at the pose where it stopped.
        recover: Somebody has looked: first clear a protective stop, a drive's fault, or a program
            that was left on the robot.
        revisit: Visit the first pose again at the end, which shows drift; auto: on real robots
            and in dry runs.
        seed: Of the noise.
        set: NAME=VALUE of a setting that this driver alone has, for instance base=0x68 with can or
            frequency=none with rtde; a wrong NAME lists them. May be repeated.
        rrd: Picture of the campaign to write, see `wrenchbed view`; live drivers draw it as they
            record; of a dry run, the way through all poses.
        view: With live drivers: watch while recording, in rerun's window or in a browser.
        as_json: Print the result as JSON.
    """
    console.check_seed(seed or 0)
    console.check_out(out, plan, parameters, Path(recording) if recording else None)
    console.check_out(rrd, out, plan)
    todo = wb.Plan.read(plan)
    if todo.robot != robot:
        raise PlanError(f"{plan}: the plan is for robot {todo.robot!r}, not {robot!r}")
    device = wb.load("drivers", driver)
    limits = _limits(device, speed, tracking, workspace, max_force, max_torque)
    if dry_run:
        if resume:
            raise ParameterError("--dry-run records from the start: leave --resume out")
        device, driver = wb.SimDriver, "sim"
        host = channel = sensor = recording = None
        _show(robot, todo, limits)
        if rrd is not None:
            from wrenchbed.viewer import plan_view

            plan_view(todo, rrd, limits)
            rrd = None
    given = {"host": host, "channel": channel, "sensor": sensor, "recording": recording,
             "parameters": console.parameters(parameters) or None, "noise": noise,
             "effects": effect or None, "seed": seed}  # fmt: skip
    words = {} if dry_run else settings.pairs(set)
    own = settings.typed(device.options, words, ("robot", "limits", *given))
    link: Driver = device(_options(device, driver, robot, limits, given | own))
    again = {"yes": True, "no": False, "auto": True if dry_run else None}[revisit]
    with (
        _ready(link, recover),
        watched(link, out, rrd, view),
        console.progress(f"recording {robot}", len(todo)) as tell,
    ):
        done = wb.record(
            link, todo, out, samples=samples, rate=rate, progress=tell, revisit=again,
            resume=resume, clear=dry_run or None,
        )  # fmt: skip
    _answer(done, todo, driver, as_json)


@contextmanager
def _ready(link: Driver, recover: bool) -> Iterator[None]:
    """Connected and able to move; what Python programs are told to call is a flag here."""
    try:
        link.connect()
        try:
            if recover:
                link.recover()
            else:
                link.activate()
            yield
        finally:
            link.close()
    except DriverError as error:
        raise type(error)(str(error).replace("call recover()", "give --recover")) from error


def _limits(
    device: type[Driver],
    speed: float | None,
    tracking: float | None,
    workspace: tuple[float, ...] | None,
    force: float | None,
    torque: float | None,
) -> Limits:
    usual = LIVE if device.live else Limits()
    box = None if workspace is None else (workspace[:3], workspace[3:])
    return Limits(
        usual.speed if speed is None else speed,
        usual.tracking if tracking is None else tracking,
        box,  # type: ignore[arg-type]
        force,
        torque,
    )


def _options(
    device: type[Driver], name: str, robot: str, limits: Limits, given: Mapping[str, Any]
) -> Any:
    """A driver's options; what it does not take is refused by its flag."""
    known = [f.name for f in fields(device.options)]
    chosen = {k: v for k, v in given.items() if v is not None}
    for key in chosen:
        if key not in known:
            flag = _FLAGS.get(key, key)
            what = "does not simulate effects" if flag == "effect" else "does not take it"
            raise ParameterError(f"--{flag}: driver {name!r} {what}")
    return device.options(robot=robot, limits=limits, **chosen)


def _show(robot: str, plan: wb.Plan, limits: Limits) -> None:
    """The campaign's moves, checked, as a table."""
    arm = wb.load("robots", robot)
    rows = [0] if plan.mode == "dynamic" else list(range(len(plan)))
    legs = itinerary(arm, plan, arm.home, limits, rows, clear=True)
    table = Table(title=f"{plan.name}: {len(plan)} rows, moves from home", title_justify="left")
    for column in ("pose", "joints [rad, m]", "through", "move [s]"):
        table.add_column(escape(column), justify="left" if column.startswith("joints") else "right")
    for leg in legs[:_SHOWN]:
        joints = " ".join(f"{v:+.2f}" for v in plan.q[leg.row])
        table.add_row(str(leg.row), joints, str(len(leg.via) - 1), f"{leg.seconds:.1f}")
    console.OUT.print(table)
    console.OUT.print(_total(legs, limits), soft_wrap=True, markup=False, highlight=False)


def _total(legs: tuple[Leg, ...], limits: Limits) -> str:
    more = f"… and {len(legs) - _SHOWN} more. " if len(legs) > _SHOWN else ""
    around = sum(len(leg.via) > 1 for leg in legs)
    seconds = sum(leg.seconds for leg in legs)
    return (
        f"{more}Every move is within reach and touches nothing; {around or 'none'} of them lead "
        f"around something. Moves take {seconds:.0f} s at {limits.speed:.0%} of top speed."
    )


def _answer(done: RunProgress, plan: wb.Plan, driver: str, as_json: bool) -> None:
    result: dict[str, Any] = {
        "recording": str(done.path), "robot": plan.robot, "mode": plan.mode, "rows": done.rows,
        "visited": done.visited, "seconds": done.seconds,
    }  # fmt: skip
    kind = "poses" if plan.points is None else "touches"
    what = f"{done.visited} {kind}" if plan.mode == "static" else f"{done.rows} samples of motion"
    text = f"recorded {what}, {done.rows} rows, {done.seconds:.0f} s of {driver} time → {done.path}"
    if done.tried_again:
        result["tried_again"] = done.tried_again
        text += f"\n{done.tried_again} tries failed and were made again"
    if done.drift is not None:
        change, std = done.drift.change, done.drift.std
        result["drift"] = {
            c: {"value": float(v), "std": float(s)}
            for c, v, s in zip(CHANNELS, change, std, strict=True)
        }
        worst = int(np.argmax(np.abs(change) / np.maximum(std, 1e-12)))
        text += (
            f"\nfirst pose again after {done.drift.seconds:.0f} s: {CHANNELS[worst]} changed most, "
            f"{change[worst]:+.2g} ± {std[worst]:.1g} {UNITS[worst]}"
        )
    console.answer(result, as_json, text)
