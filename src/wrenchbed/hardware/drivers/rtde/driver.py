"""Driver of UR robots: states by RTDE, commands through a process that uses ur_rtde."""

import time
import warnings
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, SensorInfo
from wrenchbed.errors import (
    DriverError,
    LateError,
    LinkError,
    ParameterError,
    SafetyStopError,
    StoppedError,
    WrenchbedWarning,
)
from wrenchbed.hardware.device_base import GONE_S, STALE_S, Health, only_here, wait_until
from wrenchbed.hardware.drivers.base import Applied, ArmSample
from wrenchbed.hardware.drivers.live_base import CALM_SPEED, LiveDriver, check_ready
from wrenchbed.hardware.drivers.rtde import identity, own_wrench, ur_health
from wrenchbed.hardware.drivers.rtde.connection import ControlProcess, Links, RtdeOptions
from wrenchbed.hardware.drivers.rtde.identity import Flange
from wrenchbed.hardware.drivers.rtde.states import Snapshot

_LEAST_SPEED, _LEAST_ACCELERATION, _MOST_ACCELERATION = 0.01, 0.05, 15.0
"""Bounds of the speed [rad/s] and acceleration [rad/s²] of a move: ``movej`` refuses 0, and hard
stops brake with the last one."""
_PEAK = 1.5
"""Ratio of peak to mean speed of a trapezoid with ramps of a third of its time, by definition."""
_WINDOW_S, _LAG_S = 0.6, 0.2
"""Length of the compared stream, and greatest delay of the controller, twice its look-ahead [s]."""
_MOVED, _FOLLOWED = 0.02, 0.2
"""Least motion of sent targets that is judged [rad]; fraction of it that must be followed."""
_EVERY = 8
"""Number of targets between two comparisons of sent and followed ones: 64 ms at 125 Hz."""
_MOVE_S, _SOFT_S, _HARD_S, _DASHBOARD_S = 3.0, 0.8, 0.2, 0.5
"""Deadlines of answers [s]: move, after another one came to rest; soft stop, after a stream ended;
hard stop, which waits for nothing; stop by the dashboard."""
_REST_S, _QUIT_S, _ENDED_S = 3.0, 4.0, 1.0
"""Deadlines [s]: robot at rest, process ended, program ended; its own ones are shorter."""
_EVIDENCE = {
    "i": "current", "q_target": "target_q", "qd_target": "target_qd",
    "tau_target": "target_moment", "joint_temperature": "temperatures",
}  # fmt: skip
"""Column that a recording keeps besides joint values → field of a `Snapshot`."""
_FULL, _SLOWEST = 0.99, 0.05
"""Fraction of the speed from which a slider counts as at its end, as in `doctor`, and least
fraction by which the duration of a move is divided: a slower move is given up."""
_MOST_HZ = 500.0
"""States per second of an e-Series; source: Universal Robots, RTDE guide."""


def trapezoid(distance: float, seconds: float, top: float) -> tuple[float, float]:
    """Peak speed [rad/s] and acceleration [rad/s²] of a move over a distance [rad] in a time [s].
    Accelerating and braking take a third of the time each. If that needs a speed above ``top``
    [rad/s] or more than 15 rad/s², the move takes longer."""
    speed = min(_PEAK * distance / seconds, top)
    acceleration = max(3.0 * speed / seconds, _LEAST_ACCELERATION)
    return max(speed, _LEAST_SPEED), min(acceleration, _MOST_ACCELERATION)


class Followed:
    """Checks that the controller follows streamed targets: the library ur_rtde reports success even
    for targets that the controller dropped."""

    def __init__(self) -> None:
        self._pairs: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        self._count = 0

    def add(self, t: float, sent: np.ndarray, target: np.ndarray) -> str:
        """Compare a target (J,) sent at time t [s] with the controller's own target (J,); return an
        error text if the controller does not follow, else ""."""
        pairs = self._pairs
        if pairs and t - pairs[-1][0] > _LAG_S:  # a stream begins anew
            pairs.clear()
        pairs.append((t, sent, target))
        while t - pairs[0][0] > _WINDOW_S:
            pairs.popleft()
        self._count += 1
        if self._count % _EVERY or t - pairs[0][0] < 2.0 * _LAG_S:
            return ""
        moved = np.ptp([s for then, s, _ in pairs if t - then > _LAG_S], axis=0)
        joint = int(np.argmax(moved))
        followed = float(np.ptp([target[joint] for *_, target in pairs]))
        if moved[joint] > _MOVED and followed < _FOLLOWED * moved[joint]:
            return "targets are sent and the controller does not follow them: call recover()"
        return ""


