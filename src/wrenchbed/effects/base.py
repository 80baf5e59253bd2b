"""The contract of an effect: what a simulator usually lacks, in closed form and in MuJoCo.

An effect declares all that other rooms ask about it: the stages of the chain at which it acts
(`STAGES`), what it does there, its parameters and variants, and its place in diagnosis and report.

A *variant* is one way in which an effect shows: its free amplitudes, and initial values of its
shape (a moment, an anchor, a width). Amplitudes are zero where there is no effect; the mean of
every variant is close to linear in them. Names in `STAGES` and of parameters are public.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from wrenchbed.effects.scene import Scene, examples
from wrenchbed.errors import ParameterError
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.taylor_jets import Value
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import Robot

if TYPE_CHECKING:
    from mujoco import MjSpec as MjSpec
else:
    MjSpec = Any
"""MuJoCo is imported by what compiles a model only."""
_OF_JOINT = re.compile(r"(.+)\.q\d+")
"""Pattern of a name that ends with a joint."""
_LISTED = 15
"""Names that an error lists at most: two per joint of an arm of six, ``joint`` and short names."""
STATED_NUMBERS = ("bias", "mass", "cog")
"""Numbers of a recording's metadata that every user fits; an effect may be that one is wrong."""
Rng = np.random.Generator
Values = Mapping[str, float]
"""All parameters of one effect by name, SI."""
Published = dict[str, dict[str, Any]]
"""Value, standard uncertainty and unit of parameters by name, as a diagnosis states them."""
Sizes = dict[str, tuple[float, str]]
"""Value and SI unit of quantities by name."""
_ALONG = 0.35
"""Least component of a unit vector for `sides` to name its axis: less than 1/√3."""
WAVES = 5
"""Number of sine waves of a free `course` in time: what warms and settles needs few."""


class Stage(NamedTuple):
    """One step of the chain from joint values to wrench readings, at which effects can act.

    Attributes:
        changes: what an effect at this stage changes, as text.
        simulated: text on how a simulator applies an effect that an MJCF model cannot hold.
        exported: text on the data that code beside an exported MJCF changes for such an effect.
    """

    changes: str
    simulated: str = "on what MuJoCo's sensor reads, by the closed form"
    exported: str = "on the sensor's readings"


STAGES: Mapping[str, Stage] = {
    "model": Stage("parameters of the robot", "the robot's own parameters, written into its MJCF"),
    "joint": Stage(
        "true joint values differ from reported ones",
        "the joints of the model stand elsewhere than the recording says",
        "on the joint values",
    ),
    "pose": Stage(
        "the sensor's pose differs from what the joints give", exported="on the sensor's pose"
    ),
    "load": Stage(
        "the load on the sensor differs from the tool's", exported="on the load of the sensor"
    ),
    "effort": Stage(
        "the reading of a joint's effort differs from the torque on it",
        "on the joints' torques, by the closed form",
        "on the joints' efforts",
    ),
    "reading": Stage("the sensor's reading differs from its load"),
    "timing": Stage("the reading belongs to another moment"),
    "row": Stage(
        "no mean effect: rows scatter, repeat or are quantised",
        "on the rows that the simulated sensor gives, at random",
        "on the rows of a recording",
    ),
}
"""Stages by name, in the order in which they act."""


@dataclass(frozen=True)
class Variant:
    """One way in which an effect may show: amplitudes to fit, and start values of its shape.

    Attributes:
        label: text for people, for instance ``joint 2``.
        free: names of the amplitudes that are fitted together.
        at: initial values of the shape parameters (such as a time constant), by name.
        shape: names of those in ``at`` that a nonlinear fit may move.
        detail: choices (not numbers) that the answer states: ``{"joint": 2}``.
        weight: prior probability among the effect's variants, relative.
        rivals: names of effects that give the same readings in the scene's rows.
    """

    label: str
    free: tuple[str, ...]
    at: Mapping[str, float] = field(default_factory=dict)
    shape: tuple[str, ...] = ()
    detail: Mapping[str, Any] = field(default_factory=dict)
    weight: float = 1.0
    rivals: tuple[str, ...] = ()

    @property
    def free_form(self) -> bool:
        """Whether the variant fits a free curve instead of a formula, see `Effect.free_forms`."""
        return self.detail.get("form") == "free"


