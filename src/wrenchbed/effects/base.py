"""What an effect is: one thing that a simulator usually lacks, in closed form and in MuJoCo.

An effect acts at one stage of the chain that turns joint values into readings:

``model``    other parameters of the robot (a tilted base, a wrong mass)
``joint``    the joints stand elsewhere than they report
``pose``     the sensor stands elsewhere than the joints say
``load``     more than the tool pulls on the sensor
``reading``  the sensor shows something else than its load
``timing``   the reading belongs to another moment
``row``      no mean effect: rows scatter, repeat or step

A *variant* is one way in which an effect shows: which of its parameters are free, and where its
shape (a moment, an anchor, a width) begins. Amplitudes are zero where there is no effect, and the
mean of every variant is close to linear in them.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from wrenchbed.effects.scene import Scene
from wrenchbed.errors import ParameterError
from wrenchbed.physics.parameters import Parameter, ParameterSet
from wrenchbed.physics.taylor import Value
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import Robot

if TYPE_CHECKING:
    import mujoco


STAGES = ("model", "joint", "pose", "load", "reading", "timing", "row")
Values = Mapping[str, float]
"""All parameters of one effect by name, SI."""


@dataclass(frozen=True)
class Variant:
    """One way in which an effect shows.

    Attributes:
        label: for people, for instance ``joint 2``.
        free: amplitudes that are fitted together.
        at: where the shape parameters begin.
        shape: those of ``at`` that a nonlinear fit may move.
        detail: what of the answer is a choice, not a number: ``{"joint": 2}``.
        weight: prior share among the effect's variants, relative.
    """

    label: str
    free: tuple[str, ...]
    at: Mapping[str, float] = field(default_factory=dict)
    shape: tuple[str, ...] = ()
    detail: Mapping[str, Any] = field(default_factory=dict)
    weight: float = 1.0


class Residual(NamedTuple):
    """What a calibrated simulator leaves.

    Attributes:
        rows: of the scene that were measured and may be fitted (R,).
        value: in units of ``noise``, after bias, mass and CoG (R, 6).
        noise: standard deviation of a row (6,) [N, N·m].
        tangent: change of all readings (M, 6) per typical size of a parameter, shapes given.
    """

    rows: np.ndarray
    value: np.ndarray
    noise: np.ndarray
    tangent: Callable[[str, Mapping[str, float]], np.ndarray]


class Pose(NamedTuple):
    """R_world_sensor (M, 3, 3) and the sensor's origin in the world (M, 3) [m]; jets in motion."""

    rotation: Value
    position: Value


