"""Look at a UR robot and its sensor before a first session: what would fail, and what to do.

Nothing moves and nothing is set: ports are opened, pages and outputs are read, and a stream is
watched for some seconds.
"""

import math
import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import linear_regression
from typing import Any, Literal

import numpy as np

from wrenchbed.errors import DriverError, LinkError, ParameterError, WrenchbedError
from wrenchbed.hardware.drivers.rtde import dashboard, identity, outputs, wrench_source
from wrenchbed.hardware.drivers.rtde.outputs import NATIVE_HZ, Unfit
from wrenchbed.hardware.transducers.base import Transducer, transducer_at
from wrenchbed.robots.base import Robot

Grade = Literal["ok", "note", "fails"]
"""``fails``: a recording run would not start or not end; ``note``: look at it."""
_PORTS = {30004: "RTDE", 30003: "scripts", 29999: "dashboard"}
_ANSWER_S = 2.0
"""Deadline of a port or an answer [s]; estimate."""
_SPARSE, _GAP_S = 0.9, 0.08
"""Share of the states that must arrive, and the longest gap between two, from which a driver calls
the link stale [s]; the share is an estimate."""
_NEEDED_HZ, _LONGEST_S = 100.0, 600.0
"""Readings of a box that a recording at rest needs [1/s], and longest look [s]; estimates."""
_BINS = 12
"""Stretches of a stream, of each of which the least late arrival counts; estimate."""
_DRIFT_PPM = 1000.0
"""Drift of a clock that is noted [ppm]; estimate."""
_HEAVY = 0.05
"""Share by which the pendant's payload may differ from the tool's mass; estimate."""
_MS, _MILLION = 1e3, 1e6  # by definition
_SHOWN = ("product", "serial", "firmware", "calibration", "sinc")
"""What a sensor says of itself that is shown."""


@dataclass(frozen=True)
class Line:
    """One thing that was looked at: its grade, what was found, and what to do if it is not ok."""

    name: str
    grade: Grade
    found: str
    remedy: str = ""