class Curve(NamedTuple):
    """Curve that a variant without a formula adds to readings, on a grid of P points.

    Attributes:
        channel: name of the wrench channel that it changes; empty if the same in all.
        x: grid (P,) of time, load …, in ``x_unit``; of a hysteresis loop it goes up and back.
        columns: curve (P, k) in ``y_unit`` per SI unit of each of the k amplitudes ``names``.
    """

    channel: str
    names: tuple[str, ...]
    x: np.ndarray
    columns: np.ndarray
    x_unit: str
    y_unit: str


class Residual(NamedTuple):
    """Measured minus predicted readings of a calibrated simulator, for `Effect.scan`.

    Attributes:
        rows: indices (R,) of the scene's M rows that were measured and may be fitted.
        value: residual (R, 6) in units of ``noise``, after the fit of bias, mass and CoG.
        noise: standard deviation of a row (6,) [N, N·m].
        tangent: (amplitude's name, shape values) → change of readings (M, 6) per typical size.
        fitted: orthonormal basis of the fit of bias, mass and CoG (R, 6, k).
    """

    rows: np.ndarray
    value: np.ndarray
    noise: np.ndarray
    tangent: Callable[[str, Mapping[str, float]], np.ndarray]
    fitted: np.ndarray | None = None


class Pose(NamedTuple):
    """Sensor pose: rotation R_world_sensor (M, 3, 3), origin in the world (M, 3) [m]; in motion
    each is a `Jet`, the value with its first and second time derivative."""

    rotation: Value
    position: Value


