"""The controller's numbers in words, and what to do about them.

Enumerations: Universal Robots, "RTDE guide", robot_mode, safety_mode, safety_status_bits and
runtime_state.
"""

from wrenchbed.drivers.rtde.record import Snapshot
from wrenchbed.health import State

PLAYING, STOPPED = 2, 1
RUNNING = 7
_PROTECTIVE, _SAFEGUARD, _EMERGENCY, _FAULT = 1 << 2, 1 << 4, 0b111 << 5, 0b11 << 8
_MODES = {
    -1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "off",
    4: "powering on", 5: "idle", 6: "backdrive", 7: "running", 8: "updating firmware",
}  # fmt: skip
_SAFETY = {
    1: "normal", 2: "reduced", 3: "protective stop", 4: "recovery", 5: "safeguard stop",
    6: "emergency stop", 7: "emergency stop", 8: "safety violation", 9: "safety fault",
    10: "validate joint id", 11: "undefined", 12: "safeguard stop", 13: "three-position stop",
}  # fmt: skip
_PROGRAM = {0: "stopping", 1: "stopped", 2: "playing", 3: "pausing", 4: "paused", 5: "resuming"}
_REMEDIES: dict[str, tuple[State, str]] = {
    "emergency stop": ("stopped", "release the button and power the robot on at its pendant"),
    "protective stop": ("stopped", "look what the robot hit, then call recover()"),
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
    return _MODES.get(int(state.mode), f"mode {state.mode:g}")


def safety(state: Snapshot) -> str:
    """``normal``, ``protective stop`` …; the bits tell some stops earlier than the mode does."""
    bits = int(state.bits)
    if bits & _EMERGENCY:
        return "emergency stop"
    if bits & _FAULT:
        return "safety fault"
    if bits & _PROTECTIVE:
        return "protective stop"
    if bits & _SAFEGUARD:
        return "safeguard stop"
    return _SAFETY.get(int(state.safety), f"safety mode {state.safety:g}")


def program(state: Snapshot) -> str:
    """``playing``, ``paused``, ``stopped`` …"""
    return _PROGRAM.get(int(state.runtime), f"program state {state.runtime:g}")


def trouble(state: Snapshot) -> tuple[State, str] | None:
    """What keeps the robot from moving, and what to do; None where nothing does."""
    word = safety(state)
    if word not in ("normal", "reduced"):
        kind, remedy = _REMEDIES.get(word, ("stopped", "look at the pendant"))
        return kind, f"{word}: {remedy}"
    if int(state.mode) != RUNNING:
        remedy = "power it on and release its brakes at the pendant"
        return "stopped", f"the robot is {mode(state)}: {remedy}"
    return None
