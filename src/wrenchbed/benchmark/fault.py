"""Faults of all made cases: kinds, the size from which a cause counts, draws of names and sizes.

Look-alikes, referee and efforts build on it, each with physics of its own; this file has none.
Its numbers and the order of `EFFECTS` make the cases of a seed: see `wrenchbed.benchmark`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from inspect import isfunction
from types import ModuleType
from typing import Any, Generic, TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.physics.wrench import CHANNELS, Tool, six_of
from wrenchbed.robots.base import INERTIA_AXES, Robot

Rng = np.random.Generator
Drawn = TypeVar("Drawn")
Shake = TypeVar("Shake")

KINDS = ("none", "single", "pair", "outside")
"""Nothing wrong, one effect of the library, two of different subsystems, a fault of no library."""
NEEDED = {"none": 0.0, "single": 1.0, "pair": 1.5, "outside": 2.0}
"""Least gap of each cause: of a single one the contract's, with a margin in the other kinds."""
ROWS_NEEDED = {"single": 0.5, "pair": 0.75}
"""Least rise of a channel's row variance, of causes that show only between rows."""
SIZES = (0.5, 4.0)
"""Multiples of the typical size that causes are drawn from, log-uniformly."""
STATED = ("sensor.bias", "tool.mass", "tool.cog")
"""Wrong stated numbers: they count on the configured gap, since a fit would hide them."""
_CHANNEL = "[ft][xyz]"
"""Pattern of a channel's name."""


@dataclass(frozen=True)
class CaseEffect:
    """An effect of the library that a case may have as a cause, and what makes it visible.

    ``needs`` is what a recording must have to show it: ``motion``, ``joints``, closed ``loops``,
    recorded temperatures ``warmth``, or ``repeats``, if it changes only the scatter of rows. If it
    ``adds``, its numbers add up with those of minor imperfections of the same name; ``compared``
    matches names of the numbers that mean the same in all physics (not the moment of a jump).
    """

    needs: tuple[str, ...] = ()
    adds: bool = True
    compared: str = ""


EFFECTS: Mapping[str, CaseEffect] = {
    "sensor.bias": CaseEffect(compared=rf"bias\.{_CHANNEL}"),
    "sensor.drift": CaseEffect(compared=rf"rate\.{_CHANNEL}"),
    "sensor.gain": CaseEffect(compared=rf"gain\.{_CHANNEL}"),
    "sensor.crosstalk": CaseEffect(compared=rf"x\.{_CHANNEL}\.{_CHANNEL}"),
    "sensor.hysteresis": CaseEffect(),
    "sensor.saturation": CaseEffect(),
    "sensor.quantization": CaseEffect(("repeats",)),
    "sensor.noise": CaseEffect(("repeats",)),
    "sensor.temperature": CaseEffect(("warmth",)),
    "sensor.nonlinearity": CaseEffect(),
    "sensor.creep": CaseEffect(),
    "sensor.jump": CaseEffect(adds=False, compared=rf"step\.{_CHANNEL}"),
    "mount.rotation": CaseEffect(compared=r"rotation\.[xyz]"),
    "tool.mass": CaseEffect(compared="mass"),
    "tool.cog": CaseEffect(compared=r"cog\.[xyz]"),
    "tool.inertia": CaseEffect(("motion",), compared=r"inertia\.[xyz]{2}"),
    "tool.loose": CaseEffect(),
    "tool.leak": CaseEffect(),
    "tool.slide": CaseEffect(),
    "tool.flexure": CaseEffect(),
    "cable.pull": CaseEffect(("joints",)),
    "cable.torsion": CaseEffect(("joints",)),
    "joint.offset": CaseEffect(("joints",), compared=r"offset\.q\d+"),
    "joint.compliance": CaseEffect(("joints",), compared=r"compliance\.q\d+"),
    "joint.backlash": CaseEffect(("joints",), adds=False),
    "joint.gear_error": CaseEffect(("joints",), adds=False),
    "joint.clearance": CaseEffect(("joints", "loops")),
    "link.length": CaseEffect(("joints", "loops"), compared=r"length\.[A-Z]\d\d?[yz]?"),
    "base.tilt": CaseEffect(compared="[xy]"),
    "base.compliance": CaseEffect(("joints",)),
    "base.vibration": CaseEffect(("repeats",)),
    "timing.delay": CaseEffect(("motion",), compared="delay"),
    "timing.lowpass": CaseEffect(("motion",), adds=False),
    "timing.stale": CaseEffect(("motion", "repeats")),
    "timing.skew": CaseEffect(("motion",), compared="skew"),
    "environment.contact": CaseEffect(("joints",)),
}
"""Effects by name, in the order in which causes are drawn: cases follow from it and the seed.

The weight of the sensor's own tool side is exactly a mass and a CoG: it is in every background."""


