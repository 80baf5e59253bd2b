"""Look at a UR robot and its sensor before a first session: what would fail, and what to do.

Nothing moves and nothing is set: ports are opened, pages and outputs are read, and a stream is
watched for some seconds.
"""

import math
import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from wrenchbed.errors import DriverError, LinkError, ParameterError, WrenchbedError
from wrenchbed.hardware.clock import ClockFit
from wrenchbed.hardware.device import STALE_S
from wrenchbed.hardware.drivers.rtde import identity, own_wrench, states, status
from wrenchbed.hardware.drivers.rtde.states import ANSWER_S, NATIVE_HZ
from wrenchbed.hardware.transducers.base import Transducer, transducer_at
from wrenchbed.robots.base import Robot

Grade = Literal["ok", "note", "fails"]
"""``fails``: a recording run would not start or not end; ``note``: look at it."""
_PORTS = {30004: "RTDE", 30003: "scripts", 29999: "dashboard"}
_SPARSE = 0.9
"""Fraction of the states that must arrive: fewer make a recording run wait for its rows."""
_NEEDED_HZ, _LONGEST_S = 100.0, 600.0
"""Readings of a box that a recording at rest needs [1/s], its usual rate, and longest look [s]."""
_STRETCH_S = 0.2
"""Stretch of a stream of which the least late arrival counts for the clock's drift [s]."""
_DRIFT_PPM = 1000.0
"""Drift of a clock that is noted [ppm]; a quartz drifts by 100 ppm at most."""
_HEAVY = 0.05
"""Relative difference between the pendant's payload and the tool's mass that is noted: with less
every cable is noted, with more the arm stops to protect itself unannounced."""
_SHOWN = ("product", "serial", "firmware", "calibration")
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


def _line(name: str, fine: bool, text: str, remedy: str, grade: Grade = "note") -> Line:
    """A line that is ok, or has a grade and a remedy."""
    return Line(name, "ok", text) if fine else Line(name, grade, text, remedy)


def _controller(robot: Robot, host: str, seconds: float) -> Iterator[Line]:
    closed = [port for port in _PORTS if not _open(host, port)]
    for port, name in _PORTS.items():
        text = f"{name}: nobody answers at {host}" if port in closed else f"{name} answers"
        remedy = (
            "check address, power and cable; on an e-Series enable it under Settings › Security › "
            "Services"
        )
        yield _line(f"port {port}", port not in closed, text, remedy, "fails")
    if 30004 in closed:
        return
    stated = identity.stated(host) if 29999 not in closed else {}
    try:
        with states.Outputs(host, identity.SETTINGS, ANSWER_S) as stream:
            version = stream.version
            times, values = _watched(stream, seconds)
    except DriverError as error:
        yield Line("RTDE", "fails", str(error), "restart the controller")
        return
    yield _version(version, stated)
    yield _model(robot, stated, version[0])
    if version[0] >= 5 and 29999 not in closed:
        yield _remote(host)
    yield _geometry(robot, host)
    yield from _settings(robot, values)
    yield from _stream(times, _SPARSE * NATIVE_HZ[version[0] > 3], "states", clocked=True)


def _watched(
    stream: states.Outputs, seconds: float
) -> tuple[list[tuple[float, float]], Mapping[str, states.Values]]:
    """(arrival, the controller's clock) of all states [s], and the last values."""
    times: list[tuple[float, float]] = []
    end = time.monotonic() + seconds
    values: Mapping[str, states.Values] = {}
    while time.monotonic() < end:
        arrival, packet = stream.next(time.monotonic() + ANSWER_S)
        values = packet or values
        times.append((arrival, values.get("timestamp", (math.nan,))[0]))
    return times, values


