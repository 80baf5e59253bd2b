"""Does the robot hit itself or what stands around it? MuJoCo's collision test along whole paths.

Every geom of the robot's MJCF counts, as it looks. Bodies that are at most two joints apart, or
that touch at home or in three of ten random poses, may touch: they are built or drawn so.
"""

from collections import Counter
from functools import cache, cached_property, lru_cache
from itertools import pairwise, permutations

import mujoco
import numpy as np

from wrenchbed.errors import PlanError
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.mjspec_edits import compiled

STEP = 0.03
"""Largest move of a joint between two collision tests [rad or m]."""
MARGIN = 0.005
"""Distance from which two bodies count as touching [m]."""
_DETOURS = 60
_OFTEN = 0.3
_PER_LEG = 0.3
"""Cost of each straight leg of a path, beside its length [rad or m]: prefers few, longer legs."""


class Clearance:
    """Collision checks of a robot with itself and its surroundings, in MuJoCo."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self.robot = robot
        self._theta = robot.parameters.nominal
        spec = robot.spec(self._theta)
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 1
            geom.margin = MARGIN / 2
        self.model = compiled(spec)
        self._data = mujoco.MjData(self.model)

    def hit(self, q: np.ndarray) -> str:
        """Sentence that names the first contact at joint values (J,); empty if there is none."""
        for a, b, _, _ in sorted(self._touching(q) - self._built):
            return f"{self._name(a)} would touch {self._name(b)}"
        return ""

    def blocked(self, start: np.ndarray, end: np.ndarray) -> str:
        """Sentence that names the first contact on a straight joint-space move from ``start`` to
        ``end`` (J,), and where on it; empty if the move is free."""
        n = max(1, int(np.ceil(np.abs(end - start).max() / STEP)))
        for share in np.arange(1, n + 1) / n:
            if what := self.hit(start + share * (end - start)):
                return f"{what}, {100 * share:.0f} % along the way"
        return ""

    def path(self, start: np.ndarray, end: np.ndarray, where: str) -> list[np.ndarray]:
        """Find a collision-free path from ``start`` to ``end`` (J,): its way points, last ``end``.

        A straight joint move if that is free, else the shortest free path over one or two of home
        and random poses. A `PlanError`, which says by what, if ``end`` (called ``where`` in it) or
        every such path is blocked.
        """
        if why := self.hit(end):
            raise PlanError(f"{where}: {why}")
        why = self.blocked(start, end)
        if not why:
            return [end]
        nodes = [start, end, self.robot.home, *self._free]
        length = np.abs(np.array(nodes)[:, None] - np.array(nodes)).max(axis=2) + _PER_LEG
        free = cache(lambda a, b: not self.blocked(nodes[a], nodes[b]))
        stops = [via for n in (1, 2) for via in permutations(range(2, len(nodes)), n)]
        legs = [list(pairwise((0, *via, 1))) for via in stops]
        for way in sorted(legs, key=lambda way: sum(length[leg] for leg in way)):
            if all(free(*leg) for leg in (way[0], way[-1], *way[1:-1])):  # the ends are few
                return [nodes[leg[1]] for leg in way]
        remedy = "" if self.hit(start) else "leave this pose out, or "
        remedy += "move the robot elsewhere by hand"
        raise PlanError(f"{where}: {why}, and no way around was found: {remedy}")

    @cached_property
    def _built(self) -> set[tuple[int, int, int, int]]:
        """Pairs of bodies in contact at home or in many random poses, which `hit` leaves out."""
        drawn = self.robot.sample(_DETOURS, np.random.default_rng(1))
        often = Counter(pair for q in drawn for pair in self._touching(q))
        usual = {pair for pair, n in often.items() if n > _OFTEN * len(drawn)}
        return usual | self._touching(self.robot.home)

    @cached_property
    def _free(self) -> list[np.ndarray]:
        """Joint values of random poses without contact, as way points around obstacles."""
        drawn = self.robot.sample(_DETOURS, np.random.default_rng(0))
        return [q for q in drawn if not self.hit(q)]

    def _touching(self, q: np.ndarray) -> set[tuple[int, int, int, int]]:
        """Pairs in contact at q (J,): body numbers a < b (a, b, 0, 0), or, of b with the
        surroundings, which are body 0, also the numbers of both geoms (0, b, geom, geom)."""
        model, data = self.model, self._data
        data.qpos[:] = self.robot.qpos(q[None], self._theta)[0]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        pairs = set()
        for contact in data.contact[: data.ncon]:
            geoms = [int(g) for g in contact.geom]
            (a, g), (b, h) = sorted(
                (int(model.body_weldid[model.geom_bodyid[g]]), g) for g in geoms
            )
            if not self._close[a, b]:
                pairs.add((a, b, g, h) if a == 0 else (a, b, 0, 0))
        return pairs

    @cached_property
    def _close(self) -> np.ndarray:
        """Whether two bodies are at most two joints apart (B, B), boolean, loops included."""
        model = self.model
        joined = np.eye(model.nbody, dtype=int)
        pairs = [(b, int(model.body_parentid[b])) for b in range(1, model.nbody)]
        loops = model.eq_type == mujoco.mjtEq.mjEQ_CONNECT
        sites = model.eq_objtype[loops] == mujoco.mjtObj.mjOBJ_SITE
        ends = np.stack([model.eq_obj1id[loops], model.eq_obj2id[loops]], axis=-1)
        pairs += [
            tuple(model.site_bodyid[pair]) if at_site else tuple(pair)
            for pair, at_site in zip(ends, sites, strict=True)
        ]
        for pair in pairs:
            a, b = model.body_weldid[list(pair)]
            joined[a, b] = joined[b, a] = 1
        return np.asarray(joined @ joined > 0)

    def _name(self, body: int) -> str:
        return self.model.body(body).name if body else "what stands around it"


clearance = lru_cache(maxsize=4)(Clearance)
"""Cached constructor: the `Clearance` of a robot, whose harmless contacts take a while to find."""