class Effect(ABC):
    """Physical effect that simulators lack, as hysteresis; a plug-in module has one, ``EFFECT``."""

    name: ClassVar[str]
    title: ClassVar[str]
    """One line of text: what happens on the robot."""
    title_of_joint: ClassVar[str] = ""
    """Title for an effect on one joint, with ``{joint}`` for its number."""
    source: ClassVar[str]
    """Source of the typical size."""
    stage: ClassVar[str]
    """Name of the stage in `STAGES` at which the effect acts first."""
    also_at: ClassVar[tuple[str, ...]] = ()
    """Further stages at which the effect acts."""
    numbers: ClassVar[tuple[Parameter, ...]] = ()
    """Parameters of the effect if they are the same on all robots: see `parameters`."""
    modes: ClassVar[tuple[str, ...]] = ("static", "dynamic")
    """Modes of the recordings in which the effect can show."""
    smooth: ClassVar[bool] = True
    """Whether velocities and accelerations follow from a displacement of joints."""
    rough: ClassVar[bool] = False
    """Whether the shapes act by jumps, so that slopes do not lead to better ones."""
    form_error: ClassVar[float] = 0.06
    """Share of its own gap that this closed form may miss of the real thing: a quarter of its
    amplitude in another shape (0.25² = 0.06)."""
    size_error: ClassVar[float] = 0.0
    """Relative standard uncertainty of a size, because this closed form is only nearly right."""
    stated: ClassVar[str] = ""
    """Name in `STATED_NUMBERS` whose wrong value in the metadata is this effect; empty if none."""
    local: ClassVar[bool] = False
    """Whether a parameter's name ends with the joint or link that it belongs to; of a joint effect
    it then displaces that joint alone."""
    channelwise: ClassVar[bool] = False
    """Whether an amplitude whose name ends with a channel changes that channel's reading alone, and
    no other amplitude's share of it."""
    zero_is_convention: ClassVar[bool] = False
    """Whether the effect's zero, and its mean response to load, are a convention."""
    shown: ClassVar[str] = "prediction"
    """What a report draws the effect over: the ``prediction``, ``time`` (or the recorded
    temperature), ``load`` or ``loop`` of the channel in which it shows most, ``torque`` or
    ``angle`` of its joint, or the ``matrix`` of all pairs of channels."""
    once: ClassVar[bool] = False
    """Whether the effect is of one day: another recording of the robot may be without it."""

    @property
    def subsystem(self) -> str:
        """Subsystem that the effect belongs to: its name before the dot, as ``sensor``."""
        return self.name.partition(".")[0]

    @property
    def family(self) -> str:
        """Group of effects that can absorb errors of each other's formulas: ``external`` (forces on
        the tool from outside), else the subsystem: the effect's name before the dot."""
        return "external" if self.subsystem in ("cable", "environment") else self.subsystem

    @property
    def of_recording(self) -> bool:
        """Whether the effect belongs to a recording (its tool, zero, day), not to the robot."""
        return self.once or bool(self.stated) or self.subsystem == "tool"

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of all stages of the chain at which the effect acts."""
        return (self.stage, *self.also_at)

    @property
    def between_rows(self) -> bool:
        """Whether the effect changes only the scatter between rows, not their mean."""
        return self.stage == "row"

    @property
    def in_sensor(self) -> bool:
        """Whether the effect changes only the sensor's readings, not its pose or load."""
        return self.stage in ("reading", "timing")

    def acts(self, scene: Scene) -> bool:
        """Whether the effect can change readings at rest or in motion, as the scene is; always if
        rows are averages of a motion."""
        return scene.mode in self.modes or scene.averaged

    def applies(self, robot: Robot) -> bool:
        """Whether a robot can have the effect at all, whatever the recording."""
        return self.between_rows or any(self.variants(s) for s in examples(robot))

    def parameters(self, robot: Robot) -> ParameterSet:
        """Amplitudes (nominal 0, tolerance: typical size) and shape parameters of an effect, SI."""
        return ParameterSet(self.numbers)

    @abstractmethod
    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        """Ways in which the effect may show in a scene's readings (see `Variant`); or none."""

    def free_forms(self, scene: Scene) -> tuple[Variant, ...]:
        """Variants without a formula: free curves over time, load or temperature, linear in many
        amplitudes; by default none."""
        return ()

    def curves(self, scene: Scene, variant: Variant) -> tuple[Curve, ...]:
        """Curves that a variant without a formula adds to readings, one a channel; default none."""
        return ()

    def usual(self, variant: Variant) -> tuple[str, ...]:
        """Names of a variant's amplitudes that a simulation of it sets to their typical size."""
        return variant.free

    def scan(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """More variants, whose shape values (as a jump's time) fit a residual; default none."""
        return ()

    def taken(self, robot: Robot) -> tuple[str, ...]:
        """Names that `values` accepts, with ``joint`` and short names such as ``offset``."""
        names = self.parameters(robot).names
        short = joint_stems(names)
        return ("joint", *short, *names) if short else names

    def values(self, robot: Robot, given: Mapping[str, Any]) -> dict[str, float]:
        """Values of all parameters by name, from some ``given`` by name; the others are nominal.

        ``joint=2,offset=1e-3`` is accepted for ``offset.q2=1e-3``.

        Raises:
            ParameterError: an unknown name (lists accepted ones) or an impossible value.
        """
        known = self.parameters(robot)
        named = of_joint(given, known.names, len(robot.joints))
        for name in named:
            if name not in known.names:
                raise unknown_name(self.name, name, self.taken(robot), len(robot.joints))
        try:
            return known.mapping(known.vector(named))
        except (TypeError, ValueError) as error:
            raise ParameterError(f"{self.name}: {error}") from error

    def publish(self, robot: Robot, variant: Variant, values: Values, std: Values) -> Published:
        """Dicts of ``value``, ``std``, ``unit`` of the parameters that a variant fits, by name."""
        known = self.parameters(robot)
        result: Published = {
            n: {"value": values[n], "std": std.get(n), "unit": known[known.index(n)].unit}
            for n in (*variant.free, *variant.shape)
        }
        return result | {k: {"value": v} for k, v in variant.detail.items()}

    def amplitudes(
        self, published: Mapping[str, Mapping[str, Any]]
    ) -> dict[str, Mapping[str, Any]] | None:
        """Value and std of amplitudes by name, from parameters that `publish` made; else None."""
        return dict(published)

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        """Value and SI unit, by name (``sag`` …), of how large an effect with values p is in a
        scene; empty where p itself says it."""
        return {}

    # ---- what it does at its stages: nothing at those at which it does not act ------------------

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        """Robot's parameters ``theta`` (P,) as changed by the effect with parameter values p."""
        return theta

    def displace(self, scene: Scene, p: Values) -> Value:
        """Displacement of joint values (M, J) [rad or m] that the effect with values p adds."""
        return 0.0

    def pose(self, scene: Scene, pose: Pose, p: Values) -> Pose:
        """Sensor pose after the effect with parameter values p has changed ``pose``."""
        return pose

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        """Wrench (M, 6) [N, N·m], sensor axes, that the effect with values p adds to ``load``."""
        return np.zeros_like(load)

    def sense(self, torque: np.ndarray, p: Values) -> np.ndarray:
        """Joint torques (M, J) [N·m, of slides N] as read by sensors with the effect, values p."""
        return torque

    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        """Readings (M, 6) [N, N·m] with the effect of values p acting on ``reading`` (M, 6)."""
        return reading

    def corrupt(self, rows: np.ndarray, t: np.ndarray, p: Values, rng: Rng) -> np.ndarray:
        """Readings ``rows`` (N, 6) at t (N,) [s] with the effect's random part, values p, added."""
        return rows

    # ---- MuJoCo ----------------------------------------------------------------------------

    def edit_spec(  # noqa: B027 - most effects have nothing to write
        self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values
    ) -> None:
        """Write the effect, values p, into a MuJoCo model if it can be; by default do nothing."""

    def as_parameters(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray | None:
        """Robot's parameters (P,) changed so as to give the effect of values p; else None."""
        return None


class ModelEffect(Effect):
    """Effect that only changes the robot's parameters, in closed form and in MuJoCo alike."""

    stage = "model"

    def as_parameters(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        return self.theta(robot, theta, p)


class JointEffect(Effect):
    """Effect with one amplitude per joint, mostly a displacement of true joint values."""

    stage = "joint"
    local = True
    amplitude: ClassVar[str]
    """Name of the amplitude, before the joint's number: ``offset`` of ``offset.q2``."""
    sizes: ClassVar[tuple[float, float]]
    """Typical amplitudes for rotary and for prismatic joints."""
    units: ClassVar[tuple[str, str]] = ("rad", "m")
    text: ClassVar[str]

    def parameters(self, robot: Robot) -> ParameterSet:
        return joint_parameters(robot, self.amplitude, *self.sizes, self.text, self.units)

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        """One variant for each joint alone, then one for all together; none without joints."""
        return joint_variants(self.amplitude, scene.robot) if scene.jointed else ()


class LoadEffect(Effect):
    """Effect that adds a wrench to the rigid tool's load on the sensor."""

    stage = "load"

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        """Largest force, else torque, that an external effect with values p puts on the tool."""
        if self.family != "external":
            return {}
        load = self.pull(scene, Pose(*scene.pose), scene.load, p)[scene.held]
        force, torque = (float(np.linalg.norm(x, axis=1).max()) for x in np.hsplit(load, 2))
        return {"largest_force": (force, "N")} if force else {"largest_torque": (torque, "N·m")}


class ReadingEffect(Effect):
    """Effect of the sensor: its reading differs from the load on it."""

    stage = "reading"
    sized_by_change: ClassVar[bool] = False
    """Whether the largest change of readings says the size, because no parameter does."""

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        if not self.sized_by_change:
            return {}
        change = (self.read(scene, scene.load, p) - scene.load)[scene.held]
        return {
            f"largest_change.{c}": (float(x[np.abs(x).argmax()]), unit)
            for c, unit, x in zip(CHANNELS, UNITS, change.T, strict=True)
            if x.any()
        }


class RowEffect(Effect):
    """Effect that only scatters rows (method ``corrupt``); the mean of a pose does not change."""

    stage = "row"

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return ()


# ---- building blocks of parameter sets and variants ------------------------------------------


def alike(
    names: Sequence[str], unit: str, size: float, bound: float, text: str
) -> tuple[Parameter, ...]:
    """Make parameters ``names`` [``unit``]: nominal 0, typical ``size``, ±``bound``, a ``text``."""
    return tuple(Parameter(n, 0.0, unit, size, -bound, bound, text) for n in names)


def joint_parameters(
    robot: Robot, stem: str, rotary: float, linear: float, text: str, units: tuple[str, str]
) -> ParameterSet:
    """Make parameters ``stem.q1`` … with typical size and unit for rotary (first unit) or linear
    joints, described by ``text``. Their bounds only refuse absurd values (estimates)."""
    items = []
    for k, joint in enumerate(robot.joints, start=1):
        turns = joint.unit == "rad"
        size, unit = (rotary, units[0]) if turns else (linear, units[1])
        items.append(Parameter(f"{stem}.q{k}", 0.0, unit, size, -1e3, 1e3, text))
    return ParameterSet(tuple(items))


def joint_variants(stem: str, robot: Robot) -> tuple[Variant, ...]:
    """Variants that free ``stem.q1`` …: of each joint alone, then of all joints together."""
    names = each_joint(stem, robot)
    single = (Variant(f"joint {k}", (n,), detail={"joint": k}) for k, n in enumerate(names, 1))
    return (*single, Variant("all joints", names, weight=2.0))


def per_channel(stem: str) -> tuple[str, ...]:
    """Parameter names ``stem.fx`` … ``stem.tz``, one for each channel."""
    return tuple(f"{stem}.{c}" for c in CHANNELS)


def each_joint(stem: str, robot: Robot) -> tuple[str, ...]:
    """Parameter names ``stem.q1`` …, one for each joint of a robot."""
    return tuple(f"{stem}.q{k + 1}" for k in range(len(robot.joints)))


def has_loops(robot: Robot) -> bool:
    """Whether the robot has closed chains (five-bar linkages), by the name of a parameter."""
    return "L14" in robot.parameters.names


def waves(stem: str) -> tuple[str, ...]:
    """Names ``stem.1`` … of the amplitudes of the `WAVES` sines in a smooth function of time."""
    return tuple(f"{stem}.{k}" for k in range(1, WAVES + 1))


def course(scene: Scene, p: Values, rate: str, wave: Sequence[str]) -> np.ndarray:
    """Smooth function of time r (t − t₀) + Σ_k w_k sin(kπ (t − t₀)/D) at the M rows (M,); 0 at t₀.

    ``rate`` names r in p, ``wave`` the `WAVES` amplitudes w_k; ``p["duration"]`` is D [s].
    """
    return np.asarray(p[rate] * scene.age + half_waves(scene, p["duration"]) @ vector(p, wave))


def half_waves(scene: Scene, duration: float) -> np.ndarray:
    """Sines sin(kπ (t − t₀)/D), k = 1 … WAVES, at rows (M, WAVES), 0 after the duration D [s]."""
    share = np.clip(scene.age / duration, 0.0, 1.0)
    return np.sin(np.pi * np.outer(share, np.arange(1, WAVES + 1)))


def added(robot: Robot, theta: np.ndarray, changes: Values) -> np.ndarray:
    """The robot's parameters (P,) with ``changes``, by name, added."""
    result = np.array(theta, dtype=float)
    for name, change in changes.items():
        result[robot.parameters.index(name)] += change
    return result


def vector(p: Values, names: Sequence[str]) -> np.ndarray:
    """Array (len(names),) of values of the parameters ``names`` in p."""
    return np.array([p[n] for n in names])


def sides(way: np.ndarray) -> str:
    """Signed axes along which a unit vector (3,) mainly points, as text: ``+x−z``."""
    along = zip("xyz", way, strict=True)
    return "".join(f"{'+' if w > 0.0 else '−'}{a}" for a, w in along if abs(w) > _ALONG)


def direction(p: Values, names: Sequence[str]) -> np.ndarray:
    """Unit vector (3,) along the vector of the named parameters' values."""
    along = vector(p, names)
    return along / max(float(np.linalg.norm(along)), 1e-9)


def unknown_name(effect: str, name: str, taken: Sequence[str], joints: int) -> ParameterError:
    """Error for a parameter ``name`` not among the accepted ``taken``; ``joints``: their number."""
    if name in taken:
        return ParameterError(f"{effect}: {name} belongs to one joint: add joint=1 … {joints}")
    near = sorted(taken, key=lambda n: -SequenceMatcher(None, name, n).ratio())
    more = "" if len(near) <= _LISTED else f" … ({len(near)} in all)"
    return ParameterError(
        f"{effect}: there is no parameter {name!r}; its parameters, the nearest first: "
        f"{', '.join(near[:_LISTED])}{more}"
    )


def joint_stems(names: Sequence[str]) -> tuple[str, ...]:
    """Parts before the joint of those names that end with a joint: ``offset`` of ``offset.q2``."""
    return tuple(dict.fromkeys(m[1] for m in map(_OF_JOINT.fullmatch, names) if m))


def of_joint(given: Mapping[str, Any], names: Sequence[str], joints: int) -> dict[str, Any]:
    """Complete names in ``given`` to ``names``: {"joint": 2, "offset": x} gives {"offset.q2": x}.

    Raises:
        ParameterError: there is no such joint among ``joints``, their number.
    """
    remaining, stems = dict(given), joint_stems(names)
    if not stems or "joint" not in remaining:
        return remaining
    number = remaining.pop("joint")
    if not isinstance(number, int | float):
        raise ParameterError(f"joint {number!r} is no number: 1 … {joints}")
    if int(number) != float(number) or not 1 <= int(number) <= joints:
        raise ParameterError(f"joint {number:g} does not exist: 1 … {joints}")
    return {f"{k}.q{int(number)}" if k in stems else k: v for k, v in remaining.items()}
