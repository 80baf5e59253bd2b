"""MedRUE by CiA 402 drives on CAN, with its sensor's board on the same bus.

Python's threads share one lock: another thread that computes without pause delays the cycles by up
to its switch interval (5 ms) each time. Late cycles are counted; the drives stop by themselves
when targets stay away for longer than the watchdog that `Options` names.
"""

import time
from collections.abc import Callable

import numpy as np

from wrenchbed import registry
from wrenchbed.drivers.base import Applied, ArmSample
from wrenchbed.drivers.base.live import LiveDriver
from wrenchbed.drivers.can.cia402 import State, Want
from wrenchbed.drivers.can.cycle import Cycle
from wrenchbed.drivers.can.drive import Drive
from wrenchbed.drivers.can.following import Following
from wrenchbed.drivers.can.network import Drives
from wrenchbed.drivers.can.options import Options
from wrenchbed.drivers.can.setpoints import BRAKE_S, Setpoints
from wrenchbed.errors import DriverError, LinkError
from wrenchbed.health import STALE_S, Health, by_age
from wrenchbed.robots.base import Robot
from wrenchbed.transducers.netcanoem import NetcanoemTransducer
from wrenchbed.transducers.netcanoem import Options as SensorOptions
from wrenchbed.transducers.netcanoem.link import Link, open_bus

FIRST_S, ENABLED_S, CLEARED_S, STILL_S = 2.0, 2.0, 1.0, 0.5
"""Deadlines: first state, all drives enabled, faults cleared, at rest [s]."""
_TICK_S = 0.002


