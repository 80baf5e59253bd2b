"""Effect ``link.length``: link lengths or twists differ from nominal."""

from collections.abc import Sequence

import numpy as np

from wrenchbed.effects.base import ModelEffect, Values, Variant, added, has_loops
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.robots.base import Robot

LINKS = tuple(f"L{i}{k}" for i in (1, 2) for k in (1, 2, 3, 4))
LOOPS = (*LINKS, *(f"{a}{i}{y}" for a in "AC" for i in (1, 2) for y in "yz"), "d41", "d42")


class LinkLength(ModelEffect):
    """p → p + δ, p an a, d, α of a serial arm (Denavit–Hartenberg), or L, anchor, d4 of a five-bar.

    A serial arm's lengths move no wrench at rest, its twists do; every length of a loop does.

    Seen in: varied orientations for twists and loops, a motion or a tracker for the lengths of a
    serial arm.
    """

    name = "link.length"
    title = "link lengths or twists differ from nominal"
    local = True
    source = "0.1–1 mm, 0.02–0.1° as made: estimate"

    def parameters(self, robot: Robot) -> ParameterSet:
        twists, lengths = twist_and_length_names(robot)
        sizes = [(n, "rad", 1e-3, 0.5) for n in twists] + [(n, "m", 5e-4, 0.1) for n in lengths]
        return ParameterSet(
            tuple(
                Parameter(public(n), 0.0, unit, size, -bound, bound, f"added to {n}")
                for n, unit, size, bound in sizes
            )
        )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        twists, lengths = twist_and_length_names(scene.robot)
        if has_loops(scene.robot):
            return (
                *single(lengths),
                together("all links", LINKS, 2.0),
                together("all lengths", lengths),
            )
        if not twists:
            return ()
        result = [*single(twists), together("all twists", twists, 2.0)]
        if not scene.located:
            nominal = scene.robot.parameters.mapping(scene.robot.parameters.nominal)
            lengths = [n for n in lengths if nominal[n] != 0.0 and n != "d1"]  # d1 only lifts all
        if scene.moving or scene.located:
            result += [*single(lengths), together("all lengths", lengths)]
        if scene.located:  # every arm that was never calibrated is off in all of them
            result.append(together("all lengths and twists", (*twists, *lengths), 2.0))
        return tuple(result)

    def theta(self, robot: Robot, theta: np.ndarray, p: Values) -> np.ndarray:
        twists, lengths = twist_and_length_names(robot)
        return added(robot, theta, {n: p[public(n)] for n in (*twists, *lengths)})


def twist_and_length_names(robot: Robot) -> tuple[list[str], list[str]]:
    """Names of the robot's parameters that are twists, and of those that are lengths."""
    if has_loops(robot):
        known = robot.parameters.names
        return [], [n for n in LOOPS if n in known]
    return list(robot.twists), list(robot.lengths)


def public(name: str) -> str:
    """Public name of a robot's parameter: ``twist.3`` of alpha3, ``length.L11`` of L11."""
    if name.startswith("alpha"):
        return f"twist.{name[5:]}"
    turns = name.startswith("beta") or ".rotation." in name
    return f"twist.{name}" if turns else f"length.{name}"


def single(names: Sequence[str]) -> list[Variant]:
    """Variants that free one of the robot's parameters ``names`` each."""
    return [Variant(n, (public(n),), detail={"parameter": n}) for n in names]


def together(label: str, names: Sequence[str], weight: float = 1.0) -> Variant:
    """Variant ``label``, of prior ``weight``, that frees robot's parameters ``names`` together."""
    return Variant(label, tuple(map(public, names)), weight=weight)


EFFECT = LinkLength()
