"""The base's tilt from an accelerometer on the tool: a second measurement of gravity.

At rest it reads a = A Rᵀ(g + α × g) + b: R the sensor's orientation, A the accelerometer's mounting
and scales (3, 3), b its zero, α the tilt. A and b are free, so neither its mounting nor its
calibration matters; gravity must only be constant in the base. The wrench takes no part.
"""

from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.observations import usable
from wrenchbed.data.holds import gather
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.configuration import Configuration
from wrenchbed.effects.base_tilt import EFFECT, TYPICAL
from wrenchbed.physics.rotations import cross
from wrenchbed.physics.time_derivatives import value

TILT = EFFECT.name
AXES = ("ax", "ay", "az")
SIZES = TYPICAL * 2.0 ** np.arange(-2, 3)
"""Prior standard deviations of a tilt about one axis [rad], all alike."""
LEAST_FREE = 12
"""Least degrees of freedom of the accelerometer's fit."""
_NUISANCES = 12
_STEPS = 8
_GRID = np.linspace(-8.0, 8.0, 65)


@dataclass(frozen=True, eq=False)
class Testimony:
    """A tilt as the accelerometer measures it.

    Attributes:
        tilt: rotation of gravity about the base's x and y (2,) [rad].
        covariance: (2, 2), from its own residual.
        log_bayes: log Bayes factor of a tilt against none.
        rms: of the accelerometer's residual [m/s²].
        dof: degrees of freedom of that residual.
    """

    tilt: np.ndarray
    covariance: np.ndarray
    log_bayes: float
    rms: float
    dof: int

    @property
    def std(self) -> np.ndarray:
        """Standard uncertainties of the tilt (2,) [rad]."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))


def acceleration_columns(recording: Recording) -> np.ndarray | None:
    """Readings (N, 3) of an accelerometer [m/s²], None without one."""
    if not all(a in recording.columns for a in AXES):
        return None
    return np.stack([recording.columns[a] for a in AXES], axis=-1)


def testimony(recording: Recording, configuration: Configuration) -> Testimony | None:
    """The tilt of a static recording with ``ax ay az``; None if it holds too little of it."""
    measured = acceleration_columns(recording)
    if recording.metadata.mode != "static" or measured is None:
        return None
    keep = usable(recording)
    holds = gather(recording, keep)
    read = np.add.reduceat(measured[keep], holds.rows) / holds.count[:, None]
    model = configuration.model
    rotation = value(model.robot.sensor_pose(holds.q, configuration.robot_theta)[0])
    return fitted(read, rotation, np.asarray(model.gravity))


def fitted(read: np.ndarray, rotation: np.ndarray, gravity: np.ndarray) -> Testimony | None:
    """The tilt from readings (H, 3) [m/s²] at orientations (H, 3, 3) under gravity (3,) [m/s²]."""
    dof = read.size - _NUISANCES - 2
    if dof < LEAST_FREE:
        return None
    tilt = np.zeros(2)
    for _ in range(_STEPS):
        seen = (gravity + cross(np.array([*tilt, 0.0]), gravity)) @ rotation
        basis, scale, _ = np.linalg.svd(np.column_stack([seen, np.ones(len(seen))]), False)
        if scale[-1] < 1e-6 * scale[0]:
            return None
        gain = np.linalg.lstsq(np.column_stack([seen, np.ones(len(seen))]), read, rcond=None)[0]
        turns = [(cross(axis, gravity) @ rotation) @ gain[:3] for axis in np.eye(3)[:2]]
        design = np.stack([_without(basis, x).ravel() for x in turns], axis=1)
        residual = _without(basis, read).ravel()
        normal = design.T @ design
        if np.linalg.eigvalsh(normal)[0] < 1e-9 * max(float((seen**2).sum()), 1e-12):
            return None
        step = np.linalg.solve(normal, design.T @ residual)
        tilt = tilt + step
        if np.abs(step).max() < 1e-9:
            break
    square = float(((residual - design @ step) ** 2).sum())
    none = square + float(tilt @ normal @ tilt)
    covariance = np.linalg.inv(normal) * square / dof
    logs = [_log_bayes(tilt, normal, square, none, dof + 2, float(s)) for s in SIZES]
    log_bayes = float(np.logaddexp.reduce(logs) - np.log(len(SIZES)))
    return Testimony(tilt, covariance, log_bayes, float(np.sqrt(square / read.size)), dof)


def _without(basis: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.asarray(x - basis @ (basis.T @ x))


def _log_bayes(
    tilt: np.ndarray, normal: np.ndarray, square: float, none: float, free: int, size: float
) -> float:
    """log ∫ π(α) (S(α)/S(0))^(−n/2) dα, the noise's variance integrated out (Jeffreys' prior)."""
    inside = normal * free / square
    spread = np.linalg.inv(inside + np.eye(2) / size**2)
    middle = spread @ inside @ tilt
    root = np.linalg.cholesky(spread)
    z = np.stack(np.meshgrid(_GRID, _GRID), axis=-1).reshape(-1, 2)
    at = middle + z @ root.T
    away = at - tilt
    energy = square + np.einsum("ni,ij,nj->n", away, normal, away)
    log = -0.5 * (at**2).sum(axis=1) / size**2 - np.log(2 * np.pi * size**2)
    log -= 0.5 * free * np.log(energy / none)
    cell = np.log(_GRID[1] - _GRID[0]) * 2 + np.log(np.diagonal(root)).sum()
    return float(np.logaddexp.reduce(log) + cell)
