"""A robot from a file whose joints close loops: its driven joints are q1 …, `closed_loop` solves
the passive ones.

Parameters are those of a `FileArm`, of driven and passive links alike, and the points at which the
loops hold the links, ``loop.<equality>.<body>.x`` …; passive joints have no zero.
"""

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchbed.physics.gravity import BodyMass
from wrenchbed.physics.rotations import apply, exp
from wrenchbed.physics.time_derivatives import Value, stack_jets
from wrenchbed.robots.arm_model import COUPLED, WELD, ArmModel
from wrenchbed.robots.base import STEP, complex_steps, sample_until
from wrenchbed.robots.closed_loop import ClosedLoops, Geometry
from wrenchbed.robots.file_arm import ArmDescription, DescribedArm

if TYPE_CHECKING:
    import mujoco

_PROBES = 8
"""Poses at which parameters are looked at that nothing depends on: two do not hide one by chance,
more cost time at each first use."""


class LoopArm(DescribedArm):
    """An arm with closed loops from MJCF, and a six-axis sensor at a named frame.

    Raises:
        ParameterError: its loops do not close at home, or do not determine every passive joint.
    """

    candidates = ("joint", "link", "loop", "base.tilt", "mount", "tool.mass", "tool.cog")

    def __init__(self, description: ArmDescription, record: dict[str, Any] | None = None) -> None:
        super().__init__(description, record)
        arm = self.arm_model
        self.bodies = tuple(
            BodyMass(x.body, x.mass, (float(x.cog[0]), float(x.cog[1]), float(x.cog[2])))
            for x in arm.links
        )
        self.carrier = arm.end
        self._loops = ClosedLoops(arm, self._geometry(self.parameters.nominal))
        homes = zip(arm.links, self._loops.home.tolist(), strict=True)
        self.arm_model = replace(arm, links=tuple(replace(x, home=at) for x, at in homes))

    @cached_property
    def lengths(self) -> tuple[str, ...]:  # type: ignore[override]
        """Positions of all links on others that move something."""
        arm = self.arm_model
        places = zip(arm.links, arm.parents, strict=True)
        bodies = [link.body for link, before in places if before >= 0]
        names = [f"link.{body}.position.{a}" for body in bodies for a in "xyz"]
        return tuple(n for n in names if n not in self.unobservable)

    @cached_property
    def unobservable(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of parameters that no reading shows: passive joints or planar loops absorb them."""
        rng, size = np.random.default_rng(1), self.parameters.tolerance
        q = self.sample(_PROBES, rng)
        theta = self.parameters.nominal + 0.1 * size * rng.uniform(-1.0, 1.0, len(size))
        columns = [k for k, n in enumerate(self.parameters.names) if n not in self.load]
        unseen = []
        for k, shifted in zip(columns, complex_steps(theta, columns), strict=True):
            moved = [x.imag / STEP * size[k] for x in self.sensor_pose(q, shifted[0])]
            if max(float(np.nanmax(np.abs(x))) for x in moved) < 1e-13:
                unseen.append(self.parameters.names[k])
        return tuple(unseen)

    def _geometry(self, theta: np.ndarray) -> Geometry:
        arm, p = self.arm_model, self.values(theta)

        def turned(fixed: np.ndarray, columns: np.ndarray | list[int]) -> np.ndarray:
            vector = theta[..., columns]
            return fixed @ exp(*np.moveaxis(vector, -1, 0)) if vector.any() else fixed

        places, welds, offsets = [], [], []
        for closure in arm.closures:
            group, one, two = f"loop.{closure.name}", np.zeros(3), np.zeros(3)
            if closure.kind != COUPLED:
                bodies = (arm.links[k].body if k >= 0 else "base"
                          for k in (closure.first, closure.second))  # fmt: skip
                one, two = (stack_jets([p[f"{group}.{b}.{a}"] for a in "xyz"]) for b in bodies)
            places.append((one, two))
            offsets.append(p[f"{group}.offset"] if closure.kind == COUPLED else np.zeros(()))
            turn = [self.parameters.index(f"{group}.rotation.{a}") for a in "xyz"
                    if closure.kind == WELD]  # fmt: skip
            welds.append(turned(closure.turn, turn))
        links = zip(arm.links, self._turns, strict=True)
        return Geometry(
            [turned(link.turn, columns) for link, columns in links],
            [theta[..., columns] for columns in self._places],
            self.zeros(theta), places, welds, offsets,
        )  # fmt: skip

    def _solved(self, q: Value, theta: np.ndarray) -> tuple[list[Value], Geometry]:
        """Values of all joints, (…, N) each, and the geometry."""
        geometry, real = self._geometry(theta), theta.real
        if real.ndim > 1 and (real == real.reshape(-1, real.shape[-1])[0]).all():
            real = real.reshape(-1, real.shape[-1])[0]  # a batch of complex steps of one robot
        steps = np.iscomplexobj(theta)
        return self._loops.lifted(q, geometry, self._geometry(real), steps), geometry

    def link_frames(self, q: Value, theta: np.ndarray) -> list[tuple[Value, Value]]:
        frames = self._loops.frames(*self._solved(q, theta))[1:]
        return [self._placed(*frame, theta) for frame in frames]

    def _placed(self, turn: Value, origin: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """Frame in world axes from one in base axes."""
        base = self._leaning(self.arm_model.base_turn, theta)
        return base @ turn, apply(base, origin) + self.arm_model.base_shift

    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        arm, frames = self.arm_model, self._loops.frames(*self._solved(q, theta))
        turn, origin = self._placed(*frames[arm.end + 1], theta)
        return turn @ arm.end_turn, origin + apply(turn, arm.end_shift)

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        bad = self._outside_limits(q)
        inside = np.setdiff1d(np.arange(len(q)), list(bad))
        if len(inside):
            at = self._loops.solved(q[inside], self._geometry(theta.real))
            bad |= {int(inside[k]): why for k, why in self._loops.failures(q[inside], at).items()}
        return dict(sorted(bad.items()))

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Within the limits of driven and passive joints, and where the loops close."""
        low, high = self._sampled(self.home)
        return sample_until(n, lambda k: rng.uniform(low, high, (k, len(low))), self._feasible)

    def _feasible(self, q: np.ndarray) -> np.ndarray:
        links, passive = self.arm_model.links, self._loops.passive
        low, high = np.array([(links[k].lower, links[k].upper) for k in passive]).T
        x = self._loops.solved(q)[:, passive]
        return np.asarray(((x >= low) & (x <= high)).all(axis=1))

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        """MuJoCo's joint coordinates (N, nq); zeros are in the MJCF's bodies, not in these."""
        at, _ = self._solved(q, theta)
        at = [1.0 * x for x in at]
        for j, k in enumerate(self.arm_model.driven):
            at[k] = q[..., j]
        return stack_jets(at)

    def at(self, theta: np.ndarray) -> ArmModel:
        arm, geometry = super().at(theta), self._geometry(theta)
        assert arm.loops is not None
        each = zip(arm.closures, geometry.places, geometry.welds, strict=True)
        closures = tuple(
            replace(closure, places=np.array(places), turn=weld) for closure, places, weld in each
        )
        return replace(arm, loops=replace(arm.loops, closures=closures))

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        spec, geometry = super().spec(theta), self._geometry(theta)
        for n, closure in enumerate(self.arm_model.closures):
            if closure.kind == COUPLED:
                spec.equality(closure.name).data[:5] = self._law(n, geometry)
        spec.key("home").qpos = self.qpos(self.home[None], theta)[0]
        return spec

    def _law(self, n: int, geometry: Geometry) -> np.ndarray:
        """MuJoCo's five coefficients: both joints from home, without their zeros."""
        arm, c = self.arm_model, self.arm_model.closures[n]
        home = np.array([link.home for link in arm.links])
        home[list(arm.driven)] += geometry.zeros
        y0, x0, *law = c.law
        if c.second < 0:
            law, start = law[:1], 0.0
        else:
            start = float(home[c.second]) - x0
        shifted = np.polynomial.Polynomial(law)(np.polynomial.Polynomial([start, 1.0]))
        result = np.zeros(5)
        result[: len(shifted.coef)] = shifted.coef
        result[0] += y0 + float(geometry.offsets[n]) - float(home[c.first])
        return result
