"""A robot from a file whose joints close loops: its driven joints are q1 …, `closed_loop` solves
the passive ones.

Parameters are those of a `FileArm`, of driven and passive links alike, and the points at which the
loops hold the links, ``loop.<equality>.<body>.x`` …; passive joints have no zero.
"""

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchbed.physics.gravity_torques import BodyMass
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.taylor_jets import STEP, Value, stack_jets, value
from wrenchbed.robots.arm_numbers import ArmModel
from wrenchbed.robots.base import complex_steps, sample_until
from wrenchbed.robots.closed_loop import ClosedLoops
from wrenchbed.robots.file_arm import ArmDescription, DescribedArm, loop_groups

if TYPE_CHECKING:
    import mujoco

_PROBES = 8
"""Random poses at which parameters without effect are found: two do not hide one by chance, more
cost time at each first use."""


class LoopArm(DescribedArm):
    """An arm with closed loops from MJCF, and a six-axis sensor at a named frame; `ParameterError`
    if its loops do not close at home, or do not determine every passive joint."""

    candidates = ("joint", "link", "loop", "base.tilt", "mount", "tool.mass", "tool.cog")

    def __init__(self, description: ArmDescription, record: dict[str, Any] | None = None) -> None:
        super().__init__(description, record)
        arm = self.arm_model
        self.bodies = tuple(
            BodyMass(x.body, x.mass, (float(x.cog[0]), float(x.cog[1]), float(x.cog[2])))
            for x in arm.links
        )
        self.carrier = arm.end
        self._loops = ClosedLoops(arm)
        homes = zip(arm.links, self._loops.home.tolist(), strict=True)
        self.arm_model = replace(arm, links=tuple(replace(x, home=at) for x, at in homes))

    @cached_property
    def lengths(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the parameters of lengths between moving links that readings can determine."""
        arm = self.arm_model
        places = zip(arm.links, arm.parents, strict=True)
        bodies = [link.body for link, before in places if before >= 0]
        names = [f"link.{body}.position.{a}" for body in bodies for a in "xyz"]
        return tuple(n for n in names if n not in self.unobservable)

    @cached_property
    def unobservable(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of parameters that no reading depends on, as passive joints absorb them."""
        rng, size = np.random.default_rng(1), self.parameters.tolerance
        q = self.sample(_PROBES, rng)
        theta = self.parameters.nominal + 0.1 * size * rng.uniform(-1.0, 1.0, len(size))
        names = self.parameters.names
        columns = [k for k, name in enumerate(names) if name not in self.load]
        poses = self.sensor_pose(q, complex_steps(theta, columns))
        slopes = [np.nanmax(np.abs(x.imag).reshape(len(columns), -1), axis=1) for x in poses]
        moved = np.max(slopes, axis=0) / STEP * size[columns]
        return tuple(names[k] for k, slope in zip(columns, moved, strict=True) if slope < 1e-13)

    def at(self, theta: np.ndarray) -> ArmModel:
        arm, p = super().at(theta), self.values(theta)
        groups = loop_groups(arm)
        places = [[stack_jets([p[f"{g}.{a}"] for a in "xyz"]) for g in two] for two in groups]
        both = zip(arm.closures, places, strict=True)
        return replace(arm, closures=tuple(replace(c, places=np.array(x)) for c, x in both))

    def _solved(self, q: Value, theta: np.ndarray) -> tuple[list[Value], ArmModel]:
        """Values of all joints, (…, N) each, at driven values q (N, J), and the arm at theta."""
        arm, real = self.at(theta), theta.real
        if real.ndim > 1 and (real == real.reshape(-1, real.shape[-1])[0]).all():
            real = real.reshape(-1, real.shape[-1])[0]  # a batch of complex steps of one robot
        real_q, real_arm = value(q).real, self.at(real)
        at = self._loops.solved(real_q, real_q + self.zeros(real), real_arm)
        return self._loops.as_jets(at, q + self.zeros(theta), arm, real_arm), arm

    def link_frames(self, q: Value, theta: np.ndarray) -> list[tuple[Value, Value]]:
        at, arm = self._solved(q, theta)
        return [_placed(*frame, arm) for frame in self._loops.frames(at, arm)[1:]]

    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        at, arm = self._solved(q, theta)
        turn, origin = _placed(*self._loops.frames(at, arm)[arm.end + 1], arm)
        return turn @ arm.end_turn, origin + apply(turn, arm.end_shift)

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        bad = self.outside_limits(q)
        inside = np.setdiff1d(np.arange(len(q)), list(bad))
        if len(inside):
            driven = q[inside] + self.zeros(theta.real)
            at = self._loops.solved(q[inside], driven, self.at(theta.real))
            bad |= {int(inside[k]): why for k, why in self._loops.failures(at).items()}
        return dict(sorted(bad.items()))

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw n random poses (n, J) within all joints' limits at which the loops close."""
        low, high = self._sampled(self.home)
        links, passive = self.arm_model.links, self._loops.passive
        least, most = np.array([(links[k].lower, links[k].upper) for k in passive]).T

        def feasible(q: np.ndarray) -> np.ndarray:
            x = self._loops.solved(q)[:, passive]
            return np.asarray(((x >= least) & (x <= most)).all(axis=1))

        return sample_until(n, lambda k: rng.uniform(low, high, (k, len(low))), feasible)

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        """MuJoCo's joint coordinates (N, nq), without zero offsets, which the MJCF's bodies
        contain."""
        at, _ = self._solved(q, theta)
        at = [1.0 * x for x in at]
        for j, k in enumerate(self.arm_model.driven):
            at[k] = q[..., j]
        return stack_jets(at)

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        spec = super().spec(theta)
        spec.key("home").qpos = self.qpos(self.home[None], theta)[0]
        return spec


def _placed(turn: Value, origin: Value, arm: ArmModel) -> tuple[Value, Value]:
    """Convert a frame (rotation, origin [m]) from the arm's base axes to world axes."""
    return arm.base_turn @ turn, apply(arm.base_turn, origin) + arm.base_shift
