"""Check a UR robot and its sensor before a first session: what would fail, and what to do. Nothing
moves and nothing is set: ports are opened, pages and outputs are read, and a stream is watched for
some seconds. Its texts (`wrenchbed doctor`) are listed in docs/reference/messages.txt."""

import contextlib
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from wrenchbed.errors import DriverError, LinkError, ParameterError, WrenchbedError
from wrenchbed.hardware.device_base import STALE_S, connected
from wrenchbed.hardware.drivers.rtde import identity, own_wrench, states, ur_health
from wrenchbed.hardware.drivers.rtde.states import ANSWER_S, NATIVE_HZ
from wrenchbed.hardware.transducers.base import Transducer
from wrenchbed.hardware.transducers.netft.transducer import at_address
from wrenchbed.robots.base import Robot

Grade = Literal["ok", "note", "fails"]
"""``fails``: a recording run would not start or not end; ``note``: a person should look at it."""
_PORTS = {states.PORT: "RTDE", 30003: "scripts", ur_health.PORT: "dashboard"}
"""TCP port of the controller → service, fixed by Universal Robots; recording runs need them."""
_SPARSE = 0.9
"""Fraction of the states that must arrive: with fewer, a recording run waits for its rows."""
_NEEDED_HZ, _LONGEST_S = 100.0, 600.0
"""Readings of a box that a recording at rest needs [1/s], its usual rate, and longest check [s]."""
_HEAVY = 0.05
"""Relative difference between the pendant's payload and the tool's mass that is reported: a smaller
limit would report cables; with a larger one the arm might stop to protect itself unannounced."""
_SHOWN = ("serial", "firmware", "calibration")
"""Fields of a sensor's identity that the report contains."""
_UNSAID, _ANOTHER = "the controller does not say it", "give --robot as the arm is"


@dataclass(frozen=True)
class Line:
    """Result of one check: name, grade (ok, note, fails), what was found, remedy if not ok."""

    name: str
    grade: Grade
    found: str
    remedy: str = ""


def doctor(robot: Robot, host: str, sensor: str, seconds: float) -> list[Line]:
    """Check a robot's controller, a sensor's box, or both; return one `Line` for each finding, in
    the order in which a recording run would fail.

    Args:
        robot: robot with which recordings will be made.
        host: address of the controller; not checked if empty.
        sensor: address of the sensor, for instance ``netft://HOST``, or the HOST of a Net F/T; not
            checked if empty.
        seconds: time for which each stream is watched [s].

    Raises:
        ParameterError: neither is given, the sensor is unknown, or the time is out of range.
    """
    if not (host or sensor) or not 0.1 <= seconds <= _LONGEST_S:
        raise ParameterError(
            f"give --host ROBOT, --sensor SENSOR or both, and 0.1 … {_LONGEST_S:g} --seconds"
        )
    address = sensor if "://" in sensor else f"netft://{sensor}"
    box = None if sensor in ("", *own_wrench.OWN) else at_address(address)
    lines = [*_controller(robot, host, seconds)] if host else []
    return lines if box is None else [*lines, *_box(box, seconds)]


def _line(name: str, fine: bool, text: str, remedy: str, grade: Grade = "note") -> Line:
    """Make the result of a check: ok if ``fine``, else ``grade`` (note or fails) with a remedy."""
    return Line(name, "ok", text) if fine else Line(name, grade, text, remedy)


def _controller(robot: Robot, host: str, seconds: float) -> Iterator[Line]:
    remedy = "check address, power and cable; on an e-Series enable it under Settings › Security"
    answers = {port: _open(host, port) for port in _PORTS}
    for port, name in _PORTS.items():
        text = f"{name} answers" if answers[port] else f"{name}: nobody answers at {host}"
        yield _line(f"port {port}", answers[port], text, f"{remedy} › Services", "fails")
    if not answers[states.PORT]:
        return
    stated = identity.stated(host) if answers[ur_health.PORT] else {}
    times: list[tuple[float, float]] = []
    values: Mapping[str, states.Values] = {}
    try:
        with states.Outputs(host, identity.SETTINGS, ANSWER_S) as stream:
            version, end = stream.version, time.monotonic() + seconds
            while time.monotonic() < end:
                arrival, packet = stream.next(time.monotonic() + ANSWER_S)
                values = packet or values
                times.append((arrival, values.get("timestamp", (math.nan,))[0]))
    except DriverError as error:
        yield Line("RTDE", "fails", str(error), "restart the controller")
        return
    text = ".".join(map(str, version[:3]))
    text += f", serial {stated['serial']}" if "serial" in stated else ""
    tried = tuple(version[:2]) == ((3, 15) if version[0] <= 3 else (5, 11))
    remedy = "the drivers were tried with emulated 3.15 and 5.11: begin with --speed 0.05"
    yield _line("software", tried, text, f"{remedy} and few poses")
    yield _model(robot, stated, version[0])
    if version[0] >= 5 and answers[ur_health.PORT]:
        yield _remote_control(host)
    yield from _settings(robot, identity.in_words(values))
    yield from _stream(times, _SPARSE * NATIVE_HZ[version[0] > 3], "states", clocked=True)


def _model(robot: Robot, stated: Mapping[str, str], major: int) -> Line:
    try:
        identity.check_model(robot, stated, major, at_flange=False)
    except DriverError as error:
        return Line("model", "fails", str(error), _ANOTHER)
    model = stated.get("model", "")
    text = f"{model}, as {robot.name}" if model else "the dashboard does not say it"
    return _line("model", bool(model), text, "look at the arm's label")


