"""Numbers of each check, and steps in them against the scatter from check to check.

The numbers are a linear fit to the difference from the first check of a history, by derivatives of
the library's effects at the load and the zero of that check. With one tool an equal span (gain) of
all channels is like the tool's mass; so mass stands for both, and the spans of fx and fy are those
relative to fz. A zero that moves during a check (warm-up) is fitted beside, with a prior.

Each number is a + b·[from check k on] + n(t) + w(t) + ε. The nuisance n follows the recorded
temperature, else a wave of a year (the season of a temperature that nobody recorded), with
coefficients of a Gaussian prior. w is a slow walk, since zeros drift for months. The scatter of ε
is learnt: an inverse gamma prior from the sensor's data, worth `_PRIOR` checks, and all checks of
the history. So b over its standard error has a Student's t distribution (Gelman et al., Bayesian
Data Analysis, 3rd ed., 14.2). The fit's residual is tested likewise, by an F distribution.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from wrenchbed import registry
from wrenchbed.calibration.calibrate import check_mass, identify_from_gravity
from wrenchbed.calibration.weighting import kernel
from wrenchbed.channels.readings_with_effects import Response
from wrenchbed.channels.wrench import CHANNEL as WRENCH
from wrenchbed.effects.chain import effects
from wrenchbed.effects.scene import Scene
from wrenchbed.monitoring.history import Check
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import Robot
from wrenchbed.sensors.base import Sensor
from wrenchbed.simulation.closed_form import Model

FITTED: Mapping[str, tuple[str, str, str]] = {
    **{
        f"sensor.bias.{c}": ("sensor.bias", f"bias.{c}", unit)
        for c, unit in zip(CHANNELS, UNITS, strict=True)
    },
    "tool.mass": ("tool.mass", "mass", "kg"),
    **{f"tool.cog.{a}": ("tool.cog", f"cog.{a}", "m") for a in "xyz"},
    **{f"base.tilt.{a}": ("base.tilt", a, "rad") for a in "xy"},
    **{f"mount.rotation.{a}": ("mount.rotation", f"rotation.{a}", "rad") for a in "xyz"},
    **{f"span.{c}": ("sensor.gain", f"gain.{c}", "1") for c in ("fx", "fy")},
}
"""Name of each number that is fitted to a check, as `compare` shows it → effect, its parameter that
gives the change of readings, unit of the number."""
YEAR_S = 365.25 * 86400.0
"""Length of a year [s]."""
_ZERO_PER_K, _SPAN_PER_K = 1e-4, 2e-4
"""Typical shift of a zero [share of full scale per K] and of a gain [1/K] with temperature: 0.1 %
of full scale per 10 K and 0.02 %/K, see `effects.sensor_temperature`."""
_UNSEEN_K, _SEEN_K, _SEASON_K = 2.0, 0.5, 5.0
"""Scatter of the sensor's temperature from check to check beyond what is modelled [K], without and
with a recorded temperature, and amplitude of a year's wave of a temperature that nobody recorded.
Larger values hide shifts of the zero in the first checks; smaller ones raise false alarms there."""
_SLOW = 3.0
"""Std of slow 1/f noise from check to check, over its root density at 1 Hz: √(ln(f_high/f_low)) of
a band from 1 mHz to 10 Hz."""
_LEFT_OF_WARM_UP = 0.05
"""Fraction of a warm-up drift that remains after three time constants, exp(−3)."""
_OTHER = 1.5
"""Prior scatter of numbers other than zeros from check to check, over their noise within a check;
joints that repeat within 0.05 mrad add about as much as that noise. The history corrects it."""
_PRIOR = 6.0
"""Weight of the prior on the scatter, in checks. With fewer, chance agreement of the first checks
raises false alarms; with more, the history is learnt late."""
_WALK = 0.3
"""Variance by which a number walks in a month, over the variance of its scatter from check to
check. With 0.1 a zero that walks by 0.3 std of a row's noise a month raised two alarms in 8
robot-years, with 0.2 to 0.5 none."""
_EFFECTIVE, _WORTH, _GROWN = 6.0, 24.0, 1.5
"""Degrees of freedom of a check's misfit; of its prior; and the misfit's expected variance, over
that of the noise within a check. Joints' repeatability acts in as many directions as there are
joints."""


class Step(NamedTuple):
    """A change of K numbers from some check on: sizes and standard errors (K,), degrees of freedom,
    p value of the residual, and the log evidence for a change at this check, to compare checks."""

    size: np.ndarray
    std: np.ndarray
    freedom: float
    misfit: float
    evidence: float


class _Reference(NamedTuple):
    """First check of a history, to which others are compared: parameters (P,), scene, derivatives
    (P, 6, K) of P readings by K numbers, and the numbers' values there (K,), of which gains, tilt
    and mount count from 0."""

    theta: np.ndarray
    scene: Scene
    tangents: np.ndarray
    origin: np.ndarray


@lru_cache(maxsize=4)
def _reference(robot: Robot, first: Check) -> _Reference:
    """Make the reference of a history from its first check; slow, as it needs derivatives. A
    `CalibrationError` if the load of the check cannot be identified."""
    model, nominal = Model.of(robot), robot.parameters.nominal
    gravity, n = np.asarray(model.gravity), len(robot.parameters)
    rotation, _ = robot.sensor_pose(first.q, nominal)
    weight = 1.0 / np.diagonal(first.covariance)
    load = identify_from_gravity(gravity @ rotation, first.wrench, weight)
    check_mass(load.mass)
    theta = model.parameters.nominal.copy()
    theta[:n] = robot.theta_of_tool(nominal, load.mass, [float(c) for c in load.cog])
    theta[n : n + 6] = load.bias
    scene = Scene(robot, theta[:n], gravity, first.q, first.t, np.ones(len(first.q), dtype=bool))
    columns, typical = tangents(scene, [number[:2] for number in FITTED.values()])
    origin = np.concatenate([load.bias, [load.mass], load.cog, np.zeros(7)])
    return _Reference(theta, scene, columns / typical, origin)


def tangents(scene: Scene, wanted: Iterable[tuple[str, str]]) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (P, 6, K) of readings by K parameters (effect, name), each over its typical size;
    sizes (K,)."""
    response, known, columns, typical = Response(scene, (WRENCH,)), effects(), [], []
    for effect, name in wanted:
        parameters = known[effect].parameters(scene.robot)
        parameter = parameters[parameters.index(name)]
        columns.append(response.tangent(known[effect], parameter, known[effect].variants(scene)[0]))
        typical.append(parameter.tolerance)
    return np.stack(columns, axis=-1), np.array(typical)


