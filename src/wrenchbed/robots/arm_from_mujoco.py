"""A user's model as MuJoCo compiled it → the arm as numbers: which joints move the sensor, which
bodies load it, and, where equality constraints close loops, which joints are driven."""

import re
from collections.abc import Iterable
from dataclasses import replace

import mujoco
import numpy as np

from wrenchbed.errors import ParameterError
from wrenchbed.physics.rotations import matrix, quaternion
from wrenchbed.physics.wrench import six_of
from wrenchbed.robots.arm_mjcf import KINDS
from wrenchbed.robots.arm_numbers import (
    HINGE,
    SLIDE,
    ArmLink,
    ArmModel,
    Closure,
    Load,
    Shape,
    about,
    lighter,
)
from wrenchbed.robots.user_model_xml import ModelSource

SITE = "wrenchbed frame"
"""Name of the site that marks the sensor's frame."""
JOINT, CONNECT, COUPLED = mujoco.mjtJoint, mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_JOINT
CONSTRAINTS = (CONNECT, COUPLED, mujoco.mjtEq.mjEQ_WELD)
"""Equality constraints that a gripper may have; of the arm's own only ``connect`` is read."""
FLOATS = "the base floats: a robot is calibrated on a base that stands: leave the free joint out"
RESERVED = ("world", "base", "flange", "tool", "sensor_side")
"""Names of bodies in every robot's MJCF, which no link may have."""
_SPEED = {HINGE: np.pi / 2, SLIDE: 0.25}
"""Top speed of a joint whose file states none [rad/s, m/s]: half that of a UR5, so that
a plan is slow rather than fast. The TOML states it."""
_RANGE = {HINGE: 6.2832, SLIDE: 1.0}
"""Limits ± of a driven joint whose file states none [rad, m]: a turn; the TOML states it."""
_UNLIMITED = 1000.0
"""Limit ± of a passive joint whose file states none [rad, m]."""
_NOTHING = 1e-9
"""Mass below which a body weighs nothing [kg]."""
_SECOND_ARM = 3
"""Least number of joints in series, off the chain to the sensor, that are a second arm; fewer are a
gripper's or a camera's."""
_SHAPES = {kind: word for word, kind in KINDS.items()}
_HIDDEN_GROUP = 3
"""First group that MuJoCo's own viewer does not show."""
_ROUNDED = 5
"""Decimals of a mesh's vertices [m]: 0.01 mm."""
Frame = tuple[np.ndarray, np.ndarray]
"""Rotation matrix (3, 3) and origin (3,) [m] of a frame in the world."""


