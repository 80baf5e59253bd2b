"""The objects of CiA 402 that a drive has, with their types, ranges and values after power-up.

Positions are in counts, speeds in count/s, accelerations in count/s². Source: CiA 402-2
(IEC 61800-7-201).
"""

from collections.abc import Callable, Sequence

from robot_emulators.canopen.dictionary import (
    I8,
    I16,
    I32,
    TEXT,
    U8,
    U16,
    U32,
    Abort,
    AbortError,
    Entry,
    Objects,
)
from robot_emulators.medrue.axis import CYCLIC, MODES, Ratings
from robot_emulators.medrue.motion import METHODS, MotionSettings

CONTROL, STATUS, TARGET, TARGET_SPEED = (0x6040, 0), (0x6041, 0), (0x607A, 0), (0x60FF, 0)
MODE, POLARITY = (0x6060, 0), (0x607E, 0)
COMMANDS = (CONTROL, TARGET, TARGET_SPEED)
"""Objects whose writing is a command, no setting."""
LABEL = 0x2000
"""A text of the user, for long transfers."""
RATED_A = 4.0
"""Rated current of a motor [A]; an estimate."""
_NEAR, _SEARCH, _CREEP = 0.05, 0.1, 0.01
"""Position window as a share of the following window; speeds of homing as shares of the top speed;
estimates."""
_STEADY, _STILL, _HELD_MS = 0.01, 0.001, 20
"""Velocity window and threshold as shares of the top speed, and for how long; estimates."""
_QUICK_STOPS, _FAULT_SIGNAL, _QUICK_STOP = (0, 1, 2, 5, 6), 1, 3


def only(*values: int) -> Callable[[int], None]:
    """A check that lets only some values pass."""

    def check(value: int) -> None:
        if value not in values:
            raise AbortError(Abort.VALUE)

    return check


def define(objects: Objects, ratings: Ratings, position: int) -> None:
    """Write the profile's area as it is after power-up.

    Args:
        objects: the dictionary.
        ratings: of the axis.
        position: where the axis is [count].
    """
    _texts(objects)
    _states(objects)
    _values(objects, ratings, position)
    _positions(objects, ratings, position)
    _dynamics(objects, ratings)
    _homing(objects, ratings)


def _texts(objects: Objects) -> None:
    objects.add(LABEL, Entry("User label", TEXT, b"axis of a robot arm", "rw"))


def _states(objects: Objects) -> None:
    def option(index: int, name: str, value: int, allowed: Sequence[int]) -> None:
        objects.add(index, Entry(name, I16, value, "rw", check=only(*allowed)))

    add = objects.add
    broken = (0, _FAULT_SIGNAL, _QUICK_STOP)
    option(0x6007, "Abort connection option code", _FAULT_SIGNAL, broken)
    add(0x603F, Entry("Error code", U16, 0, mapped=True))
    add(0x6040, Entry("Controlword", U16, 0, "rw", True, kept=False))
    add(0x6041, Entry("Statusword", U16, 0x40, mapped=True))
    option(0x605A, "Quick stop option code", 6, _QUICK_STOPS)
    option(0x605B, "Shutdown option code", 0, (0, 1))
    option(0x605C, "Disable operation option code", 1, (0, 1))
    option(0x605D, "Halt option code", 1, (1, 2))
    option(0x605E, "Fault reaction option code", 2, (0, 1, 2))
    add(0x6060, Entry("Modes of operation", I8, CYCLIC, "rw", True, check=only(*MODES)))
    add(0x6061, Entry("Modes of operation display", I8, CYCLIC, mapped=True))
    add(0x6502, Entry("Supported drive modes", U32, sum(1 << (mode - 1) for mode in MODES)))


def _values(objects: Objects, ratings: Ratings, position: int) -> None:
    """What the drive measures and what it is."""
    for index, name, kind, value in (
        (0x6062, "Position demand value", I32, position),
        (0x6064, "Position actual value", I32, position),
        (0x606B, "Velocity demand value", I32, 0),
        (0x606C, "Velocity actual value", I32, 0),
        (0x6077, "Torque actual value", I16, 0),
        (0x6078, "Current actual value", I16, 0),
        (0x60F4, "Following error actual value", I32, 0),
        (0x60FD, "Digital inputs", U32, 0),
    ):
        objects.add(index, Entry(name, kind, value, mapped=True))
    objects.add(0x6075, Entry("Motor rated current", U32, round(RATED_A * 1000.0)))
    objects.add(0x6076, Entry("Motor rated torque", U32, round(ratings.torque * 1000.0)))


