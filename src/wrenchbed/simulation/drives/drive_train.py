"""What the drives of a simulated robot report: torques or currents, with friction, faults, noise.

    τ = rigid body and rotor (MuJoCo) + F_c tanh(q̇/v₀) + F_v q̇ + τ₀,   then the faults,
    i = τ/K + noise, quantised.

Noise of a current: white, and a ripple of the motor's turns, both through the filter of the drive's
current reading. Reported torques are such currents times K.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from scipy import signal

from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.drives.faults import REVERSAL, ActiveFault, Rows, active_fault
from wrenchbed.simulation.drives.joint_torques import JointTorques
from wrenchbed.simulation.drives.parameters import DriveParameters

Kind = Literal["torque", "current"]
COLUMN: Mapping[str, str] = {"torque": "tau", "current": "i"}
"""Prefix of the columns by kind of effort."""
_WHITE = 0.01
"""White noise of a current before its filter, as a share of `level`; estimate."""
_RIPPLE = 0.005
"""Amplitude of a current's ripple, as a share of `level`; estimate."""
_FRICTIONS = 4.0
"""Coulomb frictions that count as load of a drive, beside what holds the robot; estimate."""
_GEAR, _POLES = 100.0, 6.0
"""Turns of a motor per turn of its joint, and waves a turn of the motor; estimates."""
_FILTER_HZ = 40.0
"""Cutoff of the first-order filter on a drive's current reading [Hz]; estimate."""
_STEP = 0.001
"""Resolution of reported currents [A]; estimate."""
_COLD, _WARMER, _WARM_S = 25.0, 8.0, 1800.0
"""Temperature of a drive [°C] as it starts, its rise [K], and the time constant [s]; estimates."""
_BLOCK = 512
"""Rows of white noise drawn at once in real time."""
_POSES, _SEED = 200, 5
"""Number and seed of the random poses for the torque that holds the robot."""


def temperatures(t: np.ndarray, joints: int) -> np.ndarray:
    """Temperatures of the drives (N, J) [°C] that warm up from t = 0 [s] on."""
    warm = _COLD + _WARMER * (1.0 - np.exp(-np.asarray(t, dtype=float) / _WARM_S))
    return np.repeat(warm[:, None], joints, axis=1)


class DriveTrain:
    """The drives of one robot.

    Args:
        robot: which one.
        theta: its true parameters (P,).
        gravity: in world axes (3,) [m/s²].
        given: true parameters of the drives where they differ from nominal: ``drive.coulomb.2``.
        faults: (name, values) of each.

    Raises:
        NotFoundError, ParameterError: a parameter or a fault does not exist or is impossible.
    """

    def __init__(
        self, robot: SimulatedRobot, theta: np.ndarray, gravity: Sequence[float],
        given: Mapping[str, float] | None = None,
        faults: Sequence[tuple[str, Mapping[str, Any]]] = (),
    ) -> None:  # fmt: skip
        nominal = JointTorques(robot, robot.parameters.nominal, gravity)
        poses = robot.sample(_POSES, np.random.default_rng(_SEED))
        holding = nominal.of(Jet(poses, 0.0 * poses, 0.0 * poses))
        self.holding = np.abs(holding).max(axis=0)
        usual = DriveParameters.nominal(robot, nominal.rotor, self.holding)
        self.nominal = usual
        self.parameters = usual.changed(given or {})
        self.rigid = JointTorques(robot, theta, gravity, self.parameters.inertia)
        self.controller = nominal
        """Parameters of the robot that the controller assumes."""
        self.faults: tuple[ActiveFault, ...] = tuple(
            active_fault(name, values, usual.coulomb) for name, values in faults
        )

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.parameters.coulomb)

    def torques(self, t: np.ndarray, q: Jet, rigid: np.ndarray | None = None) -> np.ndarray:
        """Torques of the motors (N, J) [N·m or N], as drives with nominal constants report it.

        Calls follow each other in time: some faults remember.

        Args:
            t: times (N,) [s].
            q: joint values with speeds and accelerations (N, J).
            rigid: of the rigid body (N, J) where that is known.
        """
        p = self.parameters
        rigid = self.rigid.of(q) if rigid is None else rigid
        total = rigid + p.coulomb * np.tanh(q.d / REVERSAL) + p.viscous * q.d + p.offset
        if not self.faults:
            return np.asarray(total)
        warm = temperatures(t, 1)[:, 0]
        for fault in self.faults:
            j = fault.joint - 1
            rows = Rows(t, q.v[:, j], q.d[:, j], q.dd[:, j], rigid[:, j], warm,
                        float(self.nominal.coulomb[j]))  # fmt: skip
            total[:, j] = fault.act(rows, total[:, j])
        return np.asarray(total)

    def level(self) -> np.ndarray:
        """Current (J,) [A] that noise and ripple are proportional to."""
        load = self.holding + _FRICTIONS * self.nominal.coulomb
        return np.asarray(load / np.abs(self.nominal.constant))


