"""The compensated wrench while a driver reads: to callbacks, or by UDP.

Nothing here moves a robot: the driver is connected and never activated.
"""

import contextlib
import json
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.device_base import GONE_S
from wrenchbed.hardware.drivers.live_base import CALM_SPEED, LiveDriver
from wrenchbed.monitoring.compensation import Compensator, External

POLL_S = 2e-4
"""Interval at which a new reading is looked for [s]: a tenth of a period at 500 Hz."""
_KEPT = 1 << 20
"""Most latencies that are kept for the summary."""
Sink = Callable[[External], None]


@dataclass(frozen=True)
class LiveSummary:
    """Statistics of a run of `live`.

    Attributes:
        readings, seconds: number of readings, and duration [s].
        lost: readings that the sensor or the link lost.
        skipped: readings that came between two published ones and were left out.
        p50, p99: median and 99th percentile of the time from arrival to publication [s].
        rms: rms of the wrench at rest, per channel (6,) [N, N·m]; NaN where the robot never rested.
        alarms: number of alarms raised.
    """

    readings: int
    seconds: float
    lost: int
    skipped: int
    p50: float
    p99: float
    rms: tuple[float, ...]
    alarms: int


def live(
    driver: LiveDriver,
    compensate: Compensator,
    sinks: Sequence[Sink],
    *,
    rate: float = 1000.0,
    seconds: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> LiveSummary:
    """Publish the compensated readings of a driver that is only read, and return a summary.

    At most ``rate`` readings a second are published, for ``seconds`` or until ``stopped``.
    ``sinks`` are called with each result in this thread; they must not block.

    Raises:
        DriverError: the controller subtracts a payload from the wrench, which would be subtracted
            twice.
        LinkError: no new reading for a second.
    """
    stated = driver.metadata("static", 1.0).extra.get("wrench") or {}
    payload = (stated.get("payload") or {}).get("mass")
    if stated.get("compensated") and payload != 0.0:
        what = "its payload" if payload is None else f"a payload of {payload:g} kg"
        raise DriverError(
            f"the controller subtracts {what} from its wrench, and the tool would be subtracted "
            "twice: set payload 0 on the pendant, or use a Net F/T box (--sensor netft://HOST)"
        )
    begin = newest = due = time.monotonic()
    period, before = 1.0 / rate, _received(driver)
    count = lost = alarms = rests = 0
    squares, alarm = np.zeros(6), ""
    latency: deque[float] = deque(maxlen=_KEPT)
    while not stopped() and (seconds is None or time.monotonic() - begin < seconds):
        reading = driver.read_wrench()
        if reading.t <= due:
            if time.monotonic() - newest > GONE_S + period:
                health = driver.health()
                raise LinkError(health.detail or f"no new reading for {GONE_S:g} s")
            time.sleep(min(max(POLL_S, due - time.monotonic()), GONE_S))
            continue
        arm = driver.read()
        at_rest = bool(np.abs(arm.qd).max() < CALM_SPEED)
        external = compensate(reading.t - begin, arm.q, reading.wrench, at_rest)
        for sink in sinks:
            sink(external)
        latency.append(time.monotonic() - reading.t)
        count, lost = count + 1, reading.lost
        if at_rest and not external.alarm:
            squares, rests = squares + external.wrench**2, rests + 1
        alarms += bool(external.alarm) and not alarm
        alarm = external.alarm
        newest, due = reading.t, max(due + period, reading.t)
        time.sleep(min(max(0.0, due - time.monotonic()), GONE_S))
    rms = np.sqrt(squares / rests) if rests else np.full(6, np.nan)
    p50, p99 = map(float, np.quantile(list(latency) or [np.nan], (0.5, 0.99)))
    seconds, skipped = time.monotonic() - begin, max(0, _received(driver) - before - count)
    return LiveSummary(count, seconds, lost, skipped, p50, p99, tuple(map(float, rms)), alarms)


def _received(driver: LiveDriver) -> int:
    """Number of readings that the driver's sensor has received since it was connected."""
    return int(driver.health().counters["wrench readings"])


class Datagrams(AbstractContextManager["Datagrams"]):
    """Sink of `live` that sends each reading as JSON in a UDP datagram to HOST:PORT; a context
    manager. Raises a `ParameterError` if that is no HOST:PORT or there is no such host."""

    def __init__(self, address: str) -> None:
        host, colon, port = address.rpartition(":")
        if not colon or not host or not port.isdigit() or not 0 < int(port) < 1 << 16:
            raise ParameterError(f"--udp {address}: give HOST:PORT")
        try:
            self._target = socket.gethostbyname(host), int(port)
        except (OSError, UnicodeError) as error:
            text = f"--udp {address}: no such host, nothing is sent: {error}"
            raise ParameterError(text) from error
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def __call__(self, external: External) -> None:
        """Send a reading; it is lost if nobody listens or the buffer is full."""
        with contextlib.suppress(OSError):
            self._socket.sendto(json.dumps(external.to_json()).encode(), self._target)

    def __exit__(self, *_: object) -> None:
        self._socket.close()
