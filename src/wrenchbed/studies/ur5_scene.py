"""The scene of the UR5 study: published figures, the simulated robot, recordings from MuJoCo.

The article is "Calculation of Installation Error for Six-Axis Force Sensors in Robotic
Applications", Tables 1 to 6; it names no author and no DOI. Lengths are the manufacturer's: read
literally, the article's Denavit–Hartenberg table puts the flange 0.86 m away.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.physics.noise import NoiseModel, NoiseStream
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import INERTIA_AXES
from wrenchbed.robots.ur5 import URArm
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.simulation import Simulation

DIRECTIONS = ("right", "up", "backward", "down", "left")
METHODS = ("Method 1", "Method 2", "Method 3")
FORCE = {
    "right": (0.0189, 3.6908, 5.1165), "up": (0.0120, 4.4279, 5.9899),
    "backward": (0.1808, 9.5964, 6.1964), "down": (0.0060, 11.5635, 10.3358),
    "left": (0.0085, 8.6540, 5.6913),
}  # fmt: skip
"""Geometric mean of the force's magnitude by method [N]."""
TORQUE = {
    "right": (0.0122, 0.4353, 0.1034), "up": (0.0038, 0.4464, 0.0507),
    "backward": (0.0077, 0.3589, 0.1234), "down": (0.0082, 0.6394, 0.2247),
    "left": (0.0051, 0.4811, 0.0789),
}  # fmt: skip
"""Geometric mean of the torque's magnitude by method [N·m]."""
TABLE = {"right": 2, "up": 3, "backward": 4, "down": 5, "left": 6}
RATE_HZ, SAMPLES, MOVE_S = 100.0, 100, 3.0
"""Rows per second and per pose, and the time between poses [s]."""
INSTALLATION = {
    "sensor.bias.fx": 2.1, "sensor.bias.fy": -3.4, "sensor.bias.fz": 6.2,
    "sensor.bias.tx": 0.21, "sensor.bias.ty": -0.36, "sensor.bias.tz": 0.14,
}  # fmt: skip
"""Installation error [N, N·m], of the size that the article's Method 2 leaves."""
SENSOR_MASS = 0.12
"""Part of the sensor's own mass that loads its gauges [kg], stated and true: about
half of the Gamma's 0.255 kg."""
_DEGREE = float(np.pi / 180)


@dataclass(frozen=True)
class Scenario:
    """Deviations from the article's assumptions.

    Attributes:
        true: parameters that are not as stated, by name.
        stated_mass: factor of the tool's true mass that the user states.
        cold: whether the sensor was switched on only when the campaign begins.
    """

    name: str
    true: Mapping[str, float] = field(default_factory=dict)
    stated_mass: float = 1.0
    cold: bool = False


SCENARIOS = (
    Scenario("as the article assumes"),
    Scenario("sensor just switched on: it drifts", cold=True),
    Scenario("stated tool mass 5 % too large", stated_mass=1.05),
    Scenario("base tilted by 1°", {"base.tilt.x": 0.8 * _DEGREE, "base.tilt.y": -0.6 * _DEGREE}),
    Scenario("sensor turned by 1° on the flange", {"mount.rotation.z": _DEGREE}),
    Scenario("joint 5's zero off by 1°, which no method models", {"dq5": _DEGREE}),
    Scenario(
        "drift, mass, tilt and turn at once",
        {"base.tilt.x": 0.8 * _DEGREE, "base.tilt.y": -0.6 * _DEGREE, "mount.rotation.z": _DEGREE},
        1.05,
        True,
    ),
)


@dataclass(frozen=True, eq=False)
class StudyScene:
    """Robot and sensor in one scenario."""

    scenario: Scenario
    model: Model
    theta: np.ndarray
    metadata: Metadata
    noise: NoiseModel
    seed: int

    @classmethod
    def of(cls, scenario: Scenario, seed: int) -> "StudyScene":
        """Scene of a UR5 with an ATI Gamma in a scenario."""
        robot: URArm = registry.load("robots", "ur5")
        model = Model.of(robot)
        theta = model.parameters.vector(
            INSTALLATION | {"sensor.mass": SENSOR_MASS} | dict(scenario.true)
        )
        sensor = registry.load("sensors", robot.sensor)
        noise = replace(sensor.noise, warmup_age=0.0) if scenario.cold else sensor.noise
        p = robot.values(robot.parameters.nominal)
        metadata = Metadata(
            robot=robot.name, mode="static", source="sim", rate_hz=RATE_HZ,
            tool=ToolInfo(
                mass=float(p["tool.mass"]) * scenario.stated_mass,
                cog=tuple(float(p[f"tool.cog.{a}"]) for a in "xyz"),
                inertia=tuple(float(p[f"tool.inertia.{a}"]) for a in INERTIA_AXES),
            ),
            sensor=SensorInfo(
                model=sensor.name, noise_std=tuple(float(s) for s in noise.row_std),
                mass=SENSOR_MASS, pose_flange=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            ),
            gravity=model.gravity,
        )  # fmt: skip
        return cls(scenario, model, theta, metadata, noise, seed)

    def measure(self, q: np.ndarray) -> tuple[Recording, np.ndarray]:
        """Holds at q (N, 6), and the exact load and bias at each (N, 6) before noise and drift."""
        own = len(self.model.robot.parameters)
        simulation = Simulation(self.model.robot, self.theta[:own], self.model.gravity)  # type: ignore[arg-type]
        exact = self.model.read(simulation.wrench(q), self.theta)
        n = len(q)
        first = np.arange(n) * (SAMPLES / RATE_HZ + MOVE_S)
        t = (first[:, None] + np.arange(SAMPLES) / RATE_HZ).ravel()
        segment = np.repeat(np.arange(n), SAMPLES)
        reading, status = NoiseStream(self.noise, self.seed).corrupt(t, exact[segment])
        columns: dict[str, np.ndarray] = {"t": t, "segment": segment, "status": status}
        columns |= {f"q{j + 1}": q[segment, j] for j in range(q.shape[1])}
        columns |= {c: reading[:, k] for k, c in enumerate(CHANNELS)}
        return Recording(self.metadata, columns, self.scenario.name), exact

    def stated(self) -> np.ndarray:
        """Parameters (P,) as the metadata states them."""
        return self.model.configured(self.metadata)