def _version(version: Sequence[int], stated: Mapping[str, str]) -> Line:
    text = ".".join(map(str, version[:3]))
    text += f", serial {stated['serial']}" if "serial" in stated else ""
    tried = (3, 15) if version[0] <= 3 else (5, 11)
    remedy = "the drivers were tried with emulated 3.15 and 5.11: begin with --speed 0.05"
    return _line("software", tuple(version[:2]) == tried, text, f"{remedy} and few poses")


def _model(robot: Robot, stated: Mapping[str, str], major: int) -> Line:
    try:
        identity.check_model(robot, stated, major, at_flange=False)
    except DriverError as error:
        return Line("model", "fails", str(error), "give --robot as the arm is")
    if "model" not in stated:
        return Line("model", "note", "the dashboard does not say it", "look at the arm's label")
    return Line("model", "ok", f"{stated['model']}, as {robot.name}")


def _geometry(robot: Robot, host: str) -> Line:
    try:
        own = identity.geometry(robot, host).get("kinematics")
    except DriverError as error:
        return Line("kinematics", "fails", str(error), "give --robot as the arm is")
    if own is None:
        text = "not told on port 30002: the arm's calibration is not recorded"
        remedy = "enable the port under Settings › Security › Services"
        return Line("kinematics", "note", text, remedy)
    if "from_nominal" not in own:
        return Line("kinematics", "note", f"read, and {robot.name} has no such table to compare")
    text = f"the flange is up to {1e3 * own['from_nominal']:.1f} mm from that of {robot.name}"
    return Line("kinematics", "ok", text)


def _remote(host: str) -> Line:
    try:
        answer = status.request(host, "is in remote control", ANSWER_S)
    except LinkError as error:
        return Line("remote control", "note", str(error), "look at the pendant")
    on = "true" in answer.lower()
    text = "on" if on else f"the dashboard says {answer!r}"
    return _line("remote control", on, text, "switch it on at the pendant, top right", "fails")


def _settings(robot: Robot, values: Mapping[str, states.Values]) -> Iterator[Line]:
    words = identity.in_words(values)
    safety, mode = words.get("safety_mode", "unknown"), words.get("robot_mode", "unknown")
    fine = safety in ("normal", "reduced")
    yield _line("safety", fine, safety, "clear it at the pendant", "fails")
    remedy = "power it on and release its brakes at the pendant"
    yield _line("robot mode", mode == "running", mode, remedy, "fails")
    speed = words.get("speed_scaling", 1.0)
    remedy = "motions fail below 100 %: move the slider up"
    yield _line("speed slider", speed > 0.99, f"{speed:.0%}", remedy)
    yield _payload(robot, words.get("payload"))
    tcp = words.get("tcp_offset")
    if tcp is None:
        yield Line("TCP", "note", "the controller does not say it", "set the flange, all zeros")
        return
    at_flange = all(abs(v) <= 1e-6 for v in tcp)
    text = "x y z " + " ".join(f"{1e3 * v:+.1f}" for v in tcp[:3]) + " mm"
    remedy = "leave it as it is during a run; recordings state it"
    yield _line("TCP", at_flange, "the flange" if at_flange else text, remedy)


def _payload(robot: Robot, mass: float | None) -> Line:
    if mass is None:
        remedy = "set it at the pendant to the tool's mass"
        return Line("payload", "note", "the controller does not say it", remedy)
    tool = float(robot.tool(robot.parameters.nominal).mass)
    remedy = (
        "set it at the pendant to what the flange carries: the arm stops to protect itself where "
        "they differ much"
    )
    text = f"{mass:.3g} kg, tool of {robot.name} {tool:.3g} kg"
    return _line("payload", abs(mass - tool) <= _HEAVY * max(tool, mass), text, remedy)


