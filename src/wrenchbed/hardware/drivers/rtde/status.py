"""State of a UR robot and of its link in words, with remedies.

Source of the enumerations: Universal Robots, "RTDE guide", robot_mode, safety_mode,
safety_status_bits and runtime_state.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from wrenchbed.hardware.device import GONE_S, Health, State, by_age
from wrenchbed.hardware.drivers.rtde.shared_state import Snapshot
from wrenchbed.hardware.drivers.rtde.state_worker import WRONG

PLAYING, STOPPED = 2, 1
RUNNING = 7
_PROTECTIVE, _SAFEGUARD, _EMERGENCY, _FAULT = 1 << 2, 1 << 4, 0b111 << 5, 0b11 << 8
MODES = {
    -1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "off",
    4: "powering on", 5: "idle", 6: "backdrive", 7: "running", 8: "updating firmware",
}  # fmt: skip
SAFETY = {
    1: "normal", 2: "reduced", 3: "protective stop", 4: "recovery", 5: "safeguard stop",
    6: "emergency stop", 7: "emergency stop", 8: "safety violation", 9: "safety fault",
    10: "validate joint id", 11: "undefined", 12: "safeguard stop", 13: "three-position stop",
}  # fmt: skip
_PROGRAM = {0: "stopping", 1: "stopped", 2: "playing", 3: "pausing", 4: "paused", 5: "resuming"}
_WORKER_SILENT_S = 0.06
"""Age of the state worker's heartbeat from which it hangs [s], three of its periods."""
_REMEDIES: dict[str, tuple[State, str]] = {
    "emergency stop": ("stopped", "release the button and power the robot on at its pendant"),
    "protective stop": ("stopped", "look what the robot hit, then call recover(unlock=True)"),
    "safeguard stop": ("stopped", "leave the guarded area and reset the safeguard"),
    "three-position stop": ("stopped", "hold the three-position switch in its middle"),
    "recovery": ("stopped", "move the robot back within its limits at its pendant"),
    "safety violation": ("fault", "restart the safety system at the pendant"),
    "safety fault": ("fault", "restart the safety system at the pendant"),
    "validate joint id": ("fault", "confirm the joints at the pendant"),
    "undefined": ("fault", "look at the pendant"),
}


def mode(state: Snapshot) -> str:
    """Of the robot: ``running``, ``off`` …"""
    return MODES.get(int(state.mode), f"mode {state.mode:g}")


def safety(state: Snapshot) -> str:
    """``normal``, ``protective stop`` …; the bits report some stops earlier than the mode."""
    bits = int(state.bits)
    if bits & _EMERGENCY:
        return "emergency stop"
    if bits & _FAULT:
        return "safety fault"
    if bits & _PROTECTIVE:
        return "protective stop"
    if bits & _SAFEGUARD:
        return "safeguard stop"
    return SAFETY.get(int(state.safety), f"safety mode {state.safety:g}")


def program(state: Snapshot) -> str:
    """``playing``, ``paused``, ``stopped`` …"""
    return _PROGRAM.get(int(state.runtime), f"program state {state.runtime:g}")


def problem(state: Snapshot) -> tuple[State, str] | None:
    """What keeps the robot from moving, and what to do; None where nothing does."""
    word = safety(state)
    if word not in ("normal", "reduced"):
        kind, remedy = _REMEDIES.get(word, ("stopped", "look at the pendant"))
        return kind, f"{word}: {remedy}"
    if int(state.mode) != RUNNING:
        remedy = "power it on and release its brakes at the pendant"
        return "stopped", f"the robot is {mode(state)}: {remedy}"
    return None


@dataclass(frozen=True)
class Observation:
    """What the driver knows of the link and of both workers.

    Attributes:
        state: newest state, None before the first.
        age: of it [s].
        worker_gone: why the state worker is gone, empty while it lives.
        worker_silent: time since its heartbeat [s].
        armed: whether the robot was made ready to move.
        control_gone: why the control worker is gone, empty while it lives.
        control_silent: time since its heartbeat [s].
        ended: whether the control worker saw its program ended.
        halts: how often a program had stopped playing when the robot was made ready.
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


def judge(seen: Observation, counters: Mapping[str, float]) -> Health:
    """What is wrong: the link first, then the robot's safety, its program, its control."""
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
    trouble = problem(state)
    if trouble is not None:
        return Health(*trouble, counters)
    return _program(seen, state, counters) if seen.armed else link


def _silent(seen: Observation, state: Snapshot) -> str:
    if seen.worker_silent > _WORKER_SILENT_S:
        return "the state worker hangs"
    if state.wrong:
        return f"the controller sends {WRONG[int(state.wrong)]}"
    return "the controller is silent or repeats itself"


def _program(seen: Observation, state: Snapshot, counters: Mapping[str, float]) -> Health:
    if seen.control_gone:
        text = f"{seen.control_gone}; the robot's watchdog stops it: call recover()"
        return Health("lost", text, counters)
    if seen.control_silent > GONE_S:
        text = f"the control worker hangs for {seen.control_silent:.1f} s: call recover()"
        return Health("lost", text, counters)
    if int(state.runtime) != PLAYING:
        text = f"the robot's program is {program(state)}: call recover()"
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
    counters: dict[str, float] = {"restarts": restarts, "recoveries": recoveries}
    if state is not None:
        counters |= {
            "states": state.received,
            "skipped": state.skipped,
            "refused states": state.bad,
        }
        counters["speed scaling"] = state.scaling
    return counters
