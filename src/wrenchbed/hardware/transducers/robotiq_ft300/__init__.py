"""Transducer for a Robotiq FT 300 or FT 300-S on its own RS-485 line: Modbus RTU, then a stream.

May import: transducer base, ``serial_line``, registry, errors; no other transducer.
Read first: ``transducer.py``, then ``modbus.py`` (registers) and ``packets.py`` (the stream).
"""

from wrenchbed.hardware.transducers.robotiq_ft300.transducer import (
    RobotiqFt300Options,
    RobotiqFt300Transducer,
)

TRANSDUCER = RobotiqFt300Transducer

__all__ = ["TRANSDUCER", "RobotiqFt300Options", "RobotiqFt300Transducer"]
