"""How a device is doing: one named state, one sentence, and its counters."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

State = Literal["closed", "starting", "ok", "stale", "lost", "stopped", "fault"]
"""``stale``: no fresh reading for `STALE_S`; ``lost``: the link or its worker is gone;
``stopped``: the device is at rest by a stop of its own (protective, emergency, program ended);
``fault``: the device answers and reports an error that someone must clear."""

STALE_S = 0.08
"""Age of the newest reading from which a link is stale [s]; named well within 100 ms."""
GONE_S = 1.0
"""Age from which a link is lost [s]."""


@dataclass(frozen=True)
class Health:
    """State of a device.

    Attributes:
        state: one of `State`.
        detail: one sentence for people; empty when all is well.
        counters: readings, losses, restarts, by name.
    """

    state: State
    detail: str = ""
    counters: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the device may be used."""
        return self.state == "ok"


def by_age(age: float, what: str, counters: Mapping[str, float]) -> Health:
    """Health of a link from the age [s] of its newest reading; ``what`` names the link."""
    if age < STALE_S:
        return Health("ok", "", counters)
    state: State = "stale" if age < GONE_S else "lost"
    return Health(state, f"{what}: no fresh reading for {age:.2f} s", counters)
