"""Effects that joint torques show, with their words and the units of their parameters."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Named:
    """Words and unit of an effect for people.

    Attributes:
        title: what it is, ``{joint}`` in the place of the joint's number; begins small.
        size: name of the parameter that is its size.
        unit: of that parameter, SI.
    """

    title: str
    size: str
    unit: str


EFFECTS: Mapping[str, Named] = {
    "drive.coulomb": Named("Coulomb friction of joint {joint} differs from its stated value",
                           "coulomb", "N·m"),
    "drive.viscous": Named("viscous friction of joint {joint} differs from its stated value",
                           "viscous", "N·m·s/rad"),
    "drive.offset": Named("joint {joint} has a constant torque that is not stated", "offset",
                          "N·m"),
    "drive.stribeck": Named("friction of joint {joint} rises at low speed (Stribeck)", "rise",
                            "N·m"),
    "drive.load": Named("friction of joint {joint} grows with its load", "share", "1"),
    "drive.temperature": Named("friction of joint {joint} changes with its temperature", "slope",
                               "N·m/K"),
    "drive.constant": Named("the drive constant of joint {joint} differs from its stated value",
                            "gain", "1"),
    "drive.cogging": Named("the motor of joint {joint} cogs: its torque repeats with the motor's "
                           "angle", "amplitude", "N·m"),
    "drive.ripple": Named("the gear of joint {joint} has a torque ripple per turn", "amplitude",
                          "N·m"),
    "drive.inertia": Named("the rotor inertia of joint {joint} differs from its stated value",
                           "inertia", "kg·m²"),
    "drive.hysteresis": Named("the gear of joint {joint} has hysteresis after reversals", "size",
                              "N·m"),
    "drive.delay": Named("the effort of joint {joint} is reported late", "delay", "s"),
    "drive.bandwidth": Named("the effort of joint {joint} is low-pass filtered", "time", "s"),
    "drive.asymmetry": Named("friction of joint {joint} differs by direction", "difference",
                             "N·m·s/rad"),
    "drive.stiction": Named("joint {joint} sticks at reversals", "size", "N·m"),
    "link.mass": Named("the mass of link {joint} differs from the model", "mass", "kg"),
    "link.cog": Named("the centre of gravity of link {joint} differs from the model", "moment",
                      "kg·m"),
    "link.inertia": Named("the inertia of link {joint} differs from the model", "inertia", "kg·m²"),
    "link.cable": Named("a cable bundle pulls at joint {joint} like a spring", "stiffness",
                        "N·m/rad"),
    "link.spring": Named("the spring that balances gravity at joint {joint} is wrong", "amplitude",
                         "N·m"),
    "tool.mass": Named("the tool's mass differs from its stated value", "mass", "kg"),
    "tool.cog": Named("the tool's centre of gravity differs from its stated place", "distance",
                      "m"),
    "base.tilt": Named("the base is tilted", "angle", "rad"),
}  # fmt: skip


def title(effect: str, joint: int | None) -> str:
    """Description of an effect with its joint, beginning in lower case."""
    return EFFECTS[effect].title.format(joint=joint)