def _positions(objects: Objects, ratings: Ratings, position: int) -> None:
    add = objects.add
    add(0x6065, Entry("Following error window", U32, ratings.window, "rw"))
    add(0x6066, Entry("Following error time out", U16, 0, "rw"))
    add(0x6067, Entry("Position window", U32, round(_NEAR * ratings.window), "rw"))
    add(0x6068, Entry("Position window time", U16, _HELD_MS, "rw"))
    add(0x607A, Entry("Target position", I32, position, "rw", True, kept=False))
    add(0x607C, Entry("Home offset", I32, 0, "rw"))
    limits = {
        1: Entry("Min position limit", I32, ratings.lower, "rw"),
        2: Entry("Max position limit", I32, ratings.upper, "rw"),
    }
    objects.record(0x607D, "Software position limit", limits, array=True)
    add(0x607E, Entry("Polarity", U8, 0, "rw", check=only(0x00, 0x40, 0x80, 0xC0)))


def _dynamics(objects: Objects, ratings: Ratings) -> None:
    def rate(index: int, name: str, value: float, mapped: bool = False) -> None:
        objects.add(index, Entry(name, U32, round(value), "rw", mapped, low=1))

    def short(index: int, name: str, value: float) -> None:
        objects.add(index, Entry(name, U16, round(min(value, 0xFFFF)), "rw"))

    short(0x606D, "Velocity window", _STEADY * ratings.speed)
    short(0x606E, "Velocity window time", _HELD_MS)
    short(0x606F, "Velocity threshold", _STILL * ratings.speed)
    short(0x6070, "Velocity threshold time", 0)
    rate(0x607F, "Max profile velocity", ratings.speed)
    rate(0x6081, "Profile velocity", ratings.speed, mapped=True)
    rate(0x6083, "Profile acceleration", ratings.acceleration)
    rate(0x6084, "Profile deceleration", ratings.acceleration)
    rate(0x6085, "Quick stop deceleration", ratings.quick)
    objects.add(0x6086, Entry("Motion profile type", I16, 0, "rw", check=only(0)))
    period = {
        1: Entry("Interpolation time period value", U8, 4, "rw", low=1),
        2: Entry("Interpolation time index", I8, -3, "rw", low=-4, high=-2),
    }
    objects.record(0x60C2, "Interpolation time period", period)
    objects.add(0x60FF, Entry("Target velocity", I32, 0, "rw", True, kept=False))


def _homing(objects: Objects, ratings: Ratings) -> None:
    objects.add(0x6098, Entry("Homing method", I8, 0, "rw", check=only(0, *METHODS)))
    objects.record(
        0x6099, "Homing speeds",
        {
            1: Entry(
                "Speed during search for switch", U32, round(_SEARCH * ratings.speed), "rw", low=1
            ),
            2: Entry(
                "Speed during search for zero", U32, round(_CREEP * ratings.speed), "rw", low=1
            ),
        },
        array=True,
    )  # fmt: skip
    acceleration = Entry("Homing acceleration", U32, round(ratings.acceleration), "rw", low=1)
    objects.add(0x609A, acceleration)
    methods = {k: Entry(f"Method {k}", I8, m) for k, m in enumerate(METHODS, start=1)}
    objects.record(0x60E3, "Supported homing methods", methods, array=True)


def settings(objects: Objects) -> MotionSettings:
    """What the master set."""
    o = objects
    return MotionSettings(
        lower=o[0x607D, 1], upper=o[0x607D, 2], window=o[0x6065, 0],
        speed=min(o[0x6081, 0], o[0x607F, 0]), top=o[0x607F, 0], up=o[0x6083, 0],
        down=o[0x6084, 0], quick=o[0x6085, 0], mode=o[0x6060, 0], window_s=o[0x6066, 0] * 1e-3,
        near=o[0x6067, 0], near_s=o[0x6068, 0] * 1e-3, steady=o[0x606D, 0],
        steady_s=o[0x606E, 0] * 1e-3, still=o[0x606F, 0], still_s=o[0x6070, 0] * 1e-3,
        quick_option=o[0x605A, 0], shutdown_option=o[0x605B, 0], disable_option=o[0x605C, 0],
        halt_option=o[0x605D, 0], fault_option=o[0x605E, 0], method=o[0x6098, 0],
        search=o[0x6099, 1], creep=o[0x6099, 2], homing_up=o[0x609A, 0], home=o[0x607C, 0],
    )  # fmt: skip
