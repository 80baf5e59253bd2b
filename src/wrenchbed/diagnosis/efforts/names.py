"""Effects that joint efforts show: of drives (from the registry), and of links, tool and base."""

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from wrenchbed import registry
from wrenchbed.diagnosis.explain.verdict import Key
from wrenchbed.effects.drives.base import DriveEffect, Size

_RANGE = "record the joint over its whole range, which tells a cable from a spring"
_REACH = "record poses with the arm stretched and folded, at rest in both directions"


class Carried(NamedTuple):
    """Effect of links, tool or base: title, definition of its size, and how to tell its rivals."""

    title: str
    size: Size
    remedy: str = ""


OTHERS: Mapping[str, Carried] = {
    "link.mass": Carried("the mass of link {joint} differs from the model",
                         Size("mass", "kg", 0.5), _REACH),
    "link.cog": Carried("the centre of gravity of link {joint} differs from the model",
                        Size("moment", "kg·m", 0.05, vector=True), _REACH),
    "link.inertia": Carried("the inertia of link {joint} differs from the model",
                            Size("inertia", "kg·m²", 1.0, vector=True)),
    "link.cable": Carried("a cable bundle pulls at joint {joint} like a spring",
                          Size("stiffness", "N·m/rad", 2.0, columns=("cable",)), _RANGE),
    "link.spring": Carried(
        "the spring that balances gravity at joint {joint} is wrong",
        Size("amplitude", "N·m", 2.0, columns=("sine", "cosine"), vector=True), _RANGE,
    ),
    "tool.mass": Carried("the tool's mass differs from its stated value",
                         Size("mass", "kg", 0.25),
                         "weigh the tool, or record the same motion without it"),
    "tool.cog": Carried("the tool's centre of gravity differs from its stated place",
                        Size("distance", "m", 0.02, vector=True),
                        "record the same motion without the tool"),
    "base.tilt": Carried("the base is tilted",
                         Size("angle", "rad", float(np.deg2rad(5.0)), vector=True),
                         "put a level on the base, or record with joint 1 in several directions"),
}  # fmt: skip
"""Effects without a file of their own, by name; ``{joint}`` is the joint's or link's number."""


@cache
def drive_effects() -> Mapping[str, DriveEffect]:
    """All drive effects by name."""
    return {name: registry.load("drives", name) for name in registry.names("drives")}


@cache
def all_effects() -> Mapping[str, DriveEffect | Carried]:
    """Descriptions by name of all effects of drives, and of links, tool and base."""
    return {**drive_effects(), **OTHERS}


def place(key: Key) -> str:
    """Place of an effect as text: ``joint 2``, ``link 3``; without a joint ``tool`` or ``base``."""
    part = key[0].split(".")[0]
    return part if key[1] is None else f"{'link' if part == 'link' else 'joint'} {key[1]}"


def title(effect: str, joint: int | None) -> str:
    """Description of an effect with its joint's number, from 1, in lower case."""
    return all_effects()[effect].title.format(joint=joint)
