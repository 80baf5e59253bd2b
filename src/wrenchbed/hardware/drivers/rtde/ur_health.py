"""Health of a UR robot in words with remedies; and its dashboard commands: power, brakes, stops.

A protective stop only pauses the program; playing it again would continue the interrupted move. So
the program is stopped instead, and the next `activate` sends a new one. Sources: Universal Robots,
"RTDE guide" (robot_mode, safety_mode, safety_status_bits, runtime_state) and "Dashboard server":
TCP 29999; a line of welcome, a command line, an answer line, one command a connection.
"""

import socket
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

from wrenchbed.errors import LinkError, StoppedError
from wrenchbed.hardware.device_base import GONE_S, Health, State, by_age, connected, wait_until
from wrenchbed.hardware.drivers.rtde.states import Snapshot

PLAYING, STOPPED = 2, 1
RUNNING = 7
_BITS = {
    0b111 << 5: "emergency stop", 0b11 << 8: "safety fault", 1 << 2: "protective stop",
    1 << 4: "safeguard stop",
}  # fmt: skip
"""Bits of ``safety_status_bits`` → what they mean, the gravest first."""
MODES = {
    -1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "off",
    4: "powering on", 5: "idle", 6: "backdrive", 7: "running", 8: "updating firmware",
}  # fmt: skip
SAFETY = {
    1: "normal", 2: "reduced", 3: "protective stop", 4: "recovery", 5: "safeguard stop",
    6: "emergency stop", 7: "emergency stop", 8: "safety violation", 9: "safety fault",
    10: "validate joint id", 11: "undefined", 12: "safeguard stop", 13: "three-position stop",
}  # fmt: skip
HARMLESS = ("normal", "reduced")
"""Names of the safety modes in which the robot may move."""
_PROGRAM = {0: "stopping", 1: "stopped", 2: "playing", 3: "pausing", 4: "paused", 5: "resuming"}
_REMEDIES: dict[str, tuple[State, str]] = {
    "emergency stop": ("stopped", "release the button and power the robot on at its pendant"),
    "protective stop": ("stopped", "look what the robot hit, then call recover(unlock=True)"),
    "safeguard stop": ("stopped", "leave the guarded area and reset the safeguard"),
    "three-position stop": ("stopped", "hold the three-position switch in its middle"),
    "recovery": ("stopped", "move the robot back within its limits at its pendant"),
    "safety violation": ("fault", "restart the safety system at the pendant"),
    "safety fault": ("fault", "restart the safety system at the pendant"),
    "validate joint id": ("fault", "confirm the joints at the pendant"),
    "undefined": ("fault", "look at the pendant"),
}


PORT = 29999
"""TCP port of the dashboard; source: Universal Robots, "Dashboard server"."""
UNLOCK_AFTER_S = 5.1
"""Time after a protective stop before which it is not unlocked [s]: the controller requires 5 s
(source: Universal Robots, "Dashboard server"), and states arrive late."""
IDLE = 5
"""``robot_mode`` with power and closed brakes; source: Universal Robots, RTDE guide."""
_LONGEST = 4096
"""Most bytes of a dashboard answer, which is one line."""
_CLEARED_S, _STOPPED_S, _POWER_S, _BRAKES_S = 3.0, 2.0, 15.0, 20.0
"""Deadlines [s]: stop cleared, program ended, power on after a boot, brakes released one by one."""
Look = Callable[[], Snapshot]


def mode(state: Snapshot) -> str:
    """Robot mode of a state in words: ``running``, ``off`` …"""
    return MODES.get(int(state.mode), f"mode {state.mode:g}")


def safety(state: Snapshot) -> str:
    """Safety state in words, such as ``protective stop``; its bits report some stops first."""
    for mask, word in _BITS.items():
        if int(state.bits) & mask:
            return word
    return SAFETY.get(int(state.safety), f"safety mode {state.safety:g}")


def program(state: Snapshot) -> str:
    """State of the robot's program in a word: ``playing``, ``paused``, ``stopped`` …"""
    return _PROGRAM.get(int(state.runtime), f"program state {state.runtime:g}")


def problem(state: Snapshot) -> tuple[State, str] | None:
    """Health state, and reason with remedy, that prevent a robot from moving; None if it may."""
    word = safety(state)
    if word not in HARMLESS:
        kind, remedy = _REMEDIES.get(word, ("stopped", "look at the pendant"))
        return kind, f"{word}: {remedy}"
    if int(state.mode) != RUNNING:
        remedy = "power it on and release its brakes at the pendant"
        return "stopped", f"the robot is {mode(state)}: {remedy}"
    return None


class Control(NamedTuple):
    """State of the control process.

    Attributes:
        gone: reason why it has ended, empty while it runs.
        silent: time since its heartbeat [s].
        ended: whether it saw that its program on the robot has ended.
        halts: number of programs that had stopped when the robot was activated.
    """

    gone: str
    silent: float
    ended: bool
    halts: float


