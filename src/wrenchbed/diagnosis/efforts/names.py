"""Effects that joint torques show, with their words and the units of their parameters."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

LEVELS = ("friction", "mass", "inertia", "1")
"""What a plausible size is relative to: Coulomb friction of the joint [N·m], mass [kg] or mean
inertia [kg·m²] of the link or the tool; of ``1`` it is absolute."""
_SINE = ("sine", "cosine")


@dataclass(frozen=True)
class Named:
    """Words and unit of an effect for people.

    Attributes:
        title: what it is, ``{joint}`` in the place of the joint's number; begins small.
        size: name of the parameter that is its size.
        unit: of that parameter, SI.
        plausible: largest size that a fault in use has, in ``of`` [`LEVELS`]; estimate.
        of: what that size is relative to.
        columns: beginnings of the names of the columns whose amplitudes make the size; all of the
            cause if empty.
        vector: whether the size is their length, not their sum.
    """

    title: str
    size: str
    unit: str
    plausible: float
    of: str = "friction"
    columns: tuple[str, ...] = ()
    vector: bool = False


EFFECTS: Mapping[str, Named] = {
    "drive.coulomb": Named("Coulomb friction of joint {joint} differs from its stated value",
                           "coulomb", "N·m", 3.0),
    "drive.viscous": Named("viscous friction of joint {joint} differs from its stated value",
                           "viscous", "N·m·s/rad", 3.0),
    "drive.stribeck": Named("friction of joint {joint} rises at low speed (Stribeck)", "rise",
                            "N·m", 2.0, columns=("stribeck",)),
    "drive.load": Named("friction of joint {joint} grows with its load", "share", "1", 0.6, "1",
                        ("load.",)),
    "drive.temperature": Named("friction of joint {joint} changes with its temperature", "slope",
                               "N·m/K", 0.05, columns=("warmcoulomb",)),
    "drive.constant": Named("the drive constant of joint {joint} differs from its stated value",
                            "gain", "1", 0.3, "1"),
    "drive.cogging": Named("the motor of joint {joint} cogs: its torque repeats with the motor's "
                           "angle", "amplitude", "N·m", 1.0,
                           columns=("drive.cogging.sine1", "drive.cogging.cosine1"), vector=True),
    "drive.ripple": Named("the gear of joint {joint} has a torque ripple per turn", "amplitude",
                          "N·m", 1.0, columns=("drive.ripple.sine1", "drive.ripple.cosine1"),
                          vector=True),
    "drive.inertia": Named("the rotor inertia of joint {joint} differs from its stated value",
                           "inertia", "kg·m²", 0.5, "1"),
    "drive.hysteresis": Named("the gear of joint {joint} has hysteresis after reversals", "size",
                              "N·m", 2.0, columns=("stop",)),
    "drive.delay": Named("the effort of joint {joint} is reported late", "delay", "s", 0.1, "1"),
    "drive.bandwidth": Named("the effort of joint {joint} is low-pass filtered", "time", "s", 0.1,
                             "1"),
    "drive.asymmetry": Named("friction of joint {joint} differs by direction", "difference",
                             "N·m·s/rad", 2.0, columns=("asymmetry",)),
    "drive.stiction": Named("joint {joint} sticks at reversals", "size", "N·m", 2.0,
                            columns=("since",)),
    "link.mass": Named("the mass of link {joint} differs from the model", "mass", "kg", 0.5,
                       "mass"),
    "link.cog": Named("the centre of gravity of link {joint} differs from the model", "moment",
                      "kg·m", 0.05, "mass", vector=True),
    "link.inertia": Named("the inertia of link {joint} differs from the model", "inertia", "kg·m²",
                          1.0, "inertia", vector=True),
    "link.cable": Named("a cable bundle pulls at joint {joint} like a spring", "stiffness",
                        "N·m/rad", 2.0, columns=("cable",)),
    "link.spring": Named("the spring that balances gravity at joint {joint} is wrong", "amplitude",
                         "N·m", 2.0, columns=_SINE, vector=True),
    "tool.mass": Named("the tool's mass differs from its stated value", "mass", "kg", 1.0, "mass"),
    "tool.cog": Named("the tool's centre of gravity differs from its stated place", "distance",
                      "m", 0.05, "1", vector=True),
    "base.tilt": Named("the base is tilted", "angle", "rad", float(np.deg2rad(5.0)), "1",
                       vector=True),
}  # fmt: skip


def title(effect: str, joint: int | None) -> str:
    """Description of an effect with its joint, beginning in lower case."""
    return EFFECTS[effect].title.format(joint=joint)