@dataclass(frozen=True)
class Report:
    """All lines, in the order in which a recording run would meet them."""

    lines: tuple[Line, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing fails."""
        return all(line.grade != "fails" for line in self.lines)

    def to_json(self) -> dict[str, Any]:
        """``ok`` and ``lines``."""
        return {"ok": self.ok, "lines": [asdict(line) for line in self.lines]}


def doctor(robot: Robot, host: str = "", sensor: str = "", seconds: float = 3.0) -> Report:
    """Look at a robot's controller, a sensor's box, or both.

    Args:
        robot: that recordings will be made with.
        host: of the controller; it is left out if empty.
        sensor: address of the sensor, for instance ``netft://HOST``, or the HOST of a Net F/T;
            left out if empty.
        seconds: for which each stream is watched [s].

    Raises:
        ParameterError: nothing to look at, no such sensor, or no time.
    """
    if not (host or sensor) or not 0.1 <= seconds <= _LONGEST_S:
        raise ParameterError(
            f"give --host ROBOT, --sensor SENSOR or both, and 0.1 … {_LONGEST_S:g} --seconds"
        )
    box = _transducer(sensor)
    lines: list[Line] = []
    if host:
        lines += _controller(robot, host, seconds)
    if box is not None:
        lines += _box(box, seconds)
    return Report(tuple(lines))


def _controller(robot: Robot, host: str, seconds: float) -> Iterator[Line]:
    closed = [port for port in _PORTS if not _open(host, port)]
    for port, name in _PORTS.items():
        if port in closed:
            remedy = "check address, power and cable; on an e-Series enable it under Settings › "
            yield Line(f"port {port}", "fails", f"{name}: nobody answers at {host}",
                       remedy + "Security › Services")  # fmt: skip
        else:
            yield Line(f"port {port}", "ok", f"{name} answers")
    if 30004 in closed:
        return
    told = identity.stated(host) if 29999 not in closed else {}
    try:
        with outputs.outputs(host, identity.SETTINGS, _ANSWER_S) as stream:
            version = stream.version
            times, values = _watched(stream, seconds)
    except (OSError, Unfit) as error:
        yield Line("RTDE", "fails", str(error) or type(error).__name__, "restart the controller")
        return
    yield _version(version, told)
    yield _model(robot, told, version[0])
    if version[0] >= 5 and 29999 not in closed:
        yield _remote(host)
    yield _geometry(robot, host)
    yield from _settings(robot, values)
    yield from _stream(times, NATIVE_HZ[version[0] > 3], "states", clocked=True)


def _watched(
    stream: outputs.Outputs, seconds: float
) -> tuple[list[tuple[float, float]], Mapping[str, outputs.Values]]:
    """(arrival, the controller's clock) of all states [s], and the last values."""
    times: list[tuple[float, float]] = []
    end = time.monotonic() + seconds
    values: Mapping[str, outputs.Values] = {}
    while time.monotonic() < end:
        arrival, values = stream.next(time.monotonic() + _ANSWER_S)
        times.append((arrival, values.get("timestamp", (math.nan,))[0]))
    return times, values


def _version(version: Sequence[int], told: Mapping[str, str]) -> Line:
    text = ".".join(map(str, version[:3]))
    text += f", serial {told['serial']}" if "serial" in told else ""
    tried = (3, 15) if version[0] <= 3 else (5, 11)
    if tuple(version[:2]) == tried:
        return Line("software", "ok", text)
    return Line("software", "note", text, "the drivers were tried with emulated 3.15 and 5.11: "
                "begin with --speed 0.05 and few poses")  # fmt: skip


def _model(robot: Robot, told: Mapping[str, str], major: int) -> Line:
    try:
        identity.check_model(robot, told, major, at_flange=False)
    except DriverError as error:
        return Line("model", "fails", str(error), "give --robot as the arm is")
    if "model" not in told:
        return Line("model", "note", "the dashboard does not say it", "look at the arm's label")
    return Line("model", "ok", f"{told['model']}, as {robot.name}")


def _geometry(robot: Robot, host: str) -> Line:
    try:
        own = identity.geometry(robot, host).get("kinematics")
    except DriverError as error:
        return Line("kinematics", "fails", str(error), "give --robot as the arm is")
    if own is None:
        return Line("kinematics", "note", "not told on port 30002: the arm's calibration is not "
                    "recorded", "enable the port under Settings › Security › Services")  # fmt: skip
    if "from_nominal" not in own:
        return Line("kinematics", "note", f"read, and {robot.name} has no such table to compare")
    return Line("kinematics", "ok", f"the flange is up to {1e3 * own['from_nominal']:.1f} mm from "
                f"that of {robot.name}")  # fmt: skip


def _remote(host: str) -> Line:
    try:
        answer = dashboard.request(host, "is in remote control", _ANSWER_S)
    except LinkError as error:
        return Line("remote control", "note", str(error), "look at the pendant")
    if "true" in answer.lower():
        return Line("remote control", "ok", "on")
    return Line("remote control", "fails", f"the dashboard says {answer!r}",
                "switch it on at the pendant, top right")  # fmt: skip


def _settings(robot: Robot, values: Mapping[str, outputs.Values]) -> Iterator[Line]:
    found = identity.in_words(values)
    safety, mode = found.get("safety_mode", "unknown"), found.get("robot_mode", "unknown")
    fine = safety in ("normal", "reduced")
    yield Line(
        "safety", "ok" if fine else "fails", safety, "" if fine else "clear it at the pendant"
    )
    fine = mode == "running"
    yield Line("robot mode", "ok" if fine else "fails", mode,
               "" if fine else "power it on and release its brakes at the pendant")  # fmt: skip
    speed = found.get("speed_scaling", 1.0)
    yield Line("speed slider", "ok" if speed > 0.99 else "note", f"{speed:.0%}",
               "" if speed > 0.99 else "motions fail below 100 %: move the slider up")  # fmt: skip
    yield _payload(robot, found)
    tcp = found.get("tcp_offset")
    if tcp is None:
        yield Line("TCP", "note", "the controller does not say it", "set the flange, all zeros")
    elif any(abs(v) > 1e-6 for v in tcp):
        yield Line("TCP", "note", "x y z " + " ".join(f"{1e3 * v:+.1f}" for v in tcp[:3]) + " mm",
                   "leave it as it is during a run; recordings state it")  # fmt: skip
    else:
        yield Line("TCP", "ok", "the flange")


def _payload(robot: Robot, found: Mapping[str, Any]) -> Line:
    tool = float(robot.tool(robot.parameters.nominal).mass)
    mass = found.get("payload")
    if mass is None:
        return Line("payload", "note", "the controller does not say it",
                    "set it at the pendant to the tool's mass")  # fmt: skip
    text = f"{mass:.3g} kg, tool of {robot.name} {tool:.3g} kg"
    if abs(mass - tool) <= _HEAVY * max(tool, mass):
        return Line("payload", "ok", text)
    return Line("payload", "note", text, "set it at the pendant to what the flange carries: the "
                "arm stops to protect itself where they differ much")  # fmt: skip


def _stream(
    times: Sequence[tuple[float, float]], native: float, what: str, *, clocked: bool
) -> Iterator[Line]:
    """Rate, gaps, jitter and clock of a stream of (arrival, device clock) [s].

    Args:
        times: NaN for the clock where there is none.
        native: rate [Hz].
        what: comes.
        clocked: whether a device of this kind always has a clock.
    """
    at, clock = np.transpose(times) if len(times) > 2 else (np.zeros(2), np.zeros(2))
    rate = (len(at) - 1) / (at[-1] - at[0]) if at[-1] > at[0] else 0.0
    gap = float(np.diff(at).max()) if rate else math.inf
    least = _SPARSE * native
    text = f"{rate:.1f} {what} a second ({least:g} needed), longest gap {gap * _MS:.1f} ms"
    if rate < least or gap > _GAP_S:
        yield Line("rate", "fails", text, "use a cable and no wireless link, end other programs on "
                   "this computer and other clients of the robot")  # fmt: skip
    else:
        yield Line("rate", "ok", text)
    if rate and np.isnan(clock).all() and clocked:
        yield Line("clock", "fails", f"its {what} have no timestamp", "update its software")
        return
    if rate and np.isnan(clock).all():
        yield Line("clock", "ok", "it sends none: readings are dated by their arrival")
        return
    if not rate or not np.isfinite(clock).all() or clock[-1] <= clock[0]:
        yield Line("clock", "fails", "the device's clock stands still", "restart the device")
        return
    late = np.abs(np.diff(at) - np.diff(clock)) * _MS
    yield Line("jitter", "ok", f"median {np.median(late):.2f} ms, 99 % within "
               f"{np.percentile(late, 99):.2f} ms, largest {late.max():.2f} ms")  # fmt: skip
    ppm = _drift(at, clock)
    found = f"runs {ppm:+.0f} ppm against this computer's"
    if abs(ppm) < _DRIFT_PPM:
        yield Line("clock", "ok", found)
    else:
        remedy = "watch longer (--seconds 30); if it stays, have the clock looked at"
        yield Line("clock", "note", found, remedy)


def _drift(at: np.ndarray, clock: np.ndarray) -> float:
    """Drift of a clock (N,) against its arrivals [ppm], by the least late one of each bin."""
    late = at - clock
    parts = np.array_split(np.arange(len(at)), min(_BINS, len(at) // 2))
    least = [int(part[np.argmin(late[part])]) for part in parts]
    if len(least) < 2:
        return 0.0
    since = (at[least] - at[least[0]]).tolist()
    return -_MILLION * float(linear_regression(since, (late[least] - late[0]).tolist()).slope)


def _transducer(sensor: str) -> Transducer | None:
    if not sensor or sensor in wrench_source.OWN:
        return None
    words = sensor if "://" in sensor else f"netft://{sensor}"
    return transducer_at(words)


def _box(box: Transducer, seconds: float) -> Iterator[Line]:
    try:
        box.connect()
    except WrenchbedError as error:
        yield Line("box", "fails", str(error), "check its address, power, cable, and the firewall")
        return
    try:
        known, scale = box.identity, box.full_scale
        words = ", ".join(f"{name} {known[name]}" for name in _SHOWN if name in known)
        yield Line("box", "ok", words or "it does not say its serial number")
        yield from _box_settings(known)
        times = _readings(box, seconds)
        yield from _load(box, scale)
        yield from _stream(times, _NEEDED_HZ, "readings", clocked=False)
        yield _lost(box)
    finally:
        box.close()


def _box_settings(known: Mapping[str, str]) -> Iterator[Line]:
    transform = known.get("tool_transform", "")
    if any(c in "123456789" for c in transform):
        yield Line("tool transform", "fails", transform, "set it to zeros in the box's settings: "
                   "recordings are in the sensor's own axes")  # fmt: skip
    if known.get("filter", "0") != "0":
        yield Line("filter", "note", f"number {known['filter']}",
                   "it delays readings: switch it off for motions")  # fmt: skip


def _readings(box: Transducer, seconds: float) -> list[tuple[float, float]]:
    """(arrival, device clock) of the readings that a driver would see [s]."""
    times: list[tuple[float, float]] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        sample = box.read()
        if sample.fresh:
            clock = math.nan if sample.device_time is None else sample.device_time
            times.append((sample.t, clock))
        time.sleep(1e-3)
    return times


def _load(box: Transducer, scale: np.ndarray | None) -> Iterator[Line]:
    sample = box.read()
    force, torque = np.linalg.norm(sample.wrench[:3]), np.linalg.norm(sample.wrench[3:])
    text = f"{force:.2f} N, {torque:.3f} N·m"
    if scale is None:
        yield Line("load", "note", text, "it does not say its range: give --max-force")
        return
    share = float(np.max(np.abs(sample.wrench) / scale))
    grade: Grade = "ok" if share < 0.5 else "note" if share < 1.0 else "fails"
    yield Line("load", grade, f"{text}, {share:.0%} of the range", "" if grade == "ok" else
               "unload the sensor, or set its zero")  # fmt: skip


def _lost(box: Transducer) -> Line:
    health = box.health()
    lost, records = health.counters["lost"], health.counters["readings"]
    if not health.ok:
        return Line("readings", "fails", health.detail, "see the box's page of its status")
    text = f"{records:.0f} records, {lost:.0f} lost"
    if lost <= 1e-3 * records:
        return Line("readings", "ok", text)
    return Line("readings", "note", text, "use one switch and a cable")


def _open(host: str, port: int, connect: Callable[..., Any] = socket.create_connection) -> bool:
    try:
        with connect((host, port), _ANSWER_S):
            return True
    except OSError:
        return False
