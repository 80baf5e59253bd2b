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
from wrenchbed.robots.base import STEP, sample_until
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
        self._loops = ClosedLoops(arm, self._geometry(self.parameters.nominal))
        homes = zip(arm.links, self._loops.home.tolist(), strict=True)
        self.arm_model = replace(arm, links=tuple(replace(x, home=at) for x, at in homes))

    @property
    def lengths(self) -> tuple[str, ...]:
        """Positions of all links on others that move something."""
        names = [
            f"link.{link.body}.position.{a}"
            for link, before in zip(self.arm_model.links, self.arm_model.parents, strict=True)
            for a in "xyz"
            if before >= 0
        ]
        return tuple(n for n in names if n not in self.unobservable)

    @cached_property
    def unobservable(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of parameters that no reading shows: passive joints or planar loops absorb them."""
        rng = np.random.default_rng(1)
        q = self.sample(_PROBES, rng)
        theta, size = self.parameters.nominal, self.parameters.tolerance
        theta = theta + 0.1 * size * rng.uniform(-1.0, 1.0, len(theta))
        names = [n for n in self.parameters.names if n not in self.load]
        unseen = []
        for name in names:
            k = self.parameters.index(name)
            shifted = theta.astype(complex)
            shifted[k] += 1j * STEP
            moved = [x.imag / STEP * size[k] for x in self.sensor_pose(q, shifted)]
            if max(float(np.nanmax(np.abs(x))) for x in moved) < 1e-13:
                unseen.append(name)
        return tuple(unseen)

    @property
    def eye(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        arm = self.arm_model
        middle = self.sensor_pose(self.home[None], self.parameters.nominal)[1][0]
        middle = 0.5 * (middle + arm.base_shift)
        place = middle + max(arm.reach, 0.1) * np.array([0.9, -1.2, 0.6])
        return tuple(place.tolist()), tuple(middle.tolist())

    def _geometry(self, theta: np.ndarray) -> Geometry:
        arm = self.arm_model
        assert arm.loops is not None

        def turned(fixed: np.ndarray, columns: np.ndarray | list[int]) -> np.ndarray:
            vector = theta[..., columns]
            return fixed @ exp(*np.moveaxis(vector, -1, 0)) if vector.any() else fixed

        p = self.values(theta)
        places, welds, offsets = [], [], []
        for closure in arm.loops.closures:
            group, pair = f"loop.{closure.name}", (closure.first, closure.second)
            if closure.kind == COUPLED:
                places.append((np.zeros(3), np.zeros(3)))
                offsets.append(p[f"{group}.offset"])
            else:
                bodies = (arm.links[k].body if k >= 0 else "base" for k in pair)
                one, two = (stack_jets([p[f"{group}.{b}.{a}"] for a in "xyz"]) for b in bodies)
                places.append((one, two))
                offsets.append(np.zeros(()))
            index = self.parameters.index
            turn = [index(f"{group}.rotation.{a}") for a in "xyz"] if closure.kind == WELD else []
            welds.append(turned(closure.turn, turn) if turn else closure.turn)
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

    def _placed(self, frame: tuple[Value, Value], theta: np.ndarray) -> tuple[Value, Value]:
        """Frame in world axes from one in base axes."""
        arm = self.arm_model
        base = self._leaning(arm.base_turn, theta)
        return base @ frame[0], apply(base, frame[1]) + arm.base_shift

    def link_frames(self, q: Value, theta: np.ndarray) -> list[tuple[Value, Value]]:
        at, geometry = self._solved(q, theta)
        return [self._placed(f, theta) for f in self._loops.frames(at, geometry)[1:]]

    @property
    def carrier(self) -> int:
        return self.arm_model.end

    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        arm = self.arm_model
        at, geometry = self._solved(q, theta)
        turn, origin = self._placed(self._loops.frames(at, geometry)[arm.end + 1], theta)
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
        at = self._loops.solved(q)
        limits = np.array([[x.lower, x.upper] for x in self.arm_model.links])
        passive = [k for k in range(len(limits)) if k not in self.arm_model.driven]
        x, (low, high) = at[:, passive], limits[passive].T
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
        closures = tuple(
            closure
            if closure.kind == COUPLED
            else replace(closure, places=np.array(places), turn=weld)
            for closure, places, weld in zip(
                arm.loops.closures, geometry.places, geometry.welds, strict=True
            )
        )
        return replace(arm, loops=replace(arm.loops, closures=closures))

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        spec, arm, geometry = super().spec(theta), self.arm_model, self._geometry(theta)
        assert arm.loops is not None
        zeros = dict(zip(arm.driven, geometry.zeros.tolist(), strict=True))
        for n, closure in enumerate(arm.loops.closures):
            if closure.kind == COUPLED:
                spec.equality(closure.name).data[:5] = self._law(n, geometry, zeros)
        spec.key("home").qpos = self.qpos(self.home[None], theta)[0]
        return spec

    def _law(self, n: int, geometry: Geometry, zeros: dict[int, float]) -> np.ndarray:
        """MuJoCo's five coefficients: both joints from home, without their zeros."""
        arm = self.arm_model
        assert arm.loops is not None
        c = arm.loops.closures[n]
        y0, x0, *law = c.law
        if c.second < 0:
            law, start = law[:1], 0.0
        else:
            start = arm.links[c.second].home + zeros.get(c.second, 0.0) - x0
        shifted = np.polynomial.Polynomial(law)(np.polynomial.Polynomial([start, 1.0]))
        result = np.zeros(5)
        result[: len(shifted.coef)] = shifted.coef
        home = arm.links[c.first].home + zeros.get(c.first, 0.0)
        result[0] += y0 + float(geometry.offsets[n]) - home
        return result