def _stream(
    times: Sequence[tuple[float, float]], least: float, what: str, *, clocked: bool
) -> Iterator[Line]:
    """Rate, gaps, jitter and clock of a stream of (arrival, device clock) [s].

    Args:
        times: NaN for the clock where there is none.
        least: rate that is needed [Hz].
        what: comes.
        clocked: whether a device of this kind always has a clock.
    """
    at, clock = np.transpose(times) if len(times) > 2 else (np.zeros(2), np.zeros(2))
    rate = (len(at) - 1) / (at[-1] - at[0]) if at[-1] > at[0] else 0.0
    gap = float(np.diff(at).max()) if rate else math.inf
    text = f"{rate:.1f} {what} a second ({least:g} needed), longest gap {1e3 * gap:.1f} ms"
    remedy = (
        "use a cable and no wireless link, end other programs on this computer and other clients "
        "of the robot"
    )
    yield _line("rate", rate >= least and gap <= STALE_S, text, remedy, "fails")
    if rate and np.isnan(clock).all():
        text = "it sends none: readings are dated by their arrival"
        text = f"its {what} have no timestamp" if clocked else text
        yield _line("clock", not clocked, text, "update its software", "fails")
        return
    if not rate or not np.isfinite(clock).all() or clock[-1] <= clock[0]:
        yield Line("clock", "fails", "the device's clock stands still", "restart the device")
        return
    late = 1e3 * np.abs(np.diff(at) - np.diff(clock))
    text = f"median {np.median(late):.2f} ms, 99 % within {np.percentile(late, 99):.2f} ms"
    yield Line("jitter", "ok", f"{text}, largest {late.max():.2f} ms")
    fit = ClockFit(_STRETCH_S)
    for device, host in zip(clock - clock[0], at - at[0], strict=True):
        fit.add(float(device), float(host))
    ppm = fit.ppm
    text = (
        "not known in so short a time"
        if ppm is None
        else f"runs {ppm:+.0f} ppm against this computer's"
    )
    remedy = "watch longer (--seconds 30); if it stays, have the clock looked at"
    yield _line("clock", ppm is None or abs(ppm) < _DRIFT_PPM, text, remedy)


def _transducer(sensor: str) -> Transducer | None:
    if not sensor or sensor in own_wrench.OWN:
        return None
    return transducer_at(sensor if "://" in sensor else f"netft://{sensor}")


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
        yield _load(box, scale)
        yield from _stream(times, _SPARSE * _NEEDED_HZ, "readings", clocked=False)
        yield _lost(box)
    finally:
        box.close()


def _box_settings(known: Mapping[str, str]) -> Iterator[Line]:
    transform, number = known.get("tool_transform", ""), known.get("filter", "0")
    if any(c in "123456789" for c in transform):
        remedy = "set it to zeros in the box's settings: recordings are in the sensor's own axes"
        yield Line("tool transform", "fails", transform, remedy)
    if number != "0":
        remedy = "it delays readings: switch it off for motions"
        yield Line("filter", "note", f"number {number}", remedy)


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


def _load(box: Transducer, scale: np.ndarray | None) -> Line:
    wrench = box.read().wrench
    text = f"{np.linalg.norm(wrench[:3]):.2f} N, {np.linalg.norm(wrench[3:]):.3f} N·m"
    if scale is None:
        return Line("load", "note", text, "it does not say its range: give --max-force")
    fraction = float(np.max(np.abs(wrench) / scale))
    grade: Grade = "note" if fraction < 1.0 else "fails"
    text = f"{text}, {fraction:.0%} of the range"
    return _line("load", fraction < 0.5, text, "unload the sensor, or set its zero", grade)


def _lost(box: Transducer) -> Line:
    health = box.health()
    lost, records = health.counters["lost"], health.counters["readings"]
    if not health.ok:
        return Line("readings", "fails", health.detail, "see the box's page of its status")
    text = f"{records:.0f} records, {lost:.0f} lost"
    return _line("readings", lost <= 1e-3 * records, text, "use one switch and a cable")


def _open(host: str, port: int, connect: Callable[..., Any] = socket.create_connection) -> bool:
    try:
        with connect((host, port), ANSWER_S):
            return True
    except OSError:
        return False
