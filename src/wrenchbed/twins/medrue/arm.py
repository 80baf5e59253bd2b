"""The robot behind the drives, with what its motors give."""

from collections import deque

import numpy as np

from wrenchbed.serving.body import Body, Options


class Arm(Body):
    """A body that also tells the forces and torques of its actuators.

    MedRUE's simulated links are weightless to their motors (MuJoCo's gravity compensation): what
    these give accelerates the robot and holds what pushes on it. It is reckoned from the state at
    a step's end, as MuJoCo's implicit integration applies it; ``actuator_force`` is reckoned at its
    begin, and is off by some newtons while an axis moves.
    """

    def __init__(self, options: Options, cycle: float) -> None:
        self._torques: deque[np.ndarray] = deque()
        super().__init__(options, cycle)

    @property
    def torque(self) -> np.ndarray:
        """Of each joint's actuator (J,) [N·m or N], in the cycle of the state that is shown."""
        return self._torques[0]

    def step(self, target: np.ndarray) -> None:
        super().step(target)
        model, plant = self.simulation.model, self._plant
        gain, spring, damper = (
            model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2]
        )  # fmt: skip
        self._torques.append(gain * plant.data.ctrl + spring * plant.q + damper * plant.qd)
        while len(self._torques) > self._behind + 1:
            self._torques.popleft()