def _remote_control(host: str) -> Line:
    try:
        answer = ur_health.request(host, "is in remote control", ANSWER_S)
    except LinkError as error:
        return Line("remote control", "note", str(error), "look at the pendant")
    on = "true" in answer.lower()
    text = "on" if on else f"the dashboard says {answer!r}"
    return _line("remote control", on, text, "switch it on at the pendant", "fails")


def _settings(robot: Robot, words: Mapping[str, Any]) -> Iterator[Line]:
    safety, mode = words.get("safety_mode", "unknown"), words.get("robot_mode", "unknown")
    yield _line("safety", safety in ur_health.HARMLESS, safety, "clear it at the pendant", "fails")
    remedy = "power it on and release its brakes at the pendant"
    yield _line("robot mode", mode == "running", mode, remedy, "fails")
    speed = words.get("speed_scaling", 1.0)
    remedy = "motions fail below 100 %: move the slider up"
    yield _line("speed slider", speed > 0.99, f"{speed:.0%}", remedy)
    mass, tool = words.get("payload"), float(robot.tool(robot.parameters.nominal).mass)
    fits = mass is not None and abs(mass - tool) <= _HEAVY * max(tool, mass)
    text = _UNSAID if mass is None else f"{mass:.3g} kg, tool of {robot.name} {tool:.3g} kg"
    remedy = "set it at the pendant to what the flange carries: the arm stops to protect itself"
    yield _line("payload", fits, text, f"{remedy} where they differ much")
    tcp = words.get("tcp_offset")
    at_flange = tcp is not None and all(abs(v) <= 1e-6 for v in tcp)
    place = "" if tcp is None else " ".join(f"{1e3 * v:+.1f}" for v in tcp[:3])
    text = "the flange" if at_flange else f"x y z {place} mm" if place else _UNSAID
    yield _line("TCP", at_flange, text, "leave it as it is during a run; recordings state it")


def _stream(
    times: Sequence[tuple[float, float]], least: float, what: str, *, clocked: bool
) -> Iterator[Line]:
    """Yield findings on the rate, gaps and clock of the stream called ``what``. ``times`` are
    (arrival, device clock or NaN) [s]; ``least``: required rate [Hz]; ``clocked``: it needs a
    clock."""
    at, clock = np.transpose(times) if len(times) > 2 else (np.zeros(2), np.zeros(2))
    rate = (len(at) - 1) / (at[-1] - at[0]) if at[-1] > at[0] else 0.0
    gap = float(np.diff(at).max()) if rate else math.inf
    text = f"{rate:.1f} {what} a second ({least:g} needed), longest gap {1e3 * gap:.1f} ms"
    remedy = "use a cable and no wireless link, end other programs on this computer and"
    fine = rate >= least and gap <= STALE_S
    yield _line("rate", fine, text, f"{remedy} other clients of the robot", "fails")
    if rate and np.isnan(clock).all():
        text = "it sends none: readings are dated by their arrival"
        text = f"its {what} have no timestamp" if clocked else text
        yield _line("clock", not clocked, text, "update its software", "fails")
        return
    if not rate or not np.isfinite(clock).all() or clock[-1] <= clock[0]:
        yield Line("clock", "fails", "the device's clock stands still", "restart the device")


def _box(box: Transducer, seconds: float) -> Iterator[Line]:
    try:
        box.connect()
    except WrenchbedError as error:
        yield Line("box", "fails", str(error), "check its address, power, cable, and the firewall")
        return
    with contextlib.closing(box):
        known = box.identity
        words = ", ".join(f"{name} {known[name]}" for name in _SHOWN if name in known)
        yield Line("box", "ok", words or "it does not say its serial number")
        transform, number = known.get("tool_transform", ""), known.get("filter", "0")
        if any(c in "123456789" for c in transform):
            remedy = "set it to zeros in the box's settings: recordings are in the sensor's axes"
            yield Line("tool transform", "fails", transform, remedy)
        if number != "0":
            remedy = "it delays readings: switch it off for motions"
            yield Line("filter", "note", f"number {number}", remedy)
        times: list[tuple[float, float]] = []
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            sample = box.read()
            if sample.fresh:
                clock = sample.device_time
                times.append((sample.t, math.nan if clock is None else clock))
            time.sleep(1e-3)
        yield _load(box.read().wrench, box.full_scale)
        yield from _stream(times, _SPARSE * _NEEDED_HZ, "readings", clocked=False)
        health = box.health()
        lost, records = health.counters["lost"], health.counters["readings"]
        text = f"{records:.0f} records, {lost:.0f} lost"
        if health.ok:
            yield _line("readings", lost <= 1e-3 * records, text, "use one switch and a cable")
        else:
            yield Line("readings", "fails", health.detail, "see the box's page of its status")


def _load(wrench: np.ndarray, scale: np.ndarray | None) -> Line:
    text = f"{np.linalg.norm(wrench[:3]):.2f} N, {np.linalg.norm(wrench[3:]):.3f} N·m"
    if scale is None:
        return Line("load", "note", text, "it does not say its range: give --max-force")
    fraction = float(np.max(np.abs(wrench) / scale))
    grade: Grade = "note" if fraction < 1.0 else "fails"
    text = f"{text}, {fraction:.0%} of the range"
    return _line("load", fraction < 0.5, text, "unload the sensor, or set its zero", grade)


def _open(host: str, port: int) -> bool:
    with contextlib.suppress(OSError), connected(host, port, ANSWER_S):
        return True
    return False