def as_stated(robot: Robot, mode: str, source: str, rate: float, tool: Tool) -> Metadata:
    """Metadata of a tool, row ``rate`` [Hz], ``mode`` (as ``static``), ``source`` (as ``sim``)."""
    sensor = registry.load("sensors", robot.sensor)
    stated = SensorInfo(sensor.name, tuple(sensor.noise.row_std.tolist()))
    return Metadata.of(robot.name, mode, source, rate, tool, stated, robot.gravity)


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """Draw a number between two positive ones, uniform in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: Rng) -> float:
    """Draw a sign, −1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


def subsystem(name: str) -> str:
    """Subsystem of an effect's name: ``sensor`` of ``sensor.gain``."""
    return name.partition(".")[0]


def of_another_subsystem(names: Iterable[str], name: str) -> list[str]:
    """Names of those effects that sit in another subsystem than the effect ``name``."""
    return [other for other in names if subsystem(other) != subsystem(name)]


def between(name: str) -> bool:
    """Whether an effect of this name changes only the scatter of rows, not their mean."""
    return name in EFFECTS and "repeats" in EFFECTS[name].needs


def possible(shown: Iterable[str]) -> list[str]:
    """Names of effects that can be causes where ``shown`` holds all `CaseEffect.needs`."""
    met = set(shown)
    return [name for name, effect in EFFECTS.items() if met.issuperset(effect.needs)]


def attempts(tries: int, draw: Callable[[int], Drawn], failure: type[Exception]) -> Drawn:
    """Call ``draw`` with 0, 1, …, ``tries`` times at most, until one makes a case; return the case.

    A draw that makes none raises ``failure``; that of the last attempt is passed on.
    """
    for attempt in range(tries - 1):
        try:
            return draw(attempt)
        except failure:
            continue
    return draw(tries - 1)


@dataclass(frozen=True, eq=False)
class Fault:
    """Something wrong with a robot: its ``true`` numbers by name [SI], and the name of an effect,
    of a family outside the library, or ``background`` (minor imperfections)."""

    true: Mapping[str, float] = field(default_factory=dict)
    name: str = field(default="", kw_only=True)


def named(name: str, draw: Callable[..., Any], *args: Any) -> Any:
    """Call a function that draws a fault, and give the fault a name."""
    return replace(draw(*args), name=name)


def draws(*modules: ModuleType, mark: str = ".") -> dict[str, Callable[..., Any]]:
    """Collect the functions that draw faults, by name: each public one of modules, in their order.
    The mark replaces the first underscore: ``sensor_gain`` draws ``sensor.gain``."""
    functions = (
        f
        for module in modules
        for f in vars(module).values()
        if isfunction(f) and f.__module__ == module.__name__ and not f.__name__.startswith("_")
    )
    every = {f.__name__.replace("_", mark, 1): f for f in functions}
    return {name: partial(named, name, f) for name, f in every.items()}


def true_numbers(cause: Fault, faults: Iterable[tuple[Fault, float]]) -> dict[str, float]:
    """True numbers of a cause by name, SI, plus those of minor imperfections of the same effect;
    ``faults`` has all faults of the robot, each with its amount, which is 1 for a cause."""
    if cause.name not in EFFECTS or not EFFECTS[cause.name].adds:
        return dict(cause.true)
    sums: dict[str, float] = {}
    for fault, amount in faults:
        if fault.name == cause.name:
            for key, value in fault.true.items():
                sums[key] = sums.get(key, 0.0) + amount * value
    return sums


def by_axis(vector: np.ndarray, stem: str = "") -> dict[str, float]:
    """Components of a vector (3,) by name: the stem and ``x``, ``y``, ``z``."""
    return {f"{stem}{a}": float(v) for a, v in zip("xyz", vector, strict=True)}


def by_moment(inertia: np.ndarray) -> dict[str, float]:
    """Moments and products ``inertia.xx`` … of a symmetric matrix (3, 3)."""
    names = (f"inertia.{a}" for a in INERTIA_AXES)
    return dict(zip(names, six_of(inertia).tolist(), strict=True))


def by_channel(values: np.ndarray, stem: str = "") -> dict[str, float]:
    """Nonzero values of an array (6,) by name: the stem and ``fx`` … ``tz``."""
    pairs = zip(CHANNELS, values.tolist(), strict=True)
    return {f"{stem}{c}": v for c, v in pairs if v != 0.0}


def by_pair(matrix: np.ndarray) -> dict[str, float]:
    """Nonzero numbers of crosstalk (6, 6) by name: ``x.fx.ty`` is what fx reads of ty."""
    entries = np.argwhere(matrix != 0.0)
    return {f"x.{CHANNELS[i]}.{CHANNELS[j]}": float(matrix[i, j]) for i, j in entries}


