"""What the robot truly is, mechanically: numbers that a MuJoCo model is built from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

Drive = Callable[[np.ndarray], np.ndarray]
"""What gears and zeros add to reported joint values (T, J) [rad or m]."""


@dataclass(frozen=True)
class Play:
    """A gear with play: its whole width [rad] and the friction inside it [N·m]."""

    width: float
    friction: float


@dataclass(frozen=True, eq=False)
class Loose:
    """A part of the tool that slides between two stops.

    Attributes:
        share: of the tool's mass.
        axis: it slides along, sensor axes (3,).
        stop: half its way [m].
        stick: friction as a share of its weight.
    """

    share: float
    axis: np.ndarray
    stop: float
    stick: float


@dataclass(frozen=True, eq=False)
class Hose:
    """A hose from the world (3,) [m] to the tool (3,) [m]: a spring once it is taut."""

    hook: np.ndarray
    point: np.ndarray
    slack: float
    stiffness: float


@dataclass(frozen=True, eq=False)
class Pad:
    """A sprung pad in the way of the tool's end.

    Attributes:
        point: on its face at rest (3,) [m].
        normal: towards the robot (3,).
        stiffness: [N/m].
        friction: coefficient.
        tip: the tool's end in sensor axes (3,) [m].
        radius: of that end [m].
    """

    point: np.ndarray
    normal: np.ndarray
    stiffness: float
    friction: float
    tip: np.ndarray
    radius: float


@dataclass(frozen=True, eq=False)
class Mechanics:
    """The true machine.

    Attributes:
        theta: its geometry and load, the robot's own parameters (P,).
        gravity: in the axes of the nominal world (3,) [m/s²].
        give: compliance of each driven joint (J,) [rad/(N·m)], 0 for sliding ones.
        mass: factor on the mass of each body by name.
        drive: errors between reported joint values and where the drives are.
        play: of driven joints, by index.
        slack: radius of the play of a pin that closes a loop, by its name [m].
        lean: compliance of the base about two axes (2,) [rad/(N·m)].
        heading: of the first of these axes in the base's plane [rad].
        bend: compliance of the tool's root about x and y (2,) [rad/(N·m)].
        root: height of that root above the sensor's origin [m].
        turn: rotation vector of the sensor on its flange (3,) [rad].
    """

    theta: np.ndarray
    gravity: np.ndarray
    give: np.ndarray
    mass: Mapping[str, float] = field(default_factory=dict)
    drive: tuple[Drive, ...] = ()
    play: Mapping[int, Play] = field(default_factory=dict)
    slack: Mapping[str, float] = field(default_factory=dict)
    lean: np.ndarray = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    bend: np.ndarray = field(default_factory=lambda: np.zeros(2))
    root: float = 0.0
    turn: np.ndarray = field(default_factory=lambda: np.zeros(3))
    loose: Loose | None = None
    hose: Hose | None = None
    pad: Pad | None = None

    def driven(self, q: np.ndarray) -> np.ndarray:
        """Where the drives are (T, J) when the robot reports q (T, J)."""
        return np.asarray(q + sum((error(q) for error in self.drive), np.zeros_like(q)))
