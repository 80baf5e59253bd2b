"""A robot's simulator with numbers for all its parameters, split by what they describe."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.effects.chain import stated_effects
from wrenchbed.errors import DiagnosisError, RecordingError
from wrenchbed.physics.wrench import CHANNELS, Tool
from wrenchbed.simulation.closed_form import Model, robot_of

STATED = stated_effects()
"""Effects that are wrong numbers of the metadata, which every user fits: bias, mass, CoG."""
BIAS = tuple(f"{STATED[0]}.{c}" for c in CHANNELS)
"""Names of the biases among the parameters of a model."""
LOAD = ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z")
"""Names of mass and CoG among the parameters of a robot whose tool is stated by them."""


@dataclass(frozen=True, eq=False)
class Configuration:
    """A robot's model with its full parameters ``theta`` (P,): the robot's, then the sensor's."""

    model: Model
    theta: np.ndarray

    @cached_property
    def robot_theta(self) -> np.ndarray:
        """Parameters of the robot alone, with its tool but without the sensor."""
        return self.model.robot.robot_theta(self.theta)

    @cached_property
    def tool(self) -> Tool:
        """Tool that the sensor carries: mass, CoG and inertia."""
        return self.model.robot.tool(self.robot_theta)

    @property
    def mass(self) -> float:
        """Mass of the tool [kg]."""
        return float(self.tool.mass)

    @property
    def cog(self) -> np.ndarray:
        """Centre of gravity of the tool in sensor axes (3,) [m]."""
        return np.asarray(self.tool.cog, dtype=float)

    @property
    def bias(self) -> np.ndarray:
        """Zero of the sensor (6,) [N, N·m]."""
        return self.theta[[self.model.parameters.index(name) for name in BIAS]]

    def with_load(
        self, mass: float, cog: Sequence[float] | np.ndarray, bias: np.ndarray | None = None
    ) -> "Configuration":
        """Copy with a tool of mass [kg] and CoG (3,) [m] and, if given, a bias (6,) [N, N·m]."""
        theta = self.theta.copy()
        theta[: len(self.robot_theta)] = self.model.robot.theta_of_tool(
            self.robot_theta, float(mass), [float(c) for c in cog]
        )
        if bias is not None:
            theta[[self.model.parameters.index(name) for name in BIAS]] = bias
        return Configuration(self.model, theta)

    def with_nearest_load(
        self, mass: float, cog: np.ndarray, bias: np.ndarray | None
    ) -> "Configuration":
        """Copy with the possible tool nearest to a mass [kg] and CoG (3,) [m]; bias (6,) if given.

        Beside a cause that takes the weight over, a linear fit may make the mass negative.
        """
        robot = self.model.robot
        of_load = [p for p in robot.parameters.items if p.name in robot.load]
        weight = next(p for p in of_load if p.unit == "kg" and p.name != "sensor.mass")
        lever = next(p for p in of_load if p.unit == "m")
        bounds = [weight, lever, lever, lever]
        load = np.clip([mass, *cog], [p.lower for p in bounds], [p.upper for p in bounds])
        return self.with_load(load[0], load[1:], bias)


def configured(recording: Recording) -> Configuration:
    """Simulator as a recording's metadata configure it.

    Raises:
        DiagnosisError: there is no such robot, or it cannot take the recorded joint values.
    """
    try:
        model = Model.of(robot_of(recording), recording.metadata)
    except RecordingError as error:
        raise DiagnosisError(str(error)) from error
    return Configuration(model, model.configured(recording.metadata))
