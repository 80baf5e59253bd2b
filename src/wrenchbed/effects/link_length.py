"""Link lengths or twists differ from nominal."""

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.parameters import Parameter, ParameterSet
from wrenchbed.robots.base import Robot

TWISTS = tuple(f"alpha{k}" for k in range(1, 7))
SERIAL = tuple(f"{s}{k}" for s in "ad" for k in range(1, 7))
LINKS = tuple(f"L{i}{k}" for i in (1, 2) for k in (1, 2, 3, 4))
LOOPS = (*LINKS, *(f"{a}{i}{y}" for a in "AC" for i in (1, 2) for y in "yz"), "d41", "d42")


class LinkLength(ModelEffect):
    """a, d, α + δ of a serial arm (Denavit–Hartenberg); L, anchors, d4 + δ of five-bars.

    A serial arm's lengths move no wrench at rest, its twists do; every length of a loop does.

    Seen in: varied orientations for twists and loops, a motion for the lengths of a serial arm.
    """

    name = "link.length"
    title = "link lengths or twists differ from nominal"
    local = True
    source = "0.1–1 mm, 0.02–0.1° as made: estimate"

    def parameters(self, robot: Robot) -> ParameterSet:
        lengths = LOOPS if is_loop(robot) else SERIAL
        known = set(robot.parameters.names)
        twists = [
            Parameter(public(n), 0.0, "rad", 1e-3, -0.5, 0.5, f"added to {n}")
            for n in TWISTS
            if n in known
        ]
        return ParameterSet(
            (
                *twists,
                *(
                    Parameter(public(n), 0.0, "m", 5e-4, -0.1, 0.1, f"added to {n}")
                    for n in lengths
                    if n in known
                ),
            )
        )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if is_loop(scene.robot):
            every = Variant("all links", tuple(map(public, LINKS)), weight=2.0)
            return (*single(LOOPS), every, Variant("all lengths", tuple(map(public, LOOPS))))
        known = scene.robot.parameters.names
        if TWISTS[0] not in known:
            return ()
        result = [*single(TWISTS), Variant("all twists", tuple(map(public, TWISTS)), weight=2.0)]
        if scene.moving:
            nominal = scene.robot.parameters.mapping(scene.robot.parameters.nominal)
            lengths = [n for n in SERIAL if nominal[n] != 0.0 and n != "d1"]  # d1 only lifts all
            result += [*single(lengths), Variant("all lengths", tuple(map(public, lengths)))]
        return tuple(result)

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        result = np.array(theta, dtype=float)
        for n in (*TWISTS, *SERIAL, *LOOPS):
            if public(n) in p:
                result[robot.parameters.index(n)] += p[public(n)]
        return result


def is_loop(robot: Robot) -> bool:
    """Whether the robot is made of five-bars."""
    return LINKS[0] in robot.parameters.names


def public(name: str) -> str:
    """``twist.3`` of alpha3, ``length.L11`` of L11."""
    return f"twist.{name[5:]}" if name in TWISTS else f"length.{name}"


def single(names: tuple[str, ...] | list[str]) -> list[Variant]:
    """Each parameter of the robot alone."""
    return [Variant(n, (public(n),), detail={"parameter": n}) for n in names]


EFFECT = LinkLength()
