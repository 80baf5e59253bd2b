"""What the EDS file of MedRUE's drives cannot state of their objects of CiA 402.

That is values after power-up that depend on the axis, and values that may be written where not all
within a range may. Positions are in counts, speeds in count/s, accelerations in count/s². Source:
CiA 402-2 (IEC 61800-7-201).
"""

from importlib import resources

from robot_emulators.canopen.dictionary import Abort, AbortError, Key, Objects
from robot_emulators.medrue.axis import CYCLIC, HOMING, METHODS, PROFILE

SHEET = resources.files(__package__).joinpath("cia402.eds").read_text("utf-8")
"""The EDS file; its values after power-up are those of an axis of 2,000,000 counts."""
CONTROL, STATUS, TARGET, ACTUAL = (0x6040, 0), (0x6041, 0), (0x607A, 0), (0x6064, 0)
RATED_CURRENT, RATED_TORQUE = (0x6075, 0), (0x6076, 0)
"""In mA, and in mN·m or mN."""
FAULT_SIGNAL, QUICK_STOP = 1, 3
"""Values of the abort connection option code (0x6007); 0 does nothing."""
ALLOWED: dict[Key, tuple[int, ...]] = {
    (0x6007, 0): (0, FAULT_SIGNAL, QUICK_STOP),
    (0x605A, 0): (0, 1, 2, 5, 6),
    (0x6060, 0): (PROFILE, HOMING, CYCLIC),
    (0x6098, 0): (0, *METHODS),
}
"""Objects of which only some values may be written."""
_RATED_A = 4.0
"""Rated current of a motor [A]. MedRUE's motors are not published; currents are reported in
thousandths of it, in 16 bits with a sign, so that 130 A can be reported."""
_NEAR = 0.05
"""Position window as a part of the largest following error: a servo at rest is well within it."""


def rated(
    lower: int, upper: int, window: int, quick: float, speed: float, acceleration: float,
    torque: float,
) -> dict[Key, int]:  # fmt: skip
    """Values after power-up that depend on the axis.

    Args:
        lower, upper: software position limits [count].
        window: largest following error [count].
        quick: quick-stop deceleration [count/s²].
        speed: top speed [count/s].
        acceleration: of profiles [count/s²].
        torque: rated, of its motor [N·m, or N].
    """
    top, rate = round(speed), round(acceleration)
    return {
        (0x6065, 0): window, (0x6067, 0): round(_NEAR * window),
        RATED_CURRENT: round(_RATED_A * 1000.0), RATED_TORQUE: round(torque * 1000.0),
        (0x607D, 1): lower, (0x607D, 2): upper, (0x607F, 0): top, (0x6081, 0): top,
        (0x6083, 0): rate, (0x6084, 0): rate, (0x6085, 0): round(quick),
    }  # fmt: skip


def check(objects: Objects) -> None:
    """Refuse values that are not `ALLOWED`."""
    for key, values in ALLOWED.items():

        def refuse(value: int, values: tuple[int, ...] = values) -> None:
            if value not in values:
                raise AbortError(Abort.VALUE)

        objects.entry(key).check = refuse
