"""Springs, backlash and cables added to an MjSpec; names of added elements are ``effect:part``.

A joint with a range has backlash ±half, and a weak spring k: under a force it settles at
half·tanh(force/(k·half)). With friction it stays until the force exceeds the friction; one that
lags settles on the side opposite to its joint's last motion. With a negative stiffness it settles
on the other side.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from wrenchbed.errors import ParameterError

MARK = ":"
"""Character in the names of elements that effects add; no name of a robot's own MJCF has it."""
LAGS, MASS, ROUND = ".lags", ":mass", ".round"
"""Ends of names: of a joint that lags, of the body with the tool's mass, of backlash in a plane."""
FAR, BEHIND = 1e6, 1e7
"""Distance [m] of the anchor of a tendon that acts as a constant force, or as a plane: within a
metre the force turns by 1e-6 rad, the plane bulges by 5e-8 m."""
ROTOR, DAMPING_S = 1e-3, 1e-3
"""Inertia of an added joint [kg·m² or kg] and its damping over its stiffness [s]: no reading of
the twin depends on them, but the exported model is stable."""
_HARD = ((0.004, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0))
"""MuJoCo's solref and solimp of the ends of backlash; the usual ones yield by more than it."""


class Spring(NamedTuple):
    """Spring, backlash and friction of a joint that an effect adds.

    Attributes:
        stiffness: of the spring [N·m/rad or N/m].
        half: half of the backlash [rad or m]; None without backlash.
        lags: whether it rests on the side opposite to the driven joint's last motion.
        friction: force [N] up to which it stays where it is.
        bias: the spring's force in the middle [N].
    """

    stiffness: float
    half: float | None = None
    lags: bool = False
    friction: float = 0.0
    bias: float = 0.0


def in_series(spec: mujoco.MjSpec, effect: str, joint: str, spring: Spring) -> None:
    """Add a sprung joint for ``effect`` in series with the joint of this name, on the same axis."""
    driven = spec.joint(joint)
    name = f"{effect}{MARK}{joint}{LAGS * spring.lags}"
    _add(driven.parent, name, driven.type, driven.axis, spring).pos = driven.pos


def hinge(
    effect: str, part: str, body: mujoco.MjsBody, axis: Sequence[float], spring: Spring
) -> None:
    """Add a sprung hinge named EFFECT:PART at a body's origin, about an axis (3,) in body axes."""
    _add(body, f"{effect}{MARK}{part}", mujoco.mjtJoint.mjJNT_HINGE, axis, spring)


def slide(
    spec: mujoco.MjSpec, effect: str, part: str, axis: Sequence[float], spring: Spring
) -> None:
    """Let the tool's mass slide on a spring, named EFFECT:PART, along an axis (3,), sensor axes."""
    body, kind = tool_mass(spec, effect), mujoco.mjtJoint.mjJNT_SLIDE
    added = _add(body, f"{effect}{MARK}{part}", kind, axis, spring)
    added.frictionloss, added.springref = spring.friction, spring.bias / spring.stiffness


def tool_mass(spec: mujoco.MjSpec, effect: str) -> mujoco.MjsBody:
    """Return the MJCF body that holds the tool's mass alone, so that it can move; made once."""
    tool = spec.body("tool")
    for child in tool.bodies:
        if child.name.endswith(MASS):
            return child
    mass = tool.add_body(name=effect + MASS, gravcomp=tool.gravcomp, explicitinertial=True)
    mass.mass, mass.ipos, mass.fullinertia = tool.mass, tool.ipos, tool.fullinertia
    tool.mass, tool.inertia, tool.fullinertia = 0.0, [0.0] * 3, [np.nan] * 6
    return mass


def cable(
    spec: mujoco.MjSpec,
    effect: str,
    point: Sequence[float],
    anchor: Sequence[float],
    stiffness: float,
    length: float,
) -> None:
    """Add a spring [N/m], slack within a ``length`` [m], from a point of the tool (3,) [m], sensor
    axes, to an ``anchor`` (3,) [m] in the world."""
    _tendon(spec, f"{effect}{MARK}cable", point, anchor, stiffness, [0.0, length])


def pull(spec: mujoco.MjSpec, effect: str, point: Sequence[float], force: np.ndarray) -> None:
    """Add a constant force (3,) [N] of the world on a tool point (3,) [m], by a tendon to far
    away."""
    strength = float(np.linalg.norm(force))
    if strength > 0.0:
        anchor = FAR * np.asarray(force) / strength
        _tendon(spec, f"{effect}{MARK}pull", point, anchor, strength / FAR, [0.0, 0.0])


def plane(
    spec: mujoco.MjSpec,
    effect: str,
    point: Sequence[float],
    normal: np.ndarray,
    depth: float,
    stiffness: float,
) -> None:
    """Add a plane n·p = depth [m] (n: ``normal`` (3,), world) that pushes a tool point (3,) [m]
    back like a spring [N/m]: a tendon from far behind the plane that resists pressure only."""
    from scipy.spatial.transform import Rotation  # slow to load: only when it is used

    name = f"{effect}{MARK}plane"
    frame = spec.worldbody.add_body(name=f"{name}.frame", pos=[*map(float, depth * normal)])
    turned, *_ = Rotation.align_vectors(normal[None], np.array([[0.0, 0.0, 1.0]]))
    frame.quat = turned.as_quat(scalar_first=True)
    frame.add_site(name=f"{name}.anchor", pos=[0.0, 0.0, -BEHIND])
    _tendon(spec, name, point, None, stiffness, [BEHIND, 2.0 * BEHIND])


def _add(
    body: mujoco.MjsBody, name: str, kind: mujoco.mjtJoint, axis: Sequence[float], spring: Spring
) -> mujoco.MjsJoint:
    try:
        joint = body.add_joint(name=name, type=kind, axis=axis)
    except ValueError as cause:  # the name is taken
        twice = " acts twice on ".join(name.split(MARK, 1))
        raise ParameterError(f"effect {twice}: give it once, with one value") from cause
    joint.limited = spring.half is not None
    joint.ref, joint.armature = 0.0, ROTOR
    joint.stiffness = [spring.stiffness, 0.0, 0.0]
    joint.damping = [abs(spring.stiffness) * DAMPING_S, 0.0, 0.0]
    if spring.half is not None:
        joint.range = [-spring.half, spring.half]
        joint.solref_limit, joint.solimp_limit = _HARD
    return joint


def _tendon(
    spec: mujoco.MjSpec,
    name: str,
    point: Sequence[float],
    anchor: Sequence[float] | np.ndarray | None,
    stiffness: float,
    lengths: Sequence[float],
) -> None:
    """Add a tendon from a world ``anchor`` (3,) (None: an existing site) to a tool point (3,) [m]:
    a spring [N/m] outside of ``lengths`` (low, high) [m]; and a sensor of its force."""
    if anchor is not None:
        spec.worldbody.add_site(name=f"{name}.anchor", pos=[float(x) for x in anchor])
    spec.body("tool").add_site(name=f"{name}.point", pos=[float(x) for x in point])
    tendon = spec.add_tendon(name=name)
    for end in ("anchor", "point"):
        tendon.wrap_site(f"{name}.{end}")
    tendon.stiffness, tendon.springlength = [stiffness, 0.0, 0.0], list(lengths)
