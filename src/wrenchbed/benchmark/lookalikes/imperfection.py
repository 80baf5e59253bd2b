"""One imperfection of a robot: where it acts and how; and a robot that has several of them.

Draws and laws that several faults share are here too: channels, relays, Preisach's hysteresis,
lags, 1/f noise. Numbers without a source are estimates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_banded

from wrenchbed.benchmark.fault import Fault, Rng, RowChange, by_axis, by_channel
from wrenchbed.benchmark.lookalikes.experiment_design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.motion_loads import SensorMotion, load_wrench
from wrenchbed.physics.wrench import Tool

Act = Callable[[np.ndarray], np.ndarray]
"""Function that changes a wrench (N, 6) [N, N·m]."""


def relay(signal: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """State of relays along time (T, …): 1 above ``high``, −1 below ``low``, else as before.

    Before the first crossing the state is on the nearer side.
    """
    up, down = signal > high, signal < low
    instant = np.arange(len(signal)).reshape(-1, *[1] * (up.ndim - 1))
    last_up = np.maximum.accumulate(np.where(up, instant, -1), axis=0)
    last_down = np.maximum.accumulate(np.where(down, instant, -1), axis=0)
    initial = np.where(signal[:1] > 0.5 * (low + high), 1.0, -1.0)
    state = np.where(last_up > last_down, 1.0, -1.0)
    return np.asarray(np.where(last_up == last_down, initial, state))


def preisach(signal: np.ndarray, rng: Rng, reach: float, relays: int = 96) -> np.ndarray:
    """Hysteresis (T, C) of signals (T, C), about ±1 wide at its widest, without its linear part.

    Relays (centre, half width) are spread at random over the signal's range, with a mean half width
    of ``reach`` in units of half that range: the loop's shape differs from draw to draw.
    """
    low, high = signal.min(axis=0), signal.max(axis=0)
    middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, 1e-12)
    unit = (signal - middle) / half
    grid = np.linspace(-0.9, 0.9, relays)
    centre = grid[rng.permutation(relays)] + rng.normal(0.0, 0.03, relays)
    width = reach * rng.gamma(4.0, 0.25, relays)
    weight = rng.gamma(3.0, 1.0, relays) * (1.1 - np.abs(grid))
    state = relay(unit[..., None], centre - width, centre + width)
    offset = unit[..., None] - centre
    linear = np.sign(offset - width) + np.sign(offset + width)
    loop = (state - 0.5 * linear) @ (weight / weight.sum())
    return np.asarray(loop / max(1e-6, 2.0 * min(1.0, reach)))


def relax(t: np.ndarray, signal: np.ndarray, time: float) -> np.ndarray:
    """Signal (T, C) at times t (T,) [s] after a first-order lag of a time constant ``time`` [s]."""
    keep = np.exp(-np.diff(t) / time)
    bands = np.ones((2, len(t)))
    bands[1, :-1], bands[1, -1] = -keep, 0.0
    driven = signal.copy()
    driven[1:] *= (1.0 - keep)[:, None]
    return np.asarray(solve_banded((1, 0), bands, driven, check_finite=False))


def slow_noise(rng: Rng, rows: int, columns: int) -> np.ndarray:
    """Draw 1/f noise (rows, columns) of unit rms about a zero mean."""
    spectrum = np.fft.rfft(rng.standard_normal((max(rows, 4), columns)), axis=0)
    frequency = np.arange(len(spectrum), dtype=float)
    frequency[0] = np.inf
    wave = np.fft.irfft(spectrum / np.sqrt(frequency)[:, None], n=max(rows, 4), axis=0)[:rows]
    wave = wave - wave.mean(axis=0)
    return np.asarray(wave / np.maximum(wave.std(axis=0), 1e-12))


class Shaking(NamedTuple):
    """Wrench (N, 6) per unit of a shaking signal, and its frequency [Hz], 0 for broadband."""

    wrench: np.ndarray
    frequency: float


RowImperfection = RowChange[Shaking]
"""Change of single rows by an imperfection."""


@dataclass(frozen=True, eq=False)
class Imperfection(Fault):
    """One departure from the robot as stated; unused stages are None.

    ``joint`` changes the joint values (N, J) [rad or m], ``link`` the parameters (P,) or (N, P);
    ``base`` turns the robot in the world by rotation vectors (3,) or (N, 3), ``mount`` the sensor
    on its flange (3,) [rad]; ``tool`` changes the rigid load, ``load`` adds a wrench (N, 6), which
    ``sensor`` changes as gauges do, ``clock`` as timing does; ``rows`` changes the scatter of rows.
    """

    joint: np.ndarray | None = None
    link: np.ndarray | None = None
    base: np.ndarray | None = None
    mount: np.ndarray | None = None
    tool: Callable[[Tool, SensorMotion], Tool] | None = None
    load: Callable[[SensorMotion, Tool], np.ndarray] | None = None
    sensor: Act | None = None
    clock: Act | None = None
    rows: RowImperfection | None = None


Scaled = tuple[Imperfection, float]
"""An imperfection and how much of it is there: 1 is all."""


def spread(rng: Rng) -> float:
    """Draw a factor about 1 by which a requested size is varied (its range: estimate)."""
    return rng.uniform(0.8, 1.25)


def channels(rng: Rng, one: float = 0.6) -> np.ndarray:
    """Draw weights (6,) of either sign: of one channel (probability ``one``), three or all six."""
    kind = rng.uniform()
    chosen = np.zeros(6, dtype=bool)
    if kind < one:
        chosen[rng.integers(6)] = True
    elif kind < one + 0.2:
        chosen[slice(0, 3) if rng.uniform() < 0.5 else slice(3, 6)] = True
    else:
        chosen[:] = True
    weight = rng.uniform(0.5, 1.0, 6) * rng.choice([-1.0, 1.0], 6) * chosen
    return np.asarray(weight / np.abs(weight).max())


def heavier(error: float) -> Imperfection:
    """Fault of a tool that is heavier than stated by ``error`` [kg]."""
    return Imperfection({"mass": error}, tool=lambda load, _: replace(load, mass=load.mass + error))


def off(error: np.ndarray, true: dict[str, float] | None = None) -> Imperfection:
    """Fault of a tool's CoG off by (3,) or (N, 3) [m]; ``true`` numbers, else ``cog.x`` …."""
    known = by_axis(error, "cog.") if true is None else true
    return Imperfection(known, tool=lambda load, _: replace(load, cog=load.cog + error))