class EffortNoise:
    """Noise of the drives' readings, one call after another.

    Args:
        train: the drives.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise.
        rate: rows a second [Hz].
    """

    def __init__(self, train: DriveTrain, noise: str, seed: int, rate: float) -> None:
        self._kind, self._level = noise, train.level()
        self._rng = np.random.default_rng([seed, 17])
        self._phase = self._rng.uniform(0.0, 2.0 * np.pi, train.joints)
        keep = float(np.exp(-2.0 * np.pi * _FILTER_HZ / rate))
        self._keep, self._b, self._a = keep, [1.0 - keep], [1.0, -keep]
        self._state = np.zeros((1, train.joints))
        self._drawn: list[np.ndarray] = []

    def on(self, current: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Currents (N, J) [A] as they are reported at joint values (N, J)."""
        if self._kind == "off":
            return current
        noise = _WHITE * self._rng.normal(size=current.shape)
        if self._kind == "white":
            return np.asarray(current + self._level * noise)
        noise = noise + self._ripple(q)
        seen, self._state = signal.lfilter(self._b, self._a, noise, axis=0, zi=self._state)
        return np.asarray(np.round((current + self._level * seen) / _STEP) * _STEP)

    def row(self, current: np.ndarray, q: np.ndarray) -> np.ndarray:
        """`on` for one row (J,), in real time: the same formulas without calls per row."""
        if self._kind == "off":
            return current
        if not self._drawn:
            self._drawn = list(_WHITE * self._rng.normal(size=(_BLOCK, len(q))))
        noise = self._drawn.pop()
        if self._kind == "white":
            return np.asarray(current + self._level * noise)
        fresh = (1.0 - self._keep) * (noise + self._ripple(q)) + self._state[0]
        self._state[0] = self._keep * fresh
        return np.asarray(np.rint((current + self._level * fresh) / _STEP) * _STEP)

    def _ripple(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(_RIPPLE * np.sin(_GEAR * _POLES * q + self._phase))


class ReportedEfforts:
    """Columns of a recording: efforts, what the controller wants, and temperatures.

    Args:
        train: the drives.
        kind: ``torque`` or ``current``.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise.
    """

    def __init__(self, train: DriveTrain, kind: Kind, noise: str, seed: int) -> None:
        self._train, self._kind, self._noise, self._seed = train, kind, noise, seed
        self._stream: EffortNoise | None = None

    def columns(
        self, t: np.ndarray, q: Jet, targets: np.ndarray, rate: float
    ) -> dict[str, np.ndarray]:
        """Columns of a recording's rows that follow each other in time.

        Args:
            t: times (N,) [s].
            q: joint values with speeds and accelerations (N, J).
            targets: of the joint values (N, J).
            rate: rows a second [Hz].
        """
        train = self._train
        if self._stream is None:
            self._stream = EffortNoise(train, self._noise, self._seed, rate)
        constant = train.parameters.constant
        seen = self._stream.on(train.torques(t, q) / constant, q.v)
        if self._kind == "torque":
            seen = seen * train.nominal.constant
        speed = np.gradient(targets, 1.0 / rate, axis=0) if len(targets) > 1 else 0.0 * targets
        parts = {
            COLUMN[self._kind]: seen, "qd_target": speed, "tau_target": train.controller.of(q),
            "joint_temperature": temperatures(t, train.joints),
        }  # fmt: skip
        return {f"{k}{j + 1}": v[:, j] for k, v in parts.items() for j in range(train.joints)}
