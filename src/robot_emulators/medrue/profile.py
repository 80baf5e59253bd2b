"""What the EDS file of MedRUE's drives cannot state of their objects of CiA 402.

That is values after power-up that depend on the axis, and values that may be written where not all
within a range may. Positions are in counts, speeds in count/s, accelerations in count/s². Source:
CiA 402-2 (IEC 61800-7-201).
"""

from dataclasses import dataclass
from importlib import resources

from robot_emulators.canopen.dictionary import Abort, AbortError, Key, Objects
from robot_emulators.medrue.axis import CYCLIC, HOMING, PROFILE
from robot_emulators.medrue.motion import METHODS

SHEET = resources.files(__package__).joinpath("cia402.eds").read_text("utf-8")
"""The EDS file; its values after power-up are those of an axis of 2,000,000 counts."""
CONTROL, STATUS, TARGET, ACTUAL = (0x6040, 0), (0x6041, 0), (0x607A, 0), (0x6064, 0)
COMMANDS = (CONTROL, TARGET)
"""Objects whose writing is a command, no setting."""
FAULT_SIGNAL, QUICK_STOP = 1, 3
"""Values of the abort connection option code (0x6007); 0 does nothing."""
ALLOWED: dict[Key, tuple[int, ...]] = {
    (0x6007, 0): (0, FAULT_SIGNAL, QUICK_STOP),
    (0x605A, 0): (0, 1, 2, 5, 6),
    (0x6060, 0): (PROFILE, HOMING, CYCLIC),
    (0x6098, 0): (0, *METHODS),
}
"""Objects of which only some values may be written."""
RATED_A = 4.0
"""Rated current of a motor [A]. MedRUE's motors are not published; currents are reported in
thousandths of it, in 16 bits with a sign, so that 130 A can be reported."""
_NEAR = 0.05
"""Position window as a part of the largest following error: a servo at rest is well within it."""


@dataclass(frozen=True)
class Ratings:
    """Limits and ratings of one axis and its drive.

    Attributes:
        lower: software position limit [count].
        upper: the other software position limit [count].
        window: largest following error [count].
        quick: quick-stop deceleration [count/s²].
        speed: top speed [count/s].
        acceleration: of profiles [count/s²].
        torque: rated, of its motor [N·m, or N].
    """

    lower: int
    upper: int
    window: int
    quick: float
    speed: float
    acceleration: float
    torque: float


def rate(objects: Objects, ratings: Ratings, position: int) -> None:
    """Write the values that an axis has after power-up at a position [count]."""
    speed, acceleration = round(ratings.speed), round(ratings.acceleration)
    values = {
        (0x6062, 0): position, ACTUAL: position, TARGET: position,
        (0x6065, 0): ratings.window, (0x6067, 0): round(_NEAR * ratings.window),
        (0x6075, 0): round(RATED_A * 1000.0), (0x6076, 0): round(ratings.torque * 1000.0),
        (0x607D, 1): ratings.lower, (0x607D, 2): ratings.upper,
        (0x607F, 0): speed, (0x6081, 0): speed,
        (0x6083, 0): acceleration, (0x6084, 0): acceleration, (0x6085, 0): round(ratings.quick),
    }  # fmt: skip
    for key, value in values.items():
        objects[key] = value


def check(objects: Objects) -> None:
    """Refuse values that are not `ALLOWED`."""
    for key, values in ALLOWED.items():

        def refuse(value: int, values: tuple[int, ...] = values) -> None:
            if value not in values:
                raise AbortError(Abort.VALUE)

        objects.entry(key).check = refuse