class RtdeDriver(LiveDriver):
    """Driver of a UR robot over RTDE (its data link), with a Net F/T sensor or the robot's own
    wrench. Raises a `ParameterError` for impossible options."""

    name = "rtde"
    title = "a UR robot over ur_rtde, with a Net F/T sensor or its own wrench"
    options = RtdeOptions
    source = "ur_rtde"
    lead = 0.1  # [s]: targets that a busy machine sends this late are still smooth

    def __init__(self, options: RtdeOptions | None = None) -> None:
        options = options or RtdeOptions()
        super().__init__(options.limits)
        self._options = options
        self.top_rate = options.frequency or _MOST_HZ
        self.robot = registry.load("robots", options.robot)
        sensor = own_wrench.OwnWrench(self.robot, lambda t: self._live().since(t))
        self.transducer = own_wrench.transducer(options.sensor, options.host, sensor)
        self._own = self.transducer is sensor
        self._links: Links | None = None
        self._control: ControlProcess | None = None
        self._flange, self._followed = Flange(self.robot), Followed()
        self._halts = 0.0
        self._undelivered = ""
        self._controller: dict[str, Any] = {}

    @property
    def address(self) -> str:
        return "" if only_here(self._options.host) else self._options.host

    @property
    def answers(self) -> Mapping[str, Any]:
        return self._controller

    def metadata(self, mode: str, rate: float) -> Metadata:
        stated = super().metadata(mode, rate)
        if not self._own:
            return stated
        if self._links:  # someone may have set another payload
            self._controller |= identity.settings(self._options.host)
        facts = own_wrench.facts(self._look(), self._controller) if self._links else {}
        sensor = SensorInfo(model="ur-wrench", pose_flange=stated.sensor.pose_flange)
        return replace(stated, sensor=sensor, extra={**stated.extra, "wrench": facts})

    def full_scale(self) -> np.ndarray:
        if not self._own or self._links is None:
            return super().full_scale()
        cb3 = self._look().major <= 3
        return np.repeat(own_wrench.CB3_END if cb3 else own_wrench.E_END, 3)

    def stop(self, kind: str = "soft") -> None:
        """Brake (``kind``: soft or hard) and wait until the robot is at rest. Raises a `LinkError`
        if the stop was not delivered (the robot's watchdog ends its program), a `LateError` if the
        robot does not rest in time."""
        super().stop(kind)
        if self._undelivered:
            raise LinkError(f"the stop was not delivered: {self._undelivered}")
        self._wait_for_rest()

    def _open(self) -> None:
        registry.require("rtde_control", "hil")
        if not self._options.host:
            raise ParameterError("driver 'rtde' needs the robot's address: give its host")
        self._links = Links(self._options)
        self._links.open_state()
        self._flange, state = Flange(self.robot), self._look()
        answers = identity.stated(self._options.host)
        self._controller = answers | identity.settings(self._options.host)
        self._flange.look(state)
        identity.check_model(self.robot, answers, int(state.major), self._flange.at_tcp)

    def _shut(self) -> None:
        self._drop_control(_QUIT_S)
        if self._links is not None:
            self._links.close()
        self._links = None

    def _activate(self) -> None:
        links, options = self._live(), self._options
        wait_until(lambda: self._arm_health().state != "stale", GONE_S)
        if (health := self._arm_health()).state in ("stale", "lost"):
            raise LinkError(health.detail)
        if options.power_on and ur_health.safety(self._look()) in ur_health.HARMLESS:
            ur_health.switch_on(options.host, self._look)
        check_ready(self._arm_health())
        if not wait_until(lambda: int(self._look().runtime) == ur_health.STOPPED, _ENDED_S):
            raise DriverError(
                f"a program is {ur_health.program(self._look())} on the robot, someone else's or "
                "one that a stop left: stop it there, close the other client, or call recover()"
            )
        self._control, self._followed = links.open_control(), Followed()
        self._last_target = None
        wait_until(lambda: int(self._look().runtime) == ur_health.PLAYING, GONE_S)
        self._halts = self._look().halts
        check_ready(self._arm_health())

    def _deactivate(self) -> None:
        self._drop_control(_QUIT_S)

    def _recover(self, unlock: bool) -> None:
        links, options = self._live(), self._options
        self._drop_control(0.0)
        links.renew_state()
        trouble = ur_health.problem(self._look())
        if trouble is not None and not unlock:
            raise SafetyStopError(trouble[1])
        ur_health.clear(options.host, self._look)
        self._wait_for_rest()
        if not self.transducer.health().ok:
            self.transducer.close()
            self.transducer.connect()

    def _read(self) -> ArmSample:
        return self._sample_of(self._look())

    def _states(self, after: float) -> Sequence[ArmSample]:
        return [self._sample_of(state) for state in self._live().since(after)]

    def _sample_of(self, state: Snapshot) -> ArmSample:
        kept = _EVIDENCE if self._options.effort == "current" else {}
        return ArmSample(
            state.t, state.stamp, time.monotonic() - state.t, np.array(state.q),
            np.array(state.qd), np.array(state.target_q), ur_health.mode(state),
            ur_health.safety(state), ur_health.program(state),
            {name: np.array(getattr(state, field)) for name, field in kept.items()},
        )  # fmt: skip

    def _begin(self, goal: np.ndarray, seconds: float) -> None:
        control, self._followed = self._armed(), Followed()
        control.refused = ""
        self._heed_slider(self._look().scaling)
        top = self.limits.speed * min(joint.speed for joint in self.robot.joints)
        distance = float(np.abs(goal - np.array(self._look().q)).max())
        speed, acceleration = trapezoid(distance, seconds, top)
        order = {"q": goal.tolist(), "speed": speed, "acceleration": acceleration}
        try:
            why = control.ask("move", _MOVE_S, **order)
        except LinkError as error:
            control.kill(str(error))
            raise
        if why:
            # the states report some cycles after the program stopped what keeps the robot
            wait_until(lambda: ur_health.problem(self._look()) is not None, STALE_S)
            trouble = ur_health.problem(self._look())
            raise StoppedError(trouble[1] if trouble else f"{why}: call recover()")

    def _heed_slider(self, scaling: float) -> None:
        """Set `pace` from the speed scaling, 0 … 1; warn if the speed slider was moved."""
        before, self.pace = self.pace, max(scaling, _SLOWEST)
        if self.pace < _FULL and abs(self.pace - before) > 1.0 - _FULL:
            warnings.warn(
                f"the speed slider is at {scaling:.0%}: moves take {1.0 / self.pace:.1f} times as "
                "long, and motions fail", WrenchbedWarning, stacklevel=2,
            )  # fmt: skip

    def _stream(self, q: np.ndarray, at: float) -> Applied:
        control = self._armed()
        why = control.gone() or control.refused
        if not why and not control.send("servo", q=q.tolist(), at=at):
            why = "the control process takes no targets"
        if not why:
            why = self._followed.add(time.monotonic(), q, np.array(self._look().target_q))
        return Applied(None, why) if why else Applied(q)

    def _stop(self, kind: str) -> None:
        """Brake, soft or hard, by the control process; if it is silent, by the dashboard server."""
        self._followed, self._last_target = Followed(), None
        self._undelivered = ""
        control = self._control
        if control is None:
            return
        control.refused = ""
        deadline = _HARD_S if kind == "hard" else _SOFT_S
        try:
            self._undelivered = control.ask("stop", deadline, kind=kind)
        except LinkError as error:
            control.kill(str(error))
            self._undelivered = ur_health.halt(self._options.host, _DASHBOARD_S)
        control.refused = ""  # of a target that came before the stop

    def _arm_health(self) -> Health:
        links, control = self._links, self._control
        if links is None:
            return Health("closed", "call connect() first")
        state = links.state
        known = None
        if control is not None:
            silent = links.shared.silence("control")
            known = ur_health.Control(control.gone(), silent, control.program_ended, self._halts)
        counters: dict[str, float] = {"restarts": links.restarts}
        if state is not None:
            counters |= {
                "states": state.received, "skipped": state.skipped, "refused states": state.bad,
                "speed scaling": state.scaling,
            }  # fmt: skip
        health = ur_health.judge(state, links.ended, known, counters)
        if health.ok and state is not None:
            self._flange.look(state)
        if health.ok and self._flange.trouble:
            return Health("fault", self._flange.trouble, health.counters)
        return health

    def _live(self) -> Links:
        if self._links is None:
            raise DriverError("driver 'rtde' is not connected: call connect() first")
        return self._links

    def _armed(self) -> ControlProcess:
        if self._control is None:
            raise DriverError("driver 'rtde' is not active: call activate() first")
        return self._control

    def _look(self) -> Snapshot:
        state = self._live().state
        if state is None:
            raise LinkError("the robot has sent no state: call recover()")
        return state

    def _wait_for_rest(self) -> None:
        def at_rest() -> bool:
            health = self._arm_health()
            if health.state == "lost":
                raise LinkError(health.detail)
            return health.state != "stale" and np.abs(self._look().qd).max() < CALM_SPEED

        if not wait_until(at_rest, _REST_S):
            raise LateError(f"the robot does not rest within {_REST_S:g} s of its stop")

    def _drop_control(self, quit_s: float) -> None:
        """End the control process; within ``quit_s`` [s] it may first stop the robot itself."""
        control, self._control = self._control, None
        if control is not None:
            if quit_s > 0.0 and not control.gone():
                control.quit(quit_s)
            control.kill()


DRIVER = RtdeDriver
