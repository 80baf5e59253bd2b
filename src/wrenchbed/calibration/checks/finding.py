"""A reason not to trust a recording: a word for programs, a sentence for people."""

from dataclasses import dataclass

REASONS = {
    "dead channel": "a channel is constant, or does not follow the load that the others show",
    "stuck channel": "a channel keeps one value for many rows",
    "saturated": "a channel rests at the ends of its range",
    "spike": "single rows far from their neighbours",
    "clock": "times that go back, repeat or leave gaps",
    "frozen joint": "a joint's column stands still while the wrench shows that it moved",
    "one orientation": "gravity hardly turns in the sensor's axes",
    "contact": "rows in which something touches or pushes the tool",
    "no weight": "the forces are not those of the stated load",
    "compensated": "weight and zero were subtracted before",
    "swapped channels": "two columns stand in each other's place",
    "wrong sign": "wrench, forces, torques or one column turned over",
    "left-handed": "axes that no rotation reaches",
    "frame of the wrench": "a wrench in axes of the base or of the flange",
    "turned sensor": "a sensor mounted otherwise than stated",
    "gravity": "another direction of gravity than stated",
    "joints": "joints in another order, unit, sign or zero",
    "order of poses": "poses and wrenches of different rows",
    "units": "forces or torques in other units",
    "several tools": "a load that changes on the way",
    "zero jumps": "a zero that changes on the way",
    "another robot": "joint values of another robot",
    "not one load": "readings that no load under gravity explains",
}
"""All reasons of findings, each with a description."""


@dataclass(frozen=True)
class Finding:
    """One reason why a recording cannot be trusted.

    Attributes:
        reason: one of `REASONS`.
        sentence: what is seen, where, and what to do; without the recording's name.
        blocks: whether nothing can be learnt from such data, so that a diagnosis refuses it too.
    """

    reason: str
    sentence: str
    blocks: bool = True
