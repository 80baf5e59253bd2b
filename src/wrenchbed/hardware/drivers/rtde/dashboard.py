"""What can be cleared on a UR robot from here, through its dashboard; nothing is ever resumed.

A protective stop only pauses the program: to play it again would go on with the interrupted move.
So the program is stopped instead, and a new one is sent by the next `activate`.

The robot's dashboard server: one text command a connection, with a deadline for all of it.

Universal Robots, "Dashboard server": TCP 29999, a line in, a line out, after a line of welcome.
"""

import socket
import time
from collections.abc import Callable

from wrenchbed.errors import LinkError, StoppedError
from wrenchbed.hardware.drivers.rtde import status
from wrenchbed.hardware.drivers.rtde.shared_state import Snapshot

PORT = 29999


def request(host: str, command: str, timeout: float = 1.0) -> str:
    """The answer to one command.

    Raises:
        LinkError: none came in time [s].
    """
    deadline = time.monotonic() + timeout
    try:
        with socket.create_connection((host, PORT), timeout) as link:
            rest = _line(link, b"", deadline)[1]
            link.sendall(command.encode() + b"\n")
            return _line(link, rest, deadline)[0].decode(errors="replace").strip()
    except OSError as error:
        why = error.strerror or str(error)
        raise LinkError(f"dashboard of {host}: no answer to {command!r}: {why}") from error


def _line(link: socket.socket, data: bytes, deadline: float) -> tuple[bytes, bytes]:
    while b"\n" not in data:
        left = deadline - time.monotonic()
        if left <= 0.0 or len(data) > 4096:
            raise TimeoutError("timed out")
        link.settimeout(left)
        part = link.recv(1024)
        if not part:
            raise ConnectionResetError("the connection was closed")
        data += part
    line, _, rest = data.partition(b"\n")
    return line, rest


UNLOCK_AFTER_S = 5.0
"""The controller refuses to unlock a protective stop earlier [s]."""
_CLEARED_S, _STOPPED_S = 3.0, 2.0
_POWER_S, _BRAKES_S = 15.0, 20.0
_POLL_S = 0.01
Look = Callable[[], Snapshot]


def clear(host: str, look: Look) -> None:
    """Unlock a protective stop and end whatever program is there.

    Raises:
        StoppedError: it cannot be cleared from here; says what to do.
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
        StoppedError: it goes on.
        LinkError: the dashboard does not answer.
    """
    if int(look().runtime) == status.STOPPED:
        return
    said = request(host, "stop")
    if not _until(lambda: int(look().runtime) == status.STOPPED, _STOPPED_S):
        raise StoppedError(f"the robot's program does not stop, the dashboard says {said!r}")


def switch_on(host: str, look: Look) -> None:
    """Power on and release the brakes.

    Raises:
        StoppedError: the robot does not come up in time.
        LinkError: the dashboard does not answer.
    """
    if int(look().mode) not in (5, status.RUNNING):
        request(host, "power on")
        if not _until(lambda: int(look().mode) in (5, status.RUNNING), _POWER_S):
            raise StoppedError(f"the robot does not power on: it is {status.mode(look())}")
    if int(look().mode) == 5:
        request(host, "brake release")
        if not _until(lambda: int(look().mode) == status.RUNNING, _BRAKES_S):
            raise StoppedError(f"the brakes are not released: the robot is {status.mode(look())}")


def _unlock(host: str, look: Look) -> None:
    state = look()
    time.sleep(max(0.0, state.protective + UNLOCK_AFTER_S + 0.1 - time.monotonic()))
    request(host, "close safety popup")
    said = request(host, "unlock protective stop")
    if not _until(lambda: status.problem(look()) is None, _CLEARED_S):
        raise StoppedError(f"the protective stop is not cleared, the dashboard says {said!r}")


def _until(done: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not done():
        if time.monotonic() > end:
            return False
        time.sleep(_POLL_S)
    return True


def halt(host: str, timeout: float) -> str:
    """Stop the program by the dashboard; empty when it answered that it did, else why not."""
    try:
        said = request(host, "stop", timeout)
    except LinkError as error:
        return str(error)
    return "" if said.lower().startswith("stopp") else f"the dashboard says {said!r}"
