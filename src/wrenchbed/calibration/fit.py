"""Result of a calibration: values with uncertainty, residuals, and what was not identifiable."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.calibration.observability import Observability
from wrenchbed.calibration.touch_points import Agreement
from wrenchbed.data.metadata import model_field
from wrenchbed.files import write_json
from wrenchbed.physics.wrench import CHANNELS, UNITS

FORMAT = 1


@dataclass(frozen=True)
class IdentifiedValue:
    """Value of one identified parameter, with its uncertainty.

    Attributes:
        value, nominal: fitted and start value [unit].
        std: standard uncertainty [unit], None if the data determine only a combination of it.
        interval95: half width of the 95 % interval [unit], Student's t.
    """

    name: str
    value: float
    std: float | None
    unit: str
    nominal: float
    interval95: float | None


@dataclass(frozen=True)
class FitNoise:
    """Noise by channel (6,) [N, N·m], as the fit used it; a hold is one pose at rest.

    Attributes:
        row: standard deviation of one row, from ``source``.
        source: ``repeats`` (rows within holds), ``stated`` (metadata) or ``residual`` (of the fit).
        expected: standard deviation of a hold's mean if its rows are independent.
        scatter: standard deviation of the holds' means about the fit.
        effective: number of independent rows with as much information as all rows (6,).
        rows: mean number of rows in a hold.
        inflated: whether the uncertainties were widened from ``expected`` to ``scatter``.
    """

    row: np.ndarray
    source: str
    expected: np.ndarray
    scatter: np.ndarray
    effective: np.ndarray
    rows: float
    inflated: bool


class WrittenFit(ABC):
    """Base class of fits: parameter values by name, written to a JSON file."""

    identified: tuple[IdentifiedValue, ...]

    def __getitem__(self, name: str) -> IdentifiedValue:
        return next(p for p in self.identified if p.name == name)

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """Return the content of the fit's JSON file."""

    def write(self, path: str | Path) -> None:
        """Write the fit to a JSON file."""
        write_json(path, self.to_json())


@dataclass(frozen=True, eq=False)
class Fit(WrittenFit):
    """Result of a calibration: identified parameters, noise and residual.

    Attributes:
        status: sentence: converged or not, and how far to trust the values.
        identified: the free parameters.
        theta: all parameters by name, fitted or not.
        gravity: gravity of the fit, world axes (3,) [m/s²].
        tool: fitted load on the sensor, as in fit.json: mass [kg], cog (3,) [m] in sensor axes.
        covariance: covariance of the free parameters (K, K), minimum-norm where they are redundant.
        residual_rms: rms residual over the holds, each channel (6,) [N, N·m].
        observability: rank and null directions of all parameters that the robot may have wrong.
        target_rms: expected position error of the tool in the robot's target workspace [m], rms;
            only with a prior, which bounds what the data cannot tell, and touches that agree.
        touches: agreement of the touches with the other data; None without touches.
        refuted: why the data refute values that were asked for nevertheless; else None.
    """

    recording: str
    robot: str
    status: str
    converged: bool
    iterations: int
    identified: tuple[IdentifiedValue, ...]
    theta: Mapping[str, float]
    gravity: tuple[float, ...]
    tool: Mapping[str, Any]
    covariance: np.ndarray
    residual_rms: np.ndarray
    noise: FitNoise
    poses: int
    rows: int
    left_out: int
    observability: Observability
    target_rms: float | None = None
    touches: Agreement | None = None
    refuted: str | None = None

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (K, K) of the free parameters; 0 beside one without variance."""
        std = np.sqrt(np.diagonal(self.covariance))
        outer = np.outer(std, std)
        return np.divide(self.covariance, outer, out=np.zeros_like(outer), where=outer > 0)

    def to_json(self) -> dict[str, Any]:
        """Return the content of the fit's JSON file."""
        o, noise = self.observability, self.noise
        return head(self.recording, self.robot, self.status, self.refuted) | {
            "converged": self.converged,
            "iterations": self.iterations,
            "poses": self.poses,
            "rows": self.rows,
            "rows_left_out": self.left_out,
            "parameters": entries(self.identified),
            "tool": dict(self.tool),
            "target_rms": self.target_rms,
            "touches": None if self.touches is None else asdict(self.touches),
            "residual_rms": _channels(self.residual_rms),
            "noise": {
                "source": noise.source,
                "row_std": _channels(noise.row),
                "rows_per_pose": noise.rows,
                "effective_rows": _channels(noise.effective),
                "hold_mean_expected": _channels(noise.expected),
                "hold_mean_scatter": _channels(noise.scatter),
                "inflated": noise.inflated,
            },
            "rank": o.rank,
            "candidates": list(o.names),
            "no_effect": list(o.no_effect),
            "redundancies": [r.to_json() for r in o.redundancies],
            "singular_values": o.singular_values.tolist(),
            "correlation": {
                "names": [p.name for p in self.identified],
                "matrix": self.correlation.tolist(),
            },
            "covariance": self.covariance.tolist(),
            "theta": dict(self.theta),
            "gravity": list(self.gravity),
        }


def identified_values(
    names: Iterable[tuple[str, str]], values: np.ndarray, std: np.ndarray, nominal: np.ndarray,
    determined: np.ndarray, wide: float,
) -> tuple[IdentifiedValue, ...]:  # fmt: skip
    """Combine K values with their uncertainties; None for those that the data do not determine.

    Args:
        names: (name, unit) of the K parameters.
        values, std, nominal: (K,).
        determined: whether the data determine each (K,), boolean.
        wide: half width of a 95 % interval in standard uncertainties.
    """
    return tuple(
        IdentifiedValue(
            name, float(value), float(s) if known else None, unit, float(begun),
            float(wide * s) if known else None,
        )
        for (name, unit), value, s, begun, known in zip(
            names, values, std, nominal, determined, strict=True
        )
    )  # fmt: skip


def head(recording: str, robot: str, status: str, refuted: str | None) -> dict[str, Any]:
    """First entries of a fit's JSON file: the four arguments (``refuted`` unless None), format, and
    the model of a user's own robot."""
    named = {"format": FORMAT, "recording": recording, "robot": robot, "status": status}
    said = {} if refuted is None else {"refuted": refuted}
    return named | said | model_field(robot)


def entries(identified: Sequence[IdentifiedValue]) -> dict[str, dict[str, Any]]:
    """Name → value, uncertainty and unit of each parameter, as a fit's JSON file has them."""
    return {p.name: {k: v for k, v in asdict(p).items() if k != "name"} for p in identified}


def _channels(values: np.ndarray) -> dict[str, Any]:
    return {c: float(v) for c, v in zip(CHANNELS, values, strict=True)} | {
        "unit": f"{UNITS[0]}, {UNITS[3]}"
    }
