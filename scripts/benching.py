"""What benchmarks share: interleaved repeats, tables in Markdown, configurations, an arm."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import wrenchbed as wb


def timed(
    routes: Mapping[str, Callable[[], object]],
    repeats: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:
    """Least time of each route [s], repeats interleaved."""
    best = dict.fromkeys(routes, np.inf)
    for _ in range(repeats):
        for name, route in routes.items():
            begun = clock()
            route()
            best[name] = min(best[name], clock() - begun)
    return best


def tell(title: str, best: Mapping[str, float], first: str, note: str = "") -> None:
    """A table: our time, and how many times it others take."""
    print(f"\n**{title}**{': ' + note if note else ''}\n\n| route | time | × |\n|---|---|---|")
    for name, seconds in best.items():
        print(f"| {name} | {1e3 * seconds:.3g} ms | {seconds / best[first]:.3g} |", flush=True)


def configurations(name: str, count: int) -> tuple:
    """A robot, its nominal parameters and poses (count, J)."""
    robot = wb.load("robots", name)
    few = robot.sample(min(count, 2000), np.random.default_rng(0))
    return robot, robot.parameters.nominal, np.resize(few, (count, few.shape[1]))


def arm(pin: Any, p: Mapping[str, Any]) -> tuple[Any, int, Any]:
    """The UR5 in pinocchio: the model, its last joint and the flange's place at it."""
    model, joint, place = pin.Model(), 0, pin.SE3.Identity()
    for i in range(1, 7):
        joint = model.addJoint(joint, pin.JointModelRZ(), place, f"q{i}")
        offset = np.array([p[f"a{i}"], 0.0, p[f"d{i}"]])
        place = pin.SE3(pin.utils.rotate("x", p[f"alpha{i}"]), offset)
    return model, joint, place
