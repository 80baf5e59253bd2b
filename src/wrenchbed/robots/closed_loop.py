"""Closed loops of an arm: passive joints from driven ones, by Newton on the loops' residual.

The residual r(q, x; θ) holds, for each loop, what keeps its two sides apart, in the axes of the
last link before the loop parts. The branch is the keyframe's: poses are reached from it along ways
on which ∂r/∂x stays regular. Velocities, accelerations and parameter derivatives follow by the
implicit function theorem: with the inverse of ∂r/∂x at the solution, each Newton step in the
arithmetic of jets or complex steps makes one more order exact (Griewank & Walther, Evaluating
Derivatives, 2nd ed., ch. 15).

A planar loop closed in space has equations that hold by themselves, such as that across its plane.
They are found at the keyframe and left out; what a parameter error would change there is taken up
by the joints' play.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from wrenchbed.errors import ParameterError
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.taylor_jets import Jet, Value, cos, sin, stack_jets, transposed, value
from wrenchbed.robots.arm_numbers import HINGE, ArmModel

_STRIDE, _CAREFUL = 0.2, 0.05
"""Longest way of a driven joint between two Newton solutions [rad, m over the arm's reach], at
first and where that fails."""
_LEAP = 0.7
"""Longest way of a passive joint in one Newton step [rad, m]; beyond it the branch is lost."""
_CLOSED = 1e-10
"""Largest residual at which a loop counts as closed [rad, m over the arm's reach]."""
_DIGITS = 1e-6
"""Largest residual, from the file's digits, of loop equations that always hold [rad, m over the
arm's reach]."""
_NEAR_SINGULAR = 0.05
"""Smallest 1/‖(∂r/∂x)⁻¹‖ of a pose over that at home: below it an error of
the driven joints moves the passive ones twenty times as far as at home."""
_RANK = 1e-7
"""Singular values of ∂r/∂x below this share of the largest are zero."""
_SEEDS, _ROUNDS, _NEAREST = 300, 3, 2
"""Poses solved beforehand, rounds of reaching them, and how many a pose is reached from."""
_STEPS = 12
"""Newton steps to a solution at most; it needs three to five."""
_KEPT = 8
"""Sets of poses whose solutions are kept: a fit asks for the same poses again and again."""
_BARRED = "the loops cannot close there, or only beyond a singular pose"
Frame = tuple[Value, Value]
"""Rotation (…, N, 3, 3) and origin (…, N, 3) [m] in the base's axes."""


class ClosedLoops:
    """Solves the closed loops of one arm for the values of its passive joints.

    Methods take as ``arm`` the nominal arm or one of other parameters, also a batch (K, 1, …) of
    them or complex steps; joint values include the joints' zero offsets.

    Args:
        arm: nominal arm with closures; its home is where Newton begins.

    Raises:
        ParameterError: the loops do not close at home, or leave a joint free; says which.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.arm, self.closures = arm, arm.closures
        self.driven = list(arm.driven)
        self.passive = [k for k in range(len(arm.links)) if k not in arm.driven]
        self._scale = arm.reach
        self._unit = np.array([1.0 if x.kind == HINGE else self._scale for x in arm.links])
        self._spins = [np.cross(np.eye(3), link.axis) for link in arm.links]
        self._ways: list[list[int]] = [[]]  # links from the base to each link, the base first
        for k, before in enumerate(arm.parents):
            self._ways.append([*self._ways[before + 1], k])
        both = [(self._ways[c.first + 1], self._ways[c.second + 1]) for c in self.closures]
        self._shared = [  # the last link before a loop's two sides part; −1 is the base
            max((a for a, b in zip(*two, strict=False) if a == b), default=-1) for two in both
        ]
        self._kept = np.eye(0)
        self._solutions: dict[tuple[bytes, tuple[int, ...]], np.ndarray] = {}
        self.home = self._at_home(np.array([link.home for link in arm.links]))

    def frames(self, at: Sequence[Value], arm: ArmModel) -> list[Frame]:
        """Rotation and origin of base and L links, in base axes, at L joint values, (…, N) each."""
        frames: list[Frame] = [(np.eye(3), np.zeros(3))]
        for k, (link, before) in enumerate(zip(arm.links, arm.parents, strict=True)):
            turn, origin = frames[before + 1]
            origin = origin + apply(turn, link.shift)
            turn = turn @ link.turn
            if link.kind == HINGE:
                once = turn @ self._spins[k]
                s, c = sin(at[k])[..., None, None], cos(at[k])[..., None, None]
                turn = turn + once * s + (once @ self._spins[k]) * (1.0 - c)
            else:
                origin = origin + apply(turn, link.axis) * at[k][..., None]
            frames.append((turn, origin))
        return frames

    def residual(self, at: Sequence[Value], arm: ArmModel) -> Value:
        """Residual (…, N, E) of all loops, three numbers each [m over the arm's reach], at L joint
        values ``at``, (…, N) each."""
        frames = self.frames(at, arm)
        parts: list[Value] = []
        for n, closure in enumerate(arm.closures):
            (one, first), (two, second) = frames[closure.first + 1], frames[closure.second + 1]
            here, there = closure.places
            back = transposed(frames[self._shared[n] + 1][0])
            gap = first + apply(one, here) - second - apply(two, there)
            gap = apply(back, gap) * (1.0 / self._scale)
            parts += [gap[..., i] for i in range(3)]
        return stack_jets(parts)

    def _slopes(self, at: np.ndarray, arm: ArmModel) -> np.ndarray:
        """Derivatives (…, N, E, L) of `residual` by all joints, at their values ``at`` (…, N, L);
        exact on closed loops."""
        frames = self.frames(_split(at), arm)
        rows = []
        for n, closure in enumerate(arm.closures):
            block = np.zeros((*at.shape[:-1], 3, at.shape[-1]))
            rows.append(block)
            shared = self._shared[n] + 1
            back, common = transposed(frames[shared][0]), len(self._ways[shared])
            sides = zip((closure.first, closure.second), closure.places, (1, -1), strict=True)
            for link, place, sign in sides:
                point = frames[link + 1][1] + apply(frames[link + 1][0], place)
                for k in self._ways[link + 1][common:]:
                    axis = sign * apply(frames[k + 1][0], self.arm.links[k].axis)
                    hinge = self.arm.links[k].kind == HINGE
                    moved = np.cross(axis, point - frames[k + 1][1]) if hinge else axis
                    block[..., k] = apply(back, moved) / self._scale
        return np.concatenate(rows, axis=-2)

    def _inverse(self, at: np.ndarray, arm: ArmModel) -> np.ndarray:
        """Inverse (…, N, X, X) of the derivatives of X independent residuals by the X passive
        joints, at joint values ``at`` (…, N, L)."""
        slopes = self._kept @ self._slopes(at, arm)[..., self.passive]
        try:
            return np.linalg.inv(slopes)
        except np.linalg.LinAlgError:
            return np.linalg.inv(slopes + 1e-13 * np.eye(slopes.shape[-1]))

    def _at_home(self, at: np.ndarray) -> np.ndarray:
        """Close the loops near values ``at`` (L,), choose which equations to keep; return all L
        values. A `ParameterError` if loops stay open, leave a joint free, or couple driven ones."""
        for _ in range(3 * _STEPS):
            r = self.residual(_split(at), self.arm)
            step = np.linalg.pinv(self._slopes(at, self.arm)[:, self.passive], _RANK) @ r
            at[self.passive] -= step * min(1.0, _LEAP / max(np.abs(step).max(), 1e-12))
        r = np.abs(self.residual(_split(at), self.arm))
        if r.max() > _DIGITS:
            raise ParameterError(
                "the loops do not close at home (keyframe, else as the file stands): "
                f"{self._open(r)}"
            )
        slopes = self._slopes(at, self.arm)
        left, size, right = np.linalg.svd(slopes[:, self.passive])
        rank = int((size > _RANK * size[0]).sum())
        if rank < len(self.passive):
            free = self._named(self.passive, np.abs(right[rank:]).max(axis=0) > 0.1)
            raise ParameterError(
                f"the driven joints and the loops leave {free} free at home: "
                "drive one by an <actuator>, or state a keyframe that is not singular"
            )
        self._kept = left[:, :rank].T
        fighting = np.abs(left[:, rank:].T @ slopes[:, self.driven]).max(axis=0, initial=0.0)
        if fighting.max() > _DIGITS:
            raise ParameterError(
                f"the driven joints {self._named(self.driven, fighting > _DIGITS)} cannot move by "
                "themselves: the loops couple them; leave out an <actuator>"
            )
        self._floor = _NEAR_SINGULAR * float(_regular(self._inverse(at, self.arm)))
        self._check_left_out(at)
        return at

    def _named(self, links: Sequence[int], which: np.ndarray) -> str:
        return ", ".join(self.arm.links[links[n]].joint for n in np.flatnonzero(which).tolist())

    def _check_left_out(self, home: np.ndarray) -> None:
        """Raise `ParameterError` if the dropped loop equations hold at home but not near it."""
        way = np.random.default_rng(0).uniform(-1.0, 1.0, (4, len(self.driven)))
        goal = home[self.driven] + _STRIDE * way * self._unit[self.driven]
        at = self._follow(np.tile(home, (len(goal), 1)), goal, _CAREFUL)
        r = np.abs(self.residual(_split(at[np.isfinite(at[:, 0])]), self.arm))
        if r.max(initial=0.0) > 10.0 * _DIGITS:
            raise ParameterError(
                "the loops have more equations than they need, and which ones turns with the pose: "
                f"beside home {self._open(r.max(axis=0))}; only loops whose spare equations stay "
                "the same, such as planar ones, can be read"
            )

    def _open(self, r: np.ndarray) -> str:
        """Describe the loop with the widest gap, from residuals (E,) of all loops."""
        gaps = np.abs(r).reshape(-1, 3).max(axis=1)
        widest = self.closures[int(np.argmax(gaps))]
        return f"{widest.name!r} stays {self._scale * gaps.max() * 1e3:.3g} mm open"

    def solved(
        self, q: np.ndarray, driven: np.ndarray | None = None, arm: ArmModel | None = None
    ) -> np.ndarray:
        """Values of all L joints (…, N, L) at driven values q (N, J); rows without solution are
        NaN. For an ``arm`` other than the nominal one ``driven`` (…, N, J) are q plus its zero
        offsets."""
        key = q.tobytes(), q.shape
        if key not in self._solutions:
            if len(self._solutions) >= _KEPT:
                self._solutions.pop(next(iter(self._solutions)))
            self._solutions[key] = self._reached(q)
        at = self._solutions[key]
        if driven is None or arm is None or not np.isfinite(at).any():
            return at
        at = np.broadcast_to(at, (*driven.shape[:-1], at.shape[-1])).copy()
        at[..., self.driven] = driven
        return self._closed(at, arm)

    def _closed(self, at: np.ndarray, arm: ArmModel) -> np.ndarray:
        """Close the loops by Newton from values ``at`` (…, N, L) of all joints near a solution; NaN
        rows where that fails."""
        with np.errstate(all="ignore"):
            last = np.inf
            for _ in range(_STEPS):
                r = self._kept_residual(at, arm)
                worst = float(np.nanmax(np.abs(r), initial=0.0))
                if worst < 1e-13 and worst >= 0.5 * last:
                    break
                last = worst
                at[..., self.passive] -= apply(self._inverse(at, arm), r)
            off = np.abs(self._kept_residual(at, arm)).max(axis=-1)
            at[~(off < _CLOSED)] = np.nan
        return at

    def _kept_residual(self, at: np.ndarray, arm: ArmModel) -> np.ndarray:
        return np.asarray(self.residual(_split(at), arm) @ self._kept.T)

    def _reached(self, q: np.ndarray) -> np.ndarray:
        """Nominal values of all joints (N, L) at driven values q (N, J); NaN where none exist."""
        goal, seeds = q, self._seeds
        at = np.full((len(q), len(self.arm.links)), np.nan)
        finite = np.flatnonzero(np.isfinite(goal).all(axis=1))
        away = self._distances(goal[finite], seeds)
        near = np.argsort(away, axis=1, kind="stable")[:, :_NEAREST].T
        home = np.zeros(len(finite), dtype=int)
        fast = [(start, _STRIDE) for start in near]
        careful = [(start, _CAREFUL) for start in (home, *near)]
        for start, stride in (*fast, *careful):
            rest = np.isnan(at[finite, 0])
            if not rest.any():
                break
            at[finite[rest]] = self._follow(seeds[start[rest]], goal[finite[rest]], stride)
        return self._closed(at, self.arm)

    def _distances(self, goal: np.ndarray, solutions: np.ndarray) -> np.ndarray:
        """Distance (N, S) [rad, m over the arm's reach] of driven values (N, J) from those in S
        solutions (S, L), values of all joints."""
        way = (goal[:, None] - solutions[None][..., self.driven]) / self._unit[self.driven]
        return np.linalg.norm(way, axis=-1)

    @cached_property
    def _seeds(self) -> np.ndarray:
        """Solutions (S, L), spread over the driven joints' limits, to start from; home first."""
        low, high = np.array([(x.lower, x.upper) for x in self.arm.moved]).T
        rng = np.random.default_rng(0)
        goal = rng.uniform(low, high, (_SEEDS, len(low)))
        solutions = self.home[None]
        for _ in range(_ROUNDS):
            near = np.argmin(self._distances(goal, solutions), axis=1)
            at = self._follow(solutions[near], goal, _CAREFUL)
            good = np.isfinite(at).all(axis=1)
            solutions, goal = np.concatenate([solutions, at[good]]), goal[~good]
            if not good.any() or not len(goal):
                break
        return solutions

    def _follow(self, start: np.ndarray, goal: np.ndarray, stride: float) -> np.ndarray:
        """Joint values (N, L) at the end of a straight way from solutions (N, L) to driven values
        (N, J), in steps of ``stride`` [rad, m over the reach]; NaN where a loop opens on the
        way."""
        at, begin = start.copy(), start[:, self.driven]
        longest = (np.abs(goal - begin) / self._unit[self.driven]).max(axis=1)
        strides = np.maximum(1, np.ceil(longest / stride)).astype(int)
        for n in range(1, int(strides.max(initial=0)) + 1):
            rows = np.flatnonzero((strides >= n) & np.isfinite(at[:, 0]))
            if not len(rows):
                break
            fraction = (n / strides[rows])[:, None]
            driven = begin[rows] + fraction * (goal[rows] - begin[rows])
            at[rows] = self._stride(at[rows], driven)
        return at

    def _stride(self, at: np.ndarray, driven: np.ndarray) -> np.ndarray:
        at[:, self.driven] = driven
        with np.errstate(all="ignore"):
            for _ in range(3):
                inverse = self._inverse(at, self.arm)
                step = apply(inverse, self._kept_residual(at, self.arm))
                at[:, self.passive] -= step
                at[~(np.abs(step).max(axis=1) < _LEAP)] = np.nan
            settled = np.abs(step).max(axis=1) < 1e-3
            at[~(settled & (_regular(inverse) > self._floor))] = np.nan
        return at

    def as_jets(self, at: np.ndarray, driven: Value, arm: ArmModel, real: ArmModel) -> list[Value]:
        """Values of all joints, (…, N) each, as jets or complex numbers. Their values are ``at``
        (…, N, L), the solution for the arm ``real``; their derivatives follow from those that
        ``driven`` (…, N, J) and ``arm`` carry."""
        orders = 2 * isinstance(driven, Jet) + np.iscomplexobj(value(driven))
        values = list[Value](_split(at))
        if not orders:
            return values
        for j, k in enumerate(self.driven):
            values[k] = driven[..., j]
        inverse = self._inverse(at, real) @ self._kept
        for _ in range(orders):
            move = apply(inverse, self.residual(values, arm))
            for i, k in enumerate(self.passive):
                values[k] = values[k] - move[..., i]
        return values

    def failures(self, at: np.ndarray) -> dict[int, str]:
        """Row → reason, of rows of ``at`` (N, L) without solution or beyond passive limits."""
        bad = {int(row): _BARRED for row in np.flatnonzero(np.isnan(at).any(axis=1))}
        for k in self.passive:
            link = self.arm.links[k]
            for row in np.flatnonzero((at[:, k] < link.lower) | (at[:, k] > link.upper)):
                bad.setdefault(
                    int(row),
                    f"the passive joint {link.joint} would be at {at[row, k]:.4g}, outside its "
                    f"limits {link.lower:.4g} … {link.upper:.4g}",
                )
        return dict(sorted(bad.items()))


def _split(at: np.ndarray) -> list[Value]:
    return list(np.moveaxis(at, -1, 0))


def _regular(inverse: np.ndarray) -> np.ndarray:
    """Distance from singular poses (…, N): reciprocal of the inverse Jacobian's norm."""
    return np.asarray(1.0 / np.linalg.norm(inverse, axis=(-2, -1)))
