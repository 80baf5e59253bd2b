"""One fault of a robot: where it acts, its true numbers, and how a list of faults makes a robot.

Ranges of the random draws that many faults share are estimates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.benchmark.frame import Fault, Rng, RowChange
from wrenchbed.benchmark.referee.machine import Mechanics, Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting

Change = Callable[[Ride, np.ndarray], np.ndarray]
"""Makes another signal (T, 6) [N, N·m] of one, over the instants of a ride."""
RowFault = RowChange[Callable[[np.ndarray], np.ndarray]]
"""Change of single rows; it shakes the base by accelerations (n, 3) at times (n,) [s], world axes
[m/s²]."""


def about(rng: Rng, value: float, spread: float = 0.2) -> float:
    """Random value around ``value``, log-normal with relative spread ``spread``."""
    return float(value * np.exp(spread * np.clip(rng.standard_normal(), -2.0, 2.0)))


def direction(rng: Rng) -> np.ndarray:
    """Random unit vector (3,)."""
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def touched(rng: Rng) -> np.ndarray:
    """Signed weights (6,) of channels: one, two, three of a kind or all; the largest is ±1."""
    few = int(rng.choice([1, 2, 3, 6], p=[0.45, 0.2, 0.15, 0.2]))
    chosen = np.zeros(6, dtype=bool)
    if few == 3:
        chosen[:3] = rng.uniform() < 0.5
        chosen[3:] = not chosen[0]
    else:
        chosen[rng.choice(6, few, replace=False)] = True
    weight = chosen * rng.uniform(0.4, 1.0, 6) * rng.choice([-1.0, 1.0], 6)
    return np.asarray(weight / np.abs(weight).max())


@dataclass(frozen=True, eq=False)
class RefereeFault(Fault):
    """Fault of the referee's robot; ``true`` has its numbers as a diagnosis publishes them, SI.

    Attributes:
        body: changes the machine; it has to ride anew.
        load: changes the load on the sensor.
        gauge: changes what the gauges make of it, in the order of ``stage``.
        clock: changes when it is read.
        rows: what happens between rows.
        size: in multiples of typical.
    """

    body: Callable[[Mechanics], Mechanics] | None = None
    load: Change | None = None
    gauge: Change | None = None
    stage: int = 0
    clock: Change | None = None
    rows: RowFault | None = None
    size: float = 0.0


Draw = Callable[[RefereeSetting, Rng, float], RefereeFault]
"""Draws a fault of a size in multiples of typical."""
DRAWS: dict[str, Callable[..., RefereeFault]] = {}
"""Draws of the library's effects by name; importing `body` and `sensor` fills it."""


def mechanics(start: Mechanics, faults: Sequence[RefereeFault]) -> Mechanics:
    """Machine with all faults of its body."""
    for fault in faults:
        if fault.body is not None:
            start = fault.body(start)
    return start


def signal(ride: Ride, faults: Sequence[RefereeFault]) -> np.ndarray:
    """Sensor's reading at every instant (T, 6) [N, N·m], without noise and range."""
    y = ride.load
    for fault in faults:
        if fault.load is not None:
            y = fault.load(ride, y)
    for fault in sorted(faults, key=lambda f: f.stage):
        if fault.gauge is not None:
            y = fault.gauge(ride, y)
    for fault in faults:
        if fault.clock is not None:
            y = fault.clock(ride, y)
    return y
