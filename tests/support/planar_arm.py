"""A planar arm with any number of joints, its driver and its sensor: the smallest that obey."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.errors import DriverError
from wrenchbed.hardware.device import Health
from wrenchbed.hardware.drivers.base import Applied, ArmSample, Driver, Move, Reached, as_designed
from wrenchbed.hardware.transducers.base import Transducer, WrenchSample
from wrenchbed.physics.parameters import ParameterSet
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import Joint, LoadInSensorAxes, load_parameters, tool_parameters
from wrenchbed.robots.motion_limits import Limits


class PlanarArm(LoadInSensorAxes):
    """Links of 0.1 m in the plane x z."""

    title, sensor = "a planar arm", "ati-gamma"
    free = candidates = ("tool.mass",)
    parameters = ParameterSet(tool_parameters(1.0, (0.0, 0.0, 0.1))) + load_parameters((0.0,) * 6)

    def __init__(self, joints: int) -> None:
        self.name = f"planar-{joints}"
        self.joints = tuple(Joint(f"q{j + 1}", "rad", -3.0, 3.0, 1.0) for j in range(joints))

    def sensor_pose(self, q: Any, theta: np.ndarray) -> tuple[Any, Any]:
        angles = np.cumsum(q, axis=-1)
        c, s = np.cos(angles), np.sin(angles)
        zero, one = np.zeros(len(q)), np.ones(len(q))
        rows = [[c[:, -1], zero, s[:, -1]], [zero, one, zero], [-s[:, -1], zero, c[:, -1]]]
        rotation = np.moveaxis(np.array(rows), -1, 0)
        return rotation, 0.1 * np.stack([c.sum(axis=-1), zero, s.sum(axis=-1)], axis=-1)

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return self._outside_limits(q)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return rng.uniform(-2.0, 2.0, (n, len(self.joints)))


@dataclass(frozen=True)
class Options:
    joints: int = 5
    limits: Limits | None = None


class PlanarMove(Move):
    """Twenty steps to the goal."""

    def __init__(self, driver: "PlanarDriver", start: np.ndarray, goal: np.ndarray) -> None:
        super().__init__(goal)
        self.driver, self.start, self.step = driver, start, 0

    def _advance(self) -> Reached | None:
        self.step += 1
        self.driver.q = self.start + self.step / 50 * (self.goal - self.start)
        self.driver.time += 0.02
        return Reached(self.driver.q, 1.0) if self.step == 50 else None

    def wait(self, timeout: float | None = None) -> Reached:
        while (end := self.poll()) is None:
            pass
        return end


class PlanarDriver(Driver):
    """Goes where it is sent, in its own time."""

    name, title, options = "planar", "a planar arm", Options

    def __init__(self, options: Options | None = None) -> None:
        options = options or Options()
        super().__init__(options.limits)
        self.robot = PlanarArm(options.joints)
        self.q, self.time, self.count = np.zeros(options.joints), 0.0, 0

    def metadata(self, mode, rate):
        return as_designed(
            self.robot, source="sim", mode=mode, rate=rate, gravity=self.robot.gravity,
            sensor="ati-gamma", noise_std=registry.load("sensors", "ati-gamma").noise.row_std,
        )  # fmt: skip

    def _connect(self) -> None: ...
    def _close(self) -> None: ...
    def _stop(self, kind: str) -> None: ...

    def _health(self) -> Health:
        return Health("ok")

    def _position(self) -> np.ndarray:
        return np.array(self.q)

    def _read(self) -> ArmSample:
        self.count += 1
        return ArmSample(self.time, None, 0.0, self.q, 0.0 * self.q)

    def _read_wrench(self) -> WrenchSample:
        return WrenchSample(self.time, None, self.count, 0.0, True, np.zeros(6))

    def _write(self, q: np.ndarray) -> Applied:
        if why := self.limits.check_step(self.robot, self.q, q, 0.008):
            return Applied(None, why)
        self.q = q
        return Applied(q)

    def _move(self, start: np.ndarray, goal: np.ndarray, seconds: float) -> Move:
        return PlanarMove(self, start, goal)

    def _rows(self, q: np.ndarray, rate: float):
        t = self.time + np.arange(len(q)) / rate
        self.time, self.q = float(t[-1]) + 1.0 / rate, np.array(q[-1])
        columns = {f"q{j + 1}": q[:, j] for j in range(q.shape[1])}
        columns |= {c: np.zeros(len(q)) for c in CHANNELS}
        return {"t": t} | columns | {"status": np.zeros(len(q), np.uint32)}

    def _sample(self, n: int, rate: float):
        return self._rows(np.repeat(self.q[None], n, axis=0), rate)

    def _track(self, targets: np.ndarray, rate: float):
        extra = {f"{n}{j + 1}": targets[:, j] for n in ("qd", "q_target")
                 for j in range(targets.shape[1])}  # fmt: skip
        yield self._rows(targets, rate) | extra


class PlanarSensor(Transducer):
    """Counts its readings."""

    name, title, options = "planar", "a quiet sensor", Options

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def _connect(self) -> None: ...
    def _close(self) -> None: ...

    def _read(self) -> WrenchSample:
        self.count += 1
        sample = WrenchSample(time.monotonic(), None, self.count, 0.0, True, np.zeros(6))
        self._past.add(sample.t, sample.wrench)
        return sample

    def _health(self) -> Health:
        return Health("ok", "", {"readings": float(self.count)})


def only_raises(base: type) -> type:
    """A device whose every method raises."""

    def fail(self: Any, *_: Any, **__: Any) -> Any:
        raise DriverError("not implemented")

    kept = ("__", "_check", "_abc")
    hooks = {
        name: fail
        for name in dir(base)
        if name.startswith("_") and not name.startswith(kept) and callable(getattr(base, name))
    }
    hooks |= {"metadata": fail} if hasattr(base, "metadata") else {}
    return type(f"Raising{base.__name__}", (base,), hooks)
