"""What an RTDE client may read and write: names, types and the versions that brought them."""

from wrenchbed.twins.ur5.wire import FORMATS, Values

Version = tuple[int, int, int, int]
"""Major, minor, bugfix, build of the controller's software."""

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
"""First software of CB3 and of e-Series with a field, where it came late."""
_UPPER_RANGE = ((3, 9, 0), (5, 3, 0))


def outputs(version: Version) -> dict[str, str]:
    """Name → type of what this software sends."""
    found = _listed(_OUTPUTS) | _registers("output", version) | _registers("input", version)
    return {name: kind for name, kind in found.items() if _exists(name, version)}


def inputs(version: Version) -> dict[str, str]:
    """Name → type of what this software takes."""
    return _listed(_INPUTS) | _registers("input", version)


def zero(kind: str) -> Values:
    """A type's value at rest."""
    if kind == "BOOL":
        return (False,)
    number: float | int = 0.0 if "DOUBLE" in kind or kind.endswith("D") else 0
    return (number,) * int(FORMATS[kind][:-1] or 1)


def _listed(table: dict[str, str]) -> dict[str, str]:
    return {name: kind for kind, names in table.items() for name in names.split()}


def _registers(way: str, version: Version) -> dict[str, str]:
    count = REGISTERS if _after(_UPPER_RANGE, version) else REGISTERS // 2
    found = {f"{way}_int_register_{k}": "INT32" for k in range(count)}
    found |= {f"{way}_double_register_{k}": "DOUBLE" for k in range(count)}
    return found | {f"{way}_bit_register_{k}": "BOOL" for k in BIT_REGISTERS}


def _exists(name: str, version: Version) -> bool:
    return name not in _SINCE or _after(_SINCE[name], version)


def _after(since: tuple[tuple[int, int, int], tuple[int, int, int]], version: Version) -> bool:
    return version[:3] >= since[0 if version[0] < 5 else 1]