class Effect(ABC):
    """One unmodelled effect; the instance of a module is its constant ``EFFECT``."""

    name: ClassVar[str]
    title: ClassVar[str]
    """One line: what happens."""
    stage: ClassVar[str]
    source: ClassVar[str]
    """Where the typical size comes from."""
    modes: ClassVar[tuple[str, ...]] = ("static", "dynamic")
    """Recordings in which it can show."""
    rough: ClassVar[bool] = False
    """Whether its shapes act by jumps, so that slopes do not show the way to better ones."""
    form_error: ClassVar[float] = 0.06
    """Share of its own gap that the form given here may miss of the real thing."""
    size_error: ClassVar[float] = 0.0
    """Relative standard uncertainty of a size, because the form given here is only nearly right."""

    @property
    def subsystem(self) -> str:
        """The part of the robot that it sits in: the name before the dot."""
        return self.name.partition(".")[0]

    @abstractmethod
    def parameters(self, robot: Robot) -> ParameterSet:
        """Amplitudes (nominal 0, tolerance = typical size) and shapes, SI."""

    @abstractmethod
    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        """The ways in which it may show in a scene; none where it cannot."""

    def usual(self, variant: Variant) -> tuple[str, ...]:
        """Amplitudes of a variant that a robot with the effect at its typical size has."""
        return variant.free

    def found(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """Further variants whose shapes a scan of a residual suggests; default: none."""
        return ()

    def values(self, robot: Robot, given: Mapping[str, Any]) -> dict[str, float]:
        """All parameters by name, nominal where not given.

        Raises:
            ParameterError: an unknown name or an impossible value.
        """
        known = self.parameters(robot)
        try:
            return known.mapping(known.vector(dict(given)))
        except (TypeError, ValueError) as error:
            raise ParameterError(f"{self.name}: {error}") from error

    def publish(
        self, robot: Robot, variant: Variant, values: Values, std: Values
    ) -> dict[str, dict[str, Any]]:
        """Parameters as a diagnosis states them: value, standard uncertainty and unit by name."""
        known = self.parameters(robot)
        names = [*variant.free, *variant.shape]
        told: dict[str, dict[str, Any]] = {
            n: {"value": values[n], "std": std.get(n), "unit": known[known.index(n)].unit}
            for n in names
        }
        return told | {k: {"value": v} for k, v in variant.detail.items()}

    # ---- MuJoCo ----------------------------------------------------------------------------

    def edit_spec(  # noqa: B027 - most effects have nothing to write
        self, spec: "mujoco.MjSpec", robot: Robot, theta: np.ndarray, p: Values
    ) -> None:
        """Write the effect into a model, where MuJoCo can carry it; default: nothing to write."""

    def corrupt(
        self, rows: np.ndarray, t: np.ndarray, p: Values, rng: np.random.Generator
    ) -> np.ndarray:
        """The random part on readings (N, 6) at times (N,) [s]; default: none."""
        return rows


class ModelEffect(Effect):
    """Changes the robot's own parameters; closed form and MuJoCo take them alike."""

    stage = "model"

    @abstractmethod
    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        """The robot's parameters (P,) with the effect."""


class JointEffect(Effect):
    """The joints stand elsewhere than they report; one amplitude a joint."""

    stage = "joint"
    amplitude: ClassVar[str]
    """Name of the amplitude, with the joint's number behind: ``offset.q2``."""
    smooth: ClassVar[bool] = True
    """Whether velocities and accelerations follow from the displacement."""

    @abstractmethod
    def displace(self, scene: Scene, p: Values) -> np.ndarray:
        """What is added to the joint values (M, J) [rad or m]."""

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return joint_variants(self, scene)

    def values(self, robot: Robot, given: Mapping[str, Any]) -> dict[str, float]:
        """Also takes ``joint=2,offset=0.003`` for one joint."""
        return super().values(robot, one_joint(given, len(robot.joints), self.amplitude))


class PoseEffect(Effect):
    """The sensor stands elsewhere than its joints say."""

    stage = "pose"

    @abstractmethod
    def pose(self, scene: Scene, pose: Pose, p: Values) -> Pose:
        """The sensor's pose with the effect."""


class LoadEffect(Effect):
    """More than the rigid tool pulls on the sensor."""

    stage = "load"

    @abstractmethod
    def load(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        """What is added to the load on the sensor (M, 6) [N, N·m] in sensor axes."""


class ReadingEffect(Effect):
    """The sensor shows something else than its load."""

    stage = "reading"

    @abstractmethod
    def read(self, scene: Scene, reading: np.ndarray, p: Values) -> np.ndarray:
        """Readings (M, 6) [N, N·m] with the effect."""


class RowEffect(Effect):
    """Shows between rows only: its mean is nothing; ``corrupt`` makes it."""

    stage = "row"

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        return ()


# ---- building blocks of parameter sets and variants ------------------------------------------


def channel_parameters(
    stem: str, force: float, torque: float, text: str, units: Sequence[str] = UNITS
) -> list[Parameter]:
    """One amplitude a channel, ``stem.fx`` …, with typical sizes of forces and torques."""
    return [
        Parameter(f"{stem}.{c}", 0.0, u, force if c[0] == "f" else torque, -1e4, 1e4, text)
        for c, u in zip(CHANNELS, units, strict=True)
    ]


def channel_variants(
    stem: str, at: Values | None = None, shape: tuple[str, ...] = ()
) -> list[Variant]:
    """Each channel alone, the forces, the torques, all six."""
    names = [f"{stem}.{c}" for c in CHANNELS]
    where = dict(at or {})
    single = [
        Variant(c, (n,), where, shape, {"channel": c}) for c, n in zip(CHANNELS, names, strict=True)
    ]
    return [
        *single,
        Variant("forces", tuple(names[:3]), where, shape, weight=2.0),
        Variant("torques", tuple(names[3:]), where, shape),
        Variant("all channels", tuple(names), where, shape, weight=3.0),
    ]


def joint_parameters(
    robot: Robot, stem: str, rotary: float, linear: float, text: str, units: tuple[str, str]
) -> ParameterSet:
    """One amplitude a joint, ``stem.q1`` …; typical sizes and units of rotary and linear joints."""
    items = []
    for k, joint in enumerate(robot.joints, start=1):
        turns = joint.unit == "rad"
        size, unit = (rotary, units[0]) if turns else (linear, units[1])
        items.append(Parameter(f"{stem}.q{k}", 0.0, unit, size, -1e3, 1e3, text))
    return ParameterSet(tuple(items))


def joint_variants(effect: JointEffect, scene: Scene) -> tuple[Variant, ...]:
    """Each joint alone, and all together."""
    if not scene.jointed:
        return ()
    names = [f"{effect.amplitude}.q{k + 1}" for k in range(len(scene.robot.joints))]
    single = [
        Variant(f"joint {k}", (n,), detail={"joint": k}) for k, n in enumerate(names, start=1)
    ]
    return (*single, Variant("all joints", tuple(names), weight=2.0))


def one_joint(given: Mapping[str, Any], joints: int, amplitude: str) -> dict[str, Any]:
    """``{"joint": 2, amplitude: x}`` → ``{"amplitude.q2": x}``; other forms pass unchanged.

    Raises:
        ParameterError: there is no such joint.
    """
    rest = dict(given)
    if "joint" not in rest:
        return rest
    number = rest.pop("joint")
    if not isinstance(number, int | float):
        raise ParameterError(f"joint {number!r} is no number: 1 … {joints}")
    if int(number) != float(number) or not 1 <= int(number) <= joints:
        raise ParameterError(f"joint {number:g} does not exist: 1 … {joints}")
    if amplitude in rest:
        rest[f"{amplitude}.q{int(number)}"] = rest.pop(amplitude)
    return rest
