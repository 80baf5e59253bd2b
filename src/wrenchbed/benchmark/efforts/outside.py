"""Families that no effect of the library is: the right answer to them is ``unknown``.

Sizes and shapes are estimates.
"""

from collections.abc import Callable

import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts.faults import Maker, _log, only
from wrenchbed.benchmark.efforts.path import Path, of_values
from wrenchbed.benchmark.efforts.world import EffortFault, EffortSetting, State

OUTSIDE: dict[str, Maker] = {}
"""Makers by the family's name; the joint is 0-based."""


def outside(name: str) -> Callable[[Maker], Maker]:
    """Register a maker of a family outside the library."""

    def register(maker: Maker) -> Maker:
        OUTSIDE[name] = maker
        return maker

    return register


def _episodes(t: np.ndarray, rng: np.random.Generator, count: int, share: float) -> np.ndarray:
    """1 during ``count`` stretches, 0 elsewhere (T,), with edges of 50 ms."""
    found, length = np.zeros_like(t), share * t[-1] / count
    for k in range(count):
        start = (k + rng.uniform(0.1, 0.9 - share)) * t[-1] / count
        found = np.maximum(found, np.clip(np.minimum(t - start, start + length - t) / 0.05, 0, 1))
    return found


@outside("clipped effort")
def _clipped(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    share = rng.uniform(0.35, 0.75)

    def reading(_: State, effort: np.ndarray) -> np.ndarray:
        found = effort.copy()
        column = found[:, joint]
        limit = share * np.abs(column - np.median(column)).max()
        found[:, joint] = np.clip(column, np.median(column) - limit, np.median(column) + limit)
        return found

    return EffortFault("clipped effort", joint + 1, {"share": share}, reading=reading)


@outside("dragging brake")
def _brake(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    drag = _log(rng, 1.0, 4.0) * setting.drives.coulomb[joint]
    on = _episodes(setting.path.t, rng, int(rng.integers(2, 5)), rng.uniform(0.2, 0.4))
    return EffortFault("dragging brake", joint + 1, {"drag": drag},
                       level=lambda state: only(state, joint, drag * on))  # fmt: skip


@outside("slipping belt")
def _belt(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Stick-slip: under load the belt creeps and catches, a sawtooth that grows with torque."""
    size, hertz = _log(rng, 0.3, 1.5), rng.uniform(1.5, 6.0)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        found, column = effort.copy(), effort[:, joint]
        over = np.maximum(np.abs(column) - np.quantile(np.abs(column), 0.5), 0.0)
        phase = np.cumsum(hertz * (0.5 + over / (over.max() + 1e-9))) * state.path.step
        found[:, joint] = column - size * np.sign(column) * over * signal.sawtooth(
            2.0 * np.pi * phase
        )
        return found

    return EffortFault("slipping belt", joint + 1, {"size": size}, reading=reading)


@outside("loose tooth")
def _tooth(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """A damaged tooth hits once per turn of an intermediate wheel and rings."""
    size, wheel = _log(rng, 0.08, 0.4) * setting.rated[joint], rng.uniform(5.0, 12.0)
    hertz, damping = rng.uniform(6.0, 15.0), rng.uniform(0.05, 0.15)

    def torque(state: State) -> np.ndarray:
        turn = np.floor(wheel * state.path.q[:, joint] / (2.0 * np.pi) + 0.3)
        hits = np.diff(turn, prepend=turn[:1])
        w, t = 2.0 * np.pi * hertz, state.path.t[state.path.t < 1.0]
        ring = np.exp(-damping * w * t) * np.sin(w * t)
        return only(state, joint, size * np.convolve(hits, ring)[: len(hits)])

    return EffortFault("loose tooth", joint + 1, {"size": size}, torque=torque)


@outside("external push")
def _push(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """Someone leans on the arm now and then."""
    on = _episodes(setting.path.t, rng, int(rng.integers(2, 5)), rng.uniform(0.15, 0.35))
    smooth = signal.windows.hann(int(0.4 / setting.path.step))
    on = np.convolve(on, smooth / smooth.sum(), mode="same")
    force = rng.normal(size=3)
    force *= _log(rng, 2.0, 20.0) / np.linalg.norm(force)
    link = len(setting.rated) - 1
    far = 50.0  # [m]: the slope of a line so long is a force of one direction, by definition

    def torque(state: State) -> np.ndarray:
        size = float(np.linalg.norm(force))
        anchor = far * force / size
        slope = state.arm.pulled(state.path, link, np.zeros(3), anchor)[:, 1:]
        return np.asarray(size * on[:, None] * slope)

    return EffortFault("external push", None, {"force": float(np.linalg.norm(force))},
                       torque=torque)  # fmt: skip


@outside("held samples")
def _held(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """The bus repeats old efforts of all joints for a while."""
    seconds, each = rng.uniform(0.3, 1.0), rng.uniform(1.5, 4.0)
    seed = int(rng.integers(2**31))

    def rows(effort: np.ndarray) -> np.ndarray:
        draw, found = np.random.default_rng(seed), effort.copy()
        at = 0
        while True:
            at += int(draw.uniform(0.5, 1.5) * each * setting.path.rate)
            end = at + int(draw.uniform(0.7, 1.3) * seconds * setting.path.rate)
            if end >= len(found):
                return found
            found[at:end] = found[at]
            at = end

    return EffortFault("held samples", None, {"seconds": seconds}, rows=rows)


@outside("swapped channels")
def _swapped(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    joints = len(setting.rated)
    other = joint + 1 if joint + 1 < joints else joint - 1
    start, length = rng.uniform(0.1, 0.5), rng.uniform(0.15, 0.4)

    def rows(effort: np.ndarray) -> np.ndarray:
        found = effort.copy()
        part = slice(int(start * len(found)), int((start + length) * len(found)))
        found[part, joint], found[part, other] = effort[part, other], effort[part, joint]
        return found

    return EffortFault("swapped channels", joint + 1, {"length": length}, rows=rows)


@outside("thermal derating")
def _derating(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """The amplifier folds back its gain in steps as its heat sink fills, and recovers."""
    lost, memory = _log(rng, 0.15, 0.5), rng.uniform(5.0, 12.0)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        found, share = effort.copy(), state.path.step / memory
        heat = signal.lfilter([share], [1.0, share - 1.0], found[:, joint] ** 2)
        late = heat[int(memory / state.path.step) :]
        high, low = np.quantile(late, 0.65), np.quantile(late, 0.35)
        on, folded = np.empty(len(heat)), 0.0
        for k, h in enumerate(heat.tolist()):
            folded = 1.0 if h > high else 0.0 if h < low else folded
            on[k] = folded
        found[:, joint] *= 1.0 - lost * on
        return found

    return EffortFault("thermal derating", joint + 1, {"lost": lost}, reading=reading)


@outside("encoder eccentricity")
def _eccentric(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """The joint is not where its encoder says, by a wave of its angle."""
    size, order = np.radians(_log(rng, 0.5, 4.0)), int(rng.integers(3, 9))
    phase = rng.uniform(0.0, 2.0 * np.pi)

    def motion(path: Path) -> Path:
        q = path.q.copy()
        q[:, joint] += size * np.sin(order * q[:, joint] + phase)
        return of_values(path.kind, path.rate, path.t, q)

    return EffortFault("encoder eccentricity", joint + 1, {"size": float(size)}, motion=motion)


@outside("supply sag")
def _sag(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """All drives lose gain while together they draw much power."""
    lost = _log(rng, 0.1, 0.5)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        power = np.abs(effort * state.path.qd * setting.scale).sum(axis=1)
        drawn = np.clip(power / np.quantile(power, 0.9), 0.0, 1.5)
        sections = signal.butter(2, 2.0, fs=1.0 / state.path.step, output="sos")
        dip = lost * np.clip(signal.sosfiltfilt(sections, drawn) - 0.3, 0.0, 1.0)
        return np.asarray(effort * (1.0 - dip)[:, None])

    return EffortFault("supply sag", None, {"lost": lost}, reading=reading)


@outside("flexible joint")
def _flexible(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """A gear's spring rings after each change of its load."""
    hertz, damping = rng.uniform(4.0, 14.0), rng.uniform(0.01, 0.05)
    size = _log(rng, 0.3, 3.0)

    def torque(state: State) -> np.ndarray:
        w = 2.0 * np.pi * hertz
        turned = state.drives.coulomb[joint] * np.tanh(state.path.qd[:, joint] / 0.01)
        jolt = state.rigid[:, joint] + turned
        b, a = signal.bilinear([1.0, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w],
                               fs=1.0 / state.path.step)  # fmt: skip
        kicked = signal.lfilter(b, a, jolt - jolt[0])
        return only(state, joint, size * kicked)

    return EffortFault("flexible joint", joint + 1, {"hz": hertz}, torque=torque)


@outside("jumping zero")
def _jumping(setting: EffortSetting, joint: int, rng: np.random.Generator) -> EffortFault:
    """The current sensor's zero hops between levels, as a bad contact makes it."""
    size, seed = _log(rng, 0.01, 0.08) * setting.rated[joint], int(rng.integers(2**31))

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        draw, found = np.random.default_rng(seed), effort.copy()
        edges = np.cumsum(draw.exponential(2.5, 200))
        level = draw.choice((-1.0, 0.0, 1.0), 201)[np.searchsorted(edges, state.path.t)]
        found[:, joint] += size * level / setting.scale[joint]
        return found

    return EffortFault("jumping zero", joint + 1, {"size": size}, reading=reading)
