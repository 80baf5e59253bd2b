"""Faults of efforts that no effect of the library describes: the right answer is ``unknown``.

Every public function draws the family of its name at a 0-based joint. Sizes are estimates.
"""

import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts.arm import Path, of_values
from wrenchbed.benchmark.efforts.drives import EffortFault, EffortSetting, State, direction, vector
from wrenchbed.benchmark.fault import Rng, log_uniform

_FAR = 50.0
"""Length [m] of a line that pulls: its force has one direction all over the workspace."""


def _episodes(t: np.ndarray, rng: Rng, count: int, share: float) -> np.ndarray:
    """Signal (T,): 1 in ``count`` stretches, a ``share`` of all time together, else 0."""
    on, length = np.zeros_like(t), share * t[-1] / count
    for k in range(count):
        start = (k + rng.uniform(0.1, 0.9 - share)) * t[-1] / count
        on = np.maximum(on, np.clip(np.minimum(t - start, start + length - t) / 0.05, 0, 1))
    return on


def clipped_effort(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    share = rng.uniform(0.35, 0.75)

    def reading(_: State, effort: np.ndarray) -> np.ndarray:
        middle = np.median(effort)
        limit = share * np.abs(effort - middle).max()
        return np.clip(effort, middle - limit, middle + limit)

    return EffortFault({"share": share}, joint, reading=reading)


def dragging_brake(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    drag = log_uniform(rng, 1.0, 4.0) * setting.drives.coulomb[joint]
    on = _episodes(setting.path.t, rng, int(rng.integers(2, 5)), rng.uniform(0.2, 0.4))
    return EffortFault({"drag": drag}, joint, level=lambda state: drag * on)


def slipping_belt(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): a belt that creeps and catches: a sawtooth of torque."""
    size, hertz = log_uniform(rng, 0.3, 1.5), rng.uniform(1.5, 6.0)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        over = np.maximum(np.abs(effort) - np.quantile(np.abs(effort), 0.5), 0.0)
        phase = np.cumsum(hertz * (0.5 + over / (over.max() + 1e-9))) * state.path.step
        slip = signal.sawtooth(2.0 * np.pi * phase)
        return np.asarray(effort - size * np.sign(effort) * over * slip)

    return EffortFault({"size": size}, joint, reading=reading)


def loose_tooth(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): a damaged tooth hits once a wheel's turn, and rings."""
    size, wheel = log_uniform(rng, 0.08, 0.4) * setting.rated[joint], rng.uniform(5.0, 12.0)
    hertz, damping = rng.uniform(6.0, 15.0), rng.uniform(0.05, 0.15)

    def torque(state: State) -> np.ndarray:
        turn = np.floor(wheel * state.q / (2.0 * np.pi) + 0.3)
        hits = np.diff(turn, prepend=turn[:1])
        w, t = 2.0 * np.pi * hertz, state.path.t[state.path.t < 1.0]
        ring = np.exp(-damping * w * t) * np.sin(w * t)
        return np.asarray(size * np.convolve(hits, ring)[: len(hits)])

    return EffortFault({"size": size}, joint, torque=torque)


def external_push(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault of all joints (``joint`` is not used): someone leans on the arm now and then."""
    on = _episodes(setting.path.t, rng, int(rng.integers(2, 5)), rng.uniform(0.15, 0.35))
    smooth = signal.windows.hann(int(0.4 / setting.path.step))
    on = np.convolve(on, smooth / smooth.sum(), mode="same")
    force = vector(rng, 2.0, 20.0)
    size = float(np.linalg.norm(force))

    def torque(state: State) -> np.ndarray:
        slopes = state.arm.pull_slopes(state.path, _FAR * force / size)
        return np.asarray(size * on[:, None] * slopes)

    return EffortFault({"force": size}, torque=torque)


def held_samples(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault of all joints (``joint`` is not used): the bus repeats old efforts at times."""
    seconds, each = rng.uniform(0.3, 1.0), rng.uniform(1.5, 4.0)
    seed = int(rng.integers(2**31))

    def rows(effort: np.ndarray) -> np.ndarray:
        draw, repeated = np.random.default_rng(seed), effort.copy()
        at = 0
        while True:
            at += int(draw.uniform(0.5, 1.5) * each * setting.path.rate)
            end = at + int(draw.uniform(0.7, 1.3) * seconds * setting.path.rate)
            if end >= len(repeated):
                return repeated
            repeated[at:end] = repeated[at]
            at = end

    return EffortFault({"seconds": seconds}, rows=rows)


def swapped_channels(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    other = joint + 1 if joint + 1 < len(setting.rated) else joint - 1
    start, length = rng.uniform(0.1, 0.5), rng.uniform(0.15, 0.4)

    def rows(effort: np.ndarray) -> np.ndarray:
        swapped, n = effort.copy(), len(effort)
        part = slice(int(start * n), int((start + length) * n))
        swapped[part, [joint, other]] = effort[part, [other, joint]]
        return swapped

    return EffortFault({"length": length}, joint, rows=rows)


def thermal_derating(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): an amplifier loses gain in steps as it heats."""
    lost, memory = log_uniform(rng, 0.15, 0.5), rng.uniform(5.0, 12.0)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        fraction = state.path.step / memory
        heat = signal.lfilter([fraction], [1.0, fraction - 1.0], effort**2)
        late = heat[int(memory / state.path.step) :]
        high, low = np.quantile(late, 0.65), np.quantile(late, 0.35)
        on, folded = np.empty(len(heat)), 0.0
        for k, h in enumerate(heat.tolist()):
            folded = 1.0 if h > high else 0.0 if h < low else folded
            on[k] = folded
        return np.asarray(effort * (1.0 - lost * on))

    return EffortFault({"lost": lost}, joint, reading=reading)


def encoder_eccentricity(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): an encoder whose error is a wave of the joint's angle."""
    size, order = np.radians(log_uniform(rng, 0.5, 4.0)), int(rng.integers(3, 9))
    phase = rng.uniform(0.0, 2.0 * np.pi)

    def motion(path: Path) -> Path:
        q = path.q.copy()
        q[:, joint] += size * np.sin(order * q[:, joint] + phase)
        return of_values(path.rate, path.t, q)

    return EffortFault({"size": float(size)}, joint, motion=motion)


def supply_sag(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault of all joints (``joint`` is not used): less gain while they draw much power."""
    lost = log_uniform(rng, 0.1, 0.5)

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        power = np.abs(effort * state.path.qd * setting.scale).sum(axis=1)
        drawn = np.clip(power / np.quantile(power, 0.9), 0.0, 1.5)
        sections = signal.butter(2, 2.0, fs=1.0 / state.path.step, output="sos")
        dip = lost * np.clip(signal.sosfiltfilt(sections, drawn) - 0.3, 0.0, 1.0)
        return np.asarray(effort * (1.0 - dip)[:, None])

    return EffortFault({"lost": lost}, reading=reading)


def flexible_joint(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): a gear's spring rings after each change of its load."""
    hertz, damping = rng.uniform(4.0, 14.0), rng.uniform(0.01, 0.05)
    size = log_uniform(rng, 0.3, 3.0)

    def torque(state: State) -> np.ndarray:
        w = 2.0 * np.pi * hertz
        jolt = state.load + state.coulomb * direction(state)
        b, a = signal.bilinear(
            [1.0, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w], fs=1.0 / state.path.step
        )
        return np.asarray(size * signal.lfilter(b, a, jolt - jolt[0]))

    return EffortFault({"hz": hertz}, joint, torque=torque)


def jumping_zero(setting: EffortSetting, joint: int, rng: Rng) -> EffortFault:
    """Draw a fault at a joint (from 0): its current sensor's zero hops between levels."""
    size, seed = log_uniform(rng, 0.01, 0.08) * setting.rated[joint], int(rng.integers(2**31))

    def reading(state: State, effort: np.ndarray) -> np.ndarray:
        draw = np.random.default_rng(seed)
        edges = np.cumsum(draw.exponential(2.5, 200))
        level = draw.choice((-1.0, 0.0, 1.0), 201)[np.searchsorted(edges, state.path.t)]
        return np.asarray(effort + size * level / setting.scale[joint])

    return EffortFault({"size": size}, joint, reading=reading)
