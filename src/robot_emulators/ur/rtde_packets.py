"""RTDE's packets: headers, types, recipes, and the fields of each software version; big endian.

A header is the uint16 size of the packet and a uint8 type. Source: Universal Robots, "Real-Time
Data Exchange (RTDE) guide". wrenchbed's driver has another codec (hardware/drivers/rtde).
"""

import struct
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from robot_emulators.errors import EmulatorError

VERSION, CONTROLLER, TEXT, DATA = ord("V"), ord("v"), ord("M"), ord("U")
OUTPUTS, INPUTS, START, PAUSE = ord("O"), ord("I"), ord("S"), ord("P")

HEADER = 3
FORMATS = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip
"""Name of an RTDE type → its format in `struct`."""
WARNING = 2
"""Level of an RTDE text message: warning."""
_LONGEST_NAMES = 1 << 14
"""Most bytes of a recipe's names; the maker's client library asks for all outputs in 9,174."""

Values = tuple[Any, ...]
"""Value of one field: a tuple of as many numbers as its type has."""
Version = tuple[int, int, int, int]
"""Version of the controller's software: major, minor, bugfix, build."""
REGISTERS = 48
BIT_REGISTERS = range(64, 128)
_OUTPUTS = {
    "DOUBLE": """timestamp actual_execution_time target_execution_time speed_scaling
        target_speed_fraction actual_momentum actual_main_voltage actual_robot_voltage
        actual_robot_current standard_analog_input0 standard_analog_input1 standard_analog_output0
        standard_analog_output1 io_current euromap67_24V_voltage euromap67_24V_current
        tool_analog_input0 tool_analog_input1 tool_output_current tool_temperature
        tcp_force_scalar joint_position_deviation_ratio collision_detection_ratio payload
        actual_robot_energy_consumed actual_robot_braking_energy_dissipated""",
    "VECTOR6D": """target_q target_qd target_qdd target_current target_moment actual_q actual_qd
        actual_current actual_current_window actual_current_as_torque joint_control_output
        actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed
        tcp_offset actual_TCP_acceleration target_TCP_acceleration joint_temperatures
        actual_joint_voltage ft_raw_wrench wrench_calc_from_currents payload_inertia
        target_base_acceleration target_base_wrench""",
    "VECTOR3D": """actual_tool_accelerometer elbow_position elbow_velocity payload_cog
        target_gravity""",
    "UINT64": """actual_digital_input_bits actual_digital_output_bits
        actual_configurable_digital_input_bits actual_configurable_digital_output_bits
        control_step""",
    "UINT32": """runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode
        tool_analog_input_types output_bit_registers0_to_31 output_bit_registers32_to_63
        input_bit_registers0_to_31 input_bit_registers32_to_63 euromap67_input_bits
        euromap67_output_bits script_control_line""",
    "INT32": """robot_mode safety_mode safety_status tool_output_voltage time_scale_source
        encoder0_raw encoder1_raw""",
    "VECTOR6INT32": "joint_mode",
    "UINT8": "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
}
_INPUTS = {
    "UINT32": "speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63",
    "DOUBLE": "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    "UINT8": """standard_digital_output_mask standard_digital_output
        configurable_digital_output_mask configurable_digital_output tool_digital_output_mask
        tool_digital_output standard_analog_output_mask standard_analog_output_type""",
    "VECTOR6D": "external_force_torque",
}
_NEVER = (99, 0, 0)
_SINCE: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "ft_raw_wrench": (_NEVER, (5, 9, 0)),
    "payload": ((3, 11, 0), (5, 5, 1)),
    "payload_cog": ((3, 11, 0), (5, 5, 1)),
    "payload_inertia": ((3, 15, 0), (5, 11, 0)),
    "actual_current_as_torque": (_NEVER, (5, 23, 0)),
    "safety_status": ((3, 10, 0), (5, 4, 0)),
}
"""Field → first software version of CB3 and of e-Series that has it, if not all have."""
_UPPER_RANGE = ((3, 9, 0), (5, 3, 0))


def packet(kind: int, payload: bytes = b"") -> bytes:
    """Return the bytes of an RTDE packet: header with packet type ``kind``, and payload."""
    return struct.pack(">HB", HEADER + len(payload), kind) + payload


def text(message: str, source: str, level: int, version: int) -> bytes:
    """Return an RTDE text message from ``source`` in protocol ``version`` 1 or 2; ``level`` 0:
    exception, 1: error, 2: warning."""
    said, by = message.encode()[:255], source.encode()[:255]
    if version == 1:
        return packet(TEXT, bytes([level]) + said)
    return packet(TEXT, bytes([len(said)]) + said + bytes([len(by)]) + by + bytes([level]))


def names(raw: bytes) -> list[str] | None:
    """Field names in an RTDE client's comma-separated request; None if longer than allowed."""
    if len(raw) > _LONGEST_NAMES:
        return None
    return [name for name in raw.decode("latin-1").split(",") if name]


class Splitter:
    """Cuts a stream of bytes into RTDE packets; ``held`` are bytes of an unfinished one."""

    def __init__(self) -> None:
        self.held = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Add received bytes; return type and payload of each packet that is now complete. Raises
        an `EmulatorError` if a packet's size is less than that of its header.
        """
        self.held += data
        packets, at = [], 0
        while len(self.held) - at >= HEADER:
            size, kind = struct.unpack_from(">HB", self.held, at)
            if size < HEADER:
                raise EmulatorError(f"packet of {size} bytes: its header alone has {HEADER}")
            if len(self.held) - at < size:
                break
            packets.append((kind, bytes(self.held[at + HEADER : at + size])))
            at += size
        del self.held[:at]
        return packets


class Recipe:
    """Recipe of RTDE: fields of a data packet, in order.

    Args:
        number: recipe id; None in protocol 1, whose data packets do not carry it.
        fields: name and RTDE type of each field.
    """

    def __init__(self, number: int | None, fields: Sequence[tuple[str, str]]) -> None:
        self.number = number
        self.names = tuple(name for name, _ in fields)
        self.types = tuple(kind for _, kind in fields)
        self._struct = struct.Struct(">" + "".join(FORMATS[kind] for kind in self.types))
        self._widths = tuple(int(FORMATS[kind][:-1] or 1) for kind in self.types)

    def pack(self, values: Mapping[str, Values]) -> bytes:
        """Return the bytes of a data packet with the values of its fields, given by name."""
        flat = chain.from_iterable([values[name] for name in self.names])
        head = b"" if self.number is None else bytes([self.number])
        return packet(DATA, head + self._struct.pack(*flat))

    def unpack(self, payload: bytes) -> dict[str, Values] | None:
        """Decode a data packet's payload to field → value; None if it is too short."""
        if len(payload) < self._struct.size:
            return None
        flat = self._struct.unpack_from(payload)
        result, at = {}, 0
        for name, width in zip(self.names, self._widths, strict=True):
            result[name] = flat[at : at + width]
            at += width
        return result


def outputs(version: Version) -> dict[str, str]:
    """Field name → type of the RTDE outputs that a software version offers."""
    fields = _listed(_OUTPUTS) | _registers("output", version) | _registers("input", version)
    return {
        name: kind for name, kind in fields.items()
        if name not in _SINCE or _after(_SINCE[name], version)
    }  # fmt: skip


def inputs(version: Version) -> dict[str, str]:
    """Field name → type of the RTDE inputs that a software version accepts."""
    return _listed(_INPUTS) | _registers("input", version)


def zero(kind: str) -> Values:
    """Return the zero of an RTDE type: a tuple with one element for each number of it."""
    if kind == "BOOL":
        return (False,)
    number: float | int = 0.0 if "DOUBLE" in kind or kind.endswith("D") else 0
    return (number,) * int(FORMATS[kind][:-1] or 1)


def _listed(table: dict[str, str]) -> dict[str, str]:
    return {name: kind for kind, names in table.items() for name in names.split()}


def _registers(way: str, version: Version) -> dict[str, str]:
    count = REGISTERS if _after(_UPPER_RANGE, version) else REGISTERS // 2
    kinds = {f"{way}_int_register_{k}": "INT32" for k in range(count)}
    kinds |= {f"{way}_double_register_{k}": "DOUBLE" for k in range(count)}
    return kinds | {f"{way}_bit_register_{k}": "BOOL" for k in BIT_REGISTERS}


def _after(since: tuple[tuple[int, int, int], tuple[int, int, int]], version: Version) -> bool:
    return version[:3] >= since[0 if version[0] < 5 else 1]
