"""Commands of a UR robot's dashboard server: power, brakes, stops; one command per connection.

A protective stop only pauses the program; playing it again would continue the interrupted move. So
the program is stopped instead, and the next `activate` sends a new one. Source of the protocol:
Universal Robots, "Dashboard server": TCP 29999; a line of welcome, a command line, an answer line.
"""

import socket
import time
from collections.abc import Callable

from wrenchbed.errors import LinkError, StoppedError
from wrenchbed.hardware.device import wait_until
from wrenchbed.hardware.drivers.rtde import status
from wrenchbed.hardware.drivers.rtde.shared_state import Snapshot

PORT = 29999
"""TCP port; source: Universal Robots, "Dashboard server"."""
UNLOCK_AFTER_S = 5.1
"""The controller refuses to unlock a protective stop within 5 s [s]; source: Universal Robots,
"Dashboard server"; 0.1 s more, since states arrive late."""
IDLE = 5
"""``robot_mode`` with power and closed brakes; source: Universal Robots, RTDE guide."""
_LONGEST, _CHUNK = 4096, 1024
"""Bytes of the longest answer, which is a line, and bytes read at once."""
_CLEARED_S, _STOPPED_S = 3.0, 2.0
_POWER_S, _BRAKES_S = 15.0, 20.0
"""Deadlines: stop cleared, program ended; power on, for which an arm boots; brakes released, one by
one [s]."""
Look = Callable[[], Snapshot]


def request(host: str, command: str, timeout: float = 1.0) -> str:
    """The answer to one command.

    Raises:
        LinkError: none came in time [s].
    """
    deadline = time.monotonic() + timeout
    try:
        with socket.create_connection((host, PORT), timeout) as link:
            after_welcome = _line(link, b"", deadline)[1]
            link.sendall(command.encode() + b"\n")
            return _line(link, after_welcome, deadline)[0].decode(errors="replace").strip()
    except OSError as error:
        why = error.strerror or str(error)
        raise LinkError(f"dashboard of {host}: no answer to {command!r}: {why}") from error


def _line(link: socket.socket, data: bytes, deadline: float) -> tuple[bytes, bytes]:
    while b"\n" not in data:
        remaining = deadline - time.monotonic()
        if remaining <= 0.0 or len(data) > _LONGEST:
            raise TimeoutError("timed out")
        link.settimeout(remaining)
        part = link.recv(_CHUNK)
        if not part:
            raise ConnectionResetError("the connection was closed")
        data += part
    line, _, following = data.partition(b"\n")
    return line, following


def clear(host: str, look: Look) -> None:
    """Unlock a protective stop and end any program.

    Raises:
        StoppedError: it cannot be cleared from here; the message says what to do.
        LinkError: the dashboard does not answer.
    """
    state = look()
    word = status.safety(state)
    if word == "protective stop":
        _unlock(host, look)
    elif word not in ("normal", "reduced"):
        trouble = status.problem(state)
        raise StoppedError(f"cannot be cleared from here: {trouble[1] if trouble else word}")
    end_program(host, look)


def end_program(host: str, look: Look) -> None:
    """Stop the program that plays or is paused.

    Raises:
        StoppedError: it still runs.
        LinkError: the dashboard does not answer.
    """
    if int(look().runtime) == status.STOPPED:
        return
    answer = request(host, "stop")
    if not wait_until(lambda: int(look().runtime) == status.STOPPED, _STOPPED_S):
        raise StoppedError(f"the robot's program does not stop, the dashboard says {answer!r}")


def switch_on(host: str, look: Look) -> None:
    """Power on and release the brakes.

    Raises:
        StoppedError: the robot does not come up in time.
        LinkError: the dashboard does not answer.
    """
    if int(look().mode) not in (IDLE, status.RUNNING):
        request(host, "power on")
        if not wait_until(lambda: int(look().mode) in (IDLE, status.RUNNING), _POWER_S):
            raise StoppedError(f"the robot does not power on: it is {status.mode(look())}")
    if int(look().mode) == IDLE:
        request(host, "brake release")
        if not wait_until(lambda: int(look().mode) == status.RUNNING, _BRAKES_S):
            raise StoppedError(f"the brakes are not released: the robot is {status.mode(look())}")


def _unlock(host: str, look: Look) -> None:
    state = look()
    time.sleep(max(0.0, state.protective + UNLOCK_AFTER_S - time.monotonic()))
    request(host, "close safety popup")
    answer = request(host, "unlock protective stop")
    if not wait_until(lambda: status.problem(look()) is None, _CLEARED_S):
        raise StoppedError(f"the protective stop is not cleared, the dashboard says {answer!r}")


def halt(host: str, timeout: float) -> str:
    """Stop the program; empty when the dashboard confirms it, else the reason."""
    try:
        answer = request(host, "stop", timeout)
    except LinkError as error:
        return str(error)
    return "" if answer.lower().startswith("stopp") else f"the dashboard says {answer!r}"