@dataclass(frozen=True, eq=False)
class History:
    """Checks of one robot since its last baseline, oldest first, with K numbers fitted to each."""

    robot: Robot
    checks: Sequence[Check]

    @property
    def _first(self) -> _Reference:
        return _reference(self.robot, self.checks[0])

    @cached_property
    def _sensor(self) -> Sensor:
        name = self.checks[0].sensor
        known = name if registry.is_known("sensors", name) else self.robot.sensor
        sensor: Sensor = registry.load("sensors", known)
        return sensor

    @cached_property
    def _slow(self) -> np.ndarray:
        """Std (6,) [N, N·m] of the zeros' drift between checks by 1/f noise and warm-up."""
        noise = self._sensor.noise
        return np.hypot(_SLOW * noise.flicker, _LEFT_OF_WARM_UP * np.abs(noise.warmup_drift))

    @cached_property
    def _row_std(self) -> np.ndarray:
        """Standard deviation (6,) [N, N·m] of one row: the median over checks."""
        variances = np.median([np.diagonal(c.covariance) for c in self.checks], axis=0)
        return np.sqrt(np.maximum(variances, 1e-6 * self._sensor.noise.row_std**2))

    @cached_property
    def _turn(self) -> np.ndarray:
        """Whitening matrix (6 P, 6 P) of mean readings at P rests, for row noise and 1/f noise."""
        first, noise = self.checks[0], self._sensor.noise
        flicker = noise.correlation * np.outer(noise.flicker, noise.flicker)
        rows = np.kron(np.eye(len(first.t)), np.diag(self._row_std**2 / np.median(first.count)))
        return np.linalg.inv(np.linalg.cholesky(rows + np.kron(kernel(first.t), flicker)))

    @cached_property
    def _fit(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Numbers and drifts of zeros in n checks (n, K + 6), as differences from the model at the
        first check, their covariance in one check (K + 6, K + 6), and the whitened residual (n, 6
        P) at P rests."""
        scene, tangents = self._first.scene, self._first.tangents
        moving = (scene.age / scene.span - 0.5)[:, None, None] * np.eye(6)
        both = np.concatenate([tangents, moving], axis=-1)
        columns = self._turn @ both.reshape(-1, both.shape[-1])
        prior = np.zeros(len(columns.T))
        prior[-6:] = 1.0 / np.maximum(self._slow, 1e-12) ** 2
        covariance = np.linalg.inv(columns.T @ columns + np.diag(prior))
        q, wrench = (np.concatenate([getattr(c, n) for c in self.checks]) for n in ("q", "wrench"))
        differences = wrench - Model.of(self.robot).predict(q, self._first.theta)
        white = differences.reshape(len(self.checks), -1) @ self._turn.T
        numbers = white @ columns @ covariance
        return numbers, covariance, white - numbers @ columns.T

    @property
    def values(self) -> np.ndarray:
        """Fitted numbers of all checks (n, K) [SI]."""
        return self._fit[0][:, : len(FITTED)] + self._first.origin

    @property
    def std(self) -> np.ndarray:
        """Standard uncertainty (K,) [SI] of one check's numbers by the noise within it."""
        return np.sqrt(np.diagonal(self._fit[1]))[: len(FITTED)]

    @property
    def misfit(self) -> np.ndarray:
        """Mean squared residual (n,) of each check, over the variance of a row's noise."""
        residual = np.linalg.solve(self._turn, self._fit[2].T).T.reshape(len(self.checks), -1, 6)
        return np.asarray(((residual / self._row_std) ** 2).mean(axis=(1, 2)))

    @cached_property
    def years(self) -> np.ndarray:
        """Times (n,) since the first check [years of 365.25 days]."""
        times = [c.time.timestamp() for c in self.checks]
        return (np.array(times) - times[0]) / YEAR_S

    @cached_property
    def _nuisance(self) -> np.ndarray:
        """Temperatures (n, 1), or yearly sine and cosine (n, 2) [K], by which numbers may vary."""
        degrees = np.array([c.temperature for c in self.checks])
        if np.isfinite(degrees).all():
            return (degrees - degrees[0])[:, None]
        wave = 2.0 * np.pi * self.years
        return _SEASON_K * np.stack([np.cos(wave), np.sin(wave)], axis=1)

    @cached_property
    def _expected(self) -> tuple[np.ndarray, np.ndarray]:
        """Prior scatter (K,) [SI] of each of K numbers from check to check, and its change per
        kelvin in units of that scatter (K,)."""
        full, mass = self._sensor.calibration().range, self._first.origin[6]
        spans = [_SPAN_PER_K] * 2
        by_kelvin = np.concatenate([_ZERO_PER_K * full, [_SPAN_PER_K * mass], np.zeros(8), spans])
        day = _OTHER * self.std
        day[:6] = np.hypot(self.std[:6], self._slow)
        kelvin = _SEEN_K if self._nuisance.shape[1] == 1 else _UNSEEN_K
        expected = np.hypot(day, by_kelvin * kelvin)
        return expected, np.maximum(by_kelvin / expected, 1e-6)  # 0 would be no prior at all

    @cached_property
    def _root(self) -> np.ndarray:
        """Whitening matrix (n, n) of the scatter over n checks: white noise and a random walk."""
        months = 12.0 * self.years
        covariance = np.eye(len(months)) + _WALK * np.minimum(months[:, None], months)
        return np.linalg.inv(np.linalg.cholesky(covariance))

    def step(self, begin: int) -> Step:
        """Estimate a step of the numbers that begins with check ``begin``, at least 1."""
        n, (expected, by_kelvin) = len(self.checks), self._expected
        flat = np.column_stack([np.arange(n) >= begin, np.ones(n)]).astype(float)
        x = self._root @ np.column_stack([flat, self._nuisance])
        y = self._root @ (self._fit[0][:, : len(FITTED)] / expected)
        precision = np.zeros((len(FITTED), x.shape[1]))
        precision[:, 2:] = 1.0 / by_kelvin[:, None] ** 2
        inverse = np.linalg.inv(x.T @ x + precision[:, :, None] * np.eye(x.shape[1]))
        beta = np.einsum("kij,jk->ik", inverse, x.T @ y)
        square = ((y - x @ beta) ** 2).sum(axis=0) + (precision.T * beta**2).sum(axis=0)
        freedom = _PRIOR + n - 2
        std = np.sqrt((_PRIOR + square) / freedom * inverse[:, 0, 0])
        logs = 0.5 * np.linalg.slogdet(inverse)[1] - 0.5 * freedom * np.log(_PRIOR + square)
        misfit, evidence = self._misfit_of(flat)
        evidence += float(logs.sum())
        return Step(expected * beta[0], expected * std, freedom, misfit, evidence)

    def _misfit_of(self, x: np.ndarray) -> tuple[float, float]:
        """p value, log evidence of a step in the whitened residuals; x (n, 2): columns step and
        mean."""
        residual = self._fit[2]
        each, inverse = residual.shape[1] - len(self._fit[1]), np.linalg.inv(x.T @ x)
        beta = inverse @ (x.T @ residual)
        scatter = float(((residual - x @ beta) ** 2).sum()) / each
        freedom = _WORTH + _EFFECTIVE * (len(x) - 2)
        variance = (_WORTH * _GROWN + _EFFECTIVE * scatter) / freedom
        ratio = float((beta[0] ** 2).sum()) / each / inverse[0, 0] / variance
        p = float(fdtrc(_EFFECTIVE, freedom, ratio))
        return p, -0.5 * freedom * float(np.log(variance))
