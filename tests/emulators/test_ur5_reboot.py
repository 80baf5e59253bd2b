"""The UR5 emulator after its control box was power-cycled: nothing of a client survives."""

import numpy as np
import pytest

from robot_emulators.base.faults import TimedFault
from robot_emulators.ur.outputs import Outputs
from robot_emulators.ur.tool_wrench import GRAVITY
from ur5_bench import CYCLE, Bench
from wrenchbed.plant.serving import EmulatorOptions, emulated


@pytest.fixture
def bench():
    return Bench(series="e").script()


def reboot(bench: Bench) -> dict:
    """Switch off and on; all that it says afterwards."""
    bench.controller.reboot()
    bench.write(i0=0)
    bench.run(0.5)
    outputs = Outputs(bench.controller, shared=False)
    outputs.update(1.0, set(bench.controller.fields))
    return bench.controller.values


def test_what_a_program_set_is_that_of_the_installation_again(bench):
    for command in ((29, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0), (59, 0.0, 9.0, 0.0), (21, 0.1), (8,),
                    (65, 0.35, 0.0, 0.0, 0.05, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0)):  # fmt: skip
        bench.command(*command)
        bench.run(2 * CYCLE)
    estimate = bench.controller.estimate
    assert bench.arm.tcp[2] == 0.1 and bench.arm.force_scaling == 0.1
    assert estimate.payload.mass == 0.35 and estimate.gravity[1] == -9.0
    assert np.abs(estimate._zero).max() > 5.0
    values = reboot(bench)
    assert values["tcp_offset"] == (0.0,) * 6 and bench.arm.force_scaling == 1.0
    assert values["payload"] == (pytest.approx(1.35),)
    assert values["payload_cog"] == pytest.approx((0.004, -0.006, 0.071))
    assert values["payload_inertia"] == tuple(bench.body.arm.payload.inertia)
    assert values["target_gravity"] == pytest.approx(tuple(-GRAVITY))
    assert values["actual_TCP_force"] == pytest.approx((0.0,) * 6, abs=1e-3)


def test_the_speed_slider_is_at_full_speed_and_moves_keep_to_it(bench):
    bench.controller.inputs.write(
        {"speed_slider_mask": (1,), "speed_slider_fraction": (0.25,)}, bench.now
    )
    assert bench.arm.slider == 0.25
    assert reboot(bench)["speed_scaling"] == (1.0,)
    bench.script()
    bench.command(1, *(bench.arm.q + 0.5), 0.5, 5.0)
    way = np.array(bench.run(0.6))
    assert np.abs(np.diff(way, axis=0)).max() / CYCLE == pytest.approx(0.5, rel=1e-3)


def test_no_program_is_loaded_and_scripts_start(bench):
    assert bench.controller.load("external_control.urp")
    bench.controller.script_denied_until = float("inf")
    reboot(bench)
    assert not bench.controller.loaded and not bench.controller.play()
    bench.script()


def test_a_press_that_was_tolerated_is_not_any_more(bench):
    bench.controller.protective_stop()
    bench.controller.estimate.wrench = np.array([0.0, 0.0, 200.0, 0.0, 0.0, 0.0])
    assert not bench.controller._pressed_too_hard()
    bench.controller.reboot()
    bench.controller.estimate.wrench = np.array([0.0, 0.0, 200.0, 0.0, 0.0, 0.0])
    assert bench.controller._pressed_too_hard()


def test_the_arm_stays_where_it_is(bench):
    bench.command(1, *(bench.arm.q + 0.5), 0.5, 5.0)
    bench.run(0.5)
    q, speed = bench.arm.q.copy(), np.abs(bench.arm.qd).max()
    assert speed > 0.4
    bench.controller.reboot()
    bench.run(1.0)
    assert not bench.arm.moving and 0.0 < np.abs(bench.arm.q - q).max() < 0.03


def test_what_was_denied_held_back_or_counted_is_not(monkeypatch):
    emulator = emulated("ur5", EmulatorOptions("127.0.1.34", noise="off", setting={"box": "off"}))
    kinds = ("refuse_start", "in_use", "freeze", "drop", "burst", "stall")
    for kind in kinds:
        emulator.faults.inject(TimedFault("rtde", kind))
    emulator._outputs.update(1.0, set())
    monkeypatch.setattr(emulator, "_wait", lambda: None)  # no cycle
    with emulator:
        emulator.soon(lambda: emulator.restart(0.0))
    assert all(emulator.faults.now("rtde", kind) is None for kind in kinds)
    emulator._outputs.update(1.0, set())
    assert emulator.controller.values["control_step"] == (1,)