class ArmTree:
    """Reads the arm of a compiled model file, standing in its home pose.

    Args:
        model: compiled model with the site `SITE`, where the sensor is.
        source: the file as XML, for names and messages.
        frame: the user's name of that site.
        key: coordinates (nq,) of the keyframe, if there is one.

    Raises:
        ParameterError: the arm has a kind of joint or loop that cannot be computed; says which.
    """

    def __init__(
        self, model: mujoco.MjModel, source: ModelSource, frame: str, key: np.ndarray | None
    ) -> None:
        self.model, self.data, self.source = model, mujoco.MjData(model), source
        self.key, self.site = key, model.site(SITE).id
        if key is not None and len(key) == model.nq:
            self.data.qpos[:] = key
        self._above: list[list[int]] = [[]]  # joints that move each body
        for body in range(1, model.nbody):
            self._above.append([*self._above[model.body_parentid[body]], *self._joints(body)])
        self._end = int(model.site_bodyid[self.site])
        if not self._above[self._end]:
            raise self._refusal(f"no joint moves the frame {frame!r}: name one at the arm's end")
        self._refuse_kinds(self._above[self._end])
        self.behind = {self._end}
        for body in range(self._end + 1, model.nbody):  # parents come before their children
            if int(model.body_parentid[body]) in self.behind:
                self.behind.add(body)
        if model.body_jntnum[self._end]:
            self.behind.remove(self._end)
        for e in range(model.neq):  # a load must be connected to the arm through the sensor alone
            one_body, other_body = self._sides(e)
            if (one_body in self.behind) != (other_body in self.behind):
                raise self._refusal(
                    f"the file {self._words(e)}, across the sensor: part of the load goes past it, "
                    "and no wrench follows from weights alone. Name a frame that carries all of it"
                )
        self.chain, self.equalities = self._joined()
        self._refuse_kinds(self.chain)
        for one, other, offset in source.mimics():
            if {one, other} & {self._joint_name(j) for j in self.chain}:
                raise self._refusal(
                    f"the file couples joints {one!r} and {other!r}: no arm of coupled joints can "
                    "be read, only loops that MJCF's equality constraint connect closes"
                )
            if (joint := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, one)) >= 0:
                self.data.qpos[model.jnt_qposadr[joint]] = offset  # what it follows is at 0
        self._home = self.data.qpos.copy()
        at = model.jnt_qposadr[self.chain]
        self.data.qpos[at] = model.qpos0[at]
        mujoco.mj_kinematics(model, self.data)

    def arm(self, actuators: Iterable[str]) -> ArmModel:
        """Return the arm's links, load and loops; ``actuators`` names the driven joints."""
        model, data, chain = self.model, self.data, self.chain
        driven = self._driven(actuators) if self.equalities else tuple(range(len(chain)))
        segment = self._segments()
        base = int(model.body_parentid[model.jnt_bodyid[chain[0]]])
        frames = [(_axes(data.xmat[base]), data.xpos[base].copy())]
        frames += [(_axes(data.xmat[model.jnt_bodyid[j]]), data.xanchor[j].copy()) for j in chain]
        moving = [self._above[model.jnt_bodyid[j]] for j in chain]
        before = [[i for i in some if i < j and i in chain]
                  for j, some in zip(chain, moving, strict=True)]  # fmt: skip
        parents = tuple(chain.index(joints[-1]) if joints else -1 for joints in before)
        links = [
            self._link(k, np.flatnonzero(segment == k + 1), frames[p + 1], frames[k + 1],
                       k in driven)
            for k, p in enumerate(parents)
        ]  # fmt: skip
        last = chain.index(self._above[self._end][-1])
        closures = [self._closure(n, frames, segment) for n in range(len(self.equalities))]
        turn, origin = frames[last + 1]
        end, at = _axes(data.site_xmat[self.site]), data.site_xpos[self.site]
        carried, load = np.array(sorted(self.behind), dtype=int), None
        mass, cog, inertia = self._together(carried, (end, at))
        if mass > 0.0:
            numbers = tuple(cog.tolist()), tuple(six_of(inertia).tolist())
            names = tuple(model.body(b).name for b in carried)
            load = Load(mass, *numbers, names, self._shapes(carried, (end, at)))
        gravity = (0.0, 0.0, -9.80665) if self.source.urdf else model.opt.gravity
        stated = str(self.source.root.get("model") or self.source.root.get("name") or "MuJoCo")
        name = self.source.path.stem if "MuJoCo" in stated else stated
        return ArmModel(
            name=re.sub(r"[^A-Za-z0-9_.-]+", "_", name),
            base_turn=frames[0][0], base_shift=frames[0][1],
            base_shapes=self._shapes(np.flatnonzero(segment == 0), frames[0]),
            links=_distinct(links), end_turn=turn.T @ end, end_shift=turn.T @ (at - origin),
            load=load, gravity=tuple(map(float, gravity)),
            parents=parents, end=last, driven=driven, closures=tuple(closures),
        )  # fmt: skip

    def held(self, allowed: bool) -> list[str]:
        """Names of joints that move neither the sensor nor what is behind it; a `ParameterError` if
        they are a second arm and ``allowed`` is False."""
        depth, names = 0, list[str]()
        for body in sorted(set(range(self.model.nbody)) - self.behind):
            series = [
                j for j in self._above[body]
                if j not in self.chain and self.model.jnt_type[j] != JOINT.mjJNT_FREE
            ]  # fmt: skip
            depth = max(depth, len(series))
            names += [n for n in map(self._joint_name, series) if n not in names]
        if depth >= _SECOND_ARM and not allowed:
            raise self._refusal(
                f"holds a second arm: {', '.join(names)} are neither on the way to "
                "the frame nor behind it; --hold-others keeps them where the file has them"
            )
        return names

    def _refusal(self, words: str) -> ParameterError:
        return ParameterError(f"{self.source.path}: {words}")

    def _joints(self, body: int) -> range:
        first = int(self.model.body_jntadr[body])
        return range(first, first + int(self.model.body_jntnum[body]))

    def _joint_name(self, j: int) -> str:
        return self.model.joint(j).name or f"joint{j + 1}"

    def _refuse_kinds(self, joints: Iterable[int]) -> None:
        """Raise `ParameterError` for a joint of this list that is neither a hinge nor a slide."""
        for j in joints:
            body = int(self.model.jnt_bodyid[j])
            named = f"{self._joint_name(j)!r} of {self.model.body(body).name!r}"
            if self.model.jnt_type[j] == JOINT.mjJNT_FREE:
                raise self._refusal(f"free joint {named}: {FLOATS}")
            if self.model.jnt_type[j] == JOINT.mjJNT_BALL:
                raise self._refusal(
                    f"{named} is a ball joint: only hinges and slides can be moved "
                    "(three hinges in one body turn like a ball)"
                )

    def _sides(self, e: int) -> tuple[int, int]:
        """Numbers of the two bodies that the e-th equality constraint couples; 0 is the world."""
        model, one, two = self.model, int(self.model.eq_obj1id[e]), int(self.model.eq_obj2id[e])
        if model.eq_type[e] == COUPLED:
            return int(model.jnt_bodyid[one]), int(model.jnt_bodyid[two]) if two >= 0 else 0
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            return int(model.site_bodyid[one]), int(model.site_bodyid[two])
        return one, two

    def _words(self, e: int) -> str:
        """Describe the e-th equality constraint for messages: what it couples or closes."""
        model, one, two = self.model, int(self.model.eq_obj1id[e]), int(self.model.eq_obj2id[e])
        if model.eq_type[e] == COUPLED:
            other = repr(model.joint(two).name) if two >= 0 else "a number"
            return f"couples joints {model.joint(one).name!r} and {other}"
        first, second = (model.body(b).name for b in self._sides(e))
        return f"closes a loop between {first!r} and {second!r}"

    def _joined(self) -> tuple[list[int], list[int]]:
        """Numbers of the joints that move the sensor, through loops too, in MuJoCo's order, and of
        the equalities that close these loops, each a ``connect``, or else a `ParameterError`."""
        joints, equalities = set(self._above[self._end]), set[int]()
        while True:
            reached = set()
            for e in range(self.model.neq):
                moving = [set(self._above[b]) for b in self._sides(e) if b not in self.behind]
                if any(m & joints for m in moving):
                    reached.add(e)
                    joints |= set().union(*moving)
            if reached == equalities:
                break
            equalities = reached
        for e in sorted(equalities):
            if self.model.eq_type[e] != CONNECT:
                raise self._refusal(
                    f"the file {self._words(e)}: only the equality constraint connect is read "
                    "between links of an arm"
                )
        return sorted(joints), sorted(equalities)

    def _driven(self, actuators: Iterable[str]) -> tuple[int, ...]:
        """Numbers of the arm's joints that have actuators, in the actuators' order."""
        names = [self.model.joint(j).name for j in self.chain]
        driven = tuple(names.index(name) for name in actuators if name in names)
        if not driven:
            raise self._refusal(
                f"the file {self._words(self.equalities[0])}, and no <actuator> says which joints "
                f"are driven (of {', '.join(n or '?' for n in names)})"
            )
        return driven

    def _closure(self, n: int, frames: list[Frame], segment: np.ndarray) -> Closure:
        """Make the `Closure` of the n-th loop equality, with joints at reference values, from the
        links' world frames and each body's link number, ``segment`` (B,)."""
        model, data, e = self.model, self.data, self.equalities[n]
        name = _plain(model.equality(e).name or f"loop{n + 1}")
        one, two = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            points = [data.site_xpos[s] for s in (one, two)]
        else:
            places = zip((one, two), model.eq_data[e][:6].reshape(2, 3), strict=True)
            points = [data.xpos[b] + _axes(data.xmat[b]) @ place for b, place in places]
        ends = [int(segment[b]) for b in self._sides(e)]
        at = [frames[k][0].T @ (p - frames[k][1]) for k, p in zip(ends, points, strict=True)]
        return Closure(name, ends[0] - 1, ends[1] - 1, np.array(at))

    def _segments(self) -> np.ndarray:
        """Link number of each body (B,), from 1; 0 of the base, −1 of the load and what floats."""
        result = np.zeros(self.model.nbody, dtype=int)
        for body, above in enumerate(self._above):
            loose = any(self.model.jnt_type[j] == JOINT.mjJNT_FREE for j in above)
            moving = [self.chain.index(j) + 1 for j in above if j in self.chain]
            result[body] = -1 if loose or body in self.behind else max(moving, default=0)
        return result

    def _link(
        self, k: int, bodies: np.ndarray, before: Frame, here: Frame, driven: bool
    ) -> ArmLink:
        model, j = self.model, self.chain[k]
        kind = HINGE if model.jnt_type[j] == JOINT.mjJNT_HINGE else SLIDE
        axis = model.jnt_axis[j] / np.linalg.norm(model.jnt_axis[j])
        ref = float(model.qpos0[model.jnt_qposadr[j]])
        turn, shift = before[0].T @ here[0], before[0].T @ (here[1] - before[1])
        if kind == HINGE and ref:
            turn = turn @ about(axis, -ref)
        elif ref:
            shift = shift - turn @ axis * ref
        body, name = int(model.jnt_bodyid[j]), self._joint_name(j)
        body_name = model.body(body).name or f"link{k + 1}"
        body_name = body_name if j == self._joints(body)[-1] else f"{body_name}_{name}"
        lower, upper, home = self._range(j, _RANGE[kind] if driven else _UNLIMITED)
        mass, cog, inertia = self._together(bodies, here)
        return ArmLink(
            joint=_plain(name), body=_plain(body_name), kind=kind, axis=axis, turn=turn,
            shift=shift, lower=lower, upper=upper,
            speed=self.source.speeds().get(name, float(_SPEED[kind])), home=home,
            mass=mass, cog=cog, inertia=inertia, shapes=self._shapes(bodies, here),
        )  # fmt: skip

    def _range(self, j: int, bound: float) -> tuple[float, float, float]:
        """Limits and home of joint j [rad or m]; limits are ± ``bound`` where the file has none,
        and in a loop home is the keyframe's."""
        model, home = self.model, float(self._home[self.model.jnt_qposadr[j]])
        limited = bool(model.jnt_limited[j])
        lower, upper = (float(x) for x in (model.jnt_range[j] if limited else (-bound, bound)))
        inside = lower <= home <= upper
        if self.equalities and not inside:
            raise self._refusal(
                f"joint {self._joint_name(j)} stands at {home:g}, outside its limits "
                f"{lower:g} … {upper:g}: state a keyframe within"
            )
        if not inside or (not self.equalities and self.key is None and home in (lower, upper)):
            home = 0.5 * (lower + upper)
        return lower, upper, home

    def _together(self, bodies: np.ndarray, frame: Frame) -> tuple[float, np.ndarray, np.ndarray]:
        """Total mass [kg], CoG (3,) [m] and inertia about it (3, 3) [kg·m²] of bodies (by number),
        in the axes of ``frame``."""
        model, data, (turn, origin) = self.model, self.data, frame
        some = [b for b in bodies if b and model.body_mass[b] > _NOTHING]
        mass = float(sum(model.body_mass[b] for b in some))
        if not some:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        places = {b: data.xpos[b] + _axes(data.xmat[b]) @ model.body_ipos[b] for b in some}
        centre = sum(model.body_mass[b] * places[b] for b in some) / mass
        inertia = np.zeros((3, 3))  # about the centre at once: a plate's would lose its last digits
        for b in some:
            axes, r = _axes(data.xmat[b]) @ matrix(model.body_iquat[b]), places[b] - centre
            inertia += axes @ np.diag(model.body_inertia[b]) @ axes.T
            inertia += model.body_mass[b] * (r @ r * np.eye(3) - np.outer(r, r))
        return mass, turn.T @ (centre - origin), turn.T @ inertia @ turn

    def _shapes(self, bodies: np.ndarray, frame: Frame) -> tuple[Shape, ...]:
        """Shapes of bodies (by number), visual geoms or else collision geoms, in a frame's axes."""
        model, data, shapes, (turn, origin) = self.model, self.data, list[Shape](), frame
        for body in bodies:
            axes = _axes(data.xmat[body])
            geoms = np.flatnonzero(model.geom_bodyid == body)
            ghost = (model.geom_contype[geoms] == 0) & (model.geom_conaffinity[geoms] == 0)
            visual = geoms[ghost & (model.geom_group[geoms] < _HIDDEN_GROUP)]
            for g in visual if len(visual) else geoms:
                kind = _SHAPES.get(mujoco.mjtGeom(model.geom_type[g]))
                if kind is None:
                    continue
                pos = turn.T @ (data.xpos[body] + axes @ model.geom_pos[g] - origin)
                quat = quaternion(turn.T @ axes @ matrix(model.geom_quat[g]))
                size, colour, material = model.geom_size[g], model.geom_rgba[g], model.geom_matid[g]
                if material >= 0 and np.allclose(colour, [0.5, 0.5, 0.5, 1.0]):
                    colour = model.mat_rgba[material]
                numbers = (tuple(x.tolist()) for x in (size, pos, quat, colour))
                shape = Shape(kind, *numbers)
                shapes.append(shape if kind != "mesh" else self._with_mesh(shape, int(g)))
        return tuple(shapes)

    def _with_mesh(self, shape: Shape, g: int) -> Shape:
        model, m = self.model, int(self.model.geom_dataid[g])
        first, count = int(model.mesh_vertadr[m]), int(model.mesh_vertnum[m])
        face, faces = int(model.mesh_faceadr[m]), int(model.mesh_facenum[m])
        vertices, kept = lighter(
            np.array(model.mesh_vert[first : first + count], dtype=float),
            np.array(model.mesh_face[face : face + faces]),
        )
        rounded = tuple(tuple(round(x, _ROUNDED) for x in v) for v in vertices.tolist())
        return replace(shape, vertices=rounded, faces=tuple(map(tuple, kept.tolist())))


def _axes(nine: np.ndarray) -> np.ndarray:
    return nine.reshape(3, 3).copy()


def _plain(name: str) -> str:
    """Replace characters in a name that have a meaning in patterns and effect names."""
    return re.sub(r"[^\w.-]", "_", name)


def _distinct(links: Iterable[ArmLink]) -> tuple[ArmLink, ...]:
    """Return the links with numbers added to names that occur more than once."""
    bodies, joints, renamed = set(RESERVED), set[str](), []
    for k, link in enumerate(links, start=1):
        body = link.body if link.body not in bodies else f"{link.body}_{k}"
        joint = link.joint if link.joint not in joints else f"{link.joint}_{k}"
        bodies.add(body)
        joints.add(joint)
        renamed.append(replace(link, body=body, joint=joint))
    return tuple(renamed)
