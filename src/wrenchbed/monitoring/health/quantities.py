"""What a check measures: a linear fit of a few numbers to the difference from the first check.

The tangents are those of the library's effects at the load and the bias that the first check shows.
With one tool a span of all channels is the tool's mass; so mass stands for both, and the spans of
fx and fy are those relative to fz. A zero that moves during the check (warm-up) is fitted beside,
with a prior, and is no quantity.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.calibrate import check_mass, identify
from wrenchbed.calibration.compensated import restored
from wrenchbed.calibration.observations import observe
from wrenchbed.calibration.weighting import kernel
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.effects.chain import Response, effects
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import RecordingError
from wrenchbed.monitoring.health.history import Check, digest, digest_of
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import Robot
from wrenchbed.simulation.closed_form import Model

_FITTED = {
    "sensor.bias": tuple(f"bias.{c}" for c in CHANNELS),
    "tool.mass": ("mass",),
    "tool.cog": tuple(f"cog.{a}" for a in "xyz"),
    "base.tilt": ("x", "y"),
    "mount.rotation": tuple(f"rotation.{a}" for a in "xyz"),
    "sensor.gain": ("gain.fx", "gain.fy"),
}
"""Effects and their parameters that are fitted to every check."""
QUANTITIES: Mapping[str, str] = {
    **{f"sensor.bias.{c}": u for c, u in zip(CHANNELS, UNITS, strict=True)},
    "tool.mass": "kg",
    **{f"tool.cog.{a}": "m" for a in "xyz"},
    **{f"base.tilt.{a}": "rad" for a in "xy"},
    **{f"mount.rotation.{a}": "rad" for a in "xyz"},
    "span.fx": "1",
    "span.fy": "1",
}
"""Their names in a history, with units."""
BIASES = slice(0, 6)
_FAR = 0.02
"""Largest distance of a pose from the plan's [rad or m]; estimate."""
ZERO_PER_K, SPAN_PER_K = 1e-4, 2e-4
"""Typical shift of a zero [of full scale, 1/K] and of a span [1/K]: 0.1 % of full scale per
10 K and 0.02 %/K, see `effects.sensor_temperature`."""
UNSEEN_K, SEEN_K = 2.0, 0.5
"""Scatter of the sensor's temperature from check to check that no column shows [K], without
and with a recorded temperature; estimates."""
_SLOW = 3.0
"""Slow 1/f noise from check to check in units of its root density at 1 Hz: √(ln(f_high/f_low)) of a
band from 1 mHz to 10 Hz."""
_LEFT_OF_WARM_UP = 0.05
"""Share of a warm-up that may be missing when a check begins; estimate, three time constants."""
_OTHER = 1.5
"""Scatter of the other numbers from check to check in their measurement noise; estimate."""


def summary(recording: Recording, robot: Robot, plan: Plan, time: datetime) -> Check:
    """A recording as a check without identified numbers.

    Raises:
        RecordingError: another robot, a motion, or other poses than the plan's; names the first.
    """
    found = recording.metadata
    if found.robot != robot.name or found.mode != "static" or not recording.joints:
        raise RecordingError(
            f"{recording.name}: is of {found.robot} ({found.mode}); a check needs {robot.name} at "
            f"rest in the poses of {plan.name}"
        )
    data, poses = observe(restored(recording)), len(plan)
    q = np.asarray(data.q)
    fits = len(q) >= poses and np.abs(q[:poses] - plan.q).max(axis=1) <= _FAR
    if not np.all(fits):
        first = len(q) if len(q) < poses else int(np.argmin(fits))
        raise RecordingError(
            f"{recording.name}: holds {len(q)} poses; pose {first} is not that of {plan.name}: "
            f"record that plan (wrenchbed record --plan {plan.name})"
        )
    warm = recording.columns.get("temperature")
    sensor = found.sensor.model or robot.sensor
    return Check(
        time=time, robot=robot.name, sensor=sensor, robot_digest=digest(robot, sensor),
        recording=recording.name, recording_digest=digest_of(recording.wrench, recording.t),
        temperature=np.nan if warm is None else float(np.mean(warm)), t=data.t[:poses],
        q=q[:poses], wrench=data.wrench[:poses], count=data.count[:poses].astype(float),
        covariance=_spread(data.row_covariance, sensor, robot),
    )  # fmt: skip


def sensor_of(name: str, robot: Robot) -> Any:
    """The `Sensor` of a name; the robot's own where the name is not known."""
    known = name if registry.is_known("sensors", name) else robot.sensor
    return registry.load("sensors", known)


_LEAST_NOISE = 1e-3
"""Least noise of a row in that of the sensor's data: recordings without noise are weighed too."""


