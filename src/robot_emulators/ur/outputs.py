"""The controller's output fields, updated every control cycle, and its clock."""

import time
from collections.abc import Set

import numpy as np

from robot_emulators.plant import Plant
from robot_emulators.ur.controller import Controller
from robot_emulators.ur.kinematics import vector
from robot_emulators.ur.modes import RobotMode, Runtime, SafetyMode
from robot_emulators.ur.rtde_packets import Values

_DECIMALS = 12
"""Decimals of reported joint values [rad]: a controlled arm at rest still approaches its target by
less, and an encoder shows no such change."""
_STILL: dict[str, Values] = {
    "actual_joint_voltage": (48.0,) * 6,
    "actual_main_voltage": (48.0,),
    "actual_robot_voltage": (48.0,),
    "actual_robot_current": (0.6,),
    "standard_analog_input0": (0.0,),
    "io_current": (0.07,),
    "tool_temperature": (30.0,),
    "actual_execution_time": (0.35,),
    "target_execution_time": (0.35,),
    "actual_current_window": (1.0,) * 6,
}
_SAFETY_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}
_RUNNING, _OFF, _IDLE = 253, 239, 255
"""Values of the field joint_mode: running, power off, idle."""


class Outputs:
    """Computes the output fields of a UR controller, `Controller.values`, every cycle.

    Args:
        controller: controller whose fields are updated.
        shared: whether field ft_raw_wrench shows the flange sensor, else the arm's own measurement.
    """

    def __init__(self, controller: Controller, shared: bool) -> None:
        self._controller, self._shared = controller, shared
        self._count = 0
        self._tool_fields = frozenset(self._tool())
        controller.values.update({k: v for k, v in _STILL.items() if k in controller.fields})

    def restart(self) -> None:
        self._count = 0

    def update(self, timestamp: float, wanted: Set[str]) -> None:
        """Update a UR's output fields at controller time [s]; slow ones only if in ``wanted``."""
        controller = self._controller
        self._count += 1
        outputs: dict[str, Values] = {"timestamp": (timestamp,), "control_step": (self._count,)}
        outputs |= self._joints() | self._modes()
        if not wanted.isdisjoint(self._tool_fields):
            outputs |= self._tool()
        if "ft_raw_wrench" in wanted:
            outputs["ft_raw_wrench"] = self._raw()
        values = controller.values
        values.update({name: value for name, value in outputs.items() if name in controller.fields})

    def _raw(self) -> Values:
        """Field ft_raw_wrench (6,) [N, N·m]: the reading of the flange sensor or, if a Net F/T box
        serves that sensor, of the arm's own."""
        plant = self._controller.arm.plant
        if not self._shared:
            return tuple(self._controller.arm.load.tolist())
        reading, _ = plant.readings(np.array([plant.time]))
        return tuple(reading[0].tolist())

    def _joints(self) -> dict[str, Values]:
        arm = self._controller.arm
        return self._efforts() | {
            "target_q": tuple(arm.q.tolist()),
            "target_qd": tuple(arm.qd.tolist()),
            "target_qdd": tuple(arm.qdd.tolist()),
            "actual_q": tuple(arm.plant.q.round(_DECIMALS).tolist()),
            "actual_qd": tuple(arm.plant.qd.tolist()),
        }

    def _efforts(self) -> dict[str, Values]:
        """Output fields of joint torque and current: targets (frictionless model) and actual."""
        arm = self._controller.arm
        plant, gravity = arm.plant, self._controller.estimate.gravity
        wanted = plant.model_torques(arm.q, arm.qd, arm.qdd, gravity)
        effort = plant.efforts
        current = tuple(effort.current.tolist())
        return {
            "target_current": tuple((wanted / plant.arm.constants).tolist()),
            "target_moment": tuple(wanted.tolist()),
            "actual_current": current,
            "actual_current_as_torque": tuple(effort.torque.tolist()),
            "joint_control_output": current,
            "joint_temperatures": tuple(effort.temperature.tolist()),
        }

    def _tool(self) -> dict[str, Values]:
        controller = self._controller
        arm, estimate = controller.arm, controller.estimate
        kinematics, tcp = arm.kinematics, arm.tcp
        jacobian, rotation, position = kinematics.jacobian_and_transform(arm.plant.q, tcp)
        target, target_rotation, target_position = kinematics.jacobian_and_transform(arm.q, tcp)
        wrench, payload = estimate.wrench, estimate.payload
        return {
            "actual_TCP_pose": tuple(vector(rotation, position).tolist()),
            "target_TCP_pose": tuple(vector(target_rotation, target_position).tolist()),
            "actual_TCP_speed": tuple((jacobian @ arm.plant.qd).tolist()),
            "target_TCP_speed": tuple((target @ arm.qd).tolist()),
            "actual_TCP_force": tuple(wrench.tolist()),
            "tcp_force_scalar": (float(np.linalg.norm(wrench[:3])),),
            "tcp_offset": tuple(tcp.tolist()),
            "actual_tool_accelerometer": tuple((-(rotation.T @ estimate.gravity)).tolist()),
            "elbow_position": tuple(kinematics.elbow(arm.plant.q).tolist()),
            "payload": (payload.mass,),
            "payload_cog": tuple(payload.cog.tolist()),
            "payload_inertia": tuple(payload.inertia.tolist()),
            "target_gravity": tuple((-estimate.gravity).tolist()),
        }

    def _modes(self) -> dict[str, Values]:
        controller = self._controller
        modes, terminals = controller.modes, controller.terminals
        powered = modes.robot is not RobotMode.POWER_OFF
        joint = _RUNNING if modes.robot == 7 else _IDLE if modes.robot == 5 else _OFF
        return {
            "robot_mode": (int(modes.robot),),
            "safety_mode": (int(modes.safety),),
            "safety_status": (int(modes.safety),),
            "runtime_state": (int(modes.runtime),),
            "robot_status_bits": (powered | (modes.runtime is Runtime.PLAYING) << 1,),
            "safety_status_bits": (_SAFETY_BITS[modes.safety],),
            "joint_mode": (joint,) * 6,
            "speed_scaling": (terminals.slider,),
            "target_speed_fraction": (terminals.slider,),
            "actual_digital_output_bits": (terminals.bits,),
            "actual_configurable_digital_output_bits": (terminals.bits >> 8 & 0xFF,),
            "standard_analog_output0": terminals.analog_values[:1],
            "standard_analog_output1": terminals.analog_values[1:],
            "analog_io_types": (terminals.analog_types << 2,),
        }


class Timestamp:
    """Controller clock [s] since power-up: simulated time with the shifts that faults inject."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._offset = -plant.time

    def now(self) -> float:
        """Time stamp of the robot's newest state [s]."""
        return self._offset + self._plant.time

    def jump(self, by: float) -> None:
        """Shift the clock by a time [s], for instance one that the loop has lost."""
        self._offset += by

    def restart(self, at: float) -> None:
        """Set the clock so that it shows 0 at the power-up, at `time.monotonic` time ``at`` [s]."""
        off = max(0.0, at - time.monotonic())
        self._offset = -self._plant.time - (off if off != float("inf") else 0.0)