def biased(shift: np.ndarray, true: dict[str, float] | None = None) -> Imperfection:
    """Fault of a zero off by (6,) or (N, 6) [N, N·m]; ``true`` numbers, else ``bias.fx`` …."""
    known = by_channel(shift, "bias.") if true is None else true
    return Imperfection(known, sensor=lambda y: y + shift)


class ImperfectRobot:
    """Computes noise-free readings of one design with any imperfections.

    Poses of the sensor are cached for each set of imperfections of joints and links, by identity.
    """

    def __init__(self, design: ExperimentDesign) -> None:
        self.design = design
        self._motions: dict[tuple[Scaled, ...], SensorMotion] = {}

    def reading(self, items: Sequence[Scaled], *, clip: bool = True) -> np.ndarray:
        """Noise-free reading (N, 6) [N, N·m] with (imperfection, amount) items, clipped if
        ``clip``."""
        moving = [(i, k) for i, k in items if i.joint is not None or i.link is not None]
        motion = self._motion(moving)
        tilts = [k * i.base for i, k in items if i.base is not None]
        if tilts:
            motion = motion.tilted(sum(tilts, np.zeros(3)))
        for item, k in items:
            if item.mount is not None:
                motion = motion.mounted(k * item.mount)
        load = self.design.load
        for item, k in items:
            if item.tool is not None:
                new = item.tool(load, motion)
                pairs = zip(vars(load).values(), vars(new).values(), strict=True)
                load = new if k == 1.0 else Tool(*(a + k * (b - a) for a, b in pairs))
        y = load_wrench(motion, load)
        forces = [k * i.load(motion, load) for i, k in items if i.load is not None]
        y = sum(forces, y)
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

    def _motion(self, items: Sequence[Scaled]) -> SensorMotion:
        if not items:
            return self.design.motion
        key = tuple(items)
        if key not in self._motions:
            dq = sum((k * i.joint for i, k in items if i.joint is not None), np.zeros(()))
            changes = (k * i.link for i, k in items if i.link is not None)
            self._motions[key] = self.design.moved(dq, sum(changes, self.design.theta))
        return self._motions[key]


def held_rows(rows: int, stale: tuple[float, float], rng: Rng) -> np.ndarray:
    """Draw which row is read in place of each (N,): itself, or an earlier one that is repeated.
    ``stale`` is the chance that a repeat begins, and the mean number of rows that it lasts."""
    chance, length = stale
    fresh = np.ones(rows, dtype=bool)
    for start in np.flatnonzero(rng.uniform(size=rows) < chance):
        fresh[start : start + 1 + rng.poisson(max(length - 1.0, 0.0))] = False
    fresh[0] = True
    return np.maximum.accumulate(np.where(fresh, np.arange(rows), 0))
