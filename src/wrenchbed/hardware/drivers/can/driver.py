"""Driver of MedRUE: CiA 402 drives on CAN, with its sensor's board on the same bus. Python's
threads share one lock: another thread that computes without pause delays each cycle by up to its
switch interval (5 ms). Late cycles are counted; drives stop by themselves when no targets arrive
for longer than the option ``watchdog``."""

import time
from collections.abc import Callable

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import DriverError, LinkError, SafetyStopError
from wrenchbed.hardware.device_base import GONE_S, STALE_S, Health, by_age, only_here, wait_until
from wrenchbed.hardware.drivers.base import Applied, ArmSample
from wrenchbed.hardware.drivers.can.ati_gauge_board import GaugeBoard
from wrenchbed.hardware.drivers.can.bus import CanLink, open_bus
from wrenchbed.hardware.drivers.can.cia402 import (
    IN_FAULT,
    OPERATIONAL,
    DriveState,
    DriveStatus,
    Want,
)
from wrenchbed.hardware.drivers.can.cycle import Cycle, Following, Rest
from wrenchbed.hardware.drivers.can.drive_configuration import TRIES, Drives
from wrenchbed.hardware.drivers.can.options import CanOptions, master
from wrenchbed.hardware.drivers.can.setpoints import BRAKE_S, Setpoints
from wrenchbed.hardware.drivers.live_base import LiveDriver
from wrenchbed.robots.base import Robot

FIRST_S, ENABLED_S, CLEARED_S, STILL_S = 1.0, 2.0, 1.0, 0.5
"""Deadlines [s]: first state after a start; all drives enabled, which climb three states and may
release brakes; faults cleared; at rest, as long as a quick stop takes (`cycle.REST_S`)."""
_POLL_S = 0.002
"""Time between two checks while waiting for drives [s], half a cycle of 250 Hz."""
_STUCK = (*IN_FAULT, DriveStatus.QUICK_STOP, DriveStatus.ENABLED)
"""CiA 402 states in which no recovered drive may be."""


