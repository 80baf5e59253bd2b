"""Faults in plain numpy, to be added to a real recording of one tool at rest or in motion.

Each draw returns a change of the wrench (N, 6), whose scale does not matter: `faulty` scales it to
the gap that is wanted. Noise, imperfections and design are the recording's own. No code is shared
with the effects, the look-alikes or the referee.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.data.metadata import ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.prepare_recording import prepare

CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")
LEVER = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
"""Typical torques for forces of 1 N [m]."""
STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Wrong stated numbers: all of them counts, not only what a calibration leaves."""


@dataclass(frozen=True, eq=False)
class Host:
    """A real recording with the rigid tool that fits it.

    Attributes:
        std: noise of a row (6,) [N, N·m].
        pull: gravity less acceleration in sensor axes (N, 3) [m/s²], which the force tells in
            motion.
        mass, cog: of the tool [kg], (3,) [m].
    """

    recording: Recording
    std: np.ndarray
    pull: np.ndarray
    mass: float
    cog: np.ndarray

    @classmethod
    def of(cls, recording: Recording) -> "Host":
        """Fit mass, centre of gravity and bias by linear least squares, with the stated noise."""
        scene = prepare(recording).scene
        pull = scene.gravity @ scene.robot.sensor_pose(recording.q, scene.theta)[0]
        std = np.asarray(recording.metadata.sensor.noise_std)
        white = (columns_of(pull) / std[:, None]).reshape(-1, 10)
        fit = np.linalg.lstsq(white, (recording.wrench / std).ravel(), rcond=None)[0]
        if recording.metadata.mode == "dynamic":
            pull = (recording.wrench[:, :3] - fit[:3]) / fit[6]
        return cls(recording, std, pull, float(fit[6]), fit[7:] / fit[6])

    @property
    def load(self) -> np.ndarray:
        """Weight of the tool (N, 6) [N, N·m]."""
        force = self.mass * self.pull
        return np.concatenate([force, np.cross(self.cog, force)], axis=1)

    @property
    def progress(self) -> np.ndarray:
        """Fraction of the run that is over at each row (N,)."""
        t = self.recording.t
        return (t - t[0]) / np.ptp(t)

    def gap(self, change: np.ndarray, configured: bool) -> float:
        """Mean square of a change (N, 6) over noise; bias, mass, CoG fitted if not configured."""
        x = (change / self.std).ravel()
        if not configured:
            basis = np.linalg.qr((columns_of(self.pull) / self.std[:, None]).reshape(-1, 10))[0]
            x = x - basis @ (basis.T @ x)
        return float(np.mean(x**2))

    def faulty(self, name: str, gap: float, rng: np.random.Generator) -> Recording:
        """The recording with a fault that adds a gap; mass and CoG are stated as they are."""
        change = (EFFECTS | OUTSIDE)[name](self, rng)
        change = np.sqrt(gap / self.gap(change, name in STATED)) * change
        wrench = self.recording.wrench + change
        columns = dict(self.recording.columns) | dict(zip(CHANNELS, wrench.T, strict=True))
        tool = ToolInfo(round(self.mass, 4), tuple(np.round(self.cog, 5).tolist()))
        return Recording(replace(self.recording.metadata, tool=tool), columns, name)


def columns_of(pull: np.ndarray) -> np.ndarray:
    """Wrenches (N, 6, 10) of a bias in each channel, of a kilogram, and of its moments."""
    zero = np.zeros_like(pull)
    columns = [np.broadcast_to(e, (len(pull), 6)) for e in np.eye(6)]
    columns.append(np.concatenate([pull, zero], axis=1))
    columns += [np.concatenate([zero, np.cross(e, pull)], axis=1) for e in np.eye(3)]
    return np.stack(columns, axis=-1)


def some(rng: np.random.Generator) -> np.ndarray:
    """Signed weights (6,) of one channel or of all [N, N·m]."""
    weight = rng.uniform(0.5, 1.0, 6) * rng.choice([-1.0, 1.0], 6) * LEVER
    return weight if rng.uniform() < 0.5 else weight * np.eye(6)[rng.integers(6)]


