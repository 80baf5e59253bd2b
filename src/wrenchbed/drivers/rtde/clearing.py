"""What can be cleared on a UR robot from here, through its dashboard; nothing is ever resumed.

A protective stop only pauses the program: to play it again would go on with the interrupted move.
So the program is stopped instead, and a new one is sent by the next `activate`.
"""

import time
from collections.abc import Callable

from wrenchbed.drivers.rtde import dashboard, words
from wrenchbed.drivers.rtde.record import Snapshot
from wrenchbed.errors import LinkError, StoppedError

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
    word = words.safety(state)
    if word == "protective stop":
        _unlock(host, look)
    elif word not in ("normal", "reduced"):
        trouble = words.trouble(state)
        raise StoppedError(f"cannot be cleared from here: {trouble[1] if trouble else word}")
    end_program(host, look)


def end_program(host: str, look: Look) -> None:
    """Stop the program that plays or is paused.

    Raises:
        StoppedError: it goes on.
        LinkError: the dashboard does not answer.
    """
    if int(look().runtime) == words.STOPPED:
        return
    said = dashboard.ask(host, "stop")
    if not _until(lambda: int(look().runtime) == words.STOPPED, _STOPPED_S):
        raise StoppedError(f"the robot's program does not stop, the dashboard says {said!r}")


def switch_on(host: str, look: Look) -> None:
    """Power on and release the brakes.

    Raises:
        StoppedError: the robot does not come up in time.
        LinkError: the dashboard does not answer.
    """
    if int(look().mode) not in (5, words.RUNNING):
        dashboard.ask(host, "power on")
        if not _until(lambda: int(look().mode) in (5, words.RUNNING), _POWER_S):
            raise StoppedError(f"the robot does not power on: it is {words.mode(look())}")
    if int(look().mode) == 5:
        dashboard.ask(host, "brake release")
        if not _until(lambda: int(look().mode) == words.RUNNING, _BRAKES_S):
            raise StoppedError(f"the brakes are not released: the robot is {words.mode(look())}")


def _unlock(host: str, look: Look) -> None:
    state = look()
    time.sleep(max(0.0, state.protective + UNLOCK_AFTER_S + 0.1 - time.monotonic()))
    dashboard.ask(host, "close safety popup")
    said = dashboard.ask(host, "unlock protective stop")
    if not _until(lambda: words.trouble(look()) is None, _CLEARED_S):
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
        said = dashboard.ask(host, "stop", timeout)
    except LinkError as error:
        return str(error)
    return "" if said.lower().startswith("stopp") else f"the dashboard says {said!r}"
