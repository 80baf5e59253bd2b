"""One fault of a robot: where it acts, its true numbers, and how a list of faults makes a robot.

Ranges of the random draws that many faults share are estimates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.benchmark.frame import Fault, Rng, RowChange, by_axis
from wrenchbed.benchmark.referee.machine import Mechanics, Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting

LOAD, GAIN, MIX, BEND, LOOP, CREEP, ZERO, CLOCK = range(8)
"""Order in which faults act: on the load, in the sensor, and on the time of its readings."""
Change = Callable[[Ride, np.ndarray], np.ndarray]
"""Makes another signal (T, 6) [N, N·m] of one, over the instants of a ride."""
RowFault = RowChange[Callable[[np.ndarray], np.ndarray]]
"""Change of single rows; it shakes the base by accelerations (n, 3) at times (n,) [s], world axes
[m/s²]."""


def about(rng: Rng, value: float, spread: float = 0.2) -> float:
    """Draw a log-normal value around ``value`` with a relative spread."""
    return float(value * np.exp(spread * np.clip(rng.standard_normal(), -2.0, 2.0)))


def direction(rng: Rng) -> np.ndarray:
    """Draw a unit vector (3,)."""
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def touched(rng: Rng) -> np.ndarray:
    """Draw weights (6,) of channels: one, two, three of a kind or all; the largest is ±1."""
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
        body: changes the mechanics, which are then simulated anew.
        change: changes the load on the sensor, what its gauges make of it, or when it is read.
        stage: at which it does.
        rows: what happens between rows.
        size: in multiples of typical.
    """

    body: Callable[[Mechanics], Mechanics] | None = None
    change: Change | None = None
    stage: int = 0
    rows: RowFault | None = None
    size: float = 0.0


def shifted(true: dict[str, float], shift: np.ndarray) -> RefereeFault:
    """Fault of a sensor's zero that shifts by (6,), or instant by instant by (T, 6) [N, N·m]."""
    return RefereeFault(true, change=lambda ride, y: y + shift, stage=ZERO)


def misshapen(
    setting: RefereeSetting, true: dict[str, float], errors: dict[str, float]
) -> RefereeFault:
    """Fault of the mechanics: errors of its parameters by name."""
    shift = np.zeros(len(setting.theta))
    for name, value in errors.items():
        shift[setting.robot.parameters.index(name)] = value
    return RefereeFault(true, lambda m: replace(m, theta=m.theta + shift))


def not_as_drawn(setting: RefereeSetting, errors: dict[str, float]) -> RefereeFault:
    """Fault of links whose parameters are off by name; no diagnosis publishes such numbers."""
    return misshapen(setting, {f"length.{k}": v for k, v in errors.items()}, errors)


def heavier(setting: RefereeSetting, error: float) -> RefereeFault:
    """Fault of a tool that is heavier than stated by ``error`` [kg]."""
    return RefereeFault({"mass": error}, lambda m: _loaded(setting, m, error, np.zeros(3)))


def off(setting: RefereeSetting, error: np.ndarray) -> RefereeFault:
    """Fault of a tool whose centre of gravity is off by (3,) [m]."""
    return RefereeFault(by_axis(error, "cog."), lambda m: _loaded(setting, m, 0.0, error))


def _loaded(setting: RefereeSetting, m: Mechanics, mass: float, cog: np.ndarray) -> Mechanics:
    """The machine with another mass [kg] and CoG (3,) [m] of its tool."""
    tool = setting.robot.tool(m.theta)
    centre = (np.asarray(tool.cog) + cog).tolist()
    theta = setting.robot.theta_of_tool(m.theta, float(tool.mass) + mass, centre)
    return replace(m, theta=theta)


def signal(ride: Ride, faults: Sequence[RefereeFault]) -> np.ndarray:
    """Sensor's reading at every instant (T, 6) [N, N·m], without noise and range."""
    y = ride.load
    for fault in sorted(faults, key=lambda f: f.stage):
        if fault.change is not None:
            y = fault.change(ride, y)
    return y