def numbered(stem: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Columns (N,) of values (N, J) by name: the stem and the column's number from 1."""
    return {f"{stem}{j + 1}": column for j, column in enumerate(values.T)}


def at_times(y: np.ndarray, t: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Interpolate a signal (T, k), sampled at instants (T,), at other times (n,) within them."""
    return np.asarray(CubicSpline(t, y)(np.clip(times, t[0], t[-1])))


def elapsed(t: np.ndarray) -> np.ndarray:
    """Share of the run that has elapsed (T,), 0 … 1, at each instant t (T,)."""
    return np.asarray((t - t[0]) / max(float(t[-1] - t[0]), 1e-9))


@dataclass(frozen=True, eq=False)
class Shown:
    """Visibility of a cause beside all other faults: ``gap`` is the mean square over noise variance
    that it adds, ``rows`` 0; of a cause that only scatters rows ``gap`` is the mean rise of a
    channel's row variance over the noise's, ``rows`` the largest one."""

    gap: float
    rows: float

    @property
    def amount(self) -> float:
        """Number by which causes are compared: ``rows``, or ``gap`` where that is 0."""
        return self.rows or self.gap

    def needed(self, kind: str) -> float:
        """Least `amount` from which a cause counts in a case of a kind, as ``single``."""
        return (ROWS_NEEDED if self.rows else NEEDED)[kind]


@dataclass(frozen=True, eq=False)
class RowChange(Generic[Shake]):
    """Change of the scatter of rows (6,), without change of means: factor on the noise, step of
    rounding (0: none), what shakes the robot, chance that a row starts a repeat of the one before
    with the mean number of repeats, and the largest reading [N, N·m]."""

    gain: np.ndarray = field(default_factory=lambda: np.ones(6))
    step: np.ndarray = field(default_factory=lambda: np.zeros(6))
    shake: Shake | None = None
    stale: tuple[float, float] = (0.0, 1.0)
    limit: np.ndarray = field(default_factory=lambda: np.full(6, np.inf))

    def rise(
        self,
        noise: np.ndarray,
        y: np.ndarray,
        shaken: Callable[[Shake], np.ndarray],
        held: Callable[[int, tuple[float, float], Rng], np.ndarray],
    ) -> np.ndarray:
        """Rise of the variance of rows (6,) in units of a row's noise (6,) squared, at readings y
        (N, 6); ``held`` draws which row is shown in place of each, ``shaken`` is the wrench of
        shaking. Rounding adds the variance of a uniform distribution, by definition step²/12."""
        rise = self.gain**2 - 1.0 + (self.step / noise) ** 2 / 12.0
        if self.shake is not None:
            rise = rise + ((shaken(self.shake) / noise) ** 2).mean(axis=0)
        if self.stale[0] > 0.0:
            shown = held(len(y), self.stale, np.random.default_rng(len(y)))
            rise = rise + (((y[shown] - y) / noise) ** 2).mean(axis=0)
        return np.asarray(rise)


def converted(y: np.ndarray, changes: Sequence[RowChange[Any]]) -> np.ndarray:
    """Readings (…, 6) rounded to the steps, then clipped at the limits, of all ``changes``."""
    for r in changes:
        step = np.where(r.step > 0.0, r.step, 1.0)
        y = np.where(r.step > 0.0, np.round(y / step) * step, y)
    for r in changes:
        y = np.clip(y, -r.limit, r.limit)
    return y


@dataclass(frozen=True, eq=False)
class UsualFit:
    """Fit of bias, mass and CoG to n rows, which every diagnosis makes first: orthonormal columns
    (6 n, 10) in units of a row's noise (6,)."""

    noise: np.ndarray
    basis: np.ndarray

    @classmethod
    def of(cls, differences: Sequence[np.ndarray], noise: np.ndarray) -> "UsualFit":
        """Make the basis of six biases and four differences of readings (n, 6) by mass and CoG."""
        biases = [np.broadcast_to(axis, differences[0].shape) for axis in np.eye(6)]
        columns = np.stack([*biases, *differences], axis=-1)
        white = (columns / noise[:, None]).reshape(-1, columns.shape[-1])
        return cls(noise, np.linalg.qr(white / np.linalg.norm(white, axis=0))[0])

    def white(self, signal: np.ndarray, configured: bool) -> np.ndarray:
        """Difference (n, 6) over noise, as (6 n,), less its usual fit unless ``configured``."""
        x = (signal / self.noise).ravel()
        return np.asarray(x if configured else x - self.basis @ (self.basis.T @ x))

    def gap(self, signal: np.ndarray, configured: bool = False) -> float:
        """Gap of a difference of readings (n, 6): mean square over row noise, after the usual fit
        of bias, mass and CoG, or before it if ``configured``."""
        x = self.white(signal, configured)
        return float(x @ x) / len(x)