def crosstalk(host: Host, rng: np.random.Generator) -> np.ndarray:
    i, j = 3 * rng.integers(2, size=2)
    matrix = np.zeros((6, 6))
    matrix[i : i + 3, j : j + 3] = rng.standard_normal((3, 3)) * (1.0 - (i == j) * np.eye(3))
    return host.load @ matrix.T


def hysteresis(host: Host, rng: np.random.Generator) -> np.ndarray:
    """Ishlinskii's stops: each slides once its spring is bent by its reach (Visintin 1994)."""
    load = host.load / np.abs(host.load).max(axis=0)
    loops = np.zeros_like(load)
    for reach in rng.uniform(0.05, 0.6, 4):
        state = np.zeros(6)
        for k, move in enumerate(np.diff(load, axis=0, prepend=load[:1])):
            state = np.clip(state + move, -reach, reach)
            loops[k] += state
    return loops * np.abs(some(rng))


def moved(host: Host, rng: np.random.Generator, law: np.ndarray | float = 1.0) -> np.ndarray:
    """A CoG that is off, by a law in time (N,)."""
    shift = np.multiply.outer(np.broadcast_to(law, len(host.pull)), rng.standard_normal(3))
    return np.concatenate([0.0 * shift, np.cross(shift, host.mass * host.pull)], axis=1)


def turned(host: Host, rng: np.random.Generator) -> np.ndarray:
    axis = rng.standard_normal(3)
    return np.concatenate([np.cross(p, axis) for p in np.split(host.load, 2, axis=1)], axis=1)


def episodes(host: Host, rng: np.random.Generator) -> np.ndarray:
    """On and off (N,) at random moments, about a dozen changes a run."""
    return np.searchsorted(np.cumsum(rng.exponential(1.0 / 12.0, 200)), host.progress) % 2.0


def knock(host: Host, rng: np.random.Generator) -> np.ndarray:
    """Zeros that spring when somebody knocks at the tool, and creep back."""
    since = host.progress[:, None] - rng.uniform(0.05, 0.9, 3)
    course = np.where(since >= 0.0, np.exp(-np.maximum(since, 0.0) / 0.08), 0.0)
    return np.outer(course @ rng.choice([-1.0, 1.0], 3), some(rng))


def triple(host: Host, rng: np.random.Generator) -> np.ndarray:
    """One channel reads the square of a second times a third."""
    a, b, into = rng.permutation(6)[:3]
    unit = host.load / np.abs(host.load).max(axis=0)
    return np.outer(unit[:, a] ** 2 * unit[:, b], LEVER * np.eye(6)[into])


Draw = Callable[[Host, np.random.Generator], np.ndarray]
EFFECTS: dict[str, Draw] = {
    "sensor.bias": lambda host, rng: np.tile(some(rng), (len(host.pull), 1)),
    "sensor.drift": lambda host, rng: np.outer(host.progress ** rng.uniform(0.85, 1.2), some(rng)),
    "sensor.jump": lambda host, rng: np.outer(host.progress > rng.uniform(0.2, 0.8), some(rng)),
    "sensor.gain": lambda host, rng: host.load * some(rng) / LEVER,
    "sensor.crosstalk": crosstalk,
    "sensor.nonlinearity": lambda host, rng: np.abs(host.load) ** rng.uniform(1.8, 3.2) * some(rng),
    "sensor.hysteresis": hysteresis,
    "mount.rotation": turned,
    "tool.mass": lambda host, rng: rng.choice([-1.0, 1.0]) * host.load,
    "tool.cog": moved,
    "tool.slide": lambda host, rng: moved(host, rng, np.log1p(host.progress / 0.2)),
    "tool.leak": lambda host, rng: -host.load * np.expm1(-host.progress)[:, None],
}
"""Draws by the effect's name."""
OUTSIDE: dict[str, Draw] = {
    "knock": knock,
    "triple": triple,
    "popcorn": lambda host, rng: np.outer(episodes(host, rng), some(rng)),
    "bursts": lambda host, rng: (
        ((20.0 * host.progress).astype(int) % 6 == 2)[:, None] * rng.standard_normal((1, 6))
        * rng.standard_normal(host.load.shape) * some(rng)
    ),
    "dropout": lambda host, rng: (
        -host.load * np.outer(episodes(host, rng), np.eye(6)[rng.integers(6)])
    ),
}  # fmt: skip
"""Draws of faults that no effect is."""