class CanDriver(LiveDriver):
    """Driver of the robot MedRUE: CiA 402 servo drives and a sensor board on one CAN bus."""

    name = "can"
    title = "MedRUE: CiA 402 drives and ATI NETCANOEM on one CAN bus"
    source = "can"
    options = CanOptions
    lead = 0.1  # [s]: targets that a busy machine sends this late are still smooth

    def __init__(self, options: CanOptions | None = None) -> None:
        self.setting = s = options or CanOptions()
        super().__init__(s.limits)
        self.robot: Robot = registry.load("robots", s.robot)
        self.transducer: GaugeBoard = GaugeBoard(s.base, s.slot)
        self._counts, self.top_rate = np.array(s.counts_per_unit), s.rate
        self._top = np.array([joint.speed for joint in self.robot.joints])
        self._rest = Rest(self._top, self._counts, 1.0 / s.rate, s.watchdog)
        self._link: CanLink | None = None
        self._network: Drives | None = None
        self._cycle: Cycle | None = None
        self._rated: np.ndarray | None = None

    @property
    def address(self) -> str:
        s = self.setting
        if s.interface == "virtual" or (s.host and only_here(s.host)):
            return ""
        return f"{s.channel} of {s.host}" if s.host else s.channel

    def _open(self) -> None:
        s = self.setting
        self._link = link = open_bus(s.interface, s.channel, s.host, s.port, s.bitrate)
        self._network = network = Drives(link, s)
        network.configure(s.nodes)
        lower, upper = np.transpose([(j.lower, j.upper) for j in self.robot.joints])
        for k, node in enumerate(s.nodes):
            if (in_drive := network.limits(node)) is not None:
                ends = sorted(count / self._counts[k] for count in in_drive)
                lower[k], upper[k] = max(lower[k], ends[0]), min(upper[k], ends[1])
        self._setpoints = Setpoints(1.0 / s.rate, lower, upper, self._top)
        if s.torque:
            self._rated = np.array([network.rated(node) for node in s.nodes])
        self.transducer.use(link)
        drives = [DriveState(node, hint=network.error_code(node)) for node in s.nodes]
        self._cycle = cycle = Cycle(
            link, drives, self._counts, self._setpoints, self.transducer.poll,
            Following(self._top), 1.0 / s.rate, master(s.base, s.nodes),
        )  # fmt: skip
        cycle.start()
        if self._until(lambda: cycle.answers is not None, FIRST_S):
            return
        for _ in range(TRIES):
            silent = [d for d in cycle.drives if not d.answers]
            network.start([d.node for d in silent])
            for drive in silent:  # an old heartbeat may still arrive: wait for a new one
                drive.nmt = 0x00
            if self._until(lambda: cycle.answers is not None and cycle.operational, FIRST_S):
                return cycle.clear()
        nodes = [d.node for d in silent]
        raise LinkError(f"drives {nodes} do not answer SYNC: are their PDOs switched on?")

    def _shut(self) -> None:
        if self._network is not None:
            if self._age() < STALE_S:
                self._network.release()
            self._network.close()
        if self._cycle is not None:
            self._cycle.stop()
        if self._link is not None:
            self._link.close()
        self._cycle = self._network = self._link = None

    def _activate(self) -> None:
        cycle = self._running()
        self._until(lambda: self._health().state != "stale", ENABLED_S)  # this program was busy
        health = self._arm_health()
        if not health.ok:
            raise DriverError(f"cannot enable the drives: {health.detail}")
        self._check_start()
        cycle.want = Want.ENABLE
        if not self._until(lambda: cycle.following or cycle.latched is not None, ENABLED_S):
            late = [d for d in cycle.drives if d.state is not DriveStatus.ENABLED]
            cycle.want = Want.DISABLE
            words = ", ".join(f"drive {d.node} is in state {d.state.value}" for d in late)
            raise DriverError(f"not enabled within {ENABLED_S:g} s: {words}; call recover()")
        if cycle.latched is not None:
            raise DriverError(f"cannot enable the drives: {cycle.latched[1]}")

    def _check_start(self) -> None:
        """Raise `DriverError` for drives that move, lack a watchdog or report impossible places."""
        cycle, network, q = self._running(), self._network, self._read().q
        if not self._at_rest(cycle, self._rest.longest):
            raise DriverError("cannot enable the drives: the robot moves; call recover()")
        for why in () if network is None else network.unguarded.values():
            raise DriverError(f"{why}: without a deadline for targets it would not stop by itself")
        beyond = self._setpoints.outside(q)
        if beyond is not None:
            j, lower, upper = beyond
            joint, node = self.robot.joints[j], self.setting.nodes[j]
            raise DriverError(
                f"{joint.name} (drive {node}) reports {q[j]:.4g} {joint.unit}, outside its limits "
                f"{lower:.4g} … {upper:.4g}: home the drives, or check counts_per_unit"
            )

    def _deactivate(self) -> None:
        cycle = self._cycle
        if cycle is None:
            return
        self._setpoints.brake()
        self._until(lambda: not self._setpoints.moving, STILL_S)
        if not self._at_rest(cycle, STILL_S):
            cycle.want = Want.QUICK_STOP
            if not self._at_rest(cycle, 2.0 * self._rest.longest):
                return  # it still brakes, with voltage
        cycle.want = Want.DISABLE
        powered = (DriveStatus.ENABLED, DriveStatus.QUICK_STOP, DriveStatus.SWITCHED_ON)
        self._until(lambda: not any(d.state in powered for d in cycle.drives), STILL_S)
        cycle.want = Want.NOTHING

    def _recover(self, unlock: bool) -> None:
        cycle, link = self._cycle, self._link
        alive = cycle is not None and cycle.alive and link is not None and not link.dead
        if not alive or self._age() > GONE_S:
            self._reopen()
        self._come_to_rest()
        cycle, network = self._running(), self._network
        for drive in () if unlock else cycle.drives:
            trouble = drive.trouble(enabled=False)
            if trouble is not None and trouble[0] == "fault":
                raise SafetyStopError(trouble[1])
        self.transducer.connect()
        assert network is not None
        restarted = [d for d in cycle.drives if d.rebooted or d.nmt != OPERATIONAL or d.missed]
        cycle.want = Want.RESET
        network.configure([drive.node for drive in restarted])
        for drive in restarted:  # an old heartbeat may still arrive: wait for a new one
            drive.rebooted, drive.nmt = False, 0x00
        cycle.clear()

        def cleared() -> bool:
            fresh = self._age() < STALE_S and all(d.nmt == OPERATIONAL for d in restarted)
            return fresh and not any(d.state in _STUCK or d.error for d in cycle.drives)

        done = self._until(cleared, CLEARED_S)
        cycle.want = Want.NOTHING
        cycle.clear()
        if not done:
            bad = next((d for d in cycle.drives if d.state in _STUCK), None)
            if bad is None:
                raise LinkError(f"the drives send nothing new for {self._age():.2f} s")
            raise DriverError(
                f"drive {bad.node} stays in state {bad.state.value}: remove the cause, or switch "
                "its power off and on"
            )
        self._last_target = None

    def _reopen(self) -> None:
        """Open the lost CAN bus again, after the drives' watchdogs have stopped them."""
        began = 0.0 if self._cycle is None else self._cycle.began
        try:
            self._close()
            time.sleep(max(0.0, began + self._rest.longest - time.monotonic()))
            self._open()
        except BaseException:
            self._shut()
            raise
        self._last_target = None

    def _come_to_rest(self) -> None:
        """Brake all axes and wait until they are at rest, before their power is switched off."""
        cycle, longest = self._running(), 2.0 * self._rest.longest
        cycle.halt("stopped", "recover() stops the robot first")
        if not cycle.all_in(DriveStatus.DISABLED):
            cycle.want = Want.QUICK_STOP
        if self._at_rest(cycle, longest):
            return
        if self._link is None or self._link.dead:
            raise LinkError("the CAN bus is gone: call recover() again")
        for drive, moves in zip(cycle.drives, self._rest.moving(cycle.answers), strict=True):
            if moves and drive.state in _STUCK and drive.state is not DriveStatus.FAULT:
                raise SafetyStopError(
                    f"drive {drive.node} still moves {longest:.1f} s after a quick stop: press "
                    "the emergency stop"
                )

    def _begin(self, goal: np.ndarray, seconds: float) -> None:
        self._setpoints.move(goal, seconds)

    def _stream(self, q: np.ndarray, at: float) -> Applied:
        now = time.monotonic()
        self._setpoints.follow(q, at if at > now else now + self.lead, now)
        return Applied(q)

    def _stop(self, kind: str) -> None:
        if self._cycle is None:
            return
        self._last_target = None
        if kind == "hard":
            self._cycle.halt("stopped", "a quick stop was asked for: call recover()")
        else:
            self._setpoints.brake()
            if self._cycle.want is Want.ENABLE:
                self._until(lambda: not self._setpoints.moving, 2.0 * BRAKE_S)

    def _read(self) -> ArmSample:
        cycle = self._running()
        answers = cycle.answers
        if answers is None:
            raise LinkError("the drives have sent no state yet")
        column = "tau" if self.setting.effort == "torque" else "i"  # [N·m or N], [A]
        efforts = {} if self._rated is None else {column: answers.torque * 1e-3 * self._rated}
        return ArmSample(
            answers.t, None, time.monotonic() - answers.t, answers.q.copy(), answers.qd.copy(),
            (self._setpoints.command if cycle.following else answers.q).copy(), self._mode(cycle),
            "quick stop" if cycle.want is Want.QUICK_STOP else "normal", extra_columns=efforts,
        )  # fmt: skip

    def _mode(self, cycle: Cycle) -> str:
        states = {drive.state for drive in cycle.drives}
        if states & {*IN_FAULT}:
            return "fault"
        if not cycle.operational:
            return "off"
        return "running" if states == {DriveStatus.ENABLED} else "idle"

    def _arm_health(self) -> Health:
        cycle, link = self._cycle, self._link
        if cycle is None or link is None:
            return Health("lost", "the CAN bus is not open: call recover()")
        counters = {
            "cycles": float(cycle.cycles), "incomplete": float(cycle.incomplete),
            "overruns": float(cycle.overruns), "clipped": float(self._setpoints.clipped),
            "error frames": float(link.error_frames), "odd frames": float(link.failures),
            "queue full": float(link.full), "bus_load": self.setting.bus_load,
        } | (self._network.counters if self._network else {})  # fmt: skip
        if link.dead:
            return Health("lost", f"CAN bus: {link.dead}", counters)
        if cycle.latched is not None:
            return Health(*cycle.latched, counters)
        return by_age(self._age(), "drives", counters)

    def _age(self) -> float:
        """Time since the drives' newest answers [s]; infinite before the first."""
        answers = None if self._cycle is None else self._cycle.answers
        return np.inf if answers is None else time.monotonic() - answers.t

    def _running(self) -> Cycle:
        if self._cycle is None:
            raise LinkError("the CAN bus is not open: call recover()")
        return self._cycle

    def _at_rest(self, cycle: Cycle, seconds: float) -> bool:
        return self._until(lambda: self._rest.reached(cycle.answers), seconds)

    def _until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Wait until ``done`` holds and return True; False after ``seconds`` or without a bus."""

        def gone() -> bool:
            return self._link is not None and bool(self._link.dead)

        return wait_until(lambda: done() or gone(), seconds, _POLL_S) and (not gone() or done())