def _spread(covariance: np.ndarray, name: str, robot: Robot) -> np.ndarray:
    least = _LEAST_NOISE * sensor_of(name, robot).noise.row_std
    return np.asarray(covariance + np.diag(least**2))


@dataclass(frozen=True, eq=False)
class Reference:
    """The load that a check shows, and what small changes of it make.

    Args:
        robot: whose check it is.
        first: the check.
    """

    robot: Robot
    first: Check

    @cached_property
    def sensor(self) -> Any:
        """The sensor of the check."""
        return sensor_of(self.first.sensor, self.robot)

    @cached_property
    def model(self) -> Model:
        """The robot with its sensor."""
        return Model.of(self.robot)

    @cached_property
    def theta(self) -> np.ndarray:
        """Parameters (P,) that the first check shows.

        Raises:
            CalibrationError: its load cannot be identified.
        """
        first, own = self.first, self.robot.parameters.nominal
        rotation, _ = self.robot.sensor_pose(first.q, own)
        weight = 1.0 / np.diagonal(first.covariance)
        load = identify(rotation, first.wrench, np.asarray(self.model.gravity), weight)
        check_mass(load.mass)
        own = self.robot.theta_of_tool(own, load.mass, [float(c) for c in load.cog])
        theta = self.model.parameters.nominal
        theta[: len(own)] = own
        theta[len(own) : len(own) + 6] = load.bias
        return theta

    @cached_property
    def scene(self) -> Scene:
        """The poses of the first check, in its order."""
        first, n = self.first, len(self.robot.parameters)
        gravity = np.asarray(self.model.gravity)
        held = np.ones(len(first.q), dtype=bool)
        return Scene(self.robot, self.theta[:n], gravity, first.q, first.t, held)

    @cached_property
    def response(self) -> Response:
        """The load of the first check, to ask for tangents."""
        return Response(self.scene, self.scene.load)

    @cached_property
    def tangents(self) -> np.ndarray:
        """Readings (P, 6, K) per unit of each quantity."""
        columns, known = [], effects()
        for name, wanted in _FITTED.items():
            effect, own = known[name], known[name].parameters(self.robot)
            variant = effect.variants(self.scene)[0]
            for parameter in (own[own.index(p)] for p in wanted):
                tangent = self.response.tangent(effect, parameter, variant)
                columns.append(tangent / parameter.tolerance)
        return np.stack(columns, axis=-1)


@lru_cache(maxsize=4)
def _reference(robot: Robot, first: Check) -> Reference:
    """The same for all checks of a stretch: its tangents cost more than all else."""
    return Reference(robot, first)


