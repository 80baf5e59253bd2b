"""The poses of a robot's checks: few, always the same, and chosen to show what may change."""

from itertools import permutations

import numpy as np

from wrenchbed import registry
from wrenchbed.data.plan import Plan
from wrenchbed.effects.chain import Response, effects, respond
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import PlanError
from wrenchbed.planning.clearance import Clearance
from wrenchbed.planning.criteria import INDICES
from wrenchbed.planning.exchange import Pool, exchange
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.motion_limits import duration

POSES = 12
"""Stops of a check; the last is the first pose again, which shows drift."""
LONGEST_S = 180.0
"""Longest check [s]."""
SAMPLES, RATE_HZ = 200, 100.0
"""Rows a pose and their rate [Hz]: a mean of 2 s is as good as 1/f noise lets it be; estimate."""
CHANGES = (
    "sensor.bias", "sensor.gain", "tool.mass", "tool.cog", "base.tilt", "mount.rotation",
    "joint.offset", "joint.compliance",
)  # fmt: skip
"""Effects that the poses are chosen to show."""
SETTLE_S = 1.5
"""Time to come to rest at a pose [s]; estimate, five times the steady window of live drivers."""
_POOL = 2000
"""Candidate poses; estimate."""
_SEED = 0
_SWEEPS = 50
"""Most passes of the search for a short way; estimate."""


def choose(robot: Robot) -> Plan:
    """The poses of a robot's checks: the same for each robot of a kind.

    The information on the typical changes of `CHANGES`, beside their sizes as a prior, is largest
    (Bayesian D-optimality: Chaloner & Verdinelli 1995, doi 10.1214/ss/1177009939). The order makes
    the way short.

    Raises:
        PlanError: the robot has no model, or too few free poses.
    """
    if not isinstance(robot, SimulatedRobot):
        raise PlanError(f"robot {robot.name!r} has no model to plan with, and a check needs one")
    q = robot.pool(_POOL, _SEED)
    blocks = _slopes(robot, q)
    prior = np.eye(blocks.shape[-1])
    clearance = Clearance(robot)
    while True:
        chosen = exchange(Pool(blocks), INDICES["O1"], POSES - 1, prior=prior, seed=_SEED).chosen
        hits = [k for k in chosen if clearance.hit(q[k])]
        if not hits:
            break
        q, blocks = np.delete(q, hits, axis=0), np.delete(blocks, hits, axis=0)
    short = _short_way(robot, q[chosen])
    return Plan.of(robot.name, np.concatenate([short, short[:1]]))


def seconds(moves: float, poses: int, samples: int, rate: float) -> float:
    """How long a check takes on a robot [s].

    Args:
        moves: time of all moves [s].
        samples, rate: rows a pose, and their rate [Hz].

    Raises:
        PlanError: it is longer than `LONGEST_S`.
    """
    total = moves + poses * (samples / rate + SETTLE_S)
    if total > LONGEST_S:
        raise PlanError(
            f"the check would take {total:.0f} s: {moves:.0f} s of moves and {poses} poses of "
            f"{samples / rate:.1f} s with {SETTLE_S:g} s to settle. {LONGEST_S:.0f} s are allowed: "
            "raise --speed, or give fewer --samples"
        )
    return total


def _slopes(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Change of the mean of a hold (N, 6, K) in its noise, per typical size of each effect."""
    n = len(q)
    theta, gravity = robot.parameters.nominal, np.asarray(robot.gravity)
    scene = Scene(robot, theta, gravity, q, np.arange(n) * 1.0, np.ones(n, dtype=bool))
    response = Response(scene, respond(scene))
    columns = []
    known = effects()
    for name in CHANGES:
        effect, own = known[name], known[name].parameters(robot)
        variants = effect.variants(scene)
        if not variants:
            continue
        free = dict.fromkeys(p for v in variants for p in v.free)
        columns += [response.tangent(effect, own[own.index(p)], variants[0]) for p in free]
    noise = registry.load("sensors", robot.sensor).noise.row_std / np.sqrt(SAMPLES)
    return np.stack(columns, axis=-1) / noise[:, None]


def _short_way(robot: SimulatedRobot, q: np.ndarray) -> np.ndarray:
    """The poses (N, J) in an order of a short round trip that begins near home (2-opt)."""
    cost = np.array([[duration(robot, a, b) for b in q] for a in q])
    order = [int(np.argmin([duration(robot, robot.home, p) for p in q]))]
    while len(order) < len(q):
        rest = [k for k in range(len(q)) if k not in order]
        order.append(min(rest, key=lambda k: cost[order[-1], k]))
    for _ in range(_SWEEPS):
        better = _two_opt(order, cost)
        if better == order:
            break
        order = better
    return np.asarray(q[order])


def _two_opt(order: list[int], cost: np.ndarray) -> list[int]:
    """The first order with a stretch reversed that is a shorter round trip."""

    def length(way: list[int]) -> float:
        return float(cost[way, [*way[1:], way[0]]].sum())

    for i, j in permutations(range(1, len(order) + 1), 2):
        if i < j:
            trial = [*order[:i], *order[i:j][::-1], *order[j:]]
            if length(trial) < length(order) - 1e-9:
                return trial
    return order
