"""One imperfection of a robot: where it acts and how; a world that has several of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from wrenchbed.lookalikes.design import Design
from wrenchbed.lookalikes.rigid import Load, Motion, load_wrench

Act = Callable[[np.ndarray], np.ndarray]
"""Changes a wrench (N, 6) [N, N·m]."""


@dataclass(frozen=True, eq=False)
class Rows:
    """What happens to single rows, not to a hold's mean.

    Attributes:
        gain: factor on the noise per channel (6,).
        step: of the rounding per channel (6,), 0 does not round [N, N·m].
        shake: the wrench per unit of a shaking signal (N, 6) and its frequency [Hz], 0 is broad.
        stale: chance that a row starts a repeat of the one before, and mean length of it.
        limit: range that is read per channel (6,) [N, N·m].
    """

    gain: np.ndarray = field(default_factory=lambda: np.ones(6))
    step: np.ndarray = field(default_factory=lambda: np.zeros(6))
    shake: np.ndarray | None = None
    frequency: float = 0.0
    stale: tuple[float, float] = (0.0, 1.0)
    limit: np.ndarray = field(default_factory=lambda: np.full(6, np.inf))


@dataclass(frozen=True, eq=False)
class Imperfection:
    """One departure from the robot as stated; unused stages are None.

    Attributes:
        name: of the effect or of the family.
        values: its true parameters, SI.
        joint: change of the joint values (N, J) [rad or m].
        link: change of the robot's parameters (P,) or (N, P).
        base: rotation vector of the whole robot in the world (3,) or (N, 3) [rad].
        mount: rotation vector of the sensor on the flange (3,) [rad].
        tool: another load for this motion.
        load: a further load on the sensor (N, 6) for this motion.
        sensor: what the gauges make of the load.
        clock: what timing makes of the reading.
        rows: what happens between rows.
    """

    name: str
    values: Mapping[str, float]
    joint: np.ndarray | None = None
    link: np.ndarray | None = None
    base: np.ndarray | None = None
    mount: np.ndarray | None = None
    tool: Callable[[Load, Motion], Load] | None = None
    load: Callable[[Motion, Load], np.ndarray] | None = None
    sensor: Act | None = None
    clock: Act | None = None
    rows: Rows | None = None

    @property
    def moves(self) -> bool:
        """Whether the sensor stands elsewhere because of it, before tilt and mount."""
        return self.joint is not None or self.link is not None


Scaled = tuple[Imperfection, float]
"""An imperfection and how much of it is there: 1 is all."""


class World:
    """Evaluates noise-free readings of one design with any of its imperfections.

    The poses of one set of joint imperfections are computed once.
    """

    def __init__(self, design: Design) -> None:
        self.design = design
        self._motions: dict[tuple[tuple[int, float], ...], Motion] = {}
        self._alive: list[Imperfection] = []  # keys hold identities, which must not be reused

    def reading(self, items: Sequence[Scaled], *, clip: bool = True) -> np.ndarray:
        """Noise-free reading (N, 6) [N, N·m]; without range limits if not ``clip``."""
        motion = self._motion([(i, k) for i, k in items if i.moves])
        tilts = [k * i.base for i, k in items if i.base is not None]
        if tilts:
            motion = motion.tilted(sum(tilts, np.zeros(3)))
        for item, k in items:
            if item.mount is not None:
                motion = motion.mounted(k * item.mount)
        load = self.design.load
        for item, k in items:
            if item.tool is not None:
                load = _blend(load, item.tool(load, motion), k)
        y = load_wrench(motion, load)
        pushes = [k * i.load(motion, load) for i, k in items if i.load is not None]
        y = sum(pushes, y)
        for stage in ("sensor", "clock"):
            for item, k in items:
                act: Act | None = getattr(item, stage)
                if act is not None:
                    y = y + k * (act(y) - y)
        if clip:
            for item, _ in items:
                if item.rows is not None and np.isfinite(item.rows.limit).any():
                    y = np.clip(y, -item.rows.limit, item.rows.limit)
        return y

    def _motion(self, items: Sequence[Scaled]) -> Motion:
        if not items:
            return self.design.motion
        key = tuple((id(i), k) for i, k in items)
        if key not in self._motions:
            dq = np.zeros(0)
            theta = self.design.theta
            for item, k in items:
                if item.joint is not None:
                    dq = dq + k * item.joint if dq.size else k * item.joint
                if item.link is not None:
                    theta = theta + k * item.link
            self._alive += [item for item, _ in items]
            self._motions[key] = self.design.moved(dq, theta)
        return self._motions[key]


def _blend(old: Load, new: Load, k: float) -> Load:
    if k == 1.0:
        return new
    return Load(
        old.mass + k * (new.mass - old.mass),
        old.cog + k * (new.cog - old.cog),
        old.inertia + k * (new.inertia - old.inertia),
        old.sensor_mass + k * (new.sensor_mass - old.sensor_mass),
    )
