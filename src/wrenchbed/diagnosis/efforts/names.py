"""Effects that joint efforts show: those of the drives by the registry, and of what they carry."""

from collections.abc import Mapping
from functools import cache

import numpy as np

from wrenchbed import registry
from wrenchbed.effects.drives.base import DriveEffect, Size

OTHERS: Mapping[str, tuple[str, Size]] = {
    "link.mass": ("the mass of link {joint} differs from the model",
                  Size("mass", "kg", 0.5, "mass")),
    "link.cog": ("the centre of gravity of link {joint} differs from the model",
                 Size("moment", "kg·m", 0.05, "mass", vector=True)),
    "link.inertia": ("the inertia of link {joint} differs from the model",
                     Size("inertia", "kg·m²", 1.0, "inertia", vector=True)),
    "link.cable": ("a cable bundle pulls at joint {joint} like a spring",
                   Size("stiffness", "N·m/rad", 2.0, columns=("cable",))),
    "link.spring": ("the spring that balances gravity at joint {joint} is wrong",
                    Size("amplitude", "N·m", 2.0, columns=("sine", "cosine"), vector=True)),
    "tool.mass": ("the tool's mass differs from its stated value",
                  Size("mass", "kg", 1.0, "mass")),
    "tool.cog": ("the tool's centre of gravity differs from its stated place",
                 Size("distance", "m", 0.05, "1", vector=True)),
    "base.tilt": ("the base is tilted",
                  Size("angle", "rad", float(np.deg2rad(5.0)), "1", vector=True)),
}  # fmt: skip
"""Title, ``{joint}`` in the place of its number, and size; plausible sizes are estimates."""


@cache
def drive_effects() -> Mapping[str, DriveEffect]:
    """All drive effects by name."""
    return {name: registry.load("drives", name) for name in registry.names("drives")}


def titles() -> dict[str, str]:
    """Title of every effect by name, ``{joint}`` in the place of the joint's or link's number."""
    drives = {name: effect.title for name, effect in drive_effects().items()}
    return drives | {name: text for name, (text, _) in OTHERS.items()}


def title(effect: str, joint: int | None) -> str:
    """Description of an effect with its joint, beginning in lower case."""
    return titles()[effect].format(joint=joint)


def size_of(effect: str) -> Size:
    """What the size of an effect is."""
    drive = drive_effects().get(effect)
    return OTHERS[effect][1] if drive is None else drive.size
