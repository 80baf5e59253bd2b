"""What goes wrong in a drive, as the simulator makes it: each fault changes one joint's torque.

A fault is a formula on the torque that a drive reports, row by row in time. It sees joint value q,
speed q̇, acceleration q̈ and the torque τ of the rigid body. Formulas are written for the simulator;
fits and diagnoses have others. It acts on efforts only: the joints follow their targets anyway, and
the wrench is that of the motion.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.errors import NotFoundError, ParameterError, did_you_mean

PREFIX = "drive."
"""Names of drives' parameters and faults begin with it."""
REVERSAL = 1e-3
"""Speed within which friction changes its sign, as tanh [rad/s or m/s]: a thousandth of usual
speeds."""
_ROOM_C = 25.0
"""Temperature at which friction is nominal [°C]: a room's, as `_COLD` of `drive_train`."""
Values = Mapping[str, float]
Memory = dict[str, Any]
_TURN = 2.0 * np.pi


class Rows(NamedTuple):
    """Motion, rigid-body torque and temperature of one drive over time (N,), SI.

    Attributes:
        rigid: torque of the rigid body, rotor included [N·m or N].
        warm: temperature of the drive [°C].
        coulomb: nominal Coulomb friction of the joint, one number [N·m or N].
    """

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    rigid: np.ndarray
    warm: np.ndarray
    coulomb: float

    @property
    def direction(self) -> np.ndarray:
        """Direction of motion (N,), −1 … 1, smooth through rest."""
        return np.asarray(np.tanh(self.qd / REVERSAL))


Formula = Callable[[Rows, np.ndarray, Values, Memory], np.ndarray]
"""Function (rows, torque so far (N,), values, memory) → torque with the fault (N,)."""


class Fault(NamedTuple):
    """One kind of drive fault: its formula, units and default values.

    Attributes:
        unit: unit of ``size`` on a rotary joint; N·m stands for N on a slide.
        typical: default size [unit], or, if ``of_friction``, as a multiple of Coulomb friction.
        more: further parameters with their defaults.
    """

    title: str
    unit: str
    typical: float
    formula: Formula
    more: Mapping[str, float] = {}
    of_friction: bool = False


def _hysteresis(rows: Rows, torque: np.ndarray, p: Values, memory: Memory) -> np.ndarray:
    """Return ``torque`` (N,) plus presliding friction p["size"]·z [N·m or N], z kept in ``memory``:
    z ← s + (z − s) e^(−|dq|/p["width"]), s the sign of a row's step dq of the joint."""
    z, last = memory.get("z", 0.0), memory.get("q", float(rows.q[0]))
    deflection = np.empty_like(rows.q)
    for k, q in enumerate(rows.q.tolist()):
        way = float(np.sign(q - last))
        if way:
            z = way + (z - way) * float(np.exp(-abs(q - last) / p["width"]))
        deflection[k], last = z, q
    memory["z"], memory["q"] = z, last
    return torque + p["size"] * deflection


def _delay(rows: Rows, torque: np.ndarray, p: Values, memory: Memory) -> np.ndarray:
    t = np.append(memory.get("t", rows.t[:0]), rows.t)
    past = np.append(memory.get("torque", torque[:0]), torque)
    keep = max(int(np.searchsorted(t, rows.t[-1] - p["size"])) - 1, 0)
    memory["t"], memory["torque"] = t[keep:], past[keep:]
    return np.asarray(np.interp(rows.t - p["size"], t, past))


