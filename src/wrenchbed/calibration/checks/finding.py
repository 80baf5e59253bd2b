"""A reason not to trust a recording: a word for programs, a sentence for people."""

from dataclasses import dataclass

REASONS = (
    "dead channel", "stuck channel", "saturated", "spike", "clock", "frozen joint",
    "one orientation", "contact", "no weight", "compensated", "swapped channels", "wrong sign",
    "left-handed", "frame of the wrench", "turned sensor", "gravity", "joints", "order of poses",
    "units", "several tools", "zero jumps", "another robot", "not one load",
)  # fmt: skip
"""Every reason that a check may give."""


@dataclass(frozen=True)
class Finding:
    """Why a recording cannot be trusted.

    Attributes:
        reason: one of `REASONS`.
        sentence: what is seen, where, and what to do; without the recording's name.
        blocks: whether nothing can be learnt from such data, so that a diagnosis refuses it too.
    """

    reason: str
    sentence: str
    blocks: bool = True
