"""One fault of a robot: where it acts, its true numbers, and how a list of faults makes a robot.

Draws of faults register themselves with `drawn`, each in the file of its family. Ranges of the
random draws that many faults share are estimates.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Concatenate, ParamSpec

import numpy as np

from wrenchbed.benchmark.frame import Rng, RowChange
from wrenchbed.benchmark.referee.machine import Mechanics, Ride
from wrenchbed.benchmark.referee.scenario import RefereeSetting

P = ParamSpec("P")
CHANNEL = "[ft][xyz]"
"""Pattern of a channel's name."""
Change = Callable[[Ride, np.ndarray], np.ndarray]
"""Makes another signal (T, 6) [N, N·m] of one, over the instants of a ride."""
RowFault = RowChange[Callable[[np.ndarray], np.ndarray]]
"""Change of single rows; it shakes the base by accelerations (n, 3) at times (n,) [s], world axes
[m/s²]."""


def sign(rng: Rng) -> float:
    """Random sign: −1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


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
class RefereeFault:
    """Fault of the referee's robot.

    Attributes:
        true: its numbers as a diagnosis would publish them, SI.
        body: changes the machine; it has to ride anew.
        load: changes the load on the sensor.
        gauge: changes what the gauges make of it, in the order of ``stage``.
        clock: changes when it is read.
        rows: what happens between rows.
        name: the contract's name of the effect, or of the family outside.
        size: in multiples of typical.
    """

    true: Mapping[str, float] = field(default_factory=dict)
    body: Callable[[Mechanics], Mechanics] | None = None
    load: Change | None = None
    gauge: Change | None = None
    stage: int = 0
    clock: Change | None = None
    rows: RowFault | None = None
    name: str = ""
    size: float = 0.0


@dataclass(frozen=True)
class RefereeEffect:
    """Effect of the library with the rules by which it is drawn and compared.

    Attributes:
        draw: of a size in multiples of typical.
        motion: it shows only in motion.
        loops: only robots with closed loops have it.
        warm: only a recorded temperature shows it; without one it is a minor imperfection.
        between: only the scatter of rows shows it.
        adds: its numbers add up with those of minor imperfections of the same name.
        compared: names (a regular expression) of the numbers that mean the same to the referee and
            to the library. The moment of a jump is not compared: any moment between two poses is as
            true as another.
    """

    draw: Callable[[RefereeSetting, Rng, float], RefereeFault]
    motion: bool = False
    loops: bool = False
    warm: bool = False
    between: bool = False
    adds: bool = True
    compared: str = ""


DRAWN: dict[str, RefereeEffect] = {}
"""Every effect by name, in the order of the files' import."""
Draw = Callable[Concatenate[RefereeSetting, Rng, float, P], RefereeFault]


def drawn(name: str, **options: Any) -> Callable[[Draw[P]], Draw[P]]:
    """Register a function as the draw of an effect; what it draws gets the name and size.

    Args:
        options: fields of `RefereeEffect`.
    """

    def register(draw: Draw[P]) -> Draw[P]:
        named_draw = named(name, draw)
        DRAWN[name] = RefereeEffect(named_draw, **options)
        return named_draw

    return register


def named(name: str, draw: Draw[P]) -> Draw[P]:
    """Draw whose faults carry a name and their size."""

    def named_draw(
        setting: RefereeSetting, rng: Rng, size: float, /, *args: P.args, **options: P.kwargs
    ) -> RefereeFault:
        return replace(draw(setting, rng, size, *args, **options), name=name, size=size)

    return named_draw


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


def total(faults: Sequence[RefereeFault], name: str) -> dict[str, float]:
    """True numbers of an effect: the cause's and those of the minor imperfections beside it."""
    sums: dict[str, float] = {}
    for fault in faults:
        if fault.name == name:
            for key, value in fault.true.items():
                sums[key] = sums.get(key, 0.0) + value
    return sums
