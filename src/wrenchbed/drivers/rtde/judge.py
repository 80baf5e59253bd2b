"""The state of a UR robot's link and of the robot, from all that the driver sees of them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from wrenchbed.drivers.rtde import words
from wrenchbed.drivers.rtde.record import Snapshot
from wrenchbed.drivers.rtde.state_worker import WRONG
from wrenchbed.health import GONE_S, Health, by_age

_WORKER_SILENT_S = 0.06


@dataclass(frozen=True)
class Seen:
    """What the driver sees.

    Attributes:
        state: newest state, None before the first.
        age: of it [s].
        worker_gone: why the state worker is gone, empty while it lives.
        worker_silent: time since its heartbeat [s].
        armed: whether the robot was made ready to move.
        control_gone: why the control worker is gone, empty while it lives.
        control_silent: time since its heartbeat [s].
        ended: whether the control worker found its program ended.
        halts: how often the program had left off playing when the robot was made ready.
    """

    state: Snapshot | None
    age: float
    worker_gone: str
    worker_silent: float
    armed: bool
    control_gone: str
    control_silent: float
    ended: bool
    halts: float


def judge(seen: Seen, counters: Mapping[str, float]) -> Health:
    """Name what is wrong: the link first, then the robot's safety, its program, its control."""
    state = seen.state
    if seen.worker_gone or state is None:
        why = seen.worker_gone or "no state yet"
        return Health("lost", f"{why}: call recover()", counters)
    if state.back > 0.0:
        text = f"the controller's clock went back by {state.back:.3g} s: it was restarted"
        return Health("lost", f"{text}: call recover()", counters)
    link = by_age(seen.age, _silent(seen, state), counters)
    if not link.ok:
        return link
    trouble = words.trouble(state)
    if trouble is not None:
        return Health(*trouble, counters)
    return _program(seen, state, counters) if seen.armed else link


def _silent(seen: Seen, state: Snapshot) -> str:
    if seen.worker_silent > _WORKER_SILENT_S:
        return "the state worker hangs"
    if state.wrong:
        return f"the controller sends {WRONG[int(state.wrong)]}"
    return "the controller is silent or repeats itself"


def _program(seen: Seen, state: Snapshot, counters: Mapping[str, float]) -> Health:
    if seen.control_gone:
        text = f"{seen.control_gone}; the robot's watchdog stops it: call recover()"
        return Health("lost", text, counters)
    if seen.control_silent > GONE_S:
        text = f"the control worker hangs for {seen.control_silent:.1f} s: call recover()"
        return Health("lost", text, counters)
    if int(state.runtime) != words.PLAYING:
        text = f"the robot's program is {words.program(state)}: call recover()"
        return Health("stopped", text, counters)
    if state.halts > seen.halts:
        text = "the robot's program was stopped, and another one plays: call recover()"
        return Health("stopped", text, counters)
    if seen.ended:
        text = "the robot's program did not take what it was sent: call recover()"
        return Health("stopped", text, counters)
    return Health("ok", "", counters)


def count(state: Snapshot | None, restarts: int, recoveries: int) -> dict[str, float]:
    """Counters of the link, by name."""
    found: dict[str, float] = {"restarts": restarts, "recoveries": recoveries}
    if state is not None:
        found |= {"states": state.received, "skipped": state.skipped, "refused states": state.bad}
        found["speed scaling"] = state.scaling
        if math.isfinite(state.drift):
            found["clock_ppm"] = state.drift
    return found
