"""Calibration before any diagnosis: fit of bias, tool mass and CoG; tolerances of stated values."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.configured_simulator import BIAS, STATED, Configuration
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.errors import DiagnosisError, ParameterError

_DIFFERENCES = (1e-4, 1e-5, 1e-5, 1e-5)
"""Steps of finite differences in mass [kg] and CoG (3,) [m]."""
_STEPS, _DONE = 5, 1e-9
"""Largest number of Gauss–Newton steps, and the change [kg, m] below which they end."""
MASS_SHARE, COG_M, BIAS_SIGMAS = 0.005, 5e-4, 3.0
"""Default tolerances: ratio to the stated mass, CoG [m], bias in units of a gap of 1."""
MOST_ROUNDED = (0.05, 5e-3)
"""Largest tolerance by rounding of a stated mass (ratio) and CoG [m]: of "0.1 kg" and "1 cm"."""


@dataclass(frozen=True, eq=False)
class Baseline:
    """Simulator calibrated by a fit of bias, tool mass and CoG.

    Attributes:
        configuration: simulator with the fitted mass, CoG and bias.
        stated: simulator before any fit.
        tolerance: of ``sensor.bias`` (6,), ``tool.mass`` (1,), ``tool.cog`` (3,); inf: unstated.
    """

    configuration: Configuration
    stated: Configuration
    tolerance: Mapping[str, np.ndarray]

    @property
    def robot_theta(self) -> np.ndarray:
        """Parameters of the robot alone, with its tool but without the sensor."""
        return self.configuration.robot_theta

    @property
    def moved(self) -> dict[str, np.ndarray]:
        """Fitted less stated bias (6,) [N, N·m], mass (1,) [kg] and CoG (3,) [m] by effect."""
        fitted, mass = self.configuration, self.configuration.mass - self.stated.mass
        every = fitted.bias, np.array([mass]), fitted.cog - self.stated.cog
        return {k: x for k, x in zip(STATED, every, strict=True) if k in self.tolerance}


def calibrate(prepared: Prepared) -> Baseline:
    """Fit bias, mass and CoG by least squares in units of the noise, on the rows of the fit.

    Without a wrench there is no bias, and no fit if the leading channel shows no weight.

    Raises:
        DiagnosisError: the fitted mass is not above 0.
    """
    prepared, stated = prepared.leading, prepared.configuration
    if not prepared.channels[0].weighs:
        return Baseline(stated, stated, {})
    measured = prepared.rows(prepared.y).ravel()
    ones = np.ones((len(prepared.y), 1))
    channels = np.eye(prepared.y.shape[1])[: len(BIAS) * prepared.has_wrench]
    biases = [prepared.rows(ones * axis).ravel() for axis in channels]
    x, bias = np.concatenate([[stated.mass], stated.cog]), np.zeros(len(channels))
    for _ in range(_STEPS):
        here, slopes = _weighed(prepared, x), load_slopes(prepared, x)
        design = np.column_stack([slopes, *biases])
        scale = np.maximum(np.sqrt((design**2).sum(axis=0)), 1e-300)
        change = np.linalg.lstsq(design / scale, measured - here, rcond=1e-10)[0] / scale
        x, bias = x + change[:4], change[4:]
        if x[0] <= 0:
            raise DiagnosisError(
                f"{prepared.recording.name}: the tool's mass comes out as {x[0]:.3g} kg: gravity "
                "or the readings have the opposite sign, or this is another robot or another tool "
                "frame (wanted: the load on the sensor, +m·g along gravity at rest)"
            )
        if np.abs(change[:4]).max() < _DONE:
            break
    fitted = _with_load(prepared, x, bias if len(bias) else None)
    return Baseline(fitted, stated, tolerances(prepared))


def load_slopes(prepared: Prepared, x: np.ndarray) -> np.ndarray:
    """Derivatives (C R, 4) of whitened rows by mass [kg] and CoG [m] at x (4,)."""
    here, steps = _weighed(prepared, x), zip(_DIFFERENCES, np.eye(4), strict=True)
    each = [(_weighed(prepared, x + h * unit) - here) / h for h, unit in steps]
    return np.stack(each, axis=1)


def _weighed(prepared: Prepared, x: np.ndarray) -> np.ndarray:
    """Expected whitened readings (C R,), R rows of C columns, with mass [kg] and CoG [m] x (4,)."""
    at = _with_load(prepared, x).robot_theta
    return prepared.rows(prepared.at(at).expected).ravel()


def _with_load(prepared: Prepared, x: np.ndarray, bias: np.ndarray | None = None) -> Configuration:
    """Stated simulator with another mass [kg] and CoG [m], x (4,), and bias (6,) if given.

    Raises:
        DiagnosisError: no tool can have them.
    """
    try:
        return prepared.configuration.with_load(x[0], x[1:], bias)
    except ParameterError as error:
        raise DiagnosisError(
            f"{prepared.recording.name}: the tool that fits best is impossible ({error}): units of "
            "forces, torques or lengths do not go together, or this is another robot"
        ) from error


def tolerances(prepared: Prepared) -> dict[str, np.ndarray]:
    """Tolerance of each stated number by effect, SI: a larger error is a cause.

    A number stated to few digits may be wrong by half a unit of its last digit.

    Raises:
        DiagnosisError: the metadata's ``tolerance`` is not made of numbers.
    """
    stated, name = prepared.recording.metadata, prepared.recording.name
    bias, mass, cog = STATED
    given, tool_mass = stated.tool, prepared.configuration.mass
    most = MOST_ROUNDED[0] * tool_mass, MOST_ROUNDED[1]
    default = {
        bias: BIAS_SIGMAS * prepared.leading.sigma,
        mass: np.array([max(MASS_SHARE * tool_mass, min(_rounding(given.mass), most[0]))]),
        cog: np.full(3, max(COG_M, min(_rounding(*(given.cog or ())), most[1]))),
    }
    result = {k: _numbers(dict(stated.tolerance), k, v, name) for k, v in default.items()}
    if not prepared.has_wrench:
        del result[bias]
    known = states_tool(prepared.recording, of_robot=not prepared.has_wrench)
    return result | {k: np.full_like(result[k], np.inf) for k in (mass, cog) if not known[k]}


def states_tool(recording: Recording, of_robot: bool = True) -> dict[str, bool]:
    """Whether the tool's mass and CoG are stated, by effect: by the recording's metadata, or (with
    ``of_robot``) by the file of a robot, whose tool of `ur5` and `medrue` is a default."""
    tool, robot = recording.metadata.tool, recording.metadata.robot
    by_file = of_robot and registry.record_of("robots", robot) is not None
    each = zip(STATED[1:], (tool.mass, tool.cog), strict=True)
    return {effect: by_file or value is not None for effect, value in each}


def _rounding(*values: float | None) -> float:
    """Half a unit of the last digit of the value with the most digits; 0 for computed values."""
    stated = [repr(float(v)).removesuffix(".0") for v in values if v]
    plain = [s for s in stated if "e" not in s]
    if not plain or len(plain) < len(stated):  # an exponent: computed, not typed
        return 0.0
    return 0.5 * 10.0 ** -max(len(s.partition(".")[2]) for s in plain)


def _numbers(given: Mapping[str, Any], key: str, default: np.ndarray, name: str) -> np.ndarray:
    try:
        values = np.asarray(given.get(key, default), dtype=float)
        result = np.array(np.broadcast_to(values, default.shape))
    except (TypeError, ValueError):
        result = np.array([np.nan])
    if not (result > 0).all():
        raise DiagnosisError(
            f"{name}: metadata tolerance.{key} = {given.get(key)!r} must be {len(default)} "
            "positive numbers, or one for all"
        )
    return result
