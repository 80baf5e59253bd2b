"""Effects as users name them on the command line: ``joint.compliance:joint=2,stiffness=1.4e4``."""

from typing import Any

from wrenchbed.effects.base import Variant
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import examples
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import Robot


def parse_effect(text: str) -> tuple[str, dict[str, Any]]:
    """``name[:key=value,…]`` → the name and the values, numbers where they are numbers.

    Raises:
        ParameterError: a part without ``=``, or a key given twice.
    """
    name, _, remaining = text.strip().partition(":")
    values: dict[str, Any] = {}
    for part in filter(None, (p.strip() for p in remaining.split(","))):
        key, equals, value = (x.strip() for x in part.partition("="))
        if not equals or not key or not value:
            raise ParameterError(f"--effect {text}: {part!r} is not name=value")
        if key in values:
            raise ParameterError(f"--effect {text}: {key!r} is given twice")
        try:
            values[key] = float(value)
        except ValueError:
            values[key] = value
    return name, values


def active_effect(robot: Robot, text: str) -> ActiveEffect:
    """An effect by its text. Without amplitudes it has its typical size, in the variant that the
    values given single out (``joint.offset:joint=3``), else in the commonest.

    Raises:
        NotFoundError, ParameterError: no such effect or parameter, or an impossible value.
    """
    name, given = parse_effect(text)
    active = ActiveEffect.of(robot, name, {})
    variant = _variant(active, robot, given)
    if variant is None and given:
        return ActiveEffect.of(robot, name, given)
    known = active.effect.parameters(robot)
    if variant is None:
        size = {p.name: p.tolerance for p in known if p.nominal == 0.0}
    else:
        size = {n: known[known.index(n)].tolerance for n in active.effect.usual(variant)}
        size |= {k: v for k, v in variant.at.items() if k not in size}
    return ActiveEffect.of(robot, name, size)


def _variant(active: ActiveEffect, robot: Robot, given: dict[str, Any]) -> Variant | None:
    """The commonest variant whose details are the values given."""
    fit = [
        v
        for scene in examples(robot)
        for v in active.effect.variants(scene)
        if all(k in v.detail and v.detail[k] == x for k, x in given.items())
    ]
    return max(fit, key=lambda v: v.weight, default=None)