def judge(
    state: Snapshot | None, ended: str, control: Control | None, counters: Mapping[str, float]
) -> Health:
    """Judge the health of a session: first the link, then safety, the program, and the control.

    Args:
        state: newest state of the robot, None before the first.
        ended: reason why no more states will come, empty while they do.
        control: state of the control process; None if the robot is not active.
        counters: counters of the link, which the health reports.
    """
    if ended or state is None:
        return Health("lost", f"{ended or 'no state yet'}: call recover()", counters)
    if state.back > 0.0:
        text = f"the controller's clock went back by {state.back:.3g} s: it was restarted"
        return Health("lost", f"{text}: call recover()", counters)
    silent = (
        f"the controller sends {state.wrong}" if state.wrong
        else "the controller is silent or repeats itself"
    )  # fmt: skip
    link = by_age(time.monotonic() - state.t, silent, counters)
    if not link.ok:
        return link
    trouble = problem(state)
    if trouble is not None:
        return Health(*trouble, counters)
    if control is None:
        return link
    halted, ours = state.halts > control.halts, "the robot's program"
    rules: tuple[tuple[bool, State, str], ...] = (
        (bool(control.gone), "lost", f"{control.gone}; the robot's watchdog stops it"),
        (control.silent > GONE_S, "lost", f"the control process hangs for {control.silent:.1f} s"),
        (int(state.runtime) != PLAYING, "stopped", f"{ours} is {program(state)}"),
        (halted, "stopped", f"{ours} was stopped, and another one plays"),
        (control.ended, "stopped", f"{ours} did not take what it was sent"),
    )
    for holds, kind, text in rules:
        if holds:
            return Health(kind, f"{text}: call recover()", counters)
    return link


def request(host: str, command: str, timeout: float = 1.0) -> str:
    """Send one command to the robot's dashboard server and return its answer; a `LinkError` if none
    comes within ``timeout`` [s]."""
    try:
        with connected(host, PORT, timeout) as link:
            _line(link, time.monotonic() + timeout)  # its welcome
            link.sendall(command.encode() + b"\n")
            answer = _line(link, time.monotonic() + timeout)
    except OSError as error:
        why = error.strerror or str(error)
        raise LinkError(f"dashboard of {host}: no answer to {command!r}: {why}") from error
    return answer.decode(errors="replace").strip()


def _line(link: socket.socket, end: float) -> bytes:
    """Receive a line of text, complete by ``end`` (`time.monotonic`, [s])."""
    line = b""
    while not line.endswith(b"\n"):
        link.settimeout(max(end - time.monotonic(), 1e-3))
        part = link.recv(_LONGEST)
        if not part or len(line) > _LONGEST:
            raise ConnectionResetError("the connection was closed, or sends no line")
        line += part
        if time.monotonic() > end:
            raise TimeoutError("timed out")
    return line


def _done(host: str, command: str, done: Callable[[], bool], seconds: float, trouble: str) -> None:
    """Send a command to a UR's dashboard server and wait for ``done``; after ``seconds`` raise
    `StoppedError`, whose text begins with ``trouble``."""
    answer = request(host, command)
    if not wait_until(done, seconds):
        raise StoppedError(f"{trouble}, the dashboard says {answer!r}")


def clear(host: str, look: Look) -> None:
    """Unlock a protective stop and stop any program by a UR's dashboard server; ``look`` reads the
    state. Raises a `StoppedError`, which says what to do, if that fails, a `LinkError` if the
    server is silent."""
    state, trouble = look(), problem(look())
    if safety(state) == "protective stop":
        time.sleep(max(0.0, state.protective + UNLOCK_AFTER_S - time.monotonic()))
        request(host, "close safety popup")
        _done(
            host, "unlock protective stop", lambda: problem(look()) is None, _CLEARED_S,
            "the protective stop is not cleared",
        )  # fmt: skip
    elif trouble is not None and safety(state) not in HARMLESS:
        raise StoppedError(f"cannot be cleared from here: {trouble[1]}")
    if int(look().runtime) != STOPPED:
        _done(
            host, "stop", lambda: int(look().runtime) == STOPPED, _STOPPED_S,
            "the robot's program does not stop",
        )  # fmt: skip


def switch_on(host: str, look: Look) -> None:
    """Power the robot on and release its brakes by a UR's dashboard server; ``look`` reads the
    state. Raises a `StoppedError` if the robot does not come up in time, a `LinkError` if the
    server is silent."""
    if int(look().mode) not in (IDLE, RUNNING):
        up = (lambda: int(look().mode) in (IDLE, RUNNING), _POWER_S)
        _done(host, "power on", *up, "the robot does not power on")
    if int(look().mode) == IDLE:
        released = (lambda: int(look().mode) == RUNNING, _BRAKES_S)
        _done(host, "brake release", *released, "the brakes are not released")


def halt(host: str, timeout: float) -> str:
    """Stop a UR's program by its dashboard server; "" if confirmed in ``timeout`` [s], else why."""
    try:
        answer = request(host, "stop", timeout)
    except LinkError as error:
        return str(error)
    return "" if answer.lower().startswith("stopp") else f"the dashboard says {answer!r}"
