"""The two worker processes of one robot: opened with retries inside a deadline, and renewed."""

import time
from typing import Any

from wrenchbed.drivers.rtde.options import Options
from wrenchbed.drivers.rtde.process import Worker
from wrenchbed.drivers.rtde.pulse import Pulse
from wrenchbed.drivers.rtde.record import Shared
from wrenchbed.drivers.rtde.wire import Message
from wrenchbed.errors import DriverError, LinkError, StoppedError
from wrenchbed.health import STALE_S

_FIRST_PAUSE_S = 0.1
_POLL_S = 0.005
_FRESH_S = 1.0
_LEAST_S = 1.0
_LOOK = "check --host, power, cable, and that nothing blocks TCP 30004"
"""Time that another attempt must have [s]."""
_REFUSALS: tuple[tuple[str, type[DriverError], str, bool], ...] = (
    ("already in use", DriverError, "another client controls this robot: close it", True),
    (
        "remote control",
        StoppedError,
        "the robot is in local control: switch it to remote control at its pendant",
        False,
    ),
    (
        "start control script",
        StoppedError,
        "the robot does not start the program that it was sent: look at its pendant",
        False,
    ),
)
"""What a worker says, the error that it is, what it means, and whether it may pass."""


class Links:
    """Shared memory, heartbeat, state worker; makes control workers."""

    def __init__(self, options: Options) -> None:
        self.shared = Shared.create()
        self.restarts = 0
        self._options = options
        self._pulse = Pulse(self.shared)
        self._state: Worker | None = None

    def open_state(self) -> None:
        """Start receiving states.

        Raises:
            LinkError: the robot cannot be reached within the deadline.
            DriverError: it answers what cannot be used.
        """
        begun = time.monotonic()
        self._state = self._open("state", {})
        end = time.monotonic() + _FRESH_S
        while (state := self.shared.read()) is None or state.t < begun:
            gone = self._state.gone()
            if gone or time.monotonic() > end:
                raise LinkError(gone or f"{self._options.host}: the controller sends no states")
            time.sleep(_POLL_S)

    def renew_state(self) -> None:
        """A new state worker, where the present one gives no fresh states.

        Raises:
            LinkError: the robot cannot be reached within the deadline.
            DriverError: it answers what cannot be used.
        """
        state = self.shared.read()
        silent = state is None or time.monotonic() - state.t > STALE_S or state.back > 0.0
        if not silent and not self.state_gone():
            return
        if self._state is not None:
            self._state.kill()
        self.restarts += 1
        self.open_state()

    def state_gone(self) -> str:
        """Why the state worker is gone; empty while it lives."""
        return self._state.gone() if self._state else "the state worker was not started"

    def open_control(self) -> Worker:
        """A worker that controls the robot, with the robot's watchdog on.

        Raises:
            StoppedError: the robot does not take a program.
            DriverError: someone else controls it.
            LinkError: it cannot be reached within the deadline.
        """
        state = self.shared.read()
        native = 500.0 if state is not None and state.major > 3 else 125.0
        period = 1.0 / (self._options.frequency or native)
        more = {"watchdog_hz": self._options.watchdog_hz, "period": period}
        return self._open("control", more)

    def close(self) -> None:
        """End the state worker; may be called twice."""
        if self._state is not None:
            self._state.kill()
        self._state = None
        self._pulse.stop()
        self.shared.close()

    def _open(self, kind: str, more: dict[str, Any]) -> Worker:
        options = self._options
        setting = {
            "host": options.host, "frequency": options.frequency,
            "alarm": int(options.connect_s) + 2,
        }  # fmt: skip
        deadline, pause = time.monotonic() + options.connect_s, _FIRST_PAUSE_S
        found: DriverError | None = None
        for _ in range(options.attempts):
            worker = Worker(kind, setting | more, self.shared)
            try:
                event = worker.wait_ready(deadline)
                if event.get("event") == "ready":
                    return worker
                found, passes = _refusal(kind, event)
            except LinkError as error:
                found, passes = found or error, True
            except BaseException:
                worker.kill()
                raise
            worker.kill()
            if not passes or time.monotonic() + pause + _LEAST_S > deadline:
                break
            time.sleep(pause)
            pause *= 2.0
        if isinstance(found, LinkError):
            raise LinkError(f"robot at {options.host}: {found}: {_LOOK}") from found
        raise type(found)(f"robot at {options.host}: {found}") if found else LinkError("not tried")


def _refusal(kind: str, event: Message) -> tuple[DriverError, bool]:
    """Why a worker ended, and whether another attempt may help."""
    why = str(event.get("why", ""))
    for sign, error, meaning, passes in _REFUSALS:
        if sign in why:
            return error(meaning), passes
    if kind == "state" and event.get("event") == "failed":
        return DriverError(why), False
    return LinkError(why), True