@dataclass(frozen=True, eq=False)
class Basis:
    """The linear fit of all checks of a history.

    Args:
        robot: whose checks these are.
        checks: the oldest first, at least one.
        begin: the check whose load the tangents are of.
    """

    robot: Robot
    checks: Sequence[Check]
    begin: int = 0

    @property
    def first(self) -> Check:
        """The check of reference."""
        return self.checks[self.begin]

    @property
    def reference(self) -> Reference:
        """What that check shows."""
        return _reference(self.robot, self.first)

    @cached_property
    def spread(self) -> np.ndarray:
        """Covariance (6, 6) of a row: that of the check whose noise is the median."""
        noise = [float(np.trace(c.covariance / self.unit)) for c in self.checks]
        middle = self.checks[int(np.argsort(noise)[len(noise) // 2])]
        return middle.covariance

    @cached_property
    def unit(self) -> np.ndarray:
        """Product (6, 6) of the rows' standard deviations by the sensor's data."""
        std = self.reference.sensor.noise.row_std
        return np.maximum(np.outer(std, std), 1e-300)

    @cached_property
    def rows(self) -> float:
        """Rows of a hold."""
        return float(np.median(self.first.count))

    @cached_property
    def _turn(self) -> np.ndarray:
        """Inverse root (6 P, 6 P) of the covariance of the holds' means: rows and 1/f noise."""
        noise, t = self.reference.sensor.noise, self.first.t
        slow = noise.correlation * np.outer(noise.flicker, noise.flicker)
        alone = np.kron(np.eye(len(t)), self.spread / self.rows)
        return np.linalg.inv(np.linalg.cholesky(alone + np.kron(kernel(t), slow)))

    def whiten(self, difference: np.ndarray) -> np.ndarray:
        """Readings (…, P, 6) as (…, 6 P) of unit variance."""
        return np.asarray(difference.reshape(*difference.shape[:-2], -1) @ self._turn.T)

    @cached_property
    def any_pattern(self) -> np.ndarray:
        """Every reading of every hold by the noise of a row, whitened (6 P, 6 P)."""
        root = np.kron(np.eye(len(self.first.t)), np.linalg.cholesky(self.spread))
        return self._turn @ root

    @cached_property
    def residual(self) -> np.ndarray:
        """Readings of all checks less the model's at their own joint values (n, P, 6)."""
        q = np.concatenate([c.q for c in self.checks])
        predicted = self.reference.model.predict(q, self.reference.theta).reshape(
            len(self.checks), -1, 6
        )
        return np.stack([c.wrench for c in self.checks]) - predicted

    @cached_property
    def warming(self) -> np.ndarray:
        """Readings (P, 6, 6) per unit of each zero that moves evenly through the check."""
        t = self.reference.scene.age / self.reference.scene.span - 0.5
        return t[:, None, None] * np.eye(6)

    @cached_property
    def warm_std(self) -> np.ndarray:
        """Prior standard deviation (6,) of what zeros move during a check [N, N·m]."""
        noise = self.reference.sensor.noise
        return np.hypot(_SLOW * noise.flicker, _LEFT_OF_WARM_UP * np.abs(noise.warmup_drift))

    @cached_property
    def _fit(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Whitened columns (6 P, K + 6), their pseudo-inverse (K + 6, 6 P), covariance (K, K)."""
        both = np.concatenate([self.reference.tangents, self.warming], axis=-1)
        white = self.whiten(np.moveaxis(both, -1, 0)).T
        k = self.reference.tangents.shape[-1]
        prior = np.zeros(k + 6)
        prior[k:] = 1.0 / np.maximum(self.warm_std, 1e-12) ** 2
        inverse = np.linalg.inv(white.T @ white + np.diag(prior))
        return white, inverse @ white.T, inverse[:k, :k]

    @property
    def covariance(self) -> np.ndarray:
        """Of the values of one check by the noise within it (K, K)."""
        return self._fit[2]

    @cached_property
    def changes(self) -> np.ndarray:
        """Values of all checks less those of the model (n, K)."""
        return self.whiten(self.residual) @ self._fit[1].T[:, : self.reference.tangents.shape[-1]]

    @cached_property
    def values(self) -> np.ndarray:
        """Values of all checks (n, K)."""
        return self.changes + self.origin

    @cached_property
    def origin(self) -> np.ndarray:
        """The model's values (K,); spans, tilt and mount count from nominal."""
        n = len(self.robot.parameters)
        tool = self.robot.tool(self.reference.theta[:n])
        load = [float(tool.mass), *(float(c) for c in tool.cog)]
        return np.concatenate([self.reference.theta[n : n + 6], load, np.zeros(7)])

    @cached_property
    def left(self) -> np.ndarray:
        """What the fit leaves of all checks, whitened (n, 6 P)."""
        white, solve, _ = self._fit
        found = self.whiten(self.residual)
        return np.asarray(found - found @ solve.T @ white.T)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of what is left of one check."""
        return self.left.shape[1] - self._fit[0].shape[1]

    @property
    def misfit(self) -> np.ndarray:
        """What is left of each check in units of a row's noise, squared, mean (n,): a gap."""
        rows = np.linalg.solve(self.any_pattern, self.left.T)
        return np.asarray((rows**2).mean(axis=0))

    @cached_property
    def per_kelvin(self) -> np.ndarray:
        """Typical change of each quantity (K,) by the sensor's temperature [1/K]."""
        full = self.reference.sensor.calibration().range
        mass = SPAN_PER_K * self.origin[6]
        return np.concatenate([ZERO_PER_K * full, [mass], np.zeros(8), [SPAN_PER_K] * 2])

    def scatter(self, warm: bool) -> np.ndarray:
        """Expected standard deviation of each quantity (K,) from check to check.

        Args:
            warm: whether the temperature is recorded.
        """
        noise, own = self.reference.sensor.noise, np.sqrt(np.diagonal(self.covariance))
        slow = np.hypot(_SLOW * noise.flicker, _LEFT_OF_WARM_UP * np.abs(noise.warmup_drift))
        other = _OTHER * own
        other[BIASES] = np.hypot(own[BIASES], slow)
        return np.hypot(other, self.per_kelvin * (SEEN_K if warm else UNSEEN_K))

    def identified(self, k: int) -> tuple[dict[str, float], np.ndarray]:
        """Values of check k with ``.std``, and ``misfit``; their covariance (K, K)."""
        told: dict[str, float] = {}
        std = np.sqrt(np.diagonal(self.covariance))
        for name, value, s in zip(QUANTITIES, self.values[k], std, strict=True):
            told |= {name: float(value), f"{name}.std": float(s)}
        return told | {"misfit": float(self.misfit[k])}, self.covariance