FAULTS: Mapping[str, Fault] = {
    "coulomb": Fault(
        "more friction of direction", "N·m", 0.5,
        lambda r, torque, p, _: torque + p["size"] * r.direction, of_friction=True,
    ),
    "viscous": Fault(
        "more friction per speed", "N·m·s/rad", 0.5,
        lambda r, torque, p, _: torque + p["size"] * r.qd, of_friction=True,
    ),
    "offset": Fault(
        "a constant torque, or a zero of the current", "N·m", 0.3,
        lambda r, torque, p, _: torque + p["size"], of_friction=True,
    ),
    "stribeck": Fault(
        "more friction at low speed", "N·m", 0.5,
        lambda r, torque, p, _: torque
        + p["size"] * r.direction * np.exp(-np.square(r.qd / p["speed"])), {"speed": 0.05}, True,
    ),
    "load": Fault(
        "friction that grows with the load of the gear", "1", 0.1,
        lambda r, torque, p, _: torque + p["size"] * np.abs(r.rigid) * r.direction,
    ),
    "temperature": Fault(
        "friction that changes with temperature", "1/K", -0.01,
        lambda r, torque, p, _: torque + p["size"] * (r.warm - _ROOM_C) * r.coulomb * r.direction,
    ),
    "asymmetry": Fault(
        "more friction in positive direction alone", "N·m", 0.5,
        lambda r, torque, p, _: torque + p["size"] * np.maximum(r.direction, 0.0), of_friction=True,
    ),
    "hysteresis": Fault(
        "friction that builds up over a way after each reversal", "N·m", 0.5, _hysteresis,
        {"width": 0.02}, True,
    ),
    "inertia": Fault(
        "a heavier rotor or gear", "kg·m²", 0.3,
        lambda r, torque, p, _: torque + p["size"] * r.qdd,
    ),
    "constant": Fault(
        "torque per current differs, relative", "1", 0.1,
        lambda r, torque, p, _: torque / (1.0 + p["size"]),
    ),
    "cogging": Fault(
        "a periodic torque over the joint's turn", "N·m", 0.4,
        lambda r, torque, p, _: torque + p["size"] * np.sin(p["order"] * r.q + p["phase"]),
        {"order": 6.0, "phase": 0.0}, True,
    ),
    "ripple": Fault(
        "the torque's gain is periodic over the joint's turn", "1", 0.05,
        lambda r, torque, p, _: torque
        * (1.0 + p["size"] * np.sin(p["order"] * r.q + p["phase"])), {"order": 12.0, "phase": 0.0},
    ),
    "delay": Fault("the effort is reported late", "s", 0.02, _delay),
}  # fmt: skip
"""Fault by kind, the name without ``drive.``; default sizes, speeds [rad/s or m/s], widths [rad or
m], orders [1 per rad] and phases [rad] are estimates."""


@dataclass(eq=False)
class ActiveFault:
    """One fault of one joint with its values; it remembers earlier rows.

    Attributes:
        name: for instance ``drive.coulomb``.
        joint: from 1.
        values: size and further parameters, SI.
    """

    name: str
    joint: int
    values: Values
    _memory: Memory = field(default_factory=dict)

    def act(self, rows: Rows, torque: np.ndarray) -> np.ndarray:
        """Torque (N,) [N·m or N] with the fault added; calls must follow each other in time."""
        return FAULTS[self.name.removeprefix(PREFIX)].formula(
            rows, torque, self.values, self._memory
        )


def active_fault(name: str, given: Mapping[str, Any], coulomb: np.ndarray) -> ActiveFault:
    """Make a fault from its name, as ``drive.coulomb``, and ``given``: ``joint`` (from 1), ``size``
    and further parameters, else defaults; these may scale with the Coulomb frictions (J,). A
    `NotFoundError` or `ParameterError` if there is no such fault, joint or parameter."""
    kind, joints = name.removeprefix(PREFIX), len(coulomb)
    if kind not in FAULTS:
        raise NotFoundError(f"there is no effect {name!r}{did_you_mean(kind, sorted(FAULTS))}")
    fault, values = FAULTS[kind], dict(given)
    joint = values.pop("joint", 1)
    if not isinstance(joint, int | float) or joint not in range(1, joints + 1):
        raise ParameterError(f"{name}: joint = {joint!r} must be 1 … {joints}")
    scale = float(coulomb[int(joint) - 1]) if fault.of_friction else 1.0
    known: dict[str, float] = {"size": fault.typical * scale, **fault.more}
    for key, value in values.items():
        if key not in known:
            close = did_you_mean(key, ["joint", *known])
            raise ParameterError(f"{name}: there is no parameter {key!r}{close}")
        if not isinstance(value, int | float) or not np.isfinite(value):
            raise ParameterError(f"{name}: {key} = {value!r} is no number")
        known[key] = float(value)
    for right, key, rule in (
        (kind != "delay" or known["size"] >= 0.0, "size", "not be below 0 [s]"),
        (kind != "constant" or known["size"] > -1.0, "size", "be above -1"),
        *((known.get(key, 1.0) > 0.0, key, "be above 0") for key in ("speed", "width")),
    ):
        if not right:
            raise ParameterError(f"{name}: {key} = {known[key]:g} must {rule}")
    return ActiveFault(name, int(joint), known)


def apart(given: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, Any]]:
    """Split values by name into those of drives (``drive.…``), as numbers, and all others."""
    drives = {k: v for k, v in given.items() if k.startswith(PREFIX)}
    return drives, {k: v for k, v in given.items() if k not in drives}


def faults_apart(effects: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split texts ``name:key=value`` of effects into faults of drives and all others."""
    faults = tuple(text for text in effects if text.startswith(PREFIX))
    return faults, tuple(text for text in effects if text not in faults)