class CanDriver(LiveDriver):
    """MedRUE on a CAN bus.

    Args:
        options: where and what it is; refuses ids that collide and rates that the bus cannot carry.
    """

    name = "can"
    title = "MedRUE: CiA 402 drives and ATI NETCANOEM on one CAN bus"
    source = "can"
    options = Options

    def __init__(self, options: Options | None = None) -> None:
        self.setting = s = options or Options()
        super().__init__(s.limits)
        self.robot: Robot = registry.load("robots", s.robot)
        self.transducer: NetcanoemTransducer = NetcanoemTransducer(
            SensorOptions(s.interface, s.channel, s.host, s.port, s.bitrate, s.base, s.slot, s.rate)
        )
        self._counts = np.array(s.counts_per_unit)
        self._link: Link | None = None
        self._network: Drives | None = None
        self._cycle: Cycle | None = None
        self._rated: np.ndarray | None = None
        self._seen = 0

    def _open(self) -> None:
        s = self.setting
        self._link = link = open_bus(s.interface, s.channel, s.host, s.port, s.bitrate)
        self._network = network = Drives(link, s)
        network.configure(s.nodes)
        self._setpoints = self._make_setpoints(network)
        if s.torque:
            self._rated = np.array([network.rated_torque(node) for node in s.nodes])
        self.transducer.use(link)
        drives = [Drive(node, hint=network.error_code(node)) for node in s.nodes]
        follow = Following(np.array([joint.speed for joint in self.robot.joints]))
        self._cycle = cycle = Cycle(
            link, drives, self._counts, self._setpoints, self.transducer.poll, follow, 1.0 / s.rate
        )
        cycle.start()
        self._seen = 0
        if not self._until(lambda: cycle.told is not None, FIRST_S):
            silent = [d.node for d in cycle.drives if not d.answers]
            raise LinkError(f"drives {silent} do not answer SYNC: are their PDOs switched on?")

    def _make_setpoints(self, network: Drives) -> Setpoints:
        joints = self.robot.joints
        lower = np.array([j.lower for j in joints])
        upper = np.array([j.upper for j in joints])
        for k, node in enumerate(self.setting.nodes):
            own = network.limits(node)
            if own is not None:
                ends = sorted(count / self._counts[k] for count in own)
                lower[k], upper[k] = max(lower[k], ends[0]), min(upper[k], ends[1])
        speed = np.array([j.speed for j in joints])
        return Setpoints(1.0 / self.setting.rate, lower, upper, speed)

    def _shut(self) -> None:
        if self._cycle is not None:
            self._cycle.stop()
        if self._network is not None:
            self._network.close()
        if self._link is not None:
            self._link.close()
        self._cycle = self._network = self._link = None

    def _activate(self) -> None:
        cycle = self._running()
        health = self._arm_health()
        if not health.ok:
            raise DriverError(f"cannot enable the drives: {health.detail}")
        cycle.want = Want.ENABLE
        if not self._until(lambda: cycle.following or cycle.latched is not None, ENABLED_S):
            late = [d for d in cycle.drives if d.state is not State.ENABLED]
            cycle.want = Want.DISABLE
            words = ", ".join(f"drive {d.node} is in state {d.state.value}" for d in late)
            raise DriverError(f"not enabled within {ENABLED_S:g} s: {words}; call recover()")
        if cycle.latched is not None:
            raise DriverError(f"cannot enable the drives: {cycle.latched[1]}")

    def _deactivate(self) -> None:
        cycle = self._cycle
        if cycle is None:
            return
        self._setpoints.brake()
        self._until(lambda: not self._setpoints.moving, STILL_S)
        self._until(lambda: cycle.told is None or np.abs(cycle.told.qd).max() < 0.02, STILL_S)
        cycle.want = Want.DISABLE
        self._until(lambda: not any(d.state is State.ENABLED for d in cycle.drives), STILL_S)
        cycle.want = Want.NOTHING

    def _recover(self) -> None:
        if self._link is None or self._link.dead:
            self._reopen()
        cycle, network = self._running(), self._network
        assert network is not None
        forgot = [d for d in cycle.drives if d.rebooted or d.nmt != 0x05 or d.missed]
        cycle.want = Want.RESET
        network.configure([drive.node for drive in forgot])
        for drive in forgot:
            drive.rebooted, drive.nmt = False, 0x05
        cycle.clear()
        stuck = (State.FAULT, State.REACTING, State.QUICK_STOP)
        cleared = self._until(
            lambda: (
                self._age() < STALE_S and not any(d.state in stuck or d.error for d in cycle.drives)
            ),
            CLEARED_S,
        )
        cycle.want = Want.NOTHING
        cycle.clear()
        if not cleared:
            bad = next((d for d in cycle.drives if d.state in stuck), None)
            if bad is None:
                raise LinkError(f"the drives tell nothing new for {self._age():.2f} s")
            raise DriverError(
                f"drive {bad.node} stays in state {bad.state.value}: remove the cause, or switch "
                "its power off and on"
            )
        self._last_target = None

    def _reopen(self) -> None:
        """Open a bus that is gone once more; the drives have stopped by their watchdogs."""
        self.transducer.close()
        self._shut()
        self._open()
        self.transducer.connect()
        self._last_target = None

    def _begin(self, goal: np.ndarray, seconds: float) -> None:
        self._setpoints.move(goal, seconds)

    def _stream(self, q: np.ndarray) -> Applied:
        self._setpoints.stream(q, time.monotonic())
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
        told = cycle.told
        if told is None:
            raise LinkError("the drives have sent no state yet")
        before, self._seen = self._seen, told.sequence
        faults = tuple(t[1] for d in cycle.drives if (t := d.trouble(enabled=False)))
        effort = None if self._rated is None else told.torque * 1e-3 * self._rated
        return ArmSample(
            t=told.t, device_time=None, sequence=told.sequence, age=time.monotonic() - told.t,
            fresh=told.sequence != before, q=told.q.copy(), qd=told.qd.copy(), effort=effort,
            target_q=(self._setpoints.command if cycle.following else told.q).copy(),
            mode=self._mode(cycle),
            safety="quick stop" if cycle.want is Want.QUICK_STOP else "normal", faults=faults,
        )  # fmt: skip

    def _mode(self, cycle: Cycle) -> str:
        states = {drive.state for drive in cycle.drives}
        if states & {State.FAULT, State.REACTING}:
            return "fault"
        if any(drive.nmt != 0x05 for drive in cycle.drives):
            return "off"
        return "running" if states == {State.ENABLED} else "idle"

    def _arm_health(self) -> Health:
        cycle, link = self._cycle, self._link
        if cycle is None or link is None:
            return Health("closed", "the bus is not open")
        counters = self._counters(cycle, link)
        if link.dead:
            return Health("lost", f"CAN bus: {link.dead}", counters)
        if cycle.latched is not None:
            state, why = cycle.latched
            return Health(state, why, counters)
        return by_age(self._age(), "drives", counters)

    def _age(self) -> float:
        """Of the drives' newest answers [s]."""
        told = None if self._cycle is None else self._cycle.told
        return np.inf if told is None else time.monotonic() - told.t

    def _counters(self, cycle: Cycle, link: Link) -> dict[str, float]:
        return {
            "cycles": float(cycle.cycles), "incomplete": float(cycle.incomplete),
            "overruns": float(cycle.overruns), "clipped": float(self._setpoints.clipped),
            "error frames": float(link.error_frames), "odd frames": float(link.failures),
            "bus_load": self.setting.bus_load.share,
        }  # fmt: skip

    def _running(self) -> Cycle:
        if self._cycle is None:
            raise DriverError("the CAN bus is not open: call connect() first")
        return self._cycle

    def _until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Wait until something is so; False at the deadline [s] or where the bus is gone."""
        end = time.monotonic() + seconds
        while not done():
            if time.monotonic() > end or (self._link is not None and self._link.dead):
                return False
            time.sleep(_TICK_S)
        return True
